//! Calibration of an L2: the 21 parameters of the nominal model `[T 3.10]`.
//!
//! A place is predicted by the forward kinematics at the measured positions of the axes, and
//!
//! ```text
//! dT/dtheta = S^-T [ s_i . (dA_i + q_i dv_i) - dL_i ],    S = [s_1 s_2 s_3]
//! ```
//!
//! there. (The thesis' cost, (3.10), takes the error of a squared length at the *measured* place: a
//! third to a half further off.)

mod placed;

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::l2::{self, Configuration, OrientationError};
use gantry_tau_core::model::robot::{ARM_OF_LINK, ARMS, LINKS, RobotError};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Vector3};

use super::robust_fit::{Model, RobustFit};
use crate::fit::frames::apply;
use crate::fit::least_squares::{Rows, solve_linear};
use crate::fit::statistics::float;
use crate::measurements::poses::MeasuredPose;
pub use placed::InRobotFrame;
pub(super) use placed::turned_covariance;

/// Parameters per arm: `A_s` (3), `V` (3), `L`.
pub const PER_ARM: usize = 7;
/// All of them.
pub const PARAMETERS: usize = ARMS * PER_ARM;
/// Change of a place or a length that would matter, m.
const TOLERANCE_M: f64 = 0.01;
/// Change of a guideway's direction that would matter, rad.
const TOLERANCE_RAD: f64 = 0.01;
/// Places that a calibration needs: 24 numbers for 21.
pub const MIN_PLACES: usize = 8;
/// Nominal model in some frame: where arm `i` would hold a single point,
/// `|A_i + q_i v_i - T| = L_i`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nominal {
    /// `A_s`: of each arm at `q = 0`, m.
    pub origins_m: [Vector3<f64>; ARMS],
    /// `v`: direction of each guideway, m per unit of `q`.
    pub guideways: [Vector3<f64>; ARMS],
    /// `L`: length of the links of each arm, m.
    pub lengths_m: [f64; ARMS],
}

/// Reason why a nominal model predicts no place.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PredictionError {
    /// Its parameters are refused.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The same.
    #[error(transparent)]
    Orientation(#[from] OrientationError),
    /// A place cannot be reached.
    #[error("pose number {}: {error}", index + 1)]
    Unreachable {
        /// Index of the pose.
        index: usize,
        /// Error of the kinematics.
        error: KinematicsError,
    },
    /// The robot file is of another machine.
    #[error("the robot file's machine reaches fewer than three of the measured positions")]
    FarOff,
}

impl Nominal {
    /// Nominal model of a machine whose platform stands in the axes of the world.
    #[must_use]
    pub fn of(geometry: &l2::Geometry) -> Self {
        Self {
            // The first link of each arm.
            origins_m: [0, 1, 3]
                .map(|link| geometry.cart_joints_m[link] - geometry.platform_joints_m[link]),
            guideways: geometry.guideways,
            lengths_m: geometry.lengths_m,
        }
    }

    /// The same machine, moved by a rigid motion.
    #[must_use]
    pub fn moved(&self, motion: &Isometry3<f64>) -> Self {
        Self {
            origins_m: self.origins_m.map(|origin| apply(motion, &origin)),
            guideways: self.guideways.map(|guideway| motion.rotation * guideway),
            lengths_m: self.lengths_m,
        }
    }

    /// The same machine, its point on the platform moved.
    #[must_use]
    pub fn shifted(&self, by_m: &Vector3<f64>) -> Self {
        Self {
            origins_m: self.origins_m.map(|origin| origin + by_m),
            ..*self
        }
    }

    /// Returns the kinematics of the point: joints on the carts, none on the platform.
    ///
    /// # Errors
    /// [`PredictionError::Robot`], [`PredictionError::Orientation`].
    pub fn kinematics(
        &self,
        configuration: Configuration,
    ) -> Result<l2::Kinematics, PredictionError> {
        let robot = l2::Robot::new(l2::Geometry {
            cart_joints_m: ARM_OF_LINK.map(|arm| self.origins_m[arm]),
            guideways: self.guideways,
            platform_joints_m: [Vector3::zeros(); LINKS],
            lengths_m: self.lengths_m,
            configuration,
            travel: None,
        })?;
        Ok(l2::Kinematics::new(&robot, &Matrix3::identity())?)
    }

