//! Selection of a mapping: schedules the candidates that can still win, and ranks them.

use std::ops::Range;

use pe_hls::mapping::{Candidate, MapOptions};
use pe_ir::graph::StepGraph;
use pe_ir::memory::BLOCK_LUTS;
use pe_ir::schedule::Schedule;
use pe_ir::word::{Latency, Pipeline, WordFormat};
use pe_target::clock::slower_with_ports;

use crate::known::Known;

/// Look-up tables of a connection: a port of 32 bits more at each end.
const CONNECTION_LUTS: f64 = 32.0;

/// Cycles that mappings may take, over those of another one, that halve blocks and connections and save so many blocks for
/// each PE.
const HALVED_TOLERANCE: f64 = 1.0 + 1.0 / 8.0;
const SAVED_BLOCKS: f64 = 4.0;

/// Schedules that are this much longer than the shortest are not considered, however few connections they have.
const PERIOD_TOLERANCE: f64 = 1.02;

/// What a step with a candidate takes: cycles, at the clock that its input ports allow. Each doubling of the ports beyond
/// the usual number has to save as much as [`PERIOD_TOLERANCE`] allows, for the cells of the multiplexers.
#[derive(Clone, Copy, Debug)]
pub struct Price(Pipeline);

impl Price {
    /// The price of ports with a pipeline.
    pub fn of(format: &WordFormat) -> Price {
        Price(format.pipeline)
    }

    /// The time of so many cycles.
    pub(crate) fn time(self, cycles: u32, candidate: &Candidate) -> f64 {
        let (ports, usual) = (f64::from(candidate.cost.max_in_degree), f64::from(MapOptions::DEFAULT_MAX_IN_DEGREE));
        let doublings = libm::log2(ports.max(usual) / usual);
        let slower = slower_with_ports(self.0, candidate.cost.max_in_degree);
        f64::from(cycles) * slower * libm::pow(PERIOD_TOLERANCE, doublings)
    }
}

/// A schedule of each candidate with its step graph. All get a draft; those that could still be the first by [`rank`] if
/// their products filled every cycle get the best schedule that can be found. `say` is told what is under way.
pub fn schedules(
    graphs: &[&StepGraph],
    candidates: &[Candidate],
    latency: Latency,
    price: Price,
    known: &Known,
    say: &dyn Fn(String),
) -> Vec<Schedule> {
    let draft = |(candidate, graph): (&Candidate, &&StepGraph)| {
        say(format!("{}, first of two passes", candidate.start));
        known.schedule(graph, &candidate.mapping, latency, true)
    };
    let mut schedules: Vec<Schedule> = candidates.iter().zip(graphs).map(draft).collect();
    let periods: Vec<u32> = schedules.iter().map(|schedule| schedule.period).collect();
    for index in contenders(candidates, &periods, price) {
        say(format!("{}, second pass", candidates[index].start));
        schedules[index] = known.schedule(graphs[index], &candidates[index].mapping, latency, false);
    }
    schedules
}

/// Schedules of all candidates. Relays and gathered tables have no say in how well the others are scheduled: of `counts`, the first
/// is the candidates without relays, which come first, the second those with gathered tables, which come last.
pub fn all_schedules(
    graphs: &[&StepGraph],
    candidates: &[Candidate],
    (plain, gathered): (usize, usize),
    (latency, price): (Latency, Price),
    known: &Known,
    say: &dyn Fn(String),
) -> Vec<Schedule> {
    let ends = [0, plain, candidates.len() - gathered, candidates.len()];
    let parts = ends.windows(2).map(|ends| ends[0]..ends[1]);
    let of = |part: Range<usize>| schedules(&graphs[part.clone()], &candidates[part], latency, price, known, say);
    parts.flat_map(of).collect()
}

/// The cycles of the shortest schedule, in words.
pub fn shortest(schedules: &[Schedule]) -> String {
    format!("{} cycles per step", schedules.iter().map(|schedule| schedule.period).min().unwrap_or(0))
}

/// Candidates from best to worst: by [`rank`] and [`prefer_gathered`].
pub fn order(
    candidates: &[Candidate],
    schedules: &[Schedule],
    blocks: &[u32],
    (plain, gathered): (usize, usize),
    price: Price,
) -> Vec<usize> {
    let others = candidates.len() - gathered;
    let mut order = rank(&candidates[..others], &schedules[..others], price, plain);
    order.extend(others..candidates.len());
    prefer_gathered(&mut order, candidates, schedules, blocks, (gathered, price));
    order
}

