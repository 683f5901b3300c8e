//! Length gauges from the machine that has them to the program that measures a campaign: a stream of records over TCP.
//!
//! It stands for the thesis' path from the gauges to the controller `[T 4.2.6]` and is not part of the controller's protocol. A record is,
//! little-endian: tick `u64` (of the publisher's own clock, another one in each record), count `u64` of at most 16, then as many lengths in
//! metres as `f64`; at most 144 bytes. NaN: the gauge is not mounted. Losing records is harmless: the reader takes the latest.

use std::io::{self, Read};
use std::net::{SocketAddr, TcpStream};

use crate::measurements::springs::MAX_GAUGES;
use crate::publisher::{self, Publisher};
use crate::server::connections::Allowed;

/// Bytes of tick and count.
pub const HEAD: usize = 16;
/// Bytes of the longest record.
pub const LONGEST: usize = HEAD + 8 * MAX_GAUGES;

/// Lengths of all gauges in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lengths {
    /// Tick in which they were taken.
    pub tick: u64,
    lengths_m: [f64; MAX_GAUGES],
    count: usize,
}

impl Lengths {
    /// Lengths, m; what is beyond [`MAX_GAUGES`] is left out.
    #[must_use]
    pub fn new(tick: u64, lengths_m: impl IntoIterator<Item = f64>) -> Self {
        let mut lengths = Self { tick, lengths_m: [0.0; MAX_GAUGES], count: 0 };
        for (place, length_m) in lengths.lengths_m.iter_mut().zip(lengths_m) {
            *place = length_m;
            lengths.count += 1;
        }
        lengths
    }

    /// The lengths, m.
    #[must_use]
    pub fn lengths_m(&self) -> &[f64] {
        self.lengths_m.get(..self.count).unwrap_or_default()
    }

    /// The record; its length.
    fn to_bytes(self) -> ([u8; LONGEST], usize) {
        let mut bytes = [0; LONGEST];
        let head = [self.tick.to_le_bytes(), (self.count as u64).to_le_bytes()];
        let fields = head.into_iter().chain(self.lengths_m.map(f64::to_le_bytes));
        for (place, field) in bytes.chunks_exact_mut(8).zip(fields) {
            place.copy_from_slice(&field);
        }
        (bytes, HEAD + 8 * self.count)
    }
}

/// Publishes lengths from the cycle: no allocation, no blocking; a reader that cannot keep up is dropped.
#[derive(Debug)]
pub struct GaugePublisher(Publisher);

impl GaugePublisher {
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

    /// Accepts at most one new reader and sends the lengths to every one.
    pub fn publish(&mut self, lengths: &Lengths) {
        let (bytes, length) = lengths.to_bytes();
        self.0.publish(bytes.get(..length).unwrap_or_default());
    }
}

/// Reads lengths; keeps the latest.
#[derive(Debug)]
pub struct GaugeReader {
    stream: TcpStream,
    buffer: [u8; LONGEST],
    filled: usize,
    latest: Option<Lengths>,
}

impl GaugeReader {
    /// Connects to a publisher.
    ///
    /// # Errors
    /// No publisher listens there.
    pub fn connect(address: SocketAddr) -> io::Result<Self> {
        Ok(Self { stream: publisher::connect(address)?, buffer: [0; LONGEST], filled: 0, latest: None })
    }

    /// Takes everything that has arrived and returns the latest whole record.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`]: a record of more than [`MAX_GAUGES`] gauges, after which the stream is not understood any more. Others:
    /// the publisher is gone.
    pub fn latest(&mut self) -> io::Result<Option<Lengths>> {
        loop {
            let expected = self.expected()?;
            let room = self.buffer.get_mut(self.filled..expected).unwrap_or_default();
            match self.stream.read(room) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.filled += count,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(self.latest),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            if self.filled >= HEAD && self.filled == self.expected()? {
                let lengths = self.fields().skip(2).map(f64::from_le_bytes);
                self.latest = Some(Lengths::new(self.word(0), lengths));
                self.filled = 0;
            }
        }
    }

    /// Bytes of the record that is being read, as far as it is known.
    fn expected(&self) -> io::Result<usize> {
        if self.filled < HEAD {
            return Ok(HEAD);
        }
        let count = self.word(1);
        match usize::try_from(count) {
            Ok(count) if count <= MAX_GAUGES => Ok(HEAD + 8 * count),
            _ => {
                let reason = format!("a record has {count} gauges; at most {MAX_GAUGES} are possible");
                Err(io::Error::new(io::ErrorKind::InvalidData, reason))
            }
        }
    }

    fn fields(&self) -> impl Iterator<Item = [u8; 8]> {
        let filled = self.buffer.get(..self.filled).unwrap_or_default();
        filled.chunks_exact(8).map(|field| <[u8; 8]>::try_from(field).unwrap_or_default())
    }

    fn word(&self, index: usize) -> u64 {
        self.fields().nth(index).map_or(0, u64::from_le_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;
    use std::net::TcpListener;

    #[test]
    fn the_latest_lengths_arrive() {
        let mut publisher = GaugePublisher::bind(([127, 0, 0, 1], 0).into()).unwrap();
        let mut reader = GaugeReader::connect(publisher.address().unwrap()).unwrap();
        let lengths = |tick| Lengths::new(tick, [1.0e-6, -2.0e-6, f64::MIN_POSITIVE]);
        let mut tick = 0;
        let received = loop {
            tick += 1;
            publisher.publish(&lengths(tick));
            if let Some(latest) = reader.latest().unwrap() {
                break latest;
            }
        };
        assert_eq!(received, lengths(received.tick));
        assert_eq!(received.lengths_m().len(), 3);
        drop(publisher);
        while reader.latest().is_ok() {
            std::thread::yield_now();
        }
    }

    /// Reads bytes to their end; returns the last lengths and the error.
    fn read_all(bytes: &[u8]) -> (Option<Lengths>, io::Error) {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let mut reader = GaugeReader::connect(listener.local_addr().unwrap()).unwrap();
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(bytes).unwrap();
        drop(stream);
        loop {
            match reader.latest() {
                Ok(_) => std::thread::yield_now(),
                Err(error) => return (reader.latest, error),
            }
        }
    }

    #[test]
    fn hostile_bytes_end_in_an_error_never_in_a_record() {
        let (bytes, length) = Lengths::new(7, [1.0; 3]).to_bytes();
        let record = &bytes[..length];
        let (latest, error) = read_all(record);
        assert_eq!((latest.unwrap().tick, error.kind()), (7, io::ErrorKind::UnexpectedEof));
        for cut in 0..length {
            assert_eq!(read_all(&record[..cut]).0, None, "{cut}");
        }
        let mut seventeen = bytes;
        seventeen[8] = 17;
        let (latest, error) = read_all(&seventeen);
        assert_eq!((latest, error.kind()), (None, io::ErrorKind::InvalidData));
        assert_eq!(error.to_string(), "a record has 17 gauges; at most 16 are possible");
        let mut huge = bytes;
        huge[8..16].copy_from_slice(&u64::MAX.to_le_bytes());
        assert_eq!(read_all(&huge).1.kind(), io::ErrorKind::InvalidData);
    }
}
