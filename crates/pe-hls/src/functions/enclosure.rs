//! Interval arithmetic over the expression of a function: bounds of its values over a whole range of arguments, which
//! samples alone cannot give. Arguments for which a function has no value do not count.

use pe_ir::functions::ScalarFunction;
use pe_ir::model::{Expr, Function};

/// Relative width that rounding adds at most to an end of an interval.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// All numbers between two, both included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Interval {
    pub low: f64,
    pub high: f64,
}

const ALL: Interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };
const HALF_TURNS: Interval = Interval { low: -0.5, high: 0.5 };

impl Interval {
    fn new(low: f64, high: f64) -> Interval {
        if low.is_nan() || high.is_nan() {
            return ALL;
        }
        // What is infinite stays so.
        let room = |end: f64| if end.is_finite() { ROUNDING * end.abs() } else { 0.0 };
        Interval { low: low - room(low), high: high + room(high) }
    }

    /// Whether both ends are finite.
    pub fn is_bounded(self) -> bool {
        self.low.is_finite() && self.high.is_finite()
    }

    fn plus(self, other: Interval) -> Interval {
        Interval::new(self.low + other.low, self.high + other.high)
    }

    fn times(self, other: Interval) -> Interval {
        // Zero times what is unbounded is anything.
        let product = |a: f64, b: f64| a * b;
        let all = [
            product(self.low, other.low),
            product(self.low, other.high),
            product(self.high, other.low),
            product(self.high, other.high),
        ];
        if all.iter().any(|product| product.is_nan()) {
            return ALL;
        }
        Interval::new(
            all.iter().copied().fold(f64::INFINITY, f64::min),
            all.into_iter().fold(f64::NEG_INFINITY, f64::max),
        )
    }

