//! Wrapped designs in GHDL and Verilator against the simulator, and broken wrappers.

mod windows;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;

use pe_ir::index::StateId;
use pe_ir::program::Program;
use pe_map::registers;
use pe_sim::machine::Machine;
use pe_verify::folder::DesignFolder;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::support::bench::Folder;
use crate::support::bus::{self, Device};
use crate::support::damage::{Damage, missed};
use crate::support::kept;

pub(super) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Names like those of the wrapper, an output that has no sample 0, and words of 40 bits.
const NAMESAKES: &str = "\
model aclk
solver heun
step 1 ms
span 20 ms
input s_axi_wdata = sine(1, 20 Hz)
input inputs = sine(0.5, 30 Hz)
state outputs = 0.25
state ce = -1
outputs' = s_axi_wdata - 3*outputs
run = ce * inputs
ce' = run - outputs - ce
output outputs, run, ce
";

pub(super) fn pe_synth(arguments: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

/// A wrapped design: `model` is a shipped one, or the text of a spec.
pub(super) fn wrapped(home: &Path, model: &str, options: &str, more: &[&str]) -> PathBuf {
    let folder = home.join("design");
    let spec = home.join("model.spec");
    let shipped = root().join(format!("models/{model}.spec"));
    let spec = if model.contains('\n') { fs::write(&spec, model).map(|()| spec).unwrap() } else { shipped };
    let mut arguments = vec!["compile", spec.to_str().unwrap(), "--quiet", "--no-pictures"];
    arguments.extend(["-o", folder.to_str().unwrap()]);
    arguments.extend(options.split_whitespace());
    pe_synth(&arguments);
    pe_synth(&[&["wrap", folder.to_str().unwrap(), "--quiet"], more].concat());
    folder
}

/// A design in a simulation beside the simulator.
struct Pair<'a> {
    device: Device,
    program: &'a Program,
    machine: Machine<Arc<Program>>,
    /// Steps that the simulator has run.
    done: u32,
    /// The inputs of each.
    history: Vec<Vec<i64>>,
    /// Words of the inputs that act.
    inputs: Vec<i64>,
    random: ChaCha8Rng,
}

type Checked = Result<(), String>;

fn same<T: PartialEq + std::fmt::Debug>(what: &str, is: T, should: T) -> Checked {
    if is == should { Ok(()) } else { Err(format!("{what}: {is:?} instead of {should:?}")) }
}

