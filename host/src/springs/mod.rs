//! Springs of a machine from forces and gauges `[T 4.2.9, 5.2]`.
#![expect(clippy::indexing_slicing, reason = "links, axes, gauges and windows are counted by the arrays themselves")]

mod agreement;
mod beyond;
pub(crate) mod blocks;
#[cfg(test)]
mod campaigns;
pub(crate) mod choice;
pub mod compliances;
mod decision;
pub mod fit;
pub mod gauge;
pub mod identify;
pub(crate) mod lines;
pub mod loaded;
mod play;
pub(crate) mod preload;
pub(crate) mod setup;
pub mod thesis;
