//! The map of a design, `NAME_map.json`: everything a host program needs to know of a network that it talks to. Ports
//! with their formats, the time a step stands for and takes, where states are, and a hash that tells one design from
//! another.
//!
//! `pe-emit` writes it; hosts and wrappers read it and convert numbers with [`Format`]. Nothing here depends on the compiler.
//! `docs/map.md` explains each key, and `docs/map.schema.json` is made of these types.

pub mod registers;
pub mod wrap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// What [`Map::map_version`] is in maps that these types describe.
pub const VERSION: u32 = 1;

/// `NAME_map.json`.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Map {
    /// Version of this format; another one has keys that mean something else.
    pub map_version: u32,
    /// `pe-synth` and its version.
    pub generator: String,
    /// SHA-256 in hexadecimal of the generator, a line feed, and the text of the program (`NAME_program.txt`). Two
    /// designs with the same hash compute the same words.
    pub hash: String,
    /// Name of the model in the spec.
    pub model: String,
    /// Name of the VHDL entity.
    pub entity: String,
    /// Ports that are there in every network.
    pub control: Control,
    /// Time that a step stands for, in seconds of the model; after the early steps, if there are some.
    pub step: f64,
    /// Shorter steps at the beginning of a run.
    pub early_steps: Vec<EarlyStep>,
    /// Enabled clocks from the beginning of a step to that of the next one in free run.
    pub clocks_per_step: u32,
    /// Inputs that a host drives.
    pub inputs: Vec<Input>,
    /// Inputs that the network makes itself: 1 in each step in which a sampled block runs, else 0.
    pub ticks: Vec<Tick>,
    /// Outputs.
    pub outputs: Vec<Output>,
    /// How outputs in memories are read; missing where outputs are ports of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_memory: Option<OutputMemory>,
    /// Stored words of the states.
    pub states: Vec<State>,
    /// States that are tunable parameters: the network keeps them, a host gives them values.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<Parameter>,
    /// Ports for a host, of designs that have some (`compile --host`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub host: Option<HostPorts>,
    /// What runs in place of a network (`wrap --vhdl`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub foreign: Option<Foreign>,
}

/// A foreign entity. All VHDL names elsewhere in the map are those of its shell, which has the handshake of a network.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Foreign {
    /// Name of the VHDL entity, as its file has it.
    pub entity: String,
    /// Architecture.
    pub architecture: String,
    /// Clocks for which a step enables it; 0 if a step ends when it is ready. The first content of `STEP_CLOCKS`.
    pub step_clocks: u32,
    /// It tells when a step has ended.
    pub ready: bool,
}

/// VHDL names of the ports for a host.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct HostPorts {
    /// Input: brings back the initial state.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restart: Option<String>,
    /// Ports that read and replace states.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub access: Option<Access>,
    /// Flags, one per cause.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flags: Option<Flags>,
}

/// VHDL names of the ports that read and replace states, one bit each unless said otherwise, and the words' order.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Access {
    /// Input: asks for access.
    pub request: String,
    /// Output: there is access.
    pub granted: String,
    /// Input, `address_bits` wide: the word to read.
    pub address: String,
    /// Bits of an address.
    pub address_bits: u32,
    /// Output, as wide as a stored word: the word that was read.
    pub word: String,
    /// Input, as wide as a stored word: a new word.
    pub new_word: String,
    /// Input: there is one.
    pub valid: String,
    /// Output: it is taken.
    pub ready: String,
    /// All words, in the order in which new ones are taken.
    pub order: Vec<Place>,
}

/// A word that a host reads and replaces: the stored word of a state, or the steps since the last sample of a tick.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Place {
    /// Number in `states`; none for a tick.
    pub state: Option<u32>,
    /// Number in `ticks`; none for a state.
    pub tick: Option<u32>,
    /// Address at which it is read.
    pub address: u64,
}

