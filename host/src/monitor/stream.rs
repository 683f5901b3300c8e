//! Reader of a LabComm port with the samples `state` and `axes`, and if they are there `tool`, `session_event` and `drives`.

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use gantry_tau_labcomm::samples::SessionEvent;
use gantry_tau_labcomm::{Error, Event, Value};

use super::assembly::Assembly;
use super::known::{Kind, Known};
use super::recorded::Tap;
use super::snapshot::{MachineName, Snapshot};
use crate::dial::{self, Addresses, NEVER};
use crate::labcomm::Incoming;
use crate::output::printable;
use crate::publication::Machine;
use crate::server::event_log::EventKind;

/// Longest wait for a server to take the connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Bytes read at a time.
const CHUNK: usize = 65_536;
/// Reads in one visit: a bound on the work that a fast server can cause.
const READS: usize = 64;
/// Largest sample, bytes.
const MOST: u32 = 65_536;

/// Samples that a server must publish for a monitor, as `serve --labcomm` takes them.
pub const SAMPLES: &str = "state,axes,tool,session_event,drives,machine";

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
    /// A value has a text that is too long.
    #[error(
        "the port sends a sample `{name}` with a text above 256 bytes; server and monitor must be of the same version"
    )]
    LongText {
        /// The sample.
        name: &'static str,
    },
    /// A machine with another number of axes is recorded.
    #[error("the server sends {sent} axes, and the machine of --robot has {expected}; name its own with --robot")]
    OtherMachine {
        /// Axes of the server.
        sent: usize,
        /// Axes of the recording.
        expected: usize,
    },
    /// A machine with other kinematic parameters is recorded.
    #[error(
        "the server's machine has kinematics {sent:08x}, and that of --robot has {expected:08x}; name its own with --robot"
    )]
    OtherKinematics {
        /// Checksum of the server's machine.
        sent: u32,
        /// Checksum of the recording's.
        expected: u32,
    },
    /// A recording draws the machine, and the server does not say which it is.
    #[error(
        "the server does not say which machine it has, so that it cannot be drawn; it needs `serve --labcomm HOST:PORT={SAMPLES}`"
    )]
    UnknownMachine,
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
    /// Code of the kind, as in the sample `session_event`.
    pub kind: u8,
    /// Code of the phase or cause.
    pub code: u8,
    /// Description of the server; bytes that are not UTF-8 are replaced, control characters removed.
    pub text: String,
}

/// A connection to a server.
pub(super) struct Stream {
    socket: TcpStream,
    /// With room for 64 definitions in 16 KiB of names and types.
    incoming: Incoming<64, 16_384>,
    chunk: Vec<u8>,
    assembly: Assembly,
    known: Known,
    machine: Option<MachineName>,
}

impl Stream {
    /// Connects to a server.
    ///
    /// # Errors
    /// [`StreamError::Unreachable`].
    pub(super) fn connect(server: &Addresses) -> Result<Self, StreamError> {
        let address = server.first();
        let unreachable = |error: std::io::Error| StreamError::Unreachable { address, kind: error.kind() };
        let socket = dial::connect(server, CONNECT_TIMEOUT, &NEVER).map_err(unreachable)?;
        socket.set_nonblocking(true).map_err(unreachable)?;
        Ok(Self {
            socket,
            incoming: Incoming::new(MOST),
            chunk: vec![0; CHUNK],
            assembly: Assembly::default(),
            known: Known::default(),
            machine: None,
        })
    }

