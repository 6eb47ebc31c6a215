//! The runs over the span: ranges, number formats, and how wrong the result is.
//!
//! ```text
//! double, step h        ranges, reference trajectory; refuses what turns non-finite
//! fixed point           widens formats until nothing saturates; word-length error, checkpoint
//! double, quantised     coefficient error on its own
//! double, step h/2      method error; once more with the means of inputs: input-hold error
//! ```

mod comparison;
mod inputs;
mod proven;
mod reasons;
mod saturated;
mod sensitivity;
mod settled;

use std::sync::Arc;

use indicatif::ProgressBar;
use pe_hls::formats::Ranges;
use pe_hls::rounding::{Aim, Moments, Sampling};
use pe_hls::step::StepOptions;
use pe_ir::codes;
use pe_ir::graph::{FixedPoint, Role, StageForm, StepGraph, ValueId};
use pe_ir::model::{Model, Variable, Waveform};
use pe_ir::source::{Diagnostic, Severity};
use pe_ir::word::WordFormat;
use pe_sim::double::{Diverged, DoubleRun};
use pe_sim::error::Trajectory;
use pe_sim::fixed::FixedRun;

use crate::options::ModelOptions;
use crate::pipeline::thread_seconds;
use crate::pivots::{self, SmallestPivot};
use crate::proof::Proof;

use self::comparison::{Substeps, first_beyond, half_step_runs, trajectory};
use self::inputs::Sight;
use self::saturated::Saturated;

pub use self::comparison::Comparison;
pub use self::inputs::outside;
pub use self::proven::prove;
pub use self::sensitivity::{APART, Sensitivity};
pub use self::settled::Settled;

/// Samples of the trajectory, at most; never fewer than 200 if the span has as many steps.
const SAMPLES: u64 = 400;

/// Numbers that a trajectory may hold before the samples are thinned out.
const SAMPLE_BUDGET: u64 = 32_000_000;

/// Estimated method error from which on the step is refused, and from which on it is warned about.
const METHOD_ERROR_REFUSED: f64 = 0.5;
const METHOD_ERROR_WARNED: f64 = 0.02;

/// The same of the error that held inputs cause.
const INPUT_ERROR_REFUSED: f64 = 0.5;
const INPUT_ERROR_WARNED: f64 = 0.02;

/// Word-length error from which on the word is called short, and from which on its result is refused; that of a model
/// that multiplies small differences is refused as soon as it is warned about.
const WORD_ERROR_WARNED: f64 = 0.02;
const WORD_ERROR_REFUSED: f64 = 0.5;

/// Errors relative to the largest magnitude of a state; see `pe_sim::error` for the floor.
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
    /// Inputs held over `h` against their means over `h/2`; zero if all inputs are constant.
    pub input_hold: f64,
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

impl Curves {
    /// Largest difference of each output, relative to its largest magnitude.
    pub fn errors(&self) -> Vec<f64> {
        let largest = |numbers: &mut dyn Iterator<Item = f64>| numbers.fold(0.0, |most: f64, n| most.max(n.abs()));
        let outputs = self.double.states.max(1);
        let of = |output| move |samples: &[f64]| samples[output];
        let error = |output| {
            let double = || self.double.samples.chunks_exact(outputs).map(of(output));
            let fixed = self.fixed.samples.chunks_exact(outputs).map(of(output));
            let difference = largest(&mut fixed.zip(double()).map(|(fixed, double)| fixed - double));
            if difference == 0.0 { 0.0 } else { difference / largest(&mut double()) }
        };
        (0..self.double.states).map(error).collect()
    }
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
    /// What the roundings of its coefficients cancel in.
    pub aim: Aim,
    /// Errors.
    pub errors: Errors,
    /// Number of times formats were widened.
    pub widenings: usize,
    /// Middle of the run.
    pub checkpoint: Checkpoint,
    /// Times of the samples that were compared, in seconds.
    pub times: Vec<f64>,
    /// States of the fixed-point run at these times.
    pub hardware: Trajectory,
    /// States of the run in double precision at these times.
    pub double: Arc<Trajectory>,
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
    /// The smallest pivot of an implicit method.
    pub smallest_pivot: Option<SmallestPivot>,
    /// Which ranges are proven; none if no proof was asked for.
    pub proof: Option<Proof>,
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
    options: &ModelOptions,
    progress: ProgressBar,
) -> Result<Judged, Vec<Diagnostic>> {
    judge_open(model, graph, format, options, progress).map(|(judged, ..)| judged)
}

