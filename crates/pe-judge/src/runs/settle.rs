//! Number formats under which the span runs without saturation, and the roundings of coefficients.

use std::sync::Arc;
use std::sync::mpsc::Receiver;

use pe_hls::formats::{self, Ranges};
use pe_hls::rounding::{self, Aim};
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph, ValueId};
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;
use pe_sim::compared::{Compared, Rows};
use pe_sim::double::DoubleRun;
use pe_sim::error::Trajectory;
use pe_sim::fixed::FixedRun;

use crate::criteria::ProofMode;
use crate::proof::{self, Proof};
use crate::times::thread_seconds;

use super::comparison::Kept;
use super::exact::{AtCorner, Exact, compared_outputs};
use super::judged::Checkpoint;
use super::lockstep::Pass;
use super::proven::{self, Proposal};
use super::reasons;
use super::saturated::{self, Beyond, Ended, Saturated};
use super::settled::{Measured, Settled};

/// Fixed-point runs before a saturating model is refused.
const WIDENINGS: usize = 24;

/// Word-length error from which on pairs of operands are given up for the accuracy that they cost.
const PAIR_ERROR: f64 = 1e-3;

/// Coefficient error from which on roundings that cancel over the step are worth a run.
const BALANCED_ERROR: f64 = 1e-7;

/// Where the run in double precision comes from, block by block.
enum Source<'a> {
    /// A run that another thread does anyway.
    Shared(Receiver<Arc<Rows>>),
    /// A run of before.
    Kept(std::slice::Iter<'a, Arc<Rows>>),
    Own(Box<Pass<'a>>),
}

/// What makes runs in fixed point shorter where many are made.
#[derive(Clone, Copy, Default)]
pub struct Aids<'a> {
    /// The run of the same step in double precision.
    pub kept: Option<&'a Kept>,
    /// Word-length error beyond which a run ends.
    pub most: Option<f64>,
}

/// Why no formats were settled on.
pub enum Unsettled {
    /// They are refused.
    Refused(Vec<Diagnostic>),
    /// The run ended early, see [`Aids::most`].
    Beyond(Beyond),
}

impl From<Vec<Diagnostic>> for Unsettled {
    fn from(findings: Vec<Diagnostic>) -> Unsettled {
        Unsettled::Refused(findings)
    }
}

impl Unsettled {
    /// The findings, where runs do not end early.
    fn findings(self) -> Vec<Diagnostic> {
        match self {
            Unsettled::Refused(findings) => findings,
            Unsettled::Beyond(_) => unreachable!("no error is too large"),
        }
    }
}

impl Exact {
    /// Finds formats under which the span runs without saturation.
    ///
    /// # Errors
    /// `E0902` saturates however wide, `E080x` no format.
    pub fn settle(&self, model: &Model, graph: &StepGraph, format: WordFormat) -> Result<Settled, Vec<Diagnostic>> {
        self.unless_paired(model, graph, format, &self.ranges, None, Aids::default()).map_err(Unsettled::findings)
    }

    /// The same, in the formats that are proposed if there are such and they cost little accuracy.
    ///
    /// # Errors
    /// Those of [`Exact::settle`], and runs that end early.
    pub fn settle_proven(
        &self,
        model: &Model,
        graph: &StepGraph,
        format: WordFormat,
        proposal: Option<&Proposal>,
        aids: Aids,
    ) -> Result<Settled, Unsettled> {
        self.settle_aided(model, graph, format, proposal, None, aids)
    }

    /// The same, where the first run can listen to one in double precision.
    pub(super) fn settle_listening(
        &self,
        model: &Model,
        graph: &StepGraph,
        format: WordFormat,
        proposal: Option<&Proposal>,
        shared: Option<Receiver<Arc<Rows>>>,
    ) -> Result<Settled, Vec<Diagnostic>> {
        let settled = self.settle_aided(model, graph, format, proposal, shared, Aids::default());
        settled.map_err(Unsettled::findings)
    }

