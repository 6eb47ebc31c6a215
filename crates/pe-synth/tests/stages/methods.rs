//! Methods that are no explicit Runge-Kutta methods: order of convergence, limits of stability, and their way through
//! all stages, bit for bit.

use crate::support::bench::{Agreement, Folder, assert_agreement};
use crate::support::flow::{Flow, Placement, Start, format};
use crate::support::is_long_suite;
use crate::support::models::compile_file;
use pe_frontend::{NoFiles, Overrides};
use pe_ir::graph::StageForm;
use pe_ir::index::StateId;
use pe_ir::model::{Model, Solver};
use pe_ir::program::Program;
use pe_ir::source::{Diagnostic, Sources};
use pe_sim::double::DoubleRun;
use pe_sim::machine::Machine;
use pe_sim::reference;
use pe_verify::engines::Engine;

/// Two coupled oscillators with cubic springs, no damping.
const SPRINGS: &str = "
state x[i] = 0.4 + 0.3*i
state v[i] = 0.2*i
x[i]' = v[i]
v[i]' = -1.5*x[i] - x[i]^3 + 0.5*(x[3 - i] - x[i])
output x[1], v[2]
";

/// A ring of masses: neighbours have equal coefficients, so that operands are paired.
const RING: &str = "
index k in 1..8
state x[k] = 0.1*k
state v[k] = 0.3 - 0.05*k
x[k]' = v[k]
v[k]' = 2*(if k > 1 then x[k - 1] else x[8]) + 2*(if k < 8 then x[k + 1] else x[1]) - 4.5*x[k]
output x[1], v[5]
";

/// The same with damping, which also couples the velocities, and a drive.
const DAMPED: &str = "
input u = sine(0.5, 0.3)
state x[i] = 0.4 + 0.3*i
state v[i] = 0.2*i
x[i]' = v[i]
v[i]' = -1.5*x[i] - x[i]^3 + 0.5*(x[3 - i] - x[i]) + 0.3*(v[3 - i] - 2*v[i]) + u
output x[1], v[2], u
";

/// A nonlinear system with a shared algebraic variable and a published one.
const BRUSSELATOR: &str = "
state x = 1.2
state y = 3.1
power = x^2*y
total = x + y
x' = 1 + power - 4*x
y' = 3*x - power
output x, y, total
";

/// A linear system with an input and a constant.
const LINEAR: &str = "
input u = sine(1.0, 0.2)
state a = 1
state b = 0.5
state c = -0.5
all = a + b + c
a' = -1.2*a + 0.9*b + u
b' = -0.9*a - 0.3*b + 0.4*c + 0.1
c' = -0.5*c + 0.2*all - u
output a, all
";

/// A membrane with a gate whose rates are functions of the voltage.
const GATE: &str = "
state V = -0.5
state n = 0.3
opening = 0.8/(1 + exp(-3*V))
closing = 0.5*exp(-0.7*V)
V' = 1.1 - 2*n^2*(V + 0.8) - 0.6*V
n' = opening*(1 - n) - closing*n
output V, n, opening
";

/// A mass that depends on the position: the derivatives of its reciprocal are read several times.
const SWING: &str = "
state x = 0.5
state y = 0.2
mass = 1.5 + sin(x)*y
x' = y/mass
y' = -x/mass - 0.3*y
output x
";

/// A chain of decays whose rates differ by six decades.
const CHAIN: &str = "
state a = 1
state b = 0.5
state c = 0
a' = -1e5*a + 1e5*b
b' = 50*a - 50*b - 0.5*b
c' = 0.5*b - 0.1*c
output a, b, c
";

fn model(body: &str, solver: Solver, step: f64, span: f64) -> Model {
    stepped(body, solver, &format!("{step:e} s"), span)
}

fn stepped(body: &str, solver: Solver, step: &str, span: f64) -> Model {
    let text =
        format!("model m \"test\"\nsolver {}\nstep {step}\nspan {span} s\nindex i in 1..2\n{body}", solver.name());
    let mut sources = Sources::new("m.spec", &text);
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default());
    pe_hls::lift::lift(compiled.unwrap_or_else(|findings| panic!("{findings:?}")).0)
}

