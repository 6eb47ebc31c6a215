//! Statements that have, or make, something in braces: components, their instances, events.

use super::{Builder, Parts};
use crate::syntax::ast::*;
use crate::syntax::grammar::Rule;

impl Builder<'_> {
    pub(super) fn component(&mut self, parts: &mut Parts) -> Option<StatementKind> {
        let name = self.name(parts.take(Rule::name)?);
        let mut parameters = Vec::new();
        while let Some(parameter) = parts.take(Rule::parameter) {
            let mut parts = Parts::of(parameter);
            let name = self.name(parts.take(Rule::name)?);
            let unit = parts.take(Rule::unit).and_then(|unit| self.unit(unit));
            let value = match parts.take(Rule::expr) {
                Some(value) => Some(self.expr(value)?),
                None => None,
            };
            parameters.push(Parameter { name, unit, value });
        }
        Some(StatementKind::Component { name, parameters })
    }

    pub(super) fn instance(&mut self, parts: &mut Parts) -> Option<StatementKind> {
        let declared = self.declared(parts)?;
        let component = self.name(parts.take(Rule::name)?);
        let mut arguments = Vec::new();
        while let Some(argument) = parts.take(Rule::argument) {
            let mut parts = Parts::of(argument);
            let name = self.name(parts.take(Rule::name)?);
            arguments.push((name, self.expr(parts.take(Rule::expr)?)?));
        }
        Some(StatementKind::Instance { declared, component, arguments })
    }

    pub(super) fn when(&mut self, parts: &mut Parts) -> Option<When> {
        let condition = self.expr(parts.take(Rule::expr)?)?;
        let number = |value: f64| Box::new(Expr { span: condition.span, kind: ExprKind::Number(value) });
        let (yes, no, span) = (number(1.0), number(0.0), condition.span);
        let trigger = Expr { span, kind: ExprKind::If { condition: Box::new(condition), yes, no } };
        let (ranges, _) = self.clauses(parts)?;
        let after = match parts.take(Rule::after) {
            Some(after) => Some(self.measure(Parts::of(after).take(Rule::measure)?)?),
            None => None,
        };
        let mut manners = Vec::new();
        while let Some(manner) = parts.take(Rule::manner) {
            let mut manner = Parts::of(manner);
            let name = self.name(manner.take(Rule::name)?);
            let number = match manner.take(Rule::expr) {
                Some(number) => Some(self.expr(number)?),
                None => None,
            };
            manners.push((name, number));
        }
        Some(When { trigger, ranges, after, manners, assignments: Vec::new() })
    }
}
