//! Parts of a step that do not wait for one another, in turns.

use std::cmp::Reverse;

use pe_ir::index::{List, number};

use super::problem::{CodeId, Problem};

/// Priorities by which parts of the step come one after the other; none if it is in one piece. Within a part the longest
/// way to the end counts, as ever.
pub(super) fn priorities(problem: &Problem) -> Option<List<CodeId, u32>> {
    let mut above: List<CodeId, CodeId> = problem.chains.ids().collect();
    for chain in problem.chains.ids() {
        for successor in problem.successors(chain) {
            let (one, other) = (first(&mut above, chain), first(&mut above, *successor));
            above[one.max(other)] = one.min(other);
        }
    }
    let of: List<CodeId, CodeId> = problem.chains.ids().map(|chain| first(&mut above, chain)).collect();
    // By the first chain of each part in the order of the graph, which does not depend on PEs.
    let mut turn = List::filled(None, of.len());
    let mut order: Vec<CodeId> = problem.chains.ids().collect();
    order.sort_by_key(|chain| problem.original(*chain));
    let mut parts = 0u32;
    for chain in &order {
        let turn = &mut turn[of[*chain]];
        if turn.is_none() {
            *turn = Some(parts);
            parts += 1;
        }
    }
    if parts < 2 {
        return None;
    }
    order.sort_by_key(|chain| (turn[of[*chain]], Reverse(problem.chains[*chain].priority), problem.original(*chain)));
    let mut priorities = List::filled(0, of.len());
    for (place, chain) in order.iter().rev().enumerate() {
        priorities[*chain] = number(place);
    }
    Some(priorities)
}

/// The first chain of the part of a chain, as far as parts are joined.
fn first(above: &mut List<CodeId, CodeId>, mut chain: CodeId) -> CodeId {
    while above[chain] != chain {
        above[chain] = above[above[chain]];
        chain = above[chain];
    }
    chain
}
