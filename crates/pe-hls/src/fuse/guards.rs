//! Choices that keep a formula from 0/0: `if V == V0 then limit else f(V)`, `if abs(V - V0) < 1e-6 then limit else f(V)`.
//!
//! A function table takes the limit at such a place by itself; the choice would keep what is 0/0 from becoming one
//! function with what it is divided by. See `docs/decisions/0073-guards.md`.

use pe_ir::codes;
use pe_ir::functions::ScalarFunction;
use pe_ir::model::{Expr, Function, Variable};
use pe_ir::source::{Diagnostic, Span};

use crate::kinks::{affine, root};

/// Values of the other variables that are tried.
const TRIALS: u32 = 8;

/// Part by which a limit that is written down may be off for being a rounded number, and part from which on a choice is
/// more than a guard.
pub(super) const ROUNDED: f64 = 1e-6;
const MOST: f64 = 1e-3;

/// Part of the largest value in all trials below which a difference in one of them does not count.
const SMALL: f64 = 0.1;

/// A choice that does no more than fill a gap of a formula.
pub(super) struct Guard {
    /// Whether the formula is what is taken where the condition holds.
    pub formula_if_true: bool,
    /// The middle of the arguments for which the formula is not taken, and half of their range.
    pub place: f64,
    pub reach: f64,
    /// The largest difference of what is taken there to the formula, as part of it.
    pub difference: f64,
}

/// The finding that a choice was left out although it makes a difference.
pub(super) fn left_out(guard: &Guard, (name, span): (&str, Span)) -> Diagnostic {
    let Guard { place, reach, difference, .. } = guard;
    let message = format!(
        "a choice in `{name}` that keeps a formula from 0/0 is left out: within {reach:.1e} of {place} it differs from the \
         formula by up to {difference:.1e} of its value"
    );
    let help = "errors are stated against the formula, which is what such a choice stands for";
    Diagnostic::error(codes::GUARD_LEFT_OUT, span, message).with_help(help).into_warning()
}

/// Whether one branch is taken for a short range of a variable only, and there is what the other branch leads to, whatever
/// other variables are.
pub(super) fn guard(condition: &Expr, variable: Variable, yes: &Expr, no: &Expr) -> Option<Guard> {
    let (inside, (low, high)) = stretch(condition)?;
    let (fill, formula) = if inside { (yes, no) } else { (no, yes) };
    let place = centre(condition, (low, high));
    let reach = 0.5 * (high - low);
    let mut trials = Vec::new();
    for trial in 0..TRIALS {
        let fixed =
            |read: Variable| if read == variable { Expr::Variable(read) } else { Expr::Constant(some(read, trial)) };
        let of = |expr: &Expr| ScalarFunction { name: String::new(), body: expr.substituted(&fixed), variable };
        let (formula, fill) = (of(formula), of(fill));
        let Some(limit) = formula.limit(place) else {
            // For some values of the others the formula may have no value anywhere near, such as the root of a sum.
            if formula.evaluate(place + 1e3 * reach.max(1e-9 * (1.0 + place.abs()))).is_finite() {
                return None;
            }
            continue;
        };
        let mut largest = (fill.evaluate(place) - limit).abs();
        // At the ends the formula is a number, of which rounding may have left little.
        let noise = 16.0 * f64::EPSILON * place.abs().max(f64::MIN_POSITIVE) / reach;
        if reach > 0.0 && noise < ROUNDED {
            for end in [low, high] {
                largest = largest.max((fill.evaluate(end) - formula.evaluate(end)).abs() - noise * limit.abs());
            }
        }
        if !largest.is_finite() {
            return None;
        }
        trials.push((largest, limit.abs()));
    }
    let scale = trials.iter().fold(0.0f64, |scale, (_, limit)| scale.max(*limit));
    let part = |(difference, limit): &(f64, f64)| {
        if *difference == 0.0 { 0.0 } else { difference / limit.max(SMALL * scale) }
    };
    let difference = trials.iter().map(part).fold(0.0, f64::max);
    let accepted = !trials.is_empty() && difference <= if reach > 0.0 { MOST } else { ROUNDED };
    accepted.then_some(Guard { formula_if_true: !inside, place, reach, difference })
}

