//! Number formats: an item for each value of the step graph, and one for each chain.

use crate::graph::{FixedPoint, StepGraph};
use crate::index::{List, at, number};
use crate::verify;
use crate::word::{Pipeline, WordFormat};

use super::labels::Labels;
use super::{Line, Section, Stage, TextError};

/// The text of word widths.
pub(crate) fn print_format(format: &WordFormat) -> String {
    let WordFormat { storage_bits, guard_bits, data_bits, coefficient_bits, pipeline } = format;
    let pipeline = match pipeline {
        Pipeline::Short => String::new(),
        Pipeline::Deep => format!(" pipeline {}", pipeline.name()),
    };
    format!(
        "format storage {storage_bits} guard {guard_bits} data {data_bits} coefficient {coefficient_bits}{pipeline}"
    )
}

/// Reads word widths behind `format`.
pub(crate) fn read_format(line: &mut Line) -> Result<WordFormat, TextError> {
    let storage_bits = line.keyed("storage")?;
    let guard_bits = line.keyed("guard")?;
    let data_bits = line.keyed("data")?;
    let coefficient_bits = line.keyed("coefficient")?;
    let pipeline = match line.take_word("pipeline") {
        true => Pipeline::ALL[line.one_of(&Pipeline::ALL.map(Pipeline::name))?],
        false => Pipeline::Short,
    };
    let format = WordFormat { storage_bits, guard_bits, data_bits, coefficient_bits, pipeline };
    match verify::fixed::unsuitable(&format) {
        None => Ok(format),
        Some(problem) => Err(line.error(problem)),
    }
}

/// The section of the formats of a step graph.
pub fn print(graph: &StepGraph, fixed: &FixedPoint) -> String {
    let labels = Labels::of_values(graph);
    let mut text = format!("{}\n{}\n", Stage::Fixed.header(), print_format(&fixed.format));
    for (index, exponent) in fixed.exponents.iter().enumerate() {
        let half_scale = if fixed.half_scale[index] { " half-scale" } else { "" };
        text += &format!("value {} exponent {exponent}{half_scale}\n", labels.text(number(index)));
    }
    for (index, chain) in graph.chains.numbered() {
        let [first, second, third] = fixed.shifts[index];
        text += &format!(
            "chain {} product {} shifts {first} {second} {third} accumulator {} coefficients",
            labels.chain(chain),
            fixed.products[index],
            fixed.accumulator_bits[index]
        );
        for coefficient in &fixed.coefficients[at(chain.terms.start)..chain.terms.end as usize] {
            text += &format!(" {coefficient}");
        }
        text.push('\n');
    }
    text
}

/// Reads the section of the formats of a step graph.
///
/// # Errors
/// An item is not one of number formats, or they do not fit the step graph.
pub fn read(section: &Section, graph: &StepGraph) -> Result<FixedPoint, TextError> {
    let labels = Labels::of_values(graph);
    let mut lines = section.lines();
    let mut line = lines.next().ok_or_else(|| section.error("there is no item `format`"))?;
    line.word("format")?;
    let format = read_format(&mut line)?;
    line.done()?;
    let mut fixed = FixedPoint {
        format,
        exponents: Vec::with_capacity(graph.values.len()),
        half_scale: Vec::with_capacity(graph.values.len()),
        coefficients: Vec::with_capacity(graph.terms.len()),
        products: List::with_capacity(graph.chains.len()),
        shifts: List::with_capacity(graph.chains.len()),
        accumulator_bits: List::with_capacity(graph.chains.len()),
    };
    for index in 0..graph.values.len() {
        let label = labels.text(number(index));
        let mut line = lines.next().ok_or_else(|| lines.error(format!("expected the format of the value {label}")))?;
        line.word("value")?;
        if labels.read_value(&mut line)?.index() != index {
            return Err(line.error(format!("expected {label}: values are in the order of the step")));
        }
        fixed.exponents.push(line.keyed("exponent")?);
        fixed.half_scale.push(line.take_word("half-scale") || line.take_word("headroom"));
        line.done()?;
    }
    for chain in &graph.chains {
        let mut line = labels.line_of(chain, "formats", &mut lines)?;
        fixed.products.push(line.keyed("product")?);
        line.word("shifts")?;
        fixed.shifts.push([line.integer()?, line.integer()?, line.integer()?]);
        fixed.accumulator_bits.push(line.keyed("accumulator")?);
        line.word("coefficients")?;
        for _ in chain.terms.clone() {
            fixed.coefficients.push(line.integer()?);
        }
        line.done()?;
    }
    if let Some(mut line) = lines.next() {
        return Err(line.expected("no more items: the step has no other value or chain"));
    }
    match verify::fixed::check(graph, &fixed).first() {
        None => Ok(fixed),
        Some(problem) => Err(section.error(format!("these formats do not fit the step: {problem}"))),
    }
}
