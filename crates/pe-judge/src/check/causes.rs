//! The cause behind a refusal: a solution that ends, a step that is unstable, a pivot near zero.

use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_sim::linear::Linearised;
use pe_sim::reference::Obstacle;

use super::prediction::{Prediction, eigenvalue};
use super::question::{SAFE, rounded};
use super::trials::affordable;
use super::trusted::Trusted;
use crate::pivots::{self, SmallestPivot};

/// Refusals that have such causes: the runs see what follows from them.
const SYMPTOMS: [&str; 7] = [
    codes::DIVERGED,
    codes::SATURATED,
    codes::STEP_TOO_LARGE,
    codes::OUTSIDE_DOMAIN,
    codes::SMALL_PIVOT,
    codes::WORD_TOO_SHORT,
    codes::NO_FORMAT,
];

/// What the relative rate of a state times what is left of the time is near a pole of the solution: its order.
const ORDERS: std::ops::Range<f64> = 0.2..20.0;

/// How far beyond the predicted limit a step has to be to be blamed without a trial.
pub(super) const BEYOND: f64 = 1.02;

/// Magnitude of a pivot from which down it is told: the step is within some percent of where it would be zero.
const NEAR_ZERO: f64 = 0.05;

/// The time at which the solution itself ends, and the state that leaves all bounds there. Refusals for a place where a
/// function has no value name that place and its time, which says more.
pub(super) fn end_of_solution(model: &Model, trusted: &Trusted, refusals: &[Diagnostic]) -> Option<(f64, usize)> {
    if refusals.iter().all(|refusal| refusal.code == codes::OUTSIDE_DOMAIN) {
        return None;
    }
    let end = trusted.end.filter(|end| end.obstacle != Obstacle::TooManySteps && end.time > 0.0)?;
    let last = trusted.count() - 1;
    let (time, at) = (trusted.times[last], trusted.at(last));
    let linear = Linearised::at(model, at, &model.sample_inputs(time));
    // What falls to zero is at its end as well, but leaves no bounds.
    let order = |state: usize| linear.derivatives[state] / at[state] * (end.time - time);
    let states = (0..model.continuous_states()).filter(|state| ORDERS.contains(&order(*state)));
    let state = states.max_by(|a, b| order(*a).total_cmp(&order(*b)))?;
    Some((end.time, state))
}

/// The refusal of a step that is unstable, whatever followed from that; none if it is not.
pub(super) fn unstable(model: &Model, prediction: &Prediction, refusal: &Diagnostic) -> Option<Diagnostic> {
    let limit = prediction.limit.as_ref().filter(|limit| model.step > BEYOND * limit.step)?;
    if !SYMPTOMS.contains(&refusal.code) {
        return None;
    }
    let state = &model.states[limit.state];
    let message = format!(
        "the step of {:e} s is unstable: {} lets `{}` grow above {:.2e} s, eigenvalue {} at t = {:.3e} s",
        model.step,
        model.solver.title(),
        state.name,
        limit.step,
        eigenvalue(limit.eigenvalue),
        limit.time
    );
    let help = format!("try `--step {:e}`", rounded(SAFE * limit.step));
    Some(Diagnostic::error(codes::STEP_TOO_LARGE, state.span, message).with_help(help))
}

/// The smallest pivot of a step that was refused for its error, with the time, if it is near zero.
pub(super) fn near_singular(model: &Model, graph: &StepGraph, refusal: &Diagnostic) -> Option<Diagnostic> {
    if ![codes::STEP_TOO_LARGE, codes::DIVERGED].contains(&refusal.code) {
        return None;
    }
    let (SmallestPivot { state, magnitude }, time) = pivots::over_run(model, graph, affordable(graph.macs()))?;
    if magnitude >= NEAR_ZERO {
        return None;
    }
    let index = model.states.ids().find(|own| model.states[*own].name == state)?;
    let place = match graph.constant_pivot {
        Some((_, constant)) if constant <= magnitude => format!("is {magnitude:.1e} in every step"),
        _ => format!("falls to {magnitude:.1e} at t = {time:.6e} s"),
    };
    let message = format!(
        "the pivot of `{state}` {place}: the matrix of the step is nearly singular there, and the result is wrong by more \
         than half"
    );
    let help = "where the model grows, its rate times the step must stay well below 1: try half of the `--step`";
    Some(Diagnostic::error(codes::SMALL_PIVOT, model.states[index].span, message).with_help(help))
}

/// Whether a refusal may have a cause of its own.
pub(super) fn is_symptom(refusal: &Diagnostic) -> bool {
    SYMPTOMS.contains(&refusal.code)
}
