//! Reader of a LabComm port with the samples `state` and `axes`, and if they are there `tool`,
//! `session_event` and `drives`.

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use gantry_tau_labcomm::samples::SessionEvent;
use gantry_tau_labcomm::{Error, Event, Field, Value};
use gantry_tau_record::labcomm::Incoming;
use gantry_tau_server::publication::MachineIdentity;
use gantry_tau_server::record::EventKind;
use gantry_tau_system::dial::{self, Addresses, NEVER};
use gantry_tau_system::output::printable;

use super::assembly::Assembly;
use super::machine::{MachineName, ServerMachine};
use super::recorded::Tap;
use super::sample_types::{SampleType, SampleTypes};
use super::snapshot::Snapshot;

/// Longest wait for a server to take the connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Bytes read at a time.
const CHUNK: usize = 65_536;
/// Reads in one visit: a bound on the work that a fast server can cause.
const READS: usize = 64;
/// Largest sample, bytes.
const MAX_SAMPLE: u32 = 65_536;

/// Samples that a server must publish for a monitor, as `serve --labcomm` takes them.
pub const SAMPLES: &str = "state,axes,tool,session_event,drives,machine";

/// Error of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StreamError {
    /// No server takes the connection.
    #[error(
        "no server answers on {address} ({kind}); start one with `gantry-tau serve --labcomm {address}={SAMPLES}`"
    )]
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
    #[error(
        "the port does not publish the sample `{name}`; it needs `serve --labcomm HOST:PORT={SAMPLES}`"
    )]
    Missing {
        /// The sample.
        name: &'static str,
    },
    /// A sample of this name has another type.
    #[error(
        "the port publishes a sample `{name}` of another type; server and monitor must be of the same version"
    )]
    OtherType {
        /// The sample.
        name: &'static str,
    },
    /// A value has a text that is too long.
    #[error(
        "the port sends a sample `{name}` with a text above 256 bytes (a robot file: above 16384); server and monitor must be of the same version"
    )]
    LongText {
        /// The sample.
        name: &'static str,
    },
    /// A machine with another number of axes is recorded.
    #[error(
        "the server sends {sent} axes, and the machine of --robot has {expected}; name its own with --robot"
    )]
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
    /// A recording is that of the server's machine, or draws it, and the server does not say which
    /// it is.
    #[error(
        "the server does not say which machine it has: it needs `serve --labcomm HOST:PORT={SAMPLES}`; CSV and LabComm are recorded with --robot as well"
    )]
    UnknownMachine,
    /// A recording is that of the server's machine, which is not built in, and whose robot file the
    /// server does not send.
    #[error(
        "the server's machine has kinematics {sent:08x}, and the server does not send its robot file; name it with --robot"
    )]
    UnknownKinematics {
        /// Checksum of the server's machine.
        sent: u32,
    },
    /// A code that this version does not know.
    #[error(
        "the server sends {field} {code}, which is unknown; server and monitor must be of the same version"
    )]
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
    /// Description of the server; bytes that are not UTF-8 are replaced, control characters
    /// removed.
    pub text: String,
}

/// A connection to a server.
pub(super) struct Stream {
    socket: TcpStream,
    /// With room for 64 definitions in 16 KiB of names and types.
    incoming: Incoming<64, 16_384>,
    chunk: Vec<u8>,
    assembly: Assembly,
    sample_types: SampleTypes,
    machine: Option<ServerMachine>,
}

impl Stream {
    /// Connects to a server.
    ///
    /// # Errors
    /// [`StreamError::Unreachable`].
    pub(super) fn connect(server: &Addresses) -> Result<Self, StreamError> {
        let socket = dial::connect(server, CONNECT_TIMEOUT, &NEVER)
            .and_then(|socket| socket.set_nonblocking(true).map(|()| socket))
            .map_err(|error| StreamError::Unreachable {
                address: server.first(),
                kind: error.kind(),
            })?;
        Ok(Self {
            socket,
            incoming: Incoming::new(MAX_SAMPLE),
            chunk: vec![0; CHUNK],
            assembly: Assembly::default(),
            sample_types: SampleTypes::default(),
            machine: None,
        })
    }

