//! Coefficients in two slots: the same step in double precision, and a fraction of the coefficient error.

use crate::support::models::{Compiled, compile};
use pe_ir::graph::StepGraph;
use pe_ir::index::StateId;
use pe_sim::double::DoubleRun;

fn designs(model: &str, options: &[&str]) -> [Compiled; 2] {
    ["one-slot", "two-slot"]
        .map(|slots| compile(model, &[options, &["--multiplier", "25x18", "--coefficients", slots]].concat()))
}

/// States after some steps in double precision.
fn states(graph: &StepGraph) -> Vec<f64> {
    let mut run = DoubleRun::new(graph);
    let inputs = vec![0.25; graph.inputs.len()];
    (0..50).for_each(|_| run.step(&inputs).expect("finite"));
    (0..graph.states.len()).map(|state| run.state(StateId::at(state))).collect()
}

#[test]
fn the_second_slot_holds_what_the_first_one_lacks() {
    // With one slot the last stage of the Lorenz model makes good most of what the others lost, that of an affine model
    // none, so there the errors can be compared with one another.
    let cases =
        [("lorenz", &["--span", "200ms"][..], Some(6e-7)), ("weibel5", &["--span", "20ms", "--pes", "4"][..], None)];
    for (model, options, most) in cases {
        let [one, two] = designs(model, options);
        let (one, two) = (&one.design, &two.design);
        let numbers = states(&one.graph).into_iter().zip(states(&two.graph));
        let mut compared = 0;
        for (whole, parts) in numbers {
            assert!((whole - parts).abs() <= 1e-9 * whole.abs().max(1e-3), "{model}: {whole} {parts}");
            compared += 1;
        }
        assert!(compared > 2, "{model}");
        assert!(two.graph.macs() > one.graph.macs() && two.graph.macs() <= 2 * one.graph.macs(), "{model}");
        let errors = [one, two].map(|design| design.judged.errors);
        let most = most.unwrap_or(0.05 * errors[0].coefficient);
        assert!(errors[1].coefficient < most, "{model}: {errors:?}");
        assert!(errors[1].word_length < errors[0].word_length, "{model}: {errors:?}");
    }
}

#[test]
fn two_slots_are_taken_by_themselves_where_they_pay_only() {
    let slots = |options: &[&str]| {
        let design = compile("lorenz", &[options, &["--span", "1s", "--coefficients", "auto"]].concat()).design;
        pe_hls::two_slots::used(&design.graph)
    };
    assert!(!slots(&["--multiplier", "32x32"]));
    assert!(!slots(&["--multiplier", "18x25", "--storage", "18"]));
}
