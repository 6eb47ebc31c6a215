//! Mappings in which equations that look up the same tables are together, so that a PE needs only some of the tables.
//!
//! The tables are divided into sets whose columns fit a base memory of half the depth, each PE is given a set, and
//! equations move to PEs that have theirs. The annealer then balances loads and saves connections among the mappings
//! that keep to that. See `docs/decisions/0103-gathered-tables.md`.

mod teams;

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap};

use pe_ir::graph::{FixedPoint, Role, StepGraph};
use pe_ir::index::{EquationId, List, PeId, at, number};
use pe_ir::mapping::Mapping;
use pe_ir::memory;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::anneal::{Plan, anneal};
use super::{Candidate, MapOptions, Problem, SLACK, STRUCTURED_BEGIN, starts};

pub use teams::{TEAMS, in_teams};

/// Base words of a state, and those of a PE beside states and columns.
const STATE_WORDS: u32 = 2;
const OTHER_WORDS: u32 = 16;

/// Stream of the random numbers of its annealing.
const STREAM: u64 = 3;

/// Name of the start of a mapping in which equations with the same tables are together.
pub const TABLES: &str = "tables";

/// The tables that equations look up.
#[derive(Clone, Debug)]
pub struct Tables {
    /// Columns that the equations of a group look up, ascending.
    columns: Vec<Vec<u32>>,
    /// The group of each equation that has lookups.
    group: List<EquationId, Option<u32>>,
    /// Words of a column.
    length: u32,
    states: u32,
    word_bits: u32,
}

/// Which PEs equations may be on.
#[derive(Clone, Debug)]
pub(super) struct Permits<'a> {
    tables: &'a Tables,
    /// For each group the PEs that have its columns.
    pes: Vec<Vec<bool>>,
}

impl Permits<'_> {
    /// Whether an equation may be on a PE.
    pub(super) fn permits(&self, equation: usize, pe: usize) -> bool {
        self.tables.group[EquationId::at(equation)].is_none_or(|group| self.pes[at(group)][pe])
    }
}

impl Tables {
    /// The tables of a step; none if it looks up none.
    pub fn of(graph: &StepGraph, fixed: &FixedPoint) -> Option<Tables> {
        if graph.functions.tables.is_empty() {
            return None;
        }
        // Columns are the same word by word where their numbers and formats are.
        let mut contents: HashMap<Vec<u64>, u32> = HashMap::new();
        let mut content = |column: &Vec<f64>| {
            let next = number(contents.len());
            *contents.entry(column.iter().map(|number| number.to_bits()).collect()).or_insert(next)
        };
        let tables = graph.functions.tables.iter();
        let contents: Vec<Vec<u32>> = tables.map(|table| table.columns.iter().map(&mut content).collect()).collect();
        let mut numbers: HashMap<(u32, i32, bool), u32> = HashMap::new();
        let mut of_equation: List<EquationId, BTreeSet<u32>> = List::filled(BTreeSet::new(), graph.equations.len());
        for (index, value) in graph.values.iter().enumerate() {
            let (Role::Column(lookup, column), Some(equation)) = (value.role, value.equation) else { continue };
            let table = at(graph.functions.lookups[at(lookup)].table);
            let next = number(numbers.len());
            let key = (contents[table][usize::from(column)], fixed.exponents[index], value.factor);
            of_equation[equation].insert(*numbers.entry(key).or_insert(next));
        }
        let mut groups: BTreeMap<Vec<u32>, u32> = BTreeMap::new();
        let mut columns = Vec::new();
        let mut group = List::filled(None, graph.equations.len());
        for (equation, set) in of_equation.numbered().filter(|(_, set)| !set.is_empty()) {
            let set: Vec<u32> = set.iter().copied().collect();
            group[equation] = Some(*groups.entry(set.clone()).or_insert_with(|| {
                columns.push(set);
                number(columns.len()) - 1
            }));
        }
        let (length, states) = (number(graph.functions.segments.count()), number(graph.states.len()));
        Some(Tables { columns, group, length, states, word_bits: fixed.format.word_bits() })
    }

    /// Blocks of the base memories of a mapping, about.
    pub fn blocks(&self, mapping: &Mapping) -> u32 {
        self.depths(mapping).iter().map(|depth| memory::ram(*depth, self.word_bits).bram18).sum()
    }

    /// Depth of the base memory of each PE, about.
    fn depths(&self, mapping: &Mapping) -> Vec<u32> {
        let mut columns: List<PeId, BTreeSet<u32>> = List::filled(BTreeSet::new(), at(mapping.pes));
        let mut others: List<PeId, u32> = List::filled(OTHER_WORDS, at(mapping.pes));
        for (equation, pe) in mapping.pe_of.numbered() {
            // Behind the equations of the step come relays.
            if let Some(group) = self.group.find(equation).copied().flatten() {
                columns[*pe].extend(&self.columns[at(group)]);
            }
            if equation.number() < self.states {
                others[*pe] += STATE_WORDS;
            }
        }
        let words = columns.iter().zip(&others).map(|(columns, others)| self.words(columns.len(), *others));
        words.map(memory::depth).collect()
    }

