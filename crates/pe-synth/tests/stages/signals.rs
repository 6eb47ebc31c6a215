//! Signals that are part of the model: orders of all methods, words that agree in all engines, long runs.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;

use crate::support::bench::{Folder, assert_lively_agreement};
use crate::support::models::compile_file;
use crate::support::{is_long_suite, kept};
use pe_frontend::Overrides;
use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_ir::source::Sources;
use pe_sim::double::DoubleRun;
use pe_sim::reference;
use pe_verify::engines::Engine;
use serde_json::Value;

/// Samples of a smooth signal every 200 ms, with a kink and a jump at each.
fn samples() -> String {
    let row = |k: u32| format!("{:.1},{:.6}\n", 0.2 * f64::from(k), libm::sin(1.3 * f64::from(k)));
    format!("t,p\n{}", (0..=20).map(row).collect::<String>())
}

fn model(text: &str) -> Model {
    let files = BTreeMap::from([("s.csv".to_owned(), samples().into_bytes())]);
    let model = pe_frontend::compile(&mut Sources::new("m.spec", text), &files, &Overrides::default());
    pe_hls::lift::lift(model.unwrap_or_else(|findings| panic!("{findings:?}")).0)
}

/// A damped oscillator driven by a sine, a square of the time and a ramp that begins on a step.
const OSCILLATOR: &str = "model m\nsolver rk4\nstep 0.1\nspan 4\nstate x = 0.2\nstate v = 0\n\
    x' = v\nv' = -4*x - 0.2*v + u\noutput x\n";
const SINE: &str = "u = sine(1, 0.5 Hz, 0.2, 0.5)\n";
const NONLINEAR: &str = "u = sine(1, 0.5 Hz)*(1 + 0.1*time^2) - 0.3*x^3\n";

/// Largest error of the last state in steps of `step`, over the magnitude of the solution.
fn error(model: &Model, solver: Solver, step: f64) -> f64 {
    let mut model = Model { solver, ..model.clone() };
    model.set_step(step);
    let graph = pe_hls::step::build(&model).unwrap_or_else(|error| panic!("{solver:?}: {error:?}"));
    let mut run = DoubleRun::new(&graph);
    let steps = model.steps();
    for done in 0..steps {
        run.step(&model.sample_inputs(model.time(done, 0.0))).expect("finite");
    }
    let solution =
        reference::solve_with_limit(&model, &[model.span], 1e-13, 1_000_000, &mut |_| {}).expect("it exists");
    (0..2).map(|state| (run.state(StateId::at(state)) - solution.states.samples[state]).abs()).fold(0.0, f64::max)
}

#[test]
fn every_method_has_its_order_in_driven_models() {
    for (what, signal) in [("a sine", SINE), ("products", NONLINEAR)] {
        let model = model(&format!("{OSCILLATOR}{signal}"));
        for solver in Solver::ALL {
            // Without functions of another state no state is a gate; a method for linear models; positions alone.
            let suits = !matches!(solver, Solver::RushLarsen | Solver::Leapfrog)
                && (solver != Solver::Exact || what == "a sine");
            if !suits {
                continue;
            }
            let (long, short) = (error(&model, solver, 0.02), error(&model, solver, 0.01));
            if solver == Solver::Exact {
                assert!(long < 1e-9, "{what}: {long:e}");
                continue;
            }
            let order = libm::log2(long / short);
            println!("{what}, {}: order {order:.2}, error {short:.1e}", solver.name());
            assert!(order > f64::from(solver.order()) - 0.2, "{what}, {}: {order:.2}", solver.name());
        }
    }
}

/// Signals that the network plays; what jumps or bends does so between two steps.
const PLAYED: [&str; 7] = [
    "u = square(1, 0.5 Hz, 0.2, 0.3)*(1 - 0.2*x)\n",
    "u = pulse(1, 0.2 s, 0.4 s) + pulse(0.3, 0.8 s, 0.4 s, 0, 1 s)\n",
    "u = pwm(-1, 1, 2 Hz, 0.5 + 0.3*square(1, 0.5 Hz))\n",
    "u = samples(\"s.csv\", \"p\", hold) - 0.1*x^3\n",
    "u = samples(\"s.csv\", \"p\", linear)\n",
    "u = samples(\"s.csv\", \"p\", linear)*(1 - 0.2*x)\n",
    "u = chirp(1, 0.2 Hz, 0.7 Hz, 2 s, 0.1, 0.4)\n",
];

