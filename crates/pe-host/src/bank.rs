//! The register bank of a wrapper in software: what a board shows, over any engine.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pe_map::registers::{Capability, ID, NO_SLACK, REGISTER_VERSION, REGISTERS, Register, Span, Use, Windows};
use pe_map::{Map, Place, wrap};

use crate::bus::{Access, Bus, Op};
use crate::design::{Design, States};
use crate::engine::{Engine, Flags};
use crate::error::Error;
use crate::places::{address, halves, hash_words, mask, masks, whole};

/// The registers of `docs/wrapper.md` over an engine. A run goes on while `STATUS` is read; clocks are those of the schedule.
/// Runs without end, held outputs and single clocks are refused.
pub struct Bank {
    map: Arc<Map>,
    engine: Box<dyn Engine>,
    windows: Windows,
    /// Registers that are read and written as they are, by number.
    registers: Vec<u32>,
    inputs: Vec<u32>,
    parameters: Vec<u32>,
    outputs: Vec<u32>,
    /// Whether every word of the output window can be read.
    defined: Vec<bool>,
    status: u32,
    /// Steps of the run that are left.
    left: u32,
    steps: u64,
    clocks: u64,
    overruns: u32,
    timed: bool,
    /// Upper halves that were kept when the lower ones were read.
    kept: u32,
    state: Vec<i64>,
    /// New state words so far.
    replaced: usize,
}

/// Fields of the status that are flags of the network.
const FLAGS: [&str; 3] = ["SATURATED", "OPERAND", "INPUT"];

impl Bank {
    /// A bank over an engine in its initial state.
    ///
    /// # Errors
    /// Those of the engine.
    pub fn over(design: &Design, engine: Box<dyn Engine>) -> Result<Bank, Error> {
        let map = design.shared_map();
        let windows = wrap::windows(&map);
        let (inputs, outputs) = (Windows::total(&windows.inputs), Windows::total(&windows.outputs));
        let zeros = |count: u32| vec![0; usize::try_from(count).unwrap_or(0)];
        let mut bank = Bank {
            registers: vec![0; REGISTERS.len()],
            inputs: zeros(inputs),
            parameters: Vec::new(),
            outputs: zeros(outputs),
            defined: Vec::new(),
            status: 0,
            left: 0,
            steps: 0,
            clocks: 0,
            overruns: 0,
            timed: false,
            kept: 0,
            state: map.initial_state(),
            replaced: 0,
            windows,
            engine,
            map,
        };
        bank.set("RUN_STEPS", 1);
        bank.begin_parameters();
        bank.show()?;
        Ok(bank)
    }

    fn number(name: &str) -> usize {
        REGISTERS.iter().position(|register| register.name == name).unwrap_or(0)
    }

    fn set(&mut self, name: &str, word: u32) {
        self.registers[Bank::number(name)] = word;
    }

    fn get(&self, name: &str) -> u32 {
        self.registers[Bank::number(name)]
    }

    fn has(&self, needed: Option<Capability>) -> bool {
        match needed {
            None | Some(Capability::Restart | Capability::Flags) => true,
            Some(Capability::States) => self.order().is_some(),
            Some(Capability::Parameters) => !self.windows.parameters.is_empty(),
            Some(_) => false,
        }
    }

    fn order(&self) -> Option<&[Place]> {
        Some(&self.map.host.as_ref()?.access.as_ref()?.order)
    }

    /// Takes the outputs of the engine into the window.
    fn show(&mut self) -> Result<(), Error> {
        let mut words = vec![None; self.map.outputs.len()];
        self.engine.read(&mut words)?;
        let begin = self.windows.outputs.first().map_or(0, |span| span.address);
        self.defined.clear();
        for (span, word) in self.windows.outputs.iter().zip(words) {
            let (at, halves) = (place(begin, span.address), halves(word.unwrap_or(0)));
            let count = usize::try_from(span.words).unwrap_or(0);
            self.outputs[at..at + count].copy_from_slice(&halves[..count]);
            self.defined.resize(at + count, word.is_some());
        }
        Ok(())
    }

    /// Takes the words of the input window.
    fn take_inputs(&mut self) -> Result<(), Error> {
        let begin = self.windows.inputs.first().map_or(0, |span| span.address);
        let word = |(span, input): (&Span, &pe_map::Input)| {
            let at = place(begin, span.address);
            let word = whole(&self.inputs[at..at + usize::try_from(span.words).unwrap_or(0)]);
            // The port has no more bits.
            let unused = 64 - input.format.bits;
            word << unused >> unused
        };
        let words: Vec<i64> = self.windows.inputs.iter().zip(&self.map.inputs).map(word).collect();
        self.engine.write(&words)
    }

