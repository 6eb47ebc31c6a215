//! Left-hand sides and outputs: `V[b] where b > 1` stands for many elements.

use crate::bind::resolver::Reads;
use crate::bound::{Condition, Node, NodeKind};
use crate::context::Context;
use crate::fault::Fault;
use crate::names::table::{Names, Symbol, count, nth};
use crate::report::Report;
use crate::syntax::ast::{Binder, Expr, ExprKind, Reference};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// Faults of one statement after which its further elements are not looked at.
const MOST_FAULTS: usize = 20;

/// A bound reference to elements of a quantity.
pub(crate) struct Pattern<'a> {
    /// The quantity.
    pub(crate) quantity: usize,
    /// Free indices in order of first mention; their values are the frame.
    pub(crate) indices: Vec<&'a str>,
    /// Range of each free index.
    pub(crate) ranges: Vec<(i64, i64)>,
    subscripts: Vec<Node>,
    condition: Option<Condition>,
}

impl Pattern<'_> {
    /// Number of combinations of index values, conditions aside.
    pub(crate) fn combinations(&self) -> usize {
        self.ranges.iter().map(|range| count(*range)).fold(1, usize::saturating_mul)
    }

    /// Sets `frame` to the index values of a combination, by its number; the last index runs fastest.
    pub(crate) fn set_frame(&self, mut combination: usize, frame: &mut Vec<i64>) {
        frame.clear();
        for range in self.ranges.iter().rev() {
            // Not zero: a range without values gives no combinations.
            let count = count(*range);
            frame.push(nth(range.0, combination % count));
            combination /= count;
        }
        frame.reverse();
    }

    /// Adds the index values of a frame to a finding, if there are any.
    pub(crate) fn explain(&self, error: Diagnostic, span: Span, frame: &[i64]) -> Diagnostic {
        if self.indices.is_empty() {
            return error;
        }
        let values = self.indices.iter().zip(frame).map(|(index, value)| format!("{index} = {value}"));
        error.with_label(span, format!("for {}", values.collect::<Vec<_>>().join(", ")))
    }

    /// Values of the subscripts in the present frame, `None` where the condition does not hold.
    pub(crate) fn subscripts(&self, context: &mut Context) -> Result<Option<Vec<i64>>, Fault> {
        if let Some(condition) = &self.condition
            && !context.evaluator.condition(&context.names, condition)?
        {
            return Ok(None);
        }
        let mut values = Vec::with_capacity(self.subscripts.len());
        for subscript in &self.subscripts {
            values.push(context.evaluator.integer(&context.names, subscript)?);
        }
        Ok(Some(values))
    }

    /// Extents of the elements that it can reach, conditions aside; `None` after an error.
    pub(crate) fn reach(&self, context: &mut Context) -> Option<Vec<(i64, i64)>> {
        let mut extents = Vec::with_capacity(self.subscripts.len());
        for subscript in &self.subscripts {
            extents.push(match subscript.kind {
                NodeKind::Index(place) => *self.ranges.get(place)?,
                _ => {
                    context.evaluator.frame = self.ranges.iter().map(|range| range.0).collect();
                    let value = context.evaluator.integer(&context.names, subscript);
                    let value = context.report.settle(value, |error| error)?;
                    (value, value)
                }
            });
        }
        Some(extents)
    }
}

