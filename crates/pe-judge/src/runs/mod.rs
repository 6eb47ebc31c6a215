//! The runs over the span: ranges, number formats, and how wrong the result is.
//!
//! ```text
//! double, step h        ranges and magnitudes; refuses what turns non-finite
//!
//! double, step h        once more, beside all others: they are compared at every step, block by block
//! fixed point           widens formats until nothing saturates; word-length error, checkpoint
//! double, quantised     coefficient error on its own
//! double, step h/2      method error
//! double, step h        with the means of inputs: input-hold error
//! double, step h/4      for the first steps, to see the order of the method; for all, where right-hand sides have bends
//! ```

mod comparison;
mod inputs;
mod lockstep;
mod looks;
mod magnitudes;
mod proven;
mod reasons;
mod saturated;
mod sensitivity;
mod settled;

use std::sync::Arc;
use std::sync::mpsc::sync_channel;

use pe_hls::formats::Ranges;
use pe_hls::rounding::{Aim, Moments, Sampling};
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, Role, StageForm, StepGraph, ValueId};
use pe_ir::model::{Model, Variable, Waveform};
use pe_ir::source::{Diagnostic, Severity};
use pe_ir::word::WordFormat;
use pe_sim::compared::Compared;
use pe_sim::double::{Diverged, DoubleRun};
use pe_sim::error::Trajectory;
use pe_sim::fixed::FixedRun;

use crate::criteria::Criteria;
use crate::pivots::{self, SmallestPivot};
use crate::progress::Progress;
use crate::proof::Proof;
use crate::times::thread_seconds;

use self::lockstep::Plan;

pub use self::comparison::{Comparison, method_error};
pub use self::inputs::outside;
pub use self::proven::Proposal;
pub use self::sensitivity::{APART, SENSITIVE, Sensitivity};
use self::settled::Measured;
pub use self::settled::Settled;

/// Estimated method error from which on the step is refused, unless it is that of the beginning alone, and from which on
/// it is warned about.
const METHOD_ERROR_REFUSED: f64 = 0.5;
const METHOD_ERROR_WARNED: f64 = 0.02;

/// The same of the error that held inputs cause.
const INPUT_ERROR_REFUSED: f64 = 0.5;
const INPUT_ERROR_WARNED: f64 = 0.02;

/// Word-length error from which on the word is called short, and from which on its result is refused; that of a model
/// that multiplies small differences is refused as soon as it is warned about.
const WORD_ERROR_WARNED: f64 = 0.02;
const WORD_ERROR_REFUSED: f64 = 0.5;

/// Errors of all steps, relative to the largest magnitude of a state over the span; see `pe_sim::error` for the floor.
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    /// State with the largest word-length error.
    pub worst_state: usize,
    /// Fixed point against double precision with exact coefficients, same step: rounding and coefficients together.
    pub word_length: f64,
    /// The part of it that quantised coefficients alone cause.
    pub coefficient: f64,
    /// Both at the end of the span alone.
    pub at_end: (f64, f64),
    /// Tables against the functions that they stand for, both in double precision; none without functions.
    pub function: Option<f64>,
    /// Step `h` against step `h/2`, extrapolated with the order of the method.
    pub method: f64,
    /// Inputs held over `h` against their means; zero if all inputs are constant.
    pub input_hold: f64,
    /// The same errors relative to the largest magnitude of a state up to the step in question.
    pub to_date: ToDate,
}

/// Errors relative to the largest magnitude that a state has up to the step in question, at least a millionth of its
/// scale over the span.
#[derive(Clone, Copy, Debug)]
pub struct ToDate {
    /// As [`Errors::word_length`].
    pub word_length: f64,
    /// As [`Errors::coefficient`].
    pub coefficient: f64,
    /// As [`Errors::function`].
    pub function: Option<f64>,
    /// As [`Errors::method`].
    pub method: f64,
    /// As [`Errors::input_hold`].
    pub input_hold: f64,
}

impl Errors {
    /// The largest part of the error relative to the largest magnitude of a state up to the step in question.
    pub fn largest_to_date(&self) -> f64 {
        let ToDate { word_length, function, method, input_hold, .. } = self.to_date;
        [word_length, function.unwrap_or(0.0), method, input_hold].into_iter().fold(0.0, f64::max)
    }
}