    /// The parameter window of the initial state.
    fn begin_parameters(&mut self) {
        let words = self.map.parameters_of(&self.map.initial_state());
        let window = self.windows.parameters.iter().zip(words);
        let count = |span: &Span| usize::try_from(span.words).unwrap_or(0);
        self.parameters = window.flat_map(|(span, word)| halves(word).into_iter().take(count(span))).collect();
    }

    /// Takes the words of the parameter window.
    fn take_parameters(&mut self) -> Result<(), Error> {
        let begin = self.windows.parameters.first().map_or(0, |span| span.address);
        let bits = self.map.states.first().map_or(64, |state| state.format.bits);
        let word = |span: &Span| {
            let at = place(begin, span.address);
            let word = whole(&self.parameters[at..at + usize::try_from(span.words).unwrap_or(0)]);
            word << (64 - bits) >> (64 - bits)
        };
        let words: Vec<i64> = self.windows.parameters.iter().map(word).collect();
        self.engine.set_parameters(&words)
    }

    fn start(&mut self) -> Result<(), Error> {
        self.take_inputs()?;
        let (mode, clocks) = (self.get("MODE"), self.map.clocks_per_step);
        let budget = self.get("CLOCK_BUDGET");
        if budget > 0 && clocks > budget {
            self.status |= masks("STATUS", &["TIME_EXCEEDED", "UNFINISHED", "DONE"]);
            return Ok(());
        }
        let late = mode & mask("MODE", "PACE") != 0 && clocks > self.get("PACE_PERIOD");
        let mut steps = self.get("RUN_STEPS");
        if late && steps > 0 {
            self.status |= mask("STATUS", "OVERRUN");
            steps = if mode & mask("MODE", "CONTINUE") == 0 { 1 } else { steps };
            self.overruns = self.overruns.saturating_add(steps);
        }
        self.left = steps;
        if steps == 0 {
            self.status |= mask("STATUS", "DONE");
        }
        self.advance()
    }

    /// Goes on with the run for a while.
    fn advance(&mut self) -> Result<(), Error> {
        if self.left == 0 || self.get("MODE") & mask("MODE", "ACCESS") != 0 {
            return Ok(());
        }
        let (begin, mut at_once) = (Instant::now(), 1);
        while self.left > 0 && begin.elapsed() < STRETCH {
            let ran = self.engine.run(u64::from(at_once.min(self.left)))?.steps;
            self.left -= at_once.min(self.left);
            self.steps += ran;
            self.clocks = self.clocks.saturating_add(ran.saturating_mul(u64::from(self.map.clocks_per_step)));
            self.timed |= ran > 0;
            at_once = at_once.saturating_mul(2).min(MOST_AT_ONCE);
        }
        if self.left == 0 {
            self.status |= mask("STATUS", "DONE");
        }
        self.show()
    }

    fn restart(&mut self) -> Result<(), Error> {
        self.engine.reset()?;
        (self.status, self.left, self.steps) = (0, 0, 0);
        self.begin_parameters();
        self.clear();
        self.show()
    }

    fn clear(&mut self) {
        (self.clocks, self.overruns, self.timed) = (0, 0, false);
    }

    fn command(&mut self, word: u32) -> Result<(), Error> {
        let asked = |field| word & mask("COMMAND", field) != 0;
        let tunes = asked("PARAMETERS");
        let cannot = tunes && (!self.has(Some(Capability::Parameters)) || asked("RESTART"));
        let stopped = self.get("MODE") & mask("MODE", "ACCESS") != 0 || self.replaced > 0;
        let busy = asked("START") && (self.left > 0 || asked("ABORT") || asked("RESTART"));
        let period = self.get("MODE") & mask("MODE", "PACE") != 0 && self.get("PACE_PERIOD") == 0;
        if cannot || busy || (asked("START") && period) || ((asked("START") || tunes) && stopped) {
            return Err(Error::Refused(address("COMMAND")));
        }
        if asked("ABORT") && self.left > 0 {
            self.left = 0;
            self.status |= masks("STATUS", &["DONE", "ABORTED"]);
        }
        if asked("RESTART") {
            self.restart()?;
        }
        if asked("CLEAR") {
            self.clear();
        }
        if asked("INPUTS") {
            self.take_inputs()?;
        }
        if tunes {
            self.take_parameters()?;
        }
        if asked("START") { self.start() } else { Ok(()) }
    }

