//! The program: control words, memory images and links of every PE, and the only input of VHDL, Rust reference
//! and simulator.

mod fits;
mod fold;
mod host;
mod layout;
mod memory;
mod shape;
mod text;

pub use fold::{Effects, Fold, VARIANT_WORDS, closed_up};
pub use host::{Host, Replaced, Replacement};
pub use layout::{Field, FieldName, Layout, index_bits};
pub use memory::OutputMemory;
pub use shape::{shape, shapes};
pub use text::read;

use std::num::NonZeroU32;

use crate::functions::Segments;
use crate::index::{List, PeId, PortId, StateId, ValueId, at};
use crate::word::{Latency, WordFormat};

/// A word of a PE's own or imported memory. With `swap`, the top address bit is inverted in odd rounds. With `ring`, the number
/// of the step is added to the [`PeFeatures::ring_bits`] lowest bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    /// Index within the memory.
    pub word: u16,
    /// Whether the word lies in a pair of buffers that change roles every round.
    pub swap: bool,
    /// Whether the word lies in a ring of past values, whose words move on by one place with every step.
    pub ring: bool,
}

/// Operand on the coefficient port of the multiplier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CoefficientOperand {
    /// The coefficient in the control word (PEs without a coefficient memory).
    Coefficient(i64),
    /// A word of the coefficient memory (PEs with one).
    Stored(u16),
}

/// Where a result is written: the memories share one address, of which each takes as many low bits as it needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Target {
    /// Address; its swap bit steers the own memory only.
    pub address: Address,
    /// The own memory takes the data operand.
    pub own: bool,
    /// The base memory takes the word.
    pub base: bool,
    /// The coefficient memory takes the coefficient operand (PEs with the `factor` feature).
    pub factor: bool,
}

/// One control word. Its groups act in the cycle in which the word is in the control register; the scheduler
/// places each group at the distance that [`Latency`] prescribes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ControlWord {
    /// Operand group: word of the own memory on the data port.
    pub own: Option<Address>,
    /// Operand group: word of the imported memory on the data port. At most one of `own` and `imported` is set.
    pub imported: Option<Address>,
    /// Operand group: what is on the coefficient port.
    pub coefficient: CoefficientOperand,
    /// Accumulate group: hands the finished sum to the hold register and starts the next one.
    pub close: bool,
    /// Scale group: word of the base memory; without one the rounding offset is the base.
    pub base: Option<u16>,
    /// Index group: word of the index memory whose index the base address of the next word takes.
    pub index: Option<u16>,
    /// Scale group: index into [`PeFeatures::shifts`].
    pub shift: u8,
    /// Write group: memory words that take the result.
    pub write: Option<Target>,
    /// Write group: word of the index memory that takes the segment of the result, and whether it counts octaves.
    pub write_index: Option<(u16, bool)>,
    /// Write group: the output memory takes the result, in the last round only if the PE has
    /// [`PeFeatures::show_last`].
    pub show: bool,
    /// Write group: puts the result on the PE's link.
    pub send: bool,
    /// Receive group: input port and imported memory word.
    pub receive: Option<(PortId, Address)>,
}

impl Default for ControlWord {
    fn default() -> Self {
        ControlWord {
            own: None,
            imported: None,
            coefficient: CoefficientOperand::Coefficient(0),
            close: false,
            base: None,
            index: None,
            shift: 0,
            write: None,
            write_index: None,
            show: false,
            send: false,
            receive: None,
        }
    }
}

