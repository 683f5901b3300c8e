//! Nominal kinematics `[T 3.7-3.9]`: each cluster as one link, solved in closed form both ways.

use core::fmt;
use nalgebra::{Matrix3, Vector3};

use super::{AXES, LinkFrame, Robot};
use crate::model::kinematics::{
    KinematicsError, Pose, RESIDUAL_TOLERANCE, ROTATION_TOLERANCE, SINGULARITY_TOLERANCE,
    TAU_TOLERANCE,
};
use crate::model::linalg::{norm, rotation_deviation, sqrt, times};
use crate::model::robot::{ARM_OF_LINK, ARMS, Branch, LINKS, MAX_LENGTH_M, checksum};
use crate::model::statics::LineMatrix;

/// Farthest a cart may stand from `q = 0`, in lengths of its link. Farther out, rounding alone
/// (`foot^2` ulps, see [`Arm::reach`]) would cost more than [`RESIDUAL_TOLERANCE`].
const MAX_REACH: f64 = 1e3;
/// Largest coordinate of a tool centre point, metres; cart, link and platform together do not reach
/// it.
pub(super) const MAX_POSITION_M: f64 = 10.0 * MAX_LENGTH_M;

/// Error of a machine in an orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum OrientationError {
    /// The matrix given is not a rotation.
    NotRotation {
        /// Largest deviation of `R^T R` from the identity; infinite for a mirror or for numbers
        /// that are not finite.
        deviation: f64,
    },
    /// The Tau property is violated: within a cluster, `A0_ij - R b_ij` must be the same for every
    /// link.
    NotTau {
        /// Index of the link that differs from the first of its cluster, from 0 in link order.
        link: usize,
        /// Difference, metres.
        mismatch_m: f64,
    },
}

impl fmt::Display for OrientationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotRotation { deviation } => {
                write!(f, "R is not a rotation matrix (deviation {deviation:e})")
            }
            Self::NotTau { link, mismatch_m } => {
                write!(
                    f,
                    "A0 - R b of link[{link}] differs by {mismatch_m:e} m within its cluster (Tau property)"
                )
            }
        }
    }
}

impl core::error::Error for OrientationError {}

/// One cluster as one link, with everything that does not change from pose to pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arm {
    /// `A_s`: the cart's point at `q = 0` `[T 3.7]`, metres.
    pub(super) origin_m: Vector3<f64>,
    /// `v`: metres per q-unit.
    pub(super) guideway: Vector3<f64>,
    /// `c v / |v|`: direction along the guideway that the link points to.
    direction: Vector3<f64>,
    /// `c |v|`.
    signed_scale: f64,
    /// `c / |v|`: takes metres along `direction` to q-units.
    per_metre: f64,
    /// `L^2`.
    pub(super) length_squared: f64,
    /// Smallest length of the link along its guideway that is not singular, and its square.
    pub(super) along_min: f64,
    pub(super) along_squared_min: f64,
    /// Largest magnitude of the travel, q-units.
    widest: f64,
    /// Travel, q-units.
    pub(super) lower: f64,
    pub(super) upper: f64,
}

/// The nominal model of a machine in a constant orientation `R`.
///
/// [`inverse`](Self::inverse) and [`forward`](Self::forward) are closed forms, and inverses of each
/// other on the machine's side of the carts' plane, within rounding.
///
/// # Examples
/// ```
/// use gantry_tau_core::model::nalgebra::{Matrix3, Vector3};
/// use gantry_tau_core::model::{l2, presets};
///
/// let robot = l2::Robot::new(presets::l2())?;
/// let kinematics = l2::Kinematics::new(&robot, &Matrix3::identity())?;
/// let tcp_m = Vector3::new(0.0, 0.5, 0.65);
/// let q = kinematics.inverse_in_assembly(&tcp_m)?;
/// assert!((kinematics.forward(&q)? - tcp_m).amax() < 1e-12);
/// # Ok::<(), Box<dyn core::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    pub(super) arms: [Arm; ARMS],
    /// Sign of `-n . (T - P_1) = det(w_1, w_2, w_3)` in this configuration.
    pub(super) side: f64,
    /// Sign of `n . (T - P_1)`: `c_f`.
    height_sign: f64,
    /// `L_1^2 - L_2^2` and `L_1^2 - L_3^2`, metres squared.
    squares_less: (f64, f64),
    /// Smallest `|det(w_1, w_2, w_3)|` that is not singular, and its square.
    pub(super) determinant_min: f64,
    pub(super) determinant_squared_min: f64,
    /// Largest [`Meeting::mismatch`] that keeps [`RESIDUAL_TOLERANCE`].
    pub(super) mismatch_max: f64,
    rotation: Matrix3<f64>,
    levers_m: [Vector3<f64>; LINKS],
    robot: Robot,
}

