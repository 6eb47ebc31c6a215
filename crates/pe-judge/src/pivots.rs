//! The pivots of implicit methods over the run in double precision.
//!
//! The matrix of a step is `I - gamma h J` in the units of the states, and it is eliminated in a fixed order. A pivot is
//! 1 for a state that nothing moves and above 1 for one that decays; near zero the step is that of another model.

use pe_ir::codes;
use pe_ir::graph::{Role, StepGraph, ValueId};
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;

/// Smallest magnitude of a pivot that is accepted, beside the 1 of the identity.
const SMALLEST: f64 = 1.0 / (1u64 << 20) as f64;

const HELP: &str = "try half of the `--step`; where the model grows, its rate times the step must stay below 1";

/// The smallest magnitude that the pivot of a state had.
#[derive(Clone, Debug, PartialEq)]
pub struct SmallestPivot {
    /// Name of the state.
    pub state: String,
    /// Magnitude.
    pub magnitude: f64,
}

/// The smallest pivot of a run of at most so many steps, its state and its time in seconds, those that are numbers among
/// them; none if there is no pivot.
pub fn over_run(model: &Model, graph: &StepGraph, steps: u64) -> Option<(SmallestPivot, f64)> {
    let pivots: Vec<(StateId, ValueId)> = (0..graph.values.len() as u32)
        .filter_map(|index| match graph.value(ValueId::new(index)).role {
            Role::Pivot(state, _) => Some((state, ValueId::new(index))),
            _ => None,
        })
        .collect();
    let mut run = DoubleRun::new(graph);
    let mut smallest: Option<(StateId, f64, f64)> =
        graph.constant_pivot.map(|(state, magnitude)| (state, magnitude, 0.0));
    for step in 0..if pivots.is_empty() { 0 } else { model.steps().min(steps) } {
        let time = model.time(step, 0.0);
        let finite = run.step(&model.sample_inputs(time)).is_ok();
        for (state, value) in &pivots {
            let magnitude = 1.0 / run.value(value.index()).abs();
            if magnitude.is_finite() && smallest.is_none_or(|(_, least, _)| magnitude < least) {
                smallest = Some((*state, magnitude, time));
            }
        }
        if !finite {
            break;
        }
    }
    let (state, magnitude, time) = smallest?;
    Some((SmallestPivot { state: graph.names.states[state].clone(), magnitude }, time))
}

/// The smallest pivot that varies, from the largest magnitude of each value of the graph; none if there is none.
///
/// # Errors
/// `E0905` if it, or one that is a number, is below 2^-20.
pub fn smallest(model: &Model, graph: &StepGraph, largest: &[f64]) -> Result<Option<SmallestPivot>, Vec<Diagnostic>> {
    if let Some((state, magnitude)) = graph.constant_pivot.filter(|(_, magnitude)| *magnitude < SMALLEST) {
        let state = &model.states[state];
        let message = format!(
            "the pivot of `{}` is {magnitude:.1e} in every step: the matrix of the step is nearly singular",
            state.name
        );
        return Err(vec![Diagnostic::error(codes::SMALL_PIVOT, state.span, message).with_help(HELP)]);
    }
    let reciprocals = graph.values.iter().zip(largest).filter_map(|(value, largest)| match value.role {
        Role::Pivot(state, _) => Some((state, value.equation?, 1.0 / largest)),
        _ => None,
    });
    let Some((state, equation, magnitude)) = reciprocals.min_by(|a, b| a.2.total_cmp(&b.2)) else { return Ok(None) };
    let state = graph.names.states[state].clone();
    if magnitude >= SMALLEST {
        return Ok(Some(SmallestPivot { state, magnitude }));
    }
    let time = over_run(model, graph, u64::MAX).map_or(0.0, |(_, time)| time);
    let message = format!(
        "the pivot of `{state}` falls to {magnitude:.1e} at t = {time:.6e} s: the matrix of the step is nearly singular"
    );
    let finding = Diagnostic::error(codes::SMALL_PIVOT, graph.equations[equation].span, message);
    Err(vec![finding.with_help(HELP)])
}
