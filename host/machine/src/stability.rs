//! Stability of the compensation on a machine with mass.
//!
//! The force sensor between platform and tool reads the tool's inertia too. The compensation turns
//! that into offsets, the drives into motion, and the springs into accelerations: a loop, in free
//! air as well. Per cycle, with the reading `y`, the map `P` of a compensator of first order, the
//! filter `F` and `d` cycles from a reading to its reference,
//!
//! ```text
//! z' = A z + B_1 r_previous + B_2 r_current,   y = H z,   r = P F(y), d cycles late
//! L(w) = P H (e^jw - A)^-1 (B_2 + B_1 e^-jw) F(e^jw) e^(-j w d)
//! ```
//!
//! | module | contents |
//! |---|---|
//! | [`filter`] | filters of the load |
//! | [`linear_machine`] | a machine about one place: matrices of its motion |
//! | [`tick_map`] | its motion over one cycle, with its drives |
//! | [`closed_loop`] | growth of the closed loop |
//! | [`loop_gain`] | margin against any phase of the loop |
//! | [`filter_kind`] | what a kind of filter is in one place |
//! | [`notch_finder`] | notches of a compensation for the places of a machine |
//! | [`design`] | choice of a filter, and of the largest tool |
//! | [`survey`] | stability over the reach of a machine |
#![expect(
    clippy::indexing_slicing,
    reason = "off the reference path: floats cannot panic, matrices have the sizes of their machine"
)]

pub mod closed_loop;
pub mod design;
mod eigenvalues;
pub mod filter;
pub mod filter_kind;
pub mod linear_machine;
pub mod loop_gain;
pub mod notch_finder;
pub mod survey;
pub mod tick_map;

pub use closed_loop::{Growth, Loop};
pub use filter::Filter;
pub use filter_kind::FilterKind;
pub use linear_machine::{Contact, LinearMachine};
pub use loop_gain::{LoopGain, LoopResponse, Margin};
pub use notch_finder::{NotchFinder, Notches};
pub use survey::{Compensation, Place, StabilitySurvey};
pub use tick_map::{DriveKind, TickMap};

#[cfg(test)]
mod tests;
