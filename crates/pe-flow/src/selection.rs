//! Selection of a mapping: schedules the candidates that can still win, and ranks them.

use pe_hls::mapping::Candidate;
use pe_ir::graph::StepGraph;
use pe_ir::index::List;
use pe_ir::memory::BLOCK_LUTS;
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;

use crate::known::Known;

/// Look-up tables of a connection: a port of 32 bits more at each end.
const CONNECTION_LUTS: f64 = 32.0;

/// Schedules that are this much longer than the shortest are not considered, however few connections they have.
const PERIOD_TOLERANCE: f64 = 1.02;

/// A schedule of each candidate with its step graph. All get a draft; those that could still be the first by [`rank`] if
/// their products filled every cycle get the best schedule that can be found. `say` is told what is under way.
pub fn schedules(
    graphs: &[&StepGraph],
    candidates: &[Candidate],
    latency: Latency,
    max_in_degree: u32,
    known: &Known,
    say: &dyn Fn(String),
) -> Vec<Schedule> {
    let draft = |(candidate, graph): (&Candidate, &&StepGraph)| {
        say(format!("{}, first of two passes", candidate.start));
        known.schedule(graph, &candidate.mapping, latency, true)
    };
    let mut schedules: Vec<Schedule> = candidates.iter().zip(graphs).map(draft).collect();
    let periods: Vec<u32> = schedules.iter().map(|schedule| schedule.period).collect();
    let loads: Vec<u32> = candidates.iter().zip(graphs).map(|(candidate, graph)| load(graph, candidate)).collect();
    for index in contenders(candidates, &loads, &periods, max_in_degree) {
        say(format!("{}, second pass", candidates[index].start));
        schedules[index] = known.schedule(graphs[index], &candidates[index].mapping, latency, false);
    }
    schedules
}

/// The most products of a PE as they are issued: the mapper may have counted on pairs that its mapping does not allow.
fn load(graph: &StepGraph, candidate: &Candidate) -> u32 {
    let mut loads = List::filled(0, candidate.mapping.pes as usize);
    for (load, pe) in graph.loads().iter().zip(&candidate.mapping.pe_of) {
        loads[*pe] += load;
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
/// The first ones, as many as `plain` says, do without relays; one with relays has to have a smaller product than the best
/// of them.
pub fn rank(candidates: &[Candidate], schedules: &[Schedule], max_in_degree: u32, plain: usize) -> Vec<usize> {
    let excess = |index: usize| candidates[index].cost.max_in_degree.saturating_sub(max_in_degree);
    let product =
        |index: usize| u64::from(schedules[index].period) * u64::from(candidates[index].cost.connections.max(1));
    let order = |among: usize, useless: &dyn Fn(usize) -> bool| {
        let permitted = (0..among).filter(|&index| excess(index) == 0 && !useless(index));
        let shortest = permitted.map(|index| schedules[index].period).min().unwrap_or(0);
        let longest = f64::from(shortest) * PERIOD_TOLERANCE;
        let mut order: Vec<usize> = (0..among).collect();
        order.sort_by_key(|&index| {
            let slow = f64::from(schedules[index].period) > longest;
            (useless(index), excess(index), slow, product(index), index)
        });
        order
    };
    let best = order(plain, &|_| false).first().copied();
    order(candidates.len(), &|index| index >= plain && best.is_some_and(|best| product(index) >= product(best)))
}

/// Mappings in which equations with the same tables are together, which are the last `gathered` ones, before all others of
/// an order: the best one if it is no slower than the first, and what it saves in blocks of memory is worth more than its
/// connections.
pub fn prefer_gathered(
    order: &mut [usize],
    candidates: &[Candidate],
    schedules: &[Schedule],
    blocks: &[u32],
    (gathered, max_in_degree): (usize, u32),
) {
    let Some(first) = order.first().copied().filter(|_| gathered > 0) else { return };
    let luts = |index: usize| {
        BLOCK_LUTS * f64::from(blocks[index]) + CONNECTION_LUTS * f64::from(candidates[index].cost.connections)
    };
    let is_better = |index: &usize| {
        candidates[*index].cost.max_in_degree <= max_in_degree
            && schedules[*index].period <= schedules[first].period
            && luts(*index) < luts(first)
    };
    let last = candidates.len() - gathered..candidates.len();
    let best = last.filter(is_better).min_by(|a, b| luts(*a).total_cmp(&luts(*b)).then(a.cmp(b)));
    if let Some(place) = best.and_then(|best| order.iter().position(|index| *index == best)) {
        order[..=place].rotate_right(1);
    }
}

#[cfg(test)]
mod tests {
    use pe_ir::mapping::{Mapping, MappingCost};

    use super::*;

    fn candidate(max_load: u32, connections: u32) -> Candidate {
        let cost = MappingCost { max_load, connections, max_in_degree: 1 };
        Candidate { mapping: Mapping { pes: 1, pe_of: List::new() }, cost, start: "test", start_cost: cost }
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

    #[test]
    fn gathered_tables_have_to_be_as_fast_and_smaller() {
        let candidates = [candidate(100, 20), candidate(100, 30), candidate(100, 40), candidate(100, 50)];
        let schedule = |period| Schedule { period, starts: List::new(), order: Vec::new(), transfers: Vec::new() };
        let first = |periods: [u32; 4], blocks: [u32; 4]| {
            let mut order = vec![0, 1, 2, 3];
            prefer_gathered(&mut order, &candidates, &periods.map(schedule), &blocks, (2, 1));
            order
        };
        assert_eq!(first([100; 4], [10, 10, 8, 4]), [3, 0, 1, 2], "fewest blocks");
        assert_eq!(first([100; 4], [10, 10, 6, 5]), [2, 0, 1, 3], "connections are worth something");
        assert_eq!(first([100, 100, 101, 101], [10, 10, 8, 4]), [0, 1, 2, 3], "slower");
        assert_eq!(first([100; 4], [10, 2, 10, 10]), [0, 1, 2, 3], "not gathered");
        let mut order = vec![0, 1];
        prefer_gathered(&mut order, &candidates[..2], &[schedule(9), schedule(9)], &[], (0, 1));
        assert_eq!(order, [0, 1], "no tables");
    }

    #[test]
    fn relays_have_to_save_something() {
        let candidates = [candidate(100, 50), candidate(100, 40), candidate(100, 35), candidate(100, 10)];
        let schedule = |period| Schedule { period, starts: List::new(), order: Vec::new(), transfers: Vec::new() };
        let ranked = |periods: [u32; 4]| rank(&candidates, &periods.map(schedule), 1, 2);
        assert_eq!(ranked([100, 101, 100, 120]), [2, 1, 0, 3], "a smaller product, and not too slow");
        assert_eq!(ranked([100, 101, 140, 120])[0], 1, "too slow");
        // Faster, but at a larger product than the best without relays, which so would be too slow.
        let last = [candidate(100, 40), candidate(100, 50)];
        let schedules = [100, 90].map(schedule);
        assert_eq!(rank(&last, &schedules, 1, 1), [0, 1]);
        assert_eq!(rank(&last, &schedules, 1, 2), [1, 0]);
        assert_eq!(rank(&last, &schedules, 1, 0), [1, 0], "nothing to compare with");
    }
}
