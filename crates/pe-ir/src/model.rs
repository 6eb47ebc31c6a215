//! A model: flat equations with resolved names, as the front end produces them.
//!
//! Every array element is a variable of its own here; parameters and constants are folded into the expressions.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::index::{self, List, StateId, at};
use crate::mechanism::Mechanism;
use crate::motion::Motion;
use crate::source::Span;

pub use crate::expr::{Expr, Function, Select, Variable};
pub use crate::solution::{Entry, Matrix, Right, Solution};
pub use crate::solver::Solver;
pub use crate::waveform::{Chirp, Formula, Interpolation, Pwm, Samples, Unseen, Waveform};

/// A state variable and its equation.
#[derive(Clone, Debug)]
pub struct State {
    /// Name with indices, for example `V[3]`.
    pub name: String,
    /// Number of the declared quantity (array) it belongs to; scalars have one of their own.
    pub quantity: u32,
    /// Value at time zero.
    pub initial: f64,
    /// Range the user states, if any.
    pub range: Option<(f64, f64)>,
    /// Whether it is a tunable parameter: it stands still, and a host gives it values within the range.
    pub tunable: bool,
    /// Whether it is an angle: a number of turns, of which the step drops whole ones.
    pub angle: bool,
    /// Unit as written, without brackets.
    pub unit: Option<String>,
    /// Right-hand side of `state' = ...`; of `next state = ...` if it has a rate.
    pub derivative: Expr,
    /// What is added to it at the end of each step, of everything as the method leaves it there; none if nothing is.
    pub jump: Option<Expr>,
    /// A time in seconds that is added as well, counted in steps of the run, by a state that counts steps; none otherwise.
    pub wait: Option<Expr>,
    /// The rate in [`Model::rates`] at which the state takes its next value, held in between; none if it changes all
    /// the time.
    pub rate: Option<u32>,
    /// How it moves exactly, if it stands for a signal of the model.
    pub motion: Option<Motion>,
    /// The equation in the spec.
    pub span: Span,
}

/// How often a part of the model is sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// Seconds from one sample to the next; the first is at time zero.
    pub period: f64,
    /// Where a block with it begins in the spec.
    pub span: Span,
}

/// An algebraic equation `name = expr`.
#[derive(Clone, Debug)]
pub struct Algebraic {
    /// Name with indices.
    pub name: String,
    /// Unit as written.
    pub unit: Option<String>,
    /// Right-hand side.
    pub expr: Expr,
    /// Range the user states (`in lo .. hi`).
    pub range: Option<(f64, f64)>,
    /// Whether it is computed on its own even where it would cost less to put it in place where it is read.
    pub kept: bool,
    /// Whether it is an angle in radians: values that differ by whole turns are the same.
    pub angle: bool,
    /// The equation in the spec.
    pub span: Span,
}

/// A signal that the network plays: its states are told by their motion.
#[derive(Clone, Debug)]
pub struct Signal {
    /// The signal over time.
    pub waveform: Waveform,
    /// Where it is defined.
    pub span: Span,
}

/// An external input, sampled once per step.
#[derive(Clone, Debug)]
pub struct Input {
    /// Name with indices.
    pub name: String,
    /// Unit as written.
    pub unit: Option<String>,
    /// Declared signal.
    pub waveform: Waveform,
    /// Range the user states (`in lo .. hi`).
    pub range: Option<(f64, f64)>,
    /// What it is between two samples: the earlier one, sampled at the beginning of a step; or a straight line to the
    /// later one, which is what it is at the end of the step that takes it.
    pub between: Interpolation,
    /// The declaration.
    pub span: Span,
}

/// A variable that the user wants to see.
#[derive(Clone, Debug)]
pub struct Output {
    /// Name with indices, equal to the variable's own name.
    pub name: String,
    /// The variable.
    pub variable: Variable,
    /// Where it is asked for.
    pub span: Span,
}

