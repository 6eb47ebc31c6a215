//! How the numerical methods amplify a mode of a linear model, in one place for all of them.

use crate::coefficients::{ROS2_GAMMA, adams, chebyshev};
use crate::complex::{Complex, largest_root};
use crate::index::at;
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
    /// The explicit Runge-Kutta methods of `rk4` and below have as many stages as their order, so that R is the
    /// exponential series up to there. Of multi-step methods the largest root of the characteristic equation counts. The
    /// methods of positions and velocities are judged on the oscillator with this pair of eigenvalues, and Rush and
    /// Larsen's as Euler's, which all states but the gates have.
    pub fn amplification(self, re: f64, im: f64) -> f64 {
        let z = Complex { re, im };
        match self {
            Solver::Euler | Solver::Heun | Solver::Heun3 | Solver::Rk4 | Solver::RushLarsen => {
                // Horner's rule: 1 + z (1 + z/2 (1 + z/3 (..))).
                let inner = |sum, divisor| Complex::ONE + z.scaled(1.0 / f64::from(divisor)) * sum;
                (1..=self.stages()).rev().fold(Complex::ONE, inner).magnitude()
            }
            Solver::SymplecticEuler | Solver::Leapfrog => {
                let trace = 2.0 + 2.0 * re - (re * re + im * im);
                let real = |re| Complex { re, im: 0.0 };
                largest_root(&[real(-trace), real(1.0 + 2.0 * re)])
            }
            Solver::Ab2 | Solver::Ab3 | Solver::Ab4 => {
                let mut coefficients: Vec<Complex> = adams(self).iter().map(|weight| z.scaled(-weight)).collect();
                coefficients[0] = coefficients[0] - Complex::ONE;
                largest_root(&coefficients)
            }
            Solver::Rkc5 | Solver::Rkc10 => {
                let (mut before, mut last) = (Complex::ZERO, Complex::ZERO);
                for (index, stage) in chebyshev(at(self.stages())).into_iter().enumerate() {
                    let first = if index == 0 { Complex::ZERO } else { z.scaled(stage.first_slope) };
                    let slope = z.scaled(stage.slope) * (Complex::ONE + last);
                    let next = last.scaled(stage.mu) + before.scaled(stage.nu) + slope + first;
                    (before, last) = (last, next);
                }
                (Complex::ONE + last).magnitude()
            }
            Solver::ImplicitEuler => 1.0 / (Complex::ONE - z).magnitude(),
            Solver::Trapezoidal => {
                (Complex::ONE + z.scaled(0.5)).magnitude() / (Complex::ONE - z.scaled(0.5)).magnitude()
            }
            Solver::Ros2 => {
                let matrix = Complex::ONE - z.scaled(ROS2_GAMMA);
                let first = z / matrix;
                let second = (z * (Complex::ONE + first) - first.scaled(2.0)) / matrix;
                (Complex::ONE + first.scaled(1.5) + second.scaled(0.5)).magnitude()
            }
            Solver::Rodas3 => {
                let half = z.scaled(0.5);
                let matrix = Complex::ONE - half;
                let u1 = half / matrix;
                let u2 = (half + u1.scaled(2.0)) / matrix;
                let point = Complex::ONE + u1.scaled(2.0);
                let u3 = (half * point + (u1 - u2).scaled(0.5)) / matrix;
                let u4 = (half * (point + u3) + (u1 - u2).scaled(0.5) - u3.scaled(4.0 / 3.0)) / matrix;
                (point + u3 + u4).magnitude()
            }
            Solver::Exact => libm::exp(re),
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
        let step = inside / magnitude;
        step.is_finite().then_some(step)
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
    fn limits_of_multi_step_and_stabilised_methods_are_those_of_the_textbooks() {
        let cases = [
            (Solver::Ab2, 1.0),
            (Solver::Ab3, 6.0 / 11.0),
            (Solver::Ab4, 0.3),
            (Solver::Rkc5, 16.60),
            (Solver::Rkc10, 64.74),
        ];
        for (solver, limit) in cases {
            let found = solver.largest_step(-10.0, 0.0).expect("explicit methods have a limit");
            assert!((10.0 * found / limit - 1.0).abs() < 1e-3, "{solver:?}: {}", 10.0 * found);
        }
        for (solver, limit) in
            [(Solver::Ab3, 0.7236), (Solver::Ab4, 0.4300), (Solver::SymplecticEuler, 2.0), (Solver::Leapfrog, 2.0)]
        {
            let found = solver.largest_step(-1e-7, 1.0).expect("explicit methods have a limit");
            assert!((found / limit - 1.0).abs() < 2e-3, "{solver:?}: {found}");
        }
    }

    #[test]
    fn implicit_methods_have_no_limit_and_damp_fast_modes_as_published() {
        let damped = [Solver::ImplicitEuler, Solver::Ros2, Solver::Rodas3, Solver::Exact];
        for solver in damped.into_iter().chain([Solver::Trapezoidal]) {
            for angle in [91, 120, 150, 180] {
                let angle = f64::from(angle).to_radians();
                let step = solver.largest_step(libm::cos(angle), libm::sin(angle));
                assert_eq!(step, None, "{solver:?} at {angle}");
            }
            let fast = solver.amplification(-1e9, 0.0);
            let expected = if solver == Solver::Trapezoidal { 1.0 } else { 0.0 };
            assert!((fast - expected).abs() < 1e-6, "{solver:?}: {fast}");
        }
    }

    #[test]
    fn methods_agree_with_the_exponential_to_their_order() {
        for solver in Solver::ALL.into_iter().filter(|solver| ![Solver::Exact, Solver::Leapfrog].contains(solver)) {
            let error = |h: f64| (solver.amplification(-0.3 * h, h) - libm::exp(-0.3 * h)).abs();
            let order = libm::log2(error(0.02) / error(0.01)) - 1.0;
            assert!(order > f64::from(solver.order()) - 0.2, "{solver:?}: {order}");
        }
    }

    #[test]
    fn modes_that_grow_have_no_limit() {
        assert_eq!(Solver::Rk4.largest_step(0.0, 1.0), None);
        assert_eq!(Solver::Rk4.largest_step(1.0, 0.0), None);
    }
}
