//! Models that a method does not suit.

use pe_ir::codes;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;

/// The finding that the method does not suit the model.
pub fn unsuitable(model: &Model, reason: &str, help: &str) -> Vec<Diagnostic> {
    let message = format!("`{}` does not suit `{}`: {reason}", model.solver.name(), model.name);
    vec![Diagnostic::global(codes::UNSUITABLE_SOLVER, message).with_help(help)]
}
