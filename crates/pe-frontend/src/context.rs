//! What the passes that bind and evaluate expressions share: the names and four services, each a type of its own.
//!
//! Passes that need less take less.

use crate::bind::resolver::{Reads, Resolver};
use crate::bound::{BoundRange, Node};
use crate::evaluate::evaluator::Evaluator;
use crate::fault::{Fault, Purpose, fault};
use crate::limits::{Elements, Limits};
use crate::names::table::{Names, Symbol};
use crate::report::Report;
use crate::syntax::ast::{Binder, Declared, Expr as Tree, Range, Spec};
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// A bound range of values.
pub(crate) type BoundBounds = Option<(Node, Node)>;

/// A spec with its names, and the services.
pub(crate) struct Context<'a> {
    pub(crate) spec: &'a Spec,
    /// What each name stands for; every pass fills in what it finds out.
    pub(crate) names: Names<'a>,
    /// Takes what is wrong.
    pub(crate) report: Report,
    /// Computes values.
    pub(crate) evaluator: Evaluator,
    /// Counts elements.
    pub(crate) elements: Elements,
}

impl<'a> Context<'a> {
    pub(crate) fn new(spec: &'a Spec, names: Names<'a>, limits: &Limits, report: Report) -> Self {
        let evaluator = Evaluator::new(limits.evaluations, limits.reads);
        Context { spec, names, report, evaluator, elements: Elements { left: limits.elements } }
    }

    /// A resolver without indices in scope.
    pub(crate) fn resolver(&mut self, reads: Reads) -> Resolver<'_, 'a> {
        Resolver::new(self.spec, &mut self.names, &mut self.report, reads)
    }

    /// Binds an expression in which the dimensions of a declaration have values.
    pub(crate) fn bind_element(&mut self, expr: &'a Tree, declared: &'a Declared, reads: Reads) -> Option<Node> {
        let owner = match self.names.find(&declared.name.text) {
            Some(Symbol::Quantity(number)) if self.names.quantities[number].name.span == declared.name.span => number,
            // Defined twice; the first definition counts.
            _ => return None,
        };
        let mut resolver = self.resolver(reads);
        resolver.owner = Some(owner);
        resolver.scope = declared.dimensions.iter().map(|binder| binder.name.text.as_str()).collect();
        resolver.number(expr)
    }

    /// Binds a stated range in which the dimensions of a declaration have values.
    pub(crate) fn bind_bounds(&mut self, within: Option<&'a Range>, declared: &'a Declared) -> Option<BoundBounds> {
        let Some(range) = within else { return Some(None) };
        let low = self.bind_element(&range.low, declared, Reads::Constants);
        let high = self.bind_element(&range.high, declared, Reads::Constants);
        Some(Some((low?, high?)))
    }

    /// The value of a bound constant in the present frame.
    pub(crate) fn number(&mut self, node: &Node) -> Result<f64, Fault> {
        self.evaluator.number(&self.names, node, Purpose::Constant)
    }

    /// The stated range in the present frame.
    pub(crate) fn bounds(&mut self, bounds: &BoundBounds) -> Result<Option<(f64, f64)>, Fault> {
        let Some((low_node, high_node)) = bounds else { return Ok(None) };
        let (low, high) = (self.number(low_node)?, self.number(high_node)?);
        if low < high {
            return Ok(Some((low, high)));
        }
        let span = Span { start: low_node.span.start, end: high_node.span.end };
        let message = format!("the range from {low} to {high} holds no interval");
        Err(fault(Diagnostic::error(codes::BAD_BOUNDS, span, message).with_help("give the smaller bound first")))
    }

    /// Binds and evaluates a constant outside of any index.
    pub(crate) fn constant(&mut self, expr: &'a Tree) -> Option<f64> {
        let node = self.resolver(Reads::Constants).number(expr)?;
        self.evaluator.frame.clear();
        let value = self.number(&node);
        self.report.settle(value, |diagnostic| diagnostic)
    }

    /// Binds and evaluates the range of an index.
    pub(crate) fn range_of(&mut self, binder: &'a Binder, reads: Reads) -> Option<(i64, i64)> {
        let range: BoundRange = self.resolver(reads).range(binder)?;
        self.evaluator.frame.clear();
        let range = self.evaluator.range(&self.names, &range);
        self.report.settle(range, |diagnostic| diagnostic)
    }
}
