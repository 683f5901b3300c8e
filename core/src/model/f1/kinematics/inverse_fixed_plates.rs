//! Inverse kinematics with fixed plates, from a tool position to the carts: three axes without the
//! Tau property.

use nalgebra::{Matrix3, Vector3};

use super::Kinematics;
use super::forward::orthonormal;
use super::inverse::cart;
use super::step::System;
use crate::model::block_solve::Inverse;
use crate::model::f1::AXES;
use crate::model::kinematics::{KinematicsError, Pose, Solution, is_pose};
use crate::model::linalg::{product, rotation_from_vector};
use crate::model::lu::Lu;
use crate::model::robot::{ARMS, LINKS};

/// One step: of the carts (q-units) and of the platform's turn (world axes, radians).
struct Step {
    carts: [f64; ARMS],
    rotation_rad: Vector3<f64>,
    /// True if the determinant is negative: its sign changes where assembly modes meet.
    det_is_negative: bool,
}

impl Kinematics {
    /// Inverse kinematics of three axes: returns the positions that put the tool at `position_m`
    /// (world axes, metres), with plates fixed at `plates` (`q_4`, `q_5`, `q_6`; zeros for a
    /// [`Geometry`](crate::model::f1::Geometry) made from an L2's). Also returns the resulting
    /// pose; the links determine its orientation. The Tau property is not needed; a machine that
    /// has it does not turn.
    ///
    /// The platform starts in the orientation `near`, carts where their first link just fits. At
    /// most `iterations` linear solves
    /// ([`WARM_ITERATIONS`](crate::model::kinematics::WARM_ITERATIONS) from the cycle before,
    /// [`COLD_ITERATIONS`](crate::model::kinematics::COLD_ITERATIONS)).
    ///
    /// # Errors
    /// `Unreachable`, `Singular`, `NotConverged`, `OutOfRange`, `NotFinite` (also for a `near` that
    /// is not a rotation); `OtherBranch` where an arm or the platform (`arm: None`) would pass a
    /// singularity on the way.
    pub fn inverse_fixed_plates(
        &self,
        position_m: &Vector3<f64>,
        plates: &[f64; 3],
        near: &Matrix3<f64>,
        iterations: u8,
    ) -> Result<Solution<([f64; AXES], Pose)>, KinematicsError> {
        let mut pose = Pose {
            position_m: *position_m,
            rotation: *near,
        };
        if !is_pose(&pose) || !plates.iter().all(|value| value.is_finite()) {
            return Err(KinematicsError::NotFinite);
        }
        let [q4, q5, q6] = *plates;
        let mut carts = self.first_carts(&pose, plates)?;
        let mut mode = None;
        for made in 0..=iterations {
            let [q1, q2, q3] = carts;
            let q = [q1, q2, q3, q4, q5, q6];
            let joints = self.plates.at(&q).joints_m;
            let system = self.system(&pose, &joints);
            if made == iterations || system.is_settled(&self.settled()) {
                pose.rotation = orthonormal(&pose.rotation);
                let (links_m, _) = self.links_and_levers(&pose, &joints);
                let residual_m =
                    self.check(&links_m, &q, &self.robot.geometry().lengths_m, made)?;
                return Ok(Solution {
                    value: (q, pose),
                    iterations: made,
                    residual_m,
                });
            }
            self.on_their_sides(&system.links_m)?;
            let step = self.step_of_carts(&system)?;
            if *mode.get_or_insert(step.det_is_negative) != step.det_is_negative {
                return Err(KinematicsError::OtherBranch { arm: None });
            }
            for (cart, change) in carts.iter_mut().zip(step.carts) {
                *cart += change;
            }
            let turn =
                rotation_from_vector(&step.rotation_rad).ok_or(KinematicsError::NotFinite)?;
            pose.rotation = product(&turn, &pose.rotation);
        }
        // Not reached: the last round returns.
        Err(KinematicsError::NotFinite)
    }

    /// Carts where links 11, 21 and 31 just fit.
    fn first_carts(
        &self,
        pose: &Pose,
        &[q4, q5, q6]: &[f64; 3],
    ) -> Result<[f64; ARMS], KinematicsError> {
        let geometry = self.robot.geometry();
        let joints = self.plates.at(&[0.0, 0.0, 0.0, q4, q5, q6]).joints_m;
        let [a11, a21, _, a31, ..] = joints;
        let [b11, b21, _, b31, ..] = self.ends_m(pose);
        let [l11, l21, _, l31, ..] = geometry.lengths_m;
        let [v1, v2, v3] = &geometry.guideways;
        let [c1, c2, c3] = geometry.configuration;
        Ok([
            cart(0, &(b11 - a11), v1, l11, c1)?,
            cart(1, &(b21 - a21), v2, l21, c2)?,
            cart(2, &(b31 - a31), v3, l31, c3)?,
        ])
    }

    /// `e + (w . V) dq - m . dtheta = 0` for every link, with its surplus `e`: the carts are
    /// eliminated by links 11, 21, 31, and with `a = w . V / w_1 . V` three equations
    /// `(m - a m_1) . dtheta = e - a e_1` are left.
    fn step_of_carts(&self, system: &System) -> Result<Step, KinematicsError> {
        let [v1, v2, v3] = self.plates.guideways();
        let [s11, s21, s22, s31, s32, s33] = &system.links_m;
        let [m11, m21, m22, m31, m32, m33] = &system.moments();
        let [e11, e21, e22, e31, e32, e33] = system.surpluses;
        let (d1, d2, d3) = (s11.dot(v1), s21.dot(v2), s31.dot(v3));
        let (a22, a32, a33) = (s22.dot(v2) / d2, s32.dot(v3) / d3, s33.dot(v3) / d3);
        let rows = [m22 - m21 * a22, m32 - m31 * a32, m33 - m31 * a33];
        let right = [e22 - a22 * e21, e32 - a32 * e31, e33 - a33 * e31];
        let (rotation_rad, det_is_negative) = match Inverse::of_rows(rows.each_ref()) {
            Some(inverse) => (inverse.times(right), inverse.det_is_negative),
            None => {
                let factors = Lu::factor(&rows.map(Into::into))?;
                (factors.solve(&right).into(), factors.det_is_negative())
            }
        };
        Ok(Step {
            carts: [
                (m11.dot(&rotation_rad) - e11) / d1,
                (m21.dot(&rotation_rad) - e21) / d2,
                (m31.dot(&rotation_rad) - e31) / d3,
            ],
            rotation_rad,
            det_is_negative,
        })
    }
}

const _: () = assert!(LINKS == ARMS + 3, "three carts and three rotations");
