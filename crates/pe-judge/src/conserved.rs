//! Quantities that the model conserves, and their drift in a run.
//!
//! Linear invariants, such as a sum of concentrations, are found: the left null space of the derivatives at random
//! places near the solution. Others, such as an energy, are named by the user: outputs that shall stay constant.

use nalgebra::DMatrix;
use pe_ir::index::StateId;
use pe_ir::model::{Model, Variable};
use pe_ir::place::Place;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Models with more states are not searched for invariants: the search takes the cube of their number.
const MOST_STATES: usize = 200;

/// Places beyond the number of states at which the derivatives are taken.
const MORE_PLACES: usize = 8;

/// Invariants that are reported, at most.
const MOST_FOUND: usize = 8;

/// Part of a row below which nothing but rounding is left.
const ROUNDING: f64 = 1e-10;

/// Terms of an invariant that its name shows.
const SHOWN_TERMS: usize = 4;

/// A quantity that stays constant in the solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Conserved {
    /// Its name, or its formula.
    pub name: String,
    kind: Kind,
}

#[derive(Clone, Debug, PartialEq)]
enum Kind {
    /// A sum of states with their weights.
    Linear(Vec<(usize, f64)>),
    /// A variable of the model.
    Named(Variable),
}

/// How far a quantity drifted.
#[derive(Clone, Debug, PartialEq)]
pub struct Drift {
    /// The quantity.
    pub name: String,
    /// Largest distance from its value at the start, relative to that value; for a sum to that of its terms'
    /// magnitudes. Absolute if that is zero.
    pub drift: f64,
}

impl Conserved {
    /// The quantities of the user: outputs by their names.
    ///
    /// # Errors
    /// The first name that is no output of the model.
    pub fn named(model: &Model, names: &[String]) -> Result<Vec<Conserved>, String> {
        let find = |name: &String| {
            let output = model.outputs.iter().find(|output| output.name == *name).ok_or_else(|| name.clone())?;
            Ok(Conserved { name: name.clone(), kind: Kind::Named(output.variable) })
        };
        names.iter().map(find).collect()
    }

    /// The variable that it is; none of a sum.
    pub fn variable(&self) -> Option<(String, Variable)> {
        match self.kind {
            Kind::Linear(_) => None,
            Kind::Named(variable) => Some((self.name.clone(), variable)),
        }
    }

    /// The linear invariants of a model of at most 200 states whose magnitudes are `scales`.
    pub fn found(model: &Model, scales: &[f64]) -> Vec<Conserved> {
        let count = model.states.len();
        // Samples move states at once, which no derivative tells.
        if !(2..=MOST_STATES).contains(&count) || !model.rates.is_empty() {
            return Vec::new();
        }
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut place = || {
            let states: Vec<f64> = model
                .states
                .iter()
                .zip(scales)
                .map(|(state, scale)| near(&mut random, state.initial, if scale.is_finite() { *scale } else { 1.0 }))
                .collect();
            let inputs: Vec<f64> = model.inputs.iter().map(|_| random.random_range(0.1..1.0)).collect();
            let mut derivatives = Place::new(model, &states, &inputs).derivatives();
            // What stands for a signal is no part of anything conserved, nor what drops whole turns.
            for (derivative, state) in derivatives.iter_mut().zip(&model.states) {
                if state.motion.is_some() || state.angle {
                    *derivative = random.random_range(0.1..1.0);
                }
            }
            derivatives
        };
        let places: Vec<Vec<f64>> = (0..count + MORE_PLACES).map(|_| place()).collect();
        let fresh = place();
        if places.iter().flatten().any(|number| !number.is_finite()) {
            return Vec::new();
        }
        let vectors = null_space(count, &places);
        let conserved = vectors.into_iter().filter(|weights| {
            let parts = weights.iter().map(|(state, weight)| weight * fresh[*state]);
            let (sum, all) = parts.fold((0.0, 0.0), |(sum, all), part| (sum + part, all + part.abs()));
            sum.abs() <= ROUNDING * all
        });
        let of = |weights: Vec<(usize, f64)>| Conserved { name: formula(model, &weights), kind: Kind::Linear(weights) };
        conserved.take(MOST_FOUND).map(of).collect()
    }