    fn access(&self) -> bool {
        self.get("MODE") & mask("MODE", "ACCESS") != 0 && self.replaced == 0
    }

    /// Bits of the status for flags of the engine.
    fn flags(&mut self) -> Result<u32, Error> {
        let flags = self.engine.flags()?;
        let bit = |field, flag| if flags.has(flag) { mask("STATUS", field) } else { 0 };
        Ok(bit("SATURATED", Flags::SATURATED)
            | bit("OPERAND", Flags::OPERAND_TOO_LARGE)
            | bit("INPUT", Flags::INPUT_CLAMPED))
    }

    fn status(&mut self) -> Result<u32, Error> {
        self.advance()?;
        let status = self.status | self.flags()?;
        let bit = |field, condition: bool| if condition { mask("STATUS", field) } else { 0 };
        Ok(status
            | bit("BUSY", self.left > 0)
            | bit("OVERFLOW", status & masks("STATUS", &FLAGS) != 0)
            | bit("OUTPUTS", self.defined.iter().all(|defined| *defined))
            | bit("ACCESS", self.access())
            | bit("STATE_READY", self.get("MODE") & mask("MODE", "ACCESS") != 0)
            | bit("REPLACING", self.replaced > 0))
    }

    /// The next word that replaces a state, and with the last one all of them.
    fn replace(&mut self, low: u32) -> Result<(), Error> {
        let order = self.order().unwrap_or(&[]);
        if self.get("MODE") & mask("MODE", "ACCESS") == 0 {
            return Err(Error::Refused(address("STATE_LOW")));
        }
        let (Some(place), count) = (order.get(self.replaced), order.len()) else { return Ok(()) };
        let at = self.index(place);
        self.state[at] = whole(&[low, self.get("STATE_HIGH")]);
        self.replaced += 1;
        if self.replaced == count {
            self.replaced = 0;
            self.engine.set_state(&self.state)?;
            self.defined.fill(false);
        }
        Ok(())
    }

    fn index(&self, place: &Place) -> usize {
        let tick = |tick: u32| self.map.states.len() + usize::try_from(tick).unwrap_or(0);
        place.state.map_or_else(|| tick(place.tick.unwrap_or(0)), |state| usize::try_from(state).unwrap_or(0))
    }

    fn state_word(&mut self) -> Result<i64, Error> {
        let at = u64::from(self.get("STATE_ADDRESS"));
        let place = self.order().and_then(|order| order.iter().find(|place| place.address == at).cloned());
        let mut words = vec![0; self.state.len()];
        self.engine.state(&mut words)?;
        Ok(place.map_or(0, |place| words[self.index(&place)]))
    }

    /// A number of 64 bits in two registers, the upper half of which is kept while the lower one is read.
    fn pair(&mut self, number: u64) -> u32 {
        let [low, high] = halves(number as i64);
        self.kept = high;
        low
    }

    fn read_register(&mut self, register: &Register) -> Result<u32, Error> {
        let hash = hash_words(&self.map.hash);
        let bits = self.map.states.first().map_or(0, |state| state.format.bits);
        let clocks = self.map.clocks_per_step;
        let slack = self.get("PACE_PERIOD").wrapping_sub(clocks);
        let paced = self.timed && self.get("MODE") & mask("MODE", "PACE") != 0;
        Ok(match register.name {
            "ID" => ID,
            "VERSION" => u32::from(REGISTER_VERSION) | self.map.map_version << 16,
            "HASH_0" => hash[0],
            "HASH_1" => hash[1],
            "HASH_2" => hash[2],
            "HASH_3" => hash[3],
            "CAPS" => {
                let states = if self.has(Some(Capability::States)) { mask("CAPS", "STATES") | bits << 16 } else { 0 };
                let tunable = self.has(Some(Capability::Parameters));
                let tunable = if tunable { mask("CAPS", "PARAMETERS") } else { 0 };
                masks("CAPS", &["RESTART", "FLAGS"]) | self.windows.growth << 8 | states | tunable
            }
            "STEP_CLOCKS" => clocks,
            "STATUS" => self.status()?,
            "STEP_COUNT_LOW" | "OUTPUT_STEP_LOW" => self.pair(self.steps),
            "CLOCK_COUNT_LOW" => self.pair(self.clocks),
            "STEP_COUNT_HIGH" | "CLOCK_COUNT_HIGH" | "OUTPUT_STEP_HIGH" => self.kept,
            "CLOCKS_LAST" | "CLOCKS_MAX" => {
                if self.timed {
                    clocks
                } else {
                    0
                }
            }
            "CLOCKS_MIN" => {
                if self.timed {
                    clocks
                } else {
                    u32::MAX
                }
            }
            "SLACK_MIN" => {
                if paced {
                    slack
                } else {
                    halves(NO_SLACK.into())[0]
                }
            }
            "OVERRUNS" => self.overruns,
            "INPUT_WORDS" => Windows::total(&self.windows.inputs),
            "OUTPUT_WORDS" => Windows::total(&self.windows.outputs),
            "PARAMETER_WORDS" => Windows::total(&self.windows.parameters),
            "STATE_LOW" => halves(self.state_word()?)[0],
            "STATE_HIGH" => halves(self.state_word()?)[1],
            name => self.get(name),
        })
    }

