//! What the eigenvalues of the Jacobian say about steps.

use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_sim::linear::{Linearised, is_affine};
use pe_sim::spectrum::{eigenvalues, outer_eigenvalues};

use super::trusted::Trusted;

/// Points along the trajectory at which small models are linearised; all eigenvalues together may take the operations
/// below, so that larger ones have fewer.
const POINTS: usize = 150;
const OPERATIONS: f64 = 1e9;

/// States up to which all eigenvalues are computed, of models whose Jacobian is the same everywhere and of others.
const ALL_AFFINE: usize = 300;
const ALL: usize = 120;

/// Vectors of Arnoldi's method for larger ones.
const VECTORS: usize = 60;

/// Part of the largest magnitude below which an eigenvalue is rounding.
const ROUNDING: f64 = 1e-12;

/// Part of its magnitude below which the damping of a mode is too small to matter: whether a step is stable for it is a
/// question of how much it grows over the span.
const UNDAMPED: f64 = 1e-3;

/// Natural logarithm of the growth from which on a mode is unstable. A mode that is fast for a step or two has no time for
/// it; with more than this, steps count as stable that are too large for modes that come and go.
const GROWN: f64 = 1.0;

/// Ratio of neighbouring steps in search of the one at which a mode has the time, and how many are looked at.
const STRIDE: f64 = 1.02;
const STRIDES: usize = 70;

/// Multiplications with the Jacobian that find the states of its fastest mode.
const POWER_STEPS: usize = 30;

/// How the eigenvalues were found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// All of them.
    All,
    /// The outer ones, estimated.
    Outer,
    /// None: a bound of their magnitude.
    Bound,
}

impl Basis {
    /// The name that reports have for it.
    pub fn name(self) -> &'static str {
        match self {
            Basis::All => "all eigenvalues",
            Basis::Outer => "outer eigenvalues, estimated",
            Basis::Bound => "bound",
        }
    }
}

/// The mode that limits the step.
#[derive(Clone, Debug, PartialEq)]
pub struct Limit {
    /// Largest stable step in seconds.
    pub step: f64,
    /// Time at which the model was linearised.
    pub time: f64,
    /// Real and imaginary part of the eigenvalue, in 1/s.
    pub eigenvalue: (f64, f64),
    /// The state that moves most in the fastest mode at that time.
    pub state: StateId,
}

/// What is known from the model linearised along a trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// How eigenvalues were found.
    pub basis: Basis,
    /// At how many times.
    pub points: usize,
    /// What limits the step; none if no damped mode does.
    pub limit: Option<Limit>,
    /// The fastest decay, in 1/s.
    pub fastest: f64,
    /// Bound of the magnitude of all eigenvalues, in 1/s.
    pub bound: f64,
    /// Natural logarithm of what the method makes of undamped modes over the span; 0 if it does not let them grow.
    pub growth: f64,
    /// Spectra, kept to answer for other methods.
    spectra: Vec<Spectrum>,
}

/// Eigenvalues at a time.
#[derive(Clone, Debug, PartialEq)]
struct Spectrum {
    time: f64,
    /// Time for which it stands, in seconds.
    duration: f64,
    values: Vec<(f64, f64)>,
    /// The fastest growth, at least 0.
    rightmost: f64,
}

impl Prediction {
    /// Linearises a model along a trajectory.
    pub fn of(model: &Model, trusted: &Trusted) -> Prediction {
        let states = model.states.len();
        let affine = is_affine(model);
        let small = states <= if affine { ALL_AFFINE } else { ALL };
        let operations =
            if small { 25.0 * (states * states * states) as f64 } else { (states * VECTORS * VECTORS * 4) as f64 };
        let most = if affine { 1 } else { POINTS };
        let points = trusted.points(((OPERATIONS / operations.max(1.0)) as usize).clamp(most.min(5), most));
        let mut basis = if small { Basis::All } else { Basis::Outer };
        let mut bound: f64 = 0.0;
        let mut spectra = Vec::with_capacity(points.len());
        for point in &points {
            let linear = Linearised::at(model, trusted.at(*point), &model.sample_inputs(trusted.times[*point]));
            // A kink or a singularity right there says nothing about the steps around it.
            if !linear.is_finite() {
                continue;
            }
            let row_bound = linear.row_bound();
            bound = bound.max(row_bound);
            let values = if small {
                eigenvalues(states, &linear.dense())
            } else {
                outer_eigenvalues(states, VECTORS, |vector| linear.product(vector))
            };
            let values = values.unwrap_or_else(|| {
                basis = Basis::Bound;
                vec![(-row_bound, 0.0)]
            });
            let rightmost = values.iter().map(|value| value.0).fold(0.0, f64::max);
            spectra.push(Spectrum { time: trusted.times[*point], duration: 0.0, values: damped(values), rightmost });
        }
        let times: Vec<f64> = spectra.iter().map(|spectrum| spectrum.time).collect();
        for (index, spectrum) in spectra.iter_mut().enumerate() {
            let between = |other: Option<&f64>, end: f64| other.map_or(end, |other| 0.5 * (spectrum.time + other));
            let before = index.checked_sub(1).map(|index| &times[index]);
            spectrum.duration = between(times.get(index + 1), model.span) - between(before, 0.0);
        }
        let fastest = spectra.iter().flat_map(|spectrum| &spectrum.values).map(|value| -value.0).fold(0.0, f64::max);
        let mut prediction =
            Prediction { basis, points: spectra.len(), limit: None, fastest, bound, growth: 0.0, spectra };
        prediction.growth = prediction.growth_of(model.solver, model.step, model.span);
        if let Some((step, time, eigenvalue)) = prediction.limit_of(model.solver) {
            let point = trusted.times.partition_point(|at| *at < time).min(trusted.count() - 1);
            let linear = Linearised::at(model, trusted.at(point), &model.sample_inputs(time));
            let of_time = prediction.spectra.iter().find(|spectrum| spectrum.time == time);
            let state = fastest_state(&linear, of_time.map_or(0.0, |spectrum| spectrum.rightmost));
            prediction.limit = Some(Limit { step, time, eigenvalue, state });
        }
        prediction
    }