    fn settle_aided(
        &self,
        model: &Model,
        graph: &StepGraph,
        format: WordFormat,
        proposal: Option<&Proposal>,
        mut shared: Option<Receiver<Arc<Rows>>>,
        aids: Aids,
    ) -> Result<Settled, Unsettled> {
        let mut wide = None;
        if let Some(proposal) = proposal.filter(|proposal| proposal.widened() > 0) {
            let settled = self.unless_paired(model, graph, format, proposal.ranges(), shared.take(), aids);
            let proven = settled.ok().and_then(|settled| proposal.proven(model, graph, settled));
            match proven {
                Some(settled) if settled.word_length() <= proven::HARMLESS => return Ok(settled),
                settled => wide = settled,
            }
        }
        let narrow = self.unless_paired(model, graph, format, &self.ranges, shared, aids)?;
        match wide {
            Some(wide) if wide.word_length() <= proven::ERROR_GROWTH * narrow.word_length() => {
                Ok(wide.with_error_before(narrow.word_length()))
            }
            _ => Ok(match proposal {
                Some(proposal) => proposal.as_found(model, graph, narrow),
                None => narrow,
            }),
        }
    }

    /// Formats with pairs of operands if the graph has such and they cost little accuracy.
    fn unless_paired(
        &self,
        model: &Model,
        graph: &StepGraph,
        format: WordFormat,
        ranges: &Ranges,
        shared: Option<Receiver<Arc<Rows>>>,
        aids: Aids,
    ) -> Result<Settled, Unsettled> {
        let settled = match self.widened(model, graph, format, ranges.clone(), shared, aids) {
            Ok(settled) if !graph.pre_adder || settled.word_length() <= PAIR_ERROR => return Ok(settled),
            Ok(settled) => Some(settled),
            // Without pairs the same word may be accurate enough.
            Err(Unsettled::Beyond(_)) if graph.pre_adder => None,
            Err(other) => return Err(other),
        };
        let alone = StepGraph { pre_adder: false, ..graph.clone() };
        let most = aids.most.filter(|_| settled.is_none());
        let alone = self.widened(model, &alone, format, ranges.clone(), None, Aids { kept: None, most })?;
        let Some(settled) = settled else { return Ok(alone) };
        Ok(if alone.word_length() < settled.word_length() { alone } else { settled })
    }

    /// Chooses formats and widens them until the fixed-point run does not saturate.
    fn widened(
        &self,
        model: &Model,
        graph: &StepGraph,
        format: WordFormat,
        mut ranges: Ranges,
        mut shared: Option<Receiver<Arc<Rows>>>,
        aids: Aids,
    ) -> Result<Settled, Unsettled> {
        let (mut widenings, mut with_rounding) = (0, false);
        // A bit at a time keeps LSBs fine. Where that does not do, all ranges become what rounding makes of them at once.
        let (narrow, mut by_noise) = (ranges.clone(), None);
        loop {
            let chosen = match formats::choose(graph, &ranges, format) {
                Ok(chosen) => chosen,
                // Values that are next to nothing in double precision ask for LSBs that nothing they are computed from has.
                Err(refused) if refused.code == codes::NO_FORMAT && !with_rounding => {
                    with_rounding = true;
                    ranges = ranges.with_rounding(graph, format);
                    continue;
                }
                Err(refused) => return Err(vec![refused].into()),
            };
            let mut fixed = chosen.clone();
            let aim = Aim::Chain;
            rounding::improve(graph, &mut fixed, &self.moments, aim);
            let source = shared.take().map_or_else(|| self.source(graph, aids), Source::Shared);
            let measured = self.measure(model, graph, &fixed, source, aids.most);
            match measured.and_then(|measured| self.hold_at_corners(graph, &fixed).map(|()| measured)) {
                Ok(measured) => {
                    let settled = Settled { fixed, aim: Some(aim), widenings, measured, proof: None };
                    return Ok(self.balanced(model, graph, chosen, settled, aids));
                }
                Err(Ended::Diverged(findings)) => return Err(findings.into()),
                Err(Ended::Beyond(beyond)) => return Err(Unsettled::Beyond(beyond)),
                Err(Ended::Saturated(saturated))
                    if by_noise.is_none() && widenings < WIDENINGS && saturated.argument(graph).is_none() =>
                {
                    widenings += 1;
                    for value in &saturated.values {
                        ranges.widened[value.index()] += 1;
                    }
                }
                Err(Ended::Saturated(_)) if by_noise.is_none() && widenings > 0 => {
                    (ranges, by_noise, with_rounding) = (narrow.clone(), Some(0), false);
                }
                Err(Ended::Saturated(saturated)) if saturated.argument(graph).is_some() => {
                    return Err(vec![saturated.refusal(model, graph, self, &fixed)].into());
                }
                Err(Ended::Saturated(_)) if by_noise.is_some_and(|rounds| rounds < WIDENINGS) => {
                    widenings += 1;
                    by_noise = by_noise.map(|rounds| rounds + 1);
                    self.include_noise(model, graph, &fixed, &mut ranges);
                }
                Err(Ended::Saturated(saturated)) => {
                    let states = model.states.ids();
                    let small = |state: StateId| reasons::too_small(model, state, self.scales[state.index()]);
                    let refusal = states.into_iter().find_map(small);
                    return Err(vec![refusal.unwrap_or_else(|| saturated.refusal(model, graph, self, &fixed))].into());
                }
            }
        }
    }

