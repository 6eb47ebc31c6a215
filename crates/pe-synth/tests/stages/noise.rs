//! Ranges of what rounding makes: values that cancel in double precision get formats for what they are in fixed point.

use std::fmt::Write;

use crate::support::FAMILIES;
use crate::support::flow::{Flow, Placement, format};
use pe_frontend::{NoFiles, Overrides};
use pe_hls::formats::{self, Ranges};
use pe_hls::step::StepOptions;
use pe_ir::graph::{FixedPoint, ValueId};
use pe_ir::model::{Model, Solver};
use pe_ir::source::Sources;
use pe_judge::Criteria;
use pe_judge::progress::silent;
use pe_judge::runs::{self, port_words};
use pe_sim::double::DoubleRun;
use pe_sim::fixed::FixedRun;
use pe_sim::roomy::RoomyRun;

const STEPS: u64 = 60;

/// Whether a run with room has the words of the hardware for as long as these do not saturate, and knows what leaves its range.
fn assert_same_until_saturation(flow: &Flow, fixed: &FixedPoint) -> bool {
    let (mut hardware, mut roomy) = (FixedRun::new(&flow.graph, fixed), RoomyRun::new(&flow.graph, fixed));
    for step in 0..STEPS {
        let words = port_words(&flow.model, &hardware, step);
        let saturated = hardware.step(&words);
        roomy.step(&words);
        let beyond: Vec<ValueId> = roomy.beyond().into_iter().map(|(value, _)| value).collect();
        if saturated || hardware.saturations().iter().any(|count| *count > 0) {
            // What comes first in the step saturates for what rounding made of it, not for what saturated before it.
            let counts = hardware.saturations();
            let written = flow.graph.chains.iter().flat_map(|chain| chain.writes()).map(|write| write.value);
            let starts = flow.graph.states.iter().map(|(state, _)| *state);
            let first = starts.chain(written).find(|value| counts[value.index()] > 0).expect("a value saturated");
            assert!(beyond.contains(&first), "{}: {} is not found", flow.label, flow.graph.value_name(first));
            return true;
        }
        assert_eq!(beyond, [], "{}, step {step}", flow.label);
        for value in (0..flow.graph.values.len()).map(ValueId::at) {
            let name = || flow.graph.value_name(value);
            assert_eq!(roomy.run().word(value), hardware.word(value), "{}, step {step}: {}", flow.label, name());
        }
    }
    false
}

#[test]
fn runs_with_room_are_those_of_the_hardware_until_it_saturates() {
    let mut saturated = 0;
    for (seed, family) in (0..).zip(FAMILIES) {
        for word in [format(32, 32, 32), format(32, 25, 18), format(18, 18, 18), format(40, 35, 35)] {
            let flow = Flow::random(family, (6, 2), Solver::Rk4, word, Placement::Scattered, seed);
            assert!(!assert_same_until_saturation(&flow, &flow.fixed), "{}", flow.label);
            // Too narrow by four bits.
            let mut run = DoubleRun::new(&flow.graph);
            for step in 0..STEPS {
                run.step(&flow.model.sample_inputs(flow.model.time(step, 0.0))).expect("it is finite");
            }
            let mut largest: Vec<f64> = run.largest().iter().map(|largest| largest / 16.0).collect();
            // But for what the states begin with, which no step writes.
            for ((start, _), initial) in flow.graph.states.iter().zip(&flow.graph.initial) {
                largest[start.index()] = largest[start.index()].max(initial.abs());
            }
            let ranges = Ranges { largest, widened: vec![0; flow.graph.values.len()] };
            let Ok(narrow) = formats::choose(&flow.graph, &ranges, word) else { continue };
            saturated += u32::from(assert_same_until_saturation(&flow, &narrow));
        }
    }
    assert!(saturated >= 16, "{saturated}");
}

fn next(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *seed >> 33
}

fn one_of<'a>(seed: &mut u64, choices: &[&'a str]) -> &'a str {
    choices[next(seed) as usize % choices.len()]
}

/// Two states that are equal but for rounding, whose difference goes through products with gains and comes back.
fn cancelling(seed: &mut u64) -> String {
    let (solver, span) = (one_of(seed, &["rk4", "heun"]), one_of(seed, &["100", "200"]));
    let (x, z) = (one_of(seed, &["1", "0.3", "20"]), one_of(seed, &["0.5", "0.9", "2"]));
    let rate = [0.37, 1.9, 7.1][next(seed) as usize % 3];
    let part = rate * [0.3, 0.61][next(seed) as usize % 2];
    let mut text = format!(
        "model m\nsolver {solver}\nstep 1 ms\nspan {span} ms\nstate x = {x}\nstate y = {x}\nstate z = {z}\nd = x*z - y*z\n"
    );
    let (mut last, mut total) = ("d".to_owned(), 1.0);
    for level in 0..2 + next(seed) % 5 {
        let mut gain = [3.0, 10.0, 40.0][next(seed) as usize % 3];
        if total * gain > 300.0 {
            gain = 0.1;
        }
        total *= gain;
        writeln!(text, "p{level} = {gain}*{last}*z + 0.001*{last}*{last}").expect("a string");
        last = format!("p{level}");
    }
    let rest = rate - part;
    text + &format!(
        "x' = -{rate}*x + z - {last}\ny' = -{part}*y - {rest}*y + z + {last}*z\nz' = -0.2*z + 0.1 + 0.01*{last}*z\n\
         output x, y\n"
    )
}

fn compiled(text: &str) -> Model {
    let mut sources = Sources::new("noise.spec", text);
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default());
    let (model, _) = compiled.unwrap_or_else(|findings| panic!("{findings:#?}\n{text}"));
    pe_hls::lift::lift(model)
}

#[test]
fn what_cancels_in_double_precision_has_a_format() {
    let mut seed = 86;
    for case in 0..16 {
        let text = cancelling(&mut seed);
        let model = compiled(&text);
        let graph = pe_hls::step::build_with(&model, &StepOptions::default()).expect("a step");
        for word in [format(32, 32, 32), format(40, 35, 35)] {
            let judged = runs::judge(&model, &graph, word, &Criteria::default(), silent());
            let judged = judged.unwrap_or_else(|findings| panic!("case {case}: {findings:#?}\n{text}"));
            assert!(judged.errors.word_length < 1e-4, "case {case}: {:e}\n{text}", judged.errors.word_length);
        }
    }
}
