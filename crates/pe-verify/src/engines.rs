//! Runs a written design in the engines that must agree, and compares what they print.
//!
//! Every engine prints the same lines: `t` and a memory write, `o` and a published output, `v` and an overflow flag,
//! `c` and the clocks between the last two steps; the fast form, which has neither memories nor clocks, `s` and the word of
//! a state after a step in place of `t` and `c`; those with a handshake also `h` and its changes, and `u` and a clock in
//! which outputs changed although nothing was published.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pe_ir::index::PeId;
use pe_ir::program::{Program, StateRegister};
use pe_sim::machine::Machine;
use pe_sim::trace::TraceLine;

use crate::child::Children;
use crate::package::{self, InitialWord};
use pe_flow::failure::Failure;

/// A change of the handshake's pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// The first clock that sees it, counted from 1.
    pub clock: u64,
    /// 4 `busy_o`, 2 `done_o`, 1 `overflow_o`.
    pub pins: u8,
}

/// What a run showed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Run {
    /// Memory writes, sorted.
    pub trace: Vec<TraceLine>,
    /// Published outputs: step, index, word.
    pub outputs: Vec<(u64, usize, u64)>,
    /// Words of the states after each step, in the same way; none if the run shows memory writes instead.
    pub states: Vec<(u64, usize, u64)>,
    /// Whether an overflow flag was set.
    pub overflow: bool,
    /// PEs whose sticky flag was set; none if the run does not tell.
    pub flags: Option<Vec<PeId>>,
    /// Changes of the handshake, of runs that were told what to do to it.
    pub events: Vec<Event>,
    /// Clocks in which outputs changed although nothing was published.
    pub strays: Vec<u64>,
    /// Clocks between the last two `done_o`; zero after a single step.
    pub clocks: u64,
}

/// An engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// The generated Rust program, built with `rustc`.
    Reference,
    /// The same program, step by step.
    Fast,
    /// The generated VHDL in GHDL.
    Ghdl,
    /// GHDL's synthesised netlist in Verilator.
    Verilator,
}

impl Engine {
    /// All of them.
    pub const ALL: [Engine; 4] = [Engine::Reference, Engine::Fast, Engine::Ghdl, Engine::Verilator];

    /// Whether it has clocks, and waits for `step_i`.
    pub fn has_handshake(self) -> bool {
        matches!(self, Engine::Ghdl | Engine::Verilator)
    }

    /// The name on the command line.
    pub fn option(self) -> &'static str {
        match self {
            Engine::Reference => "reference",
            Engine::Fast => "fast",
            Engine::Ghdl => "ghdl",
            Engine::Verilator => "verilator",
        }
    }

    /// Compares its run with the simulator's, as [`compare`] does; the fast form shows states in place of memory writes.
    ///
    /// # Errors
    /// The first difference.
    pub fn compare(self, program: &Program, run: &Run, expected: &Run, expected_writes: u64) -> Result<(), String> {
        match self {
            Engine::Fast => compare_states(program, self.name(), run, expected),
            _ => compare(program, self.name(), run, expected, expected_writes),
        }
    }

    /// What it is, in a line of help.
    pub fn title(self) -> &'static str {
        match self {
            Engine::Reference => "The generated Rust program, built with `rustc`",
            Engine::Fast => "The same program, step by step instead of clock by clock",
            Engine::Ghdl => "The generated VHDL in GHDL",
            Engine::Verilator => "GHDL's synthesised netlist in Verilator",
        }
    }

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Engine::Reference => "Rust reference",
            Engine::Fast => "fast form",
            Engine::Ghdl => "GHDL",
            Engine::Verilator => "Verilator",
        }
    }
}

/// A copy of a design's files, in which the engines build what they run.
pub struct Bench<'a> {
    design: String,
    scratch: PathBuf,
    built: BTreeSet<&'static str>,
    /// The initial words with which the package was analysed last.
    analysed: Option<Vec<InitialWord>>,
    children: Children<'a>,
}

/// One run of an engine.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// Steps.
    pub steps: u64,
    /// Initial words in place of the design's.
    pub words: &'a [InitialWord],
    /// Lines of input words in place of the design's stimulus file.
    pub stimulus: Option<&'a str>,
    /// What to do to the handshake, a hex digit per clock; freely running without. The reference has no handshake.
    pub control: Option<&'a str>,
}

