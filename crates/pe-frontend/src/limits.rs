//! How large a model may become.

use crate::report::Report;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// How large a model may become before it is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Elements of all parameters, inputs, states and algebraic quantities together.
    pub elements: usize,
    /// Expressions evaluated for all elements together.
    pub evaluations: u64,
    /// Variables read by all flat equations together.
    pub reads: u64,
}

impl Default for Limits {
    /// Five million elements, about ten seconds of work, about three gigabytes of equations.
    fn default() -> Self {
        Limits { elements: 5_000_000, evaluations: 500_000_000, reads: 50_000_000 }
    }
}

/// Elements that may still be created.
#[derive(Debug)]
pub(crate) struct Elements {
    pub(crate) left: usize,
}

impl Elements {
    /// Takes `count` elements of `what` from the limit, or reports that there are too many.
    pub(crate) fn take(&mut self, count: usize, what: &str, span: Span, report: &mut Report) -> bool {
        if let Some(left) = self.left.checked_sub(count) {
            self.left = left;
            return true;
        }
        let message =
            format!("`{what}` has {} elements; together with those before it the model is too large", shown(count));
        report.push(
            Diagnostic::error(codes::TOO_MANY_ELEMENTS, span, message).with_help("look at the ranges of its indices"),
        );
        false
    }
}

/// A count for messages; astronomically large ones are not counted out.
fn shown(count: usize) -> String {
    if count == usize::MAX { "more than 10^18".to_owned() } else { count.to_string() }
}
