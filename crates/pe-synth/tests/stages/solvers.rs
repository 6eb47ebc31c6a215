//! The step graph of every solver against its textbook form: Butcher's tableau, written down a second time.

use crate::support::flow::stage_by_stage;
use crate::support::{AFFINE_FAMILIES, FAMILIES, Family, random_model};
use pe_hls::step::StepOptions;
use pe_ir::graph::{StageForm, StepGraph};
use pe_ir::index::StateId;
use pe_ir::model::{Algebraic, Expr, Model, Solver, Variable};
use pe_ir::source::Span;
use pe_sim::double::DoubleRun;

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
        _ => unreachable!("no explicit Runge-Kutta method"),
    }
}

fn value(expr: &Expr, states: &[f64], inputs: &[f64], algebraics: &[f64]) -> f64 {
    let of = |expr: &Expr| value(expr, states, inputs, algebraics);
    match expr {
        Expr::Constant(number) => *number,
        Expr::Variable(Variable::State(index)) => states[index.index()],
        Expr::Variable(Variable::Input(index)) => inputs[*index as usize],
        Expr::Variable(Variable::Algebraic(index)) => algebraics[*index as usize],
        Expr::Sum(members) => members.iter().map(of).sum(),
        Expr::Product(members) => members.iter().map(of).product(),
        Expr::Power(base, exponent) => of(base).powi(*exponent as i32),
        Expr::Apply(..) | Expr::Select(_) | Expr::Solution(_) => unreachable!("these models are polynomials"),
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

/// Compares steps of a graph with the textbook; returns the number of states that were compared.
fn compare(label: &str, model: &Model, graph: &StepGraph) -> u32 {
    let mut compared = 0;
    let mut run = DoubleRun::new(graph);
    let mut states: Vec<f64> = model.states.iter().map(|state| state.initial).collect();
    for step in 0..20 {
        let inputs: Vec<f64> =
            model.inputs.iter().map(|input| input.waveform.at(f64::from(step) * model.step)).collect();
        states = textbook_step(model, &states, &inputs);
        run.step(&inputs).expect("random models are stable");
        for (index, expected) in states.iter().enumerate() {
            let is = run.state(StateId::at(index));
            let scale = expected.abs().max(1e-3);
            assert!((is - expected).abs() < 1e-12 * scale, "{label}: {is:e} is not {expected:e}");
            compared += 1;
        }
    }
    compared
}

/// An affine model with all that its matrix has: states, inputs, constants, and algebraic equations put in place.
fn affine_model(family: Family, solver: Solver) -> Model {
    let mut model = random_model(family, 9, solver, 5);
    let scaled = |factor, variable| Expr::Product(vec![Expr::Constant(factor), Expr::Variable(variable)]);
    for index in 0..2 {
        let mut sum: Vec<Expr> =
            (0..4).map(|state| scaled(0.1 + 0.2 * state as f64, Variable::State(StateId::new(state)))).collect();
        sum.push(scaled(0.5, Variable::Input(0)));
        sum.push(Expr::Constant(0.25));
        sum.extend((0..index).map(|earlier| scaled(0.3, Variable::Algebraic(earlier))));
        let (name, expr) = (format!("a[{index}]"), Expr::Sum(sum));
        model.algebraics.push(Algebraic {
            name,
            unit: None,
            expr,
            range: None,
            kept: false,
            angle: false,
            span: Span::default(),
        });
    }
    for (index, state) in model.states.iter_mut().enumerate() {
        let algebraic = scaled(0.2, Variable::Algebraic(index as u32 % 2));
        state.derivative = Expr::Sum(vec![state.derivative.clone(), algebraic, Expr::Constant(0.01 * index as f64)]);
    }
    model
}

#[test]
fn every_form_of_an_affine_step_is_the_textbook_step() {
    for solver in Solver::RUNGE_KUTTA {
        for family in AFFINE_FAMILIES {
            let model = affine_model(family, solver);
            for form in [StageForm::Horner, StageForm::Factors, StageForm::Full] {
                let options = StepOptions { form: Some(form), ..StepOptions::default() };
                let stages = match (solver, form) {
                    // A single stage has no other form, and two stages have no real factors.
                    (Solver::Euler, _) | (Solver::Heun, StageForm::Factors) => {
                        let refused = pe_hls::step::build_with(&model, &options).expect_err("there is no such form");
                        assert_eq!(refused[0].code, "E0805");
                        continue;
                    }
                    (_, StageForm::Horner) => solver.stages(),
                    (_, StageForm::Factors) => 2,
                    _ => 1,
                };
                let graph = pe_hls::step::build_with(&model, &options).expect("affine models have every form");
                assert_eq!((graph.form, graph.stages), (form, stages));
                compare(&format!("{family:?} {solver:?} {form}"), &model, &graph);
            }
        }
    }
}

#[test]
fn the_step_graph_is_the_textbook_step_of_every_solver() {
    let mut compared = 0;
    for solver in Solver::RUNGE_KUTTA {
        for family in FAMILIES {
            let model = random_model(family, 9, solver, 5);
            let graph = stage_by_stage(&model);
            assert_eq!(graph.stages, solver.stages());
            compared += compare(&format!("{family:?} {solver:?}"), &model, &graph);
        }
    }
    println!("{compared} states compared");
    assert!(compared > 4_000);
}
