//! A cycle of the F1: inverse, forward, statics, compensation.

use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose, Solution, WARM_ITERATIONS};
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use gantry_tau_core::model::f1;
use gantry_tau_core::units::OffsetNm;
use nalgebra::{ArrayStorage, Matrix3, SMatrix, Vector3};

use super::{AXES, Pose6, Refused, robots};

/// One cycle of the F1.
pub(crate) struct F1Answer {
    /// Positions of the axes.
    pub(crate) q: Solution<[f64; AXES]>,
    /// Where these take the tool, from the pose of the cycle before.
    pub(crate) pose: Solution<Pose>,
    /// Twist over axes.
    pub(crate) jacobian: SMatrix<f64, 6, AXES>,
    /// Link tensions, N.
    pub(crate) forces_n: [f64; 6],
    /// Loads of the axes.
    pub(crate) loads: [f64; AXES],
    /// The correction.
    pub(crate) correction: Correction<AXES>,
}

/// The machine, its compensation, and the cycle before.
pub(crate) struct F1 {
    compensator: f1::Compensator,
    /// The last cycle: here, so that no stack has to hold it.
    answer: F1Answer,
    /// Whether it came to its end; then the next one starts from it.
    is_answered: bool,
}

impl F1 {
    /// The machine of `robots/f1.toml`, and its checksum.
    pub(crate) fn new() -> Result<(Self, u32), Refused> {
        let (robot, springs) = robots::f1().map_err(|_| Refused::Robot)?;
        let elastic = f1::Elastic::new(f1::Kinematics::new(&robot), springs);
        let f1 = Self {
            compensator: f1::Compensator::new(
                elastic,
                robots::compensation(robots::F1_METRES_PER_Q),
            )
            .map_err(|_| Refused::Compensation)?,
            answer: UNANSWERED,
            is_answered: false,
        };
        Ok((f1, robot.kinematics_checksum()))
    }

    /// One cycle. Its parts are not inlined, so that they share their stack.
    pub(crate) fn cycle(
        &mut self,
        pose: &Pose6,
        load: &Wrench,
    ) -> Result<&F1Answer, KinematicsError> {
        let is_warm = core::mem::take(&mut self.is_answered);
        self.find_positions(pose, is_warm)?;
        self.find_statics(load)?;
        self.find_correction(load)?;
        self.is_answered = true;
        Ok(&self.value)
    }

    /// The inverse, and where its answer takes the tool.
    #[inline(never)]
    fn find_positions(
        &mut self,
        [x, y, z, a, b, c]: &Pose6,
        is_warm: bool,
    ) -> Result<(), KinematicsError> {
        let (kinematics, answer) = (self.compensator.machine().kinematics(), &mut self.value);
        let pose = Pose {
            position_m: Vector3::new(*x, *y, *z),
            rotation: rotation_from_vector(&Vector3::new(*a, *b, *c))
                .ok_or(KinematicsError::NotFinite)?,
        };
        let [.., q4, q5, q6] = answer.q.value;
        answer.q = kinematics.inverse(&pose, is_warm.then_some([q4, q5, q6]))?;
        let q = &answer.q.value;
        answer.pose = if is_warm {
            kinematics.forward_from(q, &answer.pose.value, WARM_ITERATIONS)?
        } else {
            kinematics.forward(q)?
        };
        Ok(())
    }

    /// Twist over axes, link tensions, loads of the axes.
    #[inline(never)]
    fn find_statics(&mut self, load: &Wrench) -> Result<(), KinematicsError> {
        let answer = &mut self.value;
        let (pose, q) = (&answer.pose.value, &answer.q.value);
        let kinematics = self.compensator.machine().kinematics();
        // Not moved out of its result: it would be on the stack twice.
        let lines = kinematics.line_matrix(pose, q);
        let lines = lines.as_ref().map_err(|error| *error)?;
        answer.forces_n = lines.link_forces_n(load)?;
        answer.loads = lines.cart_loads(&answer.forces_n);
        answer.jacobian = lines.jacobian()?;
        Ok(())
    }

    /// What holds the pose under the load.
    #[inline(never)]
    fn find_correction(&mut self, load: &Wrench) -> Result<(), KinematicsError> {
        let answer = &mut self.value;
        let (pose, q) = (&answer.pose.value, &answer.q.value);
        answer.correction = self.compensator.correction(pose, q, load)?;
        Ok(())
    }
}

/// Before the first cycle.
const UNANSWERED: F1Answer = F1Answer {
    q: Solution {
        answer: [0.0; AXES],
        iterations: 0,
        residual_m: 0.0,
    },
    pose: Solution {
        answer: Pose {
            position_m: Vector3::new(0.0, 0.0, 0.0),
            rotation: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        },
        iterations: 0,
        residual_m: 0.0,
    },
    jacobian: SMatrix::from_array_storage(ArrayStorage([[0.0; 6]; AXES])),
    forces_n: [0.0; 6],
    loads: [0.0; AXES],
    correction: Correction {
        offsets: [OffsetNm(0); AXES],
        saturated: [false; AXES],
    },
};
