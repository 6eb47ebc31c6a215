//! How a host reaches what a network offers it: names of the ports, and the order in which states are replaced.

use pe_ir::index::at;
use pe_ir::program::{Host, Program, Replaced, Replacement};
use pe_map::{Access, Flags, HostPorts, Place};

use crate::names::comment_text;
use crate::program_pkg::{lines, push_binary};

/// The order of states as the program package has it, for programs that replace any.
pub(crate) struct Order {
    /// Low bits of an address: the base word.
    pub place_bits: u32,
    /// Bits of an address.
    pub address_bits: u32,
    /// Bits of a row.
    pub bits: u32,
    /// Last row.
    pub last: usize,
    /// Whether rows have initial words.
    pub initial: bool,
    /// The rows, as elements of an array.
    pub words: String,
}

impl Order {
    /// # Panics
    /// If a word cannot be replaced, see [`Program::replacements`].
    pub fn of(program: &Program) -> Order {
        let rows = replacements(program);
        let widths = program.row_bits();
        let ticks: Vec<u32> = program.ticks().map(|(input, ..)| input).collect();
        let name = |row: &Replacement| match row.of {
            Replaced::State(state, ..) => &program.states[state].name,
            Replaced::Tick(tick) => &program.inputs[at(ticks[at(tick)])].name,
        };
        let fields = |text: &mut String, row: usize| {
            let fields = program.row(&rows[row]).into_iter().zip(widths).filter(|(_, bits)| *bits > 0);
            for (number, (field, bits)) in fields.enumerate() {
                text.push_str(if number > 0 { "_" } else { "" });
                push_binary(text, field, bits);
            }
        };
        let place_bits = program.state_place_bits();
        Order {
            place_bits,
            address_bits: place_bits + program.state_target_bits(),
            bits: widths.iter().sum(),
            last: rows.len().max(1) - 1,
            initial: program.host.restart,
            words: lines(rows.len(), fields, |text, row| text.push_str(&comment_text(name(&rows[row])))),
        }
    }
}

fn replacements(program: &Program) -> Vec<Replacement> {
    program.replacements().unwrap_or_else(|reason| panic!("{reason}"))
}

/// Names of the ports, and the order of states.
pub(crate) fn ports(program: &Program) -> HostPorts {
    let Host { restart, states, flags } = program.host;
    let port = |name: &str| name.to_owned();
    let place = |row: &Replacement| {
        let (state, tick) = match row.of {
            Replaced::State(state, ..) => (Some(state.number()), None),
            Replaced::Tick(tick) => (None, Some(tick)),
        };
        Place { state, tick, address: program.state_address(row.of) }
    };
    let access = || Access {
        request: port("access_i"),
        granted: port("access_o"),
        address: port("state_address_i"),
        address_bits: program.state_place_bits() + program.state_target_bits(),
        word: port("state_o"),
        new_word: port("state_i"),
        valid: port("state_valid_i"),
        ready: port("state_ready_o"),
        order: replacements(program).iter().map(place).collect(),
    };
    let flag_ports = || Flags {
        clear: port("clear_i"),
        saturated: port("saturated_o"),
        operand: port("operand_o"),
        input: port("input_o"),
    };
    HostPorts {
        restart: restart.then(|| port("restart_i")),
        access: states.then(access),
        flags: flags.then(flag_ports),
    }
}

/// The names alone.
pub(crate) fn port_names(program: &Program) -> Vec<String> {
    let HostPorts { restart, access, flags } = ports(program);
    let access = access.map(|access| {
        let Access { request, granted, address, word, new_word, valid, ready, .. } = access;
        [request, granted, address, word, new_word, valid, ready]
    });
    let flags = flags.map(|Flags { clear, saturated, operand, input }| [clear, saturated, operand, input]);
    restart.into_iter().chain(access.into_iter().flatten()).chain(flags.into_iter().flatten()).collect()
}
