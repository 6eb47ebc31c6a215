//! Families of devices that sizes are estimated for.

use pe_ir::memory::{self, MemoryCells};
use pe_ir::multiplier::{DSP48E1, DSP48E2, GOWIN, MULT18X18D, Tile};

use super::fitted::{self, Fitted};

/// A family of devices whose cells are alike.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Family {
    /// Xilinx 6 and 7 series.
    #[default]
    Virtex6,
    /// Xilinx UltraScale+: tables and memories like those before, wider multipliers.
    UltraScale,
    /// Lattice ECP5.
    Ecp5,
    /// Gowin GW1N and GW2A.
    Gowin,
}

/// Bits of a distributed memory of 16 words of a family with tables of four inputs.
const SLICE_BITS: u32 = 4;

/// Tables that it takes: the vendors count three slices for one.
const SLICE_LUTS: u32 = 6;

impl Family {
    /// Those that networks were measured on.
    pub const MEASURED: [Family; 3] = [Family::Virtex6, Family::Ecp5, Family::Gowin];

    /// The name in reports and scripts.
    pub fn name(self) -> &'static str {
        match self {
            Family::Virtex6 => "xc6v",
            Family::UltraScale => "xcup",
            Family::Ecp5 => "ecp5",
            Family::Gowin => "gowin",
        }
    }

    /// The family of a name.
    pub fn named(name: &str) -> Option<Family> {
        let all = [Family::Virtex6, Family::UltraScale, Family::Ecp5, Family::Gowin];
        all.into_iter().find(|family| family.name() == name)
    }

    /// Inputs of a look-up table.
    pub fn lut_inputs(self) -> u32 {
        if self.wide_tables() { 6 } else { 4 }
    }

    /// Whether tables have six inputs, and multiplier blocks a pre-adder and an accumulator that synthesis uses.
    pub fn wide_tables(self) -> bool {
        matches!(self, Family::Virtex6 | Family::UltraScale)
    }

    /// Its multiplier blocks.
    pub fn tiles(self) -> &'static [Tile] {
        match self {
            Family::Virtex6 => DSP48E1,
            Family::UltraScale => DSP48E2,
            Family::Ecp5 => MULT18X18D,
            Family::Gowin => GOWIN,
        }
    }

    /// What was fitted to PEs of the family.
    pub(super) fn fitted(self) -> &'static Fitted {
        match self {
            Family::Virtex6 | Family::UltraScale => &fitted::XC6V,
            Family::Ecp5 => &fitted::ECP5,
            Family::Gowin => &fitted::GOWIN,
        }
    }

    /// A memory with a write port, and the tables per bit that choose among its parts when it is read.
    pub(super) fn ram(self, words: u32, bits: u32) -> (MemoryCells, f64) {
        if self.wide_tables() || words == 0 {
            return (memory::ram(words, bits), 0.0);
        }
        let (wide, banks) = (f64::from(bits), words.div_ceil(16));
        let slices = banks * bits.div_ceil(SLICE_BITS);
        let blocks = memory::blocks(words, bits);
        let block = MemoryCells { bram18: blocks, ..MemoryCells::default() };
        // As yosys weighs it: a slice is 4, a choice between two bits a half, a block 128.
        let distributed = f64::from(4 * slices) + wide * f64::from(banks - 1) / 2.0;
        if memory::ram(words, bits).bram18 > 0 || distributed > 130.0 * f64::from(blocks) {
            return (block, 0.0);
        }
        (MemoryCells { lut: f64::from(SLICE_LUTS * slices), ff: wide, bram18: 0 }, wide * choices(banks))
    }
}

/// Tables of four inputs that choose one of so many bits: two of them and a multiplexer beside choose among four by
/// five inputs; synthesis takes one for each input of a tree of such.
fn choices(banks: u32) -> f64 {
    match banks {
        0 | 1 => 0.0,
        2 => 1.0,
        banks => f64::from(banks),
    }
}
