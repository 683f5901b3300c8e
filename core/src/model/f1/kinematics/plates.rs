//! Plates of the carts: positions of their joints for given axes, and their derivatives.

use nalgebra::{Matrix3, Vector3};

use crate::model::f1::{AXES, Geometry};
use crate::model::linalg::{cross_matrix, product, sin_cos, times};
use crate::model::robot::{ARMS, LINKS};

/// Constants of the plates' kinematics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plates {
    carts_m: [Vector3<f64>; ARMS],
    guideways: [Vector3<f64>; ARMS],
    joints_m: [Vector3<f64>; LINKS],
    turn: Axis,
    tilt: Axis,
    /// `sigma_4`, `sigma_5`.
    signs: [f64; 2],
}

/// A fixed axis: `Rot(a, angle) = I + sin K + (1 - cos) K^2` with `K = a x` (Rodrigues' formula).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis {
    direction: Vector3<f64>,
    k: Matrix3<f64>,
    k_squared: Matrix3<f64>,
}

impl Axis {
    fn new(direction: Vector3<f64>) -> Self {
        let k = cross_matrix(&direction);
        Self { direction, k, k_squared: product(&k, &k) }
    }

    #[inline]
    fn rotation(&self, angle_rad: f64) -> Matrix3<f64> {
        // Over the half angle, 1 - cos = 2 sin^2 does not cancel.
        let (sine, cosine) = sin_cos(0.5 * angle_rad);
        let (along, across) = (2.0 * sine * cosine, 2.0 * sine * sine);
        Matrix3::identity() + self.k * along + self.k_squared * across
    }
}

/// Joints of plate 2, and their derivatives by `q_4`.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlateTwo {
    /// `A_21`, `A_22` at `q_2 = 0`, metres.
    pub(super) joints_m: [Vector3<f64>; 2],
    /// `dA/dq_4`, metres per radian.
    pub(super) turns: [Vector3<f64>; 2],
}

/// Joints of plate 3, and their derivatives by `q_5` and `q_6`.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlateThree {
    /// `A_31`, `A_32`, `A_33` at `q_3 = 0`, metres.
    pub(super) joints_m: [Vector3<f64>; 3],
    /// `dA/dq_5`, metres per radian.
    pub(super) turns: [Vector3<f64>; 3],
    /// `dA/dq_6`, metres per radian.
    pub(super) tilts: [Vector3<f64>; 3],
}

/// Plates at given positions: every joint, and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlatesAt {
    /// `A_ij`: world axes, metres, link order.
    pub(super) joints_m: [Vector3<f64>; LINKS],
    guideways: [Vector3<f64>; ARMS],
    two_turns: [Vector3<f64>; 2],
    three_turns: [Vector3<f64>; 3],
    three_tilts: [Vector3<f64>; 3],
}

impl Plates {
    pub(super) fn new(geometry: &Geometry) -> Self {
        Self {
            carts_m: geometry.carts_m,
            guideways: geometry.guideways,
            joints_m: geometry.plate_joints_m,
            turn: Axis::new(geometry.turn_axis),
            tilt: Axis::new(geometry.tilt_axis),
            signs: geometry.turn_signs.map(|sign| sign.sign()),
        }
    }

    /// `V_i`, metres per q-unit.
    pub(super) const fn guideways(&self) -> &[Vector3<f64>; ARMS] {
        &self.guideways
    }

    /// `A_11` at `q_1 = 0`, metres.
    pub(super) fn one(&self) -> Vector3<f64> {
        let [c1, _, _] = self.carts_m;
        let [p11, ..] = self.joints_m;
        c1 + p11
    }

    /// Plate 2, turned by `q_4`.
    pub(super) fn two(&self, q4: f64) -> PlateTwo {
        let [_, c2, _] = self.carts_m;
        let [_, p21, p22, ..] = self.joints_m;
        let [sigma4, _] = self.signs;
        let q_2 = self.turn.rotation(sigma4 * q4);
        let levers = [p21, p22].map(|joint| times(&q_2, &joint));
        let axis = self.turn.direction * sigma4;
        PlateTwo { joints_m: levers.map(|lever| c2 + lever), turns: levers.map(|lever| axis.cross(&lever)) }
    }

