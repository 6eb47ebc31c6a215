//! Mappings in which a few PEs, a team, compute whole parts of a model and have the tables among them.
//!
//! The parts are what the dependency graph falls into without the dependencies between equations that are alike, such as
//! the cells of a tissue without what flows between them. Equations are alike if they are beside mostly the same tables. A
//! part is on one team, and in all teams the same kind of equation is on the same PE, which so needs few tables. See
//! `docs/decisions/0118-teams.md`.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use pe_ir::index::{EquationId, List, PeId, at, number};
use pe_ir::mapping::Mapping;
use pe_ir::memory;

use super::super::{Candidate, MapOptions, Problem, SLACK, annealed};
use super::{OTHER_WORDS, Permits, STATE_WORDS, Tables, settled};

/// Name of the start of a mapping in which teams have the tables among them.
pub const TEAMS: &str = "teams";

/// Stream of the random numbers of its annealing.
const STREAM: u64 = 4;

/// PEs of a team, at most.
const MOST_PES: u32 = 32;

/// Kinds of equations without tables, at most: a model of more is not made of parts that are alike.
const MOST_KINDS: usize = 256;

/// Moves between PEs of a team that make its loads even, at most.
const MOST_MOVES: usize = 256;

/// Equivalent LUTs of a connection.
const CONNECTION_LUTS: f64 = 32.0;

/// What equations of all parts do.
struct Kinds {
    of: Vec<usize>,
    /// Load of each, and the group of its tables.
    items: Vec<(u64, Option<u32>)>,
}

/// How a team divides its work.
struct Division {
    pes: u32,
    /// For each kind the PEs of a team that have it.
    places: Vec<Vec<usize>>,
    /// Columns of each PE of a team.
    columns: Vec<BTreeSet<u32>>,
    /// Largest load of a PE of a team, all teams together.
    load: u64,
    /// Words of the deepest base memory.
    depth: u32,
}

/// Groups of tables beside each equation: its own, and those of what it reads and of what reads it.
fn beside(problem: &Problem, tables: &Tables) -> Vec<Vec<u32>> {
    let of = |equation: usize| {
        let all = problem.adjacent(equation).chain([equation]);
        let groups: BTreeSet<u32> = all.filter_map(|other| tables.group[EquationId::at(other)]).collect();
        groups.into_iter().collect()
    };
    (0..problem.loads().len()).map(of).collect()
}

/// Whether at least half of the tables beside either are beside both.
fn alike(one: &[u32], other: &[u32]) -> bool {
    let common = one.iter().filter(|group| other.binary_search(group).is_ok()).count();
    common > 0 && 3 * common >= one.len() + other.len()
}

/// The part of each equation, and their number.
fn parts(problem: &Problem, tables: &Tables, beside: &[Vec<u32>]) -> (Vec<u32>, u32) {
    const NONE: u32 = u32::MAX;
    let has_table = |equation: usize| tables.group[EquationId::at(equation)].is_some();
    let same = |one: usize, other: usize| has_table(one) == has_table(other) && alike(&beside[one], &beside[other]);
    let mut part = vec![NONE; beside.len()];
    let (mut count, mut open) = (0, Vec::new());
    for first in 0..beside.len() {
        if part[first] != NONE {
            continue;
        }
        part[first] = count;
        open.push(first);
        while let Some(equation) = open.pop() {
            for other in problem.adjacent(equation) {
                if part[other] == NONE && !same(equation, other) {
                    part[other] = count;
                    open.push(other);
                }
            }
        }
        count += 1;
    }
    (part, count)
}

/// The problem whose equations are the parts.
fn of_parts(problem: &Problem, part: &[u32], count: u32) -> Problem {
    let mut loads = vec![0; at(count)];
    part.iter().zip(problem.loads()).for_each(|(part, load)| loads[at(*part)] += load);
    let (mut arcs, mut inputs) = (Vec::new(), Vec::new());
    for (equation, own) in part.iter().enumerate() {
        for read in problem.neighbours(equation).iter().filter(|neighbour| neighbour.reads() == 1) {
            match part.get(read.node()) {
                Some(other) if other == own => {}
                Some(other) => arcs.push((*other, *own)),
                None => inputs.push((number(read.node() - part.len()), *own)),
            }
        }
    }
    Problem::new(loads, &arcs, &inputs)
}

