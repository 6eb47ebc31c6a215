//! The network, clock by clock: every register as the datasheet describes it, with nothing computed ahead.
//!
//! [`crate::machine`] runs what a step computes; this runs how. It is slower, and knows what the other does not: which
//! PE's flag is set when, sums of operands that wrapped, and what was at work ([`Coverage`]).

use std::collections::BTreeMap;

use pe_ir::index::{List, PeId, StateId, at, number};
use pe_ir::program::{
    Address, CoefficientOperand, ControlWord, FieldName, Fold, Layout, LinkSource, PeFeatures, PeProgram, Program,
};
use pe_ir::word::{Pipeline, WordFormat};

use crate::coverage::{
    BASE, COEFFICIENT, Coverage, IMPORTED, INDEX, OPERANDS, OWN, PeCoverage, alone, bit, shift_matters, takes,
    used_results,
};
use crate::record::physical;
use crate::trace::TraceLine;

/// Registers and memories of a PE.
struct Registers {
    own: Vec<i64>,
    base_words: Vec<i64>,
    coefficients: Vec<i64>,
    imported: Vec<i64>,
    indices: Vec<usize>,
    /// Products on their way; the last one is accumulated next.
    products: Vec<i128>,
    accumulator: i128,
    hold: i128,
    /// Base word and shift of the scale group.
    base: i64,
    shift: u8,
    /// Base and shifted sum in front of the adder, with a deep pipeline.
    addends: (i64, i128),
    sum: i128,
    word: i64,
    /// The sum that the word was made from.
    exact: i128,
    /// Sums of the words that were at the memories, and own and imported operand, by control word.
    sums: Vec<i128>,
    operands: Vec<[i64; 2]>,
    /// -1 below, 1 above, 0 if it did not saturate.
    saturated: i8,
    index: usize,
    /// Operands that are too large for their sum, the last word's last.
    too_large: Vec<bool>,
    overflow: bool,
    /// What set the flag first, and what did in all words that would have, each if it was one thing alone.
    causes: [Option<usize>; 2],
    /// Words with a result that nothing took and that would have set the flag, with the first cycle of each.
    unsent: BTreeMap<usize, u64>,
}

/// What set a sticky flag.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Causes {
    /// A word that was written or sent saturated.
    pub saturated: bool,
    /// An operand was too large for a sum of two.
    pub operand: bool,
    /// An input was too large for a data operand.
    pub input: bool,
}

/// The whole network.
pub struct Clocked<'a> {
    program: &'a Program,
    words: List<PeId, Vec<ControlWord>>,
    used: List<PeId, Vec<bool>>,
    captures: BTreeMap<(PeId, usize), Vec<usize>>,
    pes: List<PeId, Registers>,
    links: List<PeId, i64>,
    inputs: Vec<i64>,
    captured: Vec<i64>,
    word: usize,
    cycle: u64,
    odd: bool,
    settle: bool,
    steps: u64,
    overflow_cycle: Option<u64>,
    /// PEs, then inputs, that raised it in that cycle.
    raised_by: Vec<usize>,
    causes: Causes,
    wrapped: bool,
    escaped: bool,
    coverage: Coverage,
}

