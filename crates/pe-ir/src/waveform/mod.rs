//! Signals of external inputs over time. All are computed with `libm`, so that every platform gives the same bits.

mod formula;
mod mean;

use std::sync::Arc;

pub use self::formula::{Chirp, Formula, Pwm};
pub use self::mean::Unseen;

/// Declared signal of an external input; drives the runs and the test bench.
#[derive(Clone, Debug, PartialEq)]
pub enum Waveform {
    /// Constant value.
    Constant(f64),
    /// `offset + amplitude * sin(2 pi frequency t + phase)`, frequency in Hz, phase in radians.
    Sine {
        /// Peak value above the offset.
        amplitude: f64,
        /// Frequency in Hz.
        frequency: f64,
        /// Mean value.
        offset: f64,
        /// Phase at time zero in radians.
        phase: f64,
    },
    /// `offset + amplitude` during the first `duty` part of each period, `offset - amplitude` in the rest.
    Square {
        /// Half of the peak-to-peak value.
        amplitude: f64,
        /// Frequency in Hz.
        frequency: f64,
        /// Mean of the two levels.
        offset: f64,
        /// Part of the period spent on the high level, between 0 and 1.
        duty: f64,
    },
    /// `offset + height` from `start` on for `width`, `offset` before and after; again every `period` if there is one.
    Pulse {
        /// Value above the offset during the pulse.
        height: f64,
        /// Beginning of the first pulse in seconds.
        start: f64,
        /// Length in seconds.
        width: f64,
        /// Value outside of pulses.
        offset: f64,
        /// Distance of the beginnings of two pulses in seconds, at least the width; infinite for a single pulse.
        period: f64,
    },
    /// `from` until `start`, then a straight line that reaches `to` after `duration`, then `to`.
    Ramp {
        /// First value.
        from: f64,
        /// Last value.
        to: f64,
        /// Beginning of the rise in seconds.
        start: f64,
        /// Length of the rise in seconds, positive.
        duration: f64,
    },
    /// Sampled values.
    Samples(Arc<Samples>),
    /// The time in seconds.
    Time {
        /// Span of the model in seconds, which its largest value is expected at.
        span: f64,
    },
    /// A sine whose frequency changes.
    Chirp(Chirp),
    /// Pulses whose width a signal gives.
    Pwm(Arc<Pwm>),
    /// An expression of signals.
    Formula(Arc<Formula>),
}

/// What a sampled signal does between two samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// A straight line.
    Linear,
    /// The value of the earlier one.
    Hold,
}

/// A sampled signal. Before the first sample it has the first value, after the last one the last value.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    times: Vec<f64>,
    values: Vec<f64>,
    interpolation: Interpolation,
}

impl Samples {
    /// A signal through these samples; `None` unless there are as many times as values, at least one, all of them
    /// finite and the times strictly ascending.
    pub fn new(times: Vec<f64>, values: Vec<f64>, interpolation: Interpolation) -> Option<Self> {
        let finite = times.iter().chain(&values).all(|number| number.is_finite());
        let ascending = times.windows(2).all(|pair| pair[0] < pair[1]);
        let complete = !times.is_empty() && times.len() == values.len();
        (finite && ascending && complete).then_some(Samples { times, values, interpolation })
    }

    /// Times in seconds, ascending.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// One value per time.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// What the signal does between two samples.
    pub fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// Value at `time` on the piece that holds at `within`.
    fn value(&self, within: f64, time: f64) -> f64 {
        // Samples at or before `within`.
        let passed = self.times.partition_point(|at| *at <= within);
        let last = self.times.len() - 1;
        if passed == 0 {
            return self.values[0];
        }
        let (before, after) = (passed - 1, passed);
        if self.interpolation == Interpolation::Hold || before == last {
            return self.values[before];
        }
        let part = (time - self.times[before]) / (self.times[after] - self.times[before]);
        self.values[before] + part * (self.values[after] - self.values[before])
    }
}

impl Waveform {
    /// Value at `time` in seconds; at a jump, the value after it.
    pub fn at(&self, time: f64) -> f64 {
        self.piece(time, time)
    }

