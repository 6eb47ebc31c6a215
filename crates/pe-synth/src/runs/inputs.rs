//! Inputs whose declared signal leaves the range that the spec states for them.

use pe_ir::codes;
use pe_ir::model::{Input, Model};
use pe_ir::source::Diagnostic;

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
