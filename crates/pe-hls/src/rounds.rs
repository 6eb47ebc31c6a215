//! Steps whose stages are alike: one round of them, scheduled once and repeated.
//!
//! By Horner's rule each stage computes the same sums of the previous stage's values with other coefficients, added to
//! the same base; so do factors of equal pattern, each added to what it multiplies, and sums of one scale, which differ
//! in what they are added to and in their weights. One round, which reads values and
//! writes their successors into buffers that swap, then stands for all. It is a step graph of its own, of one stage; a
//! schedule of it is unrolled into a schedule of the whole step.
//!
//! Where a step falls into parts that are alike ([`crate::parts`]), a round is what one of them computes.

mod parts;

use std::borrow::Cow;
use std::collections::BTreeMap;

use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StageForm, StepGraph, Term, Value, ValueId, Write};
use pe_ir::index::{self, ChainId, EquationId, List, PeId, StateId, at};
use pe_ir::pasts::Pasts;
use pe_ir::schedule::{Schedule, Transfer};

use parts::Turns;

/// What a step is made of: rounds, and the values and chains of one.
#[derive(Clone, Debug)]
pub struct Rounds<'a> {
    /// Number of rounds.
    pub count: u32,
    /// Values, chains and terms of one round.
    pub graph: Cow<'a, StepGraph>,
    /// For each chain of the step its round and its chain in [`Rounds::graph`].
    chains: List<ChainId, (u32, ChainId)>,
    /// For each value of the step its value in [`Rounds::graph`], and for values in swapping buffers the round that
    /// reads it.
    values: Vec<(ValueId, u32)>,
    /// For each value of a round one of the step that it stands for.
    originals: Vec<ValueId>,
    /// Whether all rounds add to the states at the start of the step, rather than each to those at its own start.
    pub base_last: bool,
    /// Whether each state has a running sum, which takes its place as the base of the last round.
    pub sums: bool,
    /// Where each round is that of another part of the step.
    turns: Turns,
}

impl<'a> Rounds<'a> {
    /// Every step is one round of itself.
    pub fn single(graph: &'a StepGraph) -> Rounds<'a> {
        let next = |role: Role| u32::from(matches!(role, Role::Next(_)));
        Rounds {
            count: 1,
            graph: Cow::Borrowed(graph),
            chains: graph.chains.ids().map(|chain| (0, chain)).collect(),
            values: (0..).zip(&graph.values).map(|(id, value)| (ValueId::new(id), next(value.role))).collect(),
            originals: (0..graph.values.len() as u32).map(ValueId::new).collect(),
            base_last: false,
            sums: false,
            turns: Turns::default(),
        }
    }

    /// The rounds of a step, if its stages are alike.
    pub fn of(graph: &StepGraph, fixed: &FixedPoint) -> Option<Rounds<'static>> {
        let alike = matches!(graph.form, StageForm::Horner | StageForm::Factors | StageForm::Sums);
        // Rings move on once in a step.
        if !alike || graph.stages < 2 || !Pasts::of(graph).is_empty() {
            return None;
        }
        let mut inner = List::filled(0, graph.equations.len());
        for value in &graph.values {
            if let Role::Inner(equation, _) = value.role {
                inner[equation] += 1;
            }
        }
        if inner.iter().any(|count| count % graph.stages != 0) {
            return None;
        }
        inner.iter_mut().for_each(|count| *count /= graph.stages);
        Finder { graph, fixed, count: graph.stages, inner }.find()
    }

    /// The value of a round that stands for a value of the step; the second figure counts the swaps of its buffer.
    pub fn value(&self, value: ValueId) -> (ValueId, u32) {
        self.values[value.index()]
    }

    /// A value of the step that a value of a round stands for.
    pub fn original(&self, value: ValueId) -> ValueId {
        self.originals[value.index()]
    }

    /// The chain of a round that stands for a chain of the step.
    pub fn chain(&self, chain: ChainId) -> (u32, ChainId) {
        self.chains[chain]
    }

