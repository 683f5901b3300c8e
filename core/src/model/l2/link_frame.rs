//! Jacobian of the L2, from cart speeds to tool speed, and its transpose `[T 3.3.3]`.

use nalgebra::{Matrix3, Vector3};

use super::{AXES, Kinematics};
use crate::model::kinematics::{KinematicsError, SINGULARITY_TOLERANCE};
use crate::model::linalg::times;
use crate::model::robot::ARMS;

/// Largest mismatch of a link's squared length, over that length squared: half a micrometre per
/// metre.
const LENGTH_TOLERANCE: f64 = 1e-6;

/// The three nominal links in a pose, with the cofactors that solve `S x = b` and `S^T x = b`.
///
/// The links keep their length, `w_i = L_i s_i` (from platform to cart, world axes, metres):
/// nothing here needs a root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkFrame {
    pub(crate) links_m: [Vector3<f64>; ARMS],
    /// `w_2 x w_3`, `w_3 x w_1`, `w_1 x w_2`, each over `det(w_1, w_2, w_3)`: the rows of the
    /// inverse, per metre.
    pub(crate) inverse_rows: [Vector3<f64>; ARMS],
    /// `w_i . v_i = L_i D_i`, metres squared per q-unit.
    pub(crate) drives: [f64; ARMS],
}

impl LinkFrame {
    /// Returns the tool speed per cart speed, `dT/dq` (world axes, metres per q-unit):
    /// `S^T dT = diag(s_i . v_i) dq`.
    #[must_use]
    pub fn jacobian(&self) -> Matrix3<f64> {
        let [r1, r2, r3] = &self.inverse_rows;
        let [d1, d2, d3] = self.drives;
        Matrix3::from_columns(&[r1 * d1, r2 * d2, r3 * d3])
    }
}

impl Kinematics {
    /// Returns the links of a pose `tcp_m` (world axes, metres) and its positions `q` (q-units).
    ///
    /// # Errors
    /// [`KinematicsError::Inconsistent`] when the two do not belong together; `Singular`,
    /// `OtherBranch`, `NotFinite`.
    #[inline]
    pub fn link_frame(
        &self,
        tcp_m: &Vector3<f64>,
        q: &[f64; AXES],
    ) -> Result<LinkFrame, KinematicsError> {
        let [a1, a2, a3] = &self.arms;
        let [q1, q2, q3] = *q;
        let (w1, w2, w3) = (
            a1.cart(q1) - tcp_m,
            a2.cart(q2) - tcp_m,
            a3.cart(q3) - tcp_m,
        );
        let (c1, c2, c3) = (w2.cross(&w3), w3.cross(&w1), w1.cross(&w2));
        let determinant = w1.dot(&c1);
        // Every comparison fails for NaN.
        if !(fits(&w1, a1.length_squared)
            && fits(&w2, a2.length_squared)
            && fits(&w3, a3.length_squared)
            && self.side * determinant > self.determinant_min)
        {
            return Err(self.diagnose_frame(&[w1, w2, w3]));
        }
        let scale = 1.0 / determinant;
        Ok(LinkFrame {
            links_m: [w1, w2, w3],
            inverse_rows: [c1 * scale, c2 * scale, c3 * scale],
            drives: [
                w1.dot(&a1.guideway),
                w2.dot(&a2.guideway),
                w3.dot(&a3.guideway),
            ],
        })
    }

    /// Returns the Jacobian `dT/dq` at `tcp_m` (world axes, metres per q-unit), positions by
    /// [`inverse`](Self::inverse).
    ///
    /// # Errors
    /// As [`inverse`](Self::inverse).
    ///
    /// # Examples
    /// ```
    /// use gantry_tau_core::model::nalgebra::{Matrix3, Vector3};
    /// use gantry_tau_core::model::{l2, presets};
    ///
    /// let robot = l2::Robot::new(presets::l2())?;
    /// let kinematics = l2::Kinematics::new(&robot, &Matrix3::identity())?;
    /// let jacobian = kinematics.jacobian(&Vector3::new(0.0, 0.5, 0.65))?;
    /// // Parallel guideways: carts that move together carry the tool with them.
    /// let together = jacobian * Vector3::new(1.0, 1.0, 1.0);
    /// assert!((together - Vector3::x()).amax() < 1e-12);
    /// # Ok::<(), Box<dyn core::error::Error>>(())
    /// ```
    pub fn jacobian(&self, tcp_m: &Vector3<f64>) -> Result<Matrix3<f64>, KinematicsError> {
        let q = self.inverse(tcp_m)?;
        Ok(self.link_frame(tcp_m, &q)?.jacobian())
    }

    #[cold]
    #[inline(never)]
    fn diagnose_frame(&self, links_m: &[Vector3<f64>; ARMS]) -> KinematicsError {
        let [w1, w2, w3] = links_m;
        if !links_m
            .iter()
            .all(|link| link.iter().all(|value| value.is_finite()))
        {
            return KinematicsError::NotFinite;
        }
        for (arm, (model, link)) in self.arms.iter().zip(links_m).enumerate() {
            if !fits(link, model.length_squared) {
                return KinematicsError::Inconsistent { arm };
            }
        }
        let determinant = w1.dot(&w2.cross(w3));
        if self.side * determinant < -self.determinant_min {
            return KinematicsError::OtherBranch { arm: None };
        }
        KinematicsError::Singular {
            measure: determinant.abs() * SINGULARITY_TOLERANCE / self.determinant_min,
        }
    }
}

/// True if a link has its length; false for NaN.
#[inline]
fn fits(link: &Vector3<f64>, length_squared: f64) -> bool {
    (link.dot(link) - length_squared).abs() <= LENGTH_TOLERANCE * length_squared
}

/// Returns the load on each cart, `tau = J^T F` `[T 3.28]`, which does not depend on the moment:
/// positive along `+q`, in newtons times metres per q-unit.
#[inline]
#[must_use]
pub fn cart_loads_from_jacobian(jacobian: &Matrix3<f64>, force_n: &Vector3<f64>) -> [f64; AXES] {
    let loads = times(&jacobian.transpose(), force_n);
    [loads.x, loads.y, loads.z]
}
