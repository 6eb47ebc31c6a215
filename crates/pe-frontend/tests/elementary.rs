//! Functions and choices of variables against those of the standard library.

#![allow(clippy::disallowed_methods, reason = "the tests' own numbers may come from the standard library")]

mod common;

/// A right-hand side, and what it is for values of `x` and `y`.
type Case = (&'static str, fn(f64, f64) -> f64);

#[test]
fn functions_and_choices_of_variables_have_the_values_of_a_library() {
    let cases: [Case; 23] = [
        ("x/y", |x, y| x / y),
        ("1/(x*y^2)", |x, y| 1.0 / (x * y * y)),
        ("x^-2.5 + y^0.5 - x^-1", |x, y| x.powf(-2.5) + y.sqrt() - 1.0 / x),
        ("x^y + 2^x + x^-y", |x, y| x.powf(y) + 2f64.powf(x) + x.powf(-y)),
        ("log2(x) + log10(y) + log(x*y)", |x, y| x.log2() + y.log10() + (x * y).ln()),
        ("1/exp(x) + 1/sqrt(y) + 1/y^-3", |x, y| (-x).exp() + 1.0 / y.sqrt() + y.powi(3)),
        ("asin(x/9) + acos(y/9) + atan(x)", |x, y| (x / 9.0).asin() + (y / 9.0).acos() + x.atan()),
        ("sinh(x) - cosh(y) + tanh(x - y) + tan(y/9)", |x, y| x.sinh() - y.cosh() + (x - y).tanh() + (y / 9.0).tan()),
        ("abs(x - y) + sign(y - x)", |x, y| (x - y).abs() + (y - x).signum()),
        ("floor(x - y) + ceil(x - y)", |x, y| (x - y).floor() + (x - y).ceil()),
        ("round(x - y) + round(y - x) + round(2*x)", |x, _| (2.0 * x).round()),
        ("quotient(x - y, 0.3) - quotient(y, x)", |x, y| ((x - y) / 0.3).trunc() - (y / x).trunc()),
        ("mod(x - y, 0.7)", |x, y| (x - y).rem_euclid(0.7)),
        ("mod(x, y) + mod(-x, y)", |x, y| x.rem_euclid(y) + (-x).rem_euclid(y)),
        ("min(x, y, 1.3, x*y)", |x, y| x.min(y).min(1.3).min(x * y)),
        ("max(x, 2*y, 3) - min(x, y)", |x, y| x.max(2.0 * y).max(3.0) - x.min(y)),
        ("if x > y then x - y else 7", |x, y| if x > y { x - y } else { 7.0 }),
        ("if x <= y then 1 else 2", |x, y| if x <= y { 1.0 } else { 2.0 }),
        ("if not (x >= y) then 1 else 2", |x, y| if x < y { 1.0 } else { 2.0 }),
        ("if x > 1 and y > 1 then x else y", |x, y| if x > 1.0 && y > 1.0 { x } else { y }),
        ("if x > 2 or y > 2 or 1 > 2 then x else y", |x, y| if x > 2.0 || y > 2.0 { x } else { y }),
        ("if x == x + 0*y and x != y then 1 else 2", |_, _| 1.0),
        ("if 1 < 2 and x > y then sin(x) else cos(y)", |x, y| if x > y { x.sin() } else { y.cos() }),
    ];
    for (text, library) in cases {
        let spec = format!(
            "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nstate x = 0\nstate y = 0\nx' = {text}\ny' = x\noutput x, y\n"
        );
        let model = common::model(&spec);
        for (x, y) in [(0.7, 1.9), (2.5, 0.3), (1.2, 1.1), (3.5, 4.5)] {
            let is = common::derivatives(&model, &[x, y], &[])[0];
            let should = library(x, y);
            assert!((is - should).abs() <= 1e-12 * (1.0 + should.abs()), "{text} at {x}, {y}: {is} is not {should}");
        }
    }
}
