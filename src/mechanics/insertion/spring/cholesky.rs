//! The small dense system of needle and nodes, without allocations.

/// Solves a symmetric positive definite system in place: `matrix` holds its rows (the lower triangle is read, and replaced by
/// the factor), `right` the right side and then the solution.
pub(super) fn solve(matrix: &mut [f64], right: &mut [f64]) {
    let count = right.len();
    for row in 0..count {
        for column in 0..=row {
            let entry = matrix[row * count + column];
            let mut sum = entry;
            for k in 0..column {
                sum -= matrix[row * count + k] * matrix[column * count + k];
            }
            matrix[row * count + column] = match row == column {
                // The flexibility is semidefinite and the diagonal adds to it: below 0 is rounding.
                true => sum.max(entry * f64::EPSILON).sqrt(),
                false => sum / matrix[column * count + column],
            };
        }
    }
    for row in 0..count {
        for k in 0..row {
            right[row] -= matrix[row * count + k] * right[k];
        }
        right[row] /= matrix[row * count + row];
    }
    for row in (0..count).rev() {
        for k in row + 1..count {
            right[row] -= matrix[k * count + row] * right[k];
        }
        right[row] /= matrix[row * count + row];
    }
}
