//! The time of an event within the step, and what states are at it.

use super::{Writer, minus, not, of};
use crate::equations::events::margin;
use pe_ir::index::{StateId, at};
use pe_ir::model::{Expr, Function, State, Variable};
use pe_ir::motion::Motion;

/// The derivative of a state; what a quantity was some time ago stands still for as long as an event may be late.
pub(super) fn slope(state: &State) -> Expr {
    match state.motion {
        Some(Motion::Delayed(_)) => Expr::Constant(0.0),
        _ => state.derivative.clone(),
    }
}

impl Writer<'_> {
    /// The time in seconds since the margin of an event was zero, where it is due by itself; zero elsewhere. One step of
    /// Newton's method from the end of the step.
    pub(super) fn late(&mut self, event: usize, newly: Variable) -> Variable {
        let margin = margin(&self.events[event].trigger).expect("it is a single comparison");
        let slope = self.rate(&margin);
        if let Some(slope) = slope.as_constant() {
            // What changes by jumps alone is never late.
            let scale = if slope == 0.0 { 0.0 } else { 1.0 / slope };
            let late = Expr::scaled(scale, Expr::product(vec![of(newly), margin]));
            return self.quantity(event, "late", late);
        }
        // Where the event does not come this is 1, so that nothing is divided by zero.
        let slope = Expr::sum(vec![Expr::product(vec![of(newly), slope]), not(newly)]);
        let slope = self.quantity(event, "slope", slope);
        let margin = self.quantity(event, "margin", margin);
        let late = Expr::product(vec![of(newly), of(margin), Expr::Apply(Function::Reciprocal, Box::new(of(slope)))]);
        self.quantity(event, "late", late)
    }

    /// The derivative of an expression with respect to time, as states are without events.
    fn rate(&self, expr: &Expr) -> Expr {
        let mut read = Vec::new();
        expr.each_variable(&mut |variable| read.push(variable));
        read.sort_unstable();
        read.dedup();
        let mut members = Vec::new();
        for variable in read {
            let inner = match variable {
                Variable::State(state) => slope(&self.model.states[state]),
                Variable::Input(_) => continue,
                Variable::Algebraic(algebraic) => self.rate(&self.model.algebraics[at(algebraic)].expr),
            };
            members.push(Expr::product(vec![expr.derivative(variable), inner]));
        }
        Expr::sum(members)
    }

    /// Takes states back to the time of an event: those that it changes, those that its new values read and those whose derivative
    /// reads what it changes, or changes with it. Returns the ones that go on with another derivative.
    pub(super) fn go_back(&mut self, event: usize, late: Variable) -> Vec<u32> {
        let assignments = &self.events[event].assignments;
        let targets: Vec<u32> = assignments.iter().map(|(state, _)| *state).collect();
        let mut back = targets.clone();
        assignments.iter().for_each(|(_, value)| back.extend(self.states_read(value)));
        let mut bent = targets.clone();
        for reader in targets.iter().flat_map(|target| &self.readers[at(*target)]) {
            bent.push(*reader);
            back.extend(&self.read_by[at(*reader)]);
        }
        for all in [&mut back, &mut bent] {
            all.sort_unstable();
            all.dedup();
        }
        back.extend(&bent);
        back.sort_unstable();
        back.dedup();
        let mut moved = Vec::new();
        for state in back {
            let derivative = slope(&self.model.states[StateId::new(state)]);
            if derivative == Expr::Constant(0.0) {
                continue;
            }
            let slope = self.expr(event, &derivative);
            let own = self.present(event, Variable::State(StateId::new(state)));
            let change = self.quantity(event, "back", minus(Expr::product(vec![of(late), slope])));
            let at = self.quantity(event, "at", Expr::sum(vec![of(own), of(change)]));
            moved.push((state, at, change));
        }
        for (state, at, change) in moved {
            self.changed.insert(state, at);
            // Elsewhere what is taken back is what is gone forward again, to first order.
            if bent.contains(&state) {
                self.jumps.entry(state).or_default().push(of(change));
            } else {
                self.lent.push((state, change));
            }
        }
        self.twins.clear();
        bent
    }

    /// Lets the rest of the step go by from the time of an event.
    pub(super) fn go_forward(&mut self, event: usize, late: Variable, bent: &[u32]) {
        let mut moved = Vec::new();
        for state in bent {
            let derivative = slope(&self.model.states[StateId::new(*state)]);
            if derivative == Expr::Constant(0.0) {
                continue;
            }
            let slope = self.expr(event, &derivative);
            let own = self.present(event, Variable::State(StateId::new(*state)));
            let change = self.quantity(event, "rest", Expr::product(vec![of(late), slope]));
            let after = self.after(event, *state, Expr::sum(vec![of(own), of(change)]));
            moved.push((*state, after, change));
        }
        for (state, after, change) in moved {
            self.changed.insert(state, after);
            self.jumps.entry(state).or_default().push(of(change));
        }
        for (state, change) in std::mem::take(&mut self.lent) {
            let own = self.present(event, Variable::State(StateId::new(state)));
            let after = self.after(event, state, Expr::sum(vec![of(own), minus(of(change))]));
            self.changed.insert(state, after);
        }
        self.twins.clear();
    }
}
