//! Which chains of a step compute the same sum in different stages.

use pe_ir::graph::{Role, StageForm, StepGraph};
use pe_ir::index::{ChainId, EquationId, List, at};

/// For each chain the one of the last stage that computes the same sum; itself where there is none. Only stages by sums
/// are alike in their coefficients, too.
pub fn alike(graph: &StepGraph) -> List<ChainId, ChainId> {
    let mut like: List<ChainId, ChainId> = graph.chains.ids().collect();
    if graph.form != StageForm::Sums {
        return like;
    }
    let mut of_equation: List<EquationId, Vec<ChainId>> = List::filled(Vec::new(), graph.equations.len());
    for (index, chain) in graph.chains.numbered() {
        of_equation[chain.equation].push(index);
    }
    let role = |chain: ChainId| graph.value(graph.chains[chain].write.value).role;
    let ends_stage = |chain: &ChainId| match role(*chain) {
        Role::Stage(..) | Role::Next(_) | Role::Partial(..) => true,
        Role::Algebraic(_, stage) => stage < u8::MAX,
        _ => false,
    };
    for chains in of_equation {
        // Behind the last stage come sums for outputs.
        let count = chains.iter().rposition(ends_stage).map_or(0, |last| last + 1);
        let each = count / at(graph.stages);
        if each > 0 && count % at(graph.stages) == 0 {
            for (position, chain) in chains[..count].iter().enumerate() {
                let last = chains[count - each + position % each];
                if graph.chains[last].len() == graph.chains[*chain].len() {
                    like[*chain] = last;
                }
            }
        }
    }
    like
}
