//! Estimated size of a PE on a Xilinx 6 or 7 series device, from its features.
//!
//! The coefficients are fitted to the synthesised shapes in `docs/results.md`; `hdl/measure-area.sh` measures.

use pe_ir::program::{Layout, PeFeatures, Program};
use pe_ir::word::WordFormat;

/// Cells of a network.
#[derive(Clone, Copy, Debug, Default)]
pub struct Area {
    /// Look-up tables, memories in LUTs included.
    pub lut: f64,
    /// Flip-flops.
    pub ff: f64,
    /// Multiplier blocks.
    pub dsp: u32,
    /// Block RAMs of 18 kbit.
    pub bram18: u32,
}

/// Deepest memory that goes into LUTs; beyond it synthesis takes block RAM.
const LUT_RAM_WORDS: u32 = 128;

/// Estimates a whole network: the sum over its PEs.
pub fn estimate(program: &Program) -> Area {
    program.pes.iter().fold(Area::default(), |sum, pe| {
        let one = estimate_pe(&pe.features, &program.format, program.period);
        Area { lut: sum.lut + one.lut, ff: sum.ff + one.ff, dsp: sum.dsp + one.dsp, bram18: sum.bram18 + one.bram18 }
    })
}

fn estimate_pe(features: &PeFeatures, format: &WordFormat, period: u32) -> Area {
    let word = f64::from(format.word_bits());
    let data = f64::from(format.data_bits);
    let coefficient = f64::from(format.coefficient_bits);
    let mut area = Area { dsp: format.dsp_per_pe(), ..Area::default() };
    let mut memory = |words: u32, bits: f64| {
        if words == 0 {
        } else if words > LUT_RAM_WORDS {
            area.bram18 += (bits / 36.0).ceil() as u32 * words.div_ceil(512);
        } else {
            // RAM32M holds 32 x 6 bits in 4 LUTs, RAM64M 64 x 3.
            area.lut +=
                if words <= 32 { 4.0 * (bits / 6.0).ceil() } else { f64::from(words / 64) * 4.0 * (bits / 3.0).ceil() };
        }
    };
    memory(features.own_words, word);
    memory(features.own_words, data);
    memory(features.imported_words, data);
    memory(if features.factor { features.own_words } else { 0 }, coefficient);
    // A 4-way multiplexer bit is one LUT.
    let select = |ways: usize, bits: f64| bits * (ways.saturating_sub(1) as f64 / 3.0).ceil();
    let adders = word + 6.0;
    let saturation = word;
    let operand = if features.imported_words > 0 { data } else { 0.0 };
    let factor = if features.factor { coefficient } else { 0.0 };
    area.lut += select(features.shifts.len(), word + 4.0) + adders + saturation + operand + factor;
    area.lut += select(features.ports as usize, data) + 6.0;
    if !format.single_multiplier() {
        area.lut += 2.0 * f64::from(features.accumulator_bits);
    }
    area.ff = 3.0 * word + 2.0 * f64::from(features.accumulator_bits) + if features.send { data } else { 0.0 };
    let bits = Layout::new(features, format).bits;
    area.bram18 += bits.div_ceil(36) * period.div_ceil(512);
    area
}
