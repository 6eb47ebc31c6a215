//! Evaluates bound expressions for given index values: to a number where everything is constant, else to an
//! expression over the flat variables.

use crate::bind::rows;
use crate::bound::{Body, BoundRange, Condition, DEEPEST_BODY, Node, NodeKind, Rows, SumOver};
use crate::evaluate::delays;
use crate::evaluate::elementary::{self, Truth, reciprocal, size};
use crate::evaluate::fold::{ProductBuilder, SumBuilder, negate};
use crate::evaluate::signals::{SIGNALS, Signals};
use crate::evaluate::systems::Systems;
use crate::fault::{Budget, Fault, Purpose, fault, not_constant, not_finite};
use crate::language::functions::modulo;
use crate::language::measures::scaled;
use crate::language::waveforms::{Argument, SAMPLES, WAVEFORMS, waveform_of};
use crate::names::table::{Kind, MOST_DIMENSIONS, Names};
use crate::syntax::ast::{Connective, Factor, Sign};
use pe_ir::codes;
use pe_ir::index::{at, number as number_of};
use pe_ir::model::{Expr, Formula, Variable, Waveform};
use pe_ir::source::{Diagnostic, Span};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Integers up to this size are exact in double precision.
const LARGEST_INTEGER: f64 = 9_007_199_254_740_992.0;

/// Index values and remaining work.
#[derive(Debug)]
pub(crate) struct Evaluator {
    /// Values of the indices in scope, outermost first.
    pub(crate) frame: Vec<i64>,
    /// Arguments of the functions in progress, and the place of the first one of the innermost.
    arguments: Vec<Expr>,
    first_argument: usize,
    budget: Budget,
    /// Signals of the model.
    pub(crate) signals: Signals,
    /// Signals that the signal of an input is made of; none in equations.
    parts: Option<Vec<Waveform>>,
    /// Whether all left-hand sides are known; before, any algebraic element may still get its equation.
    pub(crate) left_sides_known: bool,
    /// Linear systems.
    systems: Systems,
    /// The sums by their places, with what was empty first in those that have had no term.
    pub(crate) sums: BTreeMap<Span, Option<Empty>>,
}

/// What a sum without terms is over.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Empty {
    /// A range of whole numbers.
    Range(i64, i64),
    /// Rows of a data file.
    Rows,
}

impl Evaluator {
    pub(crate) fn new(work: u64, reads: u64) -> Self {
        let (frame, arguments, signals, budget) =
            (Vec::new(), Vec::new(), Signals::default(), Budget { work, reads, stop: None });
        Evaluator {
            frame,
            arguments,
            first_argument: 0,
            budget,
            signals,
            parts: None,
            left_sides_known: false,
            systems: Systems::default(),
            sums: BTreeMap::new(),
        }
    }

    /// Ends the evaluation early when its result is no longer wanted.
    pub(crate) fn stop_on(&mut self, stop: Option<Arc<AtomicBool>>) {
        self.budget.stop = stop;
    }

