//! The client's connection: frames over a TCP stream or as UDP datagrams.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{ClientMessage, ServerMessage};
use gantry_tau_core::control::wire::{Deframer, Feed, Frame, decode_server, encode_client};

use super::ClientError;

/// Bytes read at a time: several States.
const CHUNK: usize = 4_096;

/// A connection to a server of `N` axes.
#[derive(Debug)]
pub struct Connection<const N: usize> {
    wire: Wire,
    silence: Duration,
    chunk: [u8; CHUNK],
    /// Bytes of the chunk not yet fed; a stream's only.
    from: usize,
    to: usize,
}

#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a client has one of them")]
enum Wire {
    Stream(TcpStream, Deframer),
    Datagrams(UdpSocket),
}

impl<const N: usize> Connection<N> {
    /// Connects over TCP. A server that is silent for `silence` counts as vanished.
    ///
    /// # Errors
    /// [`ClientError::Unreachable`].
    pub fn connect(address: SocketAddr, silence: Duration) -> Result<Self, ClientError> {
        Self::over(Transport::Stream, address, silence)
    }

    /// Connects over `transport`. Over UDP nothing is sent yet, so the server need not be there.
    ///
    /// # Errors
    /// [`ClientError::Unreachable`].
    pub fn over(
        transport: Transport,
        address: SocketAddr,
        silence: Duration,
    ) -> Result<Self, ClientError> {
        let wire = match transport {
            Transport::Stream => stream(address, silence),
            Transport::Datagram => datagrams(address, silence),
        };
        let wire = wire.map_err(|error| ClientError::Unreachable {
            what: "server",
            address,
            error,
        })?;
        Ok(Self {
            wire,
            silence,
            chunk: [0; CHUNK],
            from: 0,
            to: 0,
        })
    }

    /// True if frames can get lost: then important ones are sent again.
    #[must_use]
    pub const fn loses_frames(&self) -> bool {
        matches!(self.wire, Wire::Datagrams(_))
    }

    /// Sends one message.
    ///
    /// # Errors
    /// [`ClientError::Vanished`].
    pub fn send(&mut self, message: &ClientMessage<N>) -> Result<(), ClientError> {
        let frame = encode_client(message);
        let sent = match &mut self.wire {
            Wire::Stream(stream, _) => stream.write_all(&frame),
            Wire::Datagrams(socket) => match socket.send(&frame) {
                // The server is not there; the silence that follows is the error.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(()),
                sent => sent.map(|_| ()),
            },
        };
        sent.map_err(|error| ClientError::Vanished(vanished(&error)))
    }

    /// Waits for the next message.
    ///
    /// # Errors
    /// As [`receive_within`](Self::receive_within), with the silence given at the start.
    pub fn receive(&mut self) -> Result<ServerMessage<N>, ClientError> {
        self.receive_within(self.silence)?
            .ok_or_else(|| ClientError::Vanished("it has been silent for too long".to_owned()))
    }

    /// Waits for the next message, over UDP no longer than `patience`; `None` if none came.
    ///
    /// # Errors
    /// [`ClientError::Vanished`] after silence or a closed connection; [`ClientError::Incompatible`] for a frame that cannot be
    /// read. A broken datagram is dropped.
    pub fn receive_within(
        &mut self,
        patience: Duration,
    ) -> Result<Option<ServerMessage<N>>, ClientError> {
        let since = Instant::now();
        loop {
            if let Some(message) = self.take()? {
                return Ok(Some(message));
            }
            let (read, is_stream) = match &mut self.wire {
                Wire::Stream(stream, _) => (stream.read(&mut self.chunk), true),
                Wire::Datagrams(socket) => {
                    let left = patience.saturating_sub(since.elapsed());
                    if left.is_zero() {
                        return Ok(None);
                    }
                    let waiting = socket.set_read_timeout(Some(left));
                    (waiting.and_then(|()| socket.recv(&mut self.chunk)), false)
                }
            };
            match read {
                Ok(0) if is_stream => {
                    return Err(ClientError::Vanished("it closed the connection".to_owned()));
                }
                Ok(count) => (self.from, self.to) = (0, count),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if !is_stream && is_nothing(&error) => {}
                Err(error) => {
                    let after = since.elapsed().as_millis();
                    let reason = format!("{} (after {after} ms)", vanished(&error));
                    return Err(ClientError::Vanished(reason));
                }
            }
        }
    }

    /// True if more has been read than was returned: then the current State is not the latest.
    #[must_use]
    pub const fn has_unread_bytes(&self) -> bool {
        self.from < self.to
    }

    /// Returns the next message among the bytes already read.
    fn take(&mut self) -> Result<Option<ServerMessage<N>>, ClientError> {
        let unread = self.chunk.get(self.from..self.to).unwrap_or_default();
        let incompatible =
            |error: &dyn std::fmt::Display| ClientError::Incompatible(error.to_string());
        match &mut self.wire {
            Wire::Stream(_, deframer) => match deframer.feed(unread) {
                Feed::Incomplete => {
                    self.from = self.to;
                    Ok(None)
                }
                Feed::Frame { frame, consumed } => {
                    self.from += consumed;
                    (decode_server(&frame).map(Some)).map_err(|error| incompatible(&error))
                }
                Feed::Broken(error) => Err(incompatible(&error)),
            },
            Wire::Datagrams(_) => {
                self.from = self.to;
                match Frame::parse(unread) {
                    Ok(frame) => {
                        (decode_server(&frame).map(Some)).map_err(|error| incompatible(&error))
                    }
                    // No datagram yet, or a broken one.
                    Err(_) => Ok(None),
                }
            }
        }
    }
}

fn stream(address: SocketAddr, silence: Duration) -> io::Result<Wire> {
    let stream = TcpStream::connect_timeout(&address, silence)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(silence))?;
    stream.set_write_timeout(Some(silence))?;
    Ok(Wire::Stream(stream, Deframer::new()))
}

/// Opens a socket that receives from this server only.
fn datagrams(address: SocketAddr, silence: Duration) -> io::Result<Wire> {
    let any: SocketAddr = match address {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let socket = UdpSocket::bind(any)?;
    socket.connect(address)?;
    socket.set_write_timeout(Some(silence))?;
    Ok(Wire::Datagrams(socket))
}

/// True if no datagram came: the time is over, or the server was not there for an earlier datagram of ours.
fn is_nothing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock
            | ErrorKind::TimedOut
            | ErrorKind::ConnectionRefused
            | ErrorKind::ConnectionReset
    )
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
