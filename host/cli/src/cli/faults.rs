//! `gantry-tau faults`.

use std::net::SocketAddr;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use crate::faults::plan::{Directions, FaultPlan, FaultRate, read_script};
use crate::faults::relay::{LinkReport, Relay};
use crate::faults::{Fault, FaultStats};
use crate::signals;
use crate::terminal::say;
use clap::Args;
use gantry_tau_server::server::ServerError;
use gantry_tau_system::dial::Addresses;

use super::outputs::InputFile;
use super::{Failure, Outcome, address, peer, transport};

/// Longest wait for an ended connection before looking for Ctrl-C.
const POLL: Duration = Duration::from_millis(50);

/// Inject faults between a client and a server: delay, loss, corruption, stalls, resets
///
/// Forwards between clients and a server and injects faults, until Ctrl-C; then prints how often each fault occurred.
/// Example, with a server on port 7000:
///
///   gantry-tau faults --listen 127.0.0.1:7100 --to 127.0.0.1:7000 --drop 0.01 --stall 0.001:50
///   gantry-tau client 127.0.0.1:7100
///
/// Faults act on whole frames of the protocol, at most one per frame. RATE is `P` or `P:N`: the probability per frame, 0 to 1,
/// and the parameter of the fault. The default of N is given below. The same seed and the same frames give the same faults.
///
/// A script is a TOML file with one entry per fault. `at_frame` and `at_ms` count in each connection; `at_ms` means the first
/// frame from then on. `direction` is "up" (to the server), "down" or "both"; `parameter` is optional:
///
///   [[fault]]
///   at_frame = 100        # or: at_ms = 2500
///   direction = "up"
///   kind = "corrupt"
///   parameter = 17
///
/// Exit codes: 0 ended by Ctrl-C; 1 could not run; 2 usage.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub(crate) struct Faults {
    /// Address to which clients connect
    #[arg(long, value_name = "HOST:PORT", value_parser = address)]
    listen: SocketAddr,
    /// Address of the server
    #[arg(long, value_name = "HOST:PORT", value_parser = peer)]
    to: Addresses,
    /// Forward UDP datagrams instead of TCP streams
    #[arg(long)]
    udp: bool,
    /// Seed of every random draw
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Directions to which delay, jitter and rates apply (scripted faults state their own)
    #[arg(long, value_name = "up|down|both", default_value = "both")]
    direction: Directions,
    /// Delay of every frame
    #[arg(long, value_name = "MS", default_value = "0", allow_negative_numbers = true, value_parser = milliseconds)]
    delay: Duration,
    /// Largest additional delay, drawn for each frame; the order stays
    #[arg(long, value_name = "MS", default_value = "0", allow_negative_numbers = true, value_parser = milliseconds)]
    jitter: Duration,
    /// The frame is lost
    #[arg(long, value_name = "RATE")]
    drop: Option<FaultRate>,
    /// N additional copies of the frame arrive [N: 1]
    #[arg(long, value_name = "RATE")]
    duplicate: Option<FaultRate>,
    /// The frame arrives N ms late, after its successors [N: 2]; only with --udp
    #[arg(long, value_name = "RATE")]
    reorder: Option<FaultRate>,
    /// Bit N of the frame is flipped [N: drawn]
    #[arg(long, value_name = "RATE")]
    corrupt: Option<FaultRate>,
    /// Only the first N bytes arrive [N: drawn]
    #[arg(long, value_name = "RATE")]
    truncate: Option<FaultRate>,
    /// The frame arrives in two pieces, the first of N bytes [N: drawn]
    #[arg(long, value_name = "RATE")]
    split: Option<FaultRate>,
    /// All frames of the next N ms arrive together at their end [N: 10]
    #[arg(long, value_name = "RATE")]
    burst: Option<FaultRate>,
    /// As burst; meanwhile the sender's buffers fill [N: 10]
    #[arg(long, value_name = "RATE")]
    stall: Option<FaultRate>,
    /// Nothing passes in this direction any more, closing the connection included
    #[arg(long, value_name = "RATE")]
    half_open: Option<FaultRate>,
    /// The connection is reset at both ends; not with --udp
    #[arg(long, value_name = "RATE")]
    reset: Option<FaultRate>,
    /// Scripted faults, see above
    #[arg(long, value_name = "FILE")]
    script: Option<InputFile>,
    /// Print the counts as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Milliseconds up to a minute, with decimals.
