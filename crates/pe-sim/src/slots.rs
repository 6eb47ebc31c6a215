//! Layout of the values of a step graph while it runs.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use pe_ir::graph::{Chain, Role, StepGraph, ValueId, Write};
use pe_ir::index::{self, ChainId, StateId, at};
use pe_ir::pasts::{Past, Pasts};

use crate::rows::{Kept, Rows};
use crate::tiles::{self, Outcome};

/// A slot for each value, one behind them that stands for a missing base, then one for the segment of each lookup and
/// one for each entry of the tables' columns.
#[derive(Clone, Debug)]
pub(crate) struct Slots {
    of: Vec<u32>,
    /// The slot behind those of all values.
    zero: u32,
    /// Number of lookups.
    lookups: u32,
    /// First entry of each column that is kept, by a value that it gives and its index into [`Slots::entries`].
    columns: Vec<(ValueId, u32)>,
    /// Values that read a column, and which of [`Slots::columns`] it is.
    column_of: BTreeMap<u32, u32>,
    /// Number of entries of all columns.
    entries: u32,
    /// Slots from the first on that no chain writes: states, inputs, constants.
    pub given: usize,
    /// States taken over at the end of a step, as rows: from, to, length.
    copies: Vec<(u32, u32, u32)>,
    /// States that are in long rows of the past.
    rows: Rows,
}

impl Slots {
    /// Puts values of one kind in a row, in the order of what they belong to: equations that differ only in their
    /// indices then read rows as well. Values of a column that differ in `kind` have entries of their own; `copies` says
    /// whether a chain gives its only operand as it is, or as it is moved.
    pub fn new(graph: &StepGraph, kind: impl Fn(ValueId) -> i32, copies: impl Fn(ChainId, &Chain) -> bool) -> Slots {
        let mut slots = Slots::in_rows(graph, kind, (1, 0, |_, row| (row, false)));
        slots.rows = Rows::of(graph, |value| slots.of(value), copies);
        slots.copies = slots.copied(graph);
        slots
    }

    /// The same, where `row` may change the row of a value and its place in there, and says whether places are exact:
    /// slots between them, and `tail` slots behind the last one, are then left free. Rows begin at multiples of `align`
    /// slots.
    pub fn in_rows(
        graph: &StepGraph,
        column_kind: impl Fn(ValueId) -> i32,
        (align, tail, row): (u32, u32, impl Fn(ValueId, InRow) -> (InRow, bool)),
    ) -> Slots {
        let kinds = graph.values.iter().map(|value| kind(&value.role));
        let rows: Vec<(InRow, bool)> = (0..).zip(kinds).map(|(index, kind)| row(ValueId::new(index), kind)).collect();
        let mut order: Vec<u32> = (0..graph.values.len() as u32).collect();
        order.sort_by_key(|index| (rows[at(*index)].0, *index));
        let (mut of, mut zero, mut given) = (vec![0; order.len()], 0u32, 0);
        let (mut before, mut start, mut behind) = (None, 0, 0);
        for value in order {
            let ((kind, stage, place), exact) = rows[at(value)];
            if before.replace((kind, stage)) != Some((kind, stage)) {
                zero = (zero + behind).next_multiple_of(align);
                start = zero;
                behind = if exact { tail } else { 0 };
            }
            if exact {
                zero = zero.max(start + place);
            }
            of[at(value)] = zero;
            zero += 1;
            if kind < COMPUTED {
                given = at(zero);
            }
        }
        zero += behind;
        let lookups = index::number(graph.functions.lookups.len());
        let mut slots = Slots {
            of,
            zero,
            lookups,
            columns: Vec::new(),
            column_of: BTreeMap::new(),
            entries: 0,
            given,
            copies: Vec::new(),
            rows: Rows::default(),
        };
        let mut known: BTreeMap<(u32, u8, i32), u32> = BTreeMap::new();
        for (index, value) in (0..).zip(&graph.values) {
            if let Role::Column(lookup, column) = value.role {
                let table = graph.functions.lookups[at(lookup)].table;
                let next = index::number(slots.columns.len());
                let number = *known.entry((table, column, column_kind(ValueId::new(index)))).or_insert(next);
                if number == next {
                    slots.columns.push((ValueId::new(index), slots.entries));
                    slots.entries += index::number(graph.functions.segments.count());
                }
                slots.column_of.insert(index, number);
            }
        }
        slots.copies = slots.copied(graph);
        slots
    }

