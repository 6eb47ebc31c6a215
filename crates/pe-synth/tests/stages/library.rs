//! The reference as a library, called from C: both forms against the simulator, step by step, with inputs that change in every
//! step, states that move to another network in the middle of a run, saturation and misuse.

use std::fmt::Write as _;
use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use pe_ir::index::StateId;
use pe_ir::model::Solver;
use pe_ir::program::Program;
use pe_ir::word::Pipeline;
use pe_sim::clocked::Clocked;
use pe_sim::machine::{Machine, output_word};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::support::bench::{Folder, emit};
use crate::support::flow::{Flow, Placement, format};
use crate::support::models::compile;
use crate::support::{Family, kept};

/// Steps of a run; in the middle its state moves.
const STEPS: usize = 12;
const MIDDLE: usize = 5;

/// A C program that calls libraries, and the folder of what was built.
struct Host {
    folder: Folder,
    program: PathBuf,
}

fn run(command: &mut Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

impl Host {
    fn new(name: &str) -> Host {
        let folder = Folder::new(name);
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/support/library_host.c");
        let program = folder.0.join("host");
        run(Command::new("cc")
            .args(["-std=gnu11", "-Wall", "-Werror", "-O1", "-o"])
            .arg(&program)
            .arg(source)
            .arg("-ldl"));
        Host { folder, program }
    }

    /// Builds the library of a program.
    fn build(&self, label: &str, program: &Program) -> Library<'_> {
        let folder = self.folder.sub(label);
        emit(program, &[vec![0; program.ports().count()]], &folder);
        let name = pe_emit::design_name(program);
        let library = folder.join("library.so");
        let mut build = Command::new("rustc");
        build.args(["--edition", "2021", "-O", "-D", "warnings", "--crate-type", "cdylib", "-o"]).arg(&library);
        run(build.arg(folder.join(format!("{name}_reference.rs"))));
        Library { host: self, library, name }
    }
}

struct Library<'a> {
    host: &'a Host,
    library: PathBuf,
    name: String,
}

impl Library<'_> {
    /// Answers to lines of commands.
    fn answers(&self, script: &str) -> Vec<String> {
        let mut host = Command::new(&self.host.program);
        host.arg(&self.library).arg(&self.name).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = host.spawn().expect("it was just built");
        let (mut stdin, text) = (child.stdin.take().expect("a pipe"), script.to_owned());
        let writer = std::thread::spawn(move || stdin.write_all(text.as_bytes()));
        let output = child.wait_with_output().expect("it ends");
        writer.join().expect("no panic").expect("it reads all");
        assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("text").lines().map(str::to_owned).collect()
    }
}

/// Commands and what must come back.
#[derive(Default)]
struct Script {
    commands: String,
    expected: Vec<String>,
}

impl Script {
    fn call(&mut self, command: &str, expected: impl Into<String>) {
        self.commands += command;
        self.commands += "\n";
        self.expected.push(expected.into());
    }

    fn check(&self, label: &str, library: &Library) -> usize {
        let answers = library.answers(&self.commands);
        for ((command, is), should) in self.commands.lines().zip(&answers).zip(&self.expected) {
            // A star stands for anything.
            let equal = should.strip_suffix('*').map_or(is == should, |start| is.starts_with(start));
            assert!(equal, "{label}: `{command}` gives `{is}` instead of `{should}`");
        }
        assert_eq!(answers.len(), self.expected.len(), "{label}");
        answers.len()
    }
}

fn listed(words: impl IntoIterator<Item = i64>) -> String {
    words.into_iter().fold(String::new(), |mut text, word| {
        write!(text, " {word}").expect("memory takes the word");
        text
    })
}

/// Words of the states, then steps since the last sample of each tick, after some steps.
fn state_words(program: &Program, machine: &Machine<&Program>, steps: u64) -> Vec<i64> {
    let states = program.states.ids().map(|state| machine.state(state));
    let since = program.ticks().map(|(_, tick, _)| ((steps + u64::from(tick.done)) % u64::from(tick.steps)) as i64);
    states.chain(since).collect()
}