fn refusal(body: &str, solver: Solver) -> Diagnostic {
    let findings =
        pe_hls::step::build(&model(body, solver, 0.01, 1.0)).expect_err("the solver does not suit the model");
    findings.into_iter().next().expect("a finding")
}

/// The states at the end of the span.
fn end(model: &Model) -> Vec<f64> {
    let graph = pe_hls::step::build(model).unwrap_or_else(|findings| panic!("{findings:?}"));
    let mut run = DoubleRun::new(&graph);
    for step in 0..model.steps() {
        run.step(&model.sample_inputs(model.time(step, 0.0))).expect("the step is stable");
    }
    (0..model.states.len()).map(|state| run.state(StateId::at(state))).collect()
}

/// Logarithmic slope of the error over the step, from a step and its quarter.
fn measured_order(body: &str, solver: Solver, step: f64) -> f64 {
    const SPAN: f64 = 4.0;
    let error = |step: f64| {
        let model = model(body, solver, step, SPAN);
        let reference = reference::solve(&model, &[SPAN], 1e-13, &mut |_| {}).expect("smooth models");
        let errors = end(&model).into_iter().zip(reference.samples).map(|(is, should)| (is - should).abs());
        errors.fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(step), error(step / 4.0));
    assert!(fine > 1e-12, "{solver:?}: nothing but rounding is left");
    libm::log2(coarse / fine) / 2.0
}

#[test]
fn errors_fall_with_the_order_of_the_method() {
    // With the input at rest only the method has an error.
    let held = LINEAR.replace("sine(1.0, 0.2)", "constant(0.7)");
    let cases = [
        (SPRINGS, Solver::Leapfrog, 0.02),
        (SPRINGS, Solver::SymplecticEuler, 0.005),
        (SPRINGS, Solver::Ab2, 0.01),
        (SPRINGS, Solver::Rkc5, 0.02),
        (BRUSSELATOR, Solver::Ab2, 0.005),
        (BRUSSELATOR, Solver::Ab3, 0.005),
        (BRUSSELATOR, Solver::Ab4, 0.01),
        (BRUSSELATOR, Solver::Rkc5, 0.02),
        (BRUSSELATOR, Solver::Rkc10, 0.02),
        (&held, Solver::ImplicitEuler, 0.01),
        (&held, Solver::Trapezoidal, 0.05),
        (&held, Solver::Ros2, 0.05),
        (&held, Solver::Rodas3, 0.05),
        (BRUSSELATOR, Solver::ImplicitEuler, 0.002),
        (BRUSSELATOR, Solver::Trapezoidal, 0.01),
        (BRUSSELATOR, Solver::Ros2, 0.005),
        (BRUSSELATOR, Solver::Rodas3, 0.01),
        (GATE, Solver::RushLarsen, 0.002),
        (GATE, Solver::Rodas3, 0.02),
        (GATE, Solver::Ab3, 0.005),
        (GATE, Solver::Rkc5, 0.02),
    ];
    for (body, solver, step) in cases {
        let order = measured_order(body, solver, step);
        println!("{solver:?}: {order:.3}");
        assert!((order - f64::from(solver.order())).abs() < 0.15, "{solver:?}: {order}");
    }
}

/// The largest `h` at which a decaying or rotating model does not grow, by bisection.
fn limit(body: &str, solver: Solver, mut high: f64) -> f64 {
    let stable = |step: f64| {
        let model = model(body, solver, step, 4000.0 * step);
        let graph = pe_hls::step::build(&model).expect("the solver suits the model");
        let mut run = DoubleRun::new(&graph);
        (0..4000).all(|_| run.step(&[]).is_ok() && run.state(StateId::new(0)).abs() < 1e3)
    };
    let mut low = 0.0;
    for _ in 0..12 {
        let middle = (low + high) / 2.0;
        if stable(middle) { low = middle } else { high = middle }
    }
    low
}

