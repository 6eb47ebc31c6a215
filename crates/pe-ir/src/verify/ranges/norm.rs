//! Norms in which the step of a model grows slowly, if at all.

use super::cholesky::{Sparse, largest_singular_value, largest_sum};
use super::system::{Row, UNIT, up};
use crate::index::at;

/// A norm of the states; their numbers count in LSB. Any will do, the better ones prove more.
#[derive(Clone, Debug, PartialEq)]
pub enum Norm {
    /// The largest magnitude relative to the weight of each state.
    Largest(Vec<f64>),
    /// Root of the sum of squares relative to the weight of each state.
    Energy(Vec<f64>),
    /// Root of the sum of squares of what the states are in a basis: its rows, and those of about its inverse.
    Basis(Vec<Vec<f64>>, Vec<Vec<f64>>),
}

/// What is proven about a norm.
#[derive(Clone, Debug)]
pub struct Measured {
    /// The norm.
    pub norm: Norm,
    /// Most by which a step multiplies it.
    pub(super) growth: f64,
    /// Most by which the inverse of a basis differs from the given one, relatively.
    slack: f64,
    /// For each state its largest magnitude where the norm is one.
    pub(super) reach: Vec<f64>,
}

impl Measured {
    /// `None` if nothing is proven. `rows` are the states at the end of a step as sums over those at its start, with the
    /// most roundings on the way to one.
    pub(super) fn of((rows, roundings): &(Vec<Row>, usize), norm: Norm) -> Option<Measured> {
        let n = rows.len();
        // What rounding did to an entry, relative to its magnitude without cancellation.
        let doubt = 2.0 * (*roundings as f64 + 2.0) * UNIT;
        let (growth, slack, reach) = match &norm {
            Norm::Largest(weights) => {
                if weights.len() != n || weights.iter().any(|weight| !(weight.is_finite() && *weight > 0.0)) {
                    return None;
                }
                let mut growth = 0.0f64;
                for (row, weight) in rows.iter().zip(weights) {
                    let of_entry = |(state, number, magnitude): &(u32, f64, f64)| {
                        (number.abs() + doubt * magnitude) * weights[at(*state)]
                    };
                    growth = growth.max(up(row.iter().map(of_entry).sum::<f64>() / weight, row.len() + 6));
                }
                (growth, 0.0, weights.clone())
            }
            Norm::Energy(weights) => {
                if weights.len() != n || weights.iter().any(|weight| !(weight.is_finite() && *weight > 0.0)) {
                    return None;
                }
                let scaled = |of: &dyn Fn(f64, f64) -> f64| -> Sparse {
                    let row = |(row, weight): (&Row, &f64)| {
                        let entry = |(state, number, magnitude): &(u32, f64, f64)| {
                            (*state, of(*number, *magnitude) * weights[at(*state)] / weight)
                        };
                        row.iter().map(entry).collect()
                    };
                    rows.iter().zip(weights).map(row).collect()
                };
                let numbers = scaled(&|number, _| number);
                // Scaling rounds twice more.
                let doubts = scaled(&|_, magnitude| (doubt + 8.0 * UNIT) * magnitude);
                let growth = largest_singular_value(&numbers)? + two_norm(&doubts);
                (up(growth, 2), 0.0, weights.clone())
            }
            Norm::Basis(basis, inverse) => {
                if basis.len() != n || inverse.len() != n || basis.iter().chain(inverse).any(|row| row.len() != n) {
                    return None;
                }
                // The inverse is `(YX)^-1 Y`, so the step in the basis is `(YX)^-1 YAX`.
                let a = dense(rows, |number, _| number);
                let magnitudes = dense(rows, |_, magnitude| magnitude);
                let [basis_sizes, inverse_sizes] = [basis, inverse].map(|of| map(of, f64::abs));
                let mut off = product(inverse, basis);
                off.iter_mut().enumerate().for_each(|(index, row)| row[index] -= 1.0);
                let rounded = 2.0 * (n as f64 + 4.0) * UNIT;
                let off = frobenius(&off) + rounded * (frobenius(&product(&inverse_sizes, &basis_sizes)) + 1.0);
                if off.is_nan() || off > 1e-3 {
                    return None;
                }
                let step = product(&product(inverse, &a), basis);
                let sizes = frobenius(&product(&product(&inverse_sizes, &magnitudes), &basis_sizes));
                let doubt = up((doubt + 2.0 * rounded) * sizes, 4);
                let sparse: Sparse = step.iter().map(|row| (0..).zip(row.iter().copied()).collect()).collect();
                let growth = (largest_singular_value(&sparse)? + doubt) / (1.0 - off);
                let reach = basis.iter().map(|row| up(root_of_squares(row.iter().copied()), n)).collect();
                (up(growth, 4), up(off, 4), reach)
            }
        };
        growth.is_finite().then_some(Measured { norm, growth, slack, reach })
    }

