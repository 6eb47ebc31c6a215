//! The program memory of a PE: bits that every round repeats are stored once.
//!
//! Control words of a step stand in two memories of one address each: the loop memory has one word for each word of a
//! round, the stream memory one for each word of the step. Every bit of the control word comes from one of them. Where
//! the bits of the stream memory take few different turns through the rounds, a variant memory stands for it: it has a
//! word for each round of each such variant, and each word of the loop memory has the variant of the next word. Fields
//! that take few different values together may be in the variant memory as well, whether rounds differ in them or not.

use std::collections::HashMap;

use super::{Field, FieldName, Layout, PeProgram, Program, index_bits};
use crate::index::{at, number};
use crate::memory::{MemoryCells, rom, tables};
use crate::word::Pipeline;

/// Most words of a variant memory, which is made of LUTs.
pub const VARIANT_WORDS: usize = 512;

/// The memories of a PE's program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fold {
    /// Bits of the control word that come from the stream or the variant memory, those that rounds need different values
    /// of among them.
    pub streamed: u128,
    /// All bits of the control word.
    pub all: u128,
    /// Loop memory, bits at their places in the control word; empty if no bit comes from it.
    pub repeated: Vec<u128>,
    /// Stream memory, bits at their places in the control word; empty if no bit comes from it.
    pub stream: Vec<u128>,
    /// Variant memory, bits at their places in the control word: the rounds of a variant side by side, as many as a power
    /// of two has; empty if no bit comes from it.
    pub variant_words: Vec<u128>,
    /// The variant of each word of a round; empty without a variant memory.
    pub variant_of: Vec<u32>,
    /// Words of a variant.
    turns: usize,
}

/// What the streamed bits of a word of a round are in each round, and which of them have an effect.
type Turns = Vec<(u128, u128)>;

/// The control words of a PE as bits.
pub struct Effects {
    /// The words.
    pub words: Vec<u128>,
    /// Bits of each word that have an effect.
    pub cares: Vec<u128>,
    /// Bits that some rounds need different values of.
    pub differing: u128,
    /// Bits of a round that all of them can have.
    common: Vec<u128>,
}

impl Effects {
    /// Those of a PE.
    pub fn of(program: &Program, pe: &PeProgram) -> Effects {
        let layout = Layout::new(&pe.features, &program.format);
        let words: Vec<u128> = pe.words.iter().map(|word| layout.encode(word)).collect();
        let result = |k: usize| {
            let end = &pe.words[(k + at(program.latency().scale_to_write())) % pe.words.len()];
            end.write.is_some() || end.write_index.is_some() || end.send || end.show
        };
        let cares: Vec<u128> = (0..).zip(&pe.words).map(|(k, word)| layout.effective(word, result(k))).collect();
        let length = at(program.round_words());
        let (mut common, mut known, mut differing) = (vec![0; length], vec![0; length], 0);
        for (k, care) in cares.iter().copied().enumerate() {
            let slot = k % length;
            differing |= (words[k] ^ common[slot]) & care & known[slot];
            common[slot] |= words[k] & care & !known[slot];
            known[slot] |= care;
        }
        Effects { words, cares, differing, common }
    }

    /// What some bits of a place are in all rounds.
    fn turns(&self, slot: usize, mask: u128) -> Turns {
        let places = (slot..self.words.len()).step_by(self.common.len());
        places.map(|k| (self.words[k] & self.cares[k] & mask, self.cares[k] & mask)).collect()
    }
}

impl Fold {
    /// Folds the program of a PE where that is smaller. Bits of fields without effect are free, and take what other
    /// rounds need.
    pub fn of(program: &Program, pe: &PeProgram) -> Fold {
        let layout = Layout::new(&pe.features, &program.format);
        let all = u128::MAX >> (128 - layout.bits);
        let turns = at(program.rounds.next_power_of_two());
        let effects = Effects::of(program, pe);
        let flat = Fold {
            streamed: all,
            all,
            repeated: Vec::new(),
            stream: effects.words.clone(),
            variant_words: Vec::new(),
            variant_of: Vec::new(),
            turns,
        };
        let streamed = effects.differing;
        // Behind more registers the variant would be known too late.
        let direct = program.format.pipeline != Pipeline::Deep;
        if streamed == all || (program.rounds == 1 && (pe.varied.is_empty() || !direct)) {
            return flat;
        }
        let repeated: Vec<u128> = effects.common.iter().map(|word| word & !streamed).collect();
        let words = &effects.words;
        let stream = if streamed == 0 { Vec::new() } else { words.iter().map(|word| word & streamed).collect() };
        let looped = Fold { streamed, all, repeated, stream, ..flat.clone() };
        let varied = |streamed: u128| {
            let words = (0..effects.common.len()).map(|slot| effects.turns(slot, streamed));
            // An address has a bit at least.
            let (variants, variant_of) =
                variants(words, VARIANT_WORDS / turns).filter(|(variants, _)| variants.len() * turns > 1)?;
            let padded = |turns: &Turns| -> Vec<u128> {
                let bits = turns.iter().map(|(bits, _)| *bits);
                bits.chain(std::iter::repeat(0)).take(looped.turns).collect()
            };
            let variant_words = variants.iter().flat_map(padded).collect();
            let repeated = looped.repeated.iter().map(|word| word & !streamed).collect();
            Some(Fold { streamed, repeated, stream: Vec::new(), variant_words, variant_of, ..looped.clone() })
        };
        let fields: u128 = pe.varied.iter().map(|field| layout.mask(*field)).fold(streamed, |mask, field| mask | field);
        let mut masks = if direct { vec![streamed, fields] } else { Vec::new() };
        masks.dedup();
        let masks = masks.into_iter().filter(|mask| *mask != 0);
        let mut best = flat;
        for fold in std::iter::once(looped.clone()).chain(masks.filter_map(varied)) {
            if fold.cells().equivalent_luts() < best.cells().equivalent_luts() {
                best = fold;
            }
        }
        best
    }

