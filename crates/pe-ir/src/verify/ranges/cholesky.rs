//! Rigorous bounds of the largest singular value of a matrix, by factorising in double precision.

use crate::index;
use std::collections::BTreeSet;

use super::system::{UNIT, up};

/// Entries of a factor, at most.
const FILL: usize = 1 << 24;

/// A matrix by rows: columns in ascending order, and numbers.
pub(super) type Sparse = Vec<Vec<(u32, f64)>>;

/// The smallest of a few numbers that provably is no less than the largest singular value of `matrix`, which has as
/// many columns as rows.
///
/// `s^2 - G'G` is positive semidefinite, if the factorisation of it less a shift comes to its end and the shift is
/// larger than what rounding can have done (S. M. Rump, Verification of positive definiteness, BIT 46, 2006).
pub(super) fn largest_singular_value(matrix: &Sparse) -> Option<f64> {
    let square = Square::of(matrix)?;
    let candidates = candidates();
    let (mut low, mut high) = (0, candidates.len());
    while low < high {
        let middle = (low + high) / 2;
        if square.is_below(candidates[middle]) { high = middle } else { low = middle + 1 }
    }
    candidates.get(low).copied()
}

/// Numbers that are tried, ascending: near one in small differences, for they act in every step.
fn candidates() -> Vec<f64> {
    let fine = |sign: f64| move |exponent: i32| 1.0 + sign * libm::scalbn(1.0, exponent);
    let below = (-30..=-1).rev().map(fine(-1.0));
    below.chain(std::iter::once(1.0)).chain((-38..=0).map(fine(1.0))).collect()
}

/// `G'G` in the order of its elimination, with the pattern of its factor.
struct Square {
    /// For each column the entries from the diagonal on, in the order of the rows.
    columns: Vec<Vec<(u32, f64)>>,
    /// For each column of the factor the rows below the diagonal.
    pattern: Vec<Vec<u32>>,
    /// Entries of the longest row of the factor.
    longest: usize,
    /// What rounding can have done to the norm of the matrix.
    error: f64,
}

impl Square {
    fn of(matrix: &Sparse) -> Option<Square> {
        let n = matrix.len();
        let mut dense = vec![Vec::new(); n];
        let mut neighbours: Vec<BTreeSet<u32>> = vec![BTreeSet::new(); n];
        let mut entries = 0;
        for (row, numbers) in (0..).zip(matrix) {
            for (column, number) in numbers {
                dense[index::at(*column)].push((row, *number));
            }
            entries += numbers.len() * numbers.len();
            if entries > FILL {
                return None;
            }
            for (a, _) in numbers {
                neighbours[index::at(*a)].extend(numbers.iter().map(|(b, _)| *b).filter(|b| b != a));
            }
        }
        let (order, pattern) = eliminate(neighbours)?;
        let mut place = vec![0u32; n];
        order.iter().zip(0..).for_each(|(index, at)| place[index::at(*index)] = at);
        let mut columns = vec![Vec::new(); n];
        let mut sums = vec![0.0; n];
        for (at, index) in order.iter().enumerate() {
            let mut touched = Vec::new();
            for (row, number) in &dense[index::at(*index)] {
                for (other, factor) in &matrix[index::at(*row)] {
                    let other = index::at(place[index::at(*other)]);
                    if other >= at {
                        touched.push(index::number(other));
                        sums[other] += number * factor;
                    }
                }
            }
            touched.push(index::number(at));
            touched.sort_unstable();
            touched.dedup();
            columns[at] = touched.iter().map(|other| (*other, sums[index::at(*other)])).collect();
            touched.iter().for_each(|other| sums[index::at(*other)] = 0.0);
        }
        let mut lengths = vec![1usize; n];
        pattern.iter().flatten().for_each(|row| lengths[index::at(*row)] += 1);
        let longest = dense.iter().map(Vec::len).max().unwrap_or(0);
        let (of_rows, of_columns) = (largest_sum(matrix), largest_sum(&dense));
        let error = 2.0 * (longest as f64 + 2.0) * UNIT * of_rows * of_columns;
        let error = up(error, 4);
        Some(Square { columns, pattern, longest: lengths.into_iter().max().unwrap_or(0), error })
    }