/// VHDL names of the ports for flags, one bit each. Flags are sticky.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Flags {
    /// Input: clears all flags.
    pub clear: String,
    /// Output: a word that was written or sent saturated.
    pub saturated: String,
    /// Output: an operand was too large for a sum of two.
    pub operand: String,
    /// Output: an input was too large for a data operand.
    pub input: String,
}

/// VHDL names of the ports for clock and handshake, one bit each.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Control {
    /// Clock.
    pub clock: String,
    /// Clock enable of all registers and memories.
    pub clock_enable: String,
    /// Input: lets the next step begin.
    pub step: String,
    /// Output: 0 while the network waits for a step.
    pub busy: String,
    /// Output: 1 for one enabled clock when outputs are new.
    pub done: String,
    /// Output, sticky: a word saturated, or an input was out of range.
    pub overflow: String,
}

/// A step at the beginning of a run.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct EarlyStep {
    /// Time at which it ends, in seconds.
    pub until: f64,
    /// Its length in seconds.
    pub step: f64,
}

/// A fixed-point number: a two's complement integer of so many bits times `2^exponent`.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Format {
    /// Bits, the sign among them: at most 64.
    pub bits: u32,
    /// The least significant bit is worth `2^exponent`.
    pub exponent: i32,
}

/// What an input stands for.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Meaning {
    /// A quantity of the model.
    Quantity,
    /// What the step is divided by; in models with early steps.
    StepRatio,
}

/// What a host gives for the time between two steps.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Between {
    /// The value at the beginning of the step, which holds until its end.
    Hold,
    /// The value at the end of the step; a straight line leads to it.
    Linear,
}

/// What happens to a number that a port cannot carry.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outside {
    /// The nearest word that it can carry takes its place, and the overflow flag is set.
    ClampsAndFlags,
    /// The nearest word that it can carry takes its place. The flag is set if the word that is shown saturated before.
    Clamps,
    /// It was proven that there is none over the span that was judged.
    Proven,
    /// Up to a foreign entity; hosts give its inputs none.
    Foreign,
}

/// How a host rounds a number to a word.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HostRounding {
    /// To the nearest word; a number in the middle of two takes the one farther from zero.
    #[default]
    Nearest,
    /// To the next lower word.
    Down,
    /// To the next word towards zero.
    TowardsZero,
}

impl HostRounding {
    fn is_nearest(&self) -> bool {
        *self == HostRounding::Nearest
    }
}

/// How a network rounds a word.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rounding {
    /// To the nearest word; a number in the middle of two takes the upper one.
    NearestHalvesUp,
}

/// An input port.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Input {
    /// Name in the spec, with indices.
    pub name: String,
    /// Name of the VHDL port.
    pub port: String,
    /// What it stands for.
    pub meaning: Meaning,
    /// Unit in the spec.
    pub unit: Option<String>,
    /// Format of the port's words.
    #[serde(flatten)]
    pub format: Format,
    /// Least and greatest word that is not clamped.
    pub words: [i64; 2],
    /// The numbers that these stand for.
    pub limits: [f64; 2],
    /// Range that the spec states, for which formats and errors are judged.
    pub range: Option<[f64; 2]>,
    /// What a host gives for the time between two steps.
    pub between: Between,
    /// Format of the operand that the network rounds the word to.
    pub operand: Format,
    /// How it rounds.
    pub rounding: Rounding,
    /// What becomes of words beyond the limits.
    pub outside: Outside,
    /// How a host rounds a number to a word; to the nearest where nothing is said.
    #[serde(default, skip_serializing_if = "HostRounding::is_nearest")]
    pub host_rounding: HostRounding,
}

/// When an input that the network makes itself is 1.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Tick {
    /// Name of the sampled block's tick.
    pub name: String,
    /// Steps from one sample to the next.
    pub steps: u32,
    /// Steps since the last sample in the initial state; 0 if the first step begins with one.
    pub done: u32,
}

/// VHDL names of the ports that read outputs in memories.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct OutputMemory {
    /// Input, `address_bits` wide: the output to read, a number in `outputs`.
    pub address: String,
    /// Bits of an address.
    pub address_bits: u32,
    /// Output: its word.
    pub word: String,
    /// Clocks, enabled or not, from the address of an output to its word.
    pub latency: u32,
    /// Clocks before `done` rises from which on an address may read the step that is published then.
    pub lead: u32,
}

