//! The floats of a tick: nominal positions from a pose, offsets from a load.

use gantry_tau_core::compensation::{Compensator, CompensatorConfig, Correction};
use gantry_tau_core::kinematics::{KinematicsError, Nominal};
use gantry_tau_core::sensor::{ForceSensor, Reading};
use gantry_tau_core::statics::Wrench;
use gantry_tau_core::units::{Metres, OffsetNm, PositionNm};
use nalgebra::{Matrix3, Vector3};

use super::f1::{F1, F1Answer};
use super::robots::{self, F1_METRES_PER_Q};
use super::{AXES, Moment, Motion, Refused};

/// A place, metres, and a rotation vector, radians.
pub(crate) type Pose6 = [f64; 6];

/// Largest correction of an axis.
const LIMIT: OffsetNm = OffsetNm(4_000_000);

/// Kinematics, compensators and sensor.
pub(crate) struct Work {
    sensor: ForceSensor,
    load: Wrench,
    l2: Compensator,
    f1: F1,
}

/// What became of the pose and the load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Answer<'a> {
    /// By the L2.
    L2(Result<L2Answer, KinematicsError>),
    /// By the F1.
    F1(Result<&'a F1Answer, KinematicsError>),
}

/// One cycle of the L2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct L2Answer {
    /// Positions of the carts.
    pub(crate) q: [f64; 3],
    /// The correction.
    pub(crate) correction: Correction,
}

impl Work {
    /// Both machines, and the checksum of the F1.
    #[inline(never)]
    pub(crate) fn new() -> Result<(Self, u32), Refused> {
        let (robot, springs) = robots::l2().map_err(|_| Refused::Robot)?;
        let nominal = Nominal::new(&robot, &Matrix3::identity()).map_err(|_| Refused::Robot)?;
        let (f1, checksum) = F1::new()?;
        let work = Self {
            sensor: ForceSensor::new(robots::sensor()).map_err(|_| Refused::Compensation)?,
            load: Wrench::zero(),
            l2: Compensator::new(&nominal, &springs, config([1.0; 3]))
                .map_err(|_| Refused::Compensation)?,
            f1,
        };
        Ok((work, checksum))
    }

    /// One cycle. A reading that is none leaves the load as it was.
    pub(crate) fn answer(&mut self, moment: &Moment) -> Answer<'_> {
        if let Ok(Reading::Load(load)) = self.sensor.update(&Wrench::from_array(moment.load)) {
            self.load = load;
        }
        match moment.motion {
            Motion::Given { .. } | Motion::L2 => Answer::L2(self.l2_cycle(&moment.pose)),
            Motion::F1 => Answer::F1(self.f1.cycle(&moment.pose, &self.load)),
        }
    }

    fn l2_cycle(&self, [x, y, z, ..]: &Pose6) -> Result<L2Answer, KinematicsError> {
        let tcp_m = Vector3::new(*x, *y, *z);
        let q = self.l2.model().nominal().inverse(&tcp_m)?;
        let correction = self.l2.correction(&q, &self.load)?;
        Ok(L2Answer { q, correction })
    }
}

impl Answer<'_> {
    /// Nominal positions of the server's axes; `None` without an answer, or when it is farther than any machine reaches.
    pub(crate) fn nominal(&self) -> Option<[PositionNm; AXES]> {
        let metres = match self {
            Self::L2(answer) => {
                let [one, two, three] = answer.ok()?.q;
                [one, two, three, 0.0, 0.0, 0.0]
            }
            Self::F1(answer) => {
                let mut metres = answer.ok()?.q.answer;
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

/// Gain, limits and units of either machine.
pub(super) fn config<const N: usize>(metres_per_q: [f64; N]) -> CompensatorConfig<N> {
    CompensatorConfig {
        gain: 1.0,
        limits: [LIMIT; N],
        metres_per_q,
    }
}
