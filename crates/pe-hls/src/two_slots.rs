//! Coefficients in two slots: what the coefficient port does not see of a coefficient becomes a product of its own.
//!
//! A narrow coefficient port rounds every coefficient, and mostly that rounding is nearly all of the word-length error.
//! Here a chain `v := base + sum c_i x_i` becomes two. The first sums `(c_i - q_i) x_i`, where `q_i` is what the port
//! sees of `c_i`, on a product point of its own, and adds the base; the second adds `sum q_i x_i` to the first one's
//! result. Both are ordinary chains, so nothing behind the step graph knows of it: one multiplier with a port of 18
//! bits computes with coefficients of about 35, at up to twice the products.

use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{self, ChainId, List, at};

/// Bits that the first slot leaves unused. A value whose range is widened later takes a bit of its chains' coefficients;
/// with a bit to spare the seen part stays exact.
const SPARE_BITS: i32 = 1;

/// Part of the LSB of the written word below which the rest of a product is not worth a slot.
const NEGLIGIBLE: f64 = 1.0 / 16.0;

/// The graph with coefficients in two slots where the rest of one can be seen in what its chain writes; `fixed` are its
/// formats. None if no chain has such a rest.
pub fn split(graph: &StepGraph, fixed: &FixedPoint) -> Option<StepGraph> {
    let mut split = graph.with_chains(List::with_capacity(graph.chains.len()), Vec::with_capacity(graph.terms.len()));
    let mut serial = List::filled(0u32, graph.equations.len());
    for (index, chain) in graph.chains.numbered() {
        let parts: Vec<(Term, Option<Term>)> =
            chain.terms.clone().map(|term| part(graph, fixed, index, term)).collect();
        let rests: Vec<Term> = parts.iter().filter_map(|(_, rest)| *rest).collect();
        if rests.is_empty() || !can_split(graph, chain) {
            add(&mut split, chain.clone(), graph.chain_terms(chain).to_vec());
            continue;
        }
        let mut fine = |write: &Write| {
            let serial = &mut serial[chain.equation];
            *serial += 1;
            let value = ValueId::at(split.values.len());
            let role = Role::Partial(chain.equation, FIRST_SERIAL + *serial);
            split.values.push(Value { role, equation: Some(chain.equation), factor: false });
            (Write { value, ..*write }, Write { base: Some(value), ..*write })
        };
        let (first, then) = fine(&chain.write);
        let second = chain.second.as_ref().map(fine);
        let rest = Chain { write: first, second: second.map(|(first, _)| first), ..chain.clone() };
        let seen = Chain { write: then, second: second.map(|(_, then)| then), ..chain.clone() };
        add(&mut split, rest, rests);
        add(&mut split, seen, parts.into_iter().map(|(seen, _)| seen).collect());
    }
    (split.terms.len() > graph.terms.len()).then_some(split)
}

/// Serial numbers of the values here, after those of partial sums, which have names of the same kind.
const FIRST_SERIAL: u32 = 1 << 16;

/// Whether a graph has coefficients in two slots.
pub fn used(graph: &StepGraph) -> bool {
    graph.values.iter().any(|value| matches!(value.role, Role::Partial(_, serial) if serial > FIRST_SERIAL))
}

/// Functions are applied to a whole sum, and a factor is read by the narrow port again.
fn can_split(graph: &StepGraph, chain: &Chain) -> bool {
    let column = |write: &Write| {
        write.base.is_some_and(|base| matches!(graph.value(base).role, Role::Column(..)))
            || graph.value(write.value).factor
    };
    chain.function.is_none() && chain.interim.is_none() && !chain.writes().any(column)
}

/// A term with what its port sees of the coefficient, and one with the rest if it can be seen in the result.
fn part(graph: &StepGraph, fixed: &FixedPoint, chain: ChainId, term: u32) -> (Term, Option<Term>) {
    let whole = graph.terms[at(term)];
    let Factor::Coefficient(coefficient) = whole.factor else { return (whole, None) };
    let operand = fixed.exponents[whole.operand.index()];
    let unit = fixed.products[chain] + SPARE_BITS - operand - fixed.format.data_drop() as i32;
    let seen = libm::scalbn(libm::round(libm::scalbn(coefficient, -unit)), unit);
    let rest = coefficient - seen;
    let largest = libm::scalbn(rest.abs(), operand + fixed.format.word_bits() as i32 - 1);
    let visible = |write: &Write| {
        let lsb = fixed.exponents[write.value.index()] - write.weight;
        largest > NEGLIGIBLE * libm::scalbn(1.0, lsb)
    };
    if rest == 0.0 || !graph.chains[chain].writes().any(visible) {
        // Without a second slot the port gives all of its bits to the first.
        return (whole, None);
    }
    let with = |number: f64| Term { factor: Factor::Coefficient(number), ..whole };
    (with(seen), Some(with(rest)))
}

fn add(graph: &mut StepGraph, chain: Chain, terms: Vec<Term>) {
    let first = index::number(graph.terms.len());
    graph.terms.extend(terms);
    graph.chains.push(Chain { terms: first..graph.terms.len() as u32, ..chain });
}
