//! Signals that are part of the model: orders of all methods, words that agree in all engines, long runs.

mod support;

use std::process::Command;

use pe_frontend::{NoFiles, Overrides};
use pe_ir::model::{Model, Solver};
use pe_ir::source::Sources;
use pe_sim::double::DoubleRun;
use pe_sim::reference;
use serde_json::Value;
use support::bench::Folder;

fn model(text: &str) -> Model {
    let model = pe_frontend::compile(&mut Sources::new("m.spec", text), &NoFiles, &Overrides::default());
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
    (0..2).map(|state| (run.state(state) - solution.states.samples[state]).abs()).fold(0.0, f64::max)
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
fn all_engines_compute_the_same_words() {
    let folder = Folder::new("signals_agree");
    let linear = "state x = 0.2\nstate v = 0\nx' = v\nv' = -4*x - 0.2*v + u\noutput x, u\n";
    let sampled = "state x = 0\nx' = u - x\nevery 40 ms {\n  u = sine(1, 2 Hz) + 0.1*time - x\n}\noutput x, u\n";
    let cases = [
        ("sine_rk4", "rk4", "10 ms", format!("{linear}u = sine(1, 0.5 Hz, 0.2, 0.5)\n")),
        ("sine_heun3", "heun3", "10 ms", format!("{linear}u = sine(1, 0.5 Hz)*(1 - 0.3*x)\n")),
        ("sine_euler", "euler", "1 ms", format!("{linear}u = sine(1, 0.5 Hz)\n")),
        ("sine_exact", "exact", "10 ms", format!("{linear}u = sine(1, 0.5 Hz) + 0.1*time\n")),
        ("ramp", "rk4", "10 ms", format!("{linear}u = ramp(0, 1, 0.1 s, 0.2 s)\n")),
        ("function", "rk4", "10 ms", format!("{linear}u = exp(-time) - 0.1*x^3\n")),
        (
            "leapfrog",
            "leapfrog",
            "10 ms",
            "state x = 1\nstate v = 0\nx' = v\nv' = sine(1, 1 Hz) - 4*x\noutput x\n".to_owned(),
        ),
        ("rosenbrock", "rodas3", "10 ms", format!("{linear}u = sine(1, 0.5 Hz) + exp(-time)\n")),
        ("list", "ros2", "1 ms until 20 ms, then 10 ms", format!("{linear}u = sine(1, 0.5 Hz) + 0.1*time - 0.1*x^3\n")),
        ("adams", "ab3", "10 ms", format!("{linear}u = sine(1, 0.5 Hz) + 0.1*time\n")),
        ("chebyshev", "rkc5", "10 ms", format!("{linear}u = sine(1, 0.5 Hz) + 0.1*time\n")),
        ("sampled", "heun", "10 ms", sampled.to_owned()),
    ];
    let forms = ["horner", "factors", "full"].map(|form| (form, "rk4", "10 ms", cases[0].3.clone()));
    for (name, solver, step, statements) in cases.into_iter().chain(forms) {
        let text = format!("model m\nsolver {solver}\nstep {step}\nspan 1.02 s\n{statements}");
        std::fs::write(folder.0.join("m.spec"), text).expect("the spec can be written");
        let form: &[&str] = if ["horner", "factors", "full"].contains(&name) { &["--form", name] } else { &[] };
        let (exit, _, messages) =
            run(&folder, &[&["compile", "m.spec", "-o", name, "--pes", "2", "--no-pictures"], form].concat());
        assert_eq!(exit, Some(0), "{name}: {messages}");
        // A program to build takes longer than all else.
        let sure = name == "sine_rk4" || name == "list";
        let (exit, said, messages) =
            run(&folder, &["verify", name, "--steps", "30", "--engines", if sure { "reference,ghdl" } else { "ghdl" }]);
        assert_eq!(exit, Some(0), "{name}: {said}{messages}");
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
