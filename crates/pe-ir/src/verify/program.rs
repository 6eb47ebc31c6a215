//! Checks a program by running it on symbols instead of numbers.
//!
//! The checker follows every control word through the pipeline of the datasheet, with names of values in place of
//! words, and compares what is written with what the step graph says. It knows nothing of schedules or register
//! allocation. What it enforces:
//!
//! 1. each write stores exactly the products, base and shift of the chain of the value it claims to write;
//! 2. each operand, factor and base is that value of that step: nothing read too early, nothing overwritten too soon;
//! 3. a received word is the one its link carries at that time;
//! 4. every value is written once per step, every output is captured when its value is in the result register, and its place
//!    in an output memory is the one that the word gets which the PE shows then;
//! 5. before the pause point of the first round nothing is written;
//! 6. words of rings have the age that they are read as, see [`super::rings`];
//! 7. an index is that of the value and step which the graph looks up, and the base words that it chooses among are the
//!    column of the graph, in order and never overwritten.
//!
//! PEs meet on their links only. A link carries what its sender claims to send, and each PE is held to its own claims; so
//! they run through a round one after the other, and what one of them needs stays in the cache of the processor.

use std::collections::VecDeque;
use std::rc::Rc;

use crate::graph::{Factor, FixedPoint, Role, StepGraph, ValueId};
use crate::index::{self, ChainId, List, PeId};
use crate::program::{Address, CoefficientOperand, ControlWord, LinkSource, PeProgram, Program, Target};
use crate::word::Pipeline;

/// What a register or memory word holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
enum Cell {
    /// Nothing known.
    Unknown,
    /// A word of the initial image.
    Image(i64),
    /// A value of a step. The end value of a state is its start value in the next step.
    Value(ValueId, i64),
    /// The base word, from this one on, that the segment of a value of a step tells; whether octaves are counted.
    Entry(u16, ValueId, i64, bool),
}

/// What a word of the index memory tells the segment of: value, step, and whether octaves are counted.
type Index = (ValueId, i64, bool);

/// A product: data operand and second factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Product {
    operand: Cell,
    factor: Cell,
}

/// The products of a control word: two where the pre-adder joins two operands.
type Operands = [Option<Product>; 2];

/// The products of a finished sum, sorted.
type Sum = Rc<[Product]>;

/// A finished sum on its way to memory.
#[derive(Clone, Debug)]
struct Result {
    base: Option<Cell>,
    sum: Sum,
    shift: u8,
}

struct Pe<'a> {
    program: &'a PeProgram,
    own: Vec<Cell>,
    base: Vec<Cell>,
    coefficients: Vec<Cell>,
    imported: Vec<Cell>,
    products: VecDeque<Operands>,
    accumulator: Vec<Product>,
    hold: Sum,
    /// Base and shift of the adder.
    scale: (Option<Cell>, u8),
    /// Results on their way to the result register, the front one first.
    added: VecDeque<Option<Result>>,
    result: Option<Result>,
    /// Words that send, in order, each with the value that it claims to send.
    sends: Vec<(u32, Option<ValueId>)>,
    /// Index memory, and its read register; none is nothing known.
    indices: Vec<Option<Index>>,
    index: IndexRegister,
}

/// The read register of the index memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum IndexRegister {
    /// Cleared: the base address is that of the control word.
    Clear,
    /// An index of something known or not.
    Loaded(Option<Index>),
}

/// Runs `rounds` rounds of the program on symbols; returns what is wrong, at most a few dozen findings.
pub fn check(program: &Program, graph: &StepGraph, fixed: &FixedPoint, rounds: u32) -> Vec<String> {
    if let Err(what) = program.check_outputs() {
        return vec![what];
    }
    let violations = super::rings::check(program, graph);
    if !violations.is_empty() {
        return violations;
    }
    let mut checker = Checker::new(program, graph, fixed);
    for round in 0..rounds {
        for pe in program.pes.ids() {
            for word in 0..program.period {
                checker.clock(pe, round, word);
                if checker.violations.len() > 24 {
                    return checker.violations;
                }
            }
        }
        checker.count(round);
    }
    checker.violations
}

