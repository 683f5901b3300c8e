//! Poses of an F1: places and orientations, 60 combinations of 64 parameters.
//!
//! The platform must turn far, about every axis, with the plates out of step: poses that turn by
//! 0.03 rad leave the joints of a cluster known to centimetres.

use gantry_tau_core::model::f1::AXES;
use gantry_tau_core::model::kinematics::{KinematicsError, Pose};
use gantry_tau_machine::model::F1;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};

use super::PlannedMachine;
use crate::fit::svd::Svd;
use crate::geometry::calibrate;
use crate::geometry::f1::{OBSERVABLE, PARAMETERS, derivative, fixed, scales};

/// Places of the grid from home, m, in x, y, z.
const FROM_HOME_M: [&[f64]; 3] = [&[-0.4, 0.0, 0.3], &[-0.3, 0.0, 0.3], &[-0.1, 0.3, 0.7]];
/// Rotation vectors of the platform, rad.
const TURNS_RAD: [[f64; 3]; 15] = [
    [0.0, 0.0, 0.0],
    [0.0, 0.0, 0.3],
    [0.0, 0.0, -0.3],
    [0.0, 0.3, 0.0],
    [0.0, -0.3, 0.0],
    [0.2, 0.0, 0.0],
    [-0.2, 0.0, 0.0],
    [0.15, 0.2, 0.2],
    [0.15, 0.2, -0.2],
    [0.15, -0.2, 0.2],
    [0.15, -0.2, -0.2],
    [-0.15, 0.2, 0.2],
    [-0.15, 0.2, -0.2],
    [-0.15, -0.2, 0.2],
    [-0.15, -0.2, -0.2],
];

impl PlannedMachine<AXES> for F1 {
    const IS_TURNED: bool = true;

    fn poses(robot: &RobotFile<Self, AXES>) -> Vec<Pose> {
        let [xs, ys, zs] = FROM_HOME_M;
        let columns = xs.iter().flat_map(|x| ys.iter().map(move |y| (*x, *y)));
        let places = columns.flat_map(|(x, y)| zs.iter().map(move |z| Vector3::new(x, y, *z)));
        let rotations = TURNS_RAD.map(|turn| {
            UnitQuaternion::from_scaled_axis(turn.into())
                .to_rotation_matrix()
                .into_inner()
        });
        places
            .flat_map(|place| {
                rotations.map(|rotation| Pose {
                    position_m: robot.home_m() + place,
                    rotation,
                })
            })
            .collect()
    }

    fn axes_in(&self, pose: &Pose) -> Result<[f64; AXES], KinematicsError> {
        Ok(self.inverse_in_assembly(pose, None)?.value)
    }

    fn names() -> Vec<(String, &'static str)> {
        calibrate::f1::names()
    }

    fn scales_and_basis(&self) -> (DVector<f64>, DMatrix<f64>) {
        let scales = scales(self.robot().geometry());
        let mut fixed =
            DMatrix::from_column_slice(4, PARAMETERS, fixed(self.robot().geometry()).as_slice());
        for (mut column, scale) in fixed.column_iter_mut().zip(&scales) {
            column *= *scale;
        }
        // Directions of the smallest singular values: orthogonal to the fixed combinations.
        let all = Svd::new(fixed.tr_mul(&fixed)).directions;
        (
            scales,
            all.columns(PARAMETERS - OBSERVABLE, OBSERVABLE)
                .into_owned(),
        )
    }

    fn derivative(&self, pose: &Pose, q: &[f64; AXES]) -> DMatrix<f64> {
        let derivative = derivative(self.robot().geometry(), q, pose);
        DMatrix::from_column_slice(6, PARAMETERS, derivative.as_slice())
    }
}
