//! Angles: orders of all methods, words after millions of turns, agreement of all engines where turns are dropped.

use std::collections::BTreeMap;

use crate::support::bench::{Folder, assert_lively_agreement};
use crate::support::models::compile_file;
use pe_frontend::Overrides;
use pe_hls::formats;
use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_ir::source::Sources;
use pe_ir::turns::{self, RADIANS};
use pe_sim::double::DoubleRun;
use pe_sim::reference;
use pe_verify::engines::Engine;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn model(text: &str) -> Model {
    let model = pe_frontend::compile(&mut Sources::new("m.spec", text), &BTreeMap::new(), &Overrides::default());
    pe_hls::lift::lift(model.unwrap_or_else(|findings| panic!("{text}: {findings:?}")).0)
}

/// A pendulum that goes over the top again and again, and a shaft that it drives by their difference.
const PENDULUM: &str = "model m\nsolver rk4\nstep 0.1\nspan 4\nangle a = 0.2\nstate v = 8\nangle b = 40\nstate w = 5\n\
    a' = v\nv' = -4*sin(a) - 0.1*v\nb' = w\nw' = 2*sin(a - b + 0.4) + 0.1*cos(2*a - 3*b - 0.1*v)\noutput a, b\n";

/// Largest error of the states at the end of the span in steps of `step`, modulo a turn.
fn error(model: &Model, solver: Solver, step: f64) -> f64 {
    let mut model = Model { solver, ..model.clone() };
    model.set_step(step);
    let graph = pe_hls::step::build(&model).unwrap_or_else(|error| panic!("{solver:?}: {error:?}"));
    let mut run = DoubleRun::new(&graph);
    for done in 0..model.steps() {
        run.step(&model.sample_inputs(model.time(done, 0.0))).expect("finite");
        for (state, turn) in model.turns() {
            let number = run.state(StateId::at(state));
            assert!(number.abs() <= 0.5 * turn + 0.3, "{solver:?}: {number} turns after {done} steps");
        }
    }
    let solution =
        reference::solve_with_limit(&model, &[model.span], 1e-13, 1_000_000, &mut |_| {}).expect("it exists");
    let known = solution.states.principal(&[]);
    let angles = model.turns();
    let difference = |state: usize| {
        let (own, exact) = (run.state(StateId::at(state)), known.samples[state]);
        let turn = angles.iter().find(|(angle, _)| *angle == state).map(|(_, turn)| *turn);
        (turn.map_or(own, |turn| turns::nearest(own, exact, turn)) - exact).abs()
    };
    (0..model.states.len()).map(difference).fold(0.0, f64::max)
}

#[test]
fn every_method_has_its_order_where_turns_are_dropped() {
    let model = model(PENDULUM);
    for solver in Solver::ALL {
        // No gates, not linear, forces that depend on velocities.
        if matches!(solver, Solver::RushLarsen | Solver::Leapfrog | Solver::Exact) {
            continue;
        }
        let (long, short) = (error(&model, solver, 0.01), error(&model, solver, 0.005));
        let order = libm::log2(long / short);
        println!("{}: order {order:.2}, error {short:.1e}", solver.name());
        assert!(order > f64::from(solver.order()) - 0.25, "{}: {order:.2}, {short:e}", solver.name());
    }
    let positions = PENDULUM.replace(" - 0.1*v)", ")").replace(" - 0.1*v", "");
    let model = self::model(&positions);
    let order = libm::log2(error(&model, Solver::Leapfrog, 0.01) / error(&model, Solver::Leapfrog, 0.005));
    assert!(order > 1.75, "leapfrog: {order:.2}");
}

/// Formats, and the words of a shaft that turns by a fraction of a turn per step, after so many steps; with the word of the
/// first one, and how many words a turn has.
fn turned(speed: &str, solver: &str, steps: u64) -> (i128, i128, i128, i128) {
    use pe_ir::graph::StepGraph;
    use pe_sim::fixed::FixedRun;
    let text = format!("model m\nsolver {solver}\nstep 1 ms\nspan 1 s\nangle a = 1\na' = {speed}\noutput a\n");
    let model = model(&text);
    let graph: StepGraph = pe_hls::step::build(&model).expect("it has a step");
    let format = pe_ir::word::WordFormat::new(32, 32, 32);
    let graph =
        pe_judge::tables::tabulate(&model, &graph, format, &*pe_judge::progress::silent()).expect("it has tables");
    let mut run = DoubleRun::new(&graph);
    (0..1000).for_each(|_| run.step(&[]).expect("finite"));
    let mut largest = run.largest().to_vec();
    for (start, end) in &graph.states {
        largest[start.index()] = largest[start.index()].max(turns::REACH);
        largest[end.index()] = largest[end.index()].max(turns::REACH);
    }
    let ranges = formats::Ranges { widened: vec![0; largest.len()], largest };
    let fixed = formats::choose(&graph, &ranges, format).expect("it has formats");
    let mut run = FixedRun::new(&graph, &fixed);
    let state = graph.states[StateId::new(0)].0;
    let first = i128::from(run.word(state));
    assert!(!run.step(&[]));
    let second = i128::from(run.word(state));
    for _ in 1..steps {
        assert!(!run.step(&[]), "it saturates");
    }
    let turn = 1i128 << -fixed.exponents[state.index()];
    (first, second - first, i128::from(run.word(state)), turn)
}

