//! Narrow tiles of a run in double precision as a list of numbers to multiply.
//!
//! A tile of a few lanes costs more for the choice of its loops than for its products, and small models have no others.
//! Here all is chosen beforehand: every product is that of two slots, coefficients among them.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::functions::FunctionRun;
use crate::tiles::{Factors, NARROW, Tile, Tiles};

/// What to do next.
pub(crate) enum Part {
    /// A tile, by its index.
    Tile(u32),
    /// So many chains of the list.
    Chains(Range<u32>),
}

/// A step as tiles and chains one after another.
pub(crate) struct Tape {
    /// In the order of execution.
    pub parts: Vec<Part>,
    /// Coefficients, which stand behind the slots of the tiles.
    pub numbers: Vec<f64>,
    chains: Vec<Chain>,
    /// Slots of factors.
    products: Vec<(u32, u32)>,
    writes: Vec<Write>,
}

struct Chain {
    products: Range<u32>,
    writes: Range<u32>,
    class: u32,
}

struct Write {
    target: u32,
    base: u32,
    weight: f64,
}

impl Tape {
    /// Takes apart the narrow tiles; `slots` is the number of slots, `weight` what a shift of a sum means.
    pub fn new(tiles: &Tiles<f64>, slots: usize, weight: impl Fn(i32) -> f64) -> Tape {
        let mut tape = Tape {
            parts: Vec::new(),
            numbers: Vec::new(),
            chains: Vec::new(),
            products: Vec::new(),
            writes: Vec::new(),
        };
        let mut slot_of = BTreeMap::new();
        for (index, tile) in (0..).zip(&tiles.tiles) {
            if tile.lanes as usize >= NARROW || tile.lookups.is_some() {
                tape.parts.push(Part::Tile(index));
                continue;
            }
            let first = tape.chains.len() as u32;
            (0..tile.lanes as usize).for_each(|lane| tape.push(tiles, tile, lane, &mut slot_of, slots, &weight));
            let end = tape.chains.len() as u32;
            match tape.parts.last_mut() {
                Some(Part::Chains(chains)) => chains.end = end,
                _ => tape.parts.push(Part::Chains(first..end)),
            }
        }
        tape
    }

    fn push(
        &mut self,
        tiles: &Tiles<f64>,
        tile: &Tile,
        lane: usize,
        slot_of: &mut BTreeMap<u64, u32>,
        slots: usize,
        weight: impl Fn(i32) -> f64,
    ) {
        let (products, writes) = (self.products.len() as u32, self.writes.len() as u32);
        for product in &tiles.products[tile.products.start as usize..tile.products.end as usize] {
            let factor = match product.factors {
                Factors::Values(place) => tiles.slot(place, lane) as u32,
                Factors::Coefficients(coefficients) => {
                    let coefficient = coefficients.of(lane, &tiles.coefficients);
                    *slot_of.entry(coefficient.to_bits()).or_insert_with(|| {
                        self.numbers.push(coefficient);
                        (slots + self.numbers.len() - 1) as u32
                    })
                }
            };
            self.products.push((tiles.slot(product.operands, lane) as u32, factor));
        }
        for write in &tiles.writes[tile.writes.start as usize..tile.writes.end as usize] {
            self.writes.push(Write {
                target: tiles.slot(write.targets, lane) as u32,
                base: tiles.slot(write.bases, lane) as u32,
                weight: weight(write.shifts.of(lane, &tiles.shifts)),
            });
        }
        let (products, writes) = (products..self.products.len() as u32, writes..self.writes.len() as u32);
        self.chains.push(Chain { products, writes, class: tile.class });
    }

    /// Runs chains of the list as tiles would; false if a value is not finite.
    #[inline(always)]
    pub fn run(
        &self,
        chains: &Range<u32>,
        values: &mut [f64],
        largest: &mut [f64],
        functions: &mut FunctionRun,
    ) -> bool {
        let mut finite = true;
        for chain in &self.chains[chains.start as usize..chains.end as usize] {
            let mut sum = 0.0;
            for (operand, factor) in &self.products[chain.products.start as usize..chain.products.end as usize] {
                sum += values[*operand as usize] * values[*factor as usize];
            }
            for write in &self.writes[chain.writes.start as usize..chain.writes.end as usize] {
                let mut result = values[write.base as usize] + write.weight * sum;
                if chain.class != 0 {
                    functions.apply(chain.class, std::slice::from_mut(&mut result), |_| write.target);
                }
                let target = write.target as usize;
                values[target] = result;
                let magnitude = result.abs();
                finite &= magnitude < f64::INFINITY;
                largest[target] = if magnitude > largest[target] { magnitude } else { largest[target] };
            }
        }
        finite
    }
}
