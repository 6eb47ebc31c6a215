//! Lifted models against the models that they come from, on random expressions.

use pe_hls::lift::lift;
use pe_ir::index::StateId;
use pe_ir::model::{Algebraic, Expr, Function, Model, Output, Select, Solver, State, Variable};
use pe_ir::source::Span;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// States of a model.
const STATES: usize = 3;

fn below(rng: &mut ChaCha8Rng, limit: u32) -> u32 {
    rng.random_range(0..limit)
}

fn between(rng: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    rng.random_range(low..high)
}

fn expression(rng: &mut ChaCha8Rng, depth: u32, variables: &[Variable], choices: bool) -> Expr {
    if depth == 0 {
        return match below(rng, 4) {
            0 => Expr::Constant((between(rng, -3.0, 3.0) * 8.0).round() / 8.0),
            _ => Expr::Variable(variables[below(rng, variables.len() as u32) as usize]),
        };
    }
    let again = |rng: &mut ChaCha8Rng| expression(rng, depth - 1, variables, choices);
    match below(rng, 10) {
        0..=2 => Expr::sum((0..2 + below(rng, 2)).map(|_| again(rng)).collect()),
        3 | 4 => Expr::product((0..2 + below(rng, 2)).map(|_| again(rng)).collect()),
        5 => Expr::power(again(rng), 2),
        6 if choices => {
            // What is inside another choice is not guarded, and may have no value where it is not taken.
            let plain = |rng: &mut ChaCha8Rng| expression(rng, depth - 1, variables, false);
            let (condition, yes, no) = (plain(rng), plain(rng), plain(rng));
            Expr::Select(Box::new(Select { condition, yes, no }))
        }
        _ => {
            const FUNCTIONS: [Function; 9] = [
                Function::Reciprocal,
                Function::RealPower(-1.5),
                Function::Sqrt,
                Function::Exp,
                Function::Log,
                Function::Sin,
                Function::Tanh,
                Function::Abs,
                Function::Sign,
            ];
            let function = FUNCTIONS[below(rng, FUNCTIONS.len() as u32) as usize];
            Expr::Apply(function, Box::new(again(rng)))
        }
    }
}

fn model(derivatives: Vec<Expr>, algebraics: Vec<Expr>) -> Model {
    let span = Span::default();
    let states = derivatives
        .into_iter()
        .enumerate()
        .map(|(index, derivative)| State { quantity: index as u32, ..State::new(format!("x{index}"), derivative) });
    let named = |(index, expr)| Algebraic {
        name: format!("a{index}"),
        unit: None,
        expr,
        range: None,
        kept: false,
        angle: false,
        span,
    };
    let algebraics: Vec<Algebraic> = algebraics.into_iter().enumerate().map(named).collect();
    let outputs = (0..algebraics.len()).map(|index| Output {
        name: format!("a{index}"),
        variable: Variable::Algebraic(index as u32),
        span,
    });
    Model {
        states: states.collect(),
        outputs: outputs.collect(),
        algebraics,
        ..Model::new("m", Solver::Rk4, 1e-3, 1.0)
    }
}

/// All derivatives and outputs.
fn values(model: &Model, states: &[f64]) -> Vec<f64> {
    let mut algebraics: Vec<f64> = Vec::new();
    for algebraic in &model.algebraics {
        let value = algebraic.expr.evaluate(&|variable| look_up(variable, states, &algebraics));
        algebraics.push(value);
    }
    let derivatives = model.states.iter().map(|state| &state.derivative);
    let outputs = model.outputs.iter().map(|output| look_up(output.variable, states, &algebraics));
    let value = |expr: &Expr| expr.evaluate(&|variable| look_up(variable, states, &algebraics));
    derivatives.map(value).chain(outputs).collect()
}

/// The equations, for messages.
fn text(model: &Model) -> String {
    let name = |variable: Variable, _| format!("{variable:?}");
    let algebraics = model.algebraics.iter().map(|algebraic| &algebraic.expr);
    let all = algebraics.chain(model.states.iter().map(|state| &state.derivative));
    all.map(|expr| expr.text(&name) + "\n").collect()
}

fn look_up(variable: Variable, states: &[f64], algebraics: &[f64]) -> f64 {
    match variable {
        Variable::State(index) => states[index.index()],
        Variable::Algebraic(index) => algebraics[index as usize],
        Variable::Input(_) => unreachable!("no inputs"),
    }
}

fn is_lifted(model: &Model) -> bool {
    let alone = |expr: &Expr| {
        let mut read = Vec::new();
        expr.each_variable(&mut |variable| read.push(variable));
        read.dedup();
        expr.is_polynomial() || read.len() == 1
    };
    let earlier = model.algebraics.iter().enumerate().all(|(index, algebraic)| {
        let mut earlier = true;
        algebraic.expr.each_variable(&mut |variable| {
            earlier &= !matches!(variable, Variable::Algebraic(read) if read as usize >= index);
        });
        earlier
    });
    earlier
        && model.algebraics.iter().all(|algebraic| alone(&algebraic.expr))
        && model.states.iter().all(|state| state.derivative.is_polynomial())
}

