//! Kani harnesses, one file per family; each hands anything there is to a property function.

mod channel;
mod wire;
