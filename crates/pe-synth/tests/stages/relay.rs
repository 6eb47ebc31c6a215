//! Relays of hubs: other connections, the same bits.

use crate::support::bench::Folder;
use crate::support::flow::{Flow, Placement, format};
use crate::support::hubs::{hub_model, hub_spec};
use pe_hls::relay::{is_relay, relay};
use pe_ir::graph::{Factor, Role};
use pe_ir::index::{EquationId, StateId};
use pe_sim::fixed::FixedRun;
use pe_sim::machine::Machine;

/// Ports of a PE, so few that a model of a dozen units has hubs.
const PORTS: u32 = 3;

fn flow(solver: &str, widths: (u32, u32, u32), placement: Placement, seed: u64) -> Flow {
    let (storage, data, coefficient) = widths;
    let label = format!("hubs, {solver}, {widths:?}, {placement:?}, seed {seed}");
    Flow::of(label, hub_model(14, solver, seed), 6, format(storage, data, coefficient), placement)
}

#[test]
fn relays_change_no_bit_and_pass_every_checker() {
    let widths = [(32, 25, 18), (32, 32, 32), (18, 18, 25), (40, 35, 35)];
    let mut compared = 0;
    for (seed, (widths, solver)) in (1..).zip(widths.into_iter().zip(["rk4", "heun", "euler", "rk4"])) {
        for (placement, relays) in [(Placement::Annealed, 1), (Placement::Scattered, 3)] {
            let plain = flow(solver, widths, placement, seed);
            let relayed = plain.relayed(PORTS, relays).unwrap_or_else(|| panic!("{}: no hubs", plain.label));
            let mut without = FixedRun::new(&plain.graph, &plain.fixed);
            let mut with = FixedRun::new(&relayed.graph, &relayed.fixed);
            let mut machine = Machine::new(&relayed.program);
            for step in 0..40 {
                let inputs = plain.inputs(&without, step);
                without.step(&inputs);
                with.step(&inputs);
                machine.step(&inputs, &mut |_| {});
                for value in 0..plain.graph.values.len() {
                    let value = pe_ir::graph::ValueId::new(value as u32);
                    let name = plain.graph.value_name(value);
                    assert_eq!(with.word(value), without.word(value), "{}: `{name}` in step {step}", relayed.label);
                }
                for (index, (state, _)) in plain.graph.states.iter().enumerate() {
                    assert_eq!(
                        machine.state(StateId::at(index)),
                        without.word(*state),
                        "{}, step {step}",
                        relayed.label
                    );
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 4_000, "{compared}");
}

#[test]
fn readers_read_a_relay_in_place_of_every_hub() {
    let flow = flow("rk4", (32, 25, 18), Placement::Annealed, 9);
    let relayed = relay(&flow.graph, 6, PORTS, 2).expect("hubs");
    let (equations, first) = (&relayed.graph.equations, flow.graph.equations.len());
    let relays: Vec<&str> = equations.iter().skip(first).map(|equation| equation.name.as_str()).collect();
    assert_eq!(relays, ["a.relay1", "a.relay2"]);
    assert!(relays.iter().all(|name| is_relay(name)) && !is_relay("a.part1") && !is_relay("a.relay"));
    // A unit reads one equation beside its own; the four values in four stages are copied once for each relay.
    let arcs = relayed.graph.dependencies();
    for (unit, equation) in equations.numbered().filter(|(_, equation)| equation.name.starts_with('x')) {
        let sources: Vec<EquationId> = arcs.iter().filter(|arc| arc.1 == unit).map(|arc| arc.0).collect();
        assert!(matches!(sources[..], [relay] if relay.index() >= first), "{} reads {sources:?}", equation.name);
    }
    assert_eq!(relayed.copied.len(), 2 * 4 * 4);
    for chain in relayed.graph.chains.iter().filter(|chain| chain.equation.index() >= first) {
        let [term] = relayed.graph.chain_terms(chain) else { panic!("a copy has one product") };
        assert_eq!(term.factor, Factor::Coefficient(1.0));
        let written = relayed.graph.value(chain.write.value).role;
        assert!(matches!(written, Role::Relayed(original, 1 | 2) if original == term.operand), "{written:?}");
    }
}

#[test]
fn what_has_no_two_hubs_has_no_relays() {
    let flow = flow("heun", (32, 25, 18), Placement::Annealed, 2);
    assert!(relay(&flow.graph, 6, 5, 1).is_none(), "every PE may read all others");
    assert!(relay(&flow.graph, 20, PORTS, 1).is_none(), "fewer readers than PEs");
    assert!(relay(&flow.graph, 12, 10, 1).is_none(), "so few readers need no relay");
    assert!(relay(&flow.graph, 13, PORTS, 1).is_some());
}

#[test]
fn a_mapping_with_relays_is_taken_as_it_is() {
    let folder = Folder::new("relay_mapping");
    let (spec, map) = (folder.0.join("hubs.spec"), folder.0.join("hubs.map"));
    std::fs::write(&spec, hub_spec(40, "rk4", 1)).unwrap();
    let dump = |options: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pe-synth"));
        let output = command.args(["dump", "--stage"]).args(options).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let (spec, map) = (spec.to_str().unwrap(), map.to_str().unwrap());
    let text = dump(&["mapping", spec, "--only", "--pes", "18"]) + "a.relay1 0\n";
    std::fs::write(map, &text).unwrap();
    assert_eq!(dump(&["mapping", spec, "--only", "--mapping", map]), text);
    // In a text of stages, too: the step has no relays yet.
    let program = dump(&["program", spec, "--only", "--mapping", map]);
    for stage in ["schedule", "program"] {
        let text = dump(&[stage, spec, "--mapping", map]);
        let stages = folder.0.join("hubs.stages");
        std::fs::write(&stages, text).unwrap();
        assert!(dump(&["program", "--only", "--from", stages.to_str().unwrap()]) == program, "{stage}");
    }
}