/// A flat model. Algebraic equations are in dependency order: each reads only earlier ones.
///
/// Invariants: at least one state and one output; no duplicate names; every number finite; step and span positive.
#[derive(Clone, Debug)]
pub struct Model {
    /// Identifier from the `model` line, `[A-Za-z][A-Za-z0-9_]*`.
    pub name: String,
    /// Text after the name.
    pub title: String,
    /// Numerical method.
    pub solver: Solver,
    /// Step in seconds; with a list of steps the last one.
    pub step: f64,
    /// Other steps for the beginning of the run. With one or more of them the last input is the step ratio: what
    /// [`Model::step`] is divided by.
    pub phases: Vec<Phase>,
    /// Span in seconds over which ranges, error and stability are judged.
    pub span: f64,
    /// State variables with their equations; those with a rate come last.
    pub states: List<StateId, State>,
    /// Rates of the sampled parts.
    pub rates: Vec<Rate>,
    /// Algebraic equations.
    pub algebraics: Vec<Algebraic>,
    /// External inputs.
    pub inputs: Vec<Input>,
    /// Signals that the network plays.
    pub signals: Vec<Signal>,
    /// What the accelerations are made of, if motion is constrained.
    pub mechanism: Option<Arc<Mechanism>>,
    /// Outputs.
    pub outputs: Vec<Output>,
    /// Names of equations and inputs that no output depends on, in source order; they are gone from the lists above.
    pub left_out: Vec<String>,
}

/// A stretch at the beginning of a run with a step of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// Time in seconds at which it ends; those of a model ascend.
    pub until: f64,
    /// What the model's step is divided by here.
    pub ratio: f64,
}

/// Name of the input that says what the step is divided by, in models with a list of steps; with `_` behind it where
/// that is taken.
pub const STEP_RATIO: &str = "step_ratio";

/// Part of a step by which times may be off for being rounded numbers.
const TIME_SLACK: f64 = 1e-6;

/// Divisions of a period that are looked at for a step that suits all rates.
const MOST_DIVISIONS: u32 = 10_000;

/// Most steps over a span; a run of more would never end.
const MOST_STEPS: f64 = 1e10;

/// Why a span cannot be run in steps of this length, if so; both in seconds.
pub fn step_count_problem(step: f64, span: f64) -> Option<String> {
    let steps = span / step;
    if steps > MOST_STEPS {
        Some(format!("a span of {span} s takes {steps:.1e} steps of {step:e} s; at most {MOST_STEPS:e} can be run"))
    } else if span < step {
        Some(format!("a span of {span} s is shorter than a step of {step} s"))
    } else {
        None
    }
}

/// Whether a time is a whole number of steps, one at least.
fn is_whole(time: f64, step: f64) -> bool {
    let steps = time / step;
    let whole = libm::round(steps);
    whole >= 1.0 && (steps - whole).abs() <= TIME_SLACK * whole
}

impl Model {
    /// A model that has no variables yet. `step` and `span` in seconds.
    pub fn new(name: impl Into<String>, solver: Solver, step: f64, span: f64) -> Model {
        Model {
            name: name.into(),
            title: String::new(),
            solver,
            step,
            phases: Vec::new(),
            span,
            states: List::new(),
            rates: Vec::new(),
            algebraics: Vec::new(),
            inputs: Vec::new(),
            signals: Vec::new(),
            mechanism: None,
            outputs: Vec::new(),
            left_out: Vec::new(),
        }
    }

    /// The same as if it came from no spec: two models that differ only in where they are written become equal.
    #[must_use]
    pub fn without_spans(&self) -> Model {
        let mut model = self.clone();
        let none = Span::default();
        model.states.iter_mut().for_each(|state| state.span = none);
        model.algebraics.iter_mut().for_each(|algebraic| algebraic.span = none);
        model.inputs.iter_mut().for_each(|input| input.span = none);
        model.outputs.iter_mut().for_each(|output| output.span = none);
        model.signals.iter_mut().for_each(|signal| signal.span = none);
        model.rates.iter_mut().for_each(|rate| rate.span = none);
        if let Some(mechanism) = &mut model.mechanism {
            Arc::make_mut(mechanism).span = none;
        }
        model
    }

    /// Number of steps over the span, at least one.
    pub fn steps(&self) -> u64 {
        let (mut steps, mut from) = (0, 0.0);
        for phase in self.phases.iter().filter(|phase| phase.until < self.span) {
            steps += self.steps_of(from, phase);
            from = phase.until;
        }
        // A span that ends within the beginning ends with the step that is taken there.
        let ratio = self.phases.iter().find(|phase| phase.until >= self.span).map_or(1.0, |phase| phase.ratio);
        (steps + libm::round((self.span - from) * ratio / self.step) as u64).max(1)
    }

    fn steps_of(&self, from: f64, phase: &Phase) -> u64 {
        libm::round((phase.until - from) * phase.ratio / self.step) as u64
    }

    /// The time in seconds at which a step begins, plus a part of the step.
    pub fn time(&self, step: u64, part: f64) -> f64 {
        let (mut steps, mut from) = (step, 0.0);
        for phase in &self.phases {
            let own = self.steps_of(from, phase);
            if steps < own {
                return from + (steps as f64 + part) * (self.step / phase.ratio);
            }
            steps -= own;
            from = phase.until;
        }
        from + (steps as f64 + part) * self.step
    }

