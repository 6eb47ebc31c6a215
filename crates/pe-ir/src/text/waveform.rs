//! Signals over time.

use std::sync::Arc;

use crate::index::at;
use crate::model::{Chirp, Formula, Interpolation, Pwm, Samples, Variable, Waveform};

use super::{Line, TextError, expr, number};

const KINDS: [&str; 10] = ["constant", "sine", "square", "pulse", "ramp", "samples", "time", "chirp", "pwm", "formula"];

/// Signals of signals that are read, one in the other.
const DEEPEST: usize = 50;

fn call(kind: &str, arguments: &[(&str, f64)]) -> String {
    let arguments: Vec<String> = arguments.iter().map(|(name, value)| format!("{name} {}", number(*value))).collect();
    format!("{kind}({})", arguments.join(", "))
}

/// What an interpolation is called.
pub(super) fn between(interpolation: Interpolation) -> &'static str {
    match interpolation {
        Interpolation::Linear => "linear",
        Interpolation::Hold => "hold",
    }
}

pub(super) fn read_between(line: &mut Line) -> Result<Interpolation, TextError> {
    Ok([Interpolation::Linear, Interpolation::Hold][line.one_of(&["linear", "hold"])?])
}

/// The text of a signal.
pub(super) fn print(waveform: &Waveform) -> String {
    match waveform {
        Waveform::Constant(value) => format!("constant({})", number(*value)),
        Waveform::Sine { amplitude, frequency, offset, phase } => call(
            "sine",
            &[("amplitude", *amplitude), ("frequency", *frequency), ("offset", *offset), ("phase", *phase)],
        ),
        Waveform::Square { amplitude, frequency, offset, duty } => call(
            "square",
            &[("amplitude", *amplitude), ("frequency", *frequency), ("offset", *offset), ("duty", *duty)],
        ),
        Waveform::Pulse { height, start, width, offset, period } => call(
            "pulse",
            &[("height", *height), ("start", *start), ("width", *width), ("offset", *offset), ("period", *period)],
        ),
        Waveform::Ramp { from, to, start, duration } => {
            call("ramp", &[("from", *from), ("to", *to), ("start", *start), ("duration", *duration)])
        }
        Waveform::Samples(samples) => {
            let pairs = samples.times().iter().zip(samples.values());
            let pairs: Vec<String> =
                pairs.map(|(time, value)| format!("{}: {}", number(*time), number(*value))).collect();
            format!("samples({}, {})", between(samples.interpolation()), pairs.join(", "))
        }
        Waveform::Time { span } => call("time", &[("span", *span)]),
        Waveform::Chirp(Chirp { amplitude, from, to, duration, offset, phase }) => call(
            "chirp",
            &[
                ("amplitude", *amplitude),
                ("from", *from),
                ("to", *to),
                ("duration", *duration),
                ("offset", *offset),
                ("phase", *phase),
            ],
        ),
        Waveform::Pwm(pwm) => {
            let Pwm { low, high, frequency, duty } = &**pwm;
            let [low, high, frequency] = [low, high, frequency].map(|value| number(*value));
            format!("pwm(low {low}, high {high}, frequency {frequency}, duty {})", print(duty))
        }
        Waveform::Formula(formula) => {
            let name = |variable: Variable| match variable {
                Variable::Input(part) => format!("s{part}"),
                other => format!("\"{other:?}\""),
            };
            let parts: String = formula.parts.iter().map(|part| format!(", {}", print(part))).collect();
            format!("formula({}{parts})", expr::print(&formula.expr, &name))
        }
    }
}

/// Reads a signal.
///
/// # Errors
/// There is none.
pub(super) fn read(line: &mut Line) -> Result<Waveform, TextError> {
    nested(line, 0)
}

