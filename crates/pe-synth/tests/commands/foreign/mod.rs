//! Foreign entities behind the wrapper: in GHDL and Verilator against models, through hosts, and broken.

mod files;
mod models;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use pe_host::{Design, Error, Host, Settings, Transport};
use pe_map::registers;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use super::wrap::{pe_synth, root};
use crate::support::bench::Folder;
use crate::support::bus::{self, Device};
use crate::support::damage::copied;
use crate::support::kept;
use models::{Counter, Divider, Entity, Smoothing, Step, step};

/// An entity of `testbenches/axi/entities`, with what its map is to say.
struct Case {
    file: &'static str,
    entity: &'static str,
    /// Changes the first map.
    edit: fn(&mut Value),
    how: Step,
    model: fn() -> Box<dyn Entity>,
    /// Steps from one word of each input to the next.
    every: &'static [u64],
}

/// The entry of a port.
fn port<'a>(map: &'a mut Value, name: &str) -> &'a mut Value {
    let ports = map["ports"].as_array_mut().unwrap();
    ports.iter_mut().find(|port| port["name"] == name).unwrap()
}

fn tied(map: &mut Value) {
    *port(map, "mode") =
        json!({"name": "mode", "declared": "in std_logic_vector(1 downto 0)", "role": "constant", "value": "10"});
    *port(map, "spare") = json!({"name": "spare", "declared": "out std_logic_vector(3 downto 0)", "role": "open"});
    port(map, "slow")["every"] = json!(3);
}

const SMOOTHING: Case = Case {
    file: "smoothing.vhd",
    entity: "smoothing",
    edit: |map| {
        tied(map);
        map["clocks"] = json!(2);
        port(map, "x")["exponent"] = json!(-8);
    },
    how: Step::Clocks(2),
    model: || Box::new(Smoothing::new(16, 3, false)),
    every: &[1, 1, 3],
};

/// Other widths, by generics, and a step of other clocks than a filter wants.
const NARROW: Case = Case {
    edit: |map| {
        tied(map);
        map["clocks"] = json!(5);
        for (generic, value) in [json!(12), json!(2), json!(true)].into_iter().enumerate() {
            map["generics"][generic]["value"] = value;
        }
    },
    how: Step::Clocks(5),
    model: || Box::new(Smoothing::new(12, 2, true)),
    ..SMOOTHING
};

const DIVIDER: Case = Case {
    file: "divider.vhd",
    entity: "DIVIDER",
    edit: |_| (),
    how: Step::Ready,
    model: || Box::new(Divider::default()),
    every: &[1, 1],
};

const COUNTER: Case = Case {
    file: "counter.vhd",
    entity: "\\wire\\",
    edit: |map| {
        map["until_ready"] = json!(true);
        *port(map, "last") = json!({"name": "last", "declared": "out std_ulogic", "role": "ready"});
    },
    how: Step::Ready,
    model: || Box::new(Counter::default()),
    every: &[1, 1],
};

/// Wraps an entity by both calls; the folder.
fn wrapped(home: &Path, case: &Case, more: &[&str]) -> PathBuf {
    let folder = home.join("design");
    let file = root().join("testbenches/axi/entities").join(case.file);
    let common = ["wrap", "--vhdl", file.to_str().unwrap(), "--entity", case.entity, "--quiet", "-o"];
    let common = [&common[..], &[folder.to_str().unwrap()]].concat();
    pe_synth(&common);
    let mut written = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let map = written.find(|path| path.to_str().unwrap().ends_with("_entity.json")).unwrap();
    let mut content: Value = serde_json::from_str(&fs::read_to_string(&map).unwrap()).unwrap();
    (case.edit)(&mut content);
    fs::write(&map, content.to_string()).unwrap();
    pe_synth(&[&common[..], &["--map", map.to_str().unwrap()], more].concat());
    folder
}

type Checked = Result<(), String>;

fn same<T: PartialEq + std::fmt::Debug>(what: &str, is: T, should: T) -> Checked {
    if is == should { Ok(()) } else { Err(format!("{what}: {is:?} instead of {should:?}")) }
}

/// An entity beside its model.
struct Pair<'a> {
    case: &'a Case,
    entity: Box<dyn Entity>,
    /// Words that each input has at the entity.
    held: Vec<i64>,
    steps: u64,
    latency: u32,
    random: ChaCha8Rng,
    words: Vec<[i64; 2]>,
}

