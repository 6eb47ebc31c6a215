//! What becomes of an entity with the map that a user edited: everything is checked, all findings in one run.

use std::collections::BTreeMap;

use pe_ir::codes;
use pe_ir::source::{Diagnostic, Sources, Span};
use pe_map::{
    Between, Control, Foreign, Format, HostPorts, HostRounding, Input, Map, Meaning, Output, Outside, Rounding, VERSION,
};

use super::entity::{Entity, Kind, Port, PortType, is_same};
use super::evaluate::Value;
use super::map::{EntityMap, Level, PortEntry, Role, Setting, Tied};

/// A port of an entity, with what becomes of it.
pub struct Planned {
    /// Name as in the file.
    pub name: String,
    /// Type.
    pub of: PortType,
    /// Bits.
    pub bits: u32,
    /// What it is connected to.
    pub part: Part,
}

/// What a port is connected to.
pub enum Part {
    /// The clock.
    Clock,
    /// A signal of the handshake, and whether it acts at level 0.
    Control(Role, bool),
    /// A word of the host.
    Data(Data),
    /// These bits, the highest in front.
    Constant(String),
    /// Nothing.
    Open,
}

/// Data of a host.
pub struct Data {
    /// Whether it is an input.
    pub input: bool,
    /// What the map of the wrapper calls it, an identifier.
    pub identifier: String,
    /// Whether words are two's complement.
    pub signed: bool,
    /// Steps from one word to the next.
    pub every: u32,
}

/// An entity that can be wrapped.
pub struct Plan {
    /// What file names and the wrapper's entities begin with.
    pub name: String,
    /// Package of `signed` and `unsigned`.
    pub arithmetic: &'static str,
    /// Clocks of a reset; 0 without one.
    pub reset_clocks: u32,
    /// Generics that are set, with their values in VHDL.
    pub generics: Vec<(String, String)>,
    /// All ports.
    pub ports: Vec<Planned>,
    /// What hosts read of it.
    pub map: Map,
}

/// Most bits of a word of a host.
const WIDEST: u32 = 64;

/// Name of the shell of an entity: `NAME_step`.
pub fn shell_name(name: &str) -> String {
    format!("{name}_step")
}

/// What file names of an entity begin with: its name, as an identifier.
pub fn base_name(entity: &str) -> String {
    pe_emit::vhdl_identifier(entity)
}

/// That no file has a unit that the wrapper brings.
pub fn check_names(entity: &Entity, findings: &mut Vec<Diagnostic>) {
    let base = base_name(&entity.name);
    let taken = [shell_name(&base), format!("{base}_axi"), format!("{base}_bus")];
    for (unit, span) in &entity.units {
        if taken.iter().any(|name| is_same(name, unit)) {
            let message = format!("the wrapper has a design unit `{unit}`, too");
            let finding = Diagnostic::error(codes::NAME_TAKEN, *span, message);
            findings.push(finding.with_help("rename it, or leave its file out"));
        }
    }
}

/// Faults that no map can mend: an entity without enough inputs of one bit, and ranges that are not constant.
pub fn check_entity(entity: &Entity, findings: &mut Vec<Diagnostic>) {
    let bits = entity.ports.iter().filter(|port| port.input && port.of == PortType::Bit).count();
    let help = "an entity needs a clock and a clock enable, each an input of type `std_logic`";
    let clean = findings.is_empty();
    let lacks = [(codes::NO_CLOCK, "a clock", 1), (codes::NO_CLOCK_ENABLE, "a clock enable", 2)];
    for (code, what, needed) in lacks {
        if bits < needed && clean {
            let message = format!("entity `{}` has no input that could be {what}", entity.name);
            findings.push(Diagnostic::error(code, entity.span, message).with_help(help));
        }
    }
}

/// Plans a wrapper. `map_span` is where the text of the map is among the sources.
pub fn plan(
    entity: &Entity,
    map: &EntityMap,
    hash: String,
    sources: &Sources,
    map_span: Span,
    findings: &mut Vec<Diagnostic>,
) -> Plan {
    let mut planner = Planner { entity, map, sources, map_span, findings };
    planner.general();
    let values = planner.generics();
    let entries = planner.entries();
    planner.roles(&entries);
    let ports = planner.ports(&entries, &values);
    planner.finish(ports, &entries, &values, hash)
}

