//! Routes of values over other PEs: fewer ports, the same bits.

use crate::support::Family;
use crate::support::bench::Folder;
use crate::support::flow::{Flow, Placement, format};
use crate::support::hubs::hub_spec;
use pe_hls::route::{is_hop, route};
use pe_ir::graph::{Factor, Role, ValueId};
use pe_ir::index::PeId;
use pe_ir::model::Solver;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::Machine;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const FAMILIES: [Family; 4] = [Family::Affine, Family::Polynomial, Family::Shared, Family::Grid];

fn flow(seed: u64) -> Flow {
    let widths = [(32, 25, 18), (32, 32, 32), (18, 18, 25), (40, 35, 35)][seed as usize % 4];
    let solver = [Solver::Rk4, Solver::Euler, Solver::Heun][seed as usize % 3];
    let (storage, data, coefficient) = widths;
    let (family, pes) = (FAMILIES[seed as usize / 2 % 4], 3 + seed as u32 % 6);
    let format = format(storage, data, coefficient);
    Flow::random(family, (9, pes), solver, format, Placement::Scattered, seed)
}

#[test]
fn routes_change_no_bit_keep_the_bound_and_pass_every_checker() {
    let (mut compared, mut copied) = (0, 0);
    for seed in 0..24 {
        let plain = flow(seed);
        // A ring and the inputs of the model: then all that there is, and more.
        let least = (1..).find(|ports| plain.routed(*ports).is_some()).expect("there are as many ports as places");
        for ports in [least, least + 1, 15] {
            let routed = plain.routed(ports).unwrap_or_else(|| panic!("{}: no routes with {ports}", plain.label));
            copied += routed.graph.values.len() - plain.graph.values.len();
            let mut without = FixedRun::new(&plain.graph, &plain.fixed);
            let mut with = FixedRun::new(&routed.graph, &routed.fixed);
            let mut machine = Machine::new(&routed.program);
            for step in 0..20 {
                let inputs = plain.inputs(&without, step);
                without.step(&inputs);
                with.step(&inputs);
                machine.step(&inputs, &mut |_| {});
                for value in (0..plain.graph.values.len()).map(ValueId::at) {
                    let name = plain.graph.value_name(value);
                    assert_eq!(with.word(value), without.word(value), "{}: `{name}` in step {step}", routed.label);
                }
                compared += routed.assert_words(&machine, &without, &format!("step {step}"));
            }
        }
    }
    assert!(compared > 10_000 && copied > 500, "{compared} words, {copied} copies");
}

#[test]
fn every_copy_is_a_product_with_one_on_the_way_to_a_reader() {
    let plain = flow(4);
    let (old, ports) = (plain.graph.values.len(), 2);
    let routed = route(&plain.graph, &plain.mapping, ports).expect("a ring");
    let graph = &routed.relayed.graph;
    for (equation, relay) in graph.equations.numbered().skip(plain.graph.equations.len()) {
        assert!(is_hop(&relay.name), "{}", relay.name);
        for chain in graph.chains.iter().filter(|chain| chain.equation == equation) {
            let [term] = graph.chain_terms(chain) else { panic!("a copy has one product") };
            assert_eq!(term.factor, Factor::Coefficient(1.0));
            let Role::Relayed(original, number) = graph.value(chain.write.value).role else { panic!("no copy") };
            assert_eq!(PeId::new(number - 1), routed.mapping.pe_of[equation]);
            let root = match graph.value(term.operand).role {
                Role::Relayed(root, _) => root,
                _ => term.operand,
            };
            assert_eq!(root, original, "a copy is made of what it is said to be a copy of");
        }
    }
    let read: Vec<ValueId> = graph.terms.iter().map(|term| term.operand).collect();
    assert!((old..graph.values.len()).all(|copy| read.contains(&ValueId::at(copy))), "a copy that nothing reads");
    assert!(!is_hop("x.relay1") && !is_hop("x.hop") && !is_hop("hop1"));
}

#[test]
fn too_few_ports_for_a_ring_and_the_inputs_are_no_routes() {
    let plain = flow(2);
    assert!(plain.graph.inputs.is_empty() || plain.routed(1).is_none());
    assert!(plain.routed(0).is_none());
}

