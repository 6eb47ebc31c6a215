//! Cholesky's factor of a symmetric matrix that is positive definite, and solutions with it.

/// Puts the factor below the diagonal of a symmetric matrix, row by row, in its place.
///
/// # Errors
/// The row whose pivot is not above a part of what it was; the pivot is in its place.
pub fn factor(matrix: &mut [f64], part: f64) -> Result<(), usize> {
    let size = libm::round(libm::sqrt(matrix.len() as f64)) as usize;
    for row in 0..size {
        for column in 0..=row {
            let before: f64 = (0..column).map(|k| matrix[row * size + k] * matrix[column * size + k]).sum();
            let rest = matrix[row * size + column] - before;
            if column < row {
                matrix[row * size + column] = rest / matrix[column * size + column];
                continue;
            }
            let whole = matrix[row * size + row].abs();
            matrix[row * size + row] = rest;
            if rest.is_nan() || rest <= part * whole {
                return Err(row);
            }
            matrix[row * size + row] = libm::sqrt(rest);
        }
    }
    Ok(())
}

/// Solves with a factor of [`factor`]: the right side becomes the solution.
pub fn solve(factor: &[f64], right: &mut [f64]) {
    let size = right.len();
    for row in 0..size {
        let known: f64 = (0..row).map(|k| factor[row * size + k] * right[k]).sum();
        right[row] = (right[row] - known) / factor[row * size + row];
    }
    for row in (0..size).rev() {
        let known: f64 = (row + 1..size).map(|k| factor[k * size + row] * right[k]).sum();
        right[row] = (right[row] - known) / factor[row * size + row];
    }
}