struct Checker<'a> {
    program: &'a Program,
    graph: &'a StepGraph,
    fixed: &'a FixedPoint,
    producers: Vec<Option<ChainId>>,
    /// Start value of a state for its end value, else none.
    start_of: Vec<Option<ValueId>>,
    /// What a state in a ring was so many steps ago, else none.
    past: Vec<Option<(ValueId, i64)>>,
    /// Outputs by the PE and word in which they are captured, sorted.
    captures: Vec<((PeId, u32), usize)>,
    pes: List<PeId, Pe<'a>>,
    written: Vec<u32>,
    /// Products of the value under `written_cell`.
    expected: Vec<Product>,
    violations: Vec<String>,
}

impl<'a> Checker<'a> {
    fn new(program: &'a Program, graph: &'a StepGraph, fixed: &'a FixedPoint) -> Self {
        let accumulate = index::at(program.latency().accumulate());
        let addition = match program.format.pipeline {
            Pipeline::Short => 1,
            Pipeline::Deep => 2,
        };
        let mut start_of = vec![None; graph.values.len()];
        let mut past = vec![None; graph.values.len()];
        for (state, next) in &graph.states {
            let (mut before, mut age) = (*next, 0);
            while let Role::State(other) = graph.value(before).role {
                let (other, end) = graph.states[other];
                if let Some((head, further)) = past[other.index()] {
                    past[state.index()] = Some((head, age + 1 + further));
                    age += 1;
                    break;
                }
                past[state.index()] = Some((other, age + 1));
                (before, age) = (end, age + 1);
            }
            if age == 0 {
                start_of[next.index()] = Some(*state);
            }
        }
        let places = program.outputs.iter().map(|output| (output.pe, output.word));
        let mut captures: Vec<_> = places.zip(0..).collect();
        captures.sort_unstable();
        let pes = program.pes.iter().map(|pe| Pe {
            program: pe,
            own: pe.own_image.iter().map(|word| Cell::Image(*word)).collect(),
            base: pe.base_image.iter().map(|word| Cell::Image(*word)).collect(),
            coefficients: pe.coefficient_image.iter().map(|word| Cell::Image(*word)).collect(),
            imported: vec![Cell::Unknown; pe.imported_image.len()],
            products: std::iter::repeat_n([None; 2], accumulate).collect(),
            accumulator: Vec::new(),
            hold: Rc::default(),
            scale: (None, u8::MAX),
            added: std::iter::repeat_n(None, addition).collect(),
            result: None,
            sends: sends(pe),
            indices: vec![None; index::at(pe.features.index_words)],
            index: IndexRegister::Clear,
        });
        let mut checker = Checker {
            program,
            graph,
            fixed,
            producers: graph.producers(),
            start_of,
            past,
            captures,
            pes: pes.collect(),
            written: vec![0; graph.values.len()],
            expected: Vec::new(),
            violations: Vec::new(),
        };
        for (register, (state, _)) in program.states.iter().zip(&graph.states) {
            let cell = checker.cell(*state, 0, |word| word);
            let pe = &mut checker.pes[register.own.0];
            pe.own[usize::from(register.own.1)] = cell;
            if register.age.is_none() {
                pe.base[pe.program.features.state_base(register.own.1)] = cell;
            }
            for (pe, word) in &register.imported {
                checker.pes[*pe].imported[usize::from(*word)] = cell;
            }
        }
        checker
    }

    fn fail(&mut self, pe: PeId, round: u32, word: u32, text: String) {
        self.violations.push(format!("round {round}, word {word}, PE {pe}: {text}"));
    }

    /// The cell that a value of a step is; a constant is the word as `seen` by what reads it.
    fn cell(&self, value: ValueId, step: i64, seen: impl Fn(i64) -> i64) -> Cell {
        match self.graph.value(value).role {
            Role::Constant(_) => Cell::Image(seen(self.fixed.constant_word(self.graph, value))),
            _ => match (self.start_of[value.index()], self.past[value.index()]) {
                (Some(state), _) => Cell::Value(state, step + 1),
                (None, Some((head, age))) => Cell::Value(head, step - age),
                (None, None) => Cell::Value(value, step),
            },
        }
    }

