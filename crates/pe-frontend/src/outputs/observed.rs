//! Outputs named on the command line, in place of the spec's.

use crate::context::Context;
use crate::fault::Fault;
use crate::language::words::TIME;
use crate::names::table::{Names, Symbol};
use crate::nearest::suggestion;
use crate::outputs::constants::{Constants, is_time, variable_of_time};
use crate::outputs::item::{Item, existing, extents, parse, split};
use pe_ir::codes;
use pe_ir::model::Output;
use pe_ir::source::{Diagnostic, Span};
use std::collections::HashSet;

/// The elements that the lists name, in order of mention; an element counts once.
pub(super) fn observed(lists: &[String], context: &mut Context, constants: &mut Constants) -> Vec<Output> {
    let Context { spec, names, report, evaluator, .. } = context;
    let mut outputs = Vec::new();
    let mut taken = HashSet::new();
    for text in lists.iter().flat_map(|list| split(list)) {
        let found = parse(text).ok_or_else(|| {
            Diagnostic::global(codes::OVERRIDE, format!("`{text}` names nothing that can be observed"))
                .with_help("name scalars, elements or whole arrays: `--observe 'p,V[3],w[1,2]'`")
        });
        if text == TIME && is_time(names) {
            let (variable, name) = variable_of_time();
            evaluator.signals.time(Span::default());
            if taken.insert(variable) {
                outputs.push(Output { name, variable, span: Span::default() });
            }
            continue;
        }
        match found.and_then(|item| elements(&item, names)) {
            Ok((number, offsets)) => {
                for offset in offsets {
                    let quantity = &names.quantities[number];
                    let variable = constants.variable(names, number, offset, quantity.name.span);
                    let name = quantity.name_at(offset);
                    if taken.insert(variable) {
                        outputs.push(Output { name, variable, span: quantity.name.span });
                    }
                }
            }
            Err(problem) => report.push(problem),
        }
    }
    if outputs.is_empty() && !report.failed() && spec.broken.is_empty() {
        report.push(Diagnostic::global(codes::NO_OUTPUT, "`--observe` names no element"));
    }
    outputs
}

/// Number of the quantity and offsets of its elements; none for what a reported error keeps from being known.
fn elements(item: &Item, names: &Names) -> Result<(usize, Vec<usize>), Diagnostic> {
    let Item { name, subscripts } = item;
    let number = match names.written(name) {
        _ if names.is_poisoned(name) => return Ok((0, Vec::new())),
        Some(Symbol::Quantity(number)) => number,
        None => {
            let known = names.quantities.iter();
            let error = Diagnostic::global(codes::UNKNOWN_NAME, format!("unknown name `{name}` to observe"));
            return Err(Diagnostic { help: suggestion(name, known.map(|q| q.name.text.as_str())), ..error });
        }
        Some(Symbol::Index(_) | Symbol::Predefined(_)) => {
            let message = format!("`{name}` does not change over time and cannot be observed");
            return Err(Diagnostic::global(codes::WRONG_KIND, message));
        }
    };
    let quantity = &names.quantities[number];
    if quantity.broken {
        return Ok((number, Vec::new()));
    }
    let Some(subscripts) = subscripts else {
        let exists = |offset: &usize| quantity.exists(*offset);
        return Ok((number, (0..quantity.length).filter(exists).collect()));
    };
    if subscripts.len() != quantity.rank {
        let message = format!("`{name}` has {} subscripts, not {}", quantity.rank, subscripts.len());
        return Err(Diagnostic::error(codes::SUBSCRIPT_COUNT, quantity.name.span, message));
    }
    match existing(quantity, subscripts, quantity.name.span) {
        Ok(offset) => Ok((number, vec![offset])),
        // The finding's place is the definition; a label there would say it twice.
        Err(Fault::Report(problem)) => Err(Diagnostic { labels: Vec::new(), help: extents(quantity), ..*problem }),
        Err(_) => Ok((number, Vec::new())),
    }
}