/// Faults of one statement: each place once.
#[derive(Default)]
pub(crate) struct Seen {
    places: Vec<(&'static str, Span)>,
    count: usize,
}

impl Seen {
    /// Whether a fault is to be reported, and whether to go on after it.
    pub(crate) fn judge(&mut self, fault: &Fault) -> (bool, bool) {
        self.count += 1;
        let new = match fault {
            Fault::Report(diagnostic) => {
                let place = (diagnostic.code, diagnostic.span.unwrap_or_default());
                let new = !self.places.contains(&place);
                if new {
                    self.places.push(place);
                }
                new
            }
            Fault::Silent | Fault::Missing(..) => false,
        };
        (new, self.count < MOST_FAULTS)
    }
}

/// Binds a reference to elements of `quantity`. Names in subscripts that are indices are free; anything else in a
/// subscript is a constant.
pub(crate) fn bind<'a>(
    context: &mut Context<'a>,
    quantity: usize,
    target: &'a Reference,
    ranges: &'a [Binder],
    condition: Option<&'a Expr>,
) -> Option<Pattern<'a>> {
    context.resolver(Reads::Constants).check_rank(quantity, target)?;
    let mut pattern =
        Pattern { quantity, indices: Vec::new(), ranges: Vec::new(), subscripts: Vec::new(), condition: None };
    let mut complete = true;
    for (dimension, subscript) in target.subscripts.iter().enumerate() {
        let Some(index) = lone_name(subscript) else { continue };
        if pattern.indices.contains(&index) {
            continue;
        }
        match free_index(context, quantity, dimension, index, ranges) {
            Some(Some(range)) => {
                pattern.indices.push(index);
                pattern.ranges.push(range);
            }
            Some(None) => {}
            None => complete = false,
        }
    }
    if !complete {
        return None;
    }
    for binder in ranges.iter().filter(|binder| !pattern.indices.contains(&binder.name.text.as_str())) {
        let message = format!("index `{}` does not occur in `{}`", binder.name.text, target.name.text);
        let help = "`for` gives ranges to the indices in the brackets before it";
        context.report.push(Diagnostic::error(codes::WRONG_KIND, binder.name.span, message).with_help(help));
        complete = false;
    }
    let mut resolver = context.resolver(Reads::Variables);
    resolver.scope = pattern.indices.clone();
    for subscript in &target.subscripts {
        match resolver.number(subscript) {
            Some(node) => pattern.subscripts.push(node),
            None => complete = false,
        }
    }
    if let Some(condition) = condition {
        pattern.condition = resolver.condition(condition);
        complete &= pattern.condition.is_some();
    }
    complete.then_some(pattern)
}

/// The range of a name in a subscript if it is a free index, `Some(None)` if it is something else; `None` if its
/// range is in error.
fn free_index<'a>(
    context: &mut Context<'a>,
    quantity: usize,
    dimension: usize,
    name: &'a str,
    ranges: &'a [Binder],
) -> Option<Option<(i64, i64)>> {
    if let Some(binder) = ranges.iter().find(|binder| binder.name.text == name) {
        return context.range_of(binder, Reads::Constants).map(Some);
    }
    match context.names.find(name) {
        Some(Symbol::Index(number)) => {
            context.names.indices[number].used = true;
            context.names.indices[number].range.map(Some)
        }
        Some(Symbol::Quantity(_) | Symbol::Predefined(_)) => Some(None),
        None => {
            // `state x[k in 1..10]` makes `k` known wherever it stands in that place of `x`.
            let quantity = &context.names.quantities[quantity];
            let own = quantity.binders.get(dimension).is_some_and(|binder| binder.name.text == name);
            let extent = quantity.dimensions.get(dimension).map(|extent| (extent.low, extent.high));
            if own { extent.map(Some) } else { Some(None) }
        }
    }
}

/// Reports subscripts on a left-hand side that shift an index, as in `x[i + 1]' = ...`.
pub(crate) fn check_plain_subscripts(
    names: &Names,
    target: &Reference,
    ranges: &[Binder],
    report: &mut Report,
) -> bool {
    let free = |name: &&str| {
        matches!(names.find(name), Some(Symbol::Index(_))) || ranges.iter().any(|binder| binder.name.text == **name)
    };
    let shifted = target
        .subscripts
        .iter()
        .find(|subscript| lone_name(subscript).is_none() && names_in(subscript).iter().any(free));
    if let Some(subscript) = shifted {
        let message = "a subscript on the left-hand side is an index or a constant";
        let help = "use the index alone on the left, and shift it on the right and in `where`";
        report.push(Diagnostic::error(codes::BAD_LEFT_SIDE, subscript.span, message).with_help(help));
    }
    shifted.is_none()
}

/// The name that an expression consists of.
fn lone_name(expr: &Expr) -> Option<&str> {
    match &expr.kind {
        ExprKind::Reference(reference) if reference.subscripts.is_empty() => Some(&reference.name.text),
        _ => None,
    }
}

/// The names without subscripts that arithmetic reads.
pub(crate) fn names_in(expr: &Expr) -> Vec<&str> {
    match &expr.kind {
        ExprKind::Sum(terms) => terms.iter().flat_map(|(_, term)| names_in(term)).collect(),
        ExprKind::Product(first, rest) => {
            let operands = std::iter::once(&**first).chain(rest.iter().map(|(_, factor)| factor));
            operands.flat_map(names_in).collect()
        }
        ExprKind::Power(base, exponent) => [&**base, &**exponent].into_iter().flat_map(names_in).collect(),
        ExprKind::Negate(operand) => names_in(operand),
        _ => lone_name(expr).into_iter().collect(),
    }
}
