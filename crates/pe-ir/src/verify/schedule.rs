//! Checks a schedule against its step graph and mapping, written apart from the scheduler.
//!
//! What it enforces, with times counted in control words of one step and its repetition every `period`:
//!
//! 1. a PE issues at most one product per word, and all issues lie within the period;
//! 2. a chain's writes find its sum in the hold register, and own writes of a PE never share a word;
//! 3. a PE receives at most one word at a time, and inputs only after they are sampled;
//! 4. every operand, factor and base is in the memory before it is read, in this step or from the step before;
//! 5. a link carries a word until its last receiver has taken it;
//! 6. a value written in place comes after every read of the word it overwrites;
//! 7. what falls into the next step's first words is done before its pause point.

use std::collections::{BTreeMap, BTreeSet};

use crate::graph::{Factor, Role, StepGraph, ValueId};
use crate::mapping::Mapping;
use crate::schedule::Schedule;
use crate::word::Latency;

const NONE: u32 = u32::MAX;

/// Returns what is wrong with a schedule; empty if nothing is.
pub fn check(graph: &StepGraph, mapping: &Mapping, schedule: &Schedule, latency: Latency) -> Vec<String> {
    Checker::new(graph, mapping, schedule, latency).run()
}

struct Checker<'a> {
    graph: &'a StepGraph,
    mapping: &'a Mapping,
    schedule: &'a Schedule,
    latency: Latency,
    /// Write word of each value that a chain computes.
    written: BTreeMap<ValueId, u32>,
    received: BTreeMap<(ValueId, u32), u32>,
    violations: Vec<String>,
}

impl<'a> Checker<'a> {
    fn new(graph: &'a StepGraph, mapping: &'a Mapping, schedule: &'a Schedule, latency: Latency) -> Self {
        let mut written = BTreeMap::new();
        for (chain, start) in graph.chains.iter().zip(&schedule.starts) {
            for (position, write) in chain.writes().enumerate() {
                written.insert(write.value, start + chain.len() - 1 + latency.write() + position as u32);
            }
        }
        let received = schedule.transfers.iter().map(|t| ((t.value, t.to), t.receive)).collect();
        Checker { graph, mapping, schedule, latency, written, received, violations: Vec::new() }
    }

    fn run(mut self) -> Vec<String> {
        self.exclusive();
        self.reads();
        self.links();
        self.violations
    }

    fn pe(&self, equation: u32) -> u32 {
        self.mapping.pe_of[equation as usize]
    }