    /// Reads what has come; adds every event, and hands events and whole ticks to `tap`. Returns the number of bytes.
    ///
    /// # Errors
    /// [`StreamError`]; the stream is then to be dropped.
    pub(super) fn receive(
        &mut self,
        happened: &mut Vec<Happened>,
        tap: &mut Option<Box<dyn Tap>>,
    ) -> Result<usize, StreamError> {
        let received = self.read();
        while let Some(event) = self.incoming.next().map_err(StreamError::Format)? {
            match event {
                Event::Define(definition) => self.known.define(&definition)?,
                Event::Data { definition, value } => {
                    let kind = self.known.kind(definition.index)?;
                    self.assembly.expect_tool(self.known.has(Kind::Tool));
                    let sends_drives = self.known.has(Kind::Drives3) || self.known.has(Kind::Drives6);
                    self.assembly.expect_drives(sends_drives);
                    if kind == Some(Kind::Machine) {
                        self.machine = Some(machine_name(&value)?);
                        continue;
                    }
                    let told = happened.len();
                    take(kind, &value, &mut self.assembly, happened)?;
                    if let Some(tap) = tap {
                        happened.iter().skip(told).for_each(|event| tap.happened(event));
                        let machine = self.machine.as_ref();
                        self.assembly.take().map_or(Ok(()), |tick| tap.tick(&tick, machine))?;
                    }
                }
                Event::Version(_) | Event::Reference(_) | Event::Skipped(_) => {}
            }
        }
        received
    }

    /// Takes the bytes that have come. Returns their number.
    fn read(&mut self) -> Result<usize, StreamError> {
        let mut received = 0;
        for _ in 0..READS {
            match self.socket.read(&mut self.chunk) {
                Ok(0) => {
                    self.incoming.end();
                    return Err(StreamError::Closed);
                }
                Ok(count) => {
                    received += count;
                    self.incoming.push(self.chunk.get(..count).unwrap_or_default());
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(StreamError::Broken(error.kind())),
            }
        }
        Ok(received)
    }

    /// The latest whole tick.
    ///
    /// # Errors
    /// [`StreamError::UnknownCode`].
    pub(super) fn snapshot(&self) -> Result<Option<Snapshot>, StreamError> {
        let snapshot = self.assembly.snapshot()?;
        Ok(snapshot.map(|snapshot| Snapshot { machine: self.machine.clone(), ..snapshot }))
    }
}

/// Takes one sample; others than those of a monitor are passed over.
fn take(
    kind: Option<Kind>,
    value: &Value<'_, '_>,
    assembly: &mut Assembly,
    happened: &mut Vec<Happened>,
) -> Result<(), StreamError> {
    let Some(kind) = kind else { return Ok(()) };
    // The type is checked with the definition; only the length of a text is not.
    let long = |_| StreamError::LongText { name: kind.name() };
    match kind {
        Kind::State => assembly.state(value.read().map_err(long)?),
        Kind::Axes3 => assembly.axes::<3>(&value.read().map_err(long)?),
        Kind::Axes6 => assembly.axes::<6>(&value.read().map_err(long)?),
        Kind::Drives3 => assembly.drives::<3>(&value.read().map_err(long)?),
        Kind::Drives6 => assembly.drives::<6>(&value.read().map_err(long)?),
        Kind::Tool => assembly.tool(value.read().map_err(long)?),
        Kind::SessionEvent => {
            let event: SessionEvent = value.read().map_err(long)?;
            if event.kind == EventKind::MachineFailed.code() {
                assembly.machine_failed(event.tick);
            } else if event.kind == EventKind::RowsLost.code() {
                assembly.rows_lost();
            }
            let text = text(event.text.as_bytes());
            happened.push(Happened { tick: event.tick, kind: event.kind, code: event.cause, text });
        }
        // Taken before.
        Kind::Machine => {}
    }
    Ok(())
}

/// Reads the machine of a server.
///
/// # Errors
/// [`StreamError`]: a name that is too long, or a checksum of more than 32 bits.
fn machine_name(value: &Value<'_, '_>) -> Result<MachineName, StreamError> {
    let machine: Machine = value.read().map_err(|_| StreamError::LongText { name: Kind::Machine.name() })?;
    let kinematics =
        u32::try_from(machine.kinematics).map_err(|_| StreamError::OtherType { name: Kind::Machine.name() })?;
    Ok(MachineName { name: text(machine.name.as_bytes()), kinematics, lockstep: machine.lockstep != 0 })
}

/// Text of a server, on one line.
fn text(bytes: &[u8]) -> String {
    printable(&String::from_utf8_lossy(bytes))
}
