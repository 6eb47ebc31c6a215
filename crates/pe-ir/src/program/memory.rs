//! Outputs in memories: each PE keeps the words that it shows, and one read port rounds them in turn.

use super::{PeFeatures, Program, index_bits};
use crate::index::{PeId, at, number};

/// The output memories of a network, and how they are read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputMemory {
    /// PEs that have one, in order.
    pub pes: Vec<PeId>,
    /// Bits of a place in the largest one.
    pub place_bits: u32,
    /// Number of the memory in `pes` and place there of each output.
    pub places: Vec<(u32, u16)>,
    /// Whether an output may be out of range, so that it is clamped.
    pub saturates: bool,
    /// Clocks from the address of an output to its word.
    pub latency: u32,
}

/// Words that one register joins: `JOINED_AT_ONCE` in `pe_output_reader.vhd`.
const JOINED_AT_ONCE: u32 = 6;

impl OutputMemory {
    /// Clocks from an address to the memory: as long before the next publication an address must come to read the last one.
    pub const READ_AFTER: u32 = 3;

    /// Bits of an address, which is the number of an output.
    pub fn address_bits(&self) -> u32 {
        index_bits(number(self.places.len())).max(1)
    }

    /// Bits of the number of a memory.
    pub fn memory_bits(&self) -> u32 {
        index_bits(number(self.pes.len())).max(1)
    }

    /// Words that are left to be joined after each register, the memories first and one last.
    pub fn joined(&self) -> Vec<u32> {
        let first = number(self.pes.len());
        std::iter::successors(Some(first), |left| (*left > 1).then(|| left.div_ceil(JOINED_AT_ONCE))).collect()
    }
}

impl Program {
    /// The output memories; none if outputs are ports, or there are none.
    pub fn output_memory(&self) -> Option<OutputMemory> {
        let shows = |features: &PeFeatures| features.shown_words > 0;
        let pes: Vec<PeId> = self.pes.numbered().filter(|(_, pe)| shows(&pe.features)).map(|(pe, _)| pe).collect();
        let deepest = self.pes.iter().map(|pe| pe.features.shown_words).max()?;
        let place = |output: &super::OutputPort| {
            let memory = pes.binary_search(&output.pe).ok()?;
            Some((number(memory), output.place?))
        };
        let places: Vec<(u32, u16)> = self.outputs.iter().map_while(place).collect();
        if places.is_empty() {
            return None;
        }
        let saturates = self.outputs.iter().any(|output| !output.proven);
        let mut memory = OutputMemory { place_bits: index_bits(deepest), places, saturates, latency: 0, pes };
        memory.latency = 4 + number(memory.joined().len());
        Some(memory)
    }

    /// Words of a PE whose results its output memory takes, in the order of their places.
    pub fn shown_by(&self, pe: PeId) -> Vec<u32> {
        let features = &self.pes[pe].features;
        let taken = |(word, control): (u32, &super::ControlWord)| {
            (control.show && (!features.show_last || self.ends_step(word))).then_some(word)
        };
        let mut words: Vec<u32> = (0..).zip(&self.pes[pe].words).filter_map(taken).collect();
        words.sort_unstable_by_key(|word| self.since_pause(*word));
        words
    }

    /// Whether outputs are where their PEs show them.
    ///
    /// # Errors
    /// What is wrong.
    pub fn check_outputs(&self) -> Result<(), String> {
        let in_memory = self.outputs.iter().filter(|output| output.place.is_some()).count();
        if in_memory != 0 && in_memory != self.outputs.len() {
            return Err("some outputs are ports, others in memories".to_owned());
        }
        let shown: Vec<Vec<u32>> = self.pes.ids().map(|pe| self.shown_by(pe)).collect();
        for (pe, words) in self.pes.iter().zip(&shown) {
            if words.len() > at(pe.features.shown_words) {
                return Err("a PE shows more words than its output memory holds".to_owned());
            }
            // As outputs are published the word before the pause point is executed.
            if words.iter().any(|word| self.since_pause(*word) == self.period - 1) {
                return Err("a PE shows a word while outputs are published".to_owned());
            }
        }
        for output in self.outputs.iter() {
            let Some(place) = output.place else { continue };
            if shown[output.pe.index()].get(usize::from(place)) != Some(&output.word) {
                return Err(format!("output `{}` is not at its place in the output memory", output.name));
            }
        }
        Ok(())
    }
}
