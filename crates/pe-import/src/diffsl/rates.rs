//! The derivative of each state, from `F` or from `M = F`.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

use super::{Reader, Side, lengths};
use crate::expr::Expr;
use crate::model::Kind;
use crate::solve::{matched, replaced, solved};

/// Most equations that are not solved for the derivative of their own state.
const MOST_COUPLED: usize = 500;

/// Equations that are put in place, one within the other, in search of a quantity.
const DEEPEST: usize = 20;

/// Most parts of an equation in which others are put in place.
const MOST_PARTS: usize = 20_000;

impl Reader<'_> {
    /// Gives states their derivatives, and those that have none their equations. `start` is where missing parts are told.
    pub(super) fn rates(&mut self, start: Span) {
        let [mass, right] = [0, 1].map(|side| self.sides[side].take());
        for (name, missing) in [("u", self.states.is_empty()), ("F", right.is_none())] {
            if missing {
                let message = format!("the model has no `{name}`");
                self.findings.push(Diagnostic::error(codes::IMPORT_SYNTAX, start, message));
            }
        }
        let Some((right, span)) = right.filter(|_| !self.states.is_empty()) else { return };
        let (count, dudt) = (self.states.len(), self.rates.len());
        let sizes = [("F", right.len(), span), ("M", mass.as_ref().map_or(count, |(side, _)| side.len()), span)];
        for (name, length, span) in sizes.into_iter().chain([("dudt", if dudt == 0 { count } else { dudt }, span)]) {
            if length != count {
                let message = format!("`{name}` has {}, and `u` {}", lengths(&[length]), lengths(&[count]));
                self.findings.push(Diagnostic::error(codes::IMPORT_MATH, span, message));
                return;
            }
        }
        match mass {
            None => {
                for (state, (rate, span)) in self.states.clone().into_iter().zip(right) {
                    self.rate(state, rate, span);
                }
            }
            Some((mass, _)) => self.solve(mass, right),
        }
    }

    fn rate(&mut self, state: usize, value: Expr, span: Span) {
        let quantity = &mut self.model.quantities[state];
        quantity.equation = span;
        if let Kind::State { rate, .. } = &mut quantity.kind {
            *rate = value;
        }
    }

    /// Solves `M = F` for the derivatives that `M` reads and for the states of which it reads none.
    fn solve(&mut self, mass: Side, right: Side) {
        let rates: HashSet<usize> = self.rates.iter().copied().collect();
        let mass: Vec<Expr> = mass.iter().map(|(side, _)| self.expanded(side, &rates)).collect();
        let read: BTreeSet<usize> = mass.iter().flat_map(names).collect();
        let mut coupled = Vec::new();
        for (index, (side, span)) in right.iter().enumerate() {
            match self.rates.get(index) {
                Some(rate) if mass[index] == Expr::Name(*rate) => {
                    let quantity = &mut self.model.quantities[*rate];
                    quantity.kind = Kind::Algebraic(side.clone());
                    quantity.equation = *span;
                }
                _ => coupled.push(index),
            }
        }
        // What else stands for the derivative of a state, if it is read.
        let own = |index: usize| self.rates.get(index).copied().filter(|rate| read.contains(rate));
        if coupled.len() > MOST_COUPLED {
            let message =
                format!("more than {MOST_COUPLED} equations are not solved for the derivative of their state");
            return self.findings.push(Diagnostic::error(codes::IMPORT_LIMIT, right[coupled[0]].1, message));
        }
        let free: Vec<usize> = coupled.iter().map(|index| own(*index).unwrap_or(self.states[*index])).collect();
        let held: HashSet<usize> = free.iter().copied().filter(|of| !rates.contains(of)).collect();
        let mut equations: Vec<Expr> = Vec::new();
        let mut candidates: Vec<Vec<usize>> = Vec::new();
        for (number, index) in coupled.iter().enumerate() {
            let whole = Expr::sum([(false, mass[*index].clone()), (true, right[*index].0.clone())]);
            // An equation with derivatives gives one of them, its own if it can.
            let has_rates = names(&whole).iter().any(|of| rates.contains(of));
            let whole = if has_rates { whole } else { self.expanded(&whole, &held) };
            let read = names(&whole);
            let mut found: Vec<usize> =
                free.iter().copied().filter(|of| read.contains(of) && rates.contains(of) == has_rates).collect();
            found.sort_by_key(|of| *of != free[number]);
            candidates.push(found);
            equations.push(whole);
        }
        let determined = matched(&candidates);
        for (number, index) in coupled.iter().enumerate() {
            let span = right[*index].1;
            let solution = determined[number].and_then(|of| Some((of, solved(&equations[number], of, &[])?)));
            let Some((of, solution)) = solution else {
                let state = self.model.quantities[self.states[*index]].id.clone();
                let (message, help) = match determined[number] {
                    Some(of) => (
                        format!(
                            "equation {index} of `M` and `F` cannot be solved for `{}`",
                            self.model.quantities[of].id
                        ),
                        "solve it by hand, and write the solution as a tensor instead of a state",
                    ),
                    None => (
                        format!(
                            "equation {index} of `M` and `F` determines no derivative or state; `{state}` has none"
                        ),
                        "a spec has ordinary differential equations: solve the algebraic ones by hand",
                    ),
                };
                self.findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span, message).with_help(help));
                continue;
            };
            let size = solution.extent().1;
            for (later, index) in equations[number + 1..].iter_mut().zip(&coupled[number + 1..]) {
                let mut times = 0usize;
                later.each(&mut |part| times += usize::from(*part == Expr::Name(of)));
                if times > 0 && times.saturating_mul(size) > MOST_PARTS {
                    let message = format!("equation {index} of `M` and `F` is too long when others are put in place");
                    self.findings.push(Diagnostic::error(codes::IMPORT_LIMIT, right[*index].1, message));
                } else if times > 0 {
                    *later = replaced(later, of, &solution);
                }
            }
            let quantity = &mut self.model.quantities[of];
            quantity.equation = span;
            quantity.kind = Kind::Algebraic(solution);
        }
        self.derivatives();
    }

    /// Derivatives that were solved for: within their states where nothing else reads them.
    fn derivatives(&mut self) {
        let expressions = self.model.quantities.iter().flat_map(|quantity| quantity.kind.expressions());
        let read: BTreeSet<usize> = expressions.flat_map(names).collect();
        for (state, rate) in self.states.clone().into_iter().zip(self.rates.clone()) {
            let Kind::Algebraic(value) = self.model.quantities[rate].kind.clone() else { continue };
            let span = self.model.quantities[rate].equation;
            if read.contains(&rate) {
                self.rate(state, Expr::Name(rate), span);
            } else {
                self.model.quantities[rate].kind = Kind::Missing;
                self.rate(state, value, span);
            }
        }
    }

    /// An expression with equations put in the place of quantities until it reads some of these.
    fn expanded(&self, expr: &Expr, wanted: &HashSet<usize>) -> Expr {
        let equation = |name: usize| match &self.model.quantities[name].kind {
            Kind::Algebraic(inner) if inner.literal().is_none() => Some(inner),
            _ => None,
        };
        let mut expr = expr.clone();
        for _ in 0..DEEPEST {
            let read = names(&expr);
            let mut sizes = read.iter().filter_map(|name| Some((*name, equation(*name)?.extent().1))).peekable();
            if read.iter().any(|name| wanted.contains(name)) || sizes.peek().is_none() {
                break;
            }
            let sizes: BTreeMap<usize, usize> = sizes.collect();
            let mut parts = 0usize;
            expr.each(&mut |part| match part {
                Expr::Name(name) => parts = parts.saturating_add(*sizes.get(name).unwrap_or(&1)),
                _ => parts += 1,
            });
            if parts > MOST_PARTS {
                break;
            }
            expr = expr.map(&mut |leaf| if let Expr::Name(name) = leaf { equation(*name).cloned() } else { None });
        }
        expr
    }
}

/// The quantities that an expression reads.
fn names(expr: &Expr) -> BTreeSet<usize> {
    let mut found = BTreeSet::new();
    expr.each(&mut |part| {
        if let Expr::Name(name) = part {
            found.insert(*name);
        }
    });
    found
}
