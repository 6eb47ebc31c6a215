//! The register map of a wrapper: the one place that says which registers there are, where, and what their bits mean.
//!
//! `pe-wrap` makes VHDL of it, `docs/wrapper.md` shows it, hosts take addresses from it. All addresses are in bytes; a
//! register has 32 bits and begins at a multiple of 4.

use crate::Format;

/// Version of the register map, in `VERSION`.
pub const REGISTER_VERSION: u16 = 1;

/// What `ID` reads: `PESH`.
pub const ID: u32 = 0x5045_5348;

/// What `SLACK_MIN` reads before a paced step.
pub const NO_SLACK: i32 = i32::MAX;

/// Bytes of a window at least. There are four, of equal size: registers, parameters, inputs, outputs.
pub const WINDOW: u32 = 0x400;

/// How a register may be used; what is not permitted is answered by an error of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// Read only.
    Read,
    /// Written only: bits that are 1 are commands.
    Command,
    /// Read and written.
    ReadWrite,
    /// Read; some bits are cleared by writing 1.
    ReadClear,
    /// Read; of a foreign entity written as well.
    ReadForeign,
}

impl Use {
    /// As tables show it.
    pub fn text(self) -> &'static str {
        match self {
            Use::Read => "R",
            Use::Command => "W",
            Use::ReadWrite => "RW",
            Use::ReadClear => "RC",
            Use::ReadForeign => "RF",
        }
    }
}

/// What a wrapper may lack; the bit of `CAPS` has the same name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Capability {
    /// The network can be restarted.
    Restart,
    /// States can be read and replaced.
    States,
    /// There is a flag per cause, and flags can be cleared.
    Flags,
    /// Inputs and outputs can go through streams.
    Stream,
    /// There are parameters that are written at run time.
    Parameters,
    /// It is a foreign entity, which runs by its clock enable.
    Foreign,
    /// It tells when a step has ended.
    Ready,
}

/// Part of a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Name.
    pub name: &'static str,
    /// Lowest bit.
    pub low: u8,
    /// Bits.
    pub bits: u8,
    /// What it says or does.
    pub meaning: &'static str,
    /// Whether writing 1 clears it.
    pub clears: bool,
    /// What a wrapper must have; without it the bit is 0, and writing 1 to a command is an error.
    pub needs: Option<Capability>,
}

impl Field {
    const fn bit(name: &'static str, low: u8, meaning: &'static str) -> Field {
        Field { name, low, bits: 1, meaning, clears: false, needs: None }
    }

    const fn bits(name: &'static str, low: u8, bits: u8, meaning: &'static str) -> Field {
        Field { name, low, bits, meaning, clears: false, needs: None }
    }

    const fn cleared(self) -> Field {
        Field { clears: true, ..self }
    }

    const fn with(self, needs: Capability) -> Field {
        Field { needs: Some(needs), ..self }
    }

    /// The bits of the field in a word of the register.
    pub const fn mask(&self) -> u32 {
        (u32::MAX >> (32 - self.bits)) << self.low
    }
}

/// A register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Register {
    /// Name.
    pub name: &'static str,
    /// Address in bytes.
    pub address: u32,
    /// How it may be used.
    pub usage: Use,
    /// What it says or does.
    pub meaning: &'static str,
    /// Its parts; without any it is one number of 32 bits, or half of one of 64.
    pub fields: &'static [Field],
    /// What a wrapper must have; without it there is no such register.
    pub needs: Option<Capability>,
}

impl Register {
    const fn new(name: &'static str, address: u32, usage: Use, meaning: &'static str) -> Register {
        Register { name, address, usage, meaning, fields: &[], needs: None }
    }

    const fn of(self, fields: &'static [Field]) -> Register {
        Register { fields, ..self }
    }

    const fn with(self, needs: Capability) -> Register {
        Register { needs: Some(needs), ..self }
    }

    /// One of its fields.
    pub fn field(&self, name: &str) -> Option<&'static Field> {
        self.fields.iter().find(|field| field.name == name)
    }
}

const CAPS: &[Field] = &[
    Field::bit("RESTART", 0, "command `RESTART` exists"),
    Field::bit("STATES", 1, "states can be read and replaced"),
    Field::bit("FLAGS", 2, "there is a flag per cause"),
    Field::bit("STREAM", 3, "there are streams"),
    Field::bit("FOREIGN", 4, "a foreign entity, which runs by its clock enable"),
    Field::bit("PARAMETERS", 5, "there are parameters that are written at run time"),
    Field::bit("READY", 6, "it tells when a step has ended: `STEP_CLOCKS` may be 0"),
    Field::bits("WINDOW", 8, 4, "each of the four windows has 400 (hex) bytes times 2 to this power"),
    Field::bits("STATE_BITS", 16, 7, "bits of a stored word; 0 without `STATES`"),
];

