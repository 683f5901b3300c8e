//! Newton's method for two and three unknowns.

use nalgebra::Vector3;

use crate::model::block_solve::Inverse;
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, SINGULARITY_TOLERANCE};
use crate::model::lu::Lu;

/// Equations, evaluated: errors (metres), and their derivatives (row per error, metres per unit).
pub(super) struct Equations<const K: usize> {
    pub(super) errors_m: [f64; K],
    pub(super) rows: [[f64; K]; K],
}

/// Solve for the unknowns that remove the errors to first order; `None` near a singularity, and for NaN.
pub(super) trait Solve<const K: usize> {
    fn solve(&self) -> Option<[f64; K]>;
}

impl Solve<2> for Equations<2> {
    #[inline]
    fn solve(&self) -> Option<[f64; 2]> {
        let ([[a, b], [c, d]], [e1, e2]) = (self.rows, self.errors_m);
        let determinant = a * d - b * c;
        let lengths_squared = (a * a + b * b) * (c * c + d * d);
        let least_squared = SINGULARITY_TOLERANCE * SINGULARITY_TOLERANCE * lengths_squared;
        let scale = 1.0 / determinant;
        (determinant * determinant > least_squared).then_some([(d * e1 - b * e2) * scale, (a * e2 - c * e1) * scale])
    }
}

impl Solve<3> for Equations<3> {
    #[inline]
    fn solve(&self) -> Option<[f64; 3]> {
        let rows = self.rows.map(Vector3::from);
        let inverse = Inverse::of_rows(rows.each_ref())?;
        Some(inverse.times(self.errors_m).into())
    }
}

/// Returns unknowns for which every error is at most `converged_m`, or those after [`COLD_ITERATIONS`] solves, and the solves made.
/// The caller checks them.
///
/// `place` computes the quantities that the equations share, and `placed` are those of `start`.
pub(super) fn newton<P, const K: usize>(
    start: [f64; K],
    placed: P,
    converged_m: f64,
    place: impl Fn(&[f64; K]) -> P,
    evaluate: impl Fn(&[f64; K], &P) -> Equations<K>,
) -> Result<([f64; K], u8), KinematicsError>
where
    Equations<K>: Solve<K>,
{
    let (mut unknowns, mut placed) = (start, placed);
    for made in 0..COLD_ITERATIONS {
        let equations = evaluate(&unknowns, &placed);
        // Not true for NaN, which the factors then refuse.
        if (equations.errors_m.iter()).all(|error| error.abs() <= converged_m) {
            return Ok((unknowns, made));
        }
        let step = match equations.solve() {
            Some(step) => step,
            None => by_pivots(&equations)?,
        };
        for (unknown, change) in unknowns.iter_mut().zip(step) {
            *unknown -= change;
        }
        placed = place(&unknowns);
    }
    Ok((unknowns, COLD_ITERATIONS))
}

/// Pivoting solve, where the determinant is small.
#[cold]
#[inline(never)]
fn by_pivots<const K: usize>(equations: &Equations<K>) -> Result<[f64; K], KinematicsError> {
    Ok(Lu::factor(&equations.rows)?.solve(&equations.errors_m))
}
