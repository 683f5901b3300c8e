//! A client that speaks frames, and any other bytes, over a real socket.

use std::io::{ErrorKind, Read, Write};
use std::mem::MaybeUninit;
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::Duration;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::message::{
    Capabilities, ClientMessage, Command, Hello, Mode, Refusal, ServerMessage, State, Welcome,
};
use gantry_tau_core::control::wire::{
    Deframer, Feed, Frame, FrameError, Notice, decode_server, encode_client,
};
use gantry_tau_core::units::{Epoch, OffsetNm, Sequence, Tick};
use socket2::{Domain, Socket, Type};

pub use gantry_tau_proofs::properties::wire::{crc_32 as crc32, sealed as enclose};

use crate::DEADLINE;

/// One connection, and what a well-behaved client would remember of it.
#[derive(Debug)]
pub struct Client<const N: usize> {
    socket: Socket,
    transport: Transport,
    deframer: Deframer,
    unread: Vec<u8>,
    /// Epoch of the session.
    pub epoch: Epoch,
    /// Sequence of the last command.
    pub sequence: u64,
    /// Tick of the last State.
    pub tick: Tick,
}

impl<const N: usize> Client<N> {
    /// Connects.
    #[must_use]
    pub fn connect(address: SocketAddr) -> Self {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
        socket.connect_timeout(&address.into(), DEADLINE).unwrap();
        Self::over(socket, Transport::Stream)
    }

    /// Connects with the smallest receive buffer there is.
    #[must_use]
    pub fn connect_narrow(address: SocketAddr) -> Self {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
        socket.set_recv_buffer_size(1).unwrap();
        socket.connect(&address.into()).unwrap();
        Self::over(socket, Transport::Stream)
    }

    /// Takes a UDP port; sends to this address, and hears it only.
    #[must_use]
    pub fn over_datagrams(address: SocketAddr) -> Self {
        let socket = Socket::new(Domain::IPV4, Type::DGRAM, None).unwrap();
        socket.connect(&address.into()).unwrap();
        Self::over(socket, Transport::Datagram)
    }

    fn over(socket: Socket, transport: Transport) -> Self {
        if transport == Transport::Stream {
            socket.set_tcp_nodelay(true).unwrap();
        }
        socket.set_read_timeout(Some(DEADLINE)).unwrap();
        socket.set_write_timeout(Some(DEADLINE)).unwrap();
        let (deframer, unread) = (Deframer::new(), Vec::new());
        Self {
            socket,
            transport,
            deframer,
            unread,
            epoch: Epoch(0),
            sequence: 0,
            tick: Tick(0),
        }
    }

