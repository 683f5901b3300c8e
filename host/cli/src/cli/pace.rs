//! `gantry-tau pace`.

use std::io;
use std::net::{Shutdown, SocketAddr};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use clap::Args;
use gantry_tau_client::pace::{self, PaceOptions, Programs};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::links::Allowed;
use gantry_tau_system::dial::Addresses;

use super::key::KeyOption;
use super::outputs::NamedInput;
use super::{MachineCommand, Outcome, address, check_reach, peer, transport};
use crate::signals;
use crate::terminal::say;

/// Most times of the pacer, ms: core takes 100 000 ticks.
const MAX_MS: u32 = 100_000;
/// Time in which a program on the standard output reads the last line.
const FAREWELL: Duration = Duration::from_secs(1);

/// Be a client of the server for a program that is slower than 1 kHz
///
/// Listens for one program at a time, which sends JSON lines:
///
///   {"mode":"submit"|"obtain","t":SECONDS,"offset_um":[..]}
///
/// t is the server's time, which comes with the lines that are sent to the program. A target is asked
/// for --latency-ms after its t, on straight lines between targets, within the server's limits.
/// Ctrl-C ends; the server ramps the offsets to zero then, and after each program. With --stdio the
/// program is the one that has started the pacer, which ends with it.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub(crate) struct Pace {
    /// Address of the server
    #[arg(default_value = "127.0.0.1:7000", value_name = "HOST:PORT", value_parser = peer)]
    server: Addresses,
    #[command(flatten)]
    key: KeyOption,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: NamedInput,
    /// UDP datagrams instead of a TCP stream; the server needs --udp as well
    #[arg(long)]
    udp: bool,
    /// Serve one program, on the standard input and output
    #[arg(long, conflicts_with_all = ["listen", "allow"])]
    stdio: bool,
    /// Address on which programs connect
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7010", value_parser = address)]
    listen: SocketAddr,
    /// Serve programs of this peer or network only (repeatable); needed for an address that is not of
    /// this machine alone
    #[arg(long, value_name = "IP|IP/BITS")]
    allow: Vec<String>,
    /// Lines to the program, per second
    #[arg(long, value_name = "HZ", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    rate: u32,
    /// Time between that of a target and when it is asked for: two periods of the program
    #[arg(long, value_name = "MS", default_value_t = 66, value_parser = clap::value_parser!(u32).range(0..=i64::from(MAX_MS)))]
    latency_ms: u32,
    /// Silence after which the targets stay where they are
    #[arg(long, value_name = "MS", default_value_t = 200)]
    hold_ms: u32,
    /// Silence after which the session is ended; not below --hold-ms
    #[arg(long, value_name = "MS", default_value_t = 1_000, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_MS)))]
    give_up_ms: u32,
}

impl MachineCommand for Pace {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        if self.hold_ms > self.give_up_ms {
            return Err("--hold-ms is above --give-up-ms".into());
        }
        let millis = |ms: u32| Duration::from_millis(ms.into());
        let options = PaceOptions {
            server: self.server,
            transport: transport(self.udp),
            key: self.key.read()?,
            kinematics_checksum: robot.checksum(),
            latency: millis(self.latency_ms),
            hold: millis(self.hold_ms),
            give_up: millis(self.give_up_ms),
            period: Duration::from_secs(1) / self.rate,
            is_hurried: false,
        };
        let quit = Arc::new(AtomicBool::new(false));
        let switch = Arc::clone(&quit);
        signals::on_quit(move || switch.store(true, Ordering::Relaxed));
        if self.stdio {
            return serve_stdio::<N>(&options, &quit);
        }
        let allowed = Allowed::only(&self.allow)?;
        check_reach(self.listen, &allowed)?;
        let mut programs = Programs::bind(self.listen, allowed)
            .map_err(|error| format!("{}: {error}", self.listen))?;
        say(format_args!(
            "waiting for a program at {}: lines as {{\"mode\":\"submit\",\"t\":0.0,\"offset_um\":[..{} numbers..]}}",
            programs.address()?,
            N
        ));
        let report = pace::run::<N>(&options, &mut programs, &quit);
        say(format_args!(
            "{} programs, {} targets, {} lines refused, {} given up as silent",
            report.programs, report.targets, report.refused, report.silent
        ));
        Ok(ExitCode::SUCCESS)
    }
}

/// Serves the program at the standard input and output, which end the session when they are closed.
fn serve_stdio<const N: usize>(options: &PaceOptions, quit: &AtomicBool) -> Outcome {
    let (mut programs, program) = Programs::one()?;
    let lines = program.try_clone()?;
    thread::Builder::new()
        .name("stdin".to_owned())
        .spawn(move || {
            let _ = io::copy(&mut io::stdin().lock(), &mut &lines);
            let _ = lines.shutdown(Shutdown::Write);
        })?;
    let (is_written, written) = mpsc::channel();
    thread::Builder::new()
        .name("stdout".to_owned())
        .spawn(move || {
            let _ = io::copy(&mut &program, &mut io::stdout().lock());
            let _ = program.shutdown(Shutdown::Both);
            let _ = is_written.send(());
        })?;
    pace::run::<N>(options, &mut programs, quit);
    // A program that does not read its last line loses it.
    let _ = written.recv_timeout(FAREWELL);
    Ok(ExitCode::SUCCESS)
}
