//! Delays of quantities, `x(t - 20 ms)`: which there may be.

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// The finding that a delay is not the same at all times.
pub(crate) fn varies(span: Span) -> Diagnostic {
    let message = "a delay must be a constant, this depends on a variable";
    let help = "a delay reads constants, parameters and indices only";
    Diagnostic::error(codes::BAD_DELAY, span, message).with_help(help)
}

/// Whether a delay in seconds lies in the past.
pub(crate) fn check(seconds: f64, span: Span) -> Result<(), Diagnostic> {
    if seconds > 0.0 && seconds.is_finite() {
        return Ok(());
    }
    let (message, help) = match seconds == 0.0 {
        true => ("the delay is zero", "write the name alone: every quantity is that of the present time"),
        false => ("a delay must be a positive time", "only what has been is known: write `x(t - 20 ms)`"),
    };
    Err(Diagnostic::error(codes::BAD_DELAY, span, message).with_help(help))
}
