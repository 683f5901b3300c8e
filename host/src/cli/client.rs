//! `gantry-tau client`.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use clap::Args;
use gantry_tau::client::{ClientControls, ClientOptions};
use gantry_tau::force_sensor::SensorSource;
use gantry_tau::model::MachineKind;
use gantry_tau::robot_file::RobotFile;
use gantry_tau::terminal::say;

use super::{MachineCommand, Outcome, address, fail, sensor, transport};

/// Connect to a server, compensate the measured force, leave with Ctrl-C
///
/// Connects, stays in Submit while the force sensor is tared (keep the tool unloaded), then compensates in Obtain until Ctrl-C.
///
/// Exit codes: 0 left with Goodbye; 1 setup; 3 unreachable; 4 refused; 5 incompatible server; 6 session ended by the server;
/// 7 server vanished; 8 force sensor silent.
#[derive(Debug, Args)]
pub(crate) struct Client {
    /// Address of the server
    #[arg(default_value = "127.0.0.1:7000", value_name = "HOST:PORT", value_parser = address)]
    server: SocketAddr,
    /// The force sensor: the address of the server's link, or labcomm: for a LabComm stream with a sample NAME of type float[6] or
    /// double[6] [default NAME: forcesensor]
    #[arg(long, value_name = "HOST:PORT|labcomm:HOST:PORT[/NAME]", default_value = "127.0.0.1:7001", value_parser = sensor)]
    sensor: SensorSource,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: String,
    /// UDP datagrams instead of a TCP stream; the server needs --udp as well
    #[arg(long)]
    udp: bool,
    /// Stay in Submit: offsets are computed and reported, but do not reach the drives
    #[arg(long)]
    submit_only: bool,
    /// Record references, actual values and force, one row per tick
    #[arg(long, value_name = "FILE.csv")]
    record: Option<PathBuf>,
}

impl MachineCommand for Client {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(self, robot: RobotFile<K, N>) -> Outcome {
        let controls = Arc::new(ClientControls::default());
        let shared = Arc::clone(&controls);
        ctrlc::set_handler(move || shared.quit.store(true, Ordering::Relaxed))
            .map_err(|error| format!("cannot listen for Ctrl-C: {error}"))?;
        let options = ClientOptions {
            server: self.server,
            transport: transport(self.udp),
            sensor: self.sensor,
            robot,
            record: self.record,
            obtain: !self.submit_only,
        };
        let report = match gantry_tau::client::run(&options, &controls) {
            Ok(report) => report,
            Err(error) => return Ok(fail(error.exit_code(), &error)),
        };
        say(format_args!(
            "left with Goodbye after {} ticks ({} without a correction of their own, {} with a saturated one); the server ramps the offsets to zero",
            report.states, report.held, report.saturated
        ));
        if let Some(recorded) = report.recorded {
            say(recorded);
        }
        Ok(ExitCode::SUCCESS)
    }
}
