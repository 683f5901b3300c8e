//! Springs of a machine from forces and gauges `[T 4.2.9, 5.2]`.
#![expect(clippy::indexing_slicing, reason = "links and axes are counted by the arrays themselves")]

pub mod fit;
pub mod gauge;
