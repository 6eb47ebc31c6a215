//! Linear systems: every order of elimination against a solver that exchanges rows, and bit for bit through all engines.

use std::fmt::Write;

use crate::support::bench::assert_lively_agreement;
use crate::support::flow::{Flow, Placement, format};
use pe_frontend::{NoFiles, Overrides};
use pe_hls::step::{Order, Scheme, StepOptions};
use pe_ir::index::StateId;
use pe_ir::model::{Model, Variable};
use pe_ir::place::Place;
use pe_ir::source::Sources;
use pe_sim::double::DoubleRun;
use pe_verify::engines::Engine;

fn next(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *seed >> 33
}

fn compiled(text: &str) -> Model {
    let mut sources = Sources::new("systems.spec", text);
    let compiled = pe_frontend::compile(&mut sources, &NoFiles, &Overrides::default());
    let (model, _) = compiled.unwrap_or_else(|findings| panic!("{findings:#?}\n{text}"));
    pe_hls::lift::lift(model)
}

/// A system of `size` unknowns whose entries are numbers, states and polynomials of states, with zeros; two right-hand
/// sides, one of them the other's solution.
fn random_spec(size: u64, symmetric: bool, solver: &str, seed: &mut u64) -> String {
    let declared = if symmetric { " symmetric" } else { "" };
    let mut text = format!(
        "model random\nsolver {solver}\nstep 1 ms\nspan 20 ms\nindex i in 1..{size}, j in 1..{size}\nstate x[i] = 0.1*i\n\
         matrix A[i, j]{declared}\nx' = 0.1*solve(A, b) - x\ny = solve(A, 2*x + z)\nz = solve(A, b)\n\
         b[i] = 0.5*x[i] + 1\noutput x, y\n"
    );
    for row in 1..=size {
        // Diagonally dominant, so that no order needs exchanges.
        _ = match next(seed) % 3 {
            0 => writeln!(text, "A[{row}, {row}] = {size} + 3"),
            1 => writeln!(text, "A[{row}, {row}] = {size} + 2 + x[{row}]"),
            _ => writeln!(text, "A[{row}, {row}] = {size} + 2 + 0.5*x[{row}]*x[1]"),
        };
        for column in (1..=size).filter(|column| *column != row && (!symmetric || *column < row)) {
            let factor = next(seed) % 9;
            _ = match next(seed) % 5 {
                0 => writeln!(text, "A[{row}, {column}] = 0.1*{factor} - 0.5"),
                1 => writeln!(text, "A[{row}, {column}] = (0.1*{factor} - 0.4)*x[{column}]"),
                _ => Ok(()),
            };
        }
    }
    text
}

/// Whether a step computes what the model says at the end of each step.
fn compare(model: &Model, order: Order, scheme: Scheme, label: &str) -> u32 {
    let options = StepOptions { order, scheme, ..StepOptions::default() };
    let graph = pe_hls::step::build_with(model, &options).unwrap_or_else(|findings| panic!("{label}: {findings:#?}"));
    assert!(pe_ir::verify::step::check(&graph).is_empty(), "{label}");
    assert_eq!(graph.to_string().parse::<pe_ir::graph::StepGraph>().unwrap().to_string(), graph.to_string());
    let mut run = DoubleRun::new(&graph);
    let mut compared = 0;
    for _ in 0..5 {
        run.step(&[]).expect("it is finite");
        let states: Vec<f64> = model.states.ids().map(|state| run.state(state)).collect();
        let place = Place::new(model, &states, &[]);
        for (output, value) in model.outputs.iter().zip(&graph.outputs) {
            let Variable::Algebraic(_) = output.variable else { continue };
            let (is, expected) = (run.value(value.index()), place.number(output.variable));
            assert!((is - expected).abs() <= 1e-12 * expected.abs().max(1.0), "{label}: {is:e} is not {expected:e}");
            compared += 1;
        }
    }
    compared
}

#[test]
fn every_order_solves_what_a_solver_with_exchanges_solves() {
    let (mut seed, mut compared) = (5, 0);
    for size in [1, 2, 3, 5, 8, 13] {
        for symmetric in [true, false] {
            for solver in ["rk4", "euler", "heun", "leapfrog", "ab2", "rkc5"] {
                let text = random_spec(size, symmetric, solver, &mut seed);
                if solver == "leapfrog" {
                    continue;
                }
                let model = compiled(&text);
                assert_eq!(model.to_string().parse::<Model>().unwrap().to_string(), model.to_string());
                for order in Order::ALL {
                    for scheme in pe_hls::step::schemes(&model) {
                        compared += compare(&model, order, *scheme, &format!("{text}\n{order:?}, {scheme:?}"));
                    }
                }
            }
        }
    }
    assert!(compared > 12_000, "{compared}");
}

#[test]
fn rows_are_exchanged_where_the_diagonal_has_no_entry() {
    let text = "model exchanged\nsolver rk4\nstep 1 ms\nspan 20 ms\nindex i in 0..3, j in 2..5\nstate x[i] = 0.1*i + 1\n\
                matrix A[i, j]\nA[0, 4] = 1 + x[1]\nA[1, 2] = 2\nA[1, 5] = x[2]\nA[2, 5] = 3 + x[0]\nA[3, 3] = 1\n\
                A[3, 4] = 0.3*x[3]\nb[i] = x[i]\ny = solve(A, b)\nx[i]' = -x[i] + 0.1*y[i + 2]\noutput x, y\n";
    let model = compiled(text);
    for order in Order::ALL {
        assert!(compare(&model, order, Scheme::default(), "exchanged") > 0);
    }
}

