//! The ports for a host, against the simulator: a script of orders that the design's host test bench carries out, and
//! what it must print.
//!
//! States are read at the beginning, in mid-run and after they were replaced; they are replaced by words of the middle of
//! the span and by words made for the hardware, after even and odd numbers of steps; the initial state is brought back;
//! flags are looked at and cleared. Between these the network runs on, so that a word that went astray shows.

use std::fmt::Write;

use pe_ir::index::at;
use pe_ir::program::{Program, Replaced, Replacement};
use pe_sim::coverage::Coverage;
use pe_sim::machine::{Flags, Machine};
use serde_json::{Value, json};

use crate::engines::Bench;
use crate::folder::DesignFolder;
use crate::stimuli::{self, Purpose};
use pe_flow::failure::Failure;

/// Steps that words are tried for before a network gets them.
const AHEAD: u64 = 3;

/// What the host does, and what it must see.
struct Play<'a> {
    program: &'a Program,
    order: Vec<Replacement>,
    stimulus: Vec<Vec<i64>>,
    script: String,
    expected: String,
    /// Steps so far.
    finished: u64,
    flags: Flags,
}

/// A network that a host plays with: the program with the words that it began with.
struct Network {
    program: Program,
}

/// What was compared.
pub struct Played {
    /// Lines of outputs, states and flags.
    pub lines: usize,
    /// Steps.
    pub steps: u64,
}

impl Played {
    /// A line for people.
    pub fn line(&self, program: &Program) -> String {
        let ports = program.host.names().collect::<Vec<_>>().join(", ");
        format!("{:>14} = simulator for a host ({ports}): {} lines equal, {} steps\n", "GHDL", self.lines, self.steps)
    }

    /// For tools.
    pub fn json(&self, program: &Program) -> Value {
        let ports: Vec<&str> = program.host.names().collect();
        json!({"start": "a host", "engine": "GHDL", "steps": self.steps, "ports": ports, "lines": self.lines})
    }
}

/// Plays the host of a folder in GHDL.
///
/// # Errors
/// [`Failure::Mismatch`] if a line is not what the simulator says, or if no state moves; others if it cannot be run.
pub fn judge(folder: &DesignFolder, bench: &mut Bench) -> Result<Played, Failure> {
    let program = &folder.program;
    let order = program.replacements().map_err(|state| {
        Failure::Mismatch(format!("a step does not write state `{state}` exactly once, so nothing can replace it"))
    })?;
    let mut play = Play {
        program,
        order,
        stimulus: folder.stimulus("stimulus")?,
        script: String::new(),
        expected: String::new(),
        finished: 0,
        flags: Flags::default(),
    };
    play.all(&folder.checkpoint()?)?;
    let printed = bench.host(&play.script)?;
    let shown = |line: &&str| ["o ", "s ", "f "].iter().any(|kind| line.starts_with(kind));
    let mut lines = 0;
    let mut printed = printed.lines().filter(shown);
    for expected in play.expected.lines() {
        match printed.next() {
            Some(line) if line == expected => lines += 1,
            Some(line) => {
                let what = format!("GHDL printed `{line}` for a host, where the simulator has `{expected}`");
                return Err(Failure::Mismatch(what));
            }
            None => return Err(Failure::Mismatch(format!("GHDL printed nothing for a host in place of `{expected}`"))),
        }
    }
    if let Some(line) = printed.next() {
        return Err(Failure::Mismatch(format!("GHDL printed `{line}` for a host, which nobody asked for")));
    }
    Ok(Played { lines, steps: play.finished })
}

