//! Lengths in standard deviations, and chi-squared with unit variables that windows share.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3};

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

/// Chi-squared of all readings, and its degrees of freedom. The unit variables are estimated along with their prior, which is the same as
/// their part of the covariance: those of a mounting series by series, the `shared` ones over all.
pub(super) fn chi_squared(series: &[Rows], shared: usize) -> (f64, usize) {
    let mut normal = DMatrix::identity(shared, shared);
    let mut right = DVector::zeros(shared);
    let (mut squares, mut degrees) = (0.0, 0);
    for rows in series {
        let (residuals, own) = (&rows.residuals, rows.derivatives.columns(0, shared));
        let mounted = rows.derivatives.columns(shared, rows.derivatives.ncols() - shared);
        let (by_own, by_residuals) = (mounted.tr_mul(&own), mounted.tr_mul(residuals));
        let square = mounted.tr_mul(&mounted) + DMatrix::identity(mounted.ncols(), mounted.ncols());
        degrees += rows.degrees();
        normal += own.tr_mul(&own);
        right += own.tr_mul(residuals);
        squares += residuals.norm_squared();
        // Positive definite: the prior is.
        let Some(factor) = square.cholesky() else { continue };
        let eliminated = factor.solve(&by_residuals);
        normal -= by_own.tr_mul(&factor.solve(&by_own));
        right -= by_own.tr_mul(&eliminated);
        squares -= by_residuals.dot(&eliminated);
    }
    let explained = normal.cholesky().map_or(0.0, |factor| right.dot(&factor.solve(&right)));
    (squares - explained, degrees)
}
