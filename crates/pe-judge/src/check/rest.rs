//! Whether sampled parts come to rest when nothing excites them: zero-input limit cycles.
//!
//! Rounding may keep a filter moving, or hold it away from zero, long after its input has gone to zero. That is looked for
//! where it can be seen: the step in fixed point runs on with zero inputs, and zeros in the place of the continuous states,
//! from states of the run, until the slowest pole has passed below half an LSB.

use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_sim::fixed::FixedRun;
use pe_sim::linear::{Linearised, samples_are_affine};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::feedback::Feedback;
use crate::runs::Judged;

/// States of the run from which it is tried, and as many small ones at random.
const STARTS: usize = 8;

/// Part of the largest magnitudes, as a binary logarithm, below which the small ones are.
const SMALL: i32 = -10;

/// Products that all tries together may take.
const PRODUCTS: u64 = 200_000_000;

/// Decays of the slowest pole below half an LSB before the states have to rest: those of sections in a row add up.
const PATIENCE: f64 = 2.0;

/// Samples over which states have to stay at rest.
const WATCHED: u64 = 1000;

/// What became of sampled parts without inputs.
#[derive(Clone, Debug, PartialEq)]
pub enum Rest {
    /// All states came to exactly zero.
    Zero,
    /// A state did not.
    Ringing(Ringing),
    /// It was not tried, and why.
    NotTried(&'static str),
}

/// The state that is farthest from rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Ringing {
    /// The state.
    pub state: StateId,
    /// Largest magnitude in LSB of the storage bits.
    pub lsb: i64,
    /// Steps after which all words repeat; none if that takes longer than was watched.
    pub period: Option<u64>,
}

/// Runs a model's sampled parts without inputs; none for models without any.
pub fn rest(model: &Model, graph: &StepGraph, judged: &Judged) -> Option<Rest> {
    if model.rates.is_empty() {
        return None;
    }
    Some(settled(model, graph, &judged.fixed, judged).unwrap_or_else(Rest::NotTried))
}

/// Runs them with the formats of a fixed-point run.
///
/// # Errors
/// The reason why it was not tried.
pub(super) fn settled(
    model: &Model,
    graph: &StepGraph,
    fixed: &FixedPoint,
    judged: &Judged,
) -> Result<Rest, &'static str> {
    let feedback = Feedback::of(model).ok_or("no sampled state feeds back to itself, or too many do")?;
    if !samples_are_affine(model) {
        return Err("a sampled part is not linear");
    }
    let (states, inputs) = (vec![0.0; model.states.len()], vec![0.0; model.inputs.len()]);
    if Linearised::of_samples(model, &states, &inputs).derivatives.iter().any(|next| *next != 0.0) {
        return Err("zero is no equilibrium of a sampled part");
    }
    if !feedback.is_stable() {
        return Err("a sampled part alone has a pole on or outside of the unit circle");
    }
    let decay = -libm::log(feedback.slowest.max(1e-3));
    let samples = PATIENCE * f64::from(fixed.format.word_bits() + 1) * std::f64::consts::LN_2 / decay;
    let per_sample = model.ticks().map(|(_, steps)| steps).max().unwrap_or(1);
    let (quiet, watched) = (samples as u64 * per_sample, WATCHED * per_sample);
    if (quiet + watched).saturating_mul(graph.macs() * 2 * STARTS as u64) > PRODUCTS {
        return Err("it would take too long");
    }
    let points = judged.times.len();
    let mut worst: Option<Ringing> = None;
    let of_run = (1..=STARTS).map(|start| {
        let point = (start * points / STARTS).saturating_sub(1);
        judged.hardware.samples[point * model.states.len()..(point + 1) * model.states.len()].to_vec()
    });
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let small = (0..STARTS as i32).map(|start| {
        let mut scaled = |value: &f64| libm::scalbn(*value * random.random_range(-1.0..1.0), SMALL - start);
        graph
            .states
            .iter()
            .take(model.states.len())
            .map(|(state, _)| scaled(&judged.largest[state.index()]))
            .collect::<Vec<f64>>()
    });
    for from in of_run.chain(small) {
        if let Some(found) = Quiet::from(model, graph, fixed, &from).ringing(quiet, watched)
            && worst.as_ref().is_none_or(|worst| found.lsb > worst.lsb)
        {
            worst = Some(found);
        }
    }
    Ok(worst.map_or(Rest::Zero, Rest::Ringing))
}

/// A run without inputs.
struct Quiet<'a> {
    model: &'a Model,
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    run: FixedRun<'a>,
    steps: u64,
}

impl<'a> Quiet<'a> {
    /// A run from given states.
    fn from(model: &'a Model, graph: &'a StepGraph, fixed: &'a FixedPoint, states: &[f64]) -> Quiet<'a> {
        let mut run = FixedRun::new(graph, fixed);
        for (index, number) in states.iter().enumerate() {
            run.set_state(StateId::at(index), *number);
        }
        Quiet { model, graph, fixed, run, steps: 0 }
    }

    fn step(&mut self) {
        // Memories of the method stand behind the states of the model.
        let continuous = 0..self.model.continuous_states();
        for index in continuous.chain(self.model.states.len()..self.graph.states.len()) {
            self.run.set_state(StateId::at(index), 0.0);
        }
        let ticks = self.model.ticks().map(|(_, steps)| f64::from(u8::from(self.steps.is_multiple_of(steps))));
        let numbers = self.model.inputs.iter().map(|_| 0.0).chain(ticks);
        let words: Vec<i64> =
            numbers.enumerate().map(|(index, number)| self.run.encode_input(index, number).0).collect();
        self.run.step(&words);
        self.steps += 1;
    }

    /// Words of the sampled states.
    fn words(&self) -> Vec<i64> {
        let states = self.model.continuous_states()..self.model.states.len();
        states.map(|index| self.run.word(self.graph.states[StateId::at(index)].0)).collect()
    }

    /// The state that is farthest from zero while it is watched after a quiet time.
    fn ringing(mut self, quiet: u64, watched: u64) -> Option<Ringing> {
        (0..quiet).for_each(|_| self.step());
        let format = self.fixed.format;
        let half = if format.guard_bits == 0 { 0 } else { 1i64 << (format.guard_bits - 1) };
        let lsb = |word: &i64| ((word - format.data_offset() + half) >> format.guard_bits).abs();
        let (first, phase) = (self.words(), self.steps);
        let mut worst = Ringing { state: StateId::new(0), lsb: 0, period: None };
        let cycle = self.model.tick_cycle().unwrap_or(u64::MAX);
        for _ in 0..watched {
            self.step();
            let words = self.words();
            for (index, word) in words.iter().enumerate() {
                if lsb(word) > worst.lsb {
                    worst.lsb = lsb(word);
                    worst.state = StateId::at(self.model.continuous_states() + index);
                }
            }
            let done = self.steps - phase;
            if worst.period.is_none() && done.is_multiple_of(cycle) && words == first {
                worst.period = Some(done);
                break;
            }
        }
        // A state that no run reaches may overflow, which is another matter.
        let overflown = self.run.saturations().iter().any(|count| *count > 0);
        (worst.lsb > 0 && !overflown).then_some(worst)
    }
}
