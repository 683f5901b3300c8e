//! Float part of a cycle: nominal positions from a pose, offsets from a load.

use core::mem::MaybeUninit;

use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::l2;
use gantry_tau_core::model::nalgebra::{Matrix3, Vector3};
use gantry_tau_core::model::sensor::{ForceSensor, Reading};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{Metres, PositionNm};

use super::f1::{F1, F1Result};
use super::robots::{self, F1_METRES_PER_Q};
use super::{AXES, CycleInput, Motion, Pose6, SetupError};

/// Kinematics, compensators and force sensor.
pub(crate) struct ControlCycle {
    sensor: ForceSensor,
    load: Wrench,
    l2: l2::Compensator,
    f1: F1,
}

/// Result of the float part of a cycle.
#[derive(Clone, Copy)]
pub(crate) enum CycleResult<'a> {
    /// Of the L2.
    L2(Result<L2Result, KinematicsError>),
    /// Of the F1.
    F1(Result<&'a F1Result, KinematicsError>),
}

/// Result of one cycle of the L2.
#[derive(Clone, Copy)]
pub(crate) struct L2Result {
    /// Positions of the carts.
    pub(crate) q: [f64; 3],
    /// Offsets that hold the tool there.
    pub(crate) correction: Correction<3>,
}

impl ControlCycle {
    /// Builds both machines in `place`. Not inlined, so that its stack is free again before the
    /// server is built.
    #[inline(never)]
    pub(crate) fn write(place: &mut MaybeUninit<Self>) -> Result<&mut Self, SetupError> {
        let (robot, springs) = robots::l2().map_err(|_| SetupError::Robot)?;
        let kinematics =
            l2::Kinematics::new(&robot, &Matrix3::identity()).map_err(|_| SetupError::Robot)?;
        let cycle = Self {
            sensor: ForceSensor::new(robots::sensor()).map_err(|_| SetupError::Compensation)?,
            load: Wrench::zero(),
            l2: l2::Compensator::new(&kinematics, &springs, robots::compensation([1.0; 3]))
                .map_err(|_| SetupError::Compensation)?,
            f1: F1::new()?,
        };
        Ok(place.write(cycle))
    }

    /// Returns the checksum of the F1.
    pub(crate) const fn checksum(&self) -> u32 {
        self.f1.checksum
    }

    /// Runs one cycle. An invalid sample of the sensor leaves the load as it was.
    pub(crate) fn run(&mut self, input: &CycleInput) -> CycleResult<'_> {
        let sample = Wrench::from_array(input.load);
        match input.motion {
            Motion::Given | Motion::L2 => {
                // Its platform never turns.
                measure(
                    &mut self.sensor,
                    &mut self.load,
                    &sample,
                    &Matrix3::identity(),
                );
                CycleResult::L2(self.run_l2(&input.pose))
            }
            Motion::F1 => CycleResult::F1(self.run_f1(&input.pose, &sample)),
        }
    }

    fn run_f1(&mut self, pose: &Pose6, sample: &Wrench) -> Result<&F1Result, KinematicsError> {
        measure(
            &mut self.sensor,
            &mut self.load,
            sample,
            self.f1.locate(pose)?,
        );
        self.f1.carry(&self.load)
    }

    fn run_l2(&self, [x, y, z, ..]: &Pose6) -> Result<L2Result, KinematicsError> {
        let tcp_m = Vector3::new(*x, *y, *z);
        let q = self.l2.machine().kinematics().inverse(&tcp_m)?;
        let correction = self.l2.correct_q(&q, &self.load)?;
        Ok(L2Result { q, correction })
    }
}

fn measure(sensor: &mut ForceSensor, load: &mut Wrench, sample: &Wrench, rotation: &Matrix3<f64>) {
    if let Ok(Reading::Load(measured)) = sensor.update(sample, rotation) {
        *load = measured;
    }
}

impl CycleResult<'_> {
    /// Returns the nominal positions of the server's axes; `None` after an error, or beyond the
    /// range of positions.
    pub(crate) fn nominal(&self) -> Option<[PositionNm; AXES]> {
        let metres = match self {
            Self::L2(result) => {
                let [one, two, three] = result.ok()?.q;
                [one, two, three, 0.0, 0.0, 0.0]
            }
            Self::F1(result) => {
                let mut metres = result.ok()?.q.value;
                for (q, metres_per_q) in metres.iter_mut().zip(F1_METRES_PER_Q) {
                    *q *= metres_per_q;
                }
                metres
            }
        };
        let mut nominal = [PositionNm(0); AXES];
        for (position, metres) in nominal.iter_mut().zip(metres) {
            *position = PositionNm::from_metres(Metres(metres)).ok()?;
        }
        Some(nominal)
    }
}