#[test]
fn every_method_has_its_order_with_played_signals() {
    for signal in PLAYED {
        let model = model(&format!("{OSCILLATOR}{signal}"));
        for solver in Solver::ALL {
            // Methods of several steps lose their order for some steps after a jump or bend.
            let steps = matches!(solver, Solver::Ab2 | Solver::Ab3 | Solver::Ab4);
            if steps || matches!(solver, Solver::RushLarsen | Solver::Leapfrog | Solver::Exact) {
                continue;
            }
            if solver == Solver::SymplecticEuler && signal.contains("chirp") {
                continue;
            }
            let (long, short) = (error(&model, solver, 0.02), error(&model, solver, 0.01));
            let order = libm::log2(long / short);
            println!("{}, {}: order {order:.2}, error {short:.1e}", signal.trim(), solver.name());
            assert!(order > f64::from(solver.order()) - 0.2, "{signal}, {}: {order:.2}", solver.name());
        }
    }
}

#[test]
fn gates_may_be_driven() {
    for signal in ["sine(1, 0.5 Hz)", "square(1, 0.5 Hz)", "0.1*time", "samples(\"s.csv\", \"p\", linear)"] {
        let text = format!(
            "model m\nsolver rush_larsen\nstep 0.1\nspan 4\nstate x = 0.2\nstate v = 0.1\n\
             x' = {signal} - x - v\nv' = (1/(1 + exp(-x)) - v)/(0.5 + 0.2*x^2)\noutput x, v\n"
        );
        let model = model(&text);
        let order = libm::log2(error(&model, Solver::RushLarsen, 0.02) / error(&model, Solver::RushLarsen, 0.01));
        println!("{signal}: order {order:.2}");
        assert!(order > 0.8, "{signal}: {order}");
    }
}

/// An input sampled once per step, as the hardware does it.
fn driven(solver: &str, step: &str, between: &str) -> Model {
    let text =
        OSCILLATOR.replace("solver rk4", &format!("solver {solver}")).replace("step 0.1", &format!("step {step}"));
    model(&format!("{text}input u = sine(1, 0.5 Hz, 0.2, 0.5), {between}\n"))
}

#[test]
fn held_inputs_have_order_one_and_interpolated_ones_order_two() {
    let list = "5 ms until 1 s, then 20 ms";
    let cases = [
        ("rk4", "0.02", 4.0),
        ("heun", "0.02", 2.0),
        ("rodas3", "0.02", 3.0),
        ("ros2", list, 2.0),
        ("rodas3", list, 3.0),
    ];
    for (solver, step, own) in cases {
        let orders = [("hold", 1.0f64), ("linear", 2.0)].map(|(between, order)| {
            let model = driven(solver, step, between);
            let order_seen = libm::log2(error(&model, model.solver, 0.02) / error(&model, model.solver, 0.01));
            println!("{between}, {solver}, {step}: order {order_seen:.2}");
            (order_seen, order.min(own))
        });
        for (seen, order) in orders {
            assert!((seen - order).abs() < 0.2, "{solver}, {step}: {orders:?}");
        }
    }
}

#[test]
fn methods_keep_their_order_with_a_list_of_steps() {
    for (solver, order) in [("implicit_euler", 1.0), ("trapezoidal", 2.0), ("ros2", 2.0), ("rodas3", 3.0)] {
        let text = OSCILLATOR.replace("solver rk4", &format!("solver {solver}"));
        let model = model(&format!("{}{SINE}", text.replace("step 0.1", "step 5 ms until 1 s, then 20 ms")));
        let seen = libm::log2(error(&model, model.solver, 0.02) / error(&model, model.solver, 0.01));
        println!("{solver}: order {seen:.2}");
        assert!(seen > order - 0.2, "{solver}: {seen:.2}");
    }
}

