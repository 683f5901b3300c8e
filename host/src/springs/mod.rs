//! Springs of a machine from forces and gauges `[T 4.2.9, 5.2]`.
#![expect(clippy::indexing_slicing, reason = "links, axes, gauges and windows are counted by the arrays themselves")]

mod agreement;
mod beyond;
mod blocks;
#[cfg(test)]
mod campaigns;
mod choice;
pub mod fit;
pub mod gauge;
pub mod identify;
mod lines;
mod play;
mod setup;
