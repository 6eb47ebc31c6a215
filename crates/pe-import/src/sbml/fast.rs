//! Fast reactions: each is in equilibrium at all times, which determines one of its species. What a fast reaction takes
//! and makes, it does in fixed parts, so of every two of its species some combination knows nothing of it; these are the
//! states, with the rates of all other reactions. Species begin in equilibrium, and return to it after events.

use std::collections::HashMap;

use pe_ir::codes;
use pe_ir::model::Function;
use pe_ir::source::Diagnostic;
use roxmltree::Node;

use super::Reader;
use crate::expr::{Callee, Expr};
use crate::mathml;
use crate::model::{Kind, Model, Quantity};
use crate::solve::{reads, replaced, solved};
use crate::xml::span;

/// Equations that are put in place, one within the other, until a kinetic law reads states alone.
const DEEPEST: usize = 20;

/// Parts of a kinetic law with these equations in place, at most.
const MOST_PARTS: usize = 20_000;

/// Distance from the equilibrium, relative to what there is, at which it is seen whether a reaction leads back.
const ASIDE: f64 = 1e-3;

/// A fast reaction.
pub(super) struct Fast<'a> {
    node: Node<'a, 'a>,
    /// Its quantity, which has the kinetic law.
    reaction: usize,
    /// Species, whether they are taken away, and how much of their amount.
    changes: Vec<(usize, bool, Expr)>,
}

/// What a fast reaction does to a quantity.
struct Change {
    index: usize,
    /// The compartment in which it is a concentration, if it is one.
    volume: Option<usize>,
    /// How much of the amount comes with each reaction, and its number.
    amount: Expr,
    number: f64,
}

impl Change {
    /// How much of this one comes with one of another.
    fn over(&self, other: &Change) -> Ratio {
        let (minus, amounts) = match (self.amount.literal(), other.amount.literal()) {
            (Some(own), Some(other)) => (own / other < 0.0, Expr::number((own / other).abs())),
            _ => (false, self.amount.clone().over(other.amount.clone())),
        };
        if self.volume == other.volume {
            return Ratio(minus, amounts);
        }
        let volumes = [(other.volume, false), (self.volume, true)].into_iter();
        let volumes = volumes.filter_map(|(volume, divides)| Some((divides, Expr::Name(volume?))));
        Ratio(minus, Expr::product([(false, amounts)].into_iter().chain(volumes)))
    }
}

/// A factor, which is below zero with `true`.
#[derive(Clone)]
struct Ratio(bool, Expr);

impl Ratio {
    /// So many times another expression, as a member of a sum.
    fn of(&self, other: Expr) -> (bool, Expr) {
        (self.0, self.1.clone().times(other))
    }

    /// The same, to be subtracted.
    fn less(&self, other: Expr) -> (bool, Expr) {
        (!self.0, self.1.clone().times(other))
    }
}

/// Species in equilibrium.
pub(super) struct Equilibrium {
    /// The quantity that is determined by it.
    pivot: usize,
    /// Each other quantity, the state that is left as it is, and how much of the other comes with one of the pivot.
    others: Vec<(usize, usize, Ratio)>,
}

impl<'a> Fast<'a> {
    pub(super) fn new(node: Node<'a, 'a>, reaction: usize) -> Self {
        Fast { node, reaction, changes: Vec::new() }
    }

    pub(super) fn change(&mut self, species: usize, is_reactant: bool, amount: Expr) {
        self.changes.push((species, is_reactant, amount));
    }
}

