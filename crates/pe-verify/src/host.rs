//! The ports for a host, against the simulator: scripts that the design's host test bench carries out, and what it must
//! print.
//!
//! A play begins with other words than the design's, as other starts do, so that a restart shows. States are read at the
//! beginning, in mid-run and after they were replaced; they are replaced by words of the middle of the span and by words
//! made for the hardware, after even and odd numbers of steps; the initial state is brought back. Between these the network
//! runs on, so that a word that went astray shows. For each cause of a flag a play begins so that it is set.

use std::fmt::Write;

use pe_ir::program::{Host, Program, Replaced, Replacement};
use pe_sim::clocked::{Causes, Clocked};
use pe_sim::coverage::Coverage;
use serde_json::{Value, json};

use crate::climb;
use crate::engines::Bench;
use crate::folder::DesignFolder;
use crate::package::{self, InitialWord};
use crate::stimuli::{self, Candidate, Purpose};
use pe_flow::failure::Failure;

/// Steps that words are tried for before a network gets them.
const AHEAD: u64 = 3;

/// What a host does, and what it must see.
pub struct Play {
    name: &'static str,
    /// What differs from the folder's images.
    words: Vec<InitialWord>,
    /// Lines of input words.
    stimulus: String,
    script: String,
    expected: String,
    steps: u64,
}

/// All plays of a folder; none if its network has no ports for a host.
///
/// # Errors
/// [`Failure::Mismatch`] if nothing would be shown; others if the folder cannot be read.
pub fn plays(folder: &DesignFolder) -> Result<Vec<Play>, Failure> {
    let program = &folder.program;
    let host = program.host;
    if host == Host::default() {
        return Ok(Vec::new());
    }
    let mut plays = Vec::new();
    if host.replaces() {
        let (step, words) = folder.checkpoint()?;
        let mut middle = with_states(program, |state| words[state]);
        let begin = match made(program, Purpose::Motion) {
            Some(made) => made,
            None => Candidate { program: middle.clone(), stimulus: folder.stimulus("checkpoint_stimulus")? },
        };
        middle.start_ticks(step);
        let mut author = Author::new("a host", program, begin)?;
        author.states(&middle)?;
        plays.push(author.play());
    }
    if host.flags {
        let seen = Coverage::none(program);
        let begins = [
            ("a host, words at the limits", made(program, Purpose::Saturation)),
            ("a host, operands too large", climb::too_large_operands(program, AHEAD, &seen)),
        ];
        for (name, begin) in begins {
            let Some(begin) = begin else { continue };
            let mut author = Author::new(name, program, begin)?;
            author.flags();
            plays.push(author.play());
        }
    }
    Ok(plays)
}

impl Play {
    /// Plays the host in GHDL.
    ///
    /// # Errors
    /// [`Failure::Mismatch`] if a line is not what the simulator says; others if it cannot be run.
    pub fn judge(&self, bench: &mut Bench) -> Result<(), Failure> {
        let printed = bench.host(&self.words, &self.script, &self.stimulus)?;
        let shown = |line: &&str| ["o ", "s ", "f "].iter().any(|kind| line.starts_with(kind));
        let mut printed = printed.lines().filter(shown);
        let name = self.name;
        for expected in self.expected.lines() {
            let what = match printed.next() {
                Some(line) if line == expected => continue,
                Some(line) => format!("GHDL printed `{line}` for {name}, where the simulator has `{expected}`"),
                None => format!("GHDL printed nothing for {name} in place of `{expected}`"),
            };
            return Err(Failure::Mismatch(what));
        }
        match printed.next() {
            Some(line) => Err(Failure::Mismatch(format!("GHDL printed `{line}` for {name}, which nobody asked for"))),
            None => Ok(()),
        }
    }

    /// Where it starts.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Lines of outputs, states and flags.
    pub fn lines(&self) -> usize {
        self.expected.lines().count()
    }

    /// A line for people.
    pub fn line(&self) -> String {
        let (name, lines, steps) = (self.name, self.lines(), self.steps);
        format!("{:>14} = simulator for {name}: {lines} lines equal, {steps} steps\n", "GHDL")
    }

    /// For tools.
    pub fn json(&self) -> Value {
        json!({"start": self.name, "engine": "GHDL", "steps": self.steps, "lines": self.lines()})
    }
}

/// Writes a play.
struct Author<'a> {
    play: Play,
    program: &'a Program,
    order: Vec<Replacement>,
    inputs: Vec<Vec<i64>>,
    /// The program with the words that the network has now.
    network: Program,
    causes: Causes,
}

