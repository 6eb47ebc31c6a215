//! Own, base, coefficient and imported memories of all PEs: lifetimes from the schedule, words for them.
//!
//! A value lives only in the memories that something reads it from. States are in the own and in the base memory at
//! addresses that share their low bits, so one write reaches both; everything else is in one of them. Of a state's two own
//! words in halves that change roles the one of the lower half has the address of its base word.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};

use pe_ir::graph::{Factor, FixedPoint, Role, StepGraph, ValueId};
use pe_ir::index::{self, List, PeId, StateId};
use pe_ir::mapping::Mapping;
use pe_ir::memory::depth;
use pe_ir::pasts::Pasts;
use pe_ir::program::index_bits;
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;

use super::registers::{Arc, pack};
use crate::rounds::Rounds;

/// Where a value is kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    /// Memory word; of a swapping pair the one in the lower half.
    pub word: u32,
    /// Whether the word is one of a swapping pair.
    pub swap: bool,
    /// Whether an own pair is written after its round ends, in words that belong to the next one.
    pub late: bool,
    /// Whether it is a word of a ring, as it is in the first step.
    pub ring: bool,
}

/// Places of a value in its own PE.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Home {
    /// Word of the own memory.
    pub own: Option<Place>,
    /// Word of the base memory.
    pub base: Option<u32>,
    /// Word of the coefficient memory.
    pub factor: Option<u32>,
    /// Word of the index memory, of a table's argument.
    pub index: Option<u32>,
}

/// Depths of a PE's memories.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Depths {
    pub own: u32,
    pub base: u32,
    /// Words for factors; coefficients come on top.
    pub factors: u32,
    pub imported: u32,
    pub indices: u32,
    /// Bits that count the words of a ring.
    pub ring_bits: u32,
    /// Words of a part's states in own and base memory, and of those in the imported memory; a power of two.
    pub strides: [u32; 2],
}

/// Places of all values.
pub(super) struct Memories {
    /// Places of each value in its own PE.
    pub homes: Vec<Home>,
    /// Depths of each PE's memories.
    pub depths: List<PeId, Depths>,
    /// Columns of tables: PE, first base word, and a value that the column gives.
    pub columns: Vec<(PeId, u32, ValueId)>,
    /// Place of each imported value, by value and PE; start and end value of a state have entries of their
    /// own. Sorted.
    imported: Vec<((ValueId, PeId), Place)>,
}

impl Memories {
    /// Place of a value imported by a PE.
    pub fn import(&self, value: ValueId, pe: PeId) -> Place {
        let found = self.imported.binary_search_by_key(&(value, pe), |(import, _)| *import);
        self.imported[found.expect("operands from other PEs are imported")].1
    }

    /// All imports in order.
    pub fn imports(&self) -> impl Iterator<Item = (ValueId, PeId)> {
        self.imported.iter().map(|(import, _)| *import)
    }

    /// Places the values of one round.
    pub fn allocate(rounds: &Rounds, fixed: &FixedPoint, mapping: &Mapping, schedule: &Schedule) -> Memories {
        let graph = rounds.graph.as_ref();
        let lives = Lives::of(graph, mapping, schedule, Latency::of(&fixed.format));
        let pes = index::at(mapping.pes);
        let mut memories = Memories {
            homes: vec![Home::default(); graph.values.len()],
            depths: List::filled(Depths::default(), pes),
            columns: Vec::new(),
            imported: Vec::new(),
        };
        let rings = Rings::of(graph);
        memories.count_rings(graph, mapping, schedule, &rings);
        memories.allocate_indices(graph, mapping, schedule.period, &lives);
        memories.allocate_own(rounds, fixed, mapping, schedule.period, (&lives, &rings));
        memories.allocate_imported(rounds, schedule, &lives, &rings);
        memories
    }

