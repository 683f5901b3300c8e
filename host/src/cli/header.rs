//! `gantry-tau header`.

use std::process::ExitCode;

use clap::Args;
use gantry_tau::header::{HeaderOptions, Prefix};
use gantry_tau::output::{Kind, Output};
use gantry_tau::robot_file::AnyRobotFile;
use gantry_tau::terminal::say;

use super::Outcome;
use super::outputs::{NamedInput, file};

/// Write a machine as a C header, for programs over the C interface and for LinuxCNC
///
/// Geometry, home, limits of offsets, travel, the motors of each axis, springs and force sensor, with the types of `gantry_tau.h`
/// (`host/capi`), and the checksum of the kinematics: what a server and a compensating client need.
#[derive(Debug, Args)]
pub(crate) struct Header {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(value_name = "l2|f1|FILE")]
    robot: NamedInput,
    /// Output file; an existing one is replaced
    #[arg(short, long, value_name = "FILE.h", default_value = "machine.h", value_parser = file(Kind::Header))]
    output: Output,
    /// First part of every name in the header; a program with two machines gives each its own
    #[arg(long, value_name = "NAME", default_value = "gantry_tau")]
    prefix: Prefix,
}

impl Header {
    pub(super) fn run(self) -> Outcome {
        let options =
            HeaderOptions { robot: AnyRobotFile::named(&self.robot)?, prefix: self.prefix, output: self.output };
        gantry_tau::header::run(&options)?;
        say(format_args!("{}: written to {}", &*self.robot, options.output.path().display()));
        Ok(ExitCode::SUCCESS)
    }
}
