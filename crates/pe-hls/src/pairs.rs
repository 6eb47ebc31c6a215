//! Pairs of operands with equal coefficients: `a x + a y` as one product `a (x + y)` of the multiplier's pre-adder.
//!
//! If both operands have one binary point, coefficient and sum are the same integers either way, so pairs change no
//! result: formats decide which operands may be paired, the mapping decides which are. One operand of a pair comes from
//! the own memory, the other from the imported memory. Where a PE computes both, it sends one of them to itself.

use std::collections::{BTreeMap, BinaryHeap};

use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StepGraph, Term, ValueId};
use pe_ir::index::{ChainId, at, number};
use pe_ir::mapping::Mapping;

/// Pairs must save one product of so many; otherwise the formats keep their bit.
const WORTHWHILE: u64 = 32;

/// A mapped step graph with its pairs, and its numbers.
pub struct Paired {
    /// The graph: a term per product.
    pub graph: StepGraph,
    /// Formats and coefficients of its terms.
    pub fixed: FixedPoint,
    /// Pairs per step.
    pub pairs: u64,
    /// Values that a PE sends to itself.
    pub sent_home: u64,
}

/// Whether operands with equal coefficients are frequent enough to give a bit of their formats for them.
pub fn worthwhile(graph: &StepGraph) -> bool {
    let saved: u32 = graph
        .chains
        .iter()
        .map(|chain| equal_coefficients(graph, chain).map(|class| number(class.len()) / 2).sum::<u32>())
        .sum();
    are_worthwhile(saved, number(graph.terms.len()))
}

/// Whether pairs save enough of so many products.
pub fn are_worthwhile(saved: u32, products: u32) -> bool {
    u64::from(saved) * WORTHWHILE >= u64::from(products) && saved > 0
}

/// Operands of a chain that have the same coefficient, in groups of at least two.
pub fn equal_coefficients(graph: &StepGraph, chain: &Chain) -> impl Iterator<Item = Vec<ValueId>> + use<> {
    let mut classes: BTreeMap<u64, Vec<ValueId>> = BTreeMap::new();
    for term in graph.chain_terms(chain) {
        if let Factor::Coefficient(coefficient) = term.factor
            && coefficient != 0.0
            && can_be_paired(graph, term.operand)
        {
            classes.entry(coefficient.to_bits()).or_default().push(term.operand);
        }
    }
    classes.into_values().filter(|class| class.len() > 1)
}

/// Inputs keep the full scale of their ports, and constants belong to one memory.
fn can_be_paired(graph: &StepGraph, operand: ValueId) -> bool {
    !matches!(graph.value(operand).role, Role::Input(_) | Role::Constant(_))
}

/// The graph as it would be if all operands with equal coefficients were paired: what a mapping may count on. `None` if
/// there is no pair.
pub fn optimistic(graph: &StepGraph, fixed: &FixedPoint) -> Option<StepGraph> {
    let pairs = |members: &[u32]| members.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
    merge(graph, fixed, &mut |_, members| pairs(members)).map(|paired| paired.graph)
}

/// Pairs operands under a mapping. `None` if there is no pair.
pub fn pair(graph: &StepGraph, fixed: &FixedPoint, mapping: &Mapping) -> Option<Paired> {
    if !graph.pre_adder {
        return None;
    }
    let home = |value: ValueId| graph.value(value).equation.map(|equation| mapping.pe_of[equation]);
    let local = |chain: &Chain, term: u32| home(graph.terms[at(term)].operand) == Some(mapping.pe_of[chain.equation]);
    let sent_home = sent_home(graph, fixed, &local);
    let mut paired = merge(graph, fixed, &mut |chain, members| {
        let (mut own, mut imported): (Vec<u32>, Vec<u32>) = members.iter().partition(|term| local(chain, **term));
        let wanted = own.len().saturating_sub(imported.len()) / 2;
        let is_sent = |term: &u32| sent_home[graph.terms[at(*term)].operand.index()];
        let (sent, rest): (Vec<u32>, Vec<u32>) = own.iter().partition(|term| is_sent(term));
        debug_assert!(sent.len() >= wanted);
        imported.extend(&sent[..wanted]);
        own = rest.into_iter().chain(sent[wanted..].iter().copied()).collect();
        own.into_iter().zip(imported).collect()
    })?;
    paired.sent_home = sent_home.iter().filter(|sent| **sent).count() as u64;
    Some(paired)
}

