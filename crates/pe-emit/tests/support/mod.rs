//! Random programs, and the engines that run an emitted design: Rust reference, GHDL, Verilator.

#![allow(dead_code)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pe_emit::{EmitOptions, design_name, emit};
use pe_ir::index::{List, PeId, PortId, ValueId};
use pe_ir::program::{
    Address, CoefficientOperand, ControlWord, FieldName, InputPort, LinkSource, Note, OutputPort, PeFeatures,
    PeProgram, Program, Target,
};
use pe_ir::word::{Pipeline, WordFormat};

/// A small generator of reproducible numbers (splitmix64).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    pub fn below(&mut self, limit: u64) -> u64 {
        self.next() % limit
    }

    pub fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }

    /// A signed number of `bits` bits; now and then an extreme one.
    pub fn signed(&mut self, bits: u32) -> i64 {
        match self.below(12) {
            0 => (1 << (bits - 1)) - 1,
            1 => -(1 << (bits - 1)),
            _ => self.next() as i64 >> (64 - bits) >> self.below(u64::from(bits / 2)),
        }
    }
}

/// What a random program is made of; one PE per entry of `pes`.
pub struct Case {
    pub name: &'static str,
    pub storage: u32,
    pub multiplier: (u32, u32),
    pub pipeline: Pipeline,
    pub pes: Vec<PeFeatures>,
    pub period: u32,
    pub inputs: u32,
    pub seed: u64,
}

/// Shorthand for a feature record: own words, imported words, ports, shifts, and the flags among `fpws` for factor,
/// pre-adder, swap and send; `t` is for tables, `o` for tables of octaves, `r` for rings.
pub fn features(own: u32, imported: u32, ports: u32, shifts: &[u8], accumulator_bits: u32, flags: &str) -> PeFeatures {
    let tables = flags.contains(['t', 'o']);
    PeFeatures {
        own_words: own,
        // Deeper than an own memory that swaps, as deep, or half as deep.
        base_words: match (flags.contains('w'), tables) {
            (true, false) => own.max(4) / 2,
            (false, false) => own,
            (_, true) => own.max(8),
        },
        coefficient_words: if flags.contains('f') { own.max(8) } else { 0 },
        imported_words: imported,
        ports,
        shifts: shifts.to_vec(),
        accumulator_bits,
        factor: flags.contains('f'),
        pre_adder: flags.contains('p'),
        ring_bits: if flags.contains('r') { 2 } else { 0 },
        swap: flags.contains('w'),
        base_last: flags.contains('l'),
        send: flags.contains('s'),
        proven: false,
        index_words: if tables { 4 } else { 0 },
        index_bits: if tables { 3 } else { 0 },
        octave_bits: if flags.contains('o') { 2 } else { 0 },
        shown_words: 0,
        show_last: false,
    }
}

/// A program of random legal control words.
pub fn random_program(case: &Case) -> Program {
    let mut random = Random(case.seed);
    let format = WordFormat::new(case.storage, case.multiplier.0, case.multiplier.1).with_pipeline(case.pipeline);
    let senders: Vec<PeId> = PeId::all(case.pes.len() as u32).filter(|pe| case.pes[pe.index()].send).collect();
    let pes = case.pes.iter().map(|features| random_pe(&mut random, case, &format, features, &senders)).collect();
    let mut program = Program {
        model: case.name.to_owned(),
        format,
        period: case.period,
        rounds: 1,
        host: pe_ir::program::Host::default(),
        pes,
        inputs: Vec::new(),
        outputs: Vec::new(),
        states: List::new(),
        names: vec!["V[1].u2".to_owned(), "hostile\n\"; end; -- */ \\".to_owned(), "x".repeat(100)].into(),
    };
    for index in 0..case.inputs {
        let unit = (index == 0).then(|| "mV\n".to_owned());
        program.inputs.push(InputPort {
            name: ["signal", "V[1]", "v(1)"][index as usize % 3].to_owned(),
            unit,
            exponent: -3,
            tick: None,
        });
    }
    let pause = program.latency().pause();
    // Rounds that are alike but for coefficients and writes.
    if case.period.is_multiple_of(3) && case.period / 3 > pause {
        program.rounds = 3;
        for pe in &mut program.pes {
            for k in case.period as usize / 3..case.period as usize {
                let like = pe.words[k % (case.period as usize / 3)];
                pe.words[k] = ControlWord { coefficient: pe.words[k].coefficient, write: pe.words[k].write, ..like };
            }
        }
    }
    for (index, pe) in PeId::all(case.pes.len() as u32).chain([PeId::new(0)]).enumerate() {
        // The word before the pause point belongs to the next step already.
        let word = match random.below(u64::from(case.period)) as u32 {
            word if word == pause - 1 => 0,
            word => word,
        };
        let name = ["y", "Y", "clk", ""][index % 4].to_owned();
        program.outputs.push(OutputPort { name, unit: None, pe, word, exponent: -20, proven: false, place: None });
    }
    program
}

