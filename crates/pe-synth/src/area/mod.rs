//! Estimated size of a network on a Xilinx 6 or 7 series device, from the features of its PEs and its outputs.
//!
//! What the datapaths are made of is counted bit by bit, in a few terms; how many tables and flip-flops a unit of each
//! term takes was fitted to synthesised PEs ([`fitted`], written by `cargo run --example fit_area` from `measured.txt`).
//! Depths at which memories become block RAM are those of synthesis. `hdl/measure-area.sh` measures a design; what it
//! writes can take the place of the estimates ([`Measured`]).

pub mod fitted;
mod measured;

use std::collections::BTreeSet;

use pe_ir::memory::{self, MemoryCells};
use pe_ir::program::{Fold, PeFeatures, Program, index_bits};
use pe_ir::word::{Pipeline, WordFormat};

pub use measured::{Measured, MeasuredShape, read};

/// Cells of a network.
#[derive(Clone, Copy, Debug, Default)]
pub struct Area {
    /// Look-up tables, memories in LUTs included.
    pub lut: f64,
    /// What the look-up tables may be off by, to either side; 0 if measured.
    pub lut_error: f64,
    /// Flip-flops.
    pub ff: f64,
    /// What the flip-flops may be off by.
    pub ff_error: f64,
    /// Multiplier blocks.
    pub dsp: u32,
    /// Block RAMs of 18 kbit.
    pub bram18: u32,
    /// PEs whose cells were measured.
    pub measured_pes: u32,
    /// All PEs.
    pub pes: u32,
}

/// Look-up tables that a multiplier block is worth, as Huang, Vahid and Givargis count in section 6.2.2.
pub const DSP_LUTS: f64 = 250.0;

impl Area {
    /// Look-up tables and what the blocks are worth in them.
    pub fn equivalent_luts(&self) -> f64 {
        self.lut + DSP_LUTS * f64::from(self.dsp) + memory::BLOCK_LUTS * f64::from(self.bram18)
    }

    /// Where the figures come from.
    pub fn basis(&self) -> &'static str {
        if self.measured_pes == self.pes { "measured" } else { "estimated" }
    }

    /// Look-up tables in words.
    pub fn lut_words(&self) -> String {
        if self.lut_error > 0.0 {
            format!("{:.0} ± {:.0} LUT", self.lut, self.lut_error)
        } else {
            format!("{:.0} LUT", self.lut)
        }
    }
}

/// What a PE's look-up tables are counted in.
pub const LUT_TERMS: [&str; 8] = [
    "tables of memories",
    "bits of shifts chosen in tables",
    "bits of the base addition",
    "bits of port choices",
    "buffers that change roles",
    "pre-adder with sums of two operands",
    "bits of sums outside of multiplier blocks",
    "one",
];

/// What a PE's flip-flops are counted in.
pub const FF_TERMS: [&str; 6] = [
    "bits of memory read registers",
    "bits of hold register, sum and word",
    "bits of the link register",
    "pre-adder with sums of two operands",
    "bits of sums outside of multiplier blocks",
    "one",
];

/// Traits of PEs that the model may not know from enough measured ones.
pub const TRAITS: [&str; 14] = [
    "multiplier of 32x32",
    "multiplier of 18x25",
    "multiplier of another size but 25x18",
    "factors (products of two stored words)",
    "coefficients in a memory of their own",
    "buffers that change roles",
    "pre-adder with sums of two operands",
    "no link",
    "data memories of more than 32 words in LUTs",
    "data memories in block RAM",
    "more than five shift positions",
    "more than four ports",
    "bases written in the last round only",
    "tables of functions",
];

/// Measured PEs with a trait from which on estimates of others with it have the error of the fit.
pub const ENOUGH: u32 = 4;

/// Error of the estimate of a PE with a trait that fewer measured ones have; a count by hand had a worst residual of
/// 8.7 % over 45 shapes.
pub const RARE_ERROR: f64 = 0.1;

/// Which of [`TRAITS`] a PE has.
pub fn traits(features: &PeFeatures, format: &WordFormat) -> [bool; TRAITS.len()] {
    let multiplier = (format.data_bits, format.coefficient_bits);
    let depth = features.own_words.max(features.base_words).max(features.imported_words);
    let blocks = memories(features, format).bram18 > 0;
    [
        multiplier == (32, 32),
        multiplier == (18, 25),
        ![(25, 18), (18, 25), (32, 32)].contains(&multiplier),
        features.factor,
        features.coefficient_words > 0 && !features.factor,
        features.swap,
        features.pre_adder,
        !features.send,
        depth > 32 && !blocks,
        blocks,
        features.shifts.len() > 5,
        features.ports > 4,
        features.base_last,
        features.index_words > 0,
    ]
}

