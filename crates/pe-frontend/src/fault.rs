//! Why an expression has no value, and the remaining work budget.

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Why an expression has no value.
#[derive(Debug)]
pub(crate) enum Fault {
    /// The reason has been reported elsewhere.
    Silent,
    /// A constant is needed whose value is not computed yet: quantity and offset.
    Missing(usize, usize),
    /// To be reported.
    Report(Box<Diagnostic>),
}

/// What a constant is needed for.
#[derive(Clone, Copy)]
pub(crate) enum Purpose {
    Condition,
    Integer,
    /// Values before time zero, bounds, waveform arguments.
    Constant,
}

/// What may still be done.
#[derive(Debug)]
pub(crate) struct Budget {
    /// Expressions that may still be evaluated.
    pub(crate) work: u64,
    /// Variables that may still be read; bounds the memory of the result.
    pub(crate) reads: u64,
    /// Ends the work early when its result is no longer wanted.
    pub(crate) stop: Option<Arc<AtomicBool>>,
}

/// Expressions evaluated between two looks at whether the result is still wanted.
const LOOK: u64 = 1 << 12;

impl Budget {
    /// Evaluates one expression.
    pub(crate) fn spend(&mut self, span: Span) -> Result<(), Fault> {
        if self.work.is_multiple_of(LOOK) && self.stop.as_ref().is_some_and(|stop| stop.load(Ordering::Relaxed)) {
            self.work = 0;
        }
        self.work = self.work.checked_sub(1).ok_or_else(|| fault(too_large(span)))?;
        Ok(())
    }

    /// Reads variables.
    pub(crate) fn read(&mut self, count: u64, span: Span) -> Result<(), Fault> {
        self.reads = self.reads.checked_sub(count).ok_or_else(|| fault(too_large(span)))?;
        Ok(())
    }
}

pub(crate) fn fault(diagnostic: Diagnostic) -> Fault {
    Fault::Report(Box::new(diagnostic))
}

pub(crate) fn not_finite(span: Span, reason: &str) -> Diagnostic {
    Diagnostic::error(codes::NOT_FINITE, span, reason)
}

pub(crate) fn too_large(span: Span) -> Diagnostic {
    Diagnostic::error(codes::TOO_MUCH_WORK, span, "the model is too large to write out; the limit is reached here")
        .with_help("look for a sum or an index range that is larger than intended")
}

pub(crate) fn not_constant(span: Span, purpose: Purpose) -> Diagnostic {
    let (code, message, help) = match purpose {
        Purpose::Condition => (
            codes::VARIABLE_CONDITION,
            "the condition depends on a variable".to_owned(),
            "`where` chooses between equations when the model is built; it can read indices and constants only. `if` can read variables",
        ),
        Purpose::Integer => (
            codes::NOT_CONSTANT,
            "an integer is needed here, this depends on a variable".to_owned(),
            "subscripts, ranges, `div` and `mod` can read indices and constants only",
        ),
        Purpose::Constant => (
            codes::NOT_CONSTANT,
            "a constant is needed here, this depends on a variable".to_owned(),
            "a value fixed before time zero can only read constants and parameters",
        ),
    };
    Diagnostic::error(code, span, message).with_help(help)
}
