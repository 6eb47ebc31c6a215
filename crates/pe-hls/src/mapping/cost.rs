//! A mapping with everything that its cost needs, kept up to date move by move.
//!
//! The energy that the annealer lowers is counted in connections:
//!
//! ```text
//! E = sum over pairs of PEs of c(w)  +  overload * sum over PEs of (x + x^2) / 2  +  excess * sum over PEs of d
//! c(0) = 0,  c(w) = 1 + spread * (1/2 + 1/3 + ... + 1/w)
//! ```
//!
//! where `w` is the number of dependencies between two PEs, `x` a PE's load above the cap in mean equations and `d`
//! its in-degree above the limit. With `spread` = 0 the first sum is the number of connections. That alone gives no
//! direction while all pairs carry many dependencies; the harmonic sum does: taking one dependency off a pair
//! saves `spread / w`, which is the preference for thin links in the benefit of the size neighbour of Huang, Vahid and
//! Givargis (2013), doi 10.1145/2514641.2514650, section 5.2.2.

use pe_ir::index::{self, PeId, number};
use pe_ir::mapping::{Mapping, MappingCost};

use super::gather::Permits;
use super::links::{Link, Links};
use super::problem::Problem;
use super::sets::IndexSet;

/// Weights of the energy's terms.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weights {
    /// Weight of the harmonic sum over dependencies that share a connection.
    pub(super) spread: f64,
    /// Connections that one mean equation above the cap is worth.
    pub(super) overload: f64,
    /// Connections that one input port above the limit is worth.
    pub(super) excess: f64,
}

/// Largest number of dependencies for which the harmonic sum still grows.
const HARMONICS: usize = 256;

