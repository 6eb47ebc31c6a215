//! How far the step that accuracy would allow lies beyond the one that keeps a method stable.

use pe_ir::model::{Model, Solver};

use super::prediction::Prediction;
use super::question::{ACCURACY, MATRIX_STATES, SAFE};
use super::trials::Trials;
use super::trusted::Trusted;

/// Ratio from which on implicit methods are worth a trial: their steps cost a few times as much.
pub const STIFF: f64 = 5.0;

/// The step at which a method would have the error `goal`, over the stable one, from a step with its error. That step
/// may be more accurate than asked for because stability allows no larger one.
pub fn ratio(stable: f64, (step, error): (f64, f64), goal: f64, solver: Solver) -> f64 {
    let reserve = libm::pow((goal / error.max(1e-16)).max(1.0), 1.0 / f64::from(solver.order()));
    step / stable * reserve
}

/// Steps over the span that stability asks of RK4, at least, whatever the model's own method; none where [`explicit`]
/// has none.
pub fn steps(model: &Model) -> Option<f64> {
    let model = Model { solver: Solver::Rk4, phases: Vec::new(), ..model.clone() };
    let small = model.states.len() <= MATRIX_STATES;
    let limit = small.then(|| Prediction::of(&model, &Trusted::of(&model, None)).limit).flatten()?;
    Some(model.span / limit.step)
}

/// The ratio for RK4, whatever the model's own method; none if no mode limits its step, and for models that are too
/// large for methods with a matrix.
pub fn explicit(model: &Model) -> Option<f64> {
    if model.states.len() > MATRIX_STATES {
        return None;
    }
    let mut model = Model { solver: Solver::Rk4, phases: Vec::new(), ..model.clone() };
    let trusted = Trusted::of(&model, None);
    let stable = Prediction::of(&model, &trusted).limit?.step;
    model.step = SAFE * stable;
    // As much of the span as a trial may take.
    let trial = Trials::new(&model, &trusted).trial(Solver::Rk4, model.step)?;
    model.span = model.span.min(model.step * super::trials::affordable(trial.graph.macs()) as f64);
    let error = Trials::new(&model, &trusted).method_error(Solver::Rk4, model.step)?;
    Some(ratio(stable, (model.step, error), ACCURACY, Solver::Rk4))
}
