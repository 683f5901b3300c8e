//! `gantry-tau monitor`.

use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::monitor::web::Web;
use crate::monitor::{MonitorOptions, MonitorView, Tap, run, run_page, tap};
use crate::signals;
use crate::terminal::say;
use clap::Args;
use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_record::recording::{RecordError, RecordTo, Recorded};
use gantry_tau_server::links::Allowed;
use gantry_tau_system::dial::Addresses;

use super::labcomm::LabcommVersion;
use super::outputs::NamedInput;
use super::recording::RecordLimit;
use super::{OptionError, Outcome, address, check_reach, peer};

/// Watch a server: phase, counters, axes, force and events, on the terminal, as JSON or as a page
/// that draws the machine
///
/// Reads a LabComm port of the server, opened by
/// `serve --labcomm HOST:PORT=state,axes,tool,session_event,drives,machine`. It sends nothing and
/// owns nothing. A lost server is told and tried again until Ctrl-C.
///
/// Exit codes: 0 ended. With --status, of the last line: 0 listening, handshake, submit or obtain;
/// 3 offsets ramp to zero; 4 fault; 5 the machine failed; 6 no server.
#[derive(Debug, Args)]
pub(crate) struct Monitor {
    /// Address of the server's LabComm port
    #[arg(default_value = "127.0.0.1:7003", value_name = "HOST:PORT", value_parser = peer)]
    server: Addresses,
    /// Print one line of JSON and end, instead of the screen
    #[arg(long)]
    status: bool,
    /// With --status: a line every S seconds, until Ctrl-C
    #[arg(long, value_name = "S", requires = "status", value_parser = seconds)]
    every: Option<Duration>,
    /// Serve a page for browsers instead of the screen
    #[arg(long, value_name = "HOST:PORT", conflicts_with = "status", value_parser = address)]
    web: Option<SocketAddr>,
    /// With --web: answer only this peer or network (repeatable); needed for an address that is not
    /// of this machine alone
    #[arg(long, value_name = "IP|IP/BITS", requires = "web")]
    allow: Vec<String>,
    /// The machine of a page or a recording: l2 or f1 (built in), or a robot file [default: the one
    /// that the server sends]
    #[arg(long, value_name = "l2|f1|FILE")]
    robot: Option<NamedInput>,
    /// Record every tick that is received, in the format of the extension, with the columns and
    /// samples of a recording by `serve`
    #[arg(long, value_name = "FILE.csv|FILE.labcomm|FILE.mcap")]
    record: Option<RecordTo>,
    #[command(flatten)]
    record_limit: RecordLimit,
    /// Version of LabComm in FILE.labcomm
    #[arg(
        long,
        value_name = "VERSION",
        default_value = "2014",
        requires = "record"
    )]
    labcomm_version: LabcommVersion,
    /// End after S seconds
    #[arg(long, value_name = "S", value_parser = seconds)]
    quit_after: Option<Duration>,
}

impl Monitor {
    pub(super) fn run(self) -> Outcome {
        if self.web.is_none() && self.record.is_none() {
            return self.show(None);
        }
        let robot = self.robot.as_deref().map(AnyRobotFile::named).transpose()?;
        let tap = self
            .recording()
            .map(|to| tap(to, robot.as_ref()))
            .transpose()?;
        match self.web {
            Some(address) => self.serve(address, robot, tap),
            None => self.show(tap),
        }
    }

    fn recording(&self) -> Option<RecordTo> {
        let to = self.record_limit.of(self.record.clone()?);
        Some(to.with_version(self.labcomm_version.into()))
    }

    /// Screen or lines.
    fn show(&self, tap: Option<Box<dyn Tap>>) -> Outcome {
        let quit = interrupted();
        let view = if self.status {
            MonitorView::Status { every: self.every }
        } else {
            MonitorView::Screen
        };
        let options = MonitorOptions {
            server: self.server.clone(),
            view,
            quit_after: self.quit_after,
        };
        let (code, recorded) = run(&options, tap, &quit);
        tell(recorded)?;
        Ok(code)
    }

    /// The page.
    fn serve(
        &self,
        address: SocketAddr,
        robot: Option<AnyRobotFile>,
        tap: Option<Box<dyn Tap>>,
    ) -> Outcome {
        let allowed = Allowed::only(&self.allow)?;
        check_reach(address, &allowed)?;
        let mut page = Web::bind(address, allowed, robot)
            .map_err(|error| format!("cannot serve the page on {address}: {error}"))?;
        let quit = interrupted();
        say(format_args!(
            "page on http://{}/; Ctrl-C ends",
            page.address()?
        ));
        tell(run_page(
            self.server.clone(),
            &mut page,
            tap,
            self.quit_after,
            &quit,
        ))?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Tells the outcome of a recording, beside lines of JSON.
fn tell(recorded: Option<Recorded>) -> Result<(), RecordError> {
    let Some(recorded) = recorded else {
        return Ok(());
    };
    tracing::info!("{recorded}");
    recorded.failure.map_or(Ok(()), Err)
}

/// Becomes true with Ctrl-C.
fn interrupted() -> Arc<AtomicBool> {
    let quit = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&quit);
    signals::on_quit(move || asked.store(true, Ordering::Relaxed));
    quit
}

/// A time in seconds.
fn seconds(text: &str) -> Result<Duration, OptionError> {
    match text.parse() {
        Ok(seconds) if (0.01..=1e6).contains(&seconds) => Ok(Duration::from_secs_f64(seconds)),
        _ => Err("expected from 0.01 to 1000000 seconds".into()),
    }
}
