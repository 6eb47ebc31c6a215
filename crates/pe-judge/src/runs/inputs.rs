//! Inputs: what a step sees of their signals, and signals that leave the range that the spec states for them.

use pe_ir::codes;
use pe_ir::index::{self, StateId};
use pe_ir::model::{Expr, Input, Interpolation, Model, State, Unseen, Variable, Waveform};
use pe_ir::motion::{MIDDLE, Motion, Source};
use pe_ir::source::Diagnostic;
use pe_sim::compared::Compared;

/// Error that held inputs cause from which on the step is refused, and from which on it is warned about.
const INPUT_ERROR_REFUSED: f64 = 0.5;
const INPUT_ERROR_WARNED: f64 = 0.02;

/// What a comparison run takes an input for in a substep.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Sight {
    /// Its value at the beginning of the step, as the hardware does.
    Held,
    /// Its value at the beginning of the substep.
    Sampled,
    /// Its value as [`taken`] for the step.
    Taken,
    /// Its mean over the substep. What samples read is read at the beginning of the substep.
    Mean,
}

/// The inputs of a substep in their means; those that not only the continuous part reads as they are at its beginning.
pub(super) fn means(finer: &Model, continuous: &[bool], (begin, end): (f64, f64)) -> Vec<f64> {
    let mut inputs = finer.sample_inputs(begin);
    for ((number, input), mean) in inputs.iter_mut().zip(&finer.inputs).zip(continuous) {
        if *mean {
            *number = input.waveform.mean(begin, end);
        }
    }
    inputs
}

/// The inputs of a model [with signals as inputs](Model::with_signals_as_inputs), in the mean of what the hardware makes
/// of them in a step; those that not only the continuous part reads as they are at its beginning.
pub(super) fn taken(model: &Model, seen: &Model, continuous: &[bool], step: u64) -> Vec<f64> {
    let (begin, end) = (model.time(step, 0.0), model.time(step, 1.0));
    let mut inputs = seen.sample_inputs(begin);
    let slack = 1e-6 * model.tick();
    for state in &model.states {
        let (source, line) = match state.motion {
            Some(Motion::Held(source)) => (source, false),
            Some(Motion::Line(source)) => (source, true),
            _ => continue,
        };
        let (input, signal) = match source {
            Source::Input(input) => (index::at(input), model.waveform(source)),
            Source::Signal(signal) => (model.inputs.len() + index::at(signal), model.waveform(source)),
        };
        if continuous[input] {
            inputs[input] = match line {
                true => f64::midpoint(signal.piece(begin + slack, begin), signal.piece(end + slack, end)),
                false => signal.at(model.time(step, MIDDLE)),
            };
        }
    }
    inputs
}

/// For each input whether it is read by nothing but the continuous part of the model.
pub(super) fn read_by_continuous_alone(model: &Model) -> Vec<bool> {
    let mut alone = vec![true; model.inputs.len()];
    if let Some(Variable::Input(ratio)) = model.step_ratio() {
        alone[index::at(ratio)] = false;
    }
    let sampled = model.states.iter().filter(|state| state.rate.is_some()).map(|state| &state.derivative);
    let mut waiting: Vec<&Expr> = sampled.chain(model.states.iter().filter_map(|state| state.jump.as_ref())).collect();
    let mut seen = vec![false; model.algebraics.len()];
    while let Some(expr) = waiting.pop() {
        expr.each_variable(&mut |variable| match variable {
            Variable::Input(input) => alone[index::at(input)] = false,
            Variable::Algebraic(number) if !std::mem::replace(&mut seen[index::at(number)], true) => {
                waiting.push(&model.algebraics[index::at(number)].expr);
            }
            Variable::Algebraic(_) | Variable::State(_) => {}
        });
    }
    alone
}

/// What steps do not see of an input: which one, what, and the beginning of the first such step in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cause {
    input: usize,
    unseen: Unseen,
    time: f64,
}

