//! A client's session over sockets: core's protocol over a TCP stream or UDP datagrams, and the
//! time-outs.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Answer, Client, Event, Requirements};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::{Key, KeyId};
use gantry_tau_core::control::message::{Mode, Phase, Welcome};
use gantry_tau_core::control::wire::FrameBytes;
use gantry_tau_server::key_file;
use gantry_tau_system::dial::{self, Addresses, LOOK, NEVER};

use super::ClientError;

/// Bytes read at a time: several States.
const CHUNK: usize = 4_096;
/// Time without an answer after which a Hello or a Goodbye is repeated over UDP.
const AGAIN: Duration = Duration::from_millis(200);

/// A connection to a server of `N` axes.
///
/// Each step (to connect, to be welcomed, to hear the next State, to leave) has one deadline,
/// `patience`, however many bytes come meanwhile.
#[derive(Debug)]
pub struct Connection<'q, const N: usize> {
    wire: Wire,
    server: Addresses,
    client: Client<N>,
    requirements: Requirements,
    /// Name of the key, with one.
    key: Option<KeyId>,
    patience: Duration,
    /// Ends every wait but that for the end of a session that is left.
    quit: &'q AtomicBool,
    /// The Hello and the Goodbye, which are repeated over UDP.
    hello: Option<FrameBytes>,
    goodbye: Option<FrameBytes>,
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

/// End of a wait.
enum Heard<const N: usize> {
    Event(Event<N>),
    /// The time is over.
    Nothing,
    /// The switch was set.
    Quit,
}

impl<const N: usize> Connection<'static, N> {
    /// Connects to a server. Over UDP nothing is sent yet, so the server may be absent.
    /// A server that takes longer than `patience` for any step counts as vanished.
    ///
    /// # Errors
    /// [`ClientError::Unreachable`].
    pub fn open(
        transport: Transport,
        server: impl Into<Addresses>,
        patience: Duration,
        requirements: Requirements,
    ) -> Result<Self, ClientError> {
        Connection::open_unless(&NEVER, transport, server, patience, requirements)
    }
}

impl<'q, const N: usize> Connection<'q, N> {
    /// As [`Self::open`]; every wait ends when `quit` is set, with [`ClientError::Quit`].
    ///
    /// # Errors
    /// [`ClientError::Unreachable`]; [`ClientError::Quit`].
    pub fn open_unless(
        quit: &'q AtomicBool,
        transport: Transport,
        server: impl Into<Addresses>,
        patience: Duration,
        requirements: Requirements,
    ) -> Result<Self, ClientError> {
        let server = server.into();
        let wire = match transport {
            Transport::Stream => stream(&server, patience, quit),
            Transport::Datagram => datagrams(server.first()),
        };
        let wire = wire.map_err(|error| ClientError::unreachable("server", &server, error))?;
        let client = Client::new(transport, requirements);
        let chunk = [0; CHUNK];
        Ok(Self {
            wire,
            server,
            client,
            requirements,
            key: None,
            patience,
            quit,
            hello: None,
            goodbye: None,
            chunk,
            from: 0,
            to: 0,
        })
    }

    /// Speaks to a server that has this key, and hears nothing else. Before the Hello.
    ///
    /// # Errors
    /// [`ClientError::Setup`]: the system gives no random numbers.
    pub fn with_key(self, key: Option<Key>) -> Result<Self, ClientError> {
        let Some(key) = key else { return Ok(self) };
        let transport = if self.is_stream() {
            Transport::Stream
        } else {
            Transport::Datagram
        };
        let nonce = key_file::random().map_err(|error| ClientError::Setup(error.to_string()))?;
        Ok(Self {
            key: Some(key.id()),
            client: Client::keyed(transport, self.requirements, key, nonce),
            ..self
        })
    }

    /// Sends Hello and waits for the Welcome. Over UDP the Hello is repeated: a server whose
    /// Welcome was lost refuses until it has given up that session; and each address of the server
    /// has its turn.
    ///
    /// # Errors
    /// [`ClientError::Refused`]; [`ClientError::Quit`]; as [`Self::next_event`].
    pub fn greet(&mut self) -> Result<Welcome<N>, ClientError> {
        let mut is_challenged = false;
        self.ask(&mut is_challenged).map_err(|error| match (error, self.key) {
            (ClientError::Vanished(_), Some(id)) if !is_challenged => ClientError::Vanished(format!(
                "no answer: wrong key? its id here is {id}; compare with `gantry-tau key show-id` at the server"
            )),
            (error, _) => error,
        })
    }

