//! Records to readers over TCP, from the cycle: no allocation, no blocking; a reader that cannot keep up is dropped.

use std::io::{self, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use crate::server::connections::Allowed;

/// Longest wait for a publisher to answer.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);
/// Readers served at once.
const READERS: usize = 4;

/// A listener, and the readers that it has accepted.
#[derive(Debug)]
pub(crate) struct Publisher {
    listener: TcpListener,
    allowed: Allowed,
    readers: [Option<TcpStream>; READERS],
}

impl Publisher {
    pub(crate) fn bind(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, allowed: Allowed::all(), readers: [const { None }; READERS] })
    }

    /// Serves only these peers.
    pub(crate) fn for_peers(self, allowed: Allowed) -> Self {
        Self { allowed, ..self }
    }

    pub(crate) fn address(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }

    /// Accepts at most one new reader and sends the record to every one.
    pub(crate) fn publish(&mut self, record: &[u8]) {
        self.accept();
        for reader in &mut self.readers {
            let sent = (reader.as_mut())
                .is_some_and(|stream| matches!(stream.write(record), Ok(count) if count == record.len()));
            if !sent {
                *reader = None;
            }
        }
    }

    fn accept(&mut self) {
        let Some(free) = self.readers.iter_mut().find(|reader| reader.is_none()) else {
            return;
        };
        if let Ok((stream, peer)) = self.listener.accept() {
            let usable = self.allowed.admits(peer.ip())
                && stream.set_nonblocking(true).is_ok()
                && stream.set_nodelay(true).is_ok();
            *free = usable.then_some(stream);
        }
    }
}

/// Connects to a publisher.
pub(crate) fn connect(address: SocketAddr) -> io::Result<TcpStream> {
    let stream = TcpStream::connect_timeout(&address, CONNECT_TIMEOUT)?;
    stream.set_nodelay(true)?;
    stream.set_nonblocking(true)?;
    Ok(stream)
}