impl Kinematics {
    /// Prepares the kinematics of a machine in orientation `R` (world axes from platform axes),
    /// after a check of the Tau property.
    ///
    /// Travel that is absent, or wider than [`MAX_LENGTH_M`] or a thousand link lengths to either
    /// side, is taken as that.
    ///
    /// # Errors
    /// [`OrientationError`]: the nominal model holds only for a rotation that keeps
    /// `A0_ij - R b_ij` equal within each cluster.
    pub fn new(robot: &Robot, rotation: &Matrix3<f64>) -> Result<Self, OrientationError> {
        let deviation = rotation_deviation(rotation);
        if deviation > ROTATION_TOLERANCE {
            return Err(OrientationError::NotRotation { deviation });
        }
        let geometry = robot.geometry();
        let levers_m = geometry
            .platform_joints_m
            .map(|joint| times(rotation, &joint));
        let origins = cluster_origins(&geometry.cart_joints_m, &levers_m, &geometry.lengths_m)?;
        let [o1, o2, o3] = origins;
        let [v1, v2, v3] = geometry.guideways;
        let [l1, l2, l3] = geometry.lengths_m;
        let [c1, c2, c3] = geometry.configuration.inverse;
        let [t1, t2, t3] = geometry
            .travel
            .map_or([None; ARMS], |ranges| ranges.map(Some));
        let determinant_min = SINGULARITY_TOLERANCE * l1 * l2 * l3;
        Ok(Self {
            arms: [
                Arm::new(o1, v1, l1, c1, t1),
                Arm::new(o2, v2, l2, c2, t2),
                Arm::new(o3, v3, l3, c3, t3),
            ],
            side: -geometry.configuration.forward.sign(),
            height_sign: geometry.configuration.forward.sign(),
            squares_less: (l1 * l1 - l2 * l2, l1 * l1 - l3 * l3),
            determinant_min,
            determinant_squared_min: determinant_min * determinant_min,
            mismatch_max: RESIDUAL_TOLERANCE * (l1 * l1).min(l2 * l2).min(l3 * l3),
            rotation: *rotation,
            levers_m,
            robot: *robot,
        })
    }

