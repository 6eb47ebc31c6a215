//! Elements of the solutions of linear systems: what they read, and their values.

use std::sync::Arc;

use crate::expr::{Expr, Variable};
use crate::index::at;

/// The matrix of linear systems.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    /// Its number in the model; two of one number are the same.
    pub number: u32,
    /// Name of the array.
    pub name: String,
    /// Whether it equals its transpose; then [`Matrix::entries`] has both triangles all the same.
    pub symmetric: bool,
    /// Rows, and columns.
    pub size: u32,
    /// Subscripts of the first row and of the first column.
    pub first: (i64, i64),
    /// Entries that are not zero all the time, row by row.
    pub entries: Vec<Entry>,
}

/// An entry of a matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Row, from 0.
    pub row: u32,
    /// Column, from 0.
    pub column: u32,
    /// A number or a variable.
    pub value: Expr,
}

/// A right-hand side.
#[derive(Clone, Debug, PartialEq)]
pub struct Right {
    /// Its number in the model; two of one number are the same.
    pub number: u32,
    /// For each row a number or a variable.
    pub values: Vec<Expr>,
}

/// An element of the solution of `matrix * x = right`.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The matrix.
    pub matrix: Arc<Matrix>,
    /// The right-hand side.
    pub right: Arc<Right>,
    /// Which unknown it is, from 0.
    pub row: u32,
}

impl Matrix {
    /// Its entries with other expressions.
    fn with(&self, change: &impl Fn(&Expr) -> Expr) -> Matrix {
        let entries = self.entries.iter().map(|entry| Entry { value: change(&entry.value), ..*entry }).collect();
        Matrix { entries, name: self.name.clone(), ..*self }
    }

    /// The entry of a row and a column as a spec has it.
    pub fn entry_name(&self, row: u32, column: u32) -> String {
        format!("{}[{},{}]", self.name, self.first.0 + i64::from(row), self.first.1 + i64::from(column))
    }

    /// The numbers of all entries, row by row.
    pub fn numbers(&self, variable: &impl Fn(Variable) -> f64) -> Vec<f64> {
        let size = at(self.size);
        let mut numbers = vec![0.0; size * size];
        for entry in &self.entries {
            numbers[at(entry.row) * size + at(entry.column)] = entry.value.evaluate(variable);
        }
        numbers
    }
}

impl Right {
    /// The numbers of all rows.
    pub fn numbers(&self, variable: &impl Fn(Variable) -> f64) -> Vec<f64> {
        self.values.iter().map(|value| value.evaluate(variable)).collect()
    }
}

impl Solution {
    /// The expressions that matrix and right-hand side are made of.
    fn parts(&self) -> impl Iterator<Item = &Expr> {
        self.matrix.entries.iter().map(|entry| &entry.value).chain(&self.right.values)
    }

    pub(crate) fn each_variable(&self, visit: &mut impl FnMut(Variable)) {
        self.parts().for_each(|part| part.each_variable(visit));
    }

    pub(crate) fn each_variable_mut(&mut self, visit: &mut impl FnMut(&mut Variable)) {
        let entries = Arc::make_mut(&mut self.matrix).entries.iter_mut().map(|entry| &mut entry.value);
        entries.chain(&mut Arc::make_mut(&mut self.right).values).for_each(|part| part.each_variable_mut(visit));
    }

    pub(crate) fn substituted(&self, change: &impl Fn(&Expr) -> Expr) -> Solution {
        let values = self.right.values.iter().map(change).collect();
        let right = Right { values, ..*self.right };
        Solution { matrix: Arc::new(self.matrix.with(change)), right: Arc::new(right), row: self.row }
    }

    /// The whole solution; not finite where the matrix is singular.
    pub fn all(&self, variable: &impl Fn(Variable) -> f64) -> Vec<f64> {
        eliminated(self.matrix.numbers(variable), self.right.numbers(variable))
    }

