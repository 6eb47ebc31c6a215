//! The list scheduler.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use pe_ir::index::{self, PeId, at, number};
use pe_ir::word::Latency;

use super::problem::{CodeId, NONE, Placement, Problem};

/// How many chains are tried when the most urgent one has to wait for a write or link slot.
const ALTERNATIVES: usize = 8;

/// Places all chains, of those that could start the one with the highest priority first. `release` bounds the first reads of
/// values from the step before.
pub(super) fn place(problem: &Problem, priorities: &index::List<CodeId, u32>, release: &[u32]) -> Placement {
    let mut list = List::new(problem, priorities, release);
    list.receive_inputs();
    for (index, chain) in problem.chains.numbered() {
        if chain.predecessors == 0 {
            list.make_ready(index, 0);
        }
    }
    while let Some((time, pe)) = list.events.next() {
        list.visit(pe, time);
    }
    debug_assert!(list.waiting.iter().all(|count| *count == 0));
    list.placement
}

/// State of one PE.
#[derive(Default)]
struct Pe {
    /// Chains whose operands will be there: earliest start, chain.
    coming: BinaryHeap<Reverse<(u32, CodeId)>>,
    /// Chains that could start now: priority, chain (earlier chains first).
    ready: BinaryHeap<(u32, Reverse<CodeId>)>,
    /// First word without an operand so far.
    free: u32,
    /// Earliest last operand of the next chain: the writes of the chain before it need the hold register.
    next_last: u32,
    /// Earliest next send: all receivers have taken the word before.
    next_send: u32,
    /// Words in which a receive is placed.
    receives: Slots,
}

struct List<'a> {
    problem: &'a Problem,
    priorities: &'a index::List<CodeId, u32>,
    pes: index::List<PeId, Pe>,
    events: Events,
    waiting: index::List<CodeId, u32>,
    /// First word that may read each slot; an import's in the step that its current word belongs to.
    ready: Vec<u32>,
    /// Last read of each imported slot's old word so far.
    last_read: Vec<u32>,
    /// Arrival and term of each operand of the chain under `make_ready`.
    arrivals: Vec<(u32, u32)>,
    /// Chains that have to wait in the PE under `visit`.
    passed: Vec<(u32, Reverse<CodeId>)>,
    placement: Placement,
}

impl<'a> List<'a> {
    fn new(problem: &'a Problem, priorities: &'a index::List<CodeId, u32>, release: &[u32]) -> Self {
        // Nothing may be written before the pause point, so no chain may end in word 0.
        let pes = (0..problem.pes).map(|_| Pe { next_last: 1, ..Pe::default() }).collect();
        List {
            problem,
            priorities,
            pes,
            events: Events::new(problem.pes),
            waiting: problem.chains.iter().map(|chain| chain.predecessors).collect(),
            ready: release.to_vec(),
            last_read: vec![0; problem.slots],
            arrivals: Vec::new(),
            passed: Vec::new(),
            placement: Placement {
                starts: index::List::filled(0, problem.chains.len()),
                order: vec![0; problem.operands.len()],
                receives: vec![0; problem.imports.len()],
                first_reads: vec![u32::MAX; problem.slots],
            },
        }
    }

    /// Inputs are sampled at the pause point; each PE takes its own in the first words after it.
    fn receive_inputs(&mut self) {
        let first = self.problem.latency.pause() + 1;
        for (index, import) in self.problem.imports.iter().enumerate().filter(|(_, import)| import.is_input) {
            let receive = self.pes[import.pe].receives.take(first);
            self.placement.receives[index] = receive;
            self.ready[at(import.slot)] = receive + Latency::WRITE_TO_READ;
        }
    }

