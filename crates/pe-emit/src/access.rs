//! How a host reaches the states: addresses to read them, and the order in which they are replaced.

use std::fmt::Write;

use pe_ir::index::{at, number};
use pe_ir::program::{Program, Replaced, Replacement, index_bits};

use crate::names::comment_text;

/// Places of the states, for programs that replace any.
pub(crate) struct Access {
    /// Low bits of an address: the base word.
    pub place_bits: u32,
    /// Bits of an address.
    pub address_bits: u32,
    /// Bits of a row of the order.
    pub bits: u32,
    /// Last row.
    pub last: usize,
    /// Whether rows have initial words.
    pub initial: bool,
    /// The rows, as elements of an array.
    pub words: String,
}

impl Access {
    /// # Panics
    /// If a step does not write each state once, see [`Program::replacements`].
    pub fn of(program: &Program) -> Access {
        let rows = replacements(program);
        let pes = number(program.pes.len());
        let place_bits = program.state_place_bits();
        let target_bits = program.state_target_bits();
        let word_bits = index_bits(program.period).max(1);
        let initial_bits = if program.host.restart { program.format.word_bits() } else { 0 };
        let bits = initial_bits + target_bits + word_bits;
        let mut words = String::new();
        let last = rows.len() - 1;
        for (index, row) in rows.iter().enumerate() {
            let (target, name) = match row.of {
                Replaced::State(state, pe, _) => (pe.number(), &program.states[state].name),
                Replaced::Tick(tick) => (pes + tick, &program.inputs[at(tick_input(program, tick))].name),
            };
            let (target_bits, word_bits) = (target_bits as usize, word_bits as usize);
            write!(words, "\n    {index} => b\"").expect("memory takes the row");
            if initial_bits > 0 {
                let word = row.initial as u64 & (u64::MAX >> (64 - initial_bits));
                write!(words, "{word:0width$b}_", width = initial_bits as usize).expect("memory takes the row");
            }
            let comma = if index == last { " " } else { "," };
            write!(words, "{target:0target_bits$b}_{:0word_bits$b}\"{comma} -- {}", row.word, comment_text(name))
                .expect("memory takes the row");
        }
        Access { place_bits, address_bits: place_bits + target_bits, bits, last, initial: program.host.restart, words }
    }
}

/// The order of replacements, of programs that have one.
pub(crate) fn replacements(program: &Program) -> Vec<Replacement> {
    program.replacements().unwrap_or_else(|state| panic!("a step does not write state `{state}` exactly once"))
}

/// Number among the inputs of a tick.
pub(crate) fn tick_input(program: &Program, tick: u32) -> u32 {
    program.ports().count() as u32 + tick
}
