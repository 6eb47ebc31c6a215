//! The scheduling problem in flat arrays.
//!
//! A schedule of a large model waits for memory most of all. So what belongs to one PE lies side by side here, in the
//! graph's order, in which a PE also comes to it: chains, operands, and the slots that say when a word is there.

use pe_ir::graph::{Factor, Role, StepGraph, Term, ValueId, Write};
use pe_ir::index::{ChainId, List, PeId, StateId, at, number};
use pe_ir::mapping::Mapping;
use pe_ir::pasts::Pasts;
use pe_ir::schedule::{Schedule, Transfer};
use pe_ir::word::Latency;

use super::bound::words_of;

pub(super) const NONE: u32 = u32::MAX;

pe_ir::ids! {
    /// A chain in the order of [`Problem::chains`], which is not that of the step graph.
    pub(super) CodeId
}

/// Times of one step, before it is closed into a loop.
pub(super) struct Placement {
    /// First operand of each chain.
    pub starts: List<CodeId, u32>,
    /// Terms in issue order.
    pub order: Vec<u32>,
    /// Receive time of each import.
    pub receives: Vec<u32>,
    /// First read of each slot's word from the step before.
    pub first_reads: Vec<u32>,
}

/// Where an operand or a base is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Operand(u32);

/// Set where the word is that of the step before.
const FROM_BEFORE: u32 = 1 << 31;
/// Set where the word comes from another PE.
const IMPORTED: u32 = 1 << 30;
/// Set where the word is an entry of a table: the slot is that of the table's argument.
const INDEXED: u32 = 1 << 29;

impl Operand {
    /// The slot of the word: a value in its own PE, or an import.
    pub fn slot(self) -> usize {
        at(self.0 & !(FROM_BEFORE | IMPORTED | INDEXED))
    }

    /// Words that pass between the first possible read of the slot and that of the operand.
    pub fn lag(self) -> u32 {
        if self.0 & INDEXED != 0 { Latency::INDEX_TO_SCALE } else { 0 }
    }

    /// Whether the word is that of the step before, the start value of a state.
    pub fn is_from_before(self) -> bool {
        self.0 & FROM_BEFORE != 0
    }

    /// Whether the word comes from another PE or from outside.
    pub fn is_imported(self) -> bool {
        self.0 & IMPORTED != 0
    }
}

/// A value that a PE needs from elsewhere. Start and end of a state share one import.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Import {
    /// The value as its memory word is known: the start value for states.
    resident: ValueId,
    /// The value that is sent: the end value of a state.
    sent: ValueId,
    /// The PE that needs it.
    pub pe: PeId,
    /// Its slot.
    pub slot: u32,
    /// Whether it is an external input.
    pub is_input: bool,
}

/// A write of a chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Store {
    /// Slot of the value.
    pub slot: u32,
    /// What the sum is added to, unless the chain itself writes it.
    pub base: Option<Operand>,
    /// Words after the first possible ones.
    pub delay: u32,
}

/// A chain with all that its placement needs.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Code {
    /// Its terms: a range of [`Problem::operands`].
    pub terms: std::ops::Range<u32>,
    /// Its PE.
    pub pe: PeId,
    /// Length of the longest way from its first operand to the end of the step.
    pub priority: u32,
    /// Number of chains that it waits for.
    pub predecessors: u32,
    /// The write that may be sent.
    pub write: Store,
    /// Other writes.
    others: [Option<Store>; 2],
    /// Words for which its sum stays in the hold register.
    pub held: u32,
    /// Whether the write that may be sent overwrites the start value of a state.
    pub overwrites: bool,
    /// Range of `links`.
    links: (u32, u32),
    /// Range of `successors`.
    successors: (u32, u32),
}

impl Code {
    /// Number of terms.
    pub fn len(&self) -> u32 {
        self.terms.end - self.terms.start
    }

    /// Its writes.
    pub fn stores(&self) -> impl Iterator<Item = &Store> {
        std::iter::once(&self.write).chain(self.others.iter().flatten())
    }

    /// Whether a write goes to other PEs.
    pub fn is_sent(&self) -> bool {
        self.links.0 != self.links.1
    }
}

