//! Number formats under which the span runs without saturation, and the roundings of coefficients.

use pe_hls::formats::{self, Ranges};
use pe_hls::rounding::{self, Aim};
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;
use pe_sim::double::DoubleRun;
use pe_sim::error::{Deviation, Trajectory};

use crate::pipeline::thread_seconds;

use super::comparison::{Substeps, trajectory};
use super::inputs::Sight;
use super::{Checkpoint, Exact, fixed_run};

/// Fixed-point runs before a saturating model is refused.
const WIDENINGS: usize = 24;

/// Word-length error from which on pairs of operands are given up for the accuracy that they cost.
const PAIR_ERROR: f64 = 1e-3;

/// Coefficient error from which on roundings that cancel over the step are worth a run.
const BALANCED_ERROR: f64 = 1e-7;

/// Formats under which the span runs without saturation, and what they cost in accuracy.
pub struct Settled {
    pub(super) fixed: FixedPoint,
    /// What its roundings cancel in.
    pub(super) aim: Aim,
    /// Samples of the fixed-point run.
    pub(super) hardware: Trajectory,
    /// Deviation of the run in double precision with quantised coefficients.
    pub(super) quantised: Deviation,
    /// The same at the last sample alone.
    pub(super) quantised_at_end: Deviation,
    pub(super) checkpoint: Checkpoint,
    pub(super) curves: Trajectory,
    pub(super) widenings: usize,
    /// Time of the fixed-point run.
    pub(super) seconds: f64,
}

impl Settled {
    /// The formats.
    pub fn fixed(&self) -> &FixedPoint {
        &self.fixed
    }
}

impl Exact {
    /// Finds formats under which the span runs without saturation.
    ///
    /// # Errors
    /// `E0902` saturates however wide, `E080x` no format.
    pub fn settle(&self, model: &Model, graph: &StepGraph, format: WordFormat) -> Result<Settled, Vec<Diagnostic>> {
        let settled = self.widened(model, graph, format, self.ranges.clone())?;
        if !graph.pre_adder || self.word_length(&settled) <= PAIR_ERROR {
            return Ok(settled);
        }
        let alone = StepGraph { pre_adder: false, ..graph.clone() };
        let alone = self.widened(model, &alone, format, self.ranges.clone())?;
        Ok(if self.word_length(&alone) < self.word_length(&settled) { alone } else { settled })
    }

    /// Chooses formats and widens them until the fixed-point run does not saturate.
    pub(super) fn widened(
        &self,
        model: &Model,
        graph: &StepGraph,
        format: WordFormat,
        mut ranges: Ranges,
    ) -> Result<Settled, Vec<Diagnostic>> {
        let mut widenings = 0;
        loop {
            let chosen = formats::choose(graph, &ranges, format).map_err(|error| vec![error])?;
            let mut fixed = chosen.clone();
            let aim = Aim::Chain;
            rounding::improve(graph, &mut fixed, &self.moments, aim);
            let begin = thread_seconds();
            match fixed_run(model, graph, &fixed, &self.plan) {
                Ok((hardware, checkpoint, curves)) => {
                    let seconds = thread_seconds() - begin;
                    let (quantised, quantised_at_end) = self.quantised(model, graph, &fixed)?;
                    let settled = Settled {
                        fixed,
                        aim,
                        hardware,
                        quantised,
                        quantised_at_end,
                        checkpoint,
                        curves,
                        widenings,
                        seconds,
                    };
                    return self.balanced(model, graph, chosen, settled);
                }
                Err(saturated) if saturated.argument(graph).is_some() => {
                    return Err(vec![saturated.refusal(model, graph)]);
                }
                Err(saturated) if widenings < WIDENINGS => {
                    widenings += 1;
                    for value in &saturated.values {
                        ranges.widened[value.index()] += 1;
                    }
                }
                Err(saturated) => return Err(vec![saturated.refusal(model, graph)]),
            }
        }
    }

    /// Deviation of a run in double precision with quantised coefficients, over the span and at its end.
    fn quantised(
        &self,
        model: &Model,
        graph: &StepGraph,
        fixed: &FixedPoint,
    ) -> Result<(Deviation, Deviation), Vec<Diagnostic>> {
        let run = DoubleRun::quantised(graph, fixed);
        let samples = trajectory(model, run, &self.plan, Substeps { count: 1, inputs: Sight::Held })?;
        Ok((self.reference.deviation(&samples), self.reference.last().deviation(&samples.last())))
    }

    /// The same formats with roundings that cancel over the step, if the coefficient error matters and they make it
    /// smaller. `chosen` are the formats with nearest roundings.
    fn balanced(
        &self,
        model: &Model,
        graph: &StepGraph,
        chosen: FixedPoint,
        settled: Settled,
    ) -> Result<Settled, Vec<Diagnostic>> {
        let error = |deviation: &Deviation| deviation.worst(&self.scales).1;
        if error(&settled.quantised) <= BALANCED_ERROR || !rounding::can_balance(graph) {
            return Ok(settled);
        }
        let mut fixed = chosen;
        let aim = Aim::Step;
        rounding::improve(graph, &mut fixed, &self.moments, aim);
        self.plan.progress.inc_length(self.plan.steps);
        let (quantised, quantised_at_end) = self.quantised(model, graph, &fixed)?;
        if error(&quantised) >= error(&settled.quantised) {
            return Ok(settled);
        }
        self.plan.progress.inc_length(self.plan.steps);
        let begin = thread_seconds();
        Ok(match fixed_run(model, graph, &fixed, &self.plan) {
            Ok((hardware, checkpoint, curves)) => {
                let seconds = thread_seconds() - begin;
                Settled { fixed, aim, hardware, quantised, quantised_at_end, checkpoint, curves, seconds, ..settled }
            }
            // Formats that were wide enough for the other roundings are kept with those.
            Err(_) => settled,
        })
    }
}