/// Whether a PE has a trait that too few measured ones have.
fn rare(features: &PeFeatures, format: &WordFormat) -> bool {
    traits(features, format).into_iter().zip(fitted::SHAPES).any(|(has, shapes)| has && shapes < ENOUGH)
}

/// Estimates a whole network: the sum over its PEs, inputs and outputs. The sequencer, some thirty tables, is left out.
pub fn estimate(program: &Program) -> Area {
    size(program, &Measured::default())
}

/// The same with measured PEs where there are any of their shape.
pub fn size(program: &Program, measured: &Measured) -> Area {
    let shapes = measured.shapes(program);
    let mut area = Area {
        lut: program.outputs.len() as f64 * output_luts(&program.format, program.period),
        ff: f64::from(program.format.storage_bits * 2) * program.outputs.len() as f64
            + f64::from(program.format.data_bits) * program.ports().count() as f64,
        ..Area::default()
    };
    for (_, tick, _) in program.ticks() {
        // A counter, a comparison with its last number, and the register of the operand's one bit.
        let bits = f64::from(pe_ir::program::index_bits(tick.steps));
        area.lut += bits + 1.0;
        area.ff += bits + 1.0;
    }
    for (index, pe) in program.pes.iter().enumerate() {
        area.pes += 1;
        if let Some(shape) = shapes.get(&index) {
            area.lut += f64::from(shape.lut);
            area.ff += f64::from(shape.ff);
            area.dsp += shape.dsp;
            area.bram18 += shape.bram18;
            area.measured_pes += 1;
            continue;
        }
        let (lut, ff) = self::pe(&pe.features, &program.format);
        area.lut += lut;
        area.ff += ff;
        // The errors of equal shapes are the same, so they add up.
        let (lut_error, ff_error) = errors(&pe.features, &program.format);
        area.lut_error += lut_error * lut;
        area.ff_error += ff_error * ff;
        area.dsp += program.format.dsp_per_pe();
        let fold = Fold::of(program, pe);
        let rom = fold.cells();
        let programs = [(fold.repeated.len(), fold.loop_bits()), (fold.stream.len(), fold.streamed_bits())];
        let behind = programs.map(|(words, bits)| followers(&program.format, words as u32, bits));
        area.lut += rom.lut;
        area.ff += rom.ff + behind.iter().sum::<f64>();
        area.bram18 += memories(&pe.features, &program.format).bram18 + rom.bram18;
    }
    area
}

/// Look-up tables and flip-flops of a PE without its program memory.
pub fn pe(features: &PeFeatures, format: &WordFormat) -> (f64, f64) {
    let (choices, registers) = deeper(features, format);
    // The upper bits of a saturated word tell its sign; a reset makes the others without a table.
    let saturation = if features.proven { f64::from(WordFormat::CEILING_BITS) } else { 0.0 };
    (
        weighted(&lut_terms(features, format), &fitted::LUT) + choices * fitted::DEEP_LUT - saturation,
        weighted(&ff_terms(features, format), &fitted::FF) + registers * fitted::DEEP_FF,
    )
}

/// What the estimate of a PE may be off by, relative to it: look-up tables and flip-flops.
fn errors(features: &PeFeatures, format: &WordFormat) -> (f64, f64) {
    let floor = if rare(features, format) { RARE_ERROR } else { 0.0 };
    let (lut, ff) = match format.pipeline {
        Pipeline::Short => (fitted::LUT_DEVIATION, fitted::FF_DEVIATION),
        Pipeline::Deep => (fitted::DEEP_LUT_DEVIATION, fitted::DEEP_FF_DEVIATION),
    };
    (floor.max(2.0 * lut), floor.max(2.0 * ff))
}

/// Flip-flops of a program memory in a deep pipeline: the replica of its address, and two registers behind it.
pub(crate) fn followers(format: &WordFormat, words: u32, bits: u32) -> f64 {
    if format.pipeline == Pipeline::Short || bits == 0 { 0.0 } else { f64::from(index_bits(words) + 2 * bits) }
}

/// What a deep pipeline adds. Bits that are chosen in tables of their own, because a register follows: the operand, which
/// no pre-adder makes then, and among groups of shift positions, which the tables of the addition choose otherwise. And
/// bits of second registers, behind memories and shifts.
pub fn deeper(features: &PeFeatures, format: &WordFormat) -> (f64, f64) {
    if format.pipeline == Pipeline::Short {
        return (0.0, 0.0);
    }
    let (shifted, _) = sum_bits(features, format);
    let imported = if features.imported_words > 0 { format.data_bits } else { 0 };
    let memories = format.data_bits + imported + format.coefficient_bits + format.word_bits();
    let operand = if features.pre_adder { 0 } else { imported };
    let groups = if features.shifts.len() > 1 { shifted } else { 0.0 };
    (f64::from(operand) + groups, f64::from(memories) + shifted)
}

