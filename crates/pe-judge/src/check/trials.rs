//! Cheap runs in double precision with other steps and methods.

use std::cell::RefCell;
use std::rc::Rc;

use pe_hls::step::{StepOptions, build_with};
use pe_ir::graph::StepGraph;
use pe_ir::index::{self, StateId};
use pe_ir::model::{Model, Solver};
use pe_sim::double::DoubleRun;

use super::trusted::Trusted;
use crate::runs::method_error;

/// Products that a trial may take; what takes more runs over the first part of the span only. A step costs as much as
/// some products more.
const PRODUCTS: u64 = 100_000_000;
const PRODUCTS_PER_STEP: u64 = 300;

/// Steps below which a trial says nothing.
const FEWEST_STEPS: u64 = 50;

/// Times at which a trial looks where the states are.
const LOOKS: u64 = 400;

/// Ratio of neighbouring trials while the limit is looked for, and ratio of its ends at which it is found.
const STRIDE: f64 = 1.5;
const CLOSE: f64 = 1.02;

/// Trials in search of a limit to either side.
const STRIDES: usize = 14;

/// Trials in search of the step for an accuracy, and the products that they may take: so many, this part of those of
/// the span with the model's own step, and so many for each product of a step, a part of what its mapping and its files
/// cost a compilation. What takes more is left to the order of the method.
const ACCURACY_TRIALS: usize = 6;
const ACCURACY_PRODUCTS: f64 = 1.5e6;
const ACCURACY_PART: f64 = 0.005;
const ACCURACY_MAPPING: f64 = 2e4;

/// Part of the accuracy asked for that trials aim at: what aims at all of it ends just above it as often as not.
const ACCURACY_AIM: f64 = 0.9;

/// Steps that a method error takes for each step: the step itself, and halves of it; quarters where there are bends.
const METHOD_STEPS: f64 = 3.0;
const BENT_STEPS: f64 = 7.0;

/// How a trial ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// All states stayed near where the trusted trajectory goes.
    Stable,
    /// A state left it, at this time in seconds.
    Unstable(f64),
    /// It would take too long, or the model has no such step.
    Impossible,
}

/// The end of the stable steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// Largest step that was found stable, in seconds.
    pub stable: f64,
    /// Smallest step that was found unstable; none if there is none worth a name.
    pub unstable: Option<f64>,
    /// Time over which trials ran, in seconds.
    pub span: f64,
}

/// A step for an accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// The step in seconds.
    pub step: f64,
    /// Its method error.
    pub error: f64,
    /// Whether it was tried; else the order of the method says so.
    pub tried: bool,
}

/// Steps of a trial, if each takes so many products.
pub fn affordable(macs: u64) -> u64 {
    PRODUCTS / (macs + PRODUCTS_PER_STEP)
}

/// Runs trials of a model.
pub struct Trials<'a> {
    model: &'a Model,
    /// Where states may be.
    low: Vec<f64>,
    high: Vec<f64>,
    /// Magnitudes to which errors of states are relative.
    scales: Vec<f64>,
    /// Time up to which the solution is known.
    end: f64,
    /// The latest trial: several things are asked of one after another.
    latest: RefCell<Option<Rc<Trial>>>,
}

/// The model with another method and step, and its step graph.
pub struct Trial {
    model: Model,
    /// The step graph.
    pub graph: StepGraph,
}

impl<'a> Trials<'a> {
    /// Trials are held against the range that a trusted trajectory visits: a state may leave it by its own width.
    pub fn new(model: &'a Model, trusted: &Trusted) -> Self {
        let states = model.states.len();
        let (mut low, mut high) = (trusted.at(0).to_vec(), trusted.at(0).to_vec());
        for sample in trusted.states.samples.chunks_exact(states.max(1)) {
            for (index, number) in sample.iter().enumerate() {
                low[index] = low[index].min(*number);
                high[index] = high[index].max(*number);
            }
        }
        // A transient that falls between the samples is part of the range.
        for (index, largest) in trusted.states.largest.iter().enumerate() {
            low[index] = low[index].min(-largest);
            high[index] = high[index].max(*largest);
        }
        // What hardly moves may move as far as others of its quantity, or of the model, do.
        let quantities = model.states.iter().map(|state| state.quantity).max().map_or(0, |last| index::at(last) + 1);
        let mut widths = vec![0.0f64; quantities];
        let mut largest = 0.0f64;
        for (state, (low, high)) in model.states.iter().zip(low.iter().zip(&high)) {
            let width = &mut widths[index::at(state.quantity)];
            *width = width.max(high - low).max(0.1 * high.abs().max(low.abs()));
            largest = largest.max(*width);
        }
        for (state, (low, high)) in model.states.iter().zip(low.iter_mut().zip(&mut high)) {
            let shared = widths[index::at(state.quantity)];
            let width = (*high - *low).max(1e-2 * shared).max(1e-6 * largest);
            let width = if width > 0.0 { width } else { f64::INFINITY };
            let width = if state.angle { f64::INFINITY } else { width };
            (*low, *high) = (*low - width, *high + width);
        }
        let of: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
        let scales = model.own_scales(trusted.states.scales(&of));
        Trials { model, low, high, scales, end: trusted.times[trusted.count() - 1], latest: RefCell::default() }
    }

