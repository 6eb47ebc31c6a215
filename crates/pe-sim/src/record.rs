//! What a program does in one step, found by executing its control words once on names of words instead of words
//! (symbolic execution).
//!
//! The control words alone decide what every register and memory word holds when, so one look at them suffices: what
//! remains for each step are the sums that reach a result which something reads. Registers and memories are those of
//! the datasheet, clock by clock, whatever the bits of the control words; nothing here knows of values or equations.
//! Rings are followed as they are in the first step; at the end of each step their words move on by a place.
//!
//! Words live in slots. Every register and memory word has a *home*, where the next step finds what it held at the end
//! of this one; what a step computes gets slots of its own. Sums that are under way at the end of a step are kept.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::rc::Rc;

use pe_ir::index::{self, List, PeId, at};
use pe_ir::program::{Address, CoefficientOperand, ControlWord, LinkSource, PeFeatures, Program};

use crate::tiles::{Chain, Columns, Factor, Outcome, Term, Write};
use crate::trace::MemoryWrite;
use crate::words;

/// The slot of the word 0, and of what a missing base adds.
pub(crate) const NULL: u32 = 0;
pub(crate) const OFFSET: u32 = 1;

/// Where the words of a network lie between steps.
pub(crate) struct Homes {
    inputs: u32,
    pes: List<PeId, PeHomes>,
    pub count: u32,
}

#[derive(Clone, Copy)]
struct PeHomes {
    own: u32,
    base: u32,
    coefficients: u32,
    imported: u32,
    link: u32,
    /// Base words in the scale register, and from there on in the registers of sums up to the result register.
    scale: u32,
    results: u32,
    /// Indices, as words, in the index memory and in its read register.
    indices: u32,
    index: u32,
}

impl Homes {
    pub fn new(program: &Program) -> Homes {
        let mut count = OFFSET + 1 + index::number(program.inputs.len());
        let results = result_registers(program);
        let mut take = |words: usize| {
            count += index::number(words);
            count - index::number(words)
        };
        let mut home = |pe: &pe_ir::program::PeProgram| PeHomes {
            own: take(pe.own_image.len()),
            base: take(pe.base_image.len()),
            coefficients: take(pe.coefficient_image.len()),
            imported: take(pe.imported_image.len()),
            link: take(1),
            scale: take(1),
            results: take(at(results)),
            indices: take(at(pe.features.index_words)),
            index: take(1),
        };
        let pes = program.pes.iter().map(&mut home).collect();
        Homes { inputs: OFFSET + 1, pes, count }
    }

    /// An input.
    pub fn input(&self, index: u32) -> u32 {
        self.inputs + index
    }

    /// A word of an own memory.
    pub fn own(&self, pe: PeId, word: usize) -> u32 {
        self.pes[pe].own + index::number(word)
    }

    /// A word of a base memory.
    pub fn base(&self, pe: PeId, word: usize) -> u32 {
        self.pes[pe].base + index::number(word)
    }

    /// A word of a coefficient memory.
    pub fn coefficient(&self, pe: PeId, word: usize) -> u32 {
        self.pes[pe].coefficients + index::number(word)
    }

    /// A word of an imported memory.
    pub fn imported(&self, pe: PeId, word: usize) -> u32 {
        self.pes[pe].imported + index::number(word)
    }
}

/// Sums under way between two steps: registers of the same PE that add up to one, as a bit set.
#[derive(Default)]
pub(crate) struct KeptSums {
    indices: BTreeMap<(PeId, u64), u32>,
    pub sums: Vec<(PeId, u64)>,
}

impl KeptSums {
    fn index(&mut self, pe: PeId, registers: u64) -> Option<u32> {
        if registers == 0 {
            return None;
        }
        let next = index::number(self.sums.len());
        let index = *self.indices.entry((pe, registers)).or_insert(next);
        if index == next {
            self.sums.push((pe, registers));
        }
        Some(index)
    }
}

/// Registers behind the scale register up to the result register.
fn result_registers(program: &Program) -> u32 {
    program.latency().scale_to_write() - 1
}