    /// How far it drifts in a run: states at sample times, one sample after another.
    pub fn drift(&self, model: &Model, times: &[f64], samples: &[f64]) -> Drift {
        let start: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
        let value = |time: f64, states: &[f64]| -> (f64, f64) {
            match &self.kind {
                Kind::Linear(weights) => {
                    let parts = weights.iter().map(|(state, weight)| weight * states[*state]);
                    parts.fold((0.0, 0.0), |(sum, all), part| (sum + part, all + part.abs()))
                }
                Kind::Named(variable) => {
                    let number = Place::new(model, states, &model.sample_inputs(time)).number(*variable);
                    (number, number.abs())
                }
            }
        };
        let (first, size) = value(0.0, &start);
        let distance = |(time, states): (&f64, &[f64])| {
            let distance = (value(*time, states).0 - first).abs();
            if distance.is_nan() { f64::INFINITY } else { distance }
        };
        let largest = times.iter().zip(samples.chunks_exact(model.states.len())).map(distance).fold(0.0, f64::max);
        Drift { name: self.name.clone(), drift: if size > 0.0 { largest / size } else { largest } }
    }
}

/// A random number of the sign and size of a state.
fn near(random: &mut ChaCha8Rng, initial: f64, scale: f64) -> f64 {
    let size = if scale > 0.0 { scale } else { 1.0 };
    size * random.random_range(0.1..1.0) * if initial < 0.0 { -1.0 } else { 1.0 }
}

/// Weights of sums of states whose derivatives cancel at all places: the null space of the matrix of derivatives, reduced
/// so that each sum begins with a state that the others lack.
///
/// States that never change are left out: they say nothing about a run.
fn null_space(count: usize, places: &[Vec<f64>]) -> Vec<Vec<(usize, f64)>> {
    let largest = |state: usize| places.iter().fold(0.0f64, |most, place| most.max(place[state].abs()));
    // Every column has the same size, so that what cancels can be told from rounding.
    let moving: Vec<(usize, f64)> =
        (0..count).map(|state| (state, largest(state))).filter(|(_, largest)| *largest > 0.0).collect();
    if moving.is_empty() {
        return Vec::new();
    }
    let derivatives = DMatrix::from_fn(places.len(), moving.len(), |place, column| {
        let (state, largest) = moving[column];
        places[place][state] / largest
    });
    let decomposed = derivatives.svd(false, true);
    let directions = decomposed.v_t.expect("it was asked for");
    let still: Vec<usize> =
        (0..moving.len()).filter(|row| decomposed.singular_values[*row] <= ROUNDING * moving.len() as f64).collect();
    let mut basis =
        DMatrix::from_fn(still.len(), moving.len(), |row, column| directions[(still[row], column)] / moving[column].1);
    let rank = reduce(&mut basis);
    let weights = |row: usize| {
        let largest = basis.row(row).amax();
        // Weights of models are mostly whole numbers; the reduction leaves them off by rounding.
        let clean = |number: f64| {
            let rounded = libm::round(number);
            if (number - rounded).abs() <= 1e-9 * largest.max(1.0) { rounded } else { number }
        };
        let entries = basis.row(row).into_iter().zip(&moving).map(|(number, (state, _))| (*state, clean(*number)));
        entries.filter(|(_, weight)| weight.abs() > 1e-9 * largest).collect()
    };
    (0..rank).map(weights).collect()
}

/// Gauss and Jordan's reduction of rows: the leading entry of each is 1 and the only one in its column. Returns the rank.
fn reduce(rows: &mut DMatrix<f64>) -> usize {
    let mut done = 0;
    for column in 0..rows.ncols() {
        let usable = |row: &usize| rows[(*row, column)].abs() > 1e-6 * rows.row(*row).amax();
        let Some(found) = (done..rows.nrows()).find(usable) else { continue };
        rows.swap_rows(done, found);
        let pivot = rows[(done, column)];
        rows.row_mut(done).unscale_mut(pivot);
        let leading = rows.row(done).into_owned();
        for row in (0..rows.nrows()).filter(|row| *row != done) {
            let factor = rows[(row, column)];
            rows.row_mut(row).zip_apply(&leading, |number, other| *number -= factor * other);
        }
        done += 1;
    }
    done
}