    /// Mean step over the span in seconds: the step, if there is only one.
    pub fn mean_step(&self) -> f64 {
        if self.phases.is_empty() { self.step } else { self.span / self.steps() as f64 }
    }

    /// The input that says what the step is divided by, if there is a list of steps.
    pub fn step_ratio(&self) -> Option<Variable> {
        (!self.phases.is_empty()).then(|| Variable::Input(index::number(self.inputs.len()) - 1))
    }

    /// Adds the input that [`Model::step_ratio`] names to a model with a list of steps.
    pub fn add_step_ratio(&mut self) {
        if self.phases.is_empty() {
            return;
        }
        let starts = std::iter::once(0.0).chain(self.phases.iter().map(|phase| phase.until)).collect();
        let ratios = self.phases.iter().map(|phase| phase.ratio).chain([1.0]).collect();
        let samples = Samples::new(starts, ratios, Interpolation::Hold).expect("phases ascend");
        self.inputs.push(Input {
            name: self.free_name(STEP_RATIO.to_owned()),
            unit: None,
            waveform: Waveform::Samples(Arc::new(samples)),
            range: None,
            between: Interpolation::Hold,
            span: Span::default(),
        });
    }

    /// A name that no variable has: this one, with `_` behind it where it is taken.
    pub fn free_name(&self, mut name: String) -> String {
        let taken = |name: &str| {
            self.states.iter().any(|state| state.name == name)
                || self.inputs.iter().any(|input| input.name == name)
                || self.algebraics.iter().any(|algebraic| algebraic.name == name)
        };
        while taken(&name) {
            name.push('_');
        }
        name
    }

    /// The inputs as a step that begins at `time` samples them, then the [ticks](Model::ticks).
    ///
    /// Times of steps and of jumps are rounded numbers: a jump that follows within a millionth of a step is meant to
    /// fall on the beginning of the step, and has happened.
    pub fn sample_inputs(&self, time: f64) -> Vec<f64> {
        self.hold_inputs(time, time)
    }

    /// The inputs of a step that begins at `time` and takes the inputs as they were in the step at the time `sampled`;
    /// interpolated ones as they are at its end.
    pub fn hold_inputs(&self, sampled: f64, time: f64) -> Vec<f64> {
        let inputs = self.inputs.iter().map(|input| self.sample_input(input, sampled));
        let step = libm::round(time / self.step) as u64;
        let ticks = self.ticks().map(|(_, steps)| if step.is_multiple_of(steps) { 1.0 } else { 0.0 });
        inputs.chain(ticks).collect()
    }

    /// One input as a step that begins at `time` samples it; an interpolated one as it is at the end of the step.
    pub fn sample_input(&self, input: &Input, time: f64) -> f64 {
        let time = match input.between {
            Interpolation::Hold => time,
            Interpolation::Linear => self.end_of_step(time),
        };
        input.waveform.piece(time + TIME_SLACK * self.step, time)
    }

    /// The end of the step that begins at a time.
    fn end_of_step(&self, time: f64) -> f64 {
        let slack = TIME_SLACK * self.tick();
        let phase = self.phases.iter().find(|phase| time + slack < phase.until);
        time + self.step / phase.map_or(1.0, |phase| phase.ratio)
    }

    /// Number of states that change all the time.
    pub fn continuous_states(&self) -> usize {
        self.states.partition_point(|state| state.rate.is_none())
    }

    /// Whether any state jumps at ends of steps.
    pub fn has_jumps(&self) -> bool {
        self.states.iter().any(|state| state.jump.is_some())
    }

    /// The same without jumps.
    #[must_use]
    pub fn without_jumps(&self) -> Model {
        let mut model = self.clone();
        model.states.iter_mut().for_each(|state| (state.jump, state.wait) = (None, None));
        model
    }

    /// Whether right-hand sides of states that change all the time have bends or jumps, where they are defined as they are
    /// or in algebraic equations; or jump at ends of steps.
    pub fn has_bends(&self) -> bool {
        if self.has_jumps() {
            return true;
        }
        let derivatives = self.states.iter().take(self.continuous_states()).map(|state| &state.derivative);
        let mut waiting: Vec<&Expr> = derivatives.collect();
        let mut seen = vec![false; self.algebraics.len()];
        while let Some(expr) = waiting.pop() {
            if expr.has_bends() {
                return true;
            }
            expr.each_variable(&mut |variable| {
                if let Variable::Algebraic(number) = variable
                    && !std::mem::replace(&mut seen[at(number)], true)
                {
                    waiting.push(&self.algebraics[at(number)].expr);
                }
            });
        }
        false
    }

