//! Expressions with their names bound: indices to places in the frame, everything else to quantities.
//!
//! Binding happens once per statement, evaluation once per element, so evaluation looks up no names.

use crate::language::functions::Function;
use crate::syntax::ast::{Comparison, Connective, Factor, Sign};
use pe_ir::model::Samples;
use pe_ir::source::Span;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;

/// Functions that call one another, one inside the other.
pub(crate) const MOST_NESTED_CALLS: usize = 16;

/// Deepest body, those of called functions put in; every later pass may recurse this deep.
pub(crate) const DEEPEST_BODY: usize = 500;

/// A bound expression and its place.
#[derive(Debug)]
pub(crate) struct Node {
    pub(crate) kind: NodeKind,
    pub(crate) span: Span,
}

/// The kinds of bound expressions; the counterpart of [`crate::syntax::ast::ExprKind`].
#[derive(Debug)]
pub(crate) enum NodeKind {
    Number(f64),
    /// Value of the index at this place of the frame.
    Index(usize),
    /// A number for each row of a data file, of which the index at this place of the frame is one.
    Cell(usize, Rc<[f64]>),
    /// Element of a quantity, by its number.
    Element(usize, Vec<Node>),
    Sum(Vec<(Sign, Node)>),
    Product(Box<Node>, Vec<(Factor, Node)>),
    Power(Box<Node>, Box<Node>),
    Negate(Box<Node>),
    If(Box<Condition>, Box<Node>, Box<Node>),
    SumOver(Box<SumOver>),
    Call(Function, Vec<Node>),
    /// The time.
    Time,
    /// A signal: its number in [`crate::language::waveforms::WAVEFORMS`], arguments and the scales of their units.
    Signal(usize, Vec<(Node, f64)>),
    /// Argument of the innermost function.
    Argument(usize),
    /// The body of a function with these arguments.
    Inline(Vec<Node>, Rc<Body>),
    /// One expression for each element of this quantity, whose subscripts come first in the frame.
    Matrix(usize, Vec<Node>),
    /// One value for each element of this quantity, whose subscripts come first in the frame.
    Data(usize, Vec<f64>),
    /// An element of a quantity as it was so long ago: the delay in a unit of so many seconds.
    Delayed(Box<Node>, Box<Node>, f64),
    /// A sampled signal.
    Samples(Arc<Samples>),
    /// An element of the solution of a linear system: quantities of matrix and right-hand side, and subscripts.
    Solved(usize, usize, Vec<Node>),
}

/// A sum over an index, whose value is pushed onto the frame.
#[derive(Debug)]
pub(crate) struct SumOver {
    pub(crate) range: BoundRange,
    pub(crate) condition: Option<Condition>,
    pub(crate) body: Node,
}

/// The values of an index.
#[derive(Debug)]
pub(crate) enum BoundRange {
    /// Those of an `index` statement, by its number.
    Index(usize),
    /// From the first to the second.
    Own(Node, Node),
    /// The rows of a data file.
    Rows(Rows),
}

/// The rows of a data file, which a condition may choose from.
#[derive(Debug)]
pub(crate) struct Rows {
    /// The first cell of each.
    pub(crate) places: Vec<Span>,
    /// Where the condition says what a cell of them is: rows by the bits of that number, and the number.
    pub(crate) chosen: Option<(BTreeMap<u64, Vec<u32>>, Node)>,
}

/// A bound condition.
#[derive(Debug)]
pub(crate) enum Condition {
    Compare(Comparison, Node, Node),
    Logical(Connective, Vec<Condition>),
    Not(Box<Condition>),
    /// Whether both hold or neither, or, if negated, just one of them.
    Same {
        one: Box<Condition>,
        other: Box<Condition>,
        negated: bool,
    },
}

/// The bound body of a function.
#[derive(Debug)]
pub(crate) struct Body {
    pub(crate) node: Node,
    pub(crate) depth: usize,
}

/// Depth of a bound expression with the bodies of functions put in.
pub(crate) fn depth(node: &Node) -> usize {
    let most = |nodes: &mut dyn Iterator<Item = &Node>| nodes.map(depth).max().unwrap_or(0);
    1 + match &node.kind {
        NodeKind::Number(_)
        | NodeKind::Time
        | NodeKind::Index(_)
        | NodeKind::Cell(..)
        | NodeKind::Argument(_)
        | NodeKind::Data(..)
        | NodeKind::Samples(_) => 0,
        NodeKind::Signal(_, members) => most(&mut members.iter().map(|(member, _)| member)),
        NodeKind::Element(_, members)
        | NodeKind::Call(_, members)
        | NodeKind::Matrix(_, members)
        | NodeKind::Solved(.., members) => most(&mut members.iter()),
        NodeKind::Sum(terms) => most(&mut terms.iter().map(|(_, term)| term)),
        NodeKind::Product(first, rest) => depth(first).max(most(&mut rest.iter().map(|(_, operand)| operand))),
        NodeKind::Power(base, exponent) | NodeKind::Delayed(base, exponent, _) => depth(base).max(depth(exponent)),
        NodeKind::Negate(operand) => depth(operand),
        NodeKind::If(condition, yes, no) => condition_depth(condition).max(depth(yes)).max(depth(no)),
        NodeKind::SumOver(sum) => {
            let range = match &sum.range {
                BoundRange::Index(_) => 0,
                BoundRange::Own(low, high) => depth(low).max(depth(high)),
                BoundRange::Rows(rows) => rows.chosen.as_ref().map_or(0, |(_, number)| depth(number)),
            };
            range.max(sum.condition.as_ref().map_or(0, condition_depth)).max(depth(&sum.body))
        }
        NodeKind::Inline(arguments, body) => body.depth.max(most(&mut arguments.iter())),
    }
}

fn condition_depth(condition: &Condition) -> usize {
    1 + match condition {
        Condition::Compare(_, left, right) => depth(left).max(depth(right)),
        Condition::Logical(_, operands) => operands.iter().map(condition_depth).max().unwrap_or(0),
        Condition::Not(operand) => condition_depth(operand),
        Condition::Same { one, other, .. } => condition_depth(one).max(condition_depth(other)),
    }
}
