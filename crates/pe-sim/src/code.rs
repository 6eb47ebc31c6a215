//! A step graph as flat arrays: what the inner loops of the runs walk over.

use std::ops::Range;

use pe_ir::graph::{Factor, StepGraph};

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
        for chain in &graph.chains {
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
                coefficients: start..split,
                factors: split..end,
                write: write(&chain.write),
                second: chain.second.as_ref().map(write),
            });
        }
        code
    }
}
