//! Closes a step into a loop in which successive steps overlap (software pipelining).

use super::problem::{Placement, Problem};
use pe_ir::word::Latency;

/// The smallest period at which steps can follow one another.
///
/// Operands of a step issue in words 0 .. period - 1; its last writes and receives may fall into the first words of
/// the next step, before the pause point. There they meet nothing: no operation of the new step writes that early.
pub(super) fn smallest(problem: &Problem, placement: &Placement) -> u32 {
    let latency = problem.latency;
    // The network pauses and samples inputs in every round.
    let mut period = latency.pause() + 1;
    for (chain, start) in problem.chains.iter().zip(&placement.starts) {
        period = period.max(start + chain.len() - 1 + chain.held);
    }
    for receive in &placement.receives {
        period = period.max((receive + 1).saturating_sub(latency.pause()));
    }
    for (slot, ready) in arrivals(problem, placement) {
        let first_read = placement.first_reads[slot];
        if first_read != u32::MAX {
            period = period.max(ready.saturating_sub(first_read));
        }
    }
    period
}

/// Earliest reads in the next placement so that the loop could close at `period`.
pub(super) fn releases(problem: &Problem, placement: &Placement, period: u32) -> Vec<u32> {
    let mut releases = vec![0; problem.slots];
    for (slot, ready) in arrivals(problem, placement) {
        releases[slot] = ready.saturating_sub(period);
    }
    releases
}

/// For each slot of a word from the step before: when the next step's word is there.
fn arrivals<'a>(problem: &'a Problem, placement: &'a Placement) -> impl Iterator<Item = (usize, u32)> + 'a {
    let (own, imported) = problem.returning();
    let own = own.map(|(slot, code, chain)| {
        let last = placement.starts[chain] + code.len() - 1;
        (slot, last + problem.latency.write() + code.write.delay + Latency::WRITE_TO_READ)
    });
    own.chain(imported.map(|(slot, import)| (slot, placement.receives[import] + Latency::WRITE_TO_READ)))
}