/// All that the schedule of a mapped step graph depends on: equal problems have equal schedules.
#[derive(PartialEq, Eq, Hash)]
pub struct Problem {
    pub(super) latency: Latency,
    pub(super) pes: usize,
    /// Chains by PE, those of a PE in the graph's order.
    pub(super) chains: List<CodeId, Code>,
    /// Index in the graph of each chain, and of its first term.
    originals: List<CodeId, (ChainId, u32)>,
    /// Data operand of each term, in the order of the chains.
    pub(super) operands: Vec<Operand>,
    /// Second data operand of each term, an import, or none; empty if no term is a pair.
    partners: Vec<Option<Operand>>,
    /// Slot of the second factor of each term, or none; empty if no term has one.
    factors: Vec<u32>,
    /// Number of slots.
    pub(super) slots: usize,
    /// By PE, those of a PE by value.
    pub(super) imports: Vec<Import>,
    /// Imports that each chain feeds.
    links: Vec<u32>,
    /// Chains that wait for each chain: data and write-after-read order.
    successors: Vec<CodeId>,
    /// Slot of each state in its own PE, and the chain that writes its end value.
    states: Vec<(u32, CodeId)>,
    /// Imports of states, each with the sign that its word is that of the step before.
    state_imports: Vec<u32>,
}

impl Problem {
    /// That of a mapped step graph.
    pub fn new(graph: &StepGraph, mapping: &Mapping, latency: Latency) -> Problem {
        let pe_of: List<ChainId, PeId> = graph.chains.iter().map(|chain| mapping.pe_of[chain.equation]).collect();
        let pasts = Pasts::of(graph);
        let places = Places::new(graph, mapping, (&pe_of, &pasts));
        let mut originals: List<CodeId, ChainId> = graph.chains.ids().collect();
        originals.sort_by_key(|chain| pe_of[*chain]);
        let in_place = !graph.swaps();
        let mut operands = Vec::with_capacity(graph.terms.len());
        let mut chains = List::with_capacity(graph.chains.len());
        for original in &originals {
            let chain = &graph.chains[*original];
            let pe = pe_of[*original];
            let begin = number(operands.len());
            operands.extend(graph.chain_terms(chain).iter().map(|term| places.operand(graph, term.operand, pe)));
            let own = |base: &ValueId| chain.writes().any(|write| write.value == *base);
            let store = |(delay, write): (u32, &Write)| Store {
                slot: places.own[write.value.index()],
                base: write.base.filter(|base| !own(base)).map(|base| places.base(graph, base, pe)),
                delay,
            };
            let is_sent = |(_, write): &(u32, &Write)| write.value == chain.write.value;
            let mut others = chain.delayed(latency).filter(|write| !is_sent(write)).map(store);
            let others = [others.next(), others.next()];
            let ends_state = match graph.value(chain.write.value).role {
                Role::Next(state) => pasts.find(state).is_none(),
                _ => false,
            };
            chains.push(Code {
                terms: begin..operands.len() as u32,
                pe,
                priority: 0,
                predecessors: 0,
                write: chain.delayed(latency).find(is_sent).map(store).expect("a chain writes"),
                others,
                held: chain.held(latency),
                overwrites: in_place && ends_state,
                links: (0, 0),
                successors: (0, 0),
            });
        }
        let mut factors: Vec<u32> = Vec::new();
        if graph.terms.iter().any(|term| matches!(term.factor, Factor::Value(_))) {
            let slot = |term: &Term| match term.factor {
                Factor::Value(value) => places.own[value.index()],
                Factor::Coefficient(_) => NONE,
            };
            let terms = originals.iter().flat_map(|chain| graph.chain_terms(&graph.chains[*chain]));
            factors = terms.map(slot).collect();
        }
        let mut partners: Vec<Option<Operand>> = Vec::new();
        if graph.terms.iter().any(|term| term.partner.is_some()) {
            for original in &originals {
                let partner = |term: &Term| Some(places.import(graph, term.partner?, pe_of[*original]));
                partners.extend(graph.chain_terms(&graph.chains[*original]).iter().map(partner));
            }
        }
        let mut problem = Problem {
            latency,
            pes: at(mapping.pes),
            chains,
            originals: originals.into_iter().map(|chain| (chain, graph.chains[chain].terms.start)).collect(),
            operands,
            partners,
            factors,
            slots: places.slots,
            imports: places.imports,
            links: Vec::new(),
            successors: Vec::new(),
            states: Vec::new(),
            state_imports: Vec::new(),
        };
        let mut renumbered: List<ChainId, CodeId> = List::filled(CodeId::new(0), graph.chains.len());
        for (index, (original, _)) in problem.originals.numbered() {
            renumbered[*original] = index;
        }
        // For each value the chain that writes it.
        let producers = graph.producers().into_iter().map(|producer| Some(renumbered[producer?]));
        let producers: Vec<Option<CodeId>> = producers.collect();
        let end = |state: &(ValueId, ValueId)| {
            (places.own[state.0.index()], producers[state.1.index()].expect("every state has an end value"))
        };
        // What is older than a step is there.
        let returning = |state: &StateId| pasts.find(*state).is_none_or(|past| past.age == 1);
        problem.states = graph.states.ids().filter(returning).map(|state| end(&graph.states[state])).collect();
        problem.link(graph, &producers);
        // A state of one part of many was written a round of each part ago.
        if graph.parts.is_one_of_many() {
            problem.states.clear();
            problem.state_imports.clear();
        }
        problem.order(graph, &producers, &renumbered, |state| in_place && pasts.find(state).is_none());
        problem.prioritise();
        problem
    }

