//! Writes wrappers: a network behind a bus, with registers for inputs, outputs and control, and a bus master that hosts
//! talk to in a simulation.
//!
//! In: the [`Map`] of a design. Out: files, deterministic, with paths relative to the design's folder. Hand-written VHDL
//! goes along unchanged; what is generated holds constants and wiring only. The registers are those of
//! [`pe_map::registers`].

mod bus;
pub mod foreign;
mod package;
mod top;

pub use package::constants;

use pe_emit::Artefact;
use pe_map::Map;
use pe_map::wrap::{Capabilities, Wrap};

/// The hand-written VHDL of wrappers, in compile order, behind that of the network: file name and text.
pub const LIBRARY: [(&str, &str); 13] = [
    ("pe_register_pkg.vhd", include_str!("../hdl/pe_register_pkg.vhd")),
    ("pe_axi_lite.vhd", include_str!("../hdl/pe_axi_lite.vhd")),
    ("pe_registers.vhd", include_str!("../hdl/pe_registers.vhd")),
    ("pe_windows.vhd", include_str!("../hdl/pe_windows.vhd")),
    ("pe_output_window.vhd", include_str!("../hdl/pe_output_window.vhd")),
    ("pe_state_port.vhd", include_str!("../hdl/pe_state_port.vhd")),
    ("pe_parameters.vhd", include_str!("../hdl/pe_parameters.vhd")),
    ("pe_stream.vhd", include_str!("../hdl/pe_stream.vhd")),
    ("pe_synchronizer.vhd", include_str!("../hdl/pe_synchronizer.vhd")),
    ("pe_counters.vhd", include_str!("../hdl/pe_counters.vhd")),
    ("pe_foreign.vhd", include_str!("../hdl/pe_foreign.vhd")),
    ("pe_held_input.vhd", include_str!("../hdl/pe_held_input.vhd")),
    ("pe_held_output.vhd", include_str!("../hdl/pe_held_output.vhd")),
];

/// What the files tell about their origin.
#[derive(Clone, Debug)]
pub struct Origin {
    /// `pe-synth` and its version.
    pub generator: String,
    /// Command for the `Regenerate:` lines.
    pub command: String,
}

/// Of the library of networks what wrappers need as well, where there is no network.
fn foundation(map: &Map, stream: bool) -> impl Iterator<Item = &'static (&'static str, &'static str)> {
    let foreign = map.foreign.is_some();
    pe_emit::LIBRARY.iter().filter(move |(file, _)| match *file {
        "pe_pkg.vhd" => foreign,
        "pe_style_pkg.vhd" | "pe_ram.vhd" => foreign && stream,
        _ => false,
    })
}

/// Files of a wrapper around a network, or around the shell of a foreign entity, with streams or without. `list` is its file
/// list: a library and a file in each line.
pub fn wrap(map: &Map, list: &str, stream: bool, origin: &Origin) -> Vec<Artefact> {
    let name = &map.entity;
    let description = Wrap::of(map, &origin.generator, Capabilities::of(map, stream));
    let needed = |file: &str| match file {
        "pe_state_port.vhd" => description.capabilities.states,
        "pe_stream.vhd" => stream,
        "pe_output_window.vhd" => map.output_memory.is_some(),
        "pe_parameters.vhd" => description.capabilities.parameters,
        "pe_foreign.vhd" => description.capabilities.foreign,
        "pe_held_input.vhd" => description.capabilities.foreign && !map.inputs.is_empty(),
        "pe_held_output.vhd" => description.capabilities.ready || (description.capabilities.foreign && stream),
        _ => true,
    };
    let parts = foundation(map, stream).chain(LIBRARY.iter().filter(|(file, _)| needed(file)));
    let mut artefacts: Vec<Artefact> =
        parts.map(|(file, text)| Artefact { path: format!("hdl/{file}"), text: (*text).to_owned() }).collect();
    let own: String = list.lines().filter(|line| !line.ends_with("_tb.vhd")).map(|line| format!("{line}\n")).collect();
    let library: String = artefacts.iter().map(|artefact| format!("pe_lib {}\n", artefact.path)).collect();
    // A shell is made of the library; users may call their files as they like.
    let mut files = if map.foreign.is_some() { format!("{library}{list}") } else { own + &library };
    files += &format!("work {name}_axi.vhd\nwork {name}_bus.vhd\n");
    let mut push = |suffix: &str, text: String| {
        artefacts.push(Artefact { path: format!("{name}{suffix}"), text: pe_emit::aligned(text) });
    };
    push("_axi.vhd", top::render(map, &description, origin));
    push("_bus.vhd", bus::vhdl(name, &description, origin));
    push("_bus.cpp", bus::cpp(&description, origin));
    push("_axi.f", files);
    push("_wrap.json", description.text());
    artefacts
}
