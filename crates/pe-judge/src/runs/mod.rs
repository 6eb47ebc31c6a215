//! The runs over the span: ranges, number formats, and the errors of the result.
//!
//! ```text
//! double, step h        ranges and magnitudes; refuses what turns non-finite
//!
//! double, step h        once more, beside all others: they are compared at every step, block by block
//! fixed point           widens formats until nothing saturates; word-length error, checkpoint
//! double, quantised     coefficient error on its own
//! double, step h/2      method error
//! double, step h        with the means of inputs: input-hold error
//! double, step h/4      for the first steps, to see the order of the method; for all, where right-hand sides have
//! bends
//! ```

mod comparison;
mod copies;
mod events;
mod exact;
mod inputs;
mod judged;
mod jumping;
mod kept;
mod lockstep;
mod looks;
mod magnitudes;
mod measure;
mod noise;
mod proven;
mod reasons;
mod saturated;
mod sensitivity;
mod settle;
mod settled;
mod siblings;
mod tallied;
mod tally;

use std::sync::Arc;
use std::sync::mpsc::sync_channel;

use pe_ir::codes;
use pe_ir::graph::{FixedPoint, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::Model;
use pe_ir::source::{Diagnostic, Severity};
use pe_ir::word::WordFormat;
use pe_sim::compared::Compared;
use pe_sim::error::Trajectory;

use crate::criteria::{Criteria, JudgedBy};
use crate::progress::Progress;

use self::exact::AtCorner;
use self::settled::{Measured, Run};

pub use self::comparison::{Comparison, method_error};
pub use self::exact::{Exact, non_finite};
pub use self::inputs::{outside, varying_inputs};
pub use self::judged::{Checkpoint, Curves, Errors, Judged, Looks, ToDate, Unseen};
pub use self::jumping::left_at;
pub use self::kept::{Kept, Room};
pub use self::measure::port_words;
pub use self::proven::Proposal;
pub use self::saturated::Beyond;
pub use self::sensitivity::{APART, SENSITIVE, Sensitivity};
pub use self::settle::{Aids, Unsettled};
pub use self::settled::Settled;
pub use self::siblings::Siblings;
pub use self::tally::{Difference, Family, Part, Tally};

/// Estimated method error from which on the step is refused, unless it is that of the beginning alone, and from which on
/// it is warned about.
const METHOD_ERROR_REFUSED: f64 = 0.5;
const METHOD_ERROR_WARNED: f64 = 0.02;

/// Word-length error from which on the word is called short, and from which on its result is refused; that of a model
/// that multiplies small differences is refused as soon as it is warned about.
const WORD_ERROR_WARNED: f64 = 0.02;
const WORD_ERROR_REFUSED: f64 = 0.5;

/// Runs the model over its span.
///
/// # Errors
/// `E0901` non-finite, `E0902` saturates however wide, `E0903` step too large, `E0907` word too short, `E0913` to `E0915` input not seen,
/// `E080x` no format, `E0931` and `E0932` of events that are counted.
pub fn judge(
    model: &Model,
    graph: &StepGraph,
    format: WordFormat,
    criteria: &Criteria,
    progress: Arc<dyn Progress>,
) -> Result<Judged, Vec<Diagnostic>> {
    Exact::run(model, graph, progress)?.judge(model, graph, format, criteria, None)
}

/// Blocks that one run in double precision may be ahead of those that listen to it.
const BLOCKS_AHEAD: usize = 4;

/// The results of both, the second from a thread of its own.
fn side_by_side<A, B: Send>(own: impl FnOnce() -> A, other: impl FnOnce() -> B + Send) -> (A, B) {
    std::thread::scope(|scope| {
        let other = scope.spawn(other);
        (own(), other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    })
}

impl Exact {
    /// The other runs, in the formats that are proposed if there are such.
    ///
    /// # Errors
    /// Those of [`judge`].
    pub fn judge(
        &self,
        model: &Model,
        graph: &StepGraph,
        format: WordFormat,
        criteria: &Criteria,
        proposal: Option<&Proposal>,
    ) -> Result<Judged, Vec<Diagnostic>> {
        // They depend on this run alone, so they share the machine's cores; each is deterministic.
        let (sender, blocks) = sync_channel(BLOCKS_AHEAD);
        let (settled, comparison) = side_by_side(
            || self.settle_listening(model, graph, format, proposal, Some(blocks)),
            // The listener must hear of it if this run ends.
            move || self.compare_telling(model, graph, &mut |rows| sender.send(Arc::clone(rows)).is_ok()),
        );
        self.conclude(model, graph, settled, comparison, criteria)
    }

    /// The other runs, in formats that are given.
    ///
    /// # Errors
    /// Those of [`judge`]; `E0902` for formats that are too narrow.
    pub fn judge_given(
        &self,
        model: &Model,
        graph: &StepGraph,
        fixed: &FixedPoint,
        criteria: &Criteria,
    ) -> Result<Judged, Vec<Diagnostic>> {
        let (settled, comparison) =
            side_by_side(|| self.settle_given(model, graph, fixed, criteria.proof), || self.compare(model, graph));
        self.conclude(model, graph, settled, comparison, criteria)
    }

    /// Puts together what the runs found.
    ///
    /// # Errors
    /// Those of the runs; `E0903` step too large, `E0907` word too short.
    pub fn conclude(
        &self,
        model: &Model,
        graph: &StepGraph,
        settled: Result<Settled, Vec<Diagnostic>>,
        comparison: Result<Comparison, Vec<Diagnostic>>,
        criteria: &Criteria,
    ) -> Result<Judged, Vec<Diagnostic>> {
        let settled = settled?;
        let comparison = comparison?;
        let Settled { fixed, aim, widenings, measured, proof } = settled;
        let Measured { run, quantised } = measured;
        let Run { word, outputs, hardware, looks, curves, checkpoint, seconds } = run;
        let (worst_state, word_length) = word.worst();
        let (method, input_hold) = (comparison.method(), comparison.input_hold());
        let (method_to_date, hold_to_date) = comparison.to_date();
        let to_date = ToDate {
            word_length: word.to_date(),
            coefficient: quantised.to_date(),
            function: comparison.function.as_ref().map(Compared::to_date),
            method: method_to_date,
            input_hold: hold_to_date,
        };
        let errors = Errors {
            worst_state: StateId::at(worst_state),
            word_length,
            coefficient: quantised.worst().1,
            at_end: (word.at_end(), quantised.at_end()),
            function: comparison.function.as_ref().map(|function| function.worst().1),
            method,
            input_hold,
            to_date,
        };
        let mut warnings = Vec::new();
        let tally = self.counted(model, graph, &fixed, criteria, &mut warnings)?;
        // Trajectories count for as long as no event falls in another step.
        let together = tally.as_ref().map(|tally| tally.differences().map(|difference| difference.apart.is_none()));
        let [word_counts, step_counts, _] = together.unwrap_or([true; 3]);
        let finding = comparison.finding(model);
        if step_counts && comparison.lasting(model) > METHOD_ERROR_REFUSED {
            let rate = Sensitivity::of(model, graph, &self.scales).and_then(|sensitivity| sensitivity.rate);
            match rate.and_then(|rate| self.chaotic(model, graph, &fixed, rate, &hardware)) {
                Some(chaotic) => warnings.push(chaotic),
                None => warnings.extend(criteria.permit(vec![finding])?),
            }
        } else if step_counts && errors.method > METHOD_ERROR_WARNED {
            let message = finding.message.replace("too large", "large");
            warnings.push(Diagnostic { code: codes::STEP_LARGE, message, ..finding.into_warning() });
        }
        if let Some(finding) = comparison.blindness().and_then(|blindness| blindness.finding(model)) {
            let refused = finding.severity == Severity::Error;
            warnings.extend(if refused { criteria.permit(vec![finding])? } else { vec![finding] });
        }
        // Of a chaotic model that has been told all that there is to say.
        let chaotic = warnings.iter().any(|warning| warning.code == codes::CHAOTIC);
        let word_short = if chaotic || !word_counts {
            None
        } else {
            self.word_short(model, graph, &word, errors, (&fixed, &hardware))
        };
        if let Some(finding) = word_short {
            let refused = finding.severity == Severity::Error;
            warnings.extend(if refused { criteria.permit(vec![finding])? } else { vec![finding] });
        }
        warnings.extend(outside(model));
        let macs = graph.macs() as f64 * self.plan.steps as f64;
        let mut judged = Judged {
            fixed,
            aim,
            errors,
            widenings,
            checkpoint,
            steps: self.plan.steps,
            times: self.plan.times(&self.plan.samples),
            hardware,
            double: Arc::clone(&self.reference),
            looks: Looks { times: self.plan.times(&self.plan.looks), hardware: looks, double: Arc::clone(&self.looks) },
            unseen: Unseen { word_length: word.unseen().collect(), double: comparison.unseen() },
            warnings,
            ns_per_mac: (self.seconds * 1e9 / macs, seconds * 1e9 / macs),
            curves: Curves { fixed: curves, ..self.curves.clone() },
            largest: self.largest.clone(),
            state_errors: word.relative().collect(),
            output_errors: outputs.relative().collect(),
            smallest_pivot: self.smallest_pivot.clone(),
            proof,
            tally,
            corners: Vec::new(),
        };
        for AtCorner { corner, model, exact } in &self.corners {
            let other = exact.judge_given(model, &corner.graph(graph), &judged.fixed, criteria);
            judged.include(corner, other.map_err(|findings| corner.named(findings))?);
        }
        Ok(judged)
    }

    /// Events of the runs, where they are what is judged.
    ///
    /// # Errors
    /// `E0901` non-finite, `E0931` no events, `E0932` other numbers of them.
    fn counted(
        &self,
        model: &Model,
        graph: &StepGraph,
        fixed: &FixedPoint,
        criteria: &Criteria,
        warnings: &mut Vec<Diagnostic>,
    ) -> Result<Option<Tally>, Vec<Diagnostic>> {
        if criteria.by == JudgedBy::Trajectories {
            return Ok(None);
        }
        let tally = self.tally(model, graph, fixed)?;
        let (refusals, told) = tally.findings(model);
        warnings.extend(criteria.permit(refusals)?);
        warnings.extend(told);
        Ok(Some(tally))
    }

    /// The warning about a chaotic model that multiplies differences at such a rate.
    fn chaotic(
        &self,
        model: &Model,
        graph: &StepGraph,
        fixed: &FixedPoint,
        rate: f64,
        hardware: &Trajectory,
    ) -> Option<Diagnostic> {
        reasons::chaotic(model, graph, fixed, (&self.scales, rate), (&self.reference, hardware))
    }

    /// The finding about a word-length error that is no longer small.
    ///
    /// Of a chaotic model any word gives another trajectory sooner or later, which is no reason to refuse this one. Of
    /// others the word is too short where the run has little in common with the model, or where the model multiplies
    /// differences so much that the last bits decide where it goes, and not the step.
    fn word_short(
        &self,
        model: &Model,
        graph: &StepGraph,
        word: &Compared,
        errors: Errors,
        (fixed, hardware): (&FixedPoint, &Trajectory),
    ) -> Option<Diagnostic> {
        if errors.word_length <= WORD_ERROR_WARNED {
            return None;
        }
        if let Some(finding) = reasons::too_small(model, errors.worst_state, self.scales[errors.worst_state.index()]) {
            return Some(finding);
        }
        let state = &model.states[errors.worst_state];
        let message = format!(
            "word short: rounding moves `{}` by {:.1e} of its largest magnitude",
            state.name, errors.word_length
        );
        let warning = Diagnostic::error(codes::WORD_SHORT, state.span, message)
            .with_help("take a wider multiplier or more `--storage` bits, or narrow the stated ranges")
            .into_warning();
        let sensitivity = Sensitivity::of(model, graph, &self.scales);
        if let Some(rate) = sensitivity.and_then(|sensitivity| sensitivity.rate)
            && let Some(chaotic) = self.chaotic(model, graph, fixed, rate, hardware)
        {
            return Some(chaotic);
        }
        let growth = sensitivity.map_or(0.0, |sensitivity| sensitivity.growth);
        let decided = growth > sensitivity::SENSITIVE && errors.method <= METHOD_ERROR_WARNED;
        if !(decided || errors.word_length > WORD_ERROR_REFUSED) {
            return Some(warning);
        }
        let time = model.time(word.since(WORD_ERROR_WARNED), 0.0);
        let reason = match decided {
            true => {
                format!("the model multiplies differences by {growth:.1e}, so that the last bits decide where it goes")
            }
            false => "the run has little in common with the model".to_owned(),
        };
        let message = format!(
            "the word is too short: from t = {time:.6e} s on rounding moves states by more than {WORD_ERROR_WARNED} of \
             their largest magnitude, `{}` by up to {:.1e}; {reason}",
            state.name, errors.word_length
        );
        Some(Diagnostic { code: codes::WORD_TOO_SHORT, message, severity: Severity::Error, ..warning })
    }
}
