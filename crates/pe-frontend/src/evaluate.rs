//! Evaluates bound expressions for given index values: to a number where everything is constant, else to an
//! expression over the flat variables.

use crate::ast::{Connective, Factor, Sign};
use crate::bound::{BoundRange, Condition, Node, NodeKind, SumOver};
use crate::defined::{SIGNALS, Signals};
use crate::elementary::reciprocal;
use crate::fold::{ProductBuilder, SumBuilder, negate};
use crate::functions::modulo;
use crate::names::{Kind, MOST_DIMENSIONS, NO_EQUATION, Names};
use crate::signals::{SAMPLES, WAVEFORMS};
use pe_ir::codes;
use pe_ir::model::{Expr, Variable, Waveform};
use pe_ir::source::{Diagnostic, Span};
use std::sync::Arc;

/// Integers up to this size are exact in double precision.
const LARGEST_INTEGER: f64 = 9_007_199_254_740_992.0;

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
    Argument(&'static str),
    Integer,
    /// Values before time zero, bounds, waveform arguments.
    Constant,
}

/// Index values and remaining work.
#[derive(Debug)]
pub(crate) struct Evaluator {
    /// Values of the indices in scope, outermost first.
    pub(crate) frame: Vec<i64>,
    /// Arguments of the functions in progress, and the place of the first one of the innermost.
    pub(crate) arguments: Vec<Expr>,
    pub(crate) first_argument: usize,
    /// Expressions that may still be evaluated.
    work: u64,
    /// Variables that may still be read; bounds the memory of the result.
    pub(crate) reads: u64,
    /// Signals of the model.
    pub(crate) signals: Signals,
    /// Signals that the signal of an input is made of; none in equations.
    pub(crate) parts: Option<Vec<Waveform>>,
    /// Span of the model in seconds.
    pub(crate) span: f64,
    /// Whether all left-hand sides are known; before, any algebraic element may still get its equation.
    pub(crate) left_sides_known: bool,
}

impl Evaluator {
    pub(crate) fn new(work: u64, reads: u64) -> Self {
        let (frame, arguments, signals) = (Vec::new(), Vec::new(), Signals::default());
        let (parts, span) = (None, 1.0);
        Evaluator { frame, arguments, first_argument: 0, work, reads, signals, parts, span, left_sides_known: false }
    }

    /// The value of an expression over variables.
    pub(crate) fn expr(&mut self, names: &Names, node: &Node) -> Result<Expr, Fault> {
        self.spend(node.span)?;
        match &node.kind {
            NodeKind::Number(value) => Ok(Expr::Constant(*value)),
            NodeKind::Index(place) => Ok(Expr::Constant(self.frame[*place] as f64)),
            NodeKind::Element(quantity, subscripts) => self.element(names, *quantity, subscripts, node.span),
            NodeKind::Sum(terms) => {
                let mut sum = SumBuilder::default();
                for (sign, term) in terms {
                    sum.add(self.expr(names, term)?, *sign == Sign::Minus);
                }
                finish_sum(sum, node.span)
            }
            NodeKind::Product(first, rest) => self.product(names, first, rest, node.span),
            NodeKind::Power(base, exponent) => self.power(names, base, exponent, node.span),
            NodeKind::Negate(operand) => Ok(negate(self.expr(names, operand)?)),
            NodeKind::If(condition, yes, no) => self.choice(names, condition, yes, no),
            NodeKind::SumOver(sum) => self.sum_over(names, sum, node.span),
            NodeKind::Call(function, arguments) => self.call(names, function, arguments, node.span),
            NodeKind::Time => {
                let span = self.span;
                Ok(self.part(|| Waveform::Time { span }).unwrap_or_else(|| self.time(node.span)))
            }
            NodeKind::Signal(number, arguments) => {
                let waveform = self.signal(names, *number, arguments)?;
                match self.part(|| waveform.clone()) {
                    Some(part) => Ok(part),
                    None => self.defined(WAVEFORMS[*number].0, waveform, node.span),
                }
            }
            NodeKind::Samples(samples) => {
                let waveform = Waveform::Samples(Arc::clone(samples));
                match self.part(|| waveform.clone()) {
                    Some(part) => Ok(part),
                    None => self.defined(SAMPLES, waveform, node.span),
                }
            }
            NodeKind::Argument(place) => self.argument(*place, node.span),
            NodeKind::Inline(arguments, body) => self.inline(names, arguments, body, node.span),
            NodeKind::Matrix(quantity, cells) => {
                let quantity = &names.quantities[*quantity];
                let offset = quantity.offset(&self.frame[..quantity.rank]).map_err(|_| Fault::Silent)?;
                self.expr(names, cells.get(offset).ok_or(Fault::Silent)?)
            }
            NodeKind::Data(quantity, values) => {
                let quantity = &names.quantities[*quantity];
                let offset = quantity.offset(&self.frame[..quantity.rank]).map_err(|_| Fault::Silent)?;
                values.get(offset).map(|value| Expr::Constant(*value)).ok_or(Fault::Silent)
            }
        }
    }