/// An output.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Output {
    /// Name in the spec, with indices.
    pub name: String,
    /// Name of the VHDL port; of outputs in memories the one that shows the word at `address`.
    pub port: String,
    /// Address at which it is read; missing of a port of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub address: Option<u32>,
    /// Unit in the spec.
    pub unit: Option<String>,
    /// Format of the port's words.
    #[serde(flatten)]
    pub format: Format,
    /// Number of the state that it shows, whose stored word the network rounds to the port; none of an output that the
    /// network has only after a step.
    pub state: Option<u32>,
    /// Of outputs that show no state: the word in the initial state with all inputs 0; missing if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial: Option<i64>,
    /// How the word in the network is rounded to the port.
    pub rounding: Rounding,
    /// What becomes of a word that rounds to more than the port carries.
    pub outside: Outside,
}

/// A tunable parameter.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Parameter {
    /// Name in the spec, with indices.
    pub name: String,
    /// Unit in the spec.
    pub unit: Option<String>,
    /// Number of its state, whose word a host replaces.
    pub state: u32,
    /// Value in the spec.
    pub value: f64,
    /// Range that the spec states, and the design was judged for at its ends.
    pub range: [f64; 2],
}

/// Where a state is.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct State {
    /// Name in the spec, with indices.
    pub name: String,
    /// Format of the stored word; its value is `(word - offset) * 2^exponent`.
    #[serde(flatten)]
    pub format: Format,
    /// What is added to every stored word, so that cutting bits off rounds it.
    pub offset: i64,
    /// The PE that computes it.
    pub pe: u32,
    /// Address in that PE's own memory, and in its base memory unless there is a `base`.
    pub address: u16,
    /// Address in the base memory where it is another one: in PEs whose own memory is not deeper, and whose buffers change roles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base: Option<u16>,
    /// PEs and addresses of imported memories that hold a copy between two steps.
    pub copies: Vec<(u32, u16)>,
    /// How many steps ago it was written, if it is one of the past words of a ring: the addresses, where it has no base word, are
    /// those of the first step, and the words of a ring move on by one with every step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub age: Option<u32>,
    /// Stored word of the initial state.
    pub initial: i64,
}

/// A word that stands for a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Word {
    /// Two's complement.
    pub word: i64,
    /// Whether the number is beyond the words of the format, so that the nearest one was taken.
    pub clamped: bool,
}

/// The largest exponent of a format, and its negative the smallest: more than any number has.
const MOST_EXPONENT: u32 = 1 << 12;

/// The least number beyond integers of 64 bits.
const TWO_TO_63: f64 = 9_223_372_036_854_775_808.0;

impl Format {
    /// Least and greatest word.
    pub fn words(&self) -> [i64; 2] {
        [i64::MIN >> (64 - self.bits), i64::MAX >> (64 - self.bits)]
    }

    /// The nearest word to a number, ties away from zero; none for NaN.
    pub fn word(&self, number: f64) -> Option<Word> {
        self.word_within(number, self.words())
    }

    /// The same, for words from the first to the second of `limits`.
    pub fn word_within(&self, number: f64, limits: [i64; 2]) -> Option<Word> {
        self.rounded_within(number, limits, HostRounding::Nearest)
    }

    fn rounded_within(&self, number: f64, [least, most]: [i64; 2], rounding: HostRounding) -> Option<Word> {
        if number.is_nan() {
            return None;
        }
        let rounded = match rounding {
            HostRounding::Nearest => libm::round,
            HostRounding::Down => libm::floor,
            HostRounding::TowardsZero => libm::trunc,
        };
        let scaled = rounded(libm::scalbn(number, -self.exponent));
        // The cast takes the nearest integer of 64 bits, so a comparison of integers is exact.
        let beyond = !(-TWO_TO_63..TWO_TO_63).contains(&scaled);
        let nearest = scaled as i64;
        Some(Word { word: nearest.clamp(least, most), clamped: beyond || !(least..=most).contains(&nearest) })
    }

