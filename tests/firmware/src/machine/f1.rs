//! A cycle of the F1: inverse, forward, statics, compensation.

use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose, Solution};
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::statics::Wrench;
use nalgebra::{ArrayStorage, Matrix3, SMatrix, Vector3};

use super::{AXES, Pose6, Refused, robots};

/// One cycle of the F1.
pub(crate) struct F1Answer {
    /// Positions of the axes.
    pub(crate) q: Solution<[f64; AXES]>,
    /// Pose at these, tracked from the cycle before.
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
    /// Last cycle; kept here to save stack.
    answer: F1Answer,
    /// True if the last cycle succeeded; then the next one starts from its plates.
    is_answered: bool,
}

impl F1 {
    /// The machine of `robots/f1.toml`, and its checksum.
    pub(crate) fn new() -> Result<(Self, u32), Refused> {
        let (robot, springs) = robots::f1().map_err(|_| Refused::Robot)?;
        let f1 = Self {
            compensator: f1::Compensator::new(
                &f1::Kinematics::new(&robot),
                &springs,
                robots::compensation(robots::F1_METRES_PER_Q),
            )
            .map_err(|_| Refused::Compensation)?,
            answer: UNANSWERED,
            is_answered: false,
        };
        Ok((f1, robot.kinematics_checksum()))
    }

    /// One cycle. Its parts are not inlined, so that their stack use does not add up.
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
        Ok(&self.answer)
    }

    /// Inverse kinematics, and the pose of its solution.
    #[inline(never)]
    fn find_positions(
        &mut self,
        [x, y, z, a, b, c]: &Pose6,
        is_warm: bool,
    ) -> Result<(), KinematicsError> {
        let (kinematics, answer) = (self.compensator.machine().kinematics(), &mut self.answer);
        let pose = Pose {
            position_m: Vector3::new(*x, *y, *z),
            rotation: rotation_from_vector(&Vector3::new(*a, *b, *c))
                .ok_or(KinematicsError::NotFinite)?,
        };
        let [.., q4, q5, q6] = answer.q.value;
        answer.q = kinematics.inverse(&pose, is_warm.then_some([q4, q5, q6]))?;
        let q = &answer.q.value;
        answer.pose = self.compensator.track(q)?;
        Ok(())
    }

    /// Twist over axes, link tensions, loads of the axes.
    #[inline(never)]
    fn find_statics(&mut self, load: &Wrench) -> Result<(), KinematicsError> {
        let answer = &mut self.answer;
        let (pose, q) = (&answer.pose.value, &answer.q.value);
        let kinematics = self.compensator.machine().kinematics();
        // Borrowed: moving the 1 KB matrix out of the `Result` would put a second copy on the stack.
        let lines = kinematics.line_matrix(pose, q);
        let lines = lines.as_ref().map_err(|error| *error)?;
        answer.forces_n = lines.link_forces_n(load)?;
        answer.loads = lines.cart_loads(&answer.forces_n);
        answer.jacobian = lines.jacobian()?;
        Ok(())
    }

    /// Offsets that hold the pose under the load.
    #[inline(never)]
    fn find_correction(&mut self, load: &Wrench) -> Result<(), KinematicsError> {
        let answer = &mut self.answer;
        let (pose, q) = (&answer.pose.value, &answer.q.value);
        answer.correction = self.compensator.correct_at(pose, q, load)?;
        Ok(())
    }
}

/// Before the first cycle.
const UNANSWERED: F1Answer = F1Answer {
    q: Solution::new([0.0; AXES], 0, 0.0),
    pose: Solution::new(
        Pose {
            position_m: Vector3::new(0.0, 0.0, 0.0),
            rotation: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        },
        0,
        0.0,
    ),
    jacobian: SMatrix::from_array_storage(ArrayStorage([[0.0; 6]; AXES])),
    forces_n: [0.0; 6],
    loads: [0.0; AXES],
    correction: Correction::ZERO,
};
