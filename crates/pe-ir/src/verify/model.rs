//! Checks a model.
//!
//! Invariants:
//!
//! 1. There is at least one state and one output; no two variables have the same name.
//! 2. Numbers are finite, and the step, the span and periods positive.
//! 3. Expressions read variables that exist, and algebraic equations only those before them.
//! 4. States with a rate come last, and their rates exist.
//! 5. Motions name states, inputs and signals that exist; what has a partner behind or before it has it.
//! 6. With phases the last input is the step ratio.
//! 7. Tunable parameters stand still, and have a range.
//! 8. Angles change all the time, by equations of the spec.
//! 9. What jumps changes all the time, and is neither tunable nor an angle nor a signal.

use std::collections::BTreeSet;

use crate::index::{self, StateId};
use crate::mechanism::Mechanism;
use crate::model::{Entry, Expr, Function, Model, Solution, Variable, Waveform, step_count_problem};
use crate::motion::{Motion, Source};

/// Returns what is wrong with a model; empty if nothing is.
pub fn check(model: &Model) -> Vec<String> {
    let mut checker = Checker { model, violations: Vec::new() };
    checker.names();
    checker.settings();
    checker.equations();
    checker.states();
    checker.violations
}

struct Checker<'a> {
    model: &'a Model,
    violations: Vec<String>,
}

impl Checker<'_> {
    fn require(&mut self, holds: bool, violation: impl FnOnce() -> String) {
        if !holds {
            self.violations.push(violation());
        }
    }

    fn names(&mut self) {
        let model = self.model;
        self.require(!model.states.is_empty(), || "it has no state".to_owned());
        self.require(!model.outputs.is_empty(), || "it has no output".to_owned());
        let states = model.states.iter().map(|state| &state.name);
        let others = model.inputs.iter().map(|input| &input.name);
        let mut known = BTreeSet::new();
        for name in states.chain(others).chain(model.algebraics.iter().map(|algebraic| &algebraic.name)) {
            self.require(known.insert(name), || format!("two variables are called `{name}`"));
        }
    }

    fn settings(&mut self) {
        let model = self.model;
        for (what, number) in [("step", model.step), ("span", model.span)] {
            self.require(number.is_finite() && number > 0.0, || format!("its {what} is not positive"));
        }
        if let Some(problem) = step_count_problem(model.step, model.span) {
            self.violations.push(problem);
        }
        for rate in &model.rates {
            self.require(rate.period.is_finite() && rate.period > 0.0, || "a period is not positive".to_owned());
        }
        let mut before = 0.0;
        for phase in &model.phases {
            self.require(phase.until > before && phase.ratio > 0.0, || "phases do not ascend".to_owned());
            before = phase.until;
        }
        let has_ratio = matches!(model.inputs.last().map(|input| &input.waveform), Some(Waveform::Samples(_)));
        self.require(model.phases.is_empty() || has_ratio, || "it has phases and no step ratio".to_owned());
        for (low, high) in model.inputs.iter().filter_map(|input| input.range) {
            self.require(low.is_finite() && high.is_finite(), || "a range is not finite".to_owned());
        }
    }

    fn equations(&mut self) {
        let model = self.model;
        for (index, algebraic) in model.algebraics.iter().enumerate() {
            match &algebraic.expr {
                Expr::Solution(solution) => {
                    self.reads(&algebraic.expr, &algebraic.name, index);
                    self.require(is_system(solution), || format!("`{}` is no element of a solution", algebraic.name));
                }
                expr => self.expr(expr, &algebraic.name, index),
            }
        }
        for state in &model.states {
            state.equations().for_each(|expr| self.expr(expr, &state.name, model.algebraics.len()));
        }
        if let Some(mechanism) = &model.mechanism {
            let mut known = is_mechanism(mechanism);
            mechanism.each_variable(&mut |variable| known &= self.exists(variable, model.algebraics.len()));
            let states = mechanism.pairs.iter().flat_map(|(coordinate, velocity)| [coordinate, velocity]);
            known &= states.into_iter().all(|state| model.states.find(*state).is_some());
            self.require(known, || "its mechanism is not made of its variables".to_owned());
        }
        for output in &model.outputs {
            let exists = self.exists(output.variable, model.algebraics.len());
            self.require(exists, || format!("output `{}` is no variable", output.name));
        }
    }

    fn exists(&self, variable: Variable, algebraics: usize) -> bool {
        match variable {
            Variable::State(state) => self.model.states.find(state).is_some(),
            Variable::Input(input) => (index::at(input)) < self.model.inputs.len(),
            Variable::Algebraic(algebraic) => (index::at(algebraic)) < algebraics,
        }
    }

    fn reads(&mut self, expr: &Expr, name: &str, algebraics: usize) {
        let mut unknown = false;
        expr.each_variable(&mut |variable| unknown |= !self.exists(variable, algebraics));
        self.require(!unknown, || format!("the equation of `{name}` reads what is not known before it"));
    }

    fn expr(&mut self, expr: &Expr, name: &str, algebraics: usize) {
        self.reads(expr, name, algebraics);
        self.require(is_finite(expr), || format!("the equation of `{name}` has a number that is not finite"));
    }

    fn states(&mut self) {
        let model = self.model;
        let continuous = model.states.iter().take_while(|state| state.rate.is_none()).count();
        for (index, state) in model.states.numbered() {
            let name = &state.name;
            self.require(state.initial.is_finite(), || format!("`{name}` does not begin with a finite number"));
            self.require(index.index() < continuous || state.rate.is_some(), || {
                format!("`{name}` comes behind sampled states")
            });
            let still = state.range.is_some()
                && state.rate.is_none()
                && state.motion.is_none()
                && state.derivative == Expr::Constant(0.0);
            self.require(!state.tunable || still, || format!("`{name}` is tunable, and moves or has no range"));
            let turns = state.rate.is_none() && state.motion.is_none() && !state.tunable;
            self.require(!state.angle || turns, || {
                format!("`{name}` is an angle, and no state of the continuous part")
            });
            let jumps = turns && !state.angle;
            self.require(state.wait.is_none() || state.jump.is_some(), || format!("`{name}` waits and has no jump"));
            self.require(state.jump.is_none() || jumps, || format!("`{name}` jumps, and is no state that may"));
            let has_rate = state.rate.is_none_or(|rate| (index::at(rate)) < model.rates.len());
            self.require(has_rate, || format!("`{name}` has a rate that does not exist"));
            if let Some(motion) = state.motion {
                let fits = self.motion(index, motion);
                self.require(fits, || format!("the motion of `{name}` names what does not exist"));
            }
        }
    }

    fn motion(&self, index: StateId, motion: Motion) -> bool {
        let model = self.model;
        let at = |index: Option<usize>| index.and_then(|index| model.states.get(index)).and_then(|state| state.motion);
        let source = |source: Source| match source {
            Source::Input(input) => (index::at(input)) < model.inputs.len(),
            Source::Signal(signal) => (index::at(signal)) < model.signals.len(),
        };
        let (next, before) = (at(Some(index.index() + 1)), at(index.index().checked_sub(1)));
        match motion {
            Motion::Clock => matches!(model.states[index].derivative, Expr::Constant(_)),
            Motion::Sine(speed) => speed.is_finite() && next == Some(Motion::Cosine(speed)),
            Motion::Cosine(speed) => before == Some(Motion::Sine(speed)),
            Motion::SweptSine(line) => model.states.find(line).is_some() && next == Some(Motion::SweptCosine(line)),
            Motion::SweptCosine(line) => before == Some(Motion::SweptSine(line)),
            Motion::Held(of) | Motion::After(of) => source(of),
            Motion::Line(of) => source(of) && next == Some(Motion::Before(of)),
            Motion::Before(of) => source(of) && before == Some(Motion::Line(of)),
            Motion::Delayed(seconds) => {
                let is_variable = matches!(model.states[index].derivative, Expr::Variable(_));
                seconds > 0.0 && is_variable && model.rates.is_empty() && model.phases.is_empty()
            }
            Motion::Along(..) => false,
        }
    }
}

