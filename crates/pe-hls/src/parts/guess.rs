//! Guesses which equations are alike, from the indices in their names and from what they read.

use std::collections::{BTreeSet, HashMap};

use pe_ir::graph::{Factor, Role, StepGraph, ValueId};
use pe_ir::index::{ChainId, EquationId, List, at, number};

/// A division of the values of an index into parts.
pub(super) struct Division {
    /// Which of the indices in a name.
    place: usize,
    /// Its least value.
    first: u32,
    /// How many values belong to a part.
    each: u32,
    /// Number of parts.
    pub parts: u32,
}

/// The text before, the indices, and the text behind them, of a name with one list of indices that is whole.
fn split(name: &str) -> Option<(&str, Vec<u32>, &str)> {
    let (before, rest) = name.split_once('[')?;
    let (indices, behind) = rest.split_once(']')?;
    if behind.contains('[') || name.ends_with("..") {
        return None;
    }
    let indices: Result<Vec<u32>, _> = indices.split(',').map(|index| index.trim().parse()).collect();
    Some((before, indices.ok()?, behind))
}

/// Divisions into odd numbers of parts: buffers that change roles with each round then do so from step to step.
pub(super) fn divisions(graph: &StepGraph, most: u32) -> Vec<Division> {
    let states = graph.states.ids().map(|state| split(&graph.names.states[state]).map(|(_, indices, _)| indices));
    let Some(indices) = states.collect::<Option<Vec<_>>>() else { return Vec::new() };
    let Some(places) = indices.iter().map(Vec::len).min() else { return Vec::new() };
    let mut divisions = Vec::new();
    for place in 0..places {
        let values: BTreeSet<u32> = indices.iter().map(|indices| indices[place]).collect();
        let (Some(&first), Some(&last)) = (values.first(), values.last()) else { continue };
        let count = number(values.len());
        if last - first + 1 != count {
            continue;
        }
        let of = |parts: u32| Division { place, first, each: count / parts, parts };
        let parts = (3..=count.min(most)).step_by(2).filter(|parts| count.is_multiple_of(*parts));
        divisions.extend(parts.map(of));
    }
    divisions
}

/// Equations that read the same.
#[derive(Default)]
struct Same {
    /// Their kinds: one more than a part has met has the next.
    kinds: Vec<u32>,
    /// How many of them each part has so far.
    met: HashMap<u32, usize>,
}

/// For each equation its part, and the equation of the first part that it may be like; none if some equation has no part, or no
/// like.
pub(super) fn alike(graph: &StepGraph, division: &Division) -> Option<List<EquationId, (u32, EquationId)>> {
    let mut found: List<EquationId, Option<(u32, u32)>> = List::filled(None, graph.equations.len());
    let mut by_name: HashMap<(&str, Vec<u32>, &str), u32> = HashMap::new();
    let mut kinds = 0u32;
    let mut next = || {
        kinds += 1;
        kinds - 1
    };
    for (equation, info) in graph.equations.numbered() {
        let Some((before, mut indices, behind)) = split(&info.name) else { continue };
        let index = indices.get(division.place)?.checked_sub(division.first)?;
        indices[division.place] = index % division.each;
        let kind = *by_name.entry((before, indices, behind)).or_insert_with(&mut next);
        found[equation] = Some((index / division.each, kind));
    }
    // What has no such name is told by what it reads.
    let mut chains_of: List<EquationId, Vec<ChainId>> = List::filled(Vec::new(), graph.equations.len());
    for (index, chain) in graph.chains.numbered() {
        chains_of[chain.equation].push(index);
    }
    let mut places: Vec<u32> = vec![0; graph.values.len()];
    let mut counted: List<EquationId, u32> = List::filled(0, graph.equations.len());
    for (place, value) in places.iter_mut().zip(&graph.values) {
        let count = &mut counted[value.equation?];
        *place = *count;
        *count += 1;
    }
    let mut by_reads: HashMap<Vec<u64>, Same> = HashMap::new();
    let mut open: Vec<EquationId> = graph.equations.ids().filter(|equation| found[*equation].is_none()).collect();
    while !open.is_empty() {
        let before = open.len();
        let mut left = Vec::new();
        for equation in open {
            let Some((part, reads)) = read(graph, &chains_of[equation], &places, &found, equation) else {
                left.push(equation);
                continue;
            };
            // Those that read the same are told apart by their order.
            let same = by_reads.entry(reads).or_default();
            let place = same.met.entry(part).or_default();
            if *place == same.kinds.len() {
                same.kinds.push(next());
            }
            let kind = same.kinds[*place];
            *place += 1;
            found[equation] = Some((part, kind));
        }
        if left.len() == before {
            return None;
        }
        open = left;
    }
    let mut members: Vec<Vec<Option<EquationId>>> = vec![vec![None; at(division.parts)]; at(kinds)];
    for (equation, found) in found.numbered() {
        let (part, kind) = (*found)?;
        let member = &mut members[at(kind)][at(part)];
        if member.replace(equation).is_some() {
            return None;
        }
    }
    if members.iter().flatten().any(Option::is_none) {
        return None;
    }
    found.iter().map(|found| found.and_then(|(part, kind)| Some((part, members[at(kind)][0]?)))).collect()
}

/// The part of an equation, and what its chains read and write; none as long as something that it reads has no part, or parts
/// differ.
fn read(
    graph: &StepGraph,
    chains: &[ChainId],
    places: &[u32],
    found: &List<EquationId, Option<(u32, u32)>>,
    equation: EquationId,
) -> Option<(u32, Vec<u64>)> {
    let mut part = None;
    let mut reads = Vec::new();
    let mut value = |id: ValueId, reads: &mut Vec<u64>| {
        let info = graph.value(id);
        let of = info.equation?;
        let kind = if of == equation {
            u64::MAX
        } else {
            let (other, kind) = found[of]?;
            if *part.get_or_insert(other) != other {
                return None;
            }
            u64::from(kind)
        };
        reads.extend([kind, u64::from(places[id.index()])]);
        if let Role::Column(lookup, column) = info.role {
            reads.extend([u64::from(graph.functions.lookups[at(lookup)].table), u64::from(column)]);
        }
        Some(())
    };
    for chain in chains {
        let chain = &graph.chains[*chain];
        reads.push(u64::from(chain.len()));
        for term in graph.chain_terms(chain) {
            value(term.operand, &mut reads)?;
            match term.factor {
                Factor::Value(factor) => value(factor, &mut reads)?,
                Factor::Coefficient(_) => {}
            }
        }
        for write in chain.writes() {
            value(write.value, &mut reads)?;
            if let Some(base) = write.base {
                value(base, &mut reads)?;
            }
        }
    }
    Some((part?, reads))
}