/// The gravest thing that steps do not see of inputs and of signals that the network plays; the model has these as inputs.
pub(super) fn cause(model: &Model) -> Option<Cause> {
    const GRAVEST: [Unseen; 3] = [Unseen::Aliased, Unseen::Missed, Unseen::Jump];
    let rank = |unseen: Unseen| GRAVEST.iter().position(|other| *other == unseen);
    let mut found: Option<Cause> = None;
    for (input, _) in read_by_continuous_alone(model).into_iter().enumerate().filter(|(_, alone)| *alone) {
        let mut begin = 0.0;
        for step in 0..model.steps() {
            let end = model.time(step, 1.0);
            let unseen = model.inputs[input].waveform.unseen(begin, end);
            let graver = |unseen: &Unseen| found.is_none_or(|found| rank(*unseen) < rank(found.unseen));
            if let Some(unseen) = unseen.filter(graver) {
                found = Some(Cause { input, unseen, time: begin });
                if rank(unseen) == Some(0) {
                    return found;
                }
            }
            begin = end;
        }
    }
    found
}

/// How wrong the steps are for what they do not see of inputs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blindness {
    /// Relative to the largest magnitude that the state has in either run.
    pub error: f64,
    state: StateId,
}

impl Blindness {
    /// From the comparison of a run that sees inputs as the hardware does with one that sees their means.
    pub fn of(compared: &Compared) -> Blindness {
        let (state, error) = compared.worst();
        Blindness { error, state: StateId::at(state) }
    }

    /// What is said about it, if it is worth a word.
    pub fn finding(&self, model: &Model) -> Option<Diagnostic> {
        if self.error <= INPUT_ERROR_WARNED {
            return None;
        }
        let refused = self.error > INPUT_ERROR_REFUSED;
        let moved =
            format!("moves `{}` by up to {:.1e} of its largest magnitude", model.states[self.state].name, self.error);
        let seen = model.with_signals_as_inputs();
        let cause = cause(&seen);
        let played = |input: usize| input >= model.inputs.len();
        let held = model.inputs.iter().any(|input| input.between == Interpolation::Hold);
        let (error, warning, message) = match cause {
            None => {
                let doing = if held { "holding inputs" } else { "straight lines in place of signals" };
                let message = format!("{doing} over steps of {:e} s {moved}", model.step);
                (codes::INPUT_UNSEEN, codes::INPUT_HELD, message)
            }
            Some(Cause { input, unseen, time }) => {
                let name = &seen.inputs[input].name;
                let name = name.strip_suffix(".input").filter(|_| played(input)).unwrap_or(name);
                let step = format!("the step of {:e} s at t = {time:.6e} s", model.step);
                match unseen {
                    Unseen::Aliased => {
                        let message =
                            format!("`{name}` changes faster than steps of {:e} s see: that {moved}", model.step);
                        (codes::INPUT_ALIASED, codes::INPUT_NEARLY_ALIASED, message)
                    }
                    Unseen::Missed => {
                        let message =
                            format!("`{name}` has a pulse within {step}, which sees none of it: that {moved}");
                        (codes::PULSE_MISSED, codes::SHORT_PULSE_MISSED, message)
                    }
                    Unseen::Jump => {
                        let seen = if played(input) { "at its beginning or its end" } else { "at its end" };
                        let message = format!("`{name}` jumps within {step}, which sees it {seen}: that {moved}");
                        (codes::INPUT_UNSEEN, codes::INPUT_JUMPS, message)
                    }
                }
            }
        };
        let help = match cause.map(|cause| cause.unseen) {
            None if !held => "take a smaller `--step`, with which the error falls with the square".to_owned(),
            None => "take a smaller `--step`, with which the error falls linearly, or `--inputs linear`; or, if the model itself knows the signal, define it without `input`: the network computes it within the step".to_owned(),
            Some(Unseen::Aliased) => "take a step of a tenth of its period, or a slower signal".to_owned(),
            Some(Unseen::Missed) => "take a step that its beginning and its length are multiples of".to_owned(),
            Some(Unseen::Jump) => {
                "take a step that the times of its jumps are multiples of, or a smaller one".to_owned()
            }
        };
        let span = cause.map_or(model.states[self.state].span, |cause| seen.inputs[cause.input].span);
        let finding = Diagnostic::error(if refused { error } else { warning }, span, message).with_help(help);
        Some(if refused { finding } else { finding.into_warning() })
    }
}

