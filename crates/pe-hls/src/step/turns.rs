//! Angles: what the end of a step adds to drops the whole turns that the state has at its start.
//!
//! The number of these turns is looked up at the start of the step, so that nothing waits for it, and is a whole number of
//! words: dropping it is exact (`docs/decisions/0069-angles.md`). The state so stays within half a turn and what it moves in a
//! step, and its stages within twice that.

use pe_ir::functions::ScalarFunction;
use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{List, StateId, number};
use pe_ir::model::{Expr, Model, Select, Variable};
use pe_ir::turns::HALF;

use super::prune::prune;

/// The argument of the function.
const X: Variable = Variable::State(StateId::new(0));

/// Whole turns of a number of turns, for numbers of less than one and a half.
fn whole_turns() -> Expr {
    let above = |place: f64, yes: f64, no: Expr| {
        let condition = Expr::sum(vec![Expr::Variable(X), Expr::Constant(-place)]);
        Expr::Select(Box::new(Select { condition, yes: Expr::Constant(yes), no }))
    };
    above(HALF, 1.0, above(-HALF, 0.0, Expr::Constant(-1.0)))
}

/// The same step, in which angles drop whole turns.
pub(super) fn drop_turns(model: &Model, mut graph: StepGraph) -> StepGraph {
    let angles: Vec<StateId> = model.states.numbered().filter(|(_, state)| state.angle).map(|(id, _)| id).collect();
    if angles.is_empty() {
        return graph;
    }
    let body = whole_turns();
    let known = graph.functions.exact.iter().position(|function| function.body == body);
    let function = number(known.unwrap_or(graph.functions.exact.len()));
    if known.is_none() {
        let name = "whole turns of x".to_owned();
        graph.functions.exact.push(ScalarFunction { name, body, variable: X });
    }
    let producers = graph.producers();
    let mut chains = Vec::new();
    let mut rest: Vec<Chain> = std::mem::take(&mut graph.chains).into_iter().collect();
    let mut behind: Vec<(usize, Chain)> = Vec::new();
    for state in angles {
        let (start, next) = graph.states[state];
        let equation = graph.value(start).equation.expect("states have equations");
        let chain = |graph: &mut StepGraph, operand, factor, write, function| {
            let from = number(graph.terms.len());
            graph.terms.push(Term::new(operand, Factor::Coefficient(factor)));
            Chain { equation, terms: from..from + 1, interim: None, write, second: None, function }
        };
        let turns = auxiliary(&mut graph, state, "whole");
        chains.push(chain(&mut graph, start, 1.0, Write { value: turns, base: None, weight: 0 }, Some(function)));
        let writer = producers[next.index()].expect("every state has an end").index();
        let write = rest[writer].write;
        if write.value == next && write.base == Some(start) && rest[writer].interim.is_none() {
            let within = auxiliary(&mut graph, state, "within");
            chains.push(chain(&mut graph, turns, -1.0, Write { value: within, base: Some(start), weight: 0 }, None));
            rest[writer].write.base = Some(within);
        } else {
            // What the end is added to is no state, so the turns are dropped behind it.
            let beyond = auxiliary(&mut graph, state, "beyond");
            let Chain { interim, write, second, .. } = &mut rest[writer];
            let ends = interim.iter_mut().chain([write]).chain(second).filter(|write| write.value == next);
            ends.for_each(|write| write.value = beyond);
            let end = Write { value: next, base: Some(beyond), weight: 0 };
            behind.push((writer, chain(&mut graph, turns, -1.0, end, None)));
        }
    }
    behind.sort_by_key(|(writer, _)| *writer);
    let mut behind = behind.into_iter().peekable();
    for (writer, chain) in rest.into_iter().enumerate() {
        chains.push(chain);
        while let Some((_, chain)) = behind.next_if(|(before, _)| *before == writer) {
            chains.push(chain);
        }
    }
    // Nothing is dead: terms get the order of their chains.
    prune(StepGraph { chains: List::from(chains), ..graph })
}

/// A quantity of a state that the method has no name for.
fn auxiliary(graph: &mut StepGraph, state: StateId, what: &str) -> ValueId {
    let name = format!("{}.{what}", graph.names.states[state]);
    graph.names.auxiliaries.push(name);
    let role = Role::Auxiliary(number(graph.names.auxiliaries.len()) - 1);
    let equation = graph.value(graph.states[state].0).equation;
    graph.values.push(Value { role, equation, factor: false });
    ValueId::at(graph.values.len() - 1)
}