/// A positive number for a variable, another one in each trial.
fn some(variable: Variable, trial: u32) -> f64 {
    let place = match variable {
        Variable::State(state) => 3.0 * f64::from(state.number()),
        Variable::Input(input) => 3.0 * f64::from(input) + 1.0,
        Variable::Algebraic(algebraic) => 3.0 * f64::from(algebraic) + 2.0,
    };
    let turns = 0.618_033_988_75 * place + 0.414_213_562_37 * f64::from(trial);
    0.25 + 1.5 * (turns - libm::floor(turns))
}

/// The arguments between which a condition of one variable is what it is nowhere else, if there is such a range, and
/// whether it holds there.
fn stretch(condition: &Expr) -> Option<(bool, (f64, f64))> {
    let mut places = Vec::new();
    crossings(condition, &mut places)?;
    places.retain(|place| place.is_finite());
    places.sort_unstable_by(f64::total_cmp);
    places.dedup();
    let (first, last) = (*places.first()?, *places.last()?);
    let holds = |x: f64| condition.evaluate(&|_| x) > 0.0;
    let beyond = 1.0 + (last - first) + first.abs().max(last.abs());
    let outside = holds(first - beyond);
    if holds(last + beyond) != outside {
        return None;
    }
    let between = |pair: &[f64]| (0.5 * (pair[0] + pair[1]), (pair[0], pair[1]));
    let looked = places.iter().map(|place| (*place, (*place, *place))).chain(places.windows(2).map(between));
    let others = looked.filter(|(x, _)| holds(*x) != outside).map(|(_, range)| range);
    let range = others.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))?;
    // What is in between belongs to it.
    let inner = places.windows(2).map(between).filter(|(_, (low, high))| *low >= range.0 && *high <= range.1);
    inner.map(|(x, _)| x).all(|x| holds(x) != outside).then_some((!outside, range))
}

/// Where parts of a condition of one variable change sign: roots of affine parts, and of distances less a number.
fn crossings(condition: &Expr, found: &mut Vec<f64>) -> Option<()> {
    if affine(condition).is_some() {
        found.extend(root(condition));
        return Some(());
    }
    match condition {
        Expr::Select(select) => {
            [&select.condition, &select.yes, &select.no].into_iter().try_for_each(|part| crossings(part, found))
        }
        Expr::Sum(members) => {
            let (mut constant, mut rest) = (0.0, Vec::new());
            for member in members {
                match member {
                    Expr::Constant(number) => constant += number,
                    member => rest.push(member),
                }
            }
            if let [only] = rest.as_slice()
                && let Some((weight, argument)) = distance(only)
            {
                let (slope, offset) = affine(argument)?;
                let reach = -constant / weight;
                found.push(-offset / slope);
                if reach >= 0.0 {
                    found.extend([(reach - offset) / slope, (-reach - offset) / slope]);
                }
                return Some(());
            }
            rest.into_iter().try_for_each(|member| crossings(member, found))
        }
        Expr::Product(members) => members.iter().try_for_each(|member| crossings(member, found)),
        Expr::Power(base, _) => crossings(base, found),
        Expr::Constant(_) | Expr::Variable(_) => Some(()),
        Expr::Apply(..) | Expr::Solution(_) => None,
    }
}

/// A number times a magnitude: the number, and of what.
fn distance(expr: &Expr) -> Option<(f64, &Expr)> {
    match expr {
        Expr::Apply(Function::Abs, argument) => Some((1.0, argument)),
        Expr::Product(members) => match members.as_slice() {
            [Expr::Constant(weight), Expr::Apply(Function::Abs, argument)] => Some((*weight, argument)),
            _ => None,
        },
        _ => None,
    }
}

