//! Own and imported memories of all PEs: lifetimes from the schedule, words for them.

use std::collections::{BTreeMap, HashMap};

use pe_ir::graph::{Factor, FixedPoint, Role, StepGraph, ValueId};
use pe_ir::mapping::Mapping;
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;

use super::registers::{Arc, pack};

const NONE: u32 = u32::MAX;

/// Where a value is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    /// Memory word; of a swapping pair the one in the lower half.
    pub word: u32,
    /// Whether the word is one of a swapping pair.
    pub swap: bool,
    /// In a swapping pair, whether this is the buffer of the step's end values.
    pub second: bool,
}

/// Places of all values.
pub(super) struct Memories {
    /// Place of each value in its own PE.
    pub own: Vec<Place>,
    /// Depth of each PE's own memory.
    pub own_words: Vec<u32>,
    /// Depth of each PE's imported memory.
    pub imported_words: Vec<u32>,
    /// Place of each imported value, by value and PE; start and end value of a state have entries of their own.
    imported: BTreeMap<(u32, u32), Place>,
}

impl Memories {
    /// Place of a value imported by a PE.
    pub fn import(&self, value: ValueId, pe: u32) -> Place {
        self.imported[&(value.0, pe)]
    }

    /// All imports in order.
    pub fn imports(&self) -> impl Iterator<Item = (ValueId, u32, Place)> {
        self.imported.iter().map(|((value, pe), place)| (ValueId(*value), *pe, *place))
    }

    pub fn allocate(graph: &StepGraph, fixed: &FixedPoint, mapping: &Mapping, schedule: &Schedule) -> Memories {
        let lives = Lives::of(graph, mapping, schedule, Latency::of(&fixed.format));
        let pes = mapping.pes as usize;
        let mut memories = Memories {
            own: vec![Place::default(); graph.values.len()],
            own_words: vec![0; pes],
            imported_words: vec![0; pes],
            imported: BTreeMap::new(),
        };
        memories.allocate_own(graph, fixed, mapping, schedule.period, &lives);
        memories.allocate_imported(graph, schedule, &lives, pes);
        memories
    }

    fn allocate_own(&mut self, graph: &StepGraph, fixed: &FixedPoint, mapping: &Mapping, period: u32, lives: &Lives) {
        let swap = graph.swaps();
        let mut layouts: Vec<Layout> = vec![Layout::default(); mapping.pes as usize];
        let mut constants: HashMap<(u32, i64), Slot> = HashMap::new();
        let mut slots: Vec<Option<Slot>> = vec![None; graph.values.len()];
        let mut arcs: Vec<Vec<Arc>> = vec![Vec::new(); mapping.pes as usize];
        for (index, value) in graph.values.iter().enumerate() {
            if value.equation == NONE {
                continue;
            }
            let pe = mapping.pe_of[value.equation as usize];
            let layout = &mut layouts[pe as usize];
            match value.role {
                Role::State(_) => slots[index] = Some(layout.resident(swap)),
                Role::Next(_) => {}
                Role::Constant(_) => {
                    // Equal words are stored once.
                    let word = fixed.constant_word(graph, ValueId(index as u32));
                    slots[index] = Some(*constants.entry((pe, word)).or_insert_with(|| layout.resident(false)));
                }
                _ => {
                    let (write, last_read) = lives.own[index];
                    arcs[pe as usize].push(Arc { write, last_read: last_read.max(write), key: index as u32 });
                }
            }
        }
        for (pe, arcs) in arcs.into_iter().enumerate() {
            let (assigned, count) = pack(arcs, period);
            let base = layouts[pe].single;
            layouts[pe].single += count;
            for (value, register) in assigned {
                slots[value as usize] = Some(Slot::Single(base + register));
            }
            self.own_words[pe] = layouts[pe].depth();
        }
        for (index, value) in graph.values.iter().enumerate() {
            if let Some(slot) = slots[index] {
                self.own[index] = layouts[mapping.pe_of[value.equation as usize] as usize].place(slot);
            }
        }
        for (state, next) in &graph.states {
            self.own[next.index()] = Place { second: swap, ..self.own[state.index()] };
        }
    }

