//! Leaves out of a step what states that stand still need none of: stages that are the state itself, sums that are zero.

use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, ValueId, Write};
use pe_ir::index::{self, List, StateId};

/// What a value turns out to be.
#[derive(Clone, Copy, PartialEq)]
enum Known {
    /// It changes.
    Varies,
    /// Another value.
    Same(ValueId),
    /// Zero.
    Zero,
}

/// The graph without chains whose sums have zero coefficients only. What the step ends with, what functions are of and
/// second factors of products keep theirs.
pub fn leave_out(graph: StepGraph) -> StepGraph {
    let mut known = vec![Known::Varies; graph.values.len()];
    let mut is_kept = vec![false; graph.values.len()];
    graph.outputs.iter().for_each(|output| is_kept[output.index()] = true);
    for (kept, value) in is_kept.iter_mut().zip(&graph.values) {
        *kept |= value.factor || matches!(value.role, Role::Next(_) | Role::State(_) | Role::Published(_));
    }
    let mut terms: Vec<Term> = Vec::with_capacity(graph.terms.len());
    let mut chains = List::with_capacity(graph.chains.len());
    for chain in &graph.chains {
        let live: Vec<Term> = graph.chain_terms(chain).iter().filter_map(|term| present(*term, &known)).collect();
        let may_go =
            live.is_empty() && chain.function.is_none() && chain.writes().all(|write| !is_kept[write.value.index()]);
        if may_go {
            for write in chain.writes() {
                known[write.value.index()] = based(*write, &known).base.map_or(Known::Zero, Known::Same);
            }
            continue;
        }
        let start = index::number(terms.len());
        match live.is_empty() {
            false => terms.extend(live),
            true => {
                let operand = graph.chain_terms(chain)[0].operand;
                let stand_in = chain.writes().find_map(|write| based(*write, &known).base);
                let operand = read(operand, &known).or(stand_in).unwrap_or_else(|| graph.states[StateId::new(0)].0);
                terms.push(Term::new(operand, Factor::Coefficient(0.0)));
            }
        }
        chains.push(Chain {
            terms: start..index::number(terms.len()),
            interim: chain.interim.map(|write| based(write, &known)),
            write: based(chain.write, &known),
            second: chain.second.map(|write| based(write, &known)),
            ..*chain
        });
    }
    StepGraph { terms, chains, ..graph }
}

/// A value as it is read; none if it is zero.
fn read(value: ValueId, known: &[Known]) -> Option<ValueId> {
    match known[value.index()] {
        Known::Varies => Some(value),
        Known::Same(other) => Some(other),
        Known::Zero => None,
    }
}

/// A write with its base as it is read.
fn based(write: Write, known: &[Known]) -> Write {
    Write { base: write.base.and_then(|base| read(base, known)), ..write }
}

/// A term as it counts; none if it is zero.
fn present(term: Term, known: &[Known]) -> Option<Term> {
    if term.factor == Factor::Coefficient(0.0) {
        return None;
    }
    if let Factor::Value(factor) = term.factor {
        read(factor, known)?;
    }
    Some(Term { operand: read(term.operand, known)?, ..term })
}
