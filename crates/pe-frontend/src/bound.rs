//! Expressions with their names bound: indices to places in the frame, everything else to quantities.
//!
//! Binding happens once per statement, evaluation once per element, so evaluation looks up no names.

use crate::ast::{Comparison, Connective, Factor, Sign};
use crate::functions::Function;
use crate::inline::Body;
use pe_ir::model::Samples;
use pe_ir::source::Span;
use std::rc::Rc;
use std::sync::Arc;

/// A bound expression and its place.
#[derive(Debug)]
pub(crate) struct Node {
    pub(crate) kind: NodeKind,
    pub(crate) span: Span,
}

/// The kinds of bound expressions; the counterpart of [`crate::ast::ExprKind`].
#[derive(Debug)]
pub(crate) enum NodeKind {
    Number(f64),
    /// Value of the index at this place of the frame.
    Index(usize),
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
    /// A signal: its number in [`crate::signals::WAVEFORMS`], arguments and the scales of their units.
    Signal(usize, Vec<(Node, f64)>),
    /// Argument of the innermost function.
    Argument(usize),
    /// The body of a function with these arguments.
    Inline(Vec<Node>, Rc<Body>),
    /// One expression for each element of this quantity, whose subscripts come first in the frame.
    Matrix(usize, Vec<Node>),
    /// One value for each element of this quantity, whose subscripts come first in the frame.
    Data(usize, Vec<f64>),
    /// A sampled signal.
    Samples(Arc<Samples>),
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
}

/// A bound condition.
#[derive(Debug)]
pub(crate) enum Condition {
    Compare(Comparison, Node, Node),
    Logical(Connective, Vec<Condition>),
    Not(Box<Condition>),
}