    /// The same model with travel as wide as [`new`](Self::new) takes it: for corrections, which
    /// may leave the nominal travel and are bounded elsewhere.
    #[must_use]
    pub fn without_travel(&self) -> Self {
        Self {
            arms: self.arms.map(Arm::without_travel),
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
    /// into positions: `A0`, `V`, `b`, `L`, `c`, `cf`, the orientation `R` row by row, and
    /// `metres_per_q`, the length of one unit of each `q`, m; as little-endian `f64` bits, in that
    /// order, zeros without their sign. Travel, springs and sensor are not part of it.
    #[must_use]
    pub fn checksum(&self, metres_per_q: &[f64; AXES]) -> u32 {
        // nalgebra counts by columns.
        let rows: [[f64; 3]; 3] = self.rotation.transpose().into();
        checksum(
            self.robot
                .numbers()
                .chain(rows.as_flattened().iter().copied())
                .chain(*metres_per_q),
        )
    }

    /// Pose with the tool centre point at `position_m` (world axes, metres), in the constant
    /// orientation.
    #[must_use]
    pub const fn pose(&self, position_m: Vector3<f64>) -> Pose {
        Pose {
            position_m,
            rotation: self.rotation,
        }
    }

    /// As [`Robot::residual_m`].
    #[must_use]
    pub fn residual_m(&self, pose: &Pose, q: &[f64; AXES]) -> f64 {
        self.robot.residual_m(pose, q)
    }

    /// As [`Robot::line_matrix`].
    ///
    /// # Errors
    /// As [`Robot::line_matrix`].
    #[inline]
    pub fn line_matrix(
        &self,
        pose: &Pose,
        q: &[f64; AXES],
    ) -> Result<LineMatrix<AXES>, KinematicsError> {
        self.robot.line_matrix(pose, q)
    }

    /// `R`: the constant orientation, world axes from platform axes.
    #[must_use]
    pub const fn rotation(&self) -> &Matrix3<f64> {
        &self.rotation
    }

    /// `l_ij = R b_ij`: from the tool centre point to each platform joint, world axes, metres, link
    /// order.
    pub(super) const fn levers_m(&self) -> &[Vector3<f64>; LINKS] {
        &self.levers_m
    }

    /// Travel of each axis in force, `(lower, upper)`, q-units.
    #[must_use]
    pub fn travel(&self) -> [(f64, f64); AXES] {
        let [a1, a2, a3] = &self.arms;
        [
            (a1.lower, a1.upper),
            (a2.lower, a2.upper),
            (a3.lower, a3.upper),
        ]
    }

    /// `L_i^2`, metres squared.
    pub(crate) fn lengths_squared(&self) -> [f64; ARMS] {
        self.arms.map(|arm| arm.length_squared)
    }

    /// Inverse kinematics `[T 3.2, 3.9]`: positions `q` (q-units) that put the tool centre point at
    /// `tcp_m` (world axes, metres).
    ///
    /// Of the two solutions of each arm, the one with `sign(s_i . v_i) = c_i`. A pose on the other
    /// side of the carts' plane has the same positions as its mirror image on this side: where
    /// poses come from outside (a target, a file), use
    /// [`inverse_in_assembly`](Self::inverse_in_assembly), which tells them apart.
    ///
    /// # Errors
    /// [`KinematicsError::Unreachable`], `Singular`, `OutOfRange`, `NotFinite`.
    #[inline]
    pub fn inverse(&self, tcp_m: &Vector3<f64>) -> Result<[f64; AXES], KinematicsError> {
        let [a1, a2, a3] = &self.arms;
        let (r1, r2, r3) = (a1.reach(tcp_m), a2.reach(tcp_m), a3.reach(tcp_m));
        let q = [r1.q, r2.q, r3.q];
        if a1.accepts(&r1) && a2.accepts(&r2) && a3.accepts(&r3) && self.travels(&q) {
            Ok(q)
        } else {
            Err(self.diagnose_inverse(tcp_m))
        }
    }

    /// True if every axis is inside its travel: the last check of all positions returned. False for
    /// NaN.
    #[inline]
    #[must_use]
    pub fn travels(&self, q: &[f64; AXES]) -> bool {
        let [a1, a2, a3] = &self.arms;
        let [q1, q2, q3] = *q;
        a1.travels(q1) && a2.travels(q2) && a3.travels(q3)
    }

    /// As [`inverse`](Self::inverse), for a tool on the machine's side of the carts' plane only:
    /// [`forward`](Self::forward) leads back to it.
    ///
    /// # Errors
    /// As [`inverse`](Self::inverse); [`KinematicsError::OtherBranch`] on the other side,
    /// `Singular` in the plane.
    #[inline]
    pub fn inverse_in_assembly(
        &self,
        tcp_m: &Vector3<f64>,
    ) -> Result<[f64; AXES], KinematicsError> {
        let q = self.inverse(tcp_m)?;
        self.link_frame(tcp_m, &q)?;
        Ok(q)
    }

    /// Forward kinematics `[T 3.1]`: the tool centre point (world axes, metres) for positions `q`
    /// (q-units), by trilateration.
    ///
    /// Of the two solutions, the one with `sign(n . (T - P_1)) = c_f`,
    /// `n = (P_2 - P_1) x (P_3 - P_1)`; it must agree with every `c_i` too.
    ///
    /// # Errors
    /// Every variant of [`KinematicsError`] but `Unreachable` and `Inconsistent`.
    #[inline]
    pub fn forward(&self, q: &[f64; AXES]) -> Result<Vector3<f64>, KinematicsError> {
        let meeting = self.meet(q);
        if self.assembles(q, &meeting, &meeting.links()) {
            Ok(meeting.from_1 + meeting.tcp)
        } else {
            Err(self.diagnose_forward(q))
        }
    }

    /// Computes [`forward`](Self::forward) and [`link_frame`](Self::link_frame) together; cheaper
    /// than two calls.
    ///
    /// # Errors
    /// As [`forward`](Self::forward).
    #[inline]
    pub fn forward_frame(
        &self,
        q: &[f64; AXES],
    ) -> Result<(Vector3<f64>, LinkFrame), KinematicsError> {
        let meeting = self.meet(q);
        let links_m = meeting.links();
        if !self.assembles(q, &meeting, &links_m) {
            return Err(self.diagnose_forward(q));
        }
        let [w1, w2, w3] = &links_m;
        // n = w_2 x w_3 + w_3 x w_1 + w_1 x w_2, and n . w_1 is the determinant.
        let (c2, c3) = (w3.cross(w1), w1.cross(w2));
        let c1 = meeting.normal - c2 - c3;
        let scale = 1.0 / meeting.normal.dot(w1);
        let [a1, a2, a3] = &self.arms;
        let frame = LinkFrame {
            links_m,
            inverse_rows: [c1 * scale, c2 * scale, c3 * scale],
            drives: [
                a1.along(w1) * a1.signed_scale,
                a2.along(w2) * a2.signed_scale,
                a3.along(w3) * a3.signed_scale,
            ],
        };
        Ok((meeting.from_1 + meeting.tcp, frame))
    }

    /// True if the links meet as the machine is built, inside the travel; false for NaN.
    #[inline]
    fn assembles(
        &self,
        q: &[f64; AXES],
        meeting: &Meeting,
        links_m: &[Vector3<f64>; ARMS],
    ) -> bool {
        let [a1, a2, a3] = &self.arms;
        let [w1, w2, w3] = links_m;
        let mismatch = meeting.mismatch;
        self.travels(q)
            && meeting.determinant_squared > self.determinant_squared_min
            && a1.along(w1) > a1.along_min
            && a2.along(w2) > a2.along_min
            && a3.along(w3) > a3.along_min
            && mismatch <= self.mismatch_max
    }

    /// Point at which the three nominal links meet, on the side of the carts' plane that `c_f`
    /// names.
    ///
    /// With `x = T - P_1` in the plane as `x = a e_1 + b e_2`, two differences of `[T 3.9]` give
    /// `x . e_1 = k_1`, `x . e_2 = k_2`.
    #[inline]
    pub(super) fn meet(&self, q: &[f64; AXES]) -> Meeting {
        let [a1, a2, a3] = &self.arms;
        let [q1, q2, q3] = *q;
        let from_1 = a1.cart(q1);
        let e1 = a2.cart(q2) - from_1;
        let e2 = a3.cart(q3) - from_1;
        let normal = e1.cross(&e2);
        let (e11, e12, e22) = (e1.dot(&e1), e1.dot(&e2), e2.dot(&e2));
        let (d2, d3) = self.squares_less;
        let (k1, k2) = (0.5 * (e11 + d2), 0.5 * (e22 + d3));
        let normal_squared = normal.dot(&normal);
        let per_normal = 1.0 / normal_squared;
        let a = (k1 * e22 - k2 * e12) * per_normal;
        let b = (k2 * e11 - k1 * e12) * per_normal;
        // The result of the two equations, put back into them. With `|x|^2` taken from it, link 1
        // keeps its length for any `a` and `b`, and the squared lengths of the others are wrong by
        // twice the mismatch.
        let (g1, g2) = (a * e11 + b * e12, a * e12 + b * e22);
        let height_squared = a1.length_squared - (a * g1 + b * g2);
        let height = self.height_sign * sqrt(height_squared * per_normal);
        Meeting {
            from_1,
            e1,
            e2,
            tcp: e1 * a + e2 * b + normal * height,
            normal,
            normal_squared,
            determinant_squared: height_squared * normal_squared,
            mismatch: (g1 - k1).abs() + (g2 - k2).abs(),
        }
    }
}

/// One arm that reaches a point.
pub(super) struct Reach {
    pub(super) q: f64,
    /// Square of the link's length along the guideway, metres squared; negative when the link is
    /// too short.
    pub(super) along_squared: f64,
}

/// Meeting point of the links, relative to the first cart.
pub(super) struct Meeting {
    from_1: Vector3<f64>,
    e1: Vector3<f64>,
    e2: Vector3<f64>,
    tcp: Vector3<f64>,
    /// `n = e_1 x e_2`.
    normal: Vector3<f64>,
    pub(super) normal_squared: f64,
    /// Square of `det(w_1, w_2, w_3)`; negative when the links do not meet.
    pub(super) determinant_squared: f64,
    /// By how much `x . e_1 = k_1` and `x . e_2 = k_2` are missed, metres squared: near a
    /// singularity rounding decides.
    pub(super) mismatch: f64,
}

impl Meeting {
    /// `w_i`: from the tool centre point to the carts' nominal points.
    #[inline]
    pub(super) fn links(&self) -> [Vector3<f64>; ARMS] {
        [-self.tcp, self.e1 - self.tcp, self.e2 - self.tcp]
    }
}

impl Arm {
    fn new(
        origin_m: Vector3<f64>,
        guideway: Vector3<f64>,
        length: f64,
        branch: Branch,
        travel: Option<(f64, f64)>,
    ) -> Self {
        let scale = norm(&guideway);
        let widest = MAX_LENGTH_M.min(MAX_REACH * length) / scale;
        let (lower, upper) = travel.unwrap_or((-widest, widest));
        let length_squared = length * length;
        Self {
            origin_m,
            guideway,
            direction: guideway / scale * branch.sign(),
            signed_scale: branch.sign() * scale,
            per_metre: branch.sign() / scale,
            length_squared,
            along_min: SINGULARITY_TOLERANCE * length,
            along_squared_min: SINGULARITY_TOLERANCE * SINGULARITY_TOLERANCE * length_squared,
            widest,
            lower: lower.max(-widest),
            upper: upper.min(widest),
        }
    }

    fn without_travel(self) -> Self {
        Self {
            lower: -self.widest,
            upper: self.widest,
            ..self
        }
    }

    /// `P = A_s + q v` `[T 3.7]`.
    #[inline]
    pub(super) fn cart(&self, q: f64) -> Vector3<f64> {
        self.origin_m + self.guideway * q
    }

    /// Foot of the perpendicular on the guideway, then along it to where the link ends `[T 3.9]`.
    /// The difference of squares costs `foot^2` ulps: 1e-12 m at the end of a guideway of 100 m.
    #[inline]
    pub(super) fn reach(&self, tcp_m: &Vector3<f64>) -> Reach {
        let from_origin = tcp_m - self.origin_m;
        let foot = from_origin.dot(&self.direction);
        let along_squared = foot * foot + self.length_squared - from_origin.dot(&from_origin);
        Reach {
            q: (foot + sqrt(along_squared)) * self.per_metre,
            along_squared,
        }
    }

    /// `c_i (w_i . v_i) / |v_i|`: length of the link along its guideway, to its side, metres.
    #[inline]
    pub(super) fn along(&self, link_m: &Vector3<f64>) -> f64 {
        self.direction.dot(link_m)
    }

    /// True if the point is reached, away from a singularity; false for NaN.
    #[inline]
    fn accepts(&self, reach: &Reach) -> bool {
        reach.along_squared > self.along_squared_min
    }

    /// True if `q` is inside the travel; false for NaN.
    #[inline]
    pub(super) fn travels(&self, q: f64) -> bool {
        q >= self.lower && q <= self.upper
    }
}

/// Any numbers: more machines than [`Kinematics::new`] makes.
#[cfg(kani)]
impl kani::Arbitrary for Kinematics {
    fn any() -> Self {
        use crate::model::linalg::any_six;
        Self {
            arms: [kani::any(), kani::any(), kani::any()],
            side: kani::any(),
            height_sign: kani::any(),
            squares_less: (kani::any(), kani::any()),
            determinant_min: kani::any(),
            determinant_squared_min: kani::any(),
            mismatch_max: kani::any(),
            rotation: Matrix3::from(kani::any::<[[f64; 3]; 3]>()),
            robot: kani::any(),
            levers_m: any_six(),
        }
    }
}

#[cfg(kani)]
impl kani::Arbitrary for Arm {
    fn any() -> Self {
        use crate::model::linalg::any_vector;
        Self {
            origin_m: any_vector(),
            guideway: any_vector(),
            direction: any_vector(),
            signed_scale: kani::any(),
            per_metre: kani::any(),
            length_squared: kani::any(),
            along_min: kani::any(),
            along_squared_min: kani::any(),
            widest: kani::any(),
            lower: kani::any(),
            upper: kani::any(),
        }
    }
}

/// `A_s_i = A0_ij - R b_ij` `[T 3.7]`, the same for every link of a cluster: the mean, once that is
/// checked.
fn cluster_origins(
    cart_joints_m: &[Vector3<f64>; LINKS],
    levers_m: &[Vector3<f64>; LINKS],
    lengths_m: &[f64; ARMS],
) -> Result<[Vector3<f64>; ARMS], OrientationError> {
    let [a11, a21, a22, a31, a32, a33] = cart_joints_m;
    let [l11, l21, l22, l31, l32, l33] = levers_m;
    let first = [a11 - l11, a21 - l21, a31 - l31];
    for (link, ((cart, lever), arm)) in
        (cart_joints_m.iter().zip(levers_m).zip(ARM_OF_LINK)).enumerate()
    {
        let (Some(origin), Some(length)) = (first.get(arm), lengths_m.get(arm)) else {
            continue;
        };
        let mismatch_m = norm(&(cart - lever - origin));
        if mismatch_m > TAU_TOLERANCE * length {
            return Err(OrientationError::NotTau { link, mismatch_m });
        }
    }
    let [one, _, _] = first;
    Ok([
        one,
        (a21 - l21 + a22 - l22) / 2.0,
        (a31 - l31 + a32 - l32 + a33 - l33) / 3.0,
    ])
}
