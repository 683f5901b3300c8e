//! `gantry-tau bus`.

#[cfg(all(feature = "ethercat", target_os = "linux"))]
mod answer;
#[cfg(all(feature = "ethercat", target_os = "linux"))]
mod list;

use clap::{Args, Subcommand};

use super::Outcome;

/// List the devices of an EtherCAT bus
#[derive(Debug, Args)]
pub(crate) struct BusCommand {
    #[command(subcommand)]
    task: BusTask,
}

#[derive(Debug, Subcommand)]
enum BusTask {
    Scan(Scan),
}

/// List the devices of a bus: what each one speaks, and whether the server could drive it
///
/// Every device is taken to PRE-OP, read, and taken back to INIT: nothing moves, and nothing is
/// configured. End a server on this bus first: drives that are in operation stop.
///
/// The last line of a device is the verdict. For a drive that the server can drive, its entry of
/// the robot file follows, with ? where you fill in. An object that a device does not have is -;
/// one for which it gives no answer within a second is "no answer".
///
/// Exit codes: 0 the bus was read, also with nothing usable on it; 1 this program has no EtherCAT; 2 usage; 8
/// the bus cannot be read.
#[derive(Debug, Args)]
struct Scan {
    /// The network interface of the bus; emulated for one of every kind, without hardware
    #[arg(value_name = "IFACE|emulated")]
    interface: String,
    /// Print the answer as one line of JSON
    #[arg(long)]
    json: bool,
    /// Write to the PDO mapping of drives what it holds, to find out whether it can be written
    #[arg(long)]
    try_mapping: bool,
}

impl BusCommand {
    pub(super) fn run(self) -> Outcome {
        let BusTask::Scan(scan) = self.task;
        scan.run()
    }
}

#[cfg(not(all(feature = "ethercat", target_os = "linux")))]
impl Scan {
    fn run(self) -> Outcome {
        Err(super::plant::WITHOUT_ETHERCAT.into())
    }
}

#[cfg(all(feature = "ethercat", target_os = "linux"))]
impl Scan {
    fn run(self) -> Outcome {
        use std::process::ExitCode;

        use crate::terminal::say;

        match self.devices() {
            Ok(devices) if self.json => say(answer::of(&devices)),
            Ok(devices) => list::lines(&devices).iter().for_each(say),
            Err(error) => return Ok(super::fail(8, error)),
        }
        Ok(ExitCode::SUCCESS)
    }

    fn devices(&self) -> Result<Vec<gantry_tau_ethercat::scan::Device>, super::Failure> {
        use gantry_tau_ethercat::RawSocket;
        use gantry_tau_ethercat::emulation::{Chain, EmulatedWire, Kinematic, one_of_every_kind};
        use gantry_tau_ethercat::scan::{Options, scan};

        let options = Options {
            tries_mapping: self.try_mapping,
        };
        Ok(if self.interface == "emulated" {
            scan(
                EmulatedWire::new(Chain::of(one_of_every_kind(), Kinematic)),
                options,
            )?
        } else {
            scan(RawSocket::open(&self.interface)?, options)?
        })
    }
}
