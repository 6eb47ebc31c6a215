//! The solution of the model itself, by a library for ordinary differential equations.
//!
//! In: the model's equations and its declared signals, continuous in time. Out: all states at given times. Nothing is
//! shared with the step graph, and nothing with the solvers of the hardware, so that the comparison with a run says how
//! wrong that run is. The method is DOP853 of the crate `differential-equations`: explicit, of eighth order, its step
//! controlled by an error estimate (decision 0010). A stiff model, for which it needs too many steps, is solved by the
//! library's implicit Radau5 (decision 0027). Both are started anew wherever a signal jumps or bends, or a sample is
//! taken. Where more depends on it, a method of another family checks the first: Verner's explicit one of ninth order, and
//! for stiff models backward differentiation of up to fifth order, a multistep method (decision 0032).

mod equations;
mod features;
mod history;
mod interior;
mod solution;
mod states;
mod stiff;
mod waiting;

use differential_equations::error::Error;
use differential_equations::interpolate::Interpolation;
use differential_equations::methods::{
    Adaptive, BackwardDifferentiationFormula, DormandPrince, ExplicitRungeKutta, Ordinary,
};
use differential_equations::ode::OrdinaryNumericalMethod;
use differential_equations::status::Status;
use pe_ir::index::StateId;
use pe_ir::model::Model;

use self::equations::{Equations, Piece};
use self::interior::Interior;
pub use self::solution::{Method, Obstacle, ReferenceError, Solution};
use self::solution::{Scales, TIME_RESOLUTION, after, beginning, piece_by_piece};
use self::states::States;
use self::stiff::Stiff;
use crate::error::Trajectory;

/// Relative tolerance of reference solutions: what the summary and the report call "total error" is measured with it.
pub const TOLERANCE: f64 = 1e-12;

/// Relative tolerance of the first, rough solution, which only finds the magnitudes of the states.
const ROUGH_TOLERANCE: f64 = 1e-6;

/// Steps after which the solution is given up: this many, and `STEP_RATIO` for every step of the model. An explicit
/// method of eighth order needs fewer steps than the model's own wherever that one is stable and of use.
const STEP_FLOOR: u64 = 100_000;
const STEP_RATIO: u64 = 20;

/// Safety of a step that is chosen by what it is between its ends, and how much it may change.
const SAFETY: f64 = 0.9;
const CHANGE: (f64, f64) = (0.2, 2.0);

/// Steps of the model that a step of an explicit method may span where functions of time may be narrow. The widest gap
/// between its stages is about a quarter of that.
const LONGEST: f64 = 4.0;

/// All states of the model at `times`, which ascend from above zero, to a relative `tolerance`.
///
/// `progress` hears the time reached after every step, first in a rough solution, then in the one that counts.
///
/// # Errors
/// [`ReferenceError`] with the time at which the solution ends.
pub fn solve(
    model: &Model,
    times: &[f64],
    tolerance: f64,
    progress: &mut dyn FnMut(f64),
) -> Result<Trajectory, ReferenceError> {
    solve_with_limit(model, times, tolerance, explicit_steps(model), progress).map(|solution| solution.states)
}

/// The same, with the method that found it, and with a limit to the steps of the explicit method for those who cannot
/// wait.
///
/// # Errors
/// [`ReferenceError`] with the time at which the solution ends.
pub fn solve_with_limit(
    model: &Model,
    times: &[f64],
    tolerance: f64,
    steps: u64,
    progress: &mut dyn FnMut(f64),
) -> Result<Solution, ReferenceError> {
    match integrate::<DormandPrince853>(model, times, tolerance, steps, progress) {
        Err(ReferenceError { obstacle: Obstacle::TooManySteps, .. }) if Stiff::suits(model) => {
            let equations = Equations::new(model);
            let mut rough = Stiff::new(model, &equations, ROUGH_TOLERANCE, Scales::growing(model, &equations));
            rough.run(times, progress)?;
            let states = Stiff::new(model, &equations, tolerance, rough.scales.into_known()).run(times, progress)?;
            Ok(Solution { states, method: Method::Radau5, jumps: Vec::new() })
        }
        solved => solved.map(|(states, jumps)| Solution { states, method: Method::Dop853, jumps }),
    }
}