    /// The rings of a PE have one size, whether they are in its own or in its imported memory.
    fn count_rings(&mut self, graph: &StepGraph, mapping: &Mapping, schedule: &Schedule, rings: &Rings) {
        let homes = rings.members.keys().map(|head| {
            let equation = graph.value(graph.states[*head].1).equation.expect("states have a PE");
            (mapping.pe_of[equation], *head)
        });
        let received = schedule.transfers.iter().filter_map(|transfer| match graph.value(transfer.value).role {
            Role::Next(head) => Some((transfer.to, head)),
            _ => None,
        });
        for (pe, head) in homes.chain(received) {
            let bits = rings.members.get(&head).map_or(0, |members| index_bits(oldest(members) + 1));
            self.depths[pe].ring_bits = self.depths[pe].ring_bits.max(bits);
        }
    }

    /// Indices live from the word of their argument to the last lookup.
    fn allocate_indices(&mut self, graph: &StepGraph, mapping: &Mapping, period: u32, lives: &Lives) {
        let mut arcs: List<PeId, Vec<Arc>> = List::filled(Vec::new(), self.depths.len());
        for (argument, last_read) in &lives.indexed {
            let equation = graph.value(*argument).equation.expect("arguments of tables have a PE");
            let pe = mapping.pe_of[equation];
            let write = lives.own[argument.index()].0;
            arcs[pe].push(Arc { write, last_read: *last_read, key: argument.number() });
        }
        for (depths, arcs) in self.depths.iter_mut().zip(arcs) {
            let (assigned, count) = pack(arcs, period);
            for (argument, register) in assigned {
                self.homes[index::at(argument)].index = Some(register);
            }
            depths.indices = if count > 0 { depth(count) } else { 0 };
        }
    }

    /// Empty layouts of all PEs.
    fn layouts(&self) -> List<PeId, Layout> {
        self.depths.iter().map(|depths| Layout { ring_bits: depths.ring_bits, ..Layout::default() }).collect()
    }

    /// Places for the columns that each PE reads, the first one at or behind `end`; the ends.
    fn allocate_columns(
        &mut self,
        rounds: &Rounds,
        fixed: &FixedPoint,
        mapping: &Mapping,
        mut ends: List<PeId, u32>,
    ) -> List<PeId, u32> {
        let graph = rounds.graph.as_ref();
        let length = index::number(graph.functions.segments.count());
        // Equal columns are stored once, whatever their tables.
        let mut contents: HashMap<Vec<u64>, usize> = HashMap::new();
        let mut content = |column: &Vec<f64>| {
            let next = contents.len();
            *contents.entry(column.iter().map(|number| number.to_bits()).collect()).or_insert(next)
        };
        let tables = graph.functions.tables.iter();
        let contents: Vec<Vec<usize>> = tables.map(|table| table.columns.iter().map(&mut content).collect()).collect();
        let mut known: HashMap<(PeId, usize, i32, bool), u32> = HashMap::new();
        for (index, value) in graph.values.iter().enumerate() {
            let Role::Column(lookup, column) = value.role else { continue };
            let pe = mapping.pe_of[value.equation.expect("columns have a PE")];
            let id = rounds.original(ValueId::at(index));
            let table = index::at(graph.functions.lookups[index::at(lookup)].table);
            let content = contents[table][usize::from(column)];
            let end = &mut ends[pe];
            let columns = &mut self.columns;
            let place = known.entry((pe, content, fixed.exponents[id.index()], value.factor)).or_insert_with(|| {
                let place = end.next_multiple_of(length);
                *end = place + length;
                columns.push((pe, place, id));
                place
            });
            self.homes[index].base = Some(*place);
        }
        ends
    }