impl<'a> Clocked<'a> {
    /// A network after configuration, at the pause point. Control words pass through their bits.
    pub fn new(program: &'a Program) -> Clocked<'a> {
        let decode = |pe: &PeProgram| -> Vec<ControlWord> {
            let (fold, layout) = (Fold::of(program, pe), Layout::new(&pe.features, &program.format));
            (0..program.period as usize).map(|k| layout.decode(fold.word(k))).collect()
        };
        let deep = program.format.pipeline == Pipeline::Deep;
        let pe = |pe: &PeProgram| Registers {
            own: pe.own_image.clone(),
            base_words: pe.base_image.clone(),
            coefficients: pe.coefficient_image.clone(),
            imported: pe.imported_image.clone(),
            indices: vec![0; at(pe.features.index_words)],
            products: vec![0; at(program.latency().product()) + 1],
            accumulator: 0,
            hold: 0,
            base: 0,
            shift: 0,
            addends: (0, 0),
            sum: 0,
            word: 0,
            exact: 0,
            sums: vec![0; at(program.period)],
            operands: vec![[0; 2]; at(program.period)],
            saturated: 0,
            index: 0,
            too_large: vec![false; if deep { 2 } else { 1 }],
            overflow: false,
            causes: [None; 2],
            unsent: BTreeMap::new(),
        };
        let mut captures: BTreeMap<(PeId, usize), Vec<usize>> = BTreeMap::new();
        for (index, output) in program.outputs.iter().enumerate() {
            captures.entry((output.pe, at(output.word))).or_default().push(index);
        }
        let mut network = Clocked {
            program,
            words: program.pes.iter().map(decode).collect(),
            used: used_results(program),
            captures,
            pes: program.pes.iter().map(pe).collect(),
            links: List::filled(0, program.pes.len()),
            inputs: vec![0; program.inputs.len()],
            captured: vec![0; program.outputs.len()],
            word: 0,
            cycle: 0,
            odd: false,
            settle: true,
            steps: 0,
            overflow_cycle: None,
            raised_by: Vec::new(),
            causes: Causes::default(),
            wrapped: false,
            escaped: false,
            coverage: Coverage::none(program),
        };
        (0..program.latency().pause()).for_each(|_| network.clock(&mut |_| {}));
        network.settle = false;
        network
    }

    /// Runs one step with the words of the input ports; every memory write goes to `trace`.
    pub fn step(&mut self, inputs: &[i64], trace: &mut impl FnMut(TraceLine)) {
        let first = self.cycle;
        self.clock(trace);
        self.sample(inputs, first);
        (1..self.program.period).for_each(|_| self.clock(trace));
        self.steps += 1;
        let mask = u64::MAX >> (64 - self.program.format.storage_bits);
        for (index, seen) in (0..).zip(&mut self.coverage.outputs) {
            let (word, clamped) = shown(self.program, self.captured[index]);
            let word = word as u64;
            seen[0] |= word & mask;
            seen[1] |= !word & mask;
            self.coverage.shown_clamped[index] |= clamped;
            self.escaped |= clamped && self.program.outputs[index].proven;
        }
    }

    /// Published outputs, port words.
    pub fn outputs(&self) -> Vec<i64> {
        self.captured.iter().map(|word| shown(self.program, *word).0).collect()
    }

    /// PEs whose sticky flag is set.
    pub fn flags(&self) -> Vec<PeId> {
        self.pes.numbered().filter(|(_, pe)| pe.overflow).map(|(index, _)| index).collect()
    }

    /// What set the flags.
    pub fn causes(&self) -> Causes {
        self.causes
    }

    /// Stored word of a state as the next step starts.
    pub fn state(&self, index: StateId) -> i64 {
        let (pe, word) = self.program.states[index].own;
        self.pes[pe].base_words[self.program.pes[pe].features.base_word(word)]
    }

    /// The control word, counted as in traces, with which the overflow flag rose.
    pub fn overflow_cycle(&self) -> Option<u64> {
        self.overflow_cycle
    }

    /// Sums from which the words at a PE's memories were made before they saturated, one for each control word of the
    /// last step.
    pub fn sums(&self, pe: PeId) -> &[i128] {
        &self.pes[pe].sums
    }

    /// Own and imported operand of a PE, 0 if there is none, one pair for each control word of the last step.
    pub fn operands(&self, pe: PeId) -> &[[i64; 2]] {
        &self.pes[pe].operands
    }

    /// Whether a sum of two operands wrapped: [`crate::machine`] knows such sums no longer.
    pub fn wrapped(&self) -> bool {
        self.wrapped
    }

    /// Whether a word of a PE that does not saturate was out of range, which was proven impossible of the design's
    /// runs.
    pub fn escaped(&self) -> bool {
        self.escaped
    }

    /// What was at work so far.
    pub fn coverage(&self) -> Coverage {
        let mut coverage = self.coverage.clone();
        let first = match self.raised_by[..] {
            [source] => Some(source),
            _ => None,
        };
        if let Some(source) = first {
            coverage.raised[source] = true;
        }
        // A flag is compared as the run ends, and that of the network in every clock.
        for ((index, pe), cover) in self.pes.numbered().zip(&mut coverage.pes) {
            let [began, all] = pe.causes;
            let seen = all.or(began.filter(|_| first == Some(index.index())));
            seen.into_iter().for_each(|cause| cover.flagged[cause] = true);
            let hidden = |cycle: u64| pe.overflow && self.overflow_cycle.is_some_and(|first| first <= cycle);
            pe.unsent.iter().filter(|(_, cycle)| !hidden(**cycle)).for_each(|(word, _)| cover.unsent[*word] = true);
        }
        coverage
    }

    /// A PE, or behind the PEs an input, sets its flag.
    fn flag(&mut self, cycle: u64, source: usize) {
        if *self.overflow_cycle.get_or_insert(cycle) == cycle {
            self.raised_by.push(source);
        }
    }

    /// Inputs load their operands at the end of the step's first word.
    fn sample(&mut self, words: &[i64], cycle: u64) {
        let format = &self.program.format;
        let mask = u64::MAX >> (64 - format.storage_bits);
        let mut flagged = Vec::new();
        for (index, word) in words.iter().enumerate().take(self.coverage.inputs.len()) {
            let stored = (i128::from(*word) << format.guard_bits) + i128::from(format.data_offset());
            let beyond = stored > i128::from(format.max_word());
            if beyond {
                flagged.push(self.pes.len() + index);
            }
            self.coverage.clamped[index] |= beyond;
            self.causes.input |= beyond;
            self.coverage.inputs[index][0] |= *word as u64 & mask;
            self.coverage.inputs[index][1] |= !*word as u64 & mask;
            self.inputs[index] = format.input_operand(*word);
        }
        for (number, (index, tick, one)) in self.program.ticks().enumerate() {
            let due = tick.is_due(self.steps);
            self.coverage.ticks[number][usize::from(due)] = true;
            self.inputs[at(index)] = if due { format.input_operand(one) } else { 0 };
        }
        flagged.into_iter().for_each(|source| self.flag(cycle, source));
    }

    /// Executes one control word in every PE.
    fn clock(&mut self, trace: &mut impl FnMut(TraceLine)) {
        let ends_step = self.program.ends_step(number(self.word));
        let links = self.links.clone();
        for pe in self.pes.ids() {
            if self.execute(pe, ends_step, &links, trace) {
                self.flag(self.cycle, pe.index());
            }
        }
        self.cycle += 1;
        self.word += 1;
        if number(self.word).is_multiple_of(self.program.round_words()) {
            self.odd = !self.odd;
        }
        if self.word == at(self.program.period) {
            self.word = 0;
        }
    }

    /// Executes the control word in one PE; whether it sets the PE's flag.
    fn execute(
        &mut self,
        index: PeId,
        ends_step: bool,
        links: &List<PeId, i64>,
        trace: &mut impl FnMut(TraceLine),
    ) -> bool {
        let (program, settle) = (self.program, self.settle);
        let (format, features) = (&program.format, &program.pes[index].features);
        let word = &self.words[index][self.word];
        let used = self.used[index][self.word];
        let clock = Clock { program, pe: index, word, used, odd: self.odd, ends_step, cycle: self.cycle };
        let pe = &mut self.pes[index];
        let cover = &mut self.coverage.pes[index];
        let reads = pe.read(&clock);
        let mut fields = clock.reads_at_work(&reads, pe, cover);
        // The result that is at the memories now.
        let (result, saturated) = (pe.word, pe.saturated);
        pe.sums[self.word] = pe.exact;
        pe.operands[self.word] = [reads.own, reads.imported].map(|read| read.map_or(0, |(_, value)| value));
        pe.round(format, features);
        fields |= pe.accumulate(&clock, &reads, cover);
        let (too_large, joined_too_large) = pe.multiply(&clock, &reads);
        cover.too_large |= too_large && !settle;
        self.wrapped |= too_large;
        let mut flag = joined_too_large;
        if word.send {
            let operand = format.data_operand(result);
            if operand != self.links[index] {
                fields |= bit(FieldName::Send);
            }
            self.links[index] = operand;
        }
        if !settle {
            self.causes.operand |= joined_too_large;
            let taken = takes(word, features.base_last && !ends_step, joined_too_large);
            if saturated != 0 && (word.write.is_some() || word.write_index.is_some() || word.send) {
                flag = true;
                self.causes.saturated = true;
                cover.saturated[usize::from(saturated > 0)] = true;
            } else if saturated != 0 && features.send {
                pe.unsent.entry(self.word).or_insert(self.cycle);
            }
            if flag {
                pe.tell_cause(if saturated == 0 { Some(OPERANDS) } else { alone(taken) });
            }
            let source = |source: &LinkSource| match source {
                LinkSource::Pe(sender) => links[*sender],
                LinkSource::Input(input) => self.inputs[at(*input)],
            };
            fields |= pe.write(&clock, result, cover, trace);
            fields |= pe.receive(&clock, source, cover, trace);
            fields |= pe.write_index(&clock, result, cover);
            cover.fields[self.word] |= fields;
        }
        if let Some(outputs) = self.captures.get(&(index, self.word)) {
            outputs.iter().for_each(|output| self.captured[*output] = result);
        }
        flag &= !settle;
        self.escaped |= flag && features.proven;
        pe.overflow |= flag;
        flag
    }
}

/// A clock of one PE.
struct Clock<'a> {
    program: &'a Program,
    pe: PeId,
    word: &'a ControlWord,
    /// Whether anything takes the result whose base and shift the word chooses.
    used: bool,
    /// Whether buffers have swapped their roles.
    odd: bool,
    ends_step: bool,
    cycle: u64,
}

