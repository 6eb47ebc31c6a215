//! Choices that keep a formula from 0/0: `if V == V0 then limit else f(V)`.
//!
//! A function table takes the limit at such a place by itself; a choice by equality would keep what is 0/0 from becoming one
//! function with what it is divided by.

use crate::evaluate::fold::SumBuilder;
use pe_ir::functions::ScalarFunction;
use pe_ir::model::{Expr, Variable};

/// Values of the other variables that are tried.
const TRIALS: u32 = 8;

/// Part by which a limit that is written down may be off for being a rounded number.
const ROUNDED: f64 = 1e-6;

/// Whether a choice of `limit` where both sides are equal does nothing but fill a gap of `formula`: the sides are equal at one
/// value of one variable; there the formula has no value but the limit that is written down, whatever other variables are.
pub(super) fn only_fills_a_gap(sides: &(Expr, Expr), limit: &Expr, formula: &Expr) -> bool {
    let Some((variable, place)) = crossing(sides) else { return false };
    let mut found = false;
    for trial in 0..TRIALS {
        let fixed =
            |read: Variable| if read == variable { Expr::Variable(read) } else { Expr::Constant(some(read, trial)) };
        let body = formula.substituted(&fixed);
        let (value, is_limit) = ScalarFunction { name: String::new(), body, variable }.evaluate_noting(place);
        if !value.is_finite() {
            continue;
        }
        let stated = limit.evaluate(&|read| if read == variable { place } else { some(read, trial) });
        if !is_limit || (stated - value).abs() > ROUNDED * (stated.abs() + value.abs()) {
            return false;
        }
        found = true;
    }
    found
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

/// The variable and the only value of it at which two sides are equal.
fn crossing((left, right): &(Expr, Expr)) -> Option<(Variable, f64)> {
    let mut difference = SumBuilder::default();
    difference.add(left.clone(), false);
    difference.add(right.clone(), true);
    let (variable, slope, offset) = match difference.finish() {
        Expr::Sum(members) => match members.as_slice() {
            [member, Expr::Constant(offset)] | [Expr::Constant(offset), member] => {
                let (variable, slope) = scaled(member)?;
                (variable, slope, *offset)
            }
            _ => return None,
        },
        member => {
            let (variable, slope) = scaled(&member)?;
            (variable, slope, 0.0)
        }
    };
    // Adding zero turns -0 into 0.
    let place = -offset / slope + 0.0;
    place.is_finite().then_some((variable, place))
}

/// A variable and its factor.
fn scaled(expr: &Expr) -> Option<(Variable, f64)> {
    match expr {
        Expr::Variable(variable) => Some((*variable, 1.0)),
        Expr::Product(factors) => match factors.as_slice() {
            [Expr::Constant(factor), Expr::Variable(variable)] => Some((*variable, *factor)),
            _ => None,
        },
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pe_ir::index::StateId;
    use pe_ir::model::Function;

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

    #[test]
    fn a_gap_with_its_limit_is_one_and_nothing_else_is() {
        let number = Expr::Constant;
        let at = |place: f64| (state(0), number(place));
        assert!(only_fills_a_gap(&at(-40.0), &number(10.0), &rate(-40.0)));
        assert!(only_fills_a_gap(&(number(-80.0), Expr::scaled(2.0, state(0))), &number(10.0), &rate(-40.0)));
        // The other variable may be anything.
        let product = Expr::product(vec![state(1), rate(-40.0)]);
        assert!(only_fills_a_gap(&at(-40.0), &Expr::scaled(10.0, state(1)), &product));
        assert!(!only_fills_a_gap(&at(-40.0), &number(10.0), &product));
        // Another value, another place, no gap, a pole, a jump, sides of two variables.
        assert!(!only_fills_a_gap(&at(-40.0), &number(11.0), &rate(-40.0)));
        assert!(!only_fills_a_gap(&at(-41.0), &number(10.0), &rate(-40.0)));
        assert!(!only_fills_a_gap(&at(2.0), &number(4.0), &Expr::power(state(0), 2)));
        assert!(!only_fills_a_gap(&at(0.0), &number(0.0), &over(number(1.0), state(0))));
        let jump = over(Expr::Apply(Function::Abs, Box::new(state(0))), state(0));
        assert!(!only_fills_a_gap(&at(0.0), &number(0.0), &jump));
        assert!(!only_fills_a_gap(&(state(0), state(1)), &number(10.0), &rate(-40.0)));
    }
}
