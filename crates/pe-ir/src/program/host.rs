//! What a network offers a host beside inputs and outputs: a restart, its states, a flag per cause.

use std::collections::BTreeMap;

use super::{Program, index_bits};
use crate::index::{PeId, StateId, at, number};

/// What a network offers a host. What is not asked for costs nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Host {
    /// A port that brings back the initial state.
    pub restart: bool,
    /// Ports that read and replace states between two steps.
    pub states: bool,
    /// A flag per cause, and a port that clears them.
    pub flags: bool,
}

impl Host {
    /// All services by name, in the order of the fields.
    pub const NAMES: [&'static str; 3] = ["restart", "states", "flags"];

    /// Names of those that replace words of states, see [`Host::replaces`].
    pub const REPLACING: [&'static str; 2] = ["restart", "states"];

    /// Names of those that are there.
    pub fn names(&self) -> impl Iterator<Item = &'static str> {
        let present = [self.restart, self.states, self.flags];
        Host::NAMES.into_iter().zip(present).filter_map(|(name, present)| present.then_some(name))
    }

    /// Adds a service.
    ///
    /// # Panics
    /// If the name is none of [`Host::NAMES`].
    pub fn add(&mut self, name: &str) {
        match name {
            "restart" => self.restart = true,
            "states" => self.states = true,
            "flags" => self.flags = true,
            _ => panic!("a host has no `{name}`"),
        }
    }

    /// Whether words of states are replaced, by initial words or by those of a host.
    pub fn replaces(&self) -> bool {
        self.restart || self.states
    }
}

/// Whose word is replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Replaced {
    /// A state, and where its stored word is: PE and word of the base memory.
    State(StateId, PeId, u16),
    /// A tick, by its number among the ticks: its counter.
    Tick(u32),
}

/// What replaces a word when the step that replaces states comes to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Replacement {
    /// Whose word it is.
    pub of: Replaced,
    /// Control word in which the word is added up; 0 for ticks, which come first.
    pub word: u32,
    /// Word that a restart brings back.
    pub initial: i64,
}

impl Program {
    /// The order in which words are replaced: ticks, then states as the step writes them.
    ///
    /// # Errors
    /// Why a word cannot be replaced.
    pub fn replacements(&self) -> Result<Vec<Replacement>, String> {
        // The word that is written in word w is added up two words before it.
        const BEFORE: u32 = 2;
        let mut all = Vec::with_capacity(self.states.len());
        for (number, (index, tick, _)) in (0..).zip(self.ticks()) {
            let (name, bits) = (&self.inputs[at(index)].name, self.format.word_bits());
            if index_bits(tick.steps) > bits {
                return Err(format!("`{name}` counts {} steps, which is more than a word of {bits} bits", tick.steps));
            }
            all.push(Replacement { of: Replaced::Tick(number), word: 0, initial: i64::from(tick.done) });
        }
        let mut states = Vec::with_capacity(self.states.len());
        for ((index, state), writers) in self.states.numbered().zip(self.state_writers()) {
            let [word] = writers[..] else {
                return Err(format!("a step does not write state `{}` exactly once", state.name));
            };
            if state.age.is_some() {
                return Err(format!("state `{}` is in a ring", state.name));
            }
            let (pe, address) = state.own;
            let features = &self.pes[pe].features;
            let base = features.state_base(address);
            let replacement = Replacement {
                of: Replaced::State(index, pe, base as u16),
                word: (word + self.period - BEFORE) % self.period,
                initial: self.pes[pe].base_image[base],
            };
            states.push((self.since_pause(word), pe, replacement));
        }
        states.sort_unstable_by_key(|(time, pe, _)| (*time, *pe));
        all.extend(states.into_iter().map(|(.., replacement)| replacement));
        Ok(all)
    }

    /// Bits of the fields of a row of the order: the initial word, if there is a restart; the PE, or a tick's number behind
    /// the PEs; the control word.
    pub fn row_bits(&self) -> [u32; 3] {
        let initial = if self.host.restart { self.format.word_bits() } else { 0 };
        [initial, self.state_target_bits(), index_bits(self.period).max(1)]
    }

    /// The fields of a row.
    pub fn row(&self, replacement: &Replacement) -> [u64; 3] {
        let [initial, ..] = self.row_bits();
        let mask = u64::MAX.checked_shr(64 - initial).unwrap_or(0);
        let address = self.state_address(replacement.of);
        [replacement.initial as u64 & mask, address >> self.state_place_bits(), u64::from(replacement.word)]
    }

    /// Low bits of a state's address: the word of the base memory. The PE, or a tick's number behind the PEs, is above.
    pub fn state_place_bits(&self) -> u32 {
        let deepest = self.pes.iter().map(|pe| pe.features.base_words).max().unwrap_or(1);
        index_bits(deepest).max(1)
    }

    /// Upper bits of a state's address.
    pub fn state_target_bits(&self) -> u32 {
        index_bits(number(self.pes.len() + self.ticks().count())).max(1)
    }

    /// Address at which a host reads a word.
    pub fn state_address(&self, of: Replaced) -> u64 {
        let place_bits = self.state_place_bits();
        match of {
            Replaced::State(_, pe, place) => u64::from(pe.number()) << place_bits | u64::from(place),
            Replaced::Tick(tick) => (self.pes.len() as u64 + u64::from(tick)) << place_bits,
        }
    }

    /// The state whose word each output shows after a step, if it shows one: the control word that it captures is then the
    /// last one of a step that writes the state.
    pub fn shown_states(&self) -> Vec<Option<StateId>> {
        let writers = self.states.numbered().zip(self.state_writers());
        let last = writers.filter_map(|((id, state), writers)| Some(((state.own.0, *writers.last()?), id)));
        let shown: BTreeMap<(PeId, u32), StateId> = last.collect();
        self.outputs.iter().map(|output| shown.get(&(output.pe, output.word)).copied()).collect()
    }

    /// Control words that write the base word of each state, as they come: those of the last round that does.
    pub fn state_writers(&self) -> Vec<Vec<u32>> {
        let mut places: Vec<Vec<Option<StateId>>> =
            self.pes.iter().map(|pe| vec![None; at(pe.features.base_words)]).collect();
        for (index, state) in self.states.numbered().filter(|(_, state)| state.age.is_none()) {
            let (pe, address) = state.own;
            places[pe.index()][self.pes[pe].features.state_base(address)] = Some(index);
        }
        let mut writers = vec![Vec::new(); self.states.len()];
        for (pe, places) in self.pes.iter().zip(&places) {
            for (number, word) in (0..).zip(&pe.words) {
                let Some(target) = word.write.filter(|target| target.base) else { continue };
                if let Some(state) = places[pe.features.base_word(target.address.word)] {
                    writers[state.index()].push(number);
                }
            }
        }
        for words in &mut writers {
            words.sort_unstable_by_key(|word| self.since_pause(*word));
            let round = |word: u32| self.since_pause(word) / self.round_words();
            let last = words.last().map(|word| round(*word));
            words.retain(|word| Some(round(*word)) == last);
        }
        writers
    }
}