/// What a control word reads.
struct Reads {
    /// Words of the memories and what they hold.
    own: Option<(usize, i64)>,
    imported: Option<(usize, i64)>,
    factor: i64,
    base_word: Option<usize>,
    base: i64,
    index: usize,
}

impl Clock<'_> {
    fn features(&self) -> &PeFeatures {
        &self.program.pes[self.pe].features
    }

    /// Marks what was read, with effect or without.
    fn fetch(&self, reads: &Reads, cover: &mut PeCoverage) {
        let factor = if let CoefficientOperand::Stored(at) = self.word.coefficient { Some(at.into()) } else { None };
        let [own, imported] = [reads.own, reads.imported].map(|read| read.map(|(place, _)| place));
        // In the order of the memories.
        let places = [own, reads.base_word, factor, imported, self.word.index.map(usize::from)];
        let fetched = cover.fetched.iter_mut().zip(places);
        fetched.filter_map(|(words, place)| words.get_mut(place?)).for_each(|word| *word = true);
    }

    /// Marks what was at work in the reads; the fields that were.
    fn reads_at_work(&self, reads: &Reads, pe: &Registers, cover: &mut PeCoverage) -> u32 {
        const OWN_FIELDS: [FieldName; 3] = [FieldName::OwnEnable, FieldName::OwnAddress, FieldName::OwnSwap];
        const IMPORTED_FIELDS: [FieldName; 3] =
            [FieldName::ImportedEnable, FieldName::ImportedAddress, FieldName::ImportedSwap];
        let word = self.word;
        self.fetch(reads, cover);
        let mut fields = self.operand_at_work(reads.own, word.own, reads.factor, OWN_FIELDS, (OWN, cover));
        fields |= self.operand_at_work(reads.imported, word.imported, reads.factor, IMPORTED_FIELDS, (IMPORTED, cover));
        if let Some(place) = reads.base_word.filter(|_| self.used) {
            let enabled = reads.base != self.program.format.data_offset();
            let mut others = (0..self.features().base_words.ilog2()).map(|bit| pe.base_words[place ^ (1 << bit)]);
            if enabled || others.any(|other| other != reads.base) {
                fields |= bit(FieldName::BaseAddress) | if enabled { bit(FieldName::BaseEnable) } else { 0 };
                cover.read[BASE][place] = true;
            }
        }
        if let Some(address) = word.index.filter(|_| reads.index != 0) {
            fields |= bit(FieldName::IndexEnable) | bit(FieldName::IndexAddress);
            cover.read[INDEX][usize::from(address)] = true;
        }
        fields
    }

    /// Marks an operand, its factor among them, that was at work in a product; the fields that were.
    fn operand_at_work(
        &self,
        read: Option<(usize, i64)>,
        address: Option<Address>,
        factor: i64,
        names: [FieldName; 3],
        (memory, cover): (usize, &mut PeCoverage),
    ) -> u32 {
        let Some((place, value)) = read else { return 0 };
        if value == 0 || factor == 0 {
            return 0;
        }
        cover.read[memory][place] = true;
        let swapped = self.odd && address.is_some_and(|address| address.swap);
        bit(names[0])
            | bit(names[1])
            | if swapped { bit(names[2]) } else { 0 }
            | match self.word.coefficient {
                CoefficientOperand::Coefficient(_) => bit(FieldName::Coefficient),
                CoefficientOperand::Stored(address) => {
                    cover.read[COEFFICIENT][usize::from(address)] = true;
                    bit(FieldName::CoefficientAddress)
                }
            }
    }
}