#[test]
fn steps_are_stable_up_to_the_known_limits() {
    const DECAY: &str = "state y = 1\ny' = -y + 0*y^2\noutput y\n";
    const ROTATION: &str = "state x = 1\nstate v = 0\nx' = v\nv' = -x\noutput x\n";
    // From the stability polynomials; Hairer and Wanner, Solving Ordinary Differential Equations II, section V.1.
    let cases = [
        (DECAY, Solver::Ab2, 1.0),
        (DECAY, Solver::Ab3, 0.5455),
        (DECAY, Solver::Ab4, 0.3),
        (DECAY, Solver::Rkc5, 16.60),
        (DECAY, Solver::Rkc10, 64.7),
        (ROTATION, Solver::Ab3, 0.724),
        (ROTATION, Solver::Ab4, 0.430),
        (ROTATION, Solver::SymplecticEuler, 2.0),
        (ROTATION, Solver::Leapfrog, 2.0),
    ];
    for (body, solver, known) in cases {
        let found = limit(body, solver, 1.5 * known);
        println!("{solver:?}: {found:.4}, known {known}");
        assert!((found / known - 1.0).abs() < 0.02, "{solver:?}: {found} is not {known}");
    }
}

#[test]
fn the_exact_step_of_a_linear_model_has_no_error_of_its_own() {
    let body = LINEAR.replace("sine(1.0, 0.2)", "constant(0.7)");
    let model = model(&body, Solver::Exact, 0.5, 4.0);
    let reference = reference::solve(&model, &[4.0], 1e-13, &mut |_| {}).expect("a smooth model");
    for (is, should) in end(&model).iter().zip(&reference.samples) {
        assert!((is - should).abs() < 1e-11, "{is} is not {should}");
    }
}

#[test]
fn implicit_methods_take_steps_far_beyond_the_fastest_rate() {
    for (solver, bound) in [(Solver::ImplicitEuler, 0.02), (Solver::Ros2, 3e-3), (Solver::Rodas3, 1e-4)] {
        let model = model(CHAIN, solver, 0.05, 4.0);
        let exact = end(&Model { solver: Solver::Exact, ..model.clone() });
        for (is, should) in end(&model).iter().zip(&exact) {
            assert!((is - should).abs() < bound, "{solver:?}: {is} is not {should}");
        }
    }
}

/// Three reactions with rates nine decades apart (Robertson 1966).
const ROBERTSON: &str = "
state a = 1
state b = 0
state c = 0
a' = -0.04*a + 1e4*b*c
b' = 0.04*a - 1e4*b*c - 3e7*b^2
c' = 3e7*b^2
output a, b, c
";

#[test]
fn a_list_of_steps_takes_robertson_to_40_seconds_in_1196_steps() {
    const STEPS: &str = "0.5 ms until 0.4 s, then 0.1 s";
    // Hairer and Wanner, Solving Ordinary Differential Equations II; the test set of Bari has the same digits.
    let published = [0.715_827_068_718_5, 9.185_534_764_558e-6, 0.284_163_745_746];
    for (solver, bound) in [(Solver::ImplicitEuler, 5e-3), (Solver::Ros2, 1e-4), (Solver::Rodas3, 1e-6)] {
        let model = stepped(ROBERTSON, solver, STEPS, 40.0);
        assert_eq!(model.steps(), 1196);
        let errors: Vec<f64> =
            end(&model).iter().zip(published).map(|(is, should)| (is / should - 1.0).abs()).collect();
        println!("{solver:?}: {errors:?}");
        assert!(errors.iter().all(|error| *error < bound), "{solver:?}: {errors:?}");
    }
}

#[test]
fn a_list_of_equal_steps_is_the_single_step() {
    for solver in [Solver::ImplicitEuler, Solver::Trapezoidal, Solver::Ros2, Solver::Rodas3] {
        let listed = end(&stepped(BRUSSELATOR, solver, "0.01 s until 1 s, then 0.02 s", 2.0));
        let first = model(BRUSSELATOR, solver, 0.01, 1.0);
        let mut second = model(BRUSSELATOR, solver, 0.02, 1.0);
        for (state, start) in second.states.iter_mut().zip(end(&first)) {
            state.initial = start;
        }
        for (is, should) in listed.iter().zip(end(&second)) {
            assert!((is - should).abs() < 1e-12 * should.abs(), "{solver:?}: {is} is not {should}");
        }
    }
}

