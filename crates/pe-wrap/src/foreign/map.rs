//! The map of an entity, `NAME_entity.json`: what a user says of its ports. The first call of `wrap --vhdl` writes it, with
//! roles guessed by names; a later call reads it.

use std::collections::BTreeMap;

use pe_ir::codes;
use pe_ir::source::Diagnostic;
use pe_map::{Fault, HostRounding};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::entity::{Entity, Kind, Port, PortType};
use super::evaluate::Value;

/// What [`EntityMap::entity_version`] is in maps that these types describe.
pub const ENTITY_VERSION: u32 = 1;

/// `NAME_entity.json`.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct EntityMap {
    /// Version of this format; another one has keys that mean something else.
    pub entity_version: u32,
    /// `pe-synth` and its version.
    pub generator: String,
    /// Name of the VHDL entity, as its file has it.
    pub entity: String,
    /// Time that a step stands for, in seconds.
    pub step: f64,
    /// Clocks for which a step enables the entity; with `until_ready` the most that a host waits for.
    pub clocks: u32,
    /// A step ends when the port `ready` says so, and not after `clocks`.
    pub until_ready: bool,
    /// Clocks of a reset.
    pub reset_clocks: u32,
    /// Integer and Boolean generics, in the order of the file; all others have their defaults.
    pub generics: Vec<GenericEntry>,
    /// Ports, in the order of the file.
    pub ports: Vec<PortEntry>,
}

/// A generic.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct GenericEntry {
    /// Name as in the file.
    pub name: String,
    /// Type as in the file.
    pub declared: String,
    /// Value; null takes the default of the file.
    pub value: Option<Setting>,
}

/// Value of a generic.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Setting {
    /// True or false.
    Boolean(bool),
    /// An integer.
    Integer(i64),
}

/// A port.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
#[serde(deny_unknown_fields)]
pub struct PortEntry {
    /// Name as in the file.
    pub name: String,
    /// Mode and type as in the file.
    pub declared: String,
    /// What it is for.
    pub role: Role,
    /// Of resets, clock enables, `start` and `ready`: the level at which it acts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub active: Option<Level>,
    /// Of constants: an integer that fits the port, or a text of its bits.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<Tied>,
    /// Of data: bits, to be compared with those of the file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bits: Option<u32>,
    /// Of data: whether its words are two's complement; else none is below 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub signed: Option<bool>,
    /// Of data: the least significant bit is worth `2^exponent`; 0 unless said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exponent: Option<i32>,
    /// Of data: unit, for people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Of data in: range in which numbers are expected; hosts report others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Of data in: how a host rounds a number to a word.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounding: Option<HostRounding>,
    /// Of data in: the entity takes a new word in one of so many steps; 1 unless said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub every: Option<u32>,
}

/// What a port is for.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Clock; rising edges count.
    Clock,
    /// Clock enable.
    ClockEnable,
    /// Reset.
    Reset,
    /// Input that is active in the first clock of a step.
    Start,
    /// Output that is active when a step has ended; not looked at in its first clock.
    Ready,
    /// Input of the host, or output to it.
    Data,
    /// Input that always has the same value.
    Constant,
    /// Output that nobody reads.
    Open,
}

/// Level at which a port acts.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// 1.
    High,
    /// 0.
    Low,
}

/// Value of an input that is tied.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
#[serde(untagged)]
pub enum Tied {
    /// An integer.
    Integer(i64),
    /// Bits, the highest in front.
    Bits(String),
}

/// Clocks that a host expects of an entity that says when it is ready.
const CLOCKS_UNTIL_READY: u32 = 100;

impl EntityMap {
    /// The first map of an entity, with guesses, and what is left to tell.
    pub fn first(entity: &Entity, generator: &str) -> (EntityMap, Vec<Diagnostic>) {
        let mut taken: Vec<Role> = Vec::new();
        let values = entity.generics(&BTreeMap::new());
        let ports: Vec<PortEntry> =
            entity.ports.iter().map(|port| guessed(entity, port, &mut taken, &values)).collect();
        let until_ready = taken.contains(&Role::Ready);
        let settable = entity.generics.iter().filter(|generic| generic.kind != Kind::Other);
        let generics = settable.map(|generic| {
            let value = values.get(&Entity::key(&generic.name)).map(|value| match value {
                Value::Integer(number) => Setting::Integer(*number),
                Value::Boolean(truth) => Setting::Boolean(*truth),
            });
            GenericEntry { name: generic.name.clone(), declared: generic.declared.clone(), value }
        });
        let generics: Vec<GenericEntry> = generics.collect();
        let mut findings = Vec::new();
        for (role, what) in [(Role::Clock, "a clock"), (Role::ClockEnable, "a clock enable")] {
            if !taken.contains(&role) {
                let message = format!("no input of `{}` looks like {what}", entity.name);
                let word = serde_json::to_string(&role).unwrap_or_default();
                let finding = Diagnostic::error(codes::ROLE_UNKNOWN, entity.span, message).into_warning();
                findings.push(finding.with_help(format!("set the role of one port to {word} in the map")));
            }
        }
        for (entry, generic) in generics
            .iter()
            .filter(|entry| entry.value.is_none())
            .filter_map(|entry| Some((entry, entity.generics.iter().find(|generic| generic.name == entry.name)?)))
        {
            let message = format!("generic `{}` has no value that is known here", entry.name);
            let finding = Diagnostic::error(codes::GENERIC_UNSET, generic.span, message).into_warning();
            findings.push(finding.with_help("set it in the map"));
        }
        let map = EntityMap {
            entity_version: ENTITY_VERSION,
            generator: generator.to_owned(),
            entity: entity.name.clone(),
            step: 1.0,
            clocks: if until_ready { CLOCKS_UNTIL_READY } else { 1 },
            until_ready,
            reset_clocks: 1,
            generics,
            ports,
        };
        (map, findings)
    }

