//! Ranges of words that are copies of other words, as those of the past of a quantity are: a run may be too short to fill them, and
//! copies in another format would round what they copy.

use std::collections::BTreeMap;

use pe_hls::formats::Ranges;
use pe_ir::graph::{Factor, Role, StepGraph, ValueId};
use pe_ir::index::StateId;

/// Gives copies the range of what they are copies of.
pub(super) fn include(graph: &StepGraph, ranges: &mut Ranges) {
    // Each copy with its source, whose range counts at the start of the step and at its end.
    let mut copies: Vec<(StateId, ValueId)> = Vec::new();
    for chain in graph.chains.iter().filter(|chain| chain.function.is_none() && chain.second.is_none()) {
        if let ([term], Role::Next(state), None) =
            (graph.chain_terms(chain), graph.value(chain.write.value).role, chain.write.base)
            && term.partner.is_none()
            && term.factor == Factor::Coefficient(1.0)
        {
            copies.push((state, term.operand));
        }
    }
    let mut readers: BTreeMap<ValueId, Vec<StateId>> = BTreeMap::new();
    copies.iter().for_each(|(state, source)| readers.entry(*source).or_default().push(*state));
    let mut waiting: Vec<ValueId> = copies.iter().map(|(_, source)| *source).collect();
    while let Some(source) = waiting.pop() {
        let largest = ranges.largest[source.index()];
        for state in readers.get(&source).into_iter().flatten() {
            let (start, end) = graph.states[*state];
            if ranges.largest[start.index()] < largest || ranges.largest[end.index()] < largest {
                for value in [start, end] {
                    ranges.largest[value.index()] = ranges.largest[value.index()].max(largest);
                }
                waiting.push(start);
            }
        }
    }
}
