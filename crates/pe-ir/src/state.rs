//! States: a new one, and the equations of one.

use crate::model::{Expr, State};
use crate::source::Span;

impl State {
    /// Steps that a delay that is computed waits longer than it says, so that one of no time waits at all; it is rounded to whole
    /// steps.
    pub const LEAST_WAIT: f64 = 0.25;

    /// A quantity of its own that starts at zero, without a range or unit, which no spec declares.
    pub fn new(name: impl Into<String>, derivative: Expr) -> State {
        State {
            name: name.into(),
            quantity: 0,
            initial: 0.0,
            range: None,
            tunable: false,
            angle: false,
            unit: None,
            derivative,
            jump: None,
            wait: None,
            rate: None,
            motion: None,
            span: Span::default(),
        }
    }

    /// What is added to it at the end of a step of so many seconds.
    pub fn jump_of(&self, step: f64) -> Option<Expr> {
        let jump = self.jump.clone()?;
        Some(match &self.wait {
            Some(wait) => Expr::sum(vec![jump, Expr::scaled(1.0 / step, wait.clone())]),
            None => jump,
        })
    }

    /// The seconds that it waits where it begins to, if these are a number.
    pub fn waits_for(&self) -> Option<f64> {
        match self.wait.as_ref()? {
            Expr::Product(members) => match &members[..] {
                [Expr::Constant(seconds), Expr::Variable(_)] => Some(*seconds),
                _ => None,
            },
            // A delay of one second.
            Expr::Variable(_) => Some(1.0),
            _ => None,
        }
    }

    /// Whether it counts what must not happen: events that find no place to wait in.
    pub fn stays_zero(&self) -> bool {
        self.jump.is_some() && self.range == Some((0.0, 0.0))
    }

    /// Its derivative, and its jump if it has one.
    pub fn equations(&self) -> impl Iterator<Item = &Expr> {
        std::iter::once(&self.derivative).chain(&self.jump).chain(&self.wait)
    }

    /// The same, to be changed.
    pub fn equations_mut(&mut self) -> impl Iterator<Item = &mut Expr> {
        std::iter::once(&mut self.derivative).chain(&mut self.jump).chain(&mut self.wait)
    }
}
