//! Estimated size of a network on a Xilinx 6 or 7 series device, from the features of its PEs and its outputs.
//!
//! A count of what the datapaths are made of, bit by bit, with a few fitted figures ([`CONTROL_LUTS`], [`SWAP_LUTS`],
//! [`PARTIAL_SHARE`]); memories are counted by [`pe_ir::memory`]. The table in the test below holds it against
//! synthesis, residuals are in `docs/results.md`; `hdl/measure-area.sh` measures a design.

use std::collections::BTreeSet;

use pe_ir::memory::{self, MemoryCells};
use pe_ir::program::{Fold, PeFeatures, Program, index_bits};
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

/// Look-up tables that a multiplier block is worth, as Huang et al. count.
const DSP_LUTS: f64 = 250.0;

impl Area {
    /// Look-up tables and what the blocks are worth in them.
    pub fn equivalent_luts(&self) -> f64 {
        self.lut + DSP_LUTS * f64::from(self.dsp) + memory::BLOCK_LUTS * f64::from(self.bram18)
    }
}

/// Tables that do not grow with the word: overflow detection and flag, upper bits of saturated words,
/// write enables, choice of shift.
const CONTROL_LUTS: f64 = 16.0;

/// What finds operands of the pre-adder that are too large for a sum.
const PRE_ADDER_LUTS: f64 = 2.0;

/// Tables that turn address bits over in odd steps.
const SWAP_LUTS: f64 = 4.0;

/// Share of the product's width that each doubling of the multiplier blocks adds in tables and flip-flops.
const PARTIAL_SHARE: f64 = 0.85;

/// Estimates a whole network: the sum over its PEs, inputs and outputs. The sequencer, some thirty tables, is left out.
pub fn estimate(program: &Program) -> Area {
    let interface = Area {
        lut: program.outputs.len() as f64 * output_luts(&program.format, program.period),
        ff: f64::from(program.format.storage_bits * 2) * program.outputs.len() as f64
            + f64::from(program.format.data_bits) * program.inputs.len() as f64,
        ..Area::default()
    };
    program.pes.iter().fold(interface, |sum, pe| {
        let one = estimate_pe(&pe.features, &program.format);
        let rom = Fold::of(program, pe).cells();
        Area {
            lut: sum.lut + one.lut + rom.lut,
            ff: sum.ff + one.ff + rom.ff,
            dsp: sum.dsp + one.dsp,
            bram18: sum.bram18 + one.bram18 + rom.bram18,
        }
    })
}

/// Tables of an output: recognition of its control word, and, unless stored words carry the offset that rounds to the
/// port anyway, addition of another and saturation. Two registers of the port's width are beside them.
fn output_luts(format: &WordFormat, period: u32) -> f64 {
    let compare = (f64::from(index_bits(period) + 4) / 5.0).floor();
    if format.data_bits == format.storage_bits {
        return compare;
    }
    let adder = if format.data_bits < format.storage_bits { format.data_bits + 2 } else { format.guard_bits };
    compare + f64::from(adder + format.storage_bits - 1)
}

/// A PE without its program memory.
fn estimate_pe(features: &PeFeatures, format: &WordFormat) -> Area {
    let word = f64::from(format.word_bits());
    let data = f64::from(format.data_bits);
    let coefficient = f64::from(format.coefficient_bits);
    let accumulator = f64::from(features.accumulator_bits);
    let mut area = Area { dsp: format.dsp_per_pe(), ..Area::default() };

    // A block RAM has the read register inside.
    add(&mut area, memory::ram(features.base_words, format.word_bits()));
    add(&mut area, memory::ram(features.own_words, format.data_bits));
    add(&mut area, memory::ram(features.imported_words, format.data_bits));
    match (features.coefficient_words, features.factor) {
        (0, _) => {}
        (words, true) => add(&mut area, memory::ram(words, format.coefficient_bits)),
        (words, false) => add(&mut area, memory::rom(words, format.coefficient_bits)),
    }

    // Write side: choice of shift, addition; registers: held sum, sum with the base, word, link.
    let shifted =
        accumulator + f64::from(format.lift()) - f64::from(features.shifts.iter().copied().min().unwrap_or(0)) + 1.0;
    let sum = shifted.max(word + 1.0) + 1.0;
    area.lut += shift_tables(&features.shifts) * (shifted - 1.0) + sum + CONTROL_LUTS;
    area.ff += accumulator + sum + word + if features.send { data } else { 0.0 };

    area.lut += data * port_tables(features.ports);
    if features.swap {
        area.lut += SWAP_LUTS;
    }

    if features.pre_adder {
        // The sum of four-block multipliers carries from the lower part to the upper one; one table finds large operands.
        area.lut += PRE_ADDER_LUTS + if format.single_multiplier() { 0.0 } else { data };
        area.ff += 1.0;
    }

    // Only the 25-bit port of a multiplier block has a pre-adder, and only one block can accumulate.
    if !format.single_multiplier() {
        let partial = PARTIAL_SHARE * (data + coefficient) * f64::from(area.dsp).log2();
        area.lut += data + accumulator + partial;
        area.ff += accumulator + partial;
    } else if format.coefficient_bits > 18 {
        area.lut += data;
    }
    area
}