fn milliseconds(text: &str) -> Result<Duration, &'static str> {
    let ms: f64 = text.parse().map_err(|_| "not a number")?;
    if !(0.0..=60_000.0).contains(&ms) {
        return Err("must be from 0 to 60000");
    }
    Ok(Duration::from_secs_f64(ms * 1e-3))
}

impl Faults {
    pub(crate) fn run(self) -> Outcome {
        let plan = self.plan()?;
        let transport = transport(self.udp);
        plan.check(transport)?;
        let (relay, ended) = Relay::spawn(self.listen, self.to.clone(), transport, plan)
            .map_err(|error| ServerError::listen(self.listen, &error))?;
        let quit = Arc::new(AtomicBool::new(false));
        let shared = Arc::clone(&quit);
        signals::on_quit(move || shared.store(true, Ordering::Relaxed));
        // With --json the counts are the only line on stdout.
        let address = relay.address;
        let to = &self.to;
        tracing::info!("listening on {address}, forwarding to {to}; Ctrl-C ends");
        let mut total = Total::default();
        total.count(&ended, || quit.load(Ordering::Relaxed));
        drop(relay);
        total.count(&ended, || false);
        say(if self.json {
            total.json()
        } else {
            total.text()
        });
        Ok(ExitCode::SUCCESS)
    }

    fn plan(&self) -> Result<FaultPlan, Failure> {
        let rates = Fault::ALL.map(|fault| {
            let rate = match fault {
                Fault::Drop => self.drop,
                Fault::Duplicate => self.duplicate,
                Fault::Reorder => self.reorder,
                Fault::Corrupt => self.corrupt,
                Fault::Truncate => self.truncate,
                Fault::Split => self.split,
                Fault::Burst => self.burst,
                Fault::Stall => self.stall,
                Fault::HalfOpen => self.half_open,
                Fault::Reset => self.reset,
            };
            rate.map(|rate| (fault, rate))
        });
        let script = match &self.script {
            Some(path) => {
                read_script(path).map_err(|error| format!("{}: {error}", path.display()))?
            }
            None => Vec::new(),
        };
        Ok(FaultPlan {
            seed: self.seed,
            delay: self.delay,
            jitter: self.jitter,
            rates: rates.into_iter().flatten().collect(),
            direction: self.direction,
            script,
        })
    }
}

/// Sum over all connections.
#[derive(Default)]
struct Total {
    connections: u64,
    up: FaultStats,
    down: FaultStats,
}

impl Total {
    /// Adds connections as they end, until `stop` or until the relay is gone.
    fn count(&mut self, ended: &Receiver<LinkReport>, stop: impl Fn() -> bool) {
        while !stop() {
            match ended.recv_timeout(POLL) {
                Ok(ended) => {
                    let (up, down) = (ended.up.frames, ended.down.frames);
                    tracing::info!("{}: ended after {up} frames up, {down} down", ended.peer);
                    self.connections = self.connections.saturating_add(1);
                    self.up.add(&ended.up);
                    self.down.add(&ended.down);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// Every fault that occurred, with its counts up and down.
    fn occurred(&self) -> impl Iterator<Item = (Fault, u64, u64)> {
        Fault::ALL
            .into_iter()
            .map(|fault| (fault, self.up.times(fault), self.down.times(fault)))
            .filter(|(_, up, down)| *up > 0 || *down > 0)
    }

    fn text(&self) -> String {
        let mut text = format!(
            "{} connections\n{:>20} {:>10}\n",
            self.connections, "up", "down"
        );
        text += &format!(
            "{:10}{:>10} {:>10}",
            "frames", self.up.frames, self.down.frames
        );
        for (fault, up, down) in self.occurred() {
            text += &format!("\n{fault:10}{up:>10} {down:>10}");
        }
        text
    }

    fn json(&self) -> String {
        let faults: serde_json::Map<_, _> = self
            .occurred()
            .map(|(fault, up, down)| {
                (
                    fault.to_string(),
                    serde_json::json!({"up": up, "down": down}),
                )
            })
            .collect();
        serde_json::json!({
            "connections": self.connections,
            "frames": {"up": self.up.frames, "down": self.down.frames},
            "faults": faults,
        })
        .to_string()
    }
}
