//! Parameters of the L2, validated once at construction.

use nalgebra::Vector3;

use super::AXES;
use crate::model::kinematics::{KinematicsError, Pose, directions};
use crate::model::linalg::{max_propagating_nan, norm, times};
use crate::model::robot::{
    ARM_OF_LINK, ARMS, Branch, LINKS, MAX_LENGTH_M, Parameter, RobotError, SCALE_RANGE,
    check_magnitudes, check_travel, check_vectors,
};
use crate::model::statics::LineMatrix;

/// Configuration `c` of `[T 3.1]`: the solution of the kinematics that the machine is built in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Configuration {
    /// Inverse kinematics, per arm: sign of `s_i . v_i`, with `s_i` from platform to cart.
    pub inverse: [Branch; ARMS],
    /// Forward kinematics: sign of `n . (T - P_1)`, with `n = (P_2 - P_1) x (P_3 - P_1)` and `P_i`
    /// the nominal cart points.
    pub forward: Branch,
}

/// Geometry of an L2, not yet checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// `A0_ij`: cart joints at `q = 0`, world axes, metres, link order.
    pub cart_joints_m: [Vector3<f64>; LINKS],
    /// `v_i`: guideway directions, world axes, metres per unit of `q_i`.
    pub guideways: [Vector3<f64>; ARMS],
    /// `b_ij`: platform joints in platform axes, from the tool centre point, metres, link order.
    pub platform_joints_m: [Vector3<f64>; LINKS],
    /// `L_i`: link length of each arm, metres; the links of a cluster are equally long.
    pub lengths_m: [f64; ARMS],
    /// Solution of the kinematics that the machine is built in.
    pub configuration: Configuration,
    /// Range of each `q_i` in q-units, `(lower, upper)`; `None` leaves the range unchecked.
    pub travel: Option<[(f64, f64); AXES]>,
}

/// Validated L2: three axes, six links. Its fields can be read, not changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Robot {
    geometry: Geometry,
}

impl Robot {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter, in the order of [`Geometry`]'s fields, that is not finite, out of range
    /// or reversed.
    pub fn new(geometry: Geometry) -> Result<Self, RobotError> {
        let (from, to) = SCALE_RANGE;
        check_vectors(
            Parameter::CartJoint,
            &geometry.cart_joints_m,
            0.0,
            MAX_LENGTH_M,
        )?;
        check_vectors(Parameter::Guideway, &geometry.guideways, from, to)?;
        check_vectors(
            Parameter::PlatformJoint,
            &geometry.platform_joints_m,
            0.0,
            MAX_LENGTH_M,
        )?;
        check_magnitudes(Parameter::Length, &geometry.lengths_m, 1e-6, MAX_LENGTH_M)?;
        check_travel(geometry.travel.iter().flatten())?;
        Ok(Self { geometry })
    }

    /// The validated geometry.
    #[inline]
    #[must_use]
    pub const fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Returns the numbers that decide the kinematics: `A0`, `V`, `b`, `L`, `c`, `cf`, in that
    /// order.
    pub(super) fn numbers(&self) -> impl Iterator<Item = f64> {
        let geometry = &self.geometry;
        let vectors = (geometry.cart_joints_m.iter())
            .chain(&geometry.guideways)
            .chain(&geometry.platform_joints_m);
        let branches = (geometry.configuration.inverse.iter())
            .chain([&geometry.configuration.forward])
            .map(|branch| branch.sign());
        (vectors.flat_map(|vector| vector.iter().copied()))
            .chain(geometry.lengths_m)
            .chain(branches)
    }

    /// Returns the largest error of the six link lengths in this pose with these positions
    /// (q-units), in metres `[T 3.4]`; NaN when a number given is.
    #[must_use]
    pub fn residual_m(&self, pose: &Pose, q: &[f64; AXES]) -> f64 {
        links(&self.geometry, pose, q)
            .map(|(link_m, length_m)| (norm(&link_m) - length_m).abs())
            .fold(0.0, max_propagating_nan)
    }

    /// Returns the line matrix `[T 3.17]` in any pose, with these positions (q-units). The Tau
    /// property is not needed.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] when the lines depend on each other, `NotFinite` when a number
    /// given is not finite.
    #[inline]
    pub fn line_matrix(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
    ) -> Result<LineMatrix<AXES>, KinematicsError> {
        let mut links_m = [Vector3::zeros(); LINKS];
        for (slot, (link_m, _)) in links_m.iter_mut().zip(links(&self.geometry, pose, q)) {
            *slot = link_m;
        }
        let directions = directions(&links_m)?;
        let mut drives = [[0.0; AXES]; LINKS];
        for ((row, s), arm) in drives.iter_mut().zip(&directions).zip(ARM_OF_LINK) {
            if let (Some(drive), Some(guideway)) =
                (row.get_mut(arm), self.geometry.guideways.get(arm))
            {
                *drive = s.dot(guideway);
            }
        }
        let levers_m = self
            .geometry
            .platform_joints_m
            .map(|joint| times(&pose.rotation, &joint));
        LineMatrix::new(&directions, &drives, &levers_m)
    }
}

/// The six links in link order `[T 3.3, 3.5, 3.6]`: `A_ij - B_ij`, from platform joint to cart
/// joint, world axes, and `L_i`; metres.
pub(super) fn links<'a>(
    geometry: &'a Geometry,
    pose: &'a Pose,
    q: &[f64; AXES],
) -> impl Iterator<Item = (Vector3<f64>, f64)> + 'a {
    let [q1, q2, q3] = *q;
    let [v1, v2, v3] = geometry.guideways;
    let [l1, l2, l3] = geometry.lengths_m;
    let (one, two, three) = ((v1 * q1, l1), (v2 * q2, l2), (v3 * q3, l3));
    let joints = geometry
        .cart_joints_m
        .iter()
        .zip(&geometry.platform_joints_m);
    [one, two, two, three, three, three]
        .into_iter()
        .zip(joints)
        .map(|((moved_m, length_m), (cart, joint))| {
            (
                cart + moved_m - pose.position_m - times(&pose.rotation, joint),
                length_m,
            )
        })
}

/// Any numbers: more machines than [`Robot::new`] accepts.
#[cfg(kani)]
impl kani::Arbitrary for Robot {
    fn any() -> Self {
        use crate::model::linalg::{any_six, any_three};
        let geometry = Geometry {
            cart_joints_m: any_six(),
            guideways: any_three(),
            platform_joints_m: any_six(),
            lengths_m: kani::any(),
            configuration: Configuration {
                inverse: [Branch::Positive; ARMS],
                forward: Branch::Positive,
            },
            travel: kani::any(),
        };
        Self { geometry }
    }
}
