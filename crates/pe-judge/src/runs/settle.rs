//! Number formats under which the span runs without saturation, and the roundings of coefficients.

use std::sync::Arc;
use std::sync::mpsc::Receiver;

use pe_hls::formats::{self, Ranges};
use pe_hls::rounding::{self, Aim, Moments};
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph, ValueId};
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;
use pe_sim::compared::{Compared, Rows};

use crate::criteria::ProofMode;
use crate::proof::{self, Proof};

use super::exact::Exact;
use super::kept::Kept;
use super::measure::Source;
use super::proven::{self, Proposal};
use super::reasons;
use super::saturated::{self, Beyond, Ended};
use super::settled::{Measured, Run, Settled};

/// Fixed-point runs before a saturating model is refused.
const WIDENINGS: usize = 24;

/// Word-length error from which on pairs of operands are given up for the accuracy that they cost.
const PAIR_ERROR: f64 = 1e-3;

/// Coefficient error from which on roundings that cancel over the step are worth a run.
const BALANCED_ERROR: f64 = 1e-7;

/// Bits of a coefficient up to which its rounding alone is expected to be a larger error than that.
const SHORT_COEFFICIENT: u32 = 23;

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
            let roundings = Roundings::of(graph, chosen, &self.moments);
            let source = shared.take().map_or_else(|| self.source(graph, aids), Source::Shared);
            let fixed = &roundings.chain;
            let first = widenings == 0 && by_noise.is_none();
            match self.rounded(model, graph, &roundings, source, first, aids) {
                Ok((fixed, aim, measured)) => {
                    return Ok(Settled { fixed, aim: Some(aim), widenings, measured, proof: None });
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
                    self.siblings.iter().for_each(|siblings| siblings.include(&mut ranges));
                }
                Err(Ended::Saturated(_)) if by_noise.is_none() && widenings > 0 => {
                    (ranges, by_noise, with_rounding) = (narrow.clone(), Some(0), false);
                }
                Err(Ended::Saturated(saturated)) if saturated.argument(graph).is_some() => {
                    return Err(vec![saturated.refusal(model, graph, self, fixed)].into());
                }
                Err(Ended::Saturated(_)) if by_noise.is_some_and(|rounds| rounds < WIDENINGS) => {
                    widenings += 1;
                    by_noise = by_noise.map(|rounds| rounds + 1);
                    self.include_noise(model, graph, fixed, &mut ranges);
                }
                Err(Ended::Saturated(saturated)) => {
                    let states = model.states.ids();
                    let small = |state: StateId| reasons::too_small(model, state, self.scales[state.index()]);
                    let refusal = states.into_iter().find_map(small);
                    return Err(vec![refusal.unwrap_or_else(|| saturated.refusal(model, graph, self, fixed))].into());
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
        let measured = self.measure(model, graph, fixed, [fixed], self.source(graph, Aids::default()), None);
        let measured = match measured.and_then(|measured| self.hold_at_corners(graph, fixed).map(|()| measured)) {
            Ok((run, [quantised])) => run.with(quantised),
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

    /// Runs in formats with roundings that cancel over the step if the coefficient error matters and they make it smaller,
    /// else with those that cancel in each chain. `first` says that no formats were too narrow before.
    fn rounded(
        &self,
        model: &Model,
        graph: &StepGraph,
        roundings: &Roundings,
        source: Source,
        first: bool,
        aids: Aids,
    ) -> Result<(FixedPoint, Aim, Measured), Ended> {
        let Roundings { chain, step } = roundings;
        let in_chain = |(run, quantised): (Run, Compared)| (chain.clone(), Aim::Chain, run.with(quantised));
        let in_step =
            |(run, quantised): (Run, Compared)| (step.clone().expect("it is run"), Aim::Step, run.with(quantised));
        let held = |fixed: &FixedPoint, run: Run| self.hold_at_corners(graph, fixed).map(|()| run);
        let Some(step) = step else {
            let (run, [quantised]) = self.measure(model, graph, chain, [chain], source, aids.most)?;
            return held(chain, run).map(|run| in_chain((run, quantised)));
        };
        let (own, again) =
            (|| self.source(graph, aids), |runs: u64| self.plan.progress.add_length(runs * self.plan.steps));
        let better = |[of_chain, of_step]: &[Compared; 2]| {
            of_chain.worst().1 > BALANCED_ERROR && of_step.worst().1 < of_chain.worst().1
        };
        let mut source = source;
        if first && chain.format.coefficient_bits <= SHORT_COEFFICIENT {
            // Then they nearly always do, and one run is enough. Where formats have to be widened, two would end each time.
            let run = self.measure(model, graph, step, [chain, step], source, aids.most);
            match run.and_then(|(run, quantised)| held(step, run).map(|run| (run, quantised))) {
                Ok((run, quantised)) if better(&quantised) => {
                    return Ok(in_step((run, quantised.into_iter().nth(1).expect("two"))));
                }
                Ok((_, [quantised, _])) => {
                    again(1);
                    let (run, []) = self.measure(model, graph, chain, [], own(), aids.most)?;
                    return held(chain, run).map(|run| in_chain((run, quantised)));
                }
                // What ends a run with these roundings need not end one with the others.
                Err(_) => source = own(),
            }
            again(2);
        }
        let both = self.measure(model, graph, chain, [chain, step], source, aids.most);
        let (run, quantised) = match both {
            Err(Ended::Diverged(_)) => {
                again(2);
                let (run, [quantised]) = self.measure(model, graph, chain, [chain], own(), aids.most)?;
                return held(chain, run).map(|run| in_chain((run, quantised)));
            }
            both => both?,
        };
        let run = held(chain, run)?;
        let [of_chain, of_step] = quantised.clone();
        if !better(&quantised) {
            return Ok(in_chain((run, of_chain)));
        }
        again(1);
        // Formats that are wide enough for the other roundings are kept with those.
        let balanced = self.measure(model, graph, step, [], own(), None);
        match balanced.and_then(|(run, [])| held(step, run)) {
            Ok(run) => Ok(in_step((run, of_step))),
            Err(_) => Ok(in_chain((run, of_chain))),
        }
    }
}

/// Formats with the roundings that may be taken.
struct Roundings {
    /// With those that cancel in each chain.
    chain: FixedPoint,
    /// With those that cancel over the step; none if they are the same.
    step: Option<FixedPoint>,
}

impl Roundings {
    /// Those of formats whose coefficients are rounded to nearest.
    fn of(graph: &StepGraph, chosen: FixedPoint, moments: &Moments) -> Roundings {
        let rounded = |aim: Aim| {
            let mut fixed = chosen.clone();
            rounding::improve(graph, &mut fixed, moments, aim);
            fixed
        };
        let chain = rounded(Aim::Chain);
        let step = rounding::can_balance(graph).then(|| rounded(Aim::Step)).filter(|step| *step != chain);
        Roundings { chain, step }
    }
}
