//! Layout of the values of a step, and its chains in execution order.

use std::collections::BTreeMap;
use std::ops::Range;

use pe_ir::graph::{Factor, Role, StepGraph, ValueId};
use pe_ir::index::{self, at};

use super::fuse;
use super::loops::{self, Arranged, Memory, Row};
use super::order::Order;
use crate::slots::Slots;
use crate::tiles::{self, Chain, Outcome, Term};

/// Slots at whose multiples rows begin: a line of the cache in single precision.
const LINE: u32 = 16;

/// Readers from which on a value counts as one that all read.
const MANY_READERS: u32 = 64;

/// Where everything lies, and the loops over it.
pub(super) struct Layout {
    pub slots: Slots,
    pub chains: Vec<Chain>,
    pub terms: Vec<Term<f64>>,
    pub memory: Memory,
    pub arranged: Arranged,
}

impl Layout {
    pub fn new(graph: &StepGraph, order: &Order) -> Layout {
        let slots = Slots::in_rows(graph, |_| 0, (LINE, order.edge, |value, row| order.row(graph, value, row)));
        let coefficient = |term: usize| match graph.terms[term].factor {
            Factor::Coefficient(coefficient) => coefficient,
            Factor::Value(_) => 0.0,
        };
        let (mut chains, terms, columns) = slots.chains(graph, |_, _| 0, coefficient, |_, _, write| write.weight);
        let levels = tiles::levels(&chains, &terms, slots.count(), &columns);
        // The entries of a column stand one after the other: from here on `among` is the slot of the first.
        for chain in &mut chains {
            if let Outcome::Choice { among, .. } = &mut chain.outcome {
                *among = columns.choices[at(*among)];
            }
        }
        let mut constants = vec![None; slots.count()];
        let mut shared = vec![false; slots.count()];
        for (index, value) in (0..).zip(&graph.values) {
            let slot = at(slots.of(ValueId::new(index)));
            match value.role {
                Role::Constant(number) => (constants[slot], shared[slot]) = (Some(number), true),
                Role::Input(_) => shared[slot] = true,
                _ => {}
            }
        }
        let mut readers = vec![0; slots.count()];
        for term in &terms {
            readers[at(term.operand)] += 1;
        }
        for (shared, readers) in shared.iter_mut().zip(readers) {
            *shared |= readers >= MANY_READERS;
        }
        let ranges = rows(graph, order, &slots);
        let mut free = vec![false; slots.count()];
        for range in &ranges {
            free[at(range.start)..range.end as usize].fill(true);
        }
        for slot in (0..graph.values.len() as u32).map(|value| slots.of(ValueId::new(value))) {
            free[at(slot)] = false;
        }
        free[at(slots.zero())..].fill(false);
        let rows = placed(graph, &slots, (&chains, &terms, &levels), &ranges, &free);
        let memory = Memory { rows, constants, shared, free, zero: slots.zero() };
        let mut arranged = loops::arrange(&chains, &terms, &levels, &memory);
        let published = graph.outputs.iter().map(|output| memory.row(slots.of(*output)));
        let alone = arranged.rest.iter().flat_map(|(_, chain)| read(&chains[*chain], &terms));
        let needed = published.chain(alone.map(|slot| memory.row(slot))).chain(arranged.read_free.iter().copied());
        let needed = needed.collect();
        fuse::fuse(&mut arranged.loops, &memory, &needed);
        Layout { slots, chains, terms, memory, arranged }
    }
}

/// The slots that a chain reads, but for those that a lookup chooses among.
fn read<'a>(chain: &'a Chain, terms: &'a [Term<f64>]) -> impl Iterator<Item = u32> + 'a {
    let own = &terms[at(chain.terms.start)..chain.terms.end as usize];
    let factors = own.iter().filter_map(|term| match term.factor {
        tiles::Factor::Value(slot) => Some(slot),
        tiles::Factor::Coefficient(_) => None,
    });
    let bases = chain.writes().map(|write| write.base);
    own.iter().map(|term| term.operand).chain(factors).chain(bases).chain(chain.looked_at())
}