struct Planner<'a> {
    entity: &'a Entity,
    map: &'a EntityMap,
    sources: &'a Sources,
    map_span: Span,
    findings: &'a mut Vec<Diagnostic>,
}

type Entries<'a> = Vec<Option<(&'a PortEntry, Span)>>;

impl<'a> Planner<'a> {
    fn refuse(&mut self, code: &'static str, span: Span, message: String, help: &str) {
        self.findings.push(Diagnostic::error(code, span, message).with_help(help));
    }

    /// Place of an entry of the map: the text of its name, of which this is the one with this number.
    fn named(&self, name: &str, number: usize) -> Span {
        let text = &self.sources.text()[self.map_span.range()];
        let quoted = serde_json::to_string(name).unwrap_or_default();
        let places = text.match_indices(&quoted).filter(|(at, _)| {
            let before = text[..*at].trim_end();
            before.ends_with(':') && before[..before.len() - 1].trim_end().ends_with("\"name\"")
        });
        let start = self.map_span.range().start;
        let found = places.map(|(at, _)| Span::of(start + at, start + at + quoted.len())).nth(number);
        found.unwrap_or_else(|| self.key("ports"))
    }

    /// Place of a key of the map.
    fn key(&self, key: &str) -> Span {
        let text = &self.sources.text()[self.map_span.range()];
        let (start, quoted) = (self.map_span.range().start, format!("\"{key}\""));
        let at = text.find(&quoted);
        at.map_or(Span { end: self.map_span.start, ..self.map_span }, |at| {
            Span::of(start + at, start + at + quoted.len())
        })
    }

    fn general(&mut self) {
        let EntityMap { entity, step, clocks, reset_clocks, .. } = self.map;
        if !is_same(entity, &self.entity.name) {
            let message = format!("the map is of entity `{entity}`, not of `{}`", self.entity.name);
            self.refuse(codes::MAP_DIFFERS, self.key("entity"), message, "write a new one: leave --map out");
        }
        if !(step.is_finite() && *step > 0.0) {
            let message = format!("a step cannot stand for {step} s");
            self.refuse(codes::BAD_ENTRY, self.key("step"), message, "give a time above 0 in seconds");
        }
        for (key, clocks, most) in [("clocks", *clocks, u32::MAX - 2), ("reset_clocks", *reset_clocks, 1 << 16)] {
            if clocks == 0 || clocks > most {
                let message = format!("`{key}` cannot be {clocks}");
                self.refuse(codes::BAD_ENTRY, self.key(key), message, &format!("give a number from 1 to {most}"));
            }
        }
    }

    /// Values of all generics that have one.
    fn generics(&mut self) -> BTreeMap<String, Value> {
        let mut set = BTreeMap::new();
        for (index, entry) in self.map.generics.iter().enumerate() {
            let number = self.map.generics[..index].iter().filter(|other| other.name == entry.name).count();
            let span = self.named(&entry.name, number);
            let Some(generic) = self.entity.generics.iter().find(|generic| is_same(&generic.name, &entry.name)) else {
                let message = format!("there is no generic `{}`", entry.name);
                self.refuse(codes::MAP_DIFFERS, span, message, "write a new map: leave --map out");
                continue;
            };
            let value = match (entry.value, generic.kind) {
                (None, _) => continue,
                (Some(Setting::Integer(number)), Kind::Integer(least)) => {
                    if !(least..=i64::from(i32::MAX)).contains(&number) {
                        let message =
                            format!("generic `{}` of type `{}` cannot be {number}", entry.name, generic.declared);
                        self.refuse(codes::BAD_ENTRY, span, message, &format!("give an integer from {least} on"));
                    }
                    Value::Integer(number)
                }
                (Some(Setting::Boolean(truth)), Kind::Boolean) => Value::Boolean(truth),
                _ => {
                    let message = format!("generic `{}` of type `{}` cannot be set so", entry.name, generic.declared);
                    let help = "integers take a number, Booleans `true` or `false`, all others keep their default";
                    self.refuse(codes::BAD_ENTRY, span, message, help);
                    continue;
                }
            };
            if set.insert(Entity::key(&generic.name), value).is_some() {
                let message = format!("generic `{}` is set twice", entry.name);
                self.refuse(codes::MAP_DIFFERS, span, message, "leave one of the two");
            }
        }
        for generic in &self.entity.generics {
            if generic.default.is_none()
                && generic.kind != Kind::Other
                && !set.contains_key(&Entity::key(&generic.name))
            {
                let message = format!("generic `{}` has no value", generic.name);
                self.refuse(codes::BAD_GENERIC, generic.span, message, "set it in the map");
            }
        }
        self.entity.generics(&set)
    }

