//! Signals that are part of the model: `time`, and what is computed from it in the network.
//!
//! Time is a count of steps, sines are rotations: states of their own that move exactly ([`Motion`]). While equations are
//! written out they have numbers from [`SIGNALS`] on; the last pass gives them their places behind the declared states.

use crate::evaluate::fold::{ProductBuilder, SumBuilder};
use crate::language::measures::TimeUnit;
use pe_ir::index::{StateId, at, number};
use pe_ir::model::{Algebraic, Expr, Function, Interpolation, Samples, Signal, State, Variable, Waveform};
use pe_ir::motion::{Motion, Source};
use pe_ir::source::Span;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Number of the first variable that stands for a signal; no model has as many of its own.
pub(crate) const SIGNALS: u32 = 1 << 30;

/// What rounding leaves of a sine or cosine of a phase that ought to be zero.
const RESIDUE: f64 = 1e-15;

/// The time, an algebraic quantity.
pub(crate) const TIME: Variable = Variable::Algebraic(SIGNALS);

/// The count of steps.
pub(crate) const CLOCK: Variable = Variable::State(StateId::new(SIGNALS));

/// A state that represents a signal.
#[derive(Clone, Copy, Debug, PartialEq)]
enum SignalState {
    /// The sine of a frequency in hertz; the cosine is behind it.
    Sine(f64),
    Cosine(f64),
    /// The sine of an angle whose speed is the state of this number; the cosine is behind it.
    SweptSine(StateId),
    SweptCosine(StateId),
    /// A played signal or an input, in a role.
    Played(Motion),
    /// What is told by the entry of this number in [`Signals::delays`].
    Delayed(u32),
}

/// Signals of the model found so far.
#[derive(Debug)]
pub(crate) struct Signals {
    /// Span of the model in seconds.
    pub(crate) span: f64,
    /// The unit in which `time` counts.
    pub(crate) unit: TimeUnit,
    /// Where time is read first.
    time_read: Option<Span>,
    /// States after the clock, each with the place where it occurs first.
    entries: Vec<(SignalState, Span)>,
    /// What is read so many seconds after it was, each once, with the place of its entry.
    pub(crate) delays: Vec<(Variable, f64)>,
    delayed: BTreeMap<(Variable, u64), Variable>,
    /// What the network plays, each once, with its name.
    pub(crate) played: Vec<(Signal, String)>,
}

impl Default for Signals {
    fn default() -> Self {
        Signals {
            span: 1.0,
            unit: TimeUnit::default(),
            time_read: None,
            entries: Vec::new(),
            delays: Vec::new(),
            delayed: BTreeMap::new(),
            played: Vec::new(),
        }
    }
}

impl Signals {
    /// Number of states that represent signals: the clock, which may be unused, and all others.
    pub(crate) fn states(&self) -> usize {
        1 + self.entries.len()
    }

    /// The state of the latest entries that are added, the first of them.
    fn add(&mut self, entries: &[SignalState], span: Span) -> Variable {
        let first = SIGNALS + 1 + number(self.entries.len());
        self.entries.extend(entries.iter().map(|entry| (*entry, span)));
        Variable::State(StateId::new(first))
    }

    /// The first state of a entry, if there is one.
    fn find(&self, entry: SignalState) -> Option<Variable> {
        let place = self.entries.iter().position(|(other, _)| *other == entry)?;
        Some(Variable::State(StateId::new(SIGNALS + 1 + number(place))))
    }

    /// The state that an interpolated input is.
    pub(crate) fn line(&mut self, input: u32, span: Span) -> Variable {
        let source = Source::Input(input);
        self.add(&[SignalState::Played(Motion::Line(source)), SignalState::Played(Motion::Before(source))], span)
    }

