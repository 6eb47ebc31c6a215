//! Equations `expr = 0`, solved for quantities that nothing else determines.

use std::collections::HashMap;

use crate::expr::{Callee, Expr};
use crate::mathml;
use crate::model::Function;

/// Most parts of a solution.
const MOST_PARTS: usize = 20_000;

/// For each equation, the quantity that it determines among those that it may, each quantity once: as many equations as
/// possible have one. `candidates` are the quantities that each may determine, the most wanted first.
pub(crate) fn matched(candidates: &[Vec<usize>]) -> Vec<Option<usize>> {
    fn augment(
        equation: usize,
        candidates: &[Vec<usize>],
        taken: &mut HashMap<usize, usize>,
        seen: &mut Vec<usize>,
    ) -> bool {
        for quantity in &candidates[equation] {
            if seen.contains(quantity) {
                continue;
            }
            seen.push(*quantity);
            let other = taken.get(quantity).copied();
            if other.is_none_or(|other| augment(other, candidates, taken, seen)) {
                taken.insert(*quantity, equation);
                return true;
            }
        }
        false
    }
    let mut taken = HashMap::new();
    for equation in 0..candidates.len() {
        augment(equation, candidates, &mut taken, &mut Vec::new());
    }
    let mut found = vec![None; candidates.len()];
    taken.into_iter().for_each(|(quantity, equation)| found[equation] = Some(quantity));
    found
}

/// What a quantity must be for an expression to be zero; none if that cannot be told in one way.
pub(crate) fn solved(expr: &Expr, quantity: usize, functions: &[Function]) -> Option<Expr> {
    let expr = written_out(expr, quantity, functions);
    let solution = match linear(&expr, quantity) {
        Some((slope, _)) if slope == Expr::number(0.0) => None,
        Some((slope, rest)) => Some(match slope.literal() {
            Some(1.0) => rest.negated(),
            Some(-1.0) => rest,
            _ => rest.negated().over(slope),
        }),
        None => inverted(&expr, Expr::number(0.0), quantity),
    };
    solution.filter(|solution| solution.extent().1 <= MOST_PARTS)
}

/// Whether an expression reads a quantity.
pub(crate) fn reads(expr: &Expr, quantity: usize) -> bool {
    let mut found = false;
    expr.each(&mut |part| found |= *part == Expr::Name(quantity));
    found
}

/// The same with another expression in place of a quantity.
pub(crate) fn replaced(expr: &Expr, quantity: usize, by: &Expr) -> Expr {
    expr.map(&mut |leaf| (*leaf == Expr::Name(quantity)).then(|| by.clone()))
}

/// The same with functions of the model put in place where they take what reads a quantity.
fn written_out(expr: &Expr, quantity: usize, functions: &[Function]) -> Expr {
    let again = |expr: &Expr| written_out(expr, quantity, functions);
    let all =
        |members: &[(bool, Expr)]| members.iter().map(|(sign, member)| (*sign, again(member))).collect::<Vec<_>>();
    match expr {
        expr if !reads(expr, quantity) => expr.clone(),
        Expr::Call(Callee::Own(number), arguments) => again(&mathml::inlined(&functions[*number].body, arguments)),
        Expr::Sum(members) => Expr::sum(all(members)),
        Expr::Product(members) => Expr::product(all(members)),
        Expr::Power(pair) => again(&pair.0).power(again(&pair.1)),
        expr => expr.clone(),
    }
}

/// An expression as `slope*quantity + rest`.
fn linear(expr: &Expr, quantity: usize) -> Option<(Expr, Expr)> {
    let zero = || Expr::number(0.0);
    match expr {
        Expr::Name(name) if *name == quantity => Some((Expr::number(1.0), zero())),
        expr if !reads(expr, quantity) => Some((zero(), expr.clone())),
        Expr::Sum(members) => {
            let parts: Option<Vec<(bool, (Expr, Expr))>> =
                members.iter().map(|(sign, member)| Some((*sign, linear(member, quantity)?))).collect();
            let (slopes, rests): (Vec<_>, Vec<_>) =
                parts?.into_iter().map(|(sign, (slope, rest))| ((sign, slope), (sign, rest))).unzip();
            Some((total(slopes), Expr::sum(rests)))
        }
        Expr::Product(members) => {
            let (with, without): (Vec<_>, Vec<_>) =
                members.iter().cloned().partition(|(_, member)| reads(member, quantity));
            let [(false, member)] = with.as_slice() else { return None };
            let (slope, rest) = linear(member, quantity)?;
            let times = |expr: Expr| Expr::product([(false, expr)].into_iter().chain(without.iter().cloned()));
            Some((times(slope), times(rest)))
        }
        Expr::Choice(pieces, otherwise) if pieces.iter().all(|(condition, _)| !reads(condition, quantity)) => {
            let (otherwise_slope, otherwise_rest) = linear(otherwise, quantity)?;
            let (mut slopes, mut rests) = (Vec::new(), Vec::new());
            for (condition, value) in pieces {
                let (slope, rest) = linear(value, quantity)?;
                slopes.push((condition.clone(), slope));
                rests.push((condition.clone(), rest));
            }
            let same = slopes.iter().all(|(_, slope)| *slope == otherwise_slope);
            let slope = if same { otherwise_slope } else { Expr::choice(slopes, otherwise_slope) };
            Some((slope, Expr::choice(rests, otherwise_rest)))
        }
        _ => None,
    }
}

/// A sum whose numbers are added up, so that terms that cancel are seen.
fn total(members: Vec<(bool, Expr)>) -> Expr {
    let (numbers, others): (Vec<_>, Vec<_>) = members.into_iter().partition(|(_, member)| member.literal().is_some());
    let sum: f64 = numbers
        .iter()
        .filter_map(|(sign, member)| member.literal().map(|value| if *sign { -value } else { value }))
        .sum();
    let number = if sum < 0.0 { (true, Expr::number(-sum)) } else { (false, Expr::number(sum)) };
    Expr::sum(others.into_iter().chain([number]))
}

