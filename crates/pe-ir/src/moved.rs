//! Models with states that represent signals: their motion, and its steps.

use crate::index::{self, StateId};
use crate::model::{Expr, Input, Interpolation, Model, Phase, State, Variable, Waveform};
use crate::motion::{MIDDLE, Motion, Source};
use crate::turns;

/// Part of a tick by which what rounding makes of it may differ from it.
const SAME_TICK: f64 = 1e-12;

impl Model {
    /// The time in seconds that every step is a whole number of: the step, or the shortest of a list whose ratios are
    /// multiples of each other.
    pub fn tick(&self) -> f64 {
        self.phases.iter().fold(self.step, |shortest, phase| shortest.min(self.step / phase.ratio))
    }

    /// Takes another step; with a list of steps the others keep their ratio to it.
    pub fn set_step(&mut self, step: f64) {
        let before = std::mem::replace(&mut self.step, step);
        self.retime();
        self.recount(before);
        self.bound_waits();
        let tick = self.tick();
        let is_clock = |state: &StateId| self.states[*state].motion == Some(Motion::Clock);
        let Some(clock) = self.states.ids().find(is_clock) else { return };
        let Some(rate) = self.states[clock].derivative.as_constant() else { return };
        self.states[clock].derivative = Expr::Constant(1.0 / tick);
        let count = Expr::Variable(Variable::State(clock));
        // The clock's own equation makes seconds of its ticks; whatever else reads it counts ticks of before.
        let is_own = |expr: &Expr| match expr {
            Expr::Product(members) => match &members[..] {
                [Expr::Constant(seconds), of] => *of == count && (seconds * rate - 1.0).abs() < SAME_TICK,
                _ => false,
            },
            _ => *expr == count && (rate - 1.0).abs() < SAME_TICK,
        };
        let read = |variable: Variable| match variable == Variable::State(clock) {
            true => Expr::scaled(tick * rate, count.clone()),
            false => Expr::Variable(variable),
        };
        let algebraics = self.algebraics.iter_mut().map(|algebraic| &mut algebraic.expr);
        for expr in algebraics.chain(self.states.iter_mut().flat_map(State::equations_mut)) {
            let mut reads = false;
            expr.each_variable(&mut |variable| reads |= variable == Variable::State(clock));
            if is_own(expr) {
                *expr = Expr::scaled(tick, count.clone());
            } else if reads && (tick * rate - 1.0).abs() >= SAME_TICK {
                *expr = expr.substituted(&read);
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
            state.jump = state.jump.as_ref().map(|jump| jump.renamed(&read));
            state.wait = state.wait.as_ref().map(|wait| wait.renamed(&read));
            state.motion = state.motion.filter(|_| !rests);
        }
        model.algebraics.iter_mut().for_each(|algebraic| algebraic.expr = algebraic.expr.renamed(&read));
        model.outputs.iter_mut().for_each(|output| output.variable = read(output.variable));
        model.share_systems();
        model
    }

    /// The states that stand for what a quantity was, each with its delay in seconds.
    pub fn delays(&self) -> impl Iterator<Item = (StateId, f64)> + '_ {
        self.states.numbered().filter_map(|(state, own)| match own.motion {
            Some(Motion::Delayed(seconds)) => Some((state, seconds)),
            _ => None,
        })
    }

    /// The states that count the steps of events with delays, each with its delay in seconds where that is a number.
    pub fn waits(&self) -> impl Iterator<Item = (StateId, f64)> + '_ {
        self.states.numbered().filter_map(|(state, own)| Some((state, own.waits_for()?)))
    }

    /// The same in steps of so many seconds, with signals and lists of steps as they are.
    pub fn in_steps_of(&self, step: f64) -> Model {
        let mut model = Model { step, ..self.clone() };
        model.recount(self.step);
        model.bound_waits();
        model
    }

    /// Counts what waits at time zero in steps of the model, in the place of others of so many seconds.
    fn recount(&mut self, before: f64) {
        let ratio = before / self.step;
        for state in self.states.iter_mut().filter(|state| state.wait.is_some() && state.initial > 0.0) {
            let more = if state.waits_for().is_some() { 0.0 } else { State::LEAST_WAIT };
            state.initial = (state.initial - more) * ratio + more;
        }
    }

    /// Gives states that count steps their ranges.
    pub fn bound_waits(&mut self) {
        let waits: Vec<(StateId, f64)> = self.waits().collect();
        for (state, seconds) in waits {
            self.states[state].range = Some((0.0, libm::round(seconds / self.step).max(0.0)));
        }
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
    /// wrong with them is seen in what reads them, as with those that count steps; and but for angles, whose scale is half a turn.
    pub fn own_scales(&self, mut scales: Vec<f64>) -> Vec<f64> {
        for (scale, state) in scales.iter_mut().zip(&self.states) {
            if state.motion.is_some() || state.wait.is_some() {
                *scale = f64::INFINITY;
            }
            if state.angle {
                *scale = turns::HALF;
            }
        }
        scales
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Algebraic, Solver};

    #[test]
    fn another_step_keeps_what_equations_make_of_the_clock() {
        let clock = || Expr::Variable(Variable::State(StateId::new(0)));
        let mut model = Model::new("m", Solver::Rk4, 0.5, 4.0);
        let state = State { motion: Some(Motion::Clock), ..State::new("time.steps", Expr::Constant(1.0)) };
        model.states = vec![state.clone(), State { motion: None, derivative: clock(), ..state }].into();
        let equation = |expr: Expr| Algebraic {
            name: "a".to_owned(),
            unit: None,
            expr,
            range: None,
            kept: false,
            angle: false,
            span: Default::default(),
        };
        // The time, twice and squared.
        let exprs = [clock(), Expr::scaled(2.0, clock()), Expr::power(clock(), 2)];
        model.algebraics = exprs.map(equation).into();
        let at = |model: &Model, time: f64| {
            let ticks = time * model.states[StateId::new(0)].derivative.as_constant().expect("a number");
            let numbers = model.algebraics.iter().map(|algebraic| algebraic.expr.evaluate(&|_| ticks));
            numbers.chain([model.states[StateId::new(1)].derivative.evaluate(&|_| ticks)]).collect::<Vec<f64>>()
        };
        for step in [0.5, 0.25, 0.1, 0.7, 0.5] {
            model.set_step(step);
            for (is, should) in at(&model, 3.0).into_iter().zip([3.0, 6.0, 9.0, 3.0]) {
                assert!((is - should).abs() < 1e-12, "{step}: {is} in place of {should}");
            }
            let own = if step == 1.0 { clock() } else { Expr::scaled(step, clock()) };
            assert_eq!(model.algebraics[0].expr, own, "the time itself is what it would be from the beginning");
        }
    }
}
