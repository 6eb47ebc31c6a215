//! The wrapper's entity: constants and wiring around the hand-written parts.

use askama::Template;
use pe_emit::comment_text;
use pe_map::registers::{Span, Windows};
use pe_map::wrap::{Wrap, windows};
use pe_map::{Control, Format, HostPorts, Map};

use crate::Origin;

#[derive(Template)]
#[template(path = "wrapper.vhd")]
struct Top<'a> {
    generator: &'a str,
    command: &'a str,
    wraps: &'a str,
    entity: &'a str,
    address_bits: u32,
    input_words: u32,
    output_words: u32,
    hash: &'a str,
    map_version: u32,
    step_clocks: u32,
    restart: bool,
    states: bool,
    flags: bool,
    stream: bool,
    /// Bits of a stored word and of its address, words that are replaced, and clocks from an address to its word.
    state_bits: u32,
    state_address_bits: u32,
    state_count: usize,
    state_clocks: u32,
    control: &'a Control,
    host: HostPorts,
    inputs: Vec<Port>,
    outputs: Vec<Port>,
    initial: Vec<Initial>,
}

/// A port of the network in the words of its window.
struct Port {
    port: String,
    comment: String,
    lsb: u32,
    msb: u32,
    /// Highest bit of its words.
    high: u32,
    /// Bits above the port.
    fill: u32,
}

/// A word of the outputs in the initial state.
struct Initial {
    value: String,
    comment: String,
    /// Whether it has a value.
    sampled: bool,
}

impl Port {
    fn of(name: &str, port: &str, format: Format, span: &Span, window: u32) -> Port {
        let lsb = 8 * (span.address - window);
        let (msb, high) = (lsb + format.bits - 1, lsb + 32 * span.words - 1);
        Port { port: port.to_owned(), comment: comment_text(name), lsb, msb, high, fill: high - msb }
    }
}

/// Clocks from an address to the word of a state, as many as a deep pipeline takes; a short one is there sooner.
const STATE_CLOCKS: u32 = 4;

/// The text of `NAME_axi.vhd`.
pub fn render(map: &Map, wrap: &Wrap, origin: &Origin) -> String {
    let places = windows(map);
    let first = |spans: &[Span]| spans.first().map_or(0, |span| span.address);
    let (input_window, output_window) = (first(&places.inputs), first(&places.outputs));
    let inputs = map.inputs.iter().zip(&places.inputs);
    let outputs = map.outputs.iter().zip(&places.outputs);
    let host = map.host.clone().unwrap_or_default();
    let access = host.access.as_ref();
    let top = Top {
        generator: &origin.generator,
        command: &origin.command,
        wraps: &wrap.wraps,
        entity: &wrap.entity,
        address_bits: wrap.address_bits,
        input_words: Windows::total(&places.inputs),
        output_words: Windows::total(&places.outputs),
        hash: &wrap.hash[..32],
        map_version: map.map_version,
        step_clocks: map.clocks_per_step,
        restart: wrap.capabilities.restart,
        states: wrap.capabilities.states,
        flags: wrap.capabilities.flags,
        stream: wrap.capabilities.stream,
        state_bits: map.states.first().filter(|_| access.is_some()).map_or(0, |state| state.format.bits),
        state_address_bits: access.map_or(1, |access| access.address_bits),
        state_count: access.map_or(0, |access| access.order.len()),
        state_clocks: STATE_CLOCKS,
        control: &map.control,
        inputs: inputs.map(|(i, span)| Port::of(&i.name, &i.port, i.format, span, input_window)).collect(),
        outputs: outputs.clone().map(|(o, span)| Port::of(&o.name, &o.port, o.format, span, output_window)).collect(),
        initial: outputs.flat_map(|(output, span)| initial(map.sample_0(output), &output.name, span.words)).collect(),
        host,
    };
    top.render().expect("templates render into strings")
}

/// Words of an output in the initial state.
fn initial(word: Option<i64>, name: &str, words: u32) -> impl Iterator<Item = Initial> {
    (0..words).map(move |half| {
        let value = format!("x\"{:08X}\"", (word.unwrap_or(0) >> (32 * half)) as u32);
        Initial { value, comment: comment_text(name), sampled: word.is_some() }
    })
}
