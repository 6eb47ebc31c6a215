//! Functions and choices of variables: quotients, powers, calls and conditions that are no numbers.
//!
//! What comes out is built from the functions of [`pe_ir::model::Function`] and from choices; the rest is put together
//! from them: `min(a, b) = (a + b - |a - b|)/2`, `a^b = exp(b log(a))`, conditions as expressions above zero.

use crate::evaluate::fold::{ProductBuilder, SumBuilder, negate};
use crate::fault::{Budget, Fault, fault, not_finite};
use crate::language::functions;
use crate::syntax::ast::{Comparison, Connective};
use pe_ir::codes;
use pe_ir::model::{Expr, Function, Select};
use pe_ir::source::{Diagnostic, Span};
use pe_ir::turns;

/// Largest magnitude of the power of a variable; more is a mistake.
const LARGEST_POWER: u32 = 255;

/// A condition as far as it is known when the model is built.
pub(crate) enum Truth {
    Known(bool),
    /// It holds where the expression is above zero, or, if negated, where it is not.
    Depends {
        above_zero: Expr,
        negated: bool,
    },
}

impl Truth {
    pub(crate) fn not(self) -> Truth {
        match self {
            Truth::Known(holds) => Truth::Known(!holds),
            Truth::Depends { above_zero, negated } => Truth::Depends { above_zero, negated: !negated },
        }
    }

    /// `if this then yes else no`.
    pub(crate) fn choose(self, yes: Expr, no: Expr) -> Expr {
        match self {
            Truth::Known(true) => yes,
            Truth::Known(false) => no,
            _ if yes == no => yes,
            Truth::Depends { above_zero: condition, negated: false } => {
                Expr::Select(Box::new(Select { condition, yes, no }))
            }
            Truth::Depends { above_zero: condition, negated: true } => {
                Expr::Select(Box::new(Select { condition, yes: no, no: yes }))
            }
        }
    }

    /// Whether one expression compares with another.
    pub(crate) fn of_comparison(comparison: Comparison, left: &Expr, right: &Expr) -> Truth {
        if let (Some(left), Some(right)) = (left.as_constant(), right.as_constant()) {
            return Truth::Known(comparison.holds(left, right));
        }
        let above = |a: &Expr, b: &Expr| sum([(a.clone(), false), (b.clone(), true)]);
        let (above_zero, negated) = match comparison {
            Comparison::Greater => (above(left, right), false),
            Comparison::LessEqual => (above(left, right), true),
            Comparison::Less => (above(right, left), false),
            Comparison::GreaterEqual => (above(right, left), true),
            Comparison::Equal | Comparison::NotEqual => {
                let is_above = |a, b| Truth::Depends { above_zero: above(a, b), negated: false };
                let differs = is_above(right, left).choose(Expr::Constant(1.0), Expr::Constant(0.0));
                let differs = is_above(left, right).choose(Expr::Constant(1.0), differs);
                let truth = Truth::from_indicator(differs);
                return if comparison == Comparison::Equal { truth.not() } else { truth };
            }
        };
        match above_zero {
            Expr::Constant(number) => Truth::Known((number > 0.0) != negated),
            above_zero => Truth::Depends { above_zero, negated },
        }
    }

    /// Whether conditions hold together; the first that decides ends it, so that only then the others are looked at
    /// while the model runs.
    pub(crate) fn of_connective(
        connective: Connective,
        operands: impl IntoIterator<Item = Result<Truth, Fault>>,
    ) -> Result<Truth, Fault> {
        let decisive = connective == Connective::Or;
        let mut truths = Vec::new();
        for operand in operands {
            match operand? {
                Truth::Known(holds) if holds == decisive => {
                    truths.push(Truth::Known(decisive));
                    break;
                }
                Truth::Known(_) => {}
                truth => truths.push(truth),
            }
        }
        if truths.len() == 1 {
            return Ok(truths.remove(0));
        }
        let number = |holds: bool| Expr::Constant(if holds { 1.0 } else { 0.0 });
        let indicator = truths.into_iter().rev().fold(number(!decisive), |rest, truth| {
            if decisive { truth.choose(number(true), rest) } else { truth.choose(rest, number(false)) }
        });
        Ok(Truth::from_indicator(indicator))
    }