/// The same by another method, which shares no coefficient with that of [`solve`]: Verner's of ninth order with an
/// embedded one of eighth, and backward differentiation where that fails, as it does on stiff models.
///
/// # Errors
/// [`ReferenceError`] with the time at which the solution ends.
pub fn solve_by_second_method(model: &Model, times: &[f64], tolerance: f64) -> Result<Solution, ReferenceError> {
    let silent = &mut |_: f64| {};
    match integrate::<Verner98>(model, times, tolerance, explicit_steps(model), silent) {
        // Far beyond its stability a method of ninth order may as well overflow between two steps.
        Err(_) if Stiff::suits(model) => {
            let (states, jumps) = integrate::<Bdf>(model, times, tolerance, stiff::most_steps(model), silent)?;
            Ok(Solution { states, method: Method::Bdf, jumps })
        }
        solved => solved.map(|(states, jumps)| Solution { states, method: Method::Verner98, jumps }),
    }
}

/// Steps that an explicit method may take. Those of an implicit solver are no measure of what an explicit one needs: a
/// model that is given to one is likely stiff, and the method made for that has its turn before so many are wasted.
pub fn explicit_steps(model: &Model) -> u64 {
    let stiff = Stiff::suits(model) && model.solver.largest_step(-1.0, 0.0).is_none();
    STEP_FLOOR + if stiff { 0 } else { STEP_RATIO * model.steps() }
}

/// States at the times, and all jumps.
type Solved = (Trajectory, Vec<(f64, StateId)>);

/// Solves by a method of the library, first roughly, to learn the magnitudes of the states.
fn integrate<M: Driven>(
    model: &Model,
    times: &[f64],
    tolerance: f64,
    steps: u64,
    progress: &mut dyn FnMut(f64),
) -> Result<Solved, ReferenceError> {
    States::expect(model.states.len());
    let equations = &Equations::new(model);
    let scales = Scales::growing(model, equations);
    let longest = if features::of_time(model) { LONGEST * model.step } else { f64::INFINITY };
    // What a step reads must have been kept.
    let longest = longest.min(equations.history.borrow().shortest());
    let (kept, rough, jumps) = (f64::INFINITY, ROUGH_TOLERANCE, Vec::new());
    let mut rough = Integration { model, equations, tolerance: rough, scales, steps, longest, kept, jumps };
    rough.run::<M>(times, progress)?;
    let (scales, jumps) = (rough.scales.into_known(), Vec::new());
    let mut exact = Integration { model, equations, tolerance, scales, steps, longest, kept, jumps };
    let states = exact.run::<M>(times, progress)?;
    Ok((states, exact.jumps))
}

/// The methods with their types.
type DormandPrince853 = ExplicitRungeKutta<Ordinary, DormandPrince, f64, States, 8, 12, 16>;
type Verner98 = ExplicitRungeKutta<Ordinary, Adaptive, f64, States, 9, 16, 21>;
type Bdf = BackwardDifferentiationFormula<Ordinary, f64, States>;

/// What [`Integration`] asks of a method beside its steps.
trait Driven: OrdinaryNumericalMethod<f64, States> + Interpolation<f64, States> + Sized {
    /// The method with its first step.
    fn beginning(step: f64) -> Self;
    /// Sets a relative tolerance, and an absolute one of each state.
    fn tolerate(&mut self, relative: f64, absolute: Vec<f64>);
    /// Goes on with a step that was proposed before another one was cut short, which says nothing about the next.
    fn resume(&mut self, proposed: f64) {
        self.set_h(self.h().max(proposed));
    }
    /// Takes a shorter step than the method would.
    fn shorten(&mut self, longest: f64) {
        self.set_h(longest);
    }
}

impl Driven for DormandPrince853 {
    fn beginning(step: f64) -> Self {
        ExplicitRungeKutta::dop853().max_steps(usize::MAX).h0(step)
    }

    fn tolerate(&mut self, relative: f64, absolute: Vec<f64>) {
        (self.rtol, self.atol) = (relative.into(), absolute.into());
    }
}

impl Driven for Verner98 {
    fn beginning(step: f64) -> Self {
        ExplicitRungeKutta::rkv988e().max_steps(usize::MAX).h0(step)
    }

    fn tolerate(&mut self, relative: f64, absolute: Vec<f64>) {
        (self.rtol, self.atol) = (relative.into(), absolute.into());
    }
}

impl Driven for Bdf {
    fn beginning(step: f64) -> Self {
        BackwardDifferentiationFormula::adaptive().max_steps(usize::MAX).h0(step)
    }

    fn tolerate(&mut self, relative: f64, absolute: Vec<f64>) {
        (self.rtol, self.atol) = (relative.into(), absolute.into());
    }

    // Its past steps are scaled with the step: it must grow again by itself.
    fn resume(&mut self, _: f64) {}

    fn shorten(&mut self, _: f64) {}
}

/// Events that are found within one step of the model, at most; those beyond come at its end.
const MOST_IN_STEP: usize = 20;

