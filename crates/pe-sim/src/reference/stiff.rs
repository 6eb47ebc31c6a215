//! The implicit method for stiff models: Radau5 of the library, driven from sample time to sample time.

use differential_equations::methods::{ImplicitRungeKutta, Ordinary, Radau};
use differential_equations::ode::OrdinaryNumericalMethod;
use differential_equations::status::Status;
use pe_ir::index::StateId;
use pe_ir::model::Model;

use super::equations::{Equations, Piece};
use super::solution::{Obstacle, ReferenceError, Scales, TIME_RESOLUTION, after, beginning, piece_by_piece};
use super::states::States;
use crate::error::Trajectory;

/// States of the largest model for it: its matrices are dense.
const MOST_STATES: usize = 400;

/// Operations that all its eliminations together may take, and steps that it may take in any case.
const OPERATIONS: f64 = 3e10;
const MOST_STEPS: f64 = 1e6;

/// The method's types: order five, three stages.
type Method = ImplicitRungeKutta<Ordinary, Radau, f64, States, 5, 3, 3>;

/// Steps that a method with a dense matrix may try.
pub(super) fn most_steps(model: &Model) -> u64 {
    let states = model.states.len() as f64;
    (OPERATIONS / (states * states * (states + 100.0))).min(MOST_STEPS) as u64
}

/// One way through the times.
pub(super) struct Stiff<'a> {
    model: &'a Model,
    equations: &'a Equations<'a>,
    tolerance: f64,
    /// Magnitudes of the states so far.
    pub scales: Scales,
    /// Steps that may still be tried.
    steps: u64,
}

impl<'a> Stiff<'a> {
    /// Whether a model is small enough.
    pub fn suits(model: &Model) -> bool {
        model.states.len() <= MOST_STATES && !model.has_jumps() && model.delays().next().is_none()
    }

    pub fn new(model: &'a Model, equations: &'a Equations<'a>, tolerance: f64, scales: Scales) -> Self {
        Stiff { model, equations, tolerance, scales, steps: most_steps(model) }
    }

    /// All states at the times.
    ///
    /// # Errors
    /// As of [`super::solve`].
    pub fn run(&mut self, times: &[f64], progress: &mut dyn FnMut(f64)) -> Result<Trajectory, ReferenceError> {
        let (model, equations, steps) = (self.model, self.equations, self.steps);
        let mut samples = Trajectory::new(model.states.len());
        self.scales.include(&beginning(model));
        piece_by_piece(model, equations, (times, steps), |piece, times, mut states| {
            self.scales.include(&states);
            let (mut time, mut step) = (piece.from, model.step);
            for target in times {
                states = self.advance(piece, (time, *target), states, &mut step, progress)?;
                time = *target;
                samples.push(|state| piece.state(StateId::at(state), *target, &states));
            }
            self.advance(piece, (time, piece.to), states, &mut step, progress)
        })?;
        Ok(samples)
    }

    /// The method at a time within a piece, with its first step.
    fn start(
        &self,
        piece: &Piece,
        time: f64,
        states: &States,
        step: f64,
    ) -> Result<impl OrdinaryNumericalMethod<f64, States> + use<>, ReferenceError> {
        if !piece.is_finite(time, states) {
            return Err(ReferenceError { time, obstacle: Obstacle::NotFinite });
        }
        // The library's own criterion for the end of its Newton iterations follows the tolerance if none is given. A
        // single relative tolerance would be transformed once for every state. The end of the interval limits its step.
        let mut method = Method::radau5()
            .newton_tol(0.0)
            .h0(step)
            .max_steps(usize::MAX)
            .rtol(vec![self.tolerance; states.0.len()])
            .atol(self.scales.tolerances(self.tolerance));
        method
            .init(piece, time, piece.to, states)
            .map_err(|_| ReferenceError { time, obstacle: Obstacle::StepUnderflow })?;
        method.set_status(Status::Solving);
        Ok(method)
    }

    /// Integrates from a time to another one within the piece; `step` is the step to begin with, and in the end the one
    /// to go on with.
    fn advance(
        &mut self,
        piece: &Piece,
        (from, target): (f64, f64),
        states: States,
        step: &mut f64,
        progress: &mut dyn FnMut(f64),
    ) -> Result<States, ReferenceError> {
        if !after(target, from) {
            return Ok(states);
        }
        let mut method = self.start(piece, from, &states, step.min(target - from))?;
        // The step that the method's matrices are for, once it has kept them for another step: from then on it does not
        // make new ones when the step changes, so that it has to be started anew.
        let mut kept: Option<f64> = None;
        while after(target, method.t()) {
            let (time, proposed) = (method.t(), method.h());
            let remaining = target - time;
            let last = 1.01 * proposed >= remaining;
            let taken = if last { remaining } else { proposed };
            if taken.is_nan() || (!last && taken <= TIME_RESOLUTION * piece.to) {
                return Err(ReferenceError { time, obstacle: Obstacle::StepUnderflow });
            }
            if self.steps == 0 {
                return Err(ReferenceError { time, obstacle: Obstacle::TooManySteps });
            }
            self.steps -= 1;
            if kept.is_some_and(|step| step != taken) {
                let states = method.y().clone();
                method = self.start(piece, time, &states, taken)?;
                kept = None;
            } else if last {
                method.set_h(taken);
            }
            if method.step(piece).is_err() {
                return Err(ReferenceError { time, obstacle: Obstacle::StepUnderflow });
            }
            if matches!(method.status(), Status::RejectedStep) {
                method.set_status(Status::Solving);
                continue;
            }
            if method.h() == taken {
                kept = Some(taken);
            }
            // A step that was cut short says nothing about the next.
            *step = if last { method.h().max(proposed) } else { method.h() };
            if self.scales.is_growing() {
                self.scales.include(method.y());
            }
            progress(method.t());
        }
        Ok(method.y().clone())
    }
}