impl<'a> Bench<'a> {
    /// Copies a design into a scratch folder: GHDL's libraries record paths and make reads them, and neither can quote
    /// what a user may call a folder.
    ///
    /// # Errors
    /// If a file is missing that an engine reads.
    pub fn new(folder: &Path, design: &str, scratch: &Path) -> Result<Bench<'a>, Failure> {
        let bench = Bench {
            design: design.to_owned(),
            scratch: fs::canonicalize(scratch).unwrap_or_else(|_| scratch.to_owned()),
            built: BTreeSet::new(),
            analysed: None,
            children: Children::default(),
        };
        let list = folder.join(format!("{design}.f"));
        let text = fs::read_to_string(&list).map_err(|error| Failure::file("read", &list, error))?;
        let listed = text.lines().filter_map(|line| line.split_once(' ')).map(|(_, file)| file.to_owned());
        let others = [".f", "_stimulus.txt", "_reference.rs", "_verilator.cpp"];
        for file in listed.chain(others.map(|ending| format!("{design}{ending}"))) {
            let (from, to) = (folder.join(&file), bench.copy(&file));
            if let Some(folder) = to.parent() {
                fs::create_dir_all(folder).map_err(|error| Failure::file("create", folder, error))?;
            }
            fs::copy(&from, &to).map_err(|error| Failure::file("read", &from, error))?;
        }
        Ok(bench)
    }

    /// The same, whose programs are limited and heard.
    pub(crate) fn with(self, children: Children<'a>) -> Bench<'a> {
        Bench { children, ..self }
    }

    /// Runs an engine. What does not depend on the job is built once.
    ///
    /// # Errors
    /// If the engine is missing, fails, or prints something else than it should.
    pub fn run(&mut self, engine: Engine, job: &Job) -> Result<Run, Failure> {
        self.run_until_difference(engine, job, None)
    }

    /// The same; GHDL is stopped at the first memory write that is not the expected one.
    ///
    /// # Errors
    /// As above.
    pub fn run_until_difference(
        &mut self,
        engine: Engine,
        job: &Job,
        expected: Option<&[TraceLine]>,
    ) -> Result<Run, Failure> {
        let stimulus = match job.stimulus {
            Some(text) => self.write("stimulus.txt", text)?,
            None => self.copy(&format!("{}_stimulus.txt", self.design)),
        };
        let stimulus = stimulus.display().to_string();
        let text = match engine {
            Engine::Reference => self.reference(job, &stimulus, &[])?,
            Engine::Fast => self.reference(job, &stimulus, &["--fast"])?,
            Engine::Ghdl => self.ghdl(job, &stimulus, expected)?,
            Engine::Verilator => self.verilator(job, &stimulus)?,
        };
        parse(&text).map_err(|line| Failure::Mismatch(format!("{} printed `{line}`", engine.name())))
    }

    /// Path of a file of the design in the scratch folder; absolute, for engines run in folders of their own.
    fn copy(&self, file: &str) -> PathBuf {
        self.scratch.join("design").join(file)
    }

    /// Writes a file beside the design.
    fn write(&self, file: &str, text: &str) -> Result<PathBuf, Failure> {
        let path = self.scratch.join(file);
        fs::write(&path, text).map_err(|error| Failure::file("write", &path, error))?;
        Ok(path)
    }

    fn reference(&mut self, job: &Job, stimulus: &str, form: &[&str]) -> Result<String, Failure> {
        let source = self.copy(&format!("{}_reference.rs", self.design));
        let program = self.scratch.join("reference");
        if self.built.insert("reference") {
            let mut build = Command::new("rustc");
            let size = fs::metadata(&source).map_or(0, |file| file.len());
            let level = if size < SMALL && job.steps < BRIEF { "opt-level=0" } else { "opt-level=3" };
            build.args(["--edition", "2021", "-C", level, "-o"]).arg(&program).arg(&source);
            self.children.run(&mut build, "rustc", "install Rust from https://rustup.rs").map_err(|failure| {
                match failure {
                    Failure::Mismatch(text) if text.contains("linker") && text.contains("not found") => {
                        Failure::MissingTool("a C linker is not installed: apt-get install gcc".into())
                    }
                    failure => failure,
                }
            })?;
            self.children.have_built();
        }
        let mut run = Command::new(&program);
        run.args(["--stimulus", stimulus, "--steps", &job.steps.to_string()]).args(form);
        if !job.words.is_empty() {
            run.arg("--images").arg(self.write("images.txt", &package::lines(job.words))?);
        }
        self.children.run(&mut run, "reference", "it was just built")
    }

    /// Analyses the files of the design's list; once the library is there, only what initial words change.
    fn analyse(&mut self, words: &[InitialWord]) -> Result<(), Failure> {
        if self.analysed.as_deref() == Some(words) {
            return Ok(());
        }
        let list = self.copy(&format!("{}.f", self.design));
        let text = fs::read_to_string(&list).map_err(|error| Failure::file("read", &list, error))?;
        let package = format!("{}_program_pkg.vhd", self.design);
        let files: Vec<(&str, &str)> =
            text.lines().map(|line| line.split_once(' ').unwrap_or(("work", line))).collect();
        for part in files.chunk_by(|(library, _), (other, _)| library == other) {
            let library = part[0].0;
            if library != "work" && !self.built.insert("library") {
                continue;
            }
            let mut analyse = Command::new("ghdl");
            analyse.args(["-a", "--std=08", &format!("--work={library}")]).args(self.work_folder());
            for (_, file) in part {
                if *file == package && !words.is_empty() {
                    let path = self.copy(file);
                    let text = fs::read_to_string(&path).map_err(|error| Failure::file("read", &path, error))?;
                    let text = package::with_words(&text, words)
                        .map_err(|what| Failure::Mismatch(format!("`{package}`: {what}")))?;
                    analyse.arg(self.write(&package, &text)?);
                } else {
                    analyse.arg(self.copy(file));
                }
            }
            self.children.run(&mut analyse, "ghdl", GHDL_INSTALL)?;
            if library != "work" {
                self.children.have_built();
            }
        }
        self.analysed = Some(words.to_vec());
        Ok(())
    }

    fn work_folder(&self) -> [String; 2] {
        let scratch = self.scratch.display();
        [format!("--workdir={scratch}"), format!("-P{scratch}")]
    }

    fn ghdl(&mut self, job: &Job, stimulus: &str, expected: Option<&[TraceLine]>) -> Result<String, Failure> {
        self.analyse(job.words)?;
        let mut run = Command::new("ghdl");
        run.args(["--elab-run", "--std=08"]).args(self.work_folder()).arg(format!("{}_tb", self.design));
        run.arg(format!("-gSTEPS={}", job.steps)).arg(format!("-gSTIMULUS={stimulus}"));
        if let Some(control) = job.control {
            run.arg(format!("-gCONTROL={}", self.write("control.txt", control)?.display()));
        }
        // The images of program memories are larger than a process may put on its stack unless told otherwise.
        run.args(["--ieee-asserts=disable-at-0", "--max-stack-alloc=0"]).current_dir(&self.scratch);
        match expected {
            Some(expected) => self.children.run_until_difference(&mut run, "ghdl", GHDL_INSTALL, Some(expected)),
            None => self.children.run(&mut run, "ghdl", GHDL_INSTALL),
        }
    }

    /// Runs the test bench of the host in GHDL, with initial words in place of the design's, what the host does, lines of
    /// input words, and gaps of the clock enable; what it printed.
    ///
    /// # Errors
    /// As [`Bench::run`].
    pub fn host(&mut self, words: &[InitialWord], script: &str, stimulus: &str) -> Result<String, Failure> {
        self.analyse(words)?;
        let script = self.write("host_script.txt", script)?;
        let stimulus = self.write("stimulus.txt", stimulus)?;
        let mut run = Command::new("ghdl");
        run.args(["--elab-run", "--std=08"]).args(self.work_folder()).arg(format!("{}_host_tb", self.design));
        run.arg(format!("-gSCRIPT={}", script.display())).arg(format!("-gSTIMULUS={}", stimulus.display()));
        run.args(["-gCE_SEED=1", "--ieee-asserts=disable-at-0", "--max-stack-alloc=0"]).current_dir(&self.scratch);
        self.children.run(&mut run, "ghdl", GHDL_INSTALL)
    }

    fn verilator(&mut self, job: &Job, stimulus: &str) -> Result<String, Failure> {
        self.analyse(job.words)?;
        let mut synthesise = Command::new("ghdl");
        synthesise.args(["--synth", "--std=08", "--out=verilog", "-gTRACE=true"]).args(self.work_folder());
        let netlist = self.children.run(synthesise.arg(&self.design), "ghdl", GHDL_INSTALL)?;
        let file = self.write(&format!("{}.v", self.design), &netlist)?;
        let driver = self.copy(&format!("{}_verilator.cpp", self.design));
        let folder = self.scratch.join("verilated");
        // What another start left there would be taken for this one's.
        let _ = fs::remove_dir_all(&folder);
        let mut build = Command::new("verilator");
        build.args(["--cc", "--exe", "--build", "-Wno-fatal", "-Wno-lint", "-Wno-style", "--top-module", &self.design]);
        build.arg("--Mdir").arg(&folder).args(["-o", "netlist"]).arg(&file).arg(driver);
        if job.steps < BRIEF {
            build.args(["-MAKEFLAGS", "OPT_FAST=-O0 OPT_GLOBAL=-O0"]);
        }
        for tool in ["make", "g++"] {
            self.children.run(Command::new(tool).arg("--version"), tool, "apt-get install g++ make")?;
        }
        self.children.run(&mut build, "verilator", "apt-get install verilator g++ make")?;
        let mut run = Command::new(folder.join("netlist"));
        run.args(["--stimulus", stimulus, "--steps", &job.steps.to_string()]);
        if let Some(control) = job.control {
            run.arg("--control").arg(self.write("control.txt", control)?);
        }
        self.children.run(&mut run, "netlist", "it was just built")
    }
}

