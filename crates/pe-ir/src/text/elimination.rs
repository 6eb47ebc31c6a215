//! How a linear system is eliminated: one item of a step.

use std::fmt;

use crate::graph::{Elimination, Pivot};

use super::labels::Labels;
use super::{Line, TextError, name, number};

/// Prints the item.
pub fn print(f: &mut fmt::Formatter<'_>, elimination: &Elimination, algebraics: &Labels) -> fmt::Result {
    let Elimination { name: matrix, order, scheme, size, symmetric, entries, fill, depth, pivots } = elimination;
    write!(f, "elimination {} order {} scheme {} size {size}", name(matrix), name(order), name(scheme))?;
    f.write_str(if *symmetric { " symmetric" } else { "" })?;
    write!(f, " entries {entries} fill {fill} depth {depth} pivots")?;
    for pivot in pivots {
        match pivot {
            Pivot::Number(pivot) => write!(f, " number {}", number(*pivot))?,
            Pivot::Varying { reciprocal, range } => {
                write!(f, " reciprocal {}", algebraics.text(*reciprocal))?;
                range.iter().try_for_each(|(low, high)| write!(f, " range {} .. {}", number(*low), number(*high)))?;
            }
        }
    }
    writeln!(f)
}

/// Reads what follows the word of the item.
///
/// # Errors
/// It is none, or names an unknown variable.
pub fn read(line: &mut Line, algebraics: &Labels) -> Result<Elimination, TextError> {
    let matrix = line.name("the name of a matrix")?;
    line.word("order")?;
    let order = line.name("the name of an order")?;
    line.word("scheme")?;
    let scheme = line.name("the name of a scheme")?;
    let size = line.keyed("size")?;
    let symmetric = line.take_word("symmetric");
    let (entries, fill, depth) = (line.keyed("entries")?, line.keyed("fill")?, line.keyed("depth")?);
    line.word("pivots")?;
    let mut pivots = Vec::new();
    while !line.is_done() {
        pivots.push(match line.one_of(&["number", "reciprocal"])? {
            0 => Pivot::Number(line.number()?),
            _ => {
                let reciprocal = algebraics.read(line, "an algebraic variable")?;
                let range = match line.take_word("range") {
                    true => {
                        let low = line.number()?;
                        line.sign("..")?;
                        Some((low, line.number()?))
                    }
                    false => None,
                };
                Pivot::Varying { reciprocal, range }
            }
        });
    }
    Ok(Elimination { name: matrix, order, scheme, size, symmetric, entries, fill, depth, pivots })
}
