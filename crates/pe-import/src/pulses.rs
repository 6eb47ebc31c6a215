//! Pulse trains that files write as conditions on the time.

use crate::expr::{Callee, Expr, Relation};

/// The expression with conditions such as `time >= s and time - s - floor((time - s)/p)*p <= d` as pulses: with a signal of
/// the language instead of a saw tooth of the time. They differ in the single instants at which a pulse ends. `constant`
/// says whether a quantity stands still.
pub(crate) fn recognised(expr: &Expr, constant: &dyn Fn(usize) -> bool) -> Expr {
    let mut found = false;
    expr.each(&mut |part| found |= matches!(part, Expr::And(members) if train(members, constant).is_some()));
    if found { replaced(expr, constant) } else { expr.clone() }
}

fn replaced(expr: &Expr, constant: &dyn Fn(usize) -> bool) -> Expr {
    let replaced = |part: &Expr| replaced(part, constant);
    match expr {
        Expr::And(members) => match train(members, constant) {
            Some((member, pulse)) => {
                let mut members = members.clone();
                members[member] = Expr::compare(Relation::Greater, pulse, Expr::number(0.5));
                Expr::And(members)
            }
            None => expr.clone(),
        },
        Expr::Choice(pieces, otherwise) => {
            let pieces = pieces.iter().map(|(condition, value)| (replaced(condition), replaced(value))).collect();
            Expr::choice(pieces, replaced(otherwise))
        }
        Expr::Sum(members) => Expr::sum(members.iter().map(|(sign, member)| (*sign, replaced(member)))),
        Expr::Product(members) => Expr::product(members.iter().map(|(sign, member)| (*sign, replaced(member)))),
        other => other.clone(),
    }
}

/// The member that is a pulse train of the time, if another says that the time is past its start; and the train.
fn train(members: &[Expr], constant: &dyn Fn(usize) -> bool) -> Option<(usize, Expr)> {
    members.iter().enumerate().find_map(|(index, member)| {
        let Expr::Compare(Relation::Less | Relation::LessEqual, pair) = member else { return None };
        let (start, period) = saw_tooth(&pair.0, constant)?;
        let is_past = |other: &Expr| match other {
            Expr::Compare(Relation::GreaterEqual | Relation::Greater, sides) => **sides == (Expr::Time, start.clone()),
            _ => false,
        };
        let width = pair.1.clone();
        let is_train = is_constant(&width, constant) && members.iter().any(is_past);
        is_train.then(|| (index, Expr::Pulse(Box::new([Expr::number(1.0), start, width, period]))))
    })
}

/// Start and period of `time - s - floor((time - s)/p)*p`.
fn saw_tooth(expr: &Expr, constant: &dyn Fn(usize) -> bool) -> Option<(Expr, Expr)> {
    let Expr::Sum(members) = expr else { return None };
    let floor = members.iter().position(|(negative, member)| *negative && matches!(member, Expr::Product(_)))?;
    let Expr::Product(factors) = &members[floor].1 else { return None };
    let (whole, period) = match &factors[..] {
        [(false, Expr::Call(Callee::Language("floor"), whole)), (false, period)] => (whole, period),
        [(false, period), (false, Expr::Call(Callee::Language("floor"), whole))] => (whole, period),
        _ => return None,
    };
    let rest = members.iter().enumerate().filter(|(index, _)| *index != floor).map(|(_, member)| member.clone());
    let rest: Vec<(bool, Expr)> = rest.collect();
    if *whole != [Expr::sum(rest.clone()).over(period.clone())] || !is_constant(period, constant) {
        return None;
    }
    match &rest[..] {
        [(false, Expr::Time), (true, start)] if is_constant(start, constant) => Some((start.clone(), period.clone())),
        _ => None,
    }
}

/// Whether an expression reads nothing that moves.
fn is_constant(expr: &Expr, constant: &dyn Fn(usize) -> bool) -> bool {
    let mut moves = false;
    expr.each(&mut |part| {
        moves |= match part {
            Expr::Time | Expr::Pulse(_) | Expr::Argument(_) => true,
            Expr::Name(quantity) => !constant(*quantity),
            _ => false,
        }
    });
    !moves
}