/// Answer to `out` before the first step.
fn outputs_of_the_state(program: &Program, state: impl Fn(StateId) -> i64) -> String {
    let shown = program.shown_states();
    let words = shown.iter().map(|shown| shown.map_or(0, |id| output_word(&program.format, state(id))));
    format!("out {}{}", i32::from(shown.contains(&None)), listed(words))
}

/// A run of both forms, `others` of which start in its middle with the state of the other form.
fn script(program: &Program, inputs: &[Vec<i64>]) -> Script {
    let mut script = Script::default();
    let (outputs, words) = (program.outputs.len(), program.states.len() + program.ticks().count());
    let bits = program.format.storage_bits;
    script.call("counts", format!("counts 1 {} {outputs} {words} {}*", program.ports().count(), program.period));
    for slot in [0, 1] {
        script.call(&format!("new {slot} {slot}"), "new 1");
    }
    let machine = Machine::new(program);
    for slot in [0, 1] {
        script.call(&format!("out {slot} {outputs}"), outputs_of_the_state(program, |id| machine.state(id)));
        script.call(&format!("state {slot} {words}"), format!("state 0{}", listed(state_words(program, &machine, 0))));
    }
    // Once more after a reset.
    for round in 0..2 {
        let mut machine = Machine::new(program);
        let mut slots = vec![0, 1];
        for (step, inputs) in inputs.iter().enumerate() {
            machine.step(inputs, &mut |_| {});
            let state = listed(state_words(program, &machine, step as u64 + 1));
            for slot in &slots {
                script.call(&format!("in {slot}{}", listed(inputs.iter().copied())), "in 0");
                script.call(&format!("step {slot} 1"), "step 0");
                script.call(&format!("out {slot} {outputs}"), format!("out 0{}", listed(machine.outputs().to_vec())));
                script.call(&format!("state {slot} {words}"), format!("state 0{state}"));
                let flags = if machine.overflow() { "flags 0 *" } else { "flags 0 0" };
                script.call(&format!("flags {slot}"), flags);
            }
            if step == MIDDLE && round == 0 {
                for (from, to, form) in [(0, 2, 1), (1, 3, 0)] {
                    script.call(&format!("new {to} {form}"), "new 1");
                    script.call(&format!("step {to} 2"), "step 0");
                    script.call(&format!("move {from} {to}"), "move 0");
                    let shown = outputs_of_the_state(program, |id| machine.state(id));
                    script.call(&format!("out {to} {outputs}"), shown);
                    script.call(&format!("state {to} {words}"), format!("state 0{state}"));
                    // A network of its own has its own flags.
                    if !machine.overflow() {
                        script.call(&format!("clear {to}"), "clear 0");
                        slots.push(to);
                    }
                }
            }
        }
        for slot in slots {
            script.call(&format!("reset {slot}"), "reset 0");
            script.call(&format!("flags {slot}"), "flags 0 0");
        }
    }
    // Misuse leaves everything as it is.
    let initial = format!("state 0{}", listed(state_words(program, &Machine::new(program), 0)));
    script.call("nulls 0", "nulls -1 -1 -1 -1 -1 -1 -1 -1 -2 -2 -2 -2 -2 -2");
    script.call("new 4 7", "new 0");
    script.call(&format!("out 0 {}", outputs + 1), "out -2");
    script.call(&format!("state 1 {}", words - 1), "state -2");
    script.call(&format!("set 0{}", listed(vec![0; words + 1])), "set -2");
    let mut beyond = vec![0; words];
    beyond[0] = i64::MAX;
    script.call(&format!("set 0{}", listed(beyond)), "set -3");
    if program.ports().count() > 0 {
        let mut words = vec![0; program.ports().count()];
        words[0] = 1 << (bits - 1);
        script.call(&format!("in 1{}", listed(words)), "in -3");
    }
    for slot in [0, 1] {
        script.call(&format!("state {slot} {words}"), initial.clone());
        script.call(&format!("free {slot}"), "free");
        script.call(&format!("step {slot} 1"), "step -1");
    }
    script
}

