//! Kani harnesses, one file per family; each hands anything there is to a property function.
//!
//! The runner compiles one family at a time (`cfg(only)`): Kani translates and links every harness it finds, on every run.

#[cfg(any(not(only), only = "channel"))]
mod channel;
