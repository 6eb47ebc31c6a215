//! How well a design keeps the closures of a mechanism, and quantities that should stay constant, at every step: the run
//! in fixed point, and the same steps in double precision.

use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::at;
use pe_ir::mechanism::Mechanism;
use pe_ir::model::{Expr, Model, Solver, Variable};
use pe_ir::place::Place;
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;

use crate::conserved::Conserved;
use crate::runs::port_words;

/// The output that is followed without being asked for.
const ENERGY: &str = "energy";

/// Part of what its coordinates move a closure by that may be open without a word.
const OPEN: f64 = 1e-3;

/// The part from which on it moves as something else.
const APART: f64 = 0.1;

/// The largest of something over a run, and where it was.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Largest {
    /// Its magnitude, infinite where it is no number.
    pub size: f64,
    /// The closure, counted from 0.
    pub closure: usize,
    /// Time in seconds.
    pub time: f64,
}

/// What is left in one run of what should be zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Residual {
    /// Of the closures.
    pub gap: Largest,
    /// Of their rates, `J w`.
    pub opening: Largest,
    /// Largest distance of each quantity from its initial value.
    pub drifts: Vec<f64>,
    /// For each closure the largest magnitude, and how far it would open at most if each coordinate moved by itself.
    closures: Vec<(f64, f64)>,
}

/// Residuals of a design.
#[derive(Clone, Debug, PartialEq)]
pub struct Residuals {
    /// Names of the closures.
    pub closures: Vec<String>,
    /// Names of the quantities that should stay constant, with their initial values.
    pub conserved: Vec<(String, f64)>,
    /// In fixed point.
    pub fixed: Residual,
    /// In double precision.
    pub double: Residual,
}

impl Residuals {
    /// Runs a design over the span of its model; none if that states no mechanism.
    pub fn of(model: &Model, graph: &StepGraph, fixed: &FixedPoint, conserved: &[Conserved]) -> Option<Residuals> {
        let mechanism = model.mechanism.as_deref()?;
        let energy = model.outputs.iter().filter(|output| output.name == ENERGY);
        let energy = energy.map(|output| (output.name.clone(), output.variable));
        let mut followed: Vec<(String, Variable)> = conserved.iter().filter_map(Conserved::variable).collect();
        followed.extend(energy.filter(|(name, _)| conserved.iter().all(|own| own.name != *name)));
        let gauge = Gauge::of(model, mechanism, &followed);
        let states = model.states.len();
        let mut run = DoubleRun::new(graph);
        let double = gauge.followed(|step| {
            run.step(&model.sample_inputs(model.time(step, 0.0))).ok()?;
            Some(run.states().take(states).collect())
        });
        let mut run = FixedRun::new(graph, fixed);
        let fixed = gauge.followed(|step| {
            let words = port_words(model, &run, step);
            run.step(&words);
            Some(run.states().take(states).collect())
        });
        let name = |gap: &Expr| match gap {
            Expr::Variable(Variable::Algebraic(algebraic)) => model.algebraics[at(*algebraic)].name.clone(),
            _ => "0".to_owned(),
        };
        let values = gauge.initial().followed;
        Some(Residuals {
            closures: mechanism.gaps.iter().map(name).collect(),
            conserved: followed.into_iter().map(|(name, _)| name).zip(values).collect(),
            fixed,
            double,
        })
    }
}

impl Residuals {
    /// What is wrong with closures that are not kept, if that is so: a warning, and an error where the mechanism is no longer
    /// that of the spec.
    pub fn finding(&self, model: &Model) -> Option<Diagnostic> {
        let mechanism = model.mechanism.as_deref()?;
        let (closure, part) = self.fixed.loosest()?;
        if part <= OPEN {
            return None;
        }
        let in_double = self.double.loosest().map_or(0.0, |(_, part)| part);
        let message = format!(
            "closure `{}` is open by up to {:.1e}, {part:.1e} of what its coordinates move it by; in double precision by \
             {in_double:.1e} of that",
            self.closures[closure], self.fixed.closures[closure].0
        );
        let help = match (in_double > 0.5 * part, model.solver) {
            (false, _) => "the word is short: take a wider multiplier or more `--storage` bits".to_owned(),
            (true, Solver::Trapezoidal) => {
                format!("take a larger penalty than {}, or a smaller `--step`", mechanism.penalty)
            }
            (true, _) => {
                format!("take a larger penalty than {}, a larger rate, or `--solver trapezoidal`", mechanism.penalty)
            }
        };
        let finding = |code| Diagnostic::error(code, mechanism.span, message).with_help(help);
        Some(if part > APART { finding(codes::COMES_APART) } else { finding(codes::CLOSURES_OPEN).into_warning() })
    }
}