/// Registers that hold sums, as bits; those of results, and those of products, follow each other.
const ACCUMULATOR: u64 = 1;
const HOLD: u64 = 2;
const RESULT: u64 = 4;
const PRODUCT: u64 = 32;

/// A sum: registers of the step before, and products.
#[derive(Clone, Debug, Default)]
struct Sum {
    registers: u64,
    terms: Vec<Term<i64>>,
}

impl Sum {
    fn of_register(registers: u64) -> Sum {
        Sum { registers, terms: Vec::new() }
    }

    fn add(&mut self, other: &Sum) {
        self.registers |= other.registers;
        self.terms.extend_from_slice(&other.terms);
    }

    fn add_product(&mut self, product: &Product) {
        self.registers |= product.registers;
        self.terms.extend(product.terms.iter().flatten());
    }
}

/// What one control word multiplies, on its way to the accumulator: a register of the step before, or a term for each
/// operand.
#[derive(Clone, Copy, Debug)]
struct Product {
    registers: u64,
    terms: [Option<Term<i64>>; 2],
}

/// A finished sum and the chain that forms it, if any does.
#[derive(Debug, Default)]
struct Held {
    sum: Sum,
    chain: Cell<Option<u32>>,
}

/// What becomes a result: base, sum and shift; and the slot of the result if anything reads it.
#[derive(Clone, Debug)]
struct Pending {
    base: u32,
    held: Rc<Held>,
    shift: u8,
    slot: Option<u32>,
}

struct Pe {
    own: Vec<u32>,
    base: Vec<u32>,
    /// Coefficients that nothing writes are numbers.
    coefficients: Vec<Factor<i64>>,
    imported: Vec<u32>,
    /// Products on their way: the front one is accumulated next.
    products: VecDeque<Product>,
    accumulator: Sum,
    hold: Rc<Held>,
    /// Base word and shift of the adder.
    scale: (u32, u8),
    /// From the adder's first register to the result register, which is the front one.
    results: VecDeque<Pending>,
    link: u32,
    indices: Vec<u32>,
    /// Index that the base address takes.
    index: u32,
}

/// Control words to follow: `words` of each PE, from word `from` for `count` words.
pub(crate) struct Stretch<'a> {
    pub program: &'a Program,
    pub words: &'a List<PeId, Vec<ControlWord>>,
    pub from: u32,
    pub count: u32,
    /// Parity at its beginning.
    pub parity: bool,
    /// Whether the pipeline is only filled: all registers are zero before, and no memory is written.
    pub settle: bool,
}

/// A word moved from a slot to another.
pub(crate) type Move = (u32, u32);

/// What homes take over at the end of a step, all at once.
#[derive(Clone, Debug, Default)]
pub(crate) struct Moves {
    /// Words of base memories and registers.
    pub words: Vec<Move>,
    /// Data operands of own and imported memories and links.
    pub operands: Vec<Move>,
    /// Words of coefficient memories.
    pub factors: Vec<Move>,
}

/// What a stretch of control words does.
pub(crate) struct Recording {
    pub chains: Vec<Chain>,
    pub terms: Vec<Term<i64>>,
    /// Number of slots, homes included.
    pub slots: u32,
    /// In the order of time, within a control word in that of the PEs.
    pub writes: Vec<MemoryWrite>,
    /// Slot of each output.
    pub outputs: Vec<u32>,
    /// Slots whose saturation sets the overflow flag.
    pub flagged: Vec<u32>,
    /// Of these the words of PEs that do not saturate.
    pub proven: Vec<u32>,
    /// Operands of sums in front of a multiplier: beyond half of full scale they set the overflow flag soon after.
    pub paired: Vec<u32>,
    /// Those of the last words, which set it in the step that follows.
    pub paired_last: Vec<u32>,
    /// Base words that indices choose among.
    pub columns: Columns,
    /// Where in [`Columns::choices`] the same words stand.
    known_choices: BTreeMap<Vec<u32>, u32>,
    accumulator_bits: List<PeId, u32>,
    format: pe_ir::word::WordFormat,
    pes: List<PeId, Pe>,
}