    fn allocate_own(
        &mut self,
        rounds: &Rounds,
        fixed: &FixedPoint,
        mapping: &Mapping,
        period: u32,
        (lives, rings): (&Lives, &Rings),
    ) {
        let graph = rounds.graph.as_ref();
        let swap = graph.swaps();
        let pes = index::at(mapping.pes);
        let mut layouts = self.layouts();
        let mut bases: List<PeId, u32> = List::filled(0, pes);
        let pe_of = |index: usize| mapping.pe_of[graph.values[index].equation.expect("own values have a PE")];
        let mut slots: Vec<Option<Slot>> = vec![None; graph.values.len()];
        // A state and its running sum are a pair in the base memory: their addresses differ in one bit.
        let mut base_layouts: List<PeId, Layout> = List::filled(Layout::default(), pes);
        let mut places: Vec<Option<Slot>> = vec![None; graph.values.len()];
        // Words of both memories come first, at equal indices.
        for (index, (state, next)) in graph.states.numbered() {
            let pe = pe_of(state.index());
            if rings.pasts.find(index).is_some() {
                if rings.members.contains_key(&index) {
                    slots[next.index()] = Some(layouts[pe].ring());
                }
                continue;
            }
            slots[state.index()] = Some(layouts[pe].resident(swap));
            if rounds.sums {
                places[state.index()] = Some(base_layouts[pe].resident(true));
            } else {
                self.homes[state.index()].base = Some(bases[pe]);
                bases[pe] += 1;
            }
        }
        // The states of a part side by side, those of all parts one behind the other.
        if rounds.are_parts() {
            for (pe, depths) in self.depths.numbered_mut() {
                depths.strides[0] = if bases[pe] > 0 { bases[pe].next_power_of_two() } else { 0 };
                bases[pe] = rounds.count * depths.strides[0];
                layouts[pe].pairs = bases[pe];
            }
        }
        // Of a one-stage solver these are states before their jumps.
        let both = |value: &u32| lives.bases[index::at(*value)] && lives.operands[index::at(*value)];
        for value in (0..graph.values.len() as u32).filter(both) {
            if slots[index::at(value)].is_none() && graph.values[index::at(value)].equation.is_some() {
                let pe = pe_of(index::at(value));
                slots[index::at(value)] = Some(layouts[pe].resident(false));
                self.homes[index::at(value)].base = Some(bases[pe]);
                bases[pe] += 1;
            }
        }
        let shared: List<PeId, u32> = layouts.iter().map(|layout| layout.pairs + layout.single).collect();
        let mut constants: HashMap<(PeId, bool, i64), u32> = HashMap::new();
        let mut own_arcs: List<PeId, Vec<Arc>> = List::filled(Vec::new(), pes);
        let mut base_arcs = own_arcs.clone();
        let mut factor_arcs = own_arcs.clone();
        for (index, value) in graph.values.iter().enumerate() {
            if value.equation.is_none() || matches!(value.role, Role::State(_) | Role::Next(_) | Role::Column(..)) {
                continue;
            }
            if rounds.sums && matches!(value.role, Role::Sum(..)) {
                continue;
            }
            let pe = pe_of(index);
            let is_base = lives.bases[index];
            if is_base && lives.operands[index] {
                continue;
            }
            if let Role::Constant(number) = value.role {
                // Equal words are stored once.
                let word = fixed.number_word(number, rounds.original(ValueId::at(index)), value);
                let count = if is_base { &mut bases[pe] } else { &mut layouts[pe].single };
                let slot = *constants.entry((pe, is_base, word)).or_insert_with(|| {
                    *count += 1;
                    *count - 1
                });
                match is_base {
                    true => self.homes[index].base = Some(slot),
                    false => slots[index] = Some(Slot::Single(slot)),
                }
                continue;
            }
            let (write, last_read) = lives.own[index];
            let arc = Arc { write, last_read: last_read.max(write), key: index::number(index) };
            match (value.factor, is_base) {
                (true, _) => factor_arcs[pe].push(arc),
                (false, true) => base_arcs[pe].push(arc),
                (false, false) => own_arcs[pe].push(arc),
            }
        }
        for pe in layouts.ids() {
            let (assigned, count) = pack(std::mem::take(&mut own_arcs[pe]), period);
            let first = layouts[pe].single;
            layouts[pe].single += count;
            for (value, register) in assigned {
                slots[index::at(value)] = Some(Slot::Single(first + register));
            }
            let (assigned, count) = pack(std::mem::take(&mut base_arcs[pe]), period);
            for (value, register) in assigned {
                self.homes[index::at(value)].base = Some(bases[pe] + register);
            }
            bases[pe] += count;
        }
        let ends = self.allocate_columns(rounds, fixed, mapping, bases.clone());
        for (pe, depths) in self.depths.numbered_mut() {
            base_layouts[pe].single = ends[pe];
            depths.base = base_layouts[pe].depth();
            let (assigned, count) = pack(std::mem::take(&mut factor_arcs[pe]), period);
            for (value, register) in assigned {
                self.homes[index::at(value)].factor = Some(register);
            }
            depths.factors = count;
            // Behind the pairs of the lower half is room for the other words that both memories take at one address.
            layouts[pe].least = if layouts[pe].pairs > 0 { depth(2 * shared[pe]) } else { 0 };
            depths.own = layouts[pe].depth();
        }
        if rounds.sums {
            for (index, home) in self.homes.iter_mut().enumerate() {
                let slot = places[index].or(home.base.map(Slot::Single));
                home.base = slot.map(|slot| base_layouts[pe_of(index)].place(slot).word);
            }
            for (index, value) in graph.values.iter().enumerate() {
                if let Role::Sum(state, _) = value.role {
                    let place = self.homes[graph.states[state].0.index()].base;
                    self.homes[index].base = place.map(|word| word + self.depths[pe_of(index)].base / 2);
                }
            }
        }
        for index in 0..graph.values.len() {
            if let Some(slot) = slots[index] {
                self.homes[index].own = Some(layouts[pe_of(index)].place(slot));
            }
        }
        for (index, (state, next)) in graph.states.numbered() {
            match rings.pasts.find(index) {
                None => {
                    let home = &mut self.homes[state.index()];
                    home.own.iter_mut().for_each(|place| place.late = lives.own[next.index()].0 >= period);
                    self.homes[next.index()] = *home;
                }
                Some(past) => {
                    let ring = self.homes[graph.states[past.head].1.index()].own.expect("placed above");
                    let bits = self.depths[pe_of(state.index())].ring_bits;
                    self.homes[state.index()].own = Some(ring.behind(past.age, bits));
                }
            }
        }
    }