impl Residual {
    /// The closure that is open most, in parts of what its coordinates move it by.
    fn loosest(&self) -> Option<(usize, f64)> {
        let part = |(open, reach): &(f64, f64)| if *reach > 0.0 { open / reach } else { 0.0 };
        self.closures.iter().map(part).enumerate().max_by(|one, other| one.1.total_cmp(&other.1))
    }

    fn include(&mut self, reading: &Reading, initial: &Reading, time: f64) {
        let larger = |largest: &mut Largest, numbers: &[f64]| {
            for (closure, number) in numbers.iter().enumerate() {
                let size = if number.is_nan() { f64::INFINITY } else { number.abs() };
                if size > largest.size {
                    *largest = Largest { size, closure, time };
                }
            }
        };
        larger(&mut self.gap, &reading.gaps);
        larger(&mut self.opening, &reading.openings);
        for ((own, open), reach) in self.closures.iter_mut().zip(&reading.gaps).zip(&reading.reaches) {
            *own = (own.0.max(if open.is_nan() { f64::INFINITY } else { open.abs() }), own.1.max(*reach));
        }
        for ((drift, now), first) in self.drifts.iter_mut().zip(&reading.followed).zip(&initial.followed) {
            let distance = (now - first).abs();
            *drift = drift.max(if distance.is_nan() { f64::INFINITY } else { distance });
        }
    }
}

/// What is read at a place.
struct Reading {
    gaps: Vec<f64>,
    openings: Vec<f64>,
    reaches: Vec<f64>,
    followed: Vec<f64>,
}

/// Reads closures from states.
struct Gauge<'m> {
    /// The model without the equations that nothing here reads.
    model: Model,
    mechanism: &'m Mechanism,
    followed: &'m [(String, Variable)],
}

