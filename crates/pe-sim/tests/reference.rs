//! The reference solution against closed forms, and against itself at another tolerance.

#![allow(clippy::disallowed_methods, reason = "the tests' own numbers may come from the standard library")]

use pe_ir::index::StateId;
use pe_ir::model::{Algebraic, Expr, Input, Model, Output, Solver, State, Variable, Waveform};
use pe_ir::source::Span;
use pe_sim::error::Trajectory;
use pe_sim::reference::{self, Obstacle, TOLERANCE};

const SPAN: Span = Span { start: 0, end: 0 };

fn state(index: u32) -> Expr {
    Expr::Variable(Variable::State(StateId::new(index)))
}

fn times(coefficient: f64, factors: &[Expr]) -> Expr {
    Expr::Product(std::iter::once(Expr::Constant(coefficient)).chain(factors.iter().cloned()).collect())
}

/// A model with a quantity for each state: initial values and derivatives.
fn model(states: Vec<(f64, Expr)>, inputs: Vec<Waveform>, algebraics: Vec<Expr>, step: f64, span: f64) -> Model {
    let states = states.into_iter().enumerate().map(|(index, (initial, derivative))| State {
        quantity: index as u32,
        initial,
        ..State::new(format!("x{index}"), derivative)
    });
    let input = |(index, waveform)| Input {
        name: format!("u{index}"),
        unit: None,
        waveform,
        range: None,
        between: pe_ir::model::Interpolation::Hold,
        span: SPAN,
    };
    let algebraic = |(index, expr)| Algebraic {
        name: format!("a{index}"),
        unit: None,
        range: None,
        expr,
        kept: false,
        angle: false,
        span: SPAN,
    };
    Model {
        states: states.collect(),
        algebraics: algebraics.into_iter().enumerate().map(algebraic).collect(),
        inputs: inputs.into_iter().enumerate().map(input).collect(),
        outputs: vec![Output { name: "x0".into(), variable: Variable::State(StateId::new(0)), span: SPAN }],
        ..Model::new("test", Solver::Rk4, step, span)
    }
}

fn sample_times(model: &Model, count: u32) -> Vec<f64> {
    (1..=count).map(|k| model.span * f64::from(k) / f64::from(count)).collect()
}

/// The solutions of both methods.
fn by_both_methods(model: &Model, at: &[f64]) -> [Trajectory; 2] {
    let first = reference::solve(model, at, TOLERANCE, &mut |_| {}).expect("it has a solution");
    let second = reference::solve_by_second_method(model, at, TOLERANCE).expect("it has a solution").states;
    assert_ne!(first.samples, second.samples, "the methods are one");
    [first, second]
}

#[test]
fn an_oscillator_keeps_its_cosine_for_sixteen_periods() {
    let model = model(vec![(1.0, state(1)), (0.0, times(-1.0, &[state(0)]))], vec![], vec![], 0.01, 100.0);
    let at = sample_times(&model, 173);
    for solution in by_both_methods(&model, &at) {
        assert_eq!(solution.len(), at.len());
        for (sample, time) in solution.samples.chunks_exact(2).zip(&at) {
            assert!((sample[0] - time.cos()).abs() < 1e-10, "{} at {time}", sample[0] - time.cos());
            assert!((sample[1] + time.sin()).abs() < 1e-10, "{} at {time}", sample[1] + time.sin());
        }
    }
}

#[test]
fn a_square_wave_is_followed_from_jump_to_jump() {
    // x' = 3 (u - x); between jumps x goes to the level of u. The jumps are at odd multiples of 1/1.4 s, no step is.
    let square = Waveform::Square { amplitude: 2.0, frequency: 0.7, offset: 0.5, duty: 0.3 };
    let input = Expr::Variable(Variable::Input(0));
    let difference = Expr::Sum(vec![input, times(-1.0, &[state(0)])]);
    let derivative = times(3.0, &[Expr::Variable(Variable::Algebraic(0))]);
    let model = model(vec![(0.0, derivative)], vec![square.clone()], vec![difference], 0.01, 10.0);
    let at = sample_times(&model, 91);
    for solution in by_both_methods(&model, &at) {
        let (mut x, mut time, mut edges) = (0.0f64, 0.0f64, square.breakpoints(11.0).peekable());
        for (sample, until) in solution.samples.iter().zip(&at) {
            while time < *until {
                let next = edges.peek().copied().filter(|edge| edge < until).unwrap_or(*until);
                let level = square.piece(0.5 * (time + next), time);
                x = level + (x - level) * (-3.0 * (next - time)).exp();
                time = next;
                edges.next_if(|edge| *edge <= time);
            }
            assert!((sample - x).abs() < 1e-11, "{:e} at {until}", sample - x);
        }
    }
}