    /// Tunable parameters, each with its range.
    pub fn tunables(&self) -> impl Iterator<Item = (&State, (f64, f64))> {
        self.states.iter().filter(|state| state.tunable).filter_map(|state| Some((state, state.range?)))
    }

    /// How many equations there are, in words.
    pub fn size(&self) -> String {
        let odes = self.odes();
        match self.states.len() - self.continuous_states() {
            0 => format!("{odes} ODEs"),
            sampled => format!("{odes} ODEs, {sampled} sampled states"),
        }
    }

    /// Steps after which all ticks repeat; none if that is beyond all numbers.
    pub fn tick_cycle(&self) -> Option<u64> {
        let divisor = |mut a: u64, mut b: u64| {
            while b > 0 {
                (a, b) = (b, a % b);
            }
            a
        };
        self.ticks().try_fold(1u64, |cycle, (_, steps)| (cycle / divisor(cycle, steps)).checked_mul(steps))
    }

    /// Steps from one sample of a rate to the next.
    fn steps_per_sample(&self, rate: &Rate) -> f64 {
        libm::round(rate.period / self.step)
    }

    /// The rates that are not sampled in every step, each with its steps per sample. Each has an input of the step graph,
    /// behind those of the model, that is 1 in the steps that begin with a sample and 0 in all others.
    pub fn ticks(&self) -> impl Iterator<Item = (u32, u64)> + '_ {
        let rates = (0..).zip(&self.rates).map(|(number, rate)| (number, self.steps_per_sample(rate) as u64));
        rates.filter(|(_, steps)| *steps > 1)
    }

    /// The outputs in the initial state with these numbers of the inputs; not finite where an equation has no value.
    pub fn initial_outputs(&self, inputs: &[f64]) -> Vec<f64> {
        let mut algebraics: Vec<f64> = Vec::with_capacity(self.algebraics.len());
        let number = |variable: Variable, known: &[f64]| match variable {
            Variable::State(state) => self.states[state].initial,
            Variable::Input(input) => inputs[at(input)],
            Variable::Algebraic(algebraic) => known[at(algebraic)],
        };
        // Each reads only earlier ones.
        for algebraic in &self.algebraics {
            algebraics.push(algebraic.expr.evaluate(&|variable| number(variable, &algebraics)));
        }
        self.outputs.iter().map(|output| number(output.variable, &algebraics)).collect()
    }

    /// For each algebraic equation whether its value is needed for that of some variables.
    pub fn needed(&self, variables: impl IntoIterator<Item = Variable>) -> Vec<bool> {
        let mut needed = vec![false; self.algebraics.len()];
        let mark = |variable: Variable, needed: &mut Vec<bool>| {
            if let Variable::Algebraic(algebraic) = variable {
                needed[at(algebraic)] = true;
            }
        };
        variables.into_iter().for_each(|variable| mark(variable, &mut needed));
        // Each reads only earlier ones.
        for index in (0..needed.len()).rev() {
            if needed[index] {
                self.algebraics[index].expr.each_variable(&mut |variable| mark(variable, &mut needed));
            }
        }
        needed
    }

    /// The model with its ticks as inputs.
    pub fn with_ticks(&self) -> Model {
        let mut model = self.clone();
        for (rate, _) in self.ticks() {
            let name = self.free_name(format!("tick_{}", rate + 1));
            let span = self.rates[at(rate)].span;
            model.inputs.push(Input {
                name,
                unit: None,
                waveform: Waveform::Constant(1.0),
                range: None,
                between: Interpolation::Hold,
                span,
            });
        }
        model
    }

    /// A rate whose period is no whole number of steps, if there is one, with the longest step up to the model's that
    /// suits the model, if a reasonable one does.
    pub fn unsuitable_rate(&self) -> Option<(Rate, Option<f64>)> {
        let first = self.rates.iter().find(|rate| !is_whole(rate.period, self.step))?;
        Some((*first, self.suitable_step(self.step)))
    }

    /// Whether all steps have to be equal: delays count steps, and events come at their ends.
    pub fn has_equal_steps(&self) -> bool {
        self.has_jumps() || self.delays().next().is_some()
    }

    /// The longest step up to this one of which periods and delays are whole multiples, all in seconds; none if no reasonable one
    /// is.
    pub fn suitable_step(&self, step: f64) -> Option<f64> {
        let periods = self.rates.iter().map(|rate| rate.period);
        let delays = self.delays().chain(self.waits()).map(|(_, seconds)| seconds);
        let times: Vec<f64> = periods.chain(delays).filter(|time| *time > 0.0).collect();
        let Some(first) = times.iter().copied().find(|time| !is_whole(*time, step)) else { return Some(step) };
        let fewest = libm::ceil(first / step - TIME_SLACK).max(1.0);
        let mut candidates = (0..MOST_DIVISIONS).map(|more| first / (fewest + f64::from(more)));
        candidates.find(|step| times.iter().all(|time| is_whole(*time, *step)))
    }

    /// The part that changes all the time: sampled states have become inputs, behind the model's own.
    pub fn continuous(&self) -> Model {
        let continuous = self.continuous_states();
        let inputs = self.inputs.len();
        let renamed = |variable: Variable| match variable {
            Variable::State(state) if state.index() >= continuous => {
                Variable::Input(index::number(inputs + state.index() - continuous))
            }
            other => other,
        };
        let mut model = self.clone();
        for held in model.states.vec_mut().drain(continuous..) {
            model.inputs.push(Input {
                name: held.name,
                unit: held.unit,
                waveform: Waveform::Constant(held.initial),
                range: held.range,
                between: Interpolation::Hold,
                span: held.span,
            });
        }
        model.rates.clear();
        for state in &mut model.states {
            state.equations_mut().for_each(|expr| *expr = expr.renamed(&renamed));
        }
        model.algebraics.iter_mut().for_each(|algebraic| algebraic.expr = algebraic.expr.renamed(&renamed));
        model.outputs.iter_mut().for_each(|output| output.variable = renamed(output.variable));
        model.share_systems();
        model
    }

    /// Lets equal matrices and right-hand sides of linear systems be one in memory.
    pub fn share_systems(&mut self) {
        let (mut matrices, mut rights) = (BTreeMap::new(), BTreeMap::new());
        for algebraic in &mut self.algebraics {
            let Expr::Solution(solution) = &mut algebraic.expr else { continue };
            let Solution { matrix, right, .. } = &mut **solution;
            matrix.clone_from(matrices.entry(matrix.number).or_insert_with(|| Arc::clone(matrix)));
            right.clone_from(rights.entry(right.number).or_insert_with(|| Arc::clone(right)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_steps_has_their_times() {
        let mut model = Model::new("m", Solver::Rodas3, 0.1, 40.0);
        model.phases = vec![Phase { until: 0.4, ratio: 200.0 }];
        model.add_step_ratio();
        assert_eq!(model.steps(), 800 + 396);
        for (step, part, time) in
            [(0, 0.0, 0.0), (1, 0.5, 7.5e-4), (800, 0.0, 0.4), (801, 0.5, 0.55), (1196, 0.0, 40.0)]
        {
            assert!((model.time(step, part) - time).abs() < 1e-12, "step {step}: {}", model.time(step, part));
        }
        for (step, ratio) in [(0, 200.0), (799, 200.0), (800, 1.0), (1195, 1.0)] {
            assert_eq!(model.sample_inputs(model.time(step, 0.0)), [ratio], "step {step}");
        }
        assert_eq!(Model { span: 0.2, ..model.clone() }.steps(), 400);
        assert_eq!(Model { step: 0.05, ..model }.steps(), 2 * 1196);
    }

    #[test]
    fn a_jump_on_the_beginning_of_a_step_has_happened_however_times_are_rounded() {
        let input = |waveform| Input {
            name: "u".to_owned(),
            unit: None,
            waveform,
            range: None,
            between: Interpolation::Hold,
            span: Span::default(),
        };
        let mut model = Model::new("m", Solver::Rk4, 50e-6, 12.0);
        model.inputs = vec![
            input(Waveform::Pulse { height: 1.0, start: 2.5, width: 0.15, offset: 0.0, period: f64::INFINITY }),
            input(Waveform::Square { amplitude: 1.0, frequency: 0.25, offset: 0.0, duty: 0.4 }),
        ];
        for step in 0..model.steps() {
            let inputs = model.sample_inputs(step as f64 * model.step);
            assert_eq!(inputs[0] > 0.0, (50_000..53_000).contains(&step), "pulse, step {step}");
            assert_eq!(inputs[1] > 0.0, step % 80_000 < 32_000, "square, step {step}");
        }
    }
}
