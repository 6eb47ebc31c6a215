//! What runs a design: VHDL test bench, Verilator driver, stimulus, compile order.

use askama::Template;
use pe_ir::index::{at, number};
use pe_ir::program::{Host, Program};
use pe_ir::word::Pipeline;

use crate::library;
use crate::names::Names;
use crate::options::{EmitOptions, Header};

/// An instance port and its slice of the drivers' vectors.
struct Slice {
    port: String,
    index: usize,
    msb: u32,
    lsb: u32,
}

fn slices(names: &[String], width: u32) -> Vec<Slice> {
    let slice = |(index, port): (usize, &String)| {
        let lsb = number(index) * width;
        Slice { port: port.clone(), index, msb: lsb + width - 1, lsb }
    };
    names.iter().enumerate().map(slice).collect()
}

fn write_depths(program: &Program) -> Vec<u32> {
    program.pes.iter().map(|pe| pe.features.write_words()).collect()
}

#[derive(Template)]
#[template(path = "testbench.vhd")]
struct Testbench<'a> {
    header: &'a Header,
    model: &'a str,
    default_steps: u32,
    pe_count: usize,
    inputs: Vec<Slice>,
    outputs: Vec<Slice>,
    output_count: usize,
    /// Whether outputs are in memories.
    memory: bool,
    /// Aggregate of the own memories' depths.
    write_words: String,
}

/// The text of `<model>_tb.vhd`.
pub fn testbench(program: &Program, names: &Names, header: &Header, options: &EmitOptions) -> String {
    let width = program.format.storage_bits;
    let depths = write_depths(program);
    let write_words = depths.iter().enumerate().map(|(index, words)| format!("{index} => {words}"));
    let bench = Testbench {
        header,
        model: &names.model,
        default_steps: options.default_steps.max(1),
        pe_count: program.pes.len(),
        inputs: slices(&names.inputs, width),
        outputs: slices(&names.outputs, width),
        output_count: program.outputs.len(),
        memory: program.output_memory().is_some(),
        write_words: write_words.collect::<Vec<_>>().join(", "),
    };
    bench.render().expect("templates render into strings")
}

#[derive(Template)]
#[template(path = "host_testbench.vhd")]
struct HostTestbench<'a> {
    header: &'a Header,
    model: &'a str,
    /// Whether the pipeline is the deep one.
    deep: bool,
    host: Host,
    inputs: Vec<Slice>,
    outputs: Vec<Slice>,
    output_count: usize,
    /// Whether outputs are in memories.
    memory: bool,
}

/// The text of `<model>_host_tb.vhd`.
pub fn host_testbench(program: &Program, names: &Names, header: &Header) -> String {
    let width = program.format.storage_bits;
    let bench = HostTestbench {
        header,
        model: &names.model,
        deep: program.format.pipeline == Pipeline::Deep,
        host: program.host,
        inputs: slices(&names.inputs, width),
        outputs: slices(&names.outputs, width),
        output_count: program.outputs.len(),
        memory: program.output_memory().is_some(),
    };
    bench.render().expect("templates render into strings")
}

#[derive(Template)]
#[template(path = "verilator.cpp")]
struct Verilator<'a> {
    header: &'a Header,
    model: &'a str,
    default_steps: u32,
    word_bits: u32,
    data_bits: u32,
    storage_bits: u32,
    pe_count: usize,
    inputs: Vec<Slice>,
    outputs: Vec<Slice>,
    output_count: usize,
    period: u32,
    /// Clocks from the address of an output in a memory to its word.
    latency: Option<u32>,
    write_words: String,
}

/// The text of `<model>_verilator.cpp`.
pub fn verilator(program: &Program, names: &Names, header: &Header, options: &EmitOptions) -> String {
    let format = &program.format;
    let driver = Verilator {
        header,
        model: &names.model,
        default_steps: options.default_steps.max(1),
        word_bits: format.word_bits(),
        data_bits: format.data_bits,
        storage_bits: format.storage_bits,
        pe_count: program.pes.len(),
        inputs: slices(&names.inputs, format.storage_bits),
        outputs: slices(&names.outputs, format.storage_bits),
        output_count: program.outputs.len(),
        period: program.period,
        latency: program.output_memory().map(|memory| memory.latency),
        write_words: write_depths(program).iter().map(u32::to_string).collect::<Vec<_>>().join(", "),
    };
    driver.render().expect("templates render into strings")
}

#[derive(Template)]
#[template(path = "files.f")]
struct FileList<'a> {
    model: &'a str,
    library: Vec<&'static str>,
    host: bool,
}

/// The text of `<model>.f`: library and file of every VHDL unit of a design, in compile order.
pub fn file_list(program: &Program, names: &Names) -> String {
    let list = FileList {
        model: &names.model,
        library: library::needed(program).map(|(file, _)| file).collect(),
        host: program.host != Host::default(),
    };
    list.render().expect("templates render into strings")
}

/// The text of `<model>_stimulus.txt`: one line per step, one hex word per input port; at least one line.
pub fn stimulus(program: &Program, options: &EmitOptions) -> String {
    let bits = program.format.storage_bits;
    let digits = at(bits.div_ceil(4));
    let mut text = String::new();
    for step in 0..options.stimulus.len().max(1) {
        let words = options.stimulus.get(step).map_or(&[][..], Vec::as_slice);
        let word = |index: usize| words.get(index).copied().unwrap_or(0) as u64 & (u64::MAX >> (64 - bits));
        let line: Vec<String> =
            (0..program.ports().count()).map(|index| format!("{:0digits$x}", word(index))).collect();
        text.push_str(&line.join(" "));
        text.push('\n');
    }
    text
}