impl<'a> Pair<'a> {
    fn new(device: Device, program: &'a Program) -> Pair<'a> {
        let inputs = vec![0; device.map.inputs.len()];
        Pair {
            device,
            program,
            machine: Machine::new(Arc::new(program.clone())),
            done: 0,
            history: Vec::new(),
            inputs,
            random: ChaCha8Rng::seed_from_u64(7),
        }
    }

    /// Writes other words of the inputs; they do not act yet.
    fn others(&mut self) -> Result<Vec<i64>, String> {
        let limits: Vec<[i64; 2]> = self.device.map.inputs.iter().map(|input| input.words).collect();
        let words: Vec<i64> =
            limits.iter().map(|[least, most]| self.random.random_range(least / 4..=most / 4)).collect();
        self.device.give(&words).map(|()| words)
    }

    /// Writes other words of the inputs, for the run that follows.
    fn change(&mut self) -> Checked {
        self.inputs = self.others()?;
        Ok(())
    }

    /// A step of the simulator.
    fn step(&mut self) {
        self.machine.step(&self.inputs, &mut |_| {});
        self.history.push(self.inputs.clone());
    }

    /// Lets the simulator follow, and compares.
    fn follow(&mut self) -> Checked {
        let steps = self.device.read("STEP_COUNT_LOW")?;
        if steps < self.done {
            return Err(format!("{steps} steps after {}", self.done));
        }
        for _ in self.done..steps {
            self.step();
        }
        self.done = steps;
        let shown: Vec<Option<i64>> = self.machine.outputs().iter().copied().map(Some).collect();
        same(&format!("outputs after {steps} steps"), self.device.outputs()?, shown)?;
        let sample = self.device.read("OUTPUT_STEP_LOW")?;
        same("OUTPUT_STEP", sample, steps)
    }

    fn steps(&mut self, steps: u32) -> Checked {
        let before = self.done;
        self.change()?;
        self.device.run(steps)?;
        self.follow()?;
        same("steps of a run", self.done - before, steps)
    }

    fn fresh(&mut self) -> Checked {
        self.device.command(&["CLEAR"])?;
        self.device.write("STATUS", u32::MAX)?;
        self.device.mode(&[])
    }

    /// Identity, sample 0, and what is not there.
    fn identity(&mut self) -> Checked {
        let hash = self.device.wrap.hash.clone();
        same("ID", self.device.read("ID")?, registers::ID)?;
        for word in 0..4 {
            let is = format!("{:08x}", self.device.read(&format!("HASH_{word}"))?);
            same("hash", is.as_str(), &hash[8 * word..8 * word + 8])?;
        }
        let initial: Vec<Option<i64>> = self.device.wrap.outputs.iter().map(|output| output.initial).collect();
        same("sample 0", self.device.outputs()?, initial.clone())?;
        same("OUTPUTS", self.device.is("OUTPUTS")?, !initial.contains(&None))?;
        same("clocks of a step", self.device.read("STEP_CLOCKS")?, self.program.period)?;
        let there: Vec<u32> = self.device.wrap.registers.iter().map(|register| register.address).collect();
        let size = 1 << (self.device.wrap.address_bits - 2);
        let words = |places: &[pe_map::wrap::Place]| 4 * places.iter().map(|place| place.words).sum::<u32>();
        let (inputs, outputs) = (words(&self.device.wrap.inputs), words(&self.device.wrap.outputs));
        let parameters = size + words(&self.device.wrap.parameters);
        let beyond =
            [0x84, 0x3fc, parameters, 2 * size - 4, 2 * size + inputs, 3 * size - 4, 3 * size + outputs, 4 * size - 4];
        let absent = registers::REGISTERS.iter().map(|register| register.address).filter(|at| !there.contains(at));
        for address in absent.chain(beyond.into_iter().filter(|at| *at != 2 * size - 4 || inputs < size)) {
            same(&format!("read of {address:x}"), self.device.read_at(address)?, None)?;
            same(&format!("write to {address:x}"), self.device.write_at(address, 1, 15)?, false)?;
        }
        for name in ["ID", "STEP_COUNT_LOW", "CLOCKS_MAX"] {
            same(name, self.device.try_write(name, 0)?, false)?;
        }
        same("write to an output", self.device.write_at(3 * size, 1, 15)?, false)?;
        same("read of COMMAND", self.device.read_at(self.device.address("COMMAND"))?, None)?;
        same("an unknown command", self.device.try_write("COMMAND", 1 << 31)?, false)?;
        same("an unknown mode", self.device.try_write("MODE", 1 << 31)?, false)?;
        self.device.write("RUN_STEPS", 0x1122_3344)?;
        self.device.write_at(self.device.address("RUN_STEPS"), 0xaabb_ccdd, 0b0101)?;
        same("strobes", self.device.read("RUN_STEPS")?, 0x11bb_33dd)?;
        if let Some(input) = self.device.wrap.inputs.first().cloned() {
            self.device.write_at(input.address, 0x1122_3344, 15)?;
            self.device.write_at(input.address, 0xaabb_ccdd, 0b0110)?;
            same("strobes of an input", self.device.read_at(input.address)?, Some(0x11bb_cc44))?;
        }
        Ok(())
    }

    /// Runs of several steps, inputs that wait, abort, and inputs that change in free run.
    fn runs(&mut self) -> Checked {
        for steps in [1, 1, 3, 1, 5] {
            self.steps(steps)?;
        }
        // What is written and not taken does not act.
        self.change()?;
        self.device.mode(&["FREE_RUN"])?;
        self.device.command(&["START"])?;
        self.others()?;
        same("a start and an abort", self.device.try_command(&["START", "ABORT"])?, false)?;
        same("a second start", self.device.try_command(&["START"])?, false)?;
        let clocks = self.random.random_range(3 * self.program.period..6 * self.program.period);
        self.device.clocks(clocks)?;
        self.device.command(&["ABORT"])?;
        self.device.await_bit("BUSY", false)?;
        let before = self.done;
        self.follow()?;
        same("more than a step", self.done - before > 1, true)?;
        same("ABORTED", self.device.is("ABORTED")?, true)?;
        // The state after an abort is that between two steps.
        self.fresh()?;
        self.steps(2)?;
        same("DONE", self.device.is("DONE")?, true)?;
        same("ABORTED", self.device.is("ABORTED")?, false)?;
        self.switched()
    }

    /// Inputs that are taken in mid-run act together: before and after are each a run of their own.
    fn switched(&mut self) -> Checked {
        self.change()?;
        self.device.mode(&["FREE_RUN"])?;
        self.device.command(&["START"])?;
        let next = self.others()?;
        self.device.clocks(2 * self.program.period)?;
        self.device.command(&["INPUTS"])?;
        self.device.clocks(2 * self.program.period)?;
        self.device.command(&["ABORT"])?;
        self.device.await_bit("BUSY", false)?;
        self.device.mode(&[])?;
        let steps = self.device.read("STEP_COUNT_LOW")?;
        let shown = self.device.outputs()?;
        // In one of the steps the inputs were switched, all at once.
        let before = self.history.len();
        let found = (0..=steps - self.done).rev().any(|first| {
            self.history.truncate(before);
            let inputs = |step| if step < first { self.inputs.clone() } else { next.clone() };
            self.history.extend((0..steps - self.done).map(inputs));
            self.machine = Machine::new(Arc::new(self.program.clone()));
            self.history.iter().for_each(|inputs| self.machine.step(inputs, &mut |_| {}));
            self.machine.outputs().iter().copied().map(Some).eq(shown.iter().copied())
        });
        (self.inputs, self.done) = (next, steps);
        same("inputs act together", found, true)
    }

    /// Budget, pacing, single clocks, held outputs.
    fn timing(&mut self) -> Checked {
        self.fresh()?;
        self.steps(3)?;
        let (latency, period) = (self.device.read("CLOCKS_LAST")?, self.program.period);
        same("latency", latency == period || latency == period + 4, true)?;
        same("longest", self.device.read("CLOCKS_MAX")?, latency)?;
        same("shortest", self.device.read("CLOCKS_MIN")?, latency)?;
        same("clocks", self.device.read("CLOCK_COUNT_LOW")?, 2 * period + latency)?;
        // Steps follow each other without a gap.
        self.change()?;
        self.device.write("RUN_STEPS", 9)?;
        self.device.command(&["START"])?;
        self.device.clocks(8 * period + latency + self.copying())?;
        same("a run without gaps is over", self.device.is("BUSY")?, false)?;
        self.follow()?;
        self.device.write("CLOCK_BUDGET", latency)?;
        self.steps(2)?;
        same("within the budget", self.device.is("TIME_EXCEEDED")?, false)?;
        self.device.write("CLOCK_BUDGET", latency - 1)?;
        self.change()?;
        let before = self.done;
        self.device.run(1)?;
        same("TIME_EXCEEDED", self.device.is("TIME_EXCEEDED")? && self.device.is("UNFINISHED")?, true)?;
        same("steps", self.device.read("STEP_COUNT_LOW")?, before)?;
        // It goes on with the inputs that it has taken.
        let taken = self.inputs.clone();
        self.others()?;
        self.device.write("CLOCK_BUDGET", 0)?;
        self.device.command(&["CLEAR"])?;
        self.device.mode(&["PACE"])?;
        self.device.write("PACE_PERIOD", 0)?;
        same("a pace of nothing", self.device.try_command(&["START"])?, false)?;
        self.device.write("PACE_PERIOD", 9999)?;
        self.device.run(1)?;
        // It did not begin with a pace.
        same("slack of a resumed step", self.device.read("SLACK_MIN")?, registers::NO_SLACK as u32)?;
        self.device.mode(&[])?;
        self.inputs = taken;
        self.follow()?;
        same("a resumed step", self.done, before + 1)?;
        self.steps(1)?;
        for (pace, fits) in [(latency, true), (latency + 9, true), (latency - 1, false)] {
            for more in [&["PACE"][..], &["PACE", "CONTINUE"]] {
                self.fresh()?;
                self.device.mode(more)?;
                self.device.write("PACE_PERIOD", pace)?;
                let before = self.done;
                self.change()?;
                self.device.run(4)?;
                self.follow()?;
                let ran = if fits || more.len() > 1 { 4 } else { 1 };
                same(&format!("steps {pace} clocks apart"), self.done - before, ran)?;
                same("OVERRUN", self.device.is("OVERRUN")?, !fits)?;
                same("OVERRUNS", self.device.read("OVERRUNS")?, if fits { 0 } else { ran })?;
                same("slack", self.device.read("SLACK_MIN")?, pace.wrapping_sub(latency))?;
            }
        }
        self.fresh()?;
        self.device.mode(&["HALT"])?;
        self.change()?;
        self.device.write("RUN_STEPS", 1)?;
        self.device.command(&["START"])?;
        self.device.clocks(100)?;
        for clock in 1.. {
            self.device.write("SINGLE_CLOCKS", 1)?;
            self.device.clocks(self.copying())?;
            if !self.device.is("BUSY")? {
                // One in which it begins, and those until the outputs. A deep pipeline goes on in between.
                same("single clocks", clock, period + 1)?;
                break;
            }
        }
        self.follow()?;
        self.device.mode(&["HOLD"])?;
        let held = self.device.outputs()?;
        self.change()?;
        self.device.run(2)?;
        same("held outputs", self.device.outputs()?, held)?;
        self.device.mode(&[])?;
        self.follow()
    }

    /// Steps in which a flag rose.
    fn flags(&mut self) -> Checked {
        self.fresh()?;
        let mut flagged = 0;
        for step in 0..40 {
            let limits: Vec<[i64; 2]> = self.device.map.inputs.iter().map(|input| input.format.words()).collect();
            self.inputs = limits.iter().map(|words| words[self.random.random_range(0..2)]).collect();
            self.device.give(&self.inputs)?;
            let steps = 1 + step % 3;
            for _ in 0..steps {
                let mut program = self.program.clone();
                let states: Vec<(StateId, i64)> = program.states.ids().map(|id| (id, self.machine.state(id))).collect();
                for (state, word) in states {
                    program.states[state].clone().set(&mut program.pes, &program.format, word);
                }
                let mut alone = Machine::new(&program);
                alone.step(&self.inputs, &mut |_| {});
                flagged += u32::from(alone.overflow());
                self.step();
            }
            self.done += steps;
            self.device.run(steps)?;
            self.follow()?;
        }
        same("SATURATED_STEPS", self.device.read("SATURATED_STEPS")?, flagged)?;
        same("OVERFLOW", self.device.is("OVERFLOW")?, flagged > 0)?;
        self.device.write("STATUS", u32::MAX)?;
        same("flags that are cleared", self.device.is("OVERFLOW")?, false)
    }

    /// The same state in another simulation: what follows is the same.
    fn states(&mut self, mut elsewhere: Device) -> Checked {
        self.fresh()?;
        self.change()?;
        self.device.mode(&["FREE_RUN"])?;
        self.device.command(&["START"])?;
        self.device.clocks(5 * self.program.period)?;
        let (steps, words) = self.device.snapshot()?;
        (self.done..steps).for_each(|_| self.step());
        self.done = steps;
        let states: Vec<i64> = self.program.states.ids().map(|state| self.machine.state(state)).collect();
        same("a snapshot in mid-run", &words[..states.len()], &states[..])?;
        self.device.clocks(3 * self.program.period)?;
        self.device.command(&["ABORT"])?;
        self.device.await_bit("BUSY", false)?;
        self.follow()?;
        elsewhere.restore(&words)?;
        same("outputs of a state", elsewhere.outputs()?, vec![None; elsewhere.wrap.outputs.len()])?;
        elsewhere.give(&self.inputs)?;
        elsewhere.run(self.done - steps)?;
        same("elsewhere", elsewhere.outputs()?, self.device.outputs()?)
    }

    fn restarted(&mut self) -> Checked {
        self.change()?;
        self.device.mode(&["FREE_RUN"])?;
        self.device.command(&["START"])?;
        self.device.clocks(3 * self.program.period / 2)?;
        self.device.command(&["RESTART"])?;
        self.device.await_bit("BUSY", false)?;
        self.device.mode(&[])?;
        let initial = self.device.wrap.outputs.iter().map(|output| output.initial).collect();
        same("sample 0 after a restart", self.device.outputs()?, initial)?;
        self.renewed();
        self.steps(4)
    }

    /// Clocks from the end of a step until its outputs can be read, where they are copied.
    fn copying(&self) -> u32 {
        let words: u32 = self.device.wrap.outputs.iter().map(|place| place.words).sum();
        self.device.map.output_memory.as_ref().map_or(0, |memory| words + memory.latency)
    }

    /// Whether outputs are copied while the next step runs, so that steps need not wait.
    fn copies_ahead(&self) -> bool {
        self.device.map.output_memory.is_none() || self.copying() + 8 <= self.program.period
    }

    /// The simulator in the initial state.
    fn renewed(&mut self) {
        (self.machine, self.done) = (Machine::new(Arc::new(self.program.clone())), 0);
        self.history.clear();
    }

    /// A frame a step, with nothing lost while nobody takes outputs; a frame of another length.
    fn frames(&mut self) -> Checked {
        self.fresh()?;
        self.device.mode(&["FREE_RUN", "STREAM"])?;
        self.device.command(&["START"])?;
        let places = self.device.wrap.inputs.clone();
        let limits: Vec<[i64; 2]> = self.device.map.inputs.iter().map(|input| input.words).collect();
        let frame = |words: &[i64]| {
            let halves = places.iter().zip(words).flat_map(|(place, word)| {
                (0..place.words).map(move |half| format!(" {:x}", (word >> (32 * half)) as u32))
            });
            format!("i{}", halves.collect::<String>())
        };
        let mut waiting = std::collections::VecDeque::new();
        // The last three take what is left.
        for round in 0..31 {
            // Four fit at most: two steps, a frame of inputs, and another one.
            while round < 28 && waiting.len() < 1 + round % 4 && !places.is_empty() {
                let words: Vec<i64> =
                    limits.iter().map(|[low, high]| self.random.random_range(low / 4..=high / 4)).collect();
                same("a frame in", self.device.ask(&frame(&words))?.as_str(), "ok")?;
                waiting.push_back(words);
            }
            self.device.clocks(self.random.random_range(0..200))?;
            self.inputs = waiting.pop_front().unwrap_or_default();
            self.step();
            self.done += 1;
            let words = self.machine.outputs().iter().zip(&self.device.wrap.outputs).flat_map(|(word, place)| {
                (0..place.words).map(move |half| format!("{:08X}", (word >> (32 * half)) as u32))
            });
            let words: Vec<String> = words.collect();
            same("a frame out", self.device.ask("o")?, words.join(" "))?;
        }
        assert!(waiting.is_empty());
        if let Some(first) = places.first() {
            let long = format!("{} 5", frame(&vec![0; places.len()]));
            same(&format!("{} and more", first.name), self.device.ask(&long)?.as_str(), "ok")?;
            same("FRAME", self.device.is("FRAME")?, true)?;
        }
        self.device.command(&["ABORT"])?;
        self.device.await_bit("BUSY", false)?;
        self.device.mode(&[])?;
        let steps = self.device.read("STEP_COUNT_LOW")?;
        self.inputs = vec![0; self.inputs.len()];
        if places.is_empty() { self.follow() } else { same("steps of frames", steps, self.done) }
    }

    fn exercise(&mut self, elsewhere: impl FnOnce() -> Device) -> Checked {
        let has = self.device.wrap.capabilities;
        self.identity()?;
        self.runs()?;
        if self.copies_ahead() {
            self.timing()?;
        }
        if has.flags && self.program.ticks().next().is_none() {
            self.flags()?;
        }
        if has.stream {
            self.frames()?;
        }
        if has.parameters {
            self.tuning()?;
        }
        if has.states {
            self.states(elsewhere())?;
        }
        if has.restart {
            self.restarted()?;
        }
        Ok(())
    }
}

type Build = fn(&Path, &Path) -> Vec<String>;

/// Builds a design and exercises it: what is found wrong.
fn judged(design: &Path, scratch: &Path, build: Build) -> Checked {
    let program = DesignFolder::open(design).unwrap().program;
    let command = build(design, scratch);
    let device = Device::start(&command, design, scratch);
    Pair::new(device, &program).exercise(|| Device::start(&command, design, scratch))
}

const FULL: &str = "--host restart,states,flags";

/// Ticks; a deep pipeline with swapped buffers; words that saturate; wide words, odd names; a step ratio, no host.
const DESIGNS: [(&str, &str, Build); 6] = [
    ("motor_pid/motor_pid", "--pes 2 --span 100ms --host restart,states,flags", bus::ghdl),
    (
        "spring_chain/spring_chain",
        "--pes 3 --loop on --pipeline deep --set n=12 --host restart,states,flags",
        bus::ghdl,
    ),
    ("rc_ladder/rc_ladder", "--pes 2 --span 10ms --multiplier 25x18 --storage 32 --proof off --host flags", bus::ghdl),
    (NAMESAKES, "--pes 2 --storage 40 --multiplier 35x35 --host restart,states", bus::ghdl),
    ("validation/bateman", "", bus::ghdl),
    ("motor_pid/motor_pid", "--pes 1 --span 100ms --pipeline deep --host restart,states,flags", bus::verilator),
];

#[test]
fn wrapped_designs_do_what_the_page_says() {
    for (number, (model, options, build)) in kept(DESIGNS, 4).enumerate() {
        let folder = Folder::new(&format!("wrap_{number}"));
        // Every second one has streams.
        let design = wrapped(&folder.0, model, options, if number % 2 == 1 { &["--stream"] } else { &[] });
        judged(&design, &folder.sub("scratch"), build).unwrap_or_else(|what| panic!("{model} {options}: {what}"));
    }
}

/// Damages of the wrapper: file, what is there, what takes its place.
const DAMAGES: [Damage; 19] = [
    // Slack of a step that began in another run.
    ("hdl/pe_synchronizer.vhd", "earlier <= under_way;", "earlier <= NO_STEPS;"),
    // Steps whose outputs have no place.
    (
        "hdl/pe_stream.vhd",
        "ready_o       <= loaded when places < 2 else",
        "ready_o       <= loaded when places < 9 else",
    ),
    // Steps without a frame.
    ("hdl/pe_synchronizer.vhd", "fed  <= (fed_i or not streams) and room_i;", "fed  <= room_i;"),
    // Long frames.
    ("hdl/pe_stream.vhd", "(dropping = '1' or count /= INPUT_WORDS - 1)", "(count /= INPUT_WORDS - 1)"),
    // `step_o` is 1 until the outputs have come: another step begins with the same inputs.
    ("hdl/pe_synchronizer.vhd", "(begins = '1' and endless = '0')", "(ends = '1' and endless = '0')"),
    // A step waits for the outputs of the one before.
    ("hdl/pe_synchronizer.vhd", "step   <= more and due", "step   <= more and due and not (or under_way)"),
    // Inputs act as they are written.
    ("hdl/pe_windows.vhd", "inputs_o   <= taken;", "inputs_o   <= written;"),
    // Strobes of an input.
    ("hdl/pe_windows.vhd", "strobe_i(byte) = '1' and", "true and"),
    // Strobes of a register.
    ("hdl/pe_registers.vhd", "(old and not bits) or ones", "ones"),
    // An abort stops in the middle of a step.
    (
        "hdl/pe_synchronizer.vhd",
        "        aborting <= '1';\n",
        "        aborting <= '1';\n        frozen   <= or under_way;\n",
    ),
    // A run has a step too many.
    ("hdl/pe_synchronizer.vhd", "left    <= order_i.steps - under_way;", "left    <= order_i.steps - under_way + 1;"),
    // The budget is a clock longer.
    ("hdl/pe_synchronizer.vhd", "spent >= order_i.budget", "spent > order_i.budget"),
    // Paced steps are a clock further apart.
    (
        "hdl/pe_synchronizer.vhd",
        "signed(resize(order_i.period, TIMER_BITS)) - 1;",
        "signed(resize(order_i.period, TIMER_BITS));",
    ),
    // Outputs are captured a clock late.
    ("hdl/pe_windows.vhd", "(missed and not stepping_i)", "'0'"),
    // Outputs change in spite of `HOLD`.
    ("hdl/pe_windows.vhd", "capture <= not hold_i and", "capture <= "),
    // Samples after a state was replaced.
    ("hdl/pe_windows.vhd", "if (forget_i = '1') then", "if (false) then"),
    // States are read before they are there.
    ("hdl/pe_registers.vhd", "state_settled_i = '1' or possible", "true or possible"),
    // Halted networks run.
    ("hdl/pe_synchronizer.vhd", "(order_i.halt = '1' and clocks = 0)", "false"),
    // What a wrapper does not have is there.
    ("hdl/pe_registers.vhd", "possible <= is_input_i;", "possible <= '1';"),
];

#[test]
fn a_broken_wrapper_is_caught() {
    let folder = Folder::new("wrap_broken");
    let design = wrapped(&folder.0, "motor_pid/motor_pid", &format!("--pes 1 --span 100ms {FULL}"), &["--stream"]);
    let missed = missed(&[&design], &folder.0, &DAMAGES, |broken, scratch| judged(broken, scratch, bus::ghdl).is_err());
    assert_eq!(missed, Vec::<&str>::new(), "not caught");
}
