//! Kinematics of the F1 `[T 3.1.2]`: the plates, the inverse and the forward problem by Newton's
//! method.
//!
//! The inverse problem falls apart: arm 1 has a closed form, cluster 2 two unknowns `(q_2, q_4)`,
//! cluster 3 three `(q_3, q_5, q_6)`. The forward problem is that of a Stewart platform whose base
//! joints are given by `q`: six unknowns, solved on the group (`R <- exp(dtheta) R`; angles are
//! never added). Both have analytic derivatives, a capped number of iterations, and a solution that
//! is checked before it is returned: every link has its length, every axis is inside its travel,
//! every arm on its side, and the tool in the same assembly mode as the seed.

mod forward;
mod inverse;
mod inverse_fixed_plates;
mod newton;
pub(in crate::model::f1) mod plates;
mod step;
#[cfg(test)]
mod tests;

use nalgebra::{ArrayStorage, Matrix6, Vector3};

use super::{AXES, Robot};
use crate::model::block_solve::BlockFactors;
use crate::model::kinematics::{
    KinematicsError, Pose, RESIDUAL_TOLERANCE, SINGULARITY_TOLERANCE, directions,
};
use crate::model::linalg::{are_finite, max_propagating_nan, norm, times};
use crate::model::robot::{ARM_OF_LINK, ARMS, LINKS, checksum};
use crate::model::statics::{LineMatrix, moments};
use crate::zip::zip;
use plates::{Drives, Plates, PlatesAt};

/// Convergence threshold of the residual over the machine's size; below it, iterations are limited
/// by round-off.
const CONVERGED: f64 = 1e-14;
/// Travel where none is given: carts unchecked, plates within half a turn.
const UNLIMITED: [(f64, f64); AXES] = {
    let cart = (f64::NEG_INFINITY, f64::INFINITY);
    let plate = (-core::f64::consts::PI, core::f64::consts::PI);
    [cart, cart, cart, plate, plate, plate]
};

/// Kinematics of a machine; built once, its methods keep no state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    robot: Robot,
    plates: Plates,
    /// Largest length in the machine, metres: the scale of rounding.
    size_m: f64,
    /// Largest error of a link in a solution, metres.
    tolerance_m: f64,
    travel: [(f64, f64); AXES],
    /// `c_i V_i / |V_i|`: side that the links of an arm point to.
    sides: [Vector3<f64>; ARMS],
    /// `|P_ij|`: distance of a joint from its cart's origin, metres.
    plate_reaches_m: [f64; LINKS],
}

impl Kinematics {
    /// Prepares the kinematics of a machine.
    #[must_use]
    pub fn new(robot: &Robot) -> Self {
        let geometry = robot.geometry();
        let [l11, l21, l22, l31, l32, l33] = geometry.lengths_m;
        let shortest = l11.min(l21).min(l22).min(l31).min(l32).min(l33);
        let longest = l11.max(l21).max(l22).max(l31).max(l32).max(l33);
        let [c1, c2, c3] = geometry.carts_m.map(|cart| norm(&cart));
        let [v1, v2, v3] = geometry
            .guideways
            .map(|guideway| guideway / norm(&guideway));
        let [side1, side2, side3] = geometry.configuration.map(|branch| branch.sign());
        Self {
            robot: *robot,
            plates: Plates::new(geometry),
            size_m: longest + c1.max(c2).max(c3),
            tolerance_m: RESIDUAL_TOLERANCE * shortest,
            travel: geometry.travel.unwrap_or(UNLIMITED),
            sides: [v1 * side1, v2 * side2, v3 * side3],
            plate_reaches_m: geometry.plate_joints_m.map(|joint| norm(&joint)),
        }
    }

    /// As [`new`](Self::new), without limits of travel: carts unchecked, plates within half a turn.
    /// For corrections, which may leave the nominal travel and are bounded elsewhere.
    /// [`robot`](Self::robot) keeps its own; [`travel`](Self::travel) is the one in force.
    #[must_use]
    pub const fn without_travel(&self) -> Self {
        Self {
            travel: UNLIMITED,
            ..*self
        }
    }

    /// The machine.
    #[inline]
    #[must_use]
    pub const fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Returns the CRC-32 of everything that turns positions of the drives into poses, and loads
    /// into positions: `C`, `V`, `P`, `b`, `L`, `c`, `ax` and `ax6` at unit length, `sigma4`,
    /// `sigma5`, and `metres_per_q`, the length of one unit of each `q`, m; as little-endian `f64`
    /// bits, in that order, zeros without their sign. Travel, springs and sensor are not part of
    /// it.
    #[must_use]
    pub fn checksum(&self, metres_per_q: &[f64; AXES]) -> u32 {
        checksum(self.robot.numbers().chain(*metres_per_q))
    }

    /// Returns the largest error of the six link lengths in this pose with these positions, metres;
    /// NaN when a number given is NaN.
    #[must_use]
    pub fn residual_m(&self, pose: &Pose, q: &[f64; AXES]) -> f64 {
        largest(
            &self.links_m(pose, q),
            &self.robot.geometry().lengths_m,
            |link, length| norm(link) - length,
        )
    }

