//! The derivative of each state, from `F` or from `M = F`.

use std::collections::HashSet;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Span};

use super::{Reader, Side, lengths};
use crate::expr::Expr;
use crate::model::Kind;
use crate::solve::{matched, reads, replaced, solved};

/// Most equations that are not solved for the derivative of their own state.
const MOST_COUPLED: usize = 500;

/// Equations that are put in place, one within the other, in search of a quantity.
const DEEPEST: usize = 20;

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
        let mut read = HashSet::new();
        for side in &mass {
            side.each(&mut |part| match part {
                Expr::Name(name) if rates.contains(name) => drop(read.insert(*name)),
                _ => {}
            });
        }
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
            let message = format!("more than {MOST_COUPLED} equations are not solved for the derivative of their state");
            return self.findings.push(Diagnostic::error(codes::IMPORT_LIMIT, right[coupled[0]].1, message));
        }
        let free: Vec<usize> = coupled.iter().map(|index| own(*index).unwrap_or(self.states[*index])).collect();
        let held: HashSet<usize> = free.iter().copied().filter(|of| !rates.contains(of)).collect();
        let mut equations: Vec<Expr> = Vec::new();
        let mut candidates: Vec<Vec<usize>> = Vec::new();
        for (number, index) in coupled.iter().enumerate() {
            let whole = Expr::sum([(false, mass[*index].clone()), (true, right[*index].0.clone())]);
            // An equation with derivatives gives one of them, its own if it can.
            let slopes: Vec<usize> = free.iter().copied().filter(|of| rates.contains(of) && reads(&whole, *of)).collect();
            let whole = if slopes.is_empty() { self.expanded(&whole, &held) } else { whole };
            let mut found = if slopes.is_empty() {
                free.iter().copied().filter(|of| held.contains(of) && reads(&whole, *of)).collect()
            } else {
                slopes
            };
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
                        format!("equation {index} of `M` and `F` cannot be solved for `{}`", self.model.quantities[of].id),
                        "solve it by hand, and write the solution as a tensor instead of a state",
                    ),
                    None => (
                        format!("equation {index} of `M` and `F` determines no derivative or state; `{state}` has none"),
                        "a spec has ordinary differential equations: solve the algebraic ones by hand",
                    ),
                };
                self.findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span, message).with_help(help));
                continue;
            };
            for later in &mut equations[number + 1..] {
                *later = replaced(later, of, &solution);
            }
            let quantity = &mut self.model.quantities[of];
            quantity.equation = span;
            quantity.kind = Kind::Algebraic(solution);
        }
        self.derivatives(&rates);
    }

    /// Derivatives that were solved for: within their states where nothing else reads them.
    fn derivatives(&mut self, rates: &HashSet<usize>) {
        let mut read = HashSet::new();
        for expr in self.model.quantities.iter().flat_map(|quantity| quantity.kind.expressions()) {
            expr.each(&mut |part| match part {
                Expr::Name(name) if rates.contains(name) => drop(read.insert(*name)),
                _ => {}
            });
        }
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
        let mut expr = expr.clone();
        for _ in 0..DEEPEST {
            let mut found = false;
            expr.each(&mut |part| found |= matches!(part, Expr::Name(name) if wanted.contains(name)));
            let mut changed = false;
            let put_in = |leaf: &Expr| match leaf {
                Expr::Name(name) => match &self.model.quantities[*name].kind {
                    Kind::Algebraic(inner) if inner.literal().is_none() => Some(inner.clone()),
                    _ => None,
                },
                _ => None,
            };
            if found {
                break;
            }
            let next = expr.map(&mut |leaf| put_in(leaf).inspect(|_| changed = true));
            if !changed || next.extent().1 > 20_000 {
                break;
            }
            expr = next;
        }
        expr
    }
}