impl<'a> Reader<'a, '_> {
    /// Puts the species of fast reactions into equilibrium, after what all others do is known.
    pub(super) fn fast_reactions(&mut self) {
        let all = std::mem::take(&mut self.fast);
        let species: Vec<usize> =
            all.iter().flat_map(|fast| fast.changes.iter().map(|(species, ..)| self.held(*species))).collect();
        self.before_all(&species);
        self.no_past(&species);
        for fast in all {
            let Err(why) = self.equilibrium(&fast) else { continue };
            let id = &self.model.quantities[fast.reaction].id;
            let message = format!("`{id}` is a fast reaction whose equilibrium cannot be expressed: {why}");
            let help = "replace it by the equilibrium it stands for, or give it a large rate";
            let finding = Diagnostic::error(codes::IMPORT_UNSUPPORTED, span(fast.node), message);
            self.findings.push(finding.with_help(help));
        }
    }

    /// Lets initial values read species as they are before any reaction.
    fn before_all(&mut self, species: &[usize]) {
        let initials: HashMap<usize, Expr> = (species.iter())
            .filter_map(|index| match &self.model.quantities[*index].kind {
                Kind::State { initial, .. } | Kind::Constant(initial) => Some((*index, initial.clone())),
                _ => None,
            })
            .collect();
        let early = |expr: &Expr| {
            let mut expr = self.in_place(expr).filter(|expr| species.iter().any(|index| reads(expr, *index)))?;
            for _ in 0..DEEPEST {
                let put_in = expr.map(&mut |leaf| match leaf {
                    Expr::Name(name) => initials.get(name).cloned(),
                    _ => None,
                });
                if put_in.extent().1 > MOST_PARTS {
                    return None;
                }
                expr = put_in;
            }
            Some(expr)
        };
        let changed: Vec<Option<Expr>> = (self.model.quantities.iter())
            .map(|quantity| match &quantity.kind {
                Kind::Constant(expr) | Kind::State { initial: expr, .. } => early(expr),
                _ => None,
            })
            .collect();
        for (quantity, changed) in self.model.quantities.iter_mut().zip(changed) {
            let (Kind::Constant(expr) | Kind::State { initial: expr, .. }, Some(changed)) =
                (&mut quantity.kind, changed)
            else {
                continue;
            };
            *expr = changed;
        }
    }

    /// Refuses delays of species that fast reactions change: before time zero they were not in equilibrium.
    fn no_past(&mut self, species: &[usize]) {
        let mut found = Vec::new();
        for quantity in &self.model.quantities {
            for expr in quantity.kind.expressions() {
                expr.each(&mut |part| {
                    if let Expr::Call(Callee::Past, members) = part {
                        let of = self.in_place(&members[0]);
                        if of.is_none_or(|of| species.iter().any(|index| reads(&of, *index))) {
                            found.push((quantity.id.clone(), quantity.equation));
                        }
                    }
                });
            }
        }
        found.dedup();
        for (id, span) in found {
            let message = format!("`{id}` reads the past of what a fast reaction changes, which cannot be expressed");
            let help = "before the beginning it is not in equilibrium: write what it was as an equation of its own";
            self.findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span, message).with_help(help));
        }
    }

    fn equilibrium(&mut self, fast: &Fast) -> Result<(), &'static str> {
        let changes = self.net(fast)?;
        let of = |index: usize| match &self.model.quantities[index].kind {
            Kind::State { initial, rate } => Some((initial.clone(), rate.clone())),
            Kind::Constant(initial) => Some((initial.clone(), Expr::number(0.0))),
            _ => None,
        };
        let Some(states) = changes.iter().map(|change| of(change.index)).collect::<Option<Vec<_>>>() else {
            return Err("something else determines one of its species, such as another fast reaction");
        };
        let law = self.law(fast.reaction)?;
        let next = self.model.quantities.len();
        for (place, change) in changes.iter().enumerate() {
            let pivot = change.index;
            let others = changes.iter().enumerate().filter(|(other, _)| *other != place);
            let others: Vec<(usize, usize, Ratio)> =
                others.zip(next..).map(|((_, other), state)| (other.index, state, other.over(change))).collect();
            let along = |state: usize, ratio: &Ratio, of: Expr| Expr::sum([(false, Expr::Name(state)), ratio.of(of)]);
            let reduced = others.iter().fold(law.clone(), |law, (index, state, ratio)| {
                replaced(&law, *index, &along(*state, ratio, Expr::Name(pivot)))
            });
            let Some(solution) = solved(&reduced, pivot, &self.model.functions) else { continue };
            let (first, flow) = &states[place];
            let rest = states.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, of)| of);
            for ((index, _, ratio), (initial, rate)) in others.iter().zip(rest) {
                let less = |of: &Expr, pivot: &Expr| Expr::sum([(false, of.clone()), ratio.less(pivot.clone())]);
                let kind = Kind::State { initial: less(initial, first), rate: less(rate, flow) };
                self.combination(*index, pivot, fast.reaction, kind);
            }
            if !self.leads_back(&reduced, pivot, &solution, change.number) {
                return Err("from its initial values the reaction leads away from it, or it is not known whither");
            }
            for (index, state, ratio) in &others {
                self.model.quantities[*index].kind = Kind::Algebraic(along(*state, ratio, Expr::Name(pivot)));
            }
            self.model.quantities[pivot].kind = Kind::Algebraic(solution);
            self.equilibria.push(Equilibrium { pivot, others });
            return Ok(());
        }
        match changes.is_empty() {
            true => Ok(()),
            false => Err("its kinetic law is zero for more than one amount of its species, or for none"),
        }
    }

    /// The quantities that a reaction changes.
    fn net(&self, fast: &Fast) -> Result<Vec<Change>, &'static str> {
        let mut quantities: Vec<(usize, Option<usize>)> = Vec::new();
        let mut sums: Vec<Vec<(bool, Expr)>> = Vec::new();
        for (species, is_reactant, amount) in &fast.changes {
            let index = self.held(*species);
            let place = quantities.iter().position(|(known, _)| *known == index).unwrap_or_else(|| {
                quantities.push((index, self.volume_of(*species).filter(|_| index == *species)));
                sums.push(Vec::new());
                sums.len() - 1
            });
            sums[place].push((*is_reactant, amount.clone()));
        }
        let mut net = Vec::new();
        for ((index, volume), members) in quantities.into_iter().zip(sums) {
            let amount = Expr::sum(members);
            let (mut moves, mut named) = (false, false);
            amount.each(&mut |part| match part {
                Expr::Name(read) => {
                    named = true;
                    moves |= !matches!(self.model.quantities[*read].kind, Kind::Constant(_));
                }
                Expr::Time | Expr::Pulse(_) => moves = true,
                _ => {}
            });
            match value(&amount, &self.model, DEEPEST, &|_| None).filter(|_| !moves) {
                None => return Err("how much of its species it takes or makes changes"),
                Some(0.0) => {}
                Some(number) => {
                    let amount = if named { amount } else { Expr::number(number) };
                    net.push(Change { index, volume, amount, number });
                }
            }
        }
        Ok(net)
    }

    /// The kinetic law as what states make of it.
    fn law(&self, reaction: usize) -> Result<Expr, &'static str> {
        let Kind::Algebraic(law) = &self.model.quantities[reaction].kind else { return Err("it has no kinetic law") };
        self.in_place(law).ok_or("its kinetic law reads too much")
    }

    /// An expression with equations in the place of what they determine; none if that is too long.
    fn in_place(&self, expr: &Expr) -> Option<Expr> {
        let mut expr = expr.clone();
        for _ in 0..DEEPEST {
            let mut changed = false;
            let put_in = expr.map(&mut |leaf| match leaf {
                Expr::Name(name) => match self.model.quantities.get(*name).map(|quantity| &quantity.kind) {
                    Some(Kind::Algebraic(equation)) => {
                        changed = true;
                        Some(equation.clone())
                    }
                    _ => None,
                },
                _ => None,
            });
            if !changed {
                return Some(expr);
            }
            if put_in.extent().1 > MOST_PARTS {
                return None;
            }
            expr = put_in;
        }
        None
    }

    /// Adds the state for a combination of two quantities that a reaction leaves as it is.
    fn combination(&mut self, index: usize, pivot: usize, reaction: usize, kind: Kind) {
        let [one, other, reaction] = [index, pivot, reaction].map(|index| self.model.quantities[index].id.clone());
        let of = &self.model.quantities[index];
        let mut quantity = Quantity::new(format!("{one}_and_{other}"), of.group, of.span);
        quantity.unit.clone_from(&of.unit);
        quantity.label = format!("what {reaction} leaves as it is");
        quantity.kind = kind;
        self.model.add(quantity);
    }

    /// Whether a reaction leads back to its equilibrium, as things are at the beginning. `per_pivot` is what it makes of
    /// the pivot.
    fn leads_back(&self, law: &Expr, pivot: usize, solution: &Expr, per_pivot: f64) -> bool {
        let Some(middle) = value(solution, &self.model, DEEPEST, &|_| None) else { return false };
        let first = value(&Expr::Name(pivot), &self.model, DEEPEST, &|_| None).unwrap_or(0.0);
        let aside = ASIDE * middle.abs().max(first.abs()).max(ASIDE);
        let at = |of: f64| value(law, &self.model, DEEPEST, &|name| (name == pivot).then_some(of));
        match (at(middle - aside), at(middle + aside)) {
            (Some(below), Some(above)) => below * per_pivot > 0.0 && above * per_pivot < 0.0,
            _ => false,
        }
    }

    /// What an event assigns where species are in equilibrium: the states that reactions leave as they are. `late` says
    /// whether it assigns what was known some time before: then nothing that it leaves may be among them.
    pub(super) fn with_equilibria(
        &mut self,
        mut assignments: Vec<(usize, Expr)>,
        (event, late): (Node, bool),
    ) -> Vec<(usize, Expr)> {
        for Equilibrium { pivot, others } in &self.equilibria {
            let is_meant = |target: usize| target == *pivot || others.iter().any(|(index, ..)| *index == target);
            let (meant, rest): (Vec<_>, Vec<_>) = assignments.into_iter().partition(|(target, _)| is_meant(*target));
            assignments = rest;
            if meant.is_empty() {
                continue;
            }
            if late && meant.len() <= others.len() {
                let message = "an event with a delay changes some species of a fast reaction and leaves others";
                let help = "let it take the values of the time at which it comes (`useValuesFromTriggerTime`)";
                self.findings.push(Diagnostic::error(codes::IMPORT_UNSUPPORTED, span(event), message).with_help(help));
            }
            let new = |of: usize| {
                let given = meant.iter().find(|(target, _)| *target == of);
                given.map_or(Expr::Name(of), |(_, value)| value.clone())
            };
            assignments.extend(
                others
                    .iter()
                    .map(|(index, state, ratio)| (*state, Expr::sum([(false, new(*index)), ratio.less(new(*pivot))]))),
            );
        }
        assignments
    }
}

