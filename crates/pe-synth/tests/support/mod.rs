//! Random models for tests: seeded, stable, and shaped to hit every feature of the hardware.

#![allow(clippy::disallowed_methods, reason = "the tests' own numbers may come from the standard library")]
// Every test file compiles all of this and uses a part.
#![allow(dead_code)]

pub mod agree;
pub mod bench;
pub mod bus;
pub mod damage;
pub mod faults;
pub mod flow;
pub mod hubs;
pub mod models;
pub mod tables;
pub mod written;

use pe_ir::index::StateId;
use pe_ir::model::{Algebraic, Expr, Input, Model, Output, Solver, State, Variable, Waveform};
use pe_ir::source::Span;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Families of random models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Sparse affine right-hand sides.
    Affine,
    /// Products of up to three states.
    Polynomial,
    /// Algebraic equations that many rows read.
    Shared,
    /// Rows of a single product.
    OneProduct,
    /// One state that all rows read, one row that reads all states.
    Hub,
    /// States whose sizes differ by six decades.
    Scales,
    /// Rings whose neighbours have equal coefficients, with a cubic term.
    Stencil,
    /// The same without it.
    Grid,
}

/// All families.
pub const FAMILIES: [Family; 8] = [
    Family::Affine,
    Family::Polynomial,
    Family::Shared,
    Family::OneProduct,
    Family::Hub,
    Family::Scales,
    Family::Stencil,
    Family::Grid,
];

/// Families whose right-hand sides are affine.
pub const AFFINE_FAMILIES: [Family; 5] =
    [Family::Affine, Family::OneProduct, Family::Hub, Family::Scales, Family::Grid];

/// Whether tests take all that they have for the long suite, `testbenches/long.sh`.
pub fn is_long_suite() -> bool {
    std::env::var_os("PE_LONG").is_some()
}

/// All cases in the long suite, else as many as the test keeps of them.
pub fn kept<T>(cases: impl IntoIterator<Item = T>, short: usize) -> impl Iterator<Item = T> {
    cases.into_iter().take(if is_long_suite() { usize::MAX } else { short })
}

fn state(index: usize) -> Expr {
    Expr::Variable(Variable::State(StateId::new(index as u32)))
}

fn scaled(factor: f64, expr: Expr) -> Expr {
    Expr::Product(vec![Expr::Constant(factor), expr])
}

/// A random model of `states` states. Every state decays, so that runs stay bounded.
pub fn random_model(family: Family, states: usize, solver: Solver, seed: u64) -> Model {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let scale: Vec<f64> = (0..states)
        .map(|_| if family == Family::Scales { 10f64.powf(rng.random_range(-3.0..3.0)) } else { 1.0 })
        .collect();
    let mut model = Model {
        title: format!("random {family:?} model, seed {seed}"),
        inputs: vec![Input {
            name: "drive".into(),
            unit: None,
            waveform: Waveform::Sine { amplitude: 1.0, frequency: 3.0, offset: 0.2, phase: 0.4 },
            range: None,
            between: pe_ir::model::Interpolation::Hold,
            span: Span::default(),
        }],
        ..Model::new(format!("random_{family:?}").to_lowercase(), solver, 0.01, 0.5)
    };
    if family == Family::Shared {
        for index in 0..states.div_ceil(4) {
            let terms = (0..4).map(|_| scaled(rng.random_range(-0.5..0.5), state(rng.random_range(0..states))));
            let mut sum: Vec<Expr> = terms.collect();
            sum.push(Expr::Constant(rng.random_range(-0.3..0.3)));
            if index > 0 {
                sum.push(scaled(0.3, Expr::Variable(Variable::Algebraic(index as u32 - 1))));
            }
            let expr = if index.is_multiple_of(2) { Expr::Sum(sum) } else { Expr::Power(Box::new(Expr::Sum(sum)), 2) };
            model.algebraics.push(Algebraic {
                name: format!("a[{index}]"),
                unit: None,
                expr,
                range: None,
                kept: false,
                angle: false,
                span: Span::default(),
            });
        }
    }
    for index in 0..states {
        let mut terms = right_hand_side(family, index, states, &scale, model.algebraics.len(), &mut rng);
        if index % 3 == 0 && family != Family::OneProduct {
            terms.push(scaled(rng.random_range(0.5..2.0) * scale[index], Expr::Variable(Variable::Input(0))));
        }
        model.states.push(State {
            initial: rng.random_range(0.2..1.0) * scale[index] * if rng.random_bool(0.5) { 1.0 } else { -1.0 },
            ..State::new(format!("x[{index}]"), Expr::Sum(terms))
        });
    }
    for index in [0, states - 1] {
        let output = Output {
            name: format!("x[{index}]"),
            variable: Variable::State(StateId::new(index as u32)),
            span: Span::default(),
        };
        model.outputs.push(output);
    }
    if let Some(last) = model.algebraics.len().checked_sub(1) {
        let variable = Variable::Algebraic(last as u32);
        model.outputs.push(Output { name: format!("a[{last}]"), variable, span: Span::default() });
    }
    model
}

fn right_hand_side(
    family: Family,
    index: usize,
    states: usize,
    scale: &[f64],
    algebraics: usize,
    rng: &mut impl Rng,
) -> Vec<Expr> {
    let any = |rng: &mut dyn Rng| rng.random_range(0..states);
    let decay = scaled(-4.0, state(index));
    match family {
        Family::Affine | Family::Scales => {
            let mut terms = vec![decay];
            for _ in 0..rng.random_range(1..4) {
                let other = any(rng);
                terms.push(scaled(rng.random_range(-1.0..1.0) * scale[index] / scale[other], state(other)));
            }
            terms
        }
        Family::Polynomial => {
            let (a, b, c) = (any(rng), any(rng), any(rng));
            vec![
                decay,
                scaled(rng.random_range(-0.8..0.8), Expr::Product(vec![state(a), state(b)])),
                scaled(rng.random_range(-0.5..0.5), Expr::Product(vec![state(a), state(b), state(c)])),
                scaled(-0.2, Expr::Power(Box::new(state(index)), 3)),
                Expr::Constant(rng.random_range(-0.5..0.5)),
            ]
        }
        Family::Shared => {
            let algebraic = Expr::Variable(Variable::Algebraic(rng.random_range(0..algebraics) as u32));
            let factor = rng.random_range(-0.7..0.7);
            if index.is_multiple_of(2) {
                vec![decay, scaled(factor, algebraic)]
            } else {
                vec![decay, scaled(factor, Expr::Product(vec![algebraic, state(any(rng))]))]
            }
        }
        Family::OneProduct => {
            // A ring of oscillating pairs: x' = w y, y' = -w x.
            let partner = if index.is_multiple_of(2) { (index + 1) % states } else { index - 1 };
            vec![scaled(if index.is_multiple_of(2) { 3.0 } else { -3.0 }, state(partner))]
        }
        Family::Stencil | Family::Grid => {
            let neighbours = [1, 3, states - 1, 2 * states - 3].map(|ahead| (index + ahead) % states);
            let mut terms = vec![decay];
            if family == Family::Stencil {
                terms.push(scaled(-0.2, Expr::Power(Box::new(state(index)), 3)));
            }
            terms.extend(neighbours.map(|neighbour| scaled(0.7, state(neighbour))));
            terms
        }
        Family::Hub => {
            let mut terms = vec![decay, scaled(rng.random_range(-0.9..0.9), state(0))];
            if index == states - 1 {
                let share = 2.0 / states as f64;
                terms.extend((0..states - 1).map(|other| scaled(rng.random_range(-share..share), state(other))));
            }
            terms
        }
    }
}