/// Port words that change in every step; those at the limits saturate.
fn changing(program: &Program, at_limits: bool, rng: &mut impl Rng) -> Vec<Vec<i64>> {
    let largest = (1i64 << (program.format.storage_bits - 1)) - 1;
    let limits = [-largest - 1, largest, largest - 1, -largest];
    let mut word = || match at_limits {
        true => limits[rng.random_range(0..limits.len())],
        false => rng.random_range(-largest / 8..=largest / 8),
    };
    (0..STEPS).map(|_| program.ports().map(|_| word()).collect()).collect()
}

/// Random states in which much saturates: both forms against the simulator clock by clock, or, where it is proven that
/// nothing does, against each other. How many runs raised a flag.
fn saturating(label: &str, program: &Program, library: &Library, rng: &mut impl Rng) -> u32 {
    let (mut raised, outputs, words) = (0, program.outputs.len(), program.states.len() + program.ticks().count());
    for _ in 0..4 {
        let inputs = changing(program, true, rng);
        let most = program.format.max_word();
        let states: Vec<i64> = program
            .states
            .iter()
            .map(|_| if rng.random_bool(0.5) { rng.random_range(-most..=most) } else { most })
            .collect();
        let mut started = program.clone();
        for (register, word) in program.states.iter().zip(&states) {
            register.set(&mut started.pes, &program.format, *word);
        }
        started.start_ticks(0);
        let mut network = Clocked::new(&started);
        let mut script = Script::default();
        for slot in [0, 1] {
            script.call(&format!("new {slot} {slot}"), "new 1");
            let words = states.iter().copied().chain(program.ticks().map(|_| 0));
            script.call(&format!("set {slot}{}", listed(words)), "set 0");
        }
        for inputs in &inputs {
            network.step(inputs, &mut |_| {});
            for slot in [0, 1] {
                script.call(&format!("in {slot}{}", listed(inputs.iter().copied())), "in 0");
                script.call(&format!("step {slot} 1"), "step 0");
                let shown = format!("out 0{}", listed(network.outputs()));
                script.call(&format!("out {slot} {outputs}"), if network.escaped() { "out 0*".into() } else { shown });
                script.call(&format!("state {slot} {words}"), "state 0*");
                let quiet = network.overflow_cycle().is_none() && !network.escaped();
                script.call(&format!("flags {slot}"), if quiet { "flags 0 0" } else { "flags 0 *" });
            }
        }
        script.check(label, library);
        let answers: Vec<String> = library.answers(&script.commands).split_off(4);
        for step in answers.chunks_exact(10) {
            assert_eq!(step[..5], step[5..], "{label}: the forms differ");
        }
        raised += u32::from(answers.last().is_some_and(|flags| flags != "flags 0 0"));
    }
    raised
}

/// Both kinds of runs of a design: calls that were compared, and runs that raised a flag.
fn agree(host: &Host, label: &str, program: &Program, seed: u64) -> (usize, u32) {
    let library = host.build(label, program);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let calls = script(program, &changing(program, false, &mut rng)).check(label, &library);
    let raised = saturating(label, program, &library, &mut rng);
    fs::remove_dir_all(host.folder.sub(label)).expect("the test's own folder");
    (calls, raised)
}

