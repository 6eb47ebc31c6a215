//! Tables written out in the spec: `param A[i, j] = [1, 2; 3, 4]`.

use crate::bound::{Node, NodeKind};
use crate::names::table::{Names, Quantity, count};
use crate::report::Report;
use crate::syntax::ast::Expr;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// A table with these bound cells, `None` after an error in one: a vector has one row or one cell per row, a matrix as
/// many rows and columns as its dimensions.
pub(crate) fn cells(
    names: &Names,
    owner: Option<usize>,
    rows: &[Vec<Expr>],
    cells: Option<Vec<Node>>,
    span: Span,
    report: &mut Report,
) -> Option<NodeKind> {
    let Some(number) = owner else {
        let message = "a table cannot be used here";
        let help = "tables give values to the elements of parameters and states in their declarations";
        report.push(Diagnostic::error(codes::WRONG_KIND, span, message).with_help(help));
        return None;
    };
    let quantity = &names.quantities[number];
    if quantity.broken {
        return None;
    }
    let columns = rows.first().map_or(0, Vec::len);
    if let Some((at, row)) = rows.iter().enumerate().find(|(_, row)| row.len() != columns) {
        let place = row.first().map_or(span, |cell| cell.span);
        let message = format!("row {} has {} cells, the first one {columns}", at + 1, row.len());
        report.push(Diagnostic::error(codes::BAD_SHAPE, place, message));
        return None;
    }
    let wanted = shape(quantity);
    let vector = rows.len() == 1 || columns == 1;
    let fits = match wanted.as_slice() {
        [length] => vector && rows.len() * columns == *length,
        [height, width] => rows.len() == *height && columns == *width,
        _ => false,
    };
    if !fits {
        let wanted = wanted.iter().map(usize::to_string).collect::<Vec<_>>().join(" x ");
        let wanted = if wanted.is_empty() { "a scalar".to_owned() } else { format!("{wanted} elements") };
        let message = format!("the table has {} x {columns} cells, `{}` is {wanted}", rows.len(), quantity.name.text);
        let error = Diagnostic::error(codes::BAD_SHAPE, span, message);
        report.push(error.with_label(quantity.name.span, "declared here"));
        return None;
    }
    Some(NodeKind::Matrix(number, cells?))
}

/// Number of elements in each dimension.
fn shape(quantity: &Quantity) -> Vec<usize> {
    quantity.dimensions.iter().map(|d| count((d.low, d.high))).collect()
}
