//! Linear and logarithmic axes with round ticks.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};

/// How numbers become places.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Proportionally.
    Linear,
    /// By their logarithm; numbers that are not positive have no place.
    Log,
}

impl Scale {
    /// Whether a number has a place.
    pub fn shows(self, number: f64) -> bool {
        number.is_finite() && (self == Scale::Linear || number >= f64::MIN_POSITIVE)
    }

    fn place(self, number: f64) -> f64 {
        match self {
            Scale::Linear => number,
            Scale::Log => libm::log10(number),
        }
    }
}

/// An axis with its range and its ticks.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    scale: Scale,
    low: f64,
    high: f64,
    ticks: Vec<f64>,
    minor: Vec<f64>,
    labels: Labels,
}

/// How the numbers at the ticks are written.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Labels {
    /// With as many decimals.
    Decimals(usize),
    /// With as many decimals as each needs.
    Shortest,
    /// With a power of ten.
    Exponential,
}

impl Axis {
    /// An axis that shows `numbers` and has at most `most_ticks` labels. With `whole` its range is `numbers`' own,
    /// otherwise a little more.
    pub fn new(scale: Scale, numbers: impl Iterator<Item = f64>, whole: bool, most_ticks: usize) -> Axis {
        // The ends of what `f64` holds would overflow when space is added.
        let shown = numbers.filter(|number| scale.shows(*number)).map(|number| number.clamp(-1e300, 1e300));
        let (low, high) = shown.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), n| (l.min(n), h.max(n)));
        let (low, high) = if low <= high { (low, high) } else { (1.0, 1.0) };
        match scale {
            // So close to zero a double has too few digits left for ticks.
            Scale::Linear if low.abs().max(high.abs()) < 1e-290 => linear(0.0, 0.0, whole, most_ticks.max(2)),
            Scale::Linear => linear(low, high, whole, most_ticks.max(2)),
            Scale::Log => log(low, high, whole, most_ticks.max(2)),
        }
    }

    /// Place of a number from 0 to 1; outside of it if the axis does not show it.
    pub fn place(&self, number: f64) -> f64 {
        let (low, high) = (self.scale.place(self.low), self.scale.place(self.high));
        (self.scale.place(number) - low) / (high - low)
    }

    /// Numbers with a label.
    pub fn ticks(&self) -> &[f64] {
        &self.ticks
    }

    /// The label of a tick.
    pub fn label(&self, number: f64) -> String {
        let rounded: f64 = format!("{number:.3e}").parse().unwrap_or(number);
        match self.labels {
            // Adding zero turns -0 into 0.
            Labels::Decimals(decimals) => format!("{:.decimals$}", number + 0.0),
            Labels::Shortest => format!("{rounded}"),
            Labels::Exponential if number == 0.0 => "0".to_owned(),
            Labels::Exponential if (1.0..10.0).contains(&rounded.abs()) => format!("{rounded}"),
            Labels::Exponential => format!("{rounded:e}"),
        }
    }
}

fn linear(low: f64, high: f64, whole: bool, most: usize) -> Axis {
    let magnitude = low.abs().max(high.abs());
    let (mut low, mut high) = (low, high);
    // A constant, or what differs by rounding alone, gets a range that does not pretend to show more.
    if high - low <= magnitude * 1e-12 {
        let half = if magnitude > 0.0 { magnitude * 0.1 } else { 1.0 };
        (low, high) = (low - half, high + half);
    } else if !whole {
        let margin = (high - low) * 0.05;
        (low, high) = (low - margin, high + margin);
    }
    // A tick at the very end of the axis must not be lost to rounding.
    let ticks_at = |step: f64| -> Vec<f64> {
        let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
        (first..=last).map(|count| count as f64 * step).collect()
    };
    let mut step = round_step((high - low) / most as f64);
    let mut ticks = ticks_at(step);
    // One label tells nothing about the scale.
    while ticks.len() < 2 {
        step = round_step(step / 2.5);
        ticks = ticks_at(step);
    }
    let largest = ticks.iter().fold(0.0f64, |largest, tick| largest.max(tick.abs()));
    let decimals = (-libm::floor(libm::log10(step) + 1e-9)).max(0.0) as usize;
    // Steps of 2.5 need a decimal more.
    let digit = step / libm::pow(10.0, libm::floor(libm::log10(step) + 1e-9));
    let decimals = if (digit - 2.5).abs() < 1e-6 && step < 10.0 { decimals + 1 } else { decimals };
    let plain = largest < 1e5 && decimals <= 4;
    let labels = if plain { Labels::Decimals(decimals) } else { Labels::Exponential };
    Axis { scale: Scale::Linear, low, high, ticks, minor: Vec::new(), labels }
}