    /// The chain in the step graph.
    pub(super) fn original(&self, chain: CodeId) -> ChainId {
        self.originals[chain].0
    }

    /// Imports that a chain feeds.
    pub(super) fn links(&self, chain: CodeId) -> &[u32] {
        let (begin, end) = self.chains[chain].links;
        &self.links[at(begin)..end as usize]
    }

    /// Chains that wait for a chain.
    pub(super) fn successors(&self, chain: CodeId) -> &[CodeId] {
        let (begin, end) = self.chains[chain].successors;
        &self.successors[at(begin)..end as usize]
    }

    /// Slot of the second factor of a term, if it is a value.
    pub(super) fn factor(&self, term: u32) -> Option<usize> {
        self.factors.get(at(term)).filter(|slot| **slot != NONE).map(|slot| at(*slot))
    }

    /// The second data operand of a term.
    pub(super) fn partner(&self, term: u32) -> Option<Operand> {
        self.partners.get(at(term)).copied().flatten()
    }

    /// Slots of words from the step before: in their own PE with the chain that writes the next step's word, and
    /// imported ones with their import.
    pub(super) fn returning(
        &self,
    ) -> (impl Iterator<Item = (usize, &Code, CodeId)>, impl Iterator<Item = (usize, usize)>) {
        let own = self.states.iter().map(|(slot, chain)| (at(*slot), &self.chains[*chain], *chain));
        let imported = self.state_imports.iter().map(|import| at(*import));
        (own, imported.map(|import| (at(self.imports[import].slot), import)))
    }

    /// The control words that the chains of the busiest PE need at least.
    pub(super) fn load_bound(&self) -> u32 {
        let mut loads = List::filled((Vec::new(), Vec::new()), self.pes);
        for chain in &self.chains {
            let (operands, held) = &mut loads[chain.pe];
            operands.push(chain.len());
            held.push(chain.held);
        }
        let words = loads.into_iter().map(|(operands, held)| words_of(operands, held)).max().unwrap_or(0);
        u32::try_from(words).unwrap_or(u32::MAX).max(self.latency.pause() + 1)
    }

    /// The chain that feeds each import.
    fn link(&mut self, graph: &StepGraph, producers: &[Option<CodeId>]) {
        let mut fed: Vec<(CodeId, u32)> = Vec::with_capacity(self.imports.len());
        for (index, import) in (0..).zip(&self.imports) {
            if let Role::State(_) = graph.value(import.resident).role {
                self.state_imports.push(index);
            }
            fed.extend(producers[import.sent.index()].map(|producer| (producer, index)));
        }
        let ranges = grouped(fed, self.chains.len(), &mut self.links);
        for (chain, range) in self.chains.iter_mut().zip(ranges) {
            chain.links = range;
        }
    }

