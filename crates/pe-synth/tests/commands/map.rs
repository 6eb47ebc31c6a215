//! The map of a design against what else is known of it: VHDL, program, spec, and what the simulator does with words.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pe_map::{Map, Meaning, Outside, sha256};
use pe_verify::folder::DesignFolder;
use pe_verify::stimuli::observe;

/// Names that are no identifiers, an input in a range, an input that is interpolated, a sampled block, and two outputs.
const HOSTILE: &str = "\
model Process
solver rk4
step 1 ms
span 50 ms
param k = 3
input load [N] = sine(1, 20 Hz) in -2 .. 2, linear
input out = sine(0.5, 20 Hz)
state signal = 0.25
state x_i = -1
signal' = load - k*signal
x_i' = out - signal - x_i
output signal, x_i
";

/// Compiles a spec; the folder.
fn compiled(home: &Path, name: &str, spec: &Path, options: &[&str]) -> PathBuf {
    let home = home.join(name);
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    command.arg("compile").arg(spec).args(["--quiet", "--no-pictures", "-o"]).arg(&home).args(options);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    home
}

/// Models with inputs, sampled blocks and tables, and a spec with odd names.
fn designs(test: &str) -> Vec<(&'static str, PathBuf)> {
    let home = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    fs::create_dir_all(&home).unwrap();
    let hostile = home.join("process.spec");
    fs::write(&hostile, HOSTILE).unwrap();
    let model = |name: &str| Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../models/{name}/{name}.spec"));
    let shipped = |name: &str, options: &[&str]| compiled(&home, name, &model(name), options);
    vec![
        ("process_x", compiled(&home, "hostile", &hostile, &["--multiplier", "25x18", "--storage", "32"])),
        ("motor_pid", shipped("motor_pid", &["--pes", "2", "--span", "20ms"])),
        ("lung", shipped("lung", &["--pes", "3"])),
        ("hodgkin_huxley", shipped("hodgkin_huxley", &["--pes", "2", "--span", "2ms"])),
    ]
}

#[test]
fn a_map_agrees_with_the_design() {
    for (name, folder) in designs("map") {
        let read = |suffix: &str| fs::read_to_string(folder.join(format!("{name}{suffix}"))).unwrap();
        let text = read("_map.json");
        let map = Map::read(&text).unwrap();
        assert_eq!(map.text(), text, "{name}: what was read differs from what was written");
        assert_eq!(map.entity, name);

        // Ports as the entity declares them.
        let network = read(".vhd");
        let control = &map.control;
        let bits = [&control.clock, &control.clock_enable, &control.step, &control.busy, &control.done];
        let declared = |port: &str, kind: &str| {
            let mut lines = network.lines().map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "));
            assert!(lines.any(|line| line.starts_with(&format!("{port} : {kind}"))), "{name}: {port} is no {kind}");
        };
        bits.iter().take(3).for_each(|port| declared(port, "in std_ulogic;"));
        bits.iter().skip(3).for_each(|port| declared(port, "out std_ulogic;"));
        declared(&control.overflow, "out std_ulogic;");
        map.inputs.iter().for_each(|input| declared(&input.port, "in std_ulogic_vector(STORAGE_BITS"));
        map.outputs.iter().for_each(|output| declared(&output.port, "out std_ulogic_vector(STORAGE_BITS"));

        // Formats and places as the program has them.
        let program_text = read("_program.txt");
        let program = DesignFolder::open(&folder).unwrap().program;
        assert_eq!(map.hash, sha256(format!("{}\n{program_text}", map.generator).as_bytes()));
        assert_eq!(map.clocks_per_step, program.period);
        assert_eq!(map.inputs.len(), program.ports().count());
        for (input, port) in map.inputs.iter().zip(program.ports()) {
            assert_eq!((&input.name, input.format.exponent), (&port.name, port.exponent));
            assert_eq!(input.format.bits, program.format.storage_bits);
            // An operand of the data port drops the low bits of a stored word.
            let one = program.format.input_operand(1 << 10) - program.format.input_operand(0);
            assert_eq!(input.operand.number(one), input.format.number(1 << 10), "{name}: {}", input.name);
        }
        for (output, port) in map.outputs.iter().zip(&program.outputs) {
            assert_eq!((&output.name, output.format.exponent), (&port.name, port.exponent));
            assert_eq!(output.outside == Outside::Proven, port.proven);
        }
        for (state, register) in map.states.iter().zip(&program.states) {
            let (pe, address) = register.own;
            assert_eq!((&state.name, state.pe, state.address), (&register.name, pe.number(), address));
            let mut moved = program.clone();
            register.set(&mut moved.pes, &program.format, state.initial);
            assert_eq!(moved, program, "{name}: {} begins elsewhere", state.name);
        }
    }
}

#[test]
fn words_beyond_the_limits_of_an_input_are_clamped_and_others_are_not() {
    let mut narrow = 0;
    for (name, folder) in designs("map_limits") {
        let map = Map::read(&fs::read_to_string(folder.join(format!("{name}_map.json"))).unwrap()).unwrap();
        let program = DesignFolder::open(&folder).unwrap().program;
        for (index, input) in map.inputs.iter().enumerate() {
            let clamped = |word: i64| {
                let mut words = vec![0; map.inputs.len()];
                words[index] = word;
                observe(&program, &[words], 1).coverage.clamped[index]
            };
            let [least, most] = input.words;
            assert!(!clamped(least) && !clamped(most), "{name}: {}", input.name);
            assert_eq!(input.format.words()[0], least);
            if most < input.format.words()[1] {
                assert!(clamped(most + 1), "{name}: {}", input.name);
                narrow += 1;
            }
            if let Some([low, high]) = input.range {
                let carried = [low, high].map(|number| input.word(number).unwrap());
                assert!(carried.iter().all(|word| !word.clamped), "{name}: {} cannot be in its range", input.name);
            }
            assert_eq!(input.meaning, Meaning::Quantity);
        }
    }
    assert!(narrow > 0, "no input of these designs clamps");
}
