//! Sums over the rows of a data file, such as the synapses of a network: `sum(e in rows("synapses.csv") where e.to == i: ...)`.

use std::collections::BTreeMap;
use std::rc::Rc;

use crate::bind::data;
use crate::report::Report;
use crate::syntax::ast::{Comparison, Connective, Expr, ExprKind, Name};
use crate::syntax::tables::Table;
use pe_ir::index::number;
use pe_ir::source::Span;

/// A sum over rows that an expression stands in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Within<'a> {
    /// The name of a row.
    pub(crate) name: &'a str,
    /// Its place in the frame.
    pub(crate) place: usize,
    pub(crate) table: &'a Table,
}

/// The column that a name stands for, `weight` of `e.weight`.
pub(crate) fn column<'n>(name: &'n str, row: &str) -> Option<&'n str> {
    name.strip_prefix(row)?.strip_prefix('.')
}

/// The numbers of a column.
pub(crate) fn cells(table: &Table, name: &Name, row: &str, report: &mut Report) -> Option<Rc<[f64]>> {
    let text = column(&name.text, row)?.to_owned();
    let column = data::find_column(table, &Name { text, span: name.span }, report)?;
    Some(data::numbers(table, column, report)?.into())
}

/// First cells of all rows.
pub(crate) fn places(table: &Table) -> Vec<Span> {
    table.column(0).map(|cell| cell.place).collect()
}

/// Rows by the bits of a number in each.
pub(crate) fn by_number(cells: &[f64]) -> BTreeMap<u64, Vec<u32>> {
    let mut rows: BTreeMap<u64, Vec<u32>> = BTreeMap::new();
    for (row, cell) in cells.iter().enumerate() {
        rows.entry(bits(*cell)).or_default().push(number(row));
    }
    rows
}

/// The bits of a number; both zeros are one.
pub(crate) fn bits(value: f64) -> u64 {
    (value + 0.0).to_bits()
}

/// The part of a condition that says what a cell is, `e.to == i`: the cell, and an expression that reads no cell of the row.
pub(crate) fn chosen<'e>(condition: &'e Expr, row: &str) -> Option<(&'e Name, &'e Expr)> {
    match &condition.kind {
        ExprKind::Compare(Comparison::Equal, one, other) => {
            let cell = |expr: &'e Expr| match &expr.kind {
                ExprKind::Reference(reference) => column(&reference.name.text, row).map(|_| &reference.name),
                _ => None,
            };
            match (cell(one), cell(other)) {
                (Some(name), None) if !reads(other, row) => Some((name, other)),
                (None, Some(name)) if !reads(one, row) => Some((name, one)),
                _ => None,
            }
        }
        ExprKind::Logical(Connective::And, members) => members.iter().find_map(|member| chosen(member, row)),
        _ => None,
    }
}

/// Whether an expression reads cells of a row.
fn reads(expr: &Expr, row: &str) -> bool {
    let mut found = false;
    crate::arrays::algebra::visit(expr, &mut |part| {
        if let ExprKind::Reference(reference) = &part.kind {
            found |= column(&reference.name.text, row).is_some() || reference.name.text == row;
        }
    });
    found
}
