//! Products of a PE's multiplier and the multiplier blocks of a device that form them.
//!
//! `hdl/pe_multiplier.vhd` cuts wide operands into parts; synthesis tiles the product of two parts with blocks. The
//! rule of the tiles is that of yosys 0.70 (`mul2dsp`).

use crate::word::{Pipeline, WordFormat};

/// A multiplier block, and what synthesis gives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Bits of the wider port.
    pub wide: u32,
    /// Bits of the narrower port.
    pub narrow: u32,
    /// Bits of a part that is cut off for the wider port.
    pub slice: u32,
    /// Whether it multiplies signed numbers only: a part that is cut off has a bit less then.
    pub signed: bool,
    /// Fewer bits at the wider port, at the narrower one or of the product are left to others.
    pub least: (u32, u32, u32),
    /// What it counts for, in halves of a block of the device.
    pub halves: u32,
}

/// The block of Virtex-6 and the 7 series.
pub const DSP48E1: &[Tile] = &[Tile { wide: 25, narrow: 18, slice: 18, signed: true, least: (2, 2, 9), halves: 2 }];

/// The block of UltraScale and UltraScale+.
pub const DSP48E2: &[Tile] = &[Tile { wide: 27, narrow: 18, slice: 18, signed: true, least: (2, 2, 9), halves: 2 }];

/// The block of ECP5.
pub const MULT18X18D: &[Tile] = &[Tile { wide: 18, narrow: 18, slice: 18, signed: false, least: (2, 2, 0), halves: 2 }];

/// The blocks of Gowin's GW1N and GW2A, counted in those of 18 x 18 bits.
pub const GOWIN: &[Tile] = &[
    Tile { wide: 36, narrow: 36, slice: 36, signed: false, least: (22, 22, 0), halves: 8 },
    Tile { wide: 18, narrow: 18, slice: 18, signed: false, least: (10, 4, 0), halves: 2 },
    Tile { wide: 9, narrow: 9, slice: 9, signed: false, least: (4, 4, 0), halves: 1 },
];

/// Parts of an operand: all of it, or an upper part and the lower bits with a zero in front.
fn parts(bits: u32, lower: u32) -> Vec<u32> {
    if bits <= lower + 1 { vec![bits] } else { vec![bits - lower, lower + 1] }
}

impl WordFormat {
    /// Bits of the two operands of each product that `pe_multiplier.vhd` forms.
    pub fn products(&self) -> Vec<(u32, u32)> {
        if self.single_multiplier() {
            return vec![(self.data_bits, self.coefficient_bits)];
        }
        let lower = if self.pipeline == Pipeline::Deep { 17 } else { 24 };
        let coefficients = parts(self.coefficient_bits, 17);
        let data = parts(self.data_bits, lower);
        data.iter().flat_map(|data| coefficients.iter().map(|coefficient| (*data, *coefficient))).collect()
    }

    /// Blocks that a PE's multiplier takes on a device with such tiles, in halves.
    pub fn half_blocks(&self, tiles: &[Tile]) -> u32 {
        self.products().into_iter().map(|(data, coefficient)| tiled(data, coefficient, tiles).halves).sum()
    }

    /// Bits that logic adds for the parts of products that are too small for a block: a row for each bit of the
    /// narrower operand.
    pub fn logic_bits(&self, tiles: &[Tile]) -> u32 {
        self.products().into_iter().map(|(data, coefficient)| tiled(data, coefficient, tiles).logic_bits).sum()
    }

    /// Blocks that a PE's multiplier takes on a device with such tiles.
    pub fn blocks(&self, tiles: &[Tile]) -> u32 {
        self.half_blocks(tiles).div_ceil(2)
    }

    /// DSP blocks per PE on a device with 25x18 multipliers.
    pub fn dsp_per_pe(&self) -> u32 {
        self.blocks(DSP48E1)
    }
}

/// What a product takes.
#[derive(Clone, Copy, Debug, Default)]
struct Taken {
    halves: u32,
    logic_bits: u32,
}

impl Taken {
    /// So many of one kind, and one of another.
    fn with(self, count: u32, other: Taken) -> Taken {
        Taken { halves: count * self.halves + other.halves, logic_bits: count * self.logic_bits + other.logic_bits }
    }
}