    fn allocate_imported(&mut self, rounds: &Rounds, schedule: &Schedule, lives: &Lives, rings: &Rings) {
        let graph = rounds.graph.as_ref();
        let swap = graph.swaps();
        let mut layouts = self.layouts();
        let mut arcs: List<PeId, Vec<Arc>> = List::filled(Vec::new(), layouts.len());
        let mut pairs: Vec<(usize, Slot)> = Vec::new();
        for (index, transfer) in schedule.transfers.iter().enumerate() {
            let pe = transfer.to;
            let last_read = |value: ValueId| lives.last_read(value, transfer.to);
            match graph.value(transfer.value).role {
                Role::Next(head) if rings.members.contains_key(&head) => pairs.push((index, layouts[pe].ring())),
                Role::Next(_) if swap => pairs.push((index, layouts[pe].resident(true))),
                Role::Next(s) => {
                    // The word lives on into the next round, until its last read under the state's own name.
                    let start = graph.states[s].0;
                    let end = last_read(start).map_or(0, |read| read + schedule.period);
                    let end = end.max(last_read(transfer.value).unwrap_or(0)).max(transfer.receive);
                    debug_assert!(end - transfer.receive < schedule.period, "a word is read behind its next arrival");
                    // The initial image holds all states at once, so even one that arrives after the wrap owns its
                    // word from the wrap on.
                    let write = transfer.receive.min(schedule.period - 1);
                    arcs[pe].push(Arc { write, last_read: end, key: index::number(index) });
                }
                _ => {
                    let end = last_read(transfer.value).unwrap_or(0).max(transfer.receive);
                    arcs[pe].push(Arc { write: transfer.receive, last_read: end, key: index::number(index) });
                }
            }
        }
        let mut slots: Vec<(usize, Slot)> = pairs;
        if rounds.are_parts() {
            for (pe, layout) in layouts.numbered_mut() {
                self.depths[pe].strides[1] = layout.pairs.next_power_of_two();
                layout.pairs = if layout.pairs > 0 { rounds.count * self.depths[pe].strides[1] } else { 0 };
            }
        }
        for (pe, arcs) in arcs.numbered_mut() {
            let (assigned, count) = pack(std::mem::take(arcs), schedule.period);
            let base = layouts[pe].single;
            layouts[pe].single += count;
            slots.extend(
                assigned.into_iter().map(|(index, register)| (index::at(index), Slot::Single(base + register))),
            );
            self.depths[pe].imported = if layouts[pe].is_empty() { 0 } else { layouts[pe].depth() };
        }
        for (index, slot) in slots {
            let transfer = &schedule.transfers[index];
            let place = layouts[transfer.to].place(slot);
            if let Role::Next(s) = graph.value(transfer.value).role
                && let Some(members) = rings.members.get(&s)
            {
                let bits = self.depths[transfer.to].ring_bits;
                let places = members.iter().map(|(member, age)| (graph.states[*member].0, place.behind(*age, bits)));
                self.imported.extend(places.map(|(start, place)| ((start, transfer.to), place)));
            } else if let Role::Next(s) = graph.value(transfer.value).role {
                // A word that is read under the name of the end value alone may be another's when the step begins.
                let start = graph.states[s].0;
                if swap || lives.last_read(start, transfer.to).is_some() {
                    self.imported.push(((start, transfer.to), place));
                }
            }
            self.imported.push(((transfer.value, transfer.to), place));
        }
        self.imported.sort_unstable_by_key(|(import, _)| *import);
    }
}