impl<'a> Author<'a> {
    fn new(name: &'static str, program: &'a Program, begin: Candidate) -> Result<Author<'a>, Failure> {
        let play = Play {
            name,
            words: package::differences(program, &begin.program),
            stimulus: stimuli::lines(program, &begin.stimulus),
            script: String::new(),
            expected: String::new(),
            steps: 0,
        };
        let order = match program.host.replaces() {
            true => program.replacements().map_err(Failure::Mismatch)?,
            false => Vec::new(),
        };
        let inputs = begin.stimulus;
        Ok(Author { play, program, order, inputs, network: begin.program, causes: Causes::default() })
    }

    fn play(self) -> Play {
        self.play
    }

    /// Restarts, reads and replaces.
    fn states(&mut self, middle: &Program) -> Result<(), Failure> {
        let Host { restart, states, .. } = self.program.host;
        let nothing = |what: &str| Failure::Mismatch(format!("outputs are the same whether a host {what} or not"));
        self.read();
        self.run(2);
        if states {
            self.read();
            self.run(1);
            let mut same = self.write(middle);
            self.read();
            self.run(2);
            if let Some(made) = made(self.program, Purpose::Motion) {
                same &= self.write(&made.program);
                self.run(1);
                self.read();
            }
            self.run(1);
            if same {
                return Err(nothing("replaces states"));
            }
        }
        if restart {
            let same = self.restart();
            self.read();
            self.run(2);
            self.restart();
            self.restart();
            self.run(1);
            if same {
                return Err(nothing("restarts the network"));
            }
        }
        Ok(())
    }

    /// Looks at flags as they rise, clears them, and looks again.
    fn flags(&mut self) {
        self.look();
        self.run(1);
        self.look();
        self.clear();
        self.look();
        self.run(1);
        self.look();
    }

    fn run(&mut self, steps: u64) {
        self.order(format_args!("n {steps}"));
        let begun = self.network.clone();
        let mut network = Clocked::new(&begun);
        let mask = u64::MAX >> (64 - self.program.format.storage_bits);
        for _ in 0..steps {
            network.step(self.inputs_of(self.play.steps), &mut |_| {});
            for (index, word) in network.outputs().iter().enumerate() {
                let (step, word) = (self.play.steps, *word as u64 & mask);
                self.expect(format_args!("o {step} {index} {word:x}"));
            }
            self.play.steps += 1;
        }
        let Causes { saturated, operand, input } = network.causes();
        self.causes.saturated |= saturated;
        self.causes.operand |= operand;
        self.causes.input |= input;
        let words: Vec<i64> = self.program.states.ids().map(|state| network.state(state)).collect();
        self.network = with_states(&begun, |state| words[state]);
        for tick in self.network.inputs.iter_mut().filter_map(|input| input.tick.as_mut()) {
            tick.done = ((u64::from(tick.done) + steps) % u64::from(tick.steps)) as u32;
        }
    }

    fn inputs_of(&self, step: u64) -> &[i64] {
        self.inputs.get(step as usize).or(self.inputs.last()).map_or(&[], Vec::as_slice)
    }

    /// Reads all states and ticks; what they are.
    fn read(&mut self) -> Vec<u64> {
        if !self.program.host.states {
            return Vec::new();
        }
        let bits = (self.program.state_place_bits() + self.program.state_target_bits()).div_ceil(4) as usize;
        let words = self.words();
        let addresses: Vec<u64> = self.order.iter().map(|row| self.program.state_address(row.of)).collect();
        for (address, word) in addresses.iter().zip(&words) {
            self.order(format_args!("g {address:0bits$x}"));
            self.expect(format_args!("s {address:x} {word:x}"));
        }
        words
    }

    /// The words of states and the counts of ticks that the network has.
    fn words(&self) -> Vec<u64> {
        let mask = u64::MAX >> (64 - self.program.format.word_bits());
        let word = |row: &Replacement| match row.of {
            Replaced::State(_, pe, place) => self.network.pes[pe].base_image[usize::from(place)] as u64 & mask,
            Replaced::Tick(tick) => {
                self.network.ticks().nth(tick as usize).map_or(0, |(_, tick, _)| u64::from(tick.done))
            }
        };
        self.order.iter().map(word).collect()
    }

    /// Replaces all states and ticks by those of a program; whether that changes nothing.
    fn write(&mut self, to: &Program) -> bool {
        let same = self.goes_on_alike(to);
        self.network = to.clone();
        let digits = self.program.format.word_bits().div_ceil(4) as usize;
        let words: String = self.words().iter().map(|word| format!(" {word:0digits$x}")).collect();
        self.order(format_args!("w{words}"));
        same
    }

    /// Brings back the initial state; whether that changes nothing.
    fn restart(&mut self) -> bool {
        let same = self.goes_on_alike(self.program);
        self.network = self.program.clone();
        self.order(format_args!("r"));
        same
    }

    /// Whether outputs of the next steps are those that they would be with other words.
    fn goes_on_alike(&self, other: &Program) -> bool {
        let outputs = |program: &Program| {
            let mut network = Clocked::new(program);
            let step = |step| {
                network.step(self.inputs_of(self.play.steps + step), &mut |_| {});
                network.outputs()
            };
            (0..AHEAD).map(step).collect::<Vec<_>>()
        };
        outputs(&self.network) == outputs(other)
    }

    fn look(&mut self) {
        let Causes { saturated, operand, input } = self.causes;
        let [any, saturated, operand, input] = [saturated | operand | input, saturated, operand, input].map(u8::from);
        self.order(format_args!("f"));
        self.expect(format_args!("f {saturated}{operand}{input}{any}"));
    }

    fn clear(&mut self) {
        self.order(format_args!("c"));
        self.causes = Causes::default();
    }

    fn order(&mut self, order: std::fmt::Arguments) {
        writeln!(self.play.script, "{order}").expect("memory takes the order");
    }

    fn expect(&mut self, line: std::fmt::Arguments) {
        writeln!(self.play.expected, "{line}").expect("memory takes the line");
    }
}

/// A program with other words of the states, by their numbers.
fn with_states(program: &Program, word: impl Fn(usize) -> i64) -> Program {
    let mut changed = program.clone();
    for (index, state) in program.states.iter().enumerate() {
        state.set(&mut changed.pes, &program.format, word(index));
    }
    changed
}

/// Words of the states that set much in motion, or saturate, and inputs; none if words would then be out of range of which
/// that was proven impossible.
fn made(program: &Program, purpose: Purpose) -> Option<Candidate> {
    let made = stimuli::choose(program, purpose, 2 * AHEAD, &Coverage::none(program))?;
    let states: Vec<i64> = program.states.iter().map(|state| state.initial(&made.program)).collect();
    let program = with_states(program, |state| states[state]);
    let escapes = stimuli::observe(&program, &made.stimulus, 2 * AHEAD).escaped;
    (!escapes).then_some(Candidate { program, stimulus: made.stimulus })
}
