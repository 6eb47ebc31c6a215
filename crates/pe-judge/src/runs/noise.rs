//! How far rounding carries values beyond the ranges that they have in double precision
//! ([0086](../../../../docs/decisions/0086-noise-ranges.md)).

use pe_hls::formats::Ranges;
use pe_ir::graph::{FixedPoint, StepGraph, ValueId};
use pe_ir::model::Model;
use pe_sim::roomy::RoomyRun;

use super::exact::{AtCorner, Exact};
use super::measure::port_words;

/// Room for what rounding makes of a value that it carried beyond its range: with other LSBs it rounds otherwise, and its
/// peaks differ.
const NOISE_MARGIN: f64 = 1.5;

impl Exact {
    /// Runs in fixed point without the ends of ranges, and widens the ranges of all values that leave them to what they
    /// become there, whether the run itself or one at the ends of tunable parameters takes them. Wider ranges have coarser
    /// LSBs, which may ask for another such run.
    pub(super) fn include_noise(&self, model: &Model, graph: &StepGraph, fixed: &FixedPoint, ranges: &mut Ranges) {
        let mut include = |beyond: Vec<(ValueId, f64)>| {
            for (value, largest) in beyond {
                let range = &mut ranges.largest[value.index()];
                *range = range.max(NOISE_MARGIN * largest);
            }
        };
        include(self.noise(model, graph, fixed));
        for AtCorner { corner, model, exact } in &self.corners {
            include(exact.noise(model, &corner.graph(graph), fixed));
        }
    }

    /// Values that leave their ranges over the span if nothing keeps them there, with the largest magnitude of each.
    pub(super) fn noise(&self, model: &Model, graph: &StepGraph, fixed: &FixedPoint) -> Vec<(ValueId, f64)> {
        let mut run = RoomyRun::new(graph, fixed);
        for step in 0..self.plan.steps {
            let words = port_words(model, run.run(), step);
            if run.step(&words) {
                break;
            }
        }
        run.beyond()
    }
}
