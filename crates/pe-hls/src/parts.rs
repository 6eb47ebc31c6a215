//! Finds parts of a step that are alike, such as slabs of a tissue, so that one program serves all of them.
//!
//! Equations that are elements of an array, or of an array of components, are numbered by an index. Where the equations of each
//! few values of that index are the same as those of the next few, each such part may take a round of control words.
//! Which equations are tried is a guess from names and from what equations read; [`Likes`] says what must be the same. A part
//! may read states of other parts as they were before the step. At a border there is nothing to read: a term with coefficient
//! zero stands for what the border lacks.

mod guess;

use std::collections::HashMap;

use pe_ir::graph::{Chain, Factor, Role, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{ChainId, EquationId, List, at, number};
use pe_ir::parts::Parts;
use pe_ir::pasts::Pasts;

/// Parts beyond this take turns in more ways than a variant memory has room for.
const MOST_PARTS: u32 = 31;

/// Words of a round that are aimed at: fewer save little memory, as blocks are not narrower, and leave PEs waiting.
const ROUND_WORDS: u64 = 1024;

/// Which equations, values and chains of a step are alike: each with its part, and the one of the first part that it is like.
pub struct Likes {
    /// Number of parts.
    pub count: u32,
    /// By value.
    pub values: Vec<(u32, ValueId)>,
    /// By chain.
    pub chains: List<ChainId, (u32, ChainId)>,
}

/// What a term multiplies, relative to the part of its chain: the operand as in the first part, how many parts further on it is,
/// the second factor if it is a value, and how many such terms came before.
type Product = (ValueId, i64, Option<ValueId>, u32);

impl Likes {
    /// Those of a step that says which equations are alike. None if values or chains are not: their kinds, formats apart, what
    /// they are written to, and what is added to what. Terms may differ.
    pub fn of(graph: &StepGraph) -> Option<Likes> {
        let Parts { count, of } = &graph.parts;
        if of.is_empty() || of.len() != graph.equations.len() {
            return None;
        }
        let mut values_of = List::filled(Vec::new(), graph.equations.len());
        for (index, value) in graph.values.iter().enumerate() {
            values_of[value.equation?].push(ValueId::at(index));
        }
        let mut chains_of = List::filled(Vec::new(), graph.equations.len());
        for (index, chain) in graph.chains.numbered() {
            chains_of[chain.equation].push(index);
        }
        let mut likes = Likes {
            count: *count,
            values: vec![(0, ValueId::new(0)); graph.values.len()],
            chains: List::filled((0, ChainId::new(0)), graph.chains.len()),
        };
        for (equation, (part, like)) in of.numbered() {
            let (own, first) = (&values_of[equation], &values_of[*like]);
            if own.len() != first.len() || chains_of[equation].len() != chains_of[*like].len() {
                return None;
            }
            for (value, like) in own.iter().zip(first) {
                likes.values[value.index()] = (*part, *like);
            }
            for (chain, like) in chains_of[equation].iter().zip(&chains_of[*like]) {
                likes.chains[*chain] = (*part, *like);
            }
        }
        let alike = graph.values.iter().zip(&likes.values).all(|(value, (_, like))| {
            same_kind(value, graph.value(*like)) && likes.same_lookup(graph, value, graph.value(*like))
        });
        let chains = graph.chains.numbered().all(|(index, chain)| {
            let (part, like) = likes.chains[index];
            likes.same_writes(chain, &graph.chains[like], part)
        });
        let states = graph.states.iter().all(|(start, end)| {
            let ((part, start), (other, end)) = (likes.values[start.index()], likes.values[end.index()]);
            let Role::State(first) = graph.value(start).role else { return false };
            part == other && graph.states[first] == (start, end)
        });
        (alike && chains && states).then_some(likes)
    }

    /// A value of a part as it is in the first part; none if it is of another part.
    fn within(&self, value: ValueId, part: u32) -> Option<ValueId> {
        let (of, like) = self.values[value.index()];
        (of == part).then_some(like)
    }

    fn same_lookup(&self, graph: &StepGraph, value: &Value, like: &Value) -> bool {
        let (Role::Column(own, column), Role::Column(other, of)) = (value.role, like.role) else { return true };
        let [own, other] = [own, other].map(|lookup| graph.functions.lookups[at(lookup)]);
        let same = self.values[own.argument.index()].1 == self.values[other.argument.index()].1;
        same && column == of && (own.table, own.function) == (other.table, other.function)
    }

    fn same_writes(&self, chain: &Chain, like: &Chain, part: u32) -> bool {
        let own = |write: &Write| {
            let base = write.base.map(|base| self.within(base, part));
            Some((self.within(write.value, part)?, base, write.weight))
        };
        let first = |write: &Write| Some((write.value, write.base.map(Some), write.weight));
        chain.function.is_none()
            && like.function.is_none()
            && [chain.interim.is_some(), chain.second.is_some()] == [like.interim.is_some(), like.second.is_some()]
            && chain.writes().map(own).eq(like.writes().map(first))
    }

    /// The products of a chain; none if it reads more of other parts than the states that they begin with, or if these come too
    /// late.
    fn products(&self, graph: &StepGraph, chain: &Chain, part: u32) -> Option<Vec<Product>> {
        let mut met: HashMap<(ValueId, i64, Option<ValueId>), u32> = HashMap::new();
        let product = |term: &Term| {
            let (of, like) = self.values[term.operand.index()];
            let further = i64::from(of) - i64::from(part);
            let state = matches!(graph.value(term.operand).role, Role::State(_));
            // What the last part writes is there a few words after the first part has begun again.
            if term.partner.is_some() || (further != 0 && !state) || further > i64::from(self.count) - 2 {
                return None;
            }
            let factor = match term.factor {
                Factor::Value(value) => Some(self.within(value, part)?),
                Factor::Coefficient(_) => None,
            };
            let before = met.entry((like, further, factor)).or_insert(0);
            *before += 1;
            Some((like, further, factor, *before - 1))
        };
        graph.chain_terms(chain).iter().map(product).collect()
    }

    /// Whether all terms are alike, in their order and up to their coefficients. Each term reads the same value of its own part, or of
    /// the part that is so many further on; at a border any part may stand for those that there are not, with coefficient zero.
    pub fn same_terms(&self, graph: &StepGraph) -> bool {
        graph.chains.numbered().all(|(index, chain)| {
            let (part, like) = self.chains[index];
            let first = graph.chain_terms(&graph.chains[like]);
            let own = graph.chain_terms(chain);
            let same = |(own, first): (&Term, &Term)| {
                let ((of, value), (_, other)) = (self.values[own.operand.index()], self.values[first.operand.index()]);
                let early = i64::from(of) - i64::from(part) <= i64::from(self.count) - 2;
                let state = matches!(graph.value(own.operand).role, Role::State(_));
                let factors = match (own.factor, first.factor) {
                    (Factor::Value(own), Factor::Value(first)) => self.within(own, part) == Some(first),
                    (Factor::Coefficient(_), Factor::Coefficient(_)) => true,
                    _ => false,
                };
                value == other && factors && early && (of == part || state) && own.partner.is_none()
            };
            own.len() == first.len() && own.iter().zip(first).all(same)
        })
    }

    /// The step with the same terms in all parts.
    fn padded(&self, graph: &StepGraph) -> Option<StepGraph> {
        let products: Option<Vec<Vec<Product>>> =
            graph.chains.numbered().map(|(index, chain)| self.products(graph, chain, self.chains[index].0)).collect();
        let products = List::from(products?);
        // The chain with most terms has those of all parts.
        let mut fullest: List<ChainId, ChainId> = self.chains.iter().map(|(_, like)| *like).collect();
        for (index, (_, like)) in self.chains.numbered() {
            if graph.chains[index].len() > graph.chains[fullest[*like]].len() {
                fullest[*like] = index;
            }
        }
        let mut value_of: HashMap<(u32, ValueId), ValueId> = HashMap::new();
        for (index, (part, like)) in self.values.iter().enumerate() {
            value_of.insert((*part, *like), ValueId::at(index));
        }
        let (mut terms, mut chains) = (Vec::with_capacity(graph.terms.len()), List::with_capacity(graph.chains.len()));
        for (index, chain) in graph.chains.numbered() {
            let (part, like) = self.chains[index];
            let own = graph.chain_terms(chain);
            let mut places: HashMap<Product, usize> = (products[index].iter().copied()).zip(0..).collect();
            let begin = number(terms.len());
            for product in &products[fullest[like]] {
                match (places.remove(product), product) {
                    (Some(place), _) => terms.push(own[place]),
                    (None, (value, further, None, _)) if *further != 0 => {
                        let own = value_of[&(part, *value)];
                        terms.push(Term::new(own, Factor::Coefficient(0.0)));
                    }
                    (None, _) => return None,
                }
            }
            if !places.is_empty() {
                return None;
            }
            chains.push(Chain { terms: begin..number(terms.len()), ..chain.clone() });
        }
        Some(graph.with_chains(chains, terms))
    }
}

/// Whether values are of one kind.
fn same_kind(value: &Value, like: &Value) -> bool {
    let same = match (value.role, like.role) {
        (Role::Constant(own), Role::Constant(other)) => own.to_bits() == other.to_bits(),
        (Role::Inner(_, own), Role::Inner(_, other)) | (Role::Partial(_, own), Role::Partial(_, other)) => own == other,
        (Role::State(_), Role::State(_)) | (Role::Next(_), Role::Next(_)) | (Role::Column(..), Role::Column(..)) => {
            true
        }
        (Role::Algebraic(_, own), Role::Algebraic(_, other)) => own == other,
        (Role::Auxiliary(_), Role::Auxiliary(_)) => true,
        _ => false,
    };
    same && value.factor == like.factor
}

/// Whether a step could have parts that are alike: it has one stage, and its states are elements of arrays.
pub fn may_have(graph: &StepGraph) -> bool {
    let other = |value: &Value| matches!(value.role, Role::Published(_) | Role::Input(_));
    graph.swaps()
        && !graph.values.iter().any(other)
        && Pasts::of(graph).is_empty()
        && !guess::divisions(graph, MOST_PARTS).is_empty()
}

/// The step with parts that are alike, for a number of PEs; none if it has none.
pub fn arranged(graph: &StepGraph, pes: u32) -> Option<StepGraph> {
    if !may_have(graph) {
        return None;
    }
    let words = graph.loads().iter().map(|load| u64::from(*load)).sum::<u64>() / u64::from(pes.max(1));
    let mut divisions = guess::divisions(graph, MOST_PARTS);
    // The fewest parts whose rounds are short, and else the most.
    let round = |parts: u32| words / u64::from(parts);
    divisions.sort_by_key(|division| {
        let short = round(division.parts) <= ROUND_WORDS;
        (!short, if short { division.parts } else { u32::MAX - division.parts })
    });
    divisions.iter().find_map(|division| {
        let of: List<EquationId, (u32, EquationId)> = guess::alike(graph, division)?;
        let marked = StepGraph { parts: Parts { count: division.parts, of }, ..graph.clone() };
        let likes = Likes::of(&marked)?;
        likes.padded(&marked)
    })
}
