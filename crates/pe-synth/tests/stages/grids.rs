//! Sums over nearly everything on a grid of PEs: the same numbers, and few ports.

use super::split::model;
use crate::support::bench::Folder;
use crate::support::flow::{Flow, format, stage_by_stage};
use pe_hls::grid::grid;
use pe_hls::mapping::{Problem, placed};
use pe_ir::graph::{Role, StepGraph};
use pe_ir::index::StateId;
use pe_ir::word::{Latency, Pipeline};
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::machine::Machine;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const LATENCY: Latency = Latency { multiplier: 3, pipeline: Pipeline::Short };

/// A network in which each of some states reads a part of all of them: itself, through a function, or in a factor.
fn spec(states: usize, part: f64, kind: usize, seed: u64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let solver = ["euler", "heun", "rk4"][seed as usize % 3];
    let mut text = format!("model dense\nsolver {solver}\nstep 1 ms\nspan 20 ms\ninput u = square(1, 50 Hz)\n");
    (0..states).for_each(|state| text += &format!("state x{state} = {:.3}\n", random.random_range(-0.9..0.9)));
    if kind == 1 {
        (0..states).for_each(|state| text += &format!("y{state} = x{state} - 0.2*x{state}^3\n"));
    }
    for state in 0..states {
        let name = if kind == 1 { "y" } else { "x" };
        let terms = (0..states).filter(|other| *other != state && random.random_bool(part));
        let terms: Vec<usize> = terms.collect();
        let terms = terms.iter().map(|other| format!("{:.3}*{name}{other}", random.random_range(-0.1..0.1)));
        let sum = terms.collect::<Vec<_>>().join(" + ");
        let input = if state % 7 == 0 { " + 2*u" } else { "" };
        text += &match kind {
            2 => format!("x{state}' = -x{state} + (0.3 - 0.1*x{state})*({sum}){input}\n"),
            _ => format!("x{state}' = -x{state} + {sum}{input}\n"),
        };
    }
    text + "output x0, x1\n"
}

/// States after some steps in double precision.
fn states(graph: &StepGraph) -> Vec<f64> {
    let mut run = DoubleRun::new(graph);
    (0..20).for_each(|step| run.step(&[f64::from(step % 5) - 2.0]).expect("finite"));
    (0..graph.states.len()).map(|state| run.state(StateId::at(state))).collect()
}

#[test]
fn a_grid_computes_the_same_within_the_ports_and_passes_every_checker() {
    let (mut grids, mut compared) = (0, 0);
    for (seed, (count, part, pes, ports)) in (0..).zip([
        (24, 1.0, 24, 6),
        (24, 0.9, 12, 5),
        (30, 0.8, 36, 8),
        (21, 1.0, 16, 4),
        (25, 0.7, 20, 6),
        (40, 1.0, 40, 8),
        (18, 1.0, 36, 15),
        (20, 0.95, 11, 3),
        (32, 0.6, 16, 8),
    ]) {
        for kind in 0..3 {
            let label = format!("{count} states, part {part}, kind {kind}, {pes} PEs with {ports} ports");
            let model = model(&spec(count, part, kind, seed));
            let graph = stage_by_stage(&model);
            let Some(on_grid) = grid(&graph, pes, ports, LATENCY) else { continue };
            grids += 1;
            assert_eq!(placed(&on_grid.graph).as_ref(), Some(&on_grid.mapping), "{label}");
            assert_eq!(on_grid.cost, Problem::of(&on_grid.graph).cost(&on_grid.mapping), "{label}");
            assert!(on_grid.cost.max_in_degree <= ports && on_grid.mapping.pes == pes, "{label}: {:?}", on_grid.cost);
            for (whole, cut) in states(&graph).into_iter().zip(states(&on_grid.graph)) {
                assert!((whole - cut).abs() < 1e-11, "{label}: {whole} {cut}");
            }
            if seed % 3 == kind as u64 {
                let flow = Flow::on_grid(label, model, (pes, ports), format(32, 32, 32)).expect("as above");
                let (mut run, mut machine) = (FixedRun::new(&flow.graph, &flow.fixed), Machine::new(&flow.program));
                for step in 0..10 {
                    let inputs = flow.inputs(&run, step);
                    run.step(&inputs);
                    machine.step(&inputs, &mut |_| {});
                    compared += flow.assert_words(&machine, &run, &format!("step {step}"));
                }
            }
        }
    }
    assert!(grids > 20 && compared > 1_000, "{grids} grids, {compared} words");
}

#[test]
fn what_reads_little_is_not_cut() {
    let sparse = model(&spec(60, 0.08, 0, 1));
    let graph = pe_hls::step::build(&sparse).expect("a step graph");
    assert!(grid(&graph, 30, 15, LATENCY).is_none(), "rows read fewer than there are ports");
    let dense = pe_hls::step::build(&model(&spec(24, 1.0, 0, 1))).expect("a step graph");
    assert!(grid(&dense, 8, 15, LATENCY).is_none(), "all PEs can read all others");
    assert!(grid(&dense, 24, 0, LATENCY).is_none(), "no grid does without ports");
    let parts = grid(&dense, 24, 5, LATENCY).expect("a grid").graph;
    assert!(parts.values.iter().any(|value| matches!(value.role, Role::Partial(..))));
}

#[test]
fn a_grid_is_taken_where_it_saves_time_and_its_mapping_read_back() {
    let folder = Folder::new("grid_mapping");
    let path = |name: &str| folder.0.join(name).display().to_string();
    let run = |words: &[&str]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(words).output().unwrap();
        assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let (spec_path, map) = (path("dense.spec"), path("dense.map"));
    std::fs::write(&spec_path, spec(24, 1.0, 0, 2)).unwrap();
    let dump =
        |stage: &str, more: &[&str]| run(&[&["dump", "--stage", stage, "--max-in-degree", "5"][..], more].concat());
    let text = dump("mapping", &[&spec_path, "--only", "--pes", "24"]);
    assert!(text.contains(".part") && !text.contains(".hop"), "{text}");
    std::fs::write(&map, &text).unwrap();
    assert_eq!(dump("mapping", &[&spec_path, "--only", "--mapping", &map]), text);
    let program = dump("program", &[&spec_path, "--only", "--pes", "24"]);
    for stage in ["step", "fixed", "mapping", "schedule", "program"] {
        std::fs::write(&map, dump(stage, &[&spec_path, "--pes", "24"])).unwrap();
        let pes: &[&str] = if ["step", "fixed"].contains(&stage) { &["--pes", "24"] } else { &[] };
        assert!(dump("program", &[&["--only", "--from", &map][..], pes].concat()) == program, "{stage}");
    }
    // A mapping of whole equations is one of the step without a grid.
    let whole: String = (0..24).map(|state| format!("x{state} {}\n", state % 6)).collect();
    std::fs::write(&map, &whole).unwrap();
    let given = run(&["dump", "--stage", "mapping", &spec_path, "--only", "--mapping", &map]);
    assert!(!given.contains(".part") && given.contains("x23 5"), "{given}");
}