/// Candidates whose largest load leaves them room to win against what the others have reached.
fn contenders(candidates: &[Candidate], periods: &[u32], price: Price) -> Vec<usize> {
    let all = || 0..candidates.len();
    let least = |index: usize| price.time(candidates[index].cost.max_load, &candidates[index]);
    let time = |index: usize| price.time(periods[index], &candidates[index]);
    let connections = |index: usize| f64::from(candidates[index].cost.connections.max(1));
    let shortest = all().map(least).fold(f64::INFINITY, f64::min);
    // Whoever reached this can no longer be too slow; the best product among them is to be beaten.
    let safe = all().filter(|index| time(*index) <= shortest * PERIOD_TOLERANCE);
    let to_beat = safe.map(|index| time(index) * connections(index)).fold(f64::INFINITY, f64::min);
    let fastest = all().map(time).fold(f64::INFINITY, f64::min);
    let can_win = |index: &usize| {
        let least = least(*index);
        least <= fastest * PERIOD_TOLERANCE && least < time(*index) && least * connections(*index) <= to_beat
    };
    all().filter(can_win).collect()
}

/// Candidates from best to worst: time x connections (the paper's objective has cycles for the time) among the fastest.
/// The first ones, as many as `plain` says, do without relays; one with relays has to have a smaller product than the best
/// of them.
pub fn rank(candidates: &[Candidate], schedules: &[Schedule], price: Price, plain: usize) -> Vec<usize> {
    let time = |index: usize| price.time(schedules[index].period, &candidates[index]);
    let product = |index: usize| time(index) * f64::from(candidates[index].cost.connections.max(1));
    let order = |among: usize, useless: &dyn Fn(usize) -> bool| {
        let shortest = (0..among).filter(|&index| !useless(index)).map(time).fold(f64::INFINITY, f64::min);
        let longest = shortest * PERIOD_TOLERANCE;
        let mut order: Vec<usize> = (0..among).collect();
        let place = |index: usize| (useless(index), time(index) > longest);
        order.sort_by(|&a, &b| place(a).cmp(&place(b)).then(product(a).total_cmp(&product(b))).then(a.cmp(&b)));
        order
    };
    let best = order(plain, &|_| false).first().copied();
    order(candidates.len(), &|index| index >= plain && best.is_some_and(|best| product(index) >= product(best)))
}

/// Mappings in which equations with the same tables are together, which are the last `gathered` ones, before all others of
/// an order: the best one if it is no slower than the first, and what it saves in blocks of memory is worth more than its
/// connections. One that halves both together, and saves much, may be a little slower.
pub fn prefer_gathered(
    order: &mut [usize],
    candidates: &[Candidate],
    schedules: &[Schedule],
    blocks: &[u32],
    (gathered, price): (usize, Price),
) {
    let Some(first) = order.first().copied().filter(|_| gathered > 0) else { return };
    let luts = |index: usize| {
        BLOCK_LUTS * f64::from(blocks[index]) + CONNECTION_LUTS * f64::from(candidates[index].cost.connections)
    };
    let time = |index: usize| price.time(schedules[index].period, &candidates[index]);
    let is_better = |index: &usize| {
        let slower = time(*index) / time(first);
        let enough = SAVED_BLOCKS * BLOCK_LUTS * f64::from(candidates[first].mapping.pes);
        let halved = luts(*index) <= 0.5 * luts(first) && luts(first) - luts(*index) >= enough;
        slower <= if halved { HALVED_TOLERANCE } else { 1.0 } && luts(*index) < luts(first)
    };
    let last = candidates.len() - gathered..candidates.len();
    let best = last.filter(is_better).min_by(|a, b| luts(*a).total_cmp(&luts(*b)).then(a.cmp(b)));
    if let Some(place) = best.and_then(|best| order.iter().position(|index| *index == best)) {
        order[..=place].rotate_right(1);
    }
}

#[cfg(test)]
mod tests {
    use pe_ir::index::List;
    use pe_ir::mapping::{Mapping, MappingCost};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const PRICE: Price = Price(Pipeline::Short);

    fn candidate(max_load: u32, connections: u32) -> Candidate {
        with_ports(max_load, connections, 1)
    }

