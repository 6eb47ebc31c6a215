//! Functions of the language, applied to constants. All are evaluated with `libm`, so that every platform gives the
//! same bits.

use pe_ir::turns;

/// A function of the language.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Function {
    /// The name in specs.
    pub(crate) name: &'static str,
    /// Fewest and most arguments.
    pub(crate) arguments: (usize, usize),
    apply: fn(&[f64]) -> f64,
}

impl Function {
    /// The value for as many arguments as the function takes; not finite outside its domain.
    pub(crate) fn apply(&self, arguments: &[f64]) -> f64 {
        (self.apply)(arguments)
    }
}

/// Any number of arguments.
const MANY: usize = usize::MAX;

const fn one(name: &'static str, apply: fn(&[f64]) -> f64) -> Function {
    Function { name, arguments: (1, 1), apply }
}

/// All functions.
pub(crate) const FUNCTIONS: [Function; 24] = [
    one("floor", |x| libm::floor(x[0])),
    one("ceil", |x| libm::ceil(x[0])),
    one("round", |x| libm::round(x[0])),
    one("log2", |x| libm::log2(x[0])),
    one("log", |x| libm::log(x[0])),
    one("log10", |x| libm::log10(x[0])),
    one("exp", |x| libm::exp(x[0])),
    one("sqrt", |x| libm::sqrt(x[0])),
    one("sin", |x| libm::sin(x[0])),
    one("cos", |x| libm::cos(x[0])),
    one("tan", |x| libm::tan(x[0])),
    one("asin", |x| libm::asin(x[0])),
    one("acos", |x| libm::acos(x[0])),
    one("atan", |x| libm::atan(x[0])),
    one("sinh", |x| libm::sinh(x[0])),
    one("cosh", |x| libm::cosh(x[0])),
    one("tanh", |x| libm::tanh(x[0])),
    one("abs", |x| libm::fabs(x[0])),
    one("sign", |x| if x[0] == 0.0 { 0.0 } else { libm::copysign(1.0, x[0]) }),
    one("wrap", |x| turns::principal(x[0], turns::RADIANS)),
    Function { name: "min", arguments: (2, MANY), apply: |x| x.iter().copied().fold(f64::INFINITY, libm::fmin) },
    Function { name: "max", arguments: (2, MANY), apply: |x| x.iter().copied().fold(f64::NEG_INFINITY, libm::fmax) },
    Function { name: "mod", arguments: (2, 2), apply: |x| modulo(x[0], x[1]) },
    Function { name: "quotient", arguments: (2, 2), apply: |x| libm::trunc(x[0] / x[1]) },
];

/// The function of this name.
pub(crate) fn find(name: &str) -> Option<Function> {
    FUNCTIONS.into_iter().find(|function| function.name == name)
}

/// Remainder of the quotient rounded down: has the sign of `b`.
pub(crate) fn modulo(a: f64, b: f64) -> f64 {
    let remainder = libm::fmod(a, b);
    if remainder != 0.0 && (remainder < 0.0) != (b < 0.0) { remainder + b } else { remainder }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modulo_rounds_the_quotient_down() {
        assert_eq!(
            [modulo(7.0, 3.0), modulo(-7.0, 3.0), modulo(7.0, -3.0), modulo(-7.0, -3.0)],
            [1.0, 2.0, -2.0, -1.0]
        );
        assert_eq!(modulo(6.0, -3.0), 0.0);
        assert!(modulo(1.0, 0.0).is_nan());
    }

    #[test]
    fn logarithms_of_powers_are_exact() {
        let log2 = find("log2").expect("log2 exists");
        assert!((0..60).all(|n| log2.apply(&[libm::ldexp(1.0, n)]) == f64::from(n)));
    }
}
