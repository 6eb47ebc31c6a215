//! The outputs, element by element.

use crate::ast::{OutputItem, StatementKind};
use crate::elaborate::Elaborator;
use crate::evaluate::{Fault, fault};
use crate::names::{Kind, PREDEFINED, Symbol};
use crate::pattern::Seen;
use pe_ir::codes;
use pe_ir::model::{Output, Variable};
use pe_ir::source::{Diagnostic, Span};
use std::collections::HashMap;

/// Outputs found so far and where each variable was asked for first.
#[derive(Default)]
struct Found {
    outputs: Vec<Output>,
    places: HashMap<Variable, Span>,
}

impl<'a> Elaborator<'a> {
    /// All outputs in order of mention. `observe` takes the place of the spec's; those are still looked at, because
    /// what is wrong with them is wrong however the model is compiled.
    pub(crate) fn outputs(&mut self, observe: &[String]) -> Vec<Output> {
        let mut found = Found::default();
        let mut asked = self.spec.broken.iter().any(|broken| broken.section == "output");
        for statement in &self.spec.statements {
            let StatementKind::Output(items) = &statement.kind else { continue };
            asked = true;
            for item in items {
                self.output(item, &mut found);
            }
        }
        if !observe.is_empty() {
            return self.observed(observe);
        }
        if !asked {
            let help = "say what you want to see, for example `output x`";
            self.report.push(Diagnostic::global(codes::NO_OUTPUT, "the spec has no output").with_help(help));
        } else if found.outputs.is_empty() && !self.report.failed() && self.spec.broken.is_empty() {
            self.report.push(Diagnostic::global(codes::NO_OUTPUT, "the outputs name no element"));
        }
        found.outputs
    }

    fn output(&mut self, item: &'a OutputItem, found: &mut Found) {
        let target = &item.target;
        let number = match self.names.find(&target.name.text) {
            Some(Symbol::Quantity(number)) => number,
            _ if self.names.is_poisoned(&target.name.text) => return,
            None if !PREDEFINED.iter().any(|(word, _)| *word == target.name.text) => {
                self.report.push(self.names.unknown(&target.name, &[]));
                return;
            }
            Some(Symbol::Index(_)) | None => {
                let message = format!("`{}` does not change over time and cannot be an output", target.name.text);
                self.report.push(Diagnostic::error(codes::WRONG_KIND, target.name.span, message));
                return;
            }
        };
        let quantity = &mut self.names.quantities[number];
        quantity.used = true;
        if matches!(quantity.kind, Kind::Const | Kind::Param) {
            let message = format!("`{}` is {} and cannot be an output", target.name.text, quantity.kind.describe());
            let error = Diagnostic::error(codes::WRONG_KIND, target.span, message);
            self.report.push(error.with_help("outputs are states, inputs and algebraic quantities"));
            return;
        }
        if target.subscripts.is_empty() && quantity.rank > 0 && item.ranges.is_empty() && item.condition.is_none() {
            self.whole(number, target.span, found);
        } else {
            self.elements(number, item, found);
        }
    }

    /// Every element of an array that exists.
    fn whole(&mut self, number: usize, span: Span, found: &mut Found) {
        for offset in 0..self.names.quantities[number].length {
            let quantity = &self.names.quantities[number];
            if !quantity.broken && quantity.exists(offset) {
                self.take(number, offset, span, found);
            }
        }
    }

    /// The elements that a pattern stands for.
    fn elements(&mut self, number: usize, item: &'a OutputItem, found: &mut Found) {
        let span = item.target.span;
        let Some(pattern) = self.pattern(number, &item.target, &item.ranges, item.condition.as_ref()) else { return };
        let combinations = pattern.combinations();
        if combinations > self.elements_left.saturating_add(self.names.quantities[number].length) {
            self.take_elements(combinations, &item.target.name.text, span);
            return;
        }
        let mut seen = Seen::default();
        for combination in 0..combinations {
            pattern.set_frame(combination, &mut self.evaluator.frame);
            let subscripts = self.subscripts_of(&pattern);
            match subscripts.and_then(|values| values.map(|values| self.existing(number, &values, span)).transpose()) {
                Ok(Some(offset)) => self.take(number, offset, span, found),
                Ok(None) => {}
                Err(fault) => {
                    let (new, go_on) = seen.judge(&fault);
                    if new {
                        let frame = self.evaluator.frame.clone();
                        self.settle::<()>(Err(fault), |error| pattern.explain(error, span, &frame));
                    }
                    if !go_on {
                        return;
                    }
                }
            }
        }
    }

    /// Offset of an element that has to exist.
    pub(crate) fn existing(&self, number: usize, subscripts: &[i64], span: Span) -> Result<usize, Fault> {
        let quantity = &self.names.quantities[number];
        if quantity.broken {
            return Err(Fault::Silent);
        }
        let offset = quantity.offset(subscripts).ok().filter(|offset| quantity.exists(*offset));
        let algebraic = quantity.kind == Kind::Algebraic;
        offset.ok_or_else(|| {
            let name = quantity.element_name(subscripts);
            let (code, message) = match algebraic {
                true => (codes::NO_SUCH_ELEMENT, format!("no equation defines `{name}`")),
                false => (codes::OUT_OF_RANGE, format!("`{name}` does not exist")),
            };
            fault(Diagnostic::error(code, span, message).with_label(quantity.name.span, "defined here"))
        })
    }

    /// Takes an element as output, unless it already is one.
    fn take(&mut self, number: usize, offset: usize, span: Span, found: &mut Found) {
        let quantity = &self.names.quantities[number];
        let (variable, name) = (quantity.variable(offset), quantity.name_at(offset));
        let first = *found.places.entry(variable).or_insert(span);
        if first != span {
            let message = format!("`{name}` is already an output");
            let warning = Diagnostic::error(codes::REPEATED_OUTPUT, span, message).with_label(first, "asked for here");
            self.report.push(warning.into_warning());
        } else {
            found.outputs.push(Output { name, variable, span });
        }
    }
}
