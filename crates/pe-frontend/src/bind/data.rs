//! Values from data files: `param R[b] = data("airways.csv", "R")`.

use crate::bound::NodeKind;
use crate::names::table::{Names, Quantity};
use crate::nearest::suggestion;
use crate::report::Report;
use crate::syntax::ast::{Name, Spec};
use crate::syntax::tables::{Cell, Table};
use pe_ir::codes;
use pe_ir::source::Diagnostic;

/// Cells of a column that are reported; a column of text needs no more.
const MOST_CELLS: usize = 5;

/// A column of a data file as values of a quantity: its rows in the order of the elements, or keyed by columns with the
/// names of the indices.
pub(crate) fn values(
    spec: &Spec,
    names: &Names,
    owner: Option<usize>,
    (path, column): (&Name, &Name),
    report: &mut Report,
) -> Option<NodeKind> {
    let Some(number) = owner else {
        let message = "`data` cannot be used here";
        let help = "data files give values to parameters, initial values, stated ranges and signals";
        report.push(Diagnostic::error(codes::WRONG_KIND, path.span, message).with_help(help));
        return None;
    };
    let table = spec.table(path)?;
    let values = find_column(table, column, report)?;
    let quantity = &names.quantities[number];
    if quantity.broken {
        return None;
    }
    let values = numbers(table, values, report)?;
    let keys: Vec<Option<usize>> = quantity.binders.iter().map(|binder| table.find(&binder.name.text)).collect();
    let keyed: Option<Vec<usize>> = keys.iter().copied().collect();
    let values = match keyed {
        Some(keys) if !keys.is_empty() => by_keys(table, &keys, &values, quantity, path, report)?,
        _ if keys.iter().any(Option::is_some) => {
            let missing = quantity.binders.iter().zip(&keys).find(|(_, key)| key.is_none());
            let name = missing.map_or("", |(binder, _)| binder.name.text.as_str());
            let message =
                format!("the file has columns for some indices of `{}`, none for `{name}`", quantity.name.text);
            report.push(Diagnostic::error(codes::BAD_TABLE, path.span, message));
            return None;
        }
        _ => in_order(table, values, quantity, path, report)?,
    };
    Some(NodeKind::Data(number, values))
}

pub(crate) fn find_column(table: &Table, column: &Name, report: &mut Report) -> Option<usize> {
    let mut found = table.columns.iter().enumerate().filter(|(_, known)| known.name == column.text);
    let first = found.next();
    if let (Some((_, one)), Some((_, other))) = (first, found.next()) {
        let message = format!("the file has two columns `{}`", column.text);
        let error = Diagnostic::error(codes::BAD_TABLE, column.span, message);
        report.push(error.with_label(one.place, "the first one").with_label(other.place, "the second one"));
        return None;
    }
    if first.is_none() {
        let message = format!("the file has no column `{}`", column.text);
        let known = table.columns.iter().map(|column| column.name.as_str());
        let help = suggestion(&column.text, known.clone()).unwrap_or_else(|| {
            format!("it has {}", known.take(8).map(|name| format!("`{name:.40}`")).collect::<Vec<_>>().join(", "))
        });
        let error = Diagnostic::error(codes::UNKNOWN_NAME, column.span, message).with_help(help);
        report.push(match table.columns.first() {
            Some(first) => error.with_label(first.place, "the header is here"),
            None => error,
        });
    }
    first.map(|(number, _)| number)
}

pub(crate) fn numbers(table: &Table, column: usize, report: &mut Report) -> Option<Vec<f64>> {
    let values: Vec<f64> = table.column(column).map(|cell| cell.value).collect();
    for cell in table.column(column).filter(|cell| cell.value.is_nan()).take(MOST_CELLS) {
        let message =
            if cell.place.start == cell.place.end { "a number is missing here" } else { "this is not a finite number" };
        let error = Diagnostic::error(codes::BAD_CELL, cell.place, message);
        report.push(error.with_help("separate cells by commas, decimals by a point"));
    }
    values.iter().all(|value| value.is_finite()).then_some(values)
}

fn in_order(
    table: &Table,
    values: Vec<f64>,
    quantity: &Quantity,
    path: &Name,
    report: &mut Report,
) -> Option<Vec<f64>> {
    if values.len() == quantity.length {
        return Some(values);
    }
    let name = &quantity.name.text;
    let message = format!("the file has {} rows for {} element(s) of `{name}`", values.len(), quantity.length);
    let error = Diagnostic::error(codes::BAD_TABLE, path.span, message).with_label(quantity.name.span, "declared here");
    let surplus = table.column(0).nth(quantity.length).map(|cell| cell.place);
    let last = table.column(0).last().map(|cell| cell.place);
    report.push(match (surplus, last) {
        (Some(place), _) => error.with_label(place, "the first row too many"),
        (None, Some(place)) => error.with_label(place, "the last row"),
        (None, None) => error,
    });
    None
}

fn by_keys(
    table: &Table,
    keys: &[usize],
    values: &[f64],
    quantity: &Quantity,
    path: &Name,
    report: &mut Report,
) -> Option<Vec<f64>> {
    let mut keyed = vec![f64::NAN; quantity.length];
    let mut rows: Vec<Option<Cell>> = vec![None; quantity.length];
    let mut subscripts = vec![0i64; keys.len()];
    let mut faults = 0;
    for (row, value) in values.iter().enumerate() {
        let cell = |key: usize| table.cells[row * table.columns.len() + key];
        for (subscript, key) in subscripts.iter_mut().zip(keys) {
            let value = cell(*key).value;
            // Not an integer, NaN included: no element has such a subscript.
            *subscript = if value == libm::floor(value) && value.abs() < 1e15 { value as i64 } else { i64::MIN };
        }
        let problem = match quantity.offset(&subscripts) {
            Err(dimension) => {
                let extent = quantity.dimensions[dimension];
                let index = &quantity.binders[dimension].name.text;
                let message = format!("`{index}` is an integer from {} to {}", extent.low, extent.high);
                let error = Diagnostic::error(codes::BAD_TABLE, cell(keys[dimension]).place, message);
                error.with_label(path.span, format!("for `{}`", quantity.name.text))
            }
            Ok(offset) => match rows[offset].replace(cell(keys[0])) {
                None => {
                    keyed[offset] = *value;
                    continue;
                }
                Some(first) => {
                    let message = format!("a second row for `{}`", quantity.name_at(offset));
                    let error = Diagnostic::error(codes::BAD_TABLE, cell(keys[0]).place, message);
                    error.with_label(first.place, "the first one")
                }
            },
        };
        report.push(problem);
        faults += 1;
        if faults >= MOST_CELLS {
            return None;
        }
    }
    let missing = rows.iter().position(Option::is_none);
    if let Some(offset) = missing.filter(|_| faults == 0) {
        let message = format!("the file has no row for `{}`", quantity.name_at(offset));
        let error = Diagnostic::error(codes::BAD_TABLE, path.span, message);
        report.push(error.with_label(table.columns[keys[0]].place, "rows are found by this column"));
        return None;
    }
    (faults == 0).then_some(keyed)
}
