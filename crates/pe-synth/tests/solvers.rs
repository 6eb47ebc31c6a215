//! The step graph of every solver against its textbook form: Butcher's tableau, written down a second time.

mod support;

use pe_ir::model::{Expr, Model, Solver, Variable};
use pe_sim::double::DoubleRun;
use support::{FAMILIES, random_model};

/// Rows of the tableau, and the weights.
fn tableau(solver: Solver) -> (Vec<Vec<f64>>, Vec<f64>) {
    match solver {
        Solver::Euler => (vec![vec![]], vec![1.0]),
        Solver::Heun => (vec![vec![], vec![1.0]], vec![0.5, 0.5]),
        Solver::Heun3 => (vec![vec![], vec![1.0 / 3.0], vec![0.0, 2.0 / 3.0]], vec![0.25, 0.0, 0.75]),
        Solver::Rk4 => (
            vec![vec![], vec![0.5], vec![0.0, 0.5], vec![0.0, 0.0, 1.0]],
            vec![1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
        ),
    }
}

fn value(expr: &Expr, states: &[f64], inputs: &[f64], algebraics: &[f64]) -> f64 {
    let of = |expr: &Expr| value(expr, states, inputs, algebraics);
    match expr {
        Expr::Constant(number) => *number,
        Expr::Variable(Variable::State(index)) => states[*index as usize],
        Expr::Variable(Variable::Input(index)) => inputs[*index as usize],
        Expr::Variable(Variable::Algebraic(index)) => algebraics[*index as usize],
        Expr::Sum(members) => members.iter().map(of).sum(),
        Expr::Product(members) => members.iter().map(of).product(),
        Expr::Power(base, exponent) => of(base).powi(*exponent as i32),
    }
}

fn slope(model: &Model, states: &[f64], inputs: &[f64]) -> Vec<f64> {
    let mut algebraics = Vec::new();
    for algebraic in &model.algebraics {
        algebraics.push(value(&algebraic.expr, states, inputs, &algebraics));
    }
    model.states.iter().map(|state| value(&state.derivative, states, inputs, &algebraics)).collect()
}

fn textbook_step(model: &Model, states: &[f64], inputs: &[f64]) -> Vec<f64> {
    let (rows, weights) = tableau(model.solver);
    let moved = |slopes: &[Vec<f64>], weights: &[f64]| -> Vec<f64> {
        let increment =
            |state: usize| -> f64 { slopes.iter().zip(weights).map(|(slope, weight)| weight * slope[state]).sum() };
        (0..states.len()).map(|state| states[state] + model.step * increment(state)).collect()
    };
    let mut slopes: Vec<Vec<f64>> = Vec::new();
    for row in &rows {
        slopes.push(slope(model, &moved(&slopes, row), inputs));
    }
    moved(&slopes, &weights)
}

#[test]
fn the_step_graph_is_the_textbook_step_of_every_solver() {
    let mut compared = 0;
    for solver in Solver::ALL {
        for family in FAMILIES {
            let model = random_model(family, 9, solver, 5);
            let graph = pe_hls::step::build(&model).expect("random models build");
            assert_eq!(graph.stages, solver.stages());
            let mut run = DoubleRun::new(&graph);
            let mut states: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
            for step in 0..20 {
                let inputs: Vec<f64> =
                    model.inputs.iter().map(|input| input.waveform.at(f64::from(step) * model.step)).collect();
                states = textbook_step(&model, &states, &inputs);
                run.step(&inputs).expect("random models are stable");
                for (index, expected) in states.iter().enumerate() {
                    let is = run.state(index);
                    let scale = expected.abs().max(1e-3);
                    assert!((is - expected).abs() < 1e-12 * scale, "{family:?} {solver:?}: {is:e} is not {expected:e}");
                    compared += 1;
                }
            }
        }
    }
    println!("{compared} states compared");
    assert!(compared > 4_000);
}