/// A mapping under change.
#[derive(Clone, Debug)]
pub(super) struct State<'p> {
    pub(super) problem: &'p Problem,
    /// Where equations may be, unless they may be anywhere.
    pub(super) permits: Option<&'p Permits<'p>>,
    pes: usize,
    /// Place of each node: equations first, then inputs, which stay behind the PEs.
    place_of: Vec<u32>,
    members: Vec<Vec<u32>>,
    /// Index of each equation in the members of its PE.
    position: Vec<u32>,
    loads: Vec<u32>,
    /// Operands with equal coefficients that are computed where they are read, for each class of them.
    own: Vec<u32>,
    links: Links,
    in_degrees: Vec<u32>,
    connections: u32,
    /// Sum of the in-degrees above the limit.
    excess: u32,
    limit: u32,
    /// Load above which overload counts.
    cap: u32,
    /// Load above which a PE is in `overloaded`.
    high: u32,
    overloaded: IndexSet,
    /// For each equation the number of equations next to it on other PEs.
    foreign: Vec<u32>,
    /// Equations where that is not 0.
    boundary: IndexSet,
    /// 1 / mean load of an equation.
    per_equation: f64,
    harmonics: Vec<f64>,
    /// Links between the equation under evaluation and the places around it.
    around: Vec<(u32, Link)>,
    /// Index of each place in `around`, or none.
    around_at: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl<'p> State<'p> {
    /// The state of a mapping.
    pub(super) fn new(problem: &'p Problem, mapping: &Mapping, limit: u32) -> State<'p> {
        let pes = index::at(mapping.pes);
        State::with_links(problem, mapping, limit, Links::new(pes, pes + index::at(problem.inputs())))
    }

    /// The state of a mapping in an empty table of links.
    fn with_links(problem: &'p Problem, mapping: &Mapping, limit: u32, links: Links) -> State<'p> {
        let (pes, equations) = (index::at(mapping.pes), index::at(problem.equations()));
        let places = pes + index::at(problem.inputs());
        let mut place_of: Vec<u32> = mapping.pe_of.iter().map(|pe| pe.number()).collect();
        place_of.extend(number(pes)..places as u32);
        let mut harmonics = vec![0.0; HARMONICS + 1];
        for weight in 2..=HARMONICS {
            harmonics[weight] = harmonics[weight - 1] + 1.0 / weight as f64;
        }
        let mut state = State {
            problem,
            permits: None,
            pes,
            place_of,
            members: vec![Vec::new(); pes],
            position: vec![0; equations],
            loads: vec![0; pes],
            own: Vec::new(),
            links,
            in_degrees: vec![0; pes],
            connections: 0,
            excess: 0,
            limit,
            cap: u32::MAX,
            high: u32::MAX,
            overloaded: IndexSet::new(pes),
            foreign: vec![0; equations],
            boundary: IndexSet::new(equations),
            per_equation: equations as f64 / (problem.total_load() as f64).max(1.0),
            harmonics,
            around: Vec::new(),
            around_at: vec![NONE; places],
        };
        state.own = problem.alike().own(&state.place_of);
        for equation in 0..equations {
            let pe = index::at(state.place_of[equation]);
            state.position[equation] = number(state.members[pe].len());
            state.members[pe].push(number(equation));
            state.loads[pe] += problem.loads()[equation] + problem.alike().missed(equation, &state.own);
            for neighbour in problem.neighbours(equation).iter().filter(|neighbour| neighbour.reads() == 1) {
                let place = index::at(state.place_of[neighbour.node()]);
                if place != pe {
                    let link = state.links.get(pe, place);
                    state.replace(pe, place, Link { into: link.into + 1, ..link });
                }
            }
            state.foreign[equation] =
                number(problem.adjacent(equation).filter(|&next| state.place_of[next] != number(pe)).count());
            state.boundary.set(equation, state.foreign[equation] > 0);
        }
        state
    }

    /// PE of an equation.
    pub(super) fn pe(&self, equation: usize) -> usize {
        index::at(self.place_of[equation])
    }

    /// Whether a node is an equation on another PE than this.
    pub(super) fn is_elsewhere(&self, node: usize, pe: usize) -> bool {
        node < self.position.len() && self.pe(node) != pe
    }

    /// Whether a node is an equation on another PE than this, not alone there, and permitted here.
    pub(super) fn may_move(&self, node: usize, to: usize) -> bool {
        self.is_elsewhere(node, to) && self.members[self.pe(node)].len() > 1 && self.permits(node, to)
    }

    /// Whether an equation is permitted on a PE.
    pub(super) fn permits(&self, equation: usize, pe: usize) -> bool {
        self.permits.is_none_or(|permits| permits.permits(equation, pe))
    }

    /// Equations of a PE.
    pub(super) fn members(&self, pe: usize) -> &[u32] {
        &self.members[pe]
    }

    /// Issue slots of a PE.
    pub(super) fn load(&self, pe: usize) -> u32 {
        self.loads[pe]
    }

    /// PEs with a high load.
    pub(super) fn overloaded(&self) -> &[u32] {
        self.overloaded.list()
    }

    /// The load half way between the mean and the largest.
    pub(super) fn high_load(&self) -> u32 {
        let total: u64 = self.loads.iter().map(|load| u64::from(*load)).sum();
        let max = self.loads.iter().copied().max().unwrap_or(0);
        ((total / self.pes as u64 + u64::from(max)) / 2) as u32
    }

    /// Equations next to equations on other PEs.
    pub(super) fn boundary(&self) -> &[u32] {
        self.boundary.list()
    }

    /// Whether an equation is next to one on another PE.
    pub(super) fn is_boundary(&self, equation: usize) -> bool {
        self.foreign[equation] > 0
    }

    /// Link between two PEs.
    pub(super) fn link(&self, pe: usize, other: usize) -> Link {
        self.links.get(pe, other)
    }

    /// The mapping as it stands.
    pub(super) fn mapping(&self) -> Mapping {
        Mapping {
            pes: number(self.pes),
            pe_of: self.place_of[..self.position.len()].iter().copied().map(PeId::new).collect(),
        }
    }

    /// Its cost.
    pub(super) fn cost(&self) -> MappingCost {
        MappingCost {
            max_load: self.loads.iter().copied().max().unwrap_or(0),
            connections: self.connections,
            max_in_degree: self.in_degrees.iter().copied().max().unwrap_or(0),
        }
    }

    /// Sets the load above which overload counts, and the load above which a PE is among the overloaded ones. The second is
    /// larger where all PEs miss pairs.
    pub(super) fn set_caps(&mut self, cap: u32, high: u32) {
        self.cap = cap;
        self.high = high;
        for pe in 0..self.pes {
            self.overloaded.set(pe, self.loads[pe] > high);
        }
    }

    /// The change of energy when an equation moves to another PE.
    pub(super) fn change(&mut self, equation: usize, to: usize, weights: &Weights) -> f64 {
        let from = self.pe(equation);
        self.look_around(equation);
        let mut connections = 0.0;
        let mut excess = 0;
        let (mut degree_from, mut degree_to) = (self.in_degrees[from], self.in_degrees[to]);
        for &(place, link) in &self.around {
            let place = index::at(place);
            if place == from || place == to {
                continue;
            }
            let (old_from, old_to) = (self.links.get(from, place), self.links.get(to, place));
            let (new_from, new_to) = (old_from.minus(link), old_to.plus(link));
            degree_from -= u32::from(old_from.into > 0 && new_from.into == 0);
            degree_to += u32::from(old_to.into == 0 && new_to.into > 0);
            if place < self.pes {
                connections += self.connection(new_from, weights) - self.connection(old_from, weights);
                connections += self.connection(new_to, weights) - self.connection(old_to, weights);
                let degree = self.in_degrees[place];
                let lost = u32::from(old_from.out > 0 && new_from.out == 0);
                let gained = u32::from(old_to.out == 0 && new_to.out > 0);
                excess += self.above(degree + gained - lost) - self.above(degree);
            }
        }
        let (old, new) = self.between(from, to);
        connections += self.connection(new, weights) - self.connection(old, weights);
        degree_from = degree_from + u32::from(new.into > 0) - u32::from(old.into > 0);
        degree_to = degree_to + u32::from(new.out > 0) - u32::from(old.out > 0);
        excess += self.above(degree_from) - self.above(self.in_degrees[from]);
        excess += self.above(degree_to) - self.above(self.in_degrees[to]);
        let (load_from, load_to) = self.loads_after(equation, from, to);
        let overload = self.overload(load_from) - self.overload(self.loads[from]) + self.overload(load_to)
            - self.overload(self.loads[to]);
        connections + weights.overload * overload + weights.excess * f64::from(excess)
    }

    /// Moves an equation to another PE.
    pub(super) fn apply(&mut self, equation: usize, to: usize) {
        let from = self.pe(equation);
        self.look_around(equation);
        let (_, between) = self.between(from, to);
        for index in 0..self.around.len() {
            let (place, link) = self.around[index];
            let place = index::at(place);
            if place != from && place != to {
                self.replace(from, place, self.links.get(from, place).minus(link));
                self.replace(to, place, self.links.get(to, place).plus(link));
            }
        }
        self.replace(from, to, between);
        (self.loads[from], self.loads[to]) = self.loads_after(equation, from, to);
        self.problem.alike().apply(equation, (number(from), number(to)), &self.place_of, &mut self.own);
        self.overloaded.set(from, self.loads[from] > self.high);
        self.overloaded.set(to, self.loads[to] > self.high);
        self.place_of[equation] = number(to);
        let position = self.position[equation];
        self.members[from].swap_remove(index::at(position));
        if let Some(&moved) = self.members[from].get(index::at(position)) {
            self.position[index::at(moved)] = position;
        }
        self.position[equation] = number(self.members[to].len());
        self.members[to].push(number(equation));
        let mut foreign = 0;
        for next in self.problem.adjacent(equation) {
            let pe = self.pe(next);
            foreign += u32::from(pe != to);
            self.foreign[next] = self.foreign[next] + u32::from(pe == from) - u32::from(pe == to);
            self.boundary.set(next, self.foreign[next] > 0);
        }
        self.foreign[equation] = foreign;
        self.boundary.set(equation, foreign > 0);
    }

    /// The loads of two PEs after an equation has moved from the first to the second. Those of others stay: pairs of
    /// their operands are imported before and after.
    fn loads_after(&self, equation: usize, from: usize, to: usize) -> (u32, u32) {
        let (alike, load) = (self.problem.alike(), self.problem.loads()[equation]);
        let places = (number(from), number(to));
        let (on_from, on_to) = alike.changes(equation, places, &self.place_of, &self.own);
        let leaves = load + alike.missed(equation, &self.own);
        let arrives = load + alike.missed_at(equation, places.1, &self.place_of);
        (
            (self.loads[from] - leaves).wrapping_add_signed(on_from),
            (self.loads[to] + arrives).wrapping_add_signed(on_to),
        )
    }

    /// Gathers the links between an equation and the places around it.
    fn look_around(&mut self, equation: usize) {
        for &(place, _) in &self.around {
            self.around_at[index::at(place)] = NONE;
        }
        self.around.clear();
        for neighbour in self.problem.neighbours(equation) {
            let place = self.place_of[neighbour.node()];
            let link = Link { out: neighbour.is_reader(), into: neighbour.reads() };
            let at = &mut self.around_at[index::at(place)];
            if *at == NONE {
                *at = number(self.around.len());
                self.around.push((place, link));
            } else {
                let sum = &mut self.around[index::at(*at)].1;
                *sum = sum.plus(link);
            }
        }
    }

    /// The link between two PEs, seen from the first, before and after the equation looked at moves between them.
    fn between(&self, from: usize, to: usize) -> (Link, Link) {
        let around = |place: usize| match self.around_at[place] {
            NONE => Link::default(),
            at => self.around[index::at(at)].1,
        };
        let old = self.links.get(from, to);
        (old, old.minus(around(to)).plus(around(from).reversed()))
    }

    /// Replaces the link between a PE and a place, with all counts that depend on it.
    fn replace(&mut self, pe: usize, place: usize, new: Link) {
        let old = self.links.get(pe, place);
        self.links.set(pe, place, new);
        self.change_in_degree(pe, old.into, new.into);
        if place < self.pes {
            self.links.set(place, pe, new.reversed());
            self.change_in_degree(place, old.out, new.out);
            self.connections = self.connections + u32::from(new.weight() > 0) - u32::from(old.weight() > 0);
        }
    }

    fn change_in_degree(&mut self, pe: usize, old: u32, new: u32) {
        let degree = self.in_degrees[pe] + u32::from(new > 0) - u32::from(old > 0);
        self.excess = self.excess + degree.saturating_sub(self.limit) - self.in_degrees[pe].saturating_sub(self.limit);
        self.in_degrees[pe] = degree;
    }

    /// `c(w)` of the module's formula.
    fn connection(&self, link: Link, weights: &Weights) -> f64 {
        match index::at(link.weight()) {
            0 => 0.0,
            weight => 1.0 + weights.spread * self.harmonics[weight.min(HARMONICS)],
        }
    }

    /// `(x + x^2) / 2` of the module's formula.
    fn overload(&self, load: u32) -> f64 {
        let above = f64::from(load.saturating_sub(self.cap)) * self.per_equation;
        0.5 * above * (1.0 + above)
    }

    /// `d` of the module's formula.
    fn above(&self, degree: u32) -> i32 {
        degree.saturating_sub(self.limit) as i32
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::mapping::random::below;

    const WEIGHTS: Weights = Weights { spread: 0.3, overload: 0.7, excess: 2.0 };

    /// The energy of the module's formula.
    fn energy(state: &State) -> f64 {
        let pairs = (0..state.pes).flat_map(|pe| (0..pe).map(move |other| (pe, other)));
        let connections: f64 = pairs.map(|(pe, other)| state.connection(state.links.get(pe, other), &WEIGHTS)).sum();
        let overload: f64 = state.loads.iter().map(|&load| state.overload(load)).sum();
        connections + WEIGHTS.overload * overload + WEIGHTS.excess * f64::from(state.excess)
    }

    /// Makes random moves and compares all that is kept up to date with a state built from nothing.
    fn check(equations: usize, pes: usize, inputs: usize, links: fn(usize, usize) -> Links) {
        let mut rng = ChaCha8Rng::seed_from_u64(equations as u64);
        let mut any = |count: usize| below(&mut rng, count);
        let arcs: Vec<_> = (0..3 * equations).map(|_| (any(equations) as u32, any(equations) as u32)).collect();
        let input_reads: Vec<_> = (0..inputs).map(|input| (input as u32, any(equations) as u32)).collect();
        let loads = (0..equations).map(|_| any(30) as u32).collect();
        let problem = Problem::new(loads, &arcs, &input_reads);
        let mapping =
            Mapping { pes: pes as u32, pe_of: (0..equations).map(|equation| PeId::at(equation % pes)).collect() };
        let fresh = |mapping: &Mapping| {
            let mut state = State::with_links(&problem, mapping, 4, links(pes, pes + inputs));
            let cap = 15 * (equations / pes) as u32;
            state.set_caps(cap, cap);
            state
        };
        let mut state = fresh(&mapping);
        for _ in 0..300 {
            let (equation, to) = (any(equations), any(pes));
            if !state.may_move(equation, to) {
                continue;
            }
            let before = energy(&state);
            let change = state.change(equation, to, &WEIGHTS);
            state.apply(equation, to);
            assert!((energy(&state) - before - change).abs() < 1e-9);
            let recomputed = fresh(&state.mapping());
            assert_eq!(state.cost(), problem.cost(&state.mapping()));
            assert_eq!(state.excess, recomputed.excess);
            assert_eq!(state.foreign, recomputed.foreign);
            assert_eq!(state.boundary.sorted(), recomputed.boundary.sorted());
            assert_eq!(state.overloaded.sorted(), recomputed.overloaded.sorted());
            assert!((energy(&state) - energy(&recomputed)).abs() < 1e-9);
        }
    }

    #[test]
    fn moves_change_the_cost_as_predicted() {
        for (equations, pes, inputs) in [(5, 2, 0), (30, 7, 3), (60, 30, 10), (200, 4, 1)] {
            check(equations, pes, inputs, Links::dense);
            check(equations, pes, inputs, |pes, _| Links::sparse(pes));
        }
    }
}