#[test]
fn fusing_keeps_all_values() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let (mut compared, mut written_out) = (0, 0);
    for _ in 0..400 {
        let mut known: Vec<Variable> = StateId::all(STATES as u32).map(Variable::State).collect();
        let mut algebraics = Vec::new();
        for number in 0..4 {
            algebraics.push(expression(&mut rng, 2, &known, false));
            known.push(Variable::Algebraic(number));
        }
        let derivatives = (0..STATES).map(|_| expression(&mut rng, 3, &known, true)).collect();
        let mut original = model(derivatives, algebraics);
        original.outputs.truncate(2);
        let (fused, _) = pe_hls::fuse::fuse(original.clone());
        let names = |model: &Model| model.outputs.iter().map(|output| output.name.clone()).collect::<Vec<_>>();
        assert_eq!(names(&fused), names(&original));
        let lifted = lift(fused.clone());
        assert!(is_lifted(&lifted), "{original:#?}\n{lifted:#?}");
        written_out += usize::from(format!("{:?}", fused.states) != format!("{:?}", original.states));
        for _ in 0..10 {
            let at: Vec<f64> = (0..STATES).map(|_| between(&mut rng, -2.0, 2.0)).collect();
            let should = values(&original, &at);
            let nearby: Vec<f64> = at.iter().map(|number| number * (1.0 + 1e-13)).collect();
            let moved = values(&original, &nearby);
            let sound =
                |(value, moved): (&f64, &f64)| value.abs() < 1e6 && (value - moved).abs() <= 1e-8 * (1.0 + value.abs());
            if !should.iter().zip(&moved).all(sound) {
                continue;
            }
            for (is, should) in values(&fused, &at).iter().zip(&should) {
                let close = (is - should).abs() <= 1e-6 * (1.0 + should.abs());
                assert!(close, "{is} is not {should} at {at:?}\n{}\n{}", text(&original), text(&fused));
                compared += 1;
            }
        }
    }
    assert!(compared > 2000 && written_out > 100, "{compared} values, {written_out} models");
}

#[test]
fn lifting_keeps_all_values_and_happens_once() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut compared, mut lifted_functions) = (0, 0);
    for _ in 0..400 {
        let states: Vec<Variable> = StateId::all(STATES as u32).map(Variable::State).collect();
        let both: Vec<Variable> = states.iter().copied().chain([Variable::Algebraic(0)]).collect();
        let algebraic = expression(&mut rng, 3, &states, true);
        let derivatives = (0..STATES).map(|_| expression(&mut rng, 3, &both, true)).collect();
        let original = model(derivatives, vec![algebraic]);
        let lifted = lift(original.clone());
        assert!(is_lifted(&lifted), "{original:#?}\n{lifted:#?}");
        lifted_functions += lifted.algebraics.len() - 1;
        let again = lift(lifted.clone());
        assert_eq!(format!("{lifted:?}"), format!("{again:?}"));
        for _ in 0..10 {
            let at: Vec<f64> = (0..STATES).map(|_| between(&mut rng, -2.0, 2.0)).collect();
            let should = values(&original, &at);
            // Nor where rounding decides, as in the sine of a huge number.
            let nearby: Vec<f64> = at.iter().map(|number| number * (1.0 + 1e-13)).collect();
            let moved = values(&original, &nearby);
            let sound =
                |(value, moved): (&f64, &f64)| value.abs() < 1e6 && (value - moved).abs() <= 1e-8 * (1.0 + value.abs());
            if !should.iter().zip(&moved).all(sound) {
                continue;
            }
            for (is, should) in values(&lifted, &at).iter().zip(&should) {
                let close = (is - should).abs() <= 1e-6 * (1.0 + should.abs());
                assert!(close, "{is} is not {should} at {at:?}\n{}\n{}", text(&original), text(&lifted));
                compared += 1;
            }
        }
    }
    assert!(compared > 2000 && lifted_functions > 1000, "{compared} values, {lifted_functions} functions");
}

#[test]
fn equal_functions_are_one_and_a_gate_rate_is_a_whole() {
    let v = || Expr::Variable(Variable::State(StateId::new(0)));
    let apply = |function, argument| Expr::Apply(function, Box::new(argument));
    let moved = || Expr::sum(vec![v(), Expr::Constant(40.0)]);
    let below = || {
        let fallen = apply(Function::Exp, Expr::scaled(-0.1, moved()));
        Expr::sum(vec![Expr::Constant(1.0), Expr::scaled(-1.0, fallen)])
    };
    let rate = |scale| Expr::product(vec![Expr::Constant(scale), moved(), apply(Function::Reciprocal, below())]);
    let gate = |scale, gate| Expr::product(vec![rate(scale), Expr::Variable(Variable::State(StateId::new(gate)))]);
    let lifted = lift(model(vec![gate(0.1, 1), gate(0.2, 2), gate(0.3, 1)], Vec::new()));
    assert_eq!(lifted.algebraics.len(), 1, "{:#?}", lifted.algebraics);
    assert_eq!(lifted.algebraics[0].name, "(x0+40)/(1-exp(-0.1*(x0+40)))");
}

#[test]
fn a_branch_reads_what_its_condition_compares() {
    let [x, y] = [0, 1].map(|state| Expr::Variable(Variable::State(StateId::new(state))));
    let distance = Expr::sum(vec![x, Expr::scaled(-1.0, y)]);
    let yes = Expr::Apply(Function::Log, Box::new(distance.clone()));
    let select = Select { condition: distance, yes, no: Expr::Constant(0.0) };
    let choice = Expr::Select(Box::new(select));
    let lifted = lift(model(vec![choice, Expr::Constant(0.0), Expr::Constant(0.0)], Vec::new()));
    // The difference, and one function of it.
    assert_eq!(lifted.algebraics.len(), 2, "{:#?}", lifted.algebraics);
}