    /// The number that a word stands for; words of more than 53 bits are rounded.
    pub fn number(&self, word: i64) -> f64 {
        libm::scalbn(word as f64, self.exponent)
    }
}

impl State {
    /// The nearest stored word to a number; none for NaN. What a host reads and replaces are such words.
    pub fn word(&self, number: f64) -> Option<Word> {
        let [least, most] = self.format.words();
        let word = self.format.word_within(number, [least, most - self.offset])?;
        Some(Word { word: word.word + self.offset, ..word })
    }

    /// The number that a stored word stands for.
    pub fn number(&self, word: i64) -> f64 {
        self.format.number(word - self.offset)
    }
}

impl Input {
    /// The word for a number, of those that the network does not clamp; none for NaN.
    pub fn word(&self, number: f64) -> Option<Word> {
        self.format.rounded_within(number, self.words, self.host_rounding)
    }
}

/// Why a text is no map that these types describe.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It is no JSON, a key is missing, or has a value of another kind: line, column and what was expected.
    Damaged(String),
    /// It is of another version.
    Version(u64),
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Fault::Damaged(what) => write!(f, "the map is damaged: {what}"),
            Fault::Version(version) => {
                write!(f, "the map is of version {version}, this program reads version {VERSION}")
            }
        }
    }
}

impl std::error::Error for Fault {}

/// SHA-256 in hexadecimal.
pub fn sha256(content: &[u8]) -> String {
    Sha256::digest(content).iter().map(|byte| format!("{byte:02x}")).collect()
}

