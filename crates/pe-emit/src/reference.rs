//! The Rust reference: one file that builds with plain `rustc` and simulates the network from its bits.

use std::fmt::Write;

use askama::Template;
use pe_ir::index::{StateId, at};
use pe_ir::program::{Fold, LinkSource, OutputPort, PeProgram, Program, StateRegister, Tick, closed_up};
use pe_ir::word::Pipeline;

use crate::names::vhdl_identifier;
use crate::options::{EmitOptions, Header};

#[derive(Template)]
#[template(path = "reference.rs")]
struct Reference<'a> {
    header: &'a Header,
    model: String,
    default_steps: u32,
    storage_bits: u32,
    guard_bits: u32,
    data_bits: u32,
    coefficient_bits: u32,
    multiplier_latency: u32,
    /// Whether the pipeline is the deep one.
    deep: bool,
    period: u32,
    rounds: u32,
    input_count: usize,
    hash: &'a str,
    /// Fields of `Tick`.
    ticks: String,
    /// Integer type that products and sums fit.
    sum_type: &'static str,
    /// Fields of `Output`.
    /// Whether outputs are in memories.
    memory: bool,
    /// Whether a PE has rings.
    rings: bool,
    outputs: String,
    /// Fields of `State`.
    states: String,
    program: &'a Program,
    folds: &'a [Fold],
}

impl Reference<'_> {
    /// The PEs, described one at a time to save memory.
    fn pes(&self) -> impl Iterator<Item = Pe> {
        self.program.pes.iter().zip(self.folds).map(|(pe, fold)| describe(pe, fold))
    }
}

struct Pe {
    own_words: u32,
    base_words: u32,
    coefficient_words: u32,
    imported_words: u32,
    ports: String,
    shifts: String,
    accumulator_bits: u32,
    factor: bool,
    pre_adder: bool,
    swap: bool,
    send: bool,
    proven: bool,
    index_words: u32,
    index_width: u32,
    octave_width: u32,
    shows: bool,
    ring_bits: u32,
    own_image: String,
    base_image: String,
    coefficient_image: String,
    imported_image: String,
    base_last: bool,
    /// Bits of the control word that come from the stream or variant memory.
    streamed: String,
    /// Loop memory in hexadecimal, a line for each word.
    repeated: String,
    /// Stream memory in hexadecimal.
    stream: String,
    /// Variant memory in hexadecimal.
    variants: String,
    /// Bits of a loop word below the variant of the next word.
    repeated_bits: u32,
}

/// `<model>.h`.
#[derive(Template)]
#[template(path = "reference.h")]
struct CHeader<'a> {
    header: &'a Header,
    model: String,
    /// What its macros begin with.
    guard: String,
    hash: &'a str,
    storage_bits: u32,
    word_bits: u32,
    inputs: usize,
    outputs: usize,
    state_words: usize,
}

/// The text of `<model>_reference.rs`; `hash` is that of the map.
pub fn render(program: &Program, folds: &[Fold], header: &Header, options: &EmitOptions, hash: &str) -> String {
    let format = &program.format;
    let output = |(output, state): (&OutputPort, Option<StateId>)| {
        let OutputPort { pe, word, proven, .. } = output;
        let state = state.map(StateId::number);
        format!("Output {{ pe: {pe}, word: {word}, proven: {proven}, state: {state:?} }}")
    };
    let rings = program.pes.iter().any(|pe| pe.features.ring_bits > 0);
    let state = |state: &StateRegister| {
        let (pe, address) = state.own;
        let copies = joined(state.imported.iter().map(|(pe, address)| format!("({pe}, {address})")));
        let ring = if rings { format!(", ring: {}", state.age.is_some()) } else { String::new() };
        format!("State {{ pe: {pe}, address: {address}, copies: &[{copies}]{ring} }}")
    };
    let tick = |(_, tick, one): (u32, Tick, i64)| {
        format!("Tick {{ steps: {}, done: {}, one: {} }}", tick.steps, tick.done, format.input_operand(one))
    };
    let reference = Reference {
        header,
        model: vhdl_identifier(&program.model),
        default_steps: options.default_steps.max(1),
        storage_bits: format.storage_bits,
        guard_bits: format.guard_bits,
        data_bits: format.data_bits,
        coefficient_bits: format.coefficient_bits,
        multiplier_latency: program.latency().multiplier,
        deep: program.format.pipeline == Pipeline::Deep,
        period: program.period,
        rounds: program.rounds,
        input_count: program.inputs.len(),
        hash,
        ticks: joined(program.ticks().map(tick)),
        sum_type: sum_type(program),
        memory: program.output_memory().is_some(),
        rings,
        outputs: joined(program.outputs.iter().zip(program.shown_states()).map(output)),
        states: joined(program.states.iter().map(state)),
        program,
        folds,
    };
    reference.render().expect("templates render into strings")
}

