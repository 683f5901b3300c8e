//! A client's session over sockets: core's protocol over a TCP stream or UDP datagrams, and the time-outs.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Answer, Client, Event, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{Mode, Welcome};
use gantry_tau_core::control::wire::FrameBytes;

use super::ClientError;

/// Bytes read at a time: several States.
const CHUNK: usize = 4_096;
/// Time without an answer after which the Hello is repeated over UDP.
const HELLO_AGAIN: Duration = Duration::from_millis(200);

/// A connection to a server of `N` axes.
#[derive(Debug)]
pub struct Connection<const N: usize> {
    wire: Wire,
    client: Client<N>,
    silence: Duration,
    chunk: [u8; CHUNK],
    /// Bytes of the chunk that the client has not taken yet.
    from: usize,
    to: usize,
}

#[derive(Debug)]
enum Wire {
    Stream(TcpStream),
    Datagrams(UdpSocket),
}

impl<const N: usize> Connection<N> {
    /// Connects to a server. Over UDP nothing is sent yet, so the server may be absent.
    /// A server that is silent for `silence` counts as vanished.
    ///
    /// # Errors
    /// [`ClientError::Unreachable`].
    pub fn open(
        transport: Transport,
        address: SocketAddr,
        silence: Duration,
        requirements: Requirements,
    ) -> Result<Self, ClientError> {
        let wire = match transport {
            Transport::Stream => stream(address, silence),
            Transport::Datagram => datagrams(address, silence),
        };
        let wire = wire.map_err(|error| ClientError::Unreachable { what: "server", address, error })?;
        Ok(Self { wire, client: Client::new(transport, requirements), silence, chunk: [0; CHUNK], from: 0, to: 0 })
    }

    /// Sends Hello and waits for the Welcome. Over UDP the Hello is repeated, for as long as `silence`: a server whose Welcome was lost
    /// refuses until it has given up that session.
    ///
    /// # Errors
    /// [`ClientError::Refused`]; as [`Self::next_event`].
    pub fn greet(&mut self) -> Result<Welcome<N>, ClientError> {
        let since = Instant::now();
        while since.elapsed() < self.silence {
            let hello = self.client.hello();
            let sent = hello.map_or(Ok(()), |frame| self.send(&frame));
            match self.event_within(HELLO_AGAIN) {
                Ok(Some(Event::Welcomed(welcome))) => return Ok(welcome),
                Ok(Some(Event::Refused(refusal))) => return Err(ClientError::Refused(refusal)),
                Ok(_) => sent?,
                // A server without room refuses before it has received the Hello, and closes: the Refusal counts more.
                Err(error) => return sent.and(Err(error)),
            }
        }
        Err(ClientError::Vanished("it does not answer".to_owned()))
    }

    /// Sends the answer to the newest State, if it waits for one.
    ///
    /// # Errors
    /// [`ClientError::Vanished`].
    pub fn answer(&mut self, mode: Mode, targets: &[Offsets; N]) -> Result<Option<Answer<N>>, ClientError> {
        let answer = self.client.answer(mode, targets);
        if let Some(answer) = &answer {
            self.send(&answer.frame)?;
        }
        Ok(answer)
    }

    /// Sends Goodbye, over UDP again for each State since. The session is over with [`Event::Ended`].
    ///
    /// # Errors
    /// [`ClientError::Vanished`].
    pub fn goodbye(&mut self) -> Result<(), ClientError> {
        let goodbye = self.client.goodbye();
        goodbye.map_or(Ok(()), |frame| self.send(&frame))
    }

    /// Waits for the next event.
    ///
    /// # Errors
    /// [`ClientError::Vanished`] after silence or a closed connection; [`ClientError::Incompatible`] if the server breaks the protocol.
    pub fn next_event(&mut self) -> Result<Event<N>, ClientError> {
        self.event_within(self.silence)?
            .ok_or_else(|| ClientError::Vanished("it has been silent for too long".to_owned()))
    }

    /// True if more was read than the client has taken: then the newest State is not the latest.
    #[must_use]
    pub const fn has_unread_bytes(&self) -> bool {
        self.from < self.to
    }

    fn send(&mut self, frame: &FrameBytes) -> Result<(), ClientError> {
        let sent = match &mut self.wire {
            Wire::Stream(stream) => stream.write_all(frame),
            Wire::Datagrams(socket) => match socket.send(frame) {
                // The server is absent; the silence that follows is the error.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(()),
                sent => sent.map(|_| ()),
            },
        };
        sent.map_err(|error| ClientError::Vanished(vanished(&error)))
    }

    /// Waits for the next event, over UDP no longer than `patience`; `None` if none came.
    fn event_within(&mut self, patience: Duration) -> Result<Option<Event<N>>, ClientError> {
        let since = Instant::now();
        loop {
            while self.has_unread_bytes() {
                let unread = self.chunk.get(self.from..self.to).unwrap_or_default();
                let (consumed, event) = self.client.feed(unread);
                self.from += consumed;
                if let Some(event) = event? {
                    return Ok(Some(event));
                }
            }
            let (read, is_stream) = match &mut self.wire {
                Wire::Stream(stream) => (stream.read(&mut self.chunk), true),
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
}

fn stream(address: SocketAddr, silence: Duration) -> io::Result<Wire> {
    let stream = TcpStream::connect_timeout(&address, silence)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(silence))?;
    stream.set_write_timeout(Some(silence))?;
    Ok(Wire::Stream(stream))
}

fn datagrams(address: SocketAddr, silence: Duration) -> io::Result<Wire> {
    let socket = connected_datagrams(address)?;
    socket.set_write_timeout(Some(silence))?;
    Ok(Wire::Datagrams(socket))
}

/// Opens a socket that receives from this server only.
pub(crate) fn connected_datagrams(server: SocketAddr) -> io::Result<UdpSocket> {
    let any: SocketAddr = match server {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let socket = UdpSocket::bind(any)?;
    socket.connect(server)?;
    Ok(socket)
}

/// True if no datagram came: the time is over, or the server was absent when an earlier datagram was sent.
fn is_nothing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset
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
