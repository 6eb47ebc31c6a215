//! Numbers with a unit of time or frequency.

use crate::syntax::ast::Name;
use pe_ir::codes;
use pe_ir::source::Diagnostic;

/// Units of time and their length in seconds.
pub(crate) const TIMES: [(&str, f64); 6] =
    [("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("min", 60.0), ("h", 3600.0)];

/// Units of frequency in hertz.
pub(crate) const FREQUENCIES: [(&str, f64); 2] = [("Hz", 1.0), ("kHz", 1e3)];

/// A unit in which a model counts time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TimeUnit {
    /// Its name.
    pub(crate) name: &'static str,
    /// Its length in seconds.
    pub(crate) seconds: f64,
}

impl Default for TimeUnit {
    fn default() -> Self {
        TimeUnit { name: TIMES[0].0, seconds: TIMES[0].1 }
    }
}

impl TimeUnit {
    /// How many of it are a second, rounded once.
    pub(crate) fn per_second(self) -> f64 {
        scaled_down(1.0, self.seconds)
    }
}

/// The unit of time of this name.
pub(crate) fn time_unit(name: &Name) -> Result<TimeUnit, Diagnostic> {
    let seconds = unit_scale(Some(name), &TIMES, "time of the model", 1.0)?;
    let (name, _) = TIMES.into_iter().find(|(known, _)| *known == name.text).unwrap_or(TIMES[0]);
    Ok(TimeUnit { name, seconds })
}

/// What a unit stands for, or why it does not suit; `unstated` where none is written.
pub(crate) fn unit_scale(
    unit: Option<&Name>,
    units: &[(&str, f64)],
    what: &str,
    unstated: f64,
) -> Result<f64, Diagnostic> {
    let Some(unit) = unit else { return Ok(unstated) };
    if let Some((_, scale)) = units.iter().find(|(name, _)| *name == unit.text) {
        return Ok(*scale);
    }
    let message = format!("`{}` is not a unit for the {what}", unit.text);
    let known: Vec<String> = units.iter().map(|(name, _)| format!("`{name}`")).collect();
    let help = match known.as_slice() {
        [] => "give a plain number here".to_owned(),
        _ => format!("known units are {}", known.join(", ")),
    };
    Err(Diagnostic::error(codes::UNKNOWN_UNIT, unit.span, message).with_help(help))
}

/// `value` in the base unit. Small units are powers of ten, so dividing by their inverse rounds only once:
/// `100 us` is the double nearest to 1e-4.
pub(crate) fn scaled(value: f64, scale: f64) -> f64 {
    if scale < 1.0 { value / libm::round(1.0 / scale) } else { value * scale }
}

/// `value` divided by a scale, likewise.
fn scaled_down(value: f64, scale: f64) -> f64 {
    if scale < 1.0 { value * libm::round(1.0 / scale) } else { value / scale }
}
