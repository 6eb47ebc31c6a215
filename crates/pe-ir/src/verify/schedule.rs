//! Checks a schedule against its step graph and mapping, written apart from the scheduler.
//!
//! What it enforces, with times counted in control words of one step and its repetition every `period`:
//!
//! 1. a PE issues at most one product per word, and all issues lie within the period;
//! 2. a chain's writes find its sum in the hold register, and own writes of a PE never share a word;
//! 3. a PE receives at most one word at a time, and inputs only after they are sampled;
//! 4. every operand, factor and base is in the memory before it is read, in this step or from the step before; an entry
//!    of a table is read where its argument is computed, and two words after that is written at the earliest;
//! 5. a link carries a word until its last receiver has taken it;
//! 6. a value written in place comes after every read of the word it overwrites;
//! 7. what falls into the next step's first words is done before its pause point.

use std::collections::BTreeMap;

use crate::graph::{Chain, Factor, Role, StepGraph, ValueId, Write};
use crate::index::{EquationId, List, PeId, at};
use crate::mapping::Mapping;
use crate::schedule::Schedule;
use crate::word::Latency;

const NONE: u32 = u32::MAX;

/// Returns what is wrong with a schedule; empty if nothing is.
pub fn check(graph: &StepGraph, mapping: &Mapping, schedule: &Schedule, latency: Latency) -> Vec<String> {
    Checker::new(graph, mapping, schedule, latency).run()
}

/// Words between the first scale word after a chain's sum and that of each of its writes: the first two follow one
/// another, and a write on top of the interim value waits until that is in the base memory.
fn writes(chain: &Chain, latency: &Latency) -> Vec<(u32, Write)> {
    let next_base = latency.scale_to_write() + 1;
    match (chain.interim, chain.second) {
        (None, None) => vec![(0, chain.write)],
        (None, Some(second)) => vec![(0, chain.write), (1, second)],
        (Some(interim), None) => vec![(0, interim), (next_base, chain.write)],
        (Some(interim), Some(second)) => vec![(0, interim), (1, second), (next_base, chain.write)],
    }
}

struct Checker<'a> {
    graph: &'a StepGraph,
    mapping: &'a Mapping,
    schedule: &'a Schedule,
    latency: Latency,
    /// Write word of each value that a chain computes, else none.
    written: Vec<u32>,
    /// Receive words by value and PE, sorted.
    received: Vec<((ValueId, PeId), u32)>,
    /// For each value whether it is a state that others follow, whose word is not written in place.
    followed: Vec<bool>,
    violations: Vec<String>,
}

impl<'a> Checker<'a> {
    fn new(graph: &'a StepGraph, mapping: &'a Mapping, schedule: &'a Schedule, latency: Latency) -> Self {
        let mut written = vec![NONE; graph.values.len()];
        for (chain, start) in graph.chains.iter().zip(&schedule.starts) {
            for (delay, write) in writes(chain, &latency) {
                written[write.value.index()] = start + chain.len() - 1 + latency.write() + delay;
            }
        }
        let mut received: Vec<_> = schedule.transfers.iter().map(|t| ((t.value, t.to), t.receive)).collect();
        received.sort_unstable();
        let mut followed = vec![false; graph.values.len()];
        graph.states.iter().for_each(|(_, end)| followed[end.index()] = true);
        Checker { graph, mapping, schedule, latency, written, received, followed, violations: Vec::new() }
    }

    fn run(mut self) -> Vec<String> {
        self.exclusive();
        self.reads();
        self.links();
        self.violations
    }

    fn pe(&self, equation: EquationId) -> PeId {
        self.mapping.pe_of[equation]
    }

    /// Write word of a value.
    fn written(&self, value: ValueId) -> Option<u32> {
        Some(self.written[value.index()]).filter(|word| *word != NONE)
    }

    /// Receive word of a value in a PE.
    fn received(&self, value: ValueId, pe: PeId) -> Option<u32> {
        let found = self.received.binary_search_by_key(&(value, pe), |entry| entry.0);
        found.ok().map(|index| self.received[index].1)
    }

