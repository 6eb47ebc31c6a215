//! Events that wait, each until the exact time at which it is due.
//!
//! A network counts the steps that an event has to wait in a state. Here that state stands for a time: to the equations it
//! shows that more than a step is left until the time has come, and that it is the last one then.

use pe_ir::index::StateId;
use pe_ir::model::{Model, State};

use super::states::States;

/// Steps left, as shown to equations: of an event that is due, and of one that is not.
const DUE: f64 = 1.0;
const LATER: f64 = 2.0;

/// Part of a step by which a time may be missed for being a rounded number.
const SLACK: f64 = 1e-9;

/// What the states are behind jumps, and what begins to wait or waits no more: states, each with its steps.
#[derive(Clone)]
pub(super) struct Jumped {
    states: States,
    waits: Vec<(StateId, f64)>,
}

/// A state that counts steps while an event waits.
struct Wait {
    state: StateId,
    /// Steps that it counts at first, and what of them is no time.
    steps: f64,
    more: f64,
    /// Time in seconds at which it began; none if nothing waits.
    since: Option<f64>,
}

/// All states of a model that count steps.
pub(super) struct Waiting {
    step: f64,
    waits: Vec<Wait>,
    /// Steps that they count at time zero.
    initial: Vec<f64>,
}

impl Waiting {
    pub fn of(model: &Model) -> Waiting {
        let counting = model.states.numbered().filter(|(_, own)| own.wait.is_some());
        let (waits, initial) = counting
            .map(|(state, own)| {
                let more = if own.waits_for().is_some() { 0.0 } else { State::LEAST_WAIT };
                (Wait { state, steps: 0.0, more, since: None }, own.initial)
            })
            .unzip();
        Waiting { step: model.step, waits, initial }
    }

    /// Goes back to time zero.
    pub fn reset(&mut self) {
        for (wait, initial) in self.waits.iter_mut().zip(&self.initial) {
            (wait.steps, wait.since) = (*initial, (*initial > 0.0).then_some(0.0));
        }
    }

    /// The time at which the next event is due, in seconds.
    pub fn next(&self) -> Option<f64> {
        self.waits.iter().filter_map(|wait| wait.due(self.step)).min_by(f64::total_cmp)
    }

    /// Puts what equations are shown in the place of what states count.
    pub fn show(&self, states: &mut [f64], time: f64) {
        for wait in &self.waits {
            let is_due = |due: f64| time >= due - SLACK * self.step;
            states[wait.state.index()] = wait.due(self.step).map_or(0.0, |due| if is_due(due) { DUE } else { LATER });
        }
    }

    /// What comes of jumps that are not zero, where equations were shown these states; none if nothing does.
    pub fn behind(&self, states: &States, shown: &[f64], jumps: &[(StateId, f64)]) -> Option<Jumped> {
        let mut jumped = Jumped { states: states.clone(), waits: Vec::new() };
        let mut changes = false;
        for (state, jump) in jumps {
            if self.waits.iter().any(|wait| wait.state == *state) {
                let behind = shown[state.index()] + jump;
                // The step that it would have counted is none here.
                if shown[state.index()] == LATER && behind == LATER - 1.0 {
                    continue;
                }
                jumped.waits.push((*state, behind));
            } else {
                jumped.states.0[state.index()] += jump;
            }
            changes = true;
        }
        changes.then_some(jumped)
    }

    /// Takes over what begins to wait at a time, or waits no more. Returns the states.
    pub fn take(&mut self, time: f64, jumped: Jumped) -> States {
        let Jumped { mut states, waits } = jumped;
        for (state, steps) in waits {
            let Some(wait) = self.waits.iter_mut().find(|wait| wait.state == state) else { continue };
            (wait.steps, wait.since) = (steps, (steps > 0.0).then_some(time));
            states.0[state.index()] = steps;
        }
        states
    }

    /// The steps that a state of a network would count at the end of a step.
    pub fn left(&self, state: StateId, time: f64) -> Option<f64> {
        const ROUNDED: f64 = 1e-6;
        let wait = self.waits.iter().find(|wait| wait.state == state)?;
        let since = wait.since.unwrap_or(time);
        let passed = libm::round(time / self.step) - libm::ceil(since / self.step - ROUNDED);
        Some(wait.since.map_or(0.0, |_| (wait.steps - passed.max(0.0)).max(0.0)))
    }
}

impl Wait {
    fn due(&self, step: f64) -> Option<f64> {
        self.since.map(|since| since + (self.steps - self.more).max(SLACK) * step)
    }
}
