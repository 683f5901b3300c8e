//! Newton's method for two and three unknowns.

use nalgebra::Vector3;

use crate::model::block_solve::Inverse;
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, SINGULARITY_TOLERANCE};
use crate::model::lu::Lu;
use crate::zip::zip;

/// Equations, evaluated: errors, and their derivatives (row per error).
pub(super) struct Equations<const K: usize> {
    errors: [f64; K],
    rows: [[f64; K]; K],
}

/// Answer of the iteration, not yet checked.
pub(super) struct Answer<W, const K: usize> {
    pub(super) unknowns: [f64; K],
    /// Links at the unknowns, metres.
    pub(super) links_m: W,
    /// Linear solves made.
    pub(super) made: u8,
}

/// Solve for the unknowns that remove the errors to first order; `None` near a singularity, and for
/// NaN.
pub(super) trait Solve<const K: usize> {
    fn solve(&self) -> Option<[f64; K]>;
}

impl Solve<2> for Equations<2> {
    #[inline]
    fn solve(&self) -> Option<[f64; 2]> {
        let ([[a, b], [c, d]], [e1, e2]) = (self.rows, self.errors);
        let determinant = a * d - b * c;
        let lengths_squared = (a * a + b * b) * (c * c + d * d);
        let least_squared = SINGULARITY_TOLERANCE * SINGULARITY_TOLERANCE * lengths_squared;
        let scale = 1.0 / determinant;
        (determinant * determinant > least_squared)
            .then_some([(d * e1 - b * e2) * scale, (a * e2 - c * e1) * scale])
    }
}

impl Solve<3> for Equations<3> {
    #[inline]
    fn solve(&self) -> Option<[f64; 3]> {
        let rows = self.rows.map(Vector3::from);
        let inverse = Inverse::of_rows(rows.each_ref())?;
        Some(inverse.times(self.errors).into())
    }
}

/// Returns unknowns for which every error is at most its `settled`, or those after
/// [`COLD_ITERATIONS`] solves. The caller checks them.
///
/// `place` places the plates, and `placed` is where they start; `measure` returns the links and
/// their errors; `rows` the derivatives of the errors, which the last round does not need.
pub(super) fn newton<P, W, const K: usize>(
    start: [f64; K],
    placed: P,
    settled: &[f64; K],
    place: impl Fn(&[f64; K]) -> P,
    measure: impl Fn(&[f64; K], &P) -> (W, [f64; K]),
    rows: impl Fn(&P, &W) -> [[f64; K]; K],
) -> Result<Answer<W, K>, KinematicsError>
where
    Equations<K>: Solve<K>,
{
    let (mut unknowns, mut placed, mut made) = (start, placed, 0);
    loop {
        let (links_m, errors) = measure(&unknowns, &placed);
        // Not true for NaN, which the factors then refuse.
        if made == COLD_ITERATIONS
            || zip(&errors, settled).all(|(error, most)| error.abs() <= *most)
        {
            return Ok(Answer {
                unknowns,
                links_m,
                made,
            });
        }
        let equations = Equations {
            errors,
            rows: rows(&placed, &links_m),
        };
        let step = match equations.solve() {
            Some(step) => step,
            None => by_pivots(&equations)?,
        };
        for (unknown, change) in unknowns.iter_mut().zip(step) {
            *unknown -= change;
        }
        placed = place(&unknowns);
        made = made.saturating_add(1);
    }
}

/// Pivoting solve, where the determinant is small.
#[cold]
#[inline(never)]
fn by_pivots<const K: usize>(equations: &Equations<K>) -> Result<[f64; K], KinematicsError> {
    Ok(Lu::factor(&equations.rows)?.solve(&equations.errors))
}
