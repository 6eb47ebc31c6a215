//! Writes a program as files: VHDL network, program package, test bench, Rust reference, Verilator driver.
//!
//! In: a [`Program`] and [`EmitOptions`]. Out: [`Artefact`]s, deterministic, with paths relative to the design's
//! directory. Hand-written VHDL goes along unchanged; generated files hold data and wiring only. Layout lives in
//! `templates/`, everything computed in the modules here.

mod access;
mod columns;
mod drivers;
mod library;
mod map;
mod names;
mod network;
mod options;
pub mod page;
mod program_pkg;
mod reference;

pub use columns::aligned;
pub use library::LIBRARY;
pub use names::{comment_text, vhdl_identifier};
pub use options::{Driven, EmitOptions, Interface, Provenance, Tunable};

use names::Names;
use options::Header;
use pe_ir::program::{Fold, Host, Program};

/// One file of the design.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artefact {
    /// Path relative to the design's directory, with `/`.
    pub path: String,
    /// Content.
    pub text: String,
}

/// Name of a program's design unit: the model name as a VHDL identifier. File names start with it.
pub fn design_name(program: &Program) -> String {
    vhdl_identifier(&program.model)
}

/// The map of a design, as its file has it.
pub fn map(program: &Program, options: &EmitOptions) -> String {
    map::render(program, &Names::new(program), options, &map::hash(program, options))
}

/// All files of a design.
///
/// # Panics
/// If a control word does not fit the layout that its PE's features give, or a note or port index is out of range.
pub fn emit(program: &Program, options: &EmitOptions) -> Vec<Artefact> {
    let header = Header::of(options);
    let names = Names::new(program);
    let folds: Vec<Fold> = program.pes.iter().map(|pe| Fold::of(program, pe)).collect();
    let model = &names.model;
    let hash = map::hash(program, options);
    let mut artefacts: Vec<Artefact> = library::needed(program)
        .map(|(file, text)| Artefact { path: format!("hdl/{file}"), text: text.to_owned() })
        .collect();
    let mut push = |suffix: &str, text: String| {
        artefacts.push(Artefact { path: format!("{model}{suffix}"), text: columns::aligned(text) });
    };
    push("_program_pkg.vhd", program_pkg::render(program, &folds, &names, &header, &options.provenance));
    push(".vhd", network::render(program, &folds, &names, &header));
    push("_tb.vhd", drivers::testbench(program, &names, &header, options));
    if program.host != Host::default() {
        push("_host_tb.vhd", drivers::host_testbench(program, &names, &header));
    }
    push(".f", drivers::file_list(program, &names));
    push("_reference.rs", reference::render(program, &folds, &header, options, &hash));
    if options.c_header {
        push(".h", reference::c_header(program, &header, &hash));
    }
    push("_verilator.cpp", drivers::verilator(program, &names, &header, options));
    push("_map.json", map::render(program, &names, options, &hash));
    push("_stimulus.txt", drivers::stimulus(program, options));
    push("_shapes.txt", pe_ir::program::shapes(program, &folds));
    artefacts
}
