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
    /// `C_1 + P_11`: `A_11` at `q_1 = 0`, metres.
    one_m: Vector3<f64>,
    turn: Axis,
    tilt: Axis,
    /// Joints of plate 2, which the turn axis turns.
    two: [Turned; 2],
    /// Joints of plate 3, which the tilt axis turns.
    three: [Turned; 3],
    /// `sigma_4`, `sigma_5`.
    signs: [f64; 2],
}

/// A fixed axis: `Rot(a, angle) = I + sin K + (1 - cos) K^2` with `K = a x` (Rodrigues' formula).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis {
    direction: Vector3<f64>,
    /// `K^2`: `xx, yy, zz`.
    diagonal: Vector3<f64>,
    /// `K^2`: `yz, zx, xy`.
    beside: Vector3<f64>,
}

impl Axis {
    fn new(direction: Vector3<f64>) -> Self {
        let k = cross_matrix(&direction);
        let squared = product(&k, &k);
        Self {
            direction,
            diagonal: squared.diagonal(),
            beside: Vector3::new(squared.m23, squared.m31, squared.m12),
        }
    }

    #[inline]
    fn rotation(&self, angle_rad: f64) -> Matrix3<f64> {
        let (along, across) = sine_and_versine(angle_rad);
        let (k, d, b) = (
            self.direction * along,
            self.diagonal * across,
            self.beside * across,
        );
        Matrix3::new(
            1.0 + d.x,
            b.z - k.z,
            b.y + k.y,
            b.z + k.z,
            1.0 + d.y,
            b.x - k.x,
            b.y - k.y,
            b.x + k.x,
            1.0 + d.z,
        )
    }
}

/// A vector that turns about a fixed axis:
/// `Rot(a, angle) p = p + sin a x p + (1 - cos) a x (a x p)`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Turned {
    vector: Vector3<f64>,
    crossed: Vector3<f64>,
    crossed_twice: Vector3<f64>,
}

impl Turned {
    fn new(axis: &Vector3<f64>, vector: Vector3<f64>) -> Self {
        let crossed = axis.cross(&vector);
        Self {
            vector,
            crossed,
            crossed_twice: axis.cross(&crossed),
        }
    }

    #[inline]
    fn by(&self, (along, across): (f64, f64)) -> Vector3<f64> {
        self.vector + self.crossed * along + self.crossed_twice * across
    }
}

/// `sin` and `1 - cos` of an angle; the latter over the half angle, where it does not cancel.
#[inline]
fn sine_and_versine(angle_rad: f64) -> (f64, f64) {
    let (sine, cosine) = sin_cos(0.5 * angle_rad);
    let twice = 2.0 * sine;
    (twice * cosine, twice * sine)
}

/// Plate 2, turned.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlateTwo {
    /// From the cart to its joints, metres.
    pub(super) levers_m: [Vector3<f64>; 2],
    /// `sigma_4 a`.
    turn_axis: Vector3<f64>,
}

impl PlateTwo {
    /// `s . dA/dq_2` and `s . dA/dq_4` of one link, for a vector `s` along it.
    #[inline]
    fn drive(&self, s: &Vector3<f64>, lever_m: &Vector3<f64>, guideway: &Vector3<f64>) -> [f64; 2] {
        [s.dot(guideway), self.turn_axis.dot(&lever_m.cross(s))]
    }

    /// `s . dA/dq_2` and `s . dA/dq_4` of links 21 and 22, for vectors `s` along them and a
    /// guideway `V_2`.
    #[inline]
    pub(super) fn drives(
        &self,
        [s1, s2]: &[Vector3<f64>; 2],
        guideway: &Vector3<f64>,
    ) -> [[f64; 2]; 2] {
        let [lever1, lever2] = &self.levers_m;
        [
            self.drive(s1, lever1, guideway),
            self.drive(s2, lever2, guideway),
        ]
    }
}