const COMMAND: &[Field] = &[
    Field::bit(
        "START",
        0,
        "takes the inputs, like `INPUTS`, and begins a run; an error while `BUSY`, with `MODE.ACCESS`, with `MODE.PACE` and a `PACE_PERIOD` of 0, and together with `ABORT` or `RESTART`",
    ),
    Field::bit("ABORT", 1, "ends the run with the step that is under way"),
    Field::bit("INPUTS", 2, "takes all words of the input window at once: steps that begin later compute with them"),
    Field::bit("CLEAR", 3, "sets counters and statistics back, but not `STEP_COUNT`"),
    Field::bit("RESTART", 4, "ends the run, brings back the initial state and sample 0, and clears counters")
        .with(Capability::Restart),
    Field::bit(
        "PARAMETERS",
        5,
        "takes all words of the parameter window to the network, between two steps: those that begin later compute with them; an error while `TUNING`, with `MODE.ACCESS`, and together with `RESTART`",
    )
    .with(Capability::Parameters),
];

const STATUS: &[Field] = &[
    Field::bit("BUSY", 0, "a run, or a restart, is under way"),
    Field::bit("DONE", 1, "a run has ended").cleared(),
    Field::bit(
        "TIME_EXCEEDED",
        2,
        "a step took more clocks than `CLOCK_BUDGET`; the run was stopped in the middle of it",
    )
    .cleared(),
    Field::bit("OVERRUN", 3, "a paced step was not ready in time").cleared(),
    Field::bit("ABORTED", 4, "a run was ended by `ABORT`").cleared(),
    Field::bit("OVERFLOW", 5, "any of the following three; without `CAPS.FLAGS` the flag of the network, which stays"),
    Field::bit("SATURATED", 6, "a word that was written or sent saturated").cleared().with(Capability::Flags),
    Field::bit("OPERAND", 7, "an operand was too large for a sum of two").cleared().with(Capability::Flags),
    Field::bit("INPUT", 8, "an input word was clamped").cleared().with(Capability::Flags),
    Field::bit("OUTPUTS", 9, "every word of the output window can be read"),
    Field::bit("UNFINISHED", 10, "a step was stopped in the middle; `START` goes on with it"),
    Field::bit("CLOCKING", 11, "clocks of `SINGLE_CLOCKS` are left"),
    Field::bit("ACCESS", 12, "states can be read, and replaced").with(Capability::States),
    Field::bit("STATE_READY", 13, "`STATE_LOW` takes a new word").with(Capability::States),
    Field::bit("REPLACING", 14, "some states are replaced, others not yet").with(Capability::States),
    Field::bit("FRAME", 15, "a frame was dropped: it had not as many words as there are inputs, or no step to take it")
        .cleared()
        .with(Capability::Stream),
    Field::bit("TUNING", 16, "parameters that were taken are on their way, and no step begins")
        .with(Capability::Parameters),
];

const MODE: &[Field] = &[
    Field::bit("FREE_RUN", 0, "a run has no last step: it goes on until `ABORT`"),
    Field::bit("PACE", 1, "steps begin `PACE_PERIOD` clocks apart"),
    Field::bit("CONTINUE", 2, "a run goes on after an overrun, which is counted; without it the run ends"),
    Field::bit("HALT", 3, "the network is enabled only for clocks of `SINGLE_CLOCKS`"),
    Field::bit("HOLD", 4, "the output window keeps what it shows"),
    Field::bit("ACCESS", 5, "asks for the states: the network stops in front of the next step")
        .with(Capability::States),
    Field::bit("STREAM", 6, "each step takes a frame of the stream as its inputs").with(Capability::Stream),
];

