//! Complex numbers, as far as stability functions need them.

use std::ops::{Add, Div, Mul, Sub};

/// `re + i im`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Complex {
    pub re: f64,
    pub im: f64,
}

impl Complex {
    pub const ONE: Complex = Complex { re: 1.0, im: 0.0 };
    pub const ZERO: Complex = Complex { re: 0.0, im: 0.0 };

    pub fn scaled(self, factor: f64) -> Complex {
        Complex { re: factor * self.re, im: factor * self.im }
    }

    pub fn magnitude(self) -> f64 {
        libm::hypot(self.re, self.im)
    }
}

impl Add for Complex {
    type Output = Complex;

    fn add(self, other: Complex) -> Complex {
        Complex { re: self.re + other.re, im: self.im + other.im }
    }
}

impl Sub for Complex {
    type Output = Complex;

    fn sub(self, other: Complex) -> Complex {
        Complex { re: self.re - other.re, im: self.im - other.im }
    }
}

impl Mul for Complex {
    type Output = Complex;

    fn mul(self, other: Complex) -> Complex {
        Complex { re: self.re * other.re - self.im * other.im, im: self.re * other.im + self.im * other.re }
    }
}

impl Div for Complex {
    type Output = Complex;

    fn div(self, other: Complex) -> Complex {
        let square = other.re * other.re + other.im * other.im;
        (self * Complex { re: other.re, im: -other.im }).scaled(1.0 / square)
    }
}

/// The largest magnitude of a root of `x^n + c_1 x^(n-1) + .. + c_n`, by the method of Durand and Kerner.
pub(crate) fn largest_root(coefficients: &[Complex]) -> f64 {
    const ROUNDS: u32 = 200;
    let value = |x: Complex| coefficients.iter().fold(Complex::ONE, |sum, c| sum * x + *c);
    let size = 1.0 + coefficients.iter().fold(0.0, |most: f64, c| most.max(c.magnitude()));
    // Starting points that are no powers of one another on a circle around all roots.
    let seed = Complex { re: 0.4, im: 0.9 };
    let mut roots: Vec<Complex> = Vec::with_capacity(coefficients.len());
    let mut start = Complex::ONE;
    for _ in coefficients {
        start = start * seed;
        roots.push(start.scaled(size));
    }
    for _ in 0..ROUNDS {
        let mut moved = 0.0f64;
        for index in 0..roots.len() {
            let own = roots[index];
            let others = (0..roots.len()).filter(|other| *other != index);
            let product = others.fold(Complex::ONE, |product, other| product * (own - roots[other]));
            let step = value(own) / product;
            roots[index] = own - step;
            moved = moved.max(step.magnitude());
        }
        if moved.is_nan() || moved < 1e-15 * size {
            break;
        }
    }
    roots.into_iter().map(Complex::magnitude).fold(0.0, f64::max)
}
