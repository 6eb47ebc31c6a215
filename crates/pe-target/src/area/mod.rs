//! Estimated size of a network on a family of devices, from the features of its PEs, the words of its programs, and what
//! is beside the PEs.
//!
//! What the datapaths are made of is counted bit by bit ([`terms`]), in a few terms; how many tables and flip-flops a unit
//! of each term takes was fitted to synthesised PEs ([`fitted`], written by `cargo run --example fit_area` from
//! `measured.txt`). Depths at which memories become block RAM are those of `hdl/pe_style_pkg.vhd`. `xtask measure-area`
//! measures a design's PEs; what it writes can take the place of the estimates ([`Measured`]). `xtask measure-network`
//! holds whole networks beside estimates.

mod content;
mod family;
pub mod fitted;
mod measured;
mod names;
mod network;
mod terms;

use std::collections::BTreeSet;

use pe_ir::memory::{self, MemoryCells};
use pe_ir::program::{Fold, PeFeatures, PeProgram, Program, index_bits};
use pe_ir::word::{Pipeline, WordFormat};

pub use family::Family;
pub use measured::{Measured, MeasuredShape, read};
pub use names::{FF_TERMS, LUT_TERMS, TRAITS};
pub use terms::{ENOUGH, RARE_ERROR, deeper, ff_terms, lut_terms, pe, traits};

/// Cells of a network.
#[derive(Clone, Copy, Debug, Default)]
pub struct Area {
    /// What they were counted for.
    pub family: Family,
    /// Look-up tables, memories in LUTs included.
    pub lut: f64,
    /// What the LUTs may be off by, to either side; 0 if all PEs were measured.
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
    /// Where the LUTs and blocks are.
    pub split: Split,
}

/// Look-up tables and block RAMs of the parts of a network.
#[derive(Clone, Copy, Debug, Default)]
pub struct Split {
    /// PEs with their data memories and tables of functions, and with measured ones their programs, too.
    pub pes: (f64, u32),
    /// Of these the tables of functions and their indices: what the PEs would be smaller without them.
    pub function_tables: (f64, u32),
    /// Memories of control words and of coefficients that nothing writes.
    pub programs: (f64, u32),
    /// Inputs and ticks: LUTs and flip-flops.
    pub inputs: (f64, f64),
    /// Outputs, their memories among them: LUTs, flip-flops and block RAMs.
    pub outputs: (f64, f64, u32),
    /// The sequencer and what joins the sticky flags: LUTs and flip-flops.
    pub sequencer: (f64, f64),
    /// What reads and replaces states for a host: LUTs, flip-flops and block RAMs.
    pub host: (f64, f64, u32),
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
}

/// Estimates a whole network: PEs, inputs, ticks, outputs and the sequencer.
pub fn estimate(program: &Program, family: Family) -> Area {
    size(program, &Measured::default(), family)
}

/// The same with measured PEs where there are any of their shape.
pub fn size(program: &Program, measured: &Measured, family: Family) -> Area {
    let shapes = measured.shapes(program, family);
    let sequencer = network::sequencer(program, family);
    let (inputs, outputs) = (network::inputs(program, family), network::outputs(program, family));
    let host = network::host(program, family);
    let mut area = Area {
        family,
        lut: sequencer.0 + (inputs.0 + outputs.0) + host.0,
        ff: sequencer.1 + (inputs.1 + outputs.1) + host.1,
        bram18: host.2 + outputs.2,
        split: Split { inputs, outputs, sequencer, host, ..Split::default() },
        ..Area::default()
    };
    let mut half_blocks = 0;
    for (index, pe) in program.pes.numbered() {
        area.pes += 1;
        if let Some(shape) = shapes.get(&index) {
            area.lut += f64::from(shape.lut);
            area.ff += f64::from(shape.ff);
            half_blocks += shape.half_blocks;
            area.bram18 += shape.bram18;
            area.split.pes.0 += f64::from(shape.lut);
            area.split.pes.1 += shape.bram18;
            area.measured_pes += 1;
            continue;
        }
        let (lut, ff) = self::pe(&pe.features, &program.format, family);
        // The errors of equal shapes are the same, so they add up.
        let (lut_error, ff_error) = terms::errors(&pe.features, &program.format, family);
        area.lut_error += lut_error * lut;
        area.ff_error += ff_error * ff;
        half_blocks += program.format.half_blocks(family.tiles());
        let programs = programs(program, pe, family);
        let data = terms::memories(&pe.features, &program.format, family).0;
        area.lut += lut + programs.lut;
        area.ff += ff + programs.ff;
        area.bram18 += data.bram18 + programs.bram18;
        area.split.pes = (area.split.pes.0 + lut, area.split.pes.1 + data.bram18);
        let tables = function_tables(program, pe, family);
        area.split.function_tables.0 += tables.0;
        area.split.function_tables.1 += tables.1;
        area.split.programs = (area.split.programs.0 + programs.lut, area.split.programs.1 + programs.bram18);
    }
    area.dsp = half_blocks.div_ceil(2);
    area
}

