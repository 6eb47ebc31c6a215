//! Outputs in memories: the words of ports, from designs with every feature, and from such designs with something broken.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::bench::{Folder, assert_lively_agreement};
use crate::support::damage::{Damage, missed};
use crate::support::flow::{Flow, Placement, format};
use crate::support::{Family, is_long_suite};
use pe_ir::index::PeId;
use pe_ir::model::Solver;
use pe_ir::program::{OutputPort, Program};
use pe_ir::verify;
use pe_ir::word::Pipeline;
use pe_map::Map;
use pe_sim::clocked::Clocked;
use pe_sim::machine::Machine;
use pe_verify::engines::Engine;
use pe_verify::inject::class::Class;
use pe_verify::inject::classes::{Places, Sources};
use pe_verify::inject::datasheet::{self, Design};
use pe_verify::inject::symbolic;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde_json::Value;

fn pe_synth(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).output().unwrap()
}

fn shipped(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models").join(path)
}

/// Compiles a shipped model; its folder.
fn compiled(test: &str, path: &str, options: &str) -> PathBuf {
    let (spec, folder) = (shipped(path), Path::new(env!("CARGO_TARGET_TMPDIR")).join(test));
    let mut arguments = vec!["compile", spec.to_str().unwrap(), "--quiet", "--no-pictures"];
    arguments.extend(["-o", folder.to_str().unwrap()]);
    arguments.extend(options.split_whitespace());
    let output = pe_synth(&arguments);
    assert!(output.status.success(), "{test}: {}", String::from_utf8_lossy(&output.stderr));
    folder
}

fn report(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("report.json")).unwrap()).unwrap()
}

/// What `verify` says of a folder.
fn verified(folder: &Path) -> Result<String, String> {
    // That a file was changed says nothing of what it does.
    let options = ["--engines", "ghdl", "--steps", "3", "--allow-changed"];
    let output = pe_synth(&[&["verify", folder.to_str().unwrap()], &options[..]].concat());
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if output.status.success() { Ok(text(&output.stdout)) } else { Err(text(&output.stderr)) }
}

/// Swapped buffers, factors, looped stages, tables, a deep pipeline, words as wide as operands; outputs that are as many as
/// clocks of a step, or more.
fn flows() -> Vec<Flow> {
    let flow = |family, size, solver, (storage, data, coefficient), seed| {
        Flow::random(family, size, solver, format(storage, data, coefficient), Placement::Scattered, seed)
    };
    let deep = format(32, 18, 18).with_pipeline(Pipeline::Deep);
    let looped = flow(Family::Affine, (10, 4), Solver::Heun3, (32, 25, 18), 42);
    vec![
        flow(Family::Shared, (6, 3), Solver::Euler, (32, 25, 18), 51),
        flow(Family::Polynomial, (4, 3), Solver::Rk4, (32, 25, 18), 52),
        flow(Family::Hub, (6, 4), Solver::Rk4, (32, 32, 32), 53),
        looped.looped().expect("stages are alike"),
        Flow::tabled((8, 3), Solver::Heun, format(18, 25, 18), Placement::Scattered, 56),
        Flow::random(Family::Shared, (6, 3), Solver::Heun, deep, Placement::Scattered, 57),
        Flow::random(Family::Stencil, (80, 9), Solver::Euler, format(32, 25, 18), Placement::Scattered, 58),
    ]
}

/// Part of the words that must change in a run.
const LIVELY: f64 = 0.5;

/// The flow with its outputs and all states, in memories, and some of them twice.
fn moved(flow: &mut Flow) {
    let program = &mut flow.program;
    let writers = program.state_writers();
    let guard = program.format.guard_bits as i32;
    for ((state, words), (_, next)) in program.states.iter().zip(&writers).zip(&flow.graph.states) {
        let Some(word) = words.last() else { continue };
        let (name, exponent) = (format!("{}.shown", state.name), state.exponent + guard);
        let (unit, proven, place) = (None, false, None);
        program.outputs.push(OutputPort { name, unit, pe: state.own.0, word: *word, exponent, proven, place });
        flow.graph.outputs.push(*next);
    }
    pe_hls::outputs::to_memory(program).unwrap();
    assert_eq!(verify::program::check(program, &flow.graph, &flow.fixed, 3), Vec::<String>::new(), "{}", flow.label);
}

