//! Newton's method for a few unknowns.

use super::KinematicsError;
use crate::linalg::Lu;

/// How an iteration ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    /// Linear solves at most.
    pub(super) iterations: u8,
    /// Error below which another step would only stir the rounding, metres.
    pub(super) converged_m: f64,
}

/// Unknowns for which every error is as small as rounding allows, or the last ones within the cap, and the solves made.
/// Whether they are good enough is the caller's business.
///
/// `evaluate` gives the errors (metres) at some unknowns, and their derivatives (row per error, metres per unit).
pub(super) fn newton<const K: usize>(
    start: [f64; K],
    rule: &Rule,
    evaluate: impl Fn(&[f64; K]) -> ([f64; K], [[f64; K]; K]),
) -> Result<([f64; K], u8), KinematicsError> {
    let mut unknowns = start;
    for made in 0..rule.iterations {
        let (errors, derivatives) = evaluate(&unknowns);
        // Not true for NaN, which the factors then refuse.
        if errors.iter().all(|error| error.abs() <= rule.converged_m) {
            return Ok((unknowns, made));
        }
        let step = Lu::factor(&derivatives)?.solve(&errors);
        for (unknown, change) in unknowns.iter_mut().zip(step) {
            *unknown -= change;
        }
    }
    Ok((unknowns, rule.iterations))
}