    /// The entry of each port, with its place.
    fn entries(&mut self) -> Entries<'a> {
        let map = self.map;
        let mut entries: Entries = vec![None; self.entity.ports.len()];
        for (index, entry) in map.ports.iter().enumerate() {
            let number = map.ports[..index].iter().filter(|other| other.name == entry.name).count();
            let span = self.named(&entry.name, number);
            let Some(at) = self.entity.ports.iter().position(|port| is_same(&port.name, &entry.name)) else {
                let message = format!("entity `{}` has no port `{}`", self.entity.name, entry.name);
                self.refuse(codes::MAP_DIFFERS, span, message, "remove it, or write a new map: leave --map out");
                continue;
            };
            if entries[at].is_some() {
                let message = format!("port `{}` is there twice", entry.name);
                self.refuse(codes::MAP_DIFFERS, span, message, "leave one of the two");
                continue;
            }
            let bare = |text: &str| text.split_whitespace().collect::<String>().to_lowercase();
            let port = &self.entity.ports[at];
            if bare(&entry.declared) != bare(&port.declared) {
                let message = format!(
                    "port `{}` is `{}` in the map, `{}` in the file",
                    entry.name, entry.declared, port.declared
                );
                let help = "check what the map says of it, and write its new declaration into the map";
                self.findings.push(
                    Diagnostic::error(codes::MAP_DIFFERS, span, message).with_label(port.span, "here").with_help(help),
                );
            }
            entries[at] = Some((entry, span));
        }
        for (port, entry) in self.entity.ports.iter().zip(&entries) {
            if entry.is_none() {
                let message = format!("the map has no port `{}`", port.name);
                self.refuse(codes::MAP_DIFFERS, port.span, message, "write a new map: leave --map out");
            }
        }
        entries
    }

    /// That there is a clock and a clock enable, and nothing twice.
    fn roles(&mut self, entries: &Entries) {
        for (role, code, needed) in [
            (Role::Clock, codes::NO_CLOCK, Some("clock")),
            (Role::ClockEnable, codes::NO_CLOCK_ENABLE, Some("clock enable")),
            (Role::Reset, codes::BAD_ROLE, None),
            (Role::Start, codes::BAD_ROLE, None),
            (Role::Ready, codes::BAD_ROLE, None),
        ] {
            let own: Vec<Span> =
                entries.iter().flatten().filter(|(e, _)| e.role == role).map(|(_, span)| *span).collect();
            if let ([], Some(what)) = (&own[..], needed) {
                let message = format!("entity `{}` has no {what}: no port of the map has this role", self.entity.name);
                let help = "set the role of one input; a wrapper runs an entity by its clock enable";
                self.refuse(code, self.entity.span, message, help);
            }
            if let [first, second, ..] = own[..] {
                let finding = Diagnostic::error(codes::BAD_ROLE, second, "another port has this role");
                self.findings.push(finding.with_label(first, "this one").with_help("make it data, constant or open"));
            }
        }
        let has = |role| entries.iter().flatten().any(|(entry, _)| entry.role == role);
        if self.map.until_ready && !has(Role::Ready) {
            let message = "no port says when a step has ended".to_owned();
            let help = "set the role of an output to \"ready\", or `until_ready` to false";
            self.refuse(codes::BAD_ROLE, self.key("until_ready"), message, help);
        }
        let complete = entries.iter().all(Option::is_some);
        if complete
            && !self
                .entity
                .ports
                .iter()
                .zip(entries)
                .any(|(port, entry)| !port.input && entry.is_some_and(|(entry, _)| entry.role == Role::Data))
        {
            let message = format!("no output of `{}` is data: there is nothing to read", self.entity.name);
            self.refuse(codes::NOTHING_TO_READ, self.entity.span, message, "set the role of an output to \"data\"");
        }
        if !has(Role::Reset) {
            let message = format!("entity `{}` has no reset, so a host cannot restart it", self.entity.name);
            let finding = Diagnostic::error(codes::NO_RESET, self.entity.span, message).into_warning();
            self.findings.push(finding.with_help("in a simulation, hosts start another one in its place"));
        }
    }

    fn ports(&mut self, entries: &Entries, values: &BTreeMap<String, Value>) -> Vec<Planned> {
        let mut planned: Vec<Planned> = Vec::new();
        let mut taken: Vec<String> = Vec::new();
        let known = values.len() == self.entity.generics.iter().filter(|generic| generic.kind != Kind::Other).count();
        for (port, entry) in self.entity.ports.iter().zip(entries) {
            let Some((entry, span)) = entry else { continue };
            let bits = match self.entity.bits(port, values) {
                Ok(bits) => bits,
                // What depends on a generic without a value was told.
                Err(_) if !known => continue,
                Err((place, what)) => {
                    let message = format!("the width of port `{}` is not known: {what}", port.name);
                    let help = "widths may be made of integers, generics and constants of packages in the files given";
                    self.refuse(codes::BAD_WIDTH, place, message, help);
                    continue;
                }
            };
            let part = self.part(port, entry, *span, bits, &mut taken);
            planned.push(Planned { name: port.name.clone(), of: port.of, bits, part });
        }
        planned
    }

    fn part(&mut self, port: &Port, entry: &PortEntry, span: Span, bits: u32, taken: &mut Vec<String>) -> Part {
        let PortEntry { role, .. } = entry;
        let (wants_input, scalar) = match role {
            Role::Clock | Role::ClockEnable | Role::Reset | Role::Start => (Some(true), true),
            Role::Ready => (Some(false), true),
            Role::Constant => (Some(true), false),
            Role::Open => (Some(false), false),
            Role::Data => (None, false),
        };
        if wants_input.is_some_and(|input| input != port.input) || (scalar && port.of != PortType::Bit) {
            let word = serde_json::to_string(role).unwrap_or_default();
            let message = format!("port `{}`, `{}`, cannot have the role {word}", port.name, port.declared);
            let help = match role {
                Role::Open => "inputs need a value: make it data or a constant",
                Role::Constant => "outputs can be data or open",
                Role::Ready => "`ready` is an output of type `std_logic`",
                _ => "it takes an input of type `std_logic`",
            };
            self.findings
                .push(Diagnostic::error(codes::BAD_ROLE, span, message).with_label(port.span, "here").with_help(help));
        }
        self.superfluous(port, entry, span);
        match role {
            Role::Clock => Part::Clock,
            Role::ClockEnable | Role::Reset | Role::Start | Role::Ready => {
                Part::Control(*role, entry.active == Some(Level::Low))
            }
            Role::Open => Part::Open,
            Role::Constant => Part::Constant(self.constant(port, entry, span, bits)),
            Role::Data => Part::Data(self.data(port, entry, span, bits, taken)),
        }
    }

    /// Keys that mean nothing for the role would be believed to act.
    fn superfluous(&mut self, port: &Port, entry: &PortEntry, span: Span) {
        let control = matches!(entry.role, Role::ClockEnable | Role::Reset | Role::Start | Role::Ready);
        let (data, input) = (entry.role == Role::Data, port.input);
        let said = [
            ("active", entry.active.is_some(), control),
            ("value", entry.value.is_some(), entry.role == Role::Constant),
            ("bits", entry.bits.is_some(), data),
            ("signed", entry.signed.is_some(), data || entry.role == Role::Constant),
            ("exponent", entry.exponent.is_some_and(|exponent| exponent != 0), data),
            ("unit", entry.unit.is_some(), data),
            ("range", entry.range.is_some(), data && input),
            ("rounding", entry.rounding.is_some_and(|rounding| rounding != HostRounding::Nearest), data && input),
            ("every", entry.every.is_some_and(|every| every != 1), data && input),
        ];
        for (key, is_said, has_effect) in said {
            // What the first map said of data may stay when a port gets another role.
            if is_said && !has_effect && key != "signed" {
                let message = format!("`{key}` means nothing for port `{}` in this role", port.name);
                self.refuse(codes::BAD_ENTRY, span, message, "remove it");
            }
        }
    }

    fn constant(&mut self, port: &Port, entry: &PortEntry, span: Span, bits: u32) -> String {
        let width = usize::try_from(bits).unwrap_or(usize::MAX);
        let fits = match &entry.value {
            Some(Tied::Bits(text)) => {
                (text.len() == width && text.bytes().all(|byte| matches!(byte, b'0' | b'1'))).then(|| text.clone())
            }
            Some(Tied::Integer(number)) => {
                let number = i128::from(*number);
                let room = bits.min(100);
                let within = number < 1 << room && number >= -(1 << (room - 1));
                let bit = |at: usize| if number >> at.min(127) & 1 == 1 { '1' } else { '0' };
                within.then(|| (0..width).rev().map(bit).collect())
            }
            None => None,
        };
        fits.unwrap_or_else(|| {
            let message = format!("constant port `{}` needs a value of {bits} bits", port.name);
            let help = "`\"value\": 5`, or `\"value\": \"0101\"` with all bits, the highest in front";
            self.refuse(codes::BAD_ENTRY, span, message, help);
            String::new()
        })
    }

    fn data(&mut self, port: &Port, entry: &PortEntry, span: Span, bits: u32, taken: &mut Vec<String>) -> Data {
        let signed = entry.signed.unwrap_or(port.of == PortType::Signed);
        if bits + u32::from(!signed) > WIDEST {
            let message = format!(
                "port `{}` has {bits} bits; words of hosts have at most {WIDEST}, their sign among them",
                port.name
            );
            let help = "make it a constant or leave it open, or make two ports of it; 64 bits must be signed";
            self.findings
                .push(Diagnostic::error(codes::BAD_WIDTH, span, message).with_label(port.span, "here").with_help(help));
        }
        if entry.bits.is_some_and(|said| said != bits) {
            let message = format!("port `{}` has {bits} bits, not {}", port.name, entry.bits.unwrap_or(0));
            self.refuse(codes::BAD_ENTRY, span, message, "write the bits that it has, or leave `bits` out");
        }
        let exponent = entry.exponent.unwrap_or(0);
        if !(-1000..=900).contains(&exponent) {
            let message = format!("an exponent of {exponent} is beyond double precision");
            self.refuse(codes::BAD_ENTRY, span, message, "give one from -1000 to 900");
        }
        if entry.every.is_some_and(|every| every == 0 || every > 1 << 30) {
            let message =
                format!("port `{}` cannot take a word in one of {} steps", port.name, entry.every.unwrap_or(0));
            self.refuse(codes::BAD_ENTRY, span, message, "give a number from 1 to 2^30");
        }
        if entry.range.is_some_and(|[least, most]| !(least.is_finite() && most.is_finite() && least <= most)) {
            let message = format!("the range of port `{}` has no numbers in it", port.name);
            self.refuse(codes::BAD_ENTRY, span, message, "give two numbers, the least first");
        }
        if matches!((port.of, signed), (PortType::Signed, false) | (PortType::Unsigned, true)) {
            let message = format!("port `{}` is `{}`, but the map says otherwise", port.name, port.declared);
            let finding = Diagnostic::error(codes::SIGN_DIFFERS, span, message).into_warning();
            self.findings.push(finding.with_label(port.span, "here").with_help("set `signed` as its type is"));
        }
        Data {
            input: port.input,
            identifier: identifier(&port.name, taken),
            signed,
            every: entry.every.unwrap_or(1).max(1),
        }
    }

    fn finish(self, ports: Vec<Planned>, entries: &Entries, values: &BTreeMap<String, Value>, hash: String) -> Plan {
        let name = base_name(&self.entity.name);
        let has = |role| ports.iter().any(|port| matches!(port.part, Part::Control(own, _) if own == role));
        let entry =
            |port: &Planned| entries.iter().flatten().map(|(entry, _)| *entry).find(|e| is_same(&e.name, &port.name));
        let clocks = self.map.clocks;
        let mut map = Map {
            map_version: VERSION,
            generator: self.map.generator.clone(),
            hash,
            model: self.entity.name.clone(),
            entity: name.clone(),
            control: control(),
            step: self.map.step,
            early_steps: Vec::new(),
            clocks_per_step: clocks.saturating_add(if self.map.until_ready { 2 } else { 1 }),
            inputs: Vec::new(),
            ticks: Vec::new(),
            outputs: Vec::new(),
            output_memory: None,
            states: Vec::new(),
            parameters: Vec::new(),
            host: has(Role::Reset).then(|| HostPorts { restart: Some("restart_i".to_owned()), ..HostPorts::default() }),
            foreign: Some(Foreign {
                entity: self.entity.name.clone(),
                architecture: self.entity.architecture.clone(),
                step_clocks: if self.map.until_ready { 0 } else { clocks },
                ready: has(Role::Ready),
            }),
        };
        for port in &ports {
            if let (Part::Data(data), Some(entry)) = (&port.part, entry(port)) {
                describe(&mut map, port, data, entry);
            }
        }
        let generics = self.entity.generics.iter().filter_map(|generic| {
            let set = self.map.generics.iter().any(|e| is_same(&e.name, &generic.name) && e.value.is_some());
            let value = values.get(&Entity::key(&generic.name)).filter(|_| set)?;
            let text = match value {
                Value::Integer(number) => number.to_string(),
                Value::Boolean(truth) => truth.to_string(),
            };
            Some((generic.name.clone(), text))
        });
        Plan {
            name,
            arithmetic: self.entity.arithmetic,
            reset_clocks: if has(Role::Reset) { self.map.reset_clocks } else { 0 },
            generics: generics.collect(),
            ports,
            map,
        }
    }
}

