//! Readers of a TCP port: each gets the same bytes, and what it sends is not read.

use std::io::{self, Write};
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

    /// Accepts at most one new reader, and sends it `first`.
    pub fn accept(&mut self, first: &[u8]) {
        let Some(free) = self.streams.iter_mut().find(|stream| stream.is_none()) else {
            return;
        };
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

/// True if a stream has taken all the bytes at once.
fn takes(stream: &mut TcpStream, bytes: &[u8]) -> bool {
    bytes.is_empty() || matches!(stream.write(bytes), Ok(count) if count == bytes.len())
}
