//! Eigenvalues: all of a small matrix, the outer ones of a large one.

use nalgebra::linalg::{Schur, balancing};
use nalgebra::{DMatrix, DVector};

/// Iterations of the QR algorithm per eigenvalue before it is given up; some three are usual.
const ITERATIONS: usize = 100;

/// Parts of their neighbours below which numbers beside the diagonal count as zero, the least first.
const DEFLATED: [f64; 3] = [f64::EPSILON, 1e-14, 1e-12];

/// Part of a vector that is left when it lies in the span of others.
const DEPENDENT: f64 = 1e-12;

/// All eigenvalues, as real and imaginary parts, of a matrix of `order` rows that is given column after column; `None`
/// if a number is not finite, or the iteration does not end.
pub fn eigenvalues(order: usize, columns: &[f64]) -> Option<Vec<(f64, f64)>> {
    if columns.iter().any(|number| !number.is_finite()) {
        return None;
    }
    let mut matrix = DMatrix::from_column_slice(order, order, columns);
    let scale = matrix.amax();
    if scale == 0.0 {
        return Some(vec![(0.0, 0.0); order]);
    }
    // Numbers near 1, so that no square under- or overflows.
    matrix /= scale;
    balancing::balance_parlett_reinsch(&mut matrix);
    // Where eigenvalues coincide an iteration to the last bit may not end.
    let schur = DEFLATED.iter().find_map(|part| Schur::try_new(matrix.clone(), *part, ITERATIONS * order.max(1)))?;
    Some(schur.complex_eigenvalues().iter().map(|value| (value.re * scale, value.im * scale)).collect())
}

/// How far a lasting disturbance of one moves the states that `x = A x + disturbance` settles at, in units that suit
/// all of them best: the largest eigenvalue of the magnitudes of (1 - A)^-1. The matrix A is given column after column;
/// `None` if 1 - A is singular.
pub fn largest_response(order: usize, columns: &[f64]) -> Option<f64> {
    let rest = DMatrix::identity(order, order) - DMatrix::from_column_slice(order, order, columns);
    let magnitudes = rest.try_inverse()?.abs();
    let values = eigenvalues(order, magnitudes.as_slice())?;
    Some(values.iter().map(|(re, im)| libm::hypot(*re, *im)).fold(0.0, f64::max))
}

/// Eigenvalues of a large matrix that `product` multiplies by, estimated by Arnoldi's method with `size` vectors: the
/// outermost converge first and lie inside of the true ones. The first vector is always the same.
///
/// `None` if a number is not finite. Y. Saad, Numerical Methods for Large Eigenvalue Problems, section 6.2.
pub fn outer_eigenvalues(order: usize, size: usize, product: impl Fn(&[f64]) -> Vec<f64>) -> Option<Vec<(f64, f64)>> {
    let mut vectors = vec![start(order)];
    let mut hessenberg = DMatrix::<f64>::zeros(size + 1, size);
    let mut reached = 0;
    while reached < size {
        let mut next = DVector::from_vec(product(vectors[reached].as_slice()));
        let before = next.norm();
        if !before.is_finite() {
            return None;
        }
        // Twice, for the first pass leaves rounding errors as large as what it takes away.
        for _ in 0..2 {
            for (row, vector) in vectors.iter().enumerate() {
                let part = vector.dot(&next);
                hessenberg[(row, reached)] += part;
                next.axpy(-part, vector, 1.0);
            }
        }
        let rest = next.norm();
        hessenberg[(reached + 1, reached)] = rest;
        reached += 1;
        if rest <= DEPENDENT * before {
            break;
        }
        vectors.push(next / rest);
    }
    let square = hessenberg.view((0, 0), (reached, reached)).into_owned();
    eigenvalues(reached, square.as_slice())
}

/// A vector of length one that is not likely to lie in a subspace of any model: hashed numbers (splitmix64).
fn start(order: usize) -> DVector<f64> {
    let number = |index: usize| {
        let mut hash = (index as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((hash ^ (hash >> 31)) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    DVector::from_fn(order, |index, _| number(index)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sorted(mut values: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
        values.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        values
    }

    #[test]
    fn eigenvalues_of_a_companion_matrix_are_the_roots_of_its_polynomial() {
        // (x + 1e4)(x^2 + 2 x + 26), badly scaled.
        let [a, b, c] = [10002.0, 20026.0, 260_000.0];
        let columns = [-a, 1.0, 0.0, -b, 0.0, 1.0, -c, 0.0, 0.0];
        let found = sorted(eigenvalues(3, &columns).expect("they converge"));
        for ((re, im), (wanted_re, wanted_im)) in found.iter().zip([(-1e4, 0.0), (-1.0, -5.0), (-1.0, 5.0)]) {
            assert!((re - wanted_re).abs() < 1e-9 * 1e4 && (im - wanted_im).abs() < 1e-6, "{found:?}");
        }
    }

    #[test]
    fn a_slow_section_answers_with_the_inverse_of_its_sum() {
        // 1 - A is (0.1, -0.1; 0.1, 0.1) of which the inverse has magnitudes of 5.
        let response = largest_response(2, &[0.9, -0.1, 0.1, 0.9]).expect("regular");
        assert!((response - 10.0).abs() < 1e-9, "{response}");
        assert_eq!(largest_response(1, &[1.0]), None);
    }

    #[test]
    fn what_is_not_finite_or_zero_has_an_answer() {
        assert_eq!(eigenvalues(1, &[f64::NAN]), None);
        assert_eq!(eigenvalues(2, &[0.0; 4]), Some(vec![(0.0, 0.0); 2]));
        assert_eq!(eigenvalues(1, &[-1e-320]).map(|values| values[0].0 < 0.0), Some(true));
        assert_eq!(eigenvalues(1, &[1e300]).map(|values| values[0].0), Some(1e300));
    }

    #[test]
    fn arnoldi_finds_the_ends_of_a_long_chain() {
        // Second differences: eigenvalues -2 + 2 cos(k pi / (n + 1)).
        let order = 3000usize;
        let product = |v: &[f64]| {
            let at = |index: usize| v.get(index).copied().unwrap_or(0.0);
            (0..order).map(|i: usize| at(i.wrapping_sub(1)) - 2.0 * at(i) + at(i + 1)).collect::<Vec<f64>>()
        };
        let found = outer_eigenvalues(order, 60, product).expect("they are finite");
        let least = found.iter().map(|value| value.0).fold(0.0, f64::min);
        assert!(least > -4.0 && least < -3.98, "{least}");
        // A small space is exhausted, and then exact.
        let diagonal = [-1.0, -2.0, -7.0];
        let product = |v: &[f64]| v.iter().zip(diagonal).map(|(v, d)| v * d).collect::<Vec<f64>>();
        let found = sorted(outer_eigenvalues(3, 10, product).expect("they are finite"));
        assert!(found.iter().zip([-7.0, -2.0, -1.0]).all(|(a, b)| (a.0 - b).abs() < 1e-12), "{found:?}");
    }
}
