//! The shell of a foreign entity: constants and wiring that give it the handshake of a network.

use askama::Template;
use pe_emit::comment_text;

use super::entity::PortType;
use super::map::Role;
use super::plan::{Part, Plan, Planned, shell_name};
use crate::Origin;

#[derive(Template)]
#[template(path = "foreign.vhd")]
struct Shell<'a> {
    generator: &'a str,
    command: &'a str,
    shell: String,
    comment: String,
    entity: &'a str,
    architecture: &'a str,
    /// Whether a port is `signed` or `unsigned`, and of which package.
    arithmetic: bool,
    package: &'a str,
    reset_clocks: u32,
    resets: bool,
    ready: bool,
    /// Whether outputs may change before a host has read them.
    held: bool,
    /// Signals of the handshake that the entity takes or gives at the other level.
    inverted: Vec<&'static str>,
    inputs: Vec<Word>,
    outputs: Vec<Word>,
    constants: Vec<Constant>,
    generics: &'a [(String, String)],
    /// Formal and actual of each port.
    ports: Vec<(String, String)>,
}

/// A port of data.
struct Word {
    identifier: String,
    comment: String,
    bits: u32,
    /// Bits of the words of hosts.
    wide: u32,
    every: u32,
    /// Type of the signal at the port.
    vhdl_type: String,
    /// What is assigned to the port, or is shown by it.
    converted: String,
    /// Where an output is shown.
    shown: String,
}

/// An input that is tied.
struct Constant {
    signal: String,
    comment: String,
    vhdl_type: String,
    /// Slices and their values.
    parts: Vec<(String, String)>,
}

/// Bits of a constant that GHDL 2.0 writes as a number into Verilog.
const SLICE: usize = 32;

fn vhdl_type(of: PortType, bits: u32) -> String {
    let range = format!("({} downto 0)", bits.max(1) - 1);
    match of {
        PortType::Bit => "std_ulogic".to_owned(),
        PortType::Vector => format!("std_ulogic_vector{range}"),
        PortType::Signed => format!("signed{range}"),
        PortType::Unsigned => format!("unsigned{range}"),
    }
}

fn word(port: &Planned, data: &super::plan::Data) -> Word {
    let identifier = data.identifier.clone();
    let (own, at_port) = (format!("{identifier}_word"), format!("{identifier}_port"));
    let converted = match (port.of, data.input) {
        (PortType::Bit, true) => format!("{own}(0)"),
        (PortType::Vector, true) => own,
        (PortType::Signed, true) => format!("signed({own})"),
        (PortType::Unsigned, true) => format!("unsigned({own})"),
        (PortType::Bit | PortType::Vector, false) => at_port,
        (_, false) => format!("std_ulogic_vector({at_port})"),
    };
    let shown = format!("{identifier}_shown{}", if port.of == PortType::Bit { "(0)" } else { "" });
    Word {
        comment: comment_text(&port.name),
        bits: port.bits,
        wide: port.bits + u32::from(!data.signed),
        every: data.every,
        vhdl_type: vhdl_type(port.of, port.bits),
        converted,
        shown,
        identifier,
    }
}

fn constant(port: &Planned, bits: &str, number: usize) -> Constant {
    let signal = format!("constant_{number}");
    let slice = |number: usize| {
        let (low, high) = (number * SLICE, ((number + 1) * SLICE).min(bits.len()));
        let digits = &bits[bits.len() - high..bits.len() - low];
        (format!("{signal}({} downto {low})", high - 1), format!("\"{digits}\""))
    };
    let parts = match port.of {
        PortType::Bit => vec![(signal.clone(), format!("'{bits}'"))],
        _ => (0..bits.len().div_ceil(SLICE)).map(slice).collect(),
    };
    Constant { signal, comment: comment_text(&port.name), parts, vhdl_type: vhdl_type(port.of, port.bits) }
}

fn signal(role: Role) -> &'static str {
    match role {
        Role::ClockEnable => "enable",
        Role::Reset => "reset",
        Role::Start => "start",
        _ => "ready",
    }
}

/// The text of `NAME_step.vhd`.
pub fn render(plan: &Plan, stream: bool, origin: &Origin) -> String {
    let foreign = plan.map.foreign.as_ref().expect("it is the map of a foreign entity");
    let mut shell = Shell {
        generator: &origin.generator,
        command: &origin.command,
        shell: shell_name(&plan.name),
        comment: comment_text(&foreign.entity),
        entity: &foreign.entity,
        architecture: &foreign.architecture,
        arithmetic: plan
            .ports
            .iter()
            .any(|port| matches!(port.of, PortType::Signed | PortType::Unsigned) && !matches!(port.part, Part::Open)),
        package: plan.arithmetic,
        reset_clocks: plan.reset_clocks,
        resets: plan.reset_clocks > 0,
        ready: foreign.ready,
        held: foreign.ready || stream,
        inverted: Vec::new(),
        inputs: Vec::new(),
        outputs: Vec::new(),
        constants: Vec::new(),
        generics: &plan.generics,
        ports: Vec::new(),
    };
    for port in &plan.ports {
        let actual = match &port.part {
            Part::Clock => "clk_i".to_owned(),
            Part::Control(role, low) => {
                let own = signal(*role);
                if *low {
                    shell.inverted.push(own);
                }
                format!("{own}{}", if *low { "_n" } else { "" })
            }
            Part::Data(data) => {
                let words = if data.input { &mut shell.inputs } else { &mut shell.outputs };
                words.push(word(port, data));
                format!("{}_port", data.identifier)
            }
            Part::Constant(bits) => {
                let constant = constant(port, bits, shell.constants.len());
                let signal = constant.signal.clone();
                shell.constants.push(constant);
                signal
            }
            Part::Open => "open".to_owned(),
        };
        shell.ports.push((port.name.clone(), actual));
    }
    shell.render().expect("templates render into strings")
}