fn add(area: &mut Area, cells: MemoryCells) {
    area.lut += cells.lut;
    area.ff += cells.ff;
    area.bram18 += cells.bram18;
}

/// Tables per bit of the choice of shift, as `pe.vhd` groups the positions. Groups with the same distances share them.
fn shift_tables(shifts: &[u8]) -> f64 {
    let count = shifts.len();
    let first_mid = if count <= 3 { 1 } else { 4 };
    let first_high = if count == 3 || count == 6 { count - 1 } else { 8 };
    let mut patterns: BTreeSet<Vec<u8>> = BTreeSet::new();
    let mut start = 0;
    for end in [first_mid, first_high, count] {
        let end = end.min(count);
        if start < end {
            patterns.insert(shifts[start..end].iter().map(|shift| shift - shifts[start]).collect());
            start = end;
        }
    }
    // A six-input table chooses among four; a tree of them among more.
    patterns.iter().map(|pattern| (pattern.len() as f64 - 1.0) / 3.0).map(f64::ceil).sum()
}

/// Tables per bit of the choice among input ports: one for up to four, one more to join such groups.
fn port_tables(ports: u32) -> f64 {
    f64::from(ports / 4 + u32::from(ports % 4 > 1) + u32::from(ports > 4))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Storage bits, data and coefficient port, own and imported words, ports, shifts, accumulator, factor, swap.
    type Shape = (u32, u32, u32, u32, u32, u32, &'static [u8], u32, bool, bool);

    /// Synthesised PEs with a link, base memories as deep as own ones and coefficient memories of 16 words, without program memory, and their LUTs, flip-flops and block RAMs of 18 kbit:
    /// GHDL 2.0, yosys 0.70, `synth_xilinx -family xc6v`.
    #[rustfmt::skip]
    const MEASURED: &[(Shape, f64, f64, u32)] = &[
        ((32, 25, 18, 16, 16, 3, &[3], 43, false, false), 151.0, 239.0, 0),
        ((32, 25, 18, 16, 16, 3, &[1, 2, 3], 43, false, false), 155.0, 245.0, 0),
        ((32, 25, 18, 16, 16, 3, &[1, 2, 3, 4], 43, false, false), 193.0, 245.0, 0),
        ((32, 25, 18, 16, 16, 3, &[1, 2, 3, 4, 5], 43, false, false), 195.0, 246.0, 0),
        ((32, 25, 18, 16, 16, 3, &[0, 1, 3, 4, 6, 9, 10, 11, 12, 13], 43, false, false), 307.0, 248.0, 0),
    ];

    /// Storage bits, data port, index bits of a synthesised `pe_output`, and its LUTs.
    const MEASURED_OUTPUTS: &[(u32, u32, u32, f64)] = &[
        (32, 32, 6, 2.0),
        (32, 32, 11, 3.0),
        (32, 25, 6, 60.0),
        (32, 25, 11, 61.0),
        (32, 18, 6, 53.0),
        (32, 18, 11, 54.0),
        (18, 18, 8, 3.0),
        (18, 25, 8, 26.0),
        (24, 24, 8, 3.0),
    ];

    #[test]
    fn estimates_of_outputs_agree_with_synthesis() {
        for &(storage_bits, data_bits, index_bits, lut) in MEASURED_OUTPUTS {
            let format = WordFormat { storage_bits, guard_bits: 8, data_bits, coefficient_bits: 18 };
            let estimate = output_luts(&format, 1 << index_bits);
            assert!((estimate - lut).abs() <= 2.0, "{storage_bits} bits, {data_bits}: {estimate} instead of {lut}");
        }
    }

    #[test]
    fn estimates_agree_with_synthesis() {
        let (mut sum, mut worst) = (0.0, 0.0f64);
        for (shape, lut, ff, bram18) in MEASURED {
            let &(storage_bits, data_bits, coefficient_bits, own_words, imported_words, ports, shifts, ..) = shape;
            let &(.., accumulator_bits, factor, swap) = shape;
            let format = WordFormat { storage_bits, guard_bits: 8, data_bits, coefficient_bits };
            let shifts = shifts.to_vec();
            let coefficient_words = if factor { 16 } else { 0 };
            let features = PeFeatures {
                own_words,
                base_words: own_words,
                coefficient_words,
                imported_words,
                ports,
                shifts,
                accumulator_bits,
                factor,
                pre_adder: false,
                swap,
                base_last: false,
                send: true,
            };
            let area = estimate_pe(&features, &format);
            let residual = (area.lut / lut - 1.0).abs();
            assert!(residual < 0.1, "{shape:?}: {} LUTs instead of {lut}", area.lut);
            assert!((area.ff / ff - 1.0).abs() < 0.1, "{shape:?}: {} flip-flops instead of {ff}", area.ff);
            assert_eq!(area.bram18, *bram18, "{shape:?}");
            sum += residual;
            worst = worst.max(residual);
        }
        let (shapes, mean) = (MEASURED.len(), sum / MEASURED.len() as f64);
        println!("residuals: {shapes} shapes, mean {:.1} %, worst {:.1} %", 100.0 * mean, 100.0 * worst);
        assert!(mean < 0.025, "mean residual {mean}");
    }
}