    /// The state that a played signal is.
    fn play(&mut self, waveform: Waveform, smooth: bool, name: &str, span: Span) -> Variable {
        let known = self.played.iter().position(|(signal, _)| signal.waveform == waveform);
        let source = Source::Signal(number(known.unwrap_or(self.played.len())));
        let states = match smooth {
            true => &[Motion::Line(source), Motion::Before(source), Motion::After(source)][..],
            false => &[Motion::Held(source)],
        };
        let entries: Vec<SignalState> = states.iter().map(|motion| SignalState::Played(*motion)).collect();
        if let Some(state) = self.find(entries[0]) {
            return state;
        }
        let name = format!("{name}.{}", self.played.len() + 1);
        self.played.push((Signal { waveform, span }, name));
        self.add(&entries, span)
    }

    /// What a signal reads, by its variable: the states that move with it, the clock, an input.
    pub(crate) fn reads(&self, variable: Variable) -> Vec<Variable> {
        let Variable::State(state) = variable else {
            return if variable == TIME { vec![CLOCK] } else { Vec::new() };
        };
        let Some((entry, _)) = (state.number() - SIGNALS).checked_sub(1).map(|entry| self.entries[at(entry)]) else {
            return Vec::new();
        };
        let next = |places: u32| Variable::State(state.behind(places));
        match entry {
            SignalState::Sine(_) => vec![next(1)],
            SignalState::Cosine(_) => vec![Variable::State(StateId::new(state.number() - 1))],
            SignalState::SweptSine(speed) => vec![next(1), Variable::State(speed)],
            SignalState::SweptCosine(speed) => {
                vec![Variable::State(StateId::new(state.number() - 1)), Variable::State(speed)]
            }
            SignalState::Played(Motion::Line(Source::Input(input))) => vec![next(1), Variable::Input(input)],
            SignalState::Played(Motion::Line(Source::Signal(_))) => vec![next(1), next(2)],
            SignalState::Delayed(delay) => vec![self.delays[at(delay)].0],
            SignalState::Played(_) => Vec::new(),
        }
    }

    /// What stands for a variable as it was so many seconds ago; a number is always the same.
    pub(crate) fn delayed(&mut self, expr: Expr, seconds: f64, span: Span) -> Expr {
        let Expr::Variable(of) = expr else { return expr };
        let key = (of, seconds.to_bits());
        if let Some(known) = self.delayed.get(&key) {
            return Expr::Variable(*known);
        }
        self.delays.push((of, seconds));
        let state = self.add(&[SignalState::Delayed(number(self.delays.len()) - 1)], span);
        self.delayed.insert(key, state);
        Expr::Variable(state)
    }

    /// Where the first delay stands, if there is any.
    pub(crate) fn first_delay(&self) -> Option<Span> {
        let is_delay = |(entry, _): &&(SignalState, Span)| matches!(entry, SignalState::Delayed(_));
        self.entries.iter().find(is_delay).map(|(_, span)| *span)
    }

