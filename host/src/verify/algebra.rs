//! Lengths in standard deviations, and chi-squared with unit variables that windows share.

use nalgebra::{DMatrix, Matrix3, Matrix6, Vector3};

use crate::fit::least_squares::Rows;

/// Share of the largest eigenvalue below which a direction is not seen.
const UNSEEN: f64 = 1e-9;

/// Pseudo-inverse of `A^T A`.
pub(super) fn pseudo_inverse(ways: &DMatrix<f64>) -> Matrix6<f64> {
    let square = ways.tr_mul(ways);
    let decomposed = Matrix6::from_fn(|row, column| square[(row, column)]).symmetric_eigen();
    let floor = UNSEEN * decomposed.eigenvalues.max();
    let inverse = decomposed.eigenvalues.map(|value| if value > floor { 1.0 / value } else { 0.0 });
    decomposed.eigenvectors * Matrix6::from_diagonal(&inverse) * decomposed.eigenvectors.transpose()
}

/// Length of a difference in standard deviations, root mean square over the directions that have a variance.
pub(super) fn deviation(difference: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    let decomposed = covariance.symmetric_eigen();
    let floor = UNSEEN * decomposed.eigenvalues.max();
    let (mut squares, mut count) = (0.0, 0.0);
    for (variance, direction) in decomposed.eigenvalues.iter().zip(decomposed.eigenvectors.column_iter()) {
        if *variance > floor {
            squares += direction.dot(difference).powi(2) / variance;
            count += 1.0;
        }
    }
    (squares / f64::max(count, 1.0)).sqrt()
}

/// Chi-squared of rows of unit variance, if the covariance of their parameters is `F F^T`, and its degrees of freedom: the least of
/// `|r - J F u|^2 + |u|^2`, which is the same as their part of the covariance of the readings.
pub(super) fn chi_squared(rows: &Rows, factor: &DMatrix<f64>) -> (f64, usize) {
    let derivatives = &rows.derivatives * factor;
    let square = derivatives.tr_mul(&derivatives) + DMatrix::identity(factor.ncols(), factor.ncols());
    let right = derivatives.tr_mul(&rows.residuals);
    // Positive definite: the prior is.
    let explained = square.cholesky().map_or(0.0, |square| right.dot(&square.solve(&right)));
    (rows.residuals.norm_squared() - explained, rows.degrees())
}
