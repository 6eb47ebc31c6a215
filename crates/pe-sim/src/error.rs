//! Comparison of a run with a reference run at sample times, state by state; [`crate::compared`] does it at every step.

use pe_ir::index::at;
use pe_ir::turns;

/// Part of the largest magnitude of its quantity that the scale of a state has at least.
pub const SCALE_FLOOR: f64 = 1e-6;

/// States of a run at sample times.
#[derive(Clone, Debug, Default)]
pub struct Trajectory {
    /// Number of states.
    pub states: usize,
    /// Samples one after another, `states` numbers each.
    pub samples: Vec<f64>,
    /// Largest magnitude of each state between the samples, too, where the run knows it; empty otherwise. A state that
    /// falls within the first sample would be judged by its rounding noise without it.
    pub largest: Vec<f64>,
}

impl Trajectory {
    /// An empty trajectory of `states` states.
    pub fn new(states: usize) -> Self {
        Trajectory { states, samples: Vec::new(), largest: Vec::new() }
    }

    /// Appends a sample.
    pub fn push(&mut self, state: impl Fn(usize) -> f64) {
        self.samples.extend((0..self.states).map(state));
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.samples.len() / self.states.max(1)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Scale of each state for relative errors: its own largest magnitude, but at least [`SCALE_FLOOR`] times the largest
    /// of its quantity, so that a state that hardly moves is not judged by its noise.
    pub fn scales(&self, quantity: &[u32]) -> Vec<f64> {
        let mut own = if self.largest.is_empty() { vec![0.0f64; self.states] } else { self.largest.clone() };
        for sample in self.samples.chunks_exact(self.states.max(1)) {
            for (largest, number) in own.iter_mut().zip(sample) {
                *largest = largest.max(number.abs());
            }
        }
        let quantities = quantity.iter().max().map_or(0, |q| at(*q) + 1);
        let mut shared = vec![0.0f64; quantities];
        for (number, quantity) in own.iter().zip(quantity) {
            shared[at(*quantity)] = shared[at(*quantity)].max(*number);
        }
        own.iter().zip(quantity).map(|(own, quantity)| own.max(SCALE_FLOOR * shared[at(*quantity)])).collect()
    }

    /// The last sample alone.
    pub fn last(&self) -> Trajectory {
        let from = self.samples.len() - self.states.min(self.samples.len());
        Trajectory { states: self.states, samples: self.samples[from..].to_vec(), largest: Vec::new() }
    }

    /// The same, where the states that are angles lie in one turn around zero. `turns` are their numbers, each with the
    /// length of a turn.
    #[must_use]
    pub fn principal(mut self, turns: &[(usize, f64)]) -> Trajectory {
        for row in self.samples.chunks_exact_mut(self.states.max(1)) {
            turns.iter().for_each(|(state, turn)| row[*state] = turns::principal(row[*state], *turn));
        }
        self
    }

    /// The same, where the states that are angles are taken whole turns further, so that they are closest to those of
    /// another trajectory at the same times. `turns` are their numbers, each with the length of a turn.
    #[must_use]
    pub fn turned(mut self, other: &Trajectory, turns: &[(usize, f64)]) -> Trajectory {
        let states = self.states.max(1);
        for (own, others) in self.samples.chunks_exact_mut(states).zip(other.samples.chunks_exact(states)) {
            for (state, turn) in turns {
                own[*state] = turns::nearest(own[*state], others[*state], *turn);
            }
        }
        self
    }

    /// How far `other`, sampled at the same times, deviates.
    ///
    /// # Panics
    /// If the samples are not as many, or none: a comparison of nothing must not pass for agreement.
    pub fn deviation(&self, other: &Trajectory) -> Deviation {
        assert!(!self.samples.is_empty() && self.samples.len() == other.samples.len(), "{} samples", other.len());
        let mut largest = vec![0.0f64; self.states];
        let states = self.states.max(1);
        for (own, others) in self.samples.chunks_exact(states).zip(other.samples.chunks_exact(states)) {
            for (largest, (own, other)) in largest.iter_mut().zip(own.iter().zip(others)) {
                let difference = (other - own).abs();
                // A difference that is not a number must not vanish in `max`.
                *largest = if difference.is_nan() { f64::INFINITY } else { largest.max(difference) };
            }
        }
        Deviation { largest }
    }
}

/// Largest deviation of each state.
#[derive(Clone, Debug)]
pub struct Deviation {
    largest: Vec<f64>,
}

impl Deviation {
    /// The relative error of each state.
    pub fn relative(&self, scales: &[f64]) -> impl Iterator<Item = f64> {
        let relative = |(deviation, scale): (&f64, &f64)| if *deviation == 0.0 { 0.0 } else { deviation / scale };
        self.largest.iter().zip(scales).map(relative)
    }

    /// The worst state and its relative error.
    pub fn worst(&self, scales: &[f64]) -> (usize, f64) {
        self.relative(scales)
            .enumerate()
            .fold((0, 0.0), |worst, (index, error)| if error > worst.1 { (index, error) } else { worst })
    }
}
