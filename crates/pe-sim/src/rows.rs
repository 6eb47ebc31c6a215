//! Long rows of states each of which takes, at the end of a step, what the one before it was: the past of a quantity. Their
//! numbers stay where they are, and what moves is the place where a row begins, so that a step takes no longer for a longer past.
//!
//! Chains read slots. So the states of a row that something reads have their numbers in their slots as well.

use std::collections::BTreeSet;

use pe_ir::graph::{Chain, Factor, Role, StepGraph, ValueId};
use pe_ir::index::{self, ChainId, List, StateId, at};

/// States of a row that nothing reads, from which on moving its beginning is cheaper than moving its numbers.
const UNREAD: usize = 16;

/// Rows over slots.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rows {
    rows: Vec<Row>,
    /// By slot the row of the state that it is of, and how far behind the beginning that is; nothing if there are no rows.
    places: Vec<Option<(u32, u32)>>,
    /// Chains that would move numbers.
    moved: BTreeSet<ChainId>,
    /// States of rows.
    members: BTreeSet<StateId>,
}

/// A row.
#[derive(Clone, Debug)]
struct Row {
    /// The slot of the state that the row follows.
    head: u32,
    /// Its numbers are these, among those of all rows.
    first: usize,
    length: usize,
    /// Slots that something reads, each with how far behind the beginning it is.
    read: Vec<(u32, usize)>,
}

/// Numbers of rows.
#[derive(Clone, Debug)]
pub(crate) struct Kept<T> {
    numbers: Vec<T>,
    /// Where each row begins.
    begins: Vec<usize>,
    /// Whether numbers were set that have not been moved since.
    fresh: bool,
}

impl Rows {
    /// The rows of a graph. `copies` says whether a chain gives its only operand as it is, or as it is moved.
    pub fn of(graph: &StepGraph, slot: impl Fn(ValueId) -> u32, copies: impl Fn(ChainId, &Chain) -> bool) -> Rows {
        let follows = followed(graph, copies);
        let mut next: List<StateId, Option<StateId>> = List::filled(None, graph.states.len());
        let mut moves: List<StateId, bool> = List::filled(false, graph.states.len());
        // Of states that follow the same one only the first is in its row.
        for (state, followed) in follows.numbered() {
            if let Some((other, _)) = followed
                && next[*other].is_none()
            {
                (next[*other], moves[state]) = (Some(state), true);
            }
        }
        let of_row = |state: StateId| follows[state].filter(|_| moves[state]).and_then(|(_, chain)| chain);
        let moved: BTreeSet<ChainId> = graph.states.ids().filter_map(of_row).collect();
        let mut read = read(graph, &moved);
        for (_, followed) in follows.numbered().filter(|(state, _)| !moves[*state]) {
            if let Some((other, _)) = followed {
                read[graph.states[*other].0.index()] = true;
            }
        }
        let mut rows = Rows::default();
        let mut first = 0;
        let heads = graph.states.ids().filter(|state| !moves[*state] && next[*state].is_some());
        for head in heads {
            let row: Vec<StateId> = std::iter::successors(next[head], |state| next[*state]).collect();
            let is_read = |state: StateId| read[graph.states[state].0.index()];
            if row.iter().filter(|state| !is_read(**state)).count() < UNREAD {
                continue;
            }
            let number = index::number(rows.rows.len());
            let mut shown = Vec::new();
            for (place, state) in row.iter().enumerate() {
                let (start, end) = graph.states[*state];
                let ends = Some(end).filter(|end| graph.value(*end).role == Role::Next(*state));
                for own in std::iter::once(start).chain(ends).map(&slot) {
                    let most = rows.places.len().max(at(own) + 1);
                    rows.places.resize(most, None);
                    rows.places[at(own)] = Some((number, index::number(place)));
                }
                if is_read(*state) {
                    shown.push((slot(start), place));
                }
                rows.moved.extend(of_row(*state));
            }
            rows.rows.push(Row { head: slot(graph.states[head].0), first, length: row.len(), read: shown });
            first += row.len();
            rows.members.extend(row);
        }
        rows
    }

    /// Room for the numbers of all rows.
    pub fn kept<T: Copy>(&self, zero: T) -> Kept<T> {
        let count = self.rows.iter().map(|row| row.length).sum();
        Kept { numbers: vec![zero; count], begins: vec![0; self.rows.len()], fresh: false }
    }

    /// Whether rows do what a chain does.
    pub fn stand_for(&self, chain: ChainId) -> bool {
        self.moved.contains(&chain)
    }

    /// Whether a state is in a row.
    pub fn have(&self, state: StateId) -> bool {
        self.members.contains(&state)
    }

    /// Slots up to an end that are in no row.
    pub fn others(&self, end: usize) -> Vec<std::ops::Range<usize>> {
        let mut ranges: Vec<std::ops::Range<usize>> = Vec::new();
        for slot in (0..end).filter(|slot| self.place(*slot).is_none()) {
            match ranges.last_mut() {
                Some(range) if range.end == slot => range.end += 1,
                _ => ranges.push(slot..slot + 1),
            }
        }
        ranges
    }

