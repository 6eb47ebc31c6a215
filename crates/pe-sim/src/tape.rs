//! Narrow tiles as a list of chains.
//!
//! A tile of a few lanes costs more for the choice of its loops than for its products, and small models have no others.
//! Here all is chosen beforehand: every chain has its products with coefficients, then those of two slots, then its
//! writes. Numbers that are rounded depend on that order; chains of [`crate::slots::Slots::chains`] have it anyway.

use pe_ir::index::{at, number};
use std::ops::Range;

use crate::tiles::{Factors, NARROW, Tile, Tiles};

/// What to do next.
pub(crate) enum Part {
    /// A tile, by its index.
    Tile(u32),
    /// So many chains of the list.
    Chains(Range<u32>),
}

/// A step as tiles and chains one after another.
pub(crate) struct Tape<C> {
    /// All tiles, those among them that are listed as chains, too.
    pub tiles: Tiles<C>,
    /// In the order of execution.
    pub parts: Vec<Part>,
    chains: Vec<Chain>,
    /// Slot of an operand, and what it is multiplied by.
    products: Vec<(u32, C)>,
    /// Slots of both factors.
    factors: Vec<(u32, u32)>,
    writes: Vec<Write>,
}

/// A sum of products and where it goes.
pub(crate) struct Chain {
    pub class: u32,
    /// The kept sum that it starts from; none means zero.
    pub start: Option<u32>,
    /// Where it is kept, if it is.
    pub kept: Option<u32>,
    products: Range<u32>,
    factors: Range<u32>,
    writes: Range<u32>,
}

/// A write of a chain.
pub(crate) struct Write {
    pub target: u32,
    pub base: u32,
    pub shift: i32,
}

impl<C: Copy> Tape<C> {
    /// Takes apart the narrow tiles.
    pub fn new(tiles: Tiles<C>) -> Tape<C> {
        Tape::below(tiles, NARROW)
    }

    /// Takes apart all tiles but lookups.
    pub fn of_chains(tiles: Tiles<C>) -> Tape<C> {
        Tape::below(tiles, usize::MAX)
    }

    /// Takes apart tiles with fewer lanes.
    fn below(tiles: Tiles<C>, lanes: usize) -> Tape<C> {
        let mut tape = Tape {
            tiles,
            parts: Vec::new(),
            chains: Vec::new(),
            products: Vec::new(),
            factors: Vec::new(),
            writes: Vec::new(),
        };
        for index in 0..tape.tiles.tiles.len() {
            let tile = tape.tiles.tiles[index].clone();
            if at(tile.lanes) >= lanes || tile.lookups.is_some() {
                tape.parts.push(Part::Tile(number(index)));
                continue;
            }
            let first = number(tape.chains.len());
            (0..tile.lanes as usize).for_each(|lane| tape.push(&tile, lane));
            let end = number(tape.chains.len());
            match tape.parts.last_mut() {
                Some(Part::Chains(chains)) => chains.end = end,
                _ => tape.parts.push(Part::Chains(first..end)),
            }
        }
        tape
    }

    fn push(&mut self, tile: &Tile, lane: usize) {
        let Tape { tiles, chains, products, factors, writes, .. } = self;
        let slot = |place| number(tiles.slot(place, lane));
        let before = (number(products.len()), number(factors.len()), number(writes.len()));
        for product in &tiles.products[at(tile.products.start)..tile.products.end as usize] {
            let operand = slot(product.operands);
            match product.factors {
                Factors::Values(place) => factors.push((operand, slot(place))),
                Factors::Coefficients(coefficients) => {
                    products.push((operand, coefficients.of(lane, &tiles.coefficients)));
                }
            }
        }
        for write in &tiles.writes[at(tile.writes.start)..tile.writes.end as usize] {
            let shift = write.shifts.of(lane, &tiles.shifts);
            writes.push(Write { target: slot(write.targets), base: slot(write.bases), shift });
        }
        chains.push(Chain {
            class: tile.class,
            start: tile.starts.map(slot),
            kept: tile.kept.map(slot),
            products: before.0..number(products.len()),
            factors: before.1..number(factors.len()),
            writes: before.2..number(writes.len()),
        });
    }

    /// Chains of the list.
    #[inline(always)]
    pub fn chains(&self, range: &Range<u32>) -> &[Chain] {
        &self.chains[at(range.start)..at(range.end)]
    }

    /// Operands of a chain with their coefficients.
    #[inline(always)]
    pub fn products(&self, chain: &Chain) -> &[(u32, C)] {
        &self.products[at(chain.products.start)..at(chain.products.end)]
    }

    /// Operands of a chain with the slots of the second factors; they come behind those with coefficients.
    #[inline(always)]
    pub fn factors(&self, chain: &Chain) -> &[(u32, u32)] {
        &self.factors[at(chain.factors.start)..at(chain.factors.end)]
    }

    /// Writes of a chain.
    #[inline(always)]
    pub fn writes(&self, chain: &Chain) -> &[Write] {
        &self.writes[at(chain.writes.start)..at(chain.writes.end)]
    }
}
