//! Signals that the network plays ([`Motion::Held`], [`Motion::Line`] and what goes with them), from counts that are exact.
//!
//! What a signal is in the next step is looked up in this one, so that no stage waits for it. Times count in steps from the
//! beginning, phases in parts of a period of which a step has a whole number; both are states of their own behind those
//! of the model (`docs/decisions/0050-played-signals.md`).

use pe_ir::codes;
use pe_ir::index::{self, StateId};
use pe_ir::model::{Expr, Function, Interpolation, Model, Pwm, Samples, Select, Variable, Waveform};
use pe_ir::motion::{MIDDLE, Motion, Source};
use pe_ir::source::{Diagnostic, Span};

/// Parts of a period that one counter counts, at most: as many as a short data port tells apart.
const MOST_PARTS: f64 = 262_144.0;

/// Parts of a period that two counters count, at most, one of which counts blocks; and parts of a step, so that a step is
/// less than half a block.
const MOST_LONG_PARTS: f64 = 8_589_934_592.0;
const MOST_IN_STEP: f64 = 16_384.0;

/// Parts of a step by which edges may come early or late at the end of the span for a period that is no ratio of the step:
/// what is sought, and what is refused.
const DRIFT: f64 = 1.0 / 256.0;
const MOST_DRIFT: f64 = 1.0 / 16.0;

/// Even intervals between samples in the table of a signal, at most: 256 segments, less those before and behind.
pub(super) const MOST_INTERVALS: usize = 253;

/// Parts of an interval by which samples may be off the even grid.
const UNEVEN: f64 = 1e-6;

/// Divisions of the shortest interval that are tried for an even grid.
const MOST_DIVISIONS: u32 = 64;

/// What takes down how signals are played: chains, or equations of a plan.
pub(super) trait Score {
    /// A value of the step.
    type Value: Copy;

    /// A number kept from step to step, as it is at the start of the step.
    fn memory(&mut self, owner: StateId, name: String, initial: f64) -> Self::Value;
    /// What a memory becomes: itself and a sum.
    fn keep(&mut self, owner: StateId, memory: Self::Value, terms: &[(f64, Self::Value)], constant: f64);
    /// A sum.
    fn sum(&mut self, owner: StateId, name: String, terms: &[(f64, Self::Value)], constant: f64) -> Self::Value;
    /// A function, whose body reads [`X`], of a value.
    fn function(&mut self, owner: StateId, name: String, argument: Self::Value, body: Expr) -> Self::Value;
    /// What a state is at the end of the step.
    fn end(&mut self, state: StateId, terms: &[(f64, Self::Value)], constant: f64);
    /// The start of a state, or an input.
    fn start(&mut self, variable: Variable) -> Self::Value;
}

/// The argument in bodies of functions.
pub(super) const X: Variable = Variable::State(StateId::new(0));

/// `if x > place then above else below`.
fn step(place: f64, below: Expr, above: Expr) -> Expr {
    let condition = Expr::sum(vec![Expr::Variable(X), Expr::Constant(-place)]);
    Expr::Select(Box::new(Select { condition, yes: above, no: below }))
}

/// The same of numbers.
fn jump(place: f64, below: f64, above: f64) -> Expr {
    step(place, Expr::Constant(below), Expr::Constant(above))
}

/// What is played, and how.
enum Tune<'a> {
    /// `on` in the first `part` of each period, then `off`, but `off` before `start`.
    Periodic {
        frequency: f64,
        phase: f64,
        part: f64,
        on: f64,
        off: f64,
        start: f64,
    },
    /// `on` between two times.
    Once {
        from: f64,
        to: f64,
        on: f64,
        off: f64,
    },
    /// The same with a width that each period has of its own.
    Modulated(&'a Pwm),
    Samples(&'a Samples),
}

fn tune(waveform: &Waveform) -> Tune<'_> {
    match waveform {
        Waveform::Square { amplitude, frequency, offset, duty } => Tune::Periodic {
            frequency: *frequency,
            phase: 0.0,
            part: *duty,
            on: offset + amplitude,
            off: offset - amplitude,
            start: 0.0,
        },
        Waveform::Pulse { height, start, width, offset, period } if period.is_finite() => Tune::Periodic {
            frequency: 1.0 / period,
            phase: -start / period,
            part: width / period,
            on: offset + height,
            off: *offset,
            // The pulse before the first one may be over at time zero.
            start: if start + width > *period { *start } else { 0.0 },
        },
        Waveform::Pulse { height, start, width, offset, .. } => {
            Tune::Once { from: *start, to: start + width, on: offset + height, off: *offset }
        }
        Waveform::Pwm(pwm) if !matches!(pwm.duty, Waveform::Constant(_)) => Tune::Modulated(pwm),
        Waveform::Pwm(pwm) => Tune::Periodic {
            frequency: pwm.frequency,
            phase: 0.0,
            part: pwm.duty.at(0.0),
            on: pwm.high,
            off: pwm.low,
            start: 0.0,
        },
        Waveform::Samples(samples) => Tune::Samples(samples),
        _ => unreachable!("no other signal is played"),
    }
}

