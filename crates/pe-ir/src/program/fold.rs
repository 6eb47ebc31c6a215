//! The program memory of a PE: bits that every round repeats are stored once.
//!
//! Control words of a step stand in two memories of one address each: the loop memory has one word for each word of a
//! round, the stream memory one for each word of the step. Every bit of the control word comes from one of them.

use super::{Field, Layout, PeProgram, Program};
use crate::memory::{MemoryCells, rom};

/// The two memories of a PE's program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fold {
    /// Bits of the control word that come from the stream memory.
    pub streamed: u128,
    /// All bits of the control word.
    pub all: u128,
    /// Loop memory, bits at their places in the control word; empty if no bit comes from it.
    pub repeated: Vec<u128>,
    /// Stream memory, bits at their places in the control word; empty if no bit comes from it.
    pub stream: Vec<u128>,
}

impl Fold {
    /// Folds the program of a PE where that is smaller. Bits of fields without effect are free, and take what other
    /// rounds need.
    pub fn of(program: &Program, pe: &PeProgram) -> Fold {
        let layout = Layout::new(&pe.features, &program.format);
        let all = u128::MAX >> (128 - layout.bits);
        let words: Vec<u128> = pe.words.iter().map(|word| layout.encode(word)).collect();
        let flat = Fold { streamed: all, all, repeated: Vec::new(), stream: words.clone() };
        if program.rounds == 1 {
            return flat;
        }
        let length = program.round_words() as usize;
        let mut repeated = vec![0; length];
        let mut known = vec![0; length];
        let mut streamed = 0;
        let result = |k: usize| {
            let end = &pe.words[(k + program.latency().scale_to_write() as usize) % pe.words.len()];
            end.write.is_some() || end.write_index.is_some() || end.send
        };
        for (k, word) in pe.words.iter().enumerate() {
            let care = layout.effective(word, result(k));
            let slot = k % length;
            streamed |= (words[k] ^ repeated[slot]) & care & known[slot];
            repeated[slot] |= words[k] & care & !known[slot];
            known[slot] |= care;
        }
        repeated.iter_mut().for_each(|word| *word &= !streamed);
        if streamed == all {
            return flat;
        }
        let stream = if streamed == 0 { Vec::new() } else { words.iter().map(|word| word & streamed).collect() };
        let fold = Fold { streamed, all, repeated, stream };
        if fold.cells().equivalent_luts() < flat.cells().equivalent_luts() { fold } else { flat }
    }

    /// Bits of a word of the loop memory.
    pub fn repeated_bits(&self) -> u32 {
        (self.all & !self.streamed).count_ones()
    }

    /// Bits of a word of the stream memory.
    pub fn streamed_bits(&self) -> u32 {
        self.streamed.count_ones()
    }

    /// The control word that the PE sees in word `k` of a step.
    pub fn word(&self, k: usize) -> u128 {
        let repeated = if self.repeated.is_empty() { 0 } else { self.repeated[k % self.repeated.len()] };
        repeated | self.stream.get(k).copied().unwrap_or(0)
    }

    /// What the memories are made of.
    pub fn cells(&self) -> MemoryCells {
        let repeated = rom(self.repeated.len() as u32, self.repeated_bits());
        let stream = rom(self.stream.len() as u32, self.streamed_bits());
        [repeated, stream].into_iter().sum()
    }
}

impl Layout {
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
        Layout { fields, bits }
    }
}

/// The bits of a word that are in `mask`, closed up.
pub fn closed_up(word: u128, mask: u128) -> u128 {
    let bits = (0..128).filter(|bit| mask >> bit & 1 == 1);
    bits.enumerate().fold(0, |packed, (place, bit)| packed | (word >> bit & 1) << place)
}