    /// What stands for a part of the signal of an input that is being evaluated; none in equations.
    fn part(&mut self, part: impl FnOnce() -> Waveform) -> Option<Expr> {
        let parts = self.parts.as_mut()?;
        parts.push(part());
        Some(Expr::Variable(Variable::Input(SIGNALS + parts.len() as u32 - 1)))
    }

    /// The value of an expression that must be constant.
    pub(crate) fn number(&mut self, names: &Names, node: &Node, purpose: Purpose) -> Result<f64, Fault> {
        match self.expr(names, node)? {
            Expr::Constant(value) => Ok(value),
            _ => Err(fault(not_constant(node.span, purpose))),
        }
    }

    /// The value of an expression that must be a constant integer.
    pub(crate) fn integer(&mut self, names: &Names, node: &Node) -> Result<i64, Fault> {
        let value = self.number(names, node, Purpose::Integer)?;
        if value != libm::floor(value) {
            let message = format!("{value} is not an integer");
            let help = "round it with `floor`, `ceil` or `round`, or divide with `div`";
            return Err(fault(Diagnostic::error(codes::NOT_INTEGER, node.span, message).with_help(help)));
        }
        if value.abs() > LARGEST_INTEGER {
            let message = format!("{value:e} is too large for an integer");
            return Err(fault(Diagnostic::error(codes::NOT_INTEGER, node.span, message)));
        }
        Ok(value as i64)
    }

    /// Whether a condition holds.
    pub(crate) fn condition(&mut self, names: &Names, condition: &Condition) -> Result<bool, Fault> {
        match condition {
            Condition::Compare(comparison, left, right) => {
                let left = self.number(names, left, Purpose::Condition)?;
                let right = self.number(names, right, Purpose::Condition)?;
                Ok(comparison.holds(left, right))
            }
            Condition::Logical(connective, operands) => {
                // Stops at the first operand that decides: the others may be out of range.
                let decisive = *connective == Connective::Or;
                for operand in operands {
                    if self.condition(names, operand)? == decisive {
                        return Ok(decisive);
                    }
                }
                Ok(!decisive)
            }
            Condition::Not(operand) => Ok(!self.condition(names, operand)?),
        }
    }

    /// First and last value of an index.
    pub(crate) fn range(&mut self, names: &Names, range: &BoundRange) -> Result<(i64, i64), Fault> {
        match range {
            BoundRange::Index(number) => names.indices[*number].range.ok_or(Fault::Silent),
            BoundRange::Own(low, high) => Ok((self.integer(names, low)?, self.integer(names, high)?)),
        }
    }

    fn spend(&mut self, span: Span) -> Result<(), Fault> {
        match self.work.checked_sub(1) {
            Some(left) => self.work = left,
            None => return Err(fault(too_large(span))),
        }
        Ok(())
    }

    fn element(&mut self, names: &Names, number: usize, subscripts: &[Node], span: Span) -> Result<Expr, Fault> {
        let quantity = &names.quantities[number];
        if quantity.broken {
            return Err(Fault::Silent);
        }
        let mut values = [0; MOST_DIMENSIONS];
        for (value, subscript) in values.iter_mut().zip(subscripts) {
            *value = self.integer(names, subscript)?;
        }
        let values = &values[..subscripts.len().min(MOST_DIMENSIONS)];
        if quantity.kind == Kind::Algebraic && !self.left_sides_known {
            // Left-hand sides may read constants only; that this is none is all that matters.
            return Ok(Expr::Variable(Variable::Algebraic(0)));
        }
        let offset = match quantity.offset(values) {
            Ok(offset) => offset,
            Err(_) if quantity.kind == Kind::Algebraic => {
                return Err(fault(no_such_element(names, number, values, span)));
            }
            Err(dimension) => {
                let span = subscripts.get(dimension).map_or(span, |subscript| subscript.span);
                return Err(fault(out_of_range(names, number, values, dimension, span)));
            }
        };
        let variable = match quantity.kind {
            Kind::Const | Kind::Param => {
                let value = quantity.values[offset];
                return if value.is_nan() { Err(Fault::Missing(number, offset)) } else { Ok(Expr::Constant(value)) };
            }
            Kind::Input => Variable::Input(quantity.base + offset as u32),
            Kind::State => Variable::State(quantity.base + offset as u32),
            Kind::Algebraic if quantity.defined_by[offset] == NO_EQUATION => {
                return Err(fault(no_such_element(names, number, values, span)));
            }
            Kind::Algebraic => Variable::Algebraic(quantity.base + offset as u32),
        };
        match self.reads.checked_sub(1) {
            Some(left) => self.reads = left,
            None => return Err(fault(too_large(span))),
        }
        Ok(Expr::Variable(variable))
    }

