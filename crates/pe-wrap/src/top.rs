//! The wrapper's entity: constants and wiring around the hand-written parts.

use askama::Template;
use pe_emit::comment_text;
use pe_map::registers::{self, Span, Windows};
use pe_map::wrap::{Wrap, windows};
use pe_map::{Access, Control, Format, HostPorts, Map, OutputMemory, Place};

use crate::Origin;
use crate::foreign::shell_name;

#[derive(Template)]
#[template(path = "wrapper.vhd")]
struct Top<'a> {
    generator: &'a str,
    command: &'a str,
    name: &'a str,
    wraps: String,
    /// Entity that is instantiated: the network, or the shell of a foreign entity.
    network: String,
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
    foreign: bool,
    ready: bool,
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
    /// Outputs in memories: where they are read, bits of one and its words, and whether all have a sample 0.
    memory: Option<&'a OutputMemory>,
    output_bits: u32,
    output_halves: u32,
    all_sampled: bool,
    parameter_words: u32,
    parameters: Option<Parameters>,
}

/// Parameters that are written at run time.
struct Parameters {
    count: usize,
    /// Words of one.
    halves: u32,
    /// The window of the initial state.
    initial: Vec<Initial>,
    /// Rows of all stored words in the order in which they are replaced, in bits.
    rows: Vec<String>,
    row_bits: usize,
}

impl Parameters {
    fn of(map: &Map, access: &Access) -> Parameters {
        let stored = |parameter: &pe_map::Parameter| &map.states[parameter.state as usize];
        let halves = map.parameters.first().map_or(1, |parameter| registers::words(stored(parameter).format.bits));
        let words = |parameter| {
            let state = stored(parameter);
            initial(Some(state.initial), &parameter.name, registers::words(state.format.bits))
        };
        let number = |place: &Place| {
            let own = |parameter: &pe_map::Parameter| Some(parameter.state) == place.state;
            map.parameters.iter().position(own).map_or(0, |number| number + 1)
        };
        let number_bits = (usize::BITS - map.parameters.len().leading_zeros()) as usize;
        let address_bits = access.address_bits as usize;
        let row = |place: &Place| format!("{:0number_bits$b}{:0address_bits$b}", number(place), place.address);
        Parameters {
            count: map.parameters.len(),
            halves,
            initial: map.parameters.iter().flat_map(words).collect(),
            rows: access.order.iter().map(row).collect(),
            row_bits: number_bits + address_bits,
        }
    }
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
        name: &map.entity,
        wraps: comment_text(&wrap.wraps),
        network: map.foreign.as_ref().map_or(map.entity.clone(), |_| shell_name(&map.entity)),
        entity: &wrap.entity,
        address_bits: wrap.address_bits,
        input_words: Windows::total(&places.inputs),
        output_words: Windows::total(&places.outputs),
        hash: &wrap.hash[..32],
        map_version: map.map_version,
        step_clocks: map.foreign.as_ref().map_or(map.clocks_per_step, |foreign| foreign.step_clocks),
        restart: wrap.capabilities.restart,
        states: wrap.capabilities.states,
        flags: wrap.capabilities.flags,
        stream: wrap.capabilities.stream,
        foreign: wrap.capabilities.foreign,
        ready: wrap.capabilities.ready,
        state_bits: map.states.first().filter(|_| access.is_some()).map_or(0, |state| state.format.bits),
        state_address_bits: access.map_or(1, |access| access.address_bits),
        state_count: access.map_or(0, |access| access.order.len()),
        state_clocks: STATE_CLOCKS,
        control: &map.control,
        inputs: inputs.map(|(i, span)| Port::of(&i.name, &i.port, i.format, span, input_window)).collect(),
        outputs: outputs.clone().map(|(o, span)| Port::of(&o.name, &o.port, o.format, span, output_window)).collect(),
        memory: map.output_memory.as_ref(),
        output_bits: map.outputs.first().map_or(0, |output| output.format.bits),
        output_halves: places.outputs.first().map_or(1, |span| span.words),
        all_sampled: map.outputs.iter().all(|output| map.sample_0(output).is_some()),
        parameter_words: Windows::total(&places.parameters),
        parameters: access.filter(|_| !map.parameters.is_empty()).map(|access| Parameters::of(map, access)),
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
