//! The model linearised at a point: its derivatives there, and its Jacobian.
//!
//! The Jacobian is kept as the gradients of the equations, algebraic variables included, so that a product with a
//! vector costs what an evaluation of the model does, however many states depend on each other through algebraic
//! variables.

use std::ops::Range;

use pe_ir::index;
use pe_ir::model::{Expr, Model, State, Variable};

/// Whether the Jacobian of a model is the same everywhere: no product of variables, no function, no choice.
pub fn is_affine(model: &Model) -> bool {
    are_affine(model, &model.states)
}

/// Whether what one sample makes of the sampled states is the same everywhere but for a shift.
pub fn samples_are_affine(model: &Model) -> bool {
    are_affine(model, &model.states.as_ref()[model.continuous_states()..])
}

fn are_affine(model: &Model, states: &[State]) -> bool {
    let mut algebraics: Vec<u32> = Vec::with_capacity(model.algebraics.len());
    for algebraic in &model.algebraics {
        algebraics.push(degree(&algebraic.expr, &algebraics));
    }
    states.iter().all(|state| degree(&state.derivative, &algebraics) <= 1)
}

/// 0 for a constant, 1 for what is affine in states and inputs, 2 for all else.
fn degree(expr: &Expr, algebraics: &[u32]) -> u32 {
    let degree_of = |member: &Expr| degree(member, algebraics);
    match expr {
        Expr::Constant(_) => 0,
        Expr::Variable(Variable::Algebraic(index)) => algebraics[index::at(*index)],
        Expr::Variable(_) => 1,
        Expr::Sum(members) => members.iter().map(degree_of).max().unwrap_or(0),
        Expr::Product(members) => members.iter().map(degree_of).sum::<u32>().min(2),
        Expr::Power(base, exponent) => (degree_of(base) * exponent).min(2),
        Expr::Apply(_, argument) => 2 * degree_of(argument).min(1),
        Expr::Select(select) => {
            2 * [&select.condition, &select.yes, &select.no].into_iter().map(degree_of).max().unwrap_or(0).min(1)
        }
        Expr::Solution(solution) => {
            let matrix = solution.matrix.entries.iter().map(|entry| degree_of(&entry.value)).max().unwrap_or(0);
            let right = solution.right.values.iter().map(degree_of).max().unwrap_or(0);
            right.max(2 * matrix.min(1))
        }
    }
}

/// A model at a point.
#[derive(Clone, Debug)]
pub struct Linearised {
    /// The derivative of each state, in units of the state per second.
    pub derivatives: Vec<f64>,
    /// The algebraic variables.
    pub algebraics: Vec<f64>,
    /// Gradients of the algebraic equations, then of the states.
    rows: Vec<Range<u32>>,
    /// Column and partial derivative; columns are the states, then the algebraic variables.
    entries: Vec<(u32, f64)>,
}

impl Linearised {
    /// The model at `states` with these inputs; sampled states are held, and so are those that stand for signals, which
    /// no mode of the model moves.
    pub fn at(model: &Model, states: &[f64], inputs: &[f64]) -> Linearised {
        Linearised::of(model, states, inputs, &|state| state.rate.is_none() && state.motion.is_none())
    }

    /// The same with the derivatives of states that stand for signals.
    pub fn with_signals(model: &Model, states: &[f64], inputs: &[f64]) -> Linearised {
        Linearised::of(model, states, inputs, &|state| state.rate.is_none())
    }

    /// What one sample makes of the sampled states at `states` with these inputs; the others are 0 after it.
    pub fn of_samples(model: &Model, states: &[f64], inputs: &[f64]) -> Linearised {
        Linearised::of(model, states, inputs, &|state| state.rate.is_some())
    }

    /// The equations of some states; all else stands still.
    fn of(model: &Model, states: &[f64], inputs: &[f64], counts: &dyn Fn(&State) -> bool) -> Linearised {
        let count = index::number(model.states.len());
        let mut algebraics: Vec<f64> = Vec::with_capacity(model.algebraics.len());
        let (mut rows, mut entries) = (Vec::new(), Vec::new());
        let mut derivatives = Vec::with_capacity(states.len());
        let all = model.algebraics.iter().map(|algebraic| &algebraic.expr);
        let still = Expr::Constant(0.0);
        let slopes = model.states.iter().map(|state| if counts(state) { &state.derivative } else { &still });
        for (index, expr) in all.chain(slopes).enumerate() {
            let value = |variable| match variable {
                Variable::State(state) => states[state.index()],
                Variable::Input(input) => inputs[index::at(input)],
                Variable::Algebraic(algebraic) => algebraics[index::at(algebraic)],
            };
            let start = index::number(entries.len());
            expr.gradient(&value, 1.0, &mut |variable, partial| match variable {
                Variable::State(state) => entries.push((state.number(), partial)),
                Variable::Algebraic(algebraic) => entries.push((count + algebraic, partial)),
                Variable::Input(_) => {}
            });
            rows.push(start..entries.len() as u32);
            let number = expr.evaluate(&value);
            if index < model.algebraics.len() { algebraics.push(number) } else { derivatives.push(number) }
        }
        Linearised { derivatives, algebraics, rows, entries }
    }

