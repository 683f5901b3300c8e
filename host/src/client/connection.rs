//! Frames over a TCP stream, from the client's side.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use gantry_tau_core::message::{ClientMessage, ServerMessage};
use gantry_tau_core::wire::{Deframer, Feed, decode_server, encode_client};

use super::ClientError;

/// Bytes read at a time: several States.
const CHUNK: usize = 4_096;

/// A connection to a server of `N` axes.
#[derive(Debug)]
pub struct Link<const N: usize> {
    stream: TcpStream,
    deframer: Deframer,
    chunk: [u8; CHUNK],
    /// Bytes of the chunk not yet fed.
    from: usize,
    to: usize,
}

impl<const N: usize> Link<N> {
    /// Connects. A server that says nothing for `silence` counts as vanished.
    ///
    /// # Errors
    /// [`ClientError::Unreachable`].
    pub fn connect(address: SocketAddr, silence: Duration) -> Result<Self, ClientError> {
        let connect = || {
            let stream = TcpStream::connect_timeout(&address, silence)?;
            stream.set_nodelay(true)?;
            stream.set_read_timeout(Some(silence))?;
            stream.set_write_timeout(Some(silence))?;
            Ok(stream)
        };
        let stream = connect().map_err(|error| ClientError::Unreachable {
            what: "server",
            address,
            error,
        })?;
        Ok(Self {
            stream,
            deframer: Deframer::new(),
            chunk: [0; CHUNK],
            from: 0,
            to: 0,
        })
    }

    /// Sends one message.
    ///
    /// # Errors
    /// [`ClientError::Vanished`].
    pub fn send(&mut self, message: &ClientMessage<N>) -> Result<(), ClientError> {
        self.stream
            .write_all(&encode_client(message))
            .map_err(|error| ClientError::Vanished(vanished(&error)))
    }

    /// Waits for the next message.
    ///
    /// # Errors
    /// [`ClientError::Vanished`] after silence, a closed connection or a broken frame; [`ClientError::Incompatible`] for content that cannot be read.
    pub fn receive(&mut self) -> Result<ServerMessage<N>, ClientError> {
        let since = Instant::now();
        loop {
            if let Some(message) = self.take()? {
                return Ok(message);
            }
            match self.stream.read(&mut self.chunk) {
                Ok(0) => return Err(ClientError::Vanished("it closed the connection".to_owned())),
                Ok(count) => (self.from, self.to) = (0, count),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => {
                    let after = since.elapsed().as_millis();
                    let reason = format!("{} (after {after} ms)", vanished(&error));
                    return Err(ClientError::Vanished(reason));
                }
            }
        }
    }

    /// Whether more has already been read: then a newer State is on its way and the current one is no longer the latest.
    #[must_use]
    pub const fn has_unread_bytes(&self) -> bool {
        self.from < self.to
    }

    /// The next message among the bytes already read.
    fn take(&mut self) -> Result<Option<ServerMessage<N>>, ClientError> {
        let unread = self.chunk.get(self.from..self.to).unwrap_or_default();
        match self.deframer.feed(unread) {
            Feed::Incomplete => {
                self.from = self.to;
                Ok(None)
            }
            Feed::Frame { frame, consumed } => {
                self.from += consumed;
                decode_server(&frame)
                    .map(Some)
                    .map_err(|error| ClientError::Incompatible(error.to_string()))
            }
            Feed::Broken(error) => Err(ClientError::Incompatible(error.to_string())),
        }
    }
}

fn vanished(error: &io::Error) -> String {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => "it has been silent for too long".to_owned(),
        ErrorKind::ConnectionReset | ErrorKind::BrokenPipe | ErrorKind::ConnectionAborted => {
            "its connection was reset".to_owned()
        }
        _ => error.to_string(),
    }
}