/// Values that their own PE needs in its imported memory, chosen so that few serve all chains: greedily the one that
/// most chains lack.
fn sent_home(graph: &StepGraph, fixed: &FixedPoint, local: &impl Fn(&Chain, u32) -> bool) -> Vec<bool> {
    // Operands of which so many are still to be sent home.
    let mut lacks: Vec<(Vec<u32>, usize)> = Vec::new();
    let mut lacking: Vec<Vec<u32>> = vec![Vec::new(); graph.values.len()];
    for (index, chain) in graph.chains.numbered() {
        for members in classes(graph, fixed, index) {
            let (own, imported): (Vec<u32>, Vec<u32>) = members.iter().partition(|term| local(chain, **term));
            let wanted = own.len().saturating_sub(imported.len()) / 2;
            if wanted > 0 {
                let own: Vec<u32> = own.iter().map(|term| graph.terms[at(*term)].operand.number()).collect();
                own.iter().for_each(|value| lacking[at(*value)].push(number(lacks.len())));
                lacks.push((own, wanted));
            }
        }
    }
    let mut count: Vec<u32> = lacking.iter().map(|lacks| number(lacks.len())).collect();
    let entry = |value: usize, count: u32| (count, std::cmp::Reverse(number(value)));
    let mut heap: BinaryHeap<(u32, std::cmp::Reverse<u32>)> =
        count.iter().enumerate().filter(|(_, count)| **count > 0).map(|(value, count)| entry(value, *count)).collect();
    let mut sent = vec![false; graph.values.len()];
    while let Some((claimed, std::cmp::Reverse(value))) = heap.pop() {
        let value = at(value);
        if sent[value] || count[value] == 0 {
            continue;
        }
        if claimed != count[value] {
            heap.push(entry(value, count[value]));
            continue;
        }
        sent[value] = true;
        for lack in &lacking[value] {
            let (own, wanted) = &mut lacks[at(*lack)];
            if *wanted > 0 {
                *wanted -= 1;
                if *wanted == 0 {
                    own.iter().for_each(|value| count[at(*value)] -= 1);
                }
            }
        }
    }
    sent
}

/// Terms of a chain that may be paired with one another: one coefficient, one binary point, half of full scale.
pub(crate) fn classes(graph: &StepGraph, fixed: &FixedPoint, chain: ChainId) -> Vec<Vec<u32>> {
    let mut classes: BTreeMap<(i64, i32), Vec<u32>> = BTreeMap::new();
    for index in graph.chains[chain].terms.clone() {
        let term = &graph.terms[at(index)];
        let operand = term.operand.index();
        let coefficient = fixed.coefficients[at(index)];
        if matches!(term.factor, Factor::Coefficient(_))
            && coefficient != 0
            && fixed.half_scale[operand]
            && can_be_paired(graph, term.operand)
        {
            classes.entry((coefficient, fixed.exponents[operand])).or_default().push(index);
        }
    }
    classes.into_values().filter(|class| class.len() > 1).collect()
}

/// Merges the pairs that `choose` makes of each class of terms. `None` if it makes none.
fn merge(
    graph: &StepGraph,
    fixed: &FixedPoint,
    choose: &mut impl FnMut(&Chain, &[u32]) -> Vec<(u32, u32)>,
) -> Option<Paired> {
    if !graph.pre_adder {
        return None;
    }
    let mut partner: Vec<Option<ValueId>> = vec![None; graph.terms.len()];
    let mut merged = vec![false; graph.terms.len()];
    let mut pairs = 0;
    for (index, chain) in graph.chains.numbered() {
        for members in classes(graph, fixed, index) {
            for (own, imported) in choose(chain, &members) {
                partner[at(own)] = Some(graph.terms[at(imported)].operand);
                merged[at(imported)] = true;
                pairs += 1;
            }
        }
    }
    if pairs == 0 {
        return None;
    }
    let mut terms: Vec<Term> = Vec::with_capacity(graph.terms.len());
    let mut coefficients = Vec::with_capacity(graph.terms.len());
    let mut chains = graph.chains.clone();
    for chain in &mut chains {
        let start = number(terms.len());
        for index in chain.terms.clone().map(at).filter(|term| !merged[*term]) {
            terms.push(Term { partner: partner[index], ..graph.terms[index] });
            coefficients.push(fixed.coefficients[index]);
        }
        chain.terms = start..terms.len() as u32;
    }
    Some(Paired {
        graph: graph.with_chains(chains, terms),
        fixed: FixedPoint { coefficients, ..fixed.clone() },
        pairs,
        sent_home: 0,
    })
}
