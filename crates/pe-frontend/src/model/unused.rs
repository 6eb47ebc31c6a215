//! The passes that warn about what nothing reads, and about sums of nothing.

use crate::evaluate::evaluator::Empty;
use crate::names::table::{Kind, Names};
use crate::report::Report;
use crate::syntax::ast::Name;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};
use std::collections::BTreeMap;

/// Warns about constants, parameters and indices that nothing reads.
pub(crate) fn warn(names: &Names, report: &mut Report) {
    let quantities = names.quantities.iter().filter(|quantity| !quantity.used);
    let constants = quantities.filter(|quantity| matches!(quantity.kind, Kind::Const | Kind::Param));
    let indices = names.indices.iter().filter(|index| !index.used).map(|index| index.name);
    let unused: Vec<&Name> = constants.map(|quantity| quantity.name).chain(indices).collect();
    for name in unused.into_iter().filter(|name| !name.text.starts_with('_')) {
        let message = format!("`{}` is never used", name.text);
        report.push(Diagnostic::error(codes::UNUSED, name.span, message).into_warning());
    }
}

/// Warns about sums that had no term wherever they were evaluated: their places, with what those are over.
pub(crate) fn empty_sums(sums: &BTreeMap<Span, Option<Empty>>, report: &mut Report) {
    for (span, empty) in sums.iter().filter_map(|(span, empty)| Some((*span, (*empty)?))) {
        let (what, help) = match empty {
            Empty::Range(low, high) => (format!("`{low}..{high}` is empty"), "check the range, or leave the sum out"),
            Empty::Rows => ("no row is chosen".to_owned(), "check the condition and the file, or leave the sum out"),
        };
        let message = format!("nothing is summed here: {what}, so the sum is always 0");
        report.push(Diagnostic::error(codes::EMPTY_RANGE, span, message).with_help(help).into_warning());
    }
}
