//! The network entity: PE instances and links, nothing else.

use askama::Template;
use pe_ir::index::{List, PeId, at, number};
use pe_ir::program::{Fold, Host, Layout, LinkSource, Program, index_bits};
use pe_ir::word::Pipeline;

use crate::names::{Names, comment_text};
use crate::options::Header;

#[derive(Template)]
#[template(path = "network.vhd")]
struct Network<'a> {
    header: &'a Header,
    model: &'a str,
    pe_count: usize,
    /// Whether the pipeline is the deep one.
    deep: bool,
    /// Whether a PE has a variant memory whose words differ from round to round.
    turns: bool,
    /// Bits that count the words of the largest rings, zero without rings.
    ring_bits: u32,
    inputs: Vec<Port>,
    ticks: Vec<Tick>,
    outputs: Vec<Output>,
    memory: Option<Memory>,
    pes: Vec<Pe>,
    host: Host,
    /// Whether words of states are replaced.
    replaces: bool,
}

impl Network<'_> {
    /// The type of a port with a default, as long as the longest of them: defaults stand in one column, but those of ports
    /// without one do not count.
    fn defaulted(&self, of: &str) -> String {
        let addressed = [("STATE", self.host.states), ("OUTPUT", self.memory.is_some())];
        let longest = addressed.into_iter().filter(|(_, present)| *present);
        let longest =
            longest.map(|(what, _)| format!("std_ulogic_vector({what}_ADDRESS_BITS - 1 downto 0)").len()).max();
        format!("{of:0$}", longest.unwrap_or(of.len()))
    }
}

struct Port {
    index: usize,
    port: String,
    comment: String,
}

struct Tick {
    index: u32,
    comment: String,
    steps: u32,
    done: u32,
    /// Bit of the operand that is worth 1.0.
    one_bit: u32,
    /// Bits of the counter.
    count_bits: u32,
}

struct Output {
    port: Port,
    pe: PeId,
    word: u32,
    proven: bool,
}

/// Outputs in memories.
struct Memory {
    pes: usize,
    place_bits: u32,
    shown_bits: u32,
    proven: bool,
}

struct Pe {
    index: PeId,
    equations: String,
    control_bits: u32,
    repeated_bits: u32,
    loop_bits: u32,
    streamed_bits: u32,
    /// Words of the variant memory, and bits of its address; 0 without one.
    variant_words: usize,
    variant_width: u32,
    own_words: u32,
    base_words: u32,
    base_bits: u32,
    coefficient_words: u32,
    imported_words: u32,
    port_count: u32,
    port_width: u32,
    /// Aggregate of the shift positions.
    shifts: String,
    accumulator_bits: u32,
    factor: bool,
    pre_adder: bool,
    swap: bool,
    base_last: bool,
    send: bool,
    proven: bool,
    index_words: u32,
    index_width: u32,
    octave_width: u32,
    /// Concatenation of what the ports are wired to, port 0 rightmost.
    wiring: String,
    wiring_comment: String,
    /// Whether an output shows a word of this PE.
    shown: bool,
    /// Words of the output memory, 0 without one, bits of a place there, and its number among the memories.
    shown_words: u32,
    shown_bits: u32,
    show_last: bool,
    ring_bits: u32,
    memory: usize,
}

