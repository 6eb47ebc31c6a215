//! Signals made of others: sums, products, functions; chirps and pulse-width modulation.

use core::f64::consts::PI;

use super::Waveform;
use crate::expr::{Expr, Function};
use crate::index;
use crate::model::Variable;

/// A sine whose frequency goes along a straight line, and stays at its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chirp {
    /// Peak value above the offset.
    pub amplitude: f64,
    /// Frequency at time zero in hertz.
    pub from: f64,
    /// Frequency from the end of the duration on, in hertz.
    pub to: f64,
    /// Length of the change in seconds, positive.
    pub duration: f64,
    /// Mean value.
    pub offset: f64,
    /// Phase at time zero in radians.
    pub phase: f64,
}

impl Chirp {
    /// Frequency at a time, in hertz.
    pub fn frequency(&self, time: f64) -> f64 {
        let part = (time / self.duration).clamp(0.0, 1.0);
        self.from + part * (self.to - self.from)
    }

    pub(super) fn at(&self, time: f64) -> f64 {
        let within = time.min(self.duration);
        let cycles = within * (self.from + (self.to - self.from) * within / (2.0 * self.duration));
        let cycles = cycles + self.to * (time - within);
        self.offset + self.amplitude * libm::sin(2.0 * PI * (cycles - libm::floor(cycles)) + self.phase)
    }
}

/// A train of pulses, each as long as a signal says at its beginning.
#[derive(Clone, Debug, PartialEq)]
pub struct Pwm {
    /// Value outside of pulses.
    pub low: f64,
    /// Value of pulses.
    pub high: f64,
    /// Pulses per second, positive.
    pub frequency: f64,
    /// Part of the period that a pulse takes, read at its beginning; below 0 it is 0, above 1 it is 1.
    pub duty: Waveform,
}

impl Pwm {
    /// Part of the period of this number that its pulse takes.
    pub fn duty_of(&self, cycle: f64) -> f64 {
        self.duty.at(cycle / self.frequency).clamp(0.0, 1.0)
    }

    pub(super) fn at(&self, time: f64) -> f64 {
        let cycles = self.frequency * time;
        let cycle = libm::floor(cycles);
        if cycles - cycle < self.duty_of(cycle) { self.high } else { self.low }
    }

    /// Edges of a period, which begins with the first; none if it stays low or high.
    pub(super) fn edges(&self, cycle: f64) -> impl Iterator<Item = f64> + use<> {
        let duty = self.duty_of(cycle);
        let edges = if duty > 0.0 && duty < 1.0 { [cycle, cycle + duty] } else { [cycle, cycle] };
        let frequency = self.frequency;
        edges.into_iter().map(move |edge| edge / frequency)
    }
}

/// An expression of signals.
#[derive(Clone, Debug, PartialEq)]
pub struct Formula {
    /// It reads signals as inputs, by their numbers.
    pub expr: Expr,
    /// The signals.
    pub parts: Vec<Waveform>,
}

impl Formula {
    pub(super) fn piece(&self, within: f64, time: f64) -> f64 {
        self.expr.evaluate(&|variable| match variable {
            Variable::Input(part) => self.parts[index::at(part)].piece(within, time),
            _ => f64::NAN,
        })
    }

    /// Bounds of its values, which it need not reach.
    pub(super) fn bounds(&self) -> (f64, f64) {
        bounds(&self.expr, &|part| self.parts[index::at(part)].bounds())
    }
}

fn hull(numbers: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let join = |(low, high): (f64, f64), number: f64| (low.min(number), high.max(number));
    numbers.into_iter().fold((f64::INFINITY, f64::NEG_INFINITY), join)
}

fn times(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    hull([a.0 * b.0, a.0 * b.1, a.1 * b.0, a.1 * b.1])
}

fn bounds(expr: &Expr, part: &impl Fn(u32) -> (f64, f64)) -> (f64, f64) {
    const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
    match expr {
        Expr::Constant(number) => (*number, *number),
        Expr::Variable(Variable::Input(number)) => part(*number),
        Expr::Variable(_) => ANY,
        Expr::Sum(members) => members
            .iter()
            .map(|member| bounds(member, part))
            .fold((0.0, 0.0), |sum, member| (sum.0 + member.0, sum.1 + member.1)),
        Expr::Product(members) => members.iter().map(|member| bounds(member, part)).fold((1.0, 1.0), times),
        Expr::Power(base, exponent) => {
            let base = bounds(base, part);
            let ends = [base.0, base.1].map(|end| libm::pow(end, f64::from(*exponent)));
            hull(ends.into_iter().chain((base.0 < 0.0 && base.1 > 0.0).then_some(0.0)))
        }
        Expr::Apply(function, argument) => {
            let (low, high) = bounds(argument, part);
            let ends = hull([function.evaluate(low), function.evaluate(high)]);
            let crosses = low < 0.0 && high > 0.0;
            match function {
                Function::Sin | Function::Cos => (-1.0, 1.0),
                Function::Wrap => (-0.5, 0.5),
                Function::Abs | Function::Cosh if crosses => hull([ends.1, function.evaluate(0.0)]),
                Function::Reciprocal | Function::RealPower(_) if low <= 0.0 && high >= 0.0 => ANY,
                Function::Tan if high - low >= PI || libm::cos(low) * libm::cos(high) <= 0.0 => ANY,
                _ if function.evaluate(low).is_nan() || function.evaluate(high).is_nan() => ANY,
                _ => ends,
            }
        }
        Expr::Select(select) => {
            let (yes, no) = (bounds(&select.yes, part), bounds(&select.no, part));
            hull([yes.0, yes.1, no.0, no.1])
        }
        Expr::Solution(_) => ANY,
    }
}