    /// A chain's predecessors are placed: orders its terms by arrival and computes its earliest start.
    fn make_ready(&mut self, chain: CodeId, now: u32) {
        let problem = self.problem;
        let code = &problem.chains[chain];
        let arrival = |term: u32| {
            let ready = self.ready[problem.operands[at(term)].slot()];
            let ready = problem.partner(term).map_or(ready, |partner| ready.max(self.ready[partner.slot()]));
            problem.factor(term).map_or(ready, |value| ready.max(self.ready[value]))
        };
        let mut arrivals = std::mem::take(&mut self.arrivals);
        arrivals.clear();
        arrivals.extend(code.terms.clone().map(|term| (arrival(term), term)));
        arrivals.sort_unstable();
        let mut start = now;
        for (position, (ready, term)) in arrivals.iter().enumerate() {
            start = start.max(ready.saturating_sub(number(position)));
            self.placement.order[at(code.terms.start) + position] = *term;
        }
        self.arrivals = arrivals;
        let last_offset = code.len() - 1;
        for store in code.stores() {
            if let Some(base) = store.base {
                let scale = last_offset + problem.latency.scale() + store.delay;
                start = start.max((self.ready[base.slot()] + base.lag()).saturating_sub(scale));
            }
        }
        let pe = code.pe;
        self.pes[pe].coming.push(Reverse((start, chain)));
        self.wake(pe, start);
    }

    /// Has a PE looked at again at `time`.
    fn wake(&mut self, pe: PeId, time: u32) {
        self.events.add(pe, time.max(self.pes[pe].free));
    }

    fn visit(&mut self, pe: PeId, time: u32) {
        while let Some(Reverse((start, chain))) = self.pes[pe].coming.peek().copied() {
            if start > time {
                break;
            }
            self.pes[pe].coming.pop();
            self.pes[pe].ready.push((self.priorities[chain], Reverse(chain)));
        }
        let mut earliest = u32::MAX;
        let mut chosen = None;
        while self.passed.len() < ALTERNATIVES {
            let Some(entry) = self.pes[pe].ready.pop() else { break };
            let possible = self.earliest_start(pe, entry.1.0);
            if possible <= time {
                chosen = Some(entry.1.0);
                break;
            }
            earliest = earliest.min(possible);
            self.passed.push(entry);
        }
        self.pes[pe].ready.extend(self.passed.drain(..));
        if let Some(chain) = chosen {
            self.issue(pe, chain, time);
        }
        let state = &self.pes[pe];
        let coming = state.coming.peek().map_or(u32::MAX, |Reverse((start, _))| *start);
        let next = if chosen.is_some() && !state.ready.is_empty() { state.free } else { earliest.min(coming) };
        if next != u32::MAX {
            self.wake(pe, next);
        }
    }

    /// When the hold register, the write port and the link allow a chain to start.
    fn earliest_start(&self, pe: PeId, chain: CodeId) -> u32 {
        let state = &self.pes[pe];
        let code = &self.problem.chains[chain];
        let last_offset = code.len() - 1;
        let mut start = state.free.max(state.next_last.saturating_sub(last_offset));
        if code.is_sent() {
            start = start
                .max(state.next_send.saturating_sub(last_offset + self.problem.latency.write() + code.write.delay));
        }
        start
    }

    fn issue(&mut self, pe: PeId, chain: CodeId, start: u32) {
        let problem = self.problem;
        let code = &problem.chains[chain];
        let last = start + code.len() - 1;
        self.placement.starts[chain] = start;
        self.pes[pe].free = last + 1;
        self.pes[pe].next_last = last + code.held;
        self.note_reads(chain, start);
        for store in code.stores() {
            let time = last + problem.latency.write() + store.delay;
            // A swapped end value has a word of its own; an in-place one is read under its own name.
            self.ready[at(store.slot)] = time + Latency::WRITE_TO_READ;
        }
        self.send(chain, last + problem.latency.write() + code.write.delay);
        for successor in problem.successors(chain) {
            self.waiting[*successor] -= 1;
            if self.waiting[*successor] == 0 {
                self.make_ready(*successor, start);
            }
        }
    }

    /// Records reads of words from the step before, and of imports.
    fn note_reads(&mut self, chain: CodeId, start: u32) {
        let problem = self.problem;
        let code = &problem.chains[chain];
        for position in 0..code.len() {
            let term = at(self.placement.order[at(code.terms.start + position)]);
            let time = start + position;
            for operand in std::iter::once(problem.operands[term]).chain(problem.partner(number(term))) {
                if operand.is_imported() {
                    let read = &mut self.last_read[operand.slot()];
                    *read = (*read).max(time);
                }
                if operand.is_from_before() {
                    let read = &mut self.placement.first_reads[operand.slot()];
                    *read = (*read).min(time);
                }
            }
        }
        for store in code.stores() {
            if let Some(base) = store.base.filter(|base| base.is_from_before()) {
                let time = start + code.len() - 1 + problem.latency.scale() + store.delay;
                let read = &mut self.placement.first_reads[base.slot()];
                *read = (*read).min(time);
            }
        }
    }

