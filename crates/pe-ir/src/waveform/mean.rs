//! Means of signals over short intervals, and what happens within one.

use super::{Chirp, Interpolation, Samples, Waveform};

/// Part of an interval at each of its ends within which an edge counts as one at the end: times of steps are rounded.
const SLACK: f64 = 1e-6;

/// What a step that takes a single value of a signal does not see of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unseen {
    /// It repeats faster than every other step, or has several samples in one.
    Aliased,
    /// It leaves its value within a step and returns to it.
    Missed,
    /// It jumps within a step.
    Jump,
}

/// Corners of a train in an interval that are listed; with more of them the mean is an estimate.
const MOST_CORNERS: u32 = 1000;

/// Subintervals of a piece, at most.
const MOST_PARTS: f64 = 4096.0;

/// A train of pulses: high for `width` from `start + k period` on, `k = 0, 1, ..`; one pulse if the period is infinite.
struct Train {
    start: f64,
    period: f64,
    width: f64,
}

impl Train {
    /// Seconds since the last beginning of a pulse, and the number of those before; none before the first.
    fn place(&self, time: f64) -> Option<(f64, f64)> {
        let since = time - self.start;
        let cycles = if self.period.is_finite() { libm::floor(since / self.period) } else { 0.0 };
        (since >= 0.0).then_some((cycles, if cycles > 0.0 { since - cycles * self.period } else { since }))
    }

    /// Number of edges up to a time.
    fn edges(&self, time: f64) -> f64 {
        let count = |(cycles, rest): (f64, f64)| 2.0 * cycles + 1.0 + f64::from(u8::from(rest >= self.width));
        self.place(time).map_or(0.0, count)
    }

    /// Seconds spent high up to a time.
    fn high(&self, time: f64) -> f64 {
        self.place(time).map_or(0.0, |(cycles, rest)| cycles * self.width + rest.min(self.width))
    }

    /// Its edges in an interval.
    fn corners(&self, begin: f64, end: f64) -> Vec<f64> {
        let first = self.place(begin).map_or(0.0, |(cycles, _)| cycles);
        let starts = (0..MOST_CORNERS)
            .map(|k| self.start + if k > 0 || first > 0.0 { (first + f64::from(k)) * self.period } else { 0.0 });
        starts.take_while(|start| *start < end).flat_map(|start| [start, start + self.width]).collect()
    }

    /// Part of an interval that is high.
    fn share(&self, begin: f64, end: f64) -> f64 {
        let slack = SLACK * (end - begin);
        let (begin, end) = (begin + slack, end - slack);
        if self.edges(begin) == self.edges(end) {
            return f64::from(u8::from(self.place(begin).is_some_and(|(_, rest)| rest < self.width)));
        }
        ((self.high(end) - self.high(begin)) / (end - begin)).clamp(0.0, 1.0)
    }

    /// What a step does not see.
    fn unseen(&self, begin: f64, end: f64) -> Option<Unseen> {
        let slack = SLACK * (end - begin);
        let (before, after) = (self.edges(begin + slack), self.edges(end - slack));
        if 2.0 * (end - begin) > self.period * (1.0 + SLACK) {
            return Some(Unseen::Aliased);
        }
        match after - before {
            0.0 => None,
            1.0 => Some(Unseen::Jump),
            _ => Some(Unseen::Missed),
        }
    }
}

impl Waveform {
    /// The pulses that a signal is made of, if it is.
    fn train(&self) -> Option<Train> {
        match *self {
            Waveform::Square { amplitude, frequency, duty, .. } if amplitude != 0.0 && frequency > 0.0 => {
                let period = 1.0 / frequency;
                Some(Train { start: 0.0, period, width: duty * period }).filter(|_| duty > 0.0 && duty < 1.0)
            }
            Waveform::Pulse { height, start, width, period, .. } if height != 0.0 && width > 0.0 => {
                // A pulse as long as its period never ends.
                let endless = width >= period;
                let width = if endless { f64::INFINITY } else { width };
                Some(Train { start, period: if endless { f64::INFINITY } else { period }, width })
            }
            _ => None,
        }
    }