#[test]
fn a_pivot_close_to_zero_is_refused_and_others_are_reported() {
    let smallest = |initial: f64| {
        let body = format!("state x = {initial:e}\nx' = 0.5*x^2\noutput x\n");
        let model = model(&body, Solver::ImplicitEuler, 0.125, 1.0);
        let graph = pe_hls::step::build(&model).expect("a step");
        let mut run = DoubleRun::new(&graph);
        run.step(&[]).expect("finite numbers");
        pe_judge::pivots::smallest(&model, &graph, &run.largest())
    };
    // The pivot is 1 - x/8.
    let pivot = smallest(2.0).expect("far from zero").expect("a pivot that varies");
    assert!(pivot.state == "x" && (pivot.magnitude - 0.75).abs() < 1e-12, "{pivot:?}");
    let finding = &smallest(8.0 - 1e-6).expect_err("close to zero")[0];
    assert!(finding.code == "E0905" && finding.message.contains("`x`"), "{}", finding.message);
}

#[test]
fn energy_stays_bounded_over_many_periods() {
    const ROTATION: &str = "state x = 1\nstate v = 0\nx' = v\nv' = -x\noutput x\n";
    for (solver, bound) in [(Solver::SymplecticEuler, 0.06), (Solver::Leapfrog, 0.003)] {
        let model = model(ROTATION, solver, 0.1, 2000.0);
        let state = end(&model);
        let energy = state[0] * state[0] + state[1] * state[1];
        assert!((energy - 1.0).abs() < bound, "{solver:?}: energy {energy}");
    }
}

/// Machine against fixed-point run, state after state; returns the words compared.
fn compare(flow: &Flow, start: &Start) -> u64 {
    let mut machine = Machine::new(&start.program);
    let mut reference = flow.fixed_run(start.step);
    let mut compared = 0;
    for (step, inputs) in start.stimulus.iter().enumerate() {
        reference.step(inputs);
        machine.step(inputs, &mut |_| {});
        compared += flow.assert_words(&machine, &reference, &format!("{}, step {step}", start.name));
    }
    compared
}

/// Methods with models that suit them.
const SUITED: [(&str, Solver); 22] = [
    (RING, Solver::SymplecticEuler),
    (RING, Solver::Leapfrog),
    (RING, Solver::Rkc5),
    (SPRINGS, Solver::Leapfrog),
    (SPRINGS, Solver::SymplecticEuler),
    (DAMPED, Solver::SymplecticEuler),
    (SPRINGS, Solver::Ab2),
    (DAMPED, Solver::Ab3),
    (BRUSSELATOR, Solver::Ab2),
    (BRUSSELATOR, Solver::Ab3),
    (BRUSSELATOR, Solver::Ab4),
    (DAMPED, Solver::Ab4),
    (LINEAR, Solver::Ab4),
    (BRUSSELATOR, Solver::Rkc5),
    (DAMPED, Solver::Rkc5),
    (LINEAR, Solver::Rkc5),
    (DAMPED, Solver::Rkc10),
    (LINEAR, Solver::ImplicitEuler),
    (LINEAR, Solver::Trapezoidal),
    (LINEAR, Solver::Ros2),
    (LINEAR, Solver::Rodas3),
    (LINEAR, Solver::Exact),
];

#[test]
fn the_machine_computes_what_the_planned_step_says() {
    let (mut compared, mut pairs, mut forms) = (0, 0, Vec::new());
    for (body, solver) in SUITED {
        for widths in [(32, 32, 32), (32, 25, 18), (18, 18, 18)] {
            for (pes, placement) in [(1, Placement::Scattered), (3, Placement::Annealed), (4, Placement::Scattered)] {
                let format = format(widths.0, widths.1, widths.2);
                let label = format!("{solver:?} {widths:?} on {pes} PEs, {placement:?}");
                let flow = Flow::of(label, model(body, solver, 0.02, 2.0), pes, format, placement);
                compared += compare(&flow, &flow.beginning(20)) + compare(&flow, &flow.middle(20));
                forms.push(flow.graph.form);
                pairs += flow.pairs;
            }
        }
    }
    println!("{compared} words compared");
    assert!(compared > 20_000, "{compared} words compared");
    assert!(pairs > 50, "{pairs} pairs");
    for form in [StageForm::Method, StageForm::Euler, StageForm::Full] {
        assert!(forms.contains(&form), "no step in the form {form}");
    }
}

