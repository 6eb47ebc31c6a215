//! Removable singularities: `x/(exp(x) - 1)` at zero, and its derivatives, whose rounding errors grow by another power
//! of the distance. Around such a place a polynomial through values outside of the noise stands for the function.

use pe_ir::functions::ScalarFunction;
use pe_ir::model::{Expr, Select};

/// Halvings of the distance at which the values are taken.
const HALVINGS: i32 = 40;

/// Difference to the function beside the place, relative to its values there, that is no fill any more.
const WORST: f64 = 1e-6;

/// Halvings of that distance down to which a function is compared with its polynomial.
const NEAREST: i32 = 40;

/// A function with a polynomial around each of some places between two arguments, as far as polynomials agree with what
/// is around them.
pub(super) fn filled(function: &ScalarFunction, places: &[f64], (low, high): (f64, f64)) -> ScalarFunction {
    let mut filled = function.clone();
    for (index, place) in places.iter().enumerate() {
        // Half of the way to the next place is this one's.
        let others = places.iter().enumerate().filter(|(other, _)| *other != index);
        let room = others.map(|(_, other)| 0.5 * (other - place).abs()).fold(high - low, f64::min);
        let found = polynomial(function, *place, room / 8.0);
        if let Some((radius, polynomial)) = found.filter(|(radius, found)| !leaves(function, *place, *radius, found)) {
            let distance = Expr::sum(vec![Expr::Variable(function.variable), Expr::Constant(-place)]);
            let parts = Expr::scaled(1.0 / radius, distance);
            let power = |(power, factor): (usize, f64)| Expr::scaled(factor, Expr::power(parts.clone(), power as u32));
            let inside = Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(-1.0, Expr::power(parts.clone(), 2))]);
            let yes = Expr::sum(polynomial.into_iter().enumerate().map(power).collect());
            filled.body = Expr::Select(Box::new(Select { condition: inside, yes, no: filled.body }));
        }
    }
    filled
}

/// The distance from a place within which a polynomial of degree five through the values at one, two and three times that
/// distance is closest to the function beside it, and its coefficients in parts of the distance, lowest first.
fn polynomial(function: &ScalarFunction, place: f64, widest: f64) -> Option<(f64, [f64; 6])> {
    let mut best: Option<(f64, f64, [f64; 6])> = None;
    for halving in 0..HALVINGS {
        let radius = libm::scalbn(widest, -halving);
        if radius <= 64.0 * f64::EPSILON * place.abs() || radius < f64::MIN_POSITIVE {
            break;
        }
        let at = |parts: f64| function.evaluate(place + parts * radius);
        let coefficients = through([1.0, 2.0, 3.0].map(|parts| (at(parts), at(-parts))));
        let is = |parts: f64| coefficients.iter().rev().fold(0.0, |sum, factor| sum * parts + factor);
        let (mut error, mut size) = (0.0f64, 0.0f64);
        // Uneven places, so that what rounding does there is not what it does at the nodes.
        for parts in [1.097, 1.483, 2.611, -1.211, -1.747, -2.389] {
            let value = at(parts);
            error = if value.is_finite() { error.max((is(parts) - value).abs()) } else { f64::INFINITY };
            size = size.max(value.abs());
        }
        let error = if size > 0.0 { error / size } else { error };
        if error <= WORST && best.is_none_or(|(least, ..)| error < least) {
            best = Some((error, radius, coefficients));
        }
    }
    best.map(|(_, radius, coefficients)| (radius, coefficients))
}

