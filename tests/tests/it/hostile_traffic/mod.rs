//! Hostile traffic over a real socket. Whatever arrives, the references that the machine is written obey DESIGN 4:
//! the first miss holds, from the second on positions fall by exactly 100 nm per tick, and nobody is let in before zero.
//! (The server asserts the bounds in every tick; the tests say what must happen beside that.)
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

mod content;
mod endings;
mod exhaustion;
mod frames;
mod hellos;
mod machine;
mod non_owners;

/// Offsets to fall from: 124 ticks, with rests; 71 ticks; one.
const AT: [i32; 3] = [12_345, -7_050, 30];
