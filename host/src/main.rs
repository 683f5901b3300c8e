//! The command line of gantry-tau.
fn main() {}
