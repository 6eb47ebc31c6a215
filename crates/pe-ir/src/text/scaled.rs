//! The text of functions that a table stands for.

use super::{Line, TextError, name, number};
use crate::functions::Scaled;

/// A function, but for the word in front.
pub(super) fn text(of: &Scaled) -> String {
    let [slope, offset, factor, times, plus] = [of.slope, of.offset, of.factor, of.beside.0, of.beside.1].map(number);
    format!("{} slope {slope} offset {offset} factor {factor} beside {times} {plus}", name(&of.name))
}

/// Reads it.
pub(super) fn read(line: &mut Line) -> Result<Scaled, TextError> {
    let name = line.name("the name of a function")?;
    let (slope, offset) = (line.keyed_number("slope")?, line.keyed_number("offset")?);
    let factor = line.keyed_number("factor")?;
    Ok(Scaled { name, slope, offset, factor, beside: (line.keyed_number("beside")?, line.number()?) })
}