    /// The largest stable step of a method, when it is reached and by which eigenvalue; none if no damped mode has one.
    pub fn limit_of(&self, solver: Solver) -> Option<(f64, f64, (f64, f64))> {
        let mut limit = self.first_limit_of(solver)?;
        // Modes that are the same all the time have all the time.
        let strides = if self.spectra.len() == 1 { 0 } else { STRIDES };
        for _ in 0..strides {
            let step = STRIDE * limit.0;
            let Some((time, eigenvalue)) = self.worst_without_growth(solver, step) else { break };
            limit = (step, time, eigenvalue);
        }
        Some(limit)
    }

    /// The time and the eigenvalue that a step amplifies most, if no mode has the time to grow; none if one has.
    fn worst_without_growth(&self, solver: Solver, step: f64) -> Option<(f64, (f64, f64))> {
        let mut grown: f64 = 0.0;
        let mut worst: Option<(f64, f64, (f64, f64))> = None;
        for spectrum in &self.spectra {
            let mut most = f64::NEG_INFINITY;
            for (re, im) in limiting(&spectrum.values, solver) {
                let growth = libm::log(solver.amplification(step * re, step * im));
                most = most.max(growth);
                if worst.is_none_or(|worst| growth > worst.0) {
                    worst = Some((growth, spectrum.time, (re, im)));
                }
            }
            // What grew before decays again where no mode is amplified.
            grown = (grown + most * spectrum.duration / step).max(0.0);
            if grown > GROWN {
                return None;
            }
        }
        worst.map(|(_, time, eigenvalue)| (time, eigenvalue))
    }

    /// The largest step at which no damped mode is amplified at any time.
    fn first_limit_of(&self, solver: Solver) -> Option<(f64, f64, (f64, f64))> {
        let mut limit: Option<(f64, f64, (f64, f64))> = None;
        for spectrum in &self.spectra {
            for (re, im) in limiting(&spectrum.values, solver) {
                // Most modes are far from limiting anything.
                let harmless = limit.is_some_and(|(step, ..)| {
                    (1..=16).all(|k| {
                        solver.amplification(re * step * f64::from(k) / 16.0, im * step * f64::from(k) / 16.0) <= 1.0
                    })
                });
                if harmless {
                    continue;
                }
                if let Some(step) = solver.largest_step(re, im)
                    && limit.is_none_or(|(least, ..)| step < least)
                {
                    limit = Some((step, spectrum.time, (re, im)));
                }
            }
        }
        limit
    }

    /// Natural logarithm of what a method makes of undamped modes over the span.
    pub fn growth_of(&self, solver: Solver, step: f64, span: f64) -> f64 {
        let mut sum = 0.0;
        for spectrum in &self.spectra {
            let undamped = spectrum.values.iter().filter(|(re, im)| -re <= UNDAMPED * libm::hypot(*re, *im));
            let worst =
                undamped.map(|(re, im)| libm::log(solver.amplification(step * re, step * im))).fold(0.0, f64::max);
            sum += worst;
        }
        sum / self.spectra.len().max(1) as f64 * span / step
    }
}

/// The modes that a step is unstable for when it amplifies them: those that are damped, and the others too where the
/// method does not amplify all of them.
fn limiting(values: &[(f64, f64)], solver: Solver) -> impl Iterator<Item = (f64, f64)> {
    let all = solver.amplification(0.0, 0.1) <= 1.0;
    values.iter().copied().filter(move |(re, im)| all || -re > UNDAMPED * libm::hypot(*re, *im))
}

/// The modes that do not grow by themselves; what is rounding is left out.
fn damped(values: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let largest = values.iter().map(|(re, im)| libm::hypot(*re, *im)).fold(0.0, f64::max);
    let floor = ROUNDING * largest;
    let kept =
        values.into_iter().filter(|(re, im)| libm::hypot(*re, *im) > floor && *re < 1e-9 * libm::hypot(*re, *im));
    // A real part that is rounding is none.
    kept.map(|(re, im)| (re.min(-1e-15 * im.abs()), im)).collect()
}

/// The state that moves most when the fastest mode of a linearised model decays; no mode grows faster than `rightmost`.
fn fastest_state(linear: &Linearised, rightmost: f64) -> StateId {
    let mut vector: Vec<f64> = (0..linear.states()).map(|index| 1.0 + 0.1 * libm::sin(index as f64)).collect();
    for _ in 0..POWER_STEPS {
        let mut next = linear.product(&vector);
        // Shifted, so that what decays fast is farther from zero than what grows.
        next.iter_mut().zip(&vector).for_each(|(next, number)| *next -= rightmost * number);
        let largest = next.iter().fold(0.0f64, |most, number| most.max(number.abs()));
        if largest == 0.0 || !largest.is_finite() {
            break;
        }
        vector = next.into_iter().map(|number| number / largest).collect();
    }
    let largest = vector.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    StateId::at(largest.map_or(0, |(index, _)| index))
}

/// An eigenvalue in words.
pub fn eigenvalue((re, im): (f64, f64)) -> String {
    // A real part that is rounding is none.
    let re = if -re < 1e-9 * im.abs() { 0.0 } else { re };
    let imaginary = if im == 0.0 { String::new() } else { format!(" ± {:.2e} i", im.abs()) };
    format!("{re:.2e}{imaginary} 1/s")
}