/// Whether a function leaves a polynomial on the way to a place, as at a pole that only shows nearby: steadily, and not as
/// rounding would have it.
fn leaves(function: &ScalarFunction, place: f64, radius: f64, coefficients: &[f64; 6]) -> bool {
    const LOOKS: [f64; 7] = [1.0, 1.13, 1.27, 1.41, 1.62, 1.77, 1.93];
    for halving in 1..NEAREST {
        let distance = libm::scalbn(radius, -halving);
        if distance <= 1024.0 * f64::EPSILON * place.abs() {
            break;
        }
        for side in [distance, -distance] {
            let looks = LOOKS.map(|look| {
                let (parts, value) = (look * side / radius, function.evaluate(place + look * side));
                let is = coefficients.iter().rev().fold(0.0, |sum, factor| sum * parts + factor);
                (value - is, value.abs())
            });
            if looks.iter().any(|(difference, _)| !difference.is_finite()) {
                return false;
            }
            let steady = looks.windows(2).all(|two| two[0].0.abs() > two[1].0.abs() && two[0].0 * two[1].0 > 0.0);
            if steady && looks.iter().all(|(difference, size)| difference.abs() > WORST * size) {
                return true;
            }
        }
    }
    false
}

/// The polynomial through values at 1, 2 and 3, and at the same places below zero.
fn through(values: [(f64, f64); 3]) -> [f64; 6] {
    // Even and odd part are polynomials of second degree of the square, through 1, 4 and 9.
    let squares = |[one, two, three]: [f64; 3]| {
        let (first, second) = ((two - one) / 3.0, (three - two) / 5.0);
        let curvature = (second - first) / 8.0;
        [one - first + 4.0 * curvature, first - 5.0 * curvature, curvature]
    };
    let even = squares(values.map(|(above, below)| 0.5 * (above + below)));
    let mut parts = [1.0, 2.0, 3.0].into_iter();
    let odd = squares(values.map(|(above, below)| 0.5 * (above - below) / parts.next().expect("three places")));
    [even[0], odd[0], even[1], odd[1], even[2], odd[2]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use pe_ir::index::StateId;
    use pe_ir::model::{Function, Variable};

    #[test]
    fn a_polynomial_is_its_own_fill() {
        let of = |x: f64| [0.5, -1.0, 2.0, 0.25, -0.125, 3.0].iter().rev().fold(0.0, |sum, c| sum * x + c);
        let is = through([1.0, 2.0, 3.0].map(|x| (of(x), of(-x))));
        for (is, should) in is.into_iter().zip([0.5, -1.0, 2.0, 0.25, -0.125, 3.0]) {
            assert!((is - should).abs() < 1e-12, "{is} {should}");
        }
    }

    #[test]
    fn derivatives_of_quotients_are_what_series_say() {
        let variable = Variable::State(StateId::new(0));
        for (place, scale) in [(0.0, 1.0), (-40.0, 10.0), (19.9, 9.0), (0.0, 1e-3)] {
            let u = Expr::scaled(1.0 / scale, Expr::sum(vec![Expr::Variable(variable), Expr::Constant(-place)]));
            let grown = Expr::Apply(Function::Exp, Box::new(u.clone()));
            let below = Expr::sum(vec![grown, Expr::Constant(-1.0)]);
            let mut body = Expr::product(vec![u, Expr::Apply(Function::Reciprocal, Box::new(below))]);
            // Bernoulli numbers: 1 - u/2 + u^2/12 - u^4/720, and its derivatives.
            let series: [fn(f64) -> f64; 3] = [
                |u| 1.0 - u / 2.0 + u * u / 12.0 - libm::pow(u, 4.0) / 720.0,
                |u| -0.5 + u / 6.0 - libm::pow(u, 3.0) / 180.0,
                |u| 1.0 / 6.0 - u * u / 60.0,
            ];
            for (order, exact) in series.into_iter().enumerate() {
                let function = ScalarFunction { name: String::new(), body: body.clone(), variable };
                let filled = filled(&function, &[place], (place - 5.0 * scale, place + 3.0 * scale));
                for u in [0.0, 1e-12, -1e-9, 1e-7, -1e-5, 1e-4, 1e-3, -1e-2] {
                    let (is, should) =
                        (filled.evaluate(place + u * scale), exact(u) * libm::pow(scale, -(order as f64)));
                    let most = [1e-11, 1e-8, 1e-5][order] * should.abs();
                    assert!((is - should).abs() < most, "{place} {scale} {order}: {is} {should} at {u}");
                }
                body = body.derivative(variable);
            }
        }
    }
}