    /// For each expression of matrix and right-hand side the partial derivative of this element by it.
    pub(crate) fn partials(&self, variable: &impl Fn(Variable) -> f64) -> Vec<(&Expr, f64)> {
        let size = at(self.matrix.size);
        let matrix = self.matrix.numbers(variable);
        let transposed = (0..size * size).map(|place| matrix[place % size * size + place / size]).collect();
        let solution = eliminated(matrix, self.right.numbers(variable));
        let unit = (0..size).map(|row| if row == at(self.row) { 1.0 } else { 0.0 }).collect();
        let weights = eliminated(transposed, unit);
        let entries = self.matrix.entries.iter();
        let entries = entries.map(|entry| (&entry.value, -weights[at(entry.row)] * solution[at(entry.column)]));
        entries.chain(self.right.values.iter().zip(weights.iter().copied())).collect()
    }
}

/// The solution of a system whose matrix is given row by row: Gaussian elimination with exchanges of rows.
fn eliminated(mut matrix: Vec<f64>, mut right: Vec<f64>) -> Vec<f64> {
    let size = right.len();
    for pivot in 0..size {
        let magnitude = |row: usize| matrix[row * size + pivot].abs();
        let largest = (pivot..size).fold(pivot, |best, row| if magnitude(row) > magnitude(best) { row } else { best });
        if largest != pivot {
            (0..size).for_each(|column| matrix.swap(pivot * size + column, largest * size + column));
            right.swap(pivot, largest);
        }
        let (above, below) = matrix.split_at_mut((pivot + 1) * size);
        let own = &above[pivot * size..];
        for (row, entries) in (pivot + 1..).zip(below.chunks_exact_mut(size)) {
            let factor = entries[pivot] / own[pivot];
            if factor != 0.0 {
                entries[pivot..].iter_mut().zip(&own[pivot..]).for_each(|(entry, own)| *entry -= factor * own);
                right[row] -= factor * right[pivot];
            }
        }
    }
    for row in (0..size).rev() {
        let known: f64 = (row + 1..size).map(|column| matrix[row * size + column] * right[column]).sum();
        right[row] = (right[row] - known) / matrix[row * size + row];
    }
    right
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::index::StateId;

    /// `[[0, a, 1], [2, b, 0], [1, 0, a]] x = [b, 1, a]`, which needs an exchange.
    fn solution(row: u32) -> Solution {
        let [a, b] = [0, 1].map(|state| Expr::Variable(Variable::State(StateId::new(state))));
        let entry = |row, column, value: &Expr| Entry { row, column, value: value.clone() };
        let entries = vec![
            entry(0, 1, &a),
            entry(0, 2, &Expr::Constant(1.0)),
            entry(1, 0, &Expr::Constant(2.0)),
            entry(1, 1, &b),
            entry(2, 0, &Expr::Constant(1.0)),
            entry(2, 2, &a),
        ];
        let matrix = Matrix { number: 0, name: "A".to_owned(), symmetric: false, size: 3, first: (1, 1), entries };
        let right = Right { number: 0, values: vec![b, Expr::Constant(1.0), a] };
        Solution { matrix: Arc::new(matrix), right: Arc::new(right), row }
    }

    #[test]
    fn what_is_solved_fulfils_the_equations() {
        let values = [0.7, -1.3];
        let x = solution(0).all(&|variable| match variable {
            Variable::State(state) => values[state.index()],
            _ => f64::NAN,
        });
        let [a, b] = values;
        for left in [a * x[1] + x[2] - b, 2.0 * x[0] + b * x[1] - 1.0, x[0] + a * x[2] - a] {
            assert!(left.abs() < 1e-14, "{left}");
        }
    }

    #[test]
    fn the_gradient_is_that_of_differences() {
        for row in 0..3 {
            let expr = Expr::Solution(Box::new(solution(row)));
            let at = |a: f64, b: f64| move |variable| if variable == Variable::State(StateId::new(0)) { a } else { b };
            let mut slopes = [0.0; 2];
            expr.gradient(&at(0.7, -1.3), 1.0, &mut |variable, partial| match variable {
                Variable::State(state) => slopes[state.index()] += partial,
                _ => unreachable!("it reads states"),
            });
            let difference = |da: f64, db: f64| {
                (expr.evaluate(&at(0.7 + da, -1.3 + db)) - expr.evaluate(&at(0.7 - da, -1.3 - db))) / 2e-6
            };
            for (slope, difference) in slopes.iter().zip([difference(1e-6, 0.0), difference(0.0, 1e-6)]) {
                assert!((slope - difference).abs() < 1e-7, "{slope} {difference}");
            }
        }
    }
}