    fn with_ports(max_load: u32, connections: u32, max_in_degree: u32) -> Candidate {
        let cost = MappingCost { max_load, connections, max_in_degree };
        Candidate { mapping: Mapping { pes: 1, pe_of: List::new() }, cost, start: "test", start_cost: cost }
    }

    #[test]
    fn only_who_can_still_win_is_scheduled_in_full() {
        let candidates = [candidate(100, 50), candidate(100, 40), candidate(100, 30), candidate(103, 10)];
        // The second is at 101 x 40; the first can reach 100 x 50 at best, the third has nothing to gain, and the
        // fourth is too slow whatever happens.
        assert_eq!(contenders(&candidates[..2], &[110, 101], PRICE), [1]);
        assert_eq!(contenders(&candidates, &[110, 101, 100, 103], PRICE), [0; 0]);
        // As long as nobody is certain to be fast enough, all go on.
        assert_eq!(contenders(&candidates[..2], &[110, 103], PRICE), [0, 1]);
        // What has many ports has to be so much faster.
        let wide = [with_ports(103, 50, 60), candidate(101, 50)];
        assert_eq!(contenders(&wide, &[110, 103], PRICE), [1]);
    }

    #[test]
    fn gathered_tables_have_to_be_as_fast_and_smaller() {
        let candidates = [candidate(100, 20), candidate(100, 30), candidate(100, 40), candidate(100, 50)];
        let schedule = |period| Schedule { period, starts: List::new(), order: Vec::new(), transfers: Vec::new() };
        let first = |periods: [u32; 4], blocks: [u32; 4]| {
            let mut order = vec![0, 1, 2, 3];
            prefer_gathered(&mut order, &candidates, &periods.map(schedule), &blocks, (2, PRICE));
            order
        };
        assert_eq!(first([100; 4], [10, 10, 8, 4]), [3, 0, 1, 2], "fewest blocks");
        assert_eq!(first([100; 4], [10, 10, 6, 5]), [2, 0, 1, 3], "connections are worth something");
        assert_eq!(first([100, 100, 101, 101], [10, 10, 8, 4]), [0, 1, 2, 3], "slower");
        assert_eq!(first([100; 4], [10, 2, 10, 10]), [0, 1, 2, 3], "not gathered");
        assert_eq!(first([100, 100, 112, 112], [100, 100, 52, 40]), [3, 0, 1, 2], "slower, but half of it");
        assert_eq!(first([100, 100, 113, 113], [100, 100, 40, 40]), [0, 1, 2, 3], "too slow");
        assert_eq!(first([100, 100, 112, 112], [25, 25, 25, 3]), [3, 0, 1, 2], "half of it, and much");
        let small = [candidate(100, 1), candidate(100, 1)];
        let mut order = vec![0, 1];
        prefer_gathered(&mut order, &small, &[schedule(100), schedule(101)], &[5, 2], (1, PRICE));
        assert_eq!(order, [0, 1], "half of little");
        let mut order = vec![0, 1];
        prefer_gathered(&mut order, &candidates[..2], &[schedule(9), schedule(9)], &[], (0, PRICE));
        assert_eq!(order, [0, 1], "no tables");
    }

    #[test]
    fn relays_have_to_save_something() {
        let candidates = [candidate(100, 50), candidate(100, 40), candidate(100, 35), candidate(100, 10)];
        let schedule = |period| Schedule { period, starts: List::new(), order: Vec::new(), transfers: Vec::new() };
        let ranked = |periods: [u32; 4]| rank(&candidates, &periods.map(schedule), PRICE, 2);
        assert_eq!(ranked([100, 101, 100, 120]), [2, 1, 0, 3], "a smaller product, and not too slow");
        assert_eq!(ranked([100, 101, 140, 120])[0], 1, "too slow");
        // Faster, but at a larger product than the best without relays, which so would be too slow.
        let last = [candidate(100, 40), candidate(100, 50)];
        let schedules = [100, 90].map(schedule);
        assert_eq!(rank(&last, &schedules, PRICE, 1), [0, 1]);
        assert_eq!(rank(&last, &schedules, PRICE, 2), [1, 0]);
        assert_eq!(rank(&last, &schedules, PRICE, 0), [1, 0], "nothing to compare with");
    }