/// The next number above `least` that is 1, 2, 2.5 or 5 times a power of ten.
fn round_step(least: f64) -> f64 {
    let power = libm::pow(10.0, libm::floor(libm::log10(least)));
    let factor = [1.0, 2.0, 2.5, 5.0].into_iter().find(|factor| factor * power >= least * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

fn log(low: f64, high: f64, whole: bool, most: usize) -> Axis {
    let (mut low, mut high) = (low, high);
    if !whole {
        let margin = libm::pow(high / low, 0.06).clamp(1.1, 10.0);
        (low, high) = ((low / margin).max(f64::MIN_POSITIVE), (high * margin).min(f64::MAX / 2.0));
    }
    if high / low < 1.5 {
        (low, high) = (low / 1.5, high * 1.5);
    }
    let (first, last) = (libm::floor(libm::log10(low)) as i32, libm::ceil(libm::log10(high)) as i32);
    let inside = |number: &f64| *number >= low * (1.0 - 1e-9) && *number <= high * (1.0 + 1e-9);
    let series = |digits: &[f64], every: i32| -> Vec<f64> {
        let powers = (first..=last).filter(|power| power.rem_euclid(every) == 0);
        let numbers =
            powers.flat_map(|power| digits.iter().map(move |digit| digit * libm::pow(10.0, f64::from(power))));
        numbers.filter(inside).collect()
    };
    let mut ticks = series(&[1.0, 2.0, 5.0], 1);
    if ticks.len() > most {
        ticks = (1..=700).map(|every| series(&[1.0], every)).find(|ticks| ticks.len() <= most).unwrap_or_default();
    }
    if ticks.len() < 2 {
        ticks = series(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0], 1);
    }
    // So little of a decade has no two of them.
    if ticks.len() < 2 {
        ticks = linear(low, high, true, most.min(5)).ticks;
    }
    let minor = if last - first <= 8 { series(&[2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0], 1) } else { Vec::new() };
    let plain = ticks.iter().all(|tick| (0.999e-3..1.001e5).contains(tick));
    let labels = if plain { Labels::Shortest } else { Labels::Exponential };
    Axis { scale: Scale::Log, low, high, ticks, minor, labels }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, number: &f64, (from, to): (i32, i32)) -> i32 {
        let length = f64::from(to - from);
        // Far outside is as good as a little outside, and does not leave the integers.
        from + (self.place(*number).clamp(-10.0, 10.0) * length).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if hint.weight().allow_light_points() { self.minor.clone() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.low..self.high
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, number: &f64) -> String {
        self.label(*number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_range_of_numbers_has_a_few_ticks() {
        for (low, high) in
            [(0.0, 0.0), (0.0, 1e-310), (1e-310, 1e-300), (-5.0, 3.0), (1e300, 2e300), (7.1e-4, 7.3e-4), (2.5, 2.9)]
        {
            for scale in [Scale::Linear, Scale::Log] {
                let axis = Axis::new(scale, [low, high].into_iter(), false, 6);
                let count = axis.ticks().len();
                assert!((2..=10).contains(&count), "{scale:?} {low:e} to {high:e}: {count} ticks");
            }
        }
    }
}