    /// Value at `time` of the smooth piece that the signal follows at the time `within`, continued beyond its ends.
    ///
    /// Between two [breakpoints](Self::breakpoints) this is the signal itself. A solver that steps from one breakpoint
    /// to the next passes their middle as `within`, and so never sees a jump, not even at the ends of the interval.
    pub fn piece(&self, within: f64, time: f64) -> f64 {
        match self {
            Waveform::Constant(value) => *value,
            Waveform::Sine { amplitude, frequency, offset, phase } => {
                offset + amplitude * libm::sin(2.0 * std::f64::consts::PI * frequency * time + phase)
            }
            Waveform::Square { amplitude, frequency, offset, duty } => {
                let cycle = frequency * within;
                if cycle - libm::floor(cycle) < *duty { offset + amplitude } else { offset - amplitude }
            }
            Waveform::Pulse { height, start, width, offset, period } => {
                let since = within - start;
                let since = if period.is_finite() { since - period * libm::floor(since / period) } else { since };
                if within >= *start && since < *width { offset + height } else { *offset }
            }
            Waveform::Ramp { from, to, start, duration } => {
                if within < *start {
                    *from
                } else if within >= start + duration {
                    *to
                } else {
                    from + (time - start) / duration * (to - from)
                }
            }
            Waveform::Samples(samples) => samples.value(within, time),
            Waveform::Time { .. } => time,
            Waveform::Chirp(chirp) => chirp.at(time),
            Waveform::Pwm(pwm) => pwm.at(within),
            Waveform::Formula(formula) => formula.piece(within, time),
        }
    }

