//! The vector of states in the form the library requires.

use std::cell::Cell;

use differential_equations::traits::State;

/// Magnitudes below this become zero. Denormal numbers, as in the far tail of a diffusion, mean nothing to the result
/// and cost a hundred times the time.
const SMALLEST: f64 = 1e-280;

thread_local! {
    /// States of the model at hand: the library's implicit methods make vectors of zeros from the type alone.
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

/// All states of a model.
#[derive(Clone, Debug)]
pub(super) struct States(pub Vec<f64>);

impl States {
    /// Says how many states the vectors of this thread have from here on.
    pub fn expect(count: usize) {
        COUNT.set(count);
    }
}

impl State<f64> for States {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn get_component(&self, index: usize) -> f64 {
        self.0[index]
    }

    fn set_component(&mut self, index: usize, value: f64) {
        self.0[index] = value;
    }

    fn map_components_mut<F: FnMut(usize, &mut f64)>(&mut self, mut f: F) {
        self.0.iter_mut().enumerate().for_each(|(index, value)| f(index, value));
    }

    fn zeros_like(&self) -> Self {
        States(vec![0.0; self.0.len()])
    }

    fn zeros() -> Self {
        States(vec![0.0; COUNT.get()])
    }

    fn mul_add_assign(&mut self, alpha: f64, other: &Self) {
        for (value, other) in self.0.iter_mut().zip(&other.0) {
            let sum = *value + alpha * other;
            *value = if sum.abs() < SMALLEST { 0.0 } else { sum };
        }
    }

    fn scale_mut(&mut self, alpha: f64) {
        self.0.iter_mut().for_each(|value| *value *= alpha);
    }

    /// Most time is spent here; many coefficients of the method are zero.
    fn add_scaled(&mut self, alpha: f64, other: &Self) -> &mut Self {
        if alpha != 0.0 {
            self.mul_add_assign(alpha, other);
        }
        self
    }
}
