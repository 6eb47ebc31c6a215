//! The hand-written library.

use pe_ir::program::Program;

/// The hand-written library `pe_lib`, in compile order: file name and text.
pub const LIBRARY: [(&str, &str); 19] = [
    ("pe_pkg.vhd", include_str!("../hdl/pe_pkg.vhd")),
    ("pe_write_pkg.vhd", include_str!("../hdl/pe_write_pkg.vhd")),
    ("pe_style_pkg.vhd", include_str!("../hdl/pe_style_pkg.vhd")),
    ("pe_replica.vhd", include_str!("../hdl/pe_replica.vhd")),
    ("pe_ram.vhd", include_str!("../hdl/pe_ram.vhd")),
    ("pe_rom.vhd", include_str!("../hdl/pe_rom.vhd")),
    ("pe_multiplier.vhd", include_str!("../hdl/pe_multiplier.vhd")),
    ("pe_index.vhd", include_str!("../hdl/pe_index.vhd")),
    ("pe_scale.vhd", include_str!("../hdl/pe_scale.vhd")),
    ("pe_coefficient.vhd", include_str!("../hdl/pe_coefficient.vhd")),
    ("pe.vhd", include_str!("../hdl/pe.vhd")),
    ("pe_sequencer.vhd", include_str!("../hdl/pe_sequencer.vhd")),
    ("pe_input.vhd", include_str!("../hdl/pe_input.vhd")),
    ("pe_tick.vhd", include_str!("../hdl/pe_tick.vhd")),
    ("pe_access.vhd", include_str!("../hdl/pe_access.vhd")),
    ("pe_output.vhd", include_str!("../hdl/pe_output.vhd")),
    ("pe_output_memory.vhd", include_str!("../hdl/pe_output_memory.vhd")),
    ("pe_output_reader.vhd", include_str!("../hdl/pe_output_reader.vhd")),
    ("pe_trace_pkg.vhd", include_str!("../hdl/pe_trace_pkg.vhd")),
];

/// The files of the library that a program needs.
pub(crate) fn needed(program: &Program) -> impl Iterator<Item = (&'static str, &'static str)> {
    let ticks = program.ticks().next().is_some();
    let replaces = program.host.replaces();
    let memory = program.output_memory().is_some();
    LIBRARY.into_iter().filter(move |(file, _)| match *file {
        "pe_tick.vhd" => ticks,
        "pe_access.vhd" => replaces,
        "pe_output_memory.vhd" | "pe_output_reader.vhd" => memory,
        _ => true,
    })
}