    /// The model with another method and step; none if the method does not suit it.
    pub fn trial(&self, solver: Solver, step: f64) -> Option<Rc<Trial>> {
        let same = |trial: &&Rc<Trial>| (trial.model.solver, trial.model.step) == (solver, step);
        if let Some(latest) = self.latest.borrow().as_ref().filter(same) {
            return Some(Rc::clone(latest));
        }
        let model = Model { solver, step, ..self.model.clone() };
        let graph = build_with(&model, &StepOptions::default()).ok()?;
        let trial = Rc::new(Trial { model, graph });
        self.latest.replace(Some(Rc::clone(&trial)));
        Some(trial)
    }

    /// Time over which a trial of a step runs, if it is not the whole span.
    pub fn shortened(&self, solver: Solver, step: f64) -> Option<f64> {
        let graph = &self.trial(solver, step)?.graph;
        let span = step * affordable(graph.macs()) as f64;
        (span < self.end).then_some(span)
    }

    /// Whole steps of a trial up to where the solution is known.
    fn steps(&self, trial: &Model) -> u64 {
        if trial.phases.is_empty() {
            return (self.end / trial.step) as u64;
        }
        Model { span: self.end, ..trial.clone() }.steps()
    }

    /// Runs a step; with a list of steps the last of them, the others in their ratios to it.
    pub fn run(&self, solver: Solver, step: f64) -> Outcome {
        let Some(trial) = self.trial(solver, step) else { return Outcome::Impossible };
        let Trial { model, graph } = &*trial;
        let whole = self.steps(model);
        let steps = whole.min(affordable(graph.macs()));
        if steps < FEWEST_STEPS.min(whole).max(1) {
            return Outcome::Impossible;
        }
        let mut run = DoubleRun::new(graph);
        let stride = steps.div_ceil(LOOKS);
        for done in 1..=steps {
            let time = model.time(done - 1, 0.0);
            let finite = run.step(&model.sample_inputs(time)).is_ok();
            let looks = done % stride == 0 || done == steps;
            let inside = |index: usize| (self.low[index]..=self.high[index]).contains(&run.state(StateId::at(index)));
            if !finite || (looks && !(0..self.low.len()).all(inside)) {
                return Outcome::Unstable(time);
            }
        }
        Outcome::Stable
    }

    /// Looks for the end of the stable steps from a first guess on; none if no trial can be run.
    pub fn limit(&self, solver: Solver, guess: f64) -> Option<Found> {
        let longest = self.end / 4.0;
        if !self.model.rates.is_empty() {
            return self.limit_of_sampled(solver, longest);
        }
        let mut step = guess.min(longest);
        let (mut stable, mut unstable) = (None, None);
        for _ in 0..STRIDES {
            match self.run(solver, step) {
                Outcome::Impossible => break,
                Outcome::Stable => stable = Some(step),
                Outcome::Unstable(_) => unstable = Some(step),
            }
            match (stable, unstable) {
                (Some(_), Some(_)) => break,
                (Some(_), None) if step >= longest => break,
                (Some(_), None) => step = (step * STRIDE).min(longest),
                _ => step /= STRIDE,
            }
        }
        if let (Some(mut inside), Some(mut outside)) = (stable, unstable) {
            while outside / inside > CLOSE {
                let middle = libm::sqrt(inside * outside);
                match self.run(solver, middle) {
                    Outcome::Stable => inside = middle,
                    _ => outside = middle,
                }
            }
            (stable, unstable) = (Some(inside), Some(outside));
        }
        let steps = affordable(self.trial(solver, guess)?.graph.macs());
        let span = stable.map_or(0.0, |step: f64| step * steps as f64).min(self.end);
        Some(Found { stable: stable?, unstable, span })
    }