    /// Mean over the interval between two times in seconds, `begin` the earlier one. An edge within a millionth of an end
    /// counts as one at the end.
    pub fn mean(&self, begin: f64, end: f64) -> f64 {
        let middle = f64::midpoint(begin, end);
        if let Some(train) = self.train() {
            let (low, high) = match self {
                Waveform::Square { amplitude, offset, .. } => (offset - amplitude, offset + amplitude),
                Waveform::Pulse { height, offset, .. } => (*offset, offset + height),
                _ => unreachable!("nothing else is a train"),
            };
            let share = train.share(begin, end);
            return if share == 1.0 { high } else { low + share * (high - low) };
        }
        match self {
            Waveform::Sine { amplitude, frequency, offset, .. } => {
                let half = core::f64::consts::PI * frequency * (end - begin);
                let part = if half.abs() < 1e-4 { 1.0 - half * half / 6.0 } else { libm::sin(half) / half };
                if *amplitude == 0.0 { *offset } else { offset + part * (self.at(middle) - offset) }
            }
            Waveform::Ramp { start, duration, .. } => self.mean_of_pieces(&[*start, start + duration], begin, end),
            Waveform::Samples(samples) => self.mean_of_pieces(samples.within(begin, end), begin, end),
            Waveform::Chirp(_) | Waveform::Formula(_) => self.mean_of_curves(begin, end),
            Waveform::Pwm(_) => self.mean_of_pieces(&self.corners(begin, end), begin, end),
            _ => self.at(middle),
        }
    }

    /// Times between two others at which the value or the slope jumps, in no order.
    fn corners(&self, begin: f64, end: f64) -> Vec<f64> {
        let mut corners = match self {
            Waveform::Ramp { start, duration, .. } => vec![*start, start + duration],
            Waveform::Samples(samples) => samples.within(begin, end).to_vec(),
            Waveform::Chirp(chirp) => vec![chirp.duration],
            Waveform::Pwm(pwm) => {
                let first = libm::floor(pwm.frequency * begin);
                let cycles = (0..MOST_CORNERS).map(|k| first + f64::from(k)).take_while(|k| *k < pwm.frequency * end);
                cycles.flat_map(|cycle| pwm.edges(cycle)).collect()
            }
            Waveform::Formula(formula) => formula.parts.iter().flat_map(|part| part.corners(begin, end)).collect(),
            _ => self.train().map_or(Vec::new(), |train| train.corners(begin, end)),
        };
        corners.retain(|time| *time > begin && *time < end);
        corners.sort_unstable_by(f64::total_cmp);
        corners.dedup();
        corners
    }

    /// The highest frequency between two times, in hertz, roughly.
    fn fastest(&self, begin: f64, end: f64) -> f64 {
        match self {
            Waveform::Sine { frequency, .. } => *frequency,
            Waveform::Chirp(chirp) => chirp.frequency(begin).max(chirp.frequency(end)),
            // Products add frequencies, powers and functions multiply them.
            Waveform::Formula(formula) => 4.0 * formula.parts.iter().map(|part| part.fastest(begin, end)).sum::<f64>(),
            _ => 0.0,
        }
    }

    /// The mean of smooth pieces, by Gauss's rule of three points on quarters of periods.
    fn mean_of_curves(&self, begin: f64, end: f64) -> f64 {
        let node = libm::sqrt(0.6);
        let slack = SLACK * (end - begin);
        let (mut sum, mut from) = (0.0, begin);
        for to in self.corners(begin + slack, end - slack).into_iter().chain([end]) {
            let within = f64::midpoint(from, to);
            let parts = libm::ceil(4.0 * self.fastest(from, to) * (to - from)).clamp(1.0, MOST_PARTS);
            let half = (to - from) / parts / 2.0;
            for part in 0..parts as u32 {
                let middle = from + (2.0 * f64::from(part) + 1.0) * half;
                let at = |offset: f64| self.piece(within, middle + offset * half);
                sum += half / 9.0 * (5.0 * at(-node) + 8.0 * at(0.0) + 5.0 * at(node));
            }
            from = to;
        }
        sum / (end - begin)
    }

    /// The mean of straight pieces between these times.
    fn mean_of_pieces(&self, corners: &[f64], begin: f64, end: f64) -> f64 {
        let slack = SLACK * (end - begin);
        let inside = corners.iter().copied().filter(|time| *time > begin + slack && *time < end - slack);
        let (mut sum, mut from) = (0.0, begin);
        for to in inside.chain([end]) {
            let middle = f64::midpoint(from, to);
            sum += (to - from) * self.piece(middle, middle);
            from = to;
        }
        if from == begin { self.at(f64::midpoint(begin, end)) } else { sum / (end - begin) }
    }

