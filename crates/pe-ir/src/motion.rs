//! States that stand for signals of the model: they move exactly, whatever the method, and depend on nothing.

use crate::model::{Expr, Model, Phase, Variable};

/// How a state moves that no method approximates. Within a step methods may treat it by its derivative; what it is at the
/// end of a step is exact but for rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// It counts time in units of [`Model::tick`]; its derivative is a number.
    Clock,
    /// The sine of an angle that grows by so many radians per second; the next state is the cosine.
    Sine(f64),
    /// The cosine of an angle that grows by so many radians per second; the state before is the sine.
    Cosine(f64),
}

impl Model {
    /// The time in seconds that every step is a whole number of: the step, or the shortest of a list whose ratios are
    /// multiples of each other.
    pub fn tick(&self) -> f64 {
        self.phases.iter().fold(self.step, |shortest, phase| shortest.min(self.step / phase.ratio))
    }

    /// Takes another step; with a list of steps the others keep their ratio to it.
    pub fn set_step(&mut self, step: f64) {
        self.step = step;
        let tick = self.tick();
        let Some(clock) = self.states.iter().position(|state| state.motion == Some(Motion::Clock)) else { return };
        self.states[clock].derivative = Expr::Constant(1.0 / tick);
        let clock = Variable::State(clock as u32);
        for algebraic in &mut self.algebraics {
            let mut reads = false;
            algebraic.expr.each_variable(&mut |variable| reads |= variable == clock);
            if reads {
                algebraic.expr = Expr::scaled(tick, Expr::Variable(clock));
            }
        }
    }

    /// Takes other steps for the beginning, each with the time until which it is taken, both in seconds, in the place of
    /// those that it has; see [`Model::phases`].
    pub fn set_early_steps(&mut self, early: &[(f64, f64)]) {
        if !self.phases.is_empty() {
            self.inputs.pop();
        }
        self.phases = early.iter().map(|(step, until)| Phase { until: *until, ratio: self.step / step }).collect();
        self.add_step_ratio();
        self.set_step(self.step);
    }

    /// Number of states that change all the time by equations of the spec.
    pub fn odes(&self) -> usize {
        self.states.iter().filter(|state| state.rate.is_none() && state.motion.is_none()).count()
    }

    /// Whether any state stands for a signal of the model.
    pub fn has_signals(&self) -> bool {
        self.states.iter().any(|state| state.motion.is_some())
    }

    /// Scales of states for relative errors, but for states that stand for signals: these move exactly, and whatever is
    /// wrong with them is seen in what reads them.
    pub fn own_scales(&self, mut scales: Vec<f64>) -> Vec<f64> {
        for (scale, state) in scales.iter_mut().zip(&self.states) {
            if state.motion.is_some() {
                *scale = f64::INFINITY;
            }
        }
        scales
    }
}
