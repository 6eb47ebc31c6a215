//! Operators: how tightly they bind, and what they make of their operands.

use crate::syntax::ast::{Comparison, Connective, Expr, ExprKind, Factor, Sign};
use crate::syntax::grammar::Rule;
use pe_ir::source::Span;
use pest::pratt_parser::{Assoc, Op, PrattParser};
use std::sync::LazyLock;

/// Operators from loosest to tightest.
pub(crate) static PRECEDENCE: LazyLock<PrattParser<Rule>> = LazyLock::new(|| {
    let left = |rule| Op::infix(rule, Assoc::Left);
    PrattParser::new()
        .op(left(Rule::kw_or))
        .op(left(Rule::kw_and))
        .op(Op::prefix(Rule::kw_not))
        .op(left(Rule::equal)
            | left(Rule::not_equal)
            | left(Rule::less)
            | left(Rule::less_equal)
            | left(Rule::greater)
            | left(Rule::greater_equal))
        .op(left(Rule::add) | left(Rule::subtract))
        .op(left(Rule::multiply) | left(Rule::divide) | left(Rule::kw_div) | left(Rule::kw_mod))
        .op(Op::prefix(Rule::negate))
        .op(Op::infix(Rule::power, Assoc::Right))
});

/// Joins two operands; chains of one rank become one list.
pub(crate) fn join(left: Expr, operator: Rule, right: Expr) -> Option<Expr> {
    let span = Span { start: left.span.start, end: right.span.end };
    let kind = match operator {
        Rule::add => term(left, Sign::Plus, right),
        Rule::subtract => term(left, Sign::Minus, right),
        Rule::multiply => factor(left, Factor::Multiply, right),
        Rule::divide => factor(left, Factor::Divide, right),
        Rule::kw_div => factor(left, Factor::IntegerDivide, right),
        Rule::kw_mod => factor(left, Factor::Modulo, right),
        Rule::power => ExprKind::Power(Box::new(left), Box::new(right)),
        Rule::kw_and => logical(left, Connective::And, right),
        Rule::kw_or => logical(left, Connective::Or, right),
        _ => {
            let comparison = match operator {
                Rule::equal => Comparison::Equal,
                Rule::not_equal => Comparison::NotEqual,
                Rule::less => Comparison::Less,
                Rule::less_equal => Comparison::LessEqual,
                Rule::greater => Comparison::Greater,
                Rule::greater_equal => Comparison::GreaterEqual,
                _ => return None,
            };
            ExprKind::Compare(comparison, Box::new(left), Box::new(right))
        }
    };
    Some(Expr { kind, span })
}

fn term(left: Expr, sign: Sign, right: Expr) -> ExprKind {
    let mut terms = match left.kind {
        ExprKind::Sum(terms) => terms,
        kind => vec![(Sign::Plus, Expr { kind, span: left.span })],
    };
    terms.push((sign, right));
    ExprKind::Sum(terms)
}

fn factor(left: Expr, operator: Factor, right: Expr) -> ExprKind {
    let (first, mut rest) = match left.kind {
        ExprKind::Product(first, rest) => (first, rest),
        kind => (Box::new(Expr { kind, span: left.span }), Vec::new()),
    };
    rest.push((operator, right));
    ExprKind::Product(first, rest)
}

fn logical(left: Expr, connective: Connective, right: Expr) -> ExprKind {
    let mut operands = match left.kind {
        ExprKind::Logical(inner, operands) if inner == connective => operands,
        kind => vec![Expr { kind, span: left.span }],
    };
    operands.push(right);
    ExprKind::Logical(connective, operands)
}