    /// The value of an expression over variables.
    pub(crate) fn expr(&mut self, names: &Names, node: &Node) -> Result<Expr, Fault> {
        self.budget.spend(node.span)?;
        match &node.kind {
            NodeKind::Number(value) => Ok(Expr::Constant(*value)),
            NodeKind::Index(place) => Ok(Expr::Constant(self.frame[*place] as f64)),
            NodeKind::Cell(place, cells) => {
                let row = usize::try_from(self.frame[*place]).ok();
                row.and_then(|row| cells.get(row)).map(|cell| Expr::Constant(*cell)).ok_or(Fault::Silent)
            }
            NodeKind::Element(quantity, subscripts) => self.element(names, *quantity, subscripts, node.span),
            NodeKind::Sum(terms) => {
                let mut sum = SumBuilder::default();
                for (sign, term) in terms {
                    sum.add(self.expr(names, term)?, *sign == Sign::Minus);
                }
                finish_sum(sum, node.span)
            }
            NodeKind::Product(first, rest) => self.product(names, first, rest, node.span),
            NodeKind::Power(base, exponent) => {
                let (power, base) = (self.expr(names, exponent)?, self.expr(names, base)?);
                elementary::power(base, power, node.span, exponent.span)
            }
            NodeKind::Negate(operand) => Ok(negate(self.expr(names, operand)?)),
            NodeKind::If(condition, yes, no) => self.choice(names, condition, yes, no),
            NodeKind::SumOver(sum) => self.sum_over(names, sum, node.span),
            NodeKind::Call(function, arguments) => {
                let value = |argument: &Node| Ok((self.expr(names, argument)?, argument.span));
                let arguments = arguments.iter().map(value).collect::<Result<Vec<_>, Fault>>()?;
                elementary::call(function, arguments, node.span, &mut self.budget)
            }
            NodeKind::Time => {
                let span = self.signals.span;
                let per_second = self.signals.unit.per_second();
                match self.part(|| Waveform::Time { span }) {
                    Some(seconds) => Ok(Expr::scaled(per_second, seconds)),
                    None => Ok(self.signals.time(node.span)),
                }
            }
            NodeKind::Signal(number, arguments) => {
                let waveform = self.signal(names, *number, arguments)?;
                Ok(self.played(WAVEFORMS[*number].0, waveform, node.span))
            }
            NodeKind::Samples(samples) => Ok(self.played(SAMPLES, Waveform::Samples(Arc::clone(samples)), node.span)),
            NodeKind::Argument(place) => self.argument(*place, node.span),
            NodeKind::Inline(arguments, body) => self.inline(names, arguments, body, node.span),
            NodeKind::Matrix(quantity, cells) => {
                let quantity = &names.quantities[*quantity];
                let offset = quantity.offset(&self.frame[..quantity.rank]).map_err(|_| Fault::Silent)?;
                self.expr(names, cells.get(offset).ok_or(Fault::Silent)?)
            }
            NodeKind::Solved(matrix, right, subscripts) => {
                let mut values = [0; 2];
                for (value, subscript) in values.iter_mut().zip(subscripts) {
                    *value = self.integer(names, subscript)?;
                }
                let values = &values[..subscripts.len().min(2)];
                self.systems.solution(names, *matrix, *right, values, node.span)
            }
            NodeKind::Delayed(element, delay, scale) => {
                let expr = self.expr(names, element)?;
                let seconds = match self.expr(names, delay)? {
                    Expr::Constant(value) => scaled(value, *scale),
                    _ => return Err(fault(delays::varies(delay.span))),
                };
                delays::check(seconds, delay.span).map_err(fault)?;
                Ok(self.signals.delayed(expr, seconds, node.span))
            }
            NodeKind::Data(quantity, values) => {
                let quantity = &names.quantities[*quantity];
                let offset = quantity.offset(&self.frame[..quantity.rank]).map_err(|_| Fault::Silent)?;
                values.get(offset).map(|value| Expr::Constant(*value)).ok_or(Fault::Silent)
            }
        }
    }

    /// What stands for a signal: a part of that of an input, or what the network plays.
    fn played(&mut self, name: &str, waveform: Waveform, span: Span) -> Expr {
        match self.part(|| waveform.clone()) {
            Some(part) => part,
            None => self.signals.defined(name, waveform, span),
        }
    }