/// The text of `<model>.h`; `hash` is that of the map.
pub fn c_header(program: &Program, header: &Header, hash: &str) -> String {
    let model = vhdl_identifier(&program.model);
    let header = CHeader {
        header,
        guard: model.to_ascii_uppercase(),
        model,
        hash,
        storage_bits: program.format.storage_bits,
        word_bits: program.format.word_bits(),
        inputs: program.ports().count(),
        outputs: program.outputs.len(),
        state_words: program.states.len() + program.ticks().count(),
    };
    header.render().expect("templates render into strings")
}

/// The faster 64-bit type unless a product or an accumulator is wider.
fn sum_type(program: &Program) -> &'static str {
    let product = program.format.data_bits + program.format.coefficient_bits;
    let widest = program.pes.iter().map(|pe| pe.features.accumulator_bits).fold(product, u32::max);
    if widest > i64::BITS { "i128" } else { "i64" }
}

fn describe(pe: &PeProgram, fold: &Fold) -> Pe {
    let features = &pe.features;
    let hex =
        |words: &[u128], mask: u128| hexadecimal(words.iter().map(|word| closed_up(*word, mask)), mask.count_ones());
    let repeated = fold.repeated.iter().enumerate().map(|(place, word)| {
        let word = closed_up(*word, fold.all & !fold.streamed);
        word | u128::from(fold.next_variant(place)) << fold.repeated_bits()
    });
    let port = |source: &LinkSource| match source {
        LinkSource::Pe(pe) => format!("Source::Pe({pe})"),
        LinkSource::Input(input) => format!("Source::Input({input})"),
    };
    Pe {
        own_words: features.own_words,
        base_words: features.base_words,
        coefficient_words: features.coefficient_words,
        imported_words: features.imported_words,
        ports: joined(pe.ports.iter().map(port)),
        shifts: joined(features.shifts.iter()),
        accumulator_bits: features.accumulator_bits,
        factor: features.factor,
        pre_adder: features.pre_adder,
        swap: features.swap,
        send: features.send,
        proven: features.proven,
        index_words: features.index_words,
        index_width: features.index_bits,
        octave_width: features.octave_bits,
        shows: features.shown_words > 0,
        ring_bits: features.ring_bits,
        own_image: joined(pe.own_image.iter()),
        base_image: joined(pe.base_image.iter()),
        coefficient_image: joined(pe.coefficient_image.iter()),
        imported_image: joined(pe.imported_image.iter()),
        base_last: features.base_last,
        streamed: format!("{:#x}", fold.streamed),
        repeated: hexadecimal(repeated, fold.loop_bits()),
        stream: hex(&fold.stream, fold.streamed),
        variants: hex(&fold.variant_words, fold.streamed),
        repeated_bits: fold.repeated_bits(),
    }
}

/// A line for each word of so many bits. Written into one text, for the words of a network are millions.
fn hexadecimal(words: impl Iterator<Item = u128>, bits: u32) -> String {
    let digits = at(bits.div_ceil(4));
    words.fold(String::new(), |mut text, word| {
        write!(text, "\n{word:0digits$x}").expect("memory takes the line");
        text
    })
}

fn joined<T: ToString>(items: impl Iterator<Item = T>) -> String {
    items.map(|item| item.to_string()).collect::<Vec<_>>().join(", ")
}