#[test]
fn memories_show_what_ports_would() {
    for mut flow in flows() {
        moved(&mut flow);
        let mut ports = flow.program.clone();
        ports.outputs.iter_mut().for_each(|output| output.place = None);
        let (mut of_ports, mut of_memory) = (Machine::new(&ports), Clocked::new(&flow.program));
        let stimulus = flow.beginning(9).stimulus;
        for inputs in &stimulus {
            of_ports.step(inputs, &mut |_| {});
            of_memory.step(inputs, &mut |_| {});
            assert_eq!(of_ports.outputs(), of_memory.outputs(), "{}", flow.label);
        }
        assert_lively_agreement(&flow.label, &flow.starts(4), &[Engine::Ghdl], LIVELY);
        // The text says the same.
        let read: Program = flow.program.to_string().parse().unwrap();
        assert_eq!(read.output_memory(), flow.program.output_memory(), "{}", flow.label);
    }
}

#[test]
fn a_netlist_reads_memories_as_ghdl_does() {
    let mut flow = flows().swap_remove(0);
    moved(&mut flow);
    let label = format!("{}, netlist", flow.label);
    assert_lively_agreement(&label, &flow.starts(4), &[Engine::Verilator], LIVELY);
}

#[test]
fn damaged_places_are_refused() {
    let mut flow = flows().swap_remove(3);
    moved(&mut flow);
    let text = flow.program.to_string();
    assert!(text.contains(" show") && text.contains(" shown ") && text.contains(" place 0"), "{text}");
    for (from, to) in [(" place 1", " place 0"), (" place 0", ""), (" show ", " ")] {
        let damaged = text.replacen(from, to, 1);
        let fault = damaged.parse::<Program>().map(|_| ()).expect_err(from);
        assert!(fault.to_string().contains("output") || fault.to_string().contains("shows"), "{from}: {fault}");
    }
}

/// Ticks and inputs with a host; a host of looped stages; a deep pipeline; more outputs than clocks.
const DESIGNS: [(&str, &str); 4] = [
    ("motor_pid/motor_pid.spec", "--pes 2 --span 100ms --host restart,states,flags --outputs memory"),
    ("weibel5/weibel5.spec", "--pes 4 --span 20ms --multiplier 25x18 --loop on --host restart,states --outputs memory"),
    ("van_der_pol/van_der_pol.spec", "--pes 2 --span 100ms --pipeline deep --host restart --outputs memory"),
    ("validation/fhn_cube.spec", "--pes 9 --set n=4 --span 200ms --multiplier 25x18 --solver euler --step 20ms"),
];

#[test]
fn verify_reads_outputs_while_the_next_step_runs() {
    let part = if is_long_suite() { 1 } else { 2 };
    for (number, (path, options)) in DESIGNS.iter().enumerate().step_by(part) {
        let folder = compiled(&format!("outputs_{number}"), path, options);
        let text = verified(&folder).unwrap_or_else(|what| panic!("{path}: {what}"));
        assert!(text.contains("outputs equal"), "{text}");
        let map_file = fs::read_dir(&folder).unwrap().filter_map(Result::ok).map(|entry| entry.path());
        let map_file = map_file.into_iter().find(|path| path.to_string_lossy().ends_with("_map.json")).unwrap();
        let map = Map::read(&fs::read_to_string(map_file).unwrap()).unwrap();
        let memory = map.output_memory.expect("outputs are in memories");
        assert!(map.outputs.iter().all(|output| output.port == memory.word));
        assert!(map.outputs.iter().map(|output| output.address).eq((0..map.outputs.len() as u32).map(Some)));
        assert!(map.outputs.len() <= 1 << memory.address_bits && memory.latency >= 5);
    }
}

#[test]
fn many_outputs_are_in_memories_where_that_takes_less() {
    let few = report(&compiled("outputs_few", "van_der_pol/van_der_pol.spec", "--pes 2 --span 100ms"));
    assert!(few.get("outputs_in").is_none(), "{few}");
    let options = "--pes 4 --span 200ms --multiplier 25x18";
    let many = report(&compiled("outputs_many", "validation/fhn_cube.spec", options));
    let chosen = &many["outputs_in"];
    assert_eq!(chosen["kind"], "memory", "{chosen}");
    assert!(chosen["memory_lut"].as_f64() < chosen["ports_lut"].as_f64(), "{chosen}");
    let ports = report(&compiled("outputs_ports", "validation/fhn_cube.spec", &format!("{options} --outputs ports")));
    assert_eq!((&ports["outputs_in"]["kind"], &ports["outputs_in"]["reason"]), (&"ports".into(), &"asked for".into()));
    let lut = |report: &Value| report["area"]["split"]["outputs"]["lut"].as_f64().unwrap();
    assert!(lut(&many) < 0.5 * lut(&ports));
    // The network computes the same.
    assert_eq!(many["cycles_per_step"], ports["cycles_per_step"]);
}

