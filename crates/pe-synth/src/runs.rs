//! The runs over the span: ranges, number formats, and how wrong the result is.
//!
//! ```text
//! double, step h        ranges, reference trajectory; refuses what turns non-finite
//! fixed point           widens formats until nothing saturates; word-length error, checkpoint
//! double, quantised     coefficient error on its own
//! double, step h/2      method error; once more with inputs sampled twice as often: input-hold error
//! ```

use std::time::Instant;

use pe_hls::formats::{self, Ranges};
use pe_ir::graph::{FixedPoint, StepGraph, ValueId};
use pe_ir::model::{Model, Waveform};
use pe_ir::source::Diagnostic;
use pe_ir::word::WordFormat;
use pe_sim::double::{Diverged, DoubleRun};
use pe_sim::error::{ErrorMeter, Trajectory};
use pe_sim::fixed::FixedRun;

use crate::options::ModelOptions;

/// Samples of the trajectory, at most; never fewer than 200 if the span has as many steps.
const SAMPLES: u64 = 400;

/// Numbers that a trajectory may hold before the samples are thinned out.
const SAMPLE_BUDGET: u64 = 32_000_000;

/// Fixed-point runs before a saturating model is refused.
const WIDENINGS: usize = 24;

/// Estimated method error from which on the step is refused, and from which on it is warned about.
const METHOD_ERROR_REFUSED: f64 = 0.5;
const METHOD_ERROR_WARNED: f64 = 0.02;

/// Errors relative to the largest magnitude of a state; see `pe_sim::error` for the floor.
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    /// State with the largest word-length error.
    pub worst_state: usize,
    /// Fixed point against double precision with exact coefficients, same step: rounding and coefficients together.
    pub word_length: f64,
    /// The part of it that quantised coefficients alone cause.
    pub coefficient: f64,
    /// Step `h` against step `h/2`, extrapolated with the order of the method.
    pub method: f64,
    /// Inputs held over `h` against inputs held over `h/2`, extrapolated; zero if all inputs are constant.
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

/// What the runs found.
pub struct Judged {
    /// Number formats under which the span runs without saturation.
    pub fixed: FixedPoint,
    /// Errors.
    pub errors: Errors,
    /// Number of times formats were widened.
    pub widenings: usize,
    /// Middle of the run.
    pub checkpoint: Checkpoint,
    /// Samples that were compared.
    pub samples: u64,
    /// Warnings.
    pub warnings: Vec<Diagnostic>,
    /// Nanoseconds per product in double precision and in fixed point.
    pub ns_per_mac: (f64, f64),
}

/// Runs the model over its span.
///
/// # Errors
/// `E0901` non-finite, `E0902` saturates however wide, `E0903` step too large, `E080x` no format.
pub fn judge(
    model: &Model,
    graph: &StepGraph,
    format: WordFormat,
    options: &ModelOptions,
) -> Result<Judged, Vec<Diagnostic>> {
    let plan = Plan::of(model);
    let clock = Instant::now();
    let (reference, mut ranges) = reference_run(model, graph, &plan)?;
    let double_seconds = clock.elapsed().as_secs_f64();
    include_declared(model, graph, &mut ranges);
    let quantities: Vec<u32> = model.states.iter().map(|state| state.quantity).collect();
    let scales = reference.scales(&quantities);

    let mut widenings = 0;
    let (fixed, meter, checkpoint, fixed_seconds) = loop {
        let fixed = formats::choose(graph, &ranges, format).map_err(|error| vec![error])?;
        let clock = Instant::now();
        match fixed_run(model, graph, &fixed, &plan, &reference) {
            Ok((meter, checkpoint)) => break (fixed, meter, checkpoint, clock.elapsed().as_secs_f64()),
            Err(saturated) if widenings < WIDENINGS => {
                widenings += 1;
                for value in &saturated.values {
                    ranges.widened[value.index()] += 1;
                }
            }
            Err(saturated) => return Err(vec![saturated.refusal(model, graph)]),
        }
    };
    let (worst_state, word_length) = meter.worst(&scales);
    let quantised =
        trajectory(model, DoubleRun::quantised(graph, &fixed), &plan, Substeps { count: 1, resample: false })?;
    let coefficient = reference.worst_deviation(&quantised, &scales).1;
    let mut errors = Errors { worst_state, word_length, coefficient, method: 0.0, input_hold: 0.0 };
    let mut warnings = Vec::new();
    let finding = estimate_method(model, &plan, &reference, &scales, &mut errors)?;
    if errors.method > METHOD_ERROR_REFUSED {
        warnings.extend(options.permit(vec![finding])?);
    } else if errors.method > METHOD_ERROR_WARNED {
        warnings.push(Diagnostic { code: "W0903", ..finding.into_warning() });
    }
    let macs = graph.macs() as f64 * plan.steps as f64;
    Ok(Judged {
        fixed,
        errors,
        widenings,
        checkpoint,
        samples: plan.samples,
        warnings,
        ns_per_mac: (double_seconds * 1e9 / macs, fixed_seconds * 1e9 / macs),
    })
}

