//! Weighted least squares, and what may be said about its answer. Knows no robot.
//!
//! Everything begins with *whitened* rows: residuals divided by their standard deviations, and their derivatives by the parameters.
//! Each parameter has a *scale*, a change of it that would matter: the value itself for a spring, a tolerance for a length. Singular values of
//! the rows in these units tell what the measurements can see: `1 / s` is the standard deviation, in scales, along its direction.

#![expect(clippy::indexing_slicing, reason = "rows, columns and parameters are counted by the matrices themselves")]

pub mod answer;
pub(crate) mod goodness;
pub mod held;
pub mod least_squares;
pub mod runs;
pub mod statistics;
pub mod svd;