#[test]
fn dropping_turns_adds_no_error_however_many_they_are() {
    // A million turns forwards, some backwards; one by a method of four stages.
    for (speed, solver, steps) in
        [("0.25*2*pi*1000", "euler", 4_000_000), ("-777.7", "rk4", 100_000), ("3", "ab3", 100_000)]
    {
        let (first, step, last, turn) = turned(speed, solver, steps);
        let wanted = first + i128::from(steps) * step;
        assert_eq!((last - wanted).rem_euclid(turn), 0, "{speed}: {last} after {steps} steps of {step}");
        assert!(steps as i128 * step.abs() > turn, "{speed}: no turn in {steps} steps of {step}");
        assert!(2 * last.abs() < turn + 2 * step.abs() + 2, "{speed}: {last} is not in a turn of {turn}");
    }
}

fn compiled(folder: &Folder, name: &str, text: &str, options: &[&str]) -> crate::support::models::Compiled {
    let path = folder.0.join(format!("{name}.spec"));
    std::fs::write(&path, text.replace("model m", &format!("model {name}"))).expect("the spec can be written");
    compile_file(&path, &[&["--tries", "20"], options].concat())
}

#[test]
fn differences_stay_right_after_many_turns() {
    let folder = Folder::new("angles_difference");
    let text = "model m\nsolver rk4\nstep 1 ms\nspan 20 s\nangle a = 0\nangle b = 0.5\nstate w = 200\nstate v = 201\n\
        d = a - b\na' = w\nb' = v\nw' = -4*sin(d) - 0.5*(w - v)\nv' = 4*sin(d) + 0.5*(w - v)\noutput a, b, d\n";
    let found = compiled(&folder, "difference", text, &[]);
    let judged = &found.design.judged;
    println!("word length {:.1e}, method {:.1e}", judged.errors.word_length, judged.errors.method);
    // 640 turns; relative to half a turn. What remains is the error of the speed, added up.
    assert!(judged.errors.word_length < 2e-5, "{:e}", judged.errors.word_length);
    assert!(judged.output_errors.iter().all(|error| *error < 1e-4), "{:?}", judged.output_errors);
    // The difference itself does not know of it.
    assert!(judged.output_errors[2] < 1e-6, "{:?}", judged.output_errors);
    for sample in judged.curves.fixed.samples.chunks_exact(3) {
        assert!(sample.iter().all(|number| number.abs() <= 0.5 * RADIANS + 1e-6), "{sample:?}");
    }
}

#[test]
fn the_range_of_an_angle_is_a_turn_whatever_the_run_does() {
    let folder = Folder::new("angles_range");
    // The run only swings about the lowest point.
    let text = "model m\nsolver rk4\nstep 1 ms\nspan 1 s\nangle a = 0\nstate v = 0\n\
        input u = sine(40, 2 Hz, 0, pi/2)\na' = v\nv' = u - 3*sin(a) - 1.5*v + 0.1*wrap(a)\noutput a, v\n";
    let found = compiled(&folder, "range", text, &[]);
    let mut run = pe_sim::fixed::FixedRun::new(&found.design.graph, &found.design.judged.fixed);
    let word = run.encode_input(0, 3.5).0;
    for _ in 0..6000 {
        assert!(!run.step(&[word]), "{:?}", run.saturations());
    }
    let exact = {
        let moved = text.replace("sine(40, 2 Hz, 0, pi/2)", "3.5").replace("span 1 s", "span 6 s");
        let model = model(&moved);
        reference::solve_with_limit(&model, &[6.0], 1e-12, 1_000_000, &mut |_| {}).expect("it exists").states.samples
    };
    let own: Vec<f64> = run.states().collect();
    assert!(exact[0] > 0.5, "it does not go over the top: {exact:?}");
    assert!((turns::nearest(own[0], exact[0], 1.0) - exact[0]).abs() < 1e-4, "{own:?} {exact:?}");
    assert!((own[1] - exact[1]).abs() < 1e-3, "{own:?} {exact:?}");
}

/// A model with a few angles that drive one another.
fn random(seed: u64) -> String {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let count = random.random_range(1..4);
    let solvers = ["rk4", "euler", "heun", "ab2", "symplectic_euler", "rkc5", "implicit_euler", "ros2", "heun3"];
    let solver = solvers[random.random_range(0..solvers.len())];
    let mut text = format!("model m\nsolver {solver}\nstep 1 ms\nspan 0.5 s\n");
    let sum = |random: &mut ChaCha8Rng| -> String {
        let terms: Vec<String> = (0..random.random_range(1..3))
            .map(|_| format!("{}*a{}", random.random_range(-2..3), random.random_range(0..count)))
            .collect();
        let rest = ["0", "pi/3", "0.3*w0", "1.5"][random.random_range(0..4)];
        terms.join(" + ") + " + " + rest
    };
    for index in 0..count {
        text += &format!("angle a{index} = {}\nstate w{index} = {}\n", random.random_range(-9.0..9.0), 20 * index + 15);
        let (one, other) = (sum(&mut random), sum(&mut random));
        text += &format!("a{index}' = w{index} + 0.2*sin({one})\nw{index}' = 5*cos({other}) - 0.2*w{index}\n");
    }
    text + &format!("g = a0 - a{}\noutput a0, g, w0\n", count - 1)
}

#[test]
fn random_models_with_angles_compute_the_same_words_in_all_engines() {
    let folder = Folder::new("angles_random");
    for seed in 0..if crate::support::is_long_suite() { 40 } else { 3 } {
        let text = random(seed);
        let multiplier = ["32x32", "25x18", "25x35"][seed as usize % 3];
        let found = compiled(&folder, &format!("random{seed}"), &text, &["--multiplier", multiplier, "--pes", "2"]);
        let errors = found.design.judged.errors;
        println!("{seed}, {multiplier}: word length {:.1e}, method {:.1e}", errors.word_length, errors.method);
        assert_lively_agreement(&format!("angles {seed}"), &found.starts(60), &[Engine::Ghdl], 0.4);
    }
}