    /// Whether two conditions hold both or neither. Each is written down once, so that nesting stays small.
    pub(crate) fn same(one: Truth, other: Truth) -> Truth {
        let indicator = |truth: Truth| truth.choose(Expr::Constant(1.0), Expr::Constant(0.0));
        match (one, other) {
            (Truth::Known(holds), truth) | (truth, Truth::Known(holds)) => {
                if holds {
                    truth
                } else {
                    truth.not()
                }
            }
            (one, other) => {
                let apart = Expr::power(sum([(indicator(one), false), (indicator(other), true)]), 2);
                let above_zero = sum([(Expr::Constant(0.5), false), (apart, true)]);
                Truth::Depends { above_zero, negated: false }
            }
        }
    }

    /// From an expression that is 1 where the condition holds, else 0.
    fn from_indicator(indicator: Expr) -> Truth {
        match indicator {
            Expr::Constant(value) => Truth::Known(value > 0.5),
            indicator => {
                let above_zero = sum([(indicator, false), (Expr::Constant(0.5), true)]);
                Truth::Depends { above_zero, negated: false }
            }
        }
    }
}

fn sum<const N: usize>(members: [(Expr, bool); N]) -> Expr {
    let mut builder = SumBuilder::default();
    members.into_iter().for_each(|(member, negative)| builder.add(member, negative));
    builder.finish()
}

fn product(first: Expr, second: Expr) -> Expr {
    let mut builder = ProductBuilder::new(first);
    builder.multiply(second);
    builder.finish()
}

fn apply(function: Function, argument: Expr) -> Expr {
    Expr::Apply(function, Box::new(argument))
}

/// The exponent that a number is, if it is one of those that powers of expressions have.
fn whole(power: f64) -> Option<u32> {
    (0..=LARGEST_POWER).find(|whole| f64::from(*whole) == power)
}

/// `base^exponent` for an exponent that is no integer above 1.
fn real_power(base: Expr, exponent: f64) -> Expr {
    match exponent {
        -1.0 => apply(Function::Reciprocal, base),
        0.5 => apply(Function::Sqrt, base),
        _ => apply(Function::RealPower(exponent), base),
    }
}

/// `1/expr`, with the coefficient inverted and powers and exponentials taken in.
pub(crate) fn reciprocal(expr: Expr) -> Expr {
    match expr {
        Expr::Constant(number) => Expr::Constant(1.0 / number),
        Expr::Product(mut factors) => match factors[0] {
            Expr::Constant(coefficient) => {
                factors.remove(0);
                let rest = if factors.len() == 1 { factors.remove(0) } else { Expr::Product(factors) };
                product(Expr::Constant(1.0 / coefficient), reciprocal(rest))
            }
            _ => apply(Function::Reciprocal, Expr::Product(factors)),
        },
        Expr::Power(base, exponent) => real_power(*base, -f64::from(exponent)),
        Expr::Apply(Function::Exp, argument) => apply(Function::Exp, negate(*argument)),
        Expr::Apply(Function::Sqrt, argument) => real_power(*argument, -0.5),
        Expr::Apply(Function::RealPower(exponent), base) => match whole(-exponent) {
            Some(whole) if whole > 1 => Expr::Power(base, whole),
            _ => real_power(*base, -exponent),
        },
        expr => apply(Function::Reciprocal, expr),
    }
}