impl<'m> Gauge<'m> {
    fn of(model: &Model, mechanism: &'m Mechanism, followed: &'m [(String, Variable)]) -> Gauge<'m> {
        let mut read: Vec<Variable> = followed.iter().map(|(_, variable)| *variable).collect();
        let levers = mechanism.jacobian.iter().map(|entry| &entry.value);
        levers
            .chain(&mechanism.gaps)
            .chain(&mechanism.drifts)
            .for_each(|part| part.each_variable(&mut |variable| read.push(variable)));
        let needed = model.needed(read);
        let mut model = model.clone();
        for (algebraic, _) in model.algebraics.iter_mut().zip(needed).filter(|(_, needed)| !needed) {
            algebraic.expr = Expr::Constant(0.0);
        }
        Gauge { model, mechanism, followed }
    }

    fn initial(&self) -> Reading {
        let states: Vec<f64> = self.model.states.iter().map(|state| state.initial).collect();
        self.read(&states, 0.0)
    }

    /// What is left in a run, of which `step` takes the states through the next step, for as long as there are some.
    fn followed(&self, mut step: impl FnMut(u64) -> Option<Vec<f64>>) -> Residual {
        let (model, initial) = (&self.model, self.initial());
        let none = Largest::default();
        let drifts = vec![0.0; self.followed.len()];
        let closures = vec![(0.0, 0.0); self.mechanism.gaps.len()];
        let mut residual = Residual { gap: none.clone(), opening: none, drifts, closures };
        for done in 1..=model.steps() {
            let Some(states) = step(done - 1) else { break };
            let time = model.time(done, 0.0);
            residual.include(&self.read(&states, time), &initial, time);
        }
        residual
    }

    fn read(&self, states: &[f64], time: f64) -> Reading {
        let Gauge { model, mechanism, followed } = self;
        let inputs = model.sample_inputs(time);
        let place = Place::new(model, states, &inputs);
        let number = |part: &Expr| part.evaluate(&|variable| place.number(variable));
        let mut reaches = vec![0.0; mechanism.gaps.len()];
        let mut openings: Vec<f64> = mechanism.drifts.iter().map(number).collect();
        openings.resize(reaches.len(), 0.0);
        for lever in &mechanism.jacobian {
            let (coordinate, velocity) = mechanism.pairs[at(lever.column)];
            let (row, size) = (at(lever.row), number(&lever.value));
            openings[row] += size * states[velocity.index()];
            let state = &model.states[coordinate];
            let moved = if state.angle { 1.0 } else { (states[coordinate.index()] - state.initial).abs() };
            reaches[row] += size.abs() * moved;
        }
        Reading {
            gaps: mechanism.gaps.iter().map(number).collect(),
            openings,
            reaches,
            followed: followed.iter().map(|(_, variable)| place.number(*variable)).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mass on a rod in two coordinates, with its energy.
    const PENDULUM: &str = "model pendulum\nsolver trapezoidal\nstep 1 ms\nspan 0.5 s\nindex i in 1..2, j in 1..2, r in 1..1\n\
        state q[i] = [1, 0]\nstate w[i] = 0\nmatrix M[i, j] symmetric\nmatrix J[r, i]\nM[i, i] = 1\n\
        f[i] = if i == 2 then -9.81 else 0\nJ[r, i] = q[i]\ngap[r] = (q[1]^2 + q[2]^2 - 1)/2\nbend[r] = w[1]^2 + w[2]^2\n\
        energy = (w[1]^2 + w[2]^2)/2 + 9.81*q[2]\nq' = w\nw' = constrained(M, f, J, gap, bend, 400, 100)\n\
        output q, w, energy\n";

    fn model(text: &str) -> Model {
        let mut sources = pe_ir::source::Sources::new("m.spec", text);
        let compiled = pe_frontend::compile(&mut sources, &pe_frontend::NoFiles, &pe_frontend::Overrides::default());
        pe_hls::lift::lift(compiled.expect("a model").0)
    }

    /// What is left in the run of a model of what another says.
    fn residual(read: &str, stepped: &str) -> Residual {
        let (read, stepped) = (model(read), model(stepped));
        let energy = read.outputs.iter().find(|output| output.name == ENERGY).expect("it is an output");
        let followed = [(ENERGY.to_owned(), energy.variable)];
        let gauge = Gauge::of(&read, read.mechanism.as_deref().expect("it has one"), &followed);
        let graph = pe_hls::step::build(&stepped).expect("a step");
        let mut run = DoubleRun::new(&graph);
        gauge.followed(|_| {
            run.step(&[]).expect("it is finite");
            Some(run.states().take(read.states.len()).collect())
        })
    }

    #[test]
    fn closures_of_a_pendulum_are_kept_and_its_energy_drifts_little() {
        let own = residual(PENDULUM, PENDULUM);
        assert!(own.gap.size < 1e-6 && own.opening.size < 1e-6, "{own:?}");
        assert!(own.drifts[0] > 0.0 && own.drifts[0] < 1e-3, "{own:?}");
    }

    #[test]
    fn a_closure_that_is_not_kept_and_an_energy_that_is_none_are_seen() {
        let longer = PENDULUM.replace("[1, 0]", "[1.1, 0]").replace("q[2]^2 - 1)", "q[2]^2 - 1.21)");
        let open = residual(PENDULUM, &longer);
        assert!((0.104..0.106).contains(&open.gap.size) && open.gap.time > 0.0, "{open:?}");
        let slanted = PENDULUM
            .replace("J[r, i] = q[i]", "J[r, i] = q[i] + (if i == 1 then 1 else 0)")
            .replace("- 1)/2", "- 1)/2 + q[1] - 1")
            .replace("[1, 0]", "[1, 0.0]");
        assert!(residual(&slanted, PENDULUM).opening.size > 0.1);
        let loosest = |read: &str, stepped: &str| residual(read, stepped).loosest().expect("it has closures");
        assert!(loosest(PENDULUM, &longer).1 > 10.0 * OPEN && loosest(PENDULUM, PENDULUM).1 < 0.1 * OPEN);
        let lighter = PENDULUM.replace("9.81*q[2]\n", "9*q[2]\n");
        let drift = residual(&lighter, PENDULUM).drifts[0];
        assert!((0.5..2.0).contains(&drift), "{drift}");
    }
}
