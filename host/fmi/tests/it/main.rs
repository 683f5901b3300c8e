//! Units as a master uses them, without the interface in C.
#![allow(
    clippy::indexing_slicing,
    clippy::as_conversions,
    clippy::arithmetic_side_effects,
    clippy::unwrap_used,
    clippy::panic,
    missing_docs,
    reason = "tests; numbers of a few thousand"
)]

mod lockstep;
mod named;
mod refusals;
mod states;