/// The text of `<model>.vhd`.
pub fn render(program: &Program, folds: &[Fold], names: &Names, header: &Header) -> String {
    let comment = |name: &str, unit: &Option<String>, exponent: i32| {
        let unit = unit.as_deref().map_or(String::new(), |unit| format!(" [{}]", comment_text(unit)));
        format!("{}{unit}, LSB 2^{exponent}", comment_text(name))
    };
    let memory = program.output_memory();
    let mut shown = List::filled(false, program.pes.len());
    for output in &program.outputs {
        shown[output.pe] = true;
    }
    let number_of = |pe: PeId| memory.as_ref().and_then(|memory| memory.pes.binary_search(&pe).ok()).unwrap_or(0);
    let pes: Vec<Pe> = (shown.numbered().zip(folds))
        .map(|((index, shown), fold)| Pe { memory: number_of(index), ..describe(program, fold, index, *shown) })
        .collect();
    let inputs = program.ports().zip(&names.inputs).enumerate();
    let outputs = program.outputs.iter().zip(&names.outputs).enumerate();
    let network = Network {
        header,
        model: &names.model,
        pe_count: program.pes.len(),
        deep: program.format.pipeline == Pipeline::Deep,
        turns: program.rounds > 1 && pes.iter().any(|pe| pe.variant_words > 0),
        inputs: inputs
            .map(|(index, (port, name))| {
                let comment = comment(&port.name, &port.unit, port.exponent);
                Port { index, port: name.clone(), comment }
            })
            .collect(),
        ticks: program
            .ticks()
            .map(|(index, tick, one)| Tick {
                index,
                comment: comment_text(&program.inputs[at(index)].name),
                steps: tick.steps,
                done: tick.done,
                one_bit: program.format.input_operand(one).trailing_zeros(),
                count_bits: index_bits(tick.steps).max(1),
            })
            .collect(),
        outputs: outputs
            .map(|(index, (port, name))| {
                let comment = comment(&port.name, &port.unit, port.exponent);
                Output {
                    port: Port { index, port: name.clone(), comment },
                    pe: port.pe,
                    word: port.word,
                    proven: port.proven,
                }
            })
            .collect(),
        memory: memory.as_ref().map(|memory| Memory {
            pes: memory.pes.len(),
            place_bits: memory.place_bits,
            shown_bits: program.format.shown_bits(),
            proven: !memory.saturates,
        }),
        pes,
        host: program.host,
        replaces: program.host.replaces(),
        ring_bits: program.pes.iter().map(|pe| pe.features.ring_bits).max().unwrap_or(0),
    };
    network.render().expect("templates render into strings")
}

fn describe(program: &Program, fold: &Fold, index: PeId, shown: bool) -> Pe {
    let pe = &program.pes[index];
    let signal = |source: &LinkSource| match source {
        LinkSource::Pe(pe) => format!("link_{pe}"),
        LinkSource::Input(input) => format!("input_{input}"),
    };
    let wired = |source: &LinkSource| match source {
        LinkSource::Pe(pe) => format!("PE {pe}"),
        LinkSource::Input(input) => format!("input {}", comment_text(&program.inputs[at(*input)].name)),
    };
    let features = &pe.features;
    let wiring = if pe.ports.is_empty() {
        "(others => '0')".to_owned()
    } else {
        pe.ports.iter().rev().map(signal).collect::<Vec<_>>().join(" & ")
    };
    let equations = if pe.equations.is_empty() { "no equation".to_owned() } else { pe.equations.join(", ") };
    let shifts = features.shifts.iter().enumerate().map(|(index, shift)| format!("{index} => {shift}"));
    Pe {
        index,
        equations: comment_text(&equations),
        control_bits: Layout::new(features, &program.format).bits,
        repeated_bits: fold.repeated_bits(),
        loop_bits: fold.loop_bits(),
        streamed_bits: fold.streamed_bits(),
        variant_words: fold.variant_words.len(),
        variant_width: index_bits(number(fold.variant_words.len())),
        own_words: features.own_words,
        base_words: features.base_words,
        base_bits: index_bits(features.base_words),
        coefficient_words: features.coefficient_words,
        imported_words: features.imported_words,
        port_count: features.ports,
        port_width: features.ports.max(1) * program.format.data_bits,
        shifts: shifts.collect::<Vec<_>>().join(", "),
        accumulator_bits: features.accumulator_bits,
        factor: features.factor,
        pre_adder: features.pre_adder,
        swap: features.swap,
        base_last: features.base_last,
        send: features.send,
        proven: features.proven,
        index_words: features.index_words,
        index_width: features.index_bits,
        octave_width: features.octave_bits,
        wiring,
        wiring_comment: pe.ports.iter().map(wired).collect::<Vec<_>>().join(", "),
        shown,
        shown_words: features.shown_words,
        shown_bits: index_bits(features.shown_words),
        show_last: features.show_last,
        ring_bits: features.ring_bits,
        memory: 0,
    }
}
