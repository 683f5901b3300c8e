//! The floats of a tick: nominal positions from a pose, offsets from a load.

use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::l2;
use gantry_tau_core::model::sensor::{ForceSensor, Reading};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{Metres, PositionNm};
use nalgebra::{Matrix3, Vector3};

use super::f1::{F1, F1Answer};
use super::robots::{self, F1_METRES_PER_Q};
use super::{AXES, Moment, Motion, Pose6, Refused};

/// Kinematics, compensators and sensor.
pub(crate) struct Work {
    sensor: ForceSensor,
    load: Wrench,
    l2: l2::Compensator,
    f1: F1,
}

/// What became of the pose and the load.
#[derive(Clone, Copy)]
pub(crate) enum Answer<'a> {
    /// By the L2.
    L2(Result<L2Answer, KinematicsError>),
    /// By the F1.
    F1(Result<&'a F1Answer, KinematicsError>),
}

/// One cycle of the L2.
#[derive(Clone, Copy)]
pub(crate) struct L2Answer {
    /// Positions of the carts.
    pub(crate) q: [f64; 3],
    /// The correction.
    pub(crate) correction: Correction<3>,
}

impl Work {
    /// Both machines, and the checksum of the F1.
    pub(crate) fn new() -> Result<(Self, u32), Refused> {
        let (robot, springs) = robots::l2().map_err(|_| Refused::Robot)?;
        let nominal =
            l2::Kinematics::new(&robot, &Matrix3::identity()).map_err(|_| Refused::Robot)?;
        let (f1, checksum) = F1::new()?;
        let work = Self {
            sensor: ForceSensor::new(robots::sensor()).map_err(|_| Refused::Compensation)?,
            load: Wrench::zero(),
            l2: l2::Compensator::new(&nominal, &springs, robots::compensation([1.0; 3]))
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
        let q = self.l2.machine().kinematics().inverse(&tcp_m)?;
        let correction = self.l2.correct_q(&q, &self.load)?;
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
                let mut metres = answer.ok()?.q.value;
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
