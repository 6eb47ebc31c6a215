//! The description of a wrapper, `NAME_wrap.json`: where a host finds what the map names.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::registers::{REGISTER_VERSION, REGISTERS, Span, Windows};
use crate::{Fault, Format, Map, Output, Parameter, State};

/// What [`Wrap::wrap_version`] is in descriptions that these types describe.
pub const WRAP_VERSION: u32 = 1;

/// `NAME_wrap.json`.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Wrap {
    /// Version of this format; another one has keys that mean something else.
    pub wrap_version: u32,
    /// `pe-synth` and its version.
    pub generator: String,
    /// Hash of the design, as in the map; `HASH_0` to `HASH_3` are its first 32 digits.
    pub hash: String,
    /// Name of the VHDL entity: the network, or another one that was wrapped.
    pub wraps: String,
    /// Name of the wrapper's VHDL entity.
    pub entity: String,
    /// Version of the register map, as in the register `VERSION`.
    pub register_version: u16,
    /// Bits of a byte address on the bus.
    pub address_bits: u32,
    /// What this wrapper has.
    pub capabilities: Capabilities,
    /// Addresses of the registers that this wrapper has.
    pub registers: Vec<RegisterPlace>,
    /// Where the parameters are that are written at run time, in the order of the map: their stored words.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<Place>,
    /// Where the inputs are, in the order of the map.
    pub inputs: Vec<Place>,
    /// Where the outputs are, in the order of the map.
    pub outputs: Vec<Place>,
}

/// What a wrapper has; bits of `CAPS`.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema, PartialEq, Eq, Serialize)]
pub struct Capabilities {
    /// The network can be restarted.
    pub restart: bool,
    /// States can be read and replaced.
    pub states: bool,
    /// There is a flag per cause.
    pub flags: bool,
    /// Inputs and outputs can go through streams.
    pub stream: bool,
    /// There are parameters that are written at run time.
    #[serde(default)]
    pub parameters: bool,
    /// It is a foreign entity, which runs by its clock enable.
    pub foreign: bool,
    /// A foreign entity that tells when a step has ended.
    #[serde(default)]
    pub ready: bool,
}

/// A register.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct RegisterPlace {
    /// Name.
    pub name: String,
    /// Address in bytes.
    pub address: u32,
    /// Parts of it that this wrapper has.
    pub fields: Vec<FieldPlace>,
}

/// Part of a register.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct FieldPlace {
    /// Name.
    pub name: String,
    /// Lowest bit.
    pub low: u8,
    /// Bits.
    pub bits: u8,
}

/// An input or output.
#[derive(Clone, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct Place {
    /// Name in the spec, with indices; of a foreign entity the port.
    pub name: String,
    /// Address in bytes of its first word; the low half comes first.
    pub address: u32,
    /// Words of 32 bits.
    pub words: u32,
    /// Of outputs: the word of sample 0, which can be read before any step; null if there is none. Null of inputs.
    pub initial: Option<i64>,
}

impl Capabilities {
    fn has(self, needed: Option<crate::registers::Capability>) -> bool {
        use crate::registers::Capability;
        match needed {
            None => true,
            Some(Capability::Restart) => self.restart,
            Some(Capability::States) => self.states,
            Some(Capability::Flags) => self.flags,
            Some(Capability::Stream) => self.stream,
            Some(Capability::Parameters) => self.parameters,
            Some(Capability::Foreign) => self.foreign,
            Some(Capability::Ready) => self.ready,
        }
    }

    /// Of a network, or of a foreign entity.
    pub fn of(map: &Map, stream: bool) -> Capabilities {
        let host = map.host.as_ref();
        Capabilities {
            restart: host.is_some_and(|host| host.restart.is_some()),
            states: host.is_some_and(|host| host.access.is_some()),
            flags: host.is_some_and(|host| host.flags.is_some()),
            stream,
            parameters: !windows(map).parameters.is_empty(),
            foreign: map.foreign.is_some(),
            ready: map.foreign.as_ref().is_some_and(|foreign| foreign.ready),
        }
    }
}