/// A product: of the first tile that takes it, or of logic.
fn tiled(one: u32, other: u32, tiles: &[Tile]) -> Taken {
    match tiles.split_first() {
        Some((tile, rest)) => on_tile(one.max(other), one.min(other), tile, rest),
        None => Taken { halves: 0, logic_bits: one.min(other) * (one + other) },
    }
}

/// A product whose first operand comes to the wider port.
fn on_tile(wide: u32, narrow: u32, tile: &Tile, rest: &[Tile]) -> Taken {
    let (least_wide, least_narrow, least_product) = tile.least;
    if wide < least_wide || narrow < least_narrow || wide + narrow < least_product {
        return tiled(wide, narrow, rest);
    }
    let sign = u32::from(tile.signed);
    // How many parts of so many bits are cut off so that the rest fits the port, and the rest.
    let cut = |bits: u32, port: u32, slice: u32| {
        let count = (bits - port).div_ceil(slice - sign);
        (count, bits - count * (slice - sign))
    };
    if wide > tile.wide {
        let (count, last) = cut(wide, tile.wide, tile.slice);
        on_tile(tile.slice, narrow, tile, rest).with(count, on_tile(last, narrow, tile, rest))
    } else if narrow > tile.narrow {
        let (count, last) = cut(narrow, tile.narrow, tile.narrow);
        on_tile(wide, tile.narrow, tile, rest).with(count, on_tile(wide, last, tile, rest))
    } else {
        Taken { halves: tile.halves, logic_bits: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Signed products and the blocks that yosys 0.70 makes of them, in halves: Virtex-6, ECP5, Gowin.
    const SYNTHESISED: &[((u32, u32), [u32; 3])] = &[
        ((5, 4), [2, 2, 1]),
        ((9, 9), [2, 2, 1]),
        ((15, 7), [2, 2, 2]),
        ((18, 18), [2, 2, 2]),
        ((19, 18), [2, 2, 2]),
        ((20, 18), [2, 4, 2]),
        ((22, 10), [2, 4, 3]),
        ((22, 18), [2, 4, 4]),
        ((25, 7), [2, 4, 3]),
        ((25, 18), [2, 4, 4]),
        ((25, 22), [4, 8, 8]),
        ((27, 18), [4, 4, 4]),
        ((27, 25), [8, 8, 8]),
        ((28, 10), [4, 4, 4]),
        ((35, 19), [8, 4, 4]),
        ((35, 35), [8, 8, 8]),
        ((37, 15), [4, 4, 4]),
        ((37, 35), [8, 8, 8]),
        ((4, 4), [0, 2, 1]),
    ];

    #[test]
    fn products_take_the_blocks_that_synthesis_makes() {
        for ((one, other), blocks) in SYNTHESISED {
            let counted = [DSP48E1, MULT18X18D, GOWIN].map(|tiles| tiled(*one, *other, tiles).halves);
            assert_eq!(counted, *blocks, "{one}x{other}");
            assert_eq!(counted, [DSP48E1, MULT18X18D, GOWIN].map(|tiles| tiled(*other, *one, tiles).halves));
        }
    }

    #[test]
    fn a_multiplier_takes_the_blocks_of_its_parts() {
        let format = |data, coefficient, pipeline| WordFormat::new(32, data, coefficient).with_pipeline(pipeline);
        assert_eq!(format(32, 32, Pipeline::Short).products(), [(8, 15), (8, 18), (25, 15), (25, 18)]);
        for (data, coefficient, pipeline, virtex, ecp5) in [
            (25, 18, Pipeline::Short, 1, 2),
            (18, 25, Pipeline::Short, 1, 2),
            (25, 35, Pipeline::Short, 2, 4),
            (24, 27, Pipeline::Short, 2, 4),
            (27, 24, Pipeline::Short, 4, 6),
            (32, 32, Pipeline::Short, 4, 6),
            (32, 32, Pipeline::Deep, 4, 4),
            (25, 35, Pipeline::Deep, 4, 4),
        ] {
            let format = format(data, coefficient, pipeline);
            assert_eq!((format.blocks(DSP48E1), format.blocks(MULT18X18D)), (virtex, ecp5), "{data}x{coefficient}");
        }
    }
}