/// The same with what other formats can be judged from.
///
/// # Errors
/// Those of [`judge`].
pub fn judge_open(
    model: &Model,
    graph: &StepGraph,
    format: WordFormat,
    options: &ModelOptions,
    progress: ProgressBar,
) -> Result<(Judged, Exact, Comparison), Vec<Diagnostic>> {
    let exact = Exact::run(model, graph, progress)?;
    // The runs that follow depend on the reference run alone, so they share the machine's cores; each is deterministic.
    let (settled, comparison) = std::thread::scope(|scope| {
        let comparison = scope.spawn(|| exact.compare(model));
        let settled = exact.settle(model, graph, format);
        (settled, comparison.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    });
    let judged = exact.conclude(model, graph, settled, comparison.clone(), options)?;
    Ok((judged, exact, comparison?))
}

/// The run in double precision, which knows nothing of formats: ranges, and the trajectory that others are compared to.
pub struct Exact {
    plan: Plan,
    form: StageForm,
    /// Whether tables stand for functions.
    tables: bool,
    reference: Arc<Trajectory>,
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
    pub fn run(model: &Model, graph: &StepGraph, progress: ProgressBar) -> Result<Exact, Vec<Diagnostic>> {
        if let Some(finding) = inputs::too_fast(model) {
            return Err(vec![finding]);
        }
        let plan = Plan::of(model, progress);
        let begin = thread_seconds();
        let (reference, curves, mut ranges, moments) = reference_run(model, graph, &plan)?;
        let reference = Arc::new(reference);
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
            curves,
            largest,
            ranges,
            moments,
            scales,
            seconds,
            smallest_pivot,
        })
    }

    /// Compares with smaller steps.
    ///
    /// # Errors
    /// `E0901` non-finite.
    pub fn compare(&self, model: &Model) -> Result<Comparison, Vec<Diagnostic>> {
        if !self.tables {
            return half_step_runs(model, self.form, &self.plan, &self.reference, &self.scales);
        }
        let options = StepOptions { form: Some(self.form), ..StepOptions::default() };
        let graph = pe_hls::step::build_with(model, &options)?;
        let functions =
            trajectory(model, DoubleRun::new(&graph), &self.plan, Substeps { count: 1, inputs: Sight::Held })?;
        let function = Some(functions.deviation(&self.reference).worst(&self.scales).1);
        let comparison = half_step_runs(model, self.form, &self.plan, &functions, &self.scales)?;
        Ok(Comparison { function, ..comparison })
    }

    /// Word-length error of a run: the worst state's largest deviation from this run.
    pub fn word_length(&self, settled: &Settled) -> f64 {
        self.reference.deviation(&settled.hardware).worst(&self.scales).1
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
        options: &ModelOptions,
    ) -> Result<Judged, Vec<Diagnostic>> {
        let settled = settled?;
        let comparison = comparison?;
        let deviation = self.reference.deviation(&settled.hardware);
        let (worst_state, word_length) = deviation.worst(&self.scales);
        let coefficient = settled.quantised.worst(&self.scales).1;
        let word_length_at_end = self.reference.last().deviation(&settled.hardware.last()).worst(&self.scales).1;
        let at_end = (word_length_at_end, settled.quantised_at_end.worst(&self.scales).1);
        let Comparison { function, method, input_hold, finding } = comparison;
        let blindness = input_hold;
        let input_hold = blindness.map_or(0.0, |blindness| blindness.error);
        let errors = Errors { worst_state, word_length, coefficient, at_end, function, method, input_hold };
        let mut warnings = Vec::new();
        if errors.method > METHOD_ERROR_REFUSED {
            let runs = (&*self.reference, &settled.hardware);
            match reasons::chaotic(model, graph, &settled.fixed, &self.scales, runs) {
                Some(chaotic) => warnings.push(chaotic),
                None => warnings.extend(options.permit(vec![finding])?),
            }
        } else if errors.method > METHOD_ERROR_WARNED {
            let message = finding.message.replace("too large", "large");
            warnings.push(Diagnostic { code: codes::STEP_LARGE, message, ..finding.into_warning() });
        }
        if let Some(finding) = blindness.and_then(|blindness| blindness.finding(model)) {
            let refused = finding.severity == Severity::Error;
            warnings.extend(if refused { options.permit(vec![finding])? } else { vec![finding] });
        }
        // Of a chaotic model that has been told all that there is to say.
        let chaotic = warnings.iter().any(|warning| warning.code == codes::CHAOTIC);
        let word_short = if chaotic { None } else { self.word_short(model, graph, &settled.hardware, errors) };
        if let Some(finding) = word_short {
            let refused = finding.severity == Severity::Error;
            warnings.extend(if refused { options.permit(vec![finding])? } else { vec![finding] });
        }
        warnings.extend(outside(model));
        let macs = graph.macs() as f64 * self.plan.steps as f64;
        Ok(Judged {
            fixed: settled.fixed,
            aim: settled.aim,
            errors,
            widenings: settled.widenings,
            checkpoint: settled.checkpoint,
            times: self.plan.times(),
            hardware: settled.hardware,
            double: Arc::clone(&self.reference),
            warnings,
            ns_per_mac: (self.seconds * 1e9 / macs, settled.seconds * 1e9 / macs),
            curves: Curves { fixed: settled.curves, ..self.curves.clone() },
            largest: self.largest.clone(),
            state_errors: deviation.relative(&self.scales).collect(),
            smallest_pivot: self.smallest_pivot.clone(),
            proof: None,
        })
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
        hardware: &Trajectory,
        errors: Errors,
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
        let chaotic = sensitivity.is_some_and(|sensitivity| sensitivity.rate.is_some());
        let growth = sensitivity.map_or(0.0, |sensitivity| sensitivity.growth);
        let decided = growth > sensitivity::SENSITIVE && errors.method <= METHOD_ERROR_WARNED;
        if chaotic || !(decided || errors.word_length > WORD_ERROR_REFUSED) {
            return Some(warning);
        }
        let moved = WORD_ERROR_WARNED * self.scales[errors.worst_state];
        let time = self.plan.times()[first_beyond(&self.reference, hardware, errors.worst_state, moved)];
        let reason = match decided {
            true => {
                format!("the model multiplies differences by {growth:.1e}, so that the last bits decide where it goes")
            }
            false => "the run has little in common with the model".to_owned(),
        };
        let message = format!(
            "the word is too short: from t = {time:.6e} s on rounding moves `{}` by up to {:.1e} of its largest magnitude; {reason}",
            state.name, errors.word_length
        );
        Some(Diagnostic { code: codes::WORD_TOO_SHORT, message, severity: Severity::Error, ..warning })
    }
}