/// Parts of a period in a step, and in a period.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ratio {
    parts: f64,
    of: f64,
    /// How far edges are off at the end of the span, in steps.
    drift: f64,
}

impl Ratio {
    /// Whether one counter holds a period.
    fn is_short(self) -> bool {
        self.of <= MOST_PARTS
    }
}

/// Periods per step as a ratio; one that takes two counters only where one does not do.
fn ratio(model: &Model, frequency: f64) -> Ratio {
    let short = convergent(model, frequency, (MOST_PARTS, MOST_PARTS));
    if short.drift <= MOST_DRIFT {
        return short;
    }
    let long = convergent(model, frequency, (MOST_IN_STEP, MOST_LONG_PARTS));
    if long.drift < short.drift { long } else { short }
}

/// The convergent of the continued fraction with so many parts at most that drifts little enough, or least.
fn convergent(model: &Model, frequency: f64, (most_parts, most_of): (f64, f64)) -> Ratio {
    let periods = frequency * model.step;
    let periods = periods - libm::floor(periods);
    let drift =
        |parts: f64, of: f64| model.steps() as f64 * (periods - parts / of).abs() / periods.max(f64::MIN_POSITIVE);
    let (mut before, mut last) = ((1.0, 0.0), (0.0, 1.0));
    let mut rest = periods;
    while drift(last.0, last.1) > DRIFT {
        if rest < 1.0 / most_of {
            break;
        }
        let whole = libm::floor(1.0 / rest);
        let next = (whole * last.0 + before.0, whole * last.1 + before.1);
        if next.1 > most_of || next.0 > most_parts {
            break;
        }
        (before, last) = (last, next);
        rest = 1.0 / rest - whole;
    }
    Ratio { parts: last.0, of: last.1, drift: drift(last.0, last.1) }
}

/// A step near the model's with which edges do not drift, if there is one: one that divides the period, or the shortest
/// of which a period is not too many.
fn fitting_step(model: &Model, frequency: f64, most_of: f64) -> Option<f64> {
    let wanted = (1.0 / (frequency * model.step)).min(most_of);
    [libm::ceil(wanted), libm::floor(wanted)].into_iter().filter(|parts| *parts >= 1.0).find_map(|parts| {
        let mut other = model.clone();
        other.set_step(1.0 / (frequency * parts));
        let ratio = ratio(&other, frequency);
        (ratio.drift <= MOST_DRIFT && ratio.of <= most_of).then_some(other.step)
    })
}

/// Knots of a table: samples that matter in the span, and their even grid.
struct Knots {
    times: Vec<f64>,
    values: Vec<f64>,
    /// Seconds between two places of the grid.
    spacing: f64,
}

impl Knots {
    /// The samples of the span; without a grid if they have none that a table holds.
    fn of(samples: &Samples, end: f64) -> (Knots, bool) {
        let (times, values) = (samples.times(), samples.values());
        let first = times.partition_point(|time| *time <= 0.0).saturating_sub(1);
        let last = times.partition_point(|time| *time < end).min(times.len() - 1);
        let (times, values) = (times[first..=last].to_vec(), values[first..=last].to_vec());
        let shortest = times.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let reach = times[times.len() - 1] - times[0];
        let even = |spacing: &f64| {
            times.iter().all(|time| {
                let places = (time - times[0]) / spacing;
                (places - libm::round(places)).abs() <= UNEVEN * (1.0 + places)
            })
        };
        let short = |spacing: &f64| reach / spacing <= MOST_INTERVALS as f64 + 0.5;
        let candidates = (1..=MOST_DIVISIONS).map(|parts| shortest / f64::from(parts));
        let spacing = if times.len() < 2 { Some(end) } else { candidates.take_while(short).find(even) };
        (Knots { spacing: spacing.unwrap_or(shortest), times, values }, spacing.is_some())
    }
}

