//! Measured PEs: the lines that `xtask measure-area` writes.

use std::collections::{BTreeMap, HashMap};

use pe_ir::index::PeId;
use pe_ir::memory::MemoryCells;
use pe_ir::program::{self, Fold, PeFeatures, Program, index_bits};
use pe_ir::word::{Pipeline, WordFormat};

use super::{Family, content, followers};

/// A synthesised PE with its program memory.
#[derive(Clone, Debug)]
pub struct MeasuredShape {
    /// What the PE is made of.
    pub features: PeFeatures,
    /// Its widths.
    pub format: WordFormat,
    /// Memories that nothing writes, of random words: control words and coefficients.
    pub program: MemoryCells,
    /// Look-up tables, memories in LUTs included.
    pub lut: u32,
    /// Flip-flops.
    pub ff: u32,
    /// Family that it was measured on.
    pub family: Family,
    /// Multiplier blocks, in halves.
    pub half_blocks: u32,
    /// Block RAMs of 18 kbit.
    pub bram18: u32,
    /// Features and widths as text, which tells whether two shapes are the same.
    pub key: String,
}

impl MeasuredShape {
    /// The line that says so.
    pub fn line(&self) -> String {
        let dsp = f64::from(self.half_blocks) / 2.0;
        format!("{} lut={} ff={} dsp={dsp} bram18={}", self.key, self.lut, self.ff, self.bram18)
    }
}

/// Measured shapes, none by default.
#[derive(Clone, Debug, Default)]
pub struct Measured(HashMap<String, MeasuredShape>);

impl Measured {
    /// Reads a file of measured shapes.
    ///
    /// # Errors
    /// The number of the first line that is none.
    pub fn parse(text: &str) -> Result<Measured, usize> {
        Ok(Measured(read(text)?.into_iter().map(|shape| (shape.key.clone(), shape)).collect()))
    }

    /// The measured shape of each PE that has one.
    pub(super) fn shapes(&self, program: &Program, family: Family) -> BTreeMap<PeId, &MeasuredShape> {
        if self.0.is_empty() {
            return BTreeMap::new();
        }
        let shape = |index: PeId| {
            let fold = Fold::of(program, &program.pes[index]);
            let line = program::shape(program, index, &fold);
            let line = if family.wide_tables() { line } else { format!("{line} family={}", family.name()) };
            self.0.get(&key(&line))
        };
        program.pes.ids().filter_map(|index| Some((index, shape(index)?))).collect()
    }
}

/// What a line says of features and widths: all but which PEs have them, and the cells.
fn key(line: &str) -> String {
    let other = ["shape=", "count=", "example=", "lut=", "packed=", "ff=", "dsp=", "bram18="];
    let words = line.split_whitespace().filter(|word| !other.iter().any(|other| word.starts_with(other)));
    let mut words: Vec<&str> = words.collect();
    words.sort_unstable();
    words.join(" ")
}

/// Reads lines of measured shapes.
///
/// # Errors
/// The number of the first line that is none.
pub fn read(text: &str) -> Result<Vec<MeasuredShape>, usize> {
    text.lines().enumerate().map(|(index, line)| shape(line).ok_or(index + 1)).collect()
}

fn shape(line: &str) -> Option<MeasuredShape> {
    let fields: HashMap<&str, &str> = line.split_whitespace().filter_map(|word| word.split_once('=')).collect();
    let number = |name: &str| fields.get(name)?.parse::<u32>().ok();
    // A line from before there was a feature does not name it.
    let flag = |name: &str| fields.get(name).map_or(Some(false), |value| value.parse::<bool>().ok());
    let missing_is_zero = |name: &str| if fields.contains_key(name) { number(name) } else { Some(0) };
    let shifts = fields.get("shifts")?.split(',').map(|shift| shift.parse().ok()).collect::<Option<Vec<u8>>>()?;
    let format = WordFormat {
        storage_bits: number("storage_bits")?,
        guard_bits: number("word_bits")?.checked_sub(number("storage_bits")?)?,
        data_bits: number("data_bits")?,
        coefficient_bits: number("coefficient_bits")?,
        pipeline: pipeline(fields.get("pipeline"))?,
    };
    let family = fields.get("family").map_or(Some(Family::default()), |name| Family::named(name))?;
    let features = PeFeatures {
        own_words: number("own_words")?,
        base_words: number("base_words")?,
        coefficient_words: number("coefficient_words")?,
        imported_words: number("imported_words")?,
        ports: number("ports")?,
        shifts,
        accumulator_bits: number("accumulator_bits")?,
        factor: flag("factor")?,
        pre_adder: flag("pre_adder")?,
        swap: flag("swap")?,
        base_last: flag("base_last")?,
        send: flag("send")?,
        proven: flag("proven")?,
        index_words: missing_is_zero("index_words")?,
        index_bits: missing_is_zero("index_bits")?,
        octave_bits: missing_is_zero("octave_bits")?,
        shown_words: missing_is_zero("shown_words")?,
        show_last: fields.get("show_last").is_some_and(|value| *value == "true"),
        ring_bits: missing_is_zero("ring_bits")?,
    };
    let coefficients = if features.factor { 0 } else { features.coefficient_words };
    let constants = content::random(coefficients, format.coefficient_bits, false, family);
    Some(MeasuredShape {
        program: [program(number, &format, family)?, constants].into_iter().sum(),
        features,
        format,
        family,
        lut: number("lut")?,
        ff: number("ff")?,
        half_blocks: (2.0 * fields.get("dsp")?.parse::<f64>().ok()?) as u32,
        bram18: number("bram18")?,
        key: key(line),
    })
}

/// The pipeline that a line names; without a name it is the short one.
fn pipeline(name: Option<&&str>) -> Option<Pipeline> {
    name.map_or(Some(Pipeline::Short), |name| Pipeline::ALL.into_iter().find(|pipeline| pipeline.name() == *name))
}

/// Memories of the control words: what every round repeats, and the rest.
fn program(number: impl Fn(&str) -> Option<u32>, format: &WordFormat, family: Family) -> Option<MemoryCells> {
    let (words, bits, streamed) = (number("program_words")?, number("program_bits")?, number("streamed_bits")?);
    let (rounds, repeated) = (number("rounds")?, bits.checked_sub(streamed)?);
    let round_words = words.checked_div(rounds)?;
    Some(match number("variants") {
        Some(variants) => {
            let table = content::random(variants * rounds.next_power_of_two(), streamed, true, family);
            let repeated = content::random(round_words, repeated + index_bits(variants), false, family);
            [repeated, table].into_iter().sum()
        }
        None => {
            let cells = |words, bits| {
                let memory = content::random(words, bits, false, family);
                MemoryCells { ff: memory.ff + followers(format, words, bits), ..memory }
            };
            [cells(round_words, repeated), cells(words, streamed)].into_iter().sum()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_is_no_shape_is_named() {
        let good = include_str!("measured.txt").lines().next().unwrap();
        assert_eq!(Measured::parse(good).unwrap().0.len(), 1);
        assert_eq!(Measured::parse(&format!("{good}\nlut=3\n")).unwrap_err(), 2);
    }
}
