//! Assembles the program: registers, control words, memory images, links.

mod coefficients;
mod limits;
mod memory;
mod provenance;
mod registers;
mod variants;

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroU32;

use pe_ir::functions::Lookup;
use pe_ir::graph::{Chain, Factor, FixedPoint, Role, StepGraph, ValueId};
use pe_ir::index::{self, ChainId, List, PeId, PortId, StateId};
use pe_ir::mapping::Mapping;
use pe_ir::model::Model;
use pe_ir::pasts::Pasts;
use pe_ir::program::{
    Address, CoefficientOperand, ControlWord, InputPort, Layout, LinkSource, Note, OutputPort, PeFeatures, PeProgram,
    Program, StateRegister, Target, Tick,
};
use pe_ir::schedule::Schedule;
use pe_ir::word::Latency;

use coefficients::Coefficients;
pub use limits::TooLarge;
use memory::Memories;
pub use provenance::coefficients;

use crate::rounds::Rounds;

/// Assembles a scheduled step graph as one round.
///
/// # Errors
/// If some PE needs more memory words or input ports than fields of the control word can tell apart.
pub fn assemble(
    model: &Model,
    graph: &StepGraph,
    fixed: &FixedPoint,
    mapping: &Mapping,
    schedule: &Schedule,
) -> Result<Program, TooLarge> {
    assemble_rounds(model, graph, fixed, mapping, &Rounds::single(graph), schedule)
}

/// Assembles a step graph from the schedule of one of its rounds.
///
/// # Errors
/// Those of [`assemble`].
pub fn assemble_rounds(
    model: &Model,
    graph: &StepGraph,
    fixed: &FixedPoint,
    mapping: &Mapping,
    rounds: &Rounds,
    round: &Schedule,
) -> Result<Program, TooLarge> {
    let memories = Memories::allocate(rounds, fixed, &rounds.mapping(mapping), round);
    let schedule = &rounds.unroll(graph, round);
    let coefficients = Coefficients::of(rounds, graph, &fixed.coefficients, index::at(mapping.pes));
    let latency = Latency::of(&fixed.format);
    let read = graph.chains.iter().flat_map(Chain::writes).filter_map(|write| graph.lookup(write.base?));
    let octaves =
        |(_, lookup): (u32, Lookup)| (lookup.argument, graph.functions.tables[index::at(lookup.table)].octaves);
    let octaves = read.map(octaves).collect();
    let bases = graph.chains.iter().flat_map(Chain::writes).filter_map(|write| write.base);
    let bases = marked(graph, bases.chain(graph.states.iter().map(|(_, next)| *next)));
    let assembler =
        Assembler { model, graph, fixed, mapping, rounds, schedule, memories, coefficients, octaves, bases, latency };
    let ports = assembler.ports();
    let sizes = assembler.memories.depths.iter().zip(&ports);
    limits::check(sizes.map(|(depths, ports)| {
        [depths.own, depths.base, depths.imported, depths.indices, index::number(ports.len()), 0, 0]
    }))?;
    let mut program = assembler.program(&ports);
    // An output memory takes a bit more.
    let bits = |features| Layout::bits_of(features, &fixed.format) + 1;
    let sizes = program.pes.iter().map(|pe| &pe.features);
    limits::check(sizes.map(|features| [0, 0, 0, 0, 0, features.coefficient_words, bits(features)]))?;
    variants::choose(&mut program);
    Ok(program)
}

/// For each value whether it is among some.
fn marked(graph: &StepGraph, values: impl Iterator<Item = ValueId>) -> Vec<bool> {
    let mut marked = vec![false; graph.values.len()];
    values.for_each(|value| marked[value.index()] = true);
    marked
}

struct Assembler<'a> {
    model: &'a Model,
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    mapping: &'a Mapping,
    rounds: &'a Rounds<'a>,
    schedule: &'a Schedule,
    memories: Memories,
    /// Where the coefficients of each PE stand.
    coefficients: Coefficients,
    /// Arguments of tables that are read, and whether their indices count octaves.
    octaves: BTreeMap<ValueId, bool>,
    /// For each value whether sums are added to it, or it is a state of the next step.
    bases: Vec<bool>,
    latency: Latency,
}