/// Bytes of a reference, and steps, below which optimising it takes longer than that saves; the same steps of a netlist.
const SMALL: u64 = 300_000;
const BRIEF: u64 = 1_000;

const GHDL_INSTALL: &str = "apt-get install ghdl";

/// Reads an engine's lines; the error is a line that is none of them.
fn parse(text: &str) -> Result<Run, String> {
    let mut run = Run { flags: Some(Vec::new()), ..Run::default() };
    for line in text.lines() {
        let parsed = match line.split_once(' ') {
            Some(("t", rest)) => TraceLine::parse(rest).map(|line| run.trace.push(line)),
            Some(("o", rest)) => output_line(rest).map(|line| run.outputs.push(line)),
            Some(("s", rest)) => output_line(rest).map(|line| run.states.push(line)),
            Some(("v", "any")) => {
                run.overflow = true;
                Some(())
            }
            Some(("v", pe)) => pe.parse().ok().map(|pe| run.flags.iter_mut().for_each(|flags| flags.push(pe))),
            Some(("h", rest)) => event(rest).map(|event| run.events.push(event)),
            Some(("c", rest)) => rest.parse().ok().map(|clocks| run.clocks = clocks),
            Some(("checks", _)) => Some(()),
            Some(("u", rest)) => rest.parse().ok().map(|clock| run.strays.push(clock)),
            // The simulator's own notes, for example where the test bench finished.
            _ => Some(()),
        };
        parsed.ok_or_else(|| line.to_owned())?;
    }
    run.trace.sort_unstable();
    run.outputs.sort_unstable();
    run.states.sort_unstable();
    Ok(run)
}

