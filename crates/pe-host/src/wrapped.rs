//! A network behind a wrapper's registers.

mod frames;

use std::sync::Arc;
use std::time::{Duration, Instant};

use pe_map::registers::{ID, REGISTER_VERSION, Span, Windows};
use pe_map::{Map, Place, wrap};

use crate::bus::{Bus, Op};
use crate::design::{Design, States, count};
use crate::engine::{Counters, Engine, Flags, Limits, Ran};
use crate::error::Error;
use crate::places::{address, halves, hash_words, mask, masks, part, whole};

/// Clocks, beside those of the step, after which nothing more is expected of a simulated network.
const SPARE_CLOCKS: u64 = 1_000;

/// Clocks that a simulation is asked for at once: what hangs is to be noticed.
const STRETCH: u32 = 2_048;

/// Clocks in which a stored word is read and written again, as new parameters are taken to the network.
const CLOCKS_PER_STORED_WORD: u32 = 16;

/// A network behind the registers of `docs/wrapper.md`.
pub struct Wrapped {
    map: Arc<Map>,
    bus: Box<dyn Bus>,
    windows: Windows,
    timeout: Duration,
    places: Places,
    has: Capabilities,
    step_clocks: u32,
    limits: Limits,
    /// Steps of a run as the register has them.
    run_steps: u32,
    stepped: bool,
    /// The state words that were set last, until a step.
    set: Option<Vec<i64>>,
    ops: Vec<Op>,
    words: Vec<u32>,
}

/// What is used in every step.
struct Places {
    command: u32,
    status: u32,
    run_steps: u32,
    start: u32,
    /// Bits of the status that are cleared before a run.
    ends: u32,
    time_exceeded: u32,
    overrun: u32,
}

#[derive(Clone, Copy)]
struct Capabilities {
    restart: bool,
    states: bool,
    flags: bool,
    parameters: bool,
    stream: bool,
}

impl Wrapped {
    /// The network behind a bus, in its initial state.
    ///
    /// # Errors
    /// [`Error::Foreign`] if there are no registers of a wrapper, [`Error::WrongHash`] if it is another design,
    /// [`Error::Lacks`] if steps were done already and there is no restart; those of the bus.
    pub fn open(design: &Design, bus: Box<dyn Bus>, timeout: Duration) -> Result<Wrapped, Error> {
        let map = design.shared_map();
        let places = Places {
            command: address("COMMAND"),
            status: address("STATUS"),
            run_steps: address("RUN_STEPS"),
            start: mask("COMMAND", "START"),
            ends: masks("STATUS", &["DONE", "TIME_EXCEEDED", "OVERRUN", "ABORTED"]),
            time_exceeded: mask("STATUS", "TIME_EXCEEDED"),
            overrun: mask("STATUS", "OVERRUN"),
        };
        let mut wrapped = Wrapped {
            windows: wrap::windows(&map),
            map,
            bus,
            timeout,
            places,
            has: Capabilities { restart: false, states: false, flags: false, parameters: false, stream: false },
            step_clocks: 0,
            limits: Limits::default(),
            run_steps: 0,
            stepped: false,
            set: None,
            ops: Vec::new(),
            words: Vec::new(),
        };
        wrapped.identify()?;
        wrapped.begin()?;
        Ok(wrapped)
    }

    /// The bus, which others may use from now on.
    pub fn into_bus(self) -> Box<dyn Bus> {
        self.bus
    }

    /// Whether the registers are those of this design.
    fn identify(&mut self) -> Result<(), Error> {
        let names = ["ID", "VERSION", "HASH_0", "HASH_1", "HASH_2", "HASH_3", "CAPS", "STEP_CLOCKS"];
        // Another device may have nothing at the other addresses.
        let [id] = self.read_registers(["ID"])?;
        if id != ID {
            return Err(Error::Foreign(format!(
                "there is no wrapper of a network: its first register reads {id:#010x}"
            )));
        }
        let [_, version, hash @ .., caps, step_clocks] = self.read_registers(names)?;
        let version = part("VERSION", "REGISTERS", version);
        if version != u32::from(REGISTER_VERSION) {
            let what = format!("the wrapper has registers of version {version}, this program needs {REGISTER_VERSION}");
            return Err(Error::Foreign(what));
        }
        if hash != hash_words(&self.map.hash) {
            let found = hash.iter().map(|word| format!("{word:08x}")).collect();
            return Err(Error::WrongHash { expected: self.map.hash.clone(), found });
        }
        let has = |field| part("CAPS", field, caps) == 1;
        if has("FOREIGN") != self.map.foreign.is_some() {
            let what = if has("FOREIGN") { "a foreign entity" } else { "a network" };
            return Err(Error::Foreign(format!("the wrapper is that of {what}, which the map is not of")));
        }
        let [restart, states, flags, parameters, stream] =
            ["RESTART", "STATES", "FLAGS", "PARAMETERS", "STREAM"].map(has);
        self.has = Capabilities { restart, states, flags, parameters, stream };
        // A foreign entity may take any time; its map says what is expected.
        if step_clocks != self.map.clocks_per_step && self.map.foreign.is_none() {
            let what = format!("a step of {step_clocks} clocks in place of {}", self.map.clocks_per_step);
            return Err(Error::Foreign(format!("the wrapper tells of {what}")));
        }
        self.step_clocks = step_clocks.max(self.map.clocks_per_step);
        Ok(())
    }