/// Models with options that make them small; so many of them without the long suite.
const MODELS: [(&str, &[&str]); 24] = [
    ("lorenz", &["--pes", "3", "--span", "1s", "--storage", "48", "--multiplier", "25x18"]),
    ("lung", &["--pes", "3"]),
    ("motor_pid", &["--pes", "2", "--span", "20ms"]),
    ("pendulum", &["--pes", "2", "--span", "1s", "--pipeline", "deep"]),
    ("pump_station", &["--pes", "3", "--solver", "heun", "--multiplier", "25x18", "--span", "10ms"]),
    ("rc_ladder", &["--pes", "2", "--span", "20ms", "--multiplier", "25x18", "--coefficients", "two-slot"]),
    ("van_der_pol", &["--pes", "2", "--storage", "48", "--multiplier", "35x35", "--span", "2s"]),
    ("weibel5", &["--pes", "9", "--multiplier", "25x18", "--span", "20ms", "--loop", "on"]),
    ("atrial3", &["--pes", "7"]),
    ("gray_scott", &["--pes", "4", "--span", "10s"]),
    ("harmonic_oscillator", &["--pes", "2", "--storage", "18", "--multiplier", "18x25"]),
    ("heat_plate", &["--pes", "4", "--span", "100ms"]),
    ("hodgkin_huxley", &["--pes", "2", "--span", "2ms"]),
    ("kepler", &["--pes", "2", "--span", "1s"]),
    ("lotka_volterra", &["--pes", "1", "--solver", "euler", "--span", "100ms"]),
    ("lutchen20", &["--pes", "5", "--span", "4ms"]),
    ("lutchen_breathing", &["--pes", "4", "--span", "50ms"]),
    ("spring_chain", &["--pes", "3", "--solver", "symplectic_euler", "--span", "400ms"]),
    ("wave6", &["--pes", "6", "--multiplier", "25x18"]),
    ("wave_fdtd", &["--pes", "4", "--span", "10ms"]),
    ("weibel11", &["--pes", "16", "--span", "1ms", "--tries", "100"]),
    ("weibel11_pressure", &["--pes", "16", "--span", "1ms", "--tries", "100"]),
    ("weibel11_square", &["--pes", "16", "--span", "1ms", "--tries", "100"]),
    ("lutchen4000", &["--pes", "64", "--span", "1ms", "--tries", "10"]),
];

const SHORT: usize = 8;

#[test]
fn the_library_of_every_model_agrees_with_the_simulator() {
    let host = Host::new("library_models");
    let (mut calls, mut raised) = (0, 0);
    for (seed, (model, options)) in (1..).zip(kept(MODELS, SHORT)) {
        let (compared, flagged) = agree(&host, model, &compile(model, options).design.program, seed);
        println!("{model}: {compared} calls, {flagged} runs with flags");
        calls += compared;
        raised += flagged;
    }
    println!("models: {calls} calls equal, {raised} runs raised flags");
    assert!(calls > 2000 && raised > 10, "{calls} calls, {raised} runs");
}

#[test]
fn the_library_of_generated_designs_agrees_with_the_simulator() {
    let host = Host::new("library_generated");
    let scattered =
        |family, size, solver, format, seed| Flow::random(family, size, solver, format, Placement::Scattered, seed);
    let deep = format(32, 25, 18).with_pipeline(Pipeline::Deep);
    let flows = [
        scattered(Family::Shared, (8, 3), Solver::Euler, format(18, 18, 25), 901),
        scattered(Family::Polynomial, (8, 3), Solver::Rk4, format(40, 35, 35), 902),
        scattered(Family::Affine, (9, 4), Solver::Heun3, format(32, 25, 18), 903).looped().expect("alike"),
        scattered(Family::Grid, (9, 3), Solver::Heun, deep, 904),
        Flow::tabled((9, 3), Solver::Heun3, deep, Placement::Scattered, 905),
        Flow::tabled((9, 3), Solver::Rk4, format(40, 35, 35), Placement::Scattered, 906),
    ];
    let (mut calls, mut raised) = (0, 0);
    for (seed, flow) in (1..).zip(&flows) {
        let (compared, flagged) = agree(&host, &format!("design{seed}"), &flow.program, seed);
        println!("{}: {compared} calls, {flagged} runs with flags", flow.label);
        calls += compared;
        raised += flagged;
    }
    assert!(calls > 1500 && raised > 5, "{calls} calls, {raised} runs");
}
