//! The pass that computes constants and parameters.
//!
//! An element may read elements of any other constant and of its own array (`r[b] = 0.8*r[b div 2]`), so values are
//! computed on demand. Chains can be as long as arrays, hence an explicit stack instead of recursion.

use crate::bind::resolver::Reads;
use crate::bound::Node;
use crate::context::Context;
use crate::declare::overrides::{Set, elements};
use crate::fault::Fault;
use crate::names::table::Kind;
use crate::syntax::ast::StatementKind;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

/// Names of a cycle that are shown; the rest is left to dots.
const SHOWN_OF_CYCLE: usize = 8;

/// Something to be computed.
#[derive(Clone, Copy)]
enum Task {
    /// The elements of a quantity from an offset on.
    Array(usize, usize),
    /// One element, because another one waits for it.
    Element(usize, usize),
}

/// The definitions of the constants of one kind.
struct Definitions {
    /// Per quantity; `None` for other kinds and after errors.
    nodes: Vec<Option<Node>>,
    /// Per quantity and element: being computed.
    visiting: Vec<Vec<bool>>,
}

/// Computes all constants of a kind, or marks them broken.
pub(crate) fn compute(context: &mut Context, kind: Kind, overrides: &[Set]) {
    let mut definitions = bind(context, kind, overrides);
    for number in 0..context.names.quantities.len() {
        if definitions.nodes[number].is_some() {
            compute_one(context, number, &mut definitions);
        }
    }
}

/// Binds the definitions of a kind.
fn bind(context: &mut Context, kind: Kind, overrides: &[Set]) -> Definitions {
    let count = context.names.quantities.len();
    let mut definitions = Definitions { nodes: Vec::new(), visiting: vec![Vec::new(); count] };
    definitions.nodes.resize_with(count, || None);
    for statement in &context.spec.statements {
        // Bound even if overridden: what the spec says must be correct with and without `--set`.
        let (name, node) = match &statement.kind {
            StatementKind::Const { name, value } if kind == Kind::Const => {
                (name, context.resolver(Reads::Consts).number(value))
            }
            StatementKind::Param { declared, value } if kind == Kind::Param => {
                (&declared.name, context.bind_element(value, declared, Reads::Constants))
            }
            _ => continue,
        };
        let Some(number) = context.names.quantity(&name.text) else { continue };
        let quantity = &mut context.names.quantities[number];
        if quantity.name.span != name.span {
            continue;
        }
        if kind == Kind::Const {
            quantity.length = 1;
        }
        match (overrides[number].whole, node) {
            _ if quantity.broken => {}
            (Some(value), _) => quantity.values = vec![value; quantity.length],
            (None, Some(node)) => {
                quantity.values = vec![f64::NAN; quantity.length];
                definitions.visiting[number] = vec![false; quantity.length];
                definitions.nodes[number] = Some(node);
            }
            (None, None) => quantity.broken = true,
        }
        // An element that has a value is not computed any more.
        for (offset, value) in elements(quantity, &overrides[number], &mut context.report) {
            quantity.values[offset] = value;
        }
    }
    definitions
}

/// Computes a quantity and whatever it waits for.
fn compute_one(context: &mut Context, number: usize, definitions: &mut Definitions) {
    let mut stack = vec![Task::Array(number, 0)];
    while let Some(task) = stack.pop() {
        let (number, offset) = match task {
            Task::Array(number, offset) | Task::Element(number, offset) => (number, offset),
        };
        let quantity = &context.names.quantities[number];
        let Some(node) = &definitions.nodes[number] else { continue };
        if quantity.broken || offset >= quantity.length {
            continue;
        }
        if quantity.values[offset].is_nan() {
            context.evaluator.frame = quantity.subscripts(offset);
            definitions.visiting[number][offset] = true;
            match context.number(node) {
                Ok(value) => context.names.quantities[number].values[offset] = value,
                Err(Fault::Missing(other, place)) if definitions.visiting[other][place] => {
                    report_cycle(context, &stack, (number, offset), (other, place));
                    continue;
                }
                Err(Fault::Missing(other, place)) => {
                    // A quantity is computed as a whole if possible: waiting for its elements one by one would
                    // evaluate a sum over them as many times.
                    let begun = definitions.visiting[other].iter().any(|visiting| *visiting);
                    stack.push(task);
                    stack.push(if begun { Task::Element(other, place) } else { Task::Array(other, 0) });
                    continue;
                }
                Err(fault) => {
                    let quantity = &mut context.names.quantities[number];
                    quantity.broken = true;
                    let (span, name) = (quantity.name.span, quantity.name_at(offset));
                    context
                        .report
                        .settle::<f64>(Err(fault), |error| error.with_label(span, format!("in the value of `{name}`")));
                    continue;
                }
            }
        }
        if let Task::Array(number, offset) = task {
            stack.push(Task::Array(number, offset + 1));
        }
    }
}

/// Reports that an element waits for itself, and gives up the quantities involved.
fn report_cycle(context: &mut Context, stack: &[Task], last: (usize, usize), first: (usize, usize)) {
    let mut cycle: Vec<(usize, usize)> = stack
        .iter()
        .map(|task| match task {
            Task::Array(number, offset) | Task::Element(number, offset) => (*number, *offset),
        })
        .skip_while(|waiting| *waiting != first)
        .collect();
    cycle.push(last);
    let mut names: Vec<String> = cycle
        .iter()
        .take(SHOWN_OF_CYCLE)
        .map(|(number, offset)| format!("`{}`", context.names.quantities[*number].name_at(*offset)))
        .collect();
    if cycle.len() > SHOWN_OF_CYCLE {
        names.push("...".to_owned());
    }
    names.push(format!("`{}`", context.names.quantities[first.0].name_at(first.1)));
    let mut places: Vec<Span> = Vec::new();
    for (number, _) in &cycle {
        let quantity = &mut context.names.quantities[*number];
        quantity.broken = true;
        if !places.contains(&quantity.name.span) && places.len() < SHOWN_OF_CYCLE {
            places.push(quantity.name.span);
        }
    }
    let message = format!("the value depends on itself: {}", names.join(" reads "));
    let mut places = places.into_iter();
    let mut error = Diagnostic::error(codes::CIRCULAR_CONSTANT, places.next().unwrap_or_default(), message);
    error.labels.extend(places.map(|span| (span, "and this one".to_owned())));
    context.report.push(error);
}
