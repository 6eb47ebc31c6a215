//! Which mapping is taken: schedules candidates as far as they can still win, and ranks them.

use pe_hls::mapping::Candidate;
use pe_hls::schedule;
use pe_ir::graph::StepGraph;
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;

/// Schedules that are this much longer than the shortest are not considered, however few connections they have.
const PERIOD_TOLERANCE: f64 = 1.02;

/// A schedule of each candidate with its step graph. All get a draft; those that could still be the first by [`rank`] if
/// their products filled every cycle get the best schedule that can be found. `say` is told what is under way.
pub fn schedules(
    graphs: &[&StepGraph],
    candidates: &[Candidate],
    latency: Latency,
    max_in_degree: u32,
    say: &dyn Fn(String),
) -> Vec<Schedule> {
    let draft = |(candidate, graph): (&Candidate, &&StepGraph)| {
        say(format!("{}, first of two passes", candidate.start));
        schedule::draft(graph, &candidate.mapping, latency)
    };
    let mut schedules: Vec<Schedule> = candidates.iter().zip(graphs).map(draft).collect();
    let periods: Vec<u32> = schedules.iter().map(|schedule| schedule.period).collect();
    let loads: Vec<u32> = candidates.iter().zip(graphs).map(|(candidate, graph)| load(graph, candidate)).collect();
    for index in contenders(candidates, &loads, &periods, max_in_degree) {
        say(format!("{}, second pass", candidates[index].start));
        schedules[index] = schedule::schedule(graphs[index], &candidates[index].mapping, latency);
    }
    schedules
}

/// The most products of a PE as they are issued: the mapper may have counted on pairs that its mapping does not allow.
fn load(graph: &StepGraph, candidate: &Candidate) -> u32 {
    let mut loads = vec![0; candidate.mapping.pes as usize];
    for (load, pe) in graph.loads().iter().zip(&candidate.mapping.pe_of) {
        loads[*pe as usize] += load;
    }
    loads.into_iter().max().unwrap_or(0)
}

/// Candidates with the ports whose largest load leaves them room to win against what the others have reached.
fn contenders(candidates: &[Candidate], loads: &[u32], periods: &[u32], max_in_degree: u32) -> Vec<usize> {
    let permitted = || (0..candidates.len()).filter(|index| candidates[*index].cost.max_in_degree <= max_in_degree);
    let least = |index: usize| f64::from(loads[index]);
    let period = |index: usize| f64::from(periods[index]);
    let connections = |index: usize| f64::from(candidates[index].cost.connections.max(1));
    let shortest = permitted().map(least).fold(f64::INFINITY, f64::min);
    // Whoever reached this can no longer be too slow; the best product among them is to be beaten.
    let safe = permitted().filter(|index| period(*index) <= shortest * PERIOD_TOLERANCE);
    let to_beat = safe.map(|index| period(index) * connections(index)).fold(f64::INFINITY, f64::min);
    let fastest = permitted().map(period).fold(f64::INFINITY, f64::min);
    let can_win = |index: &usize| {
        let least = least(*index);
        least <= fastest * PERIOD_TOLERANCE && least < period(*index) && least * connections(*index) <= to_beat
    };
    permitted().filter(can_win).collect()
}

/// Candidates from best to worst: cycles x connections (the paper's objective) among the fastest that have the ports.
pub fn rank(candidates: &[Candidate], schedules: &[Schedule], max_in_degree: u32) -> Vec<usize> {
    let excess = |index: usize| candidates[index].cost.max_in_degree.saturating_sub(max_in_degree);
    let permitted = (0..candidates.len()).filter(|&index| excess(index) == 0);
    let shortest = permitted.map(|index| schedules[index].period).min().unwrap_or(0);
    let longest = f64::from(shortest) * PERIOD_TOLERANCE;
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by_key(|&index| {
        let period = schedules[index].period;
        let slow = f64::from(period) > longest;
        (excess(index), slow, u64::from(period) * u64::from(candidates[index].cost.connections.max(1)), index)
    });
    order
}

#[cfg(test)]
mod tests {
    use pe_ir::mapping::{Mapping, MappingCost};

    use super::*;

    fn candidate(max_load: u32, connections: u32) -> Candidate {
        let cost = MappingCost { max_load, connections, max_in_degree: 1 };
        Candidate { mapping: Mapping { pes: 1, pe_of: Vec::new() }, cost, start: "test", start_cost: cost }
    }

    #[test]
    fn only_who_can_still_win_is_scheduled_in_full() {
        let candidates = [candidate(100, 50), candidate(100, 40), candidate(100, 30), candidate(103, 10)];
        // The second is at 101 x 40; the first can reach 100 x 50 at best, the third has nothing to gain, and the
        // fourth is too slow whatever happens.
        let loads = [100, 100, 100, 103];
        assert_eq!(contenders(&candidates[..2], &loads, &[110, 101], 1), [1]);
        assert_eq!(contenders(&candidates, &loads, &[110, 101, 100, 103], 1), [0; 0]);
        // As long as nobody is certain to be fast enough, all go on.
        assert_eq!(contenders(&candidates[..2], &loads, &[110, 103], 1), [0, 1]);
        assert_eq!(contenders(&candidates[..2], &loads, &[110, 103], 0), [0; 0], "none has the ports");
    }
}