    /// The state at a place behind [`SIGNALS`], with the final numbers of itself, of inputs and of played signals.
    pub(crate) fn state(
        &self,
        place: usize,
        own: u32,
        quantity: u32,
        (inputs, names): (&[u32], &[String]),
        (played, states): (&[u32], &[u32]),
    ) -> State {
        let of = |name: String, initial: f64, derivative: Expr, motion: Motion, span: Span| State {
            quantity,
            initial,
            motion: Some(motion),
            span,
            ..State::new(name, derivative)
        };
        let Some(entry) = place.checked_sub(1) else {
            // The model's step is put in when it is known.
            return of(
                "time.steps".to_owned(),
                0.0,
                Expr::Constant(1.0),
                Motion::Clock,
                self.time_read.unwrap_or_default(),
            );
        };
        let (entry, span) = self.entries[entry];
        let name = |function: &str, frequency: f64| format!("{function}(2*pi*{frequency}*time)");
        let of_state = |state: u32| Expr::Variable(Variable::State(StateId::new(state)));
        let rate = |frequency: f64| 2.0 * std::f64::consts::PI * frequency;
        match entry {
            SignalState::Sine(frequency) => {
                let (rate, cosine) = (rate(frequency), of_state(own + 1));
                of(name("sin", frequency), 0.0, Expr::scaled(rate, cosine), Motion::Sine(rate), span)
            }
            SignalState::Cosine(frequency) => {
                let (rate, sine) = (rate(frequency), of_state(own - 1));
                of(name("cos", frequency), 1.0, Expr::scaled(-rate, sine), Motion::Cosine(rate), span)
            }
            SignalState::SweptSine(speed) => {
                let speed = states[at(speed.number() - SIGNALS)];
                let moved = Expr::product(vec![of_state(speed), of_state(own + 1)]);
                of(format!("sine.{own}"), 0.0, moved, Motion::SweptSine(StateId::new(speed)), span)
            }
            SignalState::SweptCosine(speed) => {
                let speed = states[at(speed.number() - SIGNALS)];
                let moved = Expr::product(vec![Expr::Constant(-1.0), of_state(speed), of_state(own - 1)]);
                of(format!("cosine.{own}"), 1.0, moved, Motion::SweptCosine(StateId::new(speed)), span)
            }
            // Its name and the number of what it is of are put in when they are known.
            SignalState::Delayed(delay) => {
                let (variable, seconds) = self.delays[at(delay)];
                of(String::new(), 0.0, Expr::Variable(variable), Motion::Delayed(seconds), span)
            }
            SignalState::Played(motion) => {
                let final_of = |source: Source| match source {
                    Source::Input(input) => (Source::Input(inputs[at(input)]), names[at(inputs[at(input)])].clone()),
                    Source::Signal(signal) => (Source::Signal(played[at(signal)]), self.played[at(signal)].1.clone()),
                };
                let (motion, name) = match motion {
                    Motion::Line(source) => {
                        let line = if matches!(source, Source::Input(_)) { ".line" } else { "" };
                        (Motion::Line(final_of(source).0), format!("{}{line}", final_of(source).1))
                    }
                    Motion::Before(source) => {
                        (Motion::Before(final_of(source).0), format!("{}.before", final_of(source).1))
                    }
                    Motion::After(source) => {
                        (Motion::After(final_of(source).0), format!("{}.after", final_of(source).1))
                    }
                    Motion::Held(source) => (Motion::Held(final_of(source).0), final_of(source).1),
                    other => (other, String::new()),
                };
                // What the step tells is put in when it is known.
                of(name, 0.0, Expr::Constant(0.0), motion, span)
            }
        }
    }

    /// The played signals of which a state is needed, and their final numbers; `needed` tells of entries.
    pub(crate) fn played(&self, needed: impl Fn(usize) -> bool) -> (Vec<Signal>, Vec<u32>) {
        let mut kept = vec![false; self.played.len()];
        for (place, (entry, _)) in (1..).zip(&self.entries) {
            if let SignalState::Played(motion) = entry
                && let Some(Source::Signal(signal)) = motion.source()
            {
                kept[at(signal)] |= needed(place);
            }
        }
        let earlier = |place: usize| number(kept[..place].iter().filter(|kept| **kept).count());
        let numbers = (0..kept.len()).map(earlier).collect();
        let signals = self.played.iter().zip(kept).filter(|(_, kept)| *kept).map(|((signal, _), _)| signal.clone());
        (signals.collect(), numbers)
    }

    /// The algebraic equations of the time, the last of which is the time in the unit of the spec. The first reads the
    /// clock, in seconds.
    pub(crate) fn time_equations(&self, clock: u32, name: &str) -> Vec<Algebraic> {
        let equation = |name: String, unit: &str, expr: Expr| Algebraic {
            name,
            unit: Some(unit.to_owned()),
            expr,
            range: None,
            kept: false,
            angle: false,
            span: self.time_read.unwrap_or_default(),
        };
        let clock = Expr::Variable(Variable::State(StateId::new(clock)));
        let seconds = TimeUnit::default().name;
        if self.unit.name == seconds {
            return vec![equation(name.to_owned(), seconds, clock)];
        }
        let counted = scaled(self.unit.per_second(), Expr::Variable(Variable::Algebraic(0)));
        vec![equation(format!("{name}.seconds"), seconds, clock), equation(name.to_owned(), self.unit.name, counted)]
    }

