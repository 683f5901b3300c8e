//! Samples of the server for programs that speak LabComm `[T 4.2.3]`: a port carries the samples that were agreed on, one of each per tick.
//!
//! A reader that connects gets version and definitions first, and `session_event` of a failure of the machine that still lasts. What it sends
//! is not read, and it is dropped if it does not keep up.

mod rows;
mod sample_name;

use std::io;
use std::net::SocketAddr;

use gantry_tau_core::control::message::Phase;
use gantry_tau_labcomm::{Encoder, Version};

use crate::plant::ToolReading;
use crate::readers::Readers;
use crate::server::connections::Allowed;
use crate::server::cycle::Row;
use crate::server::event_log::{Event, EventKind};

pub use sample_name::{ParseSampleNameError, SampleName};

/// Room for the definitions of all samples, bytes.
const DEFINITIONS: usize = 1_024;
/// Room for all samples of a tick and as many events as one tick can have, bytes.
const TICK: usize = 2_048;

/// A port with its readers. Publishing allocates nothing and never blocks.
#[derive(Debug)]
pub struct Publication {
    readers: Readers,
    version: Version,
    names: Vec<SampleName>,
    /// Resolution of the gauges, m: what one count of `data` means.
    gauge_resolution_m: f64,
    /// Bytes that a new reader gets first: version and definitions, then the failure of the machine while it lasts.
    preamble: Vec<u8>,
    /// Length of version and definitions, bytes.
    definitions: usize,
    buffer: Box<[u8; TICK]>,
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
        let mut definitions = [0; DEFINITIONS];
        let mut encoder = Encoder::new(version, &mut definitions);
        rows::define::<N>(&mut encoder, rows::indexed(version, names))
            .map_err(|error| io::Error::other(error.to_string()))?;
        Ok(Self {
            readers: Readers::bind(address)?,
            version,
            names: names.to_vec(),
            gauge_resolution_m,
            preamble: preamble(encoder.bytes()),
            definitions: encoder.bytes().len(),
            buffer: Box::new([0; TICK]),
        })
    }

    /// Serves only these peers.
    #[must_use]
    pub fn for_peers(self, allowed: Allowed) -> Self {
        Self { readers: self.readers.for_peers(allowed), ..self }
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.readers.address()
    }

    /// True if the samples are those of the measuring programs of the thesis alone: they leave in the cycle, before the State of their tick.
    #[must_use]
    pub fn is_of_sensors(&self) -> bool {
        self.names.iter().all(|name| name.is_of_sensors())
    }

    /// Publishes gauges and force sensor, for a port of sensors.
    pub fn publish_sensors(&mut self, tool: &ToolReading) {
        let (names, resolution_m) = (rows::indexed(self.version, &self.names), self.gauge_resolution_m);
        self.readers.accept(&self.preamble);
        let mut encoder = Encoder::new(self.version, self.buffer.as_mut_slice());
        let written = rows::write_sensors(&mut encoder, names, tool, resolution_m);
        debug_assert_eq!(written, Ok(()), "a tick has room");
        self.readers.send(encoder.bytes());
    }

    /// Publishes a tick.
    pub fn publish<const N: usize>(&mut self, row: &Row<N>, events: &[Event]) {
        let (names, resolution_m) = (rows::indexed(self.version, &self.names), self.gauge_resolution_m);
        self.readers.accept(&self.preamble);
        let mut encoder = Encoder::new(self.version, self.buffer.as_mut_slice());
        let written = rows::write_row(&mut encoder, names, row, events, resolution_m);
        debug_assert_eq!(written, Ok(()), "a tick has room");
        self.readers.send(encoder.bytes());
        self.keep_failure(row, events);
    }

    /// Keeps the failure of the machine for readers that come later, until the server listens again.
    fn keep_failure<const N: usize>(&mut self, row: &Row<N>, events: &[Event]) {
        let failure = events.iter().rfind(|event| event.kind == EventKind::MachineFailed);
        if failure.is_none() && (row.plant_failed || row.state.phase != Phase::Listening) {
            return;
        }
        self.preamble.truncate(self.definitions);
        let mut encoder = Encoder::new(self.version, self.buffer.as_mut_slice());
        let written = rows::write_events(&mut encoder, rows::indexed(self.version, &self.names), failure);
        debug_assert_eq!(written, Ok(()), "an event has room");
        self.preamble.extend_from_slice(encoder.bytes());
    }
}

/// Copies version and definitions, with room for an event behind them.
fn preamble(definitions: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(DEFINITIONS + TICK);
    bytes.extend_from_slice(definitions);
    bytes
}
