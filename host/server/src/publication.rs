//! Samples of the server for programs that speak LabComm `[T 4.2.3]`: a port carries the samples
//! that were agreed on, one of each per tick.
//!
//! A reader that connects gets version and definitions first, the sample of the machine, and
//! `session_event` of rows that were lost and of a failure of the machine that still lasts. What it
//! sends is not read, and it is dropped if it does not keep up.

mod drives;
mod machine;
mod rows;
mod sample_name;
mod ticks;

use std::io;
use std::net::SocketAddr;

use gantry_tau_core::control::message::Phase;
use gantry_tau_labcomm::Version;

use crate::links::Allowed;
use crate::links::subscribers::Subscribers;
use crate::plant::ToolReading;
use crate::record::TickRecord;
use crate::record::{Event, EventKind};
pub use drives::DriveStates;
pub use machine::{MAX_ROBOT_FILE, MachineIdentity};
pub use rows::{Samples, Sensors};
pub use sample_name::{ParseSampleNameError, SampleName};
use ticks::TICK;
pub use ticks::Ticks;

/// Room for the ticks that are sent at once, bytes. One write of several ticks costs a reader's
/// connection hardly more than one of a tick.
const BATCH: usize = 8 * TICK;

/// A port with its readers. Publishing allocates nothing and never blocks.
#[derive(Debug)]
pub struct Publication {
    readers: Subscribers,
    /// Resolution of the gauges, m: what one count of `data` means.
    gauge_resolution_m: f64,
    ticks: Ticks,
    /// Bytes that a new reader gets first: version and definitions, the machine, then what is kept.
    preamble: Vec<u8>,
    /// Bytes of the preamble that stay: all but what is kept.
    fixed: usize,
    /// Kept for readers that come later: the first lost row, and the failure of the machine while
    /// it lasts.
    lost: Option<Event>,
    failure: Option<Event>,
    /// Ticks that were published and not sent.
    batch: Vec<u8>,
}

impl Publication {
    /// Listens for readers of these samples of a machine with `N` axes.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind<const N: usize>(
        address: SocketAddr,
        version: Version,
        names: &[SampleName],
        gauge_resolution_m: f64,
    ) -> io::Result<Self> {
        let ticks = Ticks::of::<N>(version, names)?;
        let mut preamble = Vec::with_capacity(ticks.preamble().len() + TICK);
        preamble.extend_from_slice(ticks.preamble());
        let batch = Vec::with_capacity(BATCH);
        let fixed = preamble.len();
        let readers = Subscribers::bind(address)?;
        Ok(Self {
            readers,
            gauge_resolution_m,
            ticks,
            preamble,
            fixed,
            lost: None,
            failure: None,
            batch,
        })
    }

    /// Says which machine it is and what it is drawn by, if the port carries that sample.
    #[must_use]
    pub fn of_machine(mut self, machine: &MachineIdentity) -> Self {
        self.preamble
            .extend_from_slice(&self.ticks.encode_machine(machine));
        self.fixed = self.preamble.len();
        self.preamble.reserve(TICK);
        self
    }

    /// Serves only these peers.
    #[must_use]
    pub fn for_peers(self, allowed: Allowed) -> Self {
        Self {
            readers: self.readers.for_peers(allowed),
            ..self
        }
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.readers.address()
    }

    /// True if the samples are those of the measuring programs of the thesis alone: they leave in
    /// the cycle, before the State of their tick.
    #[must_use]
    pub fn is_of_sensors(&self) -> bool {
        self.ticks.names().iter().all(|name| name.is_of_sensors())
    }

    /// Publishes gauges and force sensor, for a port of sensors.
    pub fn publish_sensors(&mut self, tool: &ToolReading) {
        let sensors = Sensors {
            tool,
            gauge_resolution_m: self.gauge_resolution_m,
        };
        self.readers.accept(&self.preamble);
        self.readers.send(self.ticks.encode_sensors(sensors));
    }

    /// Publishes counts of gauges, for a port of `data` alone; `None` in a tick without them.
    pub fn publish_data(&mut self, counts: Option<[i32; 3]>) {
        self.readers.accept(&self.preamble);
        if let Some(counts) = counts {
            self.readers.send(self.ticks.encode_data(counts));
        }
    }

    /// Publishes a tick: with those behind it once [`flush`](Self::flush) is called, or when there
    /// is no room for a further one.
    pub fn publish<const N: usize>(&mut self, row: &TickRecord<N>, events: &[Event]) {
        // A new reader begins at the front of a batch: the preamble tells what was before.
        if self.batch.is_empty() {
            self.readers.accept(&self.preamble);
        }
        let gauge_resolution_m = self.gauge_resolution_m;
        let sensors = row.tool.as_ref().map(|tool| Sensors {
            tool,
            gauge_resolution_m,
        });
        self.batch
            .extend_from_slice(self.ticks.encode(&row.into(), events, sensors));
        if self.batch.len() > BATCH - TICK {
            self.flush();
        }
        self.keep(row, events);
    }

    /// Sends the ticks that were published.
    pub fn flush(&mut self) {
        self.readers.send(&self.batch);
        self.batch.clear();
    }

    /// Keeps events for readers that come later: lost rows, and the failure of the machine until
    /// the server listens again.
    fn keep<const N: usize>(&mut self, row: &TickRecord<N>, events: &[Event]) {
        let lost = last(events, EventKind::RowsLost).filter(|_| self.lost.is_none());
        let failure = last(events, EventKind::MachineFailed);
        let is_over =
            self.failure.is_some() && !row.plant_failed && row.state.phase == Phase::Listening;
        if lost.is_none() && failure.is_none() && !is_over {
            return;
        }
        self.lost = self.lost.take().or(lost.cloned());
        self.failure = failure
            .cloned()
            .or(self.failure.take().filter(|_| !is_over));
        self.preamble.truncate(self.fixed);
        self.preamble.extend_from_slice(
            self.ticks
                .encode_events(self.lost.iter().chain(&self.failure)),
        );
    }
}

/// The last event of a kind.
fn last(events: &[Event], kind: EventKind) -> Option<&Event> {
    events.iter().rfind(|event| event.kind == kind)
}