    /// Data order, and for values written in place the order "all readers of the old word first".
    fn order(
        &mut self,
        graph: &StepGraph,
        producers: &[Option<CodeId>],
        renumbered: &List<ChainId, CodeId>,
        in_place: impl Fn(StateId) -> bool,
    ) {
        // Pairs of a chain and one that waits for it.
        let mut waits: Vec<(CodeId, CodeId)> = Vec::with_capacity(graph.terms.len());
        let mut of_chain: Vec<(CodeId, CodeId)> = Vec::new();
        for (chain, index) in graph.chains.iter().zip(renumbered) {
            let mut read = |value: ValueId| {
                if let Some(producer) = producers[value.index()] {
                    of_chain.push((producer, *index));
                } else if let Role::State(state) = graph.value(value).role
                    && in_place(state)
                {
                    let writer = producers[graph.states[state].1.index()];
                    of_chain.extend(writer.filter(|writer| writer != index).map(|writer| (*index, writer)));
                }
            };
            for term in graph.chain_terms(chain) {
                term.operands().for_each(&mut read);
                if let Factor::Value(value) = term.factor {
                    read(value);
                }
            }
            let own = |base: &ValueId| chain.writes().any(|write| write.value == *base);
            let bases = chain.writes().filter_map(|write| write.base).filter(|base| !own(base));
            bases.map(|base| graph.lookup(base).map_or(base, |(_, lookup)| lookup.argument)).for_each(&mut read);
            // Each wait of a chain counts once, however often it reads a value.
            of_chain.sort_unstable();
            of_chain.dedup();
            waits.append(&mut of_chain);
        }
        for (_, successor) in &waits {
            self.chains[*successor].predecessors += 1;
        }
        let ranges = grouped(waits, self.chains.len(), &mut self.successors);
        for (chain, range) in self.chains.iter_mut().zip(ranges) {
            chain.successors = range;
        }
    }

    /// Longest ways, backwards in topological order (end values may come before readers they wait for, so by count).
    fn prioritise(&mut self) {
        let count = self.chains.len();
        let mut order = Vec::with_capacity(count);
        let mut waiting: List<CodeId, u32> = self.chains.iter().map(|chain| chain.predecessors).collect();
        let mut ready: Vec<CodeId> = self.chains.ids().filter(|chain| waiting[*chain] == 0).collect();
        while let Some(chain) = ready.pop() {
            order.push(chain);
            for successor in self.successors(chain) {
                waiting[*successor] -= 1;
                if waiting[*successor] == 0 {
                    ready.push(*successor);
                }
            }
        }
        assert_eq!(order.len(), count, "the step graph has a cycle");
        let result = self.latency.write() + Latency::WRITE_TO_READ;
        for chain in order.into_iter().rev() {
            let code = &self.chains[chain];
            let follow = self.successors(chain).iter().map(|successor| {
                let successor = &self.chains[*successor];
                successor.priority + result + if successor.pe != code.pe { Latency::SEND_TO_RECEIVE } else { 0 }
            });
            let priority = code.len() + follow.max().unwrap_or(0);
            self.chains[chain].priority = priority;
        }
    }

    /// Turns a placement into the schedule that the next stage gets.
    pub(super) fn finish(&self, placement: Placement, period: u32) -> Schedule {
        let received = self.imports.iter().zip(&placement.receives);
        let received =
            received.map(|(Import { sent, pe, .. }, receive)| Transfer { value: *sent, to: *pe, receive: *receive });
        let mut transfers: Vec<Transfer> = received.collect();
        transfers.sort_unstable();
        let mut starts = List::filled(0, self.chains.len());
        let mut order = vec![0; self.operands.len()];
        for ((code, (original, first)), start) in self.chains.iter().zip(&self.originals).zip(&placement.starts) {
            starts[*original] = *start;
            for position in 0..code.len() {
                let term = placement.order[at(code.terms.start + position)];
                order[at(first + position)] = first + term - code.terms.start;
            }
        }
        Schedule { period, starts, order, transfers }
    }
}

/// Slots of values and imports.
struct Places {
    /// Slot of each value in its own PE, or none.
    own: Vec<u32>,
    /// PE of each value; none of inputs.
    home: Vec<Option<PeId>>,
    /// The start value of a state for its end value; itself for others.
    resident: Vec<u32>,
    /// First import of each PE, and their number.
    first_import: Vec<u32>,
    imports: Vec<Import>,
    slots: usize,
    /// For each value whether it is in a ring and older than a step.
    older: Vec<bool>,
}