    /// Places the receives of what a chain sends in word `sent`.
    fn send(&mut self, chain: CodeId, sent: u32) {
        let problem = self.problem;
        let code = &problem.chains[chain];
        for index in problem.links(chain) {
            let import = &problem.imports[at(*index)];
            let mut first = sent + Latency::SEND_TO_RECEIVE;
            if code.overwrites {
                first = first.max(self.last_read[at(import.slot)] + 1);
            }
            let receive = self.pes[import.pe].receives.take(first);
            self.placement.receives[at(*index)] = receive;
            self.ready[at(import.slot)] = receive + Latency::WRITE_TO_READ;
            let next_send = &mut self.pes[code.pe].next_send;
            *next_send = (*next_send).max(receive);
        }
    }
}

/// When each PE is to be looked at next, in the order of time and then of PEs. In a network at work some PE is due in
/// nearly every word, so that going through all of them word by word takes less than a heap of the times.
struct Events {
    /// For each PE the time of its next event, or none.
    times: index::List<PeId, u32>,
    now: u32,
    /// No PE before this one is due now.
    next: usize,
}

impl Events {
    /// No events of so many PEs.
    fn new(pes: usize) -> Events {
        Events { times: index::List::filled(NONE, pes), now: 0, next: 0 }
    }

    /// Adds an event, not before the one under way; a later one of the same PE is forgotten.
    fn add(&mut self, pe: PeId, time: u32) {
        self.times[pe] = self.times[pe].min(time);
        if time == self.now {
            self.next = self.next.min(pe.index());
        }
    }

    /// Takes the next event.
    fn next(&mut self) -> Option<(u32, PeId)> {
        loop {
            if let Some(waited) = self.times.iter().skip(self.next).position(|time| *time == self.now) {
                self.next += waited;
                let pe = PeId::at(self.next);
                self.times[pe] = NONE;
                return Some((self.now, pe));
            }
            self.now = self.times.iter().copied().min().filter(|time| *time != NONE)?;
            self.next = 0;
        }
    }
}

/// Occupied words, with the first free one found in near-constant time.
#[derive(Default)]
struct Slots {
    /// For each word the next one to try; a word is free if it points to itself.
    next: Vec<u32>,
}

impl Slots {
    /// Takes the first free word from `from` on.
    fn take(&mut self, from: u32) -> u32 {
        while self.next.len() <= at(from) + 1 {
            self.next.push(number(self.next.len()));
        }
        let mut slot = from;
        while self.next[at(slot)] != slot {
            slot = self.next[at(slot)];
            if self.next.len() <= at(slot) + 1 {
                self.next.push(number(self.next.len()));
            }
        }
        let mut visited = from;
        while visited != slot {
            visited = std::mem::replace(&mut self.next[at(visited)], slot + 1);
        }
        self.next[at(slot)] = slot + 1;
        slot
    }
}

#[cfg(test)]
mod tests {
    use super::{Events, PeId, Slots};

    #[test]
    fn events_come_by_time_and_by_pe_and_the_earlier_one_counts() {
        let mut events = Events::new(4);
        [(2, 5), (1, 5), (3, 7), (3, 6), (0, 9)].into_iter().for_each(|(pe, time)| events.add(PeId::new(pe), time));
        let next = |events: &mut Events| events.next().map(|(time, pe)| (time, pe.number()));
        assert_eq!(next(&mut events), Some((5, 1)));
        assert_eq!(next(&mut events), Some((5, 2)));
        // A PE before the one under way is due at the same time.
        events.add(PeId::new(0), 5);
        events.add(PeId::new(2), 5);
        let rest: Vec<_> = std::iter::from_fn(|| next(&mut events)).collect();
        assert_eq!(rest, [(5, 0), (5, 2), (6, 3)]);
    }

    #[test]
    fn slots_are_given_out_once_and_in_order() {
        let mut slots = Slots::default();
        let taken: Vec<u32> = [3, 3, 0, 4, 3, 4].into_iter().map(|from| slots.take(from)).collect();
        assert_eq!(taken, [3, 4, 0, 5, 6, 7]);
    }
}
