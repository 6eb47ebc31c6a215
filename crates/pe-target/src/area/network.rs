//! Parts of a network besides its PEs: sequencer, inputs, ticks and outputs.
//!
//! Counts of the circuit, held against `parts.txt`, which `xtask measure-parts` writes.

use pe_ir::program::{OutputMemory, Program, index_bits};
use pe_ir::word::{Pipeline, WordFormat};

use super::{Family, content};

/// Look-up tables and flip-flops of the sequencer, and of the one register that joins all sticky flags.
pub fn sequencer(program: &Program, family: Family) -> (f64, f64) {
    let deep = program.format.pipeline == Pipeline::Deep;
    let (lut, ff) = sequencer_alone(program.period, program.rounds, deep, family);
    let flags = (program.pes.len() + program.ports().count()) as f64;
    let joined = (flags - 1.0) / f64::from(family.lut_inputs() - 1);
    // The number of the step, for rings, and its way to the PEs.
    let steps = f64::from(program.pes.iter().map(|pe| pe.features.ring_bits).max().unwrap_or(0));
    let late = if deep { 5.0 } else { 1.0 };
    (lut + joined.ceil() + steps, ff + 1.0 + steps * late)
}

pub(super) fn sequencer_alone(period: u32, rounds: u32, deep: bool, family: Family) -> (f64, f64) {
    let bits = f64::from(index_bits(period));
    // Word index, place in the round, index of the word that is executed, and single bits.
    let (plain, late) = if family.wide_tables() { (11.0 + 4.0 * bits, 12.0) } else { (26.0 + 7.0 * bits, 0.0) };
    let ff = if deep { plain } else { 7.0 + 3.0 * bits };
    if !family.wide_tables() {
        return (50.0, ff);
    }
    (12.0 + 1.2 * bits + f64::from(2 * u8::from(rounds > 1)) + if deep { late } else { 0.0 }, ff)
}

/// Look-up tables and flip-flops of inputs and ticks.
pub fn inputs(program: &Program, family: Family) -> (f64, f64) {
    let (count, (lut, ff)) = (program.ports().count() as f64, input(&program.format, family));
    let mut sum = (count * lut, count * ff);
    for (_, steps, _) in program.ticks() {
        let (lut, ff) = tick(steps.steps, family);
        sum = (sum.0 + lut, sum.1 + ff);
    }
    sum
}

/// Look-up tables, flip-flops and block RAMs of outputs.
pub fn outputs(program: &Program, family: Family) -> (f64, f64, u32) {
    if let Some(memory) = program.output_memory() {
        return output_memory(program, &memory, family);
    }
    let mut sum = (0.0, 0.0, 0);
    for port in &program.outputs {
        let (lut, ff) = output(&program.format, index_bits(program.period), !port.proven, family);
        sum = (sum.0 + lut, sum.1 + ff, 0);
    }
    sum
}

/// Output memories: in each PE that shows words the memory, the counter of places and the choice of banks; once the places
/// of outputs, the choice of a memory, the registers that join what memories show, and an output.
fn output_memory(program: &Program, memory: &OutputMemory, family: Family) -> (f64, f64, u32) {
    let (format, bits) = (&program.format, program.format.shown_bits());
    let deep = 2 * u32::from(format.pipeline == Pipeline::Deep);
    let row = |(pe, place): &(u32, u16)| u128::from(*pe) << memory.place_bits | u128::from(*place);
    let rows: Vec<u128> = memory.places.iter().map(row).collect();
    let places = content::rom(&rows, memory.memory_bits() + memory.place_bits, false, family);
    // The number of a memory is compared; the last one of a row of two levels shares nothing.
    let compare = f64::from((memory.memory_bits().max(2) - 1).div_ceil(family.lut_inputs() - 1));
    let (mut lut, mut ff, mut bram18) = (places.lut, places.ff + f64::from(memory.place_bits), places.bram18);
    for pe in &memory.pes {
        let words = program.pes[*pe].features.shown_words;
        let counter = index_bits(words);
        let (cells, choices) = family.ram(2 * words, bits);
        // A word that is not read is 0: a register's reset does that, but not the one of a block outside Xilinx devices.
        let cleared = if cells.bram18 > 0 && !family.wide_tables() { f64::from(bits) } else { 0.0 };
        lut += cells.lut + choices + cleared + f64::from(counter + 2) + compare;
        ff += cells.ff + f64::from(counter + 2 + deep);
        bram18 += cells.bram18;
    }
    let joined = memory.joined();
    for (from, to) in joined.iter().zip(&joined[1..]) {
        lut += f64::from(bits) * f64::from((from - to).div_ceil(family.lut_inputs() - 1));
        ff += f64::from(bits * to);
    }
    let (output_lut, output_ff) = output(&format.with_pipeline(Pipeline::Short), 0, memory.saturates, family);
    (lut + output_lut, ff + output_ff, bram18)
}