/// Which steps are sampled.
struct Plan {
    steps: u64,
    samples: u64,
}

impl Plan {
    fn of(model: &Model) -> Plan {
        let steps = model.steps();
        let affordable = (SAMPLE_BUDGET / model.states.len().max(1) as u64).max(200);
        Plan { steps, samples: SAMPLES.min(affordable).min(steps) }
    }

    /// Whether a sample is taken after `done` steps.
    fn sampled(&self, done: u64) -> bool {
        let before = u128::from(done - 1) * u128::from(self.samples) / u128::from(self.steps);
        u128::from(done) * u128::from(self.samples) / u128::from(self.steps) > before
    }
}

/// Inputs at the beginning of a step.
fn inputs(model: &Model, time: f64) -> Vec<f64> {
    model.inputs.iter().map(|input| input.waveform.at(time)).collect()
}

fn reference_run(model: &Model, graph: &StepGraph, plan: &Plan) -> Result<(Trajectory, Ranges), Vec<Diagnostic>> {
    let mut run = DoubleRun::new(graph);
    let mut reference = Trajectory::new(model.states.len());
    for done in 1..=plan.steps {
        let time = (done - 1) as f64 * model.step;
        run.step(&inputs(model, time)).map_err(|diverged| vec![non_finite(graph, diverged, time)])?;
        if plan.sampled(done) {
            reference.push(|state| run.state(state));
        }
    }
    Ok((reference, Ranges { largest: run.largest().to_vec(), widened: vec![0; graph.values.len()] }))
}

fn non_finite(graph: &StepGraph, diverged: Diverged, time: f64) -> Diagnostic {
    let name = graph.value_name(diverged.value);
    let equation = graph.value(diverged.value).equation;
    let message = format!("`{name}` is no longer a finite number at t = {time:.6e} s");
    let help = "the model or the step is unstable: try a smaller `--step`, then check the equation";
    match graph.equations.get(equation as usize) {
        Some(equation) => Diagnostic::error("E0901", equation.span, message),
        None => Diagnostic::global("E0901", message),
    }
    .with_help(help)
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
}

/// A fixed-point run met the end of a range.
struct Saturated {
    values: Vec<ValueId>,
    step: u64,
}

impl Saturated {
    fn refusal(&self, model: &Model, graph: &StepGraph) -> Diagnostic {
        let value = self.values[0];
        let equation = &graph.equations[graph.value(value).equation as usize];
        let time = self.step as f64 * model.step;
        let message = format!("`{}` saturates at t = {time:.6e} s, however wide its range", graph.value_name(value));
        Diagnostic::error("E0902", equation.span, message)
            .with_help("rounding noise grows without bound: try more `--storage` bits or a wider `--multiplier`")
    }
}