/// All registers, by address.
pub const REGISTERS: &[Register] = &[
    Register::new("ID", 0x000, Use::Read, "5045 5348 (hex): `PESH`"),
    Register::new("VERSION", 0x004, Use::Read, "versions of what a host must know").of(&[
        Field::bits("REGISTERS", 0, 16, "this register map: 1"),
        Field::bits("MAP", 16, 16, "`map_version` of the map"),
    ]),
    Register::new("HASH_0", 0x008, Use::Read, "first 8 digits of the hash in the map"),
    Register::new("HASH_1", 0x00C, Use::Read, "the next 8"),
    Register::new("HASH_2", 0x010, Use::Read, "the next 8"),
    Register::new("HASH_3", 0x014, Use::Read, "the next 8"),
    Register::new("CAPS", 0x018, Use::Read, "what this wrapper has").of(CAPS),
    Register::new("STEP_CLOCKS", 0x01C, Use::ReadForeign, "clocks of a step: from one to the next in free run; of a foreign entity, clocks for which a step enables it, with 0 until it is ready; what is written acts in steps that begin later"),
    Register::new("COMMAND", 0x020, Use::Command, "does what bits that are 1 say; all at once").of(COMMAND),
    Register::new("STATUS", 0x024, Use::ReadClear, "what has happened").of(STATUS),
    Register::new("MODE", 0x028, Use::ReadWrite, "how runs go").of(MODE),
    Register::new("RUN_STEPS", 0x02C, Use::ReadWrite, "steps of a run; with 0 it ends at once. 1 at first"),
    Register::new("CLOCK_BUDGET", 0x030, Use::ReadWrite, "most enabled clocks from the beginning of a step to its outputs; 0 is no limit"),
    Register::new("PACE_PERIOD", 0x034, Use::ReadWrite, "clocks from the beginning of a step to that of the next one, with `MODE.PACE`"),
    Register::new("STEP_COUNT_LOW", 0x038, Use::Read, "steps since configuration or restart; reading this half keeps the other"),
    Register::new("STEP_COUNT_HIGH", 0x03C, Use::Read, "upper half"),
    Register::new("CLOCK_COUNT_LOW", 0x040, Use::Read, "enabled clocks with a step under way; reading this half keeps the other"),
    Register::new("CLOCK_COUNT_HIGH", 0x044, Use::Read, "upper half"),
    Register::new("CLOCKS_LAST", 0x048, Use::Read, "enabled clocks from the beginning of the last step to its outputs"),
    Register::new("CLOCKS_MAX", 0x04C, Use::Read, "the same of the longest step"),
    Register::new("CLOCKS_MIN", 0x050, Use::Read, "the same of the shortest step; all bits 1 before any"),
    Register::new("SLACK_MIN", 0x054, Use::Read, "least `PACE_PERIOD` less clocks from the beginning of a paced step to its outputs; signed; 7FFF FFFF (hex) before any"),
    Register::new("OVERRUNS", 0x058, Use::Read, "paced steps that were not ready in time"),
    Register::new("SATURATED_STEPS", 0x05C, Use::Read, "steps in which a flag rose").with(Capability::Flags),
    Register::new("SINGLE_CLOCKS", 0x060, Use::ReadWrite, "with `MODE.HALT`, enables the network for so many clocks; reads those that are left"),
    Register::new("INPUT_WORDS", 0x064, Use::Read, "words of 32 bits in the input window"),
    Register::new("OUTPUT_WORDS", 0x068, Use::Read, "the same of the output window"),
    Register::new("PARAMETER_WORDS", 0x06C, Use::Read, "the same of the parameter window"),
    Register::new("STATE_ADDRESS", 0x070, Use::ReadWrite, "address of a state, from `host.access.order` of the map").with(Capability::States),
    Register::new("STATE_LOW", 0x074, Use::ReadWrite, "reads the low half of the word at `STATE_ADDRESS`; writing gives the next word that replaces a state, its upper half from `STATE_HIGH`; an error unless `STATUS.STATE_READY`").with(Capability::States),
    Register::new("STATE_HIGH", 0x078, Use::ReadWrite, "upper half, sign-extended; to be written before `STATE_LOW`").with(Capability::States),
    Register::new("OUTPUT_STEP_LOW", 0x07C, Use::Read, "sample in the output window: `STEP_COUNT` after the step whose outputs these are; reading this half keeps the other"),
    Register::new("OUTPUT_STEP_HIGH", 0x080, Use::Read, "upper half"),
];

/// A register by its name.
pub fn register(name: &str) -> Option<&'static Register> {
    REGISTERS.iter().find(|register| register.name == name)
}

/// Words of 32 bits that a number of so many bits takes.
pub fn words(bits: u32) -> u32 {
    bits.div_ceil(32).max(1)
}

/// Where a value is: `words` words from `address` on, low half first, two's complement, sign-extended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Address of the first word.
    pub address: u32,
    /// Words.
    pub words: u32,
}

/// Addresses of a wrapper for certain values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Windows {
    /// Each window has [`WINDOW`] bytes times 2 to this power.
    pub growth: u32,
    /// Bits of a byte address.
    pub address_bits: u32,
    /// Parameters that are written at run time.
    pub parameters: Vec<Span>,
    /// Inputs.
    pub inputs: Vec<Span>,
    /// Outputs.
    pub outputs: Vec<Span>,
}