    /// Plate 3, turned by `q_5` and tilted by `q_6`.
    pub(super) fn three(&self, q5: f64, q6: f64) -> PlateThree {
        let [_, _, c3] = self.carts_m;
        let [_, _, _, p31, p32, p33] = self.joints_m;
        let [_, sigma5] = self.signs;
        let turned = self.turn.rotation(sigma5 * q5);
        let q_3 = product(&turned, &self.tilt.rotation(q6));
        let levers = [p31, p32, p33].map(|joint| times(&q_3, &joint));
        let turn_axis = self.turn.direction * sigma5;
        let tilt_axis = times(&turned, &self.tilt.direction);
        PlateThree {
            joints_m: levers.map(|lever| c3 + lever),
            turns: levers.map(|lever| turn_axis.cross(&lever)),
            tilts: levers.map(|lever| tilt_axis.cross(&lever)),
        }
    }

    /// Turn and tilt of the synchronised machine, whose platform turns with plate 3: `Rot(a, sigma_5 q_5) Rot(a_6, q_6)`.
    pub(super) fn orientation(&self, q5: f64, q6: f64) -> Matrix3<f64> {
        let [_, sigma5] = self.signs;
        product(&self.turn.rotation(sigma5 * q5), &self.tilt.rotation(q6))
    }

    /// `a_6`.
    pub(super) const fn tilt_axis(&self) -> &Vector3<f64> {
        &self.tilt.direction
    }

    /// All plates, at these positions.
    #[inline]
    pub(super) fn at(&self, q: &[f64; AXES]) -> PlatesAt {
        let [q1, q2, q3, q4, q5, q6] = *q;
        let [v1, v2, v3] = self.guideways;
        let (two, three) = (self.two(q4), self.three(q5, q6));
        let ([a21, a22], [a31, a32, a33]) = (two.joints_m, three.joints_m);
        let (moved2, moved3) = (v2 * q2, v3 * q3);
        PlatesAt {
            joints_m: [self.one() + v1 * q1, a21 + moved2, a22 + moved2, a31 + moved3, a32 + moved3, a33 + moved3],
            guideways: self.guideways,
            two_turns: two.turns,
            three_turns: three.turns,
            three_tilts: three.tilts,
        }
    }
}

impl PlatesAt {
    /// `D_(ij),k = s_ij . dA_ij/dq_k`.
    pub(super) fn drives(&self, directions: &[Vector3<f64>; LINKS]) -> [[f64; AXES]; LINKS] {
        let [s11, s21, s22, s31, s32, s33] = directions;
        let [v1, v2, v3] = &self.guideways;
        let [t21, t22] = self.two_turns;
        let ([t31, t32, t33], [k31, k32, k33]) = (self.three_turns, self.three_tilts);
        let two = |s: &Vector3<f64>, turn: Vector3<f64>| [0.0, s.dot(v2), 0.0, s.dot(&turn), 0.0, 0.0];
        let three = |s: &Vector3<f64>, turn: Vector3<f64>, tilt: Vector3<f64>| {
            [0.0, 0.0, s.dot(v3), 0.0, s.dot(&turn), s.dot(&tilt)]
        };
        [
            [s11.dot(v1), 0.0, 0.0, 0.0, 0.0, 0.0],
            two(s21, t21),
            two(s22, t22),
            three(s31, t31, k31),
            three(s32, t32, k32),
            three(s33, t33, k33),
        ]
    }
}

/// Any numbers.
#[cfg(kani)]
impl kani::Arbitrary for Plates {
    fn any() -> Self {
        use crate::model::linalg::{any_six, any_three, any_vector};
        let any_axis = || Axis {
            direction: any_vector(),
            k: Matrix3::from(kani::any::<[[f64; 3]; 3]>()),
            k_squared: Matrix3::from(kani::any::<[[f64; 3]; 3]>()),
        };
        Self {
            carts_m: any_three(),
            guideways: any_three(),
            joints_m: any_six(),
            turn: any_axis(),
            tilt: any_axis(),
            signs: kani::any(),
        }
    }
}
