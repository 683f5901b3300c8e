//! A plant between a server and its machine that refuses writes and fails readings, and keeps what
//! the machine took.

use std::sync::{Arc, Mutex, MutexGuard};

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::units::PositionNm;
use gantry_tau_server::plant::{DriveState, Plant, PlantError, PlantFailure, Reading};
use gantry_tau_server::record::TickRecord;

use super::{AtDrive, Bench, Trouble};

/// References that the drives took, and the faults to come.
#[derive(Debug)]
struct Record<const N: usize, const M: usize> {
    motors: MotorMap<N, M>,
    references: [Reference; M],
    parts: [InForce; N],
    /// Parts in force by the machine's account.
    told: [InForce; N],
    trouble: Option<Trouble>,
}

/// The drives' side of a watched plant.
#[derive(Clone, Debug)]
pub(super) struct Watch<const N: usize, const M: usize>(Arc<Mutex<Record<N, M>>>);

impl<const N: usize, const M: usize> Watch<N, M> {
    fn record(&self) -> MutexGuard<'_, Record<N, M>> {
        self.0.lock().unwrap()
    }
}

impl<const N: usize, const M: usize> Bench<N> for Watch<N, M> {
    fn set(&mut self, trouble: Option<Trouble>) {
        self.record().trouble = trouble;
    }

    fn at_drives(&self) -> Vec<AtDrive> {
        let record = self.record();
        let motors = record.motors.axis_of_motor().iter().zip(&record.references);
        let at_drives = motors.map(|(axis, reference)| {
            let InForce {
                nominal,
                mut offsets,
            } = record.parts[*axis];
            (offsets.velocity, offsets.torque) =
                (reference.velocity_offset, reference.torque_offset);
            AtDrive {
                axis: *axis,
                reference_nm: reference.position.0,
                nominal_nm: nominal.0,
                offsets,
            }
        });
        at_drives.collect()
    }

    fn see(&mut self, _row: &TickRecord<N>) -> Result<(), String> {
        let record = self.record();
        if record.told == record.parts {
            Ok(())
        } else {
            Err(format!("the machine tells another: {record:?}"))
        }
    }
}

/// A plant with trouble.
#[derive(Debug)]
pub(super) struct Watched<P, const N: usize, const M: usize> {
    plant: P,
    watch: Watch<N, M>,
    /// A refused write acts all the same, and the machine goes on telling what was in force before:
    /// against what [`Plant::write`] promises.
    lies: bool,
}

impl<P: Plant<N, M>, const N: usize, const M: usize> Watched<P, N, M> {
    pub(super) fn new(mut plant: P, motors: MotorMap<N, M>, lies: bool) -> (Self, Watch<N, M>) {
        let parts = plant.in_force().unwrap_or_else(|error| panic!("{error}"));
        let references = motors.axis_of_motor().map(|axis| {
            let InForce { nominal, offsets } = parts[axis];
            let position = PositionNm(nominal.0 + i64::from(offsets.position.0));
            Reference {
                position,
                velocity_offset: offsets.velocity,
                torque_offset: offsets.torque,
            }
        });
        let record = Record {
            motors,
            references,
            parts,
            told: parts,
            trouble: None,
        };
        let watch = Watch(Arc::new(Mutex::new(record)));
        (
            Self {
                plant,
                watch: watch.clone(),
                lies,
            },
            watch,
        )
    }
}

impl<P: Plant<N, M>, const N: usize, const M: usize> Plant<N, M> for Watched<P, N, M> {
    type Error = PlantFailure;

    fn start(&mut self) -> Result<(), PlantFailure> {
        self.plant.start().map_err(|error| PlantFailure::of(&error))
    }

    fn in_force(&mut self) -> Result<[InForce; N], PlantFailure> {
        let told = self
            .plant
            .in_force()
            .map_err(|error| PlantFailure::of(&error))?;
        self.watch.record().told = if self.lies {
            self.watch.record().parts
        } else {
            told
        };
        Ok(told)
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<N>, PlantFailure> {
        // Its time goes on.
        let reading = self
            .plant
            .read(elapsed)
            .map_err(|error| PlantFailure::of(&error));
        if self.watch.record().trouble == Some(Trouble::Read) {
            return Err(PlantFailure::of(&PlantError {
                operation: "be read",
                reason: "the test says so",
            }));
        }
        reading
    }

    fn write(
        &mut self,
        references: &[Reference; M],
        parts: &[InForce; N],
    ) -> Result<(), PlantFailure> {
        let is_refused = self.watch.record().trouble == Some(Trouble::Write);
        if !is_refused {
            self.plant
                .write(references, parts)
                .map_err(|error| PlantFailure::of(&error))?;
        }
        if !is_refused || self.lies {
            let mut record = self.watch.record();
            (record.references, record.parts, record.told) = (*references, *parts, *parts);
        }
        if is_refused {
            Err(PlantFailure::of(&PlantError {
                operation: "be written",
                reason: "the test says so",
            }))
        } else {
            Ok(())
        }
    }

    fn drives(&self) -> Option<[DriveState; N]> {
        self.plant.drives()
    }

    fn reset(&mut self) {
        self.plant.reset();
    }
}