/// Which steps are sampled, and who is told about the progress.
struct Plan {
    model: Model,
    steps: u64,
    samples: u64,
    progress: ProgressBar,
}

impl Plan {
    fn of(model: &Model, progress: ProgressBar) -> Plan {
        let steps = model.steps();
        // Reference, fixed point, quantised, and two substeps each in the half-step runs.
        progress.set_length(steps * if varying_inputs(model) { 7 } else { 5 });
        let affordable = (SAMPLE_BUDGET / model.states.len().max(1) as u64).max(200);
        Plan { model: model.clone(), steps, samples: SAMPLES.min(affordable).min(steps), progress }
    }

    /// Tells the progress after `done` steps; rarely, for a step may take no longer than the telling.
    fn advance(&self, done: u64, weight: u64) {
        const STRIDE: u64 = 256;
        if done.is_multiple_of(STRIDE) {
            self.progress.inc(STRIDE * weight);
        }
    }

    /// Whether a sample is taken after `done` steps.
    fn sampled(&self, done: u64) -> bool {
        let before = u128::from(done - 1) * u128::from(self.samples) / u128::from(self.steps);
        u128::from(done) * u128::from(self.samples) / u128::from(self.steps) > before
    }

    /// Times of the samples.
    fn times(&self) -> Vec<f64> {
        (1..=self.steps).filter(|done| self.sampled(*done)).map(|done| self.model.time(done, 0.0)).collect()
    }
}

