//! Symbols in place of the numbers of a network.

use std::collections::HashMap;

/// A symbol.
pub(super) type Id = u32;

/// What a symbol means. Numbers are as the datasheet writes them: stored words, operands, sums.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) enum Node {
    /// A word of an initial image, or a register's 0.
    Constant(u128),
    /// The rounding offset: base of words without one, by what makes it.
    Offset(String),
    /// What was stored there before the step: place, and which network if they differ.
    Stored(u32, u8),
    /// An input or tick, and the word in which it was taken.
    Input(String, u32),
    /// The operand that the data port, or the coefficient port, sees of a word.
    Data(Id),
    Factor(Id),
    /// Sum of an own and an imported operand; the flag tells whether the PE may add them.
    Both(Id, Id, bool),
    Product(Id, Id),
    Sum(Id, Id),
    /// Base, held sum, shift.
    Word(Id, Id, u32),
    /// Word, whether octaves are counted.
    Segment(Id, bool),
    /// One of some base words by an index.
    Chosen(Id, Vec<Id>),
    /// A port that does not exist.
    NoPort,
}

/// The number 0.
pub(super) const ZERO: Id = 0;

/// Shifts from here on stand for indices without a position.
pub(super) const UNKNOWN_SHIFT: u32 = 1_000;

/// All symbols, each once.
pub(super) struct Symbols {
    pub(super) nodes: Vec<Node>,
    ids: HashMap<Node, Id>,
}

impl Symbols {
    pub(super) fn new() -> Symbols {
        let mut symbols = Symbols { nodes: Vec::new(), ids: HashMap::new() };
        symbols.of(Node::Constant(0));
        symbols
    }

    pub(super) fn of(&mut self, node: Node) -> Id {
        if let Some(id) = self.ids.get(&node) {
            return *id;
        }
        let id = self.nodes.len() as Id;
        self.nodes.push(node.clone());
        self.ids.insert(node, id);
        id
    }

    pub(super) fn is_constant(&self, id: Id) -> bool {
        matches!(self.nodes[id as usize], Node::Constant(_) | Node::Offset(_))
    }

    pub(super) fn product(&mut self, operand: Id, factor: Id) -> Id {
        if operand == ZERO || factor == ZERO { ZERO } else { self.of(Node::Product(operand, factor)) }
    }

    pub(super) fn sum(&mut self, before: Id, product: Id) -> Id {
        match (before, product) {
            (ZERO, other) | (other, ZERO) => other,
            _ => self.of(Node::Sum(before, product)),
        }
    }

    /// A stored word; without a sum it is its base.
    pub(super) fn word(&mut self, base: Id, held: Id, shift: u32) -> Id {
        if held == ZERO { base } else { self.of(Node::Word(base, held, shift)) }
    }
}
