//! Closes a step into a loop.

use super::list::Placement;
use super::problem::{NONE, Problem};
use pe_ir::graph::Role;
use pe_ir::word::Latency;

/// The smallest period at which steps can follow one another.
///
/// Operands of a step issue in words 0 .. period - 1; its last writes and receives may fall into the first words of
/// the next step, before the pause point. There they meet nothing: no operation of the new step writes that early.
pub(super) fn smallest(problem: &Problem, placement: &Placement) -> u32 {
    let latency = problem.latency;
    // The network pauses and samples inputs in every round.
    let mut period = latency.pause() + 1;
    for (chain, start) in problem.graph.chains.iter().zip(&placement.starts) {
        period = period.max(start + chain.len() - 1 + chain.writes().count() as u32);
    }
    for receive in &placement.receives {
        period = period.max((receive + 1).saturating_sub(latency.pause()));
    }
    for (ready, first_read) in arrivals(problem, placement) {
        if first_read != u32::MAX {
            period = period.max(ready.saturating_sub(first_read));
        }
    }
    period
}

/// Earliest reads in the next placement so that the loop could close at `period`.
pub(super) fn releases(problem: &Problem, placement: &Placement, period: u32) -> Vec<u32> {
    arrivals(problem, placement).map(|(ready, _)| ready.saturating_sub(period)).collect()
}

/// For each release slot: when the next step's word is there, and when this step first read its own.
fn arrivals<'a>(problem: &'a Problem, placement: &'a Placement) -> impl Iterator<Item = (u32, u32)> + 'a {
    let producers = problem.graph.producers();
    let own = problem.graph.values.iter().enumerate().map(move |(index, value)| {
        let ready = match value.role {
            Role::State(s) => {
                let next = problem.graph.states[s as usize].1;
                let chain = producers[next.index()];
                assert_ne!(chain, NONE, "every state has an end value");
                let code = &problem.graph.chains[chain as usize];
                let last = placement.starts[chain as usize] + code.len() - 1;
                last + problem.latency.write() + Latency::WRITE_TO_READ
            }
            _ => 0,
        };
        (ready, placement.first_reads[index])
    });
    let values = problem.graph.values.len();
    let imports = problem.imports.iter().enumerate().map(move |(index, import)| {
        let ready = match problem.graph.values[import.resident as usize].role {
            Role::State(_) => placement.receives[index] + Latency::WRITE_TO_READ,
            _ => 0,
        };
        (ready, placement.first_reads[values + index])
    });
    own.chain(imports)
}