    /// Runs in formats that are given, which have to be wide enough as they are.
    ///
    /// # Errors
    /// `E0902` for what leaves its word, or uses head room that pairs of operands count on.
    pub(super) fn settle_given(
        &self,
        model: &Model,
        graph: &StepGraph,
        fixed: &FixedPoint,
        proof: ProofMode,
    ) -> Result<Settled, Vec<Diagnostic>> {
        let half = libm::scalbn(1.0, fixed.format.word_bits() as i32 - 2);
        let cramped = (0..graph.values.len()).find(|value| {
            fixed.half_scale[*value] && libm::scalbn(self.largest[*value], -fixed.exponents[*value]) > half
        });
        if let Some(value) = cramped {
            return Err(vec![saturated::too_narrow(graph, ValueId::at(value), "uses more than half of its range")]);
        }
        let measured = self.measure(model, graph, fixed, self.source(graph, Aids::default()), None);
        let measured = match measured.and_then(|measured| self.hold_at_corners(graph, fixed).map(|()| measured)) {
            Ok(measured) => measured,
            Err(Ended::Diverged(findings)) => return Err(findings),
            Err(Ended::Beyond(_)) => unreachable!("no error is too large"),
            Err(Ended::Saturated(saturated)) => {
                let what = format!("saturates at t = {:.6e} s", model.time(saturated.step, 0.0));
                return Err(vec![saturated::too_narrow(graph, saturated.values[0], &what)]);
            }
        };
        let proof = match proof {
            ProofMode::Off => None,
            ProofMode::Ranges => {
                let enclosed = proof::enclose(graph, fixed, model.steps());
                Some(Proof { enclosed, widened: 0, word_length: None })
            }
        };
        Ok(Settled { fixed: fixed.clone(), aim: None, widenings: 0, measured, proof })
    }

    fn source<'a>(&self, graph: &'a StepGraph, aids: Aids<'a>) -> Source<'a> {
        match aids.kept {
            Some(kept) => Source::Kept(kept.blocks.iter()),
            None => Source::Own(Box::new(self.own(graph))),
        }
    }

    /// Runs in fixed point, and in double precision with quantised coefficients, beside the run in double precision.
    fn measure(
        &self,
        model: &Model,
        graph: &StepGraph,
        fixed: &FixedPoint,
        mut source: Source,
        most: Option<f64>,
    ) -> Result<Measured, Ended> {
        let plan = &self.plan;
        let (states, outputs) = (model.states.len(), compared_outputs(graph));
        let output_turns = model.output_turns().into_iter().filter(|(output, _)| *output < outputs).collect();
        let mut run = FixedPass::new(graph, fixed, (states, outputs));
        let mut quantised = Pass::new(plan, DoubleRun::quantised(graph, fixed), 0);
        let mut measured = Measured {
            word: self.compared(),
            outputs: Compared::new(states, &self.output_scales, &vec![0.0; outputs]).modulo(output_turns),
            quantised: self.compared(),
            hardware: Trajectory::new(states),
            looks: Trajectory::new(states),
            curves: Trajectory::new(self.curves.outputs.len()),
            checkpoint: Checkpoint { step: 0, words: Vec::new() },
            seconds: 0.0,
        };
        for block in plan.blocks() {
            let shared;
            let double = match &mut source {
                Source::Shared(blocks) => {
                    shared = blocks.recv().expect("all blocks are sent");
                    &*shared
                }
                Source::Kept(blocks) => &**blocks.next().expect("all blocks are kept"),
                Source::Own(own) => own.block(plan, &block).expect("it was finite before"),
            };
            let begin = thread_seconds();
            run.rows.clear();
            for step in block.clone() {
                if step == plan.steps / 2 {
                    measured.checkpoint = run.checkpoint(step);
                }
                run.step(model, step)?;
                if plan.samples.binary_search(&(step + 1)).is_ok() {
                    measured.curves.push(|at| run.run.output(self.curves.outputs[at]));
                }
                plan.advance(step + 1, 1);
            }
            measured.seconds += thread_seconds() - begin;
            plan.compare(&block, &mut measured.word, double, &run.rows);
            let error = measured.word.worst().1;
            if most.is_some_and(|most| error > most) {
                return Err(Ended::Beyond(Beyond { error, time: model.time(block.end, 0.0) }));
            }
            if outputs > 0 {
                measured.outputs.include(block.end, double, &run.rows);
            }
            plan.compare(&block, &mut measured.quantised, double, quantised.block(plan, &block)?);
            for row in plan.sampled(&block) {
                measured.hardware.push(|state| run.rows.row(row)[state]);
            }
            for row in plan.looked_at(&block) {
                measured.looks.push(|state| run.rows.row(row)[state]);
            }
        }
        Ok(measured)
    }