/// The hardware features of one PE. Control-word fields, simulator and VHDL generics follow from this record.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PeFeatures {
    /// Depth of the own memory, a power of two, at least 2.
    pub own_words: u32,
    /// Depth of the base memory, a power of two, at least 2.
    pub base_words: u32,
    /// Depth of the coefficient memory, a power of two, at least 2; zero if coefficients stand in the control word.
    pub coefficient_words: u32,
    /// Depth of the imported memory, zero or a power of two, at least 2.
    pub imported_words: u32,
    /// Number of input ports.
    pub ports: u32,
    /// Right-shift positions of the write side, ascending, at least one.
    pub shifts: Vec<u8>,
    /// Accumulator bits in use; products and sums provably fit.
    pub accumulator_bits: u32,
    /// Product of two stored words: the coefficient memory is written.
    pub factor: bool,
    /// Sum of an own and an imported operand in front of the multiplier.
    pub pre_adder: bool,
    /// Buffers that change roles every round.
    pub swap: bool,
    /// The base memory is written in the last round of a step only.
    pub base_last: bool,
    /// Output link.
    pub send: bool,
    /// Every word that it writes is proven to be in range ([`crate::verify::ranges`]), so that nothing saturates.
    pub proven: bool,
    /// Depth of the index memory, zero or a power of two, at least 2.
    pub index_words: u32,
    /// Bits of an index; base memories of PEs with an index memory have at least as many address bits.
    pub index_bits: u32,
    /// Bits of an index that count octaves; zero if all indices are those of equal segments.
    pub octave_bits: u32,
    /// Words of the output memory per step, zero or a power of two, at least 2.
    pub shown_words: u32,
    /// The output memory is written in the last round of a step only.
    pub show_last: bool,
    /// Bits that count the words of a ring, alike in the own and the imported memory; zero without rings.
    pub ring_bits: u32,
}

impl PeFeatures {
    /// The base word that a write address means, in every round.
    pub fn base_word(&self, address: u16) -> usize {
        usize::from(address) & (at(self.base_words) - 1)
    }

    /// The base word of a state whose own word, as a step starts, is `own`: both words of a swapping pair have that of the lower
    /// half.
    pub fn state_base(&self, own: u16) -> usize {
        let pair = if self.swap { own & (self.own_words / 2 - 1) as u16 } else { own };
        self.base_word(pair)
    }

    /// The coefficient word that a write address means.
    pub fn factor_word(&self, address: u16) -> usize {
        usize::from(address) & (at(self.coefficient_words) - 1)
    }

    /// The word of a ring that an address means in a step of the run.
    pub fn turned(&self, word: u16, step: u64) -> u16 {
        let mask = (1u64 << self.ring_bits) - 1;
        word & !(mask as u16) | ((u64::from(word) + step) & mask) as u16
    }

    /// How arguments become indices.
    pub fn segments(&self) -> Segments {
        Segments { index_bits: self.index_bits, octave_bits: self.octave_bits }
    }

    /// Whether a write address lies within the deepest memory that takes the word.
    pub fn reaches(&self, target: Target) -> bool {
        let depths =
            [(target.own, self.own_words), (target.base, self.base_words), (target.factor, self.coefficient_words)];
        let deepest = depths.iter().filter(|(taken, _)| *taken).map(|(_, depth)| *depth).max();
        deepest.is_none_or(|depth| u32::from(target.address.word) < depth)
    }

    /// Words that a write address tells apart.
    pub fn write_words(&self) -> u32 {
        let factors = if self.factor { self.coefficient_words } else { 0 };
        self.own_words.max(self.base_words).max(factors)
    }
}

/// What an input port is wired to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LinkSource {
    /// The output link of another PE.
    Pe(PeId),
    /// An external input.
    Input(u32),
}

impl LinkSource {
    /// The PE, if it is one.
    pub fn pe(self) -> Option<PeId> {
        match self {
            LinkSource::Pe(pe) => Some(pe),
            LinkSource::Input(_) => None,
        }
    }
}

/// Where a control word comes from: values in [`Program::names`], none where nothing happens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Note {
    /// Value on the data port.
    pub operand: Option<ValueId>,
    /// Value whose chain the product belongs to (its first write).
    pub chain: Option<ValueId>,
    /// Value that the write group stores.
    pub write: Option<ValueId>,
    /// Value that the receive group stores.
    pub receive: Option<ValueId>,
}

