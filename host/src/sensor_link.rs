//! Force samples from the machine that has the sensor to the client that needs them: a stream of fixed records over TCP.
//!
//! It stands for the thesis' path from the sensor to the controller `[T 4.2.3, 4.2.5]` and is not part of the controller's protocol.
//! A record is 56 bytes, little-endian: tick `u64`, then force (N) and moment (N m) in sensor axes as six `f64`.
//! Losing records is harmless: the reader takes the latest.

use std::io::{self, Read};
use std::net::{SocketAddr, TcpStream};

use crate::publisher::{self, Publisher};
use crate::server::connections::Allowed;

/// Bytes of a record.
const RECORD: usize = 56;

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Tick in which it was taken.
    pub tick: u64,
    /// Force (N) then moment (N m), sensor axes.
    pub wrench: [f64; 6],
}

impl Sample {
    fn to_bytes(self) -> [u8; RECORD] {
        let mut bytes = [0; RECORD];
        let fields = [self.tick.to_le_bytes()].into_iter().chain(self.wrench.map(f64::to_le_bytes));
        for (place, field) in bytes.chunks_exact_mut(8).zip(fields) {
            place.copy_from_slice(&field);
        }
        bytes
    }

    fn from_bytes(bytes: &[u8; RECORD]) -> Self {
        let mut fields = bytes.chunks_exact(8).map(|field| <[u8; 8]>::try_from(field).unwrap_or_default());
        let mut next = || fields.next().unwrap_or_default();
        Self { tick: u64::from_le_bytes(next()), wrench: std::array::from_fn(|_| f64::from_le_bytes(next())) }
    }
}

/// Publishes samples from the cycle: no allocation, no blocking; a reader that cannot keep up is dropped.
#[derive(Debug)]
pub struct SensorPublisher(Publisher);

impl SensorPublisher {
    /// Listens for readers.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind(address: SocketAddr) -> io::Result<Self> {
        Publisher::bind(address).map(Self)
    }

    /// Serves only these peers.
    #[must_use]
    pub fn for_peers(self, allowed: Allowed) -> Self {
        Self(self.0.for_peers(allowed))
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.0.address()
    }

    /// Accepts at most one new reader and sends the sample to every one.
    pub fn publish(&mut self, sample: &Sample) {
        self.0.publish(&sample.to_bytes());
    }
}

/// Reads samples; keeps the latest.
#[derive(Debug)]
pub struct SensorReader {
    stream: TcpStream,
    buffer: [u8; RECORD],
    filled: usize,
    latest: Option<Sample>,
}

impl SensorReader {
    /// Connects to a publisher.
    ///
    /// # Errors
    /// No publisher listens there.
    pub fn connect(address: SocketAddr) -> io::Result<Self> {
        let stream = publisher::connect(address)?;
        Ok(Self { stream, buffer: [0; RECORD], filled: 0, latest: None })
    }

    /// Takes everything that has arrived and returns the latest whole sample.
    ///
    /// # Errors
    /// The publisher is gone.
    pub fn latest(&mut self) -> io::Result<Option<Sample>> {
        loop {
            let room = self.buffer.get_mut(self.filled..).unwrap_or_default();
            match self.stream.read(room) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.filled += count,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(self.latest),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            if self.filled == RECORD {
                self.latest = Some(Sample::from_bytes(&self.buffer));
                self.filled = 0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_sample_arrives() {
        let mut publisher = SensorPublisher::bind(([127, 0, 0, 1], 0).into()).unwrap();
        let mut reader = SensorReader::connect(publisher.address().unwrap()).unwrap();
        let sample = |tick| Sample { tick, wrench: [1.0, -2.0, 3.5, 0.1, f64::MIN_POSITIVE, -0.0] };
        let mut tick = 0;
        let received = loop {
            tick += 1;
            publisher.publish(&sample(tick));
            if let Some(latest) = reader.latest().unwrap() {
                break latest;
            }
        };
        assert_eq!(received, sample(received.tick));
        drop(publisher);
        while reader.latest().is_ok() {
            std::thread::yield_now();
        }
    }
}
