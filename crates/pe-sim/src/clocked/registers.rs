//! Registers and memories of a PE, and what a control word does with them in a clock.

use std::collections::BTreeMap;

use pe_ir::functions::Segments;
use pe_ir::index::{PeId, at, number};
use pe_ir::program::{Address, CoefficientOperand, ControlWord, FieldName, LinkSource, PeFeatures, Program};
use pe_ir::word::{Pipeline, WordFormat};

use crate::coverage::{BASE, COEFFICIENT, IMPORTED, INDEX, OWN, PeCoverage, bit, shift_matters};
use crate::record::physical;
use crate::trace::TraceLine;

/// Registers and memories of a PE.
pub(super) struct Registers {
    pub(super) own: Vec<i64>,
    pub(super) base_words: Vec<i64>,
    pub(super) coefficients: Vec<i64>,
    pub(super) imported: Vec<i64>,
    pub(super) indices: Vec<usize>,
    /// Products on their way; the last one is accumulated next.
    pub(super) products: Vec<i128>,
    pub(super) accumulator: i128,
    pub(super) hold: i128,
    /// Base word and shift of the scale group.
    pub(super) base: i64,
    pub(super) shift: u8,
    /// Base and shifted sum in front of the adder, with a deep pipeline.
    pub(super) addends: (i64, i128),
    pub(super) sum: i128,
    pub(super) word: i64,
    /// The sum that the word was made from.
    pub(super) exact: i128,
    /// Sums of the words that were at the memories, and own and imported operand, by control word.
    pub(super) sums: Vec<i128>,
    pub(super) operands: Vec<[i64; 2]>,
    /// -1 below, 1 above, 0 if it did not saturate.
    pub(super) saturated: i8,
    pub(super) index: usize,
    /// Operands that are too large for their sum, the last word's last.
    pub(super) too_large: Vec<bool>,
    pub(super) overflow: bool,
    /// What set the flag first, and what did in all words that would have, each if it was one thing alone.
    pub(super) causes: [Option<usize>; 2],
    /// Words with a result that nothing took and that would have set the flag, with the first cycle of each.
    pub(super) unsent: BTreeMap<usize, u64>,
}

/// A clock of one PE.
pub(super) struct Clock<'a> {
    pub(super) program: &'a Program,
    pub(super) pe: PeId,
    pub(super) word: &'a ControlWord,
    /// Whether anything takes the result whose base and shift the word chooses.
    pub(super) used: bool,
    /// Whether buffers have swapped their roles, and by how many places rings have moved on.
    pub(super) turn: (bool, u64),
    pub(super) ends_step: bool,
    pub(super) cycle: u64,
}

/// What a control word reads.
pub(super) struct Reads {
    /// Words of the memories, those of rings as the control words name them, and what they hold.
    pub(super) own: Option<(usize, i64)>,
    pub(super) imported: Option<(usize, i64)>,
    pub(super) factor: i64,
    pub(super) base_word: Option<usize>,
    pub(super) base: i64,
    pub(super) index: usize,
}

