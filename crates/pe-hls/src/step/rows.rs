//! Sparse rows of an affine right-hand side, and polynomials of them.

use pe_ir::index::{self, at};
use pe_ir::model::{Expr, Variable};

use super::polynomial::Polynomial;
use super::sharing::Expanded;

/// What is left where the contributions to an entry cancel, relative to the sum of their magnitudes, if it is nothing
/// but the rounding of double precision.
const RESIDUE: f64 = 1.0 / (1u64 << 46) as f64;

/// Multiplications that a product of matrices may take, whatever its result's size: below a second of work.
const WORK: u64 = 1 << 29;

/// Terms of the Taylor series of the exponential: on norms up to one half the next is below 1e-17.
const DEGREE: usize = 14;

/// A matrix `M` with a row for every state and columns for states, inputs and the number one: `(y' = M (y, u, 1))`.
/// Inputs and the number one stand still within a step, so their rows are zero and are not stored.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    starts: Vec<usize>,
    columns: Vec<u32>,
    numbers: Vec<f64>,
    width: usize,
}

/// The matrix has more entries than it may, or numbers beyond double precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoMatrix;

impl Rows {
    /// The rows of the derivatives with all algebraic equations put in their place. `None` if they are not affine in
    /// states and inputs together with constant coefficients, or have more than `limit` entries.
    pub fn of(expanded: &Expanded, inputs: usize, limit: usize) -> Option<Rows> {
        let states = expanded.derivatives.len();
        let mut sum = Sum::new(states + inputs + 1);
        let mut algebraics = Rows::empty(sum.width());
        let functions = expanded.functions.as_slice();
        for ((polynomial, shared), function) in expanded.algebraics.iter().zip(&expanded.shared).zip(functions) {
            // The polynomial of a function is its argument, so its row stays empty, and nothing may read it.
            if *shared && function.is_none() {
                sum.add_polynomial(polynomial, states, (&algebraics, functions))?;
            }
            sum.finish(&mut algebraics, limit).ok()?;
        }
        let mut rows = Rows::empty(sum.width());
        for polynomial in &expanded.derivatives {
            sum.add_polynomial(polynomial, states, (&algebraics, functions))?;
            sum.finish(&mut rows, limit).ok()?;
        }
        Some(rows)
    }

    /// `p_1 (hM) + p_2 (hM)^2 + ..`, by Horner's rule.
    ///
    /// # Errors
    /// [`NoMatrix`] if it, or a power on the way, has more than `limit` entries or one that is not finite.
    pub fn polynomial(&self, coefficients: &[f64], step: f64, limit: usize) -> Result<Rows, NoMatrix> {
        let mut sum = Sum::new(self.width);
        let mut result = Rows::empty(self.width);
        let mut work = 0;
        for (index, coefficient) in coefficients.iter().rev().enumerate() {
            let mut next = Rows::empty(self.width);
            for row in 0..self.len() {
                for (column, number) in self.row(row) {
                    sum.add(column, coefficient * step * number);
                    if index > 0 && at(column) < self.len() {
                        for (inner, factor) in result.row(at(column)) {
                            sum.add(inner, step * number * factor);
                            work += 1;
                        }
                    }
                }
                if work > WORK {
                    return Err(NoMatrix);
                }
                sum.finish(&mut next, limit)?;
            }
            result = next;
        }
        Ok(result)
    }

    /// `exp(hM) - 1`, by its Taylor series on a fraction of the step and squaring: with `E = exp(X) - 1`,
    /// `exp(2X) - 1 = 2E + E^2`, which loses nothing where the step changes little.
    ///
    /// # Errors
    /// [`NoMatrix`] if it, or a power on the way, has more than `limit` entries or one that is not finite.
    pub fn exponential(&self, step: f64, limit: usize) -> Result<Rows, NoMatrix> {
        let of_row = |row| self.row(row).filter(|(column, _)| at(*column) < self.len()).map(|(_, n)| n.abs()).sum();
        let norm = step * (0..self.len()).map(of_row).fold(0.0, |most: f64, row: f64| most.max(row));
        if !norm.is_finite() {
            return Err(NoMatrix);
        }
        let halvings = libm::frexp(2.0 * norm).1.max(0);
        let mut coefficients = vec![1.0];
        for k in 2..=DEGREE {
            coefficients.push(coefficients[k - 2] / k as f64);
        }
        let mut result = self.polynomial(&coefficients, libm::scalbn(step, -halvings), limit)?;
        for _ in 0..halvings {
            // 2E + E^2 as a polynomial of E.
            result = result.polynomial(&[2.0, 1.0], 1.0, limit)?;
        }
        Ok(result)
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Columns and numbers of a row, in the order of the columns.
    pub fn row(&self, row: usize) -> impl ExactSizeIterator<Item = (u32, f64)> {
        let range = self.starts[row]..self.starts[row + 1];
        self.columns[range.clone()].iter().copied().zip(self.numbers[range].iter().copied())
    }

    fn empty(width: usize) -> Rows {
        Rows { starts: vec![0], columns: Vec::new(), numbers: Vec::new(), width }
    }
}

/// A row under construction: a number per column, and which columns have one.
struct Sum {
    numbers: Vec<f64>,
    /// Sum of the magnitudes of the contributions to each column; zero if there are none.
    magnitudes: Vec<f64>,
    touched: Vec<u32>,
}

impl Sum {
    fn new(width: usize) -> Sum {
        Sum { numbers: vec![0.0; width], magnitudes: vec![0.0; width], touched: Vec::new() }
    }