/// Plate 3, turned and tilted.
#[derive(Clone, Copy, Debug)]
pub(super) struct PlateThree {
    /// From the cart to its joints, metres.
    pub(super) levers_m: [Vector3<f64>; 3],
    /// `sigma_5 a`.
    turn_axis: Vector3<f64>,
    /// `a_6`, turned by `q_5`.
    tilt_axis: Vector3<f64>,
}

impl PlateThree {
    /// `s . dA/dq_3`, `s . dA/dq_5` and `s . dA/dq_6` of one link, for a vector `s` along it.
    #[inline]
    fn drive(&self, s: &Vector3<f64>, lever_m: &Vector3<f64>, guideway: &Vector3<f64>) -> [f64; 3] {
        let moment = lever_m.cross(s);
        [
            s.dot(guideway),
            self.turn_axis.dot(&moment),
            self.tilt_axis.dot(&moment),
        ]
    }

    /// `s . dA/dq_3`, `s . dA/dq_5` and `s . dA/dq_6` of links 31, 32 and 33, for vectors `s` along
    /// them and a guideway `V_3`.
    #[inline]
    pub(super) fn drives(
        &self,
        [s1, s2, s3]: &[Vector3<f64>; 3],
        guideway: &Vector3<f64>,
    ) -> [[f64; 3]; 3] {
        let [lever1, lever2, lever3] = &self.levers_m;
        [
            self.drive(s1, lever1, guideway),
            self.drive(s2, lever2, guideway),
            self.drive(s3, lever3, guideway),
        ]
    }
}

/// `D_(ij),k = s_ij . dA_ij/dq_k`, arm by arm: an axis drives the links of its own arm only.
pub(super) struct Drives {
    /// Of link 11 by `q_1`.
    pub(super) one: f64,
    /// Of links 21 and 22 by `q_2`, `q_4`.
    pub(super) two: [[f64; 2]; 2],
    /// Of links 31, 32 and 33 by `q_3`, `q_5`, `q_6`.
    pub(super) three: [[f64; 3]; 3],
}

impl Drives {
    /// Rows in link order, columns in axis order.
    pub(super) const fn rows(&self) -> [[f64; AXES]; LINKS] {
        let [[d21, t21], [d22, t22]] = self.two;
        let [[d31, t31, k31], [d32, t32, k32], [d33, t33, k33]] = self.three;
        [
            [self.one, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, d21, 0.0, t21, 0.0, 0.0],
            [0.0, d22, 0.0, t22, 0.0, 0.0],
            [0.0, 0.0, d31, 0.0, t31, k31],
            [0.0, 0.0, d32, 0.0, t32, k32],
            [0.0, 0.0, d33, 0.0, t33, k33],
        ]
    }
}

/// All plates at given positions.
#[derive(Clone, Copy, Debug)]
pub(in crate::model::f1) struct PlatesAt<'a> {
    /// `A_ij`: world axes, metres, link order.
    pub(super) joints_m: [Vector3<f64>; LINKS],
    guideways: &'a [Vector3<f64>; ARMS],
    pub(super) two: PlateTwo,
    pub(super) three: PlateThree,
}

impl Plates {
    pub(super) fn new(geometry: &Geometry) -> Self {
        let [p11, p21, p22, p31, p32, p33] = geometry.plate_joints_m;
        let [c1, ..] = geometry.carts_m;
        let turn = geometry.turn_axis;
        let tilt = geometry.tilt_axis;
        Self {
            carts_m: geometry.carts_m,
            guideways: geometry.guideways,
            one_m: c1 + p11,
            turn: Axis::new(turn),
            tilt: Axis::new(tilt),
            two: [p21, p22].map(|joint| Turned::new(&turn, joint)),
            three: [p31, p32, p33].map(|joint| Turned::new(&tilt, joint)),
            signs: geometry.turn_signs.map(|sign| sign.sign()),
        }
    }

    /// `V_i`, metres per q-unit.
    pub(super) const fn guideways(&self) -> &[Vector3<f64>; ARMS] {
        &self.guideways
    }

    /// `A_11` at `q_1 = 0`, metres.
    pub(super) const fn one(&self) -> &Vector3<f64> {
        &self.one_m
    }

