//! Lengths in standard deviations, and chi-squared with unit variables that windows share.

use nalgebra::{DMatrix, Matrix3, Matrix6, Vector3};

use crate::fit::answer::FitSummary;
use crate::fit::least_squares::Rows;

/// Share of the largest eigenvalue below which a direction is not seen.
const UNSEEN: f64 = 1e-9;

/// Pseudo-inverse of `A^T A`.
pub(super) fn pseudo_inverse(ways: &DMatrix<f64>) -> Matrix6<f64> {
    let square = ways.tr_mul(ways);
    let decomposed = Matrix6::from_fn(|row, column| square[(row, column)]).symmetric_eigen();
    let floor = UNSEEN * decomposed.eigenvalues.max();
    let inverse = decomposed
        .eigenvalues
        .map(|value| if value > floor { 1.0 / value } else { 0.0 });
    decomposed.eigenvectors * Matrix6::from_diagonal(&inverse) * decomposed.eigenvectors.transpose()
}

/// Length of a difference in standard deviations, root mean square over the directions that have a
/// variance.
pub(super) fn deviation(difference: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    let decomposed = covariance.symmetric_eigen();
    let floor = UNSEEN * decomposed.eigenvalues.max();
    let mut squares = 0.0;
    let mut count = 0.0;
    for (variance, direction) in decomposed
        .eigenvalues
        .iter()
        .zip(decomposed.eigenvectors.column_iter())
    {
        if *variance > floor {
            squares += direction.dot(difference).powi(2) / variance;
            count += 1.0;
        }
    }
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Chi-squared of rows of unit variance, if the covariance of their parameters is `F F^T`: the least of `|r - J F u|^2 + |u|^2`, which is the same as their part of the
/// covariance of the readings.
pub(super) fn chi_squared(rows: &Rows, factor: &DMatrix<f64>) -> FitSummary {
    let derivatives = &rows.derivatives * factor;
    let square =
        derivatives.tr_mul(&derivatives) + DMatrix::identity(factor.ncols(), factor.ncols());
    let right = derivatives.tr_mul(&rows.residuals);
    // Positive definite: the prior is.
    let explained = square
        .cholesky()
        .map_or(0.0, |square| right.dot(&square.solve(&right)));
    FitSummary::new(rows.residuals.norm_squared() - explained, rows.degrees())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directions of which one is not seen, in any unit: the conditions of Moore and Penrose.
    #[test]
    fn a_pseudo_inverse_undoes_what_is_seen() {
        for scale in [1e-4, 1.0, 1e4] {
            let ways = DMatrix::from_fn(7, 6, |row, column| {
                // The last column is the sum of the first two.
                scale
                    * if column < 5 {
                        entry(row, column)
                    } else {
                        entry(row, 0) + entry(row, 1)
                    }
            });
            let square = ways.tr_mul(&ways);
            let inverse = pseudo_inverse(&ways);
            assert!(is_close(&(&square * inverse * &square), &square), "{scale}");
            let whole = DMatrix::from_column_slice(6, 6, inverse.as_slice());
            assert!(
                is_close(&(&whole * &square * &whole), &whole) && whole.amax() > 0.0,
                "{scale}"
            );
        }
    }

    fn entry(row: usize, column: usize) -> f64 {
        (1.7 * (7 * row + column) as f64).sin()
    }

    fn is_close(one: &DMatrix<f64>, other: &DMatrix<f64>) -> bool {
        (one - other).amax() < 1e-9 * other.amax()
    }
}
