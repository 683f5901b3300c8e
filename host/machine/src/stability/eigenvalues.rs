//! Eigenvalues of general matrices.

use nalgebra::linalg::Schur;
use nalgebra::linalg::balancing::balance_parlett_reinsch;
use nalgebra::{Complex, ComplexField, DMatrix};

/// Largest number of iterations.
const MAX_ITERATIONS: usize = 100_000;

/// Returns the eigenvalues of a real matrix; `None` if they are not found, or an entry is not
/// finite, which balancing would not end with.
pub(super) fn of_real(mut matrix: DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    if !matrix.iter().all(|entry| entry.is_finite()) {
        return None;
    }
    // Metres beside newtons: without equal norms of rows and columns digits are lost.
    balance_parlett_reinsch(&mut matrix);
    let schur = Schur::try_new(matrix, f64::EPSILON, MAX_ITERATIONS)?;
    Some(schur.complex_eigenvalues().iter().copied().collect())
}

/// Returns the largest magnitude of an eigenvalue of a complex matrix; `None` if they are not
/// found.
pub(super) fn spectral_radius(matrix: DMatrix<Complex<f64>>) -> Option<f64> {
    let (_, triangle) = Schur::try_new(matrix, f64::EPSILON, MAX_ITERATIONS)?.unpack();
    let radius = triangle
        .diagonal()
        .iter()
        .fold(0.0, |most: f64, value| most.max(value.modulus()));
    radius.is_finite().then_some(radius)
}