impl ToDate {
    /// How much larger such an error has to be than that over the span to be worth telling.
    pub const APART: f64 = 10.0;
}

/// State words in the middle of a run, to start from there.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    /// Steps done.
    pub step: u64,
    /// Stored word of each state.
    pub words: Vec<i64>,
}

/// Outputs at the sample times, for pictures: the first few of the model's.
#[derive(Clone, Debug, Default)]
pub struct Curves {
    /// In double precision.
    pub double: Trajectory,
    /// In fixed point.
    pub fixed: Trajectory,
}

/// Outputs of which [`Curves`] are kept.
const CURVES: usize = 8;

fn curve_count(graph: &StepGraph) -> usize {
    graph.outputs.len().min(CURVES)
}

/// What the runs found.
#[derive(Clone)]
pub struct Judged {
    /// Number formats under which the span runs without saturation.
    pub fixed: FixedPoint,
    /// What the roundings of its coefficients cancel in; none if they were given.
    pub aim: Option<Aim>,
    /// Errors.
    pub errors: Errors,
    /// Number of times formats were widened.
    pub widenings: usize,
    /// Middle of the run.
    pub checkpoint: Checkpoint,
    /// Steps of the span: errors are the largest of all of them.
    pub steps: u64,
    /// Times of evenly spread samples, in seconds.
    pub times: Vec<f64>,
    /// States of the fixed-point run at these times.
    pub hardware: Trajectory,
    /// States of the run in double precision at these times.
    pub double: Arc<Trajectory>,
    /// States at other times of interest.
    pub looks: Looks,
    /// How much larger the errors of each state are than at the samples and looks.
    pub unseen: Unseen,
    /// Warnings.
    pub warnings: Vec<Diagnostic>,
    /// Nanoseconds per product in double precision and in fixed point.
    pub ns_per_mac: (f64, f64),
    /// Outputs over time.
    pub curves: Curves,
    /// Largest magnitude of each value of the step graph in the run in double precision.
    pub largest: Vec<f64>,
    /// Word-length error of each state.
    pub state_errors: Vec<f64>,
    /// Word-length error of each output that has a curve, relative to its largest magnitude.
    pub output_errors: Vec<f64>,
    /// The smallest pivot of an implicit method.
    pub smallest_pivot: Option<SmallestPivot>,
    /// Which ranges are proven; none if no proof was asked for.
    pub proof: Option<Proof>,
}

/// States at steps that deserve a look beside the samples: the first ones, and those after a jump of an input.
#[derive(Clone, Debug, Default)]
pub struct Looks {
    /// Times in seconds; none of them is that of a sample.
    pub times: Vec<f64>,
    /// States of the fixed-point run at these times.
    pub hardware: Trajectory,
    /// States of the run in double precision at these times.
    pub double: Arc<Trajectory>,
}

/// By how much errors are larger than at those steps at which states are kept, state by state, relative to their scales.
#[derive(Clone, Debug, Default)]
pub struct Unseen {
    /// Of the word length.
    pub word_length: Vec<f64>,
    /// Of method, held inputs and functions together.
    pub double: Vec<f64>,
}

/// Runs the model over its span.
///
/// # Errors
/// `E0901` non-finite, `E0902` saturates however wide, `E0903` step too large, `E0907` word too short, `E0913` to `E0915` input not seen,
/// `E080x` no format.
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

/// The run in double precision, which knows nothing of formats: ranges, and what others are compared to.
pub struct Exact {
    plan: Plan,
    form: StageForm,
    /// Whether tables stand for functions.
    tables: bool,
    reference: Arc<Trajectory>,
    /// States at the plan's looks.
    looks: Arc<Trajectory>,
    /// Largest magnitude of each output that has a curve.
    output_scales: Vec<f64>,
    /// Outputs in double precision alone.
    curves: Curves,
    largest: Vec<f64>,
    ranges: Ranges,
    moments: Moments,
    scales: Vec<f64>,
    seconds: f64,
    smallest_pivot: Option<SmallestPivot>,
}

