//! `gantry-tau faults`.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

use clap::{Args, ValueEnum};
use gantry_tau::faults::plan::{Odds, Plan, parse_script};
use gantry_tau::faults::{Direction, Ended, Fault, Medium, Tally, tcp, udp};
use gantry_tau::server::ServerError;
use gantry_tau::terminal::say;

use super::{address, fail};

/// How long to wait for an ended connection before looking for Ctrl-C again.
const LOOK: Duration = Duration::from_millis(50);

/// A link that does harm on purpose, between a client and a server: delays, losses, corrupt frames, resets
///
/// Forwards between clients that connect to it and a server, and harms what passes, until Ctrl-C; then it says how often each
/// fault acted. For instance, with a server on port 7000:
///
///   gantry-tau faults --listen 127.0.0.1:7100 --to 127.0.0.1:7000 --drop 0.01 --stall 0.001:50
///   gantry-tau client 127.0.0.1:7100
///
/// Faults meet whole frames of the protocol, at most one fault each. ODDS are `P` or `P:N`: the probability per frame, 0 to 1,
/// and the fault's number. Without N it is the one below, or drawn. The same seed and the same frames give the same faults.
///
/// A script has one line per fault: `frame N` or `ms N` (counted in each connection; `ms` means the first frame from then on),
/// then `up` (to the server), `down` or `both`, then a fault and perhaps its number. `#` begins a comment:
///
///   frame 100 up corrupt
///   ms 2500 down stall 300    # a third of a second
///
/// Exit codes: 0 ended by Ctrl-C; 1 it could not run; 2 usage.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub(crate) struct Faults {
    /// Where clients connect
    #[arg(long, value_name = "HOST:PORT", value_parser = address)]
    listen: SocketAddr,
    /// The server
    #[arg(long, value_name = "HOST:PORT", value_parser = address)]
    to: SocketAddr,
    /// Forward datagrams instead of streams
    #[arg(long)]
    udp: bool,
    /// Where every draw comes from
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Which way delay, jitter and odds apply; a script says so itself
    #[arg(
        long,
        value_name = "up|down|both",
        default_value = "both",
        hide_possible_values = true
    )]
    direction: Way,
    /// Every frame comes so much later
    #[arg(long, value_name = "MS", default_value = "0", allow_negative_numbers = true, value_parser = milliseconds)]
    delay: Duration,
    /// And by up to so much more, drawn for each; the order stays
    #[arg(long, value_name = "MS", default_value = "0", allow_negative_numbers = true, value_parser = milliseconds)]
    jitter: Duration,
    /// The frame is lost
    #[arg(long, value_name = "ODDS")]
    drop: Option<Odds>,
    /// The frame comes N times more [N: 1]
    #[arg(long, value_name = "ODDS")]
    duplicate: Option<Odds>,
    /// The frame comes N ms after its turn [N: 2]; only with --udp
    #[arg(long, value_name = "ODDS")]
    reorder: Option<Odds>,
    /// Bit N of the frame is flipped [N: drawn]
    #[arg(long, value_name = "ODDS")]
    corrupt: Option<Odds>,
    /// Only the first N bytes come [N: drawn]
    #[arg(long, value_name = "ODDS")]
    truncate: Option<Odds>,
    /// The frame comes in two pieces, the first of N bytes [N: drawn]
    #[arg(long, value_name = "ODDS")]
    split: Option<Odds>,
    /// What comes within N ms comes all at once at their end [N: 10]
    #[arg(long, value_name = "ODDS")]
    burst: Option<Odds>,
    /// The same, and the sender's buffers fill meanwhile [N: 10]
    #[arg(long, value_name = "ODDS")]
    stall: Option<Odds>,
    /// Nothing comes in that direction any more, and nobody is told
    #[arg(long, value_name = "ODDS")]
    half_open: Option<Odds>,
    /// The connection is reset at both ends; not with --udp
    #[arg(long, value_name = "ODDS")]
    reset: Option<Odds>,
    /// What happens at stated moments
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// Say it as one line of JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Way {
    Up,
    Down,
    Both,
}

