//! What is fixed before time zero: initial values, stated ranges, and what drives each input.

use crate::ast::{Declared, Range, StatementKind};
use crate::bound::Node;
use crate::elaborate::Elaborator;
use crate::evaluate::{Fault, Purpose, fault};
use crate::names::{Kind, Symbol};
use crate::resolve::Reads;
use crate::set::Set;
use crate::signals;
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

/// A bound range of values.
pub(crate) type BoundBounds = Option<(Node, Node)>;

impl<'a> Elaborator<'a> {
    /// Initial values and ranges of all states, in flat order.
    pub(crate) fn initial_values(&mut self, overrides: &[Set]) -> Vec<Initial> {
        let mut initials = Vec::new();
        for statement in &self.spec.statements {
            let StatementKind::State { declared, initial, within } = &statement.kind else { continue };
            let value = self.bind_element(initial, declared, Reads::Constants);
            let bounds = self.bind_bounds(within.as_ref(), declared);
            let (Some(value), Some(bounds)) = (value, bounds) else { continue };
            let Some(Symbol::Quantity(number)) = self.names.find(&declared.name.text) else { continue };
            let elements: HashMap<usize, f64> = self.set_elements(number, &overrides[number]).into_iter().collect();
            let whole = overrides[number].whole;
            let mut offset = 0;
            let mut outside = None;
            self.for_each_element(declared, |elaborator| {
                let set = elements.get(&offset).copied().or(whole);
                offset += 1;
                let start = match set {
                    Some(value) => value,
                    None => elaborator.evaluator.number(&elaborator.names, &value, Purpose::Constant)?,
                };
                let range = elaborator.bounds(&bounds)?;
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
                self.report.push(Diagnostic::error(codes::OUTSIDE_BOUNDS, initial.span, message).into_warning());
            }
        }
        initials
    }

    /// Signals and ranges of all inputs, in flat order.
    pub(crate) fn inputs(&mut self) -> Vec<Driven> {
        let mut inputs = Vec::new();
        for statement in &self.spec.statements {
            let StatementKind::Input { declared, signal, between, within } = &statement.kind else { continue };
            let bound = self.bind_element(signal, declared, Reads::Signals);
            let bounds = self.bind_bounds(within.as_ref(), declared);
            let between = between.as_ref().map(signals::between).transpose();
            let between = between.map_err(|error| self.report.push(error)).ok();
            let (Some(signal), Some(bounds), Some(between)) = (bound, bounds, between) else { continue };
            let between = between.or(self.between).unwrap_or(Interpolation::Hold);
            self.for_each_element(declared, |elaborator| {
                let waveform = elaborator.evaluator.formula(&elaborator.names, &signal)?;
                let range = elaborator.bounds(&bounds)?;
                inputs.push(Driven { waveform, range, between, span: statement.span });
                Ok(())
            });
        }
        inputs
    }

    /// Runs `action` with the frame of each element; stops at the first fault and reports it.
    fn for_each_element(&mut self, declared: &'a Declared, mut action: impl FnMut(&mut Self) -> Result<(), Fault>) {
        let Some(Symbol::Quantity(number)) = self.names.find(&declared.name.text) else { return };
        let quantity = &self.names.quantities[number];
        if quantity.broken || quantity.name.span != declared.name.span {
            return;
        }
        for offset in 0..quantity.length {
            self.evaluator.frame = self.names.quantities[number].subscripts(offset);
            let done = action(self);
            let element = self.names.quantities[number].name_at(offset);
            let label =
                |error: Diagnostic| error.with_label(declared.name.span, format!("in the definition of `{element}`"));
            if done.is_err() {
                self.settle(done, label);
                return;
            }
        }
    }

    fn bind_bounds(&mut self, within: Option<&'a Range>, declared: &'a Declared) -> Option<BoundBounds> {
        let Some(range) = within else { return Some(None) };
        let low = self.bind_element(&range.low, declared, Reads::Constants);
        let high = self.bind_element(&range.high, declared, Reads::Constants);
        Some(Some((low?, high?)))
    }

    /// The range in the present frame.
    pub(crate) fn bounds(&mut self, bounds: &BoundBounds) -> Result<Option<(f64, f64)>, Fault> {
        let Some((low_node, high_node)) = bounds else { return Ok(None) };
        let low = self.evaluator.number(&self.names, low_node, Purpose::Constant)?;
        let high = self.evaluator.number(&self.names, high_node, Purpose::Constant)?;
        if low < high {
            return Ok(Some((low, high)));
        }
        let span = Span { start: low_node.span.start, end: high_node.span.end };
        let message = format!("the range from {low} to {high} holds no interval");
        Err(fault(Diagnostic::error(codes::BAD_BOUNDS, span, message).with_help("give the smaller bound first")))
    }

    /// Whether the spec declares a quantity of this kind, or may do so in a broken statement.
    pub(crate) fn declares(&self, kind: Kind, section: &str) -> bool {
        self.names.quantities.iter().any(|quantity| quantity.kind == kind)
            || self.spec.broken.iter().any(|broken| broken.section == section)
    }
}