/// Part of its period that a sine of the model may go through in a step: beyond half of it nothing tells it from a slower
/// one, and short before the numbers of its rotation leave every word.
const FASTEST: f64 = 0.4;

/// A sine of the model that no step can follow.
pub(super) fn too_fast(model: &Model) -> Option<Diagnostic> {
    let frequency = |state: &State| match state.motion {
        Some(Motion::Sine(rate)) => Some(rate.abs() / (2.0 * core::f64::consts::PI)),
        Some(Motion::SweptSine(speed)) => {
            let source = model.states[speed].motion.and_then(Motion::source)?;
            Some(model.waveform(source).bounds().1 / (2.0 * core::f64::consts::PI))
        }
        _ => None,
    };
    let state = model.states.iter().find(|state| frequency(state).is_some_and(|f| f * model.step > FASTEST))?;
    let frequency = frequency(state)?;
    let message = format!(
        "a sine of {frequency} Hz goes through {:.2} periods in a step of {:e} s; at most {FASTEST} can be followed",
        frequency * model.step,
        model.step
    );
    let help = format!("take `--step {:.1e}` or less, a tenth of its period", 0.1 / frequency);
    Some(Diagnostic::error(codes::INPUT_ALIASED, state.span, message).with_help(help))
}

/// What the samples of a signal do that leaves its range.
struct Excursion {
    /// First sample outside: time in seconds and value.
    first: (f64, f64),
    /// The sample farthest outside.
    farthest: (f64, f64),
    /// Smallest and largest sample.
    samples: (f64, f64),
}

/// A warning for every declaration with a signal that leaves its range at a step of the span, in the spec's order.
pub fn outside(model: &Model) -> Vec<Diagnostic> {
    let mut findings: Vec<(&Input, (f64, f64), Excursion, usize)> = Vec::new();
    for input in &model.inputs {
        let Some(range) = input.range else { continue };
        let Some(excursion) = excursion(model, input, range) else { continue };
        match findings.last_mut() {
            Some((first, _, _, others)) if first.span == input.span => *others += 1,
            _ => findings.push((input, range, excursion, 0)),
        }
    }
    findings.into_iter().map(|(input, range, excursion, others)| warning(input, range, &excursion, others)).collect()
}

/// Looks at every sample that the hardware takes, unless no value of the signal is outside.
fn excursion(model: &Model, input: &Input, (low, high): (f64, f64)) -> Option<Excursion> {
    let (least, most) = input.waveform.bounds();
    if low <= least && most <= high {
        return None;
    }
    let beyond = |value: f64| (low - value).max(value - high);
    let mut found: Option<Excursion> = None;
    let mut samples = (f64::INFINITY, f64::NEG_INFINITY);
    for step in 0..model.steps() {
        let time = model.time(step, 0.0);
        let value = model.sample_input(input, time);
        samples = (samples.0.min(value), samples.1.max(value));
        if beyond(value) > 0.0 {
            let here = (time, value);
            let excursion = found.get_or_insert(Excursion { first: here, farthest: here, samples });
            if beyond(value) > beyond(excursion.farthest.1) {
                excursion.farthest = here;
            }
        }
    }
    found.map(|excursion| Excursion { samples, ..excursion })
}

fn warning(input: &Input, (low, high): (f64, f64), excursion: &Excursion, others: usize) -> Diagnostic {
    let Excursion { first, farthest, samples } = excursion;
    let farthest = match farthest == first {
        true => String::new(),
        false => format!("; it goes as far as {} at t = {:.6e} s", farthest.1, farthest.0),
    };
    let others = if others == 0 { String::new() } else { format!("; so do {others} other elements") };
    let message = format!(
        "`{}` leaves its stated range {low} .. {high} at t = {:.6e} s with {}{farthest}{others}",
        input.name, first.0, first.1
    );
    let help = format!(
        "state `in {} .. {}`, which costs nothing: the format is made for the signal as well",
        low.min(samples.0),
        high.max(samples.1)
    );
    Diagnostic::error(codes::INPUT_RANGE, input.span, message).with_help(help).into_warning()
}

/// Whether any input changes over time.
pub fn varying_inputs(model: &Model) -> bool {
    model.waveforms().any(|signal| !matches!(signal, Waveform::Constant(_)))
}
