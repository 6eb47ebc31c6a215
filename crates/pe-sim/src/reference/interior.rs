//! What a step was between its ends, as well as the method knows these.
//!
//! Within a step methods are of a lower order than at its end, and what reads it later must not notice. So it is found again from
//! the equations: states at the nodes of a polynomial, guessed by the method, are replaced by the integral of their slopes, twice
//! (Picard's iteration on Chebyshev points). What the second time still changes, and the last coefficient of the polynomial, tell
//! how wrong it is.

use std::sync::OnceLock;

use differential_equations::ode::ODE;

use super::equations::Piece;
use super::states::States;

/// Places within a step at which it is kept: Chebyshev points, ends included.
pub const NODES: usize = 10;

/// How often slopes are integrated.
const SWEEPS: usize = 2;

/// Places and weights of Gauss and Legendre from -1 to 1, exact to degree nine.
const GAUSS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

/// The nodes from -1 to 1.
pub fn nodes() -> impl Iterator<Item = f64> {
    (0..NODES).map(|node| -libm::cos(core::f64::consts::PI * node as f64 / (NODES - 1) as f64))
}

/// The polynomial through values at the nodes, at a place from -1 to 1.
pub fn at(values: &[f64], place: f64) -> f64 {
    let (mut above, mut below) = (0.0, 0.0);
    for (number, (node, value)) in nodes().zip(values).enumerate() {
        if place == node {
            return *value;
        }
        let weight = sign(number) / (place - node);
        above += weight * value;
        below += weight;
    }
    above / below
}

/// The weight of a node: signs alternate, ends count half.
fn sign(number: usize) -> f64 {
    let half = if number == 0 || number == NODES - 1 { 0.5 } else { 1.0 };
    if number.is_multiple_of(2) { half } else { -half }
}

/// Integrals from -1 to each node of the polynomials that are one at one node and zero at all others.
fn integrals() -> &'static [[f64; NODES]; NODES] {
    static INTEGRALS: OnceLock<[[f64; NODES]; NODES]> = OnceLock::new();
    INTEGRALS.get_or_init(|| {
        let mut integrals = [[0.0; NODES]; NODES];
        for (row, end) in integrals.iter_mut().zip(nodes()) {
            for (number, integral) in row.iter_mut().enumerate() {
                let mut values = [0.0; NODES];
                values[number] = 1.0;
                let half = 0.5 * (end + 1.0);
                *integral =
                    GAUSS.iter().map(|(place, weight)| half * weight * at(&values, half * (place + 1.0) - 1.0)).sum();
            }
        }
        integrals
    })
}

/// The times of the nodes of a step.
pub fn times(from: f64, to: f64) -> impl Iterator<Item = f64> {
    // Rounding must not lead out of the step.
    nodes().map(move |node| (0.5 * (from + to) + 0.5 * (to - from) * node).clamp(from, to))
}

/// States at the nodes of a step.
pub struct Interior {
    pub states: Vec<States>,
    /// The largest error of a state, as a multiple of its tolerance.
    pub error: f64,
}

/// A step from its first states and guesses at its nodes.
pub fn found(
    piece: &Piece,
    (from, to): (f64, f64),
    begin: &States,
    mut states: Vec<States>,
    tolerances: &[f64],
) -> Interior {
    let mut error = 0.0;
    for _ in 0..SWEEPS {
        let slope = |(time, states): (f64, &States)| {
            let mut slope = States(vec![0.0; states.0.len()]);
            piece.diff(time, states, &mut slope);
            slope
        };
        let slopes: Vec<States> = times(from, to).zip(&states).map(slope).collect();
        error = 0.0;
        for (states, row) in states.iter_mut().zip(integrals()) {
            for (place, (state, begin)) in states.0.iter_mut().zip(&begin.0).enumerate() {
                let integral: f64 = row.iter().zip(&slopes).map(|(weight, slope)| weight * slope.0[place]).sum();
                let new = begin + 0.5 * (to - from) * integral;
                error = worse(error, (new - *state) / tolerances[place]);
                *state = new;
            }
        }
    }
    for (place, tolerance) in tolerances.iter().enumerate() {
        let last: f64 = states.iter().enumerate().map(|(number, states)| sign(number) * states.0[place]).sum();
        error = worse(error, last / ((NODES - 1) as f64 * tolerance));
    }
    Interior { states, error }
}

/// The larger one; what is no number is worse than all.
fn worse(error: f64, other: f64) -> f64 {
    if other.is_nan() { f64::INFINITY } else { error.max(other.abs()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrals_are_those_of_polynomials_up_to_degree_nine() {
        for degree in 0..NODES as i32 {
            let power = |x: f64, degree: i32| (0..degree).fold(1.0, |product, _| product * x);
            let values: Vec<f64> = nodes().map(|node| power(node, degree)).collect();
            for (row, end) in integrals().iter().zip(nodes()) {
                let found: f64 = row.iter().zip(&values).map(|(weight, value)| weight * value).sum();
                let exact = (power(end, degree + 1) - power(-1.0, degree + 1)) / f64::from(degree + 1);
                assert!((found - exact).abs() < 1e-14, "degree {degree} up to {end}: {found} in place of {exact}");
            }
        }
    }
}
