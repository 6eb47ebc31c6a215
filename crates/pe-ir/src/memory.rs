//! What memories are made of on a Xilinx 6 or 7 series device: LUTs or blocks of 18 kbit.
//!
//! The assembler chooses with these figures where coefficients are kept, the report adds them up.

/// Equivalent LUTs of a block RAM of 18 kbit: half of the 360 of one of 36 kbit.
pub const BLOCK_LUTS: f64 = 180.0;

/// Shapes of a block RAM of 18 kbit: words and bits.
const BLOCK_SHAPES: [(u32, u32); 6] = [(512, 36), (1024, 18), (2048, 9), (4096, 4), (8192, 2), (16384, 1)];

/// Programs and tables of at most this many words are LUTs, one for each bit.
pub const LUT_ROM_WORDS: u32 = 64;

/// Cells of a memory.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MemoryCells {
    /// LUTs.
    pub lut: f64,
    /// Flip-flops of the read register; a block has it inside.
    pub ff: f64,
    /// Block RAMs of 18 kbit.
    pub bram18: u32,
}

impl MemoryCells {
    /// Look-up tables and what the blocks are worth in them.
    pub fn equivalent_luts(&self) -> f64 {
        self.lut + BLOCK_LUTS * f64::from(self.bram18)
    }
}

impl std::iter::Sum for MemoryCells {
    fn sum<I: Iterator<Item = MemoryCells>>(memories: I) -> MemoryCells {
        memories.fold(MemoryCells::default(), |sum, one| MemoryCells {
            lut: sum.lut + one.lut,
            ff: sum.ff + one.ff,
            bram18: sum.bram18 + one.bram18,
        })
    }
}

/// Blocks of a memory: the shape that takes the fewest.
pub fn blocks(words: u32, bits: u32) -> u32 {
    BLOCK_SHAPES.iter().map(|(depth, width)| words.div_ceil(*depth) * bits.div_ceil(*width)).min().unwrap_or(0)
}

/// A memory without a write port.
pub fn rom(words: u32, bits: u32) -> MemoryCells {
    if words == 0 {
        MemoryCells::default()
    } else if words <= LUT_ROM_WORDS {
        MemoryCells { lut: f64::from(bits), ff: f64::from(bits), bram18: 0 }
    } else {
        MemoryCells { bram18: blocks(words, bits), ..MemoryCells::default() }
    }
}

/// A memory without a write port that is LUTs at any depth.
pub fn tables(words: u32, bits: u32) -> MemoryCells {
    if words == 0 {
        return MemoryCells::default();
    }
    MemoryCells { lut: f64::from(bits * words.div_ceil(LUT_ROM_WORDS)), ff: f64::from(bits), bram18: 0 }
}

/// A memory with one write and one read port. One of 128 words becomes a block if one is enough, a deeper one always.
pub fn ram(words: u32, bits: u32) -> MemoryCells {
    if words > 128 || (words == 128 && bits <= BLOCK_SHAPES[0].1) {
        return MemoryCells { bram18: blocks(words, bits), ..MemoryCells::default() };
    }
    // Four tables hold 32 words of 6 bits or 64 of 3.
    let wide = f64::from(bits);
    let lut = match words {
        0 => 0.0,
        1..=32 => 4.0 * (wide / 6.0).ceil(),
        33..=64 => 4.0 * (wide / 3.0).ceil(),
        _ => 8.0 * (wide / 3.0).ceil() + wide,
    };
    MemoryCells { lut, ff: if words > 0 { wide } else { 0.0 }, bram18: 0 }
}

/// Depth of a memory for so many words: a power of two. Two words would take as many tables as four, and are the
/// depth at which GHDL 2.0 loses images when it synthesises (see `hdl/pe_ram.vhd`).
pub fn depth(words: u32) -> u32 {
    words.next_power_of_two().max(4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deep_memories_take_narrow_slices() {
        assert_eq!(blocks(512, 36), 1);
        assert_eq!(blocks(988, 52), 3, "1024 x 18");
        assert_eq!(blocks(2004, 55), 7, "2048 x 9");
        assert_eq!(blocks(165, 40), 2);
    }

    #[test]
    fn small_memories_are_tables() {
        assert_eq!(rom(64, 30).equivalent_luts(), 30.0);
        assert_eq!(rom(65, 30).equivalent_luts(), BLOCK_LUTS);
        assert_eq!(ram(32, 18).lut, 12.0);
        assert_eq!(ram(128, 36).bram18, 1);
    }
}
