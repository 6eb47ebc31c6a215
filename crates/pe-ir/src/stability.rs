//! How the numerical methods amplify a mode of a linear model, in one place for all of them.

use crate::model::Solver;

/// Relative excess over 1 that counts as rounding and not as growth.
const ROUNDING: f64 = 1e-12;

/// Steps times the magnitude of an eigenvalue between which the end of the stable stretch is looked for.
const SMALLEST: f64 = 1e-4;
const LARGEST: f64 = 1e4;

/// Ratio of neighbouring places that are tried: fine enough for the narrowest gaps of the methods' regions.
const RATIO: f64 = 1.01;

impl Solver {
    /// |R(z)|: what a step multiplies the magnitude of a mode `y' = lambda y` by, for `z = h lambda` with real part `re`
    /// and imaginary part `im`. A step is stable for the mode if it is at most 1. Hairer and Wanner, Solving Ordinary
    /// Differential Equations II, section IV.2.
    ///
    /// The Runge-Kutta methods here have as many stages as their order, so that R is the exponential series up to there.
    pub fn amplification(self, re: f64, im: f64) -> f64 {
        match self {
            Solver::Euler | Solver::Heun | Solver::Heun3 | Solver::Rk4 => {
                // Horner's rule: 1 + z (1 + z/2 (1 + z/3 (..))).
                let (mut real, mut imaginary) = (1.0, 0.0);
                for divisor in (1..=self.stages()).rev().map(f64::from) {
                    let (a, b) = (re / divisor, im / divisor);
                    (real, imaginary) = (1.0 + a * real - b * imaginary, a * imaginary + b * real);
                }
                libm::hypot(real, imaginary)
            }
        }
    }

    /// The largest step, in seconds, up to which every step is stable for a mode with this eigenvalue (1/s), if there is
    /// an end to them. `None` for methods and eigenvalues without a limit, and for modes that do not decay.
    pub fn largest_step(self, re: f64, im: f64) -> Option<f64> {
        let magnitude = libm::hypot(re, im);
        if re >= 0.0 || !magnitude.is_finite() {
            return None;
        }
        let (a, b) = (re / magnitude, im / magnitude);
        let stable = |s: f64| self.amplification(s * a, s * b) <= 1.0 + ROUNDING;
        let mut inside = 0.0;
        let mut next = SMALLEST;
        while stable(next) {
            inside = next;
            next *= RATIO;
            if next > LARGEST {
                return None;
            }
        }
        let mut outside = next;
        for _ in 0..60 {
            let middle = f64::midpoint(inside, outside);
            if stable(middle) {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        Some(inside / magnitude)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_on_the_real_axis_are_those_of_the_textbooks() {
        for (solver, limit) in
            [(Solver::Euler, 2.0), (Solver::Heun, 2.0), (Solver::Heun3, 2.5127), (Solver::Rk4, 2.7853)]
        {
            let found = solver.largest_step(-10.0, 0.0).expect("explicit methods have a limit");
            assert!((10.0 * found / limit - 1.0).abs() < 1e-4, "{solver:?}: {found}");
        }
    }

    #[test]
    fn limits_near_the_imaginary_axis_are_those_of_the_textbooks() {
        // The damping is too small to matter for the two methods that contain a part of the axis.
        for (solver, limit) in [(Solver::Heun3, 1.7321), (Solver::Rk4, 2.8284)] {
            let found = solver.largest_step(-1e-7, 1.0).expect("explicit methods have a limit");
            assert!((found / limit - 1.0).abs() < 1e-3, "{solver:?}: {found}");
        }
        // Euler: the circle around -1, h < 2 |re| / |lambda|^2.
        let found = Solver::Euler.largest_step(-0.1, 3.0).expect("a limit");
        assert!((found / (0.2 / 9.01) - 1.0).abs() < 1e-3, "{found}");
    }

    #[test]
    fn modes_that_grow_have_no_limit() {
        assert_eq!(Solver::Rk4.largest_step(0.0, 1.0), None);
        assert_eq!(Solver::Rk4.largest_step(1.0, 0.0), None);
    }
}
