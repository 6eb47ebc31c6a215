//! Samples of a rate with several steps per period whose equations are affine.
//!
//! What such samples read is multiplied by the tick before anything else: a tick of 1 leaves every word as it is, one of 0
//! makes all changes zero. So a sample computes the same words as one that is taken in every step, and what a change has
//! below the bits that the multiplier sees is not lost.

use std::collections::BTreeMap;

use pe_ir::index::{StateId, at};
use pe_ir::model::{Expr, Model, Variable};

use super::plan::{Plan, of, times};

/// Variables that are read, for each sampled state, up to which they are multiplied by the tick; beyond it fewer products
/// multiply the changes.
const READ_PER_STATE: usize = 2;

/// Plans the ends of the sampled states of a rate, unless their equations are not affine or read too many variables.
pub fn ends(plan: &mut Plan, rate: u32, tick: Variable) -> bool {
    let model = plan.model;
    let Some(readers) = Readers::of(model, rate) else { return false };
    let mut ticked = Ticked { known: BTreeMap::new(), tick };
    for (variable, owner) in &readers.leaves {
        let sum = Expr::product(vec![of(*variable), of(tick)]);
        let name = format!("{}.sampled", name(model, *variable));
        ticked.known.insert(*variable, plan.auxiliary(*owner, name, sum, true));
    }
    for (algebraic, owner) in &readers.algebraics {
        let variable = Variable::Algebraic(*algebraic);
        let sum = ticked.expr(&model.algebraics[at(*algebraic)].expr);
        let name = format!("{}.sampled", name(model, variable));
        ticked.known.insert(variable, plan.auxiliary(*owner, name, sum, false));
    }
    for state in sampled(model, rate) {
        let own = Variable::State(state);
        let next = ticked.expr(&model.states[state].derivative);
        plan.end(state, Some(own), Expr::sum(vec![next, times(-1.0, ticked.known[&own])]));
    }
    true
}

/// The states of a rate.
fn sampled(model: &Model, rate: u32) -> impl Iterator<Item = StateId> + '_ {
    model.states.numbered().filter(move |(_, state)| state.rate == Some(rate)).map(|(number, _)| number)
}

fn name(model: &Model, variable: Variable) -> &str {
    match variable {
        Variable::State(state) => &model.states[state].name,
        Variable::Input(input) => &model.inputs[at(input)].name,
        Variable::Algebraic(algebraic) => &model.algebraics[at(algebraic)].name,
    }
}

/// What the samples of a rate read, each with the first sampled state that does: on its PE the product with the tick is
/// computed.
struct Readers {
    /// States and inputs.
    leaves: BTreeMap<Variable, StateId>,
    /// Algebraic variables, in dependency order.
    algebraics: BTreeMap<u32, StateId>,
}

impl Readers {
    /// `None` for what is better left to the products of changes.
    fn of(model: &Model, rate: u32) -> Option<Readers> {
        let mut readers = Readers { leaves: BTreeMap::new(), algebraics: BTreeMap::new() };
        let mut states = 0;
        for state in sampled(model, rate) {
            let row = &model.states[state].derivative;
            if !is_affine(row) {
                return None;
            }
            states += 1;
            readers.visit(row, state);
            readers.leaves.entry(Variable::State(state)).or_insert(state);
        }
        // Each reads only earlier ones, so that the last one has all its readers.
        let mut beyond = u32::MAX;
        while let Some((&algebraic, &owner)) = readers.algebraics.range(..beyond).next_back() {
            let expr = &model.algebraics[at(algebraic)].expr;
            if !is_affine(expr) {
                return None;
            }
            readers.visit(expr, owner);
            beyond = algebraic;
        }
        (readers.leaves.len() <= READ_PER_STATE * states).then_some(readers)
    }

    fn visit(&mut self, expr: &Expr, reader: StateId) {
        expr.each_variable(&mut |variable| {
            let owner = match variable {
                Variable::Algebraic(algebraic) => self.algebraics.entry(algebraic).or_insert(reader),
                leaf => self.leaves.entry(leaf).or_insert(reader),
            };
            *owner = reader.min(*owner);
        });
    }
}

/// Whether an expression is a sum of variables times numbers, and a number.
fn is_affine(expr: &Expr) -> bool {
    match expr {
        Expr::Constant(_) | Expr::Variable(_) => true,
        Expr::Sum(members) => members.iter().all(is_affine),
        Expr::Product(members) => {
            let mut varying = members.iter().filter(|member| member.as_constant().is_none());
            varying.next().is_none_or(is_affine) && varying.next().is_none()
        }
        Expr::Power(..) | Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => false,
    }
}

/// Variables times the tick.
struct Ticked {
    known: BTreeMap<Variable, Variable>,
    tick: Variable,
}

impl Ticked {
    /// An affine expression times the tick.
    fn expr(&self, expr: &Expr) -> Expr {
        match expr {
            Expr::Constant(number) => times(*number, self.tick),
            Expr::Variable(variable) => of(self.known[variable]),
            Expr::Sum(members) => Expr::sum(members.iter().map(|member| self.expr(member)).collect()),
            Expr::Product(members) => match members.iter().position(|member| member.as_constant().is_none()) {
                Some(varying) => {
                    let mut members = members.clone();
                    members[varying] = self.expr(&members[varying]);
                    Expr::product(members)
                }
                None => Expr::product(members.iter().cloned().chain([of(self.tick)]).collect()),
            },
            Expr::Power(..) | Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => unreachable!("not affine"),
        }
    }
}