impl Clock<'_> {
    pub(super) fn features(&self) -> &PeFeatures {
        &self.program.pes[self.pe].features
    }

    /// Marks what was read, with effect or without.
    pub(super) fn fetch(&self, reads: &Reads, cover: &mut PeCoverage) {
        let factor = if let CoefficientOperand::Stored(at) = self.word.coefficient { Some(at.into()) } else { None };
        let [own, imported] = [reads.own, reads.imported].map(|read| read.map(|(place, _)| place));
        // In the order of the memories.
        let places = [own, reads.base_word, factor, imported, self.word.index.map(usize::from)];
        let fetched = cover.fetched.iter_mut().zip(places);
        fetched.filter_map(|(words, place)| words.get_mut(place?)).for_each(|word| *word = true);
    }

    /// Marks what was at work in the reads; the fields that were.
    pub(super) fn reads_at_work(&self, reads: &Reads, pe: &Registers, cover: &mut PeCoverage) -> u64 {
        use FieldName::*;
        const OWN_FIELDS: [FieldName; 4] = [OwnEnable, OwnAddress, OwnSwap, OwnRing];
        const IMPORTED_FIELDS: [FieldName; 4] = [ImportedEnable, ImportedAddress, ImportedSwap, ImportedRing];
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

    /// Which bits beside an address were at work in it.
    pub(super) fn moved(&self, address: Address, swap: FieldName, ring: FieldName) -> u64 {
        let (odd, turns) = self.turn;
        let swapped = if address.swap && odd { bit(swap) } else { 0 };
        let ringed = address.ring && self.features().turned(address.word, turns) != address.word;
        swapped | if ringed { bit(ring) } else { 0 }
    }

    /// The word of a memory that an address means.
    pub(super) fn physical(&self, address: Address, depth: usize) -> usize {
        physical(address, depth, self.turn, self.features())
    }

    /// Marks an operand, its factor among them, that was at work in a product; the fields that were.
    pub(super) fn operand_at_work(
        &self,
        read: Option<(usize, i64)>,
        address: Option<Address>,
        factor: i64,
        names: [FieldName; 4],
        (memory, cover): (usize, &mut PeCoverage),
    ) -> u64 {
        let Some((place, value)) = read else { return 0 };
        if value == 0 || factor == 0 {
            return 0;
        }
        cover.read[memory][place] = true;
        bit(names[0])
            | bit(names[1])
            | address.map_or(0, |address| self.moved(address, names[2], names[3]))
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
    pub(super) fn read(&self, clock: &Clock) -> Reads {
        let word = clock.word;
        let read = |memory: &[i64], address: Option<Address>| {
            address.map(|address| {
                let place = clock.physical(address, memory.len());
                (if address.ring { usize::from(address.word) } else { place }, memory[place])
            })
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
    pub(super) fn round(&mut self, format: &WordFormat, features: &PeFeatures) {
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
    pub(super) fn accumulate(&mut self, clock: &Clock, reads: &Reads, cover: &mut PeCoverage) -> u64 {
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
    pub(super) fn multiply(&mut self, clock: &Clock, reads: &Reads) -> (bool, bool) {
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
    pub(super) fn tell_cause(&mut self, cause: Option<usize>) {
        self.causes =
            if self.overflow { [self.causes[0], self.causes[1].filter(|all| cause == Some(*all))] } else { [cause; 2] };
    }

    /// Writes a result to the memories that the control word names; the fields that were at work.
    pub(super) fn write(
        &mut self,
        clock: &Clock,
        result: i64,
        cover: &mut PeCoverage,
        trace: &mut impl FnMut(TraceLine),
    ) -> u64 {
        let Some(target) = clock.word.write else { return 0 };
        let (format, features) = (&clock.program.format, clock.features());
        let mut fields = 0;
        let names = bit(FieldName::WriteAddress);
        let address = clock.physical(target.address, self.own.len());
        if target.own {
            let moved = clock.moved(target.address, FieldName::WriteSwap, FieldName::WriteRing);
            let place = address & (self.own.len() - 1);
            let named = if target.address.ring { usize::from(target.address.word) } else { place };
            if store(&mut self.own, (place, named), format.data_operand(result), &mut cover.written[OWN]) {
                fields |= names | moved | bit(FieldName::WriteOwn);
            }
        }
        if target.base && (clock.ends_step || !features.base_last) {
            let place = features.base_word(target.address.word);
            if store(&mut self.base_words, (place, place), result, &mut cover.written[BASE]) {
                fields |= names | bit(FieldName::WriteBase);
            }
        }
        if target.factor {
            let (place, value) = (features.factor_word(target.address.word), format.factor_operand(result));
            if store(&mut self.coefficients, (place, place), value, &mut cover.written[COEFFICIENT]) {
                fields |= names | bit(FieldName::WriteFactor);
            }
        }
        let value = result as u64 & (u64::MAX >> (64 - format.word_bits()));
        trace(TraceLine { cycle: clock.cycle, pe: clock.pe, address: number(address), value });
        fields
    }

    /// Writes the word of a port to the imported memory; the fields that were at work.
    pub(super) fn receive(
        &mut self,
        clock: &Clock,
        source: impl Fn(&LinkSource) -> i64,
        cover: &mut PeCoverage,
        trace: &mut impl FnMut(TraceLine),
    ) -> u64 {
        let Some((port, address)) = clock.word.receive else { return 0 };
        let ports = &clock.program.pes[clock.pe].ports;
        let value = source(&ports[port]);
        let place = clock.physical(address, self.imported.len());
        let named = if address.ring { usize::from(address.word) } else { place };
        let mut fields = 0;
        if store(&mut self.imported, (place, named), value, &mut cover.written[IMPORTED]) {
            cover.ports[port] = true;
            fields |= bit(FieldName::ReceiveEnable) | bit(FieldName::ReceiveAddress);
            fields |= clock.moved(address, FieldName::ReceiveSwap, FieldName::ReceiveRing);
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
    pub(super) fn write_index(&mut self, clock: &Clock, result: i64, cover: &mut PeCoverage) -> u64 {
        let Some((address, octaves)) = clock.word.write_index else { return 0 };
        let segments = clock.features().segments();
        let segment = segment(result, clock.program.format.word_bits(), segments, octaves);
        let place = usize::from(address);
        if !store(&mut self.indices, (place, place), segment, &mut cover.written[INDEX]) {
            return 0;
        }
        let octave = if octaves { bit(FieldName::WriteOctave) } else { 0 };
        bit(FieldName::WriteIndex) | bit(FieldName::WriteIndexAddress) | octave
    }
}

/// Stores a word and marks it by its name, if it is another one; whether it was.
fn store<T: PartialEq>(memory: &mut [T], (place, named): (usize, usize), value: T, written: &mut [bool]) -> bool {
    let changes = memory[place] != value;
    if changes {
        written[named] = true;
    }
    memory[place] = value;
    changes
}

/// The low `bits` of a sum as a signed number.
fn wrapped(value: i128, bits: u32) -> i128 {
    (value << (128 - bits)) >> (128 - bits)
}

/// Number of the segment of a word.
fn segment(word: i64, word_bits: u32, segments: Segments, octaves: bool) -> usize {
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
    at(octave) << mantissa_bits | mantissa as usize
}
