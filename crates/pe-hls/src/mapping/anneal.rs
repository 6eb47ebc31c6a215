//! Simulated annealing of one mapping, after Huang, Vahid and Givargis (2013), doi 10.1145/2514641.2514650,
//! section 5.2.3.
//!
//! The energy is counted in connections (see `cost.rs`), and so are the temperatures: the smallest rise that a move
//! through a connection causes is 1 on every model, so a temperature near 1 lets mappings change freely and one near
//! 0.1 only lets them slide along equal energies. Between the two the temperature falls geometrically.
//!
//! The product of largest load and connections, which is what counts in the end, is evaluated at the end of each
//! round, and the best mapping kept.

use pe_ir::index::at;
use pe_ir::mapping::{Mapping, MappingCost};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::cost::{State, Weights};
use super::gather::Permits;
use super::neighbours;
use super::problem::Problem;
use super::random::below;
use super::regions::Regions;

/// How a mapping is annealed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan {
    /// Moves tried; a move of an equation with many neighbours counts as several.
    pub(super) tries: u64,
    /// Temperature of the first round.
    pub(super) hot: f64,
    /// Weight of the harmonic sum in the first round.
    pub(super) spread: f64,
    /// Load above which a PE counts as overloaded at first, and at last.
    pub(super) caps: (u32, u32),
    /// Largest in-degree allowed.
    pub(super) max_in_degree: u32,
    /// Whether regions are cut anew as well.
    pub(super) regions: bool,
}

/// Temperature of the last round.
const COLD: f64 = 0.1;
/// Weight of the harmonic sum in the last round.
const LAST_SPREAD: f64 = 0.1;
/// Weight of overload in the first round.
const OVERLOAD: f64 = 0.5;
/// Weight of overload in the last round, without pairs of operands and with: where moves change pairs, loads are harder to
/// level.
const LAST_OVERLOAD: (f64, f64) = (2.0, 8.0);
/// Weight of input ports above the limit.
const EXCESS: f64 = 2.0;
/// Of so many tries, one goes to moves of regions as long as there are any.
const REGIONS: u64 = 2;
/// Part of the rounds after which only single equations move.
const SETTLED: f64 = 0.5;
/// Rounds in which temperature and weights are constant.
const ROUNDS: u32 = 200;
/// Part of the rounds after which the cap falls to its last value.
const TIGHTENING: f64 = 0.85;
/// Of 256 tries, those with the performance neighbour while there are overloaded PEs,
const PERFORMANCE: u32 = 51;
/// of which so many in 256 go to any connected PE if operands are paired,
const LEVEL: u32 = 128;
/// and those with the size neighbour; the others are plain moves.
const SIZE: u32 = 77;
/// Of 256 moves that would be rejected, those completed to an exchange of two equations.
const EXCHANGE: u32 = 26;
/// Neighbours of an equation that are evaluated in the effort of one try.
const NEIGHBOURS_PER_TRY: u64 = 16;

/// What decides between two mappings: in-degrees above the limit, then largest load x connections, then the load.
pub(super) fn rank(cost: &MappingCost, max_in_degree: u32) -> (u32, u64, u32) {
    let product = u64::from(cost.max_load) * u64::from(cost.connections.max(1));
    (cost.max_in_degree.saturating_sub(max_in_degree), product, cost.max_load)
}

