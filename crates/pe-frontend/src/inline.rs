//! Functions that a spec defines. A call is replaced by the body of the function, its arguments evaluated first.

use crate::algebra::{DOT, TRANSPOSE};
use crate::ast::{Expr as Tree, Name};
use crate::bound::{BoundRange, Condition, Node, NodeKind};
use crate::elaborate::Elaborator;
use crate::evaluate::{Evaluator, Fault, fault, too_large};
use crate::functions;
use crate::names::{Names, PREDEFINED};
use crate::report::Report;
use crate::resolve::{Reads, Resolver};
use crate::signals::{SAMPLES, WAVEFORMS};
use pe_ir::codes;
use pe_ir::model::Expr;
use pe_ir::source::{Diagnostic, Span};
use std::rc::Rc;

/// Functions that call one another, one inside the other.
pub(crate) const MOST_NESTED_CALLS: usize = 16;

/// Deepest body, those of called functions put in; every later pass may recurse this deep.
const DEEPEST_BODY: usize = 500;

/// A function of the spec.
#[derive(Debug)]
pub(crate) struct Defined<'a> {
    pub(crate) name: &'a Name,
    pub(crate) parameters: &'a [Name],
    pub(crate) body: &'a Tree,
    /// The bound body for each of [`Reads`] that was asked for; `None` inside after an error.
    bound: [Option<Option<Rc<Body>>>; 4],
}

/// A bound body.
#[derive(Debug)]
pub(crate) struct Body {
    node: Node,
    depth: usize,
}

impl<'a> Names<'a> {
    /// The function of this name.
    pub(crate) fn function(&self, name: &str) -> Option<&Defined<'a>> {
        self.function_numbers.get(name).map(|number| &self.functions[*number])
    }

    /// Takes in a function.
    pub(crate) fn define_function(
        &mut self,
        name: &'a Name,
        parameters: &'a [Name],
        body: &'a Tree,
        report: &mut Report,
    ) {
        for (at, parameter) in parameters.iter().enumerate() {
            if let Some(first) = parameters[..at].iter().find(|first| first.text == parameter.text) {
                let message = format!("two arguments `{}`", parameter.text);
                let error = Diagnostic::error(codes::DUPLICATE, parameter.span, message);
                report.push(error.with_label(first.span, "the first one"));
            }
            if PREDEFINED.iter().any(|(word, _)| *word == parameter.text) {
                let message = format!("`{}` is predefined and cannot be an argument", parameter.text);
                report.push(Diagnostic::error(codes::DUPLICATE, parameter.span, message));
            }
        }
        let of_arrays = [DOT, TRANSPOSE].contains(&name.text.as_str());
        let waveform =
            WAVEFORMS.iter().any(|(word, ..)| *word == name.text) || name.text == SAMPLES || name.text == "data";
        if waveform || of_arrays || functions::find(&name.text).is_some() {
            let message = format!("`{}` is a function of the language", name.text);
            report.push(Diagnostic::error(codes::DUPLICATE, name.span, message).with_help("choose another name"));
        } else if let Some(first) = self.function(&name.text) {
            let message = format!("the function `{}` is defined twice", name.text);
            let error = Diagnostic::error(codes::DUPLICATE, name.span, message);
            report.push(error.with_label(first.name.span, "first defined here"));
        } else {
            self.function_numbers.insert(&name.text, self.functions.len());
            self.functions.push(Defined { name, parameters, body, bound: [None, None, None, None] });
        }
    }
}

impl Elaborator<'_> {
    /// Looks at the functions that nothing calls: what is wrong with them is wrong.
    pub(crate) fn check_functions(&mut self) {
        for number in 0..self.names.functions.len() {
            if self.names.functions[number].bound.iter().all(Option::is_none) {
                self.resolver(Reads::Variables).body(number, Span::default());
            }
        }
    }
}

