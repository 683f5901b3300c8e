//! Kani harnesses, one file per family; each hands anything there is to a property function.
//!
//! Every assumption is followed by a cover, and every harness ends with one: what cannot be reached proves nothing.

mod axis;
mod blackbox;
mod channel;
mod decide;
mod motors;
mod session;
mod sift;
mod total;