impl Kinds {
    /// Equations with the same tables are of a kind, and so are those without any that are beside mostly the same ones.
    fn of(problem: &Problem, tables: &Tables, beside: &[Vec<u32>]) -> Option<Kinds> {
        let mut items: Vec<(u64, Option<u32>)> =
            (0..number(tables.columns.len())).map(|group| (0, Some(group))).collect();
        let mut without: BTreeMap<&[u32], u64> = BTreeMap::new();
        for (equation, load) in problem.loads().iter().enumerate() {
            match tables.group[EquationId::at(equation)] {
                Some(group) => items[at(group)].0 += u64::from(*load),
                None => *without.entry(&beside[equation]).or_default() += u64::from(*load),
            }
        }
        let mut order: Vec<(&[u32], u64)> = without.into_iter().collect();
        order.sort_by_key(|(groups, load)| (Reverse(*load), *groups));
        let mut kinds: Vec<&[u32]> = Vec::new();
        let mut kind_of: BTreeMap<&[u32], usize> = BTreeMap::new();
        for (groups, load) in order {
            let known = kinds.iter().position(|kind| *kind == groups || alike(kind, groups));
            let kind = known.unwrap_or(kinds.len());
            if kind == kinds.len() {
                kinds.push(groups);
                items.push((0, None));
            }
            if kinds.len() > MOST_KINDS {
                return None;
            }
            items[tables.columns.len() + kind].0 += load;
            kind_of.insert(groups, kind);
        }
        let of = |(equation, beside): (usize, &Vec<u32>)| match tables.group[EquationId::at(equation)] {
            Some(group) => at(group),
            None => tables.columns.len() + kind_of[&**beside],
        };
        Some(Kinds { of: beside.iter().enumerate().map(of).collect(), items })
    }

    /// The division of a team of so many PEs whose columns fit base memories of a depth: the heaviest kind first, to the
    /// PE that has least, and to several if one would have too much of it.
    fn divide(&self, tables: &Tables, pes: u32, depth: u32, others: u32) -> Option<Division> {
        let mean = self.items.iter().map(|(load, _)| load).sum::<u64>().div_ceil(u64::from(pes)).max(1);
        let mut order: Vec<usize> = (0..self.items.len()).collect();
        order.sort_by_key(|kind| (self.items[*kind].1.is_none(), Reverse(self.items[*kind].0), *kind));
        let room = Room { tables, depth, others };
        let mut work = Work { loads: vec![0; at(pes)], columns: vec![BTreeSet::new(); at(pes)], shares: Vec::new() };
        work.shares.resize(self.items.len(), BTreeMap::new());
        for kind in order {
            let (load, group) = self.items[kind];
            let copies = load.div_ceil(mean).max(1);
            for _ in 0..copies {
                let free = (0..at(pes)).filter(|place| !work.shares[kind].contains_key(place));
                let fits = |place: &usize| room.fits(&work.columns[*place], group);
                let place = free.filter(fits).min_by_key(|place| (work.loads[*place], *place))?;
                work.add((kind, group), place, load / copies, tables);
            }
        }
        self.even(&mut work, mean, &room);
        let words = work.columns.iter().map(|columns| tables.words(columns.len(), others)).max()?;
        let load = work.loads.into_iter().max()?;
        let places = work.shares.into_iter().map(|shares| shares.into_keys().collect()).collect();
        Some(Division { pes, places, columns: work.columns, load, depth: memory::depth(words) })
    }

    /// Gives parts of kinds from the fullest PE to others, as long as their columns fit.
    fn even(&self, work: &mut Work, mean: u64, room: &Room) {
        for _ in 0..MOST_MOVES {
            let Some(full) = (0..work.loads.len()).max_by_key(|place| (work.loads[*place], Reverse(*place))) else {
                return;
            };
            let above = work.loads[full].saturating_sub(mean);
            if above <= mean / SLACK {
                return;
            }
            let of_full = (0..self.items.len()).filter_map(|kind| Some((kind, *work.shares[kind].get(&full)?)));
            let moves = of_full.flat_map(|(kind, share)| {
                let (loads, columns, group) = (&work.loads, &work.columns, self.items[kind].1);
                let below = (0..loads.len()).filter(move |place| loads[*place] < mean);
                below.filter(move |place| room.fits(&columns[*place], group)).map(move |place| (kind, share, place))
            });
            let best = moves.min_by_key(|(kind, share, place)| (work.loads[*place], Reverse(*share), *kind));
            let Some((kind, share, place)) = best else { return };
            let load = share.min(above).min(mean - work.loads[place]);
            work.add((kind, self.items[kind].1), place, load, room.tables);
            work.loads[full] -= load;
            match share - load {
                0 => work.shares[kind].remove(&full),
                left => work.shares[kind].insert(full, left),
            };
        }
    }
}

/// What the PEs of a team have.
struct Work {
    loads: Vec<u64>,
    columns: Vec<BTreeSet<u32>>,
    /// For each kind its load on the PEs that have it.
    shares: Vec<BTreeMap<usize, u64>>,
}