/// The place within a range where a distance in a condition is zero; the middle if there is none.
fn centre(condition: &Expr, (low, high): (f64, f64)) -> f64 {
    let mut places = Vec::new();
    // The range was found with them.
    let _ = crossings(condition, &mut places);
    places.into_iter().find(|place| *place > low && *place < high).unwrap_or(0.5 * (low + high)) + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use pe_ir::index::StateId;
    use pe_ir::model::Select;

    const V: Variable = Variable::State(StateId::new(0));

    fn state(number: u32) -> Expr {
        Expr::Variable(Variable::State(StateId::new(number)))
    }

    fn over(above: Expr, below: Expr) -> Expr {
        Expr::product(vec![above, Expr::Apply(Function::Reciprocal, Box::new(below))])
    }

    /// `(V - at)/(1 - exp(-(V - at)/10))`, 10 at the gap.
    fn rate(at: f64) -> Expr {
        let moved = Expr::sum(vec![state(0), Expr::Constant(-at)]);
        let fallen = Expr::Apply(Function::Exp, Box::new(Expr::scaled(-0.1, moved.clone())));
        over(moved, Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(-1.0, fallen)]))
    }

    /// Above zero within `reach` of `at`.
    fn near(at: f64, reach: f64) -> Expr {
        let moved = Expr::sum(vec![state(0), Expr::Constant(-at)]);
        Expr::sum(vec![Expr::Constant(reach), Expr::scaled(-1.0, Expr::Apply(Function::Abs, Box::new(moved)))])
    }

    /// Above zero unless `V == at`, as choices of the front end are.
    fn differs(at: f64) -> Expr {
        let choice = |condition, yes, no| Expr::Select(Box::new(Select { condition, yes, no }));
        let (above, below) = (
            Expr::sum(vec![state(0), Expr::Constant(-at)]),
            Expr::sum(vec![Expr::Constant(at), Expr::scaled(-1.0, state(0))]),
        );
        let other = choice(below, Expr::Constant(1.0), Expr::Constant(0.0));
        Expr::sum(vec![choice(above, Expr::Constant(1.0), other), Expr::Constant(-0.5)])
    }

    #[test]
    fn a_gap_with_its_limit_is_one_and_nothing_else_is() {
        let number = Expr::Constant;
        let fills = |condition: &Expr, fill: &Expr, formula: &Expr| {
            let (one, other) = (guard(condition, V, fill, formula), guard(condition, V, formula, fill));
            one.is_some_and(|guard| !guard.formula_if_true) || other.is_some_and(|guard| guard.formula_if_true)
        };
        for condition in [near(-40.0, 1e-6), near(-40.0, 1e-9), near(-40.0, 1e-4), differs(-40.0)] {
            assert!(fills(&condition, &number(10.0), &rate(-40.0)));
            // The other variable may be anything.
            let product = Expr::product(vec![state(1), rate(-40.0)]);
            assert!(fills(&condition, &Expr::scaled(10.0, state(1)), &product));
            assert!(!fills(&condition, &number(10.0), &product));
            // Another value, another place, no gap, a pole, a jump.
            assert!(!fills(&condition, &number(10.1), &rate(-40.0)));
            assert!(!fills(&condition, &number(10.0), &rate(-41.0)));
            let beside = Expr::sum(vec![state(0), number(40.0)]);
            assert!(!fills(&condition, &number(0.0), &over(number(1.0), beside.clone())));
            let jump = over(Expr::Apply(Function::Abs, Box::new(beside.clone())), beside);
            assert!(!fills(&condition, &number(0.0), &jump));
        }
        // Off by more than rounding at one place; a wide range in which the formula is another.
        assert!(!fills(&differs(-40.0), &number(10.001), &rate(-40.0)));
        assert!(!fills(&near(-40.0, 5.0), &number(10.0), &rate(-40.0)));
        assert!(!fills(&state(0), &number(10.0), &rate(0.0)));
    }

    #[test]
    fn the_difference_that_a_guard_makes_is_told() {
        // The slope of the rate at its gap is 1/2.
        let guard = guard(&near(-40.0, 1e-3), V, &Expr::Constant(10.0), &rate(-40.0)).expect("a guard");
        assert!((guard.difference / 5e-5 - 1.0).abs() < 1e-2, "{}", guard.difference);
        assert_eq!((guard.place, guard.formula_if_true), (-40.0, false));
    }
}
