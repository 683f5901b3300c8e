//! Springs of a machine from forces and gauges `[T 4.2.9, 5.2]`.
#![expect(
    clippy::indexing_slicing,
    reason = "links, axes, gauges and windows are counted by the arrays themselves"
)]

pub(crate) mod active_set;
pub(crate) mod blocks;
mod decision;
pub mod fit;
#[cfg(test)]
pub(crate) mod fixture;
pub mod identify;
pub(crate) mod linearize;
mod play;
mod post_jump;
pub(crate) mod preload;
pub(crate) mod problem;
mod robust_fit;
pub(crate) mod setup;
mod smooth_loads;
pub(crate) mod state;
pub mod thesis;