#[test]
fn tolerances_agree_on_a_chaotic_model_and_tighter_is_closer() {
    let (x, y, z) = (state(0), state(1), state(2));
    let lorenz = vec![
        (1.0, times(10.0, &[Expr::Sum(vec![y.clone(), times(-1.0, std::slice::from_ref(&x))])])),
        (
            1.0,
            Expr::Sum(vec![
                times(28.0, std::slice::from_ref(&x)),
                times(-1.0, &[x.clone(), z.clone()]),
                times(-1.0, std::slice::from_ref(&y)),
            ]),
        ),
        (1.0, Expr::Sum(vec![times(1.0, &[x, y]), times(-8.0 / 3.0, &[z])])),
    ];
    let model = model(lorenz, vec![], vec![], 1e-3, 5.0);
    let at = sample_times(&model, 50);
    let solve = |tolerance| reference::solve(&model, &at, tolerance, &mut |_| {}).expect("it has a solution");
    let (best, good, poor) = (solve(1e-14), solve(TOLERANCE), solve(1e-8));
    let scales = best.scales(&[0, 1, 2]);
    let (good, poor) = (best.deviation(&good).worst(&scales).1, best.deviation(&poor).worst(&scales).1);
    assert!(good < 1e-10 && good * 100.0 < poor, "{good:e} {poor:e}");
}

#[test]
fn powers_and_nested_sums_are_evaluated_as_written() {
    // x' = -(x (1 + x)^2 - x - 2 x^2) = -x^3, so x = 1/sqrt(1 + 2 t).
    let cubic = times(-1.0, &[state(0), Expr::Power(Box::new(Expr::Sum(vec![Expr::Constant(1.0), state(0)])), 2)]);
    let derivative = Expr::Sum(vec![cubic, state(0), times(2.0, &[Expr::Power(Box::new(state(0)), 2)])]);
    let model = model(vec![(1.0, derivative)], vec![], vec![], 0.01, 4.0);
    let solution = reference::solve(&model, &[1.0, 4.0], TOLERANCE, &mut |_| {}).expect("it has a solution");
    for (sample, exact) in solution.samples.iter().zip([1.0 / 3f64.sqrt(), 1.0 / 3.0]) {
        assert!((sample - exact).abs() < 1e-11, "{sample} {exact}");
    }
}

#[test]
fn a_singularity_is_named_with_its_time() {
    // x' = x^2 from 1 ends at t = 1.
    let model = model(vec![(1.0, Expr::Power(Box::new(state(0)), 2))], vec![], vec![], 0.01, 2.0);
    let error = reference::solve(&model, &[0.5, 2.0], TOLERANCE, &mut |_| {}).expect_err("it ends");
    assert!(error.obstacle == Obstacle::StepUnderflow && (error.time - 1.0).abs() < 1e-6, "{error}");
}

#[test]
fn states_far_from_the_input_do_not_hold_the_solution_up() {
    // A chain that starts at rest: the k-th state begins to move as the k-th power of time.
    const N: u32 = 64;
    let link = |k: u32| {
        let before = if k == 0 { Expr::Variable(Variable::Input(0)) } else { state(k - 1) };
        (0.0, Expr::Sum(vec![before, times(-1.0, &[state(k)])]))
    };
    let sine = Waveform::Sine { amplitude: 1.0, frequency: 0.1, offset: 0.0, phase: 0.0 };
    let mut chain = model((0..N).map(link).collect(), vec![sine], vec![], 0.1, 20.0);
    chain.states.iter_mut().for_each(|state| state.quantity = 0);
    let at = sample_times(&chain, 20);
    let solve = |tolerance| reference::solve(&chain, &at, tolerance, &mut |_| {}).expect("it has a solution");
    let (good, best) = (solve(1e-10), solve(TOLERANCE));
    assert!(best.deviation(&good).worst(&best.scales(&[0; N as usize])).1 < 1e-8);
}