impl Place {
    /// The word of a ring that was written so many steps ago, of what is written here.
    fn behind(self, age: u32, bits: u32) -> Place {
        let mask = (1 << bits) - 1;
        Place { word: self.word & !mask | self.word.wrapping_sub(age) & mask, ..self }
    }
}

/// The rings of a step.
struct Rings {
    pasts: Pasts,
    /// Members of each ring with their ages, by its head.
    members: BTreeMap<StateId, Vec<(StateId, u32)>>,
}

impl Rings {
    fn of(graph: &StepGraph) -> Rings {
        let pasts = Pasts::of(graph);
        let mut members: BTreeMap<StateId, Vec<(StateId, u32)>> = BTreeMap::new();
        for (state, past) in pasts.members() {
            members.entry(past.head).or_default().push((state, past.age));
        }
        Rings { pasts, members }
    }
}

/// The largest age.
fn oldest(members: &[(StateId, u32)]) -> u32 {
    members.iter().map(|(_, age)| *age).max().unwrap_or(0)
}

/// A reserved word: swapping pairs, single words and rings are numbered apart until the depth is known.
#[derive(Clone, Copy, Debug)]
enum Slot {
    Pair(u32),
    Single(u32),
    /// A ring, whose first word is what is written in the first step.
    Ring(u32),
}

