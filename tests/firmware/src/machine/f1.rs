//! Cycle of the F1: inverse, forward, statics, compensation.

use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose, Solution};
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::nalgebra::{ArrayStorage, Matrix3, SMatrix, Vector3};
use gantry_tau_core::model::statics::{LineMatrix, Wrench};

use super::{AXES, Pose6, SetupError, robots};

/// Result of one cycle of the F1.
pub(crate) struct F1Result {
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
    /// Offsets that hold the pose under the load.
    pub(crate) correction: Correction<AXES>,
}

/// Compensator of the F1, and the result of the last cycle.
pub(crate) struct F1 {
    /// Checksum of its kinematics.
    pub(super) checksum: u32,
    compensator: f1::Compensator,
    /// Last cycle; kept here to save stack.
    result: F1Result,
    /// True if the last inverse succeeded; then the next one starts from its plates.
    has_plates: bool,
}

impl F1 {
    /// Builds the machine of `robots/f1.toml`.
    pub(crate) fn new() -> Result<Self, SetupError> {
        let (robot, springs) = robots::f1().map_err(|_| SetupError::Robot)?;
        let kinematics = f1::Kinematics::new(&robot);
        Ok(Self {
            checksum: kinematics.checksum(&robots::F1_METRES_PER_Q),
            compensator: f1::Compensator::new(
                &kinematics,
                &springs,
                robots::compensation(robots::F1_METRES_PER_Q),
            )
            .map_err(|_| SetupError::Compensation)?,
            result: UNSOLVED,
            has_plates: false,
        })
    }

    /// Begins a cycle: returns the rotation of the platform. The parts of a cycle are not inlined,
    /// so that their stack use does not add up.
    pub(crate) fn locate(&mut self, pose: &Pose6) -> Result<&Matrix3<f64>, KinematicsError> {
        self.find_positions(pose)?;
        Ok(&self.result.pose.value.rotation)
    }

    /// Ends a cycle, under this load.
    pub(crate) fn carry(&mut self, load: &Wrench) -> Result<&F1Result, KinematicsError> {
        let kinematics = self.compensator.machine().kinematics();
        // Borrowed: moving the matrix out of the `Result` would put a second copy on the stack.
        let lines = kinematics.line_matrix(&self.result.pose.value, &self.result.q.value);
        let lines = lines.as_ref().map_err(|error| *error)?;
        self.find_statics(lines, load)?;
        self.find_correction(lines, load)?;
        Ok(&self.result)
    }

    /// Solves the inverse kinematics, and tracks the pose of the solution.
    #[inline(never)]
    fn find_positions(&mut self, [x, y, z, a, b, c]: &Pose6) -> Result<(), KinematicsError> {
        let is_warm = core::mem::take(&mut self.has_plates);
        let (kinematics, result) = (self.compensator.machine().kinematics(), &mut self.result);
        let pose = Pose {
            position_m: Vector3::new(*x, *y, *z),
            rotation: rotation_from_vector(&Vector3::new(*a, *b, *c))
                .ok_or(KinematicsError::NotFinite)?,
        };
        let [.., q4, q5, q6] = result.q.value;
        result.q = kinematics.inverse(&pose, is_warm.then_some([q4, q5, q6]))?;
        self.has_plates = true;
        result.pose = self.compensator.track(&result.q.value)?;
        Ok(())
    }

    /// Computes link tensions, loads of the axes, twist over axes.
    #[inline(never)]
    fn find_statics(
        &mut self,
        lines: &LineMatrix<AXES>,
        load: &Wrench,
    ) -> Result<(), KinematicsError> {
        let result = &mut self.result;
        result.forces_n = lines.link_forces_n(load)?;
        result.loads = lines.cart_loads(&result.forces_n);
        result.jacobian = lines.jacobian()?;
        Ok(())
    }

    /// Computes the offsets that hold the pose under the load.
    #[inline(never)]
    fn find_correction(
        &mut self,
        lines: &LineMatrix<AXES>,
        load: &Wrench,
    ) -> Result<(), KinematicsError> {
        let result = &mut self.result;
        let (pose, q) = (&result.pose.value, &result.q.value);
        result.correction = self.compensator.correct_of(lines, pose, q, load)?;
        Ok(())
    }
}

/// Result before the first cycle.
const UNSOLVED: F1Result = F1Result {
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