/// Damages that `verify` must see: file, what is there, what takes its place.
const DAMAGES: [Damage; 11] = [
    ("hdl/pe_output_memory.vhd", "place <= place + 1;", "place <= place + 2;"),
    ("hdl/pe_output_memory.vhd", "if (write_i = '1') then", "if (true) then"),
    ("hdl/pe_output_memory.vhd", "write_enable_i  => write_i,", "write_enable_i  => '0',"),
    ("hdl/pe_output_memory.vhd", "if (publish = '1' or settle = '1') then", "if (settle = '1') then"),
    // A step that replaces states leaves its places behind.
    ("hdl/pe_output_memory.vhd", "if (publish = '1' or settle = '1') then", "if (publish = '1') then"),
    ("hdl/pe_output_memory.vhd", "published <= published xor publish;", "published <= published;"),
    // Words of the step that runs.
    ("hdl/pe_output_memory.vhd", "write_address <= not published & std", "write_address <= published & std"),
    ("hdl/pe_output_memory.vhd", "read_enable_i   => here_i,", "read_enable_i   => '1',"),
    ("hdl/pe_output_reader.vhd", "here(i) <= '1';", "here(i) <= '0';"),
    ("hdl/pe_output_reader.vhd", "if (k < BELOW) then", "if (k < BELOW - 1) then"),
    ("hdl/pe_output_reader.vhd", "place_o   <= place;", "place_o   <= row(PLACE_BITS - 1 downto 0);"),
];

#[test]
fn what_is_broken_of_memories_is_caught() {
    let options = "--pes 2 --span 100ms --set n=6 --multiplier 25x18 --host restart,states --outputs memory";
    let options = format!("{options} --observe x,v");
    let folder = compiled("outputs_broken", "spring_chain/spring_chain.spec", &options);
    verified(&folder).unwrap();
    let scratch = Folder::new("outputs_damaged");
    let missed = missed(&[&folder], &scratch.0, &DAMAGES, |broken, _| verified(broken).is_err());
    assert_eq!(missed, Vec::<&str>::new(), "not caught");
}

/// Whether every output shows a word that the simulator makes of the same sum, in two designs that differ in their outputs.
fn same_sums(flow: &Flow, one: &Design, other: &Design) -> bool {
    let shown = |design: &Design| -> BTreeMap<String, (usize, usize)> {
        let of_pe = |(pe, own): (usize, &datasheet::Pe)| {
            own.outputs.iter().map(|(word, port, _)| (port.clone(), (pe, *word as usize))).collect::<Vec<_>>()
        };
        design.pes.iter().enumerate().flat_map(of_pe).collect()
    };
    let (one, other) = (shown(one), shown(other));
    let mut network = Clocked::new(&flow.program);
    one.len() == other.len()
        && flow.beginning(20).stimulus.iter().all(|inputs| {
            network.step(inputs, &mut |_| {});
            let sum = |(pe, word): (usize, usize)| network.sums(PeId::at(pe))[word];
            one.iter().all(|(port, place)| other.get(port).is_some_and(|other| sum(*place) == sum(*other)))
        })
}

/// A damage of a place or of a word that is shown is no other than another output to the rules of the datasheet.
#[test]
fn the_datasheet_knows_which_word_an_output_shows() {
    let mut flow = flows().swap_remove(3);
    moved(&mut flow);
    let artefacts = pe_emit::emit(&flow.program, &pe_emit::EmitOptions::default());
    let name = pe_emit::design_name(&flow.program);
    let sources = Sources {
        texts: artefacts.into_iter().map(|artefact| (artefact.path, artefact.text)).collect(),
        package_file: format!("{name}_program_pkg.vhd"),
        network_file: format!("{name}.vhd"),
    };
    let (_, _, read) = sources.read().unwrap();
    let shown: usize = read.pes.iter().map(|pe| pe.outputs.len()).sum();
    assert_eq!(shown, flow.program.outputs.len());
    assert_eq!(symbolic::equal(&read, &read), Ok(()));
    let places = Places::of(&sources).unwrap();
    assert!(places.classes().contains(&Class::OutputPlaces));
    let damages = places.choose(200, &mut ChaCha8Rng::seed_from_u64(7));
    let of_places: Vec<_> = damages.iter().filter(|damage| damage.class == Class::OutputPlaces).collect();
    assert!(!of_places.is_empty());
    for damage in of_places {
        let (_, _, damaged) = sources.damaged(damage).read().unwrap();
        // Two words of a step may be the same sum: then it does not matter which of them is shown.
        assert!(symbolic::equal(&read, &damaged).is_err() || same_sums(&flow, &read, &damaged), "{}", damage.what);
    }
}