impl Recording {
    /// Follows a stretch.
    pub fn new(stretch: &Stretch, homes: &Homes, kept: &mut KeptSums) -> Recording {
        let program = stretch.program;
        let pe = |index: PeId| Pe::new(stretch, &homes.pes[index], index);
        let mut recording = Recording {
            chains: Vec::new(),
            terms: Vec::new(),
            slots: homes.count,
            writes: Vec::new(),
            outputs: vec![NULL; program.outputs.len()],
            flagged: Vec::new(),
            proven: Vec::new(),
            paired: Vec::new(),
            paired_last: Vec::new(),
            columns: Columns { segments: program.segments(), choices: Vec::new() },
            known_choices: BTreeMap::new(),
            accumulator_bits: program.pes.iter().map(|pe| pe.features.accumulator_bits).collect(),
            format: program.format,
            pes: program.pes.ids().map(pe).collect(),
        };
        let mut captures: BTreeMap<(u32, PeId), Vec<usize>> = BTreeMap::new();
        for (index, output) in program.outputs.iter().enumerate() {
            captures.entry((output.word, output.pe)).or_default().push(index);
        }
        let (mut word, mut parity, mut turn) = (stretch.from, stretch.parity, 0);
        for cycle in 0..stretch.count {
            let links: List<PeId, u32> = recording.pes.iter().map(|pe| pe.link).collect();
            for pe in program.pes.ids() {
                let captured = captures.get(&(word, pe)).map_or(&[][..], Vec::as_slice);
                recording.clock(stretch, homes, kept, (cycle, word, parity, turn), pe, &links, captured);
            }
            word += 1;
            if word.is_multiple_of(program.round_words()) {
                parity = !parity;
            }
            if word == program.period {
                (word, turn) = (0, turn + 1);
            }
        }
        if !stretch.settle {
            for ((index, pe), words) in recording.pes.numbered_mut().zip(stretch.words) {
                pe.turn(&rings(words, &program.pes[index].features), &program.pes[index].features);
            }
        }
        recording
    }