    /// Runs in fixed point with tunable parameters at the ends of their ranges, where the same formats must do.
    fn hold_at_corners(&self, graph: &StepGraph, fixed: &FixedPoint) -> Result<(), Ended> {
        for AtCorner { corner, model, exact } in &self.corners {
            let graph = corner.graph(graph);
            let mut run = FixedRun::new(&graph, fixed);
            for step in 0..exact.plan.steps {
                let words = port_words(model, &run, step);
                advance(&mut run, &words, step)?;
            }
        }
        Ok(())
    }

    /// The same formats with roundings that cancel over the step, if the coefficient error matters and they make it
    /// smaller. `chosen` are the formats with nearest roundings.
    fn balanced(&self, model: &Model, graph: &StepGraph, chosen: FixedPoint, settled: Settled, aids: Aids) -> Settled {
        if settled.coefficient() <= BALANCED_ERROR || !rounding::can_balance(graph) {
            return settled;
        }
        let mut fixed = chosen;
        let aim = Aim::Step;
        rounding::improve(graph, &mut fixed, &self.moments, aim);
        self.plan.progress.add_length(3 * self.plan.steps);
        // Formats that were wide enough for the other roundings are kept with those.
        let measured = self.measure(model, graph, &fixed, self.source(graph, aids), None);
        let measured = measured.and_then(|measured| self.hold_at_corners(graph, &fixed).map(|()| measured));
        match measured {
            Ok(measured) if measured.quantised.worst().1 < settled.coefficient() => {
                Settled { fixed, aim: Some(aim), measured, ..settled }
            }
            _ => settled,
        }
    }
}

/// A run in fixed point, a row of states and outputs after each step.
struct FixedPass<'a> {
    graph: &'a StepGraph,
    run: FixedRun<'a>,
    states: usize,
    outputs: usize,
    rows: Rows,
}

impl<'a> FixedPass<'a> {
    fn new(graph: &'a StepGraph, fixed: &'a FixedPoint, (states, outputs): (usize, usize)) -> FixedPass<'a> {
        FixedPass { graph, run: FixedRun::new(graph, fixed), states, outputs, rows: Rows::new(states + outputs) }
    }

    fn checkpoint(&self, step: u64) -> Checkpoint {
        Checkpoint { step, words: self.graph.states.iter().map(|(state, _)| self.run.word(*state)).collect() }
    }

    fn step(&mut self, model: &Model, step: u64) -> Result<(), Saturated> {
        let FixedPass { run, states, outputs, rows, .. } = self;
        let words = port_words(model, run, step);
        advance(run, &words, step)?;
        rows.add(run.states().take(*states).chain((0..*outputs).map(|output| run.output(output))));
        Ok(())
    }
}

/// Runs a step in which nothing may saturate, and in front of the first one the initial values may not either.
fn advance(run: &mut FixedRun, words: &[i64], step: u64) -> Result<(), Saturated> {
    if run.step(words) || (step == 0 && run.saturations().iter().any(|count| *count > 0)) {
        let values = run.saturations().into_iter().enumerate().filter(|(_, count)| *count > 0);
        let values = values.map(|(index, _)| ValueId::at(index)).collect();
        return Err(Saturated { values, step });
    }
    Ok(())
}

/// Input port words of a step.
pub fn port_words(model: &Model, run: &FixedRun, step: u64) -> Vec<i64> {
    let numbers = model.sample_inputs(model.time(step, 0.0));
    numbers.iter().enumerate().map(|(index, number)| run.encode_input(index, *number).0).collect()
}