    #[test]
    fn more_ports_have_to_save_time() {
        let schedule = |period| Schedule { period, starts: List::new(), order: Vec::new(), transfers: Vec::new() };
        let first = |pipeline, candidates: &[Candidate], periods: &[u32]| {
            let schedules: Vec<Schedule> = periods.iter().map(|period| schedule(*period)).collect();
            rank(candidates, &schedules, Price(pipeline), candidates.len())[0]
        };
        let ports = [with_ports(100, 50, 15), with_ports(100, 50, 30), with_ports(100, 50, 60)];
        assert_eq!(first(Pipeline::Short, &ports, &[100, 100, 100]), 0, "nothing is saved");
        assert_eq!(first(Pipeline::Short, &ports, &[100, 97, 97]), 1, "3 % for a doubling, and none for the next");
        assert_eq!(first(Pipeline::Short, &ports, &[100, 97, 90]), 2);
        assert_eq!(
            first(Pipeline::Deep, &ports, &[100, 97, 90]),
            0,
            "with a deep pipeline they are what takes longest"
        );
        assert_eq!(first(Pipeline::Deep, &ports, &[100, 70, 70]), 1);
        let few = [with_ports(100, 50, 3), with_ports(100, 49, 15)];
        assert_eq!(first(Pipeline::Deep, &few, &[100, 100]), 1, "up to the usual number they are free");
    }

    /// What decision 0115 says of a choice, by itself: the first candidate by time and connections.
    fn as_decided(candidates: &[Candidate], periods: &[u32], pipeline: Pipeline) -> usize {
        let times: Vec<f64> = (candidates.iter().zip(periods))
            .map(|(candidate, period)| {
                let ports = candidate.cost.max_in_degree;
                let cells = if ports > 15 { libm::pow(1.02, libm::log2(f64::from(ports) / 15.0)) } else { 1.0 };
                f64::from(*period) * cells * slower_with_ports(pipeline, ports)
            })
            .collect();
        let fastest = times.iter().copied().fold(f64::INFINITY, f64::min);
        let within = (0..candidates.len()).filter(|index| times[*index] <= 1.02 * fastest);
        let product = |index: &usize| times[*index] * f64::from(candidates[*index].cost.connections);
        within.min_by(|one, other| product(one).total_cmp(&product(other))).expect("the fastest is among them")
    }

    #[test]
    fn a_rank_that_knows_ports_cycles_or_connections_wrongly_is_found_out() {
        let schedule =
            |period: &u32| Schedule { period: *period, starts: List::new(), order: Vec::new(), transfers: Vec::new() };
        let first = |candidates: &[Candidate], periods: &[u32], pipeline| {
            let schedules: Vec<Schedule> = periods.iter().map(schedule).collect();
            rank(candidates, &schedules, Price(pipeline), candidates.len())[0]
        };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut random = |below: u32| rng.random_range(0..below);
        // Faults of what the rank is told: no price of ports, that of half as many, no connections, the same cycles, and the
        // ports of another candidate.
        let mut missed = [0; 5];
        const CASES: usize = 400;
        for case in 0..CASES {
            let pipeline = Pipeline::ALL[case % 2];
            let count = 2 + random(5) as usize;
            let of: Vec<(u32, u32)> = (0..count).map(|_| (40 + random(30), 2 + random(80))).collect();
            let candidates: Vec<Candidate> =
                of.iter().map(|(connections, ports)| with_ports(90, *connections, *ports)).collect();
            let periods: Vec<u32> = (0..count).map(|_| 100 + random(12)).collect();
            let decided = as_decided(&candidates, &periods, pipeline);
            assert_eq!(first(&candidates, &periods, pipeline), decided, "{of:?} {periods:?} {pipeline:?}");
            let told = |ports: &dyn Fn(usize) -> u32, connections: &dyn Fn(usize) -> u32, periods: &[u32]| {
                let told: Vec<Candidate> =
                    (0..count).map(|index| with_ports(90, connections(index), ports(index))).collect();
                usize::from(first(&told, periods, pipeline) != decided)
            };
            let (connections, ports) = (|index: usize| of[index].0, |index: usize| of[index].1);
            missed[0] += told(&|_| 1, &connections, &periods);
            missed[1] += told(&|index| of[index].1 / 2, &connections, &periods);
            missed[2] += told(&ports, &|_| 1, &periods);
            missed[3] += told(&ports, &connections, &vec![100; count]);
            missed[4] += told(&|index| of[(index + 1) % count].1, &connections, &periods);
        }
        assert!(missed.iter().all(|missed| 10 * missed > CASES), "{missed:?} of {CASES} faults change the choice");
    }
}
