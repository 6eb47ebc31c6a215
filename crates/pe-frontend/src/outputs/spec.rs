//! The outputs, element by element.

use crate::context::Context;
use crate::equations::pattern::{Seen, bind};
use crate::equations::write::Flat;
use crate::language::words::TIME;
use crate::names::table::Symbol;
use crate::outputs::constants::{Constants, is_time, variable_of_time};
use crate::outputs::item::existing;
use crate::outputs::observed::observed;
use crate::syntax::ast::{OutputItem, StatementKind};
use pe_ir::codes;
use pe_ir::model::{Output, Variable};
use pe_ir::source::{Diagnostic, Span};
use std::collections::HashMap;

/// Outputs found so far and where each variable was asked for first.
struct Found<'f> {
    outputs: Vec<Output>,
    places: HashMap<Variable, Span>,
    constants: Constants<'f>,
}

/// All outputs in order of mention. `observe` takes the place of the spec's; those are still looked at, because
/// what is wrong with them is wrong however the model is compiled.
pub(crate) fn outputs(context: &mut Context, flat: &mut Flat, observe: &[String]) -> Vec<Output> {
    let constants = Constants::new(flat);
    let mut found = Found { outputs: Vec::new(), places: HashMap::new(), constants };
    let mut asked = context.spec.broken.iter().any(|broken| broken.section == "output");
    for statement in &context.spec.statements {
        let StatementKind::Output(items) = &statement.kind else { continue };
        asked = true;
        for item in items {
            output(context, item, &mut found);
        }
    }
    if !observe.is_empty() {
        let Found { mut constants, .. } = found;
        return observed(observe, context, &mut constants);
    }
    if !asked {
        let help = "name an output, for example `output x`";
        context.report.push(Diagnostic::global(codes::NO_OUTPUT, "the spec has no output").with_help(help));
    } else if found.outputs.is_empty() && !context.report.failed() && context.spec.broken.is_empty() {
        context.report.push(Diagnostic::global(codes::NO_OUTPUT, "the outputs name no element"));
    }
    found.outputs
}

fn output<'a>(context: &mut Context<'a>, item: &'a OutputItem, found: &mut Found) {
    let target = &item.target;
    let plain = target.subscripts.is_empty() && item.ranges.is_empty() && item.condition.is_none();
    if target.name.text == TIME && plain && is_time(&context.names) {
        context.evaluator.signals.time(target.span);
        return keep(context, variable_of_time(), target.span, found);
    }
    let number = match context.names.find(&target.name.text) {
        Some(Symbol::Quantity(number)) => number,
        _ if context.names.is_poisoned(&target.name.text) => return,
        None => {
            context.report.push(context.names.unknown(&target.name, &[]));
            return;
        }
        Some(Symbol::Index(_) | Symbol::Predefined(_)) => {
            let message = format!("`{}` does not change over time and cannot be an output", target.name.text);
            context.report.push(Diagnostic::error(codes::WRONG_KIND, target.name.span, message));
            return;
        }
    };
    let quantity = &mut context.names.quantities[number];
    quantity.used = true;
    if plain && quantity.rank > 0 {
        whole(context, number, target.span, found);
    } else {
        elements(context, number, item, found);
    }
}

/// Every element of an array that exists.
fn whole(context: &mut Context, number: usize, span: Span, found: &mut Found) {
    for offset in 0..context.names.quantities[number].length {
        let quantity = &context.names.quantities[number];
        if !quantity.broken && quantity.exists(offset) {
            take(context, number, offset, span, found);
        }
    }
}

/// The elements that a pattern stands for.
fn elements<'a>(context: &mut Context<'a>, number: usize, item: &'a OutputItem, found: &mut Found) {
    let span = item.target.span;
    let Some(pattern) = bind(context, number, &item.target, &item.ranges, item.condition.as_ref()) else { return };
    let combinations = pattern.combinations();
    if combinations > context.elements.left.saturating_add(context.names.quantities[number].length) {
        context.elements.take(combinations, &item.target.name.text, span, &mut context.report);
        return;
    }
    let mut seen = Seen::default();
    for combination in 0..combinations {
        pattern.set_frame(combination, &mut context.evaluator.frame);
        let subscripts = pattern.subscripts(context);
        match subscripts.and_then(|values| {
            values.map(|values| existing(&context.names.quantities[number], &values, span)).transpose()
        }) {
            Ok(Some(offset)) => take(context, number, offset, span, found),
            Ok(None) => {}
            Err(fault) => {
                let (new, go_on) = seen.judge(&fault);
                if new {
                    let frame = context.evaluator.frame.clone();
                    context.report.settle::<()>(Err(fault), |error| pattern.explain(error, span, &frame));
                }
                if !go_on {
                    return;
                }
            }
        }
    }
}

/// Takes an element as output, unless it already is one.
fn take(context: &mut Context, number: usize, offset: usize, span: Span, found: &mut Found) {
    let quantity = &context.names.quantities[number];
    let variable = found.constants.variable(&context.names, number, offset, span);
    keep(context, (variable, quantity.name_at(offset)), span, found);
}

/// Takes a variable of a name as output, unless it already is one.
fn keep(context: &mut Context, (variable, name): (Variable, String), span: Span, found: &mut Found) {
    let first = *found.places.entry(variable).or_insert(span);
    if first != span {
        let message = format!("`{name}` is already an output");
        let warning = Diagnostic::error(codes::REPEATED_OUTPUT, span, message).with_label(first, "asked for here");
        context.report.push(warning.into_warning());
    } else {
        found.outputs.push(Output { name, variable, span });
    }
}