    /// Follows one control word of a PE.
    fn clock(&mut self, index: PeId, round: u32, word: u32) {
        let length = self.program.round_words();
        let parity = (round * self.program.rounds + word / length) % 2 == 1;
        let pause = self.program.latency().pause();
        let settled = round > 0 || word >= pause;
        let step = i64::from(round);
        let finishing = self.finishing(round, word);
        let control = self.pes[index].program.words[index::at(word)];
        let note = self.pes[index].program.notes[index::at(word)];
        if control.own.is_some() && control.imported.is_some() {
            self.joined((index, round, word), &control, parity);
        }
        if note.write.is_some() && control.write.is_none() && control.write_index.is_none() {
            self.fail(index, round, word, "a noted write is missing".into());
        }
        let operands = self.pes[index].read(&control, (parity, round));
        let indices = &self.pes[index].indices;
        let fetched = control.index.map_or(IndexRegister::Clear, |address| {
            IndexRegister::Loaded(indices.get(usize::from(address)).copied().flatten())
        });
        self.capture(index, round, word, finishing);
        let writes = settled && (control.write.is_some() || control.write_index.is_some());
        let written = writes.then(|| self.written_cell(index, round, word, note.write, finishing));
        if let (Some(target), Some(cell)) = (control.write, written) {
            if !self.pes[index].program.features.reaches(target) {
                self.fail(index, round, word, "a write address beyond its memory".into());
            }
            let target = Target { base: target.base && self.takes_base(index, word), ..target };
            self.pes[index].write(target, (parity, round), cell);
        }
        if let (Some((address, octaves)), Some(cell)) = (control.write_index, written) {
            let known = match cell {
                Cell::Value(value, step) => Some((value, step, octaves)),
                _ => None,
            };
            self.pes[index].indices[usize::from(address)] = known;
        }
        // Whatever is sent may set the overflow flag, received or not.
        if control.send && note.write.is_none() {
            self.fail(index, round, word, "sends a value without a name".into());
        }
        if let Some((port, address)) = control.receive.filter(|_| settled) {
            let cell = match self.pes[index].program.ports.find(port) {
                Some(LinkSource::Pe(source)) => self.link(*source, round, word),
                // Inputs of a step are sampled at its pause point.
                Some(LinkSource::Input(input)) if word > pause => {
                    Cell::Value(self.graph.inputs[index::at(*input)], step)
                }
                _ => Cell::Unknown,
            };
            let noted = note.receive.map(|value| self.cell(value, self.received_step(value, finishing, step), |w| w));
            if noted != Some(cell) {
                let name = self.program.name(note.receive).to_owned();
                self.fail(index, round, word, format!("receives {cell:?} instead of `{name}`"));
            }
            let pe = &mut self.pes[index];
            let slot = pe.physical(address, pe.imported.len(), (parity, round));
            pe.imported[slot] = cell;
        }
        self.pes[index].advance(&control, operands, fetched);
    }

    /// The step whose writes are under way: those before the pause point finish the step before.
    fn finishing(&self, round: u32, word: u32) -> i64 {
        i64::from(round) - i64::from(word < self.program.latency().pause())
    }

    /// What the link of a PE carries as a word begins.
    fn link(&self, pe: PeId, round: u32, word: u32) -> Cell {
        let sends = &self.pes[pe].sends;
        let before = sends.partition_point(|(sent, _)| *sent < word);
        let last = match before.checked_sub(1) {
            Some(at) => Some((sends[at], round)),
            None => sends.last().copied().zip(round.checked_sub(1)),
        };
        match last {
            Some(((sent, Some(value)), round)) => self.cell(value, self.finishing(round, sent), |word| word),
            _ => Cell::Unknown,
        }
    }

    /// Checks that the pre-adder may join the two operands of a word: no sum of theirs leaves the data port.
    fn joined(&mut self, (pe, round, word): (PeId, u32, u32), control: &ControlWord, parity: bool) {
        let joins = self.pes[pe].program.features.pre_adder;
        let (products, _) = self.pes[pe].read(control, (parity, round));
        for product in products.into_iter().flatten() {
            if !joins || !matches!(product.factor, Cell::Image(_)) {
                self.fail(pe, round, word, "two operands".into());
            }
            let room = match product.operand {
                Cell::Value(value, _) => self.fixed.half_scale[value.index()],
                Cell::Image(_) | Cell::Entry(..) | Cell::Unknown => false,
            };
            if !room {
                self.fail(pe, round, word, format!("{:?} is too large for a sum", product.operand));
            }
        }
    }

    /// Whether a PE's base memory is written in a word of a step.
    fn takes_base(&self, pe: PeId, word: u32) -> bool {
        !self.pes[pe].program.features.base_last || self.program.ends_step(word)
    }