fn is_finite(expr: &Expr) -> bool {
    match expr {
        Expr::Constant(number) => number.is_finite(),
        Expr::Variable(_) => true,
        Expr::Sum(members) | Expr::Product(members) => members.iter().all(is_finite),
        Expr::Power(base, exponent) => *exponent >= 2 && is_finite(base),
        Expr::Apply(function, argument) => {
            let own = if let Function::RealPower(exponent) = function { exponent.is_finite() } else { true };
            own && is_finite(argument)
        }
        Expr::Select(select) => [&select.condition, &select.yes, &select.no].into_iter().all(is_finite),
        // It is the whole of an algebraic equation.
        Expr::Solution(_) => false,
    }
}

/// Whether the parts of a mechanism fit each other, and are finite numbers and variables.
fn is_mechanism(mechanism: &Mechanism) -> bool {
    let Mechanism { pairs, mass, forces, jacobian, gaps, bends, drifts, penalty, .. } = mechanism;
    let simple = |value: &Expr| matches!(value, Expr::Variable(_)) || value.as_constant().is_some_and(f64::is_finite);
    let within = |entries: &[Entry], rows: usize| {
        entries.iter().all(|entry| index::at(entry.row) < rows && index::at(entry.column) < pairs.len())
    };
    forces.len() == pairs.len()
        && bends.len() == gaps.len()
        && (drifts.is_empty() || drifts.len() == gaps.len())
        && within(mass, pairs.len())
        && within(jacobian, gaps.len())
        && *penalty > 0.0
        && penalty.is_finite()
        && mechanism.parts().all(simple)
}

/// Whether a linear system is made of finite numbers and variables, each entry once and row by row.
fn is_system(solution: &Solution) -> bool {
    let Solution { matrix, right, row } = solution;
    let simple = |value: &Expr| matches!(value, Expr::Variable(_)) || value.as_constant().is_some_and(f64::is_finite);
    let places: Vec<(u32, u32)> = matrix.entries.iter().map(|entry| (entry.row, entry.column)).collect();
    let mirrored = || places.iter().all(|(row, column)| places.binary_search(&(*column, *row)).is_ok());
    *row < matrix.size
        && right.values.len() == index::at(matrix.size)
        && places.is_sorted_by(|one, next| one < next)
        && places.iter().all(|(row, column)| *row.max(column) < matrix.size)
        && (!matrix.symmetric || mirrored())
        && matrix.entries.iter().map(|entry| &entry.value).chain(&right.values).all(simple)
}
