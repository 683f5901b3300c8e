//! Readers of a TCP port: each gets the same bytes, and what it sends is dropped.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

use socket2::SockRef;

use crate::server::connections::Allowed;

/// Readers served at once; further ones wait until one of them has gone.
pub const READERS: usize = 4;
/// Bytes that the system keeps for a reader: less than a second of all samples, so that one that has stopped reading is dropped soon
/// instead of being sent old ticks later.
const SEND_BUFFER: usize = 128 * 1024;

/// A port and its readers. Serving them allocates nothing and never blocks; a reader that cannot keep up is dropped.
#[derive(Debug)]
pub struct Readers {
    listener: TcpListener,
    allowed: Allowed,
    streams: [Option<TcpStream>; READERS],
}

impl Readers {
    /// Listens for readers.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn bind(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, allowed: Allowed::all(), streams: [const { None }; READERS] })
    }

    /// Serves only these peers.
    #[must_use]
    pub fn for_peers(self, allowed: Allowed) -> Self {
        Self { allowed, ..self }
    }

    /// Returns the address on which it listens.
    ///
    /// # Errors
    /// Error of the system.
    pub fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts at most one new reader, and sends it `first`. A reader that has gone leaves its place to it.
    pub fn accept(&mut self, first: &[u8]) {
        let free = self.streams.iter().position(Option::is_none);
        // A write finds those that have gone; a port that is seldom written asks when it needs their places.
        let free = free.or_else(|| self.streams.iter_mut().position(|stream| stream.as_mut().is_some_and(has_gone)));
        let Some(free) = free.and_then(|index| self.streams.get_mut(index)) else { return };
        *free = None;
        if let Ok((mut stream, peer)) = self.listener.accept() {
            let usable = self.allowed.admits(peer.ip())
                && stream.set_nonblocking(true).is_ok()
                && stream.set_nodelay(true).is_ok()
                && SockRef::from(&stream).set_send_buffer_size(SEND_BUFFER).is_ok()
                && takes(&mut stream, first);
            *free = usable.then_some(stream);
        }
    }

    /// Sends bytes to every reader.
    pub fn send(&mut self, bytes: &[u8]) {
        for reader in &mut self.streams {
            if !reader.as_mut().is_some_and(|stream| takes(stream, bytes)) {
                *reader = None;
            }
        }
    }
}

/// True if the peer of a stream has closed it. What it has sent is dropped, a part at a time.
fn has_gone(stream: &mut TcpStream) -> bool {
    match stream.read(&mut [0; 1024]) {
        Ok(count) => count == 0,
        Err(error) => !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
    }
}

/// True if a stream has taken all the bytes at once.
fn takes(stream: &mut TcpStream, bytes: &[u8]) -> bool {
    bytes.is_empty() || matches!(stream.write(bytes), Ok(count) if count == bytes.len())
}