    /// The schedule of the step from that of one round.
    pub fn unroll(&self, step: &StepGraph, round: &Schedule) -> Schedule {
        if self.count == 1 {
            return round.clone();
        }
        let length = round.period;
        let mut starts = List::with_capacity(step.chains.len());
        let mut order = vec![0; step.terms.len()];
        for (index, chain) in step.chains.numbered() {
            let (number, like) = self.chain(index);
            starts.push(number * length + round.starts[like]);
            let first = self.graph.chains[like].terms.start;
            for offset in 0..chain.len() {
                let term = round.order[at(first + offset)] - first;
                order[at(chain.terms.start + offset)] = chain.terms.start + term;
            }
        }
        // Transfers of each value of a round; the start value of a state is sent as the end value of the round before.
        let mut receives: BTreeMap<ValueId, Vec<(PeId, u32)>> = BTreeMap::new();
        for transfer in &round.transfers {
            receives.entry(transfer.value).or_default().push((transfer.to, transfer.receive));
        }
        if self.are_parts() {
            let transfers = self.unrolled_transfers(length, &receives);
            return Schedule { period: length * self.count, starts, order, transfers };
        }
        let mut transfers: Vec<Transfer> = Vec::new();
        for (index, value) in step.values.iter().enumerate() {
            let id = ValueId::at(index);
            let (like, swaps) = self.value(id);
            let (sent, number) = match value.role {
                Role::State(_) | Role::Constant(_) => continue,
                Role::Stage(s, _) | Role::Next(s) => (self.graph.states[s].1, swaps - 1),
                // Outputs are computed beside the last round.
                Role::Algebraic(_, u8::MAX) => (like, self.count - 1),
                Role::Algebraic(_, stage) => (like, u32::from(stage) - 1),
                _ => (like, 0),
            };
            for (to, receive) in receives.get(&sent).into_iter().flatten() {
                transfers.push(Transfer { value: id, to: *to, receive: number * length + receive });
            }
        }
        transfers.sort_unstable();
        Schedule { period: length * self.count, starts, order, transfers }
    }
}

struct Finder<'a> {
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    count: u32,
    /// Inner sums of each equation in one round.
    inner: List<EquationId, u32>,
}

/// The values of a step, each with the value of one round that stands for it.
struct Likes {
    /// One round, without chains: the values of the last one, whose start values take the name of the step's.
    round: StepGraph,
    /// As [`Rounds::values`].
    values: Vec<(ValueId, u32)>,
    /// As [`Rounds::originals`].
    originals: Vec<ValueId>,
    /// The running sum of each state that has one.
    sums: BTreeMap<StateId, ValueId>,
    /// The start value of each state in the round.
    starts: List<StateId, ValueId>,
}

impl Likes {
    fn of(&self, id: ValueId) -> ValueId {
        self.values[id.index()].0
    }

    /// What the chain of a round writes that stands for a chain of the step.
    fn target(&self, graph: &StepGraph, chain: &Chain) -> ValueId {
        match graph.value(chain.write.value).role {
            Role::Stage(s, _) | Role::Next(s) => self.round.states[s].1,
            _ => self.of(chain.write.value),
        }
    }

    /// What it adds to. A state that is in a running sum is the base of the last round there: at another word, else
    /// the same.
    fn base(&self, graph: &StepGraph, write: &Write) -> Option<ValueId> {
        write.base.map(|base| match graph.value(base).role {
            Role::Sum(s, _) => self.starts[s],
            _ => self.of(base),
        })
    }

    fn term(&self, term: &Term) -> Term {
        let factor = match term.factor {
            Factor::Value(value) => Factor::Value(self.of(value)),
            coefficient @ Factor::Coefficient(_) => coefficient,
        };
        Term { operand: self.of(term.operand), partner: term.partner.map(|partner| self.of(partner)), factor }
    }
}

/// The value that is a factor of a term.
fn stored_factor(term: &Term) -> Option<ValueId> {
    match term.factor {
        Factor::Value(value) => Some(value),
        Factor::Coefficient(_) => None,
    }
}

