//! Poses, errors, tolerances and solutions that the kinematics of both machines share.
//!
//! The kinematics themselves are [`l2::Kinematics`](super::l2::Kinematics), closed forms, and
//! [`f1::Kinematics`](super::f1::Kinematics), Newton's method. Instructions per call are counted in
//! `tests/benches/instructions/counts.toml`.

use core::fmt;
use nalgebra::{Matrix3, Vector3};

use crate::model::linalg::{rotation_deviation, unit};
use crate::model::robot::LINKS;

/// Linear solves that suffice from the seed of the cycle before: at 1 m/s and 1 rad/s, sampled at 1
/// kHz, the second leaves less than 4e-11 m over the workspace of the F1
/// (`tests/tests/six_axes.rs`).
pub const WARM_ITERATIONS: u8 = 2;
/// Largest number of linear solves from any other start.
pub const COLD_ITERATIONS: u8 = 10;

/// Smallest conditioning that a pose may have, of the carts (`|s_i . v_i| / |v_i|`) and of the
/// links (`|det(s_1, s_2, s_3)|`). Below it a micrometre at one end is a centimetre at the other.
pub const SINGULARITY_TOLERANCE: f64 = 1e-4;

/// Ratio of the smallest pivot to the largest, after equilibration, up to which a solve with
/// pivoting is refused as singular: there fewer than four digits of a result would be left.
pub const SINGULAR_PIVOT_RATIO: f64 = 1e-12;

/// Largest error of a link's length in an answer, over the length of the shortest link: a nanometre
/// per metre.
pub const RESIDUAL_TOLERANCE: f64 = 1e-9;

/// Largest deviation of `R^T R` from the identity that a rotation may have.
pub const ROTATION_TOLERANCE: f64 = 1e-9;

/// Largest mismatch of the Tau property, over the length of the arm: between the links of a
/// cluster, of their joints' offsets and of their lengths.
pub const TAU_TOLERANCE: f64 = 1e-9;

/// Position and orientation of the tool: `x_world = T + R x_platform`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// `T`: tool centre point, world axes, metres.
    pub position_m: Vector3<f64>,
    /// `R`: world axes from platform axes.
    pub rotation: Matrix3<f64>,
}

impl Pose {
    /// Pose with the orientation of the world axes.
    #[must_use]
    pub fn at(position_m: Vector3<f64>) -> Self {
        Self {
            position_m,
            rotation: Matrix3::identity(),
        }
    }
}

/// True if the position is finite and the rotation orthonormal.
pub(crate) fn is_pose(pose: &Pose) -> bool {
    pose.position_m.iter().all(|value| value.is_finite())
        && rotation_deviation(&pose.rotation) <= ROTATION_TOLERANCE
}

/// Error of a kinematic solution. Arms and axes count from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KinematicsError {
    /// A number given, or one computed from it, is NaN or infinite.
    NotFinite,
    /// The links of this arm are too short to reach the pose from anywhere on its guideway.
    Unreachable {
        /// Index of the arm.
        arm: usize,
    },
    /// The carts stand so that their links cannot meet.
    NoAssembly,
    /// The pose exists only in another configuration than the machine is built in: it lies beyond a
    /// singularity.
    OtherBranch {
        /// Index of the arm that would be on its other side; `None` if the tool would be on the
        /// other side of the carts' plane.
        arm: Option<usize>,
    },
    /// The pose is singular, or too close to it.
    Singular {
        /// Conditioning, 0 at the singularity; see [`SINGULARITY_TOLERANCE`] and
        /// [`SINGULAR_PIVOT_RATIO`].
        measure: f64,
    },
    /// An axis would leave its travel.
    OutOfRange {
        /// Index of the axis.
        axis: usize,
        /// Position that it would have, in q-units.
        q: f64,
        /// Lower end of its travel, in q-units.
        lower: f64,
        /// Upper end of its travel, in q-units.
        upper: f64,
    },
    /// The iteration did not converge.
    NotConverged {
        /// Linear solves made.
        iterations: u8,
        /// Largest error of a link's length after the last one, to first order, metres.
        residual_m: f64,
    },
    /// This machine's forward kinematics needs a seed: the machine is not of the synchronised form,
    /// or that form is not unique.
    SeedRequired,
    /// Pose and positions that were given together do not fit the length of this arm's links.
    Inconsistent {
        /// Index of the arm.
        arm: usize,
    },
}

impl KinematicsError {
    /// The error's class, as `solve` names it.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::NotFinite => "not_finite",
            Self::Unreachable { .. }
            | Self::NoAssembly
            | Self::OtherBranch { .. }
            | Self::Inconsistent { .. } => "unreachable",
            Self::Singular { .. } => "singular",
            Self::OutOfRange { .. } => "out_of_range",
            Self::NotConverged { .. } => "not_converged",
            Self::SeedRequired => "seed_required",
        }
    }
}

impl fmt::Display for KinematicsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => f.write_str("a number is not finite"),
            Self::Unreachable { arm } => {
                write!(f, "arm[{arm}] cannot reach the pose from its guideway")
            }
            Self::NoAssembly => f.write_str("the links cannot meet from these cart positions"),
            Self::OtherBranch { arm: Some(arm) } => {
                write!(
                    f,
                    "the pose needs arm[{arm}] on the other side of its guideway"
                )
            }
            Self::OtherBranch { arm: None } => {
                f.write_str("the pose lies on the other side of the carts' plane")
            }
            Self::Singular { measure } => write!(f, "the pose is singular: measure {measure:e}"),
            Self::OutOfRange {
                axis,
                q,
                lower,
                upper,
            } => {
                write!(f, "axis[{axis}] at {q} is outside {lower} to {upper}")
            }
            Self::NotConverged {
                iterations,
                residual_m,
            } => {
                write!(
                    f,
                    "no answer after {iterations} iterations: a link is {residual_m:e} m off its length"
                )
            }
            Self::SeedRequired => {
                f.write_str("a seed is required: this machine has no closed form to start from")
            }
            Self::Inconsistent { arm } => {
                write!(
                    f,
                    "pose and positions do not fit the link length of arm[{arm}]"
                )
            }
        }
    }
}

impl core::error::Error for KinematicsError {}

/// Solution of an iteration, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Solution<T> {
    /// Value found.
    pub value: T,
    /// Linear solves made.
    pub iterations: u8,
    /// Largest error of a link's length, to first order, metres.
    pub residual_m: f64,
}

impl<T> Solution<T> {
    /// A solution from its parts.
    #[must_use]
    pub const fn new(value: T, iterations: u8, residual_m: f64) -> Self {
        Self {
            value,
            iterations,
            residual_m,
        }
    }
}

/// Returns the unit vectors `s_ij`, from platform to cart.
pub(crate) fn directions(
    links_m: &[Vector3<f64>; LINKS],
) -> Result<[Vector3<f64>; LINKS], KinematicsError> {
    let mut directions = *links_m;
    for direction in &mut directions {
        *direction = unit(direction).ok_or(KinematicsError::NotFinite)?;
    }
    Ok(directions)
}
