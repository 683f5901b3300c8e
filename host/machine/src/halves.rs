//! Vectors of two halves: force and moment, or linear and angular.

use nalgebra::{Vector3, Vector6};

/// Returns the halves.
pub(crate) fn halves(both: &Vector6<f64>) -> [Vector3<f64>; 2] {
    [0, 3].map(|row| both.fixed_rows::<3>(row).into_owned())
}

/// Returns both in one vector.
pub(crate) fn joined(first: &Vector3<f64>, second: &Vector3<f64>) -> Vector6<f64> {
    let mut both = Vector6::zeros();
    both.fixed_rows_mut::<3>(0).copy_from(first);
    both.fixed_rows_mut::<3>(3).copy_from(second);
    both
}