impl Registers {
    /// All that the control word reads.
    fn read(&self, clock: &Clock) -> Reads {
        let word = clock.word;
        let read = |memory: &[i64], address: Option<Address>| {
            address.map(|address| physical(address, memory.len(), clock.odd)).map(|place| (place, memory[place]))
        };
        let base_word = word.base.map(|address| usize::from(address) | self.index);
        Reads {
            own: read(&self.own, word.own),
            imported: read(&self.imported, word.imported),
            factor: match word.coefficient {
                CoefficientOperand::Coefficient(value) => value,
                CoefficientOperand::Stored(address) => self.coefficients[usize::from(address)],
            },
            base_word,
            base: base_word.map_or(clock.program.format.data_offset(), |place| self.base_words[place]),
            index: word.index.map_or(0, |address| self.indices[usize::from(address)]),
        }
    }

    /// The sum as a word, then the next sum: base and shifted sum of products.
    fn round(&mut self, format: &WordFormat, features: &PeFeatures) {
        self.exact = self.sum;
        self.saturated = match self.sum {
            sum if sum > i128::from(format.max_word()) => 1,
            sum if sum < i128::from(format.min_word()) => -1,
            _ => 0,
        };
        self.word = match self.saturated {
            _ if features.proven => wrapped(self.sum, format.word_bits()) as i64,
            1 => format.ceiling(),
            -1 => format.min_word(),
            _ => self.sum as i64,
        };
        let wide = self.hold << format.left_shift();
        let shifted = if self.shift == 0 { wide } else { ((wide >> (self.shift - 1)) + 1) >> 1 };
        if format.pipeline == Pipeline::Deep {
            self.sum = i128::from(self.addends.0) + self.addends.1;
            self.addends = (self.base, shifted);
        } else {
            self.sum = i128::from(self.base) + shifted;
        }
    }

