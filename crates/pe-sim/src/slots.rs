//! Where the values of a step graph lie while it runs.

use pe_ir::graph::{Chain, Role, StepGraph, ValueId, Write};

use crate::tiles;

/// A slot for each value, and one behind them that stands for a missing base.
#[derive(Clone, Debug)]
pub(crate) struct Slots {
    of: Vec<u32>,
    /// Slots from the first on that no chain writes: states, inputs, constants.
    pub given: usize,
    /// States taken over at the end of a step, as rows: from, to, length.
    copies: Vec<(u32, u32, u32)>,
}

impl Slots {
    /// Puts values of one kind in a row, in the order of what they belong to: equations that differ only in their
    /// indices then read rows as well.
    pub fn new(graph: &StepGraph) -> Slots {
        let mut order: Vec<u32> = (0..graph.values.len() as u32).collect();
        order.sort_by_key(|index| (kind(&graph.values[*index as usize].role), *index));
        let mut of = vec![0; order.len()];
        for (slot, value) in order.iter().enumerate() {
            of[*value as usize] = slot as u32;
        }
        let given = order.iter().take_while(|value| kind(&graph.values[**value as usize].role).0 < COMPUTED).count();
        let mut slots = Slots { of, given, copies: Vec::new() };
        for (state, next) in &graph.states {
            let (from, to) = (slots.of(*next), slots.of(*state));
            match slots.copies.last_mut() {
                Some((start, target, length)) if from == *start + *length && to == *target + *length => *length += 1,
                _ => slots.copies.push((from, to, 1)),
            }
        }
        slots
    }

    /// The slot of a value.
    pub fn of(&self, value: ValueId) -> u32 {
        self.of[value.index()]
    }

    /// The slot of what a missing base means.
    pub fn zero(&self) -> u32 {
        self.of.len() as u32
    }

    /// What [`Slots::take_over`] moves: from, to, length.
    pub fn copies(&self) -> &[(u32, u32, u32)] {
        &self.copies
    }

    /// Number of slots.
    pub fn count(&self) -> usize {
        self.of.len() + 1
    }

    /// Numbers of all values, in the order of the graph, from those of all slots.
    pub fn in_graph_order<T: Copy>(&self, numbers: &[T]) -> Vec<T> {
        self.of.iter().map(|slot| numbers[*slot as usize]).collect()
    }

    /// The states of the next step take the place of those of this one.
    #[inline(always)]
    pub fn take_over<T: Copy>(&self, values: &mut [T]) {
        for (from, to, length) in &self.copies {
            values.copy_within(*from as usize..(from + length) as usize, *to as usize);
        }
    }

    /// The chains of a graph over slots; the products of two values come last in each sum. `class` and `shift` say what
    /// the arithmetic needs to know of a chain and of its writes, `coefficient` gives the number of a term.
    pub fn arrange<C: Copy + PartialEq>(
        &self,
        graph: &StepGraph,
        class: impl Fn(usize, &Chain) -> u32,
        coefficient: impl Fn(usize) -> C,
        shift: impl Fn(usize, usize, &Write) -> i32,
    ) -> tiles::Tiles<C> {
        use pe_ir::graph::Factor;
        let mut terms = Vec::with_capacity(graph.terms.len());
        let mut chains = Vec::with_capacity(graph.chains.len());
        for (index, chain) in graph.chains.iter().enumerate() {
            let start = terms.len() as u32;
            for with_factor in [false, true] {
                for term in chain.terms.clone() {
                    let factor = match graph.terms[term as usize].factor {
                        Factor::Coefficient(_) => tiles::Factor::Coefficient(coefficient(term as usize)),
                        Factor::Value(value) => tiles::Factor::Value(self.of(value)),
                    };
                    if matches!(factor, tiles::Factor::Value(_)) == with_factor {
                        terms.push(tiles::Term { operand: self.of(graph.terms[term as usize].operand), factor });
                    }
                }
            }
            let write = |position: usize, write: &Write| tiles::Write {
                target: self.of(write.value),
                base: write.base.map_or(self.zero(), |base| self.of(base)),
                shift: shift(index, position, write),
            };
            chains.push(tiles::Chain {
                terms: start..terms.len() as u32,
                start: None,
                outcome: tiles::Outcome::Words(
                    write(0, &chain.write),
                    chain.second.as_ref().map(|second| write(1, second)),
                ),
                class: class(index, chain),
            });
        }
        tiles::Tiles::new(&chains, &terms, self.count())
    }
}

/// The first kind of values that chains write.
const COMPUTED: u32 = 3;

/// Kind of a value, its stage or serial number, and what it belongs to.
fn kind(role: &Role) -> (u32, u32, u32) {
    match *role {
        Role::State(state) => (0, 0, state),
        Role::Input(input) => (1, 0, input),
        Role::Constant(_) => (2, 0, 0),
        Role::Stage(state, stage) => (COMPUTED, u32::from(stage), state),
        Role::Sum(state, stage) => (4, u32::from(stage), state),
        Role::Next(state) => (5, 0, state),
        Role::Algebraic(algebraic, stage) => (6, u32::from(stage), algebraic),
        Role::Inner(equation, serial) => (7, serial, equation),
        Role::Partial(equation, serial) => (8, serial, equation),
        Role::Published(output) => (9, 0, output),
        Role::Pivot(state, matrix) => (12, u32::from(matrix), state),
        Role::Auxiliary(auxiliary) => (11, 0, auxiliary),
        Role::Column(lookup, column) => (10, u32::from(column), lookup),
    }
}