    /// The initial state, whatever another host left behind.
    fn begin(&mut self) -> Result<(), Error> {
        self.transact(&[Op::Write(address("MODE"), 0), Op::Write(self.places.command, mask("COMMAND", "ABORT"))])?;
        self.await_status(mask("STATUS", "BUSY"), false, self.step_clocks, "does not end its run")?;
        if self.has.restart {
            self.transact(&[Op::Write(self.places.command, mask("COMMAND", "RESTART"))])?;
            self.await_status(mask("STATUS", "BUSY"), false, self.step_clocks.saturating_mul(4), "does not restart")?;
        } else if self.steps()? > 0 {
            if !self.bus.renew()? {
                return Err(Error::Lacks("restart"));
            }
            self.identify()?;
        }
        self.run_steps = 1;
        self.transact(&[Op::Write(self.places.run_steps, 1), Op::Write(self.places.status, self.places.ends)])?;
        if let Some(clocks) = self.map.foreign.as_ref().map(|foreign| foreign.step_clocks) {
            self.transact(&[Op::Write(address("STEP_CLOCKS"), clocks)])?;
            self.step_clocks = self.map.clocks_per_step;
        }
        (self.stepped, self.set) = (false, None);
        self.limit(&self.limits.clone())?;
        if self.has.flags { self.clear_flags() } else { Ok(()) }
    }

    fn transact(&mut self, ops: &[Op]) -> Result<(), Error> {
        self.words.clear();
        self.bus.transact(ops, &mut self.words)
    }

    fn read_registers<const N: usize>(&mut self, names: [&str; N]) -> Result<[u32; N], Error> {
        self.transact(&names.map(|name| Op::Read(address(name))))?;
        let words = self.words[..].try_into();
        words.map_err(|_| Error::Damaged("the bus gives another number of words".to_owned()))
    }

    /// Steps since the initial state.
    fn steps(&mut self) -> Result<u64, Error> {
        let [low, high] = self.read_registers(["STEP_COUNT_LOW", "STEP_COUNT_HIGH"])?;
        Ok(u64::from(high) << 32 | u64::from(low))
    }

    /// Waits for bits of the status; gives up when no step was done for long.
    fn await_status(&mut self, mask: u32, set: bool, clocks: u32, what: &str) -> Result<u32, Error> {
        let stretch = self.stretch(clocks);
        let poll = Op::Poll { address: self.places.status, mask, set, clocks: stretch };
        let (mut begin, mut steps, mut first, mut passed) = (Instant::now(), None, None, 0);
        loop {
            self.transact(&[poll])?;
            let status = self.words.first().copied().unwrap_or(0);
            if Op::holds(mask, set, status) {
                return Ok(status);
            }
            let now = self.steps()?;
            if now.saturating_sub(*first.get_or_insert(now)) > u64::from(u32::MAX) {
                return Err(Error::Damaged("more steps are counted than a run has".to_owned()));
            }
            if steps.replace(now) != Some(now) {
                (begin, passed) = (Instant::now(), 0);
            }
            passed += u64::from(stretch);
            let is_late = match self.bus.is_simulated() {
                true => passed > 4 * u64::from(clocks.max(self.expected(1))) + SPARE_CLOCKS,
                false => begin.elapsed() >= self.timeout,
            };
            if is_late {
                // A run that goes on would disturb the next one; that it may not end either is no news.
                let _ = self.transact(&[Op::Write(self.places.command, self::mask("COMMAND", "ABORT"))]);
                return Err(Error::Late(format!("the network {what}"), begin.elapsed()));
            }
        }
    }

    /// Clocks that so many steps take.
    fn expected(&self, steps: u32) -> u32 {
        steps.saturating_mul(self.step_clocks.max(self.limits.pace_period))
    }

