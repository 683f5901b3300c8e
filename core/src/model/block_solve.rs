//! Block solve of the equations of six links, `s . x + m . y = e`: two systems of three (Schur
//! complement).
//!
//! One link of each arm (11, 21, 31) has a direction far from those of the other two, and
//! eliminates `x`. With `S_1`, `M_1` its rows and `S_2`, `M_2` those of links 22, 32, 33:
//!
//! `A = S_2 S_1^-1`, `N = M_2 - A M_1`: `N y = e_2 - A e_1`, then `S_1 x = e_1 - M_1 y`.
//!
//! The same inverses, transposed and in the other order, solve for forces.

use nalgebra::Vector3;

use super::kinematics::SINGULARITY_TOLERANCE;
use crate::model::robot::LINKS;

/// The inverse of a matrix given by its rows, as columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Inverse {
    columns: [Vector3<f64>; 3],
    /// True if the determinant is negative; it is never zero.
    pub(crate) det_is_negative: bool,
}

impl Inverse {
    /// Inverts the matrix; `None` unless `|det| > SINGULARITY_TOLERANCE |r_1| |r_2| |r_3|`; not for
    /// NaN.
    #[inline(always)] // Twice in each solve, which would copy what it returns: 80 instructions of `six_jacobian`.
    pub(crate) fn of_rows([r1, r2, r3]: [&Vector3<f64>; 3]) -> Option<Self> {
        let (c1, c2, c3) = (r2.cross(r3), r3.cross(r1), r1.cross(r2));
        let determinant = r1.dot(&c1);
        let volume_squared = r1.dot(r1) * r2.dot(r2) * r3.dot(r3);
        let least_squared = SINGULARITY_TOLERANCE * SINGULARITY_TOLERANCE * volume_squared;
        let scale = 1.0 / determinant;
        (determinant * determinant > least_squared).then(|| Self {
            columns: [c1 * scale, c2 * scale, c3 * scale],
            det_is_negative: determinant < 0.0,
        })
    }

    /// The inverse times `y`.
    #[inline]
    pub(crate) fn times(&self, [y1, y2, y3]: [f64; 3]) -> Vector3<f64> {
        let [c1, c2, c3] = &self.columns;
        c1 * y1 + c2 * y2 + c3 * y3
    }

    /// `row` times the inverse; also the transposed inverse times `row`.
    #[inline]
    fn weights(&self, row: &Vector3<f64>) -> [f64; 3] {
        let [c1, c2, c3] = &self.columns;
        [row.dot(c1), row.dot(c2), row.dot(c3)]
    }
}

/// Factors of the equations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BlockFactors {
    /// `S_1^-1`.
    first: Inverse,
    /// `M_1`: of links 11, 21, 31.
    moments_m: [Vector3<f64>; 3],
    /// `A`: coefficients of links 22, 32, 33 in terms of links 11, 21, 31.
    weights: [[f64; 3]; 3],
    /// `N^-1`.
    second: Inverse,
}

impl BlockFactors {
    /// Factors the equations, rows in link order; `None` near a singularity of either block, and
    /// for NaN.
    #[inline]
    pub(crate) fn new(
        directions: &[Vector3<f64>; LINKS],
        moments_m: &[Vector3<f64>; LINKS],
    ) -> Option<Self> {
        let [s11, s21, s22, s31, s32, s33] = directions;
        let [m11, m21, m22, m31, m32, m33] = moments_m;
        let first = Inverse::of_rows([s11, s21, s31])?;
        let weights = [s22, s32, s33].map(|s| first.weights(s));
        let [a22, a32, a33] = weights;
        let [n22, n32, n33] = [(m22, a22), (m32, a32), (m33, a33)]
            .map(|(m, [a1, a2, a3])| m - (m11 * a1 + m21 * a2 + m31 * a3));
        Some(Self {
            first,
            moments_m: [*m11, *m21, *m31],
            weights,
            second: Inverse::of_rows([&n22, &n32, &n33])?,
        })
    }

    /// Returns `x` and `y` for right sides `e`.
    #[inline]
    pub(crate) fn solve(&self, e: &[f64; LINKS]) -> (Vector3<f64>, Vector3<f64>) {
        let [e11, e21, e22, e31, e32, e33] = *e;
        let [m11, m21, m31] = &self.moments_m;
        let [k22, k32, k33] = (self.weights).map(|[a1, a2, a3]| a1 * e11 + a2 * e21 + a3 * e31);
        let y = self.second.times([e22 - k22, e32 - k32, e33 - k33]);
        let x = self
            .first
            .times([e11 - m11.dot(&y), e21 - m21.dot(&y), e31 - m31.dot(&y)]);
        (x, y)
    }

    /// As [`solve`](Self::solve), where of links 11, 21 and 31 only that of `ARM` (0 to 2) has a
    /// right side, `first`; `rest` are those of links 22, 32 and 33.
    #[inline]
    pub(crate) fn solve_arm<const ARM: usize>(
        &self,
        first: f64,
        rest: [f64; 3],
    ) -> (Vector3<f64>, Vector3<f64>) {
        let [e22, e32, e33] = rest;
        let [m11, m21, m31] = &self.moments_m;
        let [k22, k32, k33] = self
            .weights
            .map(|row| row.get(ARM).map_or(0.0, |a| a * first));
        let y = self.second.times([e22 - k22, e32 - k32, e33 - k33]);
        let mut eliminated = [-m11.dot(&y), -m21.dot(&y), -m31.dot(&y)];
        if let Some(own) = eliminated.get_mut(ARM) {
            *own += first;
        }
        (self.first.times(eliminated), y)
    }

    /// `f` of `sum f s = force`, `sum f m = moment`, link order: the cluster sums `S_1^-T force`
    /// first, then what of them links 22, 32, 33 take, `N^T f_2 = moment - M_1^T S_1^-T force`.
    #[inline]
    pub(crate) fn solve_transposed(
        &self,
        force: &Vector3<f64>,
        moment: &Vector3<f64>,
    ) -> [f64; LINKS] {
        let [m11, m21, m31] = &self.moments_m;
        let [p1, p2, p3] = self.first.weights(force);
        let [f22, f32, f33] = (self.second).weights(&(moment - (m11 * p1 + m21 * p2 + m31 * p3)));
        let [a, b, c] = &self.weights;
        let [a1, a2, a3] = a.map(|a| a * f22);
        let [b1, b2, b3] = b.map(|b| b * f32);
        let [c1, c2, c3] = c.map(|c| c * f33);
        let [k1, k2, k3] = [a1 + b1 + c1, a2 + b2 + c2, a3 + b3 + c3];
        [p1 - k1, p2 - k2, f22, p3 - k3, f32, f33]
    }

    /// True if the determinant of all six rows, in link order, is negative.
    #[inline]
    pub(crate) const fn det_is_negative(&self) -> bool {
        // Link 31 stands before link 22 here, which turns the sign once.
        !(self.first.det_is_negative ^ self.second.det_is_negative)
    }
}
