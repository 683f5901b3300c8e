//! Weighted least squares, and the uncertainty of its answer. Knows no robot.
//!
//! Everything begins with *whitened* rows: residuals divided by their standard deviations, and
//! their derivatives by the parameters. Each parameter has a *scale*, a change of it that would
//! matter: the value itself for a spring, a tolerance for a length. Singular values of the rows in
//! these units tell what the measurements can see: `1 / s` is the standard deviation, in scales,
//! along its direction.

#![expect(
    clippy::indexing_slicing,
    reason = "rows, columns and parameters are counted by the matrices themselves"
)]

pub mod answer;
pub mod frames;
pub(crate) mod goodness;
pub mod held_directions;
pub mod least_squares;
pub mod runs;
pub mod statistics;
pub mod svd;