    /// Clocks to wait for at once.
    fn stretch(&self, clocks: u32) -> u32 {
        if self.bus.is_simulated() { clocks.min(STRETCH) } else { clocks }
    }

    /// Adds what starts a run.
    fn add_start(&mut self, steps: u32) {
        if steps != self.run_steps {
            self.ops.push(Op::Write(self.places.run_steps, steps));
        }
        let Places { command, status, start, ends, .. } = self.places;
        let clocks = self.stretch(self.expected(steps));
        let awaited = self.awaited();
        self.ops.extend([
            Op::Write(status, ends),
            Op::Write(command, start),
            Op::Poll { address: status, mask: awaited, set: true, clocks },
        ]);
    }

    /// Bits of the status that end a run.
    fn awaited(&self) -> u32 {
        if self.limits.go_on { self.places.ends & !self.places.overrun } else { self.places.ends }
    }

    /// What the status says of a run that has ended.
    fn ended(&mut self, status: u32) -> Result<(), Error> {
        if status & self.places.time_exceeded != 0 {
            return Err(Error::TimeExceeded);
        }
        if status & self.places.overrun != 0 && !self.limits.go_on {
            return Err(Error::Overrun);
        }
        Ok(())
    }

    /// Carries out what was collected, up to the end of a run that is in it; the words that were read, unless the run did
    /// not end at once.
    fn finish(&mut self, steps: u32) -> Result<bool, Error> {
        let ops = std::mem::take(&mut self.ops);
        // A register that may have been written, and may not.
        self.run_steps = 0;
        let done = self.transact(&ops);
        self.ops = ops;
        done?;
        self.run_steps = steps;
        (self.stepped, self.set) = (true, None);
        let (awaited, clocks) = (self.awaited(), self.expected(1));
        let status = self.words.first().copied().unwrap_or(0);
        let at_once = Op::holds(awaited, true, status);
        let status = if at_once { status } else { self.await_status(awaited, true, clocks, "does not finish a step")? };
        self.ended(status)?;
        Ok(at_once)
    }

    fn add_inputs(&mut self, words: &[i64]) -> Result<(), Error> {
        count(self.windows.inputs.len(), words.len())?;
        for (span, word) in self.windows.inputs.iter().zip(words) {
            add_write(&mut self.ops, span, *word);
        }
        Ok(())
    }

    /// Words of outputs from those that were read.
    fn take_outputs(&self, read: &[u32], words: &mut [Option<i64>], wanted: impl Fn(usize) -> bool) {
        let mut read = read;
        for (index, (span, word)) in self.windows.outputs.iter().zip(words).enumerate() {
            *word = wanted(index).then(|| {
                let (own, rest) = read.split_at(usize::try_from(span.words).unwrap_or(0).min(read.len()));
                read = rest;
                whole(own)
            });
        }
    }

    fn order(&self) -> Result<Vec<Place>, Error> {
        let access = self.map.host.as_ref().and_then(|host| host.access.as_ref());
        let order = access.filter(|_| self.has.states).map(|access| access.order.clone());
        order.ok_or(Error::Lacks("access to states"))
    }

    /// Index among the state words.
    fn index(&self, place: &Place) -> usize {
        let at = |number: u32| usize::try_from(number).unwrap_or(0);
        let tick = || self.map.states.len() + at(place.tick.unwrap_or(0));
        place.state.map_or_else(tick, at)
    }

    /// With access to the states, which the network stops for.
    fn with_access<T>(&mut self, work: impl FnOnce(&mut Wrapped) -> Result<T, Error>) -> Result<T, Error> {
        let mode = self.mode();
        self.transact(&[Op::Write(address("MODE"), mode | mask("MODE", "ACCESS"))])?;
        let access = mask("STATUS", "ACCESS");
        self.await_status(access, true, self.step_clocks, "does not give access to its states")?;
        let result = work(self)?;
        self.transact(&[Op::Write(address("MODE"), mode)])?;
        let busy = masks("STATUS", &["ACCESS", "BUSY"]);
        self.await_status(busy, false, self.step_clocks, "does not go on after access to its states")?;
        Ok(result)
    }

    fn mode(&self) -> u32 {
        let pace = if self.limits.pace_period > 0 { mask("MODE", "PACE") } else { 0 };
        pace | if self.limits.go_on { mask("MODE", "CONTINUE") } else { 0 }
    }
}

fn add_write(ops: &mut Vec<Op>, span: &Span, word: i64) {
    let words = (0..span.words).zip(halves(word));
    ops.extend(words.map(|(index, half)| Op::Write(span.address + 4 * index, half)));
}

