//! What a reference solution is, or why there is none; its times, and the magnitudes of states that errors are measured
//! by.

use differential_equations::ode::ODE;
use differential_equations::traits::State;
use pe_ir::index::{StateId, at};
use pe_ir::model::{Model, Waveform};

use super::equations::{Equations, Piece};
use super::states::States;
use crate::error::{SCALE_FLOOR, Trajectory};

/// Times closer than this, relative to their magnitude, are the same time.
pub(super) const TIME_RESOLUTION: f64 = 1e-14;

/// A method of the library.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Dormand and Prince, explicit, order eight.
    Dop853,
    /// Verner, explicit, order nine.
    Verner98,
    /// Radau IIA, implicit, order five.
    Radau5,
    /// Backward differentiation, implicit, multistep, order one to five.
    Bdf,
}

impl Method {
    /// The name that reports have for it.
    pub fn name(self) -> &'static str {
        match self {
            Method::Dop853 => "DOP853",
            Method::Verner98 => "Verner 9(8)",
            Method::Radau5 => "Radau5",
            Method::Bdf => "BDF",
        }
    }
}

/// States at the times asked for, and the method that found them.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The states.
    pub states: Trajectory,
    /// The method.
    pub method: Method,
    /// Times in seconds and states of all jumps, in the order of time.
    pub jumps: Vec<(f64, StateId)>,
}

/// Why there is no reference solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstacle {
    /// A derivative is not a finite number.
    NotFinite,
    /// The step became too small to go on, as it does before a singularity.
    StepUnderflow,
    /// The solution needs far more steps than the model's own solver, as stiff models do.
    TooManySteps,
}

/// No reference solution was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceError {
    /// Time in seconds that was reached.
    pub time: f64,
    /// What went wrong there.
    pub obstacle: Obstacle,
}

impl std::fmt::Display for ReferenceError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let reason = match self.obstacle {
            Obstacle::NotFinite => "a derivative is no longer a finite number",
            Obstacle::StepUnderflow => "the step became too small, as before a singularity",
            Obstacle::TooManySteps => "too many steps; the model may be stiff",
        };
        write!(f, "the reference solution stopped at t = {:.6e} s: {reason}", self.time)
    }
}

impl std::error::Error for ReferenceError {}

/// Magnitudes of the states, which absolute errors are measured by.
#[derive(Clone)]
pub(super) struct Scales {
    /// Of each state.
    pub own: Vec<f64>,
    /// Of each quantity: a state that has hardly moved is judged by it.
    shared: Vec<f64>,
    /// Quantity of each state.
    quantities: Vec<u32>,
    /// Whether they are still to be found.
    pub growing: bool,
}

impl Scales {
    /// Nothing is known yet but the numbers that the model starts from and is driven by. States far from an input
    /// begin to move with a high power of time; their relative error must not matter then.
    pub fn growing(model: &Model, equations: &Equations) -> Scales {
        const PART: f64 = 1e-9;
        let initial = States(model.states.iter().map(|state| state.initial).collect());
        let piece = Piece { from: 0.0, to: model.step, equations };
        let mut derivatives = initial.zeros_like();
        piece.diff(0.0, &initial, &mut derivatives);
        let bounds = model.waveforms().flat_map(|signal| [signal.bounds().0, signal.bounds().1]);
        let moved = derivatives.0.iter().map(|derivative| derivative * model.step);
        let largest = initial.0.iter().copied().chain(bounds).chain(moved).fold(0.0f64, |most, n| most.max(n.abs()));
        let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
        let count = quantities.iter().max().map_or(0, |last| at(*last) + 1);
        let shared = vec![PART * if largest > 0.0 && largest.is_finite() { largest } else { 1.0 }; count];
        Scales { own: vec![0.0; quantities.len()], shared, quantities, growing: true }
    }

    pub fn is_growing(&self) -> bool {
        self.growing
    }

    pub fn into_known(self) -> Scales {
        Scales { growing: false, ..self }
    }

    pub fn include(&mut self, states: &States) {
        for ((own, state), quantity) in self.own.iter_mut().zip(&states.0).zip(&self.quantities) {
            *own = own.max(state.abs());
            let shared = &mut self.shared[at(*quantity)];
            *shared = shared.max(*own);
        }
    }

    /// Absolute tolerance of each state.
    pub fn tolerances(&self, tolerance: f64) -> Vec<f64> {
        let floor = if self.growing { 1.0 } else { SCALE_FLOOR };
        let scale = |(own, quantity): (&f64, &u32)| own.max(floor * self.shared[at(*quantity)]);
        self.own.iter().zip(&self.quantities).map(|state| tolerance * scale(state)).collect()
    }
}

/// Whether a time lies behind another by more than rounding.
pub(super) fn after(time: f64, other: f64) -> bool {
    time - other > TIME_RESOLUTION * time.abs()
}

/// Zero, the breakpoints of the signals and the samples before `end`, and `end`, ascending. Every piece takes a step,
/// so that more breakpoints of a signal than `steps` are never reached.
pub(super) fn pieces(model: &Model, end: f64, steps: u64) -> Vec<f64> {
    let of_signal = |signal: &Waveform| signal.breakpoints(end).take(steps as usize).collect::<Vec<f64>>();
    let mut breakpoints: Vec<f64> = model.waveforms().flat_map(of_signal).collect();
    for rate in &model.rates {
        let samples = (1..=steps).map(|number| number as f64 * rate.period);
        breakpoints.extend(samples.take_while(|time| after(end, *time)));
    }
    breakpoints.sort_by(f64::total_cmp);
    let mut bounds = vec![0.0];
    for time in breakpoints {
        if after(time, bounds[bounds.len() - 1]) && after(end, time) {
            bounds.push(time);
        }
    }
    bounds.push(end);
    bounds
}

/// The states at time zero.
pub(super) fn beginning(model: &Model) -> States {
    States(model.states.iter().map(|state| state.initial).collect())
}

/// Goes through the pieces up to the last of the times: `cross` is given a piece, the times within it and the states
/// at its beginning, and gives those at its end. `steps` may be tried altogether.
pub(super) fn piece_by_piece(
    model: &Model,
    equations: &Equations,
    (times, steps): (&[f64], u64),
    mut cross: impl FnMut(&Piece, &[f64], States) -> Result<States, ReferenceError>,
) -> Result<(), ReferenceError> {
    let Some(end) = times.last() else { return Ok(()) };
    let (mut states, mut pending) = (beginning(model), times);
    for bounds in pieces(model, *end, steps).windows(2) {
        let piece = Piece { from: bounds[0], to: bounds[1], equations };
        let (in_piece, later) = pending.split_at(pending.partition_point(|time| !after(*time, piece.to)));
        pending = later;
        piece.sample(&mut states);
        states = cross(&piece, in_piece, states)?;
    }
    Ok(())
}