/// One way through the times.
struct Integration<'a> {
    model: &'a Model,
    equations: &'a Equations<'a>,
    tolerance: f64,
    scales: Scales,
    /// Steps that may still be tried.
    steps: u64,
    /// The longest step in seconds.
    longest: f64,
    /// The longest step that is known well enough between its ends, in seconds.
    kept: f64,
    /// Times and states of jumps so far.
    jumps: Vec<(f64, StateId)>,
}

impl Integration<'_> {
    fn run<M: Driven>(&mut self, times: &[f64], progress: &mut dyn FnMut(f64)) -> Result<Trajectory, ReferenceError> {
        let (model, equations, steps) = (self.model, self.equations, self.steps);
        let mut samples = Trajectory::new(model.states.len());
        equations.history.borrow_mut().reset();
        equations.waiting.borrow_mut().reset();
        self.scales.include(&beginning(model));
        piece_by_piece(model, equations, (times, steps), |piece, times, states| {
            self.scales.include(&states);
            equations.history.borrow_mut().bend(piece.from, 0);
            let mut method: M = self.start(piece, piece.from, &states, model.step)?;
            for time in times {
                self.cross(&mut method, piece, *time, progress)?;
                samples.push(|state| piece.state(StateId::at(state), *time, method.y()));
            }
            self.cross(&mut method, piece, piece.to, progress)?;
            Ok(method.y().clone())
        })?;
        samples.largest.clone_from(&self.scales.own);
        Ok(samples)
    }

    /// The method at the beginning of a piece, or anew within it.
    fn start<M: Driven>(&self, piece: &Piece, time: f64, states: &States, step: f64) -> Result<M, ReferenceError> {
        piece.equations.history.borrow_mut().takes(time, time + step);
        if !piece.is_finite(time, states) {
            return Err(ReferenceError { time, obstacle: Obstacle::NotFinite });
        }
        let mut method = M::beginning(step.min(piece.to - time));
        method.tolerate(self.tolerance, self.scales.tolerances(self.tolerance));
        method
            .init(piece, time, piece.to, states)
            .map_err(|_| ReferenceError { time, obstacle: Obstacle::StepUnderflow })?;
        method.set_status(Status::Solving);
        Ok(method)
    }

    /// Integrates to `target` within the piece, with the jumps on the way: whether one is due is looked at where steps of the
    /// model end and events are due that wait, and between two of these it is found by bisection.
    fn cross<M: Driven>(
        &mut self,
        method: &mut M,
        piece: &Piece,
        target: f64,
        progress: &mut dyn FnMut(f64),
    ) -> Result<(), ReferenceError> {
        if !self.model.has_jumps() {
            return self.advance(method, piece, target, progress);
        }
        let step = self.model.step;
        let (mut found, mut within) = (0, 0.0);
        while after(target, method.t()) {
            let end_of_step = (libm::floor(method.t() / step + 1e-9) + 1.0) * step;
            let due = piece.equations.waiting.borrow().next().filter(|due| *due < end_of_step);
            let next = due.unwrap_or(end_of_step);
            let (from, begin) = (method.t(), method.y().clone());
            let bends = piece.equations.history.borrow().bends();
            let known = self.scales.growing.then(|| self.scales.clone());
            if end_of_step > within {
                (found, within) = (0, end_of_step);
            }
            let mut end = if after(target, next) { next } else { target };
            while let Err(ended) = self.advance(method, piece, end, progress) {
                // Where there is no solution up to the end of the step an event may come before.
                end = 0.5 * (from + end);
                let nothing_left = end - from <= TIME_RESOLUTION * end.max(step);
                if nothing_left || ended.obstacle == Obstacle::TooManySteps {
                    return Err(ended);
                }
                {
                    let mut history = piece.equations.history.borrow_mut();
                    history.cut(from);
                    history.set_bends(bends.clone());
                }
                if let Some(known) = &known {
                    self.scales = known.clone();
                }
                *method = self.start(piece, from, &begin, step)?;
            }
            let Some(mut behind) = piece.jumped(end, method.y()) else { continue };
            found += 1;
            let mut left = method.y().clone();
            if found < MOST_IN_STEP {
                let mut before = from;
                piece.equations.history.borrow_mut().keep(false);
                while end - before > TIME_RESOLUTION * end.max(step) {
                    let middle = 0.5 * (before + end);
                    if middle <= before || middle >= end {
                        break;
                    }
                    piece.equations.history.borrow_mut().set_bends(bends.clone());
                    let mut trial: M = self.start(piece, from, &begin, step)?;
                    self.advance(&mut trial, piece, middle, progress)?;
                    match piece.jumped(middle, trial.y()) {
                        Some(states) => (end, left, behind) = (middle, trial.y().clone(), states),
                        None => before = middle,
                    }
                }
            }
            {
                let mut history = piece.equations.history.borrow_mut();
                history.keep(true);
                history.cut(end);
                history.set_bends(bends);
                history.next(end);
                history.bend(end, 0);
            }
            if let Some(known) = known {
                // What the states would become without the event does not count.
                self.scales = known;
                self.scales.include(&left);
            }
            let behind = piece.equations.waiting.borrow_mut().take(end, behind);
            self.scales.include(&behind);
            let jumped = behind.0.iter().zip(&left.0).enumerate();
            self.jumps.extend(
                jumped.filter(|(_, (behind, left))| behind != left).map(|(state, _)| (end, StateId::at(state))),
            );
            // At the end of the piece nothing is left of it; the next one begins with the states behind the jumps.
            let rest = Piece { to: if after(piece.to, end) { piece.to } else { piece.to + step }, ..*piece };
            *method = self.start(&rest, end, &behind, step)?;
        }
        Ok(())
    }

    /// Integrates to `target` within the piece.
    fn advance<M: Driven>(
        &mut self,
        method: &mut M,
        piece: &Piece,
        target: f64,
        progress: &mut dyn FnMut(f64),
    ) -> Result<(), ReferenceError> {
        while after(target, method.t()) {
            let time = method.t();
            let fail = |obstacle| Err(ReferenceError { time, obstacle });
            let longest = self.longest.min(self.kept);
            if method.h() > longest {
                method.shorten(longest);
            }
            let (bend, bends) = piece.equations.history.borrow_mut().next(time);
            if bends {
                // The slope at the end of the last step is not that at the beginning of the next.
                let (states, proposed) = (method.y().clone(), method.h());
                *method = self.start(piece, time, &states, proposed)?;
            }
            let (proposed, remaining) = (method.h(), target.min(bend) - time);
            // Nearly there is there: the step after would be of the order of rounding.
            let last = 1.01 * proposed >= remaining;
            if last {
                method.set_h(remaining);
            } else if proposed.is_nan() || proposed <= TIME_RESOLUTION * piece.to {
                return fail(Obstacle::StepUnderflow);
            }
            if self.steps == 0 {
                return fail(Obstacle::TooManySteps);
            }
            self.steps -= 1;
            piece.equations.history.borrow_mut().takes(time, time + method.h());
            let begin = piece.equations.history.borrow().keeps().then(|| method.y().clone());
            match method.step(piece) {
                Ok(_) => {}
                Err(Error::Stiffness { .. }) => {
                    // The library gives up when stability limits the step for long, which costs time and no accuracy.
                    let states = method.y().clone();
                    *method = self.start(piece, time, &states, proposed)?;
                    continue;
                }
                Err(_) => return fail(Obstacle::StepUnderflow),
            }
            if matches!(method.status(), Status::RejectedStep) {
                continue;
            }
            if !method.y().0.iter().all(|state| state.is_finite()) {
                return fail(Obstacle::NotFinite);
            }
            if let Some(begin) = begin
                && !self.keep(method, piece, time, &begin)
            {
                *method = self.start(piece, time, &begin, self.kept)?;
                continue;
            }
            if last {
                method.resume(proposed);
            }
            if self.scales.growing {
                self.scales.include(method.y());
                method.tolerate(self.tolerance, self.scales.tolerances(self.tolerance));
            }
            progress(method.t());
        }
        Ok(())
    }

    /// Keeps the step that a method has taken, for what reads it later; false if it was too long for that.
    fn keep<M: Driven>(&mut self, method: &mut M, piece: &Piece, from: f64, begin: &States) -> bool {
        let to = method.t();
        let guesses: Result<Vec<States>, _> = interior::times(from, to).map(|time| method.interpolate(time)).collect();
        let tolerances = self.scales.tolerances(self.tolerance);
        let Interior { states, error } = match guesses {
            Ok(guesses) => interior::found(piece, (from, to), begin, guesses, &tolerances),
            Err(_) => Interior { states: Vec::new(), error: f64::INFINITY },
        };
        let change = SAFETY * libm::pow(error, -1.0 / (interior::NODES - 1) as f64);
        self.kept = (to - from) * change.clamp(CHANGE.0, CHANGE.1);
        if error <= 1.0 {
            let followed = |(time, states)| piece.followed(time, states);
            let values: Vec<f64> = interior::times(from, to).zip(&states).flat_map(followed).collect();
            piece.equations.history.borrow_mut().add(from, to, &values);
        }
        error <= 1.0
    }
}
