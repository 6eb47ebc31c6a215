//! Statements of a component with the names that they have in the whole spec.

use crate::arrays::algebra::visit;
use crate::syntax::ast::{
    Binder, Declared, Equation, Expr, ExprKind, Measure, Name, Range, Reference, StatementKind, When,
};
use std::collections::{BTreeMap, BTreeSet};

/// Where statements are taken to.
#[derive(Clone, Debug, Default)]
pub(super) struct Scope {
    /// What stands before own names, such as `cell[].`; empty for the spec itself.
    pub(super) prefix: String,
    /// The indices of the instances, each with a range.
    pub(super) indices: Vec<Binder>,
    /// First words of own names.
    pub(super) own: BTreeSet<String>,
    /// Indices with another name here.
    pub(super) renamed: BTreeMap<String, String>,
}

impl Scope {
    /// The statement as it stands in the whole spec.
    pub(super) fn statement(&self, kind: &StatementKind) -> StatementKind {
        let mut kind = kind.clone();
        let bound = bound(&kind);
        references(&mut kind, &mut |reference| self.reference(reference, &bound));
        match &mut kind {
            StatementKind::Param { declared, .. }
            | StatementKind::Input { declared, .. }
            | StatementKind::State { declared, .. }
            | StatementKind::Matrix { declared, .. } => self.declared(declared),
            StatementKind::Equation(Equation { ranges, .. }) | StatementKind::When(When { ranges, .. }) => {
                ranges.splice(0..0, self.indices.iter().cloned());
            }
            _ => {}
        }
        kind
    }

    /// The expression as it stands in the whole spec.
    pub(super) fn expr(&self, expr: &Expr) -> Expr {
        let mut expr = expr.clone();
        let mut bound = BTreeSet::new();
        binders_of(&expr, &mut bound);
        in_expr(&mut expr, &mut |reference| self.reference(reference, &bound));
        expr
    }

    /// Whether an expression reads something of the component.
    pub(super) fn reads_own(&self, expr: &Expr) -> bool {
        let mut found = false;
        visit(expr, &mut |part| {
            found |= matches!(&part.kind, ExprKind::Reference(read) if self.own.contains(head(&read.name.text)));
        });
        found
    }

    /// The name and, in front, the indices of the instances.
    pub(super) fn declared(&self, declared: &mut Declared) {
        declared.name.text.insert_str(0, &self.prefix);
        declared.dimensions.splice(0..0, self.indices.iter().cloned());
    }

    /// The subscripts for the indices of the instances.
    pub(super) fn leading(&self) -> Vec<Expr> {
        let index = |binder: &Binder| {
            let reference = Reference { name: binder.name.clone(), subscripts: Vec::new(), span: binder.name.span };
            Expr { span: binder.name.span, kind: ExprKind::Reference(reference) }
        };
        self.indices.iter().map(index).collect()
    }

    fn reference(&self, reference: &mut Reference, bound: &BTreeSet<String>) {
        let name = &mut reference.name.text;
        // Of the rows of a data file, `e.weight` is a cell.
        if bound.contains(head(name)) {
            return;
        }
        if let Some(other) = self.renamed.get(name.as_str()) {
            name.clone_from(other);
        } else if self.own.contains(head(name)) {
            name.insert_str(0, &self.prefix);
            reference.subscripts.splice(0..0, self.leading());
        }
    }
}

/// The first word of a name.
fn head(name: &str) -> &str {
    name.split(['.', '[']).next().unwrap_or(name)
}

/// Indices that are bound in a statement, on the left-hand side or in a sum.
fn bound(kind: &StatementKind) -> BTreeSet<String> {
    let mut bound = BTreeSet::new();
    let mut take = |binders: &[Binder]| bound.extend(binders.iter().map(|binder| binder.name.text.clone()));
    match kind {
        StatementKind::Param { declared, .. }
        | StatementKind::Input { declared, .. }
        | StatementKind::State { declared, .. }
        | StatementKind::Matrix { declared, .. } => take(&declared.dimensions),
        StatementKind::Equation(equation) => take(&equation.ranges),
        StatementKind::When(when) => take(&when.ranges),
        StatementKind::Output(items) => items.iter().for_each(|item| take(&item.ranges)),
        _ => {}
    }
    for expr in values(kind) {
        binders_of(expr, &mut bound);
    }
    bound
}

/// The expressions whose sums may bind indices.
fn values(kind: &StatementKind) -> Vec<&Expr> {
    match kind {
        StatementKind::Param { value, .. } => vec![value],
        StatementKind::Input { signal, .. } => vec![signal],
        StatementKind::State { initial, .. } => vec![initial],
        StatementKind::Equation(equation) => std::iter::once(&equation.value).chain(&equation.condition).collect(),
        StatementKind::When(when) => {
            std::iter::once(&when.trigger).chain(when.assignments.iter().map(|assignment| &assignment.value)).collect()
        }
        _ => Vec::new(),
    }
}

fn binders_of(expr: &Expr, bound: &mut BTreeSet<String>) {
    visit(expr, &mut |part| {
        if let ExprKind::SumOver { binder, .. } = &part.kind {
            bound.insert(binder.name.text.clone());
        }
    });
}