#[test]
fn what_cannot_be_played_is_refused_by_name() {
    let folder = Folder::new("signals_refused");
    std::fs::write(folder.0.join("s.csv"), samples()).expect("samples can be written");
    let rows = (0..300).map(|k| format!("{},{}\n", 0.01 * f64::from(k), k % 7)).collect::<String>();
    std::fs::write(folder.0.join("long.csv"), format!("t,p\n{rows}")).expect("samples can be written");
    let cases = [
        ("rk4", "10 ms", "samples(\"long.csv\", \"p\", linear)", "E0116"),
        ("rk4", "10 ms", "pwm(-1, 1, 200 Hz, 0.5 + 0.1*sine(1, 1 Hz))", "E0116"),
        ("ros2", "1 ms until 20 ms, then 10 ms", "square(1, 5 Hz)", "E0117"),
        ("heun", "1 ns", "square(1, 0.1 Hz, 0, 0.2)", "E0118"),
        ("heun", "1 us", "pwm(-1, 1, 0.5 Hz, 0.5 + 0.1*square(1, 0.1 Hz))", "E0118"),
        ("rk4", "10 ms", "chirp(1, 1 Hz, 45 Hz, 2 s)", "E0914"),
    ];
    for (solver, step, signal, code) in cases {
        let text =
            format!("model m\nsolver {solver}\nstep {step}\nspan 4 s\nstate x = 0\nx' = {signal} - x\noutput x\n");
        std::fs::write(folder.0.join("m.spec"), text).expect("the spec can be written");
        let (exit, said, messages) = run(&folder, &["compile", "m.spec", "-o", "out"]);
        assert!(exit == Some(1) && messages.contains(code), "{signal}: {exit:?} {said}{messages}");
        if let Some((_, step)) = messages.split_once("such as `--step ").filter(|_| signal.starts_with("pwm")) {
            let step = step.split('`').next().expect("a number");
            let (_, _, messages) = run(&folder, &["dump", "m.spec", "--stage", "step", "--step", step]);
            assert!(
                !messages.contains("E0118"),
                "{signal}: the step {step} of the help is refused as well: {messages}"
            );
        }
    }
}

#[test]
fn positions_and_velocities_may_be_driven() {
    let text = "model m\nsolver leapfrog\nstep 0.1\nspan 4\nstate x = 0.2\nstate v = 0\n\
        x' = v\nv' = -4*x + sine(1, 0.5 Hz) + 0.1*time\noutput x\n";
    let model = model(text);
    let order = libm::log2(error(&model, Solver::Leapfrog, 0.02) / error(&model, Solver::Leapfrog, 0.01));
    assert!(order > 1.8, "{order}");
}

fn run(folder: &Folder, arguments: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pe-synth"));
    let output = command.current_dir(&folder.0).args(arguments).output().expect("pe-synth starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn periods_of_any_length_begin_and_end_with_their_steps() {
    // Period and width in steps of 1 us, start in steps: whole ones, ratios, one that two counters do not divide evenly.
    let cases = [
        (1_000_000.0, 500.0, 50_000.0),
        (1_000_003.0, 300_001.0, 999_000.0),
        (700_000.5, 350_000.25, 0.0),
        (400_000.0 / 3.0, 1000.0, 0.0),
        (262_144.0, 1.0, 262_143.0),
        (262_145.0, 262_144.0, 1.0),
        (1_414_213.562_373_095_1, 700_000.0, 77.0),
        (543.21, 200.0, 3.0),
    ];
    for (period, width, start) in cases {
        let text = format!(
            "model m\nsolver euler\nstep 1 us\nspan 3 s\nstate x = 0\nx' = u - x\n\
             u = pulse(1, {start:e} us, {width:e} us, 0, {period:e} us)\noutput x, u\n"
        );
        let model = model(&text);
        let graph = pe_hls::step::build(&model).unwrap_or_else(|error| panic!("{period}: {error:?}"));
        let held = model.states.iter().position(|state| state.motion.is_some()).expect("a played signal");
        let mut run = DoubleRun::new(&graph);
        let (mut jumps, mut before) = (0, f64::NAN);
        for step in 0..model.steps() {
            let is = run.state(StateId::at(held));
            let since = step as f64 + pe_ir::motion::MIDDLE - start;
            let within = since - period * libm::floor(since / period);
            let on = since >= 0.0 && within < width;
            // Where a jump falls on the place that is looked at, within the drift, either side will do.
            let near = |place: f64| (within - place).abs().min(period - (within - place).abs()) < 0.01;
            assert!(is == f64::from(u8::from(on)) || near(0.0) || near(width), "{period} {width} {start}: step {step}");
            jumps += u32::from(is != before);
            before = is;
            run.step(&[]).expect("finite");
        }
        assert!(jumps > 3, "{period}: {jumps} jumps");
    }
}

#[test]
fn a_short_port_plays_a_long_period() {
    let folder = Folder::new("signals_long_period");
    let text = "model m\nsolver heun\nstep 1 us\nspan 2.5 s\nstate x = 0\nx' = u - x\nu = pulse(1, 50 ms, 0.5 ms, 0, 1 s)\n\
                output x, u\n";
    std::fs::write(folder.0.join("m.spec"), text).expect("the spec can be written");
    let (_, said, messages) = run(&folder, &["check", "m.spec", "--message-format", "json", "--multiplier", "25x18"]);
    let result: Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}{messages}"));
    let error = result["error"]["word_length"].as_f64().unwrap_or(f64::INFINITY);
    assert!(error < 1e-2, "{error:e}");
}