impl Finder<'_> {
    fn find(&self) -> Option<Rounds<'static>> {
        let graph = self.graph;
        let likes = self.likes()?;
        let rounds = graph.chains.iter().map(|chain| self.round(chain)).collect::<Option<Vec<u32>>>()?;
        let round = self.last_round(&likes, &rounds);
        let by_target: BTreeMap<ValueId, ChainId> =
            round.chains.numbered().map(|(number, chain)| (chain.write.value, number)).collect();
        // Either all rounds add to the state at the start of the step, or each adds to that at its own start.
        let (mut first, mut own) = (true, true);
        let mut found = List::filled(0, round.chains.len());
        let mut chains = List::with_capacity(graph.chains.len());
        for (chain, number) in graph.chains.iter().zip(rounds) {
            let model = *by_target.get(&likes.target(graph, chain))?;
            if !self.alike(&likes, &round, &round.chains[model], (chain, number)) {
                return None;
            }
            let is_state = |base: &ValueId| matches!(round.value(likes.of(*base)).role, Role::State(_));
            if let Some(base) = chain.write.base.filter(is_state) {
                let swaps = likes.values[base.index()].1;
                first &= swaps == 0;
                own &= swaps == number;
            }
            chains.push((number, model));
            found[model] += 1;
        }
        let repeated = |chain: &Chain| {
            !matches!(round.value(chain.write.value).role, Role::Algebraic(_, u8::MAX) | Role::Published(_))
        };
        let complete = round.chains.iter().zip(&found).all(|(chain, found)| !repeated(chain) || *found == self.count);
        let sums = graph.form == StageForm::Sums;
        (complete && (first || own || sums)).then_some(Rounds {
            count: self.count,
            graph: Cow::Owned(round),
            chains,
            values: likes.values,
            originals: likes.originals,
            base_last: first && !sums,
            sums,
            turns: Turns::default(),
        })
    }

    /// The values of one round; none if the step has values that no round repeats.
    fn likes(&self) -> Option<Likes> {
        let graph = self.graph;
        let mut round = StepGraph {
            form: StageForm::Euler,
            stages: 1,
            values: Vec::new(),
            ..graph.with_chains(List::new(), Vec::new())
        };
        let mut known: BTreeMap<(u32, u32, i64, u64), ValueId> = BTreeMap::new();
        let mut values = Vec::with_capacity(graph.values.len());
        let mut originals = Vec::new();
        let mut sums = BTreeMap::new();
        for (id, value) in (0..).map(ValueId::new).zip(&graph.values) {
            let (role, swaps) = self.role(value.role)?;
            let like = *known.entry(self.key(role, value, id)?).or_insert_with(|| {
                round.values.push(Value { role, ..*value });
                originals.push(id);
                ValueId::at(round.values.len() - 1)
            });
            if let Role::Sum(state, _) = role {
                sums.insert(state, like);
            }
            values.push((like, swaps));
        }
        let like = |id: ValueId| values[id.index()].0;
        for (state, next) in &mut round.states {
            (*state, *next) = (like(*state), like(*next));
        }
        round.inputs.iter_mut().chain(&mut round.outputs).for_each(|value| *value = like(*value));
        let starts = round.states.iter().map(|(state, _)| *state).collect();
        Some(Likes { round, values, originals, sums, starts })
    }

    /// What a value of the step is in a round, and the swaps of its buffer.
    fn role(&self, role: Role) -> Option<(Role, u32)> {
        Some(match role {
            Role::State(s) => (Role::State(s), 0),
            // Samples are taken once, in front of all stages.
            Role::Algebraic(_, 0) => return None,
            Role::Stage(s, stage) => (Role::State(s), u32::from(stage) - 1),
            Role::Next(s) => (Role::Next(s), self.count),
            // Published values are computed beside the last round, by chains of their own.
            Role::Algebraic(a, u8::MAX) => (Role::Algebraic(a, u8::MAX), 0),
            Role::Algebraic(a, _) => (Role::Algebraic(a, 1), 0),
            Role::Sum(s, _) => (Role::Sum(s, 0), 0),
            Role::Interim(s, _) => (Role::Interim(s, 0), 0),
            Role::Inner(equation, serial) => (Role::Inner(equation, (serial - 1) % self.inner[equation]), 0),
            // Looped stages have no lookups.
            Role::Input(_) | Role::Constant(_) | Role::Published(_) | Role::Column(..) => (role, 0),
            Role::Partial(..) | Role::Relayed(..) | Role::Auxiliary(_) | Role::Pivot(..) => return None,
        })
    }

    /// Equal of values that one value of a round stands for.
    fn key(&self, role: Role, value: &Value, id: ValueId) -> Option<(u32, u32, i64, u64)> {
        Some(match role {
            Role::State(s) => (0, s.number(), 0, 0),
            Role::Next(s) => (1, s.number(), 0, 0),
            Role::Algebraic(a, stage) => (2, a, i64::from(stage), 0),
            Role::Input(i) => (3, i, 0, 0),
            Role::Constant(number) => {
                (4, value.equation?.number(), i64::from(self.fixed.exponents[id.index()]), number.to_bits())
            }
            Role::Published(o) => (5, o, 0, 0),
            Role::Sum(s, _) => (6, s.number(), 0, 0),
            Role::Interim(s, _) => (7, s.number(), 0, 0),
            Role::Inner(equation, serial) => (8, equation.number(), i64::from(serial), 0),
            _ => return None,
        })
    }

    /// One round with the chains of the step's last; `rounds` has the round of each chain.
    fn last_round(&self, likes: &Likes, rounds: &[u32]) -> StepGraph {
        let graph = self.graph;
        let mut round = likes.round.clone();
        for (chain, _) in graph.chains.iter().zip(rounds).filter(|(_, number)| **number == self.count - 1) {
            let start = index::number(round.terms.len());
            round.terms.extend(graph.chain_terms(chain).iter().map(|term| likes.term(term)));
            let write =
                Write { value: likes.target(graph, chain), base: likes.base(graph, &chain.write), ..chain.write };
            let interim =
                chain.interim.map(|part| Write { value: likes.of(part.value), base: likes.base(graph, &part), ..part });
            // A running sum is added to itself in every round; nothing waits for it.
            let second = match graph.value(chain.write.value).role {
                Role::Next(s) => likes.sums.get(&s).map(|sum| Write { value: *sum, base: Some(*sum), weight: 0 }),
                _ => None,
            };
            let terms = start..index::number(round.terms.len());
            round.chains.push(Chain { terms, interim, write, second, ..*chain });
        }
        round
    }

    /// Whether a chain of the step does in its round what a chain of the round does.
    fn alike(&self, likes: &Likes, round: &StepGraph, model: &Chain, (chain, number): (&Chain, u32)) -> bool {
        let graph = self.graph;
        let in_turn = |operand: ValueId| match graph.value(operand).role {
            Role::State(_) | Role::Stage(..) => likes.values[operand.index()].1 == number,
            Role::Algebraic(_, stage) if stage < u8::MAX => u32::from(stage) == number + 1,
            _ => true,
        };
        let named = |term: &Term| {
            let Term { operand, partner, .. } = *term;
            (operand, partner, stored_factor(term))
        };
        let terms = graph.chain_terms(chain);
        round.chain_terms(model).iter().map(named).eq(terms.iter().map(|term| named(&likes.term(term))))
            && terms.iter().flat_map(Term::operands).all(in_turn)
            && terms.iter().filter_map(stored_factor).all(|value| self.inner_round(value) == Some(number))
            && model.write.base == likes.base(graph, &chain.write)
            && chain.interim.map(|part| likes.base(graph, &part)) == model.interim.map(|part| part.base)
            && chain.second.is_none_or(|second| model.second.is_some_and(|sum| sum.value == likes.of(second.value)))
    }

    /// The round that a chain belongs to.
    fn round(&self, chain: &Chain) -> Option<u32> {
        match self.graph.value(chain.write.value).role {
            Role::Stage(_, stage) => Some(u32::from(stage) - 2),
            Role::Next(_) | Role::Published(_) | Role::Algebraic(_, u8::MAX) => Some(self.count - 1),
            Role::Algebraic(_, stage) => Some(u32::from(stage) - 1),
            _ => self.inner_round(chain.write.value),
        }
    }

    /// The round that an inner sum belongs to.
    fn inner_round(&self, value: ValueId) -> Option<u32> {
        match self.graph.value(value).role {
            Role::Inner(equation, serial) => Some((serial - 1) / self.inner[equation]),
            _ => None,
        }
    }
}