fn event(text: &str) -> Option<Event> {
    let (clock, pins) = text.split_once(' ')?;
    Some(Event { clock: clock.parse().ok()?, pins: u8::from_str_radix(pins, 16).ok()? })
}

/// Reads the trace and output files of a design.
pub fn recorded(trace: &str, outputs: &str) -> Option<Run> {
    let mut run = Run {
        trace: trace.lines().map(TraceLine::parse).collect::<Option<_>>()?,
        outputs: outputs.lines().map(output_line).collect::<Option<_>>()?,
        ..Run::default()
    };
    run.trace.sort_unstable();
    run.outputs.sort_unstable();
    Some(run)
}

fn output_line(text: &str) -> Option<(u64, usize, u64)> {
    let mut fields = text.split_ascii_whitespace();
    let step = fields.next()?.parse().ok()?;
    let index = fields.next()?.parse().ok()?;
    let word = u64::from_str_radix(fields.next()?, 16).ok()?;
    fields.next().is_none().then_some((step, index, word))
}

/// Inputs of every step; the last line of the stimulus stays.
pub(crate) fn played<'a>(program: &Program, stimulus: &'a [Vec<i64>]) -> impl Iterator<Item = Cow<'a, [i64]>> {
    let last = stimulus.last().map_or_else(|| Cow::Owned(vec![0; program.inputs.len()]), |last| Cow::from(&last[..]));
    stimulus.iter().map(|line| Cow::from(&line[..])).chain(std::iter::repeat(last))
}