fn weighted<const N: usize>(terms: &[f64; N], coefficients: &[f64; N]) -> f64 {
    terms.iter().zip(coefficients).map(|(term, coefficient)| term * coefficient).sum()
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

/// Width of the write side's adder.
fn sum_bits(features: &PeFeatures, format: &WordFormat) -> (f64, f64) {
    let smallest = u32::from(features.shifts.iter().copied().min().unwrap_or(0));
    let shifted = (features.accumulator_bits + format.lift() + 1).saturating_sub(smallest);
    (f64::from(shifted), f64::from(shifted.max(format.word_bits() + 1) + 1))
}

/// Sums outside of multiplier blocks: only the 25-bit port of a block has a pre-adder, and only one block accumulates.
fn outside(features: &PeFeatures, format: &WordFormat) -> f64 {
    let data = f64::from(format.data_bits);
    if !format.single_multiplier() {
        let partial = f64::from(format.data_bits + format.coefficient_bits) * f64::from(format.dsp_per_pe()).log2();
        return data + f64::from(features.accumulator_bits) + partial;
    }
    if format.coefficient_bits > 18 { data } else { 0.0 }
}

/// The look-up tables of a PE without its program memory, counted.
pub fn lut_terms(features: &PeFeatures, format: &WordFormat) -> [f64; LUT_TERMS.len()] {
    let (shifted, sum) = sum_bits(features, format);
    [
        memories(features, format).lut + lookup_tables(features),
        shift_tables(&features.shifts) * shifted,
        sum,
        f64::from(format.data_bits) * port_tables(features.ports),
        f64::from(u8::from(features.swap)),
        f64::from(u8::from(features.pre_adder)),
        outside(features, format),
        1.0,
    ]
}

/// The flip-flops of a PE, counted.
pub fn ff_terms(features: &PeFeatures, format: &WordFormat) -> [f64; FF_TERMS.len()] {
    [
        memories(features, format).ff,
        f64::from(features.accumulator_bits + format.word_bits()) + sum_bits(features, format).1,
        if features.send { f64::from(format.data_bits) } else { 0.0 },
        f64::from(u8::from(features.pre_adder)),
        if format.single_multiplier() { 0.0 } else { outside(features, format) },
        1.0,
    ]
}

/// Data memories: base words, operands, imported words, and coefficients or factors that have a memory.
fn memories(features: &PeFeatures, format: &WordFormat) -> MemoryCells {
    let coefficients = match (features.coefficient_words, features.factor) {
        (0, _) => MemoryCells::default(),
        (words, true) => memory::ram(words, format.coefficient_bits),
        (words, false) => memory::rom(words, format.coefficient_bits),
    };
    let all = [
        memory::ram(features.base_words, format.word_bits()),
        memory::ram(features.own_words, format.data_bits),
        memory::ram(features.imported_words, format.data_bits),
        memory::ram(features.index_words, features.index_bits),
        coefficients,
    ];
    all.into_iter().sum()
}

/// Tables that lookups take beside the index memory: index into base address, and the count of octaves, a shift by each
/// of its bits.
fn lookup_tables(features: &PeFeatures) -> f64 {
    if features.index_words == 0 {
        return 0.0;
    }
    let octaves = match features.octave_bits {
        0 => 0.0,
        bits => f64::from(bits * ((1 << bits) + features.index_bits - bits)) / 2.0,
    };
    f64::from(features.index_bits + 4) + octaves
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

    /// Index words, bits of an index, of these for octaves, and the LUTs of a synthesised PE beside those of the same
    /// PE without lookups (`docs/single_pes.py FOLDER tables`).
    const MEASURED_LOOKUPS: &[(u32, u32, u32, f64)] =
        &[(0, 0, 0, 0.0), (16, 5, 0, 13.0), (32, 6, 0, 14.0), (16, 5, 3, 28.0), (32, 6, 4, 53.0)];

    #[test]
    fn estimates_of_lookups_agree_with_synthesis() {
        for &(index_words, index_bits, octave_bits, lut) in MEASURED_LOOKUPS {
            let features = PeFeatures {
                own_words: 32,
                base_words: 256,
                coefficient_words: 32,
                imported_words: 16,
                ports: 3,
                shifts: vec![1, 2, 3, 4, 5],
                accumulator_bits: 43,
                factor: true,
                pre_adder: false,
                swap: false,
                base_last: false,
                send: true,
                proven: false,
                index_words: 0,
                index_bits: 0,
                octave_bits: 0,
            };
            let format = WordFormat::new(32, 25, 18);
            let without = weighted(&lut_terms(&features, &format), &fitted::LUT);
            let features = PeFeatures { index_words, index_bits, octave_bits, ..features };
            let with = weighted(&lut_terms(&features, &format), &fitted::LUT);
            assert!((with - without - lut).abs() < 4.0, "{features:?}: {} instead of {lut}", with - without);
        }
    }

    #[test]
    fn estimates_of_outputs_agree_with_synthesis() {
        for &(storage_bits, data_bits, index_bits, lut) in MEASURED_OUTPUTS {
            let format = WordFormat { guard_bits: 8, ..WordFormat::new(storage_bits, data_bits, 18) };
            let estimate = output_luts(&format, 1 << index_bits);
            assert!((estimate - lut).abs() <= 2.0, "{storage_bits} bits, {data_bits}: {estimate} instead of {lut}");
        }
    }

    /// Mean and worst of the residuals, and their root mean square.
    fn summary(residuals: &[f64]) -> (f64, f64, f64) {
        let count = residuals.len() as f64;
        let sizes = residuals.iter().map(|residual| residual.abs());
        let squares: f64 = residuals.iter().map(|residual| residual * residual).sum();
        (sizes.clone().sum::<f64>() / count, sizes.fold(0.0, f64::max), (squares / count).sqrt())
    }

    #[test]
    fn estimates_agree_with_synthesis() {
        let shapes = read(include_str!("measured.txt")).expect("the file is read");
        assert!(shapes.len() >= 13, "only {} shapes", shapes.len());
        let mut known = [0; TRAITS.len()];
        for pipeline in Pipeline::ALL {
            let (mut luts, mut ffs) = (Vec::new(), Vec::new());
            for shape in shapes.iter().filter(|shape| shape.format.pipeline == pipeline) {
                let (features, format) = (&shape.features, &shape.format);
                let (lut, ff) = pe(features, format);
                luts.push((lut + shape.program.lut) / f64::from(shape.lut) - 1.0);
                ffs.push((ff + shape.program.ff) / f64::from(shape.ff) - 1.0);
                assert_eq!(memories(features, format).bram18 + shape.program.bram18, shape.bram18, "{shape:?}");
                assert_eq!(format.dsp_per_pe(), shape.dsp, "{shape:?}");
                if pipeline == Pipeline::Short {
                    known.iter_mut().zip(traits(features, format)).for_each(|(count, has)| *count += u32::from(has));
                }
            }
            let deviations = match pipeline {
                Pipeline::Short => [fitted::LUT_DEVIATION, fitted::FF_DEVIATION],
                Pipeline::Deep => [fitted::DEEP_LUT_DEVIATION, fitted::DEEP_FF_DEVIATION],
            };
            for (cells, residuals, deviation) in [("LUTs", luts, deviations[0]), ("flip-flops", ffs, deviations[1])] {
                let (mean, worst, square) = summary(&residuals);
                let percent = |value: f64| 100.0 * value;
                let text = format!(
                    "{cells}, {}, residuals: {} shapes, mean {:.1} %, root mean square {:.1} %, worst {:.1} %",
                    pipeline.name(),
                    residuals.len(),
                    percent(mean),
                    percent(square),
                    percent(worst)
                );
                println!("{text}");
                let limits = if pipeline == Pipeline::Short { (0.02, 0.07) } else { (0.04, 0.07) };
                assert!(mean < limits.0 && worst < limits.1, "{text}");
                assert!((square - deviation).abs() < 1e-4, "{text}: run the example fit_area again");
            }
        }
        assert_eq!(known, fitted::SHAPES, "run the example fit_area again");
    }

    #[test]
    fn estimates_of_what_was_hardly_measured_have_wider_errors() {
        let shapes = read(include_str!("measured.txt")).expect("the file is read");
        let common = shapes
            .iter()
            .find(|shape| shape.format.pipeline == Pipeline::Short && !rare(&shape.features, &shape.format))
            .expect("a common shape");
        const { assert!(2.0 * fitted::LUT_DEVIATION < RARE_ERROR && 2.0 * fitted::FF_DEVIATION < RARE_ERROR) };
        for (index, shapes) in fitted::SHAPES.into_iter().enumerate().take(3) {
            let (data, coefficient) = [(32, 32), (18, 25), (18, 18)][index];
            let format = WordFormat::new(32, data, coefficient);
            assert!(traits(&common.features, &format)[index], "{}", TRAITS[index]);
            assert_eq!(rare(&common.features, &format), shapes < ENOUGH, "{}: {shapes} shapes", TRAITS[index]);
        }
    }
}