    /// Whether `s^2 - G'G` is proven to be positive semidefinite.
    fn is_below(&self, s: f64) -> bool {
        let n = self.columns.len();
        let square = s * s * (1.0 - 2.0 * UNIT);
        // Rump's bound of what the factorisation rounds, and the roundings of the diagonal's differences.
        let shift = up(self.error + 2.0 * (self.longest as f64 + 5.0) * UNIT * (square + 1.0) * n as f64, 8);
        let mut factor: Vec<Vec<(u32, f64)>> = Vec::with_capacity(n);
        // For each row the columns whose next entry is in it.
        let mut due: Vec<Vec<(u32, u32)>> = vec![Vec::new(); n];
        let mut sums = vec![0.0; n];
        for column in 0..n {
            for (row, number) in &self.columns[column] {
                sums[index::at(*row)] = -number;
            }
            sums[column] += square - shift;
            for (earlier, at) in std::mem::take(&mut due[column]) {
                let entries = &factor[index::at(earlier)][index::at(at)..];
                let by = entries[0].1;
                for (row, number) in entries {
                    sums[index::at(*row)] -= by * number;
                }
                if let Some((row, _)) = entries.get(1) {
                    due[index::at(*row)].push((earlier, at + 1));
                }
            }
            let pivot = sums[column];
            if pivot.is_nan() || pivot <= 0.0 {
                return false;
            }
            let root = libm::sqrt(pivot);
            sums[column] = 0.0;
            let mut entries = Vec::with_capacity(self.pattern[column].len());
            for row in &self.pattern[column] {
                entries.push((*row, sums[index::at(*row)] / root));
                sums[index::at(*row)] = 0.0;
            }
            if let Some((row, _)) = entries.first() {
                due[index::at(*row)].push((index::number(column), 0));
            }
            factor.push(entries);
        }
        true
    }
}

/// Largest sum of magnitudes of a row.
pub(super) fn largest_sum(matrix: &Sparse) -> f64 {
    let of_row = |row: &Vec<(u32, f64)>| up(row.iter().map(|(_, number)| number.abs()).sum(), row.len());
    matrix.iter().map(of_row).fold(0.0, f64::max)
}

/// The order in which the fewest neighbours come first, and for each place in it the later places that the factor has
/// entries in.
fn eliminate(mut neighbours: Vec<BTreeSet<u32>>) -> Option<(Vec<u32>, Vec<Vec<u32>>)> {
    let n = neighbours.len();
    let mut queue: BTreeSet<(usize, u32)> = neighbours.iter().zip(0..).map(|(set, index)| (set.len(), index)).collect();
    let mut order = Vec::with_capacity(n);
    let mut pattern = Vec::with_capacity(n);
    let mut fill = 0;
    while let Some((degree, index)) = queue.pop_first() {
        order.push(index);
        fill += degree;
        if fill > FILL {
            return None;
        }
        let around: Vec<u32> = std::mem::take(&mut neighbours[index::at(index)]).into_iter().collect();
        if around.len() == queue.len() {
            // All that is left is joined to all: any order does.
            let rest: Vec<u32> = queue.iter().map(|(_, index)| *index).collect();
            pattern.push(around);
            for (at, index) in rest.iter().enumerate() {
                order.push(*index);
                pattern.push(rest[at + 1..].to_vec());
            }
            break;
        }
        for neighbour in &around {
            let set = &mut neighbours[index::at(*neighbour)];
            queue.remove(&(set.len(), *neighbour));
            set.extend(around.iter().filter(|other| *other != neighbour));
            set.remove(&index);
            queue.insert((set.len(), *neighbour));
        }
        pattern.push(around);
    }
    let mut place = vec![0u32; n];
    order.iter().zip(0..).for_each(|(index, at)| place[index::at(*index)] = at);
    for rows in &mut pattern {
        rows.iter_mut().for_each(|row| *row = place[index::at(*row)]);
        rows.sort_unstable();
    }
    Some((order, pattern))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotation_keeps_lengths_and_a_larger_matrix_does_not() {
        let (c, s) = (libm::cos(0.3), libm::sin(0.3));
        let rotation = |scale: f64| vec![vec![(0, c * scale), (1, s * scale)], vec![(0, -s * scale), (1, c * scale)]];
        let of = |scale| largest_singular_value(&rotation(scale)).unwrap();
        assert!(of(1.0) >= 1.0 && of(1.0) < 1.0 + 1e-10);
        assert!(of(0.9) >= 0.9 && of(0.9) < 0.95);
        assert!(of(1.01) >= 1.01 && of(1.01) < 1.02);
        assert_eq!(largest_singular_value(&rotation(3.0)), None);
    }

    #[test]
    fn chains_and_stars_are_bounded_from_above() {
        // Differences of neighbours: singular values up to 2 sin(n pi / (2 n + 1)); a star with n rays: sqrt(n + 1).
        let n = 50;
        let chain: Sparse =
            (0..n).map(|i| if i > 0 { vec![(i - 1, -0.5), (i, 0.5)] } else { vec![(0, 0.5)] }).collect();
        let bound = largest_singular_value(&chain).unwrap();
        assert!((0.9995..=1.0).contains(&bound), "{bound}");
        let mut star: Sparse = vec![(0..n).map(|i| (i, 0.1)).collect()];
        star.extend((1..n).map(|_| Vec::new()));
        let bound = largest_singular_value(&star).unwrap();
        assert!((0.707..0.76).contains(&bound), "{bound}");
    }
}