impl Run {
    /// Adds the words that the outputs show after a step.
    pub(crate) fn publish(&mut self, program: &Program, step: u64, words: &[i64]) {
        let mask = u64::MAX >> (64 - program.format.storage_bits);
        let words = words.iter().enumerate();
        self.outputs.extend(words.map(|(index, word)| (step, index, *word as u64 & mask)));
    }
}

/// Runs the program in the simulator of this process.
pub fn simulate(program: &Program, stimulus: &[Vec<i64>], steps: u64) -> Run {
    let mut machine = Machine::new(program);
    let mut run = Run::default();
    for (step, inputs) in (0..steps).zip(played(program, stimulus)) {
        machine.step(&inputs, &mut |line| run.trace.push(line));
        run.publish(program, step, machine.outputs());
    }
    run.trace.sort_unstable();
    run.overflow = machine.overflow();
    run.clocks = if steps < 2 { 0 } else { u64::from(program.period) };
    run
}

/// Compares a run with the simulator's; the error names the first difference.
///
/// `expected_writes` is counted from the control words, not taken from a run.
pub fn compare(program: &Program, engine: &str, run: &Run, expected: &Run, expected_writes: u64) -> Result<(), String> {
    for (is, should) in run.trace.iter().zip(&expected.trace) {
        if is != should {
            let pe = program.pes.find(should.pe).or(program.pes.last()).expect("a program has PEs");
            let word = (should.cycle % u64::from(program.period)) as usize;
            let note = pe.notes[word];
            let value = if should.address < pe.features.write_words() { note.write } else { note.receive };
            return Err(format!(
                "{engine}: first difference in cycle {} (word {word}), PE {}, address {:x} (`{}`): `{is}` instead of `{should}`",
                should.cycle,
                should.pe,
                should.address,
                program.name(value)
            ));
        }
    }
    if run.trace.is_empty() {
        return Err(format!("{engine}: nothing was compared"));
    }
    if run.trace.len() as u64 != expected_writes || expected.trace.len() as u64 != expected_writes {
        return Err(format!("{engine}: {} memory writes instead of {expected_writes}", run.trace.len()));
    }
    shown_alike(program, engine, run, expected)?;
    if run.clocks != expected.clocks {
        return Err(format!("{engine}: {} clocks per step instead of {}", run.clocks, expected.clocks));
    }
    Ok(())
}

/// The same for a run without memory writes and clocks, which shows the words of the states.
fn compare_states(program: &Program, engine: &str, run: &Run, expected: &Run) -> Result<(), String> {
    let states = left_in_states(program, &expected.trace);
    for (is, should) in run.states.iter().zip(&states) {
        if is != should {
            let name = program.states.get(should.1).map_or("", |state| &state.name);
            return Err(format!(
                "{engine}: state `{name}` after step {} is {:x} instead of {:x}",
                should.0, is.2, should.2
            ));
        }
    }
    if run.outputs.is_empty() {
        return Err(format!("{engine}: nothing was compared"));
    }
    if run.states.len() != states.len() {
        return Err(format!("{engine}: {} words of states instead of {}", run.states.len(), states.len()));
    }
    shown_alike(program, engine, run, expected)
}