    /// Executes one control word in one PE.
    #[allow(clippy::too_many_arguments)]
    fn clock(
        &mut self,
        stretch: &Stretch,
        homes: &Homes,
        kept: &mut KeptSums,
        (cycle, word, parity, turn): (u32, u32, bool, u32),
        index: PeId,
        links: &List<PeId, u32>,
        captured: &[usize],
    ) {
        let ends_step = stretch.program.ends_step(word);
        let program = &stretch.program.pes[index];
        let word = stretch.words[index][at(word)];
        let pe = &self.pes[index];
        let own_depth = pe.own.len();
        let features = &program.features;
        let physical = |address: Address, depth: usize| physical(address, depth, (parity, u64::from(turn)), features);
        // Reads come before the writes at the end of the word.
        let second = match word.coefficient {
            CoefficientOperand::Coefficient(value) => Factor::Coefficient(value),
            CoefficientOperand::Stored(address) => pe.coefficients[usize::from(address)],
        };
        let own = word.own.map(|a| pe.own[physical(a, own_depth)]);
        let imported = word.imported.map(|a| pe.imported[physical(a, pe.imported.len())]);
        let operands = own.into_iter().chain(imported);
        if program.features.pre_adder && own.is_some() && imported.is_some() {
            if cycle + stretch.program.latency().operand_flag() >= stretch.count {
                self.paired_last.extend(operands.clone());
            } else if !stretch.settle {
                self.paired.extend(operands.clone());
            }
        }
        let term = |operand: u32| Term { operand, factor: second };
        let product = Product { registers: 0, terms: [own.map(term), imported.map(term)] };
        let base = word.base.map_or(OFFSET, |word| self.base_word(index, word));
        let next_index = word.index.map_or(NULL, |address| self.pes[index].indices[usize::from(address)]);
        let write = word.write.filter(|_| !stretch.settle);
        let write_index = word.write_index.filter(|_| !stretch.settle);
        if write.is_some() || write_index.is_some() || word.send || !captured.is_empty() {
            let slot = self.result(index, kept);
            if let Some(target) = write {
                // The swap bit turns the top bit of the own memory's address over, also in a wider write address.
                let address = physical(target.address, own_depth);
                let ring = if target.address.ring { program.features.ring_bits } else { 0 };
                let pe = &mut self.pes[index];
                if target.own {
                    pe.own[address & (own_depth - 1)] = slot;
                }
                if target.base && (ends_step || !program.features.base_last) {
                    pe.base[program.features.base_word(target.address.word)] = slot;
                }
                if target.factor {
                    pe.coefficients[program.features.factor_word(target.address.word)] = Factor::Value(slot);
                }
                self.writes.push(MemoryWrite {
                    cycle,
                    pe: index,
                    address: index::number(address),
                    offset: 0,
                    ring,
                    slot,
                    own: true,
                });
            }
            if let Some((address, octaves)) = write_index {
                let segment = self.lookup(|target| Outcome::Segment { target, argument: slot, octaves });
                self.pes[index].indices[usize::from(address)] = segment;
            }
            // A value that is only sent must not saturate unseen either.
            if !stretch.settle && (write.is_some() || write_index.is_some() || word.send) {
                self.flagged.push(slot);
                self.proven.extend(program.features.proven.then_some(slot));
            }
            if word.send {
                self.pes[index].link = slot;
            }
            captured.iter().for_each(|output| self.outputs[*output] = slot);
        }
        let pe = &mut self.pes[index];
        if let Some((port, a)) = word.receive.filter(|_| !stretch.settle) {
            let slot = match program.ports[port] {
                LinkSource::Pe(source) => links[source],
                LinkSource::Input(input) => homes.input(input),
            };
            let address = physical(a, pe.imported.len());
            let ring = if a.ring { program.features.ring_bits } else { 0 };
            pe.imported[address] = slot;
            let (address, offset) = (index::number(address), program.features.write_words());
            self.writes.push(MemoryWrite { cycle, pe: index, address, offset, ring, slot, own: false });
        }
        let scaled = Pending { base: pe.scale.0, held: Rc::clone(&pe.hold), shift: pe.scale.1, slot: None };
        pe.results.push_back(scaled);
        pe.results.pop_front();
        pe.index = next_index;
        pe.scale = (base, program.features.shifts.get(usize::from(word.shift)).copied().unwrap_or(0));
        if word.close {
            pe.hold = Rc::new(Held { sum: std::mem::take(&mut pe.accumulator), chain: Cell::new(None) });
        }
        if let Some(oldest) = pe.products.pop_front() {
            pe.accumulator.add_product(&oldest);
        }
        pe.products.push_back(product);
    }

    /// The slot of the base word that a PE reads: with an index, of the one that it chooses.
    fn base_word(&mut self, index: PeId, word: u16) -> u32 {
        let pe = &self.pes[index];
        if pe.index == NULL {
            return pe.base[usize::from(word)];
        }
        let segment = pe.index;
        let words = 0..self.columns.segments.count();
        let among: Vec<u32> = words.map(|index| pe.base[usize::from(word) | index]).collect();
        let next = index::number(self.columns.choices.len());
        let first = *self.known_choices.entry(among).or_insert_with_key(|among| {
            self.columns.choices.extend(among);
            next
        });
        self.lookup(|target| Outcome::Choice { target, segment, among: first })
    }

    /// A new slot with the outcome of a lookup.
    fn lookup(&mut self, outcome: impl FnOnce(u32) -> Outcome) -> u32 {
        let slot = self.slots;
        self.slots += 1;
        let none = index::number(self.terms.len());
        self.chains.push(Chain { terms: none..none, start: None, outcome: outcome(slot), class: 0 });
        slot
    }

