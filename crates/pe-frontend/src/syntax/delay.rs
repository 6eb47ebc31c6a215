//! The argument of a quantity that is read some time ago, `t - 20`.

use crate::language::words::{TIME, is_built_in};
use crate::syntax::ast::{Expr, ExprKind, Name, Reference, Sign};

/// A short name for the time, which stands only here.
const SHORT: &str = "t";

/// What follows the time in the argument, with the signs that it has there; none if it does not begin with the time.
pub(crate) fn terms(argument: &Expr) -> Option<&[(Sign, Expr)]> {
    let ExprKind::Sum(terms) = &argument.kind else { return None };
    let ((Sign::Plus, first), rest) = terms.split_first()? else { return None };
    match &first.kind {
        ExprKind::Reference(reference) => {
            let is_time = [SHORT, TIME].contains(&reference.name.text.as_str()) && reference.subscripts.is_empty();
            is_time.then_some(rest)
        }
        _ => None,
    }
}

/// A call, or what a quantity was some time ago: the same text but for an argument that begins with the time.
pub(crate) fn call(function: Name, mut arguments: Vec<Expr>, mut units: Vec<(usize, Name)>) -> ExprKind {
    let is_past = match arguments.as_slice() {
        [argument] => terms(argument).is_some() && !is_built_in(&function.text),
        _ => false,
    };
    if is_past && let Some(argument) = arguments.pop() {
        let of = Reference { span: function.span, name: function, subscripts: Vec::new() };
        return ExprKind::Delayed { of, argument: Box::new(argument), unit: units.pop().map(|(_, unit)| unit) };
    }
    ExprKind::Call { function, arguments, units }
}
