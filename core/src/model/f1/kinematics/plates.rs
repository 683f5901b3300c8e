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

/// Joints of a cluster's plate with its cart at 0, and their derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plate<const K: usize> {
    /// `A_ij`, metres.
    pub(super) joints_m: [Vector3<f64>; K],
    /// `dA_ij/dq` of each joint by the `K` axes of its cluster, the cart's first; metres per q-unit.
    pub(super) rates: [[Vector3<f64>; K]; K],
}

/// Plates at given positions: every joint, and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlatesAt {
    /// `A_ij`: world axes, metres, link order.
    pub(super) joints_m: [Vector3<f64>; LINKS],
    one: Vector3<f64>,
    two: [[Vector3<f64>; 2]; 2],
    three: [[Vector3<f64>; 3]; 3],
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
    pub(super) fn two(&self, q4: f64) -> Plate<2> {
        let ([_, c2, _], [_, v2, _]) = (self.carts_m, self.guideways);
        let [_, p21, p22, ..] = self.joints_m;
        let [sigma4, _] = self.signs;
        let q_2 = self.turn.rotation(sigma4 * q4);
        let levers = [p21, p22].map(|joint| times(&q_2, &joint));
        let axis = self.turn.direction * sigma4;
        Plate { joints_m: levers.map(|lever| c2 + lever), rates: levers.map(|lever| [v2, axis.cross(&lever)]) }
    }

    /// Plate 3, turned by `q_5` and tilted by `q_6`.
    pub(super) fn three(&self, q5: f64, q6: f64) -> Plate<3> {
        let ([_, _, c3], [_, _, v3]) = (self.carts_m, self.guideways);
        let [_, _, _, p31, p32, p33] = self.joints_m;
        let [_, sigma5] = self.signs;
        let turned = self.turn.rotation(sigma5 * q5);
        let q_3 = product(&turned, &self.tilt.rotation(q6));
        let levers = [p31, p32, p33].map(|joint| times(&q_3, &joint));
        let turn_axis = self.turn.direction * sigma5;
        let tilt_axis = times(&turned, &self.tilt.direction);
        Plate {
            joints_m: levers.map(|lever| c3 + lever),
            rates: levers.map(|lever| [v3, turn_axis.cross(&lever), tilt_axis.cross(&lever)]),
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
            one: v1,
            two: two.rates,
            three: three.rates,
        }
    }
}

impl PlatesAt {
    /// `D_(ij),k = s_ij . dA_ij/dq_k`.
    pub(super) fn drives(&self, directions: &[Vector3<f64>; LINKS]) -> [[f64; AXES]; LINKS] {
        let [s11, s21, s22, s31, s32, s33] = directions;
        let ([r21, r22], [r31, r32, r33]) = (&self.two, &self.three);
        let two = |s: &Vector3<f64>, [cart, turn]: &[Vector3<f64>; 2]| [0.0, s.dot(cart), 0.0, s.dot(turn), 0.0, 0.0];
        let three = |s: &Vector3<f64>, [cart, turn, tilt]: &[Vector3<f64>; 3]| {
            [0.0, 0.0, s.dot(cart), 0.0, s.dot(turn), s.dot(tilt)]
        };
        [
            [s11.dot(&self.one), 0.0, 0.0, 0.0, 0.0, 0.0],
            two(s21, r21),
            two(s22, r22),
            three(s31, r31),
            three(s32, r32),
            three(s33, r33),
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