    /// An upper bound of the norm of whatever has at most these magnitudes.
    pub(super) fn of_magnitudes(&self, magnitudes: &[f64]) -> f64 {
        match &self.norm {
            Norm::Largest(weights) => {
                let largest = magnitudes.iter().zip(weights).map(|(size, weight)| size / weight).fold(0.0, f64::max);
                up(largest, 1)
            }
            Norm::Energy(weights) => {
                let parts = magnitudes.iter().zip(weights).map(|(size, weight)| size / weight);
                up(root_of_squares(parts), magnitudes.len() + 4)
            }
            Norm::Basis(_, inverse) => {
                let of_row = |row: &Vec<f64>| row.iter().zip(magnitudes).map(|(y, size)| y.abs() * size).sum::<f64>();
                let length = root_of_squares(inverse.iter().map(of_row));
                up(length / (1.0 - self.slack), 2 * magnitudes.len() + 8)
            }
        }
    }

    /// An upper bound of the sum of the norms of steps, if these are the sums of the magnitudes over the steps.
    pub(super) fn of_sums(&self, magnitudes: &[f64]) -> f64 {
        let mut alone = vec![0.0; magnitudes.len()];
        let mut total = 0.0;
        match &self.norm {
            Norm::Largest(weights) | Norm::Energy(weights) => {
                total = magnitudes.iter().zip(weights).map(|(size, weight)| size / weight).sum();
            }
            Norm::Basis(..) => {
                for (state, size) in magnitudes.iter().enumerate().filter(|(_, size)| **size > 0.0) {
                    alone[state] = *size;
                    total += self.of_magnitudes(&alone);
                    alone[state] = 0.0;
                }
            }
        }
        up(total, magnitudes.len() + 1)
    }

    /// `1 + g + g^2 + ..` over so many steps, without end if there is no number of steps.
    pub(super) fn sum_of_growth(&self, steps: Option<u64>) -> f64 {
        let endless = if self.growth < 1.0 { up(1.0 / (1.0 - self.growth), 4) } else { f64::INFINITY };
        let over = steps.map_or(f64::INFINITY, |steps| up(steps as f64 * self.power(steps), 2));
        endless.min(over)
    }

    /// The most by which so many steps multiply the norm, at least one.
    pub(super) fn power(&self, steps: u64) -> f64 {
        if self.growth <= 1.0 {
            return 1.0;
        }
        let exponent = steps as f64 * libm::log1p(self.growth - 1.0);
        libm::exp(exponent * (1.0 + 1e-12)) * (1.0 + 1e-12)
    }
}

fn root_of_squares(numbers: impl Iterator<Item = f64>) -> f64 {
    libm::sqrt(numbers.map(|number| number * number).sum::<f64>())
}

/// A bound of the largest singular value, fit for small numbers.
fn two_norm(matrix: &Sparse) -> f64 {
    let mut columns: Sparse = vec![Vec::new(); matrix.len()];
    for (row, entries) in (0..).zip(matrix) {
        entries.iter().for_each(|(column, number)| columns[at(*column)].push((row, *number)));
    }
    up(libm::sqrt(largest_sum(matrix) * largest_sum(&columns)), 4)
}

fn dense(rows: &[Row], of: impl Fn(f64, f64) -> f64) -> Vec<Vec<f64>> {
    let row = |row: &Row| {
        let mut numbers = vec![0.0; rows.len()];
        row.iter().for_each(|(state, number, magnitude)| numbers[at(*state)] = of(*number, *magnitude));
        numbers
    };
    rows.iter().map(row).collect()
}

fn map(matrix: &[Vec<f64>], of: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
    matrix.iter().map(|row| row.iter().map(|number| of(*number)).collect()).collect()
}

fn product(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let of_row = |row: &Vec<f64>| {
        let mut sums = vec![0.0; row.len()];
        for (factor, other) in row.iter().zip(b).filter(|(factor, _)| **factor != 0.0) {
            sums.iter_mut().zip(other).for_each(|(sum, number)| *sum += factor * number);
        }
        sums
    };
    a.iter().map(of_row).collect()
}

/// At least the root of the sum of all squares.
fn frobenius(matrix: &[Vec<f64>]) -> f64 {
    let squares: f64 = matrix.iter().flatten().map(|number| number * number).sum();
    up(libm::sqrt(squares), matrix.len() * matrix.len() + 2)
}
