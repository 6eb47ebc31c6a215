//! Puts the chains of one step graph behind those of another.

use pe_ir::graph::{Chain, Factor, StepGraph, Term, ValueId, Write};
use pe_ir::index::{self, EquationId, List, at};

/// Adds the chains of `other` with their terms and functions. Its values and equations have the given numbers in `graph`.
pub(super) fn chains(
    graph: &mut StepGraph,
    other: &StepGraph,
    values: &[ValueId],
    equations: &List<EquationId, EquationId>,
) {
    let id = |value: ValueId| values[value.index()];
    let write = |write: Write| Write { value: id(write.value), base: write.base.map(id), ..write };
    let terms = index::number(graph.terms.len());
    for term in &other.terms {
        let factor = match term.factor {
            Factor::Value(value) => Factor::Value(id(value)),
            coefficient => coefficient,
        };
        graph.terms.push(Term { operand: id(term.operand), partner: term.partner.map(id), factor });
    }
    let mut functions = Vec::with_capacity(other.functions.exact.len());
    for function in &other.functions.exact {
        let same = graph.functions.exact.iter().position(|known| known.body == function.body);
        functions.push(index::number(same.unwrap_or(graph.functions.exact.len())));
        if same.is_none() {
            graph.functions.exact.push(function.clone());
        }
    }
    for chain in &other.chains {
        graph.chains.push(Chain {
            equation: equations[chain.equation],
            terms: chain.terms.start + terms..chain.terms.end + terms,
            interim: chain.interim.map(write),
            write: write(chain.write),
            second: chain.second.map(write),
            function: chain.function.map(|function| functions[at(function)]),
        });
    }
}
