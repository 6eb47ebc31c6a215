//! Quotients: what is divided is shifted by the exponent of the divisor before it is multiplied.
//!
//! The reciprocal of a divisor of many octaves has few bits where it is small, and there what is divided is large. Where all
//! readers of a reciprocal multiply by it, `a/b` is `(a*scale)*g` with the value `g` of one octave, which has all its bits; see
//! `docs/decisions/0104-exponents-of-arguments.md`.

use std::collections::{BTreeMap, BTreeSet};

use pe_ir::graph::{Chain, Factor, Role, StepGraph, ValueId};
use pe_ir::index::{ChainId, List};

use super::expand::Computed;

/// Products with a reciprocal, at most: each takes two words, where the reciprocal and its copy take one each.
const MOST_PRODUCTS: usize = 2;

/// The functions of a step of which only quotients are computed.
#[derive(Default)]
pub(super) struct Quotients {
    /// By function that is computed, whether it is one of them.
    taken: Vec<bool>,
    /// Values that stand for one of their values, and how many times it they are: itself, or a copy for the coefficient
    /// port.
    copies: BTreeMap<ValueId, (ValueId, f64)>,
}

impl Quotients {
    /// Those of a step; values that are `kept` are needed themselves.
    pub fn of(
        graph: &StepGraph,
        (computed, computed_of): (&[Computed], &List<ChainId, Option<usize>>),
        kept: &[ValueId],
    ) -> Quotients {
        let mut of_value: BTreeMap<ValueId, usize> = BTreeMap::new();
        // Values that something reads in another way.
        let ends = graph.states.iter().map(|(_, end)| *end);
        let mut needed: BTreeSet<ValueId> =
            ends.chain(graph.outputs.iter().copied()).chain(kept.iter().copied()).collect();
        for (chain, of) in graph.chains.iter().zip(computed_of) {
            let Some(of) = of.filter(|of| computed[*of].is_divisor()) else { continue };
            of_value.insert(chain.write.value, of);
            // Pivots of linear systems are looked at by their values.
            if !matches!(graph.value(chain.write.value).role, Role::Algebraic(..) | Role::Inner(..)) {
                needed.insert(chain.write.value);
            }
        }
        if of_value.is_empty() {
            return Quotients::default();
        }
        let mut copies: BTreeMap<ValueId, (ValueId, f64)> =
            of_value.keys().filter(|value| graph.value(**value).factor).map(|value| (*value, (*value, 1.0))).collect();
        copies.extend(graph.chains.iter().filter_map(|chain| {
            let (value, times) = copy(graph, chain)?;
            of_value.contains_key(&value).then_some((chain.write.value, (value, times)))
        }));
        let mut products: BTreeMap<ValueId, usize> = BTreeMap::new();
        for chain in &graph.chains {
            needed.extend(chain.writes().filter_map(|write| write.base));
            for term in graph.chain_terms(chain) {
                if copy(graph, chain).is_none() {
                    needed.extend(term.operands());
                }
                let Factor::Value(factor) = term.factor else { continue };
                if term.partner.is_none() && travels(graph, term.operand) && chain.function.is_none() {
                    *products.entry(factor).or_default() += 1;
                } else {
                    needed.insert(factor);
                }
            }
        }
        let mut count: BTreeMap<ValueId, usize> = BTreeMap::new();
        for (copied, (value, _)) in &copies {
            *count.entry(*value).or_default() += products.get(copied).copied().unwrap_or(0);
            if needed.contains(copied) {
                needed.insert(*value);
            }
        }
        let mut taken = vec![true; computed.len()];
        for (value, of) in &of_value {
            let is_one = |count: &usize| (1..=MOST_PRODUCTS).contains(count);
            taken[*of] &= !needed.contains(value) && count.get(value).is_some_and(is_one);
        }
        for (taken, computed) in taken.iter_mut().zip(computed) {
            *taken &= computed.is_divisor();
        }
        copies.retain(|_, (value, _)| taken[of_value[value]]);
        Quotients { taken, copies }
    }

    /// Whether only quotients are computed of a function.
    pub fn has(&self, computed: usize) -> bool {
        self.taken.get(computed).is_some_and(|taken| *taken)
    }

    /// The value that a factor stands for, and how many times it that is.
    pub fn copied(&self, factor: ValueId) -> Option<(ValueId, f64)> {
        self.copies.get(&factor).copied()
    }
}

/// The value that a chain copies for the coefficient port, and how many times it the copy is.
fn copy(graph: &StepGraph, chain: &Chain) -> Option<(ValueId, f64)> {
    let [term] = graph.chain_terms(chain) else { return None };
    let Factor::Coefficient(number) = term.factor else { return None };
    let zero = |base: ValueId| matches!(graph.value(base).role, Role::Constant(0.0));
    let is_copy = graph.value(chain.write.value).factor
        && chain.write.base.is_none_or(zero)
        && (&chain.second, &chain.interim, chain.function, term.partner) == (&None, &None, None, None);
    is_copy.then(|| (term.operand, libm::scalbn(number, chain.write.weight)))
}

/// Whether any equation can read a value.
fn travels(graph: &StepGraph, value: ValueId) -> bool {
    matches!(
        graph.value(value).role,
        Role::State(_) | Role::Stage(..) | Role::Next(_) | Role::Algebraic(..) | Role::Auxiliary(_)
    )
}
