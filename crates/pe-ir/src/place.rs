//! A model evaluated at some values of its states and inputs.

use crate::index::at;
use crate::model::{Expr, Model, Variable};

/// Numbers of all variables of a model at a place.
#[derive(Clone, Debug)]
pub struct Place<'a> {
    model: &'a Model,
    states: &'a [f64],
    inputs: &'a [f64],
    algebraics: Vec<f64>,
}

impl<'a> Place<'a> {
    /// The place with these states and inputs, a number for each of the model's.
    pub fn new(model: &'a Model, states: &'a [f64], inputs: &'a [f64]) -> Place<'a> {
        let mut place = Place { model, states, inputs, algebraics: Vec::with_capacity(model.algebraics.len()) };
        // The solution of the system that the algebraic variable before was an element of, by its right-hand side.
        let mut solved: Option<(u32, Vec<f64>)> = None;
        for algebraic in &model.algebraics {
            let number = match &algebraic.expr {
                Expr::Solution(solution) => {
                    let right = solution.right.number;
                    let known = solved.take().filter(|(number, _)| *number == right);
                    let (_, all) = known.unwrap_or_else(|| (right, solution.all(&|variable| place.number(variable))));
                    let number = all[at(solution.row)];
                    solved = Some((right, all));
                    number
                }
                expr => expr.evaluate(&|variable| place.number(variable)),
            };
            place.algebraics.push(number);
        }
        place
    }

    /// The number of a variable.
    pub fn number(&self, variable: Variable) -> f64 {
        match variable {
            Variable::State(index) => self.states[index.index()],
            Variable::Input(index) => self.inputs[at(index)],
            Variable::Algebraic(index) => self.algebraics[at(index)],
        }
    }

    /// The derivative of each state, in its unit per second; of a sampled state its next value.
    pub fn derivatives(&self) -> Vec<f64> {
        let states = self.model.states.iter();
        states.map(|state| state.derivative.evaluate(&|variable| self.number(variable))).collect()
    }

    /// What is added to each state by its jump.
    pub fn jumps(&self) -> Vec<f64> {
        let value = |jump: &Expr| jump.evaluate(&|variable| self.number(variable));
        let step = self.model.step;
        self.model.states.iter().map(|state| state.jump_of(step).as_ref().map_or(0.0, value)).collect()
    }
}
