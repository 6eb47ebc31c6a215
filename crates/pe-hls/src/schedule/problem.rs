//! The scheduling problem in flat arrays.

use pe_ir::graph::{Factor, Role, StepGraph, ValueId};
use pe_ir::mapping::Mapping;
use pe_ir::schedule::{Schedule, Transfer};
use pe_ir::word::Latency;

use super::list::Placement;

pub(super) const NONE: u32 = u32::MAX;

/// Where an operand is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// Own memory: a value.
    Own(u32),
    /// Imported memory: an import.
    Import(u32),
}

/// A value that a PE needs from elsewhere. Start and end of a state share one import.
#[derive(Clone, Copy, Debug)]
pub(super) struct Import {
    /// The value as its memory word is known: the start value for states.
    pub resident: u32,
    /// The PE that needs it.
    pub pe: u32,
}

pub(super) struct Problem<'a> {
    pub graph: &'a StepGraph,
    pub latency: Latency,
    pub pes: usize,
    /// PE of each chain.
    pub pe_of: Vec<u32>,
    /// Operand place of each term.
    pub places: Vec<Place>,
    pub imports: Vec<Import>,
    /// Imports of each value that is sent: ranges into `imports`, by resident value.
    import_start: Vec<u32>,
    /// Chains that wait for each chain: data and write-after-read order.
    pub successors: Vec<Vec<u32>>,
    /// Number of chains that each chain waits for.
    pub predecessors: Vec<u32>,
    /// Length of the longest way from a chain's first operand to the end of the step.
    pub priority: Vec<u32>,
    /// The start value of a state for its end value; itself for others.
    pub resident: Vec<u32>,
    /// Whether end values overwrite start values.
    pub in_place: bool,
}

impl<'a> Problem<'a> {
    pub fn new(graph: &'a StepGraph, mapping: &Mapping, latency: Latency) -> Self {
        let pe_of: Vec<u32> = graph.chains.iter().map(|chain| mapping.pe_of[chain.equation as usize]).collect();
        let mut resident: Vec<u32> = (0..graph.values.len() as u32).collect();
        for (state, next) in &graph.states {
            resident[next.index()] = state.0;
        }
        let home = |value: ValueId| match graph.value(value).equation {
            NONE => NONE,
            equation => mapping.pe_of[equation as usize],
        };
        let mut needs: Vec<(u32, u32)> = Vec::new();
        for (chain, pe) in graph.chains.iter().zip(&pe_of) {
            for term in graph.chain_terms(chain) {
                if home(term.operand) != *pe {
                    needs.push((resident[term.operand.index()], *pe));
                }
            }
        }
        needs.sort_unstable();
        needs.dedup();
        let mut import_start = vec![0; graph.values.len() + 1];
        for (value, _) in &needs {
            import_start[*value as usize + 1] += 1;
        }
        for index in 0..graph.values.len() {
            import_start[index + 1] += import_start[index];
        }
        let mut places = Vec::with_capacity(graph.terms.len());
        for (chain, pe) in graph.chains.iter().zip(&pe_of) {
            for term in graph.chain_terms(chain) {
                let value = resident[term.operand.index()];
                places.push(if home(term.operand) == *pe {
                    Place::Own(term.operand.0)
                } else {
                    Place::Import(needs.binary_search(&(value, *pe)).expect("collected above") as u32)
                });
            }
        }
        let imports = needs.into_iter().map(|(resident, pe)| Import { resident, pe }).collect();
        let mut problem = Problem {
            graph,
            latency,
            pes: mapping.pes as usize,
            pe_of,
            places,
            imports,
            import_start,
            successors: vec![Vec::new(); graph.chains.len()],
            predecessors: vec![0; graph.chains.len()],
            priority: Vec::new(),
            resident,
            in_place: !graph.swaps(),
        };
        problem.order();
        problem.prioritise();
        problem
    }

    /// Imports of a value, in PE order.
    pub fn imports_of(&self, value: u32) -> std::ops::Range<usize> {
        let resident = self.resident[value as usize] as usize;
        self.import_start[resident] as usize..self.import_start[resident + 1] as usize
    }

