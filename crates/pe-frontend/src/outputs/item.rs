//! Names and elements as the command line writes them: `V[3]`, `p`.

use crate::fault::{Fault, fault};
use crate::names::table::{Kind, Quantity};
use pe_ir::source::{Diagnostic, Span};
use pe_ir::{codes, element};

/// An item of a list such as `V[3], w[1,2], p`.
pub(crate) struct Item {
    pub(crate) name: String,
    /// `None` for a scalar or a whole array.
    pub(crate) subscripts: Option<Vec<i64>>,
}

/// The subscripts that an array has, as help; gaps in an algebraic quantity follow no range.
pub(crate) fn extents(quantity: &Quantity) -> Option<String> {
    if quantity.kind == Kind::Algebraic || quantity.rank == 0 {
        return None;
    }
    let ranges = quantity.dimensions.iter().map(|dimension| format!("{}..{}", dimension.low, dimension.high));
    let ranges = ranges.collect::<Vec<String>>().join(", ");
    Some(format!("subscripts of `{}` are in {ranges}", element::bare(&quantity.name.text)))
}

/// The items of a list: commas within brackets do not part them.
pub(super) fn split(list: &str) -> Vec<&str> {
    let mut depth = 0i32;
    let parts = list.split(|letter| {
        depth += i32::from(letter == '[') - i32::from(letter == ']');
        letter == ',' && depth == 0
    });
    parts.map(str::trim).collect()
}

/// Name and subscripts of an item, `None` if it is written otherwise.
pub(crate) fn parse(text: &str) -> Option<Item> {
    element::parse(text).map(|(name, subscripts)| Item { name, subscripts })
}

/// Offset of an element that has to exist.
pub(crate) fn existing(quantity: &Quantity, subscripts: &[i64], span: Span) -> Result<usize, Fault> {
    if quantity.broken {
        return Err(Fault::Silent);
    }
    let offset = quantity.offset(subscripts).ok().filter(|offset| quantity.exists(*offset));
    let algebraic = quantity.kind == Kind::Algebraic;
    offset.ok_or_else(|| {
        let name = quantity.element_name(subscripts);
        let (code, message) = match algebraic {
            true => (codes::NO_SUCH_ELEMENT, format!("no equation defines `{name}`")),
            false => (codes::OUT_OF_RANGE, format!("`{name}` does not exist")),
        };
        fault(Diagnostic::error(code, span, message).with_label(quantity.name.span, "defined here"))
    })
}