fn nested(line: &mut Line, depth: usize) -> Result<Waveform, TextError> {
    if depth > DEEPEST {
        return Err(line.expected(format!("signals that are nested at most {DEEPEST} deep")));
    }
    let kind = KINDS[line.one_of(&KINDS)?];
    line.sign("(")?;
    let waveform = match kind {
        "constant" => Waveform::Constant(line.number()?),
        "sine" => {
            let [amplitude, frequency, offset, phase] = numbers(line, ["amplitude", "frequency", "offset", "phase"])?;
            Waveform::Sine { amplitude, frequency, offset, phase }
        }
        "square" => {
            let [amplitude, frequency, offset, duty] = numbers(line, ["amplitude", "frequency", "offset", "duty"])?;
            if !(0.0..=1.0).contains(&duty) || frequency < 0.0 {
                return Err(line.error("expected a frequency of at least 0 and a duty from 0 to 1"));
            }
            Waveform::Square { amplitude, frequency, offset, duty }
        }
        "pulse" => {
            let [height, start, width, offset] = numbers(line, ["height", "start", "width", "offset"])?;
            line.sign(",")?;
            line.word("period")?;
            let period = line.any_number()?;
            if !(width >= 0.0 && period >= width && period > 0.0) {
                return Err(line.error("expected a width of at least 0, and a period that is positive and no shorter"));
            }
            Waveform::Pulse { height, start, width, offset, period }
        }
        "ramp" => {
            let [from, to, start, duration] = numbers(line, ["from", "to", "start", "duration"])?;
            if duration <= 0.0 {
                return Err(line.error("expected a positive duration"));
            }
            Waveform::Ramp { from, to, start, duration }
        }
        "samples" => samples(line)?,
        "time" => Waveform::Time { span: numbers(line, ["span"])?[0] },
        "chirp" => {
            let [amplitude, from, to, duration, offset, phase] =
                numbers(line, ["amplitude", "from", "to", "duration", "offset", "phase"])?;
            if duration <= 0.0 {
                return Err(line.error("expected a positive duration"));
            }
            Waveform::Chirp(Chirp { amplitude, from, to, duration, offset, phase })
        }
        "pwm" => {
            let [low, high, frequency] = numbers(line, ["low", "high", "frequency"])?;
            if frequency <= 0.0 {
                return Err(line.error("expected a positive frequency"));
            }
            line.sign(",")?;
            line.word("duty")?;
            Waveform::Pwm(Arc::new(Pwm { low, high, frequency, duty: nested(line, depth + 1)? }))
        }
        _ => formula(line, depth)?,
    };
    line.sign(")")?;
    Ok(waveform)
}

fn numbers<const N: usize>(line: &mut Line, names: [&str; N]) -> Result<[f64; N], TextError> {
    let mut values = [0.0; N];
    for (index, (name, value)) in names.iter().zip(&mut values).enumerate() {
        if index > 0 {
            line.sign(",")?;
        }
        *value = line.keyed_number(name)?;
    }
    Ok(values)
}

fn samples(line: &mut Line) -> Result<Waveform, TextError> {
    let interpolation = read_between(line)?;
    let (mut times, mut values) = (Vec::new(), Vec::new());
    while line.take_sign(",") {
        let time = line.number()?;
        if times.last().is_some_and(|last| *last >= time) {
            return Err(line.error("expected a time after the one before"));
        }
        line.sign(":")?;
        times.push(time);
        values.push(line.number()?);
    }
    let samples = Samples::new(times, values, interpolation).ok_or_else(|| line.expected("a sample"))?;
    Ok(Waveform::Samples(Arc::new(samples)))
}

fn formula(line: &mut Line, depth: usize) -> Result<Waveform, TextError> {
    let part = |name: &str| name.strip_prefix('s')?.parse().ok().map(Variable::Input);
    let expr = expr::read(line, &part)?;
    let place = line.last();
    let mut parts = Vec::new();
    while line.take_sign(",") {
        parts.push(nested(line, depth + 1)?);
    }
    let mut most = 0;
    expr.each_variable(&mut |variable| match variable {
        Variable::Input(part) => most = most.max(at(part) + 1),
        Variable::State(_) | Variable::Algebraic(_) => most = usize::MAX,
    });
    if most > parts.len() {
        return Err(line.error_at(place, format!("an expression of signals beyond the {} that follow", parts.len())));
    }
    Ok(Waveform::Formula(Arc::new(Formula { expr, parts })))
}
