//! A client that speaks frames, and any other bytes, over a real socket.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{
    Capabilities, ClientMessage, Command, Hello, Mode, Refusal, ServerMessage, State, Welcome,
};
use gantry_tau_core::control::wire::{Deframer, Feed, decode_server, encode_client};
use gantry_tau_core::units::{Epoch, OffsetNm, Sequence, Tick};
use socket2::{Domain, SockRef, Socket, Type};

use crate::DEADLINE;

/// One connection, and what a well-behaved client would remember of it.
#[derive(Debug)]
pub struct Client<const N: usize> {
    stream: TcpStream,
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
        Self::over(TcpStream::connect_timeout(&address, DEADLINE).unwrap())
    }

    /// Connects with the smallest receive buffer there is.
    #[must_use]
    pub fn connect_narrow(address: SocketAddr) -> Self {
        let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
        socket.set_recv_buffer_size(1).unwrap();
        socket.connect(&address.into()).unwrap();
        Self::over(socket.into())
    }

    fn over(stream: TcpStream) -> Self {
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(DEADLINE)).unwrap();
        stream.set_write_timeout(Some(DEADLINE)).unwrap();
        Self { stream, deframer: Deframer::new(), unread: Vec::new(), epoch: Epoch(0), sequence: 0, tick: Tick(0) }
    }

    /// Sends bytes, whatever they are.
    pub fn send_bytes(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).unwrap();
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
            targets: positions.map(|nm| Offsets { position: OffsetNm(nm), ..Offsets::default() }),
        }
    }

    /// The bytes of that command.
    pub fn frame(&mut self, mode: Mode, positions: [i32; N]) -> Vec<u8> {
        let command = self.command(mode, positions);
        encode_client(&ClientMessage::Command(command)).to_vec()
    }

    /// Whatever the server says next; `None` when it has closed the connection.
    pub fn receive(&mut self) -> Option<ServerMessage<N>> {
        loop {
            match self.deframer.feed(&self.unread) {
                Feed::Frame { frame, consumed } => {
                    let message = decode_server(&frame).unwrap();
                    self.unread.drain(..consumed);
                    if let ServerMessage::State(state) = message {
                        self.tick = state.tick;
                    }
                    return Some(message);
                }
                Feed::Incomplete => self.unread.clear(),
                Feed::Broken(error) => panic!("the server sent no frame: {error}"),
            }
            let mut chunk = [0; 4_096];
            match self.stream.read(&mut chunk) {
                Ok(0) => {
                    assert!(self.deframer.is_at_boundary(), "closed within a frame");
                    return None;
                }
                Ok(count) => self.unread.extend(&chunk[..count]),
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
            Some(ServerMessage::Welcome(welcome)) => {
                self.epoch = welcome.epoch;
                welcome
            }
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

    /// The server has closed: nothing comes any more.
    pub fn assert_closed(&mut self) {
        let more = self.receive();
        assert!(more.is_none(), "not closed: {more:?}");
    }

    /// Nothing has come, and the connection is still open. Only what has arrived by now can be seen.
    #[must_use]
    pub fn is_quiet(&mut self) -> bool {
        self.stream.set_nonblocking(true).unwrap();
        let seen = self.stream.peek(&mut [0]);
        self.stream.set_nonblocking(false).unwrap();
        matches!(seen, Err(error) if error.kind() == ErrorKind::WouldBlock)
    }

    /// Another handle of the same stream, for a thread that only writes.
    #[must_use]
    pub fn writer(&self) -> TcpStream {
        self.stream.try_clone().unwrap()
    }

    /// Says that it will send no more, and keeps reading.
    pub fn close_half(&self) {
        self.stream.shutdown(std::net::Shutdown::Write).unwrap();
    }

    /// Resets the connection: no goodbye, not even TCP's.
    pub fn reset(self) {
        SockRef::from(&self.stream).set_linger(Some(Duration::ZERO)).unwrap();
    }
}

/// The Hello of a client of `N` axes.
#[must_use]
pub fn hello<const N: usize>() -> ClientMessage<N> {
    ClientMessage::Hello(Hello { axes: N.try_into().unwrap(), capabilities: Capabilities::NONE })
}

/// Any body of any kind in a frame with the right checksum, made without the core's encoder.
#[must_use]
pub fn enclose(version: u8, kind: u8, body: &[u8]) -> Vec<u8> {
    let length = u16::try_from(body.len()).unwrap().to_le_bytes();
    let mut frame = vec![b'G', b'T', version, kind, length[0], length[1]];
    frame.extend(body);
    frame.extend(crc32(&frame).to_le_bytes());
    frame
}

/// CRC-32/ISO-HDLC, bit by bit.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(crc & 1)))
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