    fn allocate_imported(&mut self, graph: &StepGraph, schedule: &Schedule, lives: &Lives, pes: usize) {
        let swap = graph.swaps();
        let mut layouts: Vec<Layout> = vec![Layout::default(); pes];
        let mut arcs: Vec<Vec<Arc>> = vec![Vec::new(); pes];
        let mut pairs: Vec<(usize, Slot)> = Vec::new();
        for (index, transfer) in schedule.transfers.iter().enumerate() {
            let pe = transfer.to as usize;
            let key = (transfer.value.0, transfer.to);
            let last_read = |value: ValueId| lives.imported.get(&(value.0, transfer.to)).copied();
            match graph.value(transfer.value).role {
                Role::Next(_) if swap => pairs.push((index, layouts[pe].resident(true))),
                Role::Next(s) => {
                    // The word lives on into the next round, until its last read under the state's own name.
                    let start = graph.states[s as usize].0;
                    let end = last_read(start).map_or(0, |read| read + schedule.period);
                    let end = end.max(last_read(transfer.value).unwrap_or(0)).max(transfer.receive);
                    // The initial image holds all states at once, so even one that arrives after the wrap owns its
                    // word from the wrap on.
                    let write = transfer.receive.min(schedule.period - 1);
                    arcs[pe].push(Arc { write, last_read: end, key: index as u32 });
                }
                _ => {
                    let end = last_read(ValueId(key.0)).unwrap_or(0).max(transfer.receive);
                    arcs[pe].push(Arc { write: transfer.receive, last_read: end, key: index as u32 });
                }
            }
        }
        let mut slots: Vec<(usize, Slot)> = pairs;
        for (pe, arcs) in arcs.into_iter().enumerate() {
            let (assigned, count) = pack(arcs, schedule.period);
            let base = layouts[pe].single;
            layouts[pe].single += count;
            slots.extend(assigned.into_iter().map(|(index, register)| (index as usize, Slot::Single(base + register))));
            self.imported_words[pe] = if layouts[pe] == Layout::default() { 0 } else { layouts[pe].depth() };
        }
        for (index, slot) in slots {
            let transfer = &schedule.transfers[index];
            let place = layouts[transfer.to as usize].place(slot);
            if let Role::Next(s) = graph.value(transfer.value).role {
                self.imported.insert((graph.states[s as usize].0.0, transfer.to), place);
                self.imported.insert((transfer.value.0, transfer.to), Place { second: swap, ..place });
            } else {
                self.imported.insert((transfer.value.0, transfer.to), place);
            }
        }
    }
}

/// A reserved word: swapping pairs and single words are numbered apart until the depth is known.
#[derive(Clone, Copy, Debug)]
enum Slot {
    Pair(u32),
    Single(u32),
}

/// How a memory is filled: pairs from the bottom of both halves, single words behind them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Layout {
    pairs: u32,
    single: u32,
}

impl Layout {
    fn resident(&mut self, pair: bool) -> Slot {
        if pair {
            self.pairs += 1;
            Slot::Pair(self.pairs - 1)
        } else {
            self.single += 1;
            Slot::Single(self.single - 1)
        }
    }

    /// Two words would take as many lookup tables as four, and are the depth at which GHDL 2.0 loses images when it
    /// synthesises (see `hdl/pe_ram.vhd`).
    fn depth(&self) -> u32 {
        (2 * self.pairs + self.single).next_power_of_two().max(4)
    }

    fn place(&self, slot: Slot) -> Place {
        match slot {
            Slot::Pair(word) => Place { word, swap: true, second: false },
            Slot::Single(index) => {
                let lower = self.depth() / 2 - self.pairs;
                let word =
                    if index < lower { self.pairs + index } else { self.depth() / 2 + self.pairs + index - lower };
                Place { word, swap: false, second: false }
            }
        }
    }
}

/// When each value is written and last read.
struct Lives {
    /// By value: write word and last own read.
    own: Vec<(u32, u32)>,
    /// By value and PE: last read of the import.
    imported: HashMap<(u32, u32), u32>,
}

impl Lives {
    fn of(graph: &StepGraph, mapping: &Mapping, schedule: &Schedule, latency: Latency) -> Lives {
        let mut own = vec![(0, 0); graph.values.len()];
        let mut imported: HashMap<(u32, u32), u32> = HashMap::new();
        for (index, chain) in graph.chains.iter().enumerate() {
            let pe = mapping.pe_of[chain.equation as usize];
            let start = schedule.starts[index];
            let last = start + chain.len() - 1;
            for (time, position) in (start..).zip(chain.terms.clone()) {
                let term = &graph.terms[schedule.order[position as usize] as usize];
                let equation = graph.value(term.operand).equation;
                if equation != NONE && mapping.pe_of[equation as usize] == pe {
                    let read = &mut own[term.operand.index()].1;
                    *read = (*read).max(time);
                } else {
                    let read = imported.entry((term.operand.0, pe)).or_insert(0);
                    *read = (*read).max(time);
                }
                if let Factor::Value(value) = term.factor {
                    let read = &mut own[value.index()].1;
                    *read = (*read).max(time);
                }
            }
            for (position, write) in chain.writes().enumerate() {
                let scale = last + latency.scale() + position as u32;
                if let Some(base) = write.base {
                    let read = &mut own[base.index()].1;
                    *read = (*read).max(scale);
                }
                own[write.value.index()].0 = scale + Latency::SCALE_TO_WRITE;
            }
        }
        Lives { own, imported }
    }
}
