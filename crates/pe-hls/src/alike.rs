//! Which chains of a step compute the same sum in different stages.

use pe_ir::graph::{Role, StageForm, StepGraph};
use pe_ir::index::at;

/// For each chain the one of the last stage that computes the same sum; itself where there is none. Only stages by sums
/// are alike in their coefficients, too.
pub fn alike(graph: &StepGraph) -> Vec<u32> {
    let mut like: Vec<u32> = (0..graph.chains.len() as u32).collect();
    if graph.form != StageForm::Sums {
        return like;
    }
    let mut of_equation: Vec<Vec<u32>> = vec![Vec::new(); graph.equations.len()];
    for (index, chain) in (0..).zip(&graph.chains) {
        of_equation[at(chain.equation)].push(index);
    }
    let role = |chain: u32| graph.value(graph.chains[at(chain)].write.value).role;
    let ends_stage = |chain: &u32| match role(*chain) {
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
                if graph.chains[at(last)].len() == graph.chains[at(*chain)].len() {
                    like[at(*chain)] = last;
                }
            }
        }
    }
    like
}
