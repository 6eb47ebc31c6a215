//! Signals that are part of the model: `time`, and what is computed from it in the network.
//!
//! Time is a count of steps, sines are rotations: states of their own that move exactly ([`Motion`]). While equations are
//! written out they have numbers from [`SIGNALS`] on; [`crate::prune`] gives them their places behind the declared states.

use crate::evaluate::{Evaluator, Fault, fault};
use crate::fold::{ProductBuilder, SumBuilder};
use pe_ir::codes;
use pe_ir::model::{Algebraic, Expr, Function, State, Variable, Waveform};
use pe_ir::motion::Motion;
use pe_ir::source::{Diagnostic, Span};

/// Number of the first variable that stands for a signal; no model has as many of its own.
pub(crate) const SIGNALS: u32 = 1 << 30;

/// What rounding leaves of a sine or cosine of a phase that ought to be zero.
const RESIDUE: f64 = 1e-15;

/// The time, an algebraic quantity.
pub(crate) const TIME: Variable = Variable::Algebraic(SIGNALS);

/// The count of steps.
const CLOCK: Variable = Variable::State(SIGNALS);

/// Signals of the model found so far.
#[derive(Debug, Default)]
pub(crate) struct Signals {
    /// Where time is read first.
    time: Option<Span>,
    /// Frequencies in hertz of sines, each with the place where it occurs first.
    frequencies: Vec<(f64, Span)>,
}

impl Signals {
    /// Number of states that stand for signals: the clock, which may be unused, and two for each frequency.
    pub(crate) fn states(&self) -> usize {
        1 + 2 * self.frequencies.len()
    }

    /// What a signal reads, by its variable: the states that move with it, or the clock.
    pub(crate) fn reads(variable: Variable) -> Option<Variable> {
        match variable {
            TIME => Some(CLOCK),
            CLOCK => None,
            // Sine and cosine move one another; the clock is in front of them.
            Variable::State(number) => Some(Variable::State(SIGNALS + 1 + ((number - SIGNALS - 1) ^ 1))),
            _ => None,
        }
    }

    /// The state of a number from [`SIGNALS`] on, with the final numbers of itself and of what moves with it.
    pub(crate) fn state(&self, number: usize, own: u32, quantity: u32) -> State {
        let of = |name: String, initial: f64, derivative: Expr, motion: Motion, span: Span| State {
            name,
            quantity,
            initial,
            range: None,
            unit: None,
            derivative,
            rate: None,
            motion: Some(motion),
            span,
        };
        let Some(pair) = number.checked_sub(1) else {
            // The model's step is put in when it is known.
            return of("time.steps".to_owned(), 0.0, Expr::Constant(1.0), Motion::Clock, self.time.unwrap_or_default());
        };
        let (frequency, span) = self.frequencies[pair / 2];
        let rate = 2.0 * std::f64::consts::PI * frequency;
        let name = |function: &str| format!("{function}(2*pi*{frequency}*time)");
        match pair % 2 {
            0 => {
                let cosine = Expr::Variable(Variable::State(own + 1));
                of(name("sin"), 0.0, Expr::scaled(rate, cosine), Motion::Sine(rate), span)
            }
            _ => {
                let sine = Expr::Variable(Variable::State(own - 1));
                of(name("cos"), 1.0, Expr::scaled(-rate, sine), Motion::Cosine(rate), span)
            }
        }
    }

    /// The algebraic equation of the time, which reads the clock.
    pub(crate) fn time_equation(&self, clock: u32, name: &str) -> Algebraic {
        Algebraic {
            name: name.to_owned(),
            unit: Some("s".to_owned()),
            expr: Expr::Variable(Variable::State(clock)),
            range: None,
            span: self.time.unwrap_or_default(),
        }
    }
}

fn sum(members: impl IntoIterator<Item = Expr>) -> Expr {
    let mut sum = SumBuilder::default();
    members.into_iter().for_each(|member| sum.add(member, false));
    sum.finish()
}

fn scaled(factor: f64, expr: Expr) -> Expr {
    let mut product = ProductBuilder::new(Expr::Constant(factor));
    product.multiply(expr);
    product.finish()
}

impl Evaluator {
    /// The time.
    pub(crate) fn time(&mut self, span: Span) -> Expr {
        self.signals.time.get_or_insert(span);
        Expr::Variable(TIME)
    }

    /// A signal computed in the network.
    pub(crate) fn defined(&mut self, name: &str, waveform: Waveform, span: Span) -> Result<Expr, Fault> {
        match waveform {
            Waveform::Constant(value) => Ok(Expr::Constant(value)),
            Waveform::Sine { amplitude, frequency, offset, phase } => {
                let parts = [libm::cos(phase), libm::sin(phase)];
                let parts = parts.map(|part| if part.abs() < RESIDUE { 0.0 } else { amplitude * part });
                if frequency == 0.0 {
                    return Ok(Expr::Constant(offset + parts[1]));
                }
                let known = self.signals.frequencies.iter().position(|(other, _)| *other == frequency);
                let number = known.unwrap_or(self.signals.frequencies.len());
                if known.is_none() {
                    self.signals.frequencies.push((frequency, span));
                }
                let of = |part: u32| Expr::Variable(Variable::State(SIGNALS + 1 + 2 * number as u32 + part));
                Ok(sum([scaled(parts[0], of(0)), scaled(parts[1], of(1)), Expr::Constant(offset)]))
            }
            Waveform::Ramp { from, to, start, duration } => {
                let slope = (to - from) / duration;
                let since = |corner: f64, time: Expr| sum([time, Expr::Constant(-corner)]);
                let mut part = |corner: f64, sign: f64| {
                    let since = since(corner, self.time(span));
                    // Before time zero there is nothing to tell apart.
                    let distance = if corner <= 0.0 { since } else { Expr::Apply(Function::Abs, Box::new(since)) };
                    scaled(sign * slope / 2.0, distance)
                };
                Ok(sum([part(start, 1.0), part(start + duration, -1.0), Expr::Constant(f64::midpoint(from, to))]))
            }
            _ => {
                let message = format!("`{name}` is a signal of inputs and cannot be part of the model");
                let help =
                    "declare it, `input u = ...`, and read `u` here; or compute it in a sampled block from `time`";
                Err(fault(Diagnostic::error(codes::SIGNAL_PLACE, span, message).with_help(help)))
            }
        }
    }
}