/// What a PE would be smaller without its tables of functions: LUTs and block RAMs of 18 kbit.
fn function_tables(program: &Program, pe: &PeProgram, family: Family) -> (f64, u32) {
    let (features, format) = (&pe.features, &program.format);
    if features.index_words == 0 {
        return (0.0, 0);
    }
    // A base that an index is added to is the first word of a column.
    let pairs = pe.words.windows(2).filter(|pair| pair[0].index.is_some());
    let columns: BTreeSet<u16> = pairs.filter_map(|pair| pair[1].base).collect();
    let others = features.base_words.saturating_sub((columns.len() * program.segments().count()) as u32);
    let base_words = others.max(2).next_power_of_two().min(features.base_words);
    let plain = PeFeatures { base_words, index_words: 0, index_bits: 0, octave_bits: 0, ..features.clone() };
    let blocks = |features| terms::memories(features, format, family).0.bram18;
    let saved = self::pe(features, format, family).0 - self::pe(&plain, format, family).0;
    (saved.max(0.0), blocks(features).saturating_sub(blocks(&plain)))
}

/// The memories of a PE that nothing writes: its control words and coefficients.
fn programs(program: &Program, pe: &PeProgram, family: Family) -> MemoryCells {
    let fold = Fold::of(program, pe);
    let closed = |words: &[u128], mask: u128| -> Vec<u128> {
        words.iter().map(|word| pe_ir::program::closed_up(*word, mask)).collect()
    };
    let variant = |(place, word): (usize, u128)| word | u128::from(fold.next_variant(place)) << fold.repeated_bits();
    let repeated = closed(&fold.repeated, fold.all & !fold.streamed).into_iter().enumerate().map(variant).collect();
    let coefficient = |word: &i64| *word as u128 & (u128::MAX >> (128 - program.format.coefficient_bits));
    let constants = match pe.features.factor {
        true => Vec::new(),
        false => pe.coefficient_image.iter().take(pe.features.coefficient_words as usize).map(coefficient).collect(),
    };
    let memories: [(Vec<u128>, u32, bool); 4] = [
        (repeated, fold.loop_bits(), false),
        (closed(&fold.stream, fold.streamed), fold.streamed_bits(), false),
        (closed(&fold.variant_words, fold.streamed), fold.streamed_bits(), true),
        (constants, program.format.coefficient_bits, false),
    ];
    let behind = |memory: &(Vec<u128>, u32, bool)| followers(&program.format, memory.0.len() as u32, memory.1);
    let following: f64 = memories[..2].iter().map(behind).sum();
    let all: MemoryCells = memories.iter().map(|(words, bits, logic)| content::rom(words, *bits, *logic, family)).sum();
    MemoryCells { ff: all.ff + following, ..all }
}

/// Flip-flops of a program memory in a deep pipeline: the replica of its address, and two registers behind it.
fn followers(format: &WordFormat, words: u32, bits: u32) -> f64 {
    if format.pipeline == Pipeline::Short || bits == 0 || words == 0 {
        0.0
    } else {
        f64::from(index_bits(words) + 2 * bits)
    }
}

#[cfg(test)]
mod tests;