    /// No two operations of a kind share a word of a PE.
    fn apart(&mut self, what: &'static str, mut claims: Vec<(PeId, u32)>) {
        claims.sort_unstable();
        for pair in claims.windows(2).filter(|pair| pair[0] == pair[1]) {
            let (pe, word) = pair[0];
            self.violations.push(format!("PE {pe}: two operations for {what} in word {word}"));
        }
    }

    /// Rules 1, 2, 3 and 7.
    fn exclusive(&mut self) {
        let period = self.schedule.period;
        let (mut issues, mut own_writes, mut receives) = (Vec::new(), Vec::new(), Vec::new());
        let mut ends: List<PeId, Vec<(u32, u32)>> = List::filled(Vec::new(), at(self.mapping.pes));
        for (index, chain) in self.graph.chains.numbered() {
            let pe = self.pe(chain.equation);
            let start = self.schedule.starts[index];
            let last = start + chain.len() - 1;
            issues.extend((start..=last).map(|time| (pe, time % period)));
            if last >= period {
                self.violations.push(format!("PE {pe}: issue in word {last} of {period}"));
            }
            let mut order: Vec<u32> = self.schedule.order[at(chain.terms.start)..chain.terms.end as usize].to_vec();
            order.sort_unstable();
            if !order.into_iter().eq(chain.terms.clone()) {
                self.violations.push(format!("chain {index}: the issue order is not a permutation of its terms"));
            }
            let delays: Vec<u32> = writes(chain, &self.latency).iter().map(|(delay, _)| *delay).collect();
            ends[pe].push((last, delays.iter().max().map_or(0, |delay| delay + 1)));
            for delay in delays {
                let time = last + self.latency.write() + delay;
                own_writes.push((pe, time % period));
                self.in_time(pe, time);
            }
        }
        for (pe, ends) in ends.numbered_mut() {
            ends.sort_unstable();
            let first = ends.first().map_or(0, |end| end.0 + period);
            let following: Vec<u32> = ends.iter().skip(1).map(|end| end.0).chain([first]).collect();
            for (&mut (last, held), next) in ends.iter_mut().zip(following) {
                if next < last + held {
                    self.violations.push(format!("PE {pe}: the sum of word {last} is lost before its last write"));
                }
            }
        }
        for transfer in &self.schedule.transfers {
            receives.push((transfer.to, transfer.receive % period));
            if let Role::Input(_) = self.graph.value(transfer.value).role {
                if transfer.receive <= self.latency.pause() || transfer.receive >= period {
                    self.violations.push(format!("PE {}: input received in word {}", transfer.to, transfer.receive));
                }
            } else {
                self.in_time(transfer.to, transfer.receive);
            }
        }
        self.apart("issue", issues);
        self.apart("write", own_writes);
        self.apart("receive", receives);
    }

    /// Memory changes lie after this step's pause point and before the next one's.
    fn in_time(&mut self, pe: PeId, time: u32) {
        let pause = self.latency.pause();
        if time < pause || time >= self.schedule.period + pause {
            self.violations.push(format!("PE {pe}: a write in word {time} belongs to no step"));
        }
    }

    /// Rules 4 and 6.
    fn reads(&mut self) {
        let (graph, schedule) = (self.graph, self.schedule);
        for (index, chain) in graph.chains.numbered() {
            let pe = self.pe(chain.equation);
            let start = schedule.starts[index];
            for (time, position) in (start..).zip(chain.terms.clone()) {
                let term = &graph.terms[at(schedule.order[at(position)])];
                self.read(term.operand, (pe, self.local(term.operand, pe)), time);
                if let Some(partner) = term.partner {
                    if !self.local(term.operand, pe) {
                        self.violations.push(format!("PE {pe}: two imported operands in word {time}"));
                    }
                    self.read(partner, (pe, false), time);
                }
                if let Factor::Value(factor) = term.factor {
                    self.read(factor, (pe, self.local(factor, pe)), time);
                }
            }
            for (delay, write) in writes(chain, &self.latency) {
                if let Some(base) = write.base {
                    let scale = start + chain.len() - 1 + self.latency.scale() + delay;
                    match graph.value(base).role {
                        Role::Column(lookup, _) => self.read_entry(base, lookup, pe, scale),
                        _ => self.read(base, (pe, self.local(base, pe)), scale),
                    }
                }
            }
        }
    }

