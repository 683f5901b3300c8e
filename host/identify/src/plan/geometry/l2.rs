//! Poses of an L2: places alone, the 21 parameters of the nominal model.

use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_core::model::l2::AXES;
use gantry_tau_machine::model::{L2, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::{DMatrix, DVector, Vector3};

use super::PlannedMachine;
use crate::fit::statistics::float;
use crate::geometry::calibrate;
use crate::geometry::l2::{Nominal, PARAMETERS};

/// First place of the grid from home, its pitches, m, and its numbers of places, in x, y, z.
const FIRST_M: [f64; 3] = [-1.0, -0.6, -0.35];
const PITCH_M: [f64; 3] = [0.2, 0.1, 0.1];
const COUNT: [usize; 3] = [12, 9, 8];

impl PlannedMachine<AXES> for L2 {
    const IS_TURNED: bool = false;

    fn poses(robot: &RobotFile<Self, AXES>) -> Vec<Pose> {
        let [across, deep, high] = COUNT;
        let steps = (0..across)
            .flat_map(|x| (0..deep).flat_map(move |y| (0..high).map(move |z| [x, y, z])));
        steps
            .map(|steps| {
                let place_m =
                    Vector3::from_fn(|axis, _| FIRST_M[axis] + PITCH_M[axis] * float(steps[axis]))
                        + robot.home_m();
                // To the micrometre, as a person types it.
                Pose::at(place_m.map(|x| (x * 1e6).round() / 1e6))
            })
            .collect()
    }

    fn axes_in(&self, pose: &Pose) -> Result<[f64; AXES], KinematicsError> {
        self.axes_at(&pose.position_m)
    }

    fn names() -> Vec<(String, &'static str)> {
        calibrate::l2::names()
    }

    fn scales_and_basis(&self) -> (DVector<f64>, DMatrix<f64>) {
        (
            Nominal::of(self.robot().geometry()).scales(),
            DMatrix::identity(PARAMETERS, PARAMETERS),
        )
    }

    fn derivative(&self, pose: &Pose, q: &[f64; AXES]) -> DMatrix<f64> {
        Nominal::of(self.robot().geometry()).derivative(q, &pose.position_m)
    }
}
