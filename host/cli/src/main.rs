//! The command line of gantry-tau.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    gantry_tau::main()
}