    fn width(&self) -> usize {
        self.numbers.len()
    }

    fn add(&mut self, column: u32, number: f64) {
        let magnitude = &mut self.magnitudes[at(column)];
        if *magnitude == 0.0 && number != 0.0 {
            self.touched.push(column);
        }
        *magnitude += number.abs();
        self.numbers[at(column)] += number;
    }

    /// Adds a polynomial of degree one; `None` if it has another, or reads a function.
    fn add_polynomial(
        &mut self,
        polynomial: &Polynomial,
        states: usize,
        (algebraics, functions): (&Rows, &[Option<Expr>]),
    ) -> Option<()> {
        let one = index::number(self.width()) - 1;
        for (monomial, coefficient) in polynomial.terms() {
            match monomial.as_slice() {
                [] => self.add(one, coefficient),
                [Variable::State(state)] => self.add(state.number(), coefficient),
                [Variable::Input(input)] => self.add(index::number(states) + input, coefficient),
                [Variable::Algebraic(algebraic)] if functions[at(*algebraic)].is_none() => {
                    algebraics.row(at(*algebraic)).for_each(|(column, n)| self.add(column, coefficient * n));
                }
                _ => return None,
            }
        }
        Some(())
    }

    /// Appends the row, but for what rounding left of contributions that cancel, and begins the next one.
    fn finish(&mut self, rows: &mut Rows, limit: usize) -> Result<(), NoMatrix> {
        self.touched.sort_unstable();
        for column in self.touched.drain(..) {
            let number = std::mem::take(&mut self.numbers[at(column)]);
            let magnitude = std::mem::take(&mut self.magnitudes[at(column)]);
            if !magnitude.is_finite() {
                return Err(NoMatrix);
            }
            if number.abs() > RESIDUE * magnitude {
                rows.columns.push(column);
                rows.numbers.push(number);
            }
        }
        rows.starts.push(rows.columns.len());
        if rows.columns.len() > limit { Err(NoMatrix) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `y0' = 2 y1 + 3 u, y1' = -y0 + 5`.
    fn rows() -> Rows {
        let mut rows = Rows::empty(4);
        let mut sum = Sum::new(4);
        for row in [[(1, 2.0), (2, 3.0)], [(0, -1.0), (3, 5.0)]] {
            row.into_iter().for_each(|(column, number)| sum.add(column, number));
            sum.finish(&mut rows, 100).unwrap();
        }
        rows
    }

    fn entries(rows: &Rows, row: usize) -> Vec<(u32, f64)> {
        rows.row(row).collect()
    }

    #[test]
    fn inputs_and_constants_stand_still_in_a_polynomial() {
        let square = rows().polynomial(&[0.0, 1.0], 0.5, 100).unwrap();
        assert_eq!(entries(&square, 0), [(0, -0.5), (3, 2.5)]);
        assert_eq!(entries(&square, 1), [(1, -0.5), (2, -0.75)]);
    }

    #[test]
    fn a_power_beyond_double_precision_is_no_matrix() {
        let mut rows = Rows::empty(2);
        let mut sum = Sum::new(2);
        sum.add(0, -1e200);
        sum.finish(&mut rows, 100).unwrap();
        assert!(rows.polynomial(&[1.0], 1.0, 100).is_ok());
        assert_eq!(rows.polynomial(&[1.0, 0.5], 1.0, 100), Err(NoMatrix));
    }

    #[test]
    fn the_exponential_is_that_of_a_damped_rotation() {
        // y' = (-a, w; -w, -a) y + (b, 0) u, with the solution in closed form.
        let (a, w, b, h) = (3.0, 40.0, 2.0, 0.2);
        let mut rows = Rows::empty(4);
        let mut sum = Sum::new(4);
        [(0, -a), (1, w), (2, b)].into_iter().for_each(|(column, n)| sum.add(column, n));
        sum.finish(&mut rows, 100).unwrap();
        [(0, -w), (1, -a)].into_iter().for_each(|(column, n)| sum.add(column, n));
        sum.finish(&mut rows, 100).unwrap();
        let exponential = rows.exponential(h, 100).unwrap();
        let (decay, angle) = (libm::exp(-a * h), w * h);
        // The integral of exp(A s) over the step, first column: (1 - exp(A h)) (a, w) / (a^2 + w^2).
        let integral = |cos: f64, sin: f64| (a * (1.0 - decay * cos) + w * decay * sin) / (a * a + w * w);
        let expected = [
            decay * libm::cos(angle) - 1.0,
            decay * libm::sin(angle),
            b * integral(libm::cos(angle), libm::sin(angle)),
        ];
        for ((_, is), should) in exponential.row(0).zip(expected) {
            assert!((is - should).abs() < 1e-14, "{is} is not {should}");
        }
        assert_eq!(exponential.row(0).len(), 3);
    }

    #[test]
    fn what_rounding_leaves_of_a_cancelled_entry_is_no_entry() {
        let mut rows = Rows::empty(2);
        let mut sum = Sum::new(2);
        [(0, 0.1), (0, 0.2), (0, -0.3), (1, 1e-30)].into_iter().for_each(|(column, n)| sum.add(column, n));
        sum.finish(&mut rows, 100).unwrap();
        assert_eq!(entries(&rows, 0), [(1, 1e-30)]);
    }

    #[test]
    fn a_polynomial_beyond_the_limit_is_refused() {
        assert_eq!(rows().polynomial(&[1.0, 1.0], 0.5, 7), Err(NoMatrix));
    }
}
