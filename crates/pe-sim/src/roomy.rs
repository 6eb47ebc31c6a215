//! The step graph in fixed point without the ends of ranges: what values become when each is rounded at its LSB, and
//! nothing saturates.

use pe_ir::graph::{FixedPoint, StepGraph, ValueId};

use crate::fixed::FixedRun;

/// Bits of a word with room at its top: sums of words and of their products still fit the integers of the simulator.
const ROOMY_WORD: u32 = 61;

/// A run in fixed point that records how far values go. As long as none leaves its range, it is bit for bit that of the
/// hardware.
pub struct RoomyRun<'a> {
    run: FixedRun<'a>,
    fixed: &'a FixedPoint,
    /// By slot, the word that needs the most bits so far.
    peaks: Vec<i64>,
}

impl<'a> RoomyRun<'a> {
    /// Starts a run from the initial values.
    pub fn new(graph: &'a StepGraph, fixed: &'a FixedPoint) -> RoomyRun<'a> {
        let run = FixedRun::with_room(graph, fixed, ROOMY_WORD - fixed.format.word_bits());
        let mut peaks = Vec::new();
        run.raise(&mut peaks);
        RoomyRun { run, fixed, peaks }
    }

    /// Advances by one step. `inputs` are port words, as those of [`FixedRun::step`]; returns whether a value left even the
    /// room, after which a run means nothing more.
    pub fn step(&mut self, inputs: &[i64]) -> bool {
        let beyond = self.run.step(inputs);
        self.run.raise(&mut self.peaks);
        beyond
    }

    /// The run, for the words of its ports.
    pub fn run(&self) -> &FixedRun<'a> {
        &self.run
    }

    /// Values that left their range so far, with the largest magnitude of each.
    pub fn beyond(&self) -> Vec<(ValueId, f64)> {
        let end = self.fixed.format.max_word();
        let peaks = self.run.largest_in_graph_order(self.peaks.clone());
        let beyond = peaks.iter().enumerate().filter(|(_, peak)| **peak > end);
        beyond
            .map(|(value, peak)| (ValueId::at(value), libm::scalbn(*peak as f64, self.fixed.exponents[value])))
            .collect()
    }
}