impl Exact {
    /// Runs the step graph over the span.
    ///
    /// # Errors
    /// `E0901` non-finite, `E0905` a pivot of an implicit method close to zero, `E0914` a sine faster than the steps.
    pub fn run(model: &Model, graph: &StepGraph, progress: Arc<dyn Progress>) -> Result<Exact, Vec<Diagnostic>> {
        if let Some(finding) = inputs::too_fast(model) {
            return Err(vec![finding]);
        }
        let plan = Plan::of(model, progress);
        let begin = thread_seconds();
        let ReferenceRun { reference, looks, curves, mut ranges, moments } = reference_run(model, graph, &plan)?;
        let (reference, looks) = (Arc::new(reference), Arc::new(looks));
        let output_scales = graph.outputs[..curve_count(graph)].iter().map(|output| ranges.largest[output.index()]);
        let output_scales = output_scales.collect();
        let largest = ranges.largest.clone();
        let smallest_pivot = pivots::smallest(model, graph, &largest)?;
        let seconds = thread_seconds() - begin;
        include_declared(model, graph, &mut ranges);
        let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
        let scales = model.own_scales(reference.scales(&quantities));
        Ok(Exact {
            plan,
            form: graph.form,
            tables: !graph.functions.tables.is_empty(),
            reference,
            looks,
            output_scales,
            curves,
            largest,
            ranges,
            moments,
            scales,
            seconds,
            smallest_pivot,
        })
    }

    /// Times of samples and of looks, in seconds.
    pub fn times(&self) -> (Vec<f64>, Vec<f64>) {
        (self.plan.times(&self.plan.samples), self.plan.times(&self.plan.looks))
    }