    fn ask(&mut self, is_challenged: &mut bool) -> Result<Welcome<N>, ClientError> {
        let until = Instant::now() + self.patience;
        loop {
            let hello = self.client.hello();
            let sent = hello.as_ref().map_or(Ok(()), |frame| self.send(frame));
            self.hello = hello.or(self.hello.take());
            match self.hear(until.min(Instant::now() + AGAIN)) {
                Ok(Heard::Event(Event::Welcomed(welcome))) => return Ok(welcome),
                Ok(Heard::Event(Event::Refused(refusal))) => {
                    return Err(ClientError::Refused(refusal));
                }
                Ok(Heard::Event(Event::Challenged)) => {
                    *is_challenged = true;
                    continue;
                }
                Ok(Heard::Quit) => return Err(ClientError::Quit),
                Ok(_) => sent?,
                // A server without room refuses before it has received the Hello, and closes: the
                // Refusal counts more.
                Err(error) => return sent.and(Err(error)),
            }
            if Instant::now() >= until {
                return Err(ClientError::Vanished("it does not answer".to_owned()));
            }
            // A cookie is that of one address.
            if !*is_challenged {
                self.try_the_next_address()?;
            }
        }
    }

    /// Sends the answer to the newest State, if it waits for one.
    ///
    /// # Errors
    /// [`ClientError::Vanished`].
    pub fn answer(
        &mut self,
        mode: Mode,
        targets: &[Offsets; N],
    ) -> Result<Option<Answer<N>>, ClientError> {
        let answer = self.client.answer(mode, targets);
        if let Some(answer) = &answer {
            self.send(&answer.frame)?;
        }
        Ok(answer)
    }

    /// Sends Goodbye, over UDP again for each State since. The session is over with
    /// [`Event::Ended`].
    ///
    /// # Errors
    /// [`ClientError::Vanished`].
    pub fn goodbye(&mut self) -> Result<(), ClientError> {
        let Some(goodbye) = self.client.goodbye() else {
            return Ok(());
        };
        let sent = self.send(&goodbye);
        self.goodbye = Some(goodbye);
        sent
    }

    /// Sends Goodbye and waits until the server has received it: a connection closed at once would
    /// be the cause of the end instead. The ramp that follows is the server's. Returns the number
    /// of States until then.
    ///
    /// # Errors
    /// [`ClientError::Vanished`]; the Goodbye was not acknowledged, and what ends the session is
    /// the closed connection or the silence.
    pub fn leave(&mut self) -> Result<u64, ClientError> {
        let until = Instant::now() + self.patience;
        self.quit = &NEVER;
        let mut states = 0_u64;
        loop {
            self.goodbye()?;
            match self.hear(until.min(Instant::now() + AGAIN))? {
                Heard::Event(Event::Ended(_)) => return Ok(states.saturating_add(1)),
                Heard::Event(_) => states = states.saturating_add(1),
                Heard::Nothing | Heard::Quit => self.repeat(self.goodbye.clone())?,
            }
            if Instant::now() >= until {
                return Err(ClientError::Vanished(
                    "it has not acknowledged the Goodbye".to_owned(),
                ));
            }
        }
    }

    /// Waits for the next event.
    ///
    /// # Errors
    /// [`ClientError::Vanished`] after silence or a closed connection;
    /// [`ClientError::Incompatible`] if the server breaks the protocol; [`ClientError::Quit`].
    pub fn next_event(&mut self) -> Result<Event<N>, ClientError> {
        let until = Instant::now() + self.patience;
        loop {
            // In the handshake over UDP a server sends a State for each frame that it hears: one
            // that was lost is asked for.
            let is_handshake =
                !self.is_stream() && matches!(self.client.phase(), None | Some(Phase::Handshake));
            let wait = if is_handshake {
                until.min(Instant::now() + AGAIN)
            } else {
                until
            };
            match self.hear(wait)? {
                Heard::Event(event) => return Ok(event),
                Heard::Quit => return Err(ClientError::Quit),
                Heard::Nothing if Instant::now() >= until => {
                    return Err(ClientError::Vanished(
                        "it has been silent for too long".to_owned(),
                    ));
                }
                Heard::Nothing => self.repeat(self.hello.clone())?,
            }
        }
    }

    /// True if more was read than the client has taken: then the newest State is not the latest.
    #[must_use]
    pub const fn has_unread_bytes(&self) -> bool {
        self.from < self.to
    }

