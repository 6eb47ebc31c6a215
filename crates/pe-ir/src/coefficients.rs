//! Coefficients of methods that the step graph and the stability of the methods are both made from.

use crate::model::Solver;

/// Weights of the latest slope and those before it: Adams-Bashforth methods, Hairer, Norsett, Wanner, Solving Ordinary
/// Differential Equations I, section III.1. Of other methods that of Euler.
pub fn adams(solver: Solver) -> &'static [f64] {
    match solver {
        Solver::Ab2 => &[3.0 / 2.0, -1.0 / 2.0],
        Solver::Ab3 => &[23.0 / 12.0, -16.0 / 12.0, 5.0 / 12.0],
        Solver::Ab4 => &[55.0 / 24.0, -59.0 / 24.0, 37.0 / 24.0, -9.0 / 24.0],
        _ => &[1.0],
    }
}

/// The `gamma` of `ros2` with which it is L-stable.
pub const ROS2_GAMMA: f64 = 1.0 - core::f64::consts::FRAC_1_SQRT_2;

/// Coefficients of a stage of a Runge-Kutta-Chebyshev method, `d_j = mu d_{j-1} + nu d_{j-2} + h (slope f_{j-1} +
/// first_slope f_0)` with `d_j = y_j - y`.
#[derive(Clone, Copy, Debug)]
pub struct ChebyshevStage {
    /// Factor of the increment of the stage before.
    pub mu: f64,
    /// Factor of the increment two stages before.
    pub nu: f64,
    /// Factor of the slope of the stage before, in steps.
    pub slope: f64,
    /// Factor of the slope at the start of the step, in steps.
    pub first_slope: f64,
}

/// Chebyshev polynomials at `x` with their first two derivatives, of degree 0 to `degree`.
fn polynomials(degree: usize, x: f64) -> Vec<[f64; 3]> {
    let mut all = vec![[1.0, 0.0, 0.0], [x, 1.0, 0.0]];
    for j in 2..=degree {
        let ([a, b, c], [d, e, f]) = (all[j - 1], all[j - 2]);
        all.push([2.0 * x * a - d, 2.0 * (a + x * b) - e, 2.0 * (2.0 * b + x * c) - f]);
    }
    all
}

/// The stages of the Runge-Kutta-Chebyshev method of second order with damping 2/13: Sommeijer, Shampine, Verwer, RKC:
/// an explicit solver for parabolic PDEs, J. Comput. Appl. Math. 88 (1997), equations 2.1 to 2.7.
pub fn chebyshev(stages: usize) -> Vec<ChebyshevStage> {
    const DAMPING: f64 = 2.0 / 13.0;
    let w0 = 1.0 + DAMPING / (stages * stages) as f64;
    let t = polynomials(stages, w0);
    let w1 = t[stages][1] / t[stages][2];
    let b = |j: usize| match j {
        0 => t[2][2] / (t[2][1] * t[2][1]),
        1 => 1.0 / w0,
        _ => t[j][2] / (t[j][1] * t[j][1]),
    };
    let a = |j: usize| 1.0 - b(j) * t[j][0];
    let stage = |j: usize| match j {
        1 => ChebyshevStage { mu: 0.0, nu: 0.0, slope: b(1) * w1, first_slope: 0.0 },
        _ => {
            let slope = 2.0 * b(j) * w1 / b(j - 1);
            ChebyshevStage {
                mu: 2.0 * b(j) * w0 / b(j - 1),
                nu: -b(j) / b(j - 2),
                slope,
                first_slope: -a(j - 1) * slope,
            }
        }
    };
    (1..=stages).map(stage).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The stability polynomial by the recurrence, on `y' = lambda y` with `z = h lambda`.
    fn growth(stages: usize, z: f64) -> f64 {
        let (mut before, mut last) = (0.0, 0.0);
        for (index, stage) in chebyshev(stages).into_iter().enumerate() {
            let first = if index == 0 { 0.0 } else { stage.first_slope * z };
            let increment = stage.mu * last + stage.nu * before + stage.slope * z * (1.0 + last) + first;
            (before, last) = (last, increment);
        }
        1.0 + last
    }

    #[test]
    fn the_limit_on_the_real_axis_is_the_published_one() {
        for stages in [5, 10] {
            // Section 2 of the paper: beta(s) is about 2/3 (s^2 - 1)(1 - 2/15 * 2/13).
            let published = 2.0 / 3.0 * (stages * stages - 1) as f64 * (1.0 - 2.0 / 15.0 * 2.0 / 13.0);
            let stable = |z: f64| (0..=1000).all(|i| growth(stages, -z * f64::from(i) / 1000.0).abs() <= 1.0);
            // With an odd number of stages it is a little further.
            assert!(stable(0.98 * published) && !stable(1.08 * published), "{stages} stages: {published}");
        }
    }

    #[test]
    fn the_polynomial_agrees_with_the_exponential_to_second_order() {
        for z in [1e-2, -1e-2] {
            let error = growth(5, z) - libm::exp(z);
            assert!(error.abs() < 2e-7, "{error}");
        }
    }
}
