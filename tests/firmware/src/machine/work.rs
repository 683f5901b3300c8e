//! The floats of a tick: nominal positions from a pose, offsets from a load.

use gantry_tau_core::compensation::{
    Compensator, CompensatorConfig, Correction, SixLinkCompensator, SixLinkElastic,
};
use gantry_tau_core::kinematics::{
    KinematicsError, Nominal, Pose, SixLinkKinematics, Solved, WARM_ITERATIONS,
};
use gantry_tau_core::linalg::rotation_from_vector;
use gantry_tau_core::sensor::{ForceSensor, Reading};
use gantry_tau_core::statics::{LineMatrix, Wrench};
use gantry_tau_core::units::{Metres, OffsetNm, PositionNm};
use nalgebra::{Matrix3, SMatrix, Vector3};

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
    f1: SixLinkCompensator,
    f1_kinematics: SixLinkKinematics,
    /// The pose of the F1 in the tick before, and its plates.
    before: Option<(Pose, [f64; 3])>,
}

/// What became of the pose and the load.
#[allow(
    clippy::large_enum_variant,
    reason = "one lives at a time, and nothing is allocated"
)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Answer {
    /// By the L2.
    L2(Result<L2Answer, KinematicsError>),
    /// By the F1.
    F1(Result<F1Answer, KinematicsError>),
}

/// One cycle of the L2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct L2Answer {
    /// Positions of the carts.
    pub(crate) q: [f64; 3],
    /// The correction.
    pub(crate) correction: Correction,
}

/// One cycle of the F1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct F1Answer {
    /// Positions of the axes.
    pub(crate) q: Solved<[f64; AXES]>,
    /// Where these take the tool, from the pose of the cycle before.
    pub(crate) pose: Solved<Pose>,
    /// Twist over axes.
    pub(crate) jacobian: SMatrix<f64, 6, AXES>,
    /// Link tensions, N.
    pub(crate) forces_n: [f64; 6],
    /// Loads of the axes.
    pub(crate) loads: [f64; AXES],
    /// The correction.
    pub(crate) correction: Correction<AXES>,
}

/// Twist over axes, link tensions, loads of the axes.
type F1Statics = (SMatrix<f64, 6, AXES>, [f64; 6], [f64; AXES]);

impl Work {
    /// Both machines, and the checksum of the F1.
    pub(crate) fn new() -> Result<(Self, u32), Refused> {
        let (robot, springs) = robots::l2().map_err(|_| Refused::Robot)?;
        let nominal = Nominal::new(&robot, &Matrix3::identity()).map_err(|_| Refused::Robot)?;
        let (six, six_springs) = robots::f1().map_err(|_| Refused::Robot)?;
        let f1_kinematics = SixLinkKinematics::new(&six);
        let elastic = SixLinkElastic::new(f1_kinematics, six_springs);
        let work = Self {
            sensor: ForceSensor::new(robots::sensor()).map_err(|_| Refused::Compensation)?,
            load: Wrench::zero(),
            l2: Compensator::new(&nominal, &springs, config([1.0; 3]))
                .map_err(|_| Refused::Compensation)?,
            f1: SixLinkCompensator::new(elastic, config(F1_METRES_PER_Q))
                .map_err(|_| Refused::Compensation)?,
            f1_kinematics,
            before: None,
        };
        Ok((work, six.kinematics_checksum()))
    }

    /// One cycle. A reading that is none leaves the load as it was.
    pub(crate) fn answer(&mut self, moment: &Moment) -> Answer {
        if let Ok(Reading::Load(load)) = self.sensor.update(&Wrench::from_array(moment.load)) {
            self.load = load;
        }
        match moment.motion {
            Motion::Given { .. } | Motion::L2 => Answer::L2(self.l2_cycle(&moment.pose)),
            Motion::F1 => {
                let answer = self.f1_cycle(&moment.pose);
                self.before = answer.ok().map(|answer| {
                    let [.., q4, q5, q6] = answer.q.answer;
                    (answer.pose.answer, [q4, q5, q6])
                });
                Answer::F1(answer)
            }
        }
    }

    fn l2_cycle(&self, [x, y, z, ..]: &Pose6) -> Result<L2Answer, KinematicsError> {
        let tcp_m = Vector3::new(*x, *y, *z);
        let q = self.l2.model().nominal().inverse(&tcp_m)?;
        let correction = self.l2.correction(&q, &self.load)?;
        Ok(L2Answer { q, correction })
    }

    /// Its parts are not inlined, so that they share their stack.
    #[inline(never)]
    fn f1_cycle(&self, pose: &Pose6) -> Result<F1Answer, KinematicsError> {
        let (q, pose) = self.f1_positions(pose)?;
        let (jacobian, forces_n, loads) = self.f1_statics(&pose.answer, &q.answer)?;
        Ok(F1Answer {
            q,
            pose,
            jacobian,
            forces_n,
            loads,
            correction: self.f1.correction(&pose.answer, &q.answer, &self.load)?,
        })
    }

    /// The inverse, and where its answer takes the tool.
    #[inline(never)]
    fn f1_positions(
        &self,
        [x, y, z, a, b, c]: &Pose6,
    ) -> Result<(Solved<[f64; AXES]>, Solved<Pose>), KinematicsError> {
        let pose = Pose {
            position_m: Vector3::new(*x, *y, *z),
            rotation: rotation_from_vector(&Vector3::new(*a, *b, *c))
                .ok_or(KinematicsError::NotFinite)?,
        };
        let kinematics = &self.f1_kinematics;
        let q = kinematics.inverse(&pose, self.before.map(|(_, plates)| plates))?;
        let found = match self.before {
            Some((before, _)) => kinematics.forward_from(&q.answer, &before, WARM_ITERATIONS)?,
            None => kinematics.forward(&q.answer)?,
        };
        Ok((q, found))
    }

    /// Twist over axes, link tensions, loads of the axes.
    #[inline(never)]
    fn f1_statics(&self, pose: &Pose, q: &[f64; AXES]) -> Result<F1Statics, KinematicsError> {
        let lines = LineMatrix::of_six_link(&self.f1_kinematics, pose, q)?;
        let forces_n = lines.link_forces_n(&self.load)?;
        let loads = lines.cart_loads(&forces_n);
        Ok((lines.jacobian()?, forces_n, loads))
    }
}

impl Answer {
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

fn config<const N: usize>(metres_per_q: [f64; N]) -> CompensatorConfig<N> {
    CompensatorConfig {
        gain: 1.0,
        limits: [LIMIT; N],
        metres_per_q,
    }
}
