//! Rounds of parts: what one part of a step computes, scheduled once for all of them.

use std::borrow::Cow;
use std::collections::BTreeMap;

use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{ChainId, EquationId, List, PeId, StateId, at, number};
use pe_ir::mapping::Mapping;
use pe_ir::parts::Parts;
use pe_ir::schedule::Transfer;

use super::Rounds;
use crate::parts::Likes;

/// Which parts the values of a step belong to, and the equations of one of them.
#[derive(Clone, Debug, Default)]
pub(super) struct Turns {
    /// For each value of the step its part.
    of: Vec<u32>,
    /// For each equation of the step that of a single part which it is like.
    likes: List<EquationId, EquationId>,
    /// For each equation of a part one of the step that it stands for.
    equations: List<EquationId, EquationId>,
    /// The same of terms, whose numbers are those of one part.
    terms: Vec<u32>,
}

/// Numbers of what is in the first part.
struct Numbers {
    equations: List<EquationId, Option<EquationId>>,
    values: Vec<Option<ValueId>>,
    states: List<StateId, Option<StateId>>,
    lookups: Vec<Option<u32>>,
}

/// A number for each item that is in the first part, from 0 on.
fn numbered<T>(is_first: impl Iterator<Item = bool>, new: fn(u32) -> T) -> Vec<Option<T>> {
    let mut count = 0..;
    is_first.map(|is_first| if is_first { count.next().map(new) } else { None }).collect()
}

impl Numbers {
    fn of(graph: &StepGraph, likes: &Likes) -> Numbers {
        let first = |value: ValueId| likes.values[value.index()].0 == 0;
        let all = (0..graph.values.len()).map(ValueId::at);
        Numbers {
            equations: numbered(graph.parts.of.iter().map(|(part, _)| *part == 0), EquationId::new).into(),
            values: numbered(all.map(first), ValueId::new),
            states: numbered(graph.states.iter().map(|(start, _)| first(*start)), StateId::new).into(),
            lookups: numbered(graph.functions.lookups.iter().map(|lookup| first(lookup.argument)), |lookup| lookup),
        }
    }

    fn value(&self, value: ValueId) -> Option<ValueId> {
        self.values[value.index()]
    }

    fn role(&self, role: Role) -> Option<Role> {
        Some(match role {
            Role::State(state) => Role::State(self.states[state]?),
            Role::Next(state) => Role::Next(self.states[state]?),
            Role::Inner(equation, serial) => Role::Inner(self.equations[equation]?, serial),
            Role::Partial(equation, serial) => Role::Partial(self.equations[equation]?, serial),
            Role::Column(lookup, column) => Role::Column(self.lookups[at(lookup)]?, column),
            Role::Algebraic(..) | Role::Constant(_) | Role::Auxiliary(_) => role,
            _ => return None,
        })
    }
}

