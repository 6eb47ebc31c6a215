//! The passes that find what is fixed before time zero: initial values, stated ranges, and what drives each input.

use crate::bind::resolver::Reads;
use crate::context::Context;
use crate::declare::overrides::{Set, elements};
use crate::fault::Fault;
use crate::language::waveforms::between as interpolation;
use crate::syntax::ast::{Declared, StatementKind};
use pe_ir::codes;
use pe_ir::model::{Interpolation, Waveform};
use pe_ir::source::{Diagnostic, Span};
use std::collections::HashMap;

/// Initial value and stated range of a flat state.
pub(crate) struct Initial {
    pub(crate) value: f64,
    pub(crate) range: Option<(f64, f64)>,
}

/// Signal and stated range of a flat input.
pub(crate) struct Driven {
    pub(crate) waveform: Waveform,
    pub(crate) range: Option<(f64, f64)>,
    /// What it is between two samples.
    pub(crate) between: Interpolation,
    /// The declaration.
    pub(crate) span: Span,
}

/// Initial values and ranges of all states, in flat order.
pub(crate) fn states(context: &mut Context, overrides: &[Set]) -> Vec<Initial> {
    let mut initials = Vec::new();
    for statement in &context.spec.statements {
        let StatementKind::State { declared, initial, within, .. } = &statement.kind else { continue };
        let value = context.bind_element(initial, declared, Reads::Constants);
        let bounds = context.bind_bounds(within.as_ref(), declared);
        let (Some(value), Some(bounds)) = (value, bounds) else { continue };
        let Some(number) = context.names.quantity(&declared.name.text) else { continue };
        let set_elements = elements(&context.names.quantities[number], &overrides[number], &mut context.report);
        let set_elements: HashMap<usize, f64> = set_elements.into_iter().collect();
        let whole = overrides[number].whole;
        let mut offset = 0;
        let mut outside = None;
        for_each_element(context, declared, |context| {
            let set = set_elements.get(&offset).copied().or(whole);
            offset += 1;
            let start = match set {
                Some(value) => value,
                None => context.number(&value)?,
            };
            let range = context.bounds(&bounds)?;
            if outside.is_none() && range.is_some_and(|(low, high)| start < low || start > high) {
                outside = Some((start, range.unwrap_or_default()));
            }
            initials.push(Initial { value: start, range });
            Ok(())
        });
        if let Some((start, (low, high))) = outside {
            let name = &declared.name.text;
            let message =
                format!("the initial value {start} of `{name}` lies outside the stated range {low} .. {high}");
            context.report.push(Diagnostic::error(codes::OUTSIDE_BOUNDS, initial.span, message).into_warning());
        }
    }
    initials
}

/// Signals and ranges of all inputs, in flat order.
pub(crate) fn inputs(context: &mut Context, unstated: Option<Interpolation>) -> Vec<Driven> {
    let mut inputs = Vec::new();
    for statement in &context.spec.statements {
        let StatementKind::Input { declared, signal, between, within } = &statement.kind else { continue };
        let bound = context.bind_element(signal, declared, Reads::Signals);
        let bounds = context.bind_bounds(within.as_ref(), declared);
        let between = between.as_ref().map(interpolation).transpose();
        let between = between.map_err(|error| context.report.push(error)).ok();
        let (Some(signal), Some(bounds), Some(between)) = (bound, bounds, between) else { continue };
        let between = between.or(unstated).unwrap_or(Interpolation::Hold);
        for_each_element(context, declared, |context| {
            let waveform = context.evaluator.formula(&context.names, &signal)?;
            let range = context.bounds(&bounds)?;
            inputs.push(Driven { waveform, range, between, span: statement.span });
            Ok(())
        });
    }
    inputs
}

/// Runs `action` with the frame of each element; stops at the first fault and reports it.
fn for_each_element<'a>(
    context: &mut Context<'a>,
    declared: &Declared,
    mut action: impl FnMut(&mut Context<'a>) -> Result<(), Fault>,
) {
    let Some(number) = context.names.quantity(&declared.name.text) else { return };
    let quantity = &context.names.quantities[number];
    if quantity.broken || quantity.name.span != declared.name.span {
        return;
    }
    for offset in 0..quantity.length {
        context.evaluator.frame = context.names.quantities[number].subscripts(offset);
        let done = action(context);
        let element = context.names.quantities[number].name_at(offset);
        let label =
            |error: Diagnostic| error.with_label(declared.name.span, format!("in the definition of `{element}`"));
        if done.is_err() {
            context.report.settle(done, label);
            return;
        }
    }
}