    /// The slot of the word in a PE's result register; from now on something reads it.
    fn result(&mut self, index: PeId, kept: &mut KeptSums) -> u32 {
        let pending = self.pes[index].results[0].clone();
        if let Some(slot) = pending.slot {
            return slot;
        }
        let slot = self.slots;
        self.slots += 1;
        self.pes[index].results[0].slot = Some(slot);
        let write = Write { target: slot, base: pending.base, shift: i32::from(pending.shift) };
        // A sum is written three times at most, and again only with a base that is there before the first write or is
        // its result.
        if let Some(chain) = pending.held.chain.get()
            && let Outcome::Words(first, others) = &mut self.chains[at(chain)].outcome
            && pending.base <= first.target
            && let Some(other) = others.iter_mut().find(|other| other.is_none())
        {
            *other = Some(write);
            return slot;
        }
        pending.held.chain.set(Some(index::number(self.chains.len())));
        let start = kept.index(index, pending.held.sum.registers);
        self.chain(index, &pending.held.sum.terms, start, Outcome::Words(write, [None, None]));
        slot
    }

    fn chain(&mut self, pe: PeId, terms: &[Term<i64>], start: Option<u32>, outcome: Outcome) {
        let from = index::number(self.terms.len());
        self.terms.extend_from_slice(terms);
        let limit = self.accumulator_bits[pe];
        let bits = self.bits(terms);
        let fits = start.is_none() && bits <= limit;
        let class = words::class(&self.format, if fits { bits } else { limit }, !fits);
        self.chains.push(Chain { terms: from..self.terms.len() as u32, start, outcome, class });
    }

    /// Bits that hold any sum of these products, whatever the operands.
    fn bits(&self, terms: &[Term<i64>]) -> u32 {
        let bound = |term: &Term<i64>| match term.factor {
            Factor::Coefficient(value) => u128::from(value.unsigned_abs()),
            Factor::Value(_) => 1 << (self.format.coefficient_bits - 1),
        };
        let sum: u128 = terms.iter().map(bound).sum::<u128>() << (self.format.data_bits - 1);
        (sum + 1).ilog2() + 2
    }

    /// Adds chains that keep the sum of some registers of a PE as they are at the end.
    pub fn keep(&mut self, sum: u32, kept: &mut KeptSums) {
        let (pe, registers) = kept.sums[at(sum)];
        let all = self.pes[pe].sum_of(registers);
        let start = kept.index(pe, all.registers);
        self.chain(pe, &all.terms, start, Outcome::Kept(sum));
    }

    /// What homes have to take over at the end.
    pub fn moves(&self, homes: &Homes) -> Moves {
        let Moves { mut words, mut operands, mut factors } = Moves::default();
        for (pe, home) in self.pes.iter().zip(&homes.pes) {
            words.extend(pe.base.iter().copied().zip(home.base..));
            words.extend(pe.indices.iter().copied().zip(home.indices..));
            words.push((pe.index, home.index));
            words.push((pe.scale.0, home.scale));
            words.extend(pe.results.iter().map(|result| result.base).zip(home.results..));
            factors.extend(pe.coefficients.iter().zip(home.coefficients..).filter_map(|(factor, to)| match factor {
                Factor::Value(from) => Some((*from, to)),
                Factor::Coefficient(_) => None,
            }));
            operands.extend(pe.own.iter().copied().zip(home.own..));
            operands.extend(pe.imported.iter().copied().zip(home.imported..));
            operands.push((pe.link, home.link));
        }
        let all = [&mut words, &mut operands, &mut factors];
        all.into_iter().for_each(|moves| moves.retain(|(from, to)| from != to));
        Moves { words, operands, factors }
    }
}