fn add_read(ops: &mut Vec<Op>, span: &Span) {
    ops.extend((0..span.words).map(|index| Op::Read(span.address + 4 * index)));
}

impl Engine for Wrapped {
    fn reset(&mut self) -> Result<(), Error> {
        self.begin()
    }

    fn write(&mut self, words: &[i64]) -> Result<(), Error> {
        self.ops.clear();
        self.add_inputs(words)?;
        let ops = std::mem::take(&mut self.ops);
        let done = self.transact(&ops);
        self.ops = ops;
        done
    }

    fn run(&mut self, steps: u64) -> Result<Ran, Error> {
        let overruns = self.overruns()?;
        let mut left = steps;
        while left > 0 {
            let now = u32::try_from(left).unwrap_or(u32::MAX);
            self.ops.clear();
            self.add_start(now);
            self.finish(now)?;
            left -= u64::from(now);
        }
        Ok(Ran { steps, overruns: self.overruns()?.saturating_sub(overruns) })
    }

    fn read(&mut self, words: &mut [Option<i64>]) -> Result<(), Error> {
        count(self.windows.outputs.len(), words.len())?;
        if let Some(state) = &self.set {
            self.map.shown(state, words);
            return Ok(());
        }
        let (stepped, map) = (self.stepped, Arc::clone(&self.map));
        let wanted = |index: usize| stepped || map.sample_0(&map.outputs[index]).is_some();
        let mut ops = Vec::new();
        let spans = self.windows.outputs.iter().enumerate();
        spans.filter(|(index, _)| wanted(*index)).for_each(|(_, span)| add_read(&mut ops, span));
        self.transact(&ops)?;
        self.take_outputs(&self.words, words, wanted);
        Ok(())
    }

    fn exchange(&mut self, inputs: &[i64], steps: u64, outputs: &mut [Option<i64>]) -> Result<Ran, Error> {
        count(self.windows.outputs.len(), outputs.len())?;
        let Some(now) = u32::try_from(steps).ok().filter(|_| !self.limits.go_on) else {
            self.write(inputs)?;
            let ran = self.run(steps)?;
            self.read(outputs)?;
            return Ok(ran);
        };
        self.ops.clear();
        self.add_inputs(inputs)?;
        self.add_start(now);
        // An output that has no value yet cannot be asked for before the run has ended.
        let has_sample =
            self.set.is_none() && self.map.outputs.iter().all(|output| self.map.sample_0(output).is_some());
        let together = self.stepped || has_sample;
        if together {
            self.windows.outputs.iter().for_each(|span| add_read(&mut self.ops, span));
        }
        if self.finish(now)? && together {
            self.take_outputs(self.words.get(1..).unwrap_or(&[]), outputs, |_| true);
        } else {
            self.read(outputs)?;
        }
        Ok(Ran { steps, overruns: 0 })
    }

    fn run_frames(&mut self, frames: usize, inputs: &[i64], outputs: &mut Vec<i64>) -> Result<Ran, Error> {
        count(frames * self.windows.inputs.len(), inputs.len())?;
        let overruns = self.overruns()?;
        if frames > 0 && self.has.stream && self.bus.has_streams() {
            self.stream(frames, inputs, outputs)?;
        } else {
            self.batches(frames, inputs, outputs)?;
        }
        let overruns = self.overruns()?.saturating_sub(overruns);
        Ok(Ran { steps: frames as u64, overruns })
    }

    fn state(&mut self, words: &mut [i64]) -> Result<(), Error> {
        count(self.map.state_words(), words.len())?;
        let order = self.order()?;
        let [at, low, high] = ["STATE_ADDRESS", "STATE_LOW", "STATE_HIGH"].map(address);
        let mut ops = Vec::with_capacity(3 * order.len());
        for place in &order {
            let place = u32::try_from(place.address).map_err(|_| Error::Lacks("addresses of 32 bits of states"))?;
            ops.extend([Op::Write(at, place), Op::Read(low), Op::Read(high)]);
        }
        let read = self.with_access(|wrapped| {
            wrapped.transact(&ops)?;
            Ok(std::mem::take(&mut wrapped.words))
        })?;
        order.iter().zip(read.chunks(2)).for_each(|(place, halves)| words[self.index(place)] = whole(halves));
        Ok(())
    }