/// Program and memory images of one PE.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PeProgram {
    /// Hardware features.
    pub features: PeFeatures,
    /// Wiring of the input ports.
    pub ports: List<PortId, LinkSource>,
    /// Names of the equations mapped to this PE.
    pub equations: Vec<String>,
    /// [`Program::period`] control words.
    pub words: Vec<ControlWord>,
    /// Provenance of each control word.
    pub notes: Vec<Note>,
    /// Initial own memory, data operands.
    pub own_image: Vec<i64>,
    /// Initial base memory, stored words.
    pub base_image: Vec<i64>,
    /// Initial coefficient memory, coefficient operands.
    pub coefficient_image: Vec<i64>,
    /// Initial imported memory, data operands.
    pub imported_image: Vec<i64>,
    /// Fields of control words that come from the variant memory where that is smaller, whether rounds differ in them or
    /// not.
    pub varied: Vec<FieldName>,
}

/// An input of the network: a port, `storage_bits` wide, or a tick.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputPort {
    /// Name in the spec.
    pub name: String,
    /// Unit in the spec, if any.
    pub unit: Option<String>,
    /// The port's LSB is worth `2^exponent`.
    pub exponent: i32,
    /// Steps of a tick, which the network makes itself; none of a port.
    pub tick: Option<Tick>,
}

/// When a tick is 1.0; in all other steps it is 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tick {
    /// Steps from one sample to the next.
    pub steps: u32,
    /// Steps since the last sample as the run starts; 0 if the first step begins with one.
    pub done: u32,
}

impl Tick {
    /// Whether a step of the run begins with a sample.
    pub fn is_due(&self, step: u64) -> bool {
        (step + u64::from(self.done)).is_multiple_of(u64::from(self.steps))
    }
}

/// An output of the network, `storage_bits` wide: a port, or a word of an output memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputPort {
    /// Name in the spec.
    pub name: String,
    /// Unit in the spec, if any.
    pub unit: Option<String>,
    /// The PE that computes it.
    pub pe: PeId,
    /// Index of the control word whose write group holds the value.
    pub word: u32,
    /// The port's LSB is worth `2^exponent`.
    pub exponent: i32,
    /// What it shows is proven to be in range ([`crate::verify::ranges`]), so that nothing is clamped.
    pub proven: bool,
    /// Its place in the output memory of the PE; none of a port. Either all outputs have a place or none.
    pub place: Option<u16>,
}

/// Where a state lives; used to start a run from any state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StateRegister {
    /// Name in the spec.
    pub name: String,
    /// The stored word's LSB is worth `2^exponent`.
    pub exponent: i32,
    /// PE and own memory word; the same address, as far as the base memory goes, holds the base word, unless the state is in a
    /// ring.
    pub own: (PeId, u16),
    /// PEs and imported memory words that hold a copy at the start of a step.
    pub imported: Vec<(PeId, u16)>,
    /// How many steps ago what it holds was written, if it is in a ring: the words above are those of the first step.
    pub age: Option<NonZeroU32>,
    /// Whether it is a tunable parameter, which a step leaves as it is.
    pub tunable: bool,
}

impl PeProgram {
    /// Whether the base address of a control word takes an index, which the word before it fetches.
    pub fn takes_index(&self, word: usize) -> bool {
        self.words[(word + self.words.len() - 1) % self.words.len()].index.is_some()
    }
}

/// A network of PEs with everything they run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// Model name.
    pub model: String,
    /// Word widths.
    pub format: WordFormat,
    /// Control words per step, equal to clock cycles per step.
    pub period: u32,
    /// Rounds of equal length per step; swapping buffers change roles after each.
    pub rounds: u32,
    /// The PEs.
    pub pes: List<PeId, PeProgram>,
    /// Inputs: ports, then ticks.
    pub inputs: Vec<InputPort>,
    /// Outputs.
    pub outputs: Vec<OutputPort>,
    /// Registers of the states.
    pub states: List<StateId, StateRegister>,
    /// Names of values, for notes.
    pub names: List<ValueId, String>,
    /// What the network offers a host beside inputs and outputs.
    pub host: Host,
}

