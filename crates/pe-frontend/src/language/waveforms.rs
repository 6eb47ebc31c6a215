//! The signals of the language: their names, arguments and values.

use crate::language::measures::{FREQUENCIES, TIMES, TimeUnit};
use crate::syntax::ast::Name;
use pe_ir::codes;
use pe_ir::model::{Chirp, Interpolation, Pwm, Waveform};
use pe_ir::source::{Diagnostic, Span};
use std::sync::Arc;

/// What an argument of a waveform is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Argument {
    /// A value of the signal, in the unit of the input.
    Value,
    /// A number without unit.
    Number,
    /// A time.
    Time,
    /// A frequency.
    Frequency,
    /// A signal without unit.
    Modulation,
}

use Argument::{Frequency, Modulation, Number, Time, Value};

impl Argument {
    /// Units that may stand behind it.
    pub(crate) fn units(self) -> &'static [(&'static str, f64)] {
        match self {
            Value | Number | Modulation => &[],
            Time => &TIMES,
            Frequency => &FREQUENCIES,
        }
    }

    /// What a number without a unit is in seconds or hertz, if it is a time or a frequency.
    pub(crate) fn unstated(self, time: TimeUnit) -> f64 {
        match self {
            Value | Number | Modulation => 1.0,
            Time => time.seconds,
            Frequency => time.per_second(),
        }
    }
}

/// A waveform: name, its arguments, how many of them are needed.
type Form = (&'static str, &'static [(&'static str, Argument)], usize);

/// The signals that are made of numbers.
pub(crate) const WAVEFORMS: [Form; 7] = [
    ("constant", &[("value", Value)], 1),
    ("sine", &[("amplitude", Value), ("frequency", Frequency), ("offset", Value), ("phase", Number)], 2),
    ("square", &[("amplitude", Value), ("frequency", Frequency), ("offset", Value), ("duty", Number)], 2),
    ("pulse", &[("height", Value), ("start", Time), ("width", Time), ("offset", Value), ("period", Time)], 3),
    ("ramp", &[("from", Value), ("to", Value), ("start", Time), ("duration", Time)], 4),
    (
        "chirp",
        &[
            ("amplitude", Value),
            ("from", Frequency),
            ("to", Frequency),
            ("duration", Time),
            ("offset", Value),
            ("phase", Number),
        ],
        4,
    ),
    ("pwm", &[("low", Value), ("high", Value), ("frequency", Frequency), ("duty", Modulation)], 4),
];

/// The word for a sampled signal; it names a file and so is no waveform of numbers.
pub(crate) const SAMPLES: &str = "samples";

/// What a signal is between two samples.
pub(crate) fn between(word: &Name) -> Result<Interpolation, Diagnostic> {
    match word.text.as_str() {
        "linear" => Ok(Interpolation::Linear),
        "hold" => Ok(Interpolation::Hold),
        other => {
            let message = format!("unknown interpolation `{other}`");
            let help = "between two samples a signal is a straight line with `linear`, the earlier sample with `hold`";
            Err(Diagnostic::error(codes::UNKNOWN_FUNCTION, word.span, message).with_help(help))
        }
    }
}

/// Whether a waveform, by its number in [`WAVEFORMS`], takes so many arguments.
pub(crate) fn check_count(number: usize, count: usize, span: Span) -> Result<(), Diagnostic> {
    let (waveform, meanings, needed) = WAVEFORMS[number];
    if (needed..=meanings.len()).contains(&count) {
        return Ok(());
    }
    let wanted = if needed == meanings.len() { needed.to_string() } else { format!("{needed} to {}", meanings.len()) };
    let message = format!("`{waveform}` takes {wanted} argument(s), found {count}");
    let help = format!("its arguments are {}", meanings.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", "));
    Err(Diagnostic::error(codes::ARGUMENT_COUNT, span, message).with_help(help))
}

/// A waveform, by its number in [`WAVEFORMS`], with these arguments, which stand at these places, and this modulation.
pub(crate) fn waveform_of(form: usize, values: &[f64], duty: Waveform, spans: &[Span]) -> Result<Waveform, Diagnostic> {
    let (name, meanings, _) = WAVEFORMS[form];
    let value = |at: usize, default: f64| values.get(at).copied().unwrap_or(default);
    let bad = |at: usize, reason: &str| {
        let place = spans.get(at).copied().unwrap_or_default();
        let message = format!("the {} is {}; {reason}", meanings[at].0, value(at, 0.0));
        Err(Diagnostic::error(codes::BAD_WAVEFORM, place, message))
    };
    for (at, (_, kind)) in meanings.iter().enumerate() {
        if matches!(kind, Time | Frequency) && value(at, 0.0) < 0.0 {
            return bad(at, "it must not be negative");
        }
    }
    let (amplitude, frequency, offset) = (value(0, 0.0), value(1, 0.0), value(2, 0.0));
    Ok(match name {
        "sine" => Waveform::Sine { amplitude, frequency, offset, phase: value(3, 0.0) },
        "square" => {
            let duty = value(3, 0.5);
            if !(0.0..=1.0).contains(&duty) {
                return bad(3, "it is a fraction of the period, between 0 and 1");
            }
            Waveform::Square { amplitude, frequency, offset, duty }
        }
        "pulse" => {
            let (width, period) = (value(2, 0.0), value(4, f64::INFINITY));
            if period < width || period == 0.0 {
                return bad(4, "it must be positive and not shorter than the pulse");
            }
            Waveform::Pulse { height: amplitude, start: value(1, 0.0), width, offset: value(3, 0.0), period }
        }
        "ramp" => {
            let duration = value(3, 0.0);
            if duration == 0.0 {
                return bad(3, "use `pulse` for a jump");
            }
            Waveform::Ramp { from: amplitude, to: value(1, 0.0), start: value(2, 0.0), duration }
        }
        "chirp" => {
            let duration = value(3, 0.0);
            if duration == 0.0 {
                return bad(3, "use `sine` for a constant frequency");
            }
            let (to, offset, phase) = (value(2, 0.0), value(4, 0.0), value(5, 0.0));
            Waveform::Chirp(Chirp { amplitude, from: frequency, to, duration, offset, phase })
        }
        "pwm" => {
            let frequency = value(2, 0.0);
            if frequency == 0.0 {
                return bad(2, "it must be positive");
            }
            Waveform::Pwm(Arc::new(Pwm { low: amplitude, high: value(1, 0.0), frequency, duty }))
        }
        _ => Waveform::Constant(amplitude),
    })
}