    /// Inputs belong to the running step, everything else to the step whose writes are under way.
    fn received_step(&self, value: ValueId, finishing: i64, step: i64) -> i64 {
        match self.graph.values.get(value.index()).map(|value| value.role) {
            Some(Role::Input(_)) => step,
            _ => finishing,
        }
    }

    fn capture(&mut self, pe: PeId, round: u32, word: u32, step: i64) {
        if round == 0 && word < self.program.latency().pause() {
            return;
        }
        let here = (pe, word);
        let first = self.captures.partition_point(|(place, _)| *place < here);
        for (_, output) in self.captures[first..].iter().take_while(|(place, _)| *place == here) {
            let noted = self.pes[pe].program.notes[index::at(word)].write;
            if noted.is_none() || self.graph.outputs.get(*output).copied() != noted {
                let name = &self.program.outputs[*output].name;
                let text = format!("output `{name}` captured from another value, step {step}");
                self.violations.push(format!("round {round}, word {word}, PE {pe}: {text}"));
            }
        }
    }

    /// Checks that the result register holds what the note claims; returns what the memory word becomes.
    fn written_cell(&mut self, pe: PeId, round: u32, word: u32, value: Option<ValueId>, step: i64) -> Cell {
        let Some(id) = value else {
            self.fail(pe, round, word, "writes a value without a name".into());
            return Cell::Unknown;
        };
        let Some(producer) = self.producers[id.index()] else {
            self.fail(pe, round, word, format!("`{}` has no chain", self.graph.value_name(id)));
            return Cell::Unknown;
        };
        let chain = &self.graph.chains[producer];
        let position = chain.writes().position(|write| write.value == id).unwrap_or(0);
        let write = chain.writes().nth(position).expect("position found above");
        let format = self.fixed.format;
        let mut expected = std::mem::take(&mut self.expected);
        expected.clear();
        expected.extend(chain.terms.clone().map(|index| {
            let term = &self.graph.terms[index::at(index)];
            let factor = match term.factor {
                Factor::Coefficient(_) => Cell::Image(self.fixed.coefficients[index::at(index)]),
                Factor::Value(factor) => self.cell(factor, step, |word| format.factor_operand(word)),
            };
            Product { operand: self.cell(term.operand, step, |word| format.data_operand(word)), factor }
        }));
        expected.sort_unstable();
        let expected_base = write.base.map(|base| match self.graph.value(base).role {
            Role::Column(..) => self.entry(pe, base, step),
            _ => self.cell(base, step, |word| word),
        });
        let problem = match &self.pes[pe].result {
            None => Some("no result".to_owned()),
            Some(result) => {
                let sum = &result.sum;
                let wrong = sum.iter().zip(&expected).find(|(is, should)| is != should);
                if sum.len() != expected.len() || wrong.is_some() {
                    Some(format!("{} products instead of {}, first difference {wrong:?}", sum.len(), expected.len()))
                } else if result.base != expected_base || expected_base == Some(Cell::Unknown) {
                    Some(format!("base {:?} instead of {expected_base:?}", result.base))
                } else if result.shift != self.fixed.shifts[producer][position] {
                    Some(format!("shift {} instead of {}", result.shift, self.fixed.shifts[producer][position]))
                } else {
                    None
                }
            }
        };
        self.expected = expected;
        if let Some(problem) = problem {
            self.fail(pe, round, word, format!("`{}` of step {step}: {problem}", self.graph.value_name(id)));
        }
        self.written[id.index()] += 1;
        self.cell(id, step, |word| word)
    }

    /// What the base must be where the graph looks a column up; unknown if the column is not where it is looked up.
    fn entry(&self, pe: PeId, base: ValueId, step: i64) -> Cell {
        let found = self.pes[pe].result.as_ref().and_then(|result| result.base);
        let (Role::Column(lookup, _), Some(Cell::Entry(first, ..))) = (self.graph.value(base).role, found) else {
            return Cell::Unknown;
        };
        let functions = &self.graph.functions;
        let lookup = functions.lookups[index::at(lookup)];
        let image = &self.pes[pe].program.base_image[usize::from(first)..];
        let words = (0..functions.segments.count()).map(|segment| self.fixed.column_word(self.graph, base, segment));
        let same = image.len() >= words.len() && words.zip(image).all(|(should, is)| should == *is);
        match self.cell(lookup.argument, step, |word| word) {
            Cell::Value(value, step) if same => {
                Cell::Entry(first, value, step, functions.tables[index::at(lookup.table)].octaves)
            }
            _ => Cell::Unknown,
        }
    }