    /// The time in the unit of the spec.
    pub(crate) fn time(&mut self, span: Span) -> Expr {
        self.time_read.get_or_insert(span);
        Expr::Variable(TIME)
    }

    /// A signal computed in the network.
    pub(crate) fn defined(&mut self, name: &str, waveform: Waveform, span: Span) -> Expr {
        match waveform {
            Waveform::Constant(value) => Expr::Constant(value),
            Waveform::Sine { amplitude, frequency, offset, phase } => {
                if frequency == 0.0 {
                    return Expr::Constant(offset + amplitude * libm::sin(phase));
                }
                let known = self.find(SignalState::Sine(frequency));
                let pair = [SignalState::Sine(frequency), SignalState::Cosine(frequency)];
                let sine = known.unwrap_or_else(|| self.add(&pair, span));
                self.turned(sine, amplitude, phase, offset)
            }
            Waveform::Ramp { from, to, start, duration } => {
                // In the unit of the time that is read.
                let [start, duration] = [start, duration].map(|time| time * self.unit.per_second());
                let slope = (to - from) / duration;
                let since = |corner: f64, time: Expr| sum([time, Expr::Constant(-corner)]);
                let mut part = |corner: f64, sign: f64| {
                    let since = since(corner, self.time(span));
                    // Before time zero there is nothing to tell apart.
                    let distance = if corner <= 0.0 { since } else { Expr::Apply(Function::Abs, Box::new(since)) };
                    scaled(sign * slope / 2.0, distance)
                };
                sum([part(start, 1.0), part(start + duration, -1.0), Expr::Constant(f64::midpoint(from, to))])
            }
            Waveform::Samples(samples) => {
                let smooth = samples.interpolation() == Interpolation::Linear;
                Expr::Variable(self.play(Waveform::Samples(samples), smooth, name, span))
            }
            jumping @ (Waveform::Square { .. } | Waveform::Pulse { .. }) => self.jumping(name, jumping, span),
            jumping @ Waveform::Pwm(_) => self.jumping(name, jumping, span),
            Waveform::Chirp(chirp) => {
                let speeds = [chirp.from, chirp.to].map(|frequency| 2.0 * std::f64::consts::PI * frequency);
                let samples = Samples::new(vec![0.0, chirp.duration], speeds.to_vec(), Interpolation::Linear);
                let samples = Waveform::Samples(Arc::new(samples.expect("a positive duration")));
                let Variable::State(speed) = self.play(samples, true, name, span) else {
                    unreachable!("what is played is a state")
                };
                let known = self.find(SignalState::SweptSine(speed));
                let pair = [SignalState::SweptSine(speed), SignalState::SweptCosine(speed)];
                let sine = known.unwrap_or_else(|| self.add(&pair, span));
                self.turned(sine, chirp.amplitude, chirp.phase, chirp.offset)
            }
            Waveform::Time { .. } | Waveform::Formula(_) => unreachable!("`{name}` is no signal of its own"),
        }
    }

    /// A sine with a phase, of the states that have none.
    fn turned(&self, sine: Variable, amplitude: f64, phase: f64, offset: f64) -> Expr {
        let parts = [libm::cos(phase), libm::sin(phase)];
        let parts = parts.map(|part| if part.abs() < RESIDUE { 0.0 } else { amplitude * part });
        let Variable::State(number) = sine else { unreachable!("entries are states") };
        let cosine = Expr::Variable(Variable::State(number.behind(1)));
        sum([scaled(parts[0], Expr::Variable(sine)), scaled(parts[1], cosine), Expr::Constant(offset)])
    }

    /// A signal that jumps; one that never does is a number.
    fn jumping(&mut self, name: &str, waveform: Waveform, span: Span) -> Expr {
        if waveform.breakpoints(self.span).next().is_none() {
            return Expr::Constant(waveform.at(0.0));
        }
        Expr::Variable(self.play(waveform, false, name, span))
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