impl Rounds<'_> {
    /// The rounds of a step whose parts are alike, in their formats, too; their coefficients may differ.
    pub fn of_parts(graph: &StepGraph, fixed: &FixedPoint) -> Option<Rounds<'static>> {
        let likes = Likes::of(graph)?;
        let formats = (0..).zip(&likes.values).all(|(value, (_, like))| {
            let like = like.index();
            fixed.exponents[value] == fixed.exponents[like] && fixed.half_scale[value] == fixed.half_scale[like]
        });
        let sums = likes.chains.numbered().all(|(chain, (_, like))| {
            fixed.products[chain] == fixed.products[*like] && fixed.shifts[chain] == fixed.shifts[*like]
        });
        if !formats || !sums || !likes.same_terms(graph) {
            return None;
        }
        let numbers = Numbers::of(graph, &likes);
        let mut terms: Vec<Term> = Vec::new();
        let mut chains: List<ChainId, Chain> = List::new();
        let mut numbered: List<ChainId, Option<ChainId>> = List::with_capacity(graph.chains.len());
        let mut from: Vec<u32> = Vec::new();
        let like = |value: ValueId| numbers.value(likes.values[value.index()].1);
        let write = |write: &Write| {
            let base = match write.base {
                Some(base) => Some(like(base)?),
                None => None,
            };
            Some(Write { value: like(write.value)?, base, weight: write.weight })
        };
        for (index, chain) in graph.chains.numbered() {
            if likes.chains[index].0 != 0 {
                numbered.push(None);
                continue;
            }
            let begin = number(terms.len());
            for (term, place) in graph.chain_terms(chain).iter().zip(chain.terms.clone()) {
                let factor = match term.factor {
                    Factor::Value(value) => Factor::Value(like(value)?),
                    coefficient @ Factor::Coefficient(_) => coefficient,
                };
                terms.push(Term::new(like(term.operand)?, factor));
                from.push(place);
            }
            let chain = Chain {
                equation: numbers.equations[chain.equation]?,
                terms: begin..number(terms.len()),
                interim: chain.interim.as_ref().and_then(write),
                write: write(&chain.write)?,
                second: chain.second.as_ref().and_then(write),
                function: None,
            };
            numbered.push(Some(chains.push(chain)));
        }
        let firsts = |value: &(usize, &Value)| numbers.values[value.0].is_some();
        let values: Option<Vec<Value>> = (graph.values.iter().enumerate().filter(firsts))
            .map(|(_, value)| {
                let equation = numbers.equations[value.equation?]?;
                Some(Value { role: numbers.role(value.role)?, equation: Some(equation), ..*value })
            })
            .collect();
        let originals = (0..graph.values.len()).map(ValueId::at).filter(|value| numbers.value(*value).is_some());
        let equations: List<EquationId, EquationId> =
            graph.equations.ids().filter(|equation| numbers.equations[*equation].is_some()).collect();
        let mut functions = graph.functions.clone();
        functions.lookups = Vec::new();
        for lookup in &graph.functions.lookups {
            if let Some(argument) = numbers.value(lookup.argument) {
                functions.lookups.push(pe_ir::functions::Lookup { argument, ..*lookup });
            }
        }
        let states: Vec<StateId> = graph.states.ids().filter(|state| numbers.states[*state].is_some()).collect();
        let pair = |state: &StateId| {
            let (start, end) = graph.states[*state];
            Some((numbers.value(start)?, numbers.value(end)?))
        };
        let mut round = StepGraph {
            pre_adder: false,
            equations: equations.iter().map(|equation| graph.equations[*equation].clone()).collect(),
            values: values?,
            states: states.iter().map(pair).collect::<Option<Vec<_>>>()?.into(),
            initial: states.iter().map(|state| graph.initial[*state]).collect(),
            outputs: graph.outputs.iter().map(|value| like(*value)).collect::<Option<_>>()?,
            functions,
            parts: Parts { count: likes.count, of: List::new() },
            ..graph.with_chains(chains, terms)
        };
        round.names.states = states.iter().map(|state| graph.names.states[*state].clone()).collect();
        let swaps = |value: &Value| u32::from(matches!(value.role, Role::Next(_)));
        let of_value = |(value, (_, first)): (&Value, &(u32, ValueId))| Some((numbers.value(*first)?, swaps(value)));
        let of_chain = |(part, like): &(u32, ChainId)| Some((*part, numbered[*like]?));
        Some(Rounds {
            count: likes.count,
            chains: likes.chains.iter().map(of_chain).collect::<Option<Vec<_>>>()?.into(),
            values: graph.values.iter().zip(&likes.values).map(of_value).collect::<Option<_>>()?,
            originals: originals.collect(),
            base_last: false,
            sums: false,
            turns: Turns {
                of: likes.values.iter().map(|(part, _)| *part).collect(),
                likes: (graph.parts.of.iter().map(|(_, like)| numbers.equations[*like]))
                    .collect::<Option<Vec<_>>>()?
                    .into(),
                equations,
                terms: from,
            },
            graph: Cow::Owned(round),
        })
    }

    /// Whether each round is that of another part.
    pub fn are_parts(&self) -> bool {
        !self.turns.of.is_empty()
    }

    /// The part of a value of the step; the first one if all rounds are of the whole step.
    pub fn part(&self, value: ValueId) -> u32 {
        self.turns.of.get(value.index()).copied().unwrap_or(0)
    }

    /// The formats of one part of the step.
    pub fn formats_of_part(&self, fixed: &FixedPoint) -> FixedPoint {
        let mut first = List::filled(ChainId::new(0), self.graph.chains.len());
        for (chain, (part, like)) in self.chains.numbered() {
            if *part == 0 {
                first[*like] = chain;
            }
        }
        let originals = || self.originals.iter().map(|value| value.index());
        let of_chains = || first.iter().copied();
        FixedPoint {
            format: fixed.format,
            exponents: originals().map(|value| fixed.exponents[value]).collect(),
            half_scale: originals().map(|value| fixed.half_scale[value]).collect(),
            coefficients: self.turns.terms.iter().map(|term| fixed.coefficients[at(*term)]).collect(),
            products: of_chains().map(|chain| fixed.products[chain]).collect(),
            shifts: of_chains().map(|chain| fixed.shifts[chain]).collect(),
            accumulator_bits: of_chains().map(|chain| fixed.accumulator_bits[chain]).collect(),
        }
    }

    /// The mapping of the step from that of a part.
    pub fn spread(&self, part: &Mapping) -> Mapping {
        Mapping { pes: part.pes, pe_of: self.turns.likes.iter().map(|like| part.pe_of[*like]).collect() }
    }

    /// The mapping of what one round computes.
    pub fn mapping<'m>(&self, step: &'m Mapping) -> Cow<'m, Mapping> {
        if !self.are_parts() {
            return Cow::Borrowed(step);
        }
        let pe_of = self.turns.equations.iter().map(|equation| step.pe_of[*equation]).collect();
        Cow::Owned(Mapping { pes: step.pes, pe_of })
    }

    /// Transfers of a step whose rounds are parts: those of a part in each of them.
    pub(super) fn unrolled_transfers(
        &self,
        length: u32,
        receives: &BTreeMap<ValueId, Vec<(PeId, u32)>>,
    ) -> Vec<Transfer> {
        let mut transfers = Vec::new();
        for (index, ((like, _), part)) in self.values.iter().zip(&self.turns.of).enumerate() {
            for (to, receive) in receives.get(like).into_iter().flatten() {
                transfers.push(Transfer { value: ValueId::at(index), to: *to, receive: part * length + receive });
            }
        }
        transfers.sort_unstable();
        transfers
    }
}