    /// Words of a base memory with so many columns and other words.
    fn words(&self, columns: usize, others: u32) -> u32 {
        others.next_multiple_of(self.length) + number(columns) * self.length
    }

    /// Sets of groups whose columns fit a base memory of a depth, and their loads, the heaviest group first.
    fn sets(&self, depth: u32, pes: u32, loads: &[u64]) -> Option<Vec<(Vec<usize>, u64)>> {
        let others = OTHER_WORDS + STATE_WORDS * self.states.div_ceil(pes);
        let fits = |columns: &BTreeSet<u32>| self.words(columns.len(), others) <= depth;
        let mut order: Vec<usize> = (0..self.columns.len()).collect();
        order.sort_by_key(|group| (Reverse(loads[*group]), *group));
        let mut sets: Vec<(Vec<usize>, u64, BTreeSet<u32>)> = Vec::new();
        for group in order {
            let joined = |columns: &BTreeSet<u32>| {
                let mut columns = columns.clone();
                columns.extend(&self.columns[group]);
                columns
            };
            let place = sets.iter().position(|(.., columns)| fits(&joined(columns)));
            match place {
                Some(place) => {
                    let (groups, load, columns) = &mut sets[place];
                    groups.push(group);
                    *load += loads[group];
                    *columns = joined(columns);
                }
                None => {
                    let columns = joined(&BTreeSet::new());
                    if !fits(&columns) {
                        return None;
                    }
                    sets.push((vec![group], loads[group], columns));
                }
            }
        }
        (sets.len() <= at(pes)).then(|| sets.into_iter().map(|(groups, load, _)| (groups, load)).collect())
    }

    /// Which PEs of a mapping get which groups, if all are to have base memories of a depth.
    fn permits(&self, problem: &Problem, mapping: &Mapping, depth: u32) -> Option<Permits<'_>> {
        let pes = at(mapping.pes);
        let mut loads = vec![0u64; self.columns.len()];
        let mut here = vec![vec![0u64; pes]; self.columns.len()];
        for (equation, pe) in mapping.pe_of.numbered() {
            if let Some(group) = self.group[equation].map(at) {
                let load = u64::from(problem.loads()[equation.index()]);
                loads[group] += load;
                here[group][pe.index()] += load;
            }
        }
        let sets = self.sets(depth, mapping.pes, &loads)?;
        // As many PEs as the lookups of a set fill, and the others where most is left for each.
        let mean = (problem.total_load() / u64::from(mapping.pes)).max(1);
        let mut counts: Vec<u64> = sets.iter().map(|(_, load)| load.div_ceil(mean).max(1)).collect();
        while counts.iter().sum::<u64>() < pes as u64 {
            let fullest = (0..sets.len()).max_by_key(|set| (sets[*set].1 / counts[*set], Reverse(*set)))?;
            counts[fullest] += 1;
        }
        if counts.iter().sum::<u64>() > pes as u64 {
            return None;
        }
        let mut order: Vec<usize> = (0..sets.len()).collect();
        order.sort_by_key(|set| (counts[*set], *set));
        let mut set_of: Vec<Option<usize>> = vec![None; pes];
        for set in order {
            let load = |pe: &usize| sets[set].0.iter().map(|group| here[*group][*pe]).sum::<u64>();
            let mut free: Vec<usize> = (0..pes).filter(|pe| set_of[*pe].is_none()).collect();
            free.sort_by_key(|pe| (Reverse(load(pe)), *pe));
            free.iter().take(counts[set] as usize).for_each(|pe| set_of[*pe] = Some(set));
        }
        let has = |group: usize| {
            let of = |set: &Option<usize>| {
                let Some(set) = *set else { return false };
                let has = |column: &u32| sets[set].0.iter().any(|other| self.columns[*other].contains(column));
                self.columns[group].iter().all(has)
            };
            set_of.iter().map(of).collect()
        };
        Some(Permits { tables: self, pes: (0..self.columns.len()).map(has).collect() })
    }
}