impl Map {
    /// Reads a map.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn read(text: &str) -> Result<Map, Fault> {
        #[derive(Deserialize)]
        struct Versioned {
            map_version: u64,
        }
        let damaged = |error: serde_json::Error| Fault::Damaged(error.to_string());
        let Versioned { map_version } = serde_json::from_str(text).map_err(damaged)?;
        if map_version != u64::from(VERSION) {
            return Err(Fault::Version(map_version));
        }
        let map: Map = serde_json::from_str(text).map_err(damaged)?;
        map.check().map(|()| map).map_err(Fault::Damaged)
    }

    /// That numbers fit each other, so that whoever reads the map need not look.
    fn check(&self) -> Result<(), String> {
        let formats = self.inputs.iter().map(|input| (&input.name, input.format));
        let formats = formats.chain(self.outputs.iter().map(|output| (&output.name, output.format)));
        for (name, format) in formats.chain(self.states.iter().map(|state| (&state.name, state.format))) {
            if !(1..=64).contains(&format.bits) || format.exponent.unsigned_abs() > MOST_EXPONENT {
                return Err(format!("`{name}` has {} bits and an exponent of {}", format.bits, format.exponent));
            }
        }
        for input in &self.inputs {
            let ([least, most], [low, high]) = (input.words, input.format.words());
            if low > least || least > most || most > high {
                return Err(format!("the words of input `{}` do not fit it", input.name));
            }
        }
        for state in &self.states {
            let [least, most] = state.format.words();
            // Sums of a word and the offset fit 64 bits.
            if state.format.bits > 62 || !(0..=most).contains(&state.offset) || !(least..=most).contains(&state.initial)
            {
                return Err(format!("the words of state `{}` do not fit it", state.name));
            }
        }
        let is_state = |number: u32| usize::try_from(number).is_ok_and(|number| number < self.states.len());
        for output in &self.outputs {
            if let Some(state) = output.state {
                let bits = self.states.get(state as usize).map(|state| state.format.bits);
                if bits.is_none_or(|bits| bits < output.format.bits || bits - output.format.bits > 62) {
                    return Err(format!("output `{}` shows state {state}, which does not fit it", output.name));
                }
            }
        }
        if let Some(parameter) = self.parameters.iter().find(|parameter| !is_state(parameter.state)) {
            return Err(format!("there is no state {} for parameter `{}`", parameter.state, parameter.name));
        }
        if let Some(tick) = self.ticks.iter().find(|tick| tick.steps == 0) {
            return Err(format!("tick `{}` comes every 0 steps", tick.name));
        }
        let is_tick = |number: u32| usize::try_from(number).is_ok_and(|number| number < self.ticks.len());
        let order = self.host.as_ref().and_then(|host| host.access.as_ref()).map_or(&[][..], |access| &access.order);
        for place in order {
            if !matches!((place.state, place.tick), (Some(state), None) if is_state(state))
                && !matches!((place.state, place.tick), (None, Some(tick)) if is_tick(tick))
            {
                return Err("`host.access.order` names what there is not".to_owned());
            }
        }
        let early = self.early_steps.iter().map(|early| early.step);
        if early.chain([self.step]).any(|step| !step.is_finite() || step <= 0.0) {
            return Err("a step is not greater than 0".to_owned());
        }
        Ok(())
    }

    /// The text of the file.
    pub fn text(&self) -> String {
        let text = serde_json::to_string_pretty(self).expect("a map has names and finite numbers");
        text + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_round_to_the_nearest_word_and_clamp_at_the_ends() {
        let format = Format { bits: 8, exponent: -4 };
        let word = |number| format.word(number).map(|word| (word.word, word.clamped));
        assert_eq!(word(1.0), Some((16, false)));
        assert_eq!(word(0.031), Some((0, false)));
        assert_eq!(word(0.03125), Some((1, false)));
        assert_eq!(word(-0.03125), Some((-1, false)));
        assert_eq!(word(7.95), Some((127, false)));
        assert_eq!(word(7.97), Some((127, true)));
        assert_eq!(word(-8.0), Some((-128, false)));
        assert_eq!(word(f64::INFINITY), Some((127, true)));
        assert_eq!(word(f64::NEG_INFINITY), Some((-128, true)));
        assert_eq!(word(f64::NAN), None);
        assert!((-128..=127).all(|word| format.word(format.number(word)) == Some(Word { word, clamped: false })));
    }

    #[test]
    fn a_host_rounds_as_the_input_says() {
        let format = Format { bits: 9, exponent: -1 };
        let words = |rounding| [-0.75, 0.74, 200.0].map(|x| format.rounded_within(x, [0, 255], rounding).unwrap());
        let word = |word, clamped| Word { word, clamped };
        assert_eq!(words(HostRounding::Nearest), [word(0, true), word(1, false), word(255, true)]);
        let format = Format { bits: 9, exponent: -1 };
        let words = |rounding| [-0.75, 0.99].map(|x| format.rounded_within(x, format.words(), rounding).unwrap().word);
        assert_eq!(words(HostRounding::Nearest), [-2, 2]);
        assert_eq!(words(HostRounding::Down), [-2, 1]);
        assert_eq!(words(HostRounding::TowardsZero), [-1, 1]);
    }

    #[test]
    fn the_widest_words_are_exact_at_their_ends() {
        let format = Format { bits: 64, exponent: 0 };
        let [least, most] = format.words();
        assert_eq!((least, most), (i64::MIN, i64::MAX));
        assert_eq!(format.word(-9.3e18), Some(Word { word: least, clamped: true }));
        assert_eq!(format.word(-9_223_372_036_854_775_808.0), Some(Word { word: least, clamped: false }));
        assert_eq!(format.word(9_223_372_036_854_775_808.0), Some(Word { word: most, clamped: true }));
    }

    #[test]
    fn another_version_is_named_and_damage_has_a_place() {
        assert_eq!(Map::read("{\"map_version\": 2}"), Err(Fault::Version(2)));
        let fault = Map::read("{\"map_version\": 1,\n \"generator\": 5}").unwrap_err();
        assert!(matches!(&fault, Fault::Damaged(what) if what.contains("line 2")), "{fault}");
        assert!(matches!(Map::read(""), Err(Fault::Damaged(_))));
    }
}