impl Program {
    /// Control words per round.
    pub fn round_words(&self) -> u32 {
        self.period / self.rounds
    }

    /// Whether what is written in a word of a step belongs to the step's last round.
    pub fn ends_step(&self, word: u32) -> bool {
        // Writes before the place of the pause point in a round finish the round before.
        self.since_pause(word) / self.round_words() == self.rounds - 1
    }

    /// Control words from the pause point, where a step begins, to one of them.
    pub fn since_pause(&self, word: u32) -> u32 {
        (word + self.period - self.latency().pause() % self.period) % self.period
    }

    /// Whether a PE clamps words that are out of range. One that does not was proven to write none over the span, from
    /// the initial states on: started from words that no run over the span has, it may wrap.
    pub fn saturates(&self, pe: PeId) -> bool {
        !self.pes[pe].features.proven
    }

    /// The latency table.
    pub fn latency(&self) -> Latency {
        Latency::of(&self.format)
    }

    /// Inputs that are ports.
    pub fn ports(&self) -> impl Iterator<Item = &InputPort> {
        self.inputs.iter().filter(|input| input.tick.is_none())
    }

    /// Inputs that the network makes itself, each with its number and the port word of 1.0.
    pub fn ticks(&self) -> impl Iterator<Item = (u32, Tick, i64)> + '_ {
        let tick = |(index, input): (u32, &InputPort)| Some((index, input.tick?, 1i64 << -input.exponent));
        (0..).zip(&self.inputs).filter_map(tick)
    }

    /// Makes a step of the run the first one for all ticks.
    pub fn start_ticks(&mut self, step: u64) {
        for tick in self.inputs.iter_mut().filter_map(|input| input.tick.as_mut()) {
            tick.done = (step % u64::from(tick.steps)) as u32;
        }
    }

    /// How the arguments of tables become indices, in all PEs.
    pub fn segments(&self) -> Segments {
        let segments = self.pes.iter().map(|pe| pe.features.segments());
        segments.max_by_key(|segments| (segments.index_bits, segments.octave_bits)).unwrap_or_default()
    }

    /// Name of a noted value; empty for none.
    pub fn name(&self, note: Option<ValueId>) -> &str {
        note.and_then(|value| self.names.find(value)).map_or("", String::as_str)
    }

    /// Memory writes in each step, own and imported: the length of a trace, known without running anything.
    pub fn writes_per_step(&self) -> u64 {
        let words = self.pes.iter().flat_map(|pe| &pe.words);
        words.map(|word| u64::from(word.write.is_some()) + u64::from(word.receive.is_some())).sum()
    }
}

impl StateRegister {
    /// Its stored word in the images.
    pub fn initial(&self, program: &Program) -> i64 {
        let (pe, address) = self.own;
        let pe = &program.pes[pe];
        match self.age {
            None => pe.base_image[pe.features.state_base(address)],
            Some(_) => program.format.operand_word(pe.own_image[usize::from(address)]),
        }
    }

    /// The own word that holds it as a step of the run starts.
    pub fn own_word(&self, features: &PeFeatures, step: u64) -> u16 {
        match self.age {
            None => self.own.1,
            Some(_) => features.turned(self.own.1, step),
        }
    }

    /// Writes a stored word into every image that holds the state at the start of a step.
    pub fn set(&self, pes: &mut List<PeId, PeProgram>, format: &WordFormat, word: i64) {
        let (pe, address) = self.own;
        let pe = &mut pes[pe];
        pe.own_image[usize::from(address)] = format.data_operand(word);
        if self.age.is_none() {
            let base = pe.features.state_base(address);
            pe.base_image[base] = word;
        }
        for (pe, address) in &self.imported {
            pes[*pe].imported_image[usize::from(*address)] = format.data_operand(word);
        }
    }
}
