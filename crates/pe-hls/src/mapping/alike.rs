//! Operands with equal coefficients, and the pairs of them that a mapping keeps.
//!
//! A pair is an operand from the own memory and one from the imported memory, so how many pairs a chain has depends on
//! how many of its operands its own PE computes. The counts here are kept up to date as equations move; those of
//! `pairs::pair` are made from nothing.

use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::{at, number};

use crate::pairs;

/// Operands with equal coefficients of all chains.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Alike {
    chains: Vec<Chains>,
    /// Classes of operands, chain after chain.
    classes: Vec<Class>,
    /// Equations that compute the operands of each class, with the number of these.
    sources: Rows<(u32, u32)>,
    /// Chains of each equation.
    chains_of: Rows<u32>,
    /// Classes of the chains of others that have operands which an equation computes, with the number of these.
    uses: Rows<(u32, u32)>,
}

/// Chains of an equation whose operands come from the same equations.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Chains {
    equation: u32,
    /// Number of chains.
    count: u32,
    /// Products of a chain without pairs.
    products: u32,
    /// Issue slots that its writes take at least.
    least: u32,
    /// Its classes.
    classes: std::ops::Range<u32>,
}

impl Chains {
    /// Issue slots of all the chains with so many pairs each.
    fn load(&self, pairs: u32) -> u32 {
        self.count * self.least.max(self.products - pairs)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Class {
    chains: u32,
    operands: u32,
}

impl Class {
    /// Pairs if so many of the operands are computed where the chain is: of one own and one imported operand, and of own
    /// ones of which every second one is sent home.
    fn pairs(self, own: u32) -> u32 {
        let imported = self.operands - own;
        own.min(imported) + own.saturating_sub(imported) / 2
    }

    /// Pairs that some mapping has.
    fn most_pairs(self) -> u32 {
        self.operands / 2
    }
}

/// Rows of a table, one behind the other.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
struct Rows<T> {
    /// Start of each row; one more than there are rows.
    offsets: Vec<u32>,
    entries: Vec<T>,
}

impl<T: Copy> Rows<T> {
    fn of(rows: impl IntoIterator<Item = Vec<T>>) -> Rows<T> {
        let mut table = Rows { offsets: vec![0], entries: Vec::new() };
        for row in rows {
            table.entries.extend(row);
            table.offsets.push(number(table.entries.len()));
        }
        table
    }

    fn row(&self, index: usize) -> &[T] {
        &self.entries[at(self.offsets[index])..at(self.offsets[index + 1])]
    }
}

impl Alike {
    /// Those of a step graph.
    pub(super) fn of(graph: &StepGraph, fixed: &FixedPoint) -> Alike {
        if !graph.pre_adder {
            return Alike::default();
        }
        // Equation, products, writes, and for each class the sources of its operands.
        type Described = (u32, u32, u32, Vec<Vec<u32>>);
        let mut described: Vec<Described> = Vec::new();
        for (index, chain) in graph.chains.numbered() {
            let source = |term: &u32| {
                graph.value(graph.terms[at(*term)].operand).equation.expect("inputs are in no class").number()
            };
            let sources = |members: Vec<u32>| {
                let mut sources: Vec<u32> = members.iter().map(source).collect();
                sources.sort_unstable();
                sources
            };
            let mut classes: Vec<Vec<u32>> = pairs::classes(graph, fixed, index).into_iter().map(sources).collect();
            classes.sort_unstable();
            if !classes.is_empty() {
                described.push((chain.equation.number(), chain.len(), number(chain.writes().count()), classes));
            }
        }
        described.sort_unstable();
        let mut alike = Alike::default();
        let mut sources = Vec::new();
        let mut chains_of = vec![Vec::new(); graph.equations.len()];
        let mut uses = vec![Vec::new(); graph.equations.len()];
        for same in described.chunk_by(|left, right| left == right) {
            let (equation, products, least, classes) = &same[0];
            let (chains, first) = (number(alike.chains.len()), number(alike.classes.len()));
            for operands in classes {
                let counted: Vec<(u32, u32)> =
                    operands.chunk_by(|left, right| left == right).map(|same| (same[0], number(same.len()))).collect();
                for (source, count) in counted.iter().filter(|(source, _)| source != equation) {
                    uses[at(*source)].push((number(alike.classes.len()), *count));
                }
                alike.classes.push(Class { chains, operands: number(operands.len()) });
                sources.push(counted);
            }
            chains_of[at(*equation)].push(chains);
            let classes = first..number(alike.classes.len());
            let count = number(same.len());
            alike.chains.push(Chains { equation: *equation, count, products: *products, least: *least, classes });
        }
        alike.sources = Rows::of(sources);
        alike.chains_of = Rows::of(chains_of);
        alike.uses = Rows::of(uses);
        alike
    }

    /// Whether no operands have equal coefficients.
    pub(super) fn is_empty(&self) -> bool {
        self.chains.is_empty()
    }

    /// For each equation whether its place matters for pairs: it reads such operands or computes them.
    pub(super) fn equations(&self) -> Vec<bool> {
        let count = self.chains_of.offsets.len().saturating_sub(1);
        let matters = |equation: usize| !self.chains_of.row(equation).is_empty() || !self.uses.row(equation).is_empty();
        (0..count).map(matters).collect()
    }

    /// Operands of each class that are computed where its chain is.
    pub(super) fn own(&self, place_of: &[u32]) -> Vec<u32> {
        let own = |(class, of): (usize, &Class)| {
            let equation = self.chains[at(of.chains)].equation;
            self.own_at(class, equation, place_of[at(equation)], place_of)
        };
        self.classes.iter().enumerate().map(own).collect()
    }

    /// Issue slots of an equation beyond those it has with all pairs.
    pub(super) fn missed(&self, equation: usize, own: &[u32]) -> u32 {
        self.missed_with(equation, |class| own[class])
    }

    /// The same if the equation were on another PE.
    pub(super) fn missed_at(&self, equation: usize, to: u32, place_of: &[u32]) -> u32 {
        self.missed_with(equation, |class| self.own_at(class, number(equation), to, place_of))
    }

    /// How the issue slots of other equations change when an equation moves: on the PE it leaves, and where it goes.
    pub(super) fn changes(&self, equation: usize, (from, to): (u32, u32), place_of: &[u32], own: &[u32]) -> (i32, i32) {
        let (mut on_from, mut on_to) = (0, 0);
        if self.is_empty() {
            return (0, 0);
        }
        let reader = |class: u32| self.classes[at(class)].chains;
        for uses in self.uses.row(equation).chunk_by(|left, right| reader(left.0) == reader(right.0)) {
            let chains = &self.chains[at(reader(uses[0].0))];
            let place = place_of[at(chains.equation)];
            if place != from && place != to {
                continue;
            }
            let (mut before, mut after) = (0, 0);
            for class in chains.classes.clone().map(at) {
                let moved = uses.iter().find(|(used, _)| at(*used) == class).map_or(0, |(_, count)| *count);
                let then = if place == from { own[class] - moved } else { own[class] + moved };
                before += self.classes[class].pairs(own[class]);
                after += self.classes[class].pairs(then);
            }
            let change = chains.load(after) as i32 - chains.load(before) as i32;
            *(if place == from { &mut on_from } else { &mut on_to }) += change;
        }
        (on_from, on_to)
    }

    /// Brings the counts of [`Alike::own`] up to date before an equation moves.
    pub(super) fn apply(&self, equation: usize, (from, to): (u32, u32), place_of: &[u32], own: &mut [u32]) {
        if self.is_empty() {
            return;
        }
        for (class, count) in self.uses.row(equation) {
            let place = place_of[at(self.chains[at(self.classes[at(*class)].chains)].equation)];
            let own = &mut own[at(*class)];
            *own = *own + if place == to { *count } else { 0 } - if place == from { *count } else { 0 };
        }
        for chains in self.chains_of.row(equation) {
            for class in self.chains[at(*chains)].classes.clone().map(at) {
                own[class] = self.own_at(class, number(equation), to, place_of);
            }
        }
    }

    /// Operands of a class of an equation that would be computed on its PE if that were this one.
    fn own_at(&self, class: usize, equation: u32, pe: u32, place_of: &[u32]) -> u32 {
        let is_own = |source: u32| source == equation || place_of[at(source)] == pe;
        self.sources.row(class).iter().filter(|(source, _)| is_own(*source)).map(|(_, count)| count).sum()
    }

    fn missed_with(&self, equation: usize, own: impl Fn(usize) -> u32) -> u32 {
        if self.is_empty() {
            return 0;
        }
        let missed = |chains: &u32| {
            let chains = &self.chains[at(*chains)];
            let classes = || chains.classes.clone().map(at);
            let pairs = classes().map(|class| self.classes[class].pairs(own(class))).sum();
            let most = classes().map(|class| self.classes[class].most_pairs()).sum();
            chains.load(pairs) - chains.load(most)
        };
        self.chains_of.row(equation).iter().map(missed).sum()
    }
}

#[cfg(test)]
mod tests {
    use pe_ir::index::PeId;
    use pe_ir::mapping::Mapping;
    use pe_ir::verify;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::super::cost::{State, Weights};
    use super::super::grids::{Grid, grid};
    use super::super::random::below;
    use super::*;

    fn grids() -> Vec<Grid> {
        let diagonals: &[&[i32]] = &[&[1, 0], &[0, 1], &[2, 0], &[1, 1], &[1, -1], &[0, 2]];
        vec![
            grid(&[17], &[&[1], &[2]]),
            grid(&[6, 5], &[&[1, 0], &[0, 1]]),
            grid(&[5, 6], diagonals),
            grid(&[4, 3, 3], &[&[1, 0, 0], &[0, 1, 0], &[0, 0, 1]]),
            grid(&[3, 4, 3], &[&[1, 0, 0], &[0, 1, 0], &[0, 0, 1], &[1, 1, 0], &[1, 0, 1], &[0, 1, -1], &[1, 1, 1]]),
        ]
    }

    fn random(equations: u32, pes: u32, rng: &mut ChaCha8Rng) -> Mapping {
        // The first ones make sure that each PE has an equation.
        let pe = |equation| if equation < pes { equation } else { below(rng, at(pes)) as u32 };
        Mapping { pes, pe_of: (0..equations).map(pe).map(PeId::new).collect() }
    }

    /// The loads of the step graph with the pairs of a mapping.
    fn issued(grid: &Grid, mapping: &Mapping) -> Vec<u32> {
        let paired = pairs::pair(&grid.graph, &grid.fixed, mapping);
        let graph = paired.as_ref().map_or(&grid.graph, |paired| &paired.graph);
        let mut loads = vec![0; at(mapping.pes)];
        graph.loads().iter().zip(&mapping.pe_of).for_each(|(load, pe)| loads[pe.index()] += load);
        loads
    }

    fn counted(state: &State, pes: u32) -> Vec<u32> {
        (0..at(pes)).map(|pe| state.load(pe)).collect()
    }

    #[test]
    fn loads_are_those_of_the_pairs_that_a_mapping_has() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for grid in grids() {
            let problem = grid.problem();
            for pes in [1, 2, 3, 5, 9] {
                let mapping = random(problem.equations(), pes, &mut rng);
                let state = State::new(&problem, &mapping, 15);
                let loads = issued(&grid, &mapping);
                assert_eq!(counted(&state, pes), loads, "on {pes}");
                assert_eq!(problem.cost(&mapping).max_load, loads.into_iter().max().expect("a PE"));
            }
        }
    }

    #[test]
    fn moves_change_loads_and_energy_as_predicted() {
        let weights = Weights { spread: 0.3, overload: 0.7, excess: 2.0 };
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        for grid in grids() {
            let (problem, pes) = (grid.problem(), 4);
            let mut state = State::new(&problem, &random(problem.equations(), pes, &mut rng), 15);
            for _ in 0..60 {
                let (equation, to) = (below(&mut rng, at(problem.equations())), below(&mut rng, at(pes)));
                if !state.may_move(equation, to) {
                    continue;
                }
                let from = state.pe(equation);
                let there = state.change(equation, to, &weights);
                state.apply(equation, to);
                assert_eq!(counted(&state, pes), issued(&grid, &state.mapping()));
                assert_eq!(state.cost(), problem.cost(&state.mapping()));
                let back = state.change(equation, from, &weights);
                assert!((there + back).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn the_checker_finds_loads_that_count_all_pairs() {
        let grid = grid(&[6, 5], &[&[1, 0], &[0, 1]]);
        let mapping = random(60, 7, &mut ChaCha8Rng::seed_from_u64(3));
        let paired = pairs::pair(&grid.graph, &grid.fixed, &mapping).expect("some pairs");
        let problem = grid.problem();
        let cost = problem.cost(&mapping);
        assert_eq!(verify::mapping::check(&paired.graph, &mapping, &cost, 99), [""; 0]);
        let all = super::super::Problem::of(&pairs::optimistic(&grid.graph, &grid.fixed).expect("some pairs"));
        let claimed = all.cost(&mapping);
        let found = verify::mapping::check(&paired.graph, &mapping, &claimed, 99);
        assert_eq!(found, [format!("largest load is {}, not {}", cost.max_load, claimed.max_load)]);
    }

    #[test]
    fn annealed_mappings_of_grids_have_the_loads_they_claim() {
        for grid in grids() {
            let options = super::super::MapOptions { pes: 6, seed: 1, tries: 30_000, max_in_degree: 15 };
            for candidate in super::super::map(&grid.problem(), &options).expect("a mapping") {
                let paired = pairs::pair(&grid.graph, &grid.fixed, &candidate.mapping);
                let graph = paired.as_ref().map_or(&grid.graph, |paired| &paired.graph);
                assert_eq!(verify::mapping::check(graph, &candidate.mapping, &candidate.cost, 15), [""; 0]);
            }
        }
    }
}
