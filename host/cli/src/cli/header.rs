//! `gantry-tau header`.

use std::process::ExitCode;

use crate::header::{HeaderOptions, Prefix};
use crate::terminal::say;
use clap::Args;
use gantry_tau_system::output::{Kind, Output};

use super::Outcome;
use super::machine::MachineOption;
use super::outputs::file;

/// Write a machine as a C header, for programs over the C interface and for LinuxCNC
///
/// Geometry, home, limits of offsets, travel, the motors of each axis, springs and force sensor,
/// with the types of `gantry_tau.h` (`host/capi`), and the checksum of the kinematics: what a
/// server and a compensating client need.
#[derive(Debug, Args)]
pub(crate) struct Header {
    #[command(flatten)]
    machine: MachineOption,
    /// Output file; an existing one is replaced
    #[arg(short, long, value_name = "FILE.h", default_value = "machine.h", value_parser = file(Kind::Header))]
    output: Output,
    /// First part of every name in the header; a program with two machines gives each its own
    #[arg(long, value_name = "NAME", default_value = "gantry_tau")]
    prefix: Prefix,
}

impl Header {
    pub(super) fn run(self) -> Outcome {
        let options = HeaderOptions {
            robot: self.machine.read()?,
            prefix: self.prefix,
            output: self.output,
        };
        crate::header::run(&options)?;
        say(format_args!(
            "{}: written to {}",
            self.machine.name(),
            options.output.path().display()
        ));
        Ok(ExitCode::SUCCESS)
    }
}
