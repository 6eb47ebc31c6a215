//! Steps around events. There values change by jumps, which a run with another step or in other words makes a step earlier
//! or later: runs are compared at all other steps.

use pe_hls::step::{self, StepOptions};
use pe_ir::codes;
use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_ir::model::{Model, State};
use pe_ir::source::Diagnostic;
use pe_sim::double::DoubleRun;

use super::jumping::Jumping;

/// Steps before and behind an event that are left out, at least, and as a part of all steps: what an event that comes late
/// sets off comes late, too.
const FEWEST: u64 = 2;
const PART: u64 = 500;

/// Part of all steps that these may be. Where they would be more, a step is so long that being late by one counts.
const MOST_AROUND: u64 = 100;

/// Part of all steps that may be left out; where events come more often than that, none is.
const MOST_LEFT_OUT: u64 = 2;

/// Numbers of steps done at which runs are not compared, ascending.
pub(super) fn left_out(model: &Model) -> Vec<u64> {
    if !model.has_jumps() {
        return Vec::new();
    }
    let steps = model.steps();
    if FEWEST * MOST_AROUND > steps {
        return Vec::new();
    }
    let Ok(graph) = step::build_with(model, &StepOptions::default()) else { return Vec::new() };
    let events = events(model, &graph);
    let share = steps / (2 * MOST_LEFT_OUT * events.len().max(1) as u64);
    let around = (steps / PART).min(share).max(FEWEST);
    let mut all: Vec<u64> = Vec::new();
    for event in events {
        let from = all.last().map_or(1, |last| last + 1).max(event.saturating_sub(around));
        // The last step is what others count on.
        all.extend(from..=(event + around).min(steps - 1));
    }
    if all.len() as u64 * MOST_LEFT_OUT > steps { Vec::new() } else { all }
}

/// What a run says in which an event finds no place to wait in, by the largest magnitudes of values.
pub(super) fn lost(model: &Model, graph: &StepGraph, largest: &[f64]) -> Option<Diagnostic> {
    let is_lost = |(state, own): &(StateId, &State)| {
        own.stays_zero() && graph.states.find(*state).is_some_and(|(_, next)| largest[next.index()] > 0.0)
    };
    let (state, own) = model.states.numbered().find(is_lost)?;
    let mut run = DoubleRun::new(graph);
    let comes = |step: &u64| run.step(&model.sample_inputs(model.time(*step, 0.0))).is_err() || run.state(state) != 0.0;
    let time = (0..model.steps()).find(comes).map_or(model.span, |step| model.time(step + 1, 0.0));
    let event = own.name.split('.').next().unwrap_or(&own.name);
    let message = format!(
        "`{event}` finds no place to wait in at t = {time:.6e} s: four with a delay wait at most, four that are set off again before they \
         come, and none whose condition has become false while others came before it"
    );
    let help = "take a shorter delay, or a condition that becomes true less often";
    Some(Diagnostic::error(codes::EVENT_LOST, own.span, message).with_help(help))
}

/// Steps done when something jumps, as a run in double precision makes them.
fn events(model: &Model, graph: &StepGraph) -> Vec<u64> {
    let mut run = DoubleRun::new(graph);
    let mut jumping = Jumping::of(model, graph, |state| run.state(state));
    let mut found = Vec::new();
    for done in 1..=model.steps() {
        if run.step(&model.sample_inputs(model.time(done - 1, 0.0))).is_err() {
            break;
        }
        if jumping.jumped(|state| run.state(state), |value| run.value(value.index())).count() > 0 {
            found.push(done);
        }
    }
    found
}