    /// Number of release times: one per value for own reads, one per import.
    pub fn resident_count(&self) -> usize {
        self.graph.values.len() + self.imports.len()
    }

    /// The largest number of issue slots of a PE.
    pub fn load_bound(&self) -> u32 {
        let mut load = vec![0; self.pes];
        for (chain, pe) in self.graph.chains.iter().zip(&self.pe_of) {
            load[*pe as usize] += chain.len().max(chain.writes().count() as u32);
        }
        load.into_iter().max().unwrap_or(0).max(self.latency.pause() + 1)
    }

    /// Data order, and for values written in place the order "all readers of the old word first".
    fn order(&mut self) {
        let producers = self.graph.producers();
        let mut readers: Vec<Vec<u32>> = vec![Vec::new(); if self.in_place { self.graph.values.len() } else { 0 }];
        for (index, chain) in self.graph.chains.iter().enumerate() {
            let mut sources: Vec<u32> = Vec::new();
            let mut read = |value: ValueId| {
                let producer = producers[value.index()];
                if producer != NONE {
                    sources.push(producer);
                } else if self.in_place && matches!(self.graph.value(value).role, Role::State(_)) {
                    readers[value.index()].push(index as u32);
                }
            };
            for term in self.graph.chain_terms(chain) {
                read(term.operand);
                if let Factor::Value(value) = term.factor {
                    read(value);
                }
            }
            chain.writes().filter_map(|write| write.base).for_each(&mut read);
            self.depend(index as u32, sources);
        }
        if self.in_place {
            for (state, next) in &self.graph.states {
                let writer = producers[next.index()];
                let mut before = std::mem::take(&mut readers[state.index()]);
                before.retain(|reader| *reader != writer);
                self.depend(writer, before);
            }
        }
    }

    fn depend(&mut self, chain: u32, mut on: Vec<u32>) {
        on.sort_unstable();
        on.dedup();
        for source in on {
            self.successors[source as usize].push(chain);
            self.predecessors[chain as usize] += 1;
        }
    }

    /// Longest ways, backwards in topological order (end values may come before readers they wait for, so by count).
    fn prioritise(&mut self) {
        let count = self.graph.chains.len();
        let mut order = Vec::with_capacity(count);
        let mut waiting = self.predecessors.clone();
        let mut ready: Vec<u32> = (0..count as u32).filter(|chain| waiting[*chain as usize] == 0).collect();
        while let Some(chain) = ready.pop() {
            order.push(chain);
            for successor in &self.successors[chain as usize] {
                waiting[*successor as usize] -= 1;
                if waiting[*successor as usize] == 0 {
                    ready.push(*successor);
                }
            }
        }
        assert_eq!(order.len(), count, "the step graph has a cycle");
        let result = self.latency.write() + Latency::WRITE_TO_READ;
        self.priority = vec![0; count];
        for chain in order.into_iter().rev() {
            let follow = self.successors[chain as usize].iter().map(|successor| {
                let far = self.pe_of[*successor as usize] != self.pe_of[chain as usize];
                self.priority[*successor as usize] + result + if far { Latency::SEND_TO_RECEIVE } else { 0 }
            });
            let after = follow.max().unwrap_or(0);
            self.priority[chain as usize] = self.graph.chains[chain as usize].len() + after;
        }
    }

    /// Turns a placement into the schedule that the next stage gets.
    pub fn finish(&self, placement: Placement, period: u32) -> Schedule {
        let producers = self.graph.producers();
        let mut transfers: Vec<Transfer> = Vec::with_capacity(self.imports.len());
        for (import, receive) in self.imports.iter().zip(&placement.receives) {
            // A state's import is fed by its end value.
            let resident = ValueId(import.resident);
            let value = match self.graph.value(resident).role {
                Role::State(s) => self.graph.states[s as usize].1,
                _ => resident,
            };
            debug_assert!(producers[value.index()] != NONE || self.graph.value(value).equation == NONE);
            transfers.push(Transfer { value, to: import.pe, receive: *receive });
        }
        transfers.sort_unstable();
        Schedule { period, starts: placement.starts, order: placement.order, transfers }
    }
}
