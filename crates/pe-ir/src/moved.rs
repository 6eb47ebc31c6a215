//! Models with states that represent signals: their motion, and its steps.

use crate::index::{self, StateId};
use crate::model::{Expr, Input, Interpolation, Model, Phase, State, Variable, Waveform};
use crate::motion::{MIDDLE, Motion, Source};
use crate::turns;

impl Model {
    /// The time in seconds that every step is a whole number of: the step, or the shortest of a list whose ratios are
    /// multiples of each other.
    pub fn tick(&self) -> f64 {
        self.phases.iter().fold(self.step, |shortest, phase| shortest.min(self.step / phase.ratio))
    }

    /// Takes another step; with a list of steps the others keep their ratio to it.
    pub fn set_step(&mut self, step: f64) {
        self.step = step;
        self.retime();
        let tick = self.tick();
        let is_clock = |state: &StateId| self.states[*state].motion == Some(Motion::Clock);
        let Some(clock) = self.states.ids().find(is_clock) else { return };
        self.states[clock].derivative = Expr::Constant(1.0 / tick);
        let clock = Variable::State(clock);
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

    /// Makes the states of played signals and of lines those of the present step.
    pub fn retime(&mut self) {
        let first = self.time(0, 1.0);
        for index in self.states.ids() {
            let Some(motion) = self.states[index].motion else { continue };
            let at = |model: &Model, source, within: f64, time: f64| model.waveform(source).piece(within, time);
            let slack = 1e-6 * first;
            let initial = match motion {
                Motion::Held(source) => at(self, source, MIDDLE * first, MIDDLE * first),
                Motion::Line(source) | Motion::Before(source) => at(self, source, slack, 0.0),
                Motion::After(source) => at(self, source, first + slack, first),
                _ => continue,
            };
            self.states[index].initial = initial;
            if let Motion::Line(source) = motion {
                let before = Variable::State(index.behind(1));
                let after = match source {
                    Source::Input(input) => Variable::Input(input),
                    Source::Signal(_) => Variable::State(index.behind(2)),
                };
                let difference = Expr::sum(vec![Expr::Variable(after), Expr::scaled(-1.0, Expr::Variable(before))]);
                let slope = Expr::scaled(1.0 / self.step, difference);
                self.states[index].derivative = match self.step_ratio() {
                    Some(ratio) => Expr::product(vec![Expr::Variable(ratio), slope]),
                    None => slope,
                };
            }
        }
    }

    /// The waveform of a signal.
    pub fn waveform(&self, source: Source) -> &Waveform {
        match source {
            Source::Input(input) => &self.inputs[index::at(input)].waveform,
            Source::Signal(signal) => &self.signals[index::at(signal)].waveform,
        }
    }

    /// The signals that inputs and states follow.
    pub fn waveforms(&self) -> impl Iterator<Item = &Waveform> {
        self.inputs.iter().map(|input| &input.waveform).chain(self.signals.iter().map(|signal| &signal.waveform))
    }

    /// Puts interpolated inputs where their lines are after a part of a step that is divided.
    pub fn draw_lines(&self, step: u64, part: f64, inputs: &mut [f64]) {
        let begin = self.time(step, 0.0);
        for (input, number) in self.inputs.iter().zip(inputs) {
            if input.between == Interpolation::Linear {
                let before = input.waveform.piece(begin + 1e-6 * self.tick(), begin);
                *number = before + part * (self.sample_input(input, begin) - before);
            }
        }
    }

    /// The model with an input, held over the step, for each signal that it plays, and with its own inputs held.
    pub fn with_signals_as_inputs(&self) -> Model {
        let mut model = self.with_as_inputs(true);
        model.signals.clear();
        model.inputs.iter_mut().for_each(|input| input.between = Interpolation::Hold);
        model
    }

    /// The model with inputs behind its own for all signals that it plays, in place of those that jump; itself if none does.
    pub fn with_jumps_as_inputs(&self) -> Model {
        let jumps = self.states.iter().any(|state| matches!(state.motion, Some(Motion::Held(_))));
        if jumps { self.with_as_inputs(false) } else { self.clone() }
    }

    fn with_as_inputs(&self, lines: bool) -> Model {
        let source_of = |motion: Option<Motion>| match motion {
            Some(Motion::Held(source)) => Some(source),
            Some(Motion::Line(source)) if lines => Some(source),
            _ => None,
        };
        let inputs = index::number(self.inputs.len());
        let mut model = self.clone();
        for (index, signal) in self.signals.iter().enumerate() {
            let follows = |state: &&State| {
                let source = Source::Signal(index::number(index));
                state.motion == Some(Motion::Held(source)) || state.motion == Some(Motion::Line(source))
            };
            let name = self.states.iter().find(follows).map_or(String::new(), |state| state.name.clone());
            model.inputs.push(Input {
                name: format!("{name}.input"),
                unit: None,
                waveform: signal.waveform.clone(),
                range: None,
                between: Interpolation::Hold,
                span: signal.span,
            });
        }
        let read = |variable: Variable| match variable {
            Variable::State(state) => match source_of(self.states[state].motion) {
                Some(Source::Input(input)) => Variable::Input(input),
                Some(Source::Signal(signal)) => Variable::Input(inputs + signal),
                None => variable,
            },
            _ => variable,
        };
        for state in &mut model.states {
            let rests = match lines {
                true => state.motion.is_some_and(|motion| motion.source().is_some()),
                false => source_of(state.motion).is_some(),
            };
            state.derivative = if rests { Expr::Constant(0.0) } else { state.derivative.renamed(&read) };
            state.motion = state.motion.filter(|_| !rests);
        }
        model.algebraics.iter_mut().for_each(|algebraic| algebraic.expr = algebraic.expr.renamed(&read));
        model.outputs.iter_mut().for_each(|output| output.variable = read(output.variable));
        model.share_systems();
        model
    }

    /// Whether any state stands for a played signal or for a line.
    pub fn has_played(&self) -> bool {
        self.states.iter().any(|state| state.motion.is_some_and(|motion| motion.source().is_some()))
    }

    /// What a state that stands for a signal is in the equations at `time`, on the smooth piece that holds at `within`; none
    /// if these tell themselves.
    pub fn signal_at(&self, state: StateId, within: f64, time: f64) -> Option<f64> {
        let source = self.states[state].motion?.source()?;
        Some(self.waveform(source).piece(within, time))
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
    /// wrong with them is seen in what reads them; and but for angles, whose scale is half a turn.
    pub fn own_scales(&self, mut scales: Vec<f64>) -> Vec<f64> {
        for (scale, state) in scales.iter_mut().zip(&self.states) {
            if state.motion.is_some() {
                *scale = f64::INFINITY;
            }
            if state.angle {
                *scale = turns::HALF;
            }
        }
        scales
    }
}
