//! Narrow tiles as a list of chains.
//!
//! A tile of a few lanes costs more for the choice of its loops than for its products, and small models have no others.
//! Here all is chosen beforehand: every chain has its products with coefficients, then those of two slots, then its
//! writes. Numbers that are rounded depend on that order; chains of [`crate::slots::Slots::chains`] have it anyway.
//! Chains of one shape that follow each other are a group, so that a processor foresees where their loops end.

use pe_ir::index::{at, number};
use std::ops::Range;

use crate::tiles::{Factors, NARROW, Tile, Tiles};

/// What to do next.
pub(crate) enum Part {
    /// A tile, by its index.
    Tile(u32),
    /// So many groups of the list.
    Groups(Range<u32>),
}

/// A step as tiles and chains one after another.
pub(crate) struct Tape<C> {
    /// All tiles, those among them that are listed as chains, too.
    pub tiles: Tiles<C>,
    /// In the order of execution.
    pub parts: Vec<Part>,
    groups: Vec<Group>,
    /// Slot of an operand, and what it is multiplied by.
    products: Vec<(u32, C)>,
    /// Slots of both factors.
    factors: Vec<(u32, u32)>,
    writes: Vec<Write>,
    /// By chain of a group that has any, the kept sum that it starts from, and where its sum is kept.
    sums: Vec<(Option<u32>, Option<u32>)>,
}

/// Chains one after another that have as many products, factors and writes.
pub(crate) struct Group {
    pub class: u32,
    /// Number of chains.
    chains: u32,
    /// Products, factors and writes of each.
    shape: [u32; 3],
    /// Where those of the first one begin.
    first: [u32; 3],
    /// Where its kept sums begin, if the chains have any.
    sums: Option<u32>,
}

/// A sum of products and where it goes.
pub(crate) struct Chain<'t, C> {
    /// Operands with their coefficients.
    pub products: &'t [(u32, C)],
    /// Operands with the slots of the second factors; they come behind those with coefficients.
    pub factors: &'t [(u32, u32)],
    /// Where the sum goes.
    pub writes: &'t [Write],
}

/// A write of a chain.
#[derive(Clone, Copy)]
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
            groups: Vec::new(),
            products: Vec::new(),
            factors: Vec::new(),
            writes: Vec::new(),
            sums: Vec::new(),
        };
        for index in 0..tape.tiles.tiles.len() {
            let tile = tape.tiles.tiles[index].clone();
            if at(tile.lanes) >= lanes || tile.lookups.is_some() {
                tape.parts.push(Part::Tile(number(index)));
                continue;
            }
            let first = number(tape.groups.len());
            let goes_on = match tape.parts.last() {
                Some(Part::Groups(_)) => tape.extends(&tile),
                _ => false,
            };
            if !goes_on {
                tape.begin(&tile);
            }
            (0..tile.lanes as usize).for_each(|lane| tape.push(&tile, lane));
            let end = number(tape.groups.len());
            match tape.parts.last_mut() {
                Some(Part::Groups(groups)) => groups.end = end,
                _ => tape.parts.push(Part::Groups(first..end)),
            }
        }
        tape
    }

    fn products_of(&self, tile: &Tile) -> Range<usize> {
        at(tile.products.start)..at(tile.products.end)
    }

    /// Products with coefficients, products of two slots, and writes of each lane of a tile.
    fn shape(&self, tile: &Tile) -> [u32; 3] {
        let products = &self.tiles.products[self.products_of(tile)];
        let factors = products.iter().filter(|product| matches!(product.factors, Factors::Values(_))).count();
        [number(products.len() - factors), number(factors), tile.writes.end - tile.writes.start]
    }

    /// Whether the lanes of a tile are chains of the latest group.
    fn extends(&self, tile: &Tile) -> bool {
        let keeps = tile.starts.is_some() || tile.kept.is_some();
        let like =
            |group: &Group| (group.class, group.shape, group.sums.is_some()) == (tile.class, self.shape(tile), keeps);
        self.groups.last().is_some_and(like)
    }

    fn begin(&mut self, tile: &Tile) {
        let keeps = tile.starts.is_some() || tile.kept.is_some();
        self.groups.push(Group {
            class: tile.class,
            chains: 0,
            shape: self.shape(tile),
            first: [self.products.len(), self.factors.len(), self.writes.len()].map(number),
            sums: keeps.then(|| number(self.sums.len())),
        });
    }

    fn push(&mut self, tile: &Tile, lane: usize) {
        let range = self.products_of(tile);
        let Tape { tiles, groups, products, factors, writes, sums, .. } = self;
        let slot = |place| number(tiles.slot(place, lane));
        for product in &tiles.products[range] {
            let operand = slot(product.operands);
            match product.factors {
                Factors::Values(place) => factors.push((operand, slot(place))),
                Factors::Coefficients(coefficients) => {
                    products.push((operand, coefficients.of(lane, &tiles.coefficients)));
                }
            }
        }
        for write in &tiles.writes[at(tile.writes.start)..at(tile.writes.end)] {
            let shift = write.shifts.of(lane, &tiles.shifts);
            writes.push(Write { target: slot(write.targets), base: slot(write.bases), shift });
        }
        let group = groups.last_mut().expect("a group was begun");
        group.chains += 1;
        if group.sums.is_some() {
            sums.push((tile.starts.map(slot), tile.kept.map(slot)));
        }
    }

    /// Groups of the list.
    #[inline(always)]
    pub fn groups(&self, range: &Range<u32>) -> &[Group] {
        &self.groups[at(range.start)..at(range.end)]
    }

    /// Chains of a group.
    #[inline(always)]
    pub fn chains(&self, group: &Group) -> impl Iterator<Item = Chain<'_, C>> {
        let [products, factors, writes] = group.first.map(at);
        let each = group.shape.map(at);
        let mut left = (&self.products[products..], &self.factors[factors..], &self.writes[writes..]);
        (0..group.chains).map(move |_| {
            let (products, factors, writes);
            (products, left.0) = left.0.split_at(each[0]);
            (factors, left.1) = left.1.split_at(each[1]);
            (writes, left.2) = left.2.split_at(each[2]);
            Chain { products, factors, writes }
        })
    }

    /// For each chain of a group the kept sum that it starts from, and where its sum is kept; none if the group has none.
    #[inline(always)]
    pub fn sums(&self, group: &Group) -> Option<&[(Option<u32>, Option<u32>)]> {
        group.sums.map(|first| &self.sums[at(first)..][..at(group.chains)])
    }
}