/// A sum as a person writes it; the middle of a long one is left out.
fn formula(model: &Model, weights: &[(usize, f64)]) -> String {
    let mut text = String::new();
    for (position, (state, weight)) in weights.iter().enumerate() {
        if weights.len() > SHOWN_TERMS && position == SHOWN_TERMS - 1 {
            text += " + ...";
        }
        if weights.len() > SHOWN_TERMS && (SHOWN_TERMS - 1..weights.len() - 1).contains(&position) {
            continue;
        }
        let name = &model.states[StateId::at(*state)].name;
        let sign = if *weight < 0.0 { "-" } else { "+" };
        text += &match (position, *weight < 0.0) {
            (0, false) => String::new(),
            (0, true) => "-".to_owned(),
            _ => format!(" {sign} "),
        };
        let size = weight.abs();
        text += &if size == 1.0 { name.clone() } else { format!("{}*{name}", short(size)) };
    }
    text
}

/// A number with at most four digits.
fn short(number: f64) -> String {
    let rounded: f64 = format!("{number:.3e}").parse().unwrap_or(number);
    format!("{rounded}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The model of a spec's text.
    fn model(text: &str) -> Model {
        let mut sources = pe_ir::source::Sources::new("m.spec", text);
        pe_frontend::compile(&mut sources, &pe_frontend::NoFiles, &pe_frontend::Overrides::default())
            .expect("a model")
            .0
    }

    const ROBERTSON: &str = "model m\nsolver rk4\nstep 1 us\nspan 1 ms\nstate x = 1\nstate y = 0\nstate z = 0\n\
        x' = -0.04*x + 1e4*y*z\ny' = 0.04*x - 1e4*y*z - 3e7*y^2\nz' = 3e7*y^2\noutput x, y, z\n";

    #[test]
    fn the_mass_of_a_reaction_is_found_and_its_drift_measured() {
        let model = model(ROBERTSON);
        let found = Conserved::found(&model, &[1.0, 4e-5, 1.0]);
        assert_eq!(found.iter().map(|conserved| conserved.name.as_str()).collect::<Vec<_>>(), ["x + y + z"]);
        let drift = found[0].drift(&model, &[1.0, 2.0], &[0.5, 0.0, 0.5, 0.25, 0.25, 0.5 + 1e-6]);
        assert!((drift.drift - 1e-6).abs() < 1e-12, "{drift:?}");
    }

    #[test]
    fn a_leak_has_no_invariant_and_two_separate_cycles_have_two() {
        assert!(Conserved::found(&model(&ROBERTSON.replace("x' = -0.04", "x' = -0.05")), &[1.0, 4e-5, 1.0]).is_empty());
        let text = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nstate a = 1\nstate b = 0\nstate c = 1\nstate d = 0\n\
            a' = b - 2*a\nb' = 2*a - b\nc' = -6*c*a\nd' = 2*c*a\noutput a, b, c, d\n";
        let found = Conserved::found(&model(text), &[1.0; 4]);
        assert_eq!(found.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(), ["a + b", "c + 3*d"]);
    }

    #[test]
    fn a_named_quantity_is_an_output_and_drifts_as_it_is_evaluated() {
        let text = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nstate x = 1\nstate v = 0\nx' = v\nv' = -x\n\
            E = (x^2 + v^2)/2\noutput x, E\n";
        let model = model(text);
        let named = Conserved::named(&model, &["E".to_owned()]).unwrap();
        let drift = named[0].drift(&model, &[1.0], &[0.0, 1.1]);
        assert!((drift.drift - 0.21).abs() < 1e-12, "{drift:?}");
        assert_eq!(Conserved::named(&model, &["y".to_owned()]), Err("y".to_owned()));
    }
}
