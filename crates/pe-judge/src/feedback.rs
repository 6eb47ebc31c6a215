//! Word widths required by sampled states with feedback.
//!
//! Such a state is written as what it was plus a change. A change below half an LSB of the whole word is lost, so the
//! state stands still at up to half the response to one, which bits hidden from the multiplier keep below an LSB of
//! what the multiplier sees. States that oscillate ring on with a few LSB of what the multiplier sees, however many
//! bits are hidden; three bits below the storage bits keep that out of sight
//! (`docs/decisions/0035-sampled-parts-at-rest.md`).

use pe_hls::step::coupled;
use pe_ir::model::Model;
use pe_sim::linear::Linearised;
use pe_sim::spectrum::{eigenvalues, largest_response};

/// Bits that the multiplier shall see below the storage bits where states may ring.
pub const VISIBLE_BITS: u32 = 3;

/// Poles as close as this to the unit circle are on it, as that of an integrator is.
const ON_CIRCLE: f64 = 1e-9;

/// States that read one another in a circle, at most, and operations on all of them; more are left as they are.
const CIRCLE: usize = 200;
const OPERATIONS: usize = 300_000_000;

/// The feedback of a model's sampled parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feedback {
    /// Bits of a word that the multiplier shall not see.
    pub hidden_bits: u32,
    /// Whether stable states may ring.
    pub rings: bool,
    /// The largest magnitude of a pole of the sampled parts alone, over one sample.
    pub slowest: f64,
}

impl Feedback {
    /// The feedback around the initial state; none without any, or if it is too large to be analysed.
    pub fn of(model: &Model) -> Option<Feedback> {
        if model.rates.is_empty() {
            return None;
        }
        let circles = coupled(model);
        let states: usize = circles.iter().map(Vec::len).sum();
        let size = model.states.len() + model.algebraics.len();
        if states == 0 || circles.iter().any(|circle| circle.len() > CIRCLE) || states * size > OPERATIONS {
            return None;
        }
        let initial: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
        let linear = Linearised::of_samples(model, &initial, &model.sample_inputs(0.0));
        let mut feedback = Feedback { hidden_bits: 0, rings: false, slowest: 0.0 };
        for circle in &circles {
            feedback.include(&matrix(&linear, circle), circle.len());
        }
        Some(feedback)
    }

    /// Takes a circle of so many states into account.
    fn include(&mut self, columns: &[f64], order: usize) {
        let Some(poles) = eigenvalues(order, columns) else {
            self.slowest = f64::INFINITY;
            return;
        };
        let slowest = poles.iter().map(|(re, im)| libm::hypot(*re, *im)).fold(0.0, f64::max);
        self.slowest = self.slowest.max(slowest);
        // What does not come to rest by itself cannot be asked to.
        if slowest >= 1.0 - ON_CIRCLE {
            return;
        }
        self.rings |= order > 1 || columns[0] < 0.0;
        if let Some(response) = largest_response(order, columns) {
            self.hidden_bits = self.hidden_bits.max(libm::ceil(libm::log2(response.max(1.0))) as u32 + 1);
        }
    }

    /// Whether the sampled parts alone, without inputs, tend to a state in which they stand still.
    pub fn is_stable(&self) -> bool {
        self.slowest < 1.0 - ON_CIRCLE
    }
}

/// What one sample makes of the states of a circle, column after column.
fn matrix(linear: &Linearised, circle: &[usize]) -> Vec<f64> {
    let mut unit = vec![0.0; linear.states()];
    let mut columns = Vec::with_capacity(circle.len() * circle.len());
    for state in circle {
        unit[*state] = 1.0;
        let after = linear.product(&unit);
        columns.extend(circle.iter().map(|row| after[*row]));
        unit[*state] = 0.0;
    }
    columns
}
