//! A measuring program of the test's own: writes a LabComm stream to one client.

use std::io::Write;
use std::net::{TcpListener, TcpStream};

use gantry_tau_client::force_sensor::SensorSource;
use gantry_tau_labcomm::{Encoder, ErrorKind, Field, Sample, Text, Version, structure};
use gantry_tau_tests::server_fixture::LOOPBACK;

use super::lockstep::stream;

structure! {
    /// Force and moment with more digits.
    pub struct Doubles(pub [f64; 6]);
    /// Six numbers that are not a force.
    pub struct Counts(pub [i32; 6]);
    /// The type of a force under another name.
    pub struct Decoy(pub [f32; 6]);
}

structure! {
    /// Part of what no client knows.
    pub struct Place { pub name: Text<40>, pub at: [i64; 2], pub is_set: bool }
    /// What no client knows.
    pub struct Unknown { pub tick: i64, pub places: [Place; 3], pub state: u8, pub gain: f64 }
}

impl Sample for Doubles {
    const NAME: &'static str = "forcesensor";
}

impl Sample for Counts {
    const NAME: &'static str = "forcesensor";
}

impl Sample for Decoy {
    const NAME: &'static str = "forcesensor2";
}

impl Sample for Unknown {
    const NAME: &'static str = "places";
}

/// A sample that no client knows.
pub(super) fn unknown(tick: usize) -> Unknown {
    // Texts of several lengths, one of them with the number of a definition and the index of a
    // sample.
    let names = ["", "\u{2}\0\0\0\u{2}@A", &"x".repeat(tick % 41)];
    let places = names.map(|name| Place {
        name: Text::cut(name),
        at: [i64::MIN, -1],
        is_set: true,
    });
    Unknown {
        tick: i64::try_from(tick).unwrap(),
        places,
        ..Unknown::ZERO
    }
}

/// The program; at most one client.
pub(super) struct Program {
    version: Version,
    listener: TcpListener,
    client: Option<TcpStream>,
}

impl Program {
    pub(super) fn of(version: Version) -> Self {
        Self {
            version,
            listener: TcpListener::bind(LOOPBACK).unwrap(),
            client: None,
        }
    }

    /// The sample `forcesensor` of this stream.
    pub(super) fn source(&self) -> SensorSource {
        stream(self.listener.local_addr().unwrap())
    }

    /// Index of the first definition of a stream.
    pub(super) const fn first(&self) -> u32 {
        self.version.first_index()
    }

    /// Sends bytes; the first time after the client has connected.
    pub(super) fn send_bytes(&mut self, bytes: &[u8]) {
        let client = self
            .client
            .get_or_insert_with(|| self.listener.accept().unwrap().0);
        // A client that has left is judged by what it says.
        let _ = client.write_all(bytes);
    }

    /// Encodes, and sends.
    pub(super) fn send(&mut self, write: impl FnOnce(&mut Encoder<'_>) -> Result<(), ErrorKind>) {
        self.send_bytes(&self.encoded(write));
    }

    /// Encodes.
    pub(super) fn encoded(
        &self,
        write: impl FnOnce(&mut Encoder<'_>) -> Result<(), ErrorKind>,
    ) -> Vec<u8> {
        let mut buffer = [0; 4_096];
        let mut encoder = Encoder::new(self.version, &mut buffer);
        write(&mut encoder).unwrap();
        encoder.bytes().to_vec()
    }

    /// Ends the stream.
    pub(super) fn end(&mut self) {
        self.client = None;
    }
}
