//! Writes wrappers: a network behind a bus, with registers for inputs, outputs and control, and a bus master that hosts
//! talk to in a simulation.
//!
//! In: the [`Map`] of a design. Out: files, deterministic, with paths relative to the design's folder. Hand-written VHDL
//! goes along unchanged; what is generated holds constants and wiring only. The registers are those of
//! [`pe_map::registers`].

mod bus;
mod package;
mod top;

pub use package::constants;

use pe_emit::Artefact;
use pe_map::Map;
use pe_map::wrap::{Capabilities, Wrap};

/// The hand-written VHDL of wrappers, in compile order, behind that of the network: file name and text.
pub const LIBRARY: [(&str, &str); 8] = [
    ("pe_register_pkg.vhd", include_str!("../../../hdl/pe_register_pkg.vhd")),
    ("pe_axi_lite.vhd", include_str!("../../../hdl/pe_axi_lite.vhd")),
    ("pe_registers.vhd", include_str!("../../../hdl/pe_registers.vhd")),
    ("pe_windows.vhd", include_str!("../../../hdl/pe_windows.vhd")),
    ("pe_state_port.vhd", include_str!("../../../hdl/pe_state_port.vhd")),
    ("pe_stream.vhd", include_str!("../../../hdl/pe_stream.vhd")),
    ("pe_synchronizer.vhd", include_str!("../../../hdl/pe_synchronizer.vhd")),
    ("pe_counters.vhd", include_str!("../../../hdl/pe_counters.vhd")),
];

/// What the files tell about their origin.
#[derive(Clone, Debug)]
pub struct Origin {
    /// `pe-synth` and its version.
    pub generator: String,
    /// Command for the `Regenerate:` lines.
    pub command: String,
}

/// Files of a wrapper around a network, with streams or without. `list` is the network's file list: a library and a file in
/// each line.
pub fn wrap(map: &Map, list: &str, stream: bool, origin: &Origin) -> Vec<Artefact> {
    let name = &map.entity;
    let description = Wrap::of(map, &origin.generator, Capabilities::of(map, stream));
    let needed = |file: &str| match file {
        "pe_state_port.vhd" => description.capabilities.states,
        "pe_stream.vhd" => stream,
        _ => true,
    };
    let library = LIBRARY.iter().filter(|(file, _)| needed(file));
    let mut artefacts: Vec<Artefact> =
        library.map(|(file, text)| Artefact { path: format!("hdl/{file}"), text: (*text).to_owned() }).collect();
    let mut files: String =
        list.lines().filter(|line| !line.ends_with("_tb.vhd")).map(|line| format!("{line}\n")).collect();
    files.extend(artefacts.iter().map(|artefact| format!("pe_lib {}\n", artefact.path)));
    files += &format!("work {name}_axi.vhd\nwork {name}_bus.vhd\n");
    let mut push = |suffix: &str, text: String| {
        artefacts.push(Artefact { path: format!("{name}{suffix}"), text: pe_emit::aligned(text) });
    };
    push("_axi.vhd", top::render(map, &description, origin));
    push("_bus.vhd", bus::vhdl(&description, origin));
    push("_bus.cpp", bus::cpp(&description, origin));
    push("_axi.f", files);
    push("_wrap.json", description.text());
    artefacts
}
