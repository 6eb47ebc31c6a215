//! The pass that warns about what nothing reads.

use crate::names::table::{Kind, Names};
use crate::report::Report;
use crate::syntax::ast::Name;
use pe_ir::codes;
use pe_ir::source::Diagnostic;

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