/// Milliseconds, parts of one included, up to a minute.
fn milliseconds(text: &str) -> Result<Duration, &'static str> {
    let ms: f64 = text.parse().map_err(|_| "not a number")?;
    if !(0.0..=60_000.0).contains(&ms) {
        return Err("must be from 0 to 60000");
    }
    Ok(Duration::from_secs_f64(ms * 1e-3))
}

/// Either relay; what matters here is that it ends when it is dropped.
enum Relay {
    Tcp(tcp::Relay),
    Udp(udp::Relay),
}

impl Faults {
    pub(crate) fn run(self) -> ExitCode {
        match self.relay() {
            Ok(total) => {
                say(if self.json {
                    total.json()
                } else {
                    total.text()
                });
                ExitCode::SUCCESS
            }
            Err(error) => fail(1, error),
        }
    }

    fn relay(&self) -> Result<Total, Box<dyn std::error::Error>> {
        let plan = self.plan()?;
        let listen_error = |error| ServerError::listen(self.listen, &error);
        let (relay, ended) = if self.udp {
            plan.check(Medium::Datagrams)?;
            let (relay, ended) =
                udp::Relay::spawn(self.listen, self.to, plan).map_err(listen_error)?;
            (Relay::Udp(relay), ended)
        } else {
            plan.check(Medium::Stream)?;
            let (relay, ended) =
                tcp::Relay::spawn(self.listen, self.to, plan).map_err(listen_error)?;
            (Relay::Tcp(relay), ended)
        };
        let quit = Arc::new(AtomicBool::new(false));
        let shared = Arc::clone(&quit);
        ctrlc::set_handler(move || shared.store(true, Ordering::Relaxed))?;
        let address = match &relay {
            Relay::Tcp(relay) => relay.address,
            Relay::Udp(relay) => relay.address,
        };
        // With --json the answer is the only line on stdout.
        tracing::info!(
            "listening on {address}, forwarding to {}; Ctrl-C ends",
            self.to
        );
        let mut total = Total::default();
        total.count(&ended, || quit.load(Ordering::Relaxed));
        drop(relay);
        total.count(&ended, || false);
        Ok(total)
    }

    fn plan(&self) -> Result<Plan, String> {
        let odds = Fault::ALL.map(|fault| {
            let odds = match fault {
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
            odds.map(|odds| (fault, odds))
        });
        let script = match &self.script {
            Some(path) => {
                let named = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
                let text = std::fs::read_to_string(path).map_err(|error| named(&error))?;
                parse_script(&text).map_err(|error| named(&error))?
            }
            None => Vec::new(),
        };
        Ok(Plan {
            seed: self.seed,
            delay: self.delay,
            jitter: self.jitter,
            odds: odds.into_iter().flatten().collect(),
            direction: match self.direction {
                Way::Up => Some(Direction::Up),
                Way::Down => Some(Direction::Down),
                Way::Both => None,
            },
            script,
        })
    }
}

/// All connections together.
#[derive(Default)]
struct Total {
    connections: u64,
    up: Tally,
    down: Tally,
}

impl Total {
    /// Adds connections as they end, until told to stop or there will be no more.
    fn count(&mut self, ended: &Receiver<Ended>, stop: impl Fn() -> bool) {
        while !stop() {
            match ended.recv_timeout(LOOK) {
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

    /// Every fault that acted at all: up, down.
    fn acted(&self) -> impl Iterator<Item = (Fault, u64, u64)> {
        let times = |tally: &Tally, fault| tally.acted.get(&fault).map_or(0, |acted| acted.times);
        Fault::ALL
            .into_iter()
            .map(move |fault| (fault, times(&self.up, fault), times(&self.down, fault)))
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
        for (fault, up, down) in self.acted() {
            text += &format!("\n{fault:10}{up:>10} {down:>10}");
        }
        text
    }

    fn json(&self) -> String {
        let acted: serde_json::Map<_, _> = self
            .acted()
            .map(|(fault, up, down)| {
                let times = serde_json::json!({"up": up, "down": down});
                (fault.name().to_owned(), times)
            })
            .collect();
        serde_json::json!({
            "connections": self.connections,
            "frames": {"up": self.up.frames, "down": self.down.frames},
            "faults": acted,
        })
        .to_string()
    }
}