    /// Returns the links `A_ij - B_ij`, from platform joint to plate joint, world axes, metres,
    /// link order.
    #[must_use]
    pub fn links_m(&self, pose: &Pose, q: &[f64; AXES]) -> [Vector3<f64>; LINKS] {
        self.links_and_levers(pose, &self.plates.at(q).joints_m).0
    }

    /// Returns the links as [`links_m`](Self::links_m), for known plate joints, and the levers
    /// `R b_ij` of their platform joints about the tool centre point; metres, link order.
    #[inline]
    fn links_and_levers(
        &self,
        pose: &Pose,
        joints_m: &[Vector3<f64>; LINKS],
    ) -> ([Vector3<f64>; LINKS], [Vector3<f64>; LINKS]) {
        let levers_m = self
            .robot
            .geometry()
            .platform_joints_m
            .map(|joint| times(&pose.rotation, &joint));
        let mut links_m = *joints_m;
        for (link, lever) in links_m.iter_mut().zip(&levers_m) {
            *link -= pose.position_m + lever;
        }
        (links_m, levers_m)
    }

    /// `B_ij = T + R b_ij`: the platform joints, world axes, metres, link order.
    fn ends_m(&self, pose: &Pose) -> [Vector3<f64>; LINKS] {
        let joints = &self.robot.geometry().platform_joints_m;
        joints.map(|joint| pose.position_m + times(&pose.rotation, &joint))
    }

    /// Returns the line matrix `[T 3.17]` in this pose with these positions (q-units).
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] when the lines depend on each other, `NotFinite` when a number
    /// given is not finite.
    #[inline(never)]
    pub fn line_matrix(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
    ) -> Result<LineMatrix<AXES>, KinematicsError> {
        self.line_matrix_of(pose, &self.plates.at(q))
    }

    /// Plates at these positions.
    pub(super) fn place(&self, q: &[f64; AXES]) -> PlatesAt<'_> {
        self.plates.at(q)
    }

    /// As [`line_matrix`](Self::line_matrix), with plates that are placed.
    pub(super) fn line_matrix_of(
        &self,
        pose: &Pose,
        plates: &PlatesAt<'_>,
    ) -> Result<LineMatrix<AXES>, KinematicsError> {
        let (links_m, levers_m) = &self.links_and_levers(pose, &plates.joints_m);
        let directions = directions(links_m)?;
        LineMatrix::new(&directions, &plates.drives(&directions).rows(), levers_m)
    }

    /// Returns the Jacobian: the platform's twist (translation of the tool centre point over
    /// rotation, world axes) per axis; metres and radians per q-unit. As
    /// [`line_matrix`](Self::line_matrix) and [`LineMatrix::jacobian`], without the parts that
    /// forces need.
    ///
    /// # Errors
    /// As [`line_matrix`](Self::line_matrix).
    pub fn jacobian(&self, pose: &Pose, q: &[f64; AXES]) -> Result<Matrix6<f64>, KinematicsError> {
        let plates = self.plates.at(q);
        // Rows of any length: the links' cancel.
        let (links_m, levers_m) = &self.links_and_levers(pose, &plates.joints_m);
        let Some(factors) = BlockFactors::new(links_m, &moments(levers_m, links_m)) else {
            return self.line_matrix(pose, q)?.jacobian();
        };
        let Drives {
            one,
            two: [[d21, t21], [d22, t22]],
            three: [[d31, t31, k31], [d32, t32, k32], [d33, t33, k33]],
        } = plates.drives(links_m);
        let columns = [
            factors.solve_arm::<0>(one, [0.0; 3]),
            factors.solve_arm::<1>(d21, [d22, 0.0, 0.0]),
            factors.solve_arm::<2>(d31, [0.0, d32, d33]),
            factors.solve_arm::<1>(t21, [t22, 0.0, 0.0]),
            factors.solve_arm::<2>(t31, [0.0, t32, t33]),
            factors.solve_arm::<2>(k31, [0.0, k32, k33]),
        ];
        let jacobian = columns.map(|(x, y)| [x.x, x.y, x.z, y.x, y.y, y.z]);
        if !are_finite(jacobian.as_flattened()) {
            return Err(KinematicsError::NotFinite);
        }
        Ok(Matrix6::from_data(ArrayStorage(jacobian)))
    }

    /// Convergence threshold of each link's surplus, square metres.
    fn settled(&self) -> [f64; LINKS] {
        self.robot
            .geometry()
            .lengths_m
            .map(|length| CONVERGED * self.size_m * length)
    }

    /// Last check of every solution, found after `iterations`: links of the right length, axes
    /// inside their travel, arms on their side. Returns the residual, metres.
    #[inline]
    fn check(
        &self,
        links_m: &[Vector3<f64>; LINKS],
        q: &[f64; AXES],
        lengths_m: &[f64; LINKS],
        iterations: u8,
    ) -> Result<f64, KinematicsError> {
        // To first order: of an error that may stand, a billionth of the length, the rest is a
        // billionth. Roots are long without hardware.
        let residual_m = largest(links_m, lengths_m, |link, length| {
            surplus(link, *length) / length
        });
        if !residual_m.is_finite() {
            return Err(KinematicsError::NotFinite);
        }
        if residual_m > self.tolerance_m {
            return Err(KinematicsError::NotConverged {
                iterations,
                residual_m,
            });
        }
        if !self.travels(q) {
            return Err(self.out_of_range(q));
        }
        self.on_their_sides(links_m)?;
        Ok(residual_m)
    }

    /// True if every axis is inside its travel; false for NaN.
    #[must_use]
    pub fn travels(&self, q: &[f64; AXES]) -> bool {
        zip(q, &self.travel).all(|(q, range)| within(*q, range))
    }

    /// Range of each axis, `(lower, upper)` in q-units; infinite where a cart's is not checked.
    #[must_use]
    pub const fn travel(&self) -> &[(f64, f64); AXES] {
        &self.travel
    }

    #[cold]
    fn out_of_range(&self, q: &[f64; AXES]) -> KinematicsError {
        let mut axes = zip(q, &self.travel).enumerate();
        let outside = axes.find(|(_, (q, range))| !within(**q, range));
        match outside {
            Some((axis, (q, (lower, upper)))) => KinematicsError::OutOfRange {
                axis,
                q: *q,
                lower: *lower,
                upper: *upper,
            },
            None => KinematicsError::NotFinite,
        }
    }

    /// `c_i = sign(s_ij . V_i)` for every link of cluster `i`, and not near zero.
    #[inline]
    fn on_their_sides(&self, links_m: &[Vector3<f64>; LINKS]) -> Result<(), KinematicsError> {
        let [side1, side2, side3] = &self.sides;
        let lengths_m = &self.robot.geometry().lengths_m;
        let [l11, l21, l22, l31, l32, l33] = lengths_m;
        let [w11, w21, w22, w31, w32, w33] = links_m;
        if is_on_side(side1, w11, *l11)
            && is_on_side(side2, w21, *l21)
            && is_on_side(side2, w22, *l22)
            && is_on_side(side3, w31, *l31)
            && is_on_side(side3, w32, *l32)
            && is_on_side(side3, w33, *l33)
        {
            return Ok(());
        }
        Err(self.diagnose_on_their_sides(links_m))
    }

    #[cold]
    fn diagnose_on_their_sides(&self, links_m: &[Vector3<f64>; LINKS]) -> KinematicsError {
        let lengths = zip(links_m, &self.robot.geometry().lengths_m);
        for ((link, length), arm) in lengths.zip(ARM_OF_LINK) {
            let cosine = self
                .sides
                .get(arm)
                .map_or(0.0, |side| side.dot(link) / length);
            if cosine < -SINGULARITY_TOLERANCE {
                return KinematicsError::OtherBranch { arm: Some(arm) };
            }
            if cosine <= SINGULARITY_TOLERANCE {
                return KinematicsError::Singular {
                    measure: cosine.abs(),
                };
            }
        }
        KinematicsError::NotFinite
    }
}