    /// Scale and accumulate group; the fields that were at work.
    fn accumulate(&mut self, clock: &Clock, reads: &Reads, cover: &mut PeCoverage) -> u32 {
        let (word, features) = (clock.word, clock.features());
        let mut fields = 0;
        let shift = features.shifts.get(usize::from(word.shift)).copied().unwrap_or(0);
        (self.base, self.shift, self.index) = (reads.base, shift, reads.index);
        let product = self.products.pop().expect("products pass registers");
        let mut kept = self.accumulator;
        if word.close {
            fields |= if kept != 0 { bit(FieldName::Close) } else { 0 };
            self.hold = kept;
            kept = 0;
        }
        self.accumulator = wrapped(kept + product, features.accumulator_bits);
        if clock.used && shift_matters(self.hold << clock.program.format.left_shift(), shift, &features.shifts) {
            fields |= bit(FieldName::Shift);
            cover.shifts[usize::from(word.shift)] = true;
        }
        fields
    }

    /// Operand group: whether the operands are too large for their sum, and whether those were whose flag is due.
    fn multiply(&mut self, clock: &Clock, reads: &Reads) -> (bool, bool) {
        let format = &clock.program.format;
        let (left, right) = (reads.own.map_or(0, |read| read.1), reads.imported.map_or(0, |read| read.1));
        let half = 1i64 << (format.data_bits - 2);
        let both = clock.features().pre_adder && reads.own.is_some() && reads.imported.is_some();
        let too_large = both && [left, right].iter().any(|operand| !(-half..half).contains(operand));
        self.products.insert(0, wrapped(i128::from(left + right), format.data_bits) * i128::from(reads.factor));
        let due = self.too_large.remove(0);
        self.too_large.push(too_large);
        (too_large, due)
    }

    /// Adds what would have set the flag now, if it was one thing alone.
    fn tell_cause(&mut self, cause: Option<usize>) {
        self.causes =
            if self.overflow { [self.causes[0], self.causes[1].filter(|all| cause == Some(*all))] } else { [cause; 2] };
    }