/// Statements of a driven oscillator.
const LINEAR: &str = "state x = 0.2\nstate v = 0\nx' = v\nv' = -4*x - 0.2*v + u\noutput x, u\n";

/// Statements of a part that is sampled every 40 ms.
const SAMPLED: &str = "state x = 0\nx' = u - x\nevery 40 ms {\n  u = sine(1, 2 Hz) + 0.1*time - x\n}\noutput x, u\n";

const SHORT: &str = "10 ms";
const LISTED: &str = "1 ms until 20 ms, then 10 ms";

/// Writes the spec of a case: a name, which is the form of the step if there is such a form; solver, steps and
/// statements.
fn written(
    folder: &Folder,
    (name, solver, step, statements): (&str, &str, &str, &str),
) -> (PathBuf, Vec<&'static str>) {
    std::fs::write(folder.0.join("s.csv"), samples()).expect("samples can be written");
    let path = folder.0.join(format!("{name}.spec"));
    let text = format!("model m\nsolver {solver}\nstep {step}\nspan 1.02 s\n{statements}");
    std::fs::write(&path, text).expect("the spec can be written");
    let form = ["horner", "factors", "full"].into_iter().find(|form| *form == name);
    (path, form.map_or(vec!["--pes", "2"], |form| vec!["--pes", "2", "--form", form]))
}

/// Compiles a case and verifies it from all starts.
fn assert_verified(folder: &Folder, case: (&str, &str, &str, &str), engines: &str) {
    let (name, (_, options)) = (case.0, written(folder, case));
    let spec = format!("{name}.spec");
    let compile = [&["compile", &spec, "-o", name, "--no-pictures"], &options[..]].concat();
    let (exit, _, messages) = run(folder, &compile);
    assert_eq!(exit, Some(0), "{name}: {messages}");
    let (exit, said, messages) = run(folder, &["verify", name, "--steps", "30", "--engines", engines]);
    assert_eq!(exit, Some(0), "{name}: {said}{messages}");
}

/// GHDL computes the words of the simulator from the beginning and from the middle; in the long suite from all starts.
fn assert_same_words(folder: &str, cases: &[(&str, &str, &str, &str)]) {
    let folder = Folder::new(folder);
    for case in cases {
        let (name, solver, step, signal) = *case;
        let statements = format!("{LINEAR}{signal}\n");
        if is_long_suite() {
            assert_verified(&folder, (name, solver, step, &statements), "ghdl");
            continue;
        }
        let (path, options) = written(&folder, (name, solver, step, &statements));
        let starts = compile_file(&path, &options).starts(30);
        assert_lively_agreement(&format!("signals {name}"), &starts, &[Engine::Ghdl], HELD);
    }
}

/// Part of the words that change at the least where a signal is held for many steps.
const HELD: f64 = 0.4;

#[test]
fn ghdl_computes_the_same_words_of_smooth_signals() {
    let sine = "u = sine(1, 0.5 Hz, 0.2, 0.5)";
    assert_same_words(
        "signals_smooth",
        &[
            ("sine_rk4", "rk4", SHORT, sine),
            ("sine_heun3", "heun3", SHORT, "u = sine(1, 0.5 Hz)*(1 - 0.3*x)"),
            ("sine_euler", "euler", "1 ms", "u = sine(1, 0.5 Hz)"),
            ("sine_exact", "exact", SHORT, "u = sine(1, 0.5 Hz) + 0.1*time"),
            ("ramp", "rk4", SHORT, "u = ramp(0, 1, 0.1 s, 0.2 s)"),
            ("function", "rk4", SHORT, "u = exp(-time) - 0.1*x^3"),
            ("rosenbrock", "rodas3", SHORT, "u = sine(1, 0.5 Hz) + exp(-time)"),
            ("adams", "ab3", SHORT, "u = sine(1, 0.5 Hz) + 0.1*time"),
            ("chebyshev", "rkc5", SHORT, "u = sine(1, 0.5 Hz) + 0.1*time"),
            ("horner", "rk4", SHORT, sine),
            ("factors", "rk4", SHORT, sine),
            ("full", "rk4", SHORT, sine),
        ],
    );
}

