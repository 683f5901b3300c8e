//! Force samples out of a LabComm stream `[T 4.2.3, 4.2.5]`: found by name and type; everything
//! else is walked over.

use std::io::{self, Read};
use std::net::TcpStream;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use gantry_tau_labcomm::{Definition, Event, Type};
use gantry_tau_record::labcomm::{Stream, type_text};
use gantry_tau_server::links::closed;
use gantry_tau_system::dial::{self, Addresses};

use super::Sample;

/// Longest wait for the sensor to answer.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);
/// Bytes read at once.
const CHUNK: usize = 4_096;
/// Reads per visit: ten times what a server sends in a tick, and a bound on the work that a flood
/// of short samples can cause.
const READS: usize = 4;
/// Names of samples in a message at most.
const NAMES: usize = 8;
/// Largest value of any sample in the stream, bytes.
const MAX_VALUE: u32 = 1 << 20;

/// Reader of one sample; keeps the latest.
#[derive(Debug)]
pub struct LabcommSensor {
    socket: TcpStream,
    name: String,
    stream: Stream,
    latest: Option<Sample>,
}

impl LabcommSensor {
    /// Connects to a stream that defines a sample `name`.
    pub(super) fn connect(address: &Addresses, name: &str, quit: &AtomicBool) -> io::Result<Self> {
        let socket = dial::connect(address, CONNECT_TIMEOUT, quit)?;
        socket.set_nodelay(true)?;
        socket.set_nonblocking(true)?;
        Ok(Self {
            socket,
            name: name.to_owned(),
            stream: Stream::new(MAX_VALUE),
            latest: None,
        })
    }

    /// As [`super::SensorConnection::latest`].
    pub(super) fn latest(&mut self, tick: u64) -> io::Result<Option<Sample>> {
        let received = self.receive();
        while let Some(event) = self
            .stream
            .next_event()
            .map_err(|error| invalid(error.to_string()))?
        {
            if let Some(wrench) = wrench(&self.name, &event)? {
                self.latest = Some(Sample {
                    tick,
                    wrench,
                    is_cut: false,
                });
            }
        }
        received.map(|()| self.latest)
    }

    /// As [`super::SensorConnection::silence`].
    pub(super) fn silence(&self) -> String {
        let registry = self.stream.decoder().registry();
        if registry
            .iter()
            .any(|definition| is_named(&definition, &self.name))
        {
            return super::SILENCE.to_owned();
        }
        let names: Vec<String> = registry
            .iter()
            .take(NAMES)
            .map(|of| format!("{:?}", String::from_utf8_lossy(of.name)))
            .collect();
        let names = if names.is_empty() {
            "none".to_owned()
        } else {
            names.join(", ")
        };
        let more = if registry.iter().nth(NAMES).is_some() {
            ", ..."
        } else {
            ""
        };
        format!(
            "the stream does not define a sample {:?}; it defines {names}{more}",
            self.name
        )
    }

    /// Takes the bytes that have come.
    fn receive(&mut self) -> io::Result<()> {
        let mut chunk = [0; CHUNK];
        for _ in 0..READS {
            match self.socket.read(&mut chunk) {
                Ok(0) => {
                    self.stream.end();
                    return Err(closed());
                }
                Ok(count) => self.stream.push(chunk.get(..count).unwrap_or_default()),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// Force and moment, if an event has them.
fn wrench(name: &str, event: &Event<'_, '_>) -> io::Result<Option<[f64; 6]>> {
    match event {
        Event::Define(definition) if is_named(definition, name) => match components(&definition.ty)
        {
            Some(_) => Ok(None),
            None => Err(invalid(format!(
                "sample {name:?} has the type {}; expected [\"array\",[6],\"float\"] or [\"array\",[6],\"double\"]",
                type_text(&definition.ty)
            ))),
        },
        Event::Data { definition, value } if is_named(definition, name) => {
            let read = match components(&definition.ty) {
                Some(Components::Float) => {
                    value.read::<[f32; 6]>().map(|wrench| wrench.map(f64::from))
                }
                _ => value.read::<[f64; 6]>(),
            };
            read.map(Some).map_err(|error| invalid(error.to_string()))
        }
        _ => Ok(None),
    }
}

fn is_named(definition: &Definition<'_>, name: &str) -> bool {
    definition.name == name.as_bytes()
}

/// Kind of number of a wrench.
enum Components {
    Float,
    Double,
}

/// Returns the kind of number, if a type is six of them.
fn components(ty: &Type<'_>) -> Option<Components> {
    if ty.is::<[f32; 6]>() {
        Some(Components::Float)
    } else if ty.is::<[f64; 6]>() {
        Some(Components::Double)
    } else {
        None
    }
}

fn invalid(reason: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason)
}