impl<'a> Resolver<'_, 'a> {
    /// The argument of the innermost function that a name stands for.
    pub(crate) fn argument(&self, name: &Name) -> Option<NodeKind> {
        let function = &self.names.functions[*self.calling.last()?];
        function.parameters.iter().position(|parameter| parameter.text == name.text).map(NodeKind::Argument)
    }

    /// A call of a function of the spec.
    pub(crate) fn inline(
        &mut self,
        number: usize,
        arguments: Option<Vec<Node>>,
        found: usize,
        span: Span,
    ) -> Option<NodeKind> {
        let function = &self.names.functions[number];
        let (name, wanted) = (function.name, function.parameters.len());
        if found != wanted {
            let message = format!("`{}` takes {wanted} argument(s), found {found}", name.text);
            let error = Diagnostic::error(codes::ARGUMENT_COUNT, span, message);
            self.report.push(error.with_label(name.span, "defined here"));
            return None;
        }
        let body = self.body(number, span)?;
        Some(NodeKind::Inline(arguments?, body))
    }

    /// The bound body of a function; it is bound once for each kind of place.
    fn body(&mut self, number: usize, span: Span) -> Option<Rc<Body>> {
        let place = self.reads as usize;
        if let Some(known) = &self.names.functions[number].bound[place] {
            return known.clone();
        }
        if let Some(first) = self.calling.iter().position(|calling| *calling == number) {
            let cycle = self.calling[first..].iter().chain([&number]);
            let cycle: Vec<String> =
                cycle.map(|function| format!("`{}`", self.names.functions[*function].name.text)).collect();
            let message = format!("the function calls itself: {}", cycle.join(" calls "));
            let error = Diagnostic::error(codes::RECURSION, span, message);
            let name = self.names.functions[number].name;
            self.report.push(error.with_label(name.span, "defined here"));
            return None;
        }
        let too_deep = |name: &Name| {
            let message = format!("`{}` calls functions that call functions, too deep", name.text);
            Diagnostic::error(codes::TOO_DEEP, name.span, message)
                .with_help("give intermediate values names of their own, as algebraic equations")
        };
        let (name, tree) = (self.names.functions[number].name, self.names.functions[number].body);
        if self.calling.len() >= MOST_NESTED_CALLS {
            self.report.push(too_deep(name));
            return None;
        }
        // A body knows its arguments and what is defined for the whole spec, but no index and no element.
        let (scope, owner) = (std::mem::take(&mut self.scope), self.owner.take());
        self.calling.push(number);
        let node = self.number(tree);
        self.calling.pop();
        (self.scope, self.owner) = (scope, owner);
        let body = node.map(|node| Body { depth: depth(&node), node }).filter(|body| {
            let fits = body.depth <= DEEPEST_BODY;
            if !fits {
                self.report.push(too_deep(name));
            }
            fits
        });
        let body = body.map(Rc::new);
        self.names.functions[number].bound[place] = Some(body.clone());
        body
    }
}

impl Evaluator {
    /// An argument of the innermost function. Each use is a copy, so each counts as reading its variables.
    pub(crate) fn argument(&mut self, place: usize, span: Span) -> Result<Expr, Fault> {
        let argument = &self.arguments[self.first_argument + place];
        match self.reads.checked_sub(size(argument).0) {
            Some(left) => self.reads = left,
            None => return Err(fault(too_large(span))),
        }
        Ok(argument.clone())
    }

    /// The body of a function for these arguments.
    pub(crate) fn inline(&mut self, names: &Names, arguments: &[Node], body: &Body, span: Span) -> Result<Expr, Fault> {
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
    }
}

/// Depth of a bound expression with the bodies of functions put in.
fn depth(node: &Node) -> usize {
    let most = |nodes: &mut dyn Iterator<Item = &Node>| nodes.map(depth).max().unwrap_or(0);
    1 + match &node.kind {
        NodeKind::Number(_)
        | NodeKind::Time
        | NodeKind::Index(_)
        | NodeKind::Argument(_)
        | NodeKind::Data(..)
        | NodeKind::Samples(_) => 0,
        NodeKind::Signal(_, members) => most(&mut members.iter().map(|(member, _)| member)),
        NodeKind::Element(_, members) | NodeKind::Call(_, members) | NodeKind::Matrix(_, members) => {
            most(&mut members.iter())
        }
        NodeKind::Sum(terms) => most(&mut terms.iter().map(|(_, term)| term)),
        NodeKind::Product(first, rest) => depth(first).max(most(&mut rest.iter().map(|(_, operand)| operand))),
        NodeKind::Power(base, exponent) => depth(base).max(depth(exponent)),
        NodeKind::Negate(operand) => depth(operand),
        NodeKind::If(condition, yes, no) => condition_depth(condition).max(depth(yes)).max(depth(no)),
        NodeKind::SumOver(sum) => {
            let range = match &sum.range {
                BoundRange::Index(_) => 0,
                BoundRange::Own(low, high) => depth(low).max(depth(high)),
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
    }
}
