//! Records over TCP from the cycle to the programs that need them, which take the latest: losing
//! records is harmless.

pub mod accelerometer;
mod allowed;
pub mod gauges;
pub mod places;
pub mod subscribers;

use std::io::{self, Read};
use std::marker::PhantomData;
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use gantry_tau_system::dial::{self, Addresses};

pub use allowed::{Allowed, ParseNetworkError};
use subscribers::Subscribers;

/// Longest wait for a publisher to answer.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);

/// Bytes that the system keeps for a subscriber: half a second of records. One that reads nothing
/// is dropped after two seconds at 1 kHz, with what its own system takes.
const SEND_BUFFER: usize = 32 * 1024;
/// Bytes read at once.
const CHUNK: usize = 16_384;
/// Reads per visit: seconds of records, and a bound on the work that a flood can cause.
const READS: usize = 16;

/// Bytes of the longest record of any kind.
pub const MAX_RECORD: usize = 144;

/// Record of 64-bit fields, little-endian, at most [`MAX_RECORD`] bytes.
pub trait Record: Copy {
    /// Encodes the record; returns its length.
    fn encode(&self, bytes: &mut [u8; MAX_RECORD]) -> usize;

    /// Returns the length of the record that begins with these bytes, as far as they tell.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`]: they begin no record.
    fn expected(bytes: &[u8]) -> io::Result<usize>;

    /// Decodes a whole record.
    fn decode(bytes: &[u8]) -> Self;
}

/// Writes fields one after the other; returns their length.
pub(crate) fn put_fields(
    bytes: &mut [u8; MAX_RECORD],
    fields: impl Iterator<Item = [u8; 8]>,
) -> usize {
    bytes
        .chunks_exact_mut(8)
        .zip(fields)
        .map(|(place, field)| place.copy_from_slice(&field))
        .count()
        * 8
}

/// Fields of a record.
pub(crate) fn fields(bytes: &[u8]) -> impl Iterator<Item = [u8; 8]> {
    bytes
        .chunks_exact(8)
        .map(|field| <[u8; 8]>::try_from(field).unwrap_or_default())
}

/// Publishes records from the cycle: no allocation, no blocking; a subscriber that cannot keep up
/// is dropped.
#[derive(Debug)]
pub struct Publisher<R> {
    subscribers: Subscribers,
    record: PhantomData<R>,
}

impl<R: Record> Publisher<R> {
    /// Listens for subscribers.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind(address: SocketAddr) -> io::Result<Self> {
        Ok(Self {
            subscribers: Subscribers::bind(address)?.with_send_buffer(SEND_BUFFER),
            record: PhantomData,
        })
    }

    /// Serves only these peers.
    #[must_use]
    pub fn for_peers(self, allowed: Allowed) -> Self {
        Self {
            subscribers: self.subscribers.for_peers(allowed),
            ..self
        }
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.subscribers.address()
    }

    /// Accepts at most one new subscriber and sends the record to every one.
    pub fn publish(&mut self, record: &R) {
        let mut bytes = [0; MAX_RECORD];
        let length = record.encode(&mut bytes);
        self.subscribers.accept(&[]);
        self.subscribers
            .send(bytes.get(..length).unwrap_or_default());
    }
}

/// Reads records; keeps the latest.
#[derive(Debug)]
pub struct RecordReader<R> {
    stream: TcpStream,
    buffer: [u8; MAX_RECORD],
    filled: usize,
    pub(crate) latest: Option<R>,
}

impl<R: Record> RecordReader<R> {
    /// Connects to a publisher.
    ///
    /// # Errors
    /// No publisher listens there; [`io::ErrorKind::Interrupted`] if `quit` was set meanwhile.
    pub fn connect(address: impl Into<Addresses>, quit: &AtomicBool) -> io::Result<Self> {
        let stream = dial::connect(&address.into(), CONNECT_TIMEOUT, quit)?;
        stream.set_nodelay(true)?;
        stream.set_nonblocking(true)?;
        Ok(Self {
            stream,
            buffer: [0; MAX_RECORD],
            filled: 0,
            latest: None,
        })
    }

    /// Takes what has arrived, as far as a visit reads, and returns the latest whole record of it.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`]: bytes that begin no record, after which the stream is not
    /// understood any more. Others: the publisher is gone.
    pub fn latest(&mut self) -> io::Result<Option<R>> {
        let mut chunk = [0; CHUNK];
        for _ in 0..READS {
            match self.stream.read(&mut chunk) {
                Ok(0) => return Err(closed()),
                Ok(count) => self.consume(chunk.get(..count).unwrap_or_default())?,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(self.latest)
    }

    /// Consumes bytes; of the records that they complete the last one counts.
    fn consume(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            let expected = self.expected()?;
            let room = self
                .buffer
                .get_mut(self.filled..expected)
                .unwrap_or_default();
            let (part, rest) = bytes.split_at(room.len().min(bytes.len()));
            room.iter_mut()
                .zip(part)
                .for_each(|(place, byte)| *place = *byte);
            self.filled += part.len();
            bytes = rest;
            // What has just arrived may say that more belongs to the record.
            if self.filled == self.expected()? {
                self.latest = Some(R::decode(self.arrived()));
                self.filled = 0;
            }
        }
        Ok(())
    }

    fn arrived(&self) -> &[u8] {
        self.buffer.get(..self.filled).unwrap_or_default()
    }

    fn expected(&self) -> io::Result<usize> {
        R::expected(self.arrived())
    }
}

/// Error of a connection that the other side has closed.
pub fn closed() -> io::Error {
    io::Error::new(
        io::ErrorKind::UnexpectedEof,
        "the other side has closed the connection",
    )
}
