//! Calibration: the geometry of a machine from measured poses `[T 3.2]`.

#![expect(
    clippy::indexing_slicing,
    reason = "arms, axes and parameters are counted by the arrays themselves"
)]

pub mod answer;
pub mod calibrate;
pub mod deviation;
pub mod f1;
pub mod l2;
pub mod parallel;
pub mod robust_fit;