    /// What is to be moved at the end of a step, but for rows of the past.
    fn copied(&self, graph: &StepGraph) -> Vec<(u32, u32, u32)> {
        let mut copies: Vec<(u32, u32, u32)> = Vec::new();
        // A word of a ring leaves before the one that comes after it arrives.
        let pasts = Pasts::of(graph);
        let follows = |(state, past): &(StateId, Past)| past.age > 1 && !self.rows.have(*state);
        let mut members: Vec<(StateId, Past)> = pasts.members().filter(follows).collect();
        members.sort_unstable_by_key(|(state, past)| (past.head, Reverse(past.age), *state));
        for (state, next) in members.iter().map(|(state, _)| graph.states[*state]) {
            let (from, to) = (self.of(next), self.of(state));
            match copies.last_mut() {
                Some((start, target, length)) if from + 1 == *start && to + 1 == *target => {
                    (*start, *target, *length) = (from, to, *length + 1);
                }
                _ => copies.push((from, to, 1)),
            }
        }
        for (index, (state, next)) in graph.states.numbered() {
            if matches!(graph.value(*next).role, Role::State(_)) || self.rows.have(index) {
                continue;
            }
            let (from, to) = (self.of(*next), self.of(*state));
            match copies.last_mut() {
                Some((start, target, length)) if from == *start + *length && to == *target + *length => *length += 1,
                _ => copies.push((from, to, 1)),
            }
        }
        copies
    }

    /// All values with what is their row unless it is changed.
    pub fn kinds<'a>(graph: &'a StepGraph) -> impl Iterator<Item = (ValueId, InRow)> + 'a {
        (0..).zip(&graph.values).map(|(index, value)| (ValueId::new(index), kind(&value.role)))
    }

    /// The slot of a value.
    pub fn of(&self, value: ValueId) -> u32 {
        self.of[value.index()]
    }

    /// Where the states of a graph lie: in their order from the first slot on.
    ///
    /// # Panics
    /// If they do not.
    pub fn states(&self, graph: &StepGraph) -> std::ops::Range<usize> {
        let in_order = (0..).zip(&graph.states).all(|(slot, (state, _))| self.of(*state) == slot);
        assert!(in_order, "states come first, in their order");
        0..graph.states.len()
    }

    /// The slot of what a missing base means.
    pub fn zero(&self) -> u32 {
        self.zero
    }

    /// What [`Slots::copy`] moves: from, to, length.
    pub fn copies(&self) -> &[(u32, u32, u32)] {
        &self.copies
    }

    /// Number of slots.
    pub fn count(&self) -> usize {
        at(self.first_entry() + self.entries)
    }

    /// The slot of the segment of a lookup.
    fn segment(&self, lookup: u32) -> u32 {
        self.zero() + 1 + lookup
    }

    fn first_entry(&self) -> u32 {
        self.segment(self.lookups)
    }

    /// Entries of the columns: a value that the column gives, the segment, and the slot.
    pub fn column_entries<'a>(&'a self, graph: &'a StepGraph) -> impl Iterator<Item = (ValueId, usize, u32)> + 'a {
        let segments = 0..graph.functions.segments.count();
        self.columns.iter().flat_map(move |(value, first)| {
            segments.clone().map(move |segment| (*value, segment, self.first_entry() + first + index::number(segment)))
        })
    }

    /// Numbers of all values, in the order of the graph, from those of all slots.
    pub fn in_graph_order<T: Copy>(&self, numbers: &[T]) -> Vec<T> {
        self.of.iter().map(|slot| numbers[at(*slot)]).collect()
    }

    /// The rows of the past.
    pub fn rows(&self) -> &Rows {
        &self.rows
    }

    /// The states of the next step take the place of those of this one.
    #[inline(always)]
    pub fn take_over<T: Copy>(&self, values: &mut [T], past: &mut Kept<T>) {
        past.advance(&self.rows, values, |number| number);
        self.copy(values);
        past.show(&self.rows, |slot, number| values[slot] = number);
    }

    /// What of that is no row of the past.
    #[inline(always)]
    pub fn copy<T: Copy>(&self, values: &mut [T]) {
        for (from, to, length) in &self.copies {
            // Short rows are shorter than a call; those of rings overlap.
            if *length < 16 && from.abs_diff(*to) >= *length {
                (0..at(*length)).for_each(|place| values[at(*to) + place] = values[at(*from) + place]);
            } else {
                values.copy_within(at(*from)..at(from + length), at(*to));
            }
        }
    }

    /// The chains of a graph over slots as tiles; arguments as those of [`Slots::chains`].
    pub fn arrange<C: Copy + PartialEq>(
        &self,
        graph: &StepGraph,
        class: impl Fn(ChainId, &Chain) -> u32,
        coefficient: impl Fn(usize) -> C,
        shift: impl Fn(ChainId, usize, &Write) -> i32,
    ) -> tiles::Tiles<C> {
        let (chains, terms, columns) = self.chains(graph, class, coefficient, shift);
        tiles::Tiles::new(&chains, &terms, self.count(), columns)
    }

    /// The chains of a graph over slots, their terms, and what lookups choose among; the products of two values come
    /// last in each sum. `class` and `shift` say what the arithmetic needs to know of a chain and of its writes,
    /// `coefficient` gives the number of a term.
    pub fn chains<C>(
        &self,
        graph: &StepGraph,
        class: impl Fn(ChainId, &Chain) -> u32,
        coefficient: impl Fn(usize) -> C,
        shift: impl Fn(ChainId, usize, &Write) -> i32,
    ) -> (Vec<tiles::Chain>, Vec<tiles::Term<C>>, tiles::Columns) {
        use pe_ir::graph::Factor;
        let mut terms = Vec::with_capacity(graph.terms.len());
        let mut chains = Vec::with_capacity(graph.chains.len());
        let mut looked_up = vec![false; at(self.lookups)];
        let mut chosen: BTreeSet<ValueId> = BTreeSet::new();
        for (index, chain) in graph.chains.numbered().filter(|(index, _)| !self.rows.stand_for(*index)) {
            for base in chain.writes().filter_map(|write| write.base) {
                let Role::Column(lookup, _) = graph.value(base).role else { continue };
                let mut look_up = |outcome| {
                    let none = index::number(terms.len());
                    chains.push(tiles::Chain { terms: none..none, start: None, outcome, class: 0 });
                };
                let segment = self.segment(lookup);
                let lookup = at(lookup);
                if !std::mem::replace(&mut looked_up[lookup], true) {
                    let lookup = graph.functions.lookups[lookup];
                    let octaves = graph.functions.tables[at(lookup.table)].octaves;
                    look_up(Outcome::Segment { target: segment, argument: self.of(lookup.argument), octaves });
                }
                if chosen.insert(base) {
                    let among = self.columns[at(self.column_of[&base.number()])].1;
                    look_up(Outcome::Choice { target: self.of(base), segment, among });
                }
            }
            let start = index::number(terms.len());
            for with_factor in [false, true] {
                for term in chain.terms.clone() {
                    let factor = match graph.terms[at(term)].factor {
                        Factor::Coefficient(_) => tiles::Factor::Coefficient(coefficient(at(term))),
                        Factor::Value(value) => tiles::Factor::Value(self.of(value)),
                    };
                    if matches!(factor, tiles::Factor::Value(_)) == with_factor {
                        terms.push(tiles::Term { operand: self.of(graph.terms[at(term)].operand), factor });
                    }
                }
            }
            let write = |position: usize, write: &Write| tiles::Write {
                target: self.of(write.value),
                base: write.base.map_or(self.zero(), |base| self.of(base)),
                shift: shift(index, position, write),
            };
            let mut writes = chain.writes().enumerate().map(|(position, one)| write(position, one));
            let first = writes.next().expect("a chain writes");
            chains.push(tiles::Chain {
                terms: start..terms.len() as u32,
                start: None,
                outcome: Outcome::Words(first, [writes.next(), writes.next()]),
                class: class(index, chain),
            });
        }
        let choices = (self.first_entry()..self.first_entry() + self.entries).collect();
        (chains, terms, tiles::Columns { segments: graph.functions.segments, choices })
    }
}