#[test]
fn implicit_methods_eliminate_in_every_order() {
    let text = "model stiff\nsolver SOLVER\nstep 1 ms\nspan 20 ms\nindex i in 1..6\nstate x[i] = 0.2*i\n\
                x[i]' = -50*x[i]^3 + (if i > 1 then 10*x[i - 1] else 0) - (if i < 6 then 5*x[i + 1] else 0)\noutput x\n";
    for solver in ["implicit_euler", "trapezoidal", "ros2", "rodas3"] {
        let model = compiled(&text.replace("SOLVER", solver));
        let run = |order| {
            let options = StepOptions { order, ..StepOptions::default() };
            let graph = pe_hls::step::build_with(&model, &options).unwrap();
            let mut run = DoubleRun::new(&graph);
            (0..10).for_each(|_| run.step(&[]).unwrap());
            (0..6).map(|state| run.state(StateId::new(state))).collect::<Vec<f64>>()
        };
        let expected = run(Order::Fill);
        for order in Order::ALL {
            for (is, expected) in run(order).iter().zip(&expected) {
                assert!((is - expected).abs() < 1e-13, "{solver} {order:?}: {is:e} is not {expected:e}");
            }
        }
    }
}

#[test]
fn systems_without_a_solution_are_refused_with_their_columns() {
    let refused = |entries: &str, symmetric: &str| {
        let text = format!(
            "model none\nsolver rk4\nstep 1 ms\nspan 20 ms\nindex i in 1..3, j in 1..3\nstate x[i] = i\nmatrix A[i, j]{symmetric}\n\
             {entries}\nx' = solve(A, x)\noutput x\n"
        );
        pe_hls::step::build_with(&compiled(&text), &StepOptions::default()).expect_err("it is refused").remove(0)
    };
    let narrow = refused("A[i, 1] = x[i]\nA[1, j] = 1 where j > 1", "");
    assert_eq!(narrow.code, "E0821");
    assert!(narrow.message.contains("columns 2, 3 have entries in the rows 1 alone"), "{}", narrow.message);
    let empty = refused("A[i, 1] = x[i]\nA[i, 3] = 1", "");
    assert!(empty.message.contains("column 2 is zero"), "{}", empty.message);
    assert_eq!(refused("A[2, 1] = x[1]\nA[3, 3] = 1", " symmetric").code, "E0822");
    assert_eq!(refused("A[1, 1] = 1\nA[2, 1] = 2\nA[2, 2] = 4\nA[3, 3] = x[1]", " symmetric").code, "E0822");
}

#[test]
fn all_engines_solve_the_same_words() {
    let mut seed = 11;
    for (symmetric, pes, scheme) in [(true, 3, Scheme::Ahead), (false, 2, Scheme::Plain), (true, 2, Scheme::Root)] {
        // As long as the runs that find formats.
        let text = random_spec(4, symmetric, "rk4", &mut seed).replace("span 20 ms", "span 60 ms");
        let model = compiled(&text);
        let options = StepOptions { scheme, ..StepOptions::default() };
        let graph = pe_hls::step::build_with(&model, &options).unwrap();
        let graph =
            pe_judge::tables::tabulate(&model, &graph, format(32, 32, 32), &*pe_judge::progress::silent()).unwrap();
        let label = format!("systems_{symmetric}_{pes}_{}", scheme.name());
        let flow = Flow::with(label, model, graph, pes, format(32, 32, 32), Placement::Annealed);
        let engines = [Engine::Reference, Engine::Fast, Engine::Ghdl];
        assert_lively_agreement(&flow.label, &flow.starts(3), &engines, 0.2);
    }
}

/// The angle of the uprights of the four-bar linkage against the vertical at a time in seconds: all turn alike.
pub fn exact_angle(loops: f64, time: f64) -> f64 {
    let (inertia, weight) = ((loops + 1.0) / 3.0 + loops, 9.81 * ((loops + 1.0) / 2.0 + loops));
    let slope = |(angle, speed): (f64, f64)| (speed, weight / inertia * libm::sin(angle));
    let moved = |at: (f64, f64), by: (f64, f64), part: f64| (at.0 + part * by.0, at.1 + part * by.1);
    let steps = 20_000;
    let step = time / f64::from(steps);
    (0..steps)
        .fold((0.0, 1.0), |at, _| {
            let first = slope(at);
            let second = slope(moved(at, first, step / 2.0));
            let third = slope(moved(at, second, step / 2.0));
            let fourth = slope(moved(at, third, step));
            let middle = (second.0 + third.0, second.1 + third.1);
            let sum = (first.0 + 2.0 * middle.0 + fourth.0, first.1 + 2.0 * middle.1 + fourth.1);
            moved(at, sum, step / 6.0)
        })
        .0
}

#[test]
fn a_linkage_of_any_size_turns_as_its_exact_solution() {
    let text = include_str!("../../../../models/four_bar/four_bar.spec");
    for (loops, seconds, limit) in [(4, 10.0, 2e-4), (20, 4.0, 1e-3)] {
        let text = text.replace("const N     = 4", &format!("const N = {loops}"));
        let model = compiled(&text);
        let graph = pe_hls::step::build(&model).unwrap();
        let mut run = DoubleRun::new(&graph);
        let steps = (seconds / model.step) as u64;
        let mut worst = 0.0f64;
        for step in 1..=steps {
            run.step(&[]).unwrap();
            if step.is_multiple_of(steps / 50) {
                let exact = exact_angle(f64::from(loops), model.time(step, 0.0));
                let angle = std::f64::consts::FRAC_PI_2 - run.state(StateId::new(0));
                worst = worst.max((angle - exact).abs());
            }
        }
        assert!(worst < limit, "{loops} loops: {worst:e} rad");
        println!("{loops} loops: {worst:e} rad");
    }
}