fn random_pe(
    random: &mut Random,
    case: &Case,
    format: &WordFormat,
    features: &PeFeatures,
    senders: &[PeId],
) -> PeProgram {
    let ports = (0..features.ports).map(|port| {
        if case.inputs > 0 && (senders.is_empty() || (port == 0 && random.chance(70))) {
            LinkSource::Input(random.below(u64::from(case.inputs)) as u32)
        } else {
            LinkSource::Pe(senders[random.below(senders.len() as u64) as usize])
        }
    });
    let ports = ports.collect();
    let words = (0..case.period).map(|_| random_word(random, format, features)).collect();
    let note = |random: &mut Random| match random.below(4) {
        3 => None,
        id => Some(ValueId::new(id as u32)),
    };
    let notes = (0..case.period).map(|_| Note {
        operand: note(random),
        chain: note(random),
        write: note(random),
        receive: note(random),
    });
    let notes = notes.collect();
    PeProgram {
        features: features.clone(),
        ports,
        equations: vec!["V[1]".to_owned(), "h\u{e9}\n--".to_owned()],
        words,
        notes,
        own_image: (0..features.own_words).map(|_| random.signed(format.data_bits)).collect(),
        base_image: (0..features.base_words).map(|_| random.signed(format.word_bits())).collect(),
        coefficient_image: (0..features.coefficient_words).map(|_| random.signed(format.coefficient_bits)).collect(),
        imported_image: (0..features.imported_words).map(|_| random.signed(format.data_bits)).collect(),
        varied: FieldName::ALL.into_iter().filter(|_| random.chance(30)).collect(),
    }
}

fn random_word(random: &mut Random, format: &WordFormat, features: &PeFeatures) -> ControlWord {
    let imports = features.imported_words > 0;
    let address = |random: &mut Random, depth: u32| {
        let ring = features.ring_bits > 0 && depth >> features.ring_bits > 0 && random.chance(50);
        let word = random.below(u64::from(depth)) as u16;
        Address { word, swap: features.swap && !ring && random.chance(50), ring }
    };
    let mut word = ControlWord::default();
    match random.below(5) {
        0 => {}
        1 | 2 if imports => word.imported = Some(address(random, features.imported_words)),
        _ => word.own = Some(address(random, features.own_words)),
    }
    if imports && features.pre_adder && random.chance(30) {
        word.own = Some(address(random, features.own_words));
        word.imported = Some(address(random, features.imported_words));
    }
    word.coefficient = if features.coefficient_words > 0 {
        CoefficientOperand::Stored(random.below(u64::from(features.coefficient_words)) as u16)
    } else {
        CoefficientOperand::Coefficient(random.signed(format.coefficient_bits))
    };
    word.close = random.chance(30);
    word.base = random.chance(60).then(|| random.below(u64::from(features.base_words)) as u16);
    if features.index_words > 0 {
        word.index = random.chance(50).then(|| random.below(u64::from(features.index_words)) as u16);
        let octaves = features.octave_bits > 0 && random.chance(60);
        word.write_index = random.chance(50).then(|| (random.below(u64::from(features.index_words)) as u16, octaves));
    }
    word.shift = random.below(features.shifts.len() as u64) as u8;
    let mut target = Target {
        address: address(random, features.write_words()),
        own: random.chance(50),
        base: random.chance(40),
        factor: features.factor && random.chance(30),
    };
    if target.address.ring {
        // A ring has words of the own memory alone.
        target = Target { address: address(random, features.own_words), own: true, base: false, factor: false };
    }
    word.write = (target.own || target.base || target.factor).then_some(target);
    word.send = features.send && random.chance(50);
    if imports && features.ports > 0 && random.chance(50) {
        let port = PortId::new(random.below(u64::from(features.ports)) as u8);
        word.receive = Some((port, address(random, features.imported_words)));
    }
    word
}

/// An emitted design in a directory of its own.
pub struct Design {
    pub directory: PathBuf,
    pub model: String,
}

/// Random input words.
pub fn stimulus(program: &Program, steps: u32, seed: u64) -> Vec<Vec<i64>> {
    let mut random = Random(seed);
    let mut word = || random.signed(program.format.storage_bits);
    (0..steps).map(|_| program.inputs.iter().map(|_| word()).collect()).collect()
}

