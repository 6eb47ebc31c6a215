//! The parts of a PE, counted bit by bit, and the cells per unit of each count on a family.

use std::collections::{BTreeMap, BTreeSet};

use pe_ir::memory::MemoryCells;
use pe_ir::program::PeFeatures;
use pe_ir::word::{Pipeline, WordFormat};

use super::Family;
use super::names::{FF_TERMS, LUT_TERMS, TRAITS};

/// Measured PEs with a trait from which on estimates of others with it have the error of the fit.
pub const ENOUGH: u32 = 4;

/// Error of the estimate of a PE with a trait that fewer measured ones have; a count by hand had a worst residual of
/// 8.7 % over 45 shapes.
pub const RARE_ERROR: f64 = 0.1;

/// Which of [`TRAITS`] a PE has.
pub fn traits(features: &PeFeatures, format: &WordFormat) -> [bool; TRAITS.len()] {
    let multiplier = (format.data_bits, format.coefficient_bits);
    let depth = features.own_words.max(features.base_words).max(features.imported_words);
    let blocks = memories(features, format, Family::Virtex6).0.bram18 > 0;
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
pub(super) fn rare(features: &PeFeatures, format: &WordFormat, family: Family) -> bool {
    traits(features, format).into_iter().zip(family.fitted().shapes).any(|(has, shapes)| has && shapes < ENOUGH)
}

/// Look-up tables and flip-flops of a PE without its program memory.
pub fn pe(features: &PeFeatures, format: &WordFormat, family: Family) -> (f64, f64) {
    let (choices, registers) = deeper(features, format, family);
    let fitted = family.fitted();
    // The upper bits of a saturated word tell its sign; a reset makes the others without a table.
    let saturation = if features.proven { f64::from(WordFormat::CEILING_BITS) } else { 0.0 };
    (
        weighted(&lut_terms(features, format, family), &fitted.lut) + choices * fitted.deep_lut - saturation
            + rings(features),
        weighted(&ff_terms(features, format, family), &fitted.ff) + registers * fitted.deep_ff,
    )
}

/// What rings add, counted: a bit of a sum in front of each address that may be of a ring.
fn rings(features: &PeFeatures) -> f64 {
    let addresses = if features.imported_words > 0 { 4 } else { 2 };
    f64::from(addresses * features.ring_bits)
}

/// What the estimate of a PE may be off by, relative to it: LUTs and flip-flops.
pub(super) fn errors(features: &PeFeatures, format: &WordFormat, family: Family) -> (f64, f64) {
    let floor = if rare(features, format, family) { RARE_ERROR } else { 0.0 };
    let fitted = family.fitted();
    let (lut, ff) = match format.pipeline {
        Pipeline::Short => (fitted.lut_deviation, fitted.ff_deviation),
        Pipeline::Deep => (fitted.deep_lut_deviation, fitted.deep_ff_deviation),
    };
    (floor.max(2.0 * lut), floor.max(2.0 * ff))
}

/// What a deep pipeline adds. Bits that are chosen in tables of their own, because a register follows: the operand,
/// which no pre-adder makes then, and among groups of shift positions, which the tables of the addition choose
/// otherwise. And bits of second registers, behind memories and shifts, and of the operands where multiplier blocks
/// have none that synthesis uses.
pub fn deeper(features: &PeFeatures, format: &WordFormat, family: Family) -> (f64, f64) {
    if format.pipeline == Pipeline::Short {
        return (0.0, 0.0);
    }
    let (shifted, _) = sum_bits(features, format);
    let imported = if features.imported_words > 0 { format.data_bits } else { 0 };
    let memories = format.data_bits + imported + format.coefficient_bits + format.word_bits();
    if !family.wide_tables() {
        return (0.0, f64::from(memories + format.data_bits + format.coefficient_bits) + shifted);
    }
    let operand = if features.pre_adder { 0 } else { imported };
    let groups = if features.shifts.len() > 1 { shifted } else { 0.0 };
    (f64::from(operand) + groups, f64::from(memories) + shifted)
}

pub(super) fn weighted<const N: usize>(terms: &[f64; N], coefficients: &[f64; N]) -> f64 {
    terms.iter().zip(coefficients).map(|(term, coefficient)| term * coefficient).sum()
}

/// Width of the write side's adder.
fn sum_bits(features: &PeFeatures, format: &WordFormat) -> (f64, f64) {
    let smallest = u32::from(features.shifts.iter().copied().min().unwrap_or(0));
    let shifted = (features.accumulator_bits + format.left_shift() + 1).saturating_sub(smallest);
    (f64::from(shifted), f64::from(shifted.max(format.word_bits() + 1) + 1))
}

/// Sums outside of multiplier blocks, in bits of tables and of registers.
fn outside(features: &PeFeatures, format: &WordFormat, family: Family) -> (f64, f64) {
    let data = f64::from(format.data_bits);
    let sum = f64::from(features.accumulator_bits);
    let product = format.data_bits + format.coefficient_bits;
    if family.wide_tables() {
        // Only the 25-bit port of a block has a pre-adder, and only one block accumulates.
        if !format.single_multiplier() {
            let blocks = format.blocks(family.tiles());
            let all = data + sum + f64::from(product) * libm::log2(f64::from(blocks));
            return (all, all);
        }
        return (if format.coefficient_bits > 18 { data } else { 0.0 }, 0.0);
    }
    let operand = if features.imported_words > 0 { data } else { 0.0 };
    let products = format.products();
    // Tiles of 18 bits are added where they overlap.
    let tiled = |(one, other): &(u32, u32)| {
        let tiles = one.div_ceil(18) * other.div_ceil(18);
        f64::from((tiles - 1) * (one + other).saturating_sub(18))
    };
    let partial: f64 = products.iter().map(tiled).sum();
    let joined = f64::from(products.len() as u32 / 2 * (product - 17));
    let widths: u32 = products.iter().map(|(one, other)| one + other).sum();
    let registers = match products.len() {
        1 => product,
        2 => 2 * widths + product,
        _ => widths + 3 * product,
    };
    // A row of logic is a bit of both operands and a sum.
    let logic = 3.0 * f64::from(format.logic_bits(family.tiles()));
    (operand + sum + partial + joined + logic, sum + f64::from(registers))
}

/// The LUTs of a PE without its program memory, counted.
pub fn lut_terms(features: &PeFeatures, format: &WordFormat, family: Family) -> [f64; LUT_TERMS.len()] {
    let (shifted, sum) = sum_bits(features, format);
    let (memories, choices) = memories(features, format, family);
    let wide = family.wide_tables();
    let (shifts, ports) = match wide {
        true => (shift_tables(&features.shifts) * shifted, port_tables(features.ports)),
        false => (shift_choices(&features.shifts, shifted), f64::from(features.ports.saturating_sub(1))),
    };
    let cleared = if wide { 0.0 } else { f64::from(features.accumulator_bits) };
    [
        memories.lut + lookup_tables(features),
        choices,
        shifts,
        sum,
        f64::from(format.data_bits) * ports,
        f64::from(u8::from(features.swap)),
        f64::from(u8::from(features.pre_adder)),
        outside(features, format, family).0,
        cleared,
        1.0,
    ]
}

/// The flip-flops of a PE, counted.
pub fn ff_terms(features: &PeFeatures, format: &WordFormat, family: Family) -> [f64; FF_TERMS.len()] {
    [
        memories(features, format, family).0.ff,
        f64::from(features.accumulator_bits + format.word_bits()) + sum_bits(features, format).1,
        if features.send { f64::from(format.data_bits) } else { 0.0 },
        f64::from(u8::from(features.pre_adder)),
        outside(features, format, family).1,
        1.0,
    ]
}

/// Data memories: base words, operands, imported words, and factors that have a memory; and the tables that choose
/// among their parts. Coefficients that are never written are not among them: what they take depends on what they are.
pub fn memories(features: &PeFeatures, format: &WordFormat, family: Family) -> (MemoryCells, f64) {
    let factors = if features.factor { features.coefficient_words } else { 0 };
    let all = [
        (features.base_words, format.word_bits()),
        (features.own_words, format.data_bits),
        (features.imported_words, format.data_bits),
        (features.index_words, features.index_bits),
        (factors, format.coefficient_bits),
    ];
    let cells = all.map(|(words, bits)| family.ram(words, bits));
    let mut sum: MemoryCells = cells.iter().map(|(cells, _)| *cells).sum();
    // In the control word they have a register in the PE, which is one of the multiplier block where synthesis uses
    // that.
    if features.coefficient_words == 0 && !family.wide_tables() {
        sum.ff += f64::from(format.coefficient_bits);
    }
    let mut choices: f64 = cells.iter().map(|(_, choices)| choices).sum();
    // A block's read register has no set: a base that is not read is chosen behind it.
    if cells[0].0.bram18 > 0 && !family.wide_tables() {
        choices += f64::from(format.word_bits());
    }
    (sum, choices)
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

/// The groups of shift positions that `pe_scale.vhd` chooses within.
fn shift_groups(shifts: &[u8]) -> Vec<&[u8]> {
    let count = shifts.len();
    let first_mid = if count <= 3 { 1 } else { 4 };
    let first_high = if count == 3 || count == 6 { count - 1 } else { 8 };
    let mut groups = Vec::new();
    let mut start = 0;
    for end in [first_mid, first_high, count] {
        let end = end.min(count);
        if start < end {
            groups.push(&shifts[start..end]);
            start = end;
        }
    }
    groups
}

/// Positions from the first one on: groups with the same distances share tables.
fn distances(shifts: &[u8]) -> Vec<u8> {
    shifts.iter().map(|shift| shift - shifts[0]).collect()
}

/// Tables of six inputs per bit of the choice of shift: one chooses among four, a tree of them among more.
fn shift_tables(shifts: &[u8]) -> f64 {
    let patterns: BTreeSet<Vec<u8>> = shift_groups(shifts).into_iter().map(distances).collect();
    patterns.iter().map(|pattern| (pattern.len() as f64 - 1.0) / 3.0).map(f64::ceil).sum()
}

/// Tables of four inputs that choose the shift of a sum of so many bits: each chooses between two, with one for all
/// choices between positions as far apart; no table of the addition has room for the choice among groups. Where all
/// that is chosen among is the sign, nothing is.
fn shift_choices(shifts: &[u8], bits: f64) -> f64 {
    let below = |first: u8| (bits - f64::from(first - shifts[0])).max(0.0);
    let groups = shift_groups(shifts);
    let mut chosen: BTreeMap<Vec<u8>, f64> = BTreeMap::new();
    let mut open = groups.clone();
    while let Some(group) = open.pop() {
        if group.len() > 1 {
            let (one, other) = group.split_at(group.len().next_power_of_two() / 2);
            open.extend([one, other]);
            let choices = chosen.entry(distances(group)).or_default();
            *choices = choices.max(below(group[0]));
        }
    }
    let joined = match groups.len() {
        1 => 0.0,
        2 => bits,
        _ => bits + below(groups[1][0]),
    };
    chosen.values().sum::<f64>() + joined
}

/// Tables of six inputs per bit of the choice among input ports: one for up to four, and those that choose among such groups.
fn port_tables(ports: u32) -> f64 {
    let groups = f64::from(ports / 4 + u32::from(ports % 4 > 1));
    if ports > 4 { groups + port_tables(ports.div_ceil(4)) } else { groups }
}