impl Assembler<'_> {
    fn program(mut self, ports: &List<PeId, List<PortId, LinkSource>>) -> Program {
        let senders: BTreeSet<PeId> = ports.iter().flatten().filter_map(|source| source.pe()).collect();
        let mut pes: List<PeId, PeProgram> = PeId::all(self.mapping.pes)
            .map(|pe| {
                let ports = ports[pe].clone();
                let depths = self.memories.depths[pe];
                let features = PeFeatures {
                    own_words: depths.own,
                    base_words: depths.base,
                    coefficient_words: 0,
                    imported_words: depths.imported,
                    ports: index::number(ports.len()),
                    shifts: Vec::new(),
                    accumulator_bits: self.fixed.format.data_bits + self.fixed.format.coefficient_bits,
                    factor: false,
                    pre_adder: false,
                    swap: self.rounds.graph.swaps(),
                    base_last: self.rounds.base_last,
                    send: senders.contains(&pe),
                    proven: false,
                    index_words: depths.indices,
                    index_bits: if depths.indices > 0 { self.graph.functions.segments.index_bits } else { 0 },
                    octave_bits: 0,
                    shown_words: 0,
                    show_last: false,
                    ring_bits: depths.ring_bits,
                };
                self.blank(features, ports)
            })
            .collect();
        for (equation, pe) in self.mapping.pe_of.numbered() {
            pes[*pe].equations.push(self.graph.equations[equation].name.clone());
        }
        self.collect_features(&mut pes);
        self.place_columns(&mut pes);
        self.place_coefficients(&mut pes);
        let sent = marked(self.graph, self.schedule.transfers.iter().map(|transfer| transfer.value));
        for chain in self.graph.chains.ids() {
            self.emit_chain(chain, &mut pes, &sent);
        }
        self.emit_receives(&mut pes);
        let states = self.states(&mut pes);
        Program {
            host: pe_ir::program::Host::default(),
            model: self.model.name.clone(),
            format: self.fixed.format,
            period: self.schedule.period,
            rounds: self.rounds.count,
            pes,
            inputs: self.inputs(),
            outputs: self.outputs(),
            states,
            names: (0..self.graph.values.len() as u32).map(|id| self.graph.value_name(ValueId::new(id))).collect(),
        }
    }

    fn blank(&self, features: PeFeatures, ports: List<PortId, LinkSource>) -> PeProgram {
        let period = index::at(self.schedule.period);
        // Words nothing is stored in hold the number zero.
        PeProgram {
            own_image: vec![0; index::at(features.own_words)],
            base_image: vec![self.fixed.format.data_offset(); index::at(features.base_words)],
            coefficient_image: Vec::new(),
            imported_image: vec![0; index::at(features.imported_words)],
            features,
            ports,
            equations: Vec::new(),
            words: vec![ControlWord::default(); period],
            notes: vec![Note::default(); period],
            varied: Vec::new(),
        }
    }

    fn home(&self, value: ValueId) -> Option<PeId> {
        self.graph.value(value).equation.map(|equation| self.mapping.pe_of[equation])
    }

    /// Links into each PE: other PEs first, then inputs, each in order.
    fn ports(&self) -> List<PeId, List<PortId, LinkSource>> {
        let mut ports: List<PeId, BTreeSet<LinkSource>> = List::filled(BTreeSet::new(), index::at(self.mapping.pes));
        for transfer in &self.schedule.transfers {
            ports[transfer.to].insert(self.source(transfer.value));
        }
        ports.into_iter().map(|set| set.into_iter().collect()).collect()
    }

    fn source(&self, value: ValueId) -> LinkSource {
        match (self.home(value), self.graph.value(value).role) {
            (Some(pe), _) => LinkSource::Pe(pe),
            (None, Role::Input(input)) => LinkSource::Input(input),
            (None, role) => panic!("{role:?} has no PE"),
        }
    }

    fn collect_features(&self, pes: &mut List<PeId, PeProgram>) {
        let mut shifts: List<PeId, BTreeSet<u8>> = List::filled(BTreeSet::new(), pes.len());
        for (index, chain) in self.graph.chains.numbered() {
            let pe = self.mapping.pe_of[chain.equation];
            for (_, shift) in chain.writes().zip(self.fixed.shifts[index]) {
                shifts[pe].insert(shift);
            }
            let features = &mut pes[pe].features;
            features.accumulator_bits = features.accumulator_bits.max(u32::from(self.fixed.accumulator_bits[index]));
            let factors = self.graph.chain_terms(chain).iter().any(|t| matches!(t.factor, Factor::Value(_)));
            features.factor |= factors;
            features.pre_adder |= self.graph.chain_terms(chain).iter().any(|term| term.partner.is_some());
        }
        for (pe, shifts) in pes.iter_mut().zip(shifts) {
            pe.features.shifts = shifts.into_iter().collect();
        }
    }

    /// Writes the columns of tables into the images.
    fn place_columns(&self, pes: &mut List<PeId, PeProgram>) {
        let functions = &self.graph.functions;
        for (pe, first, value) in &self.memories.columns {
            let image = &mut pes[*pe].base_image[index::at(*first)..];
            for (segment, word) in image.iter_mut().take(functions.segments.count()).enumerate() {
                *word = self.fixed.column_word(self.graph, *value, segment);
            }
        }
        for lookup in functions.lookups.iter().filter(|lookup| functions.tables[index::at(lookup.table)].octaves) {
            let pe = self.home(lookup.argument).expect("arguments of tables have a PE");
            pes[pe].features.octave_bits = functions.segments.octave_bits;
        }
    }

    /// Control word of a time; times beyond the period belong to the next round.
    fn word(&self, time: u32) -> usize {
        debug_assert!(time < self.schedule.period + self.latency.pause());
        index::at(if time >= self.schedule.period { time - self.schedule.period } else { time })
    }

    /// Address of a value in its own PE, for an access at `time`.
    fn own_address(&self, value: ValueId, time: u32) -> Address {
        let (like, swaps) = self.rounds.value(value);
        let place = self.memories.homes[like.index()].own.expect("operands are in the own memory");
        let pe = self.home(value).expect("own values have a PE");
        let depths = self.memories.depths[pe];
        let part = self.of_part(value, 1);
        let place = memory::Place { word: place.word + part * depths.strides[0], ..place };
        // The base memory takes a write address as it is, whatever the round. If it has the bit that tells the halves apart,
        // the address that writes a pair is that of its lower half.
        let turns = if place.swap && depths.own <= depths.base { part + u32::from(!place.late) } else { 0 };
        self.address((place, swaps + turns), (depths.own, depths.ring_bits), time)
    }

    /// Address of a value in the imported memory of a PE, for an access at `time`.
    fn imported_address(&self, value: ValueId, pe: PeId, time: u32) -> Address {
        let (like, swaps) = self.rounds.value(value);
        let place = self.memories.import(like, pe);
        let depths = self.memories.depths[pe];
        let place = memory::Place { word: place.word + self.of_part(value, depths.strides[1]), ..place };
        self.address((place, swaps), (depths.imported, depths.ring_bits), time)
    }

    /// Where a value is written at `time`.
    fn target(&self, value: ValueId, time: u32) -> Target {
        let home = self.memories.homes[self.rounds.value(value).0.index()];
        let address = match (home.own, home.base.or(home.factor)) {
            (Some(_), _) => self.own_address(value, time),
            (None, word) => {
                let word = word.expect("values have a place");
                Address { word: u16::try_from(word).expect("memory depth"), ..Address::default() }
            }
        };
        // Of the values that take turns in a word, only those that something is added to need the base memory.
        let base = home.base.is_some() && (self.rounds.base_last || self.bases[value.index()]);
        Target { address, own: home.own.is_some(), base, factor: home.factor.is_some() }
    }

    fn base_word(&self, value: ValueId) -> u16 {
        let word = self.memories.homes[self.rounds.value(value).0.index()].base.expect("bases are in the base memory");
        let strides = self.home(value).map(|pe| self.memories.depths[pe].strides);
        let of_part = strides.map_or(0, |[own, _]| self.of_part(value, own));
        u16::try_from(word + of_part).expect("memory depth")
    }

    /// Where the words of a state's part begin, if the part of each state has its own words.
    fn of_part(&self, value: ValueId, stride: u32) -> u32 {
        match self.graph.value(value).role {
            Role::State(_) | Role::Next(_) => self.rounds.part(value) * stride,
            _ => 0,
        }
    }

    /// Word of the index memory of a table's argument.
    fn index_word(&self, argument: ValueId) -> u16 {
        let word = self.memories.homes[self.rounds.value(argument).0.index()].index;
        u16::try_from(word.expect("arguments of tables are in the index memory")).expect("memory depth")
    }

    /// Address of a word whose pair has changed roles `swaps` times since the step began, for an access at `time`.
    fn address(&self, (place, swaps): (memory::Place, u32), (depth, ring_bits): (u32, u32), time: u32) -> Address {
        if place.ring {
            // The hardware adds the number of the step, also of that which has already begun at `time`.
            let mask = (1 << ring_bits) - 1;
            let word = place.word & !mask | place.word.wrapping_sub(time / self.schedule.period) & mask;
            return Address { word: u16::try_from(word).expect("memory depth"), swap: false, ring: true };
        }
        // The hardware turns the address over in odd rounds, also in that which has already begun at `time`.
        let round = time / (self.schedule.period / self.rounds.count);
        let other = place.swap && (swaps + round) % 2 == 1;
        let word = if other { place.word + depth / 2 } else { place.word };
        Address { word: u16::try_from(word).expect("memory depth"), swap: place.swap, ring: false }
    }

    fn emit_chain(&self, index: ChainId, pes: &mut List<PeId, PeProgram>, sent: &[bool]) {
        let chain = &self.graph.chains[index];
        let number = self.mapping.pe_of[chain.equation];
        let start = self.schedule.starts[index];
        let last = start + chain.len() - 1;
        let pe = &mut pes[number];
        for (time, position) in (start..).zip(chain.terms.clone()) {
            let term_index = index::at(self.schedule.order[index::at(position)]);
            let term = &self.graph.terms[term_index];
            let at = self.word(time);
            let word = &mut pe.words[at];
            if self.home(term.operand) == Some(number) {
                word.own = Some(self.own_address(term.operand, time));
            } else {
                word.imported = Some(self.imported_address(term.operand, number, time));
            }
            if let Some(partner) = term.partner {
                word.imported = Some(self.imported_address(partner, number, time));
            }
            word.coefficient = match term.factor {
                Factor::Coefficient(_) => {
                    let place = self.schedule.order[index::at(position)] - chain.terms.start;
                    self.coefficient(number, index, place)
                }
                Factor::Value(value) => {
                    let like = self.rounds.value(value).0;
                    let word = self.memories.homes[like.index()].factor.expect("factors are in the coefficient memory");
                    CoefficientOperand::Stored(word as u16)
                }
            };
            pe.notes[at].operand = Some(term.operand);
            pe.notes[at].chain = Some(chain.write.value);
        }
        pe.words[self.word(last + self.latency.close())].close = true;
        for ((delay, write), shift) in chain.delayed(self.latency).zip(self.fixed.shifts[index]) {
            let scale = last + self.latency.scale() + delay;
            let store = scale + self.latency.scale_to_write();
            let slot = pe.features.shifts.binary_search(&shift).expect("collected from all chains");
            if let Some((_, lookup)) = write.base.and_then(|base| self.graph.lookup(base)) {
                pe.words[self.word(scale - Latency::INDEX_TO_SCALE)].index = Some(self.index_word(lookup.argument));
            }
            let word = &mut pe.words[self.word(scale)];
            word.base = write.base.map(|base| self.base_word(base));
            word.shift = slot as u8;
            let word = &mut pe.words[self.word(store)];
            word.write_index = self.octaves.get(&write.value).map(|o| (self.index_word(write.value), *o));
            word.write = Some(self.target(write.value, store));
            word.send = write.value == chain.write.value && sent[write.value.index()];
            pe.notes[self.word(store)].write = Some(write.value);
        }
    }

    fn emit_receives(&self, pes: &mut List<PeId, PeProgram>) {
        for transfer in &self.schedule.transfers {
            let pe = &mut pes[transfer.to];
            let port = pe.ports.binary_search(&self.source(transfer.value)).expect("collected from all transfers");
            // An input is held over the step: it is received in every round, which makes rounds alike.
            let repeats = match self.graph.value(transfer.value).role {
                Role::Input(_) => self.rounds.count,
                _ => 1,
            };
            for round in 0..repeats {
                let receive = transfer.receive + round * (self.schedule.period / self.rounds.count);
                let address = self.imported_address(transfer.value, transfer.to, receive);
                let at = self.word(receive);
                pe.words[at].receive = Some((PortId::at(port), address));
                pe.notes[at].receive = Some(transfer.value);
            }
        }
    }

    /// Registers of the states; writes constants and initial values into the images.
    fn states(&self, pes: &mut List<PeId, PeProgram>) -> List<StateId, StateRegister> {
        for (index, value) in self.rounds.graph.values.iter().enumerate() {
            if let Role::Constant(number) = value.role {
                let id = self.rounds.original(ValueId::at(index));
                let pe = self.home(id).expect("constants have a PE");
                let home = self.memories.homes[index];
                let word = self.fixed.number_word(number, id, value);
                if let Some(place) = home.own {
                    pes[pe].own_image[index::at(place.word)] = self.fixed.format.data_operand(word);
                }
                if let Some(base) = home.base {
                    pes[pe].base_image[index::at(base)] = word;
                }
            }
        }
        let pasts = Pasts::of(self.graph);
        let mut states: List<StateId, StateRegister> = List::with_capacity(self.graph.states.len());
        for (index, (state, _)) in self.graph.states.numbered() {
            let pe = self.home(*state).expect("states have a PE");
            let address = self.own_address(*state, 0);
            states.push(StateRegister {
                name: self.graph.names.states[index].clone(),
                exponent: self.fixed.exponents[state.index()],
                own: (pe, address.word),
                imported: Vec::new(),
                age: pasts.find(index).and_then(|past| NonZeroU32::new(past.age)),
                tunable: self.model.states.find(index).is_some_and(|state| state.tunable),
            });
        }
        let mut imported: BTreeMap<ValueId, Vec<PeId>> = BTreeMap::new();
        for (value, pe) in self.memories.imports() {
            imported.entry(value).or_default().push(pe);
        }
        for (state, (start, _)) in states.iter_mut().zip(&self.graph.states) {
            let pes = imported.get(&self.rounds.value(*start).0).into_iter().flatten();
            state.imported.extend(pes.map(|pe| (*pe, self.imported_address(*start, *pe, 0).word)));
        }
        for (state, initial) in states.iter().zip(&self.graph.initial) {
            let (word, _) = self.fixed.format.encode(*initial, state.exponent, self.fixed.format.data_offset());
            state.set(pes, &self.fixed.format, word);
        }
        states
    }

    fn inputs(&self) -> Vec<InputPort> {
        let inputs = self.graph.names.inputs.iter().zip(&self.graph.inputs);
        // Ticks come behind the inputs of the model.
        let ticks = self.model.ticks().map(|(_, steps)| Some(Tick { steps: steps as u32, done: 0 }));
        let ticks = self.model.inputs.iter().map(|_| None).chain(ticks);
        inputs
            .zip(ticks)
            .enumerate()
            .map(|(index, ((name, value), tick))| InputPort {
                name: name.clone(),
                unit: self.model.inputs.get(index).and_then(|input| input.unit.clone()),
                exponent: self.fixed.exponents[value.index()] + self.fixed.format.guard_bits as i32,
                tick,
            })
            .collect()
    }

    fn outputs(&self) -> Vec<OutputPort> {
        let producers = self.graph.producers();
        let output = |(index, value): (usize, &ValueId)| {
            let chain_index = producers[value.index()].expect("a chain computes each output");
            let chain = &self.graph.chains[chain_index];
            let (delay, _) =
                chain.delayed(self.latency).find(|(_, write)| write.value == *value).expect("its producer writes it");
            let last = self.schedule.starts[chain_index] + chain.len() - 1;
            let unit = match self.model.outputs[index].variable {
                pe_ir::model::Variable::State(s) => self.model.states[s].unit.clone(),
                pe_ir::model::Variable::Input(i) => self.model.inputs[index::at(i)].unit.clone(),
                pe_ir::model::Variable::Algebraic(a) => self.model.algebraics[index::at(a)].unit.clone(),
            };
            OutputPort {
                name: self.model.outputs[index].name.clone(),
                unit,
                pe: self.mapping.pe_of[chain.equation],
                word: index::number(self.word(last + self.latency.write() + delay)),
                exponent: self.fixed.exponents[value.index()] + self.fixed.format.guard_bits as i32,
                proven: false,
                place: None,
            }
        };
        self.graph.outputs.iter().enumerate().map(output).collect()
    }
}
