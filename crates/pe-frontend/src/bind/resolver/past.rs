//! What quantities were some time ago, `x(t - 20 ms)`.

use super::{Reads, Resolver, all};
use crate::bound::{Node, NodeKind};
use crate::language::measures::{TIMES, unit_scale};
use crate::syntax::ast::{Expr, Name, Reference, Sign};
use crate::syntax::delay;
use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

impl<'a> Resolver<'_, 'a> {
    /// What a quantity was some time ago, or a call of a function of the spec, which may look the same.
    pub(super) fn delayed(
        &mut self,
        of: &'a Reference,
        argument: &'a Expr,
        unit: Option<&'a Name>,
        span: Span,
    ) -> Option<NodeKind> {
        if let Some(number) = self.names.function_numbers.get(of.name.text.as_str()).copied()
            && of.subscripts.is_empty()
        {
            let argument = self.number(argument).map(|argument| vec![argument]);
            return self.inline(number, argument, 1, span);
        }
        if self.names.find(&of.name.text).is_none() && self.argument(&of.name).is_none() {
            if !self.names.is_poisoned(&of.name.text) {
                self.report.push(self.names.unknown(&of.name, &self.scope));
            }
            return None;
        }
        let scale = unit_scale(unit, &TIMES, "delay", self.names.time.seconds).map_err(|error| self.report.push(error));
        let element = self.reference(of).map(|kind| Node { kind, span: of.span });
        let Some(after_time) = delay::terms(argument) else {
            let message = format!("what `{}` was some time ago is read at `t - TIME`", of.name.text);
            let help = "write the delay behind the time, as in `x(t - 20 ms)`; a product needs its sign: `x*(...)`";
            self.report.push(Diagnostic::error(codes::BAD_DELAY, argument.span, message).with_help(help));
            return None;
        };
        let reads = std::mem::replace(&mut self.reads, Reads::Constants);
        let terms = all(after_time.iter().map(|(sign, term)| {
            let sign = if *sign == Sign::Plus { Sign::Minus } else { Sign::Plus };
            self.number(term).map(|term| (sign, term))
        }));
        self.reads = reads;
        let delay = Node { kind: NodeKind::Sum(terms?), span: argument.span };
        let (element, scale) = (element?, scale.ok()?);
        let NodeKind::Element(number, _) = element.kind else {
            let message = format!("`{}` is a number and has no past", of.name.text);
            self.report.push(Diagnostic::error(codes::BAD_DELAY, of.span, message));
            return None;
        };
        let quantity = &self.names.quantities[number];
        let sampled = quantity.block.is_some();
        if quantity.angle || sampled {
            let what = if sampled { "a sampled quantity" } else { "an angle" };
            let message = format!("`{}` is {what}, whose past is not kept", of.name.text);
            let help = match sampled {
                true => "keep it in states of the block: `next before = x`",
                false => "read its sine and cosine, as quantities of their own",
            };
            self.report.push(Diagnostic::error(codes::DELAY_MODEL, of.span, message).with_help(help));
            return None;
        }
        Some(NodeKind::Delayed(Box::new(element), Box::new(delay), scale))
    }
}