    /// Returns the change by a step of the parameters.
    fn stepped(&self, step: &DVector<f64>) -> Self {
        Self {
            origins_m: std::array::from_fn(|arm| {
                self.origins_m[arm] + step.fixed_rows::<3>(PER_ARM * arm)
            }),
            guideways: std::array::from_fn(|arm| {
                self.guideways[arm] + step.fixed_rows::<3>(PER_ARM * arm + 3)
            }),
            lengths_m: std::array::from_fn(|arm| self.lengths_m[arm] + step[PER_ARM * arm + 6]),
        }
    }

    /// The parameters: `A_s` (3), `V` (3), `L` per arm.
    #[must_use]
    pub fn parameters(&self) -> DVector<f64> {
        let arms = (0..ARMS).flat_map(|arm| {
            let origin = self.origins_m[arm];
            let guideway = self.guideways[arm];
            [
                origin.x,
                origin.y,
                origin.z,
                guideway.x,
                guideway.y,
                guideway.z,
                self.lengths_m[arm],
            ]
        });
        DVector::from_iterator(PARAMETERS, arms)
    }

    /// Change of each parameter that would matter.
    #[must_use]
    pub fn scales(&self) -> DVector<f64> {
        let arms = self.guideways.iter().flat_map(|guideway| {
            let turn = TOLERANCE_RAD * guideway.norm();
            [
                TOLERANCE_M,
                TOLERANCE_M,
                TOLERANCE_M,
                turn,
                turn,
                turn,
                TOLERANCE_M,
            ]
        });
        DVector::from_iterator(PARAMETERS, arms)
    }

    /// Derivative of the place by the parameters, 3 x 21, with the machine at `place_m`.
    #[must_use]
    pub fn derivative(&self, q: &[f64; ARMS], place_m: &Vector3<f64>) -> DMatrix<f64> {
        let directions: [Vector3<f64>; ARMS] = std::array::from_fn(|arm| {
            (self.origins_m[arm] + self.guideways[arm] * q[arm] - place_m) / self.lengths_m[arm]
        });
        let rows = Matrix3::from_rows(&directions.map(|direction| direction.transpose()));
        let inverse = rows
            .try_inverse()
            .unwrap_or_else(|| Matrix3::repeat(f64::NAN));
        let mut derivative = DMatrix::zeros(3, PARAMETERS);
        for arm in 0..ARMS {
            let along = inverse.column(arm) * directions[arm].transpose();
            derivative
                .view_mut((0, PER_ARM * arm), (3, 3))
                .copy_from(&along);
            derivative
                .view_mut((0, PER_ARM * arm + 3), (3, 3))
                .copy_from(&(along * q[arm]));
            derivative
                .view_mut((0, PER_ARM * arm + 6), (3, 1))
                .copy_from(&(-inverse.column(arm)));
        }
        derivative
    }
}

/// Measured places, and what the device's noise is.
#[derive(Clone, Copy, Debug)]
pub struct Places<'a> {
    /// The places; their orientations are not used.
    pub poses: &'a [MeasuredPose<ARMS>],
    /// Whitening matrix `W`: `W^T W` is the inverse of the covariance of a place, 1/m.
    pub whitening: Matrix3<f64>,
    /// Solution of the kinematics that the machine is built in.
    pub configuration: Configuration,
}