/// The best mapping met while annealing from `start`, which may be the start itself. Equations stay where they are
/// permitted.
pub(super) fn anneal<'p>(
    problem: &'p Problem,
    start: &Mapping,
    plan: &Plan,
    permits: Option<&'p Permits<'p>>,
    rng: &mut ChaCha8Rng,
) -> (Mapping, MappingCost) {
    let mut state = State::new(problem, start, plan.max_in_degree);
    state.permits = permits;
    let mut best = (start.clone(), state.cost());
    let acceptance = Acceptance::new();
    let mut regions = plan.regions.then(|| Regions::new(problem, at(start.pes)));
    let pairs = problem.has_pairs();
    let (mut tries, mut region_tries) = (0, 0);
    for round in 0..ROUNDS {
        let progress = f64::from(round) / f64::from(ROUNDS - 1);
        let between = |first: f64, last: f64| first * libm::pow(last / first, progress);
        let weights = Weights {
            spread: between(plan.spread, LAST_SPREAD),
            overload: between(OVERLOAD, if pairs { LAST_OVERLOAD.1 } else { LAST_OVERLOAD.0 }),
            excess: EXCESS,
        };
        let tightened = ((progress - TIGHTENING) / (1.0 - TIGHTENING)).max(0.0);
        let (first, last) = (f64::from(plan.caps.0), f64::from(plan.caps.1));
        let cap = (first + (last - first) * tightened) as u32;
        state.set_caps(cap, if pairs { cap.max(state.high_load()) } else { cap });
        let temperature = between(plan.hot, COLD);
        let end = plan.tries * u64::from(round + 1) / u64::from(ROUNDS);
        while let Some(regions) = regions.as_mut().filter(|_| progress < SETTLED && region_tries < end / REGIONS) {
            let count = region_size(at(start.pes), rng);
            let threshold = temperature * acceptance.draw(rng);
            let effort = regions.cut_anew(&mut state, count, &weights, threshold, rng);
            region_tries += effort;
            tries += effort;
        }
        while tries < end {
            tries += 1 + attempt(&mut state, &weights, |rng| temperature * acceptance.draw(rng), rng);
        }
        let cost = state.cost();
        if rank(&cost, plan.max_in_degree) < rank(&best.1, plan.max_in_degree) {
            best = (state.mapping(), cost);
        }
    }
    best
}

/// A random number of PEs, two or more: every power of two as likely as the next, and all PEs.
fn region_size(pes: usize, rng: &mut ChaCha8Rng) -> usize {
    let powers = at(pes.ilog2()) + 1;
    (2 << below(rng, powers)).min(pes)
}

/// Proposes a neighbour of the mapping and moves there if the energy rises by no more than a random threshold; the
/// effort beyond that of an ordinary try.
fn attempt(
    state: &mut State,
    weights: &Weights,
    threshold: impl Fn(&mut ChaCha8Rng) -> f64,
    rng: &mut ChaCha8Rng,
) -> u64 {
    let choice = rng.next_u32();
    let (generator, exchange) = (choice & 255, choice >> 8 & 255);
    let proposal = if generator < PERFORMANCE && !state.overloaded().is_empty() {
        if state.problem.has_pairs() && (choice >> 16 & 255) < LEVEL {
            neighbours::level(state, rng)
        } else {
            neighbours::performance(state, rng)
        }
    } else if generator < PERFORMANCE + SIZE {
        neighbours::size(state, rng)
    } else {
        neighbours::plain(state, rng)
    };
    let Some(step) = proposal else { return 0 };
    let threshold = threshold(rng);
    let from = state.pe(step.equation);
    let change = state.change(step.equation, step.to, weights);
    if change <= threshold {
        state.apply(step.equation, step.to);
    } else if exchange < EXCHANGE {
        state.apply(step.equation, step.to);
        match neighbours::exchange(state, from, step, rng) {
            Some(back) if change + state.change(back.equation, back.to, weights) <= threshold => {
                state.apply(back.equation, back.to);
            }
            _ => state.apply(step.equation, from),
        }
    }
    state.problem.neighbours(step.equation).len() as u64 / NEIGHBOURS_PER_TRY
}

/// The rule of Metropolis et al. with the logarithms of the random numbers in a table, which is faster and the same on
/// every machine: a rise `d` is accepted with probability `exp(-d / T)`, that is if `d <= -T ln u`.
struct Acceptance(Vec<f64>);

impl Acceptance {
    const ENTRIES: u32 = 4096;

    fn new() -> Acceptance {
        let uniform = |index| (f64::from(index) + 0.5) / f64::from(Acceptance::ENTRIES);
        Acceptance((0..Acceptance::ENTRIES).map(|index| -libm::log(uniform(index))).collect())
    }

    /// `-ln u` of a random `u`.
    fn draw(&self, rng: &mut ChaCha8Rng) -> f64 {
        self.0[at(rng.next_u32() % Acceptance::ENTRIES)]
    }
}