/// The function of one variable with this name in specs, and what its value is multiplied by.
fn of_one_variable(name: &str) -> Option<(Function, f64)> {
    let function = match name {
        "sqrt" => Function::Sqrt,
        "exp" => Function::Exp,
        "log" => Function::Log,
        "log2" => return Some((Function::Log, 1.0 / core::f64::consts::LN_2)),
        "log10" => return Some((Function::Log, 1.0 / core::f64::consts::LN_10)),
        "sin" => Function::Sin,
        "cos" => Function::Cos,
        "tan" => Function::Tan,
        "asin" => Function::Asin,
        "acos" => Function::Acos,
        "atan" => Function::Atan,
        "sinh" => Function::Sinh,
        "cosh" => Function::Cosh,
        "tanh" => Function::Tanh,
        "abs" => Function::Abs,
        "sign" => Function::Sign,
        _ => return None,
    };
    Some((function, 1.0))
}

/// A power of something that is no number; the places are those of the power and of its exponent.
pub(crate) fn power(base: Expr, exponent: Expr, span: Span, exponent_span: Span) -> Result<Expr, Fault> {
    let no_number = |base: f64, power: f64| fault(not_finite(span, &format!("{base}^{power} is not a finite number")));
    match (base, exponent) {
        (Expr::Constant(base), Expr::Constant(power)) => match libm::pow(base, power) {
            result if result.is_finite() => Ok(Expr::Constant(result)),
            _ => Err(no_number(base, power)),
        },
        (_, Expr::Constant(power)) if power.abs() > f64::from(LARGEST_POWER) => {
            let message = format!("a variable cannot be raised to the power {power}");
            let help = format!("powers of variables range from -{LARGEST_POWER} to {LARGEST_POWER}");
            Err(fault(Diagnostic::error(codes::BAD_POWER, exponent_span, message).with_help(help)))
        }
        (base, Expr::Constant(power)) => Ok(match whole(power) {
            Some(whole) => Expr::power(base, whole),
            None => real_power(base, power),
        }),
        (Expr::Constant(base), power) => {
            let logarithm = libm::log(base);
            if !logarithm.is_finite() {
                let message = format!("{base} cannot be raised to a variable power");
                return Err(fault(not_finite(span, &message)));
            }
            let argument = product(Expr::Constant(logarithm), power);
            Ok(if argument == Expr::Constant(0.0) { Expr::Constant(1.0) } else { apply(Function::Exp, argument) })
        }
        (base, power) => Ok(apply(Function::Exp, product(power, apply(Function::Log, base)))),
    }
}

/// A function of the language of these arguments, each with its place.
pub(crate) fn call(
    function: &functions::Function,
    arguments: Vec<(Expr, Span)>,
    span: Span,
    budget: &mut Budget,
) -> Result<Expr, Fault> {
    let numbers: Option<Vec<f64>> = arguments.iter().map(|(value, _)| value.as_constant()).collect();
    if let Some(numbers) = numbers {
        let result = function.apply(&numbers);
        if result.is_finite() {
            return Ok(Expr::Constant(result));
        }
        let shown: Vec<String> = numbers.iter().take(4).map(f64::to_string).collect();
        let message = format!("{}({}) is not a finite number", function.name, shown.join(", "));
        return Err(fault(not_finite(span, &message)));
    }
    let minimum = function.name == "min";
    if minimum || function.name == "max" {
        return extreme(arguments.into_iter().map(|(value, _)| value).collect(), minimum, span, budget);
    }
    if ROUNDING.contains(&function.name) {
        return rounded(function.name, arguments.into_iter().map(|(value, _)| value).collect(), span, budget);
    }
    if function.name == "wrap" {
        let turns = arguments.into_iter().map(|(value, _)| product(Expr::Constant(1.0 / turns::RADIANS), value)).next();
        let turns = turns.unwrap_or(Expr::Constant(0.0));
        return Ok(product(Expr::Constant(turns::RADIANS), apply(Function::Wrap, turns)));
    }
    match (of_one_variable(function.name), arguments.into_iter().next()) {
        (Some((function, scale)), Some((argument, _))) => Ok(product(Expr::Constant(scale), apply(function, argument))),
        _ => unreachable!("`{}` is none of the functions of the language", function.name),
    }
}