/// What memory writes leave in the states after each step, as [`Run::states`] has it.
fn left_in_states(program: &Program, trace: &[TraceLine]) -> Vec<(u64, usize, u64)> {
    let (period, pause) = (u64::from(program.period), u64::from(program.latency().pause()));
    let mask = u64::MAX >> (64 - program.format.word_bits());
    let initial = |state: &StateRegister| state.initial(program) as u64 & mask;
    let mut words: Vec<u64> = program.states.iter().map(initial).collect();
    // Words of rings stay where they are, and states move on to the next ones.
    let in_rings = |state: &&StateRegister| state.age.is_some();
    let mut rings: BTreeMap<(PeId, u32), u64> = program
        .states
        .iter()
        .filter(in_rings)
        .map(|state| ((state.own.0, state.own.1.into()), initial(state)))
        .collect();
    let fills_ring =
        |pe: PeId, word: u64| program.pes[pe].words[word as usize].write.is_some_and(|target| target.address.ring);
    let writers = program.states.iter().zip(program.state_writers()).enumerate();
    let states: BTreeMap<(PeId, u64), usize> = writers
        .flat_map(|(state, (register, words))| {
            words.into_iter().map(move |word| ((register.own.0, word.into()), state))
        })
        .collect();
    let mut left = Vec::new();
    for (step, lines) in (0..).zip(trace.chunk_by(|a, b| (a.cycle - pause) / period == (b.cycle - pause) / period)) {
        // What is imported comes behind the addresses that a PE itself writes.
        for line in lines.iter().filter(|line| line.address < program.pes[line.pe].features.write_words()) {
            let word = line.cycle % period;
            if let Some(state) = states.get(&(line.pe, word)) {
                words[*state] = line.value;
            }
            if fills_ring(line.pe, word) {
                rings.insert((line.pe, line.address), line.value);
            }
        }
        for (state, word) in program.states.iter().zip(&mut words).filter(|(state, _)| state.age.is_some()) {
            let pe = state.own.0;
            let place = state.own_word(&program.pes[pe].features, step + 1);
            *word = rings.get(&(pe, place.into())).copied().unwrap_or_default();
        }
        left.extend(words.iter().enumerate().map(|(state, word)| (step, state, *word)));
    }
    left
}

/// Compares outputs and flags.
fn shown_alike(program: &Program, engine: &str, run: &Run, expected: &Run) -> Result<(), String> {
    if run.outputs != expected.outputs {
        let pair = run.outputs.iter().zip(&expected.outputs).find(|(is, should)| is != should);
        return Err(match pair {
            Some((is, should)) => {
                let name = &program.outputs[should.1].name;
                format!("{engine}: output `{name}` of step {} is {:x} instead of {:x}", should.0, is.2, should.2)
            }
            None => format!("{engine}: {} outputs instead of {}", run.outputs.len(), expected.outputs.len()),
        });
    }
    if let Some(clock) = run.strays.first() {
        return Err(format!("{engine}: outputs change in clock {clock} although nothing is published"));
    }
    if run.overflow != expected.overflow {
        return Err(format!("{engine}: overflow flag is {} instead of {}", run.overflow, expected.overflow));
    }
    if let (Some(is), Some(should)) = (&run.flags, &expected.flags)
        && is != should
    {
        return Err(format!("{engine}: sticky flags of PEs {is:?} instead of {should:?}"));
    }
    Ok(())
}

/// Compares a recorded trace, which carries no flags and clocks, with the simulator.
pub fn compare_recorded(program: &Program, recorded: &Run, steps: u64, stimulus: &[Vec<i64>]) -> Result<(), String> {
    let expected = simulate(program, stimulus, steps);
    let complete = Run { overflow: expected.overflow, clocks: expected.clocks, ..recorded.clone() };
    compare(program, "reference trace", &complete, &expected, program.writes_per_step() * steps)
}

/// Share of the traced words that are not zero and differ from what their memory word held before.
pub fn liveliness(run: &Run) -> f64 {
    let mut last = std::collections::HashMap::new();
    let live = run.trace.iter().filter(|line| {
        let before = last.insert((line.pe, line.address), line.value);
        line.value != 0 && before != Some(line.value)
    });
    live.count() as f64 / run.trace.len().max(1) as f64
}