impl Design {
    /// Emits a program; the directory is emptied first.
    pub fn new(program: &Program, directory: &str, steps: u32) -> Design {
        let directory = Path::new(env!("CARGO_TARGET_TMPDIR")).join(directory);
        let _ = fs::remove_dir_all(&directory);
        let options = EmitOptions {
            command: "pe-synth build \\".to_owned(),
            spec: "tests".to_owned(),
            version: "0".to_owned(),
            stimulus: stimulus(program, steps, 7),
            default_steps: steps,
            ..EmitOptions::default()
        };
        for artefact in emit(program, &options) {
            let path = directory.join(&artefact.path);
            fs::create_dir_all(path.parent().expect("artefacts have a directory")).expect("test directory");
            fs::write(path, artefact.text).expect("test directory takes files");
        }
        Design { directory, model: design_name(program) }
    }

    /// Lines of the Rust reference.
    pub fn reference(&self) -> Vec<String> {
        let source = format!("{}_reference.rs", self.model);
        self.run("rustc", &["-O", "--edition", "2021", "-D", "warnings", "-o", "reference", &source], "rust");
        let program = self.directory.join("reference");
        self.run(program.to_str().expect("paths are text"), &[], "rust")
    }

    /// Analyses the design in the order of its file list.
    pub fn analyse(&self) {
        let list = fs::read_to_string(self.directory.join(format!("{}.f", self.model))).expect("the file list");
        for line in list.lines() {
            let (library, file) = line.split_once(' ').expect("library and file");
            self.run("ghdl", &["-a", "--std=08", &format!("--work={library}"), file], "ghdl");
        }
    }

    /// Lines of the GHDL test bench; the design must have been analysed.
    pub fn ghdl(&self, generics: &[&str]) -> Vec<String> {
        let bench = format!("{}_tb", self.model);
        let mut arguments = vec!["--elab-run", "--std=08", bench.as_str()];
        arguments.extend(generics);
        arguments.push("--assert-level=error");
        let mut lines = self.run("ghdl", &arguments, "ghdl");
        // `finish` announces itself.
        lines.retain(|line| !line.starts_with("simulation finished"));
        lines
    }

    /// Verilog of the analysed network, as GHDL synthesises it.
    pub fn synthesised(&self) -> String {
        self.run("ghdl", &["--synth", "--std=08", "--out=verilog", "-gTRACE=true", &self.model], "ghdl").join("\n")
    }

    /// Lines of the Verilator driver; the design must have been analysed.
    pub fn verilator(&self) -> Vec<String> {
        fs::write(self.directory.join("network.v"), self.synthesised()).expect("test directory takes files");
        let driver = format!("{}_verilator.cpp", self.model);
        let top =
            ["--cc", "--exe", "--build", "-Wno-fatal", "-Wno-lint", "-Wno-INITIALDLY", "--top-module", &self.model];
        let files = ["network.v", &driver, "-CFLAGS", "-O1", "-o", "network"];
        self.run("verilator", &[&top[..], &files[..]].concat(), "verilator");
        let program = self.directory.join("obj_dir/network");
        self.run(program.to_str().expect("paths are text"), &[], "verilator")
    }

    fn run(&self, program: &str, arguments: &[&str], package: &str) -> Vec<String> {
        let output = Command::new(program).args(arguments).current_dir(&self.directory).output();
        let output = output.unwrap_or_else(|error| panic!("{program}: {error}; Debian package `{package}`"));
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{program} {arguments:?} in {:?}\n{text}\n{errors}", self.directory);
        text.lines().map(str::to_owned).collect()
    }
}

/// Compares line by line; an empty run is a failure.
pub fn assert_same(what: &str, expected: &[String], found: &[String]) {
    assert!(expected.iter().any(|line| line.starts_with("t ")), "{what}: no memory writes");
    assert!(expected.iter().any(|line| line.starts_with("o ")), "{what}: no outputs");
    let difference = expected.iter().zip(found).position(|(expected, found)| expected != found);
    if let Some(line) = difference {
        panic!("{what}: line {line}: expected `{}`, found `{}`", expected[line], found[line]);
    }
    assert_eq!(expected.len(), found.len(), "{what}: number of lines");
}

/// Lines without the clock count, which differs when the network pauses.
pub fn without_clocks(lines: Vec<String>) -> Vec<String> {
    lines.into_iter().filter(|line| !line.starts_with("c ")).collect()
}