    /// What a step from one time to another that takes the value at its beginning does not see.
    pub fn unseen(&self, begin: f64, end: f64) -> Option<Unseen> {
        if let Some(train) = self.train() {
            return train.unseen(begin, end);
        }
        let slack = SLACK * (end - begin);
        match self {
            Waveform::Sine { amplitude, frequency, .. } => {
                let fast = 2.0 * frequency * (end - begin) > 1.0 + SLACK;
                (fast && *amplitude != 0.0).then_some(Unseen::Aliased)
            }
            Waveform::Samples(samples) => {
                let inside = samples.within(begin + slack, end - slack);
                match (inside.len(), samples.interpolation) {
                    (0, _) | (1, Interpolation::Linear) => None,
                    (1, Interpolation::Hold) => Some(Unseen::Jump),
                    _ => Some(Unseen::Aliased),
                }
            }
            Waveform::Chirp(Chirp { amplitude, .. }) => {
                let fast = 2.0 * self.fastest(begin, end) * (end - begin) > 1.0 + SLACK;
                (fast && *amplitude != 0.0).then_some(Unseen::Aliased)
            }
            Waveform::Pwm(pwm) if 2.0 * pwm.frequency * (end - begin) > 1.0 + SLACK => Some(Unseen::Aliased),
            Waveform::Pwm(_) => match self.corners(begin + slack, end - slack).len() {
                0 => None,
                1 => Some(Unseen::Jump),
                _ => Some(Unseen::Missed),
            },
            Waveform::Formula(formula) => {
                let unseen: Vec<Unseen> = formula.parts.iter().filter_map(|part| part.unseen(begin, end)).collect();
                [Unseen::Aliased, Unseen::Missed, Unseen::Jump].into_iter().find(|graver| unseen.contains(graver))
            }
            _ => None,
        }
    }
}

impl Samples {
    /// The times between two others.
    fn within(&self, begin: f64, end: f64) -> &[f64] {
        let first = self.times.partition_point(|at| *at <= begin);
        let last = self.times.partition_point(|at| *at < end).max(first);
        &self.times[first..last]
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::sync::Arc;

    fn pulse(start: f64, width: f64) -> Waveform {
        Waveform::Pulse { height: 2.0, start, width, offset: 1.0, period: f64::INFINITY }
    }

    /// The mean is that of many values.
    pub(in crate::waveform) fn assert_mean(signal: &Waveform, begin: f64, end: f64) {
        const COUNT: u32 = 200_000;
        let at = |k: u32| signal.at(begin + (end - begin) * (f64::from(k) + 0.5) / f64::from(COUNT));
        let mean = (0..COUNT).map(at).sum::<f64>() / f64::from(COUNT);
        assert!((signal.mean(begin, end) - mean).abs() < 1e-4, "{signal:?} from {begin} to {end}: {mean}");
    }

    #[test]
    fn means_are_those_of_many_values() {
        let samples =
            Samples::new(vec![0.1, 0.35, 0.9], vec![1.0, -2.0, 3.0], Interpolation::Linear).expect("ascending");
        let signals = [
            Waveform::Sine { amplitude: 2.0, frequency: 1.7, offset: 0.3, phase: 0.4 },
            Waveform::Square { amplitude: 2.0, frequency: 3.3, offset: 0.5, duty: 0.3 },
            pulse(0.33, 0.2),
            Waveform::Pulse { height: 1.0, start: 0.1, width: 0.02, offset: 0.0, period: 0.05 },
            Waveform::Ramp { from: 1.0, to: 4.0, start: 0.3, duration: 0.4 },
            Waveform::Samples(Arc::new(samples)),
        ];
        for signal in &signals {
            for (begin, end) in [(0.0, 1.0), (0.2, 0.45), (0.3, 0.301), (0.31, 0.9)] {
                assert_mean(signal, begin, end);
            }
        }
    }

    #[test]
    fn edges_on_the_ends_of_steps_are_none_within_them() {
        let signal = Waveform::Square { amplitude: 1.0, frequency: 0.1, offset: 0.0, duty: 0.3 };
        for step in 0..100_000u32 {
            let (begin, end) = (f64::from(step) * 0.1, f64::from(step + 1) * 0.1);
            assert_eq!(signal.unseen(begin, end), None, "step {step}");
            assert_eq!(signal.mean(begin, end), if step % 100 < 30 { 1.0 } else { -1.0 }, "step {step}");
        }
    }

    #[test]
    fn what_a_step_does_not_see_is_told_apart() {
        let sine = |frequency| Waveform::Sine { amplitude: 1.0, frequency, offset: 0.0, phase: 0.0 };
        assert_eq!(sine(400.0).unseen(0.0, 1e-3), None);
        assert_eq!(sine(600.0).unseen(0.0, 1e-3), Some(Unseen::Aliased));
        assert_eq!(pulse(1.25, 3.0).unseen(1.0, 2.0), Some(Unseen::Jump));
        assert_eq!(pulse(1.25, 0.5).unseen(1.0, 2.0), Some(Unseen::Missed));
        assert_eq!(pulse(1.25, 0.5).unseen(2.0, 3.0), None);
        assert_eq!(pulse(1.0, 1.0).unseen(1.0, 2.0), None);
    }
}