    /// Reads a map.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn read(text: &str) -> Result<EntityMap, (Fault, Option<(usize, usize)>)> {
        let damaged = |error: serde_json::Error| {
            let message = error.to_string();
            let what = message.split(" at line ").next().unwrap_or_default().to_owned();
            (Fault::Damaged(what), Some((error.line(), error.column())).filter(|(line, _)| *line > 0))
        };
        #[derive(Deserialize)]
        struct Versioned {
            entity_version: u64,
        }
        let Versioned { entity_version } = serde_json::from_str(text).map_err(damaged)?;
        if entity_version != u64::from(ENTITY_VERSION) {
            return Err((Fault::Version(entity_version), None));
        }
        serde_json::from_str(text).map_err(damaged)
    }

    /// The text of the file.
    pub fn text(&self) -> String {
        let text = serde_json::to_string_pretty(self).expect("a map has names and numbers");
        text + "\n"
    }
}

/// Roles by the names that are usual for them, without marks such as `_i` and `_n`.
const USUAL: [(Role, bool, &[&str]); 5] = [
    (Role::Clock, true, &["clk", "clock", "aclk", "sysclk", "mclk", "clkin", "sclk", "ck"]),
    (
        Role::Reset,
        true,
        &["rst", "reset", "arst", "areset", "srst", "sreset", "nrst", "nreset", "rstn", "resetn", "aresetn", "arstn"],
    ),
    (Role::ClockEnable, true, &["ce", "en", "ena", "enable", "clken", "clkena", "clockenable", "clkenable", "cke"]),
    (Role::Start, true, &["start", "go", "begin", "validin", "invalid", "launch"]),
    (Role::Ready, false, &["ready", "rdy", "done", "finished", "validout", "outvalid", "valid", "busy"]),
];

/// The role of a port by its name, and whether it acts at level 0.
fn role_of(port: &Port) -> Option<(Role, bool)> {
    if port.of != PortType::Bit {
        return None;
    }
    let name = port.name.trim_matches('\\').to_lowercase();
    let parts: Vec<&str> = name.split('_').filter(|part| !part.is_empty()).collect();
    let marks = ["i", "o", "in", "out", "n", "b", "s", "p"];
    // A mark that is all there is, or `in` beside `valid`, belongs to the name.
    let low = parts.len() > 1 && (parts.contains(&"n") || parts.last() == Some(&"b"));
    let bare: String = parts.iter().filter(|part| !marks.contains(part)).copied().collect();
    let whole: String = parts.concat();
    let (role, _, word) =
        USUAL.iter().filter(|(_, input, _)| *input == port.input).find_map(|(role, input, words)| {
            words.iter().find(|word| **word == bare || **word == whole).map(|word| (*role, *input, *word))
        })?;
    let named_low =
        (word.ends_with('n') && role == Role::Reset) || word == "nrst" || word == "nreset" || word == "busy";
    Some((role, low || named_low))
}

fn guessed(entity: &Entity, port: &Port, taken: &mut Vec<Role>, values: &BTreeMap<String, Value>) -> PortEntry {
    let role = role_of(port).filter(|(role, _)| !taken.contains(role));
    if let Some((role, _)) = role {
        taken.push(role);
    }
    let is_data = role.is_none();
    let wide = entity.bits(port, values).is_ok_and(|bits| bits > 63);
    PortEntry {
        name: port.name.clone(),
        declared: port.declared.clone(),
        role: role.map_or(Role::Data, |(role, _)| role),
        active: role
            .filter(|(role, _)| *role != Role::Clock)
            .map(|(_, low)| if low { Level::Low } else { Level::High }),
        value: None,
        bits: None,
        signed: is_data.then_some(port.of == PortType::Signed || (wide && port.of == PortType::Vector)),
        exponent: is_data.then_some(0),
        unit: None,
        range: None,
        rounding: (is_data && port.input).then_some(HostRounding::Nearest),
        every: (is_data && port.input).then_some(1),
    }
}