impl Play<'_> {
    fn all(&mut self, checkpoint: &(u64, Vec<i64>)) -> Result<(), Failure> {
        let host = self.program.host;
        let mut network = Network { program: self.program.clone() };
        let mut at_rest = true;
        let before = self.read(&network);
        self.run(&mut network, 2);
        if host.states {
            let words = self.read(&network);
            at_rest = words == before;
            self.run(&mut network, 1);
            self.write(&mut network, &middle(self.program, checkpoint));
            at_rest &= self.read(&network) == before;
            self.run(&mut network, 2);
            if let Some(made) = self.made(Purpose::Motion) {
                self.write(&mut network, &made);
                self.run(&mut network, 1);
                self.read(&network);
            }
            self.run(&mut network, 1);
        }
        if host.restart {
            self.restart(&mut network);
            self.read(&network);
            self.run(&mut network, 2);
            self.restart(&mut network);
            self.restart(&mut network);
            self.run(&mut network, 1);
        }
        self.look();
        self.clear();
        self.look();
        if host.flags
            && host.states
            && let Some(made) = self.made(Purpose::Saturation)
        {
            self.write(&mut network, &made);
            self.run(&mut network, 2);
            self.look();
            self.clear();
            self.look();
        }
        match at_rest && host.states {
            true => Err(Failure::Mismatch("a host sees no state move, so that nothing is shown of its ports".into())),
            false => Ok(()),
        }
    }

    /// The program with words that set much in motion, or saturate; none if the next steps would then show words out of
    /// range where that was proven impossible, or sums of operands that wrap, of which the simulator knows the flag alone.
    fn made(&self, purpose: Purpose) -> Option<Program> {
        let seen = Coverage::none(self.program);
        let made = stimuli::choose(self.program, purpose, AHEAD, &seen)?.program;
        let mut program = self.program.clone();
        for state in &self.program.states {
            let (pe, address) = state.own;
            let pe = &made.pes[pe];
            state.set(&mut program.pes, &program.format, pe.base_image[pe.features.base_word(address)]);
        }
        let mut machine = Machine::new(&program);
        (0..AHEAD).for_each(|step| machine.step(self.inputs(self.finished + step), &mut |_| {}));
        let is_known = !machine.escaped() && !machine.flags().operand;
        is_known.then_some(program)
    }

    fn run(&mut self, network: &mut Network, steps: u64) {
        writeln!(self.script, "n {steps}").expect("memory takes the order");
        let mut machine = Machine::new(&network.program);
        let mask = u64::MAX >> (64 - self.program.format.storage_bits);
        for _ in 0..steps {
            machine.step(self.inputs(self.finished), &mut |_| {});
            for (index, word) in machine.outputs().iter().enumerate() {
                let word = *word as u64 & mask;
                writeln!(self.expected, "o {} {index} {word:x}", self.finished).expect("memory takes the line");
            }
            self.finished += 1;
        }
        self.flags = self.flags | machine.flags();
        let words: Vec<i64> = self.program.states.ids().map(|state| machine.state(state)).collect();
        network.go_on(&words, steps);
    }

    fn inputs(&self, step: u64) -> &[i64] {
        &self.stimulus[(step as usize).min(self.stimulus.len() - 1)]
    }

    /// Reads all states and ticks; what they are.
    fn read(&mut self, network: &Network) -> Vec<u64> {
        if !self.program.host.states {
            return Vec::new();
        }
        let bits = (self.program.state_place_bits() + self.program.state_target_bits()).div_ceil(4) as usize;
        let words: Vec<u64> = self.order.iter().map(|row| network.word(row)).collect();
        for (row, word) in self.order.iter().zip(&words) {
            let address = self.program.state_address(row.of);
            writeln!(self.script, "g {address:0bits$x}").expect("memory takes the order");
            writeln!(self.expected, "s {address:x} {word:x}").expect("memory takes the line");
        }
        words
    }

    /// Replaces all states and ticks by those of a program.
    fn write(&mut self, network: &mut Network, program: &Program) {
        *network = Network { program: program.clone() };
        let digits = self.program.format.word_bits().div_ceil(4) as usize;
        let words = self.order.iter().map(|row| format!(" {:0digits$x}", network.word(row)));
        writeln!(self.script, "w{}", words.collect::<String>()).expect("memory takes the order");
    }

    fn restart(&mut self, network: &mut Network) {
        *network = Network { program: self.program.clone() };
        self.script.push_str("r\n");
    }

    fn look(&mut self) {
        if self.program.host.flags {
            let Flags { saturated, operand, input } = self.flags;
            self.script.push_str("f\n");
            self.expected.push_str("f ");
            let bits = [saturated, operand, input, saturated | operand | input].map(u8::from);
            bits.iter().for_each(|bit| self.expected.push_str(&bit.to_string()));
            self.expected.push('\n');
        }
    }

    fn clear(&mut self) {
        if self.program.host.flags {
            self.script.push_str("c\n");
            self.flags = Flags::default();
        }
    }
}

impl Network {
    /// The word of a state, or the count of a tick, as the hardware has it.
    fn word(&self, row: &Replacement) -> u64 {
        let mask = u64::MAX >> (64 - self.program.format.word_bits());
        match row.of {
            Replaced::State(_, pe, place) => self.program.pes[pe].base_image[usize::from(place)] as u64 & mask,
            Replaced::Tick(tick) => {
                let (_, tick, _) = self.program.ticks().nth(at(tick)).expect("ticks are numbered");
                u64::from(tick.done)
            }
        }
    }

    /// Begins with these words, so many steps later.
    fn go_on(&mut self, words: &[i64], steps: u64) {
        let program = &mut self.program;
        for (state, word) in program.states.iter().zip(words) {
            state.set(&mut program.pes, &program.format, *word);
        }
        for tick in program.inputs.iter_mut().filter_map(|input| input.tick.as_mut()) {
            tick.done = ((u64::from(tick.done) + steps) % u64::from(tick.steps)) as u32;
        }
    }
}

/// The program with the words of the middle of the span.
fn middle(program: &Program, (step, words): &(u64, Vec<i64>)) -> Program {
    let mut program = program.clone();
    for (state, word) in program.states.iter().zip(words) {
        state.set(&mut program.pes, &program.format, *word);
    }
    program.start_ticks(*step);
    program
}