    /// The register at an address, if there is one.
    fn register(&self, address: u32) -> Option<&'static Register> {
        REGISTERS.iter().find(|register| register.address == address && self.has(register.needs))
    }

    /// Place of an address in a window.
    fn in_window(spans: &[Span], address: u32) -> Option<usize> {
        let (first, last) = (spans.first()?, spans.last()?);
        (first.address..last.address + 4 * last.words).contains(&address).then(|| place(first.address, address))
    }
}

/// Time for which a run goes on before somebody else is heard, and most steps between two looks at the clock.
const STRETCH: Duration = Duration::from_millis(5);
const MOST_AT_ONCE: u32 = 256;

fn place(begin: u32, address: u32) -> usize {
    usize::try_from((address - begin) / 4).unwrap_or(0)
}

impl Access for Bank {
    fn read(&mut self, address: u32) -> Result<u32, Error> {
        let refused = Error::Refused(address);
        if !address.is_multiple_of(4) {
            return Err(refused);
        }
        if let Some(register) = self.register(address) {
            return if register.usage == Use::Command { Err(refused) } else { self.read_register(register) };
        }
        if let Some(at) = Bank::in_window(&self.windows.inputs, address) {
            return Ok(self.inputs[at]);
        }
        if let Some(at) = Bank::in_window(&self.windows.parameters, address) {
            return Ok(self.parameters[at]);
        }
        let at = Bank::in_window(&self.windows.outputs, address).filter(|at| self.defined[*at]);
        at.map(|at| self.outputs[at]).ok_or(refused)
    }

    fn write(&mut self, address: u32, word: u32) -> Result<(), Error> {
        let refused = Error::Refused(address);
        if !address.is_multiple_of(4) {
            return Err(refused);
        }
        if let Some(at) = Bank::in_window(&self.windows.inputs, address) {
            self.inputs[at] = word;
            return Ok(());
        }
        if let Some(at) = Bank::in_window(&self.windows.parameters, address) {
            self.parameters[at] = word;
            return Ok(());
        }
        let written = |register: &&Register| !matches!(register.usage, Use::Read | Use::ReadForeign);
        let register = self.register(address).filter(written).ok_or(refused.clone())?;
        match register.name {
            "COMMAND" => self.command(word),
            "STATUS" => {
                // An engine clears its flags together; those that a host leaves stay here.
                if word & masks("STATUS", &FLAGS) != 0 {
                    self.status |= self.flags()?;
                    self.engine.clear_flags()?;
                }
                let cleared = register.fields.iter().filter(|field| field.clears).map(pe_map::registers::Field::mask);
                self.status &= !(word & cleared.fold(0, |all, bits| all | bits));
                Ok(())
            }
            "STATE_LOW" => self.replace(word),
            "MODE" if word & !masks("MODE", &["PACE", "CONTINUE", "ACCESS"]) != 0 => Err(refused),
            "SINGLE_CLOCKS" => Err(refused),
            name => {
                self.set(name, word);
                Ok(())
            }
        }
    }
}

impl Bus for Bank {
    fn transact(&mut self, ops: &[Op], words: &mut Vec<u32>) -> Result<(), Error> {
        self.carry_out(ops, words)
    }
}
