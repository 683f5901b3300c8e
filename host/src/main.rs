//! The command line of gantry-tau.
#![forbid(unsafe_code)]
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests write files of their own"))]
#![deny(clippy::print_stdout, clippy::print_stderr, reason = "they panic when the stream fails: use `terminal`")]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
