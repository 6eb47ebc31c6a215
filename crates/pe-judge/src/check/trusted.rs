//! A trajectory to linearise the model along: the run of the step itself where half the step hardly changes it, the
//! reference solution where it does, or where there is no run. An affine model is the same everywhere, so its own run
//! serves as long as it has the right magnitudes.

use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_sim::error::Trajectory;
use pe_sim::linear::is_affine;
use pe_sim::reference::{self, ReferenceError};

use crate::runs::Judged;

/// Method error up to which the run of the step is trusted.
const TRUSTED_ERROR: f64 = 0.02;

/// The same of an affine step: its modes are the same everywhere, and magnitudes are all that is taken from the run.
const TRUSTED_AFFINE_ERROR: f64 = 0.1;

/// Tolerance of the reference where it only says where the states go.
const TOLERANCE: f64 = 1e-7;

/// Times of a reference solution.
const SAMPLES: u32 = 150;

/// Products of numbers that the explicit reference may take before it is given up, and fewest steps.
const OPERATIONS: u64 = 200_000_000;
const FEWEST_STEPS: u64 = 2000;

/// Numbers that a trajectory keeps.
const MOST_NUMBERS: usize = 4_000_000;

/// States at times, the initial ones first.
#[derive(Clone, Debug)]
pub struct Trusted {
    /// Times in seconds, ascending from 0.
    pub times: Vec<f64>,
    /// States at these times.
    pub states: Trajectory,
    /// Whether it is the run of the step, and not the reference solution.
    pub own: bool,
    /// Why the solution does not reach the end of the span, if it does not.
    pub end: Option<ReferenceError>,
}

impl Trusted {
    /// The run of a judged step if it can be trusted, else the reference solution as far as it goes.
    pub fn of(model: &Model, judged: Option<(&StepGraph, &Judged)>) -> Trusted {
        let most = if is_affine(model) { TRUSTED_AFFINE_ERROR } else { TRUSTED_ERROR };
        if let Some((graph, judged)) = judged.filter(|(_, judged)| judged.errors.method <= most) {
            let mut trusted = Trusted::start(model, true);
            trusted.append(&judged.times, &judged.hardware);
            let states = graph.states.iter().take(model.states.len());
            trusted.states.largest = states.map(|(state, _)| judged.largest[state.index()]).collect();
            return trusted;
        }
        let terms = (model.states.len() + model.algebraics.len()).max(1) as u64;
        let steps = (OPERATIONS / (50 * terms)).max(FEWEST_STEPS);
        let solve = |end: f64| {
            let times: Vec<f64> = (1..=SAMPLES).map(|k| end * f64::from(k) / f64::from(SAMPLES)).collect();
            let solution = reference::solve_with_limit(model, &times, TOLERANCE, steps, &mut |_| {});
            solution.map(|solution| (times, solution.states))
        };
        let mut trusted = Trusted::start(model, false);
        let mut solution = solve(model.span);
        // Up to shortly before its end the solution exists.
        if let Err(error) = solution {
            trusted.end = Some(error);
            if error.time <= 0.0 {
                return trusted;
            }
            solution = solve(0.98 * error.time);
        }
        if let Ok((times, states)) = solution {
            trusted.append(&times, &states.principal(&model.turns()));
        }
        trusted
    }

    fn start(model: &Model, own: bool) -> Trusted {
        let mut states = Trajectory::new(model.states.len());
        states.push(|state| model.states[StateId::at(state)].initial);
        Trusted { times: vec![0.0], states, own, end: None }
    }

    /// Takes over samples, of a large model only so many that they do not weigh on the memory.
    fn append(&mut self, times: &[f64], states: &Trajectory) {
        let stride = (times.len() * states.states).div_ceil(MOST_NUMBERS).max(1);
        let samples = states.samples.chunks_exact(states.states.max(1));
        for (index, (time, sample)) in times.iter().zip(samples).enumerate() {
            if (times.len() - 1 - index).is_multiple_of(stride) {
                self.times.push(*time);
                self.states.push(|state| sample[state]);
            }
        }
    }

    /// Number of points, at least one.
    pub fn count(&self) -> usize {
        self.times.len()
    }

    /// States at a point.
    pub fn at(&self, point: usize) -> &[f64] {
        let count = self.states.states;
        &self.states.samples[point * count..(point + 1) * count]
    }

    /// So many points, evenly spread, the first and the last among them.
    pub fn points(&self, count: usize) -> Vec<usize> {
        let last = self.count() - 1;
        let count = count.clamp(1, self.count());
        let mut points: Vec<usize> = (0..count).map(|index| index * last / (count - 1).max(1)).collect();
        points.dedup();
        points
    }
}