    /// Times at which the value or the slope jumps, ascending, each once, later than 0 and earlier than `end`.
    ///
    /// A solver of high order loses its order where the signal is not smooth, so it has to stop at each of these times
    /// and to start anew. There may be very many; they are computed as they are asked for.
    pub fn breakpoints(&self, end: f64) -> Box<dyn Iterator<Item = f64> + '_> {
        let inside = move |time: &f64| *time > 0.0 && *time < end;
        match self {
            Waveform::Constant(_) | Waveform::Sine { .. } | Waveform::Time { .. } => Box::new(std::iter::empty()),
            Waveform::Square { amplitude, frequency, duty, .. } => {
                if *amplitude == 0.0 || *frequency == 0.0 || *duty == 0.0 || *duty == 1.0 {
                    return Box::new(std::iter::empty());
                }
                let edges = (0u64..).flat_map(move |cycle| [cycle as f64, cycle as f64 + duty]);
                Box::new(edges.map(move |edge| edge / frequency).take_while(move |time| *time < end).filter(inside))
            }
            Waveform::Pulse { height, start, width, period, .. } => {
                // A pulse as long as its period never ends.
                if *height == 0.0 || *width == 0.0 || *start >= end {
                    return Box::new(std::iter::empty());
                }
                if width >= period {
                    return Box::new(std::iter::once(*start).filter(inside));
                }
                let pulses = if period.is_finite() { u64::MAX } else { 1 };
                let edges = (0..pulses).flat_map(move |pulse| {
                    let begin = if pulse == 0 { *start } else { start + pulse as f64 * period };
                    [begin, begin + width]
                });
                Box::new(edges.take_while(move |time| *time < end).filter(inside))
            }
            Waveform::Ramp { from, to, start, duration } => {
                let corners = if from == to { Vec::new() } else { vec![*start, start + duration] };
                Box::new(corners.into_iter().filter(inside))
            }
            Waveform::Samples(samples) => Box::new(samples.times.iter().copied().filter(inside)),
            Waveform::Chirp(chirp) => Box::new(std::iter::once(chirp.duration).filter(inside)),
            Waveform::Pwm(pwm) => {
                let mut last = 0.0;
                let edges = (0u64..).flat_map(move |cycle| pwm.edges(cycle as f64)).take_while(move |time| *time < end);
                Box::new(edges.filter(move |time| std::mem::replace(&mut last, *time) < *time))
            }
            Waveform::Formula(formula) => {
                let mut parts: Vec<_> = formula.parts.iter().map(|part| part.breakpoints(end).peekable()).collect();
                Box::new(std::iter::from_fn(move || {
                    let next = parts.iter_mut().filter_map(|part| part.peek().copied()).reduce(f64::min)?;
                    parts.iter_mut().for_each(|part| _ = part.next_if(|time| *time <= next));
                    Some(next)
                }))
            }
        }
    }

    /// Smallest and largest value the signal can take.
    pub fn bounds(&self) -> (f64, f64) {
        let between = |a: f64, b: f64| (a.min(b), a.max(b));
        match self {
            Waveform::Constant(value) => (*value, *value),
            Waveform::Sine { amplitude, offset, .. } | Waveform::Square { amplitude, offset, .. } => {
                (offset - amplitude.abs(), offset + amplitude.abs())
            }
            Waveform::Pulse { height, offset, .. } => between(*offset, offset + height),
            Waveform::Ramp { from, to, .. } => between(*from, *to),
            Waveform::Time { span } => (0.0, *span),
            Waveform::Chirp(Chirp { amplitude, offset, .. }) => (offset - amplitude.abs(), offset + amplitude.abs()),
            Waveform::Pwm(pwm) => between(pwm.low, pwm.high),
            Waveform::Formula(formula) => formula.bounds(),
            Waveform::Samples(samples) => {
                let fold = |pick: fn(f64, f64) -> f64| samples.values.iter().copied().reduce(pick).unwrap_or(0.0);
                (fold(f64::min), fold(f64::max))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::mean::tests::assert_mean;
    use super::*;
    use crate::expr::Expr;
    use crate::model::Variable;

    fn samples(interpolation: Interpolation) -> Waveform {
        let signal = Samples::new(vec![1.0, 2.0, 4.0], vec![10.0, 20.0, -20.0], interpolation);
        Waveform::Samples(Arc::new(signal.expect("ascending")))
    }

    /// Every kind of signal.
    fn signals() -> Vec<Waveform> {
        vec![
            Waveform::Constant(3.0),
            Waveform::Sine { amplitude: 2.0, frequency: 0.5, offset: 1.0, phase: 0.3 },
            Waveform::Square { amplitude: 2.0, frequency: 0.5, offset: 1.0, duty: 0.25 },
            Waveform::Pulse { height: 4.0, start: 1.0, width: 0.5, offset: -1.0, period: f64::INFINITY },
            Waveform::Pulse { height: -4.0, start: 0.0, width: 0.5, offset: 1.0, period: 2.0 },
            Waveform::Ramp { from: 3.0, to: -1.0, start: 1.0, duration: 2.0 },
            samples(Interpolation::Linear),
            samples(Interpolation::Hold),
        ]
    }

    /// A chirp, pulse-width modulation, and a product of signals.
    fn made() -> Vec<Waveform> {
        let sine = Waveform::Sine { amplitude: 0.3, frequency: 0.4, offset: 0.5, phase: 0.0 };
        let pwm = Pwm { low: -1.0, high: 2.0, frequency: 2.0, duty: sine.clone() };
        let chirp = Chirp { amplitude: 2.0, from: 1.0, to: 3.0, duration: 2.5, offset: 0.5, phase: 0.1 };
        let pulse = Waveform::Pulse { height: 4.0, start: 1.0, width: 0.5, offset: -1.0, period: 2.0 };
        let input = |part| Expr::Variable(Variable::Input(part));
        let expr = Expr::sum(vec![Expr::product(vec![input(0), input(1)]), Expr::scaled(0.5, input(2))]);
        let formula = Formula { expr, parts: vec![sine, pulse, Waveform::Time { span: 5.0 }] };
        vec![Waveform::Chirp(chirp), Waveform::Pwm(Arc::new(pwm)), Waveform::Formula(Arc::new(formula))]
    }

    #[test]
    fn what_is_made_of_signals_is_smooth_between_its_breakpoints_and_has_their_mean() {
        let breaks: Vec<Vec<f64>> = made().iter().map(|signal| signal.breakpoints(5.0).collect()).collect();
        assert_eq!((breaks[0].as_slice(), breaks[2].as_slice()), (&[2.5][..], &[1.0, 1.5, 3.0, 3.5][..]));
        assert_eq!((breaks[1].len(), breaks[1][0]), (19, 0.25));
        for (signal, breaks) in made().iter().zip(breaks) {
            let ends: Vec<f64> = [0.0].into_iter().chain(breaks).chain([5.0]).collect();
            let (low, high) = signal.bounds();
            for pair in ends.windows(2) {
                let middle = f64::midpoint(pair[0], pair[1]);
                for part in [0.01, 0.3, 0.99] {
                    let time = pair[0] + part * (pair[1] - pair[0]);
                    assert_eq!(signal.piece(middle, time), signal.at(time), "{signal:?} at {time}");
                    assert!(low <= signal.at(time) && signal.at(time) <= high, "{signal:?} at {time}");
                }
            }
            for (begin, end) in [(0.0, 5.0), (0.2, 0.45), (0.9, 1.7)] {
                assert_mean(signal, begin, end);
            }
        }
    }

    #[test]
    fn values_are_those_of_the_definition() {
        let at = |signal: &Waveform, times: &[f64]| times.iter().map(|time| signal.at(*time)).collect::<Vec<_>>();
        let signals = signals();
        assert_eq!(at(&signals[2], &[0.0, 0.4, 0.5, 1.9, 2.0]), [3.0, 3.0, -1.0, -1.0, 3.0]);
        assert_eq!(at(&signals[3], &[0.0, 0.99, 1.0, 1.49, 1.5, 9.0]), [-1.0, -1.0, 3.0, 3.0, -1.0, -1.0]);
        assert_eq!(at(&signals[4], &[0.0, 0.49, 0.5, 1.9, 2.0, 2.5, 100.0]), [-3.0, -3.0, 1.0, 1.0, -3.0, 1.0, -3.0]);
        assert_eq!(at(&signals[5], &[0.0, 1.0, 2.0, 3.0, 9.0]), [3.0, 3.0, 1.0, -1.0, -1.0]);
        assert_eq!(at(&signals[6], &[0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 9.0]), [10.0, 10.0, 15.0, 20.0, 0.0, -20.0, -20.0]);
        assert_eq!(at(&signals[7], &[0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 9.0]), [10.0, 10.0, 10.0, 20.0, 20.0, -20.0, -20.0]);
    }

    #[test]
    fn signals_are_smooth_between_their_breakpoints_and_inside_of_their_bounds() {
        let wanted: [&[f64]; 8] = [
            &[],
            &[],
            &[0.5, 2.0, 2.5, 4.0, 4.5],
            &[1.0, 1.5],
            &[0.5, 2.0, 2.5, 4.0, 4.5],
            &[1.0, 3.0],
            &[1.0, 2.0, 4.0],
            &[1.0, 2.0, 4.0],
        ];
        for (signal, wanted) in signals().iter().zip(wanted) {
            let breaks: Vec<f64> = signal.breakpoints(5.0).collect();
            assert_eq!(breaks, wanted, "{signal:?}");
            let ends: Vec<f64> = [0.0].into_iter().chain(breaks).chain([5.0]).collect();
            for pair in ends.windows(2) {
                let middle = f64::midpoint(pair[0], pair[1]);
                for part in [0.01, 0.3, 0.99] {
                    let time = pair[0] + part * (pair[1] - pair[0]);
                    assert_eq!(signal.piece(middle, time), signal.at(time), "{signal:?} at {time}");
                    let (low, high) = signal.bounds();
                    assert!(low <= signal.at(time) && signal.at(time) <= high, "{signal:?} at {time}");
                }
            }
        }
        // A straight line goes on as one, and the end of a held piece is not yet the jump.
        assert_eq!(samples(Interpolation::Linear).piece(1.5, 2.5), 25.0);
        assert_eq!(samples(Interpolation::Hold).piece(1.5, 2.0), 10.0);
    }

    #[test]
    fn samples_that_make_no_signal_are_refused() {
        let new = |times: &[f64], values: &[f64]| Samples::new(times.to_vec(), values.to_vec(), Interpolation::Hold);
        assert!(new(&[], &[]).is_none() && new(&[1.0], &[]).is_none() && new(&[1.0, 1.0], &[2.0, 2.0]).is_none());
        assert!(new(&[0.0], &[f64::NAN]).is_none() && new(&[f64::INFINITY], &[0.0]).is_none());
        assert!(new(&[-1.0], &[5.0]).is_some());
    }
}