    /// Reads what has come; adds every event, and hands events and whole ticks to `tap`. Returns
    /// the number of bytes.
    ///
    /// # Errors
    /// [`StreamError`]; the stream is then to be dropped.
    pub(super) fn receive(
        &mut self,
        happened: &mut Vec<Happened>,
        tap: &mut Option<Box<dyn Tap>>,
    ) -> Result<usize, StreamError> {
        let received = self.read();
        while let Some(event) = self.incoming.next_event().map_err(StreamError::Format)? {
            match event {
                Event::Define(definition) => self.sample_types.define(&definition)?,
                Event::Data { definition, value } => {
                    let Some(sample) = self.sample_types.needed(definition.index)? else {
                        continue;
                    };
                    self.assembly
                        .expect_tool(self.sample_types.has(SampleType::Tool));
                    self.assembly.expect_drives(
                        self.sample_types.has(SampleType::Drives3)
                            || self.sample_types.has(SampleType::Drives6),
                    );
                    if sample == SampleType::Machine {
                        let machine = self.machine.insert(server_machine(&value)?);
                        if let Some(tap) = tap {
                            tap.machine(machine);
                        }
                        continue;
                    }
                    let before = happened.len();
                    add_sample(sample, &value, &mut self.assembly, happened)?;
                    if let Some(tap) = tap {
                        let new = happened.iter().skip(before);
                        new.for_each(|event| tap.happened(event));
                        self.assembly
                            .next_tick()
                            .map_or(Ok(()), |tick| tap.tick(&tick))?;
                    }
                }
                Event::Version(_) | Event::Reference(_) | Event::Skipped(_) => {}
            }
        }
        received
    }

    /// Reads the bytes that have come. Returns their number.
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
                    self.incoming
                        .push(self.chunk.get(..count).unwrap_or_default());
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(StreamError::Broken(error.kind())),
            }
        }
        Ok(received)
    }

    /// The machine; `None` until the server has named it.
    pub(super) const fn machine(&self) -> Option<&ServerMachine> {
        self.machine.as_ref()
    }

    /// The latest whole tick.
    ///
    /// # Errors
    /// [`StreamError::UnknownCode`].
    pub(super) fn snapshot(&self) -> Result<Option<Snapshot>, StreamError> {
        let snapshot = self.assembly.snapshot()?;
        Ok(snapshot.map(|snapshot| Snapshot {
            machine: self.machine.as_ref().map(|machine| machine.name.clone()),
            ..snapshot
        }))
    }
}

/// Adds a sample to its tick, or to the events.
fn add_sample(
    sample: SampleType,
    value: &Value<'_, '_>,
    assembly: &mut Assembly,
    happened: &mut Vec<Happened>,
) -> Result<(), StreamError> {
    match sample {
        SampleType::State => assembly.state(read(sample, value)?),
        SampleType::Axes3 => assembly.axes::<3>(&read(sample, value)?),
        SampleType::Axes6 => assembly.axes::<6>(&read(sample, value)?),
        SampleType::Drives3 => assembly.drives::<3>(&read(sample, value)?),
        SampleType::Drives6 => assembly.drives::<6>(&read(sample, value)?),
        SampleType::Tool => assembly.tool(read(sample, value)?),
        SampleType::SessionEvent => {
            let event: SessionEvent = read(sample, value)?;
            if event.kind == EventKind::MachineFailed.code() {
                assembly.machine_failed(event.tick);
            } else if event.kind == EventKind::RowsLost.code() {
                assembly.rows_lost();
            }
            happened.push(Happened {
                tick: event.tick,
                kind: event.kind,
                code: event.cause,
                text: one_line(event.text.as_bytes()),
            });
        }
        // It belongs to no tick.
        SampleType::Machine => {}
    }
    Ok(())
}

/// Reads a sample. Its type was checked with the definition; only the length of a text was not.
///
/// # Errors
/// [`StreamError::LongText`].
fn read<T: Field>(sample: SampleType, value: &Value<'_, '_>) -> Result<T, StreamError> {
    value.read().map_err(|_| StreamError::LongText {
        name: sample.name(),
    })
}

/// Reads the machine of a server.
///
/// # Errors
/// [`StreamError`]: a text that is too long, or a checksum of more than 32 bits.
fn server_machine(value: &Value<'_, '_>) -> Result<ServerMachine, StreamError> {
    let machine: MachineIdentity = read(SampleType::Machine, value)?;
    let kinematics = u32::try_from(machine.kinematics).map_err(|_| StreamError::OtherType {
        name: SampleType::Machine.name(),
    })?;
    Ok(ServerMachine {
        name: MachineName {
            name: one_line(machine.name.as_bytes()),
            kinematics,
            lockstep: machine.lockstep != 0,
        },
        robot_file: String::from_utf8_lossy(machine.robot_file.as_bytes()).into_owned(),
    })
}

/// Text of a server, on one line.
fn one_line(bytes: &[u8]) -> String {
    printable(&String::from_utf8_lossy(bytes))
}