#[test]
fn steps_with_tables_and_lists_of_steps_agree_in_ghdl() {
    // Reciprocals of pivots and coefficients of gates are tables, which the whole pipeline makes.
    let implicit = ["implicit_euler", "trapezoidal", "ros2", "rodas3"];
    let implicit = implicit.map(|solver| (solver, "10 ms", "1 s", BRUSSELATOR, "2"));
    // 40 short steps and 36 long ones: the run from the middle goes from the former to the latter.
    let listed = ["implicit_euler", "rodas3"];
    let listed = listed.map(|solver| (solver, "0.5 ms until 20 ms, then 0.1 s", "3.62 s", ROBERTSON, "1"));
    let gates = ("rush_larsen", "10 ms", "1 s", GATE, "2");
    let folder = Folder::new("methods_ghdl");
    let mut sum = Agreement::default();
    let swing = ("implicit_euler", "10 ms", "1 s", SWING, "2");
    for (solver, step, span, body, pes) in implicit.into_iter().chain(listed).chain([gates, swing]) {
        let path = folder.0.join("m.spec");
        let text = format!("model m\nsolver {solver}\nstep {step}\nspan {span}\n{body}");
        std::fs::write(&path, text).expect("the spec can be written");
        let compiled = compile_file(&path, &["--pes", pes, "--tries", "2000", "--allow", "E0903"]);
        assert!(!compiled.design.graph.functions.tables.is_empty(), "{solver}: no table");
        let text = compiled.design.program.to_string();
        let parsed: Program = text.parse().unwrap_or_else(|error| panic!("{solver}: {error}"));
        assert!(parsed.to_string() == text, "{solver}: the text of the parsed program differs");
        let label = format!("{solver} {step}");
        let engines = [Engine::Reference, Engine::Ghdl];
        let starts = compiled.starts(6);
        let starts = if body.contains("1e4") { &starts[1..] } else { &starts };
        sum += assert_agreement(&label, starts, &engines);
    }
    let Agreement { runs, writes, outputs, seconds } = sum;
    println!("{runs} runs, {writes} memory writes and {outputs} outputs equal, {seconds:.1} s in the engines");
    // Two engines, one of them from one start in place of two.
    assert!(runs == if is_long_suite() { 28 } else { 22 } && writes > 1000, "{runs} runs, {writes} writes");
}

#[test]
fn a_solver_that_does_not_suit_is_refused_with_the_reason() {
    let explicit = stepped(BRUSSELATOR, Solver::Rk4, "0.01 s until 1 s, then 0.02 s", 2.0);
    let finding = &pe_hls::step::build(&explicit).expect_err("explicit methods take no list")[0];
    assert!(finding.code == "E0806" && finding.message.contains("a list of steps"), "{}", finding.message);
    let cases = [
        (BRUSSELATOR, Solver::Leapfrog, "reads the"),
        (DAMPED, Solver::Leapfrog, "the velocity `v[1]` reads the velocity `v[1]`"),
        ("state y = 1\ny' = -y\noutput y\n", Solver::SymplecticEuler, "not pairs of position and velocity"),
        (BRUSSELATOR, Solver::Exact, "not affine"),
        ("state z = 1\nstate x = 0\nz' = 0.3\nx' = 1/z\noutput x\n", Solver::Exact, "not affine"),
        ("state z = 1\nstate x = 0\nz' = -0.3*z\nx' = 2*abs(z) - x\noutput x\n", Solver::Exact, "not affine"),
        (BRUSSELATOR, Solver::RushLarsen, "no state is a gate"),
        ("state x = 1\nx' = 100*x\noutput x\n", Solver::ImplicitEuler, "singular at `x`"),
    ];
    for (body, solver, reason) in cases {
        let finding = refusal(body, solver);
        assert_eq!(finding.code, "E0806");
        assert!(finding.message.contains(reason), "{}", finding.message);
    }
}
