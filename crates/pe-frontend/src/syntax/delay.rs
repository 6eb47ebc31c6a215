//! The argument of a quantity that is read some time ago, `t - 20`.

use crate::language::words::TIME;
use crate::syntax::ast::{Expr, ExprKind, Sign};

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