    /// What stands for a part of the signal of an input that is being evaluated; none in equations.
    fn part(&mut self, part: impl FnOnce() -> Waveform) -> Option<Expr> {
        let parts = self.parts.as_mut()?;
        parts.push(part());
        Some(Expr::Variable(Variable::Input(SIGNALS + number_of(parts.len()) - 1)))
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
            Condition::Same { one, other, negated } => {
                let same = self.condition(names, one)? == self.condition(names, other)?;
                Ok(same != *negated)
            }
        }
    }

    /// First and last value of an index.
    pub(crate) fn range(&mut self, names: &Names, range: &BoundRange) -> Result<(i64, i64), Fault> {
        match range {
            BoundRange::Index(number) => names.indices[*number].range.ok_or(Fault::Silent),
            BoundRange::Own(low, high) => Ok((self.integer(names, low)?, self.integer(names, high)?)),
            BoundRange::Rows(rows) => Ok((0, rows.places.len() as i64 - 1)),
        }
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
        if let Err(dimension) = quantity.offset(values)
            && (quantity.kind != Kind::Algebraic || quantity.matrix.is_some())
        {
            let span = subscripts.get(dimension).map_or(span, |subscript| subscript.span);
            return Err(fault(out_of_range(names, number, values, dimension, span)));
        }
        let element = element(names, number, values, span)?;
        self.budget.read(1, span)?;
        Ok(element)
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
        if let BoundRange::Rows(rows) = &sum_over.range {
            return self.sum_over_rows(names, (sum_over, rows), span);
        }
        let (low, high) = self.range(names, &sum_over.range)?;
        self.sums_over(span, (low > high).then_some(Empty::Range(low, high)));
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

    /// Notes whether a sum is empty here.
    fn sums_over(&mut self, span: Span, empty: Option<Empty>) {
        let known = self.sums.entry(span).or_insert(empty);
        *known = known.and(empty).and(*known);
    }

    /// A sum over rows of a data file: those that have the number that the condition says, or all.
    fn sum_over_rows(&mut self, names: &Names, (over, rows): (&SumOver, &Rows), span: Span) -> Result<Expr, Fault> {
        let mut sum = SumBuilder::default();
        let place = self.frame.len();
        let mut add = |evaluator: &mut Evaluator, row: usize| {
            evaluator.frame.push(row as i64);
            let term = evaluator.term(names, over);
            evaluator.frame.truncate(place);
            match term {
                Ok(Some(term)) => sum.add(term, false),
                Ok(None) => {}
                Err(Fault::Report(finding)) => return Err(fault(finding.with_label(rows.places[row], "of this row"))),
                Err(other) => return Err(other),
            }
            Ok(())
        };
        let count = match &rows.chosen {
            Some((by_number, number)) => {
                let wanted = rows::bits(self.number(names, number, Purpose::Condition)?);
                let chosen = by_number.get(&wanted).map_or(&[][..], |chosen| chosen);
                chosen.iter().try_for_each(|row| add(self, at(*row)))?;
                chosen.len()
            }
            None => {
                (0..rows.places.len()).try_for_each(|row| add(self, row))?;
                rows.places.len()
            }
        };
        self.sums_over(span, (count == 0).then_some(Empty::Rows));
        finish_sum(sum, span)
    }

    /// One term of a sum, `None` where its condition does not hold.
    fn term(&mut self, names: &Names, sum: &SumOver) -> Result<Option<Expr>, Fault> {
        if let Some(condition) = &sum.condition
            && !self.condition(names, condition)?
        {
            // Conditions cost work, too, or an empty sum could run for ever.
            self.budget.spend(sum.body.span)?;
            return Ok(None);
        }
        self.expr(names, &sum.body).map(Some)
    }

    /// `if condition then yes else no`; a condition that is known decides which of the two is looked at.
    fn choice(&mut self, names: &Names, condition: &Condition, yes: &Node, no: &Node) -> Result<Expr, Fault> {
        match self.truth(names, condition)? {
            Truth::Known(holds) => self.expr(names, if holds { yes } else { no }),
            truth => {
                let (yes, no) = (self.expr(names, yes), self.expr(names, no));
                Ok(truth.choose(yes?, no?))
            }
        }
    }

    /// Whether a condition of variables holds.
    fn truth(&mut self, names: &Names, condition: &Condition) -> Result<Truth, Fault> {
        match condition {
            Condition::Compare(comparison, left, right) => {
                let (left, right) = (self.expr(names, left)?, self.expr(names, right)?);
                Ok(Truth::of_comparison(*comparison, &left, &right))
            }
            Condition::Logical(connective, operands) => {
                Truth::of_connective(*connective, operands.iter().map(|operand| self.truth(names, operand)))
            }
            Condition::Not(operand) => Ok(self.truth(names, operand)?.not()),
            Condition::Same { one, other, negated } => {
                let same = Truth::same(self.truth(names, one)?, self.truth(names, other)?);
                Ok(if *negated { same.not() } else { same })
            }
        }
    }

    /// An argument of the innermost function. Each use is a copy, so each counts as reading its variables.
    fn argument(&mut self, place: usize, span: Span) -> Result<Expr, Fault> {
        let argument = &self.arguments[self.first_argument + place];
        self.budget.read(size(argument).0, span)?;
        Ok(argument.clone())
    }

    /// The body of a function for these arguments.
    fn inline(&mut self, names: &Names, arguments: &[Node], body: &Body, span: Span) -> Result<Expr, Fault> {
        let first = self.arguments.len();
        for argument in arguments {
            match self.expr(names, argument) {
                Ok(value) => self.arguments.push(value),
                Err(fault) => {
                    self.arguments.truncate(first);
                    return Err(fault);
                }
            }
        }
        let frame = std::mem::take(&mut self.frame);
        let outer = std::mem::replace(&mut self.first_argument, first);
        let value = self.expr(names, &body.node);
        (self.frame, self.first_argument) = (frame, outer);
        self.arguments.truncate(first);
        match value {
            Ok(value) if size(&value).1 > DEEPEST_BODY => {
                let message = "calls of functions nest too deeply";
                Err(fault(Diagnostic::error(codes::TOO_DEEP, span, message)))
            }
            Err(Fault::Report(diagnostic)) => Err(fault(diagnostic.with_label(span, "called from here"))),
            value => value,
        }
    }

    /// A signal by its number in [`WAVEFORMS`].
    fn signal(&mut self, names: &Names, number: usize, arguments: &[(Node, f64)]) -> Result<Waveform, Fault> {
        let (mut values, mut duty) = (Vec::with_capacity(arguments.len()), Waveform::Constant(0.0));
        for ((node, scale), (_, kind)) in arguments.iter().zip(WAVEFORMS[number].1) {
            if *kind == Argument::Modulation {
                duty = self.formula(names, node)?;
                continue;
            }
            let value = scaled(self.number(names, node, Purpose::Constant)?, *scale);
            if !value.is_finite() {
                return Err(fault(Diagnostic::error(codes::NOT_FINITE, node.span, "the value is too large")));
            }
            values.push(value);
        }
        let spans: Vec<Span> = arguments.iter().map(|(node, _)| node.span).collect();
        waveform_of(number, &values, duty, &spans).map_err(fault)
    }

    /// An expression of signals as one signal.
    pub(crate) fn formula(&mut self, names: &Names, node: &Node) -> Result<Waveform, Fault> {
        let outer = self.parts.replace(Vec::new());
        let expr = self.expr(names, node);
        let mut parts = std::mem::replace(&mut self.parts, outer).unwrap_or_default();
        let waveform = match expr? {
            Expr::Constant(value) => Waveform::Constant(value),
            Expr::Variable(Variable::Input(part)) => parts.swap_remove(at(part - SIGNALS)),
            expr => {
                let part = |variable| match variable {
                    Variable::Input(part) => Variable::Input(part - SIGNALS),
                    other => other,
                };
                Waveform::Formula(Arc::new(Formula { expr: expr.renamed(&part), parts }))
            }
        };
        let (low, high) = waveform.bounds();
        if low.is_finite() && high.is_finite() {
            return Ok(waveform);
        }
        let message = "the signal is not finite";
        let help = "keep divisors away from zero and arguments in the domains of their functions, over all values of the signals in it";
        Err(fault(Diagnostic::error(codes::BAD_WAVEFORM, node.span, message).with_help(help)))
    }
}