/// Periods that begin within the span.
fn periods(model: &Model, pwm: &Pwm) -> f64 {
    libm::ceil(pwm.frequency * model.span)
}

/// Signals that cannot be played in the model's steps.
///
/// # Errors
/// `E0116` for samples that no table holds, `E0117` with a list of steps, `E0118` for a period that drifts.
pub(super) fn check(model: &Model) -> Result<(), Vec<Diagnostic>> {
    let mut findings = Vec::new();
    for signal in &model.signals {
        let span = signal.span;
        if !model.phases.is_empty() {
            let message = "a played signal counts steps, which must all be equal";
            let help = "take a single step, or declare it as an input, `input u = ...`";
            findings.push(Diagnostic::error(codes::SIGNAL_IN_LIST, span, message).with_help(help));
            continue;
        }
        match tune(&signal.waveform) {
            Tune::Modulated(pwm) if periods(model, pwm) > MOST_INTERVALS as f64 => {
                let message = format!(
                    "{} periods within the span, each with its own width, do not fit a table of {MOST_INTERVALS}",
                    periods(model, pwm)
                );
                let help = "declare it as an input, `input u = pwm(...)`, or take a shorter `--span`";
                findings.push(Diagnostic::error(codes::SIGNAL_TOO_LONG, span, message).with_help(help));
            }
            Tune::Periodic { frequency, .. } => findings.extend(drifts(model, frequency, MOST_LONG_PARTS, span)),
            Tune::Modulated(&Pwm { frequency, .. }) => findings.extend(drifts(model, frequency, MOST_PARTS, span)),
            Tune::Once { .. } => {}
            Tune::Samples(samples) => {
                if let (knots, false) = Knots::of(samples, model.span) {
                    let message = format!(
                        "{} samples within the span do not fit a table of {MOST_INTERVALS} even intervals",
                        knots.times.len()
                    );
                    let help = "give fewer samples at even times, or declare it as an input, `input u = samples(...)`";
                    findings.push(Diagnostic::error(codes::SIGNAL_TOO_LONG, span, message).with_help(help));
                }
            }
        }
    }
    if findings.is_empty() { Ok(()) } else { Err(findings) }
}

/// `E0118` if no counter of so many parts at most follows a period.
fn drifts(model: &Model, frequency: f64, most_of: f64, span: Span) -> Option<Diagnostic> {
    let Ratio { of, drift, .. } = ratio(model, frequency);
    if drift <= MOST_DRIFT && of <= most_of {
        return None;
    }
    let (period, step) = (1.0 / frequency, model.step);
    let message = if period / step > most_of {
        format!("a period of {period:e} s is {:.3e} steps of {step:e} s: a counter takes {most_of}", period / step)
    } else {
        format!(
            "a period of {period:e} s and the step of {step:e} s have no ratio that fits a counter: edges drift by \
             {drift:.2} steps in {} s",
            model.span
        )
    };
    let help = match fitting_step(model, frequency, most_of) {
        Some(step) => format!("take a step that divides the period, such as `--step {step:e}`"),
        None => "declare it as an input, or take a shorter `--span`".to_owned(),
    };
    Some(Diagnostic::error(codes::SIGNAL_DRIFTS, span, message).with_help(help))
}

/// Writes down what all played signals, and the lines of inputs, are at the end of the step.
pub(super) fn play<S: Score>(score: &mut S, model: &Model) {
    let mut player = Player { score, model, steps: None, phases: Vec::new() };
    for (index, state) in model.states.numbered() {
        match state.motion {
            Some(Motion::Held(Source::Signal(signal))) => player.held(index, signal),
            Some(Motion::After(Source::Signal(signal))) => player.after(index, signal),
            Some(Motion::Line(source)) => {
                let end = player.score.start(match source {
                    Source::Input(input) => Variable::Input(input),
                    Source::Signal(_) => Variable::State(index.behind(2)),
                });
                player.score.end(index, &[(1.0, end)], 0.0);
                player.score.end(index.behind(1), &[(1.0, end)], 0.0);
            }
            Some(Motion::SweptSine(speed)) => player.swept(index, speed),
            _ => {}
        }
    }
}

