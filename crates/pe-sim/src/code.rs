//! A step graph as flat arrays: what the inner loops of the runs walk over.

use std::ops::Range;

use pe_ir::graph::{Factor, StepGraph, ValueId};

/// A write with the slot of a zero in place of a missing base.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WriteCode {
    pub value: u32,
    pub base: u32,
    pub weight: i32,
}

/// A chain: products with coefficients, then products of two values, then writes.
#[derive(Clone, Debug)]
pub(crate) struct ChainCode {
    /// The chain's index in the graph.
    pub index: u32,
    pub coefficients: Range<u32>,
    pub factors: Range<u32>,
    pub write: WriteCode,
    pub second: Option<WriteCode>,
}

/// The whole step. Slot `zero` lies behind all values.
#[derive(Clone, Debug)]
pub(crate) struct Code {
    pub chains: Vec<ChainCode>,
    /// Operand slot of each product, in the order of the chains' ranges.
    pub operands: Vec<u32>,
    /// Slot of the second factor; `zero` for products with coefficients.
    pub factors: Vec<u32>,
    /// Term of the graph that each product comes from.
    pub terms: Vec<u32>,
    pub zero: u32,
}

impl Code {
    pub fn new(graph: &StepGraph) -> Code {
        let zero = graph.values.len() as u32;
        let count = graph.terms.len();
        let mut code = Code {
            chains: Vec::with_capacity(graph.chains.len()),
            operands: Vec::with_capacity(count),
            factors: Vec::with_capacity(count),
            terms: Vec::with_capacity(count),
            zero,
        };
        let write = |write: &pe_ir::graph::Write| WriteCode {
            value: write.value.0,
            base: write.base.map_or(zero, |base| base.0),
            weight: write.weight,
        };
        for index in execution_order(graph) {
            let chain = &graph.chains[index as usize];
            let start = code.operands.len() as u32;
            for with_factor in [false, true] {
                for index in chain.terms.clone() {
                    let term = &graph.terms[index as usize];
                    let factor = match term.factor {
                        Factor::Coefficient(_) => None,
                        Factor::Value(value) => Some(value.0),
                    };
                    if factor.is_some() == with_factor {
                        code.operands.push(term.operand.0);
                        code.factors.push(factor.unwrap_or(zero));
                        code.terms.push(index);
                    }
                }
            }
            let end = code.operands.len() as u32;
            let split = (start..end).find(|i| code.factors[*i as usize] != zero).unwrap_or(end);
            code.chains.push(ChainCode {
                index,
                coefficients: start..split,
                factors: split..end,
                write: write(&chain.write),
                second: chain.second.as_ref().map(write),
            });
        }
        code
    }
}

/// Chains level by level of their dependencies, within a level by shape: loops of equal length follow one another, so
/// that the processor predicts their ends.
fn execution_order(graph: &StepGraph) -> Vec<u32> {
    let producers = graph.producers();
    let mut level = vec![0u32; graph.chains.len()];
    for (index, chain) in graph.chains.iter().enumerate() {
        let mut own = 0;
        let mut read = |value: ValueId| {
            if let Some(producer) = level.get(producers[value.index()] as usize) {
                own = own.max(producer + 1);
            }
        };
        for term in graph.chain_terms(chain) {
            read(term.operand);
            if let Factor::Value(value) = term.factor {
                read(value);
            }
        }
        chain.writes().filter_map(|write| write.base).for_each(&mut read);
        level[index] = own;
    }
    let mut order: Vec<u32> = (0..graph.chains.len() as u32).collect();
    order.sort_by_key(|index| {
        let chain = &graph.chains[*index as usize];
        let factors = graph.chain_terms(chain).iter().filter(|t| matches!(t.factor, Factor::Value(_))).count();
        (level[*index as usize], chain.len(), factors, chain.second.is_some())
    });
    order
}