/// The element of a quantity with these subscripts. One of a matrix that no equation defines is zero, or what stands
/// across the diagonal of a symmetric one.
pub(super) fn element(names: &Names, number: usize, values: &[i64], span: Span) -> Result<Expr, Fault> {
    let quantity = &names.quantities[number];
    let Ok(offset) = quantity.offset(values) else {
        return Err(fault(no_such_element(names, number, values, span)));
    };
    if matches!(quantity.kind, Kind::Const | Kind::Param) {
        let value = quantity.values[offset];
        return if value.is_nan() { Err(Fault::Missing(number, offset)) } else { Ok(Expr::Constant(value)) };
    }
    if quantity.exists(offset) {
        return Ok(Expr::Variable(quantity.variable(offset)));
    }
    let across =
        quantity.matrix.filter(|symmetric| *symmetric).and_then(|_| quantity.offset(&[values[1], values[0]]).ok());
    match (quantity.matrix, across.filter(|across| quantity.exists(*across))) {
        (_, Some(across)) => Ok(Expr::Variable(quantity.variable(across))),
        (Some(_), None) => Ok(Expr::Constant(0.0)),
        (None, None) => Err(fault(no_such_element(names, number, values, span))),
    }
}

fn finish_sum(sum: SumBuilder, span: Span) -> Result<Expr, Fault> {
    if sum.is_finite() { Ok(sum.finish()) } else { Err(fault(not_finite(span, "the sum is too large"))) }
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