/// What a quantity that occurs once must be for an expression to be `value`.
fn inverted(expr: &Expr, value: Expr, quantity: usize) -> Option<Expr> {
    match expr {
        Expr::Name(name) if *name == quantity => Some(value),
        Expr::Sum(members) => {
            let index = only(members.iter().map(|(_, member)| member), quantity)?;
            let others = members.iter().enumerate().filter(|(other, _)| *other != index);
            let others = others.map(|(_, (sign, member))| (!*sign, member.clone()));
            let rest = Expr::sum([(false, value)].into_iter().chain(others));
            let (sign, member) = &members[index];
            inverted(member, if *sign { rest.negated() } else { rest }, quantity)
        }
        Expr::Product(members) => {
            let index = only(members.iter().map(|(_, member)| member), quantity)?;
            let others = members.iter().enumerate().filter(|(other, _)| *other != index);
            let others: Vec<(bool, Expr)> = others.map(|(_, pair)| pair.clone()).collect();
            let (inverse, member) = &members[index];
            // The quantity is divided by, or what stands beside it is.
            let rest = match inverse {
                true if value.literal() == Some(0.0) => return None,
                true => Expr::product(others.into_iter().chain([(true, value)])),
                false => {
                    Expr::product([(false, value)].into_iter().chain(others.into_iter().map(|(sign, e)| (!sign, e))))
                }
            };
            inverted(member, rest, quantity)
        }
        Expr::Call(Callee::Language(name), arguments) => {
            let [argument] = arguments.as_slice() else { return None };
            let value = match *name {
                "exp" => Expr::call("log", vec![value]),
                "log" => Expr::call("exp", vec![value]),
                "sqrt" => value.power(Expr::number(2.0)),
                _ => return None,
            };
            inverted(argument, value, quantity)
        }
        _ => None,
    }
}

/// The place of the only member that reads a quantity.
fn only<'e>(members: impl Iterator<Item = &'e Expr>, quantity: usize) -> Option<usize> {
    let mut found = members.enumerate().filter(|(_, member)| reads(member, quantity)).map(|(index, _)| index);
    found.next().filter(|_| found.next().is_none())
}

#[cfg(test)]
mod tests {
    use super::*;
    use pe_ir::model::Function as Applied;

    fn name(number: usize) -> Expr {
        Expr::Name(number)
    }

    /// The value of an expression for values of quantities.
    fn value(expr: &Expr, of: &[f64]) -> f64 {
        match expr {
            Expr::Number(value, _) => *value,
            Expr::Name(number) => of[*number],
            Expr::Sum(members) => {
                members.iter().map(|(sign, e)| if *sign { -value(e, of) } else { value(e, of) }).sum()
            }
            Expr::Product(members) => {
                members.iter().map(|(inverse, e)| if *inverse { 1.0 / value(e, of) } else { value(e, of) }).product()
            }
            Expr::Call(Callee::Language("exp"), arguments) => Applied::Exp.evaluate(value(&arguments[0], of)),
            Expr::Call(Callee::Language("log"), arguments) => Applied::Log.evaluate(value(&arguments[0], of)),
            Expr::Call(Callee::Own(_), arguments) => 3.0 * value(&arguments[0], of) - value(&arguments[1], of),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn solutions_make_their_equations_zero() {
        let argument = |index| Expr::Argument(index);
        let body = Expr::sum([(false, Expr::number(3.0).times(argument(0))), (true, argument(1))]);
        let span = pe_ir::source::Span::default();
        let function = Function { id: "f".to_owned(), arguments: vec!["a".into(), "b".into()], body, span };
        let functions = [function];
        let equations = [
            Expr::sum([(false, name(0)), (false, name(1)), (true, name(2))]),
            Expr::sum([(false, name(1)), (true, name(0).times(name(2))), (true, name(0))]),
            Expr::sum([(false, name(1)), (true, name(2).over(name(0)))]),
            Expr::sum([(false, Expr::call("exp", vec![name(0).times(name(1))])), (true, name(2))]),
            Expr::sum([(false, Expr::Call(Callee::Own(0), vec![name(0), name(1)])), (false, name(0).times(name(2)))]),
            name(1).times(Expr::sum([(false, name(0)), (true, name(2))])),
        ];
        for equation in equations {
            let solution = solved(&equation, 0, &functions).unwrap_or_else(|| panic!("{equation:?}"));
            assert!(!reads(&solution, 0), "{solution:?}");
            let with = [value(&solution, &[f64::NAN, 0.7, 1.9]), 0.7, 1.9];
            let zero = value(&equation, &with);
            assert!(zero.abs() < 1e-12, "{equation:?} {solution:?}: {zero}");
        }
        // No solution in one way, or none at all.
        let square = Expr::sum([(false, name(0).power(Expr::number(2.0))), (true, name(1))]);
        let gone = Expr::sum([(false, name(0)), (true, name(0)), (false, name(1))]);
        let never = Expr::number(1.0).over(name(0));
        for equation in [square, gone, never] {
            assert_eq!(solved(&equation, 0, &functions), None, "{equation:?}");
        }
    }

    #[test]
    fn as_many_equations_as_possible_have_a_quantity() {
        assert_eq!(matched(&[vec![1, 2], vec![1]]), [Some(2), Some(1)]);
        assert_eq!(matched(&[vec![1], vec![1]]).iter().flatten().count(), 1);
        assert_eq!(matched(&[vec![3, 1], vec![3], vec![1, 2]]), [Some(1), Some(3), Some(2)]);
    }
}