    /// After a round every value has been written once per finished step.
    fn count(&mut self, round: u32) {
        if round == 0 {
            // The writes of the last words are still to come; from here on each round sees every value once.
            self.written.iter_mut().for_each(|count| *count = 0);
            return;
        }
        for (index, count) in self.written.iter_mut().enumerate() {
            let expected = u32::from(self.producers[index].is_some());
            if *count != expected {
                let name = self.graph.value_name(ValueId::at(index));
                self.violations.push(format!("round {round}: `{name}` written {count} times instead of {expected}"));
            }
            *count = 0;
        }
    }
}

impl Pe<'_> {
    /// What a control word reads from the memories, before this word's writes.
    fn read(&self, control: &ControlWord, turn: (bool, u32)) -> (Operands, Option<Cell>) {
        let own = |address: Address| self.own[self.physical(address, self.own.len(), turn)];
        let base = |word: u16| match self.index {
            IndexRegister::Clear => self.base[usize::from(word)],
            IndexRegister::Loaded(index) => self.entry(word, index),
        };
        let imported = |address: Address| self.imported[self.physical(address, self.imported.len(), turn)];
        let factor = match control.coefficient {
            CoefficientOperand::Coefficient(coefficient) => Cell::Image(coefficient),
            CoefficientOperand::Stored(word) => self.coefficients[usize::from(word)],
        };
        let operands = [control.own.map(own), control.imported.map(imported)];
        (operands.map(|operand| operand.map(|operand| Product { operand, factor })), control.base.map(base))
    }

    /// The base word that an index chooses, if it chooses among words that nothing writes.
    fn entry(&self, first: u16, index: Option<Index>) -> Cell {
        let count = 1 << self.program.features.index_bits;
        let words = self.base.get(usize::from(first)..usize::from(first) + count).unwrap_or_default();
        let constant = |cell: &Cell| matches!(cell, Cell::Image(_));
        match index {
            Some((value, step, octaves))
                if usize::from(first) % count == 0 && words.len() == count && words.iter().all(constant) =>
            {
                Cell::Entry(first, value, step, octaves)
            }
            _ => Cell::Unknown,
        }
    }

    /// The memories take a result.
    fn write(&mut self, target: Target, turn: (bool, u32), cell: Cell) {
        let features = &self.program.features;
        if target.own {
            // The address may be wider than this memory needs.
            let word = target.address.word & (self.own.len() - 1) as u16;
            let slot = self.physical(Address { word, ..target.address }, self.own.len(), turn);
            self.own[slot] = cell;
        }
        if target.base {
            self.base[features.base_word(target.address.word)] = cell;
        }
        if target.factor {
            self.coefficients[features.factor_word(target.address.word)] = cell;
        }
    }

    /// The word that an address means, with swapped buffers or not, in a round.
    fn physical(&self, address: Address, depth: usize, (parity, round): (bool, u32)) -> usize {
        let index = usize::from(address.word);
        match address {
            Address { ring: true, .. } => {
                let mask = (1 << self.program.features.ring_bits) - 1;
                index & !mask | (index + index::at(round)) & mask
            }
            Address { swap: true, .. } if parity => index ^ (depth / 2),
            _ => index,
        }
    }

    /// Moves the pipeline on by one word.
    fn advance(&mut self, control: &ControlWord, (products, base): (Operands, Option<Cell>), index: IndexRegister) {
        self.index = index;
        self.result = self.added.pop_front().flatten();
        self.added.push_back(Some(Result { base: self.scale.0, sum: Rc::clone(&self.hold), shift: self.scale.1 }));
        self.scale = (base, self.program.features.shifts.get(usize::from(control.shift)).copied().unwrap_or(u8::MAX));
        let arriving = self.products.pop_front().unwrap_or_default();
        if control.close {
            self.accumulator.sort_unstable();
            self.hold = Rc::from(&self.accumulator[..]);
            self.accumulator.clear();
        }
        self.accumulator.extend(arriving.into_iter().flatten());
        self.products.push_back(products);
    }
}

/// The words of a PE that send, and what they claim to send.
fn sends(pe: &PeProgram) -> Vec<(u32, Option<ValueId>)> {
    let words = (0..).zip(pe.words.iter().zip(&pe.notes));
    words.filter(|(_, (control, _))| control.send).map(|(word, (_, note))| (word, note.write)).collect()
}