/// The value of an expression at the beginning, with some quantities as they are given; none if it is not plain arithmetic.
fn value(expr: &Expr, model: &Model, depth: usize, given: &dyn Fn(usize) -> Option<f64>) -> Option<f64> {
    let depth = depth.checked_sub(1)?;
    let of = |expr: &Expr| value(expr, model, depth, given);
    match expr {
        Expr::Number(value, _) => Some(*value),
        Expr::Time => Some(0.0),
        Expr::Name(name) => given(*name).or_else(|| match &model.quantities.get(*name)?.kind {
            Kind::Constant(expr) | Kind::Algebraic(expr) | Kind::State { initial: expr, .. } => of(expr),
            Kind::Missing => None,
        }),
        Expr::Sum(members) => members
            .iter()
            .try_fold(0.0, |sum, (minus, member)| Some(if *minus { sum - of(member)? } else { sum + of(member)? })),
        Expr::Product(members) => members.iter().try_fold(1.0, |product, (inverse, member)| {
            Some(if *inverse { product / of(member)? } else { product * of(member)? })
        }),
        Expr::Power(pair) => match (of(&pair.0)?, of(&pair.1)?) {
            (base, 1.0) => Some(base),
            (base, 2.0) => Some(base * base),
            (base, exponent) => Some(Function::Exp.evaluate(exponent * Function::Log.evaluate(base))),
        },
        Expr::Call(Callee::Own(function), arguments) => {
            of(&mathml::inlined(&model.functions.get(*function)?.body, arguments))
        }
        Expr::Call(Callee::Language(name), arguments) => match (*name, arguments.as_slice()) {
            ("exp", [argument]) => Some(Function::Exp.evaluate(of(argument)?)),
            ("log", [argument]) => Some(Function::Log.evaluate(of(argument)?)),
            ("sqrt", [argument]) => Some(Function::Sqrt.evaluate(of(argument)?)),
            _ => None,
        },
        _ => None,
    }
    .filter(|value| value.is_finite())
}