    /// `C_2 + q_2 V_2`: cart 2, metres.
    #[inline]
    pub(super) fn cart_two(&self, q2: f64) -> Vector3<f64> {
        let [_, c2, _] = self.carts_m;
        let [_, v2, _] = self.guideways;
        c2 + v2 * q2
    }

    /// `C_3 + q_3 V_3`: cart 3, metres.
    #[inline]
    pub(super) fn cart_three(&self, q3: f64) -> Vector3<f64> {
        let [_, _, c3] = self.carts_m;
        let [_, _, v3] = self.guideways;
        c3 + v3 * q3
    }

    /// Plate 2, turned by `q_4`.
    #[inline]
    pub(super) fn two(&self, q4: f64) -> PlateTwo {
        let [sigma4, _] = self.signs;
        let turn = sine_and_versine(sigma4 * q4);
        let levers_m = self.two.map(|joint| joint.by(turn));
        PlateTwo {
            levers_m,
            turn_axis: self.turn.direction * sigma4,
        }
    }

    /// Plate 3, turned by `q_5` and tilted by `q_6`.
    #[inline]
    pub(super) fn three(&self, q5: f64, q6: f64) -> PlateThree {
        let [_, sigma5] = self.signs;
        let turned = self.turn.rotation(sigma5 * q5);
        let tilt = sine_and_versine(q6);
        let levers_m = self.three.map(|joint| times(&turned, &joint.by(tilt)));
        PlateThree {
            levers_m,
            turn_axis: self.turn.direction * sigma5,
            tilt_axis: times(&turned, &self.tilt.direction),
        }
    }

    /// Turn and tilt of the synchronised machine, whose platform turns with plate 3:
    /// `Rot(a, sigma_5 q_5) Rot(a_6, q_6)`.
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
    pub(super) fn at(&self, q: &[f64; AXES]) -> PlatesAt<'_> {
        let [q1, q2, q3, q4, q5, q6] = *q;
        let [v1, ..] = self.guideways;
        let two = self.two(q4);
        let three = self.three(q5, q6);
        let [l21, l22] = two.levers_m;
        let [l31, l32, l33] = three.levers_m;
        let cart2 = self.cart_two(q2);
        let cart3 = self.cart_three(q3);
        PlatesAt {
            joints_m: [
                self.one_m + v1 * q1,
                cart2 + l21,
                cart2 + l22,
                cart3 + l31,
                cart3 + l32,
                cart3 + l33,
            ],
            guideways: &self.guideways,
            two,
            three,
        }
    }
}

impl PlatesAt<'_> {
    /// Drives of links along these vectors.
    #[inline]
    pub(super) fn drives(&self, [s11, s21, s22, s31, s32, s33]: &[Vector3<f64>; LINKS]) -> Drives {
        let [v1, v2, v3] = self.guideways;
        Drives {
            one: s11.dot(v1),
            two: self.two.drives(&[*s21, *s22], v2),
            three: self.three.drives(&[*s31, *s32, *s33], v3),
        }
    }
}

/// Any numbers.
#[cfg(kani)]
impl kani::Arbitrary for Plates {
    fn any() -> Self {
        use crate::model::linalg::{any_three, any_vector};
        Self {
            carts_m: any_three(),
            guideways: any_three(),
            one_m: any_vector(),
            turn: kani::any(),
            tilt: kani::any(),
            two: [kani::any(), kani::any()],
            three: [kani::any(), kani::any(), kani::any()],
            signs: kani::any(),
        }
    }
}

#[cfg(kani)]
impl kani::Arbitrary for Axis {
    fn any() -> Self {
        use crate::model::linalg::any_vector;
        Self {
            direction: any_vector(),
            diagonal: any_vector(),
            beside: any_vector(),
        }
    }
}

#[cfg(kani)]
impl kani::Arbitrary for Turned {
    fn any() -> Self {
        use crate::model::linalg::any_vector;
        Self {
            vector: any_vector(),
            crossed: any_vector(),
            crossed_twice: any_vector(),
        }
    }
}
