//! States that jump, and when they do.

use std::collections::BTreeMap;

use pe_ir::graph::{FixedPoint, StepGraph, ValueId};
use pe_ir::index::StateId;
use pe_ir::model::{Expr, Model};

/// LSBs by which rounding may move a state on its way from where the method leaves it.
const ROUNDED: f64 = 2.0;

/// States that events change, but for those that count the steps of delays.
fn jumping_alone(model: &Model) -> impl Iterator<Item = StateId> {
    model.states.numbered().filter(|(_, own)| own.jump.is_some() && own.wait.is_none()).map(|(state, _)| state)
}

/// Values that the method leaves states at that then jump and do not stand still.
pub fn left_at(model: &Model, graph: &StepGraph) -> BTreeMap<ValueId, StateId> {
    let producers = graph.producers();
    let left_at = |state: StateId| {
        let next = graph.states[state].1;
        let chain = &graph.chains[producers[next.index()]?];
        chain.writes().find(|write| write.value == next)?.base.map(|base| (base, state))
    };
    let moves = |state: &StateId| model.states[*state].derivative != Expr::Constant(0.0);
    jumping_alone(model).filter(moves).filter_map(left_at).collect()
}

/// Watches a run for jumps. States that stand still jump where they change at all; others where they are not what the method
/// leaves them at.
pub(super) struct Jumping {
    states: Vec<Watched>,
}

struct Watched {
    state: StateId,
    /// What the method leaves it at; none of states that stand still.
    left_at: Option<ValueId>,
    /// Where a state that stands still was before.
    before: f64,
    /// Difference that is rounding.
    slack: f64,
}

impl Jumping {
    /// Those of a run that begins with such states.
    pub fn of(model: &Model, graph: &StepGraph, start: impl Fn(StateId) -> f64) -> Jumping {
        let left_at: BTreeMap<StateId, ValueId> =
            left_at(model, graph).into_iter().map(|(value, state)| (state, value)).collect();
        let watched = |state: StateId| {
            let own = &model.states[state];
            let still = own.derivative == Expr::Constant(0.0);
            let left_at = left_at.get(&state).copied();
            (still || left_at.is_some()).then_some(Watched { state, left_at, before: start(state), slack: 0.0 })
        };
        Jumping { states: jumping_alone(model).filter_map(watched).collect() }
    }

    /// The same of a run in fixed point.
    pub fn rounded(mut self, graph: &StepGraph, fixed: &FixedPoint) -> Jumping {
        let lsb = |value: ValueId| libm::scalbn(1.0, fixed.exponents[value.index()]);
        for Watched { state, left_at, slack, .. } in &mut self.states {
            let (own, next) = graph.states[*state];
            *slack = ROUNDED * [Some(own), Some(next), *left_at].into_iter().flatten().map(lsb).fold(0.0, f64::max);
        }
        self
    }

    /// States that jumped in the latest step of a run, given by its states and values.
    pub fn jumped(
        &mut self,
        state: impl Fn(StateId) -> f64,
        value: impl Fn(ValueId) -> f64,
    ) -> impl Iterator<Item = StateId> {
        self.states.iter_mut().filter_map(move |own| {
            let now = state(own.state);
            let before = own.left_at.map_or(own.before, &value);
            own.before = now;
            ((now - before).abs() > own.slack).then_some(own.state)
        })
    }
}