/// Ports of a shell beside those of data.
fn control() -> Control {
    let name = str::to_owned;
    Control {
        clock: name("clk_i"),
        clock_enable: name("ce_i"),
        step: name("step_i"),
        busy: name("busy_o"),
        done: name("done_o"),
        overflow: name("overflow_o"),
    }
}

/// Identifiers that ports of a shell have.
const OWN: [&str; 8] = ["clk", "ce", "step", "busy", "done", "overflow", "restart", "step_clocks"];

/// An identifier for a name that no other port has.
fn identifier(name: &str, taken: &mut Vec<String>) -> String {
    let bare = pe_emit::vhdl_identifier(name);
    let numbered = (2..).map(|number| format!("{bare}_{number}"));
    let free = |name: &String| !OWN.contains(&name.as_str()) && !taken.contains(name);
    let identifier = std::iter::once(bare.clone()).chain(numbered).find(free).unwrap_or_default();
    taken.push(identifier.clone());
    identifier
}

/// Tells hosts of a port.
fn describe(map: &mut Map, port: &Planned, data: &Data, entry: &PortEntry) {
    // Words are two's complement, so a number without sign takes a bit more.
    let bits = (port.bits + u32::from(!data.signed)).min(WIDEST);
    let format = Format { bits, exponent: entry.exponent.unwrap_or(0) };
    let [least, most] = format.words();
    let words = [if data.signed { least } else { 0 }, most];
    let (name, unit) = (port.name.clone(), entry.unit.clone());
    if data.input {
        map.inputs.push(Input {
            name,
            port: format!("{}_i", data.identifier),
            meaning: Meaning::Quantity,
            unit,
            format,
            words,
            limits: words.map(|word| format.number(word)),
            range: entry.range,
            between: Between::Hold,
            operand: format,
            rounding: Rounding::NearestHalvesUp,
            outside: Outside::Foreign,
            host_rounding: entry.rounding.unwrap_or_default(),
        });
    } else {
        map.outputs.push(Output {
            name,
            port: format!("{}_o", data.identifier),
            address: None,
            unit,
            format,
            state: None,
            initial: None,
            rounding: Rounding::NearestHalvesUp,
            outside: Outside::Foreign,
        });
    }
}