    fn product(&mut self, names: &Names, first: &Node, rest: &[(Factor, Node)], span: Span) -> Result<Expr, Fault> {
        let mut product = ProductBuilder::new(self.expr(names, first)?);
        for (factor, operand) in rest {
            match factor {
                Factor::Multiply => product.multiply(self.expr(names, operand)?),
                Factor::Divide => match self.expr(names, operand)? {
                    Expr::Constant(0.0) => return Err(fault(not_finite(operand.span, "division by zero"))),
                    Expr::Constant(divisor) => product.divide(divisor),
                    divisor => product.multiply(reciprocal(divisor)),
                },
                Factor::IntegerDivide | Factor::Modulo => {
                    let divisor = self.integer(names, operand)? as f64;
                    let dividend =
                        product.constant().ok_or_else(|| fault(not_constant(first.span, Purpose::Integer)))?;
                    if dividend != libm::floor(dividend) {
                        let message = format!("{dividend} is not an integer");
                        return Err(fault(Diagnostic::error(codes::NOT_INTEGER, first.span, message)));
                    }
                    if divisor == 0.0 {
                        return Err(fault(not_finite(operand.span, "division by zero")));
                    }
                    let remainder = modulo(dividend, divisor);
                    // Exact: the difference is a multiple of the divisor.
                    let quotient = (dividend - remainder) / divisor;
                    product.set_constant(if *factor == Factor::Modulo { remainder } else { quotient });
                }
            }
            if !product.is_finite() {
                return Err(fault(not_finite(span, "the product is too large")));
            }
        }
        Ok(product.finish())
    }

    fn sum_over(&mut self, names: &Names, sum_over: &SumOver, span: Span) -> Result<Expr, Fault> {
        let (low, high) = self.range(names, &sum_over.range)?;
        let mut sum = SumBuilder::default();
        let place = self.frame.len();
        for value in low..=high {
            self.frame.push(value);
            let term = self.term(names, sum_over);
            self.frame.truncate(place);
            if let Some(term) = term? {
                sum.add(term, false);
            }
        }
        finish_sum(sum, span)
    }

    /// One term of a sum, `None` where its condition does not hold.
    fn term(&mut self, names: &Names, sum: &SumOver) -> Result<Option<Expr>, Fault> {
        if let Some(condition) = &sum.condition
            && !self.condition(names, condition)?
        {
            // Conditions cost work, too, or an empty sum could run for ever.
            self.spend(sum.body.span)?;
            return Ok(None);
        }
        self.expr(names, &sum.body).map(Some)
    }
}

fn finish_sum(sum: SumBuilder, span: Span) -> Result<Expr, Fault> {
    if sum.is_finite() { Ok(sum.finish()) } else { Err(fault(not_finite(span, "the sum is too large"))) }
}

pub(crate) fn fault(diagnostic: Diagnostic) -> Fault {
    Fault::Report(Box::new(diagnostic))
}

pub(crate) fn not_finite(span: Span, reason: &str) -> Diagnostic {
    Diagnostic::error(codes::NOT_FINITE, span, reason)
}

pub(crate) fn too_large(span: Span) -> Diagnostic {
    Diagnostic::error(codes::TOO_MUCH_WORK, span, "the model takes too much work to write out; the limit is met here")
        .with_help("look for a sum or an index range that is larger than intended")
}

pub(crate) fn not_constant(span: Span, purpose: Purpose) -> Diagnostic {
    let (code, message, help) = match purpose {
        Purpose::Condition => (
            codes::VARIABLE_CONDITION,
            "the condition depends on a variable".to_owned(),
            "`where` chooses between equations when the model is built; it can read indices and constants only. `if` can read variables",
        ),
        Purpose::Argument(function) => (
            codes::VARIABLE_ARGUMENT,
            format!("`{function}` of a variable cannot be computed"),
            "add up its steps: where 0 <= x < 10, `sum(k in 1..9: if x >= k then 1 else 0)` is `floor(x)`",
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

fn out_of_range(names: &Names, number: usize, subscripts: &[i64], dimension: usize, span: Span) -> Diagnostic {
    let quantity = &names.quantities[number];
    let place = ["first", "second", "third"].get(dimension).filter(|_| quantity.rank > 1);
    let which = place.map_or_else(|| "its subscript".to_owned(), |place| format!("the {place} subscript"));
    let (low, high) = quantity.dimensions.get(dimension).map_or((0, 0), |extent| (extent.low, extent.high));
    let message = format!("`{}` does not exist: {which} runs from {low} to {high}", quantity.element_name(subscripts));
    Diagnostic::error(codes::OUT_OF_RANGE, span, message).with_label(quantity.name.span, "defined here")
}

fn no_such_element(names: &Names, number: usize, subscripts: &[i64], span: Span) -> Diagnostic {
    let quantity = &names.quantities[number];
    let message = format!("no equation defines `{}`", quantity.element_name(subscripts));
    Diagnostic::error(codes::NO_SUCH_ELEMENT, span, message)
        .with_label(quantity.name.span, "other elements are defined here")
}