#[test]
fn ghdl_computes_the_same_words_of_signals_with_jumps_and_of_lines() {
    assert_same_words(
        "signals_jumps",
        &[
            ("pulse", "euler", SHORT, "u = pulse(1, 180 ms, 50 ms, 0.1, 0.2) + pulse(1, 0.1 s, 0.3 s)"),
            ("long_period", "rk4", "1 us", "u = pulse(1, 5 us, 3 us, 0.1, 0.7 s)"),
            ("pwm", "ros2", SHORT, "u = pwm(-1, 1, 10 Hz, 0.5 + 0.4*sine(1, 1 Hz))"),
            ("chirp", "rk4", SHORT, "u = chirp(1, 1 Hz, 5 Hz, 0.6 s)"),
            ("samples", "ab3", SHORT, "u = samples(\"s.csv\", \"p\", linear)"),
            ("line", "rk4", SHORT, "input u = sine(1, 2 Hz), linear"),
        ],
    );
}

#[test]
fn verify_finds_the_same_words_from_all_its_starts() {
    let folder = Folder::new("signals_verified");
    let linear = |signal: &str| format!("{LINEAR}{signal}\n");
    let positions = "state x = 1\nstate v = 0\nx' = v\nv' = sine(1, 1 Hz) - 4*x\noutput x\n";
    let cases = [
        ("list", "ros2", LISTED, linear("u = sine(1, 0.5 Hz) + 0.1*time - 0.1*x^3")),
        ("sampled", "heun", SHORT, SAMPLED.to_owned()),
        ("leapfrog", "leapfrog", SHORT, positions.to_owned()),
        ("lines", "ros2", LISTED, linear("input u = sine(1, 2 Hz), linear")),
        ("square", "rk4", SHORT, linear("u = square(1, 5 Hz)*(1 - 0.3*x) + samples(\"s.csv\", \"p\", hold)")),
        ("blocks", "rkc5", SHORT, SAMPLED.replace("sine(1, 2 Hz)", "square(1, 2 Hz)")),
    ];
    for (name, solver, step, statements) in kept(cases, 1) {
        // A program to build takes longer than all else.
        let engines = if ["list", "square"].contains(&name) { "reference,ghdl" } else { "ghdl" };
        assert_verified(&folder, (name, solver, step, &statements), engines);
    }
}

#[test]
fn a_sine_keeps_its_amplitude_and_phase_over_a_million_steps() {
    let folder = Folder::new("signals_long");
    let text = "model m\nsolver heun\nstep 1 ms\nspan 1000 s\nstate x = 0\nx' = sine(1, 7 Hz) - x\noutput x\n";
    std::fs::write(folder.0.join("m.spec"), text).expect("the spec can be written");
    for (multiplier, most) in [("32x32", 2e-5), ("35x35", 2e-6), ("25x18", 0.2)] {
        let (_, said, messages) =
            run(&folder, &["check", "m.spec", "--message-format", "json", "--multiplier", multiplier]);
        let result: Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}{messages}"));
        let error = result["error"]["word_length"].as_f64().unwrap_or(f64::INFINITY);
        println!("{multiplier}: {error:.1e}");
        assert!(error < most, "{multiplier}: {error:e}");
    }
}

#[test]
fn the_time_of_a_spec_is_its_own_if_it_has_one() {
    let text = "model m\nsolver rk4\nstep 0.1\nspan 1\nstate time = 5\ntime' = -time\nstate x = 0\n\
        x' = time + ramp(0, 1, 0.2 s, 0.3 s)\noutput x\n";
    let own = model(text);
    let names: Vec<&str> = own.states.iter().map(|state| state.name.as_str()).collect();
    assert_eq!(names, ["time", "x", "time.steps"]);
    assert!(own.algebraics.iter().any(|algebraic| algebraic.name == "time_"));
    assert_eq!(own.odes(), 2);
    let unread = model("model m\nsolver rk4\nstep 0.1\nspan 1\nstate x = 1\nu = sine(1, 1 Hz)\nx' = -x\noutput x\n");
    assert_eq!(unread.states.len(), 1, "what no output depends on is left out");
}