/// Look-up tables, flip-flops and block RAMs of what reads and replaces states: the order of states, the sum that takes
/// the offset off new words, the choice between those of a host and the initial ones, what joins the words that PEs
/// show, and in each PE the register of the new word, its way into the sum and another address of the base memory.
/// Constants are from weibel5 on 4 PEs with `25x18`, synthesised with and without these ports.
pub fn host(program: &Program, family: Family) -> (f64, f64, u32) {
    let host = program.host;
    if !host.replaces() {
        return (0.0, 0.0, 0);
    }
    let bits = f64::from(program.format.word_bits());
    let pes = program.pes.len() as f64;
    let rows = program.replacements().unwrap_or_default();
    let row_bits = program.row_bits();
    let joined =
        |row| (program.row(row).iter().zip(row_bits)).fold(0, |all, (field, bits)| all << bits | u128::from(*field));
    let words: Vec<u128> = rows.iter().map(joined).collect();
    let order = content::rom(&words, row_bits.iter().sum(), false, family);
    let both = host.restart && host.states;
    let (in_pe, scale) = match family {
        Family::Virtex6 | Family::UltraScale => (14.0, 1.0),
        Family::Ecp5 => (bits, 1.2),
        Family::Gowin => (2.0 * bits - 6.0, 1.2),
    };
    let inputs = f64::from(family.lut_inputs() - 1);
    let joined = if host.states { bits * (pes / inputs).ceil() } else { 0.0 };
    let control = 80.0 + if host.restart { bits } else { 0.0 } + if both { 2.0 * bits } else { 0.0 };
    let words = if host.states { 2.0 * bits } else { bits };
    (pes * in_pe + scale * (control + joined) + order.lut, pes * bits + 30.0 + words + order.ff, order.bram18)
}

/// An input: where operands have fewer bits than the port the sum that rounds, and what clamps it.
pub(super) fn input(format: &WordFormat, family: Family) -> (f64, f64) {
    let deep = f64::from(u8::from(format.pipeline == Pipeline::Deep));
    if format.data_bits >= format.storage_bits {
        let bits = f64::from(format.storage_bits);
        return (0.0, bits + deep * (bits + 1.0));
    }
    let bits = f64::from(format.data_bits);
    (if family.wide_tables() { 2.0 } else { 2.0 * bits + 2.0 }, bits + 1.0 + deep * (bits + 2.0))
}

/// A tick: a counter, a comparison with its last number, and the register of the operand's one bit.
pub(super) fn tick(steps: u32, family: Family) -> (f64, f64) {
    let bits = f64::from(index_bits(steps));
    (if family.wide_tables() { bits + 1.0 } else { 2.0 * bits + 3.0 }, bits + 1.0)
}

/// An output: recognition of its control word, and, unless stored words carry the offset that rounds to the port
/// anyway, addition of another and, if it is not proven to be needless, saturation, between a register of the word and
/// one of the port's width.
pub(super) fn output(format: &WordFormat, index_bits: u32, saturates: bool, family: Family) -> (f64, f64) {
    let compare = match family.wide_tables() {
        true => (f64::from(index_bits + 4) / 5.0).floor(),
        false => (f64::from(index_bits + 1) / 3.0).ceil(),
    };
    let deep = 2 * u32::from(format.pipeline == Pipeline::Deep);
    if format.data_bits == format.storage_bits {
        return (compare, f64::from(2 * format.storage_bits + deep));
    }
    let (adder, captured) = match format.data_bits < format.storage_bits {
        // Bits below the one that rounds are not looked at.
        true => (format.data_bits + 2, format.word_bits() - format.guard_bits.saturating_sub(1)),
        false if family.wide_tables() => (format.guard_bits, format.word_bits()),
        false => (format.word_bits(), format.word_bits()),
    };
    let more = if family.wide_tables() || format.guard_bits == 0 { 0.0 } else { 6.0 };
    let clamp = if saturates { format.storage_bits - 1 } else { 0 };
    (compare + f64::from(adder + clamp) + more, f64::from(captured + format.storage_bits + deep))
}
