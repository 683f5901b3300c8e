//! `gantry-tau follow`.

mod comparison;

use std::process::ExitCode;

use crate::terminal::say;
use clap::Args;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::{Kind, Output};

use super::outputs::{NamedInput, file};
use super::{MachineCommand, Outcome};
use comparison::{FollowOptions, Latency};

/// Compare position loops in the drives and outside of them, on the simulated machine; a table and
/// follow.html
///
/// Takes the carts to 0.5 m/s with the position loop in the drive, and with the server's own loop
/// for drives that take velocities (`drives.interface = "velocity"`): without feed-forward, with
/// velocity feed-forward, with torque feed-forward. Then a force step.
///
/// The loop outside follows as closely as the one in the drive, once each measurement is compared
/// with the reference that belongs to it. It costs stiffness: a force step moves a cart 1.1 to 1.7
/// times as far, for up to twice as long. Move the loop out for following; leave it in for
/// compensating, unless the drive has no other way.
#[derive(Debug, Args)]
pub(crate) struct Follow {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: NamedInput,
    /// Latency of the drives that the page shows: cycles from a command to its effect, and from a
    /// measurement to its report, 0 to 5
    #[arg(long, value_name = "D,U", default_value = "1,1")]
    delay: Latency,
    /// Path of the page
    #[arg(long, value_name = "FILE.html", default_value = "follow.html", value_parser = file(Kind::Page))]
    report: Output,
    /// Write the numbers as JSON as well
    #[arg(long, value_name = "FILE", value_parser = file(Kind::Answer))]
    json: Option<Output>,
}

impl MachineCommand for Follow {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        let options = FollowOptions {
            robot,
            latency: self.delay,
            report: self.report,
            json: self.json,
        };
        let table = comparison::run::<K, N, M>(&options)?;
        say(format_args!(
            "{table}\npage: {}",
            options.report.path().display()
        ));
        Ok(ExitCode::SUCCESS)
    }
}