    /// The longest stable step of those that divide all periods.
    fn limit_of_sampled(&self, solver: Solver, longest: f64) -> Option<Found> {
        let (mut step, mut unstable) = (longest, None);
        for _ in 0..STRIDES {
            step = self.model.suitable_step(step)?;
            match self.run(solver, step) {
                Outcome::Impossible => break,
                Outcome::Stable => {
                    let steps = affordable(self.trial(solver, step)?.graph.macs());
                    return Some(Found { stable: step, unstable, span: (step * steps as f64).min(self.end) });
                }
                Outcome::Unstable(_) => unstable = Some(step),
            }
            step /= STRIDE;
        }
        None
    }

    /// Steps over the span, if each has this length.
    fn steps_of(&self, step: f64) -> f64 {
        self.model.steps() as f64 * self.model.step / step
    }

    /// Whether the method error of such a step can be found, if each takes so many products.
    pub fn affords_error(&self, macs: u64, step: f64) -> bool {
        self.steps_of(step) <= affordable(macs) as f64
    }

    /// Products that a run of such a step takes, and its method error, if that can be found.
    pub fn products(&self, macs: u64, step: f64) -> u64 {
        let steps = self.steps_of(step);
        let error = if self.affords_error(macs, step) { METHOD_STEPS * steps } else { 0.0 };
        ((steps.min(affordable(macs) as f64) + error) * (macs + PRODUCTS_PER_STEP) as f64) as u64
    }

    /// Method error of a step: what half of it changes, extrapolated; none if it cannot be run.
    pub fn method_error(&self, solver: Solver, step: f64) -> Option<f64> {
        let trial = self.trial(solver, step)?;
        let Trial { model, graph } = &*trial;
        if !self.affords_error(graph.macs(), step) || model.span < step {
            return None;
        }
        method_error(model, graph, &self.scales).ok()
    }

    /// The step at which the method error meets a goal, and the error there. `known` is the error of the model's step.
    /// None if that cannot be found by a few runs.
    pub fn accuracy_step(&self, graph: &StepGraph, known: f64, goal: f64, limit: Option<f64>) -> Option<Accuracy> {
        let order = f64::from(self.model.solver.order());
        let next = |step: f64, error: f64| {
            let ratio = libm::pow(ACCURACY_AIM * goal / error.max(1e-300), 1.0 / order);
            let step = (step * ratio.clamp(1e-3, 1e3)).min(limit.unwrap_or(f64::INFINITY)).min(self.end / 4.0);
            self.model.suitable_step(step).unwrap_or(step)
        };
        if known <= 0.0 || !known.is_finite() {
            return None;
        }
        let all = self.model.steps() as f64 * (graph.macs() + PRODUCTS_PER_STEP) as f64;
        let each = if self.model.has_bends() { BENT_STEPS } else { METHOD_STEPS };
        let cost = |step: f64| each * all * self.model.step / step;
        let mut left = ACCURACY_PRODUCTS + ACCURACY_PART * all + ACCURACY_MAPPING * graph.macs() as f64;
        let own = Accuracy { step: self.model.step, error: known, tried: true };
        let mut best = (known <= goal).then_some(own);
        let mut latest = own;
        for _ in 0..ACCURACY_TRIALS {
            let step = next(latest.step, latest.error);
            if best.is_some_and(|best| step <= 1.05 * best.step) {
                break;
            }
            left -= cost(step);
            if left < 0.0 {
                let error = latest.error * libm::pow(step / latest.step, order);
                return Some(Accuracy { step, error, tried: false });
            }
            match self.method_error(self.model.solver, step) {
                // Beyond the range in which the order means anything: half way back, in ratio.
                None => {
                    let between = libm::sqrt(best?.step * step);
                    let between = self.model.suitable_step(between).unwrap_or(between);
                    if left >= cost(between)
                        && let Some(error) = self.method_error(self.model.solver, between)
                        && error <= goal
                    {
                        best = Some(Accuracy { step: between, error, tried: true });
                    }
                    break;
                }
                Some(error) => {
                    latest = Accuracy { step, error, tried: true };
                    if error <= goal && best.is_none_or(|best| step > best.step) {
                        best = Some(latest);
                    }
                }
            }
        }
        best
    }
}