struct Player<'a, S: Score> {
    score: &'a mut S,
    model: &'a Model,
    /// The count of steps.
    steps: Option<S::Value>,
    /// Counts of phases: frequency, phase at time zero, and how it is counted.
    phases: Vec<(f64, f64, Phase<S::Value>)>,
}

/// Where in its period a signal is.
#[derive(Clone, Copy)]
enum Phase<V> {
    /// Parts since its beginning, and parts that it has.
    Short { value: V, of: f64 },
    /// Blocks of parts before its end, and parts within a block.
    Long { coarse: V, fine: V, of: f64, digits: Digits },
}

/// How a number of parts is written as blocks and parts of a block.
#[derive(Clone, Copy)]
struct Digits {
    block: f64,
    /// What all counts are beyond a whole number.
    fraction: f64,
}

impl Digits {
    fn of(self, parts: f64) -> (f64, f64) {
        let blocks = libm::floor(parts / self.block);
        (blocks, parts - blocks * self.block)
    }

    /// The middle between the counts at either side of a place.
    fn between(self, place: f64) -> f64 {
        libm::ceil(place - self.fraction) - 0.5 + self.fraction
    }
}

impl<S: Score> Player<'_, S> {
    fn name(&self, state: StateId, what: &str) -> String {
        format!("{}.{what}", self.model.states[state].name)
    }

    /// Steps taken before this one.
    fn steps(&mut self, owner: StateId) -> S::Value {
        if let Some(steps) = self.steps {
            return steps;
        }
        let name = self.name(owner, "steps");
        let steps = self.score.memory(owner, name, 0.0);
        self.score.keep(owner, steps, &[], 1.0);
        self.steps = Some(steps);
        steps
    }

    /// The phase of the next step, where a signal that jumps is looked at.
    fn phase(&mut self, owner: StateId, frequency: f64, phase: f64) -> Phase<S::Value> {
        if let Some((.., known)) = self.phases.iter().find(|known| (known.0, known.1) == (frequency, phase)) {
            return *known;
        }
        let ratio = ratio(self.model, frequency);
        let first = ratio.parts / ratio.of * (1.0 + MIDDLE) + phase;
        let first = ratio.of * (first - libm::floor(first));
        let made =
            if ratio.is_short() { self.counter(owner, ratio, first) } else { self.counters(owner, ratio, first) };
        self.phases.push((frequency, phase, made));
        made
    }

    fn counter(&mut self, owner: StateId, Ratio { parts, of, .. }: Ratio, first: f64) -> Phase<S::Value> {
        let (name, wrap) = (self.name(owner, "phase"), self.name(owner, "turn"));
        let value = self.score.memory(owner, name, first);
        let turn = self.score.function(owner, wrap, value, jump(of - parts - 0.25, parts, parts - of));
        self.score.keep(owner, value, &[(1.0, turn)], 0.0);
        Phase::Short { value, of }
    }

    /// Parts of a period in blocks and parts of a block, both of which any data port tells apart. They count from minus
    /// one period to zero, so that a period ends where the last block does; only the first block may be shorter.
    fn counters(&mut self, owner: StateId, Ratio { parts, of, .. }: Ratio, first: f64) -> Phase<S::Value> {
        // A block has parts at least as many as there are blocks and those of a step, so what follows the turn is within one.
        let blocks = libm::floor(libm::sqrt(0.5 * of).min(0.5 * of / parts));
        let block = libm::ceil(of / blocks);
        let missing = blocks * block - of;
        let digits = Digits { block, fraction: first - libm::floor(first) };
        let (begin, rest) = digits.of(first - of);
        let [of_block, in_block, carry, last, both, turn] =
            ["block", "phase", "carry", "last", "both", "turn"].map(|what| self.name(owner, what));
        let coarse = self.score.memory(owner, of_block, begin);
        let fine = self.score.memory(owner, in_block, rest);
        let place = digits.between(block - parts);
        let carry = self.score.function(owner, carry, fine, jump(place, 0.0, 1.0));
        let last = self.score.function(owner, last, coarse, jump(-1.5, 0.0, 1.0));
        let both = self.score.sum(owner, both, &[(1.0, carry), (1.0, last)], 0.0);
        let turn = self.score.function(owner, turn, both, jump(1.5, 0.0, 1.0));
        self.score.keep(owner, fine, &[(-block, carry), (missing, turn)], parts);
        self.score.keep(owner, coarse, &[(1.0, carry), (-blocks, turn)], 0.0);
        Phase::Long { coarse, fine, of, digits }
    }

    /// `below` up to a part of the period, and then `above`.
    fn since(
        &mut self,
        state: StateId,
        name: String,
        phase: Phase<S::Value>,
        part: f64,
        below: f64,
        above: f64,
    ) -> S::Value {
        match phase {
            Phase::Short { value, of } => self.score.function(state, name, value, jump(part * of, below, above)),
            Phase::Long { coarse, fine, of, digits } => {
                let (block, rest) = digits.of(digits.between(part * of - of));
                let [beyond, within, after] = ["beyond", "within", "after"].map(|what| format!("{name}.{what}"));
                let beyond = self.score.function(state, beyond, coarse, jump(block + 0.5, 0.0, 1.0));
                let within = self.score.function(state, within, coarse, jump(block - 0.5, 0.0, 1.0));
                let after = self.score.function(state, after, fine, jump(rest, 0.0, 1.0));
                let terms = [(1.0, beyond), (1.0, within), (1.0, after)];
                let all = self.score.sum(state, format!("{name}.all"), &terms, 0.0);
                self.score.function(state, name, all, jump(1.5, below, above))
            }
        }
    }

    fn held(&mut self, state: StateId, signal: u32) {
        let (model, step) = (self.model, self.model.step);
        // The number of steps before the one in which a time has passed.
        let place = |time: f64| time / step - 1.0 - MIDDLE;
        match tune(&model.signals[index::at(signal)].waveform) {
            Tune::Periodic { frequency, phase, part, on, off, start } => {
                let phase = self.phase(state, frequency, phase);
                let (name, started) = (self.name(state, "next"), self.name(state, "started"));
                let whole = start == 0.0;
                let (first, second) = if whole { (on, off) } else { (1.0, 0.0) };
                let mut value = self.since(state, name.clone(), phase, part, first, second);
                if !whole {
                    let steps = self.steps(state);
                    let since = self.score.function(state, started.clone(), steps, jump(place(start), 0.0, 1.0));
                    let both = self.score.sum(state, format!("{started}.on"), &[(1.0, value), (1.0, since)], 0.0);
                    value = self.score.function(state, format!("{name}.on"), both, jump(1.5, off, on));
                }
                self.score.end(state, &[(1.0, value)], 0.0);
            }
            Tune::Once { from, to, on, off } => {
                let steps = self.steps(state);
                let (begun, over) = (self.name(state, "begun"), self.name(state, "over"));
                let over = self.score.function(state, over, steps, jump(place(to), 0.0, 1.0));
                if place(from) < 0.0 {
                    self.score.end(state, &[(off - on, over)], on);
                } else {
                    let begun = self.score.function(state, begun, steps, jump(place(from), 0.0, 1.0));
                    self.score.end(state, &[(on - off, begun), (off - on, over)], off);
                }
            }
            Tune::Modulated(pwm) => self.modulated(state, pwm),
            Tune::Samples(samples) => self.samples(state, samples, 1.0 + MIDDLE),
        }
    }

    fn modulated(&mut self, state: StateId, pwm: &Pwm) {
        let Ratio { parts, of, .. } = ratio(self.model, pwm.frequency);
        let Phase::Short { value: phase, .. } = self.phase(state, pwm.frequency, 0.0) else {
            unreachable!("a period that takes two counters was refused")
        };
        let first = libm::floor(parts / of * (1.0 + MIDDLE));
        let [count, begins, duty, beyond, next] =
            ["period", "begins", "duty", "beyond", "next"].map(|what| self.name(state, what));
        let begins = self.score.function(state, begins, phase, jump(of - parts - 0.25, 0.0, 1.0));
        let period = self.score.memory(state, count, first);
        self.score.keep(state, period, &[(1.0, begins)], 0.0);
        let last = periods(self.model, pwm);
        let number = |period: u32| f64::from(period);
        let duties: Vec<f64> = (0..=last as u32).map(|period| pwm.duty_of(number(period))).collect();
        let places: Vec<f64> = (0..=last as u32).map(|period| number(period) - 0.5).collect();
        let duty = self.score.function(state, duty, period, pieces(&places, &duties, Interpolation::Hold));
        let beyond = self.score.sum(state, beyond, &[(1.0 / of, phase), (-1.0, duty)], 0.0);
        let value = self.score.function(state, next, beyond, jump(0.0, pwm.high, pwm.low));
        self.score.end(state, &[(1.0, value)], 0.0);
    }

    /// A sine and the cosine behind it from the angle in turns, which grows by the mean speed of a step.
    fn swept(&mut self, sine: StateId, speed: StateId) {
        let [turns, grown, turn, next, beside] =
            ["turns", "grown", "turn", "next", "beside"].map(|what| self.name(sine, what));
        let part = self.model.step / (4.0 * core::f64::consts::PI);
        let before = self.score.start(Variable::State(speed.behind(1)));
        let after = self.score.start(Variable::State(speed.behind(2)));
        let angle = self.score.memory(sine, turns, 0.0);
        let grows = [(part, before), (part, after)];
        let grown = self.score.sum(sine, grown, &[(1.0, angle), grows[0], grows[1]], 0.0);
        let turn = self.score.function(sine, turn, grown, jump(0.5, 0.0, -1.0));
        self.score.keep(sine, angle, &[grows[0], grows[1], (1.0, turn)], 0.0);
        let of = |function: Function| {
            Expr::Apply(function, Box::new(Expr::scaled(2.0 * core::f64::consts::PI, Expr::Variable(X))))
        };
        let next = self.score.function(sine, next, grown, of(Function::Sin));
        let beside = self.score.function(sine, beside, grown, of(Function::Cos));
        self.score.end(sine, &[(1.0, next)], 0.0);
        self.score.end(sine.behind(1), &[(1.0, beside)], 0.0);
    }

    fn after(&mut self, state: StateId, signal: u32) {
        if let Tune::Samples(samples) = tune(&self.model.signals[index::at(signal)].waveform) {
            self.samples(state, samples, 2.0);
        }
    }

    /// Looks samples up, so many steps ahead.
    fn samples(&mut self, state: StateId, samples: &Samples, ahead: f64) {
        let (knots, _) = Knots::of(samples, self.model.span);
        let seconds = self.model.step;
        let place = |time: f64| time / seconds - ahead;
        let (first, last) = (place(knots.times[0]), place(knots.times[knots.times.len() - 1]));
        let spacing = knots.spacing / seconds;
        let mut argument = self.steps(state);
        // Where nothing changes any more the count stops, so that the table ends there.
        let (low, high) = (first - 0.25 * spacing, last + 0.25 * spacing);
        let end = self.model.steps() as f64;
        let x = || Expr::Variable(X);
        if high < end {
            let name = self.name(state, "until");
            argument = self.score.function(state, name, argument, step(high, x(), Expr::Constant(high)));
        }
        if low > 0.0 {
            let name = self.name(state, "since");
            argument = self.score.function(state, name, argument, step(low, Expr::Constant(low), x()));
        }
        let places: Vec<f64> = knots.times.iter().map(|time| place(*time)).collect();
        let name = self.name(state, "next");
        let value = self.score.function(state, name, argument, pieces(&places, &knots.values, samples.interpolation()));
        self.score.end(state, &[(1.0, value)], 0.0);
    }
}

/// The function through values at places as a tree of choices.
fn pieces(places: &[f64], values: &[f64], interpolation: Interpolation) -> Expr {
    let mut all = vec![Expr::Constant(values[0])];
    for (place, value) in places.windows(2).zip(values.windows(2)) {
        all.push(match interpolation {
            Interpolation::Hold => Expr::Constant(value[0]),
            Interpolation::Linear => {
                let slope = (value[1] - value[0]) / (place[1] - place[0]);
                let since = Expr::sum(vec![Expr::Variable(X), Expr::Constant(-place[0])]);
                Expr::sum(vec![Expr::Constant(value[0]), Expr::scaled(slope, since)])
            }
        });
    }
    all.push(Expr::Constant(values[values.len() - 1]));
    tree(places, &all)
}

fn tree(places: &[f64], pieces: &[Expr]) -> Expr {
    let middle = places.len() / 2;
    match places.get(middle) {
        None => pieces[0].clone(),
        Some(place) => {
            let (below, above) =
                (tree(&places[..middle], &pieces[..=middle]), tree(&places[middle + 1..], &pieces[middle + 1..]));
            step(*place, below, above)
        }
    }
}
