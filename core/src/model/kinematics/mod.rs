//! Nominal kinematics of the 3-DOF Gantry-Tau `[T 3.1.1]`: closed forms both ways, and the Jacobian.
//!
//! [`Nominal`] is built once from a [`Robot`] and an orientation; its methods are the cyclic path. Instructions per call are counted in
//! `tests/benches/instructions/counts.toml`.
//! Positions `q` are in q-units (metres for a guideway of unit length), `T` is the tool centre point in world axes, metres.

mod jacobian;
mod nominal;
mod refusal;
mod six_link;
mod two_systems;

pub use jacobian::LinkFrame;
pub use nominal::{Nominal, NominalError};
pub use six_link::{COLD_ITERATIONS, SixLinkKinematics, Solved, WARM_ITERATIONS};

pub(crate) use two_systems::TwoSystems;

use core::fmt;
use nalgebra::{Matrix3, Vector3};

use crate::model::linalg::{LinearError, larger, norm, rotation_deviation, times, unit};
use crate::model::robot::{ARMS, Geometry, LINKS, Robot};

/// Smallest measure of regularity a pose may have, both of the carts' (`|s_i . v_i| / |v_i|`) and of the links' (`|det(s_1, s_2, s_3)|`).
/// Beyond it a micrometre at one end would be a centimetre at the other.
pub const SINGULAR_MEASURE: f64 = 1e-4;

/// Largest error of a link's length in an answer, over the length of the shortest link: a nanometre per metre.
pub const RESIDUAL_TOLERANCE: f64 = 1e-9;

/// Largest deviation of `R^T R` from the identity that a rotation may have.
pub const ROTATION_TOLERANCE: f64 = 1e-9;

/// Largest mismatch of the Tau property, over the length of the arm: between the links of a cluster, of their joints' offsets
/// and of their lengths.
pub const TAU_TOLERANCE: f64 = 1e-9;

/// Where the tool is and how it is turned: `x_world = T + R x_platform`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// `T`: tool centre point, world axes, metres.
    pub position_m: Vector3<f64>,
    /// `R`: world axes from platform axes.
    pub rotation: Matrix3<f64>,
}

impl Pose {
    /// A pose whose axes are those of the world.
    #[must_use]
    pub fn at(position_m: Vector3<f64>) -> Self {
        Self {
            position_m,
            rotation: Matrix3::identity(),
        }
    }
}

/// Whether a pose is one: a place, and a rotation.
pub(crate) fn is_pose(pose: &Pose) -> bool {
    pose.position_m.iter().all(|value| value.is_finite())
        && rotation_deviation(&pose.rotation) <= ROTATION_TOLERANCE
}

/// Why the kinematics has no answer. Arms and axes count from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum KinematicsError {
    /// A number given, or one computed from it, is NaN or infinite.
    NotFinite,
    /// The links of this arm are too short to reach the pose from anywhere on its guideway.
    Unreachable {
        /// Which arm.
        arm: usize,
    },
    /// The carts stand so that their links cannot meet.
    NoAssembly,
    /// The pose exists only in another configuration than the machine is built in: it lies beyond a singularity.
    OtherBranch {
        /// Which arm would be on its other side; `None` when the tool would be on the other side of the carts' plane.
        arm: Option<usize>,
    },
    /// The pose is singular, or too close to it.
    Singular {
        /// The relative measure, 0 at the singularity; see [`SINGULAR_MEASURE`] and [`crate::model::linalg::SINGULAR_PIVOT_RATIO`].
        measure: f64,
    },
    /// An axis would leave its travel.
    OutOfRange {
        /// Which axis.
        axis: usize,
        /// Where it would be, in q-units.
        q: f64,
        /// Lower end of its travel, in q-units.
        lower: f64,
        /// Upper end of its travel, in q-units.
        upper: f64,
    },
    /// The iteration did not come to an end; what it had is not handed out.
    NotConverged {
        /// Linear solves made.
        iterations: u8,
        /// Largest error of a link's length then, metres.
        residual_m: f64,
    },
    /// Without a seed this machine's forward kinematics has no start: it is not of the synchronised form, or that form is not unique.
    SeedRequired,
    /// A pose and positions that were given together do not fit the length of this arm's links.
    Inconsistent {
        /// Which arm.
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
            } => write!(f, "axis[{axis}] at {q} is outside {lower} to {upper}"),
            Self::NotConverged {
                iterations,
                residual_m,
            } => write!(
                f,
                "no answer after {iterations} iterations: a link is {residual_m:e} m off its length"
            ),
            Self::SeedRequired => {
                f.write_str("a seed is required: there is no closed form to start from")
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

impl From<LinearError> for KinematicsError {
    fn from(error: LinearError) -> Self {
        match error {
            LinearError::NotFinite => Self::NotFinite,
            LinearError::Singular { ratio } => Self::Singular { measure: ratio },
        }
    }
}

/// One link of the machine in a pose, in world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Link {
    /// Which arm it belongs to.
    pub(crate) arm: usize,
    /// `A_ij - B_ij`: from its platform joint to its cart joint, metres.
    pub(crate) vector_m: Vector3<f64>,
    /// `l_ij = R b_ij`: from the tool centre point to its platform joint, metres.
    pub(crate) lever_m: Vector3<f64>,
    /// `v_i`: direction of its guideway, metres per q-unit.
    pub(crate) guideway: Vector3<f64>,
    /// `L_i`: its nominal length, metres.
    pub(crate) length_m: f64,
}

/// The six links in link order `[T 3.3, 3.5, 3.6]`.
pub(crate) fn links<'a>(
    geometry: &'a Geometry,
    pose: &'a Pose,
    q: &[f64; ARMS],
) -> impl Iterator<Item = Link> + 'a {
    let [q1, q2, q3] = *q;
    let [v1, v2, v3] = geometry.guideways;
    let [l1, l2, l3] = geometry.lengths_m;
    let (one, two, three) = ((0, q1, v1, l1), (1, q2, v2, l2), (2, q3, v3, l3));
    [one, two, two, three, three, three]
        .into_iter()
        .zip(&geometry.cart_joints_m)
        .zip(&geometry.platform_joints_m)
        .map(|(((arm, q, guideway, length_m), cart), joint)| {
            let lever_m = times(&pose.rotation, joint);
            Link {
                arm,
                vector_m: cart + guideway * q - pose.position_m - lever_m,
                lever_m,
                guideway,
                length_m,
            }
        })
}

/// `s_ij`: from platform to cart.
pub(crate) fn directions(
    links_m: &[Vector3<f64>; LINKS],
) -> Result<[Vector3<f64>; LINKS], KinematicsError> {
    let mut directions = *links_m;
    for direction in &mut directions {
        *direction = unit(direction).ok_or(KinematicsError::NotFinite)?;
    }
    Ok(directions)
}

/// Largest error of the six link lengths in this pose with these positions, in metres `[T 3.4]`; NaN when a number given is.
#[must_use]
pub fn residual_m(robot: &Robot, pose: &Pose, q: &[f64; ARMS]) -> f64 {
    links(robot.geometry(), pose, q)
        .map(|link| (norm(&link.vector_m) - link.length_m).abs())
        .fold(0.0, larger)
}

#[cfg(test)]
pub(crate) mod tests;
