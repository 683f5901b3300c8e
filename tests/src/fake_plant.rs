//! A machine that moves to its references and records every reference, tick by tick.

use std::net::TcpStream;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};

use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::units::{OffsetNm, PositionNm};
use gantry_tau_server::plant::{Plant, PlantError, Reading};

/// State of the machine, and the references it was written.
#[derive(Debug)]
pub struct Record<const N: usize> {
    /// Nominal references of the coming cycles.
    pub nominal: [PositionNm; N],
    /// Offsets in force: what the last `write` left, or what a test puts there.
    pub in_force: [Offsets; N],
    /// Nominal references in force.
    pub nominal_in_force: [PositionNm; N],
    /// Every `write`.
    pub written: Vec<[Reference; N]>,
    /// The drives cannot be enabled.
    pub start_fails: bool,
    /// The offsets in force cannot be read.
    pub offsets_fail: bool,
    /// `read` fails.
    pub read_fails: bool,
    /// `write` fails.
    pub write_fails: bool,
    /// Writes and read-backs that failed.
    pub failures: usize,
    /// A file whose contents every `write` looks at: a stop latch.
    pub latch: Option<PathBuf>,
    /// Contents of that file at the last `write`.
    pub latch_at_write: String,
    /// The process dies in the next `write`, before the drives have the references.
    pub dies: bool,
    /// A client's end of its connection, at which every `write` listens.
    pub ear: Option<TcpStream>,
    /// Writes that came after the client had been sent something.
    pub late_writes: usize,
}

impl<const N: usize> Record<N> {
    /// Nominal references and offsets in force.
    #[must_use]
    pub fn parts_in_force(&self) -> [InForce; N] {
        std::array::from_fn(|axis| InForce {
            nominal: self.nominal_in_force[axis],
            offsets: self.in_force[axis],
        })
    }
}

/// A bus with the machine on it; a test keeps one end, the server has the other. It outlives the
/// server, as drives do.
#[derive(Clone, Debug)]
pub struct Bus<const N: usize>(Arc<Mutex<Record<N>>>);

fn home(axis: usize) -> PositionNm {
    PositionNm(500_000_000 * (1 - 2 * i64::try_from(axis % 2).unwrap_or(0)))
}

impl<const N: usize> Default for Bus<N> {
    fn default() -> Self {
        Self(Arc::new(Mutex::new(Record {
            nominal: std::array::from_fn(home),
            nominal_in_force: std::array::from_fn(home),
            in_force: [Offsets::default(); N],
            written: Vec::new(),
            start_fails: false,
            offsets_fail: false,
            read_fails: false,
            write_fails: false,
            latch: None,
            latch_at_write: String::new(),
            dies: false,
            failures: 0,
            ear: None,
            late_writes: 0,
        })))
    }
}

impl<const N: usize> Bus<N> {
    /// The record, to look at and to change.
    pub fn record(&self) -> MutexGuard<'_, Record<N>> {
        self.0.lock().unwrap()
    }

    /// Offsets in force.
    #[must_use]
    pub fn in_force(&self) -> [Offsets; N] {
        self.record().in_force
    }

    /// Position offsets in force, nm.
    #[must_use]
    pub fn positions(&self) -> [i32; N] {
        self.in_force().map(|offsets| offsets.position.0)
    }

    /// Returns the number of references written.
    #[must_use]
    pub fn writes(&self) -> usize {
        self.record().written.len()
    }

    /// The last references written.
    #[must_use]
    pub fn last_written(&self) -> [Reference; N] {
        *self.record().written.last().expect("nothing was written")
    }
}

impl<const N: usize> Plant<N, N> for Bus<N> {
    type Error = PlantError;

    fn start(&mut self) -> Result<(), PlantError> {
        if self.record().start_fails {
            Err(failed("be enabled"))
        } else {
            Ok(())
        }
    }

    fn in_force(&mut self) -> Result<[InForce; N], PlantError> {
        let mut record = self.record();
        if record.offsets_fail {
            record.failures += 1;
            return Err(failed("read back the values in force"));
        }
        Ok(record.parts_in_force())
    }

    fn read(&mut self, _elapsed: u64) -> Result<Reading<N>, PlantError> {
        let record = self.record();
        if record.read_fails {
            return Err(failed("be read"));
        }
        let actual = record.nominal.map(|position| Actual {
            position,
            ..Actual::default()
        });
        Ok(Reading {
            nominal: record.nominal,
            actual,
            tool: None,
        })
    }

    fn write(
        &mut self,
        references: &[Reference; N],
        parts: &[InForce; N],
    ) -> Result<(), PlantError> {
        let mut record = self.record();
        if let Some(path) = record.latch.clone() {
            record.latch_at_write =
                std::fs::read_to_string(path).expect("the stop latch can be read");
        }
        if record.dies {
            drop(record);
            panic!("the process dies in a write");
        }
        if record.write_fails {
            record.failures += 1;
            return Err(failed("be written"));
        }
        let told = record.ear.as_ref().is_some_and(has_bytes);
        record.late_writes += usize::from(told);
        record.nominal_in_force = parts.map(|part| part.nominal);
        record.in_force =
            std::array::from_fn(|axis| offsets(&references[axis], parts[axis].nominal));
        record.written.push(*references);
        Ok(())
    }
}

/// True if something has arrived on a stream.
fn has_bytes(stream: &TcpStream) -> bool {
    stream.set_nonblocking(true).unwrap();
    let seen = stream.peek(&mut [0]);
    stream.set_nonblocking(false).unwrap();
    matches!(seen, Ok(1..))
}

/// Returns the offsets that a reference adds to the nominal.
fn offsets(reference: &Reference, nominal: PositionNm) -> Offsets {
    let position = reference.position.0 - nominal.0;
    Offsets {
        position: OffsetNm(position.try_into().unwrap()),
        velocity: reference.velocity_offset,
        torque: reference.torque_offset,
    }
}

const fn failed(operation: &'static str) -> PlantError {
    PlantError {
        operation,
        reason: "the test says so",
    }
}