    /// Raises what there is of each slot of a row to the largest of its row and of the state that the row follows, which all
    /// that comes into the row has been.
    pub fn spread<T: Copy + PartialOrd>(&self, largest: &mut [T]) {
        let mut of_rows: Vec<T> = self.rows.iter().map(|row| largest[at(row.head)]).collect();
        let larger = |one: T, other: T| if other > one { other } else { one };
        for (slot, (row, _)) in self.slots() {
            of_rows[row] = larger(of_rows[row], largest[slot]);
        }
        for (slot, (row, _)) in self.slots() {
            largest[slot] = of_rows[row];
        }
    }

    fn slots(&self) -> impl Iterator<Item = (usize, (usize, usize))> {
        let place = |place: (u32, u32)| (at(place.0), at(place.1));
        self.places.iter().enumerate().filter_map(move |(slot, own)| Some((slot, place((*own)?))))
    }

    #[inline(always)]
    fn place(&self, slot: usize) -> Option<(usize, usize)> {
        let (row, place) = (*self.places.get(slot)?)?;
        Some((at(row), at(place)))
    }
}

impl<T: Copy> Kept<T> {
    /// The number of a slot.
    #[inline(always)]
    pub fn number(&self, rows: &Rows, slot: usize, numbers: &[T]) -> T {
        match rows.place(slot) {
            None => numbers[slot],
            Some(place) => self.numbers[self.at(rows, place)],
        }
    }

    /// Notes the number that a slot gets.
    pub fn set(&mut self, rows: &Rows, slot: usize, number: T) {
        if let Some(place) = rows.place(slot) {
            let own = self.at(rows, place);
            self.numbers[own] = number;
            self.fresh = true;
        }
    }

    fn at(&self, rows: &Rows, (row, place): (usize, usize)) -> usize {
        let Row { first, length, .. } = rows.rows[row];
        let place = self.begins[row] + place;
        first + if place < length { place } else { place - length }
    }

    /// Moves all rows on by what the states that they follow were in the step that ends. `moved` gives what a number becomes
    /// as it is moved for the first time.
    #[inline(always)]
    pub fn advance(&mut self, rows: &Rows, numbers: &[T], moved: impl Fn(T) -> T) {
        if std::mem::replace(&mut self.fresh, false) {
            self.numbers.iter_mut().for_each(|number| *number = moved(*number));
        }
        for (row, begin) in rows.rows.iter().zip(&mut self.begins) {
            *begin = if *begin == 0 { row.length } else { *begin } - 1;
            self.numbers[row.first + *begin] = moved(numbers[at(row.head)]);
        }
    }

    /// Tells the numbers that something reads, with their slots.
    #[inline(always)]
    pub fn show(&self, rows: &Rows, mut set: impl FnMut(usize, T)) {
        for (index, row) in rows.rows.iter().enumerate() {
            for (slot, place) in &row.read {
                set(at(*slot), self.numbers[self.at(rows, (index, *place))]);
            }
        }
    }
}

/// For each state the one whose number it takes, with the chain that would move it; none for states that take anything else.
fn followed(
    graph: &StepGraph,
    copies: impl Fn(ChainId, &Chain) -> bool,
) -> List<StateId, Option<(StateId, Option<ChainId>)>> {
    let mut follows: List<StateId, Option<(StateId, Option<ChainId>)>> = List::filled(None, graph.states.len());
    let mut ends_read = vec![false; graph.values.len()];
    each_read(graph, |_, value| ends_read[value.index()] = true);
    for (state, (start, end)) in graph.states.numbered() {
        if let Role::State(other) = graph.value(*end).role
            && end != start
        {
            follows[state] = Some((other, None));
        }
    }
    for (index, chain) in graph.chains.numbered() {
        let value = chain.write.value;
        let Role::Next(state) = graph.value(value).role else { continue };
        let [term] = graph.chain_terms(chain) else { continue };
        let alone = chain.interim.is_none() && chain.second.is_none() && chain.function.is_none();
        let plain = chain.write.base.is_none() && chain.write.weight == 0 && term.partner.is_none();
        if let (Role::State(other), Factor::Coefficient(_)) = (graph.value(term.operand).role, term.factor)
            && (alone && plain && other != state && !ends_read[value.index()] && copies(index, chain))
        {
            follows[state] = Some((other, Some(index)));
        }
    }
    follows
}

/// Which values are read, but by chains for which rows stand.
fn read(graph: &StepGraph, moved: &BTreeSet<ChainId>) -> Vec<bool> {
    let mut read = vec![false; graph.values.len()];
    each_read(graph, |by, value| {
        if by.is_none_or(|chain| !moved.contains(&chain)) {
            read[value.index()] = true;
        }
    });
    read
}

/// Values that are read, each with the chain that does.
fn each_read(graph: &StepGraph, mut visit: impl FnMut(Option<ChainId>, ValueId)) {
    for (index, chain) in graph.chains.numbered() {
        for term in graph.chain_terms(chain) {
            term.operands().for_each(|operand| visit(Some(index), operand));
            if let Factor::Value(factor) = term.factor {
                visit(Some(index), factor);
            }
        }
        chain.writes().filter_map(|write| write.base).for_each(|base| visit(Some(index), base));
    }
    graph.functions.lookups.iter().for_each(|lookup| visit(None, lookup.argument));
    graph.outputs.iter().for_each(|output| visit(None, *output));
}