/// Where the values of a design are.
pub fn windows(map: &Map) -> Windows {
    let inputs: Vec<Format> = map.inputs.iter().map(|input| input.format).collect();
    let outputs: Vec<Format> = map.outputs.iter().map(|output| output.format).collect();
    // They are written through the ports that replace states.
    let access = map.host.as_ref().and_then(|host| host.access.as_ref());
    let stored = |parameter: &Parameter| Some(map.states.get(usize::try_from(parameter.state).ok()?)?.format);
    let parameters: Vec<Format> = map.parameters.iter().filter(|_| access.is_some()).filter_map(stored).collect();
    Windows::of(&parameters, &inputs, &outputs)
}

impl Wrap {
    /// Of a network that `generator` wraps.
    pub fn of(map: &Map, generator: &str, capabilities: Capabilities) -> Wrap {
        let windows = windows(map);
        let place = |name: &String, span: &Span, initial| Place {
            name: name.clone(),
            address: span.address,
            words: span.words,
            initial,
        };
        let has = |needed| capabilities.has(needed);
        Wrap {
            wrap_version: WRAP_VERSION,
            generator: generator.to_owned(),
            hash: map.hash.clone(),
            wraps: map.foreign.as_ref().map_or(&map.entity, |foreign| &foreign.entity).clone(),
            entity: format!("{}_axi", map.entity),
            register_version: REGISTER_VERSION,
            address_bits: windows.address_bits,
            capabilities,
            registers: REGISTERS
                .iter()
                .filter(|register| has(register.needs))
                .map(|register| RegisterPlace {
                    name: register.name.to_owned(),
                    address: register.address,
                    fields: (register.fields.iter().filter(|field| has(field.needs)))
                        .map(|field| FieldPlace { name: field.name.to_owned(), low: field.low, bits: field.bits })
                        .collect(),
                })
                .collect(),
            parameters: (map.parameters.iter().zip(&windows.parameters))
                .map(|(parameter, span)| place(&parameter.name, span, None))
                .collect(),
            inputs: map.inputs.iter().zip(&windows.inputs).map(|(i, span)| place(&i.name, span, None)).collect(),
            outputs: (map.outputs.iter().zip(&windows.outputs))
                .map(|(output, span)| place(&output.name, span, map.sample_0(output)))
                .collect(),
        }
    }

    /// Reads a description.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn read(text: &str) -> Result<Wrap, Fault> {
        let damaged = |error: serde_json::Error| Fault::Damaged(error.to_string());
        #[derive(Deserialize)]
        struct Versioned {
            wrap_version: u64,
        }
        let Versioned { wrap_version } = serde_json::from_str(text).map_err(damaged)?;
        if wrap_version != u64::from(WRAP_VERSION) {
            return Err(Fault::Version(wrap_version));
        }
        serde_json::from_str(text).map_err(damaged)
    }

    /// The text of the file.
    pub fn text(&self) -> String {
        let text = serde_json::to_string_pretty(self).expect("a description has names and numbers");
        text + "\n"
    }
}

impl Map {
    /// The word of an output in the initial state, with all inputs 0: as the network rounds the state that it shows, or the
    /// nearest one to what its equation gives. None if that is not defined.
    pub fn sample_0(&self, output: &Output) -> Option<i64> {
        let Some(state) = output.state else { return output.initial };
        let state = self.states.get(usize::try_from(state).ok()?)?;
        Some(output.shown(state, state.initial))
    }
}

impl Output {
    /// The word of the port when `state`, which it shows, has a stored word: rounded to nearest, halves up, and clamped.
    pub fn shown(&self, state: &State, word: i64) -> i64 {
        let guard = state.format.bits - self.format.bits;
        let half = (1_i64 << guard) >> 1;
        let [least, most] = self.format.words();
        ((word - state.offset + half) >> guard).clamp(least, most)
    }
}
