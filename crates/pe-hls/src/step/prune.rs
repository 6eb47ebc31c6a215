//! Dead-code elimination: writes, chains, values and equations that nothing reads.

use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, ValueId, Write};
use pe_ir::index::{self, EquationId, List};

/// Removes dead writes and everything that only they need, and numbers the rest densely in the old order.
pub fn prune(graph: StepGraph) -> StepGraph {
    let live = live_values(&graph);
    let kept = graph.values.iter().enumerate().map(|(index, value)| {
        // Inputs and states stay: they are ports and memory of the model, read or not.
        live[index] || matches!(value.role, Role::State(_) | Role::Next(_) | Role::Input(_))
    });
    let values: Vec<Option<ValueId>> = dense(kept).map(|place| place.map(ValueId::at)).collect();
    let mut owns_chain = List::filled(false, graph.equations.len());
    let mut terms = Vec::with_capacity(graph.terms.len());
    let mut chains = List::with_capacity(graph.chains.len());
    for chain in &graph.chains {
        let is_live = |write: &Write| live[write.value.index()];
        // An interim value lives with what is added to it.
        let interim = chain.interim.filter(is_live);
        let mut writes = std::iter::once(chain.write).chain(chain.second).filter(is_live);
        let Some(write) = writes.next() else { continue };
        let second = writes.next();
        owns_chain[chain.equation] = true;
        let start = index::number(terms.len());
        terms.extend_from_slice(graph.chain_terms(chain));
        chains.push(Chain { terms: start..terms.len() as u32, interim, write, second, ..*chain });
    }
    let equations: List<EquationId, Option<EquationId>> =
        dense(owns_chain.iter().copied()).map(|place| place.map(EquationId::at)).collect();
    let value_id = |id: ValueId| values[id.index()].expect("it is read or written");
    let write_id = |write: Write| Write { value: value_id(write.value), base: write.base.map(value_id), ..write };
    for chain in &mut chains {
        chain.equation = equations[chain.equation].expect("it owns a chain");
        chain.interim = chain.interim.map(write_id);
        chain.write = write_id(chain.write);
        chain.second = chain.second.map(write_id);
    }
    for Term { operand, factor, .. } in &mut terms {
        *operand = value_id(*operand);
        if let Factor::Value(value) = factor {
            *value = value_id(*value);
        }
    }
    let mut kept = Vec::with_capacity(graph.values.len());
    for (index, value) in graph.values.iter().enumerate().filter(|(index, _)| values[*index].is_some()) {
        debug_assert_eq!(values[index], Some(ValueId::at(kept.len())));
        let equation = value.equation.and_then(|equation| equations[equation]);
        let role = match (value.role, equation) {
            (Role::Inner(_, serial), Some(equation)) => Role::Inner(equation, serial),
            (role, _) => role,
        };
        kept.push(pe_ir::graph::Value { role, equation, ..*value });
    }
    StepGraph {
        values: kept,
        chains,
        terms,
        equations: keep(graph.equations, &equations),
        states: graph.states.iter().map(|(state, next)| (value_id(*state), value_id(*next))).collect(),
        inputs: graph.inputs.iter().copied().map(value_id).collect(),
        outputs: graph.outputs.iter().copied().map(value_id).collect(),
        ..graph
    }
}

/// Values that the next step or an output needs. Chains are in topological order, so one backward pass suffices.
fn live_values(graph: &StepGraph) -> Vec<bool> {
    let mut live = vec![false; graph.values.len()];
    for (state, next) in &graph.states {
        live[state.index()] = true;
        live[next.index()] = true;
    }
    for output in &graph.outputs {
        live[output.index()] = true;
    }
    for chain in graph.chains.iter().rev() {
        let mut needed = false;
        // What is added to an interim value comes last.
        let writes: Vec<Write> = chain.writes().copied().collect();
        for write in writes.into_iter().rev() {
            if !live[write.value.index()] {
                continue;
            }
            needed = true;
            if let Some(base) = write.base {
                live[base.index()] = true;
            }
        }
        for term in graph.chain_terms(chain).iter().filter(|_| needed) {
            live[term.operand.index()] = true;
            if let Factor::Value(value) = term.factor {
                live[value.index()] = true;
            }
        }
    }
    live
}

/// Numbers the kept members; none for the others.
fn dense(keep: impl Iterator<Item = bool>) -> impl Iterator<Item = Option<usize>> {
    let mut next = 0;
    keep.map(move |keep| keep.then(|| (next, next += 1).0))
}

fn keep<I, T>(items: List<I, T>, numbers: &List<I, Option<I>>) -> List<I, T> {
    items.into_iter().zip(numbers).filter(|(_, number)| number.is_some()).map(|(item, _)| item).collect()
}