    fn hull(self, other: Interval) -> Interval {
        Interval { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// What a rising function makes of it.
    fn rising(self, function: impl Fn(f64) -> f64) -> Interval {
        Interval::new(function(self.low), function(self.high))
    }

    fn magnitude(self) -> Interval {
        let (low, high) = (self.low.abs(), self.high.abs());
        let least = if self.low <= 0.0 && self.high >= 0.0 { 0.0 } else { low.min(high) };
        Interval { low: least, high: low.max(high) }
    }

    fn reciprocal(self) -> Interval {
        if self.low < 0.0 && self.high > 0.0 {
            return ALL;
        }
        let of = |x: f64, side: f64| if x == 0.0 { side * f64::INFINITY } else { 1.0 / x };
        if self.low >= 0.0 {
            Interval::new(of(self.high, 1.0), of(self.low, 1.0))
        } else {
            Interval::new(of(self.high, -1.0), of(self.low, -1.0))
        }
    }

    fn power(self, exponent: u32) -> Interval {
        let of = |x: f64| libm::pow(x, f64::from(exponent));
        if exponent % 2 == 1 { self.rising(of) } else { self.magnitude().rising(of) }
    }

    fn real_power(self, exponent: f64) -> Interval {
        let whole = exponent == libm::trunc(exponent) && exponent.abs() < 1e9;
        if whole {
            let positive = self.power(exponent.abs() as u32);
            return if exponent < 0.0 { positive.reciprocal() } else { positive };
        }
        // Where it is negative there is no value to bound.
        let positive = Interval { low: self.low.max(0.0), high: self.high.max(0.0) };
        let positive = positive.rising(|x| libm::pow(x, exponent.abs()));
        let positive = Interval { low: positive.low.max(0.0), ..positive };
        if exponent < 0.0 { positive.reciprocal() } else { positive }
    }

    /// The sine of it, `phase` quarters of a period later.
    fn sine(self, phase: f64) -> Interval {
        use core::f64::consts::{FRAC_PI_2, TAU};
        let moved = Interval::new(self.low + phase * FRAC_PI_2, self.high + phase * FRAC_PI_2);
        // Whether a place is reached at which the sine is 1 or -1, with room for the rounding of large arguments.
        let room = 1e-9 + ROUNDING * (moved.low.abs() + moved.high.abs());
        let reaches =
            |place: f64| libm::floor((moved.high + room - place) / TAU) >= libm::ceil((moved.low - room - place) / TAU);
        let ends = (libm::sin(moved.low), libm::sin(moved.high));
        let high = if reaches(FRAC_PI_2) { 1.0 } else { ends.0.max(ends.1) };
        let low = if reaches(-FRAC_PI_2) { -1.0 } else { ends.0.min(ends.1) };
        Interval::new(low - room.min(1.0), high + room.min(1.0))
    }

    fn tangent(self) -> Interval {
        use core::f64::consts::PI;
        let branch = |x: f64| libm::floor(x / PI + 0.5);
        if self.high - self.low >= PI || branch(self.low) != branch(self.high) { ALL } else { self.rising(libm::tan) }
    }

    /// What a function that is only defined within -1 .. 1 makes of it.
    fn within_one(self, function: impl Fn(f64) -> f64) -> Interval {
        if self.low < -1.0 - ROUNDING || self.high > 1.0 + ROUNDING {
            return ALL;
        }
        let (a, b) = (function(self.low.max(-1.0)), function(self.high.min(1.0)));
        Interval::new(a.min(b), a.max(b))
    }

    fn apply(self, function: Function) -> Interval {
        if !self.is_bounded() {
            match function {
                Function::Sin | Function::Cos => return Interval { low: -1.0, high: 1.0 },
                Function::Wrap => return HALF_TURNS,
                Function::Tan | Function::Asin | Function::Acos => return ALL,
                _ => {}
            }
        }
        match function {
            Function::Reciprocal => self.reciprocal(),
            Function::RealPower(exponent) => self.real_power(exponent),
            // Where it is negative there is no value to bound.
            Function::Sqrt => self.rising(|x| libm::sqrt(x.max(0.0))),
            Function::Exp => self.rising(libm::exp),
            Function::Log if self.low <= 0.0 => ALL,
            Function::Log => self.rising(libm::log),
            Function::Sin => self.sine(0.0),
            Function::Cos => self.sine(1.0),
            Function::Tan => self.tangent(),
            Function::Asin => self.within_one(libm::asin),
            Function::Acos => self.within_one(libm::acos),
            Function::Atan => self.rising(libm::atan),
            Function::Sinh => self.rising(libm::sinh),
            Function::Cosh => self.magnitude().rising(libm::cosh),
            Function::Tanh => self.rising(libm::tanh),
            Function::Abs => self.magnitude(),
            Function::Sign => self.rising(|x| Function::Sign.evaluate(x)),
            Function::Floor => self.rising(libm::floor),
            Function::Wrap if libm::floor(self.low + 0.5) == libm::floor(self.high + 0.5) => {
                self.rising(|x| Function::Wrap.evaluate(x))
            }
            Function::Wrap => HALF_TURNS,
        }
    }
}

/// Bounds of an expression of one variable, which is anywhere in `x`.
fn enclose(expr: &Expr, x: Interval) -> Interval {
    match expr {
        Expr::Constant(number) => Interval { low: *number, high: *number },
        Expr::Variable(_) => x,
        Expr::Sum(members) => {
            let zero = Interval { low: 0.0, high: 0.0 };
            members.iter().fold(zero, |sum, member| sum.plus(enclose(member, x)))
        }
        Expr::Product(members) => {
            let one = Interval { low: 1.0, high: 1.0 };
            members.iter().fold(one, |product, member| product.times(enclose(member, x)))
        }
        Expr::Power(base, exponent) => enclose(base, x).power(*exponent),
        Expr::Apply(function, argument) => enclose(argument, x).apply(*function),
        Expr::Select(select) => {
            let condition = enclose(&select.condition, x);
            if condition.low > 0.0 {
                enclose(&select.yes, x)
            } else if condition.high <= 0.0 {
                enclose(&select.no, x)
            } else {
                enclose(&select.yes, x).hull(enclose(&select.no, x))
            }
        }
        Expr::Solution(_) => unreachable!("no function of one variable"),
    }
}

/// Bounds of a function over a range.
pub(super) fn bounds(function: &ScalarFunction, low: f64, high: f64) -> Interval {
    enclose(&function.body, Interval { low, high })
}

#[cfg(test)]
mod tests {
    use pe_ir::index::StateId;

    use super::*;
    use pe_ir::model::{Select, Variable};

    #[test]
    fn bounds_hold_every_value_and_shrink_with_the_range() {
        let x = || Expr::Variable(Variable::State(StateId::new(0)));
        let apply = |function, argument| Expr::Apply(function, Box::new(argument));
        let moved = |by: f64| Expr::sum(vec![x(), Expr::Constant(by)]);
        let powers = [-1.5, -3.0, 0.3].map(Function::RealPower);
        let functions: Vec<Function> =
            [Function::Reciprocal].into_iter().chain(powers).chain(Function::NAMED).collect();
        let mut bodies: Vec<Expr> = functions.iter().map(|function| apply(*function, x())).collect();
        bodies.extend(functions.iter().map(|function| apply(*function, Expr::scaled(-0.7, moved(0.2)))));
        bodies.push(Expr::product(vec![moved(-0.4), Expr::power(moved(0.1), 2), apply(Function::Exp, x())]));
        let choice = Select { condition: moved(-0.3), yes: apply(Function::Log, moved(-0.1)), no: Expr::power(x(), 3) };
        bodies.push(Expr::Select(Box::new(choice)));
        let mut bounded = 0;
        for body in bodies {
            for cell in -40..40 {
                let (low, high) = (f64::from(cell) / 16.0, f64::from(cell + 1) / 16.0);
                let bounds = enclose(&body, Interval { low, high });
                bounded += usize::from(bounds.is_bounded());
                for part in 0..=16 {
                    let value = body.evaluate(&|_| low + (high - low) * f64::from(part) / 16.0);
                    let inside = (bounds.low..=bounds.high).contains(&value);
                    assert!(inside || !value.is_finite(), "{body:?} in {low} .. {high}: {value} not in {bounds:?}");
                }
            }
        }
        assert!(bounded > 2000, "{bounded}");
    }
}