impl Model for Places<'_> {
    type State = Nominal;
    type Error = PredictionError;
    const COMPONENTS: usize = 3;

    fn count(&self) -> usize {
        self.poses.len()
    }

    fn rows(&self, nominal: &Nominal, used: &[usize]) -> Result<Rows, PredictionError> {
        let kinematics = nominal.kinematics(self.configuration)?;
        let mut residuals = DVector::zeros(3 * used.len());
        let mut derivatives = DMatrix::zeros(3 * used.len(), PARAMETERS);
        for (row, &index) in used.iter().enumerate() {
            let pose = &self.poses[index];
            let place_m = kinematics
                .forward(&pose.q)
                .map_err(|error| PredictionError::Unreachable { index, error })?;
            let residual = self.whitening * (pose.position_m - place_m);
            residuals.fixed_rows_mut::<3>(3 * row).copy_from(&residual);
            let derivative = self.whitening * nominal.derivative(&pose.q, &place_m);
            derivatives
                .view_mut((3 * row, 0), (3, PARAMETERS))
                .copy_from(&derivative);
        }
        Ok(Rows::new(residuals, derivatives))
    }

    fn length_sd(&self, nominal: &Nominal, index: usize) -> f64 {
        self.rows(nominal, &[index])
            .map_or(f64::INFINITY, |rows| rows.residuals.norm())
    }

    fn away_m(&self, nominal: &Nominal, index: usize) -> Option<f64> {
        let pose = &self.poses[index];
        let place_m = nominal
            .kinematics(self.configuration)
            .ok()?
            .forward(&pose.q)
            .ok()?;
        Some((pose.position_m - place_m).norm())
    }

    fn scales(&self, nominal: &Nominal) -> DVector<f64> {
        nominal.scales()
    }

    fn stepped(nominal: &Nominal, step: &DVector<f64>) -> Nominal {
        nominal.stepped(step)
    }
}

/// A calibrated machine, in the frame of the device.
pub type Calibrated = RobustFit<Nominal>;

/// Returns a model from places alone, by nine linear unknowns per arm: `|A + q v - T|^2 = L^2` is
/// linear in `A`, `v`, `|A|^2 - L^2`, `A . v` and `|v|^2`. It takes their dependence for no
/// dependence, and is a start, not an answer. `None` where they do not follow.
#[must_use]
pub fn closed_form(poses: &[MeasuredPose<ARMS>]) -> Option<Nominal> {
    let arms = [
        arm_in_closed_form(poses, 0)?,
        arm_in_closed_form(poses, 1)?,
        arm_in_closed_form(poses, 2)?,
    ];
    Some(Nominal {
        origins_m: arms.map(|(origin, ..)| origin),
        guideways: arms.map(|(_, guideway, _)| guideway),
        lengths_m: arms.map(|(.., length)| length),
    })
}

/// Origin, guideway and length of an arm.
fn arm_in_closed_form(
    poses: &[MeasuredPose<ARMS>],
    arm: usize,
) -> Option<(Vector3<f64>, Vector3<f64>, f64)> {
    let mut rows = DMatrix::zeros(poses.len(), 9);
    let mut right = DVector::zeros(poses.len());
    for (index, pose) in poses.iter().enumerate() {
        let t = pose.position_m;
        let q = pose.q[arm];
        let row = [
            2.0 * t.x,
            2.0 * t.y,
            2.0 * t.z,
            2.0 * q * t.x,
            2.0 * q * t.y,
            2.0 * q * t.z,
            -1.0,
            -q,
            -q * q,
        ];
        rows.row_mut(index).copy_from_slice(&row);
        right[index] = t.norm_squared();
    }
    let solved = solve_linear(rows, right)?;
    let origin = solved.fixed_rows::<3>(0).into_owned();
    let guideway = solved.fixed_rows::<3>(3).into_owned();
    let length_squared = origin.norm_squared() - solved[6];
    (length_squared > 0.0).then(|| (origin, guideway, length_squared.sqrt()))
}

/// Expected error of a place, root mean square over positions: `sqrt(mean trace(G C G^T))`, m; NaN
/// where there are none. Positions that the machine cannot stand in are left out.
#[must_use]
pub fn predicted_rms_m(
    nominal: &Nominal,
    configuration: Configuration,
    covariance: &DMatrix<f64>,
    at_q: &[[f64; ARMS]],
) -> f64 {
    let Ok(kinematics) = nominal.kinematics(configuration) else {
        return f64::NAN;
    };
    let variances: Vec<f64> = at_q
        .iter()
        .filter_map(|q| {
            let derivative = nominal.derivative(q, &kinematics.forward(q).ok()?);
            Some((&derivative * covariance * derivative.transpose()).trace())
        })
        .collect();
    (variances.iter().sum::<f64>() / float(variances.len())).sqrt()
}

#[cfg(test)]
mod tests;