/// Functions that make whole numbers, and what is left.
const ROUNDING: [&str; 5] = ["floor", "ceil", "round", "quotient", "mod"];

/// A function of [`ROUNDING`].
fn rounded(name: &str, arguments: Vec<Expr>, span: Span, budget: &mut Budget) -> Result<Expr, Fault> {
    let down = |expr| apply(Function::Floor, expr);
    let mut arguments = arguments.into_iter();
    let (Some(first), second) = (arguments.next(), arguments.next()) else { return Ok(Expr::Constant(0.0)) };
    // Away from zero by half, or towards zero.
    let of_magnitude = |expr: Expr, more: f64| {
        let magnitude = sum([(apply(Function::Abs, expr.clone()), false), (Expr::Constant(more), false)]);
        product(apply(Function::Sign, expr), down(magnitude))
    };
    let Some(divisor) = second else {
        budget.read(size(&first).0, span)?;
        return Ok(match name {
            "ceil" => negate(down(negate(first))),
            "round" => of_magnitude(first, 0.5),
            _ => down(first),
        });
    };
    budget.read(2 * (size(&first).0 + size(&divisor).0), span)?;
    let mut ratio = ProductBuilder::new(first.clone());
    match divisor.as_constant() {
        Some(0.0) => return Err(fault(not_finite(span, "division by zero"))),
        Some(number) => ratio.divide(number),
        None => ratio.multiply(reciprocal(divisor.clone())),
    }
    if name == "quotient" {
        return Ok(of_magnitude(ratio.finish(), 0.0));
    }
    Ok(sum([(first, false), (product(divisor, down(ratio.finish())), true)]))
}

/// Smallest or largest of some expressions, in pairs of halves, so that nesting stays flat.
fn extreme(mut values: Vec<Expr>, minimum: bool, span: Span, budget: &mut Budget) -> Result<Expr, Fault> {
    while values.len() > 1 {
        let mut halved = Vec::with_capacity(values.len().div_ceil(2));
        let mut rest = values.into_iter();
        while let Some(first) = rest.next() {
            halved.push(match rest.next() {
                None => first,
                Some(second) => extreme_of_two(first, second, minimum, span, budget)?,
            });
        }
        values = halved;
    }
    Ok(values.pop().unwrap_or(Expr::Constant(0.0)))
}

/// `(a + b -+ |a - b|)/2`.
fn extreme_of_two(a: Expr, b: Expr, minimum: bool, span: Span, budget: &mut Budget) -> Result<Expr, Fault> {
    if let (Some(a), Some(b)) = (a.as_constant(), b.as_constant()) {
        return Ok(Expr::Constant(if minimum { libm::fmin(a, b) } else { libm::fmax(a, b) }));
    }
    budget.read(size(&a).0 + size(&b).0, span)?;
    let half = |expr| product(Expr::Constant(0.5), expr);
    let distance = apply(Function::Abs, sum([(a.clone(), false), (b.clone(), true)]));
    Ok(sum([(half(sum([(a, false), (b, false)])), false), (half(distance), minimum)]))
}

/// Variables read by an expression, and its depth.
pub(crate) fn size(expr: &Expr) -> (u64, usize) {
    match expr {
        Expr::Constant(_) => (0, 1),
        Expr::Variable(_) => (1, 1),
        Expr::Sum(members) | Expr::Product(members) => {
            let (reads, depth) = members.iter().map(size).fold((0, 0), |all, one| (all.0 + one.0, all.1.max(one.1)));
            (reads, depth + 1)
        }
        Expr::Power(base, _) | Expr::Apply(_, base) => {
            let (reads, depth) = size(base);
            (reads, depth + 1)
        }
        Expr::Select(select) => {
            let parts = [&select.condition, &select.yes, &select.no].map(size);
            (parts.iter().map(|part| part.0).sum(), parts.iter().map(|part| part.1).max().unwrap_or(0) + 1)
        }
        Expr::Solution(_) => (1, 1),
    }
}