impl Work {
    fn add(&mut self, (kind, group): (usize, Option<u32>), place: usize, load: u64, tables: &Tables) {
        self.loads[place] += load;
        self.columns[place].extend(group.iter().flat_map(|group| &tables.columns[at(*group)]));
        *self.shares[kind].entry(place).or_default() += load;
    }
}

/// What a base memory holds.
struct Room<'a> {
    tables: &'a Tables,
    depth: u32,
    others: u32,
}

impl Room<'_> {
    /// Whether it has room for the tables of a group, too.
    fn fits(&self, columns: &BTreeSet<u32>, group: Option<u32>) -> bool {
        let more = group.map(|group| &self.tables.columns[at(group)]);
        let added = more.map_or(0, |more| more.iter().filter(|column| !columns.contains(column)).count());
        added == 0 || self.tables.words(columns.len() + added, self.others) <= self.depth
    }
}

/// Numbers of PEs that teams may have, so that all have as many.
fn sizes(pes: u32) -> impl Iterator<Item = u32> {
    (2..=MOST_PES.min(pes)).filter(move |size| pes.is_multiple_of(*size))
}

/// A mapping in teams whose base memories are less deep than the deepest one of another mapping; none if the model is
/// not made of parts, or if no division of its tables makes up for the connections.
pub fn in_teams(problem: &Problem, tables: &Tables, other: &Mapping, options: &MapOptions) -> Option<Candidate> {
    let pes = options.pes;
    let deepest = tables.depths(other).into_iter().max()?;
    let beside = beside(problem, tables);
    let (part, count) = parts(problem, tables, &beside);
    // As many PEs have a part each even so.
    sizes(pes).find(|size| pes / size <= count)?;
    let kinds = Kinds::of(problem, tables, &beside)?;
    let others = OTHER_WORDS + STATE_WORDS * tables.states.div_ceil(pes);
    let least = |size: u32| {
        let depths = (1..=deepest.ilog2()).map(|halved| deepest >> halved);
        depths.map_while(|depth| kinds.divide(tables, size, depth, others)).last()
    };
    let price = |division: &Division| {
        let blocks = memory::ram(division.depth, tables.word_bits).bram18 * pes;
        let connections = f64::from(pes * (division.pes - 1)) / 2.0;
        let luts = memory::BLOCK_LUTS * f64::from(blocks) + CONNECTION_LUTS * connections;
        luts * division.load as f64 * f64::from(division.pes)
    };
    let divisions = sizes(pes).filter(|size| pes / size <= count).filter_map(least);
    let division = divisions.min_by(|a, b| price(a).total_cmp(&price(b)).then(a.pes.cmp(&b.pes)))?;
    let size = division.pes;
    let of_teams = MapOptions {
        pes: pes / size,
        tries: options.tries.min(MapOptions::default_tries(count)),
        max_in_degree: options.max_in_degree.saturating_sub(size - 1).max(1),
        ..*options
    };
    let team = annealed(&of_parts(problem, &part, count), &of_teams).ok()?.swap_remove(0).mapping;
    let (mut loads, mut pe_of) = (vec![0u64; at(pes)], List::with_capacity(part.len()));
    for (equation, load) in problem.loads().iter().enumerate() {
        let first = team.pe_of[EquationId::new(part[equation])].index() * at(size);
        let places = division.places[kinds.of[equation]].iter().map(|place| first + place);
        let pe = places.min_by_key(|pe| (loads[*pe], *pe))?;
        loads[pe] += u64::from(*load);
        pe_of.push(PeId::at(pe));
    }
    let has = |columns: &Vec<u32>| {
        let of = |pe: usize| columns.iter().all(|column| division.columns[pe % at(size)].contains(column));
        (0..at(pes)).map(of).collect()
    };
    let permits = Permits { tables, pes: tables.columns.iter().map(has).collect() };
    settled(problem, Mapping { pes, pe_of }, &permits, options, (TEAMS, STREAM))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Equations of a cell: its potential, which reads gates and tables, functions of it with a table each, and gates that
    /// read two of these.
    const TABLES_OF_CELL: u32 = 12;
    const GATES: u32 = 4;
    const CELL: u32 = 1 + TABLES_OF_CELL + GATES;

    /// A sheet of cells whose potentials read their neighbours; some cells have another table in place of one.
    fn tissue(side: u32, others: u32) -> (Problem, Tables) {
        let cells = side * side;
        let (mut arcs, mut loads) = (Vec::new(), Vec::new());
        let mut group = List::filled(None, at(cells * CELL));
        // All potentials, then all functions, then all gates: parts are not in a row.
        let potential = |cell: u32| cell;
        let function = |cell: u32, table: u32| cells + cell * TABLES_OF_CELL + table;
        let gate = |cell: u32, gate: u32| cells * (1 + TABLES_OF_CELL) + gate * cells + cell;
        for cell in 0..cells {
            let (x, y) = (cell % side, cell / side);
            let beside = [(x > 0, cell.wrapping_sub(1)), (x + 1 < side, cell + 1)];
            let over = [(y > 0, cell.wrapping_sub(side)), (y + 1 < side, cell + side)];
            let beside = beside.into_iter().chain(over).filter(|(is, _)| *is).map(|(_, other)| potential(other));
            arcs.extend(beside.map(|other| (other, potential(cell))));
            for table in 0..TABLES_OF_CELL {
                let is_other = others > 0 && cell % others == 0 && table == 0;
                let which = if is_other { TABLES_OF_CELL } else { table };
                group[EquationId::new(function(cell, table))] = Some(which);
                arcs.extend([(potential(cell), function(cell, table)), (function(cell, table), potential(cell))]);
            }
            for number in 0..GATES {
                let read = [2 * number, 2 * number + 1].map(|table| (function(cell, table), gate(cell, number)));
                arcs.extend(read.into_iter().chain([(gate(cell, number), potential(cell))]));
            }
        }
        loads.extend((0..cells).map(|cell| 18 + u32::from(cell % side > 0)));
        loads.extend((0..cells * TABLES_OF_CELL).map(|function| 7 + function % 3));
        loads.extend((0..cells * GATES).map(|_| 3));
        // The local coordinate is the same column of all.
        let columns = (0..=TABLES_OF_CELL).map(|table| [0].into_iter().chain(1 + 6 * table..7 + 6 * table).collect());
        let tables =
            Tables { columns: columns.collect(), group, length: 128, states: cells * (1 + GATES), word_bits: 40 };
        (Problem::new(loads, &arcs, &[]), tables)
    }

    fn mapped(problem: &Problem, pes: u32) -> (Mapping, MapOptions) {
        let options = MapOptions { pes, seed: 1, tries: 100_000, max_in_degree: 15 };
        (super::super::super::map(problem, &options).expect("a mapping").swap_remove(0).mapping, options)
    }

    #[test]
    fn the_parts_of_a_tissue_are_its_cells() {
        for others in [0, 3] {
            let (problem, tables) = tissue(7, others);
            let beside = beside(&problem, &tables);
            let (part, count) = parts(&problem, &tables, &beside);
            assert_eq!(count, 49, "{others}");
            assert!((0..49).all(|cell| part[at(49 + cell * TABLES_OF_CELL)] == part[at(cell)]));
        }
    }

    #[test]
    fn teams_need_few_tables_and_have_balanced_loads() {
        for (side, others, pes) in [(12, 0, 16), (12, 5, 16), (9, 0, 12), (10, 0, 5)] {
            let (problem, tables) = tissue(side, others);
            let (first, options) = mapped(&problem, pes);
            let deepest = |mapping: &Mapping| tables.depths(mapping).into_iter().max().expect("a PE");
            let teams = in_teams(&problem, &tables, &first, &options).expect("cells are parts");
            assert!(2 * deepest(&teams.mapping) <= deepest(&first), "{side} {pes}");
            assert_eq!(problem.cost(&teams.mapping), teams.cost);
            let mean = problem.total_load() as f64 / f64::from(pes);
            let load = f64::from(teams.cost.max_load);
            assert!(load < 1.15 * mean && teams.cost.max_in_degree <= 15, "{side} {pes}: {load} of {mean}");
        }
    }

    #[test]
    fn what_falls_into_no_parts_has_no_teams() {
        let (problem, tables) = tissue(6, 0);
        // More PEs than a team may have.
        let (first, options) = mapped(&problem, 40);
        // A function that all cells read.
        let mut arcs: Vec<(u32, u32)> = Vec::new();
        for equation in 0..problem.equations() {
            let read = problem.neighbours(at(equation)).iter().filter(|neighbour| neighbour.reads() == 1);
            arcs.extend(read.map(|read| (number(read.node()), equation)));
        }
        arcs.extend((0..36).map(|cell| (36, cell)));
        let hub = Problem::new(problem.loads().to_vec(), &arcs, &[]);
        assert!(in_teams(&hub, &tables, &first, &options).is_none());
        // A number of PEs that is no multiple of another one.
        let (first, options) = mapped(&problem, 37);
        assert!(in_teams(&problem, &tables, &first, &options).is_none());
    }
}