/// Robertson's reactions.
fn robertson(span: f64) -> Model {
    let square = |index| Expr::Power(Box::new(state(index)), 2);
    let derivatives = [
        Expr::Sum(vec![times(-0.04, &[state(0)]), times(1e4, &[state(1), state(2)])]),
        Expr::Sum(vec![times(0.04, &[state(0)]), times(-1e4, &[state(1), state(2)]), times(-3e7, &[square(1)])]),
        times(3e7, &[square(1)]),
    ];
    let states = [1.0, 0.0, 0.0].into_iter().zip(derivatives).collect();
    model(states, vec![], vec![], 1e-3, span)
}

#[test]
fn a_stiff_model_is_solved_by_the_implicit_method_as_well_as_by_the_explicit_one() {
    let model = robertson(40.0);
    let at = sample_times(&model, 20);
    let explicit = reference::solve(&model, &at, TOLERANCE, &mut |_| {}).expect("it has a solution");
    // So few steps are not enough for the explicit method.
    let implicit =
        reference::solve_with_limit(&model, &at, TOLERANCE, 500, &mut |_| {}).expect("it has a solution").states;
    assert!(explicit.samples != implicit.samples, "the implicit method was not asked");
    let scales = explicit.scales(&[0, 1, 2]);
    let (state, error) = explicit.deviation(&implicit).worst(&scales);
    assert!(error < 1e-10, "state {state} is off by {error:e}");
    // The end point that the literature has for t = 40.
    for (found, wanted) in implicit.last().samples.iter().zip([0.715_827_068_7, 9.185_534_76e-6, 0.284_163_745_7]) {
        assert!((found / wanted - 1.0).abs() < 1e-8, "{found} against {wanted}");
    }
}

#[test]
fn a_very_stiff_model_has_a_reference_over_all_its_span() {
    // To t = 4e5 the explicit method would take some 1e8 steps.
    let model = robertson(4e5);
    let at = sample_times(&model, 10);
    let solution =
        reference::solve_with_limit(&model, &at, TOLERANCE, 10_000, &mut |_| {}).expect("it has a solution").states;
    for (found, wanted) in solution.last().samples.iter().zip([4.938_3e-3, 1.985e-8, 0.995_06]) {
        assert!((found / wanted - 1.0).abs() < 2e-3, "{found} against {wanted}");
    }
    for sample in solution.samples.chunks_exact(3) {
        assert!((sample.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{sample:?}");
    }
}

#[test]
fn jumps_of_an_input_are_met_by_the_implicit_method() {
    // x' = 1e6 (u - x): x is u but right behind its jumps, none of which is a sample time.
    let square = Waveform::Square { amplitude: 2.0, frequency: 0.7, offset: 0.5, duty: 0.3 };
    let difference = Expr::Sum(vec![Expr::Variable(Variable::Input(0)), times(-1.0, &[state(0)])]);
    let derivative = times(1e6, &[Expr::Variable(Variable::Algebraic(0))]);
    let model = model(vec![(0.0, derivative)], vec![square.clone()], vec![difference], 1e-6, 9.9);
    let at = sample_times(&model, 97);
    let solution =
        reference::solve_with_limit(&model, &at, TOLERANCE, 1000, &mut |_| {}).expect("it has a solution").states;
    for (sample, time) in solution.samples.iter().zip(&at) {
        assert!((sample - square.at(*time)).abs() < 1e-10, "{sample} at {time}");
    }
}

#[test]
fn a_stiff_model_that_is_too_large_is_given_up_in_bounded_time() {
    let chain = |index: u32| times(-1e9, &[state(index)]);
    let model = model((0..500).map(|index| (1.0, chain(index))).collect(), vec![], vec![], 0.01, 1.0);
    let error = reference::solve_with_limit(&model, &[1.0], TOLERANCE, 1000, &mut |_| {}).expect_err("too many steps");
    assert_eq!(error.obstacle, Obstacle::TooManySteps, "{error}");
}

#[test]
fn stiff_models_are_solved_by_a_one_step_and_by_a_multistep_method() {
    // The span after which explicit methods have taken too many steps.
    let model = robertson(4e4);
    let at = sample_times(&model, 20);
    let few = 1000;
    let first = reference::solve_with_limit(&model, &at, TOLERANCE, few, &mut |_| {}).expect("it has a solution");
    let second = reference::solve_by_second_method(&Model { step: 4.0, ..model.clone() }, &at, TOLERANCE);
    let second = second.expect("it has a solution");
    assert_eq!((first.method, second.method), (reference::Method::Radau5, reference::Method::Bdf));
    let scales = first.states.scales(&[0, 1, 2]);
    let difference = first.states.deviation(&second.states).worst(&scales).1;
    assert!(difference > 0.0 && difference < 1e-8, "{difference:e}");
}