/// The slots of each row, in their order; the last is everything that is no value.
fn rows(graph: &StepGraph, order: &Order, slots: &Slots) -> Vec<Range<u32>> {
    let mut firsts: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    for (value, row) in Slots::kinds(graph) {
        let ((kind, stage, place), exact) = order.row(graph, value, row);
        let first = firsts.entry((kind, stage)).or_insert(u32::MAX);
        *first = (slots.of(value) - if exact { place } else { 0 }).min(*first);
    }
    let mut firsts: Vec<u32> = firsts.into_values().collect();
    firsts.extend([slots.zero(), index::number(slots.count())]);
    firsts.sort_unstable();
    firsts[0] = 0;
    firsts.windows(2).map(|pair| pair[0]..pair[1]).collect()
}

/// Rows in as little memory as will do: a row that nothing reads any more gives its place to one that is written later.
/// States and those of the next step change places after every step.
fn placed(
    graph: &StepGraph,
    slots: &Slots,
    (chains, terms, levels): (&[Chain], &[Term<f64>], &[u32]),
    ranges: &[Range<u32>],
    free: &[bool],
) -> Vec<Row> {
    let row = |slot: u32| ranges.partition_point(|range| range.end <= slot);
    let (mut written, mut last_read) = (vec![None; ranges.len()], vec![0; ranges.len()]);
    for (chain, level) in chains.iter().zip(levels) {
        for target in chain.targets() {
            let first: &mut Option<u32> = &mut written[row(target)];
            *first = Some(first.unwrap_or(*level).min(*level));
        }
        for slot in read(chain, terms) {
            let last = &mut last_read[row(slot)];
            *last = (*level).max(*last);
        }
        for target in chain.targets() {
            let last = &mut last_read[row(target)];
            *last = (*level).max(*last);
        }
    }
    let kept: Vec<usize> = graph.states.iter().map(|(_, next)| row(slots.of(*next))).collect();
    let mut by_level: Vec<usize> = (0..ranges.len()).collect();
    by_level.sort_by_key(|index| (written[*index], *index));
    // Places with the level from which on they can be written, by what may lie there.
    let mut places: BTreeMap<&[bool], Vec<(u32, i64)>> = BTreeMap::new();
    let mut rows: Vec<Row> =
        ranges.iter().map(|slots| Row { slots: slots.clone(), shift: [0, 0], until: None }).collect();
    let mut end = 0;
    for index in by_level {
        let range = &ranges[index];
        let pattern = &free[at(range.start)..range.end as usize];
        let reusable = written[index].filter(|_| !kept.contains(&index) && index + 1 < ranges.len());
        let known = places.entry(pattern).or_default();
        let found = reusable.and_then(|level| known.iter_mut().find(|(from, _)| *from <= level));
        let start = match (found, reusable) {
            (Some(place), _) => {
                place.0 = last_read[index] + 1;
                place.1
            }
            (None, reusable) => {
                let start = i64::from(end);
                end += (range.end - range.start).next_multiple_of(LINE);
                if reusable.is_some() {
                    known.push((last_read[index] + 1, start));
                }
                start
            }
        };
        rows[index].until = reusable.map(|_| last_read[index]);
        rows[index].shift = [start - i64::from(range.start); 2];
    }
    if let Some((states, next)) = exchanged(graph, slots, &row) {
        let (of_states, of_next) = (rows[states].shift[0], rows[next].shift[0]);
        let distance = i64::from(ranges[next].start) - i64::from(ranges[states].start);
        rows[states].shift[1] = of_next + distance;
        rows[next].shift[1] = of_states - distance;
    }
    rows
}

/// The rows of states and of those of the next step, if one can take the place of the other.
fn exchanged(graph: &StepGraph, slots: &Slots, row: &impl Fn(u32) -> usize) -> Option<(usize, usize)> {
    let pairs = || graph.states.iter().map(|(state, next)| (slots.of(*state), slots.of(*next)));
    let (states, next) = pairs().next()?;
    let mut seen = std::collections::BTreeSet::new();
    let alike = pairs().all(|(state, of_next)| {
        i64::from(state) - i64::from(states) == i64::from(of_next) - i64::from(next)
            && (row(state), row(of_next)) == (row(states), row(next))
            && seen.insert(of_next)
    });
    (alike && row(states) != row(next)).then(|| (row(states), row(next)))
}
