//! The pivots of implicit methods and of linear systems over the run in double precision.
//!
//! The matrix of a step is `I - gamma h J` in the units of the states, and it is eliminated in a fixed order. A pivot is
//! 1 for a state that nothing moves and above 1 for one that decays; near zero the step is that of another model.

use pe_ir::codes;
use pe_ir::graph::{Elimination, Pivot, Role, StepGraph, ValueId};
use pe_ir::index::{StateId, at};
use pe_ir::mechanism::POINTS;
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Span};
use pe_sim::double::DoubleRun;

use crate::regular;

/// Smallest magnitude of a pivot that is accepted, beside the 1 of the identity.
pub(crate) const SMALLEST: f64 = 1.0 / (1u64 << 20) as f64;

const HELP: &str = "try half of the `--step`; where the model grows, its rate times the step must stay below 1";

/// What helps where the pivot of a linear system comes to zero.
pub(crate) fn help_of_system(model: &Model, pivot: &str) -> String {
    match (&model.mechanism, row_of(model, pivot)) {
        (Some(mechanism), Some(row)) => regular::of_mechanism(model, mechanism, row),
        _ => regular::of_system(model),
    }
}

/// The row of a mechanism's velocity in which a pivot is: of `w.matrix[3]`, and of `ahead[2]` in the implicit step.
fn row_of(model: &Model, pivot: &str) -> Option<usize> {
    let mechanism = model.mechanism.as_deref()?;
    let (matrix, row) = pivot.strip_suffix(']')?.rsplit_once('[')?;
    if POINTS.contains(&matrix) {
        return row.parse().ok().filter(|row| *row < mechanism.pairs.len());
    }
    let name = format!("{}[{row}]", matrix.strip_suffix(".matrix")?);
    mechanism.pairs.iter().position(|pair| model.states[pair.1].name == name)
}

/// The eliminations of linear systems with the least and the largest value of each pivot over the span. In: by value, the
/// arguments of the function that computes it.
///
/// # Errors
/// `E0824` if a pivot falls below 2^-20 of its largest value.
pub(crate) fn ranged(
    model: &Model,
    graph: &StepGraph,
    arguments: &[(f64, f64)],
) -> Result<Vec<Elimination>, Vec<Diagnostic>> {
    let mut eliminations = graph.eliminations.clone();
    let ranges = regular::ranges(graph, arguments);
    for pivot in eliminations.iter_mut().flat_map(|elimination| &mut elimination.pivots) {
        let Pivot::Varying { reciprocal, range } = pivot else { continue };
        *range = ranges.get(reciprocal).copied();
        let Some((low, high)) = *range else { continue };
        let (small, large) = (low.abs().min(high.abs()), low.abs().max(high.abs()));
        // Where it passes zero the table of its reciprocal says so.
        if low * high > 0.0 && small < SMALLEST * large {
            let name = name_of_pivot(graph, *reciprocal);
            let (time, span) = place_of(model, graph, *reciprocal, small);
            let message = format!(
                "the pivot of `{name}` falls from {large:.1e} to {small:.1e}, at t = {time:.6e} s: the matrix is nearly singular"
            );
            let help = help_of_system(model, name);
            return Err(vec![Diagnostic::error(codes::ZERO_PIVOT, span, message).with_help(help)]);
        }
    }
    Ok(eliminations)
}

fn name_of_pivot(graph: &StepGraph, reciprocal: u32) -> &str {
    graph.names.algebraics[at(reciprocal)].trim_end_matches(".pivot")
}

/// The time in seconds at which a pivot first has so small a magnitude, and the place of its equation.
fn place_of(model: &Model, graph: &StepGraph, reciprocal: u32, small: f64) -> (f64, Span) {
    let is_own = |value: &ValueId| matches!(graph.value(*value).role, Role::Algebraic(own, _) if own == reciprocal);
    let values: Vec<ValueId> = (0..graph.values.len()).map(ValueId::at).filter(is_own).collect();
    let span =
        values.iter().find_map(|value| graph.equation_of(*value)).map_or(Span::default(), |equation| equation.span);
    let mut run = DoubleRun::new(graph);
    for step in 0..model.steps() {
        let time = model.time(step, 0.0);
        let finite = run.step(&model.sample_inputs(time)).is_ok();
        let reached =
            values.iter().map(|value| run.argument(*value)).any(|(low, high)| low.abs().min(high.abs()) <= small);
        if reached || !finite {
            return (time, span);
        }
    }
    (model.span, span)
}

/// The row of a linear system whose pivot's reciprocal a value is, if it is one.
pub(crate) fn of_system(graph: &StepGraph, value: ValueId) -> Option<&str> {
    let Role::Algebraic(own, _) = graph.value(value).role else { return None };
    let is_own = |pivot: &Pivot| matches!(pivot, Pivot::Varying { reciprocal, .. } if *reciprocal == own);
    let mut pivots = graph.eliminations.iter().flat_map(|elimination| &elimination.pivots);
    pivots.any(is_own).then(|| name_of_pivot(graph, own))
}

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