/// The first kind of values that chains write.
const COMPUTED: u32 = 3;

/// Kind of a value, its stage or serial number, which are its row, and what it belongs to, which is its place there.
pub(crate) type InRow = (u32, u32, u32);

/// The row of values that are states of the next step.
pub(crate) const NEXT: u32 = 5;

fn kind(role: &Role) -> InRow {
    match *role {
        Role::State(state) => (0, 0, state.number()),
        Role::Input(input) => (1, 0, input),
        Role::Constant(_) => (2, 0, 0),
        Role::Stage(state, stage) => (COMPUTED, u32::from(stage), state.number()),
        Role::Sum(state, stage) => (4, u32::from(stage), state.number()),
        Role::Interim(state, stage) => (13, u32::from(stage), state.number()),
        Role::Next(state) => (NEXT, 0, state.number()),
        Role::Algebraic(algebraic, stage) => (6, u32::from(stage), algebraic),
        Role::Inner(equation, serial) => (7, serial, equation.number()),
        Role::Partial(equation, serial) => (8, serial, equation.number()),
        Role::Relayed(value, relay) => (14, relay, value.number()),
        Role::Published(output) => (9, 0, output),
        Role::Pivot(state, matrix) => (12, u32::from(matrix), state.number()),
        Role::Auxiliary(auxiliary) => (11, 0, auxiliary),
        Role::Column(lookup, column) => (10, u32::from(column), lookup),
    }
}
