//! Region moves: the equations of some connected PEs are put in an order and cut anew.
//!
//! Moves of single equations slide the borders between PEs; they never turn compact regions into strips, or one
//! arrangement of subtrees into another, for all ways between the two are worse. A region that is cut anew goes there
//! at once, and is kept by the rule of all moves.

use pe_ir::index::{self, at};
use rand_chacha::ChaCha8Rng;

use super::cost::{State, Weights};
use super::orders::{Region, Tree};
use super::problem::Problem;
use super::random::below;
use super::starts::cut_evenly;

/// Tries that the order of so many equations of a region counts as one of.
const ORDERED_PER_TRY: usize = 4;
/// Tries that a moved equation counts as: its change of energy and the move itself.
const TRIES_PER_MOVE: u64 = 2;

/// What region moves need beside the mapping.
pub(super) struct Regions<'p> {
    problem: &'p Problem,
    region: Region<'p>,
    /// For each equation whether it is outside the region.
    outside: Vec<bool>,
    /// For each PE its number in the region, or none.
    number: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl<'p> Regions<'p> {
    /// No region yet.
    pub(super) fn new(problem: &'p Problem, pes: usize) -> Regions<'p> {
        let outside = vec![true; at(problem.equations())];
        Regions { problem, region: Region::new(problem), outside, number: vec![NONE; pes] }
    }

    /// Cuts about so many PEs around a random one anew, and keeps that if the energy rises by no more than a threshold;
    /// the effort in tries.
    pub(super) fn cut_anew(
        &mut self,
        state: &mut State,
        count: usize,
        weights: &Weights,
        threshold: f64,
        rng: &mut ChaCha8Rng,
    ) -> u64 {
        let pes = self.joined(state, below(rng, self.number.len()), count);
        let equations: Vec<u32> = pes.iter().flat_map(|pe| state.members(at(*pe))).copied().collect();
        let order = self.order(&equations, rng);
        let effort = 1 + (order.len() / ORDERED_PER_TRY) as u64;
        let moves = self.moves(state, &pes, &order);
        let mut change = 0.0;
        for (equation, _, to) in &moves {
            change += state.change(*equation, *to, weights);
            state.apply(*equation, *to);
        }
        if change > threshold {
            moves.iter().rev().for_each(|(equation, from, _)| state.apply(*equation, *from));
        }
        effort + TRIES_PER_MOVE * moves.len() as u64
    }

    /// A PE and those joined to it, nearest first, until there are enough.
    fn joined(&mut self, state: &State, centre: usize, count: usize) -> Vec<u32> {
        let mut pes = vec![index::number(centre)];
        self.number[centre] = 0;
        let mut next = 0;
        while next < pes.len() && pes.len() < count {
            for equation in state.members(at(pes[next])) {
                for neighbour in self.problem.adjacent(at(*equation)) {
                    let pe = state.pe(neighbour);
                    if self.number[pe] == NONE && pes.len() < count {
                        self.number[pe] = index::number(pes.len());
                        pes.push(index::number(pe));
                    }
                }
            }
            next += 1;
        }
        pes
    }

    /// The equations of a region as they are declared, in layers from an end, or depth first.
    fn order(&mut self, equations: &[u32], rng: &mut ChaCha8Rng) -> Vec<u32> {
        let mut order = Vec::with_capacity(equations.len());
        let kind = below(rng, 4);
        let first = below(rng, equations.len());
        if kind == 3 {
            order.extend(equations);
            order.sort_unstable();
            return order;
        }
        self.region.enter(equations);
        if kind > 0 {
            equations.iter().for_each(|equation| self.outside[at(*equation)] = false);
        }
        for equation in equations[first..].iter().chain(&equations[..first]) {
            if kind == 0 && self.region.is_unseen(*equation) {
                let end = self.region.far_end(*equation);
                self.region.layers(end, &mut order);
            } else if kind > 0 && !self.outside[at(*equation)] {
                let end = self.region.far_end(*equation);
                Tree::depth_first(self.problem, end, &mut self.outside).write(kind > 1, &mut order);
            }
        }
        self.region.leave(equations);
        order
    }

    /// The moves that make an order one run per PE; each run goes to the PE that has most of it. Forgets the region.
    fn moves(&mut self, state: &State, pes: &[u32], order: &[u32]) -> Vec<(usize, usize, usize)> {
        let mut moves = Vec::new();
        let mut here = vec![0; pes.len()];
        let mut left: Vec<bool> = vec![true; pes.len()];
        let mut homeless = Vec::new();
        let runs = cut_evenly(self.problem, order, pes.len());
        let mut send = |run: &[u32], to: u32| {
            let from = run.iter().map(|equation| (at(*equation), state.pe(at(*equation)), at(to)));
            moves.extend(from.filter(|(_, from, to)| from != to));
        };
        for run in runs {
            let run = &order[run];
            let numbers = || run.iter().map(|equation| at(self.number[state.pe(at(*equation))]));
            numbers().for_each(|number| here[number] += 1);
            let best = numbers().filter(|number| left[*number]).max_by_key(|number| (here[*number], *number));
            numbers().for_each(|number| here[number] = 0);
            match best {
                Some(number) => {
                    left[number] = false;
                    send(run, pes[number]);
                }
                None => homeless.push(run),
            }
        }
        let free = (0..pes.len()).filter(|number| left[*number]).map(|number| pes[number]);
        homeless.into_iter().zip(free).for_each(|(run, to)| send(run, to));
        pes.iter().for_each(|pe| self.number[at(*pe)] = NONE);
        moves
    }
}

#[cfg(test)]
mod tests {
    use pe_ir::index::PeId;
    use pe_ir::mapping::Mapping;
    use rand::SeedableRng;

    use super::*;

    const WEIGHTS: Weights = Weights { spread: 0.1, overload: 1.0, excess: 2.0 };

    /// Cuts a grid of 12 x 12 cells that read their neighbours, on PEs in turn.
    fn on_a_grid(pes: u32, cut: impl FnOnce(&Problem, &mut Regions, &mut State, &mut ChaCha8Rng)) {
        let side = 12;
        let right = (0..side * side).filter(|cell| cell % side + 1 < side).map(|cell| (cell, cell + 1));
        let below = (0..side * (side - 1)).map(|cell| (cell, cell + side));
        let arcs: Vec<_> = right.chain(below).flat_map(|(a, b)| [(a, b), (b, a)]).collect();
        let mapping = Mapping { pes, pe_of: (0..side * side).map(|cell| PeId::new(cell % pes)).collect() };
        let problem = Problem::new(vec![3; (side * side) as usize], &arcs, &[]);
        let mut state = State::new(&problem, &mapping, 15);
        cut(&problem, &mut Regions::new(&problem, at(pes)), &mut state, &mut ChaCha8Rng::seed_from_u64(1));
    }

    #[test]
    fn a_region_keeps_every_pe_in_use_and_what_is_refused_is_undone() {
        on_a_grid(9, |problem, regions, state, rng| {
            for trial in 0..60 {
                let before = state.mapping();
                let kept = trial % 3 > 0;
                let threshold = if kept { f64::INFINITY } else { f64::NEG_INFINITY };
                let effort = regions.cut_anew(state, 1 + trial % 9, &WEIGHTS, threshold, rng);
                assert!(effort > 0);
                assert!(kept || state.mapping() == before);
                assert_eq!(state.cost(), problem.cost(&state.mapping()));
                assert!(PeId::all(9).all(|pe| state.mapping().pe_of.contains(&pe)));
            }
        });
    }

    #[test]
    fn the_whole_grid_cut_anew_is_strips() {
        on_a_grid(6, |_, regions, state, rng| {
            for _ in 0..20 {
                regions.cut_anew(state, 6, &WEIGHTS, 0.0, rng);
            }
            assert_eq!(state.cost().connections, 5);
        });
    }
}