/// How a memory is filled: pairs from the bottom of both halves, single words behind them, rings from the top.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Layout {
    pairs: u32,
    single: u32,
    rings: u32,
    ring_bits: u32,
    /// Depth that the memory needs for other reasons.
    least: u32,
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

    fn ring(&mut self) -> Slot {
        self.rings += 1;
        Slot::Ring(self.rings - 1)
    }

    fn is_empty(&self) -> bool {
        self.pairs + self.single + self.rings == 0
    }

    fn depth(&self) -> u32 {
        // What no memory has is refused, however large.
        let rings = self.rings.saturating_mul(1 << self.ring_bits).min(1 << 24);
        let depth = depth(2 * self.pairs + self.single + rings).max(self.least);
        // Rings end where the pairs of the upper half do.
        if rings > 0 && self.pairs > 0 && depth / 2 < self.pairs + rings { 2 * depth } else { depth }
    }

    fn place(&self, slot: Slot) -> Place {
        match slot {
            Slot::Pair(word) => Place { word, swap: true, ..Place::default() },
            Slot::Ring(index) => {
                let word = self.depth().wrapping_sub((index + 1) << self.ring_bits);
                Place { word, ring: true, ..Place::default() }
            }
            Slot::Single(index) => {
                let lower = self.depth() / 2 - self.pairs;
                let word =
                    if index < lower { self.pairs + index } else { self.depth() / 2 + self.pairs + index - lower };
                Place { word, ..Place::default() }
            }
        }
    }
}

/// When each value is written and last read.
struct Lives {
    /// By value: write word and last own read.
    own: Vec<(u32, u32)>,
    /// For each value whether it is read as a base.
    bases: Vec<bool>,
    /// For each value whether it is an operand in its own PE.
    operands: Vec<bool>,
    /// Last read of the index of each argument of a table.
    indexed: BTreeMap<ValueId, u32>,
    /// By value and PE: last read of the import; sorted.
    imported: Vec<((ValueId, PeId), u32)>,
}

impl Lives {
    fn of(graph: &StepGraph, mapping: &Mapping, schedule: &Schedule, latency: Latency) -> Lives {
        let mut own = vec![(0, 0); graph.values.len()];
        let mut bases = vec![false; graph.values.len()];
        let mut operands = vec![false; graph.values.len()];
        let mut indexed: BTreeMap<ValueId, u32> = BTreeMap::new();
        let mut imported: Vec<((ValueId, PeId), u32)> = Vec::new();
        for (index, chain) in graph.chains.numbered() {
            let pe = mapping.pe_of[chain.equation];
            let start = schedule.starts[index];
            let last = start + chain.len() - 1;
            for (time, position) in (start..).zip(chain.terms.clone()) {
                let term = &graph.terms[index::at(schedule.order[index::at(position)])];
                let equation = graph.value(term.operand).equation;
                if equation.is_some_and(|equation| mapping.pe_of[equation] == pe) {
                    let read = &mut own[term.operand.index()].1;
                    *read = (*read).max(time);
                    operands[term.operand.index()] = true;
                } else {
                    imported.push(((term.operand, pe), time));
                }
                if let Some(partner) = term.partner {
                    imported.push(((partner, pe), time));
                }
                if let Factor::Value(value) = term.factor {
                    let read = &mut own[value.index()].1;
                    *read = (*read).max(time);
                }
            }
            for (delay, write) in chain.delayed(latency) {
                let scale = last + latency.scale() + delay;
                if let Some(base) = write.base {
                    if let Some((_, lookup)) = graph.lookup(base) {
                        let read = indexed.entry(lookup.argument).or_insert(0);
                        *read = (*read).max(scale - Latency::INDEX_TO_SCALE);
                    } else {
                        let read = &mut own[base.index()].1;
                        *read = (*read).max(scale);
                        bases[base.index()] = true;
                    }
                }
                own[write.value.index()].0 = scale + latency.scale_to_write();
            }
        }
        // The last read of each import stays.
        imported.sort_unstable_by_key(|(import, read)| (*import, Reverse(*read)));
        imported.dedup_by_key(|(import, _)| *import);
        Lives { own, bases, operands, indexed, imported }
    }

    /// Last read of the import of a value by a PE, if it reads it.
    fn last_read(&self, value: ValueId, pe: PeId) -> Option<u32> {
        let found = self.imported.binary_search_by_key(&(value, pe), |(import, _)| *import);
        found.ok().map(|at| self.imported[at].1)
    }
}
