//! Cuts sums that the accumulator does not hold into partial sums of the same equation.
//!
//! A product of two variables takes the width of both ports, however the number formats are chosen, so a sum holds only
//! so many of them. What is beyond goes into partial sums, each with a number format of its own, which the sum reads with
//! the coefficient 1. The chains of all stages are cut alike. Products with coefficients stay: these can be coarser.

use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{EquationId, List, at, number};
use pe_ir::word::WordFormat;

/// Most products of two variables in a sum, so that it fits the accumulator whatever the operands are.
pub fn most_products(format: &WordFormat) -> u32 {
    // As many as stay below half of what the accumulator counts to, rounding included.
    let room = (format.accumulator_limit() + 1).saturating_sub(format.data_bits + format.coefficient_bits);
    ((1u64 << room.min(31)) - 1).max(1) as u32
}

/// Cuts all sums with more products of two variables than that; none if there is none.
pub fn cut(graph: &StepGraph, format: &WordFormat) -> Option<StepGraph> {
    let most = most_products(format);
    let long = |chain: &Chain| chain.len() > most && products(graph.chain_terms(chain)).count() > at(most);
    if !graph.chains.iter().any(long) {
        return None;
    }
    let mut serials: List<EquationId, u32> = List::filled(0, graph.equations.len());
    for value in &graph.values {
        if let Role::Inner(equation, serial) = value.role {
            let last = &mut serials[equation];
            *last = serial.max(*last);
        }
    }
    let mut done = StepGraph {
        chains: List::with_capacity(graph.chains.len()),
        terms: Vec::with_capacity(graph.terms.len()),
        ..graph.clone()
    };
    for chain in &graph.chains {
        let terms = graph.chain_terms(chain);
        if !long(chain) {
            add(&mut done, chain.clone(), terms);
            continue;
        }
        let equation = chain.equation;
        let far: Vec<Term> = products(terms).copied().collect();
        let pieces = far.len().div_ceil(at(most));
        let mut rest: Vec<Term> =
            terms.iter().filter(|term| matches!(term.factor, Factor::Coefficient(_))).copied().collect();
        for piece in 0..pieces {
            let own = &far[far.len() * piece / pieces..far.len() * (piece + 1) / pieces];
            serials[equation] += 1;
            let value = ValueId::at(done.values.len());
            let role = Role::Inner(equation, serials[equation]);
            done.values.push(Value { role, equation: Some(equation), factor: false });
            let write = Write { value, base: None, weight: 0 };
            add(&mut done, Chain { equation, terms: 0..0, interim: None, write, second: None, function: None }, own);
            rest.push(Term::new(value, Factor::Coefficient(1.0)));
        }
        add(&mut done, chain.clone(), &rest);
    }
    Some(done)
}

fn products(terms: &[Term]) -> impl Iterator<Item = &Term> {
    terms.iter().filter(|term| matches!(term.factor, Factor::Value(_)))
}

fn add(graph: &mut StepGraph, chain: Chain, terms: &[Term]) {
    let first = number(graph.terms.len());
    graph.terms.extend_from_slice(terms);
    graph.chains.push(Chain { terms: first..number(graph.terms.len()), ..chain });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn so_many_products_fit_and_one_more_does_not() {
        for (data, coefficient) in [(18, 18), (25, 18), (18, 25), (27, 18), (32, 32), (35, 35), (9, 9)] {
            let format = WordFormat::new(32, data, coefficient);
            let bits = |count: u32| {
                let largest = i128::from(count) << (data + coefficient - 2);
                (largest + 1).ilog2() + 2
            };
            let (most, limit) = (most_products(&format), format.accumulator_limit());
            assert!(bits(most) <= limit && bits(most + 1) > limit, "{data}x{coefficient}: {most} in {limit} bits");
        }
    }
}