    /// Sends any bytes; over datagrams in one.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        match self.transport {
            Transport::Stream => self.socket.write_all(bytes).unwrap(),
            Transport::Datagram => assert_eq!(self.socket.send(bytes).unwrap(), bytes.len()),
        }
    }

    /// Sends one message.
    pub fn send(&mut self, message: &ClientMessage<N>) {
        self.send_bytes(&encode_client(message));
    }

    /// Asks for the session.
    pub fn say_hello(&mut self) {
        self.send(&hello::<N>());
    }

    /// The command that answers the last State.
    pub fn command(&mut self, mode: Mode, positions: [i32; N]) -> Command<N> {
        self.sequence += 1;
        Command {
            epoch: self.epoch,
            sequence: Sequence(self.sequence),
            echo: self.tick,
            mode,
            targets: positions.map(|nm| Offsets {
                position: OffsetNm(nm),
                ..Offsets::default()
            }),
        }
    }

    /// The bytes of that command.
    pub fn frame(&mut self, mode: Mode, positions: [i32; N]) -> Vec<u8> {
        let command = self.command(mode, positions);
        encode_client(&ClientMessage::Command(command)).to_vec()
    }

    /// Returns the next message of the server; `None` when it has closed the connection.
    pub fn receive(&mut self) -> Option<ServerMessage<N>> {
        loop {
            match self.deframer.feed(&self.unread) {
                Feed::Frame { frame, consumed } => {
                    let message = decode_server(&frame).unwrap();
                    self.unread.drain(..consumed);
                    match message {
                        ServerMessage::Welcome(welcome) => self.epoch = welcome.epoch,
                        ServerMessage::State(state) => self.tick = state.tick,
                        ServerMessage::Refusal(_) => {}
                    }
                    return Some(message);
                }
                Feed::Incomplete => self.unread.clear(),
                Feed::Broken(error) => panic!("the server sent no frame: {error}"),
            }
            let mut chunk = [0; 4_096];
            match self.socket.read(&mut chunk) {
                Ok(count) if self.transport == Transport::Datagram => {
                    assert!(
                        Frame::parse(&chunk[..count]).is_ok(),
                        "a datagram is one frame"
                    );
                    self.unread.extend(&chunk[..count]);
                }
                Ok(0) => {
                    assert!(self.deframer.is_at_boundary(), "closed within a frame");
                    return None;
                }
                Ok(count) => self.unread.extend(&chunk[..count]),
                // A process that was stopped and goes on: a read with a deadline ends then.
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return None,
                Err(error) => panic!("nothing came from the server: {error}"),
            }
        }
    }

    /// The State that comes next.
    pub fn state(&mut self) -> State<N> {
        match self.receive() {
            Some(ServerMessage::State(state)) => state,
            other => panic!("not a State: {other:?}"),
        }
    }

    /// The Welcome that comes next; from here on the client knows its epoch.
    pub fn welcome(&mut self) -> Welcome<N> {
        match self.receive() {
            Some(ServerMessage::Welcome(welcome)) => welcome,
            other => panic!("not a Welcome: {other:?}"),
        }
    }

    /// The refusal that comes next, after which the server closes.
    pub fn refusal(&mut self) -> Refusal {
        match self.receive() {
            Some(ServerMessage::Refusal(refusal)) => {
                self.assert_closed();
                refusal
            }
            other => panic!("not a Refusal: {other:?}"),
        }
    }

    /// The notice that comes next, after which the server closes.
    pub fn notice(&mut self) -> Notice {
        let mut bytes = std::mem::take(&mut self.unread);
        if let Err(error) = self.socket.read_to_end(&mut bytes) {
            assert_eq!(error.kind(), ErrorKind::ConnectionReset);
        }
        assert_eq!(bytes.len(), 18, "one notice, and the end");
        let (front, checksum) = bytes.split_at(14);
        assert_eq!(checksum, crc32(front).to_le_bytes());
        match Frame::parse(&bytes) {
            Err(FrameError::Notice(notice)) => notice,
            other => panic!("not a notice: {other:?}"),
        }
    }

    /// The server has closed: nothing comes any more.
    pub fn assert_closed(&mut self) {
        let more = self.receive();
        assert!(more.is_none(), "not closed: {more:?}");
    }

    /// Nothing has come, and the connection is still open. Only what has arrived by now can be
    /// seen.
    #[must_use]
    pub fn is_quiet(&mut self) -> bool {
        self.socket.set_nonblocking(true).unwrap();
        let seen = self.socket.peek(&mut [MaybeUninit::uninit()]);
        self.socket.set_nonblocking(false).unwrap();
        matches!(seen, Err(error) if error.kind() == ErrorKind::WouldBlock)
    }

    /// Another handle of the same stream, for a thread that only writes.
    #[must_use]
    pub fn writer(&self) -> TcpStream {
        self.socket.try_clone().unwrap().into()
    }

    /// Says that it will send no more, and keeps reading.
    pub fn close_half(&self) {
        self.socket.shutdown(Shutdown::Write).unwrap();
    }

    /// Resets the connection: no goodbye, not even TCP's.
    pub fn reset(self) {
        self.socket.set_linger(Some(Duration::ZERO)).unwrap();
    }
}

/// The Hello of a client of `N` axes.
#[must_use]
pub fn hello<const N: usize>() -> ClientMessage<N> {
    ClientMessage::Hello(Hello {
        axes: N.try_into().unwrap(),
        capabilities: Capabilities::NONE,
    })
}

/// Seeded bytes, the same on every machine (xorshift64*).
#[derive(Clone, Debug)]
pub struct Noise(u64);

impl Noise {
    /// From a seed other than 0.
    #[must_use]
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number.
    pub const fn number(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }

    /// A number below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        let end = u64::try_from(end).unwrap();
        usize::try_from(self.number() % end).unwrap()
    }

    /// That many bytes.
    pub fn bytes(&mut self, count: usize) -> Vec<u8> {
        (0..count).map(|_| self.number().to_le_bytes()[7]).collect()
    }
}