    /// A read of an entry of a table: the word before fetches the index of its argument.
    fn read_entry(&mut self, entry: ValueId, lookup: u32, pe: PeId, scale: u32) {
        let argument = self.graph.functions.lookups[at(lookup)].argument;
        if self.local(entry, pe) && self.local(argument, pe) && self.written(argument).is_some() {
            self.read(argument, (pe, true), scale - 1);
        } else {
            let name = self.graph.value_name(entry);
            self.violations.push(format!("PE {pe}: `{name}` is looked up where its argument is not computed"));
        }
    }

    /// Whether a value is computed by a PE.
    fn local(&self, value: ValueId, pe: PeId) -> bool {
        self.graph.value(value).equation.is_some_and(|equation| self.pe(equation) == pe)
    }

    /// A read of a PE from its own or its imported memory.
    fn read(&mut self, value: ValueId, (pe, local): (PeId, bool), time: u32) {
        let info = *self.graph.value(value);
        let name = || self.graph.value_name(value);
        if let Role::Constant(_) = info.role {
            if !local {
                self.violations.push(format!("PE {pe}: constant {} of another PE", name()));
            }
            return;
        }
        // A state's word was written by the step before, or, in a ring, as many steps before as states are followed.
        let (mut source, mut earlier) = (value, 0);
        while let Role::State(s) = self.graph.value(source).role {
            source = self.graph.states[s].1;
            earlier += self.schedule.period;
        }
        let in_ring = earlier > self.schedule.period || self.followed[value.index()];
        let arrival = if local { self.written(source) } else { self.received(source, pe) };
        match arrival {
            None => self.violations.push(format!("PE {pe}: `{}` never arrives", name())),
            Some(arrival) if time + earlier <= arrival => {
                self.violations.push(format!("PE {pe}: `{}` read in word {time}, there after {arrival}", name()));
            }
            Some(arrival) if earlier > 0 && !in_ring && !self.graph.swaps() && time >= arrival => {
                self.violations.push(format!("PE {pe}: `{}` read in word {time}, overwritten in {arrival}", name()));
            }
            Some(_) => {}
        }
    }

    /// Rule 5.
    fn links(&mut self) {
        let mut sends: BTreeMap<PeId, Vec<(u32, u32)>> = BTreeMap::new();
        let mut last_receive = vec![NONE; self.graph.values.len()];
        for transfer in &self.schedule.transfers {
            let last = &mut last_receive[transfer.value.index()];
            *last = if *last == NONE { transfer.receive } else { transfer.receive.max(*last) };
            if let Some(sent) = self.written(transfer.value)
                && transfer.receive <= sent
            {
                self.violations.push(format!("`{}` received before it is sent", self.graph.value_name(transfer.value)));
            }
        }
        for (value, last) in (0..).map(ValueId::new).zip(last_receive).filter(|(_, last)| *last != NONE) {
            if let (Some(sent), Some(equation)) = (self.written(value), self.graph.value(value).equation) {
                let pe = self.pe(equation);
                sends.entry(pe).or_default().push((sent, last));
            }
        }
        for (pe, mut sends) in sends {
            sends.sort_unstable();
            let first = sends[0].0 + self.schedule.period;
            let following: Vec<u32> = sends.iter().skip(1).map(|send| send.0).chain([first]).collect();
            for ((sent, last), next) in sends.into_iter().zip(following) {
                if next < last {
                    self.violations
                        .push(format!("PE {pe}: the word sent in {sent} is replaced in {next}, taken in {last}"));
                }
            }
        }
    }
}