fn fixed_run<'a>(
    model: &Model,
    graph: &StepGraph,
    fixed: &FixedPoint,
    plan: &Plan,
    reference: &'a Trajectory,
) -> Result<(ErrorMeter<'a>, Checkpoint), Saturated> {
    let mut run = FixedRun::new(graph, fixed);
    let mut meter = ErrorMeter::new(reference);
    let middle = plan.steps / 2;
    let mut checkpoint = Checkpoint { step: 0, words: Vec::new() };
    for done in 1..=plan.steps {
        if done - 1 == middle {
            checkpoint.step = middle;
            checkpoint.words = graph.states.iter().map(|(state, _)| run.word(*state)).collect();
        }
        let words: Vec<i64> = port_words(model, &run, done - 1);
        if run.step(&words) || (done == 1 && run.saturations().iter().any(|count| *count > 0)) {
            let values = run.saturations().iter().enumerate().filter(|(_, count)| **count > 0);
            let values = values.map(|(index, _)| ValueId(index as u32)).collect();
            return Err(Saturated { values, step: done - 1 });
        }
        if plan.sampled(done) {
            meter.push(|state| run.state(state));
        }
    }
    Ok((meter, checkpoint))
}

/// Input port words of a step.
pub fn port_words(model: &Model, run: &FixedRun, step: u64) -> Vec<i64> {
    let numbers = inputs(model, step as f64 * model.step);
    numbers.iter().enumerate().map(|(index, number)| run.encode_input(index, *number).0).collect()
}

/// How a comparison run divides a step.
#[derive(Clone, Copy)]
struct Substeps {
    count: u64,
    /// Whether inputs are sampled at each substep; otherwise they are held over the whole step.
    resample: bool,
}

/// Samples of a run in double precision at the reference's sample times.
fn trajectory(
    model: &Model,
    mut run: DoubleRun,
    plan: &Plan,
    substeps: Substeps,
) -> Result<Trajectory, Vec<Diagnostic>> {
    let mut samples = Trajectory::new(model.states.len());
    for done in 1..=plan.steps {
        for substep in 0..substeps.count {
            let part = if substeps.resample { substep as f64 / substeps.count as f64 } else { 0.0 };
            let time = ((done - 1) as f64 + part) * model.step;
            run.step(&inputs(model, time)).map_err(|_| {
                let message = format!("a comparison run is not finite at t = {time:.6e} s");
                let help = "the model is at the edge of stability: try a smaller `--step`";
                vec![Diagnostic::global("E0901", message).with_help(help)]
            })?;
        }
        if plan.sampled(done) {
            samples.push(|state| run.state(state));
        }
    }
    Ok(samples)
}

/// Method and input-hold error; returns the finding that a large method error would be.
fn estimate_method(
    model: &Model,
    plan: &Plan,
    reference: &Trajectory,
    scales: &[f64],
    errors: &mut Errors,
) -> Result<Diagnostic, Vec<Diagnostic>> {
    let half = Model { step: model.step / 2.0, ..model.clone() };
    let graph = pe_hls::step::build(&half)?;
    let halved = trajectory(model, DoubleRun::new(&graph), plan, Substeps { count: 2, resample: false })?;
    let (worst, difference) = reference.worst_deviation(&halved, scales);
    // With error C h^p the difference of steps h and h/2 is C h^p (1 - 2^-p).
    let gain = f64::from(1u32 << model.solver.order());
    errors.method = difference * gain / (gain - 1.0);
    if model.inputs.iter().any(|input| !matches!(input.waveform, Waveform::Constant(_))) {
        let resampled = trajectory(model, DoubleRun::new(&graph), plan, Substeps { count: 2, resample: true })?;
        // Both runs share the method error of h/2; holding inputs is an error of first order.
        errors.input_hold = 2.0 * halved.worst_deviation(&resampled, scales).1;
    }
    let name = &model.states[worst].name;
    let message = format!("the step is too large for `{name}`: half of it changes the result by {difference:.1e}");
    Ok(Diagnostic::error("E0903", model.states[worst].span, message)
        .with_help(format!("try `--step {:e}`; a chaotic model needs a shorter `--span`", model.step / 2.0)))
}