    fn claim(&mut self, used: &mut BTreeSet<(&'static str, u32, u32)>, what: &'static str, pe: u32, time: u32) {
        if !used.insert((what, pe, time % self.schedule.period)) {
            self.violations.push(format!("PE {pe}: two operations for {what} in word {time}"));
        }
    }

    /// Rules 1, 2, 3 and 7.
    fn exclusive(&mut self) {
        let period = self.schedule.period;
        let mut used = BTreeSet::new();
        let mut ends: BTreeMap<u32, Vec<(u32, u32)>> = BTreeMap::new();
        for (index, chain) in self.graph.chains.iter().enumerate() {
            let pe = self.pe(chain.equation);
            let start = self.schedule.starts[index];
            let last = start + chain.len() - 1;
            for time in start..=last {
                self.claim(&mut used, "issue", pe, time);
            }
            if last >= period {
                self.violations.push(format!("PE {pe}: issue in word {last} of {period}"));
            }
            let mut order: Vec<u32> =
                self.schedule.order[chain.terms.start as usize..chain.terms.end as usize].to_vec();
            order.sort_unstable();
            if !order.into_iter().eq(chain.terms.clone()) {
                self.violations.push(format!("chain {index}: the issue order is not a permutation of its terms"));
            }
            let writes = chain.writes().count() as u32;
            ends.entry(pe).or_default().push((last, writes));
            for position in 0..writes {
                let time = last + self.latency.write() + position;
                self.claim(&mut used, "write", pe, time);
                self.in_time(pe, time);
            }
        }
        for (pe, mut ends) in ends {
            ends.sort_unstable();
            let first = ends[0].0 + period;
            let following: Vec<u32> = ends.iter().skip(1).map(|end| end.0).chain([first]).collect();
            for ((last, writes), next) in ends.into_iter().zip(following) {
                if next < last + writes {
                    self.violations.push(format!("PE {pe}: the sum of word {last} is lost before its second write"));
                }
            }
        }
        for transfer in &self.schedule.transfers {
            self.claim(&mut used, "receive", transfer.to, transfer.receive);
            if let Role::Input(_) = self.graph.value(transfer.value).role {
                if transfer.receive <= self.latency.pause() || transfer.receive >= period {
                    self.violations.push(format!("PE {}: input received in word {}", transfer.to, transfer.receive));
                }
            } else {
                self.in_time(transfer.to, transfer.receive);
            }
        }
    }

    /// Memory changes lie after this step's pause point and before the next one's.
    fn in_time(&mut self, pe: u32, time: u32) {
        let pause = self.latency.pause();
        if time < pause || time >= self.schedule.period + pause {
            self.violations.push(format!("PE {pe}: a write in word {time} belongs to no step"));
        }
    }

    /// Rules 4 and 6.
    fn reads(&mut self) {
        let mut reads: Vec<(ValueId, u32, u32)> = Vec::new();
        for (index, chain) in self.graph.chains.iter().enumerate() {
            let pe = self.pe(chain.equation);
            let start = self.schedule.starts[index];
            for (time, position) in (start..).zip(chain.terms.clone()) {
                let term = &self.graph.terms[self.schedule.order[position as usize] as usize];
                reads.push((term.operand, pe, time));
                if let Factor::Value(factor) = term.factor {
                    reads.push((factor, pe, time));
                }
            }
            for (position, write) in chain.writes().enumerate() {
                if let Some(base) = write.base {
                    let scale = start + chain.len() - 1 + self.latency.scale() + position as u32;
                    reads.push((base, pe, scale));
                }
            }
        }
        for (value, pe, time) in reads {
            self.read(value, pe, time);
        }
    }

    fn read(&mut self, value: ValueId, pe: u32, time: u32) {
        let info = *self.graph.value(value);
        let local = info.equation != NONE && self.pe(info.equation) == pe;
        let name = || self.graph.value_name(value);
        if let Role::Constant(_) = info.role {
            if !local {
                self.violations.push(format!("PE {pe}: constant {} of another PE", name()));
            }
            return;
        }
        // A state's word was written by the step before.
        let (source, earlier) = match info.role {
            Role::State(s) => (self.graph.states[s as usize].1, self.schedule.period),
            _ => (value, 0),
        };
        let arrival = if local { self.written.get(&source) } else { self.received.get(&(source, pe)) };
        match arrival {
            None => self.violations.push(format!("PE {pe}: `{}` never arrives", name())),
            Some(arrival) if time + earlier <= *arrival => {
                self.violations.push(format!("PE {pe}: `{}` read in word {time}, there after {arrival}", name()));
            }
            Some(arrival) if earlier > 0 && !self.graph.swaps() && time >= *arrival => {
                self.violations.push(format!("PE {pe}: `{}` read in word {time}, overwritten in {arrival}", name()));
            }
            Some(_) => {}
        }
    }

    /// Rule 5.
    fn links(&mut self) {
        let mut sends: BTreeMap<u32, Vec<(u32, u32)>> = BTreeMap::new();
        let mut last_receive: BTreeMap<ValueId, u32> = BTreeMap::new();
        for transfer in &self.schedule.transfers {
            let last = last_receive.entry(transfer.value).or_insert(0);
            *last = (*last).max(transfer.receive);
            if let Some(sent) = self.written.get(&transfer.value)
                && transfer.receive <= *sent
            {
                self.violations.push(format!("`{}` received before it is sent", self.graph.value_name(transfer.value)));
            }
        }
        for (value, last) in &last_receive {
            if let Some(sent) = self.written.get(value) {
                let pe = self.pe(self.graph.value(*value).equation);
                sends.entry(pe).or_default().push((*sent, *last));
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