    const fn is_stream(&self) -> bool {
        matches!(self.wire, Wire::Stream(_))
    }

    /// Sends a frame again, over UDP: there it may be lost.
    fn repeat(&mut self, frame: Option<FrameBytes>) -> Result<(), ClientError> {
        frame
            .filter(|_| !self.is_stream())
            .map_or(Ok(()), |frame| self.send(&frame))
    }

    /// Takes the next address of a server that does not answer over UDP, where a connection is no
    /// answer.
    fn try_the_next_address(&mut self) -> Result<(), ClientError> {
        self.server.rotate();
        if self.is_stream() || self.server.iter().count() == 1 {
            return Ok(());
        }
        let address = self.server.first();
        self.wire = datagrams(address)
            .map_err(|error| ClientError::unreachable("server", &self.server, error))?;
        Ok(())
    }

    /// Sends a frame. A stream that does not take one for [`LOOK`] has a server that has not read
    /// for thousands of frames.
    fn send(&mut self, frame: &FrameBytes) -> Result<(), ClientError> {
        let sent = match &mut self.wire {
            Wire::Stream(stream) => match stream.write(frame) {
                Ok(count) if count < frame.len() => Err(ErrorKind::TimedOut.into()),
                sent => sent,
            },
            Wire::Datagrams(socket) => match socket.send(frame) {
                // The server is absent; the silence that follows is the error.
                Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(0),
                sent => sent,
            },
        };
        sent.map(drop)
            .map_err(|error| ClientError::Vanished(vanished(&error)))
    }

    /// Waits for the next event, until a time or until the switch is set.
    fn hear(&mut self, until: Instant) -> Result<Heard<N>, ClientError> {
        loop {
            while self.has_unread_bytes() {
                let unread = self.chunk.get(self.from..self.to).unwrap_or_default();
                let mut received = self.client.feed(unread);
                let event = received.poll_event();
                self.from = self.to.saturating_sub(received.left());
                if let Some(event) = event {
                    return Ok(Heard::Event(event?));
                }
            }
            if self.quit.load(Ordering::Relaxed) {
                return Ok(Heard::Quit);
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(Heard::Nothing);
            }
            let read = self
                .read(left.min(LOOK))
                .map_err(|error| ClientError::Vanished(vanished(&error)))?;
            (self.from, self.to) = (0, read);
        }
    }

    /// Reads what has come or comes within a time. Returns the number of bytes; none of a datagram
    /// that is empty or did not come.
    fn read(&mut self, within: Duration) -> io::Result<usize> {
        let (read, is_stream) = match &mut self.wire {
            Wire::Stream(stream) => (
                stream
                    .set_read_timeout(Some(within))
                    .and_then(|()| stream.read(&mut self.chunk)),
                true,
            ),
            Wire::Datagrams(socket) => (
                socket
                    .set_read_timeout(Some(within))
                    .and_then(|()| socket.recv(&mut self.chunk)),
                false,
            ),
        };
        match read {
            Ok(0) if is_stream => Err(ErrorKind::UnexpectedEof.into()),
            Err(error) if is_no_byte(&error) || !is_stream && is_no_datagram(&error) => Ok(0),
            read => read,
        }
    }
}

fn stream(server: &Addresses, patience: Duration, quit: &AtomicBool) -> io::Result<Wire> {
    let stream = dial::connect(server, patience, quit)?;
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(LOOK))?;
    Ok(Wire::Stream(stream))
}

fn datagrams(server: SocketAddr) -> io::Result<Wire> {
    let socket = connected_datagrams(server)?;
    socket.set_write_timeout(Some(LOOK))?;
    Ok(Wire::Datagrams(socket))
}

/// Opens a socket that receives from this server only.
pub fn connected_datagrams(server: SocketAddr) -> io::Result<UdpSocket> {
    let any: SocketAddr = match server {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let socket = UdpSocket::bind(any)?;
    socket.connect(server)?;
    Ok(socket)
}

/// True if the time to wait is over, or the wait was interrupted.
fn is_no_byte(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

/// True if the server was absent when an earlier datagram was sent.
fn is_no_datagram(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset
    )
}

fn vanished(error: &io::Error) -> String {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => {
            "it does not read what is sent to it".to_owned()
        }
        ErrorKind::UnexpectedEof => "it closed the connection".to_owned(),
        ErrorKind::ConnectionReset | ErrorKind::BrokenPipe | ErrorKind::ConnectionAborted => {
            "its connection was reset".to_owned()
        }
        _ => error.to_string(),
    }
}
