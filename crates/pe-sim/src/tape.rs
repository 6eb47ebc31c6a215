//! Narrow tiles of a run in double precision as a list of numbers to multiply.
//!
//! A tile of a few lanes costs more for the choice of its loops than for its products, and small models have no others.
//! Here all is chosen beforehand: every product is that of two slots, coefficients among them.

use pe_ir::index::{at, number};
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
            if at(tile.lanes) >= NARROW || tile.lookups.is_some() {
                tape.parts.push(Part::Tile(index));
                continue;
            }
            let first = number(tape.chains.len());
            (0..tile.lanes as usize).for_each(|lane| tape.push(tiles, tile, lane, &mut slot_of, slots, &weight));
            let end = number(tape.chains.len());
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
        let (products, writes) = (number(self.products.len()), number(self.writes.len()));
        for product in &tiles.products[at(tile.products.start)..tile.products.end as usize] {
            let factor = match product.factors {
                Factors::Values(place) => number(tiles.slot(place, lane)),
                Factors::Coefficients(coefficients) => {
                    let coefficient = coefficients.of(lane, &tiles.coefficients);
                    *slot_of.entry(coefficient.to_bits()).or_insert_with(|| {
                        self.numbers.push(coefficient);
                        number(slots + self.numbers.len() - 1)
                    })
                }
            };
            self.products.push((number(tiles.slot(product.operands, lane)), factor));
        }
        for write in &tiles.writes[at(tile.writes.start)..tile.writes.end as usize] {
            self.writes.push(Write {
                target: number(tiles.slot(write.targets, lane)),
                base: number(tiles.slot(write.bases, lane)),
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
        for chain in &self.chains[at(chains.start)..chains.end as usize] {
            let mut sum = 0.0;
            for (operand, factor) in &self.products[at(chain.products.start)..chain.products.end as usize] {
                sum += values[at(*operand)] * values[at(*factor)];
            }
            for write in &self.writes[at(chain.writes.start)..chain.writes.end as usize] {
                let mut result = values[at(write.base)] + write.weight * sum;
                if chain.class != 0 {
                    functions.apply(chain.class, std::slice::from_mut(&mut result), |_| write.target);
                }
                let target = at(write.target);
                values[target] = result;
                let magnitude = result.abs();
                finite &= magnitude < f64::INFINITY;
                largest[target] = if magnitude > largest[target] { magnitude } else { largest[target] };
            }
        }
        finite
    }
}