    /// Writes a result to the memories that the control word names; the fields that were at work.
    fn write(&mut self, clock: &Clock, result: i64, cover: &mut PeCoverage, trace: &mut impl FnMut(TraceLine)) -> u32 {
        let Some(target) = clock.word.write else { return 0 };
        let (format, features) = (&clock.program.format, clock.features());
        let mut fields = 0;
        let names = bit(FieldName::WriteAddress);
        let address = physical(target.address, self.own.len(), clock.odd);
        if target.own {
            let swap = if target.address.swap && clock.odd { bit(FieldName::WriteSwap) } else { 0 };
            let place = address & (self.own.len() - 1);
            if store(&mut self.own, place, format.data_operand(result), &mut cover.written[OWN]) {
                fields |= names | swap | bit(FieldName::WriteOwn);
            }
        }
        if target.base && (clock.ends_step || !features.base_last) {
            let place = features.base_word(target.address.word);
            if store(&mut self.base_words, place, result, &mut cover.written[BASE]) {
                fields |= names | bit(FieldName::WriteBase);
            }
        }
        if target.factor {
            let (place, value) = (features.factor_word(target.address.word), format.factor_operand(result));
            if store(&mut self.coefficients, place, value, &mut cover.written[COEFFICIENT]) {
                fields |= names | bit(FieldName::WriteFactor);
            }
        }
        let value = result as u64 & (u64::MAX >> (64 - format.word_bits()));
        trace(TraceLine { cycle: clock.cycle, pe: clock.pe, address: number(address), value });
        fields
    }

    /// Writes the word of a port to the imported memory; the fields that were at work.
    fn receive(
        &mut self,
        clock: &Clock,
        source: impl Fn(&LinkSource) -> i64,
        cover: &mut PeCoverage,
        trace: &mut impl FnMut(TraceLine),
    ) -> u32 {
        let Some((port, address)) = clock.word.receive else { return 0 };
        let ports = &clock.program.pes[clock.pe].ports;
        let value = source(&ports[port]);
        let place = physical(address, self.imported.len(), clock.odd);
        let mut fields = 0;
        if store(&mut self.imported, place, value, &mut cover.written[IMPORTED]) {
            cover.ports[port] = true;
            fields |= bit(FieldName::ReceiveEnable) | bit(FieldName::ReceiveAddress);
            fields |= if address.swap && clock.odd { bit(FieldName::ReceiveSwap) } else { 0 };
        }
        let mut others = ports.numbered().filter(|(other, _)| *other != port);
        if ports.len() > 1 && others.all(|(_, other)| source(other) != value) {
            fields |= bit(FieldName::Port);
        }
        let address = clock.features().write_words() + number(place);
        let value = value as u64 & (u64::MAX >> (64 - clock.program.format.data_bits));
        trace(TraceLine { cycle: clock.cycle, pe: clock.pe, address, value });
        fields
    }

    /// Writes the segment of a result to the index memory; the fields that were at work.
    fn write_index(&mut self, clock: &Clock, result: i64, cover: &mut PeCoverage) -> u32 {
        let Some((address, octaves)) = clock.word.write_index else { return 0 };
        let segments = clock.features().segments();
        let segment = segments.index(result, clock.program.format.word_bits(), octaves);
        if !store(&mut self.indices, usize::from(address), segment, &mut cover.written[INDEX]) {
            return 0;
        }
        let octave = if octaves { bit(FieldName::WriteOctave) } else { 0 };
        bit(FieldName::WriteIndex) | bit(FieldName::WriteIndexAddress) | octave
    }
}

/// Stores a word and marks it, if it is another one; whether it was.
fn store<T: PartialEq>(memory: &mut [T], place: usize, value: T, written: &mut [bool]) -> bool {
    let changes = memory[place] != value;
    if changes {
        written[place] = true;
    }
    memory[place] = value;
    changes
}

/// The low `bits` of a sum as a signed number.
fn wrapped(value: i128, bits: u32) -> i128 {
    (value << (128 - bits)) >> (128 - bits)
}

/// Port word of an output, and whether it is clamped.
fn shown(program: &Program, word: i64) -> (i64, bool) {
    let format = &program.format;
    let half = if format.guard_bits == 0 { 0 } else { 1 << (format.guard_bits - 1) };
    let largest = (1i64 << (format.storage_bits - 1)) - 1;
    let rounded = (word - format.data_offset() + half) >> format.guard_bits;
    (rounded.clamp(-largest - 1, largest), !(-largest - 1..=largest).contains(&rounded))
}
