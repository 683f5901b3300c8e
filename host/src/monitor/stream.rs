//! Reader of a LabComm port with the samples `state`, `axes`, `tool` and `session_event`.

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use gantry_tau_core::control::message::MAX_AXES;
use gantry_tau_labcomm::samples::{Axes, SessionEvent, State, Tool};
use gantry_tau_labcomm::{Decoded, Decoder, Definition, Error, Event, Sample, Value};

use super::assembly::Assembly;
use super::snapshot::Snapshot;
use crate::server::event_log::EventKind;

/// Longest wait for a server to take the connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Bytes read at a time.
const CHUNK: usize = 65_536;
/// Reads in one visit: a bound on the work that a fast server can cause.
const READS: usize = 64;
/// Largest sample, bytes.
const MOST: u32 = 65_536;
/// Definitions in a stream, and bytes of their names and types.
type StreamDecoder = Decoder<64, 16_384>;

/// Samples that a server must publish for a monitor, as `serve --labcomm` takes them.
pub const SAMPLES: &str = "state,axes,tool,session_event";

/// Error of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// No server takes the connection.
    #[error("no server answers on {address} ({kind}); start one with `gantry-tau serve --labcomm {address}={SAMPLES}`")]
    Unreachable {
        /// Its address.
        address: SocketAddr,
        /// Reason of the system.
        kind: ErrorKind,
    },
    /// The connection has ended.
    #[error("the server has ended, or dropped this reader because it did not keep up")]
    Closed,
    /// The connection is broken.
    #[error("the connection to the server is broken ({0})")]
    Broken(ErrorKind),
    /// The bytes are not LabComm.
    #[error("the port does not send LabComm: {0}")]
    Format(Error),
    /// A sample is not published.
    #[error("the port does not publish the sample `{name}`; it needs `serve --labcomm HOST:PORT={SAMPLES}`")]
    Missing {
        /// The sample.
        name: &'static str,
    },
    /// A sample of this name has another type.
    #[error("the port publishes a sample `{name}` of another type; server and monitor must be of the same version")]
    OtherType {
        /// The sample.
        name: &'static str,
    },
    /// A code that this version does not know.
    #[error("the server sends {field} {code}, which is unknown; server and monitor must be of the same version")]
    UnknownCode {
        /// Field of the sample `state`.
        field: &'static str,
        /// The code.
        code: u8,
    },
}

/// Something that happened to a session or to the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Happened {
    /// Tick in which it happened.
    pub tick: i64,
    /// Description of the server; bytes that are not UTF-8 are replaced, control characters removed.
    pub text: String,
}

/// A connection to a server.
pub(super) struct Stream {
    socket: TcpStream,
    decoder: Box<StreamDecoder>,
    /// Bytes that are not decoded yet.
    bytes: Vec<u8>,
    chunk: Vec<u8>,
    assembly: Assembly,
    /// The definitions were complete when the first sample came.
    is_checked: bool,
}

impl Stream {
    /// Connects to a server.
    ///
    /// # Errors
    /// [`StreamError::Unreachable`].
    pub(super) fn connect(address: SocketAddr) -> Result<Self, StreamError> {
        let unreachable = |error: std::io::Error| StreamError::Unreachable { address, kind: error.kind() };
        let socket = TcpStream::connect_timeout(&address, CONNECT_TIMEOUT).map_err(unreachable)?;
        socket.set_nonblocking(true).map_err(unreachable)?;
        Ok(Self {
            socket,
            decoder: Box::new(StreamDecoder::new(MOST)),
            bytes: Vec::new(),
            chunk: vec![0; CHUNK],
            assembly: Assembly::default(),
            is_checked: false,
        })
    }

    /// Reads what has come, and calls `each` with every event. Returns the number of bytes.
    ///
    /// # Errors
    /// [`StreamError`]; the stream is then to be dropped.
    pub(super) fn receive(&mut self, each: &mut impl FnMut(Happened)) -> Result<usize, StreamError> {
        let mut received = 0;
        for _ in 0..READS {
            match self.socket.read(&mut self.chunk) {
                Ok(0) => return Err(StreamError::Closed),
                Ok(count) => {
                    received += count;
                    self.bytes.extend_from_slice(self.chunk.get(..count).unwrap_or_default());
                    self.decode(each)?;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(StreamError::Broken(error.kind())),
            }
        }
        Ok(received)
    }

    /// Decodes whole events from the front of the bytes.
    fn decode(&mut self, each: &mut impl FnMut(Happened)) -> Result<(), StreamError> {
        let mut at = 0;
        loop {
            let rest = self.bytes.get(at..).unwrap_or_default();
            match self.decoder.decode(rest).map_err(StreamError::Format)? {
                Decoded::Need(_) => break,
                Decoded::Event { event, used } => {
                    if let Event::Data { definition, value } = event {
                        take(&definition, &value, &mut self.assembly, each)?;
                    }
                    at += used;
                    if !self.is_checked && matches!(event, Event::Data { .. }) {
                        self.check()?;
                    }
                }
            }
        }
        self.bytes.drain(..at);
        Ok(())
    }

    /// Checks that the needed samples are defined.
    fn check(&mut self) -> Result<(), StreamError> {
        let registry = self.decoder.registry();
        for name in [State::NAME, Axes::<MAX_AXES>::NAME] {
            if !registry.iter().any(|definition| definition.name == name.as_bytes()) {
                return Err(StreamError::Missing { name });
            }
        }
        if registry.iter().any(|definition| definition.is::<Tool>()) {
            self.assembly.expect_tool();
        }
        self.is_checked = true;
        Ok(())
    }

    /// The latest whole tick.
    ///
    /// # Errors
    /// [`StreamError::UnknownCode`].
    pub(super) fn snapshot(&self) -> Result<Option<Snapshot>, StreamError> {
        self.assembly.snapshot()
    }
}

/// Takes one sample; others than those of a monitor are passed over.
fn take(
    definition: &Definition<'_>,
    value: &Value<'_, '_>,
    assembly: &mut Assembly,
    each: &mut impl FnMut(Happened),
) -> Result<(), StreamError> {
    let of_type = |name: &'static str| move |_| StreamError::OtherType { name };
    if definition.is::<State>() {
        assembly.state(value.read().map_err(of_type(State::NAME))?);
    } else if definition.is::<Axes<3>>() {
        assembly.axes::<3>(&value.read().map_err(of_type(Axes::<3>::NAME))?);
    } else if definition.is::<Axes<6>>() {
        assembly.axes::<6>(&value.read().map_err(of_type(Axes::<6>::NAME))?);
    } else if definition.is::<Tool>() {
        assembly.tool(value.read().map_err(of_type(Tool::NAME))?);
    } else if definition.is::<SessionEvent>() {
        let event: SessionEvent = value.read().map_err(of_type(SessionEvent::NAME))?;
        if event.kind == EventKind::MachineFailed as u8 {
            assembly.machine_failed(event.tick);
        }
        let text = String::from_utf8_lossy(event.text.as_bytes());
        each(Happened { tick: event.tick, text: text.chars().filter(|letter| !letter.is_control()).collect() });
    } else {
        let known = [State::NAME, Axes::<3>::NAME, Tool::NAME, SessionEvent::NAME];
        if let Some(name) = known.into_iter().find(|name| name.as_bytes() == definition.name) {
            return Err(StreamError::OtherType { name });
        }
    }
    Ok(())
}