impl Windows {
    /// Of values of these formats. Values follow each other without gaps, in the order of the map.
    ///
    /// # Panics
    /// If a window had more than 2^25 bytes.
    pub fn of(parameters: &[Format], inputs: &[Format], outputs: &[Format]) -> Windows {
        let bytes = |formats: &[Format]| 4 * formats.iter().map(|format| words(format.bits)).sum::<u32>();
        let most = bytes(parameters).max(bytes(inputs)).max(bytes(outputs));
        let growth = most.div_ceil(WINDOW).next_power_of_two().trailing_zeros();
        assert!(growth < 16, "a window of more than 2^25 bytes");
        let placed = |window: u32, formats: &[Format]| {
            let mut address = window * (WINDOW << growth);
            let place = |format: &Format| {
                let span = Span { address, words: words(format.bits) };
                address += 4 * span.words;
                span
            };
            formats.iter().map(place).collect()
        };
        Windows {
            growth,
            address_bits: 12 + growth,
            parameters: placed(1, parameters),
            inputs: placed(2, inputs),
            outputs: placed(3, outputs),
        }
    }

    /// Words of all these values.
    pub fn total(spans: &[Span]) -> u32 {
        spans.iter().map(|span| span.words).sum()
    }
}

/// The tables of `docs/wrapper.md`.
pub fn tables() -> String {
    let mut text = String::from("| address | name | use | with | content |\n|---|---|---|---|---|\n");
    let needs = |needs: Option<Capability>| needs.map_or(String::new(), |needs| format!("`{}`", cap_name(needs)));
    for register in REGISTERS {
        let Register { name, address, usage, meaning, .. } = register;
        text += &format!("| {address:03X} | `{name}` | {} | {} | {meaning} |\n", usage.text(), needs(register.needs));
    }
    for register in REGISTERS.iter().filter(|register| !register.fields.is_empty()) {
        text += &format!("\n`{}`:\n\n| bits | name | with | meaning |\n|---|---|---|---|\n", register.name);
        for field in register.fields {
            let Field { name, low, bits, meaning, clears, .. } = *field;
            let place = if bits == 1 { low.to_string() } else { format!("{}:{low}", low + bits - 1) };
            let clear = if clears { "; writing 1 clears it" } else { "" };
            text += &format!("| {place} | `{name}` | {} | {meaning}{clear} |\n", needs(field.needs));
        }
    }
    text
}

/// The field of `CAPS`.
fn cap_name(capability: Capability) -> &'static str {
    match capability {
        Capability::Restart => "RESTART",
        Capability::States => "STATES",
        Capability::Flags => "FLAGS",
        Capability::Stream => "STREAM",
        Capability::Parameters => "PARAMETERS",
        Capability::Foreign => "FOREIGN",
        Capability::Ready => "READY",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_lie_apart_in_their_window_and_fields_in_their_registers() {
        for (number, register) in REGISTERS.iter().enumerate() {
            assert!(register.address == 4 * number as u32 && register.address < WINDOW, "{}", register.name);
            assert_eq!(self::register(register.name), Some(register), "two are called {}", register.name);
            let mut taken = 0;
            for field in register.fields {
                assert_eq!(taken & field.mask(), 0, "{}.{}", register.name, field.name);
                assert!(register.usage == Use::ReadClear || !field.clears, "{}.{}", register.name, field.name);
                taken |= field.mask();
            }
        }
        let caps = register("CAPS").unwrap();
        let needed = REGISTERS.iter().flat_map(|r| r.fields.iter().map(|f| f.needs).chain([r.needs])).flatten();
        assert!(needed.map(cap_name).all(|name| caps.field(name).is_some()));
    }

    #[test]
    fn values_follow_each_other_and_windows_grow() {
        let formats = |count: usize, bits| vec![Format { bits, exponent: 0 }; count];
        let small = Windows::of(&[], &formats(3, 32), &[formats(1, 40), formats(2, 18)].concat());
        assert_eq!((small.growth, small.address_bits), (0, 12));
        let addresses = |spans: &[Span]| spans.iter().map(|span| span.address).collect::<Vec<_>>();
        assert_eq!(addresses(&small.inputs), [0x800, 0x804, 0x808]);
        assert_eq!(addresses(&small.outputs), [0xC00, 0xC08, 0xC0C]);
        assert_eq!(Windows::of(&[], &formats(256, 32), &[]).growth, 0);
        let large = Windows::of(&[], &formats(257, 32), &formats(1000, 33));
        assert_eq!((large.growth, large.address_bits), (3, 15));
        assert_eq!((large.inputs[0].address, large.outputs[0].address), (0x4000, 0x6000));
        assert_eq!(Windows::of(&[], &[], &[]).address_bits, 12);
    }
}