    /// Number of states.
    pub fn states(&self) -> usize {
        self.derivatives.len()
    }

    /// Whether all partial derivatives are finite.
    pub fn is_finite(&self) -> bool {
        self.entries.iter().all(|(_, partial)| partial.is_finite())
    }

    /// The Jacobian times a vector of as many numbers as there are states.
    pub fn product(&self, vector: &[f64]) -> Vec<f64> {
        self.forward(vector, |partial| partial)
    }

    /// A bound of the magnitude of every eigenvalue: the largest sum of magnitudes of a row of the Jacobian, or, where
    /// algebraic variables are shared, a bound of it (Gershgorin's circles around zero).
    pub fn row_bound(&self) -> f64 {
        self.forward(&vec![1.0; self.states()], f64::abs).into_iter().fold(0.0, f64::max)
    }

    /// Passes a change of the states through all equations.
    fn forward(&self, vector: &[f64], weigh: impl Fn(f64) -> f64) -> Vec<f64> {
        let algebraics = self.rows.len() - vector.len();
        let mut changes = Vec::with_capacity(vector.len() + algebraics);
        changes.extend_from_slice(vector);
        let sum = |row: &Range<u32>, changes: &[f64]| {
            let entries = &self.entries[index::at(row.start)..row.end as usize];
            entries.iter().map(|(column, partial)| weigh(*partial) * changes[index::at(*column)]).sum::<f64>()
        };
        for row in &self.rows[..algebraics] {
            changes.push(sum(row, &changes));
        }
        self.rows[algebraics..].iter().map(|row| sum(row, &changes)).collect()
    }

    /// The whole Jacobian, column after column.
    pub fn dense(&self) -> Vec<f64> {
        let states = self.states();
        let mut unit = vec![0.0; states];
        let mut matrix = Vec::with_capacity(states * states);
        for column in 0..states {
            unit[column] = 1.0;
            matrix.extend(self.product(&unit));
            unit[column] = 0.0;
        }
        matrix
    }
}

#[cfg(test)]
mod tests {
    use pe_ir::index::{List, StateId};

    use super::*;
    use pe_ir::model::{Algebraic, Solver};
    use pe_ir::source::Span;

    /// x' = a y, y' = 3 a - x with a = x y, whose Jacobian is (y^2, 2 x y; 3 y - 1, 3 x).
    fn model() -> Model {
        let variable = |index| Expr::Variable(Variable::State(StateId::new(index)));
        let product = Expr::product(vec![variable(0), variable(1)]);
        let algebraic = Expr::Variable(Variable::Algebraic(0));
        let shared = Algebraic {
            name: "a".to_owned(),
            unit: None,
            expr: product,
            range: None,
            kept: false,
            angle: false,
            span: Span::default(),
        };
        Model {
            states: List::from(vec![
                State::new("x", Expr::product(vec![algebraic.clone(), variable(1)])),
                State::new("y", Expr::sum(vec![Expr::scaled(3.0, algebraic), Expr::scaled(-1.0, variable(0))])),
            ]),
            algebraics: vec![shared],
            ..Model::new("m", Solver::Rk4, 0.1, 1.0)
        }
    }

    #[test]
    fn the_jacobian_goes_through_algebraic_variables() {
        let (x, y) = (2.0, 5.0);
        let linear = Linearised::at(&model(), &[x, y], &[]);
        assert_eq!(
            (linear.derivatives.as_slice(), linear.algebraics.as_slice()),
            ([50.0, 28.0].as_slice(), [10.0].as_slice())
        );
        assert_eq!(linear.dense(), [y * y, 3.0 * y - 1.0, 2.0 * x * y, 3.0 * x]);
        assert_eq!(linear.product(&[1.0, 10.0]), [y * y + 20.0 * x * y, 3.0 * y - 1.0 + 30.0 * x]);
        // Through the shared variable the bound of a row adds magnitudes.
        assert_eq!(linear.row_bound(), f64::max(y * (y + x) + x * y, 3.0 * (x + y) + 1.0));
        assert!(linear.is_finite() && !is_affine(&model()));
    }

    #[test]
    fn products_of_variables_are_not_affine_and_sums_are() {
        let mut model = model();
        model.algebraics[0].expr =
            Expr::sum(vec![Expr::Variable(Variable::State(StateId::new(0))), Expr::Constant(1.0)]);
        assert!(!is_affine(&model));
        model.states[StateId::new(0)].derivative = Expr::scaled(2.0, Expr::Variable(Variable::Algebraic(0)));
        assert!(is_affine(&model));
    }
}
