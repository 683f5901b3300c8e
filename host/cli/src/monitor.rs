//! `monitor`: a live view of a server, as a terminal screen, as JSON, or as a page in a browser.
//!
//! It reads a LabComm port of the server (`serve --labcomm`), sends nothing and owns nothing.

mod assembly;
mod machine;
mod recorded;
mod run;
mod sample_types;
mod screen;
mod snapshot;
mod stream;
pub mod web;

use std::collections::VecDeque;
use std::time::{Duration, Instant, SystemTime};

use gantry_tau_core::control::message::Cause;
use gantry_tau_record::recording::Recorded;
use gantry_tau_system::dial::Addresses;

pub use assembly::ReceivedTick;
pub use machine::{MachineName, ServerMachine};
pub use recorded::{Tap, tap};
pub use run::{MonitorOptions, MonitorView, run, run_page};
pub use snapshot::{AxisSnapshot, Channels, Counters, NO_SERVER, Snapshot};
use stream::Stream;
pub use stream::{Happened, SAMPLES, StreamError};

/// Pause between two attempts to reach a server.
const RETRY: Duration = Duration::from_millis(500);
/// Silence of a connected server after which it counts as lost; one in lock-step has a tick per
/// second at least.
const SILENCE: Duration = Duration::from_secs(3);
/// Events that are kept.
const EVENTS: usize = 50;

/// Event of a server, or of the connection, with the time at which it was received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LoggedEvent {
    /// Number of the event, from 1.
    pub number: u64,
    /// Time of day of this computer, UTC.
    pub at: SystemTime,
    /// Tick, and description.
    pub text: String,
}

/// Reader of one server, which reconnects.
pub struct ServerMonitor {
    server: Addresses,
    stream: Option<Stream>,
    /// Time of the next attempt.
    retry: Instant,
    heard: Instant,
    snapshot: Option<Snapshot>,
    trouble: Option<StreamError>,
    events: VecDeque<LoggedEvent>,
    count: u64,
    tap: Option<Box<dyn Tap>>,
}

impl ServerMonitor {
    /// Monitor of a server, which is not yet connected.
    #[must_use]
    pub fn of(server: impl Into<Addresses>) -> Self {
        let server = server.into();
        let now = Instant::now();
        Self {
            server,
            stream: None,
            retry: now,
            heard: now,
            snapshot: None,
            trouble: None,
            events: VecDeque::new(),
            count: 0,
            tap: None,
        }
    }

    /// Hands what is received to a tap.
    #[must_use]
    pub fn with_tap(self, tap: Option<Box<dyn Tap>>) -> Self {
        Self { tap, ..self }
    }

    /// True if what is received is handed to a tap.
    fn has_tap(&self) -> bool {
        self.tap.is_some()
    }

    /// Completes the recording of the tap, if there is one.
    pub fn finish(self) -> Option<Recorded> {
        self.tap.and_then(Tap::finish)
    }

    /// Addresses of the server.
    #[must_use]
    pub const fn server(&self) -> &Addresses {
        &self.server
    }

    /// Reads what has come; connects if there is no connection, at most every half second.
    pub fn update(&mut self) {
        if let Err(error) = self.receive() {
            self.stream = None;
            self.retry = Instant::now() + RETRY;
            // One that lasts is noted once.
            if self.trouble != Some(error) {
                self.note(error.to_string());
                self.trouble = Some(error);
            }
        }
    }

    fn receive(&mut self) -> Result<(), StreamError> {
        let mut stream = match self.stream.take() {
            Some(stream) => stream,
            None if Instant::now() < self.retry => return Ok(()),
            None => {
                self.heard = Instant::now();
                let stream = Stream::connect(&self.server)?;
                if let Some(tap) = &mut self.tap {
                    tap.connected();
                }
                stream
            }
        };
        let mut happened = Vec::new();
        let received = stream.receive(&mut happened, &mut self.tap);
        for Happened { tick, text, .. } in happened {
            self.note(format!("tick {tick}: {text}"));
        }
        if received? > 0 {
            self.heard = Instant::now();
        }
        if let Some(snapshot) = stream.snapshot()? {
            if self.trouble.take().is_some() || self.snapshot.is_none() {
                self.note(format!("connected to {}", self.server));
            }
            self.snapshot = Some(snapshot);
        }
        self.stream = Some(stream);
        Ok(())
    }

    #[expect(
        clippy::disallowed_methods,
        reason = "the time of day is shown; nothing is computed from it"
    )]
    fn note(&mut self, text: String) {
        self.count += 1;
        self.events.truncate(EVENTS - 1);
        self.events.push_front(LoggedEvent {
            number: self.count,
            at: SystemTime::now(),
            text,
        });
    }

    /// The latest tick of the connected server; `None` if [`trouble`](Self::trouble) says why.
    #[must_use]
    pub fn live(&self) -> Option<&Snapshot> {
        self.snapshot.as_ref().filter(|_| self.trouble().is_none())
    }

    /// The latest tick of the last server.
    #[must_use]
    pub const fn last(&self) -> Option<&Snapshot> {
        self.snapshot.as_ref()
    }

    /// The machine of the connected server; `None` if the server has not named it.
    #[must_use]
    pub fn machine(&self) -> Option<&ServerMachine> {
        self.stream.as_ref().and_then(Stream::machine)
    }

    /// Reason for which there is no tick, in a sentence.
    #[must_use]
    pub fn trouble(&self) -> Option<String> {
        let silent = self.heard.elapsed();
        match (self.trouble, &self.snapshot) {
            (Some(trouble), _) => Some(trouble.to_string()),
            (None, None) if silent < SILENCE => {
                Some(format!("waiting for the first tick of {}", self.server))
            }
            (None, None) => Some(format!(
                "{} has taken the connection and sent no tick for {:.0} s: the server is stopped or hangs (see its terminal), or all places of the port \
                 are taken (four readers; end one of them)",
                self.server,
                silent.as_secs_f64()
            )),
            (None, Some(_)) if silent < SILENCE => None,
            (None, Some(_)) => Some(format!(
                "{} has sent nothing for {:.0} s",
                self.server,
                silent.as_secs_f64()
            )),
        }
    }

    /// True if the attempt to get a tick has failed, or takes too long.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.trouble.is_some() || self.heard.elapsed() >= SILENCE
    }

    /// Events, the last first; at most 50.
    pub fn events(&self) -> impl DoubleEndedIterator<Item = &LoggedEvent> {
        self.events.iter()
    }
}

/// Cause of a code.
fn cause(code: u8) -> Result<Cause, StreamError> {
    Cause::from_code(code).ok_or(StreamError::UnknownCode {
        field: "cause",
        code,
    })
}