impl<'a> Pair<'a> {
    fn new(case: &'a Case, words: Vec<[i64; 2]>) -> Pair<'a> {
        let random = ChaCha8Rng::seed_from_u64(3);
        Pair { case, entity: (case.model)(), held: vec![0; words.len()], steps: 0, latency: 0, random, words }
    }

    /// Any words, those at the ends among them, of all lengths.
    fn any(&mut self) -> Vec<i64> {
        let words = self.words.clone();
        words
            .into_iter()
            .map(|[least, most]| match self.random.random_range(0..6) {
                0 => least,
                1 => most,
                _ => self.random.random_range(least..=most) >> self.random.random_range(0..most.max(1).ilog2().max(1)),
            })
            .collect()
    }

    /// A step with these inputs; the outputs.
    fn step(&mut self, inputs: &[i64], how: Step) -> Vec<Option<i64>> {
        for ((held, input), every) in self.held.iter_mut().zip(inputs).zip(self.case.every) {
            if self.steps.is_multiple_of(*every) {
                *held = *input;
            }
        }
        self.steps += 1;
        let (shown, latency) = step(&mut *self.entity, &self.held, how);
        self.latency = latency;
        shown.into_iter().map(Some).collect()
    }

    fn reset(&mut self) {
        self.entity.reset();
        self.steps = 0;
    }
}

/// Steps through a bus master: what is found wrong.
fn exercised(device: &mut Device, pair: &mut Pair) -> Checked {
    let how = pair.case.how;
    let restarts = device.wrap.capabilities.restart;
    same("ID", device.read("ID")?, registers::ID)?;
    same("outputs before a step", device.outputs()?, vec![None; device.wrap.outputs.len()])?;
    let caps = device.read("CAPS")?;
    same("FOREIGN", caps & device.bits("CAPS", &["FOREIGN"]) != 0, true)?;
    same("RESTART", caps & device.bits("CAPS", &["RESTART"]) != 0, restarts)?;
    // Inputs that change in every step.
    for _ in 0..12 {
        let inputs = pair.any();
        device.give(&inputs)?;
        device.run(1)?;
        same("outputs", device.outputs()?, pair.step(&inputs, how))?;
        same("CLOCKS_LAST", device.read("CLOCKS_LAST")?, pair.latency)?;
    }
    // Several steps, which follow each other without a gap.
    let inputs = pair.any();
    device.give(&inputs)?;
    device.command(&["CLEAR"])?;
    device.run(5)?;
    let mut clocks = 0;
    let mut shown = Vec::new();
    for _ in 0..5 {
        shown = pair.step(&inputs, how);
        clocks += pair.latency;
    }
    same("outputs of a run", device.outputs()?, shown)?;
    same("CLOCK_COUNT", device.read("CLOCK_COUNT_LOW")?, clocks)?;
    budget(device, pair)?;
    single_clocks(device, pair)?;
    switched(device, pair)?;
    if device.wrap.capabilities.stream {
        frames(device, pair)?;
    }
    same("STEP_COUNT", u64::from(device.read("STEP_COUNT_LOW")?), pair.steps)?;
    step_clocks(device, pair)?;
    if restarts {
        restarted(device, pair)?;
    }
    Ok(())
}

fn budget(device: &mut Device, pair: &mut Pair) -> Checked {
    let inputs = pair.any();
    device.give(&inputs)?;
    device.write("CLOCK_BUDGET", 1)?;
    device.run(1)?;
    same("TIME_EXCEEDED", device.is("TIME_EXCEEDED")? && device.is("UNFINISHED")?, true)?;
    device.clocks(50)?;
    device.write("STATUS", u32::MAX)?;
    // It goes on with the inputs that it has taken.
    let others = pair.any();
    device.give(&others)?;
    device.write("CLOCK_BUDGET", 0)?;
    device.run(1)?;
    let shown = pair.step(&inputs, pair.case.how);
    same("a step that goes on", device.outputs()?, shown)?;
    let shown = pair.step(&others, pair.case.how);
    device.write("CLOCK_BUDGET", pair.latency)?;
    device.run(1)?;
    same("within the budget", device.is("TIME_EXCEEDED")?, false)?;
    same("outputs within the budget", device.outputs()?, shown)?;
    device.write("CLOCK_BUDGET", 0)
}

fn single_clocks(device: &mut Device, pair: &mut Pair) -> Checked {
    let inputs = pair.any();
    device.give(&inputs)?;
    device.mode(&["HALT"])?;
    device.command(&["START"])?;
    device.clocks(30)?;
    let shown = pair.step(&inputs, pair.case.how);
    for clock in 1.. {
        device.write("SINGLE_CLOCKS", 1)?;
        if !device.is("BUSY")? {
            // One in which it begins, and those until the outputs.
            same("single clocks", clock, pair.latency + 1)?;
            break;
        }
    }
    device.mode(&[])?;
    same("outputs after single clocks", device.outputs()?, shown)
}

/// Inputs that are taken in mid-run act from the next step on, all at once; outputs that are held.
fn switched(device: &mut Device, pair: &mut Pair) -> Checked {
    let (first, second) = (pair.any(), pair.any());
    let before = device.outputs()?;
    device.give(&first)?;
    device.mode(&["HALT", "HOLD"])?;
    device.write("RUN_STEPS", 2)?;
    device.command(&["START"])?;
    // The first step has begun.
    device.write("SINGLE_CLOCKS", 2)?;
    device.give(&second)?;
    device.command(&["INPUTS"])?;
    device.mode(&["HOLD"])?;
    device.await_bit("BUSY", false)?;
    same("held outputs", device.outputs()?, before)?;
    device.mode(&[])?;
    pair.step(&first, pair.case.how);
    let shown = pair.step(&second, pair.case.how);
    same("inputs that were taken in a step", device.outputs()?, shown)?;
    device.write("RUN_STEPS", 1)
}

fn frames(device: &mut Device, pair: &mut Pair) -> Checked {
    device.mode(&["FREE_RUN", "STREAM"])?;
    device.command(&["START"])?;
    let halves = |words: &[i64], places: &[pe_map::wrap::Place], wide: bool| -> Vec<String> {
        let half = |word: i64, half: u32| (word >> (32 * half)) as u32;
        let text = |word| if wide { format!("{word:08X}") } else { format!("{word:x}") };
        places
            .iter()
            .zip(words)
            .flat_map(|(place, word)| (0..place.words).map(move |at| text(half(*word, at))))
            .collect()
    };
    let (inputs, outputs) = (device.wrap.inputs.clone(), device.wrap.outputs.clone());
    let mut waiting = std::collections::VecDeque::new();
    for round in 0..19 {
        while round < 16 && waiting.len() < 1 + round % 4 {
            let words = pair.any();
            same("a frame in", device.ask(&format!("i {}", halves(&words, &inputs, false).join(" ")))?.as_str(), "ok")?;
            waiting.push_back(words);
        }
        device.clocks(pair.random.random_range(0..60))?;
        let given = waiting.pop_front().unwrap();
        let shown: Vec<i64> = pair.step(&given, pair.case.how).into_iter().flatten().collect();
        same("a frame out", device.ask("o")?, halves(&shown, &outputs, true).join(" "))?;
    }
    device.command(&["ABORT"])?;
    device.await_bit("BUSY", false)?;
    device.mode(&[])
}

/// Clocks of a step that a host sets.
fn step_clocks(device: &mut Device, pair: &mut Pair) -> Checked {
    let own = device.read("STEP_CLOCKS")?;
    let ready = device.wrap.capabilities.ready;
    same("STEP_CLOCKS of 0", device.try_write("STEP_CLOCKS", 0)?, ready)?;
    device.write("STEP_CLOCKS", 7)?;
    let inputs = pair.any();
    device.give(&inputs)?;
    device.run(1)?;
    let shown = pair.step(&inputs, Step::Clocks(7));
    same("outputs after other clocks", device.outputs()?, shown)?;
    device.write("STEP_CLOCKS", own)?;
    let inputs = pair.any();
    device.give(&inputs)?;
    device.run(1)?;
    let shown = pair.step(&inputs, pair.case.how);
    same("outputs after the usual clocks", device.outputs()?, shown)
}

fn restarted(device: &mut Device, pair: &mut Pair) -> Checked {
    device.mode(&["FREE_RUN"])?;
    device.command(&["START"])?;
    device.clocks(13)?;
    device.command(&["RESTART"])?;
    device.await_bit("BUSY", false)?;
    device.mode(&[])?;
    pair.reset();
    same("outputs after a restart", device.outputs()?, vec![None; device.wrap.outputs.len()])?;
    for _ in 0..4 {
        let inputs = pair.any();
        device.give(&inputs)?;
        device.run(1)?;
        same("outputs after a restart", device.outputs()?, pair.step(&inputs, pair.case.how))?;
    }
    Ok(())
}

type Build = fn(&Path, &Path) -> Vec<String>;

fn judged(design: &Path, scratch: &Path, case: &Case, build: Build) -> Checked {
    let mut device = Device::start(&build(design, scratch), design, scratch);
    let words = device.map.inputs.iter().map(|input| input.words).collect();
    exercised(&mut device, &mut Pair::new(case, words))
}

#[test]
fn wrapped_entities_do_what_the_page_says() {
    let cases = [
        (SMOOTHING, bus::ghdl as Build, &["--stream"][..]),
        (NARROW, bus::ghdl, &[]),
        (DIVIDER, bus::ghdl, &[]),
        (COUNTER, bus::ghdl, &["--stream"]),
        (DIVIDER, bus::verilator, &["--stream"]),
    ];
    for (number, (case, build, stream)) in kept(cases, 4).enumerate() {
        let folder = Folder::new(&format!("foreign_{number}"));
        let design = wrapped(&folder.0, &case, stream);
        let judged = judged(&design, &folder.sub("scratch"), &case, build);
        judged.unwrap_or_else(|what| panic!("{number}, {}: {what}", case.entity));
    }
}

/// Damages: file, what is there, what takes its place.
const DAMAGES: [(&str, &str, &str); 12] = [
    // `start` is held.
    ("hdl/pe_foreign.vhd", "start_o  <= first;", "start_o  <= stepping;"),
    // There is no `start`.
    ("hdl/pe_foreign.vhd", "start_o  <= first;", "start_o  <= '0';"),
    // `ready` of the step before ends this one.
    ("hdl/pe_foreign.vhd", "ready_i and not first when", "ready_i when"),
    // A clock too many.
    ("hdl/pe_foreign.vhd", "when left = 1 else", "when left = 0 else"),
    // Between two steps the entity goes on.
    ("hdl/pe_foreign.vhd", "enable_o <= ce_i and busy;", "enable_o <= ce_i;"),
    // A step that was stopped goes on behind the host's back.
    ("hdl/pe_foreign.vhd", "enable_o <= ce_i and busy;", "enable_o <= busy;"),
    // Outputs are read a clock late.
    ("hdl/pe_foreign.vhd", "show_o   <= ends when", "show_o   <= done when"),
    // Inputs are a step late.
    ("hdl/pe_foreign.vhd", "take_o   <= begins;", "take_o   <= done;"),
    // Inputs act in the middle of a step.
    ("hdl/pe_held_input.vhd", "word_o <= word;", "word_o <= word_i;"),
    // Outputs of a step are not kept.
    ("hdl/pe_held_output.vhd", "word_o <= word_i when show_i = '1' else\n            word;", "word_o <= word_i;"),
    // The reset comes without the clock enable.
    ("hdl/pe_foreign.vhd", "enable_o <= ce_i and busy;", "enable_o <= ce_i and stepping;"),
    // Steps are not counted anew.
    ("hdl/pe_held_input.vhd", "if (renew_i = '1') then", "if (false) then"),
];

#[test]
fn a_broken_wrapper_of_an_entity_is_caught() {
    let folder = Folder::new("foreign_broken");
    let cases: Vec<(Case, PathBuf)> = [SMOOTHING, DIVIDER, COUNTER]
        .into_iter()
        .map(|case| {
            let design = wrapped(&folder.sub(case.file), &case, &["--stream"]);
            (case, design)
        })
        .collect();
    let mut missed = Vec::new();
    for (number, (file, from, to)) in DAMAGES.into_iter().enumerate() {
        let caught = cases.iter().any(|(case, design)| {
            let scratch = folder.sub(&format!("{}_scratch_{number}", case.file));
            let broken = copied(design, &folder.0.join(format!("{}_{number}", case.file)));
            let text = fs::read_to_string(broken.join(file)).unwrap();
            assert_eq!(text.matches(from).count(), 1, "{file}: `{from}`");
            fs::write(broken.join(file), text.replace(from, to)).unwrap();
            judged(&broken, &scratch, case, bus::ghdl).is_err()
        });
        if !caught {
            missed.push((from, to));
        }
    }
    assert_eq!(missed, Vec::<(&str, &str)>::new(), "not caught");
}

fn open(folder: &Path, transport: &str) -> Result<Host, Error> {
    let settings = Settings { timeout: Some(Duration::from_secs(5)), ..Settings::default() };
    Host::open(folder, &transport.parse::<Transport>().expect("a transport"), &settings)
}

/// A host's program: steps with words that change every time, in numbers and in words, and a reset.
fn hosted(host: &mut Host, case: &Case) {
    let mut pair = Pair::new(case, host.inputs().map(|input| input.words).collect());
    assert!(host.read_words().unwrap().iter().all(Option::is_none));
    for round in 0..2 {
        for number in 0..60 {
            let inputs = pair.any();
            let steps = if number % 8 == 7 { 3 } else { 1 };
            let mut shown = Vec::new();
            (0..steps).for_each(|_| shown = pair.step(&inputs, case.how));
            assert_eq!(host.exchange_words(&inputs, steps).unwrap(), shown, "{} {round} {number}", case.entity);
        }
        let outputs: Vec<f64> =
            host.map().outputs.iter().zip(host.last_words()).map(|(o, w)| o.format.number(w.unwrap())).collect();
        let mut read = vec![0.0; outputs.len()];
        host.read(&mut read).unwrap();
        assert_eq!(read, outputs);
        host.reset().unwrap();
        pair.reset();
    }
}

#[test]
fn hosts_drive_entities_as_they_do_networks() {
    for (number, (case, transport)) in
        [(SMOOTHING, "ghdl"), (COUNTER, "ghdl"), (DIVIDER, "verilator")].into_iter().enumerate()
    {
        let folder = Folder::new(&format!("foreign_host_{number}"));
        let design = wrapped(&folder.0, &case, &[]);
        hosted(&mut open(&design, transport).unwrap(), &case);
        for model in ["model", "fast", "clocked"] {
            let error = open(&design, model).err().expect("there is no model");
            assert!(error.to_string().contains("of which there is no model"), "{error}");
        }
        // Over the network, as a board is reached.
        let bus =
            "ghdl".parse::<Transport>().unwrap().bus(&Design::open(&design).unwrap(), &Settings::default()).unwrap();
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        std::thread::spawn(move || pe_host::serve_tcp(bus, &listener));
        let mut host = open(&design, &format!("tcp:{address}")).unwrap();
        let mut pair = Pair::new(&case, host.inputs().map(|input| input.words).collect());
        for _ in 0..20 {
            let inputs = pair.any();
            assert_eq!(host.exchange_words(&inputs, 1).unwrap(), pair.step(&inputs, case.how));
        }
    }
}

#[test]
fn numbers_become_words_as_the_map_says() {
    let folder = Folder::new("foreign_numbers");
    let design = wrapped(
        &folder.0,
        &Case {
            edit: |map| {
                (SMOOTHING.edit)(map);
                port(map, "x")["range"] = json!([-10.0, 10.0]);
                port(map, "x")["rounding"] = json!("down");
                port(map, "y")["exponent"] = json!(-12);
                port(map, "gain")["exponent"] = json!(1);
            },
            ..SMOOTHING
        },
        &[],
    );
    let mut host = open(&design, "ghdl").unwrap();
    let mut outputs = vec![0.0; 5];
    let mut read = |inputs: &[f64]| {
        let exchanged = host.exchange(inputs, 1, &mut outputs).unwrap();
        (exchanged.written.clamped, exchanged.written.beyond_range, outputs.clone())
    };
    // 1.01 * 256 is 258.56, and 258 in the entity; 5 / 2 rounds to 3.
    let (clamped, beyond, shown) = read(&[1.01, 5.0, 77.0]);
    assert_eq!((clamped, beyond), (vec![], vec![]));
    assert_eq!(shown, [1.0, 258.0 * 16.0 / 8.0 / 4096.0, 261.0, 2.0, 77.0]);
    let (clamped, beyond, shown) = read(&[-1000.0, -3.0, 300.0]);
    assert_eq!((clamped, beyond), (vec![0, 1, 2], vec![0]));
    assert_eq!(shown[2..], [f64::from(0x8000), 4.0, 77.0]);
    // Words that the port cannot carry are refused: they would be cut off.
    for words in [[0, -1, 0], [0, 16, 0], [1 << 15, 0, 0], [0, 0, 256]] {
        assert!(matches!(host.write_words(&words), Err(Error::Range(_))), "{words:?}");
    }
}
