//! Writes a program as files: VHDL network, program package, test bench, Rust reference, Verilator driver.
//!
//! In: a [`Program`] and [`EmitOptions`]. Out: [`Artefact`]s, deterministic, with paths relative to the design's
//! directory. Hand-written VHDL goes along unchanged; generated files hold data and wiring only. Layout lives in
//! `templates/`, everything computed in the modules here.

mod columns;
mod drivers;
mod names;
mod network;
pub mod page;
mod program_pkg;
mod reference;

pub use names::{comment_text, vhdl_identifier};

use names::Names;
use pe_ir::program::{Fold, Program};

/// One file of the design.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artefact {
    /// Path relative to the design's directory, with `/`.
    pub path: String,
    /// Content.
    pub text: String,
}

/// What the files tell about their origin, and what the test benches run.
#[derive(Clone, Debug, Default)]
pub struct EmitOptions {
    /// Command for the `Regenerate:` line of the headers.
    pub command: String,
    /// Name of the spec.
    pub spec: String,
    /// Version of the tool.
    pub version: String,
    /// Words of each input port in each step; runs that last longer repeat the last step's.
    pub stimulus: Vec<Vec<i64>>,
    /// Steps that the test benches run unless told otherwise.
    pub default_steps: u32,
}

/// The hand-written library `pe_lib`, in compile order: file name and text.
pub const LIBRARY: [(&str, &str); 15] = [
    ("pe_pkg.vhd", include_str!("../../../hdl/pe_pkg.vhd")),
    ("pe_write_pkg.vhd", include_str!("../../../hdl/pe_write_pkg.vhd")),
    ("pe_style_pkg.vhd", include_str!("../../../hdl/pe_style_pkg.vhd")),
    ("pe_replica.vhd", include_str!("../../../hdl/pe_replica.vhd")),
    ("pe_ram.vhd", include_str!("../../../hdl/pe_ram.vhd")),
    ("pe_rom.vhd", include_str!("../../../hdl/pe_rom.vhd")),
    ("pe_multiplier.vhd", include_str!("../../../hdl/pe_multiplier.vhd")),
    ("pe_index.vhd", include_str!("../../../hdl/pe_index.vhd")),
    ("pe_scale.vhd", include_str!("../../../hdl/pe_scale.vhd")),
    ("pe.vhd", include_str!("../../../hdl/pe.vhd")),
    ("pe_sequencer.vhd", include_str!("../../../hdl/pe_sequencer.vhd")),
    ("pe_input.vhd", include_str!("../../../hdl/pe_input.vhd")),
    ("pe_tick.vhd", include_str!("../../../hdl/pe_tick.vhd")),
    ("pe_output.vhd", include_str!("../../../hdl/pe_output.vhd")),
    ("pe_trace_pkg.vhd", include_str!("../../../hdl/pe_trace_pkg.vhd")),
];

/// The files of the library that a program needs.
fn library(program: &Program) -> impl Iterator<Item = (&'static str, &'static str)> {
    let ticks = program.ticks().next().is_some();
    LIBRARY.into_iter().filter(move |(file, _)| ticks || *file != "pe_tick.vhd")
}

/// Lines that open every generated file.
struct Header {
    version: String,
    spec: String,
    command: String,
}

/// Name of a program's design unit: the model name as a VHDL identifier. File names start with it.
pub fn design_name(program: &Program) -> String {
    vhdl_identifier(&program.model)
}

/// All files of a design.
///
/// # Panics
/// If a control word does not fit the layout that its PE's features give, or a note or port index is out of range.
pub fn emit(program: &Program, options: &EmitOptions) -> Vec<Artefact> {
    let header = Header {
        version: comment_text(&options.version),
        spec: comment_text(&options.spec),
        command: comment_text(&options.command),
    };
    let names = Names::new(program);
    let folds: Vec<Fold> = program.pes.iter().map(|pe| Fold::of(program, pe)).collect();
    let model = &names.model;
    let mut artefacts: Vec<Artefact> =
        library(program).map(|(file, text)| Artefact { path: format!("hdl/{file}"), text: text.to_owned() }).collect();
    let mut push = |suffix: &str, text: String| {
        artefacts.push(Artefact { path: format!("{model}{suffix}"), text: columns::aligned(text) });
    };
    push("_program_pkg.vhd", program_pkg::render(program, &folds, &names, &header));
    push(".vhd", network::render(program, &folds, &names, &header));
    push("_tb.vhd", drivers::testbench(program, &names, &header, options));
    push(".f", drivers::file_list(program, &names));
    push("_reference.rs", reference::render(program, &folds, &header, options));
    push("_verilator.cpp", drivers::verilator(program, &names, &header, options));
    push("_stimulus.txt", drivers::stimulus(program, options));
    push("_shapes.txt", pe_ir::program::shapes(program, &folds));
    artefacts
}