/// True if `q` is inside its range; false for NaN.
fn within(q: f64, (lower, upper): &(f64, f64)) -> bool {
    *lower <= q && q <= *upper
}

/// True if a link points to its side (a unit vector), away from a singularity; false for NaN.
#[inline]
fn is_on_side(side: &Vector3<f64>, link_m: &Vector3<f64>, length_m: f64) -> bool {
    side.dot(link_m) > SINGULARITY_TOLERANCE * length_m
}

/// Surplus of a link, `(|w|^2 - L^2) / 2`: its error times its length, to first order; square
/// metres. Needs no root.
#[inline]
fn surplus(link_m: &Vector3<f64>, length_m: f64) -> f64 {
    (link_m.dot(link_m) - length_m * length_m) * 0.5
}

/// Largest magnitude of an error over the links; NaN where one is.
#[inline]
fn largest(
    links_m: &[Vector3<f64>; LINKS],
    lengths_m: &[f64; LINKS],
    error: impl Fn(&Vector3<f64>, &f64) -> f64,
) -> f64 {
    let [w11, w21, w22, w31, w32, w33] = links_m;
    let [l11, l21, l22, l31, l32, l33] = lengths_m;
    let two = max_propagating_nan(error(w21, l21).abs(), error(w22, l22).abs());
    let three = max_propagating_nan(
        error(w31, l31).abs(),
        max_propagating_nan(error(w32, l32).abs(), error(w33, l33).abs()),
    );
    max_propagating_nan(error(w11, l11).abs(), max_propagating_nan(two, three))
}

const _: () = assert!(ARMS == 3 && LINKS == AXES, "six links for six axes");

/// Any numbers: more machines than [`Kinematics::new`] makes.
#[cfg(kani)]
impl kani::Arbitrary for Kinematics {
    fn any() -> Self {
        use crate::model::linalg::any_three;
        Self {
            robot: kani::any(),
            plates: kani::any(),
            size_m: kani::any(),
            tolerance_m: kani::any(),
            travel: kani::any(),
            sides: any_three(),
            plate_reaches_m: kani::any(),
        }
    }
}