impl Places {
    fn new(graph: &StepGraph, mapping: &Mapping, (pe_of, pasts): (&List<ChainId, PeId>, &Pasts)) -> Places {
        let pes = at(mapping.pes);
        let mut resident: Vec<u32> = (0..graph.values.len() as u32).collect();
        for (state, next) in &graph.states {
            if !matches!(graph.value(*next).role, Role::State(_)) {
                resident[next.index()] = state.number();
            }
        }
        // A ring is one import.
        let mut older = vec![false; graph.values.len()];
        for (state, past) in pasts.members() {
            let start = graph.states[state].0.index();
            resident[start] = graph.states[past.head].0.number();
            older[start] = past.age > 1;
        }
        let home: Vec<Option<PeId>> = graph.values.iter().map(|value| Some(mapping.pe_of[value.equation?])).collect();
        let mut needs: Vec<(PeId, u32)> = Vec::new();
        for (chain, pe) in graph.chains.iter().zip(pe_of) {
            for term in graph.chain_terms(chain) {
                if home[term.operand.index()] != Some(*pe) {
                    needs.push((*pe, resident[term.operand.index()]));
                }
                // A partner is read from the imported memory even if the PE computes it itself.
                needs.extend(term.partner.map(|partner| (*pe, resident[partner.index()])));
            }
        }
        needs.sort_unstable();
        needs.dedup();
        let mut first_import = vec![0; pes + 1];
        for (pe, _) in &needs {
            first_import[pe.index() + 1] += 1;
        }
        let mut owned = List::filled(0u32, pes);
        for pe in home.iter().flatten() {
            owned[*pe] += 1;
        }
        // Each PE's slots lie together: its own values, then its imports.
        let mut next_own = List::filled(0, pes);
        let mut next_import = List::filled(0, pes);
        let mut slots = 0;
        for pe in owned.ids() {
            next_own[pe] = slots;
            next_import[pe] = slots + owned[pe];
            slots += owned[pe] + first_import[pe.index() + 1];
            first_import[pe.index() + 1] += first_import[pe.index()];
        }
        assert!(slots < INDEXED, "more values than slots can be told apart");
        let take = |pe: PeId, next: &mut List<PeId, u32>| {
            let slot = &mut next[pe];
            *slot += 1;
            *slot - 1
        };
        let own = home.iter().map(|pe| pe.map_or(NONE, |pe| take(pe, &mut next_own))).collect();
        let import = |(pe, value): (PeId, u32)| {
            let resident = ValueId::new(value);
            let (sent, is_input) = match graph.value(resident).role {
                Role::State(state) => (graph.states[state].1, false),
                role => (resident, matches!(role, Role::Input(_))),
            };
            Import { resident, sent, pe, slot: take(pe, &mut next_import), is_input }
        };
        let imports = needs.into_iter().map(import).collect();
        // One slot stands for all imported words that are older than a step.
        Places { own, home, resident, first_import, imports, slots: at(slots) + 1, older }
    }

    /// Where a PE reads a value.
    fn operand(&self, graph: &StepGraph, value: ValueId, pe: PeId) -> Operand {
        let before = if matches!(graph.value(value).role, Role::State(_)) { FROM_BEFORE } else { 0 };
        if self.home[value.index()] == Some(pe) {
            return Operand(self.own[value.index()] | before);
        }
        self.import(graph, value, pe)
    }

    /// Where a PE reads a base.
    fn base(&self, graph: &StepGraph, value: ValueId, pe: PeId) -> Operand {
        let Some((_, lookup)) = graph.lookup(value) else { return self.operand(graph, value, pe) };
        assert_eq!(self.home[lookup.argument.index()], Some(pe), "lookups and their arguments belong to one equation");
        Operand(self.own[lookup.argument.index()] | INDEXED)
    }

    /// Where a PE reads a value that it imports.
    fn import(&self, graph: &StepGraph, value: ValueId, pe: PeId) -> Operand {
        let before = if matches!(graph.value(value).role, Role::State(_)) { FROM_BEFORE } else { 0 };
        if self.older[value.index()] {
            return Operand((number(self.slots) - 1) | before | IMPORTED);
        }
        let resident = ValueId::new(self.resident[value.index()]);
        let range = at(self.first_import[pe.index()])..at(self.first_import[pe.index() + 1]);
        let imports = &self.imports[range];
        let found = imports.binary_search_by_key(&resident, |import| import.resident).expect("an import of the PE");
        Operand(imports[found].slot | before | IMPORTED)
    }
}

/// Groups the second members of pairs by their first, one of `count` chains, into `members`; the range of each group.
fn grouped<T: Copy>(pairs: Vec<(CodeId, T)>, count: usize, members: &mut Vec<T>) -> List<CodeId, (u32, u32)> {
    let mut ranges = List::filled((0, 0), count);
    for (group, _) in &pairs {
        ranges[*group].1 += 1;
    }
    let mut begin = 0;
    for range in &mut ranges {
        let size = range.1;
        *range = (begin, begin);
        begin += size;
    }
    *members = pairs.iter().map(|(_, member)| *member).collect();
    for (group, member) in pairs {
        let end = &mut ranges[group].1;
        members[at(*end)] = member;
        *end += 1;
    }
    ranges
}