/// A mapping that is annealed from another one so that no PE has a base memory of more than half the depth that the
/// deepest one has; none if tables cannot be divided so.
pub fn gathered(problem: &Problem, tables: &Tables, from: &Candidate, options: &MapOptions) -> Option<Candidate> {
    let pes = from.mapping.pes;
    let deepest = tables.depths(&from.mapping).into_iter().max()?;
    let permits = tables.permits(problem, &from.mapping, deepest / 2)?;
    let mut mapping = from.mapping.clone();
    let mut loads = vec![0u64; at(pes)];
    for (load, pe) in problem.loads().iter().zip(&mapping.pe_of) {
        loads[pe.index()] += u64::from(*load);
    }
    for (equation, load) in problem.loads().iter().enumerate() {
        let place = &mut mapping.pe_of[EquationId::at(equation)];
        if !permits.permits(equation, place.index()) {
            let to = (0..at(pes)).filter(|pe| permits.permits(equation, *pe)).min_by_key(|pe| (loads[*pe], *pe))?;
            loads[place.index()] -= u64::from(*load);
            loads[to] += u64::from(*load);
            *place = PeId::at(to);
        }
    }
    settled(problem, mapping, &permits, options, (TABLES, STREAM))
}

/// A mapping annealed among those that have equations only where their tables are; none if that leaves a PE without any, or
/// one with too many input ports.
fn settled(
    problem: &Problem,
    mapping: Mapping,
    permits: &Permits,
    options: &MapOptions,
    (start, stream): (&'static str, u64),
) -> Option<Candidate> {
    let pes = mapping.pes;
    let used: BTreeSet<PeId> = mapping.pe_of.iter().copied().collect();
    if used.len() < at(pes) {
        return None;
    }
    let (packed, mean) = (starts::packed_load(problem, pes), problem.total_load() / u64::from(pes));
    let loose = packed.max((mean + mean / SLACK) as u32);
    let (hot, spread) = STRUCTURED_BEGIN;
    let max_in_degree = options.max_in_degree;
    let plan = Plan { tries: options.tries, hot, spread, caps: (loose, packed), max_in_degree, regions: false };
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    rng.set_stream(stream);
    let start_cost = problem.cost(&mapping);
    let (mapping, cost) = anneal(problem, &mapping, &plan, Some(permits), &mut rng);
    (cost.max_in_degree <= max_in_degree).then_some(Candidate { mapping, cost, start, start_cost })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Equations on a ring with chords, of which two of three look up one of five tables.
    fn network(equations: usize, seed: u64) -> (Problem, Tables) {
        let mut state = seed;
        let mut below = |count: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % count
        };
        let (mut arcs, mut group, mut loads) = (Vec::new(), List::filled(None, equations), Vec::new());
        for equation in 0..equations {
            arcs.push((number((equation + 1) % equations), number(equation)));
            arcs.push((number(below(equations)), number(equation)));
            let is_function = equation % 3 != 0;
            if is_function {
                group[EquationId::at(equation)] = Some([0, 0, 0, 0, 1, 1, 1, 1, 2, 3, 4][below(11)]);
            }
            loads.push(if is_function { 24 + below(12) as u32 } else { 8 + below(16) as u32 });
        }
        // The local coordinate is the same column of all.
        let columns = (0..5).map(|table| std::iter::once(0).chain(1 + 6 * table..7 + 6 * table).collect()).collect();
        (Problem::new(loads, &arcs, &[]), Tables { columns, group, length: 64, states: 40, word_bits: 40 })
    }

    #[test]
    fn gathered_mappings_have_half_the_depth_and_balanced_loads() {
        for (seed, (equations, pes)) in (1..).zip([(300, 8), (600, 16), (240, 5)]) {
            let (problem, tables) = network(equations, seed);
            let options = MapOptions { pes, seed: 1, tries: 200_000, max_in_degree: 15 };
            let first = super::super::map(&problem, &options).expect("a mapping").swap_remove(0);
            let deepest = |mapping: &Mapping| tables.depths(mapping).into_iter().max();
            assert_eq!(deepest(&first.mapping), Some(2048));
            let gathered = gathered(&problem, &tables, &first, &options).expect("tables can be divided");
            assert_eq!(deepest(&gathered.mapping), Some(1024), "{equations} on {pes}");
            assert_eq!(problem.cost(&gathered.mapping), gathered.cost);
            assert!(tables.blocks(&gathered.mapping) < tables.blocks(&first.mapping));
            let mean = problem.total_load() as f64 / f64::from(pes);
            let load = f64::from(gathered.cost.max_load);
            assert!(load < 1.1 * mean && gathered.cost.max_in_degree <= 15, "{load} of {mean}");
        }
    }

    #[test]
    fn tables_that_no_division_makes_fit_stay_where_they_are() {
        let (problem, tables) = network(120, 7);
        // One table alone is too large.
        let columns = vec![(0..40).collect(); 5];
        let options = MapOptions { pes: 4, seed: 1, tries: 20_000, max_in_degree: 15 };
        let first = super::super::map(&problem, &options).expect("a mapping").swap_remove(0);
        assert!(gathered(&problem, &Tables { columns, ..tables.clone() }, &first, &options).is_none());
        // More sets than PEs.
        let columns = (0..5).map(|table| (14 * table..14 + 14 * table).collect()).collect();
        assert!(gathered(&problem, &Tables { columns, ..tables }, &first, &options).is_none());
    }
}