    /// Number of variants, if there is a variant memory.
    pub fn variants(&self) -> Option<u32> {
        (!self.variant_words.is_empty()).then_some(number(self.variant_words.len() / self.turns))
    }

    /// Bits of the number of a variant.
    pub fn variant_bits(&self) -> u32 {
        self.variants().map_or(0, index_bits)
    }

    /// The number of the variant that stands beside word `place` of a round in the loop memory: that of the next word.
    pub fn next_variant(&self, place: usize) -> u32 {
        let next = if place + 1 < self.variant_of.len() { place + 1 } else { 0 };
        self.variant_of.get(next).copied().unwrap_or(0)
    }

    /// Bits of the control word that come from the loop memory.
    pub fn repeated_bits(&self) -> u32 {
        (self.all & !self.streamed).count_ones()
    }

    /// Bits of a word of the loop memory.
    pub fn loop_bits(&self) -> u32 {
        self.repeated_bits() + self.variant_bits()
    }

    /// Bits of a word of the stream or variant memory.
    pub fn streamed_bits(&self) -> u32 {
        self.streamed.count_ones()
    }

    /// The control word that the PE sees in word `k` of a step.
    pub fn word(&self, k: usize) -> u128 {
        if self.repeated.is_empty() {
            return self.stream.get(k).copied().unwrap_or(0);
        }
        let (round, place) = (k / self.repeated.len(), k % self.repeated.len());
        let streamed = match self.variant_of.get(place) {
            Some(variant) => self.variant_words[at(*variant) * self.turns + round],
            None => self.stream.get(k).copied().unwrap_or(0),
        };
        self.repeated[place] | streamed
    }

    /// What the memories are made of.
    pub fn cells(&self) -> MemoryCells {
        let repeated = rom(number(self.repeated.len()), self.loop_bits());
        let stream = rom(number(self.stream.len()), self.streamed_bits());
        let variants = tables(number(self.variant_words.len()), self.streamed_bits());
        [repeated, stream, variants].into_iter().sum()
    }
}

/// Gives each word of a round a variant, at most so many in all; one that is there if their bits with effect agree.
fn variants(words: impl Iterator<Item = Turns>, most: usize) -> Option<(Vec<Turns>, Vec<u32>)> {
    let mut variants: Vec<Turns> = Vec::new();
    let mut variant_of = Vec::new();
    let mut known: HashMap<Turns, usize> = HashMap::new();
    for word in words {
        if let Some(index) = known.get(&word) {
            variant_of.push(number(*index));
            continue;
        }
        let agrees = |variant: &Turns| {
            variant.iter().zip(&word).all(|((bits, known), (other, care))| (bits ^ other) & known & care == 0)
        };
        let index = variants.iter().position(agrees).unwrap_or(variants.len());
        if index == most {
            return None;
        }
        known.insert(word.clone(), index);
        if index == variants.len() {
            variants.push(word);
        } else {
            for ((bits, known), (other, care)) in variants[index].iter_mut().zip(word) {
                (*bits, *known) = (*bits | other, *known | care);
            }
        }
        variant_of.push(number(index));
    }
    Some((variants, variant_of))
}

impl Layout {
    /// The fields with that of a variant in front of them.
    pub fn with_variant(mut self, width: u32) -> Layout {
        if width == 0 {
            return self;
        }
        self.fields.insert(0, Field { name: FieldName::Variant, width, lsb: self.bits });
        Layout::of(self.fields, self.bits + width)
    }

    /// The fields as far as their bits are in `mask`, closed up.
    pub fn part(&self, mask: u128) -> Layout {
        let width = |field: &Field| (mask >> field.lsb & (u128::MAX >> (128 - field.width))).count_ones();
        let mut lsb = self.fields.iter().map(width).sum();
        let bits = lsb;
        let mut fields = Vec::new();
        for field in &self.fields {
            let width = width(field);
            lsb -= width;
            if width > 0 {
                fields.push(Field { name: field.name, width, lsb });
            }
        }
        Layout::of(fields, bits)
    }
}

/// The bits of a word that are in `mask`, closed up.
pub fn closed_up(word: u128, mask: u128) -> u128 {
    let (mut packed, mut place, mut from, mut left) = (0, 0, 0, mask);
    // One run of ones in the mask after the other.
    while left != 0 {
        let gap = left.trailing_zeros();
        let run = (left >> gap).trailing_ones();
        packed |= (word >> (from + gap) & (u128::MAX >> (128 - run))) << place;
        place += run;
        from += gap + run;
        left = left.checked_shr(gap + run).unwrap_or(0);
    }
    packed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bits_of_a_mask_close_up_in_order() {
        let word = 0xfedc_ba98_7654_3210_0123_4567_89ab_cdef_u128;
        let ends = 1 | 1 << 127;
        for mask in [0, 1, u128::MAX, ends, 0xff00_00ff, !ends, word, !word, 1 << 127, u128::MAX << 64] {
            let bits = (0..128).filter(|bit| mask >> bit & 1 == 1).enumerate();
            let expected = bits.fold(0, |sum, (place, bit)| sum | (word >> bit & 1) << place);
            assert_eq!(closed_up(word, mask), expected, "{mask:x}");
        }
    }
}