    /// States at these times.
    pub fn states(&self) -> (&Trajectory, &Trajectory) {
        (&self.reference, &self.looks)
    }

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
        let (settled, comparison) = std::thread::scope(|scope| {
            let (sender, blocks) = sync_channel(BLOCKS_AHEAD);
            let comparison = scope.spawn(|| self.compare_telling(model, graph, Some(sender)));
            let settled = self.settle_listening(model, graph, format, proposal, Some(blocks));
            (settled, comparison.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
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
        let (settled, comparison) = std::thread::scope(|scope| {
            let comparison = scope.spawn(|| self.compare_telling(model, graph, None));
            let settled = self.settle_given(model, graph, fixed, criteria.proof);
            (settled, comparison.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
        });
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
        let Measured { word, outputs, quantised, hardware, looks, curves, checkpoint, seconds } = measured;
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
            worst_state,
            word_length,
            coefficient: quantised.worst().1,
            at_end: (word.at_end(), quantised.at_end()),
            function: comparison.function.as_ref().map(|function| function.worst().1),
            method,
            input_hold,
            to_date,
        };
        let mut warnings = Vec::new();
        let finding = comparison.finding(model);
        if comparison.lasting(model) > METHOD_ERROR_REFUSED {
            let rate = Sensitivity::of(model, graph, &self.scales).and_then(|sensitivity| sensitivity.rate);
            match rate.and_then(|rate| self.chaotic(model, graph, &fixed, rate, &hardware)) {
                Some(chaotic) => warnings.push(chaotic),
                None => warnings.extend(criteria.permit(vec![finding])?),
            }
        } else if errors.method > METHOD_ERROR_WARNED {
            let message = finding.message.replace("too large", "large");
            warnings.push(Diagnostic { code: codes::STEP_LARGE, message, ..finding.into_warning() });
        }
        if let Some(finding) = comparison.blindness().and_then(|blindness| blindness.finding(model)) {
            let refused = finding.severity == Severity::Error;
            warnings.extend(if refused { criteria.permit(vec![finding])? } else { vec![finding] });
        }
        // Of a chaotic model that has been told all that there is to say.
        let chaotic = warnings.iter().any(|warning| warning.code == codes::CHAOTIC);
        let word_short = if chaotic { None } else { self.word_short(model, graph, &word, errors, (&fixed, &hardware)) };
        if let Some(finding) = word_short {
            let refused = finding.severity == Severity::Error;
            warnings.extend(if refused { criteria.permit(vec![finding])? } else { vec![finding] });
        }
        warnings.extend(outside(model));
        let macs = graph.macs() as f64 * self.plan.steps as f64;
        Ok(Judged {
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
        })
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
        if let Some(finding) = reasons::too_small(model, errors.worst_state, self.scales[errors.worst_state]) {
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

/// Whether any input changes over time.
pub fn varying_inputs(model: &Model) -> bool {
    model.waveforms().any(|signal| !matches!(signal, Waveform::Constant(_)))
}

/// What the first run in double precision finds.
struct ReferenceRun {
    reference: Trajectory,
    looks: Trajectory,
    curves: Curves,
    ranges: Ranges,
    moments: Moments,
}

fn reference_run(model: &Model, graph: &StepGraph, plan: &Plan) -> Result<ReferenceRun, Vec<Diagnostic>> {
    let mut sampling = Sampling::new(graph);
    let mut run = DoubleRun::new(graph);
    let mut reference = Trajectory::new(model.states.len());
    let mut looks = Trajectory::new(model.states.len());
    let mut curves = Curves { double: Trajectory::new(curve_count(graph)), ..Curves::default() };
    let (mut samples, mut looked_at) = (plan.samples.iter().peekable(), plan.looks.iter().peekable());
    for done in 1..=plan.steps {
        let time = model.time(done - 1, 0.0);
        run.step(&model.sample_inputs(time)).map_err(|diverged| vec![non_finite(graph, diverged, time)])?;
        plan.advance(done, 1);
        if samples.next_if_eq(&&done).is_some() {
            reference.push(|state| run.state(state));
            curves.double.push(|output| run.output(output));
            sampling.add(|value| run.value(value));
        }
        if looked_at.next_if_eq(&&done).is_some() {
            looks.push(|state| run.state(state));
        }
    }
    let largest = run.largest();
    reference.largest = graph.states.iter().map(|(state, _)| largest[state.index()]).collect();
    let ranges = Ranges { largest, widened: vec![0; graph.values.len()] };
    Ok(ReferenceRun { reference, looks, curves, ranges, moments: sampling.moments() })
}

/// Magnitude of an argument from which on an infinite value is an overflow, not a pole.
const OVERFLOWING: f64 = 500.0;

/// What a run says that met a value that is not finite.
pub fn non_finite(graph: &StepGraph, diverged: Diverged, time: f64) -> Diagnostic {
    let equation = &graph.equations[graph.value(diverged.value).equation as usize];
    // An exponential that overflows has a domain; what its argument is has left all bounds.
    let overflows = |(function, argument): &(u32, f64)| {
        let value = graph.functions.exact[*function as usize].evaluate(*argument);
        value.is_infinite() && argument.abs() > OVERFLOWING
    };
    if let Some((function, argument)) = diverged.outside.filter(|outside| !overflows(outside)) {
        let function = &graph.functions.exact[function as usize].name;
        let message = format!("`{}` has no value at t = {time:.6e} s: `{function}` at x = {argument:e}", equation.name);
        return Diagnostic::error(codes::OUTSIDE_DOMAIN, equation.span, message)
            .with_help("try a smaller `--step`; or keep the argument in the domain, with `max`, `min` or `if`");
    }
    let message = format!("`{}` is no longer a finite number at t = {time:.6e} s", equation.name);
    Diagnostic::error(codes::DIVERGED, equation.span, message)
        .with_help("the model or the step is unstable: try a smaller `--step`, then check the equation")
}

/// Widens measured ranges to what the spec states and inputs can reach.
fn include_declared(model: &Model, graph: &StepGraph, ranges: &mut Ranges) {
    let mut include = |value: ValueId, (low, high): (f64, f64)| {
        let slot = &mut ranges.largest[value.index()];
        *slot = slot.max(low.abs()).max(high.abs());
    };
    for (input, value) in model.inputs.iter().zip(&graph.inputs) {
        include(*value, input.waveform.bounds());
        input.range.into_iter().for_each(|range| include(*value, range));
    }
    for (state, (value, _)) in model.states.iter().zip(&graph.states) {
        state.range.into_iter().for_each(|range| include(*value, range));
    }
    for (index, value) in graph.values.iter().enumerate() {
        let variable = match value.role {
            Role::Algebraic(algebraic, _) => Variable::Algebraic(algebraic),
            Role::Published(output) => model.outputs[output as usize].variable,
            _ => continue,
        };
        if let Variable::Algebraic(algebraic) = variable {
            let range = model.algebraics[algebraic as usize].range;
            range.into_iter().for_each(|range| include(ValueId(index as u32), range));
        }
    }
}

/// Input port words of a step.
pub fn port_words(model: &Model, run: &FixedRun, step: u64) -> Vec<i64> {
    let numbers = model.sample_inputs(model.time(step, 0.0));
    numbers.iter().enumerate().map(|(index, number)| run.encode_input(index, *number).0).collect()
}