    fn set_state(&mut self, words: &[i64]) -> Result<(), Error> {
        self.map.check_state(words)?;
        let order = self.order()?;
        let [low, high] = ["STATE_LOW", "STATE_HIGH"].map(address);
        let ready = mask("STATUS", "STATE_READY");
        let mut ops = Vec::with_capacity(3 * order.len());
        for place in &order {
            let halves = halves(words[self.index(place)]);
            let poll = Op::Poll { address: self.places.status, mask: ready, set: true, clocks: self.step_clocks };
            ops.extend([poll, Op::Write(high, halves[1]), Op::Write(low, halves[0])]);
        }
        self.with_access(|wrapped| {
            let mut given = 0;
            while given < order.len() {
                wrapped.transact(&ops[3 * given..])?;
                // A wait without success ends the transaction in front of its word.
                let taken = wrapped.words.iter().take_while(|status| *status & ready != 0).count();
                given += taken.min(order.len() - given);
                if given < order.len() {
                    wrapped.await_status(ready, true, wrapped.step_clocks, "does not take new states")?;
                }
            }
            let (replacing, access) = (mask("STATUS", "REPLACING"), mask("STATUS", "ACCESS"));
            wrapped.await_status(replacing, false, wrapped.step_clocks, "does not take new states")?;
            wrapped.await_status(access, true, wrapped.step_clocks, "does not take new states")
        })?;
        (self.stepped, self.set) = (false, Some(words.to_vec()));
        Ok(())
    }

    fn set_parameters(&mut self, words: &[i64]) -> Result<(), Error> {
        self.map.check_parameters(words)?;
        if !self.has.parameters {
            return if words.is_empty() {
                Ok(())
            } else {
                Err(Error::Lacks("parameters that are written at run time"))
            };
        }
        let mut ops = Vec::new();
        self.windows.parameters.iter().zip(words).for_each(|(span, word)| add_write(&mut ops, span, *word));
        ops.push(Op::Write(self.places.command, mask("COMMAND", "PARAMETERS")));
        self.transact(&ops)?;
        // All stored words are read and written, and the network runs through a step or two in between.
        let stored = u32::try_from(self.map.state_words()).unwrap_or(u32::MAX);
        let clocks = stored.saturating_mul(CLOCKS_PER_STORED_WORD).saturating_add(self.step_clocks.saturating_mul(9));
        self.await_status(mask("STATUS", "TUNING"), false, clocks, "does not take new parameters").map(drop)
    }

    fn flags(&mut self) -> Result<Flags, Error> {
        let [status] = self.read_registers(["STATUS"])?;
        let has = |field| status & mask("STATUS", field) != 0;
        if !self.has.flags {
            return Ok(Flags::OVERFLOW.when(has("OVERFLOW")));
        }
        let (saturated, operand) = (Flags::SATURATED, Flags::OPERAND_TOO_LARGE);
        Ok(Flags::INPUT_CLAMPED.when(has("INPUT")) | saturated.when(has("SATURATED")) | operand.when(has("OPERAND")))
    }

    fn clear_flags(&mut self) -> Result<(), Error> {
        if !self.has.flags {
            return Err(Error::Lacks("flags that can be cleared"));
        }
        let flags = masks("STATUS", &["SATURATED", "OPERAND", "INPUT"]);
        self.transact(&[Op::Write(self.places.status, flags)])
    }

    fn limit(&mut self, limits: &Limits) -> Result<(), Error> {
        self.limits = *limits;
        let budget = Op::Write(address("CLOCK_BUDGET"), limits.clock_budget);
        let pace = Op::Write(address("PACE_PERIOD"), limits.pace_period);
        self.transact(&[budget, pace, Op::Write(address("MODE"), self.mode())])
    }

    fn counters(&mut self) -> Result<Counters, Error> {
        let names = ["CLOCK_COUNT_LOW", "CLOCK_COUNT_HIGH", "CLOCKS_MAX", "CLOCKS_MIN", "SLACK_MIN", "OVERRUNS"];
        let [low, high, longest, shortest, slack, overruns] = self.read_registers(names)?;
        let slack = whole(&[slack]);
        Ok(Counters {
            clocks: u64::from(high) << 32 | u64::from(low),
            longest: Some(longest).filter(|clocks| *clocks > 0),
            shortest: Some(shortest).filter(|clocks| *clocks < u32::MAX),
            least_slack: i32::try_from(slack).ok().filter(|slack| *slack != pe_map::registers::NO_SLACK),
            overruns: u64::from(overruns),
        })
    }
}

impl Wrapped {
    /// Overruns so far, where a run goes on after one.
    fn overruns(&mut self) -> Result<u64, Error> {
        if !self.limits.go_on {
            return Ok(0);
        }
        let [overruns] = self.read_registers(["OVERRUNS"])?;
        Ok(u64::from(overruns))
    }
}