#[test]
fn a_bound_on_ports_is_kept_and_a_mapping_read_back() {
    let folder = Folder::new("route_mapping");
    let (spec, map) = (folder.0.join("hubs.spec"), folder.0.join("hubs.map"));
    std::fs::write(&spec, hub_spec(24, "rk4", 1)).unwrap();
    let dump = |options: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        let output = command.args(["dump", "--max-in-degree", "2", "--stage"]).args(options).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let (spec, map) = (spec.to_str().unwrap(), map.to_str().unwrap());
    let text = dump(&["mapping", spec, "--only", "--pes", "9"]);
    assert!(text.contains(".hop"), "{text}");
    std::fs::write(map, &text).unwrap();
    assert_eq!(dump(&["mapping", spec, "--only", "--mapping", map]), text);
    let program = dump(&["program", spec, "--only", "--pes", "9"]);
    for stage in ["schedule", "program"] {
        std::fs::write(map, dump(&[stage, spec, "--pes", "9"])).unwrap();
        assert!(dump(&["program", "--only", "--from", map]) == program, "{stage}");
    }
}

/// A linear network of states that each read as many others, anywhere.
fn random_spec(states: usize, reads: usize, seed: u64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut text = "model anywhere\nsolver heun\nstep 1 ms\nspan 20 ms\n".to_owned();
    (0..states).for_each(|state| text += &format!("state x{state} = {}\n", random.random_range(-0.9..0.9)));
    for state in 0..states {
        let terms: Vec<String> = rand::seq::index::sample(&mut random, states, reads)
            .iter()
            .map(|other| format!("{} * x{other}", 0.01 + 0.001 * other as f64))
            .collect();
        text += &format!("x{state}' = -x{state} + {}\n", terms.join(" + "));
    }
    text + "output x0\n"
}

#[test]
fn an_aim_of_ports_is_a_cost_and_what_a_mapping_does_beyond_it_is_told_and_read_back() {
    let folder = Folder::new("route_cost");
    let path = |name: &str| folder.0.join(name).display().to_string();
    let run = |words: &[&str]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(words).output().unwrap();
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{words:?}: {told}");
        (String::from_utf8(output.stdout).unwrap(), told)
    };
    let (mut wide, mut copied) = (0, 0);
    for (seed, (states, reads, pes, pipeline)) in (1..).zip([
        (48, 8, "24", "short"),
        (60, 20, "30", "short"),
        (80, 5, "20", "short"),
        (40, 30, "40", "deep"),
        (80, 14, "40", "deep"),
    ]) {
        let (spec, out, map) = (path("random.spec"), path("out"), path("random.map"));
        std::fs::write(&spec, random_spec(states, reads, seed)).unwrap();
        let compiled = |more: &[&str]| {
            let kind = ["--pes", pes, "--pipeline", pipeline];
            let words = [&["compile", &spec, "--no-pictures", "-o", &out][..], &kind, more].concat();
            let (_, told) = run(&words);
            let report = std::fs::read_to_string(format!("{out}/report.json")).unwrap();
            let report: serde_json::Value = serde_json::from_str(&report).unwrap();
            let figure = |name: &str| report[name].as_u64().unwrap_or(0);
            (figure("cycles_per_step"), figure("max_in_degree"), figure("hops"), told)
        };
        let (cycles, ports, hops, told) = compiled(&[]);
        let (bounded, most, ..) = compiled(&["--max-in-degree", "15"]);
        assert!(most <= 15, "{most} ports");
        assert!(cycles as f64 <= 1.02 * bounded as f64, "{cycles} cycles, and {bounded} with a bound");
        assert_eq!(told.contains("W0803"), ports > 15, "{ports} ports: {told}");
        assert_eq!(told.contains("W0804"), hops > 0, "{hops} copies: {told}");
        wide += u32::from(ports > 15);
        let dump = ["dump", "--stage", "mapping", "--only", &spec, "--pipeline", pipeline];
        let (text, _) = run(&[&dump[..], &["--pes", pes]].concat());
        assert_eq!(text.contains(".hop"), hops > 0);
        std::fs::write(&map, &text).unwrap();
        assert_eq!(run(&[&dump[..], &["--mapping", &map]].concat()).0, text);
        // Copies that a file names are made with or without a bound.
        let (bounded, _) = run(&[&dump[..], &["--pes", pes, "--max-in-degree", "15"]].concat());
        std::fs::write(&map, &bounded).unwrap();
        assert_eq!(run(&[&dump[..], &["--mapping", &map]].concat()).0, bounded);
        copied += u32::from(bounded.contains(".hop"));
    }
    assert!((1..5).contains(&wide) && copied > 0, "{wide} with more ports, {copied} with copies");
}