/// Whether any input changes over time.
pub fn varying_inputs(model: &Model) -> bool {
    model.inputs.iter().any(|input| !matches!(input.waveform, Waveform::Constant(_)))
}

fn reference_run(
    model: &Model,
    graph: &StepGraph,
    plan: &Plan,
) -> Result<(Trajectory, Curves, Ranges, Moments), Vec<Diagnostic>> {
    let mut sampling = Sampling::new(graph);
    let mut run = DoubleRun::new(graph);
    let mut reference = Trajectory::new(model.states.len());
    let mut curves = Curves { double: Trajectory::new(curve_count(graph)), ..Curves::default() };
    for done in 1..=plan.steps {
        let time = model.time(done - 1, 0.0);
        run.step(&model.sample_inputs(time)).map_err(|diverged| vec![non_finite(graph, diverged, time)])?;
        plan.advance(done, 1);
        if plan.sampled(done) {
            reference.push(|state| run.state(state));
            curves.double.push(|output| run.output(output));
            sampling.add(|value| run.value(value));
        }
    }
    let largest = run.largest();
    reference.largest = graph.states.iter().map(|(state, _)| largest[state.index()]).collect();
    let ranges = Ranges { largest, widened: vec![0; graph.values.len()] };
    Ok((reference, curves, ranges, sampling.moments()))
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

fn fixed_run(
    model: &Model,
    graph: &StepGraph,
    fixed: &FixedPoint,
    plan: &Plan,
) -> Result<(Trajectory, Checkpoint, Trajectory), Saturated> {
    let mut run = FixedRun::new(graph, fixed);
    let mut samples = Trajectory::new(model.states.len());
    let mut curves = Trajectory::new(curve_count(graph));
    let middle = plan.steps / 2;
    let mut checkpoint = Checkpoint { step: 0, words: Vec::new() };
    for done in 1..=plan.steps {
        if done - 1 == middle {
            checkpoint.step = middle;
            checkpoint.words = graph.states.iter().map(|(state, _)| run.word(*state)).collect();
        }
        let words: Vec<i64> = port_words(model, &run, done - 1);
        if run.step(&words) || (done == 1 && run.saturations().iter().any(|count| *count > 0)) {
            let values = run.saturations().into_iter().enumerate().filter(|(_, count)| *count > 0);
            let values = values.map(|(index, _)| ValueId(index as u32)).collect();
            return Err(Saturated { values, step: done - 1 });
        }
        plan.advance(done, 1);
        if plan.sampled(done) {
            samples.push(|state| run.state(state));
            curves.push(|output| run.output(output));
        }
    }
    Ok((samples, checkpoint, curves))
}

/// Input port words of a step.
pub fn port_words(model: &Model, run: &FixedRun, step: u64) -> Vec<i64> {
    let numbers = model.sample_inputs(model.time(step, 0.0));
    numbers.iter().enumerate().map(|(index, number)| run.encode_input(index, *number).0).collect()
}
