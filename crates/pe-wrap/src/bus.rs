//! The bus master of simulations, in GHDL and in Verilator.

use askama::Template;
use pe_map::wrap::Wrap;

use crate::Origin;

/// Clocks after which a bus master says that there is no frame.
const STREAM_PATIENCE: u32 = 100_000;

#[derive(Template)]
#[template(path = "bus.vhd")]
struct Vhdl<'a> {
    generator: &'a str,
    command: &'a str,
    name: &'a str,
    entity: &'a str,
    address_bits: u32,
    stream: bool,
    stream_patience: u32,
}

#[derive(Template)]
#[template(path = "bus.cpp")]
struct Cpp<'a> {
    generator: &'a str,
    command: &'a str,
    entity: &'a str,
    address_mask: String,
    stream: bool,
    stream_patience: u32,
}

/// The text of `NAME_bus.vhd`; `name` is what file names begin with.
pub fn vhdl(name: &str, wrap: &Wrap, origin: &Origin) -> String {
    let Origin { generator, command } = origin;
    let Wrap { entity, address_bits, capabilities, .. } = wrap;
    let bus = Vhdl {
        generator,
        command,
        name,
        entity,
        address_bits: *address_bits,
        stream: capabilities.stream,
        stream_patience: STREAM_PATIENCE,
    };
    bus.render().expect("templates render into strings")
}

/// The text of `NAME_bus.cpp`.
pub fn cpp(wrap: &Wrap, origin: &Origin) -> String {
    let Origin { generator, command } = origin;
    let address_mask = format!("0x{:x}u", (1_u64 << wrap.address_bits) - 1);
    let bus = Cpp {
        generator,
        command,
        entity: &wrap.entity,
        address_mask,
        stream: wrap.capabilities.stream,
        stream_patience: STREAM_PATIENCE,
    };
    bus.render().expect("templates render into strings")
}