/// Meets every name of a quantity or index that a statement uses, its left-hand side included.
pub(super) fn references(kind: &mut StatementKind, action: &mut dyn FnMut(&mut Reference)) {
    let ranges = |binders: &mut [Binder], action: &mut dyn FnMut(&mut Reference)| {
        binders.iter_mut().for_each(|binder| in_range(binder.range.as_mut(), action));
    };
    match kind {
        StatementKind::Const { value, .. } => in_expr(value, action),
        StatementKind::Index(binders) => ranges(binders, action),
        StatementKind::Param { declared, value } => {
            ranges(&mut declared.dimensions, action);
            in_expr(value, action);
        }
        StatementKind::Tunable { declared, value, within } => {
            ranges(&mut declared.dimensions, action);
            in_expr(value, action);
            in_range(Some(within), action);
        }
        StatementKind::Input { declared, signal: value, within, .. }
        | StatementKind::State { declared, initial: value, within, .. } => {
            ranges(&mut declared.dimensions, action);
            in_expr(value, action);
            in_range(within.as_mut(), action);
        }
        StatementKind::Matrix { declared, .. } => ranges(&mut declared.dimensions, action),
        StatementKind::Connector { declared, within } => {
            ranges(&mut declared.dimensions, action);
            in_range(within.as_mut(), action);
        }
        StatementKind::Instance { declared, arguments, .. } => {
            ranges(&mut declared.dimensions, action);
            arguments.iter_mut().for_each(|(_, value)| in_expr(value, action));
        }
        StatementKind::Equation(equation) => in_equation(equation, action),
        StatementKind::When(when) => {
            in_expr(&mut when.trigger, action);
            ranges(&mut when.ranges, action);
            when.after.iter_mut().for_each(|after| in_measure(after, action));
            when.manners
                .iter_mut()
                .filter_map(|(_, number)| number.as_mut())
                .for_each(|number| in_expr(number, action));
            when.assignments.iter_mut().for_each(|assignment| in_equation(assignment, action));
        }
        StatementKind::Output(items) => {
            for item in items {
                in_reference(&mut item.target, action);
                ranges(&mut item.ranges, action);
                item.condition.iter_mut().for_each(|condition| in_expr(condition, action));
            }
        }
        StatementKind::Function { body, .. } => in_expr(body, action),
        StatementKind::Step(step, early) => {
            in_measure(step, action);
            early
                .iter_mut()
                .for_each(|(step, until)| [step, until].into_iter().for_each(|time| in_measure(time, action)));
        }
        StatementKind::Span(time) | StatementKind::Every(time) => in_measure(time, action),
        StatementKind::Model { .. }
        | StatementKind::Solver(_)
        | StatementKind::Units(_)
        | StatementKind::Time(_)
        | StatementKind::Component { .. }
        | StatementKind::End
        | StatementKind::Include(_) => {}
    }
}

fn in_equation(equation: &mut Equation, action: &mut dyn FnMut(&mut Reference)) {
    in_reference(&mut equation.target, action);
    in_expr(&mut equation.value, action);
    in_range(equation.within.as_mut(), action);
    equation.ranges.iter_mut().for_each(|binder| in_range(binder.range.as_mut(), action));
    equation.condition.iter_mut().for_each(|condition| in_expr(condition, action));
}

fn in_measure(measure: &mut Measure, action: &mut dyn FnMut(&mut Reference)) {
    in_expr(&mut measure.value, action);
}

fn in_range(range: Option<&mut Range>, action: &mut dyn FnMut(&mut Reference)) {
    if let Some(range) = range {
        in_expr(&mut range.low, action);
        in_expr(&mut range.high, action);
    }
}

fn in_reference(reference: &mut Reference, action: &mut dyn FnMut(&mut Reference)) {
    reference.subscripts.iter_mut().for_each(|part| in_expr(part, action));
    action(reference);
}

/// Meets the names in an expression.
fn in_expr(expr: &mut Expr, action: &mut dyn FnMut(&mut Reference)) {
    match &mut expr.kind {
        ExprKind::Number(_) | ExprKind::Measured(..) | ExprKind::Data { .. } | ExprKind::Samples { .. } => {}
        ExprKind::Reference(reference) => in_reference(reference, action),
        ExprKind::Sum(terms) => terms.iter_mut().for_each(|(_, part)| in_expr(part, action)),
        ExprKind::Product(first, rest) => {
            in_expr(first, action);
            rest.iter_mut().for_each(|(_, part)| in_expr(part, action));
        }
        ExprKind::Power(one, other) | ExprKind::Compare(_, one, other) => {
            in_expr(one, action);
            in_expr(other, action);
        }
        ExprKind::Negate(operand) | ExprKind::Not(operand) => in_expr(operand, action),
        ExprKind::If { condition, yes, no } => [condition, yes, no].into_iter().for_each(|part| in_expr(part, action)),
        ExprKind::SumOver { binder, condition, body } => {
            in_range(binder.range.as_mut(), action);
            condition.iter_mut().for_each(|part| in_expr(part, action));
            in_expr(body, action);
        }
        ExprKind::Call { arguments, .. } => arguments.iter_mut().for_each(|part| in_expr(part, action)),
        ExprKind::Delayed { of, argument, .. } => {
            in_reference(of, action);
            in_expr(argument, action);
        }
        ExprKind::Matrix(rows) => rows.iter_mut().flatten().for_each(|part| in_expr(part, action)),
        ExprKind::Logical(_, operands) => operands.iter_mut().for_each(|part| in_expr(part, action)),
        // Made by later passes.
        ExprKind::Solved { .. } => {}
    }
}

/// A name with a prefix, at its own place.
pub(super) fn prefixed(prefix: &str, name: &Name) -> Name {
    Name { text: format!("{prefix}{}", name.text), span: name.span }
}
