//! The network, clock by clock: every register as the datasheet describes it, with nothing computed ahead.
//!
//! [`crate::machine`] runs what a step computes; this runs how. It is slower, and knows what the other does not: which
//! PE's flag is set when, sums of operands that wrapped, and what was at work ([`Coverage`]).

use std::collections::BTreeMap;

use pe_ir::program::{Address, ControlWord, FieldName, Fold, Layout, LinkSource, Multiplier, PeProgram, Program};
use pe_ir::word::Pipeline;

use crate::coverage::{
    BASE, COEFFICIENT, Coverage, IMPORTED, INDEX, OPERANDS, OWN, alone, bit, shift_matters, takes, used_results,
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

/// The whole network.
pub struct Clocked<'a> {
    program: &'a Program,
    words: Vec<Vec<ControlWord>>,
    used: Vec<Vec<bool>>,
    captures: BTreeMap<(usize, usize), Vec<usize>>,
    pes: Vec<Registers>,
    links: Vec<i64>,
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
            indices: vec![0; pe.features.index_words as usize],
            products: vec![0; program.latency().product() as usize + 1],
            accumulator: 0,
            hold: 0,
            base: 0,
            shift: 0,
            addends: (0, 0),
            sum: 0,
            word: 0,
            saturated: 0,
            index: 0,
            too_large: vec![false; if deep { 2 } else { 1 }],
            overflow: false,
            causes: [None; 2],
            unsent: BTreeMap::new(),
        };
        let mut captures: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
        for (index, output) in program.outputs.iter().enumerate() {
            captures.entry((output.pe as usize, output.word as usize)).or_default().push(index);
        }
        let mut network = Clocked {
            program,
            words: program.pes.iter().map(decode).collect(),
            used: used_results(program),
            captures,
            pes: program.pes.iter().map(pe).collect(),
            links: vec![0; program.pes.len()],
            inputs: vec![0; program.inputs.len()],
            captured: vec![0; program.outputs.len()],
            word: 0,
            cycle: 0,
            odd: false,
            settle: true,
            steps: 0,
            overflow_cycle: None,
            raised_by: Vec::new(),
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
    pub fn flags(&self) -> Vec<u32> {
        (0..).zip(&self.pes).filter(|(_, pe)| pe.overflow).map(|(index, _)| index).collect()
    }

    /// The control word, counted as in traces, with which the overflow flag rose.
    pub fn overflow_cycle(&self) -> Option<u64> {
        self.overflow_cycle
    }

    /// Whether a sum of two operands wrapped: [`crate::machine`] knows such sums no longer.
    pub fn wrapped(&self) -> bool {
        self.wrapped
    }

    /// Whether a word of a PE that does not saturate was out of range, which was proven impossible of the design's runs.
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
        for (index, (pe, cover)) in self.pes.iter().zip(&mut coverage.pes).enumerate() {
            let [began, all] = pe.causes;
            let seen = all.or(began.filter(|_| first == Some(index)));
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
            self.coverage.inputs[index][0] |= *word as u64 & mask;
            self.coverage.inputs[index][1] |= !*word as u64 & mask;
            self.inputs[index] = format.input_operand(*word);
        }
        for (number, (index, tick, one)) in self.program.ticks().enumerate() {
            let due = tick.is_due(self.steps);
            self.coverage.ticks[number][usize::from(due)] = true;
            self.inputs[index as usize] = if due { format.input_operand(one) } else { 0 };
        }
        flagged.into_iter().for_each(|source| self.flag(cycle, source));
    }

    /// Executes one control word in every PE.
    fn clock(&mut self, trace: &mut impl FnMut(TraceLine)) {
        let ends_step = self.program.ends_step(self.word as u32);
        let links = self.links.clone();
        for pe in 0..self.pes.len() {
            if self.execute(pe, ends_step, &links, trace) {
                self.flag(self.cycle, pe);
            }
        }
        self.cycle += 1;
        self.word += 1;
        if (self.word as u32).is_multiple_of(self.program.round_words()) {
            self.odd = !self.odd;
        }
        if self.word == self.program.period as usize {
            self.word = 0;
        }
    }

    /// Executes the control word in one PE; whether it sets the PE's flag.
    fn execute(&mut self, index: usize, ends_step: bool, links: &[i64], trace: &mut impl FnMut(TraceLine)) -> bool {
        let (program, k, odd, settle) = (self.program, self.word, self.odd, self.settle);
        let format = &program.format;
        let features = &program.pes[index].features;
        let word = &self.words[index][k];
        let used = self.used[index][k];
        let pe = &mut self.pes[index];
        let cover = &mut self.coverage.pes[index];
        let mut fields = 0;
        // Everything that is read.
        let read = |memory: &[i64], address: Option<Address>| {
            address.map(|address| physical(address, memory.len(), odd)).map(|word| (word, memory[word]))
        };
        let (own, imported) = (read(&pe.own, word.own), read(&pe.imported, word.imported));
        let factor = match word.multiplier {
            Multiplier::Coefficient(value) => value,
            Multiplier::Stored(address) => pe.coefficients[usize::from(address)],
        };
        let base_address = word.base.map(|address| usize::from(address) | pe.index);
        let base = base_address.map_or(format.data_offset(), |address| pe.base_words[address]);
        let fetched = word.index.map_or(0, |address| pe.indices[usize::from(address)]);
        // What was at work of it.
        let mut operand = |read: Option<(usize, i64)>, swap: bool, names: [FieldName; 3], memory: usize| {
            let Some((address, value)) = read else { return };
            if value != 0 && factor != 0 {
                fields |= bit(names[0]) | bit(names[1]) | if swap && odd { bit(names[2]) } else { 0 };
                cover.read[memory][address] = true;
                fields |= match word.multiplier {
                    Multiplier::Coefficient(_) => bit(FieldName::Coefficient),
                    Multiplier::Stored(address) => {
                        cover.read[COEFFICIENT][usize::from(address)] = true;
                        bit(FieldName::CoefficientAddress)
                    }
                };
            }
        };
        let swap = |address: Option<Address>| address.is_some_and(|address| address.swap);
        operand(own, swap(word.own), [FieldName::OwnEnable, FieldName::OwnAddress, FieldName::OwnSwap], OWN);
        let names = [FieldName::ImportedEnable, FieldName::ImportedAddress, FieldName::ImportedSwap];
        operand(imported, swap(word.imported), names, IMPORTED);
        if let Some(address) = base_address.filter(|_| used) {
            let enabled = base != format.data_offset();
            let others = (0..features.base_words.ilog2()).map(|bit| pe.base_words[address ^ (1 << bit)]);
            if enabled || others.into_iter().any(|other| other != base) {
                fields |= bit(FieldName::BaseAddress) | if enabled { bit(FieldName::BaseEnable) } else { 0 };
                cover.read[BASE][address] = true;
            }
        }
        if let Some(address) = word.index.filter(|_| fetched != 0) {
            fields |= bit(FieldName::IndexEnable) | bit(FieldName::IndexAddress);
            cover.read[INDEX][usize::from(address)] = true;
        }
        if word.close && pe.accumulator != 0 {
            fields |= bit(FieldName::Close);
        }
        let shift = features.shifts.get(usize::from(word.shift)).copied().unwrap_or(0);
        // The results so far.
        let result = pe.word;
        let saturated = pe.saturated;
        pe.saturated = match pe.sum {
            sum if sum > i128::from(format.max_word()) => 1,
            sum if sum < i128::from(format.min_word()) => -1,
            _ => 0,
        };
        pe.word = match pe.saturated {
            _ if features.proven => wrapped(pe.sum, format.word_bits()) as i64,
            1 => format.ceiling(),
            -1 => format.min_word(),
            _ => pe.sum as i64,
        };
        let lifted = pe.hold << format.lift();
        let shifted = if pe.shift == 0 { lifted } else { ((lifted >> (pe.shift - 1)) + 1) >> 1 };
        if format.pipeline == Pipeline::Deep {
            pe.sum = i128::from(pe.addends.0) + pe.addends.1;
            pe.addends = (pe.base, shifted);
        } else {
            pe.sum = i128::from(pe.base) + shifted;
        }
        // Scale and accumulate group.
        (pe.base, pe.shift, pe.index) = (base, shift, fetched);
        let product = pe.products.pop().expect("products pass registers");
        let mut kept = pe.accumulator;
        if word.close {
            pe.hold = kept;
            kept = 0;
        }
        pe.accumulator = wrapped(kept + product, features.accumulator_bits);
        if used && shift_matters(pe.hold << format.lift(), shift, &features.shifts) {
            fields |= bit(FieldName::Shift);
            cover.shifts[usize::from(word.shift)] = true;
        }
        // Operand group.
        let (left, right) = (own.map_or(0, |read| read.1), imported.map_or(0, |read| read.1));
        let half = 1i64 << (format.data_bits - 2);
        let both = features.pre_adder && own.is_some() && imported.is_some();
        let too_large = both && [left, right].iter().any(|operand| !(-half..half).contains(operand));
        cover.too_large |= too_large && !settle;
        self.wrapped |= too_large;
        pe.products.insert(0, wrapped(i128::from(left + right), format.data_bits) * i128::from(factor));
        let too_large_before = pe.too_large.remove(0) && !settle;
        let mut flag = too_large_before;
        pe.too_large.push(too_large);
        // Write group.
        if word.send {
            let operand = format.data_operand(result);
            if operand != self.links[index] {
                fields |= bit(FieldName::Send);
            }
            self.links[index] = operand;
        }
        if !settle {
            let takes = takes(word, features.base_last && !ends_step, too_large_before);
            if saturated != 0 && (word.write.is_some() || word.write_index.is_some() || word.send) {
                flag = true;
                cover.saturated[usize::from(saturated > 0)] = true;
            } else if saturated != 0 && features.send {
                pe.unsent.entry(k).or_insert(self.cycle);
            }
            if flag {
                let cause = match saturated {
                    0 => Some(OPERANDS),
                    _ => alone(takes),
                };
                pe.causes = if pe.overflow {
                    [pe.causes[0], pe.causes[1].filter(|all| cause == Some(*all))]
                } else {
                    [cause; 2]
                };
            }
            let mut store = |memory: &mut [i64], address: usize, value: i64, names: u32, written: &mut [bool]| {
                if memory[address] != value {
                    fields |= names;
                    written[address] = true;
                }
                memory[address] = value;
            };
            if let Some(target) = word.write {
                let names = bit(FieldName::WriteAddress);
                let address = physical(target.address, pe.own.len(), odd);
                if target.own {
                    let swap = if target.address.swap && odd { bit(FieldName::WriteSwap) } else { 0 };
                    let place = address & (pe.own.len() - 1);
                    let names = names | swap | bit(FieldName::WriteOwn);
                    store(&mut pe.own, place, format.data_operand(result), names, &mut cover.written[OWN]);
                }
                if target.base && (ends_step || !features.base_last) {
                    let (place, names) = (features.base_word(target.address.word), names | bit(FieldName::WriteBase));
                    store(&mut pe.base_words, place, result, names, &mut cover.written[BASE]);
                }
                if target.factor {
                    let place = features.factor_word(target.address.word);
                    let (value, names) = (format.factor_operand(result), names | bit(FieldName::WriteFactor));
                    store(&mut pe.coefficients, place, value, names, &mut cover.written[COEFFICIENT]);
                }
                let value = result as u64 & (u64::MAX >> (64 - format.word_bits()));
                trace(TraceLine { cycle: self.cycle, pe: index as u32, address: address as u32, value });
            }
            if let Some((port, address)) = word.receive {
                let source = |source: &LinkSource| match source {
                    LinkSource::Pe(sender) => links[*sender as usize],
                    LinkSource::Input(input) => self.inputs[*input as usize],
                };
                let ports = &program.pes[index].ports;
                let value = source(&ports[usize::from(port)]);
                let place = physical(address, pe.imported.len(), odd);
                if pe.imported[place] != value {
                    cover.ports[usize::from(port)] = true;
                }
                let others = ports.iter().enumerate().filter(|(other, _)| *other != usize::from(port));
                let distinct = ports.len() > 1 && others.into_iter().all(|(_, other)| source(other) != value);
                let names = [
                    (FieldName::ReceiveEnable, true),
                    (FieldName::ReceiveAddress, true),
                    (FieldName::ReceiveSwap, address.swap && odd),
                ];
                let names = names.iter().filter(|(_, seen)| *seen).map(|(name, _)| bit(*name)).sum();
                store(&mut pe.imported, place, value, names, &mut cover.written[IMPORTED]);
                fields |= if distinct { bit(FieldName::Port) } else { 0 };
                let address = features.write_words() + place as u32;
                let value = value as u64 & (u64::MAX >> (64 - format.data_bits));
                trace(TraceLine { cycle: self.cycle, pe: index as u32, address, value });
            }
            if let Some((address, octaves)) = word.write_index {
                let segment = segment(result, format.word_bits(), features.segments(), octaves);
                let place = usize::from(address);
                if pe.indices[place] != segment {
                    fields |= bit(FieldName::WriteIndex) | bit(FieldName::WriteIndexAddress);
                    fields |= if octaves { bit(FieldName::WriteOctave) } else { 0 };
                    cover.written[INDEX][place] = true;
                }
                pe.indices[place] = segment;
            }
            cover.fields[k] |= fields;
        }
        if let Some(outputs) = self.captures.get(&(index, k)) {
            outputs.iter().for_each(|output| self.captured[*output] = result);
        }
        flag &= !settle;
        self.escaped |= flag && features.proven;
        pe.overflow |= flag;
        flag
    }
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

/// Number of the segment of a word.
fn segment(word: i64, word_bits: u32, segments: pe_ir::functions::Segments, octaves: bool) -> usize {
    if !octaves {
        return ((word >> (word_bits - segments.index_bits)) + (1 << (segments.index_bits - 1))) as usize;
    }
    let last = (1u32 << segments.octave_bits) - 1;
    let (mut bits, mut octave) = (word.max(0), 0);
    while octave < last && bits >> (word_bits - 2) & 1 == 0 {
        bits <<= 1;
        octave += 1;
    }
    let mantissa_bits = segments.index_bits - segments.octave_bits;
    let first = if octave < last { word_bits - 2 } else { word_bits - 1 };
    let mantissa = bits >> (first - mantissa_bits) & ((1 << mantissa_bits) - 1);
    (octave as usize) << mantissa_bits | mantissa as usize
}