impl Pe {
    fn new(stretch: &Stretch, homes: &PeHomes, index: PeId) -> Pe {
        let program = &stretch.program.pes[index];
        let accumulate = u64::from(stretch.program.latency().accumulate());
        // In steady state the word before has filled the scale register, the one before that the sum, and so on.
        let scale = |base: u32, before: u32| {
            if stretch.settle {
                return (NULL, 0);
            }
            let period = stretch.program.period;
            let word = stretch.words[index][at((stretch.from + period - before) % period)];
            (base, program.features.shifts.get(usize::from(word.shift)).copied().unwrap_or(0))
        };
        let period = stretch.program.period;
        let before = stretch.words[index][at((stretch.from + period - 1) % period)];
        let register = |bit: u64| if stretch.settle { Sum::default() } else { Sum::of_register(bit) };
        let held = |bit: u64| Rc::new(Held { sum: register(bit), chain: Cell::new(None) });
        let results = result_registers(stretch.program);
        let result = |position: u32| {
            let (base, shift) = scale(homes.results + position, results + 1 - position);
            Pending { base, held: held(RESULT << position), shift, slot: None }
        };
        let targets = stretch.words[index].iter().filter_map(|word| word.write).filter(|target| target.factor);
        let written: BTreeSet<usize> =
            targets.map(|target| program.features.factor_word(target.address.word)).collect();
        let coefficient = |(word, number): (usize, &i64)| match written.contains(&word) {
            true => Factor::Value(homes.coefficients + index::number(word)),
            false => Factor::Coefficient(*number),
        };
        Pe {
            base: (homes.base..homes.base + index::number(program.base_image.len())).collect(),
            coefficients: program.coefficient_image.iter().enumerate().map(coefficient).collect(),
            own: (homes.own..homes.own + index::number(program.own_image.len())).collect(),
            imported: (homes.imported..homes.imported + index::number(program.imported_image.len())).collect(),
            products: (0..accumulate)
                .map(|position| Product { registers: register(PRODUCT << position).registers, terms: [None; 2] })
                .collect(),
            accumulator: register(ACCUMULATOR),
            hold: held(HOLD),
            scale: scale(homes.scale, 1),
            results: (0..results).map(result).collect(),
            link: homes.link,
            indices: (homes.indices..homes.indices + program.features.index_words).collect(),
            index: if stretch.settle || before.index.is_none() { NULL } else { homes.index },
        }
    }

    /// Words of rings move on by a place.
    fn turn(&mut self, rings: &[BTreeSet<usize>; 2], features: &PeFeatures) {
        for (memory, rings) in [&mut self.own, &mut self.imported].into_iter().zip(rings) {
            rings.iter().for_each(|first| memory[*first..][..1 << features.ring_bits].rotate_left(1));
        }
    }

    /// The sum of some registers.
    fn sum_of(&self, registers: u64) -> Sum {
        let mut sum = Sum::default();
        let fixed = [(ACCUMULATOR, &self.accumulator), (HOLD, &self.hold.sum)];
        let results = self.results.iter().enumerate().map(|(position, result)| (RESULT << position, &result.held.sum));
        for (_, part) in fixed.into_iter().chain(results).filter(|(bit, _)| registers & bit != 0) {
            sum.add(part);
        }
        let products = self.products.iter().enumerate().map(|(position, product)| (PRODUCT << position, product));
        for (_, product) in products.filter(|(bit, _)| registers & bit != 0) {
            sum.add_product(product);
        }
        sum
    }
}

/// Memory index of an address: that of a pair has its top bit inverted in odd steps, that of a ring is a place further in each.
pub(crate) fn physical(address: Address, depth: usize, (parity, step): (bool, u64), features: &PeFeatures) -> usize {
    let index = usize::from(address.word);
    match address {
        Address { ring: true, word, .. } => usize::from(features.turned(word, step)),
        Address { swap: true, .. } if parity => index ^ (depth / 2),
        _ => index,
    }
}

/// First words of the rings in the own and in the imported memory of a PE.
fn rings(words: &[ControlWord], features: &PeFeatures) -> [BTreeSet<usize>; 2] {
    let mut rings = [BTreeSet::new(), BTreeSet::new()];
    let bits = features.ring_bits;
    for word in words.iter().filter(|_| bits > 0) {
        let written = word.write.map(|target| target.address);
        let received = word.receive.map(|(_, address)| address);
        for (rings, addresses) in rings.iter_mut().zip([[word.own, written], [word.imported, received]]) {
            let words = addresses.into_iter().flatten().filter(|address| address.ring);
            rings.extend(words.map(|address| usize::from(address.word) >> bits << bits));
        }
    }
    rings
}
