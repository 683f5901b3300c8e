//! The L2 with links and carts as springs: two 3x3 solves instead of one 6x6, for the cyclic path.
//!
//! In the nominal model the links of a cluster are parallel (the Tau property), so `W f + w = 0`
//! falls apart. With the links kept at their length, `w_i = L_i s_i`, and tensions per metre of
//! link, `phi_ij = f_ij / L_i`:
//!
//! - forces: `sum_i Phi_i w_i = -F` for the sums `Phi_i` of each cluster, a 3x3 solve;
//! - moments: one link of each cluster expressed by its sum, what remains are differences of
//!   levers,
//!   `phi_21 (l_21 - l_22) x w_2 + phi_32 (l_32 - l_31) x w_3 + phi_33 (l_33 - l_31) x w_3 = -M - sum_i Phi_i l_i x w_i`,
//!   another 3x3 solve.
//!
//! The displacement solves the same two matrices transposed, in the other order. No root is taken.

use nalgebra::Vector3;

use super::{AXES, Kinematics, LinkFrame};
use crate::model::kinematics::{KinematicsError, SINGULARITY_TOLERANCE};
use crate::model::linalg::{norm, sqrt};
use crate::model::robot::{ARMS, Compliances, LINKS};
use crate::model::statics::Wrench;

/// Deflection under a load, as the compensation needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deflection {
    /// `r = c tau`: displacement of each cart, q-units, arm order.
    pub carts: [f64; AXES],
    /// `dT_links`: translation of the tool centre point by the links alone, world axes, m.
    pub translation_m: Vector3<f64>,
    /// `dtheta_links`: rotation of the platform by the links alone, world axes, rad. A 3-DOF
    /// machine cannot correct it.
    pub rotation_rad: Vector3<f64>,
}

/// An L2 with its springs, and everything that does not change from pose to pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elastic {
    kinematics: Kinematics,
    compliances: Compliances<AXES>,
    /// Kinematics without travel, for corrections.
    corrections: Kinematics,
    /// `l_11`, `l_22`, `l_31`: levers of the links that are expressed by their cluster's sum, m.
    levers_m: [Vector3<f64>; ARMS],
    /// `l_21 - l_22`, `l_32 - l_31`, `l_33 - l_31`, m.
    spreads_m: [Vector3<f64>; ARMS],
    /// `c_ij L_i^2`: elongation times `L_i` per `phi_ij`, link order.
    links: [f64; LINKS],
    /// Smallest determinant of the moments' matrix that is not singular, m^6.
    moments_min: f64,
}

impl Elastic {
    /// Prepares the model of a machine and its springs.
    #[must_use]
    pub fn new(kinematics: &Kinematics, compliances: &Compliances<AXES>) -> Self {
        let [l11, l21, l22, l31, l32, l33] = *kinematics.levers_m();
        let [c11, c21, c22, c31, c32, c33] = *compliances.link_m_per_n();
        let [a1, a2, a3] = kinematics.lengths_squared();
        let spreads_m = [l21 - l22, l32 - l31, l33 - l31];
        let [d1, d2, d3] = spreads_m.map(|spread| norm(&spread));
        // Each column is a spread times a link; links of arms 2, 3 and 3.
        let scale = d1 * d2 * d3 * a3 * sqrt(a2);
        Self {
            kinematics: *kinematics,
            compliances: *compliances,
            corrections: kinematics.without_travel(),
            levers_m: [l11, l22, l31],
            spreads_m,
            links: [c11 * a1, c21 * a2, c22 * a2, c31 * a3, c32 * a3, c33 * a3],
            moments_min: SINGULARITY_TOLERANCE * scale,
        }
    }

    /// The rigid machine.
    #[inline]
    #[must_use]
    pub const fn kinematics(&self) -> &Kinematics {
        &self.kinematics
    }

    /// The springs.
    #[must_use]
    pub const fn compliances(&self) -> &Compliances<AXES> {
        &self.compliances
    }

    /// Returns the command to first order: positions that hold `tcp_m` under `load`,
    /// `q_cmd = IK(T - gain dT_links) - gain r` (q-units).
    ///
    /// `q` are the positions that hold it without load. The command is neither limited nor
    /// filtered. Travel is not checked: a correction may reach from the nominal travel into the
    /// machine's.
    ///
    /// # Errors
    /// As [`deflection`](Self::deflection) at `tcp_m`, and as [`Kinematics::inverse`] for the
    /// corrected pose.
    #[inline]
    pub fn command(
        &self,
        tcp_m: &Vector3<f64>,
        q: &[f64; AXES],
        load: &Wrench,
        gain: f64,
    ) -> Result<[f64; AXES], KinematicsError> {
        let deflection = self.deflection(tcp_m, q, load)?;
        self.corrected(tcp_m, &deflection, gain)
    }

    /// `IK(T - gain dT_links) - gain r`.
    #[inline]
    pub(super) fn corrected(
        &self,
        tcp_m: &Vector3<f64>,
        deflection: &Deflection,
        gain: f64,
    ) -> Result<[f64; AXES], KinematicsError> {
        let corrected_m = tcp_m - deflection.translation_m * gain;
        let [q1, q2, q3] = self.corrections.inverse(&corrected_m)?;
        let [r1, r2, r3] = deflection.carts;
        Ok([q1 - gain * r1, q2 - gain * r2, q3 - gain * r3])
    }

    /// Returns the deflection by `load` at `tcp_m` (world axes, metres) with the carts at `q`
    /// (q-units).
    ///
    /// # Errors
    /// As [`Kinematics::link_frame`]; also [`KinematicsError::Singular`] when the platform could
    /// turn without a link changing its length, and `NotFinite`.
    #[inline]
    pub fn deflection(
        &self,
        tcp_m: &Vector3<f64>,
        q: &[f64; AXES],
        load: &Wrench,
    ) -> Result<Deflection, KinematicsError> {
        let frame = self.kinematics.link_frame(tcp_m, q)?;
        self.deflection_in(&frame, load)
    }

    /// Returns the deflection by `load` of `frame`, which comes from
    /// [`kinematics`](Self::kinematics).
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] when the platform could turn without a link changing its
    /// length, `NotFinite`.
    #[inline]
    pub fn deflection_in(
        &self,
        frame: &LinkFrame,
        load: &Wrench,
    ) -> Result<Deflection, KinematicsError> {
        let [w1, w2, w3] = &frame.links_m;
        let [r1, r2, r3] = &frame.inverse_rows;
        let [l11, l22, l31] = &self.levers_m;
        let [d21, d32, d33] = &self.spreads_m;
        let [k11, k21, k22, k31, k32, k33] = self.links;

        // Forces. The load on the cart is -D^T f, and w . v = L D.
        let force = &load.force_n;
        let (p1, p2, p3) = (-r1.dot(force), -r2.dot(force), -r3.dot(force));

        // Moments.
        let (m11, m22, m31) = (l11.cross(w1), l22.cross(w2), l31.cross(w3));
        let (n1, n2, n3) = (d21.cross(w2), d32.cross(w3), d33.cross(w3));
        let (c1, c2, c3) = (n2.cross(&n3), n3.cross(&n1), n1.cross(&n2));
        let determinant = n1.dot(&c1);
        // Fails for NaN.
        let regular = determinant.abs() > self.moments_min;
        if !regular {
            return Err(self.not_regular(determinant));
        }
        let scale = 1.0 / determinant;
        let rest = load.moment_nm + m11 * p1 + m22 * p2 + m31 * p3;
        let rest = rest * -scale;
        let (f21, f32, f33) = (c1.dot(&rest), c2.dot(&rest), c3.dot(&rest));
        let (f22, f31) = (p2 - f21, p3 - f32 - f33);

        // Elongations times L, then displacement: the transposed matrices, rotation first.
        let (e22, e31) = (k22 * f22, k31 * f31);
        let turn = c1 * (k21 * f21 - e22) + c2 * (k32 * f32 - e31) + c3 * (k33 * f33 - e31);
        let rotation_rad = turn * -scale;
        let y1 = k11 * p1 + m11.dot(&rotation_rad);
        let y2 = e22 + m22.dot(&rotation_rad);
        let y3 = e31 + m31.dot(&rotation_rad);
        let translation_m = -(r1 * y1 + r2 * y2 + r3 * y3);

        let [g1, g2, g3] = frame.drives;
        let [s1, s2, s3] = *self.compliances.cart_m_per_n();
        Ok(Deflection {
            carts: [-s1 * g1 * p1, -s2 * g2 * p2, -s3 * g3 * p3],
            translation_m,
            rotation_rad,
        })
        .and_then(Deflection::checked)
    }

    #[cold]
    #[inline(never)]
    fn not_regular(&self, determinant: f64) -> KinematicsError {
        let measure = determinant.abs() * SINGULARITY_TOLERANCE / self.moments_min;
        if measure.is_finite() {
            KinematicsError::Singular { measure }
        } else if determinant.is_finite() {
            // Two joints of a cluster in one point.
            KinematicsError::Singular { measure: 0.0 }
        } else {
            KinematicsError::NotFinite
        }
    }
}

impl Deflection {
    /// Returns the deflection if it is finite: an infinity or NaN among the numbers makes their sum
    /// infinite or NaN.
    #[inline]
    fn checked(self) -> Result<Self, KinematicsError> {
        let [r1, r2, r3] = self.carts;
        let sum = r1 + r2 + r3 + self.translation_m.sum() + self.rotation_rad.sum();
        if sum.is_finite() {
            Ok(self)
        } else {
            Err(KinematicsError::NotFinite)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::kinematics::Pose;
    use crate::model::l2::Robot;
    use crate::model::l2::tests::{close, compliances, geometry, l2, machine, machines};
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(5_000))]
        #[test]
        fn equals_the_six_by_six_path(
            x in -0.4..0.4_f64, y in 0.2..0.6_f64, z in 0.5..0.8_f64, skew: bool,
            load in prop::array::uniform6(-500.0..500.0_f64),
        ) {
            let (geometry, rotation) = machines()[usize::from(skew)];
            let nominal = machine(geometry, &rotation);
            let position_m = rotation * Vector3::new(x, y, z);
            let Ok(q) = nominal.inverse(&position_m) else { return Ok(()); };
            let load = Wrench::from_array(load);
            let Ok(ours) = Elastic::new(&nominal, &compliances()).deflection(&position_m, &q, &load) else {
                return Ok(());
            };
            let pose = Pose { position_m, rotation };
            let lines = Robot::new(geometry).unwrap().line_matrix(&pose, &q).unwrap();
            let general = lines.deflection(&compliances(), &load).unwrap();
            close(&ours.carts, &general.carts, 1e-9, "r");
            close(ours.translation_m.as_slice(), general.links.translation_m.as_slice(), 1e-9, "dT");
            close(ours.rotation_rad.as_slice(), general.links.rotation_rad.as_slice(), 1e-9, "dtheta");
        }
    }

    #[test]
    fn a_platform_that_can_turn_freely_is_refused() {
        let mut flat = geometry();
        // Links 31, 32 and 33 side by side: nothing holds a rotation about their common direction
        // in the plane.
        let shift = Vector3::new(0.12, -0.05, 0.05) - flat.cart_joints_m[5];
        flat.cart_joints_m[5] += shift;
        flat.platform_joints_m[5] += shift;
        let nominal = machine(flat, &Matrix3::identity());
        let tcp = Vector3::new(0.0, 0.5, 0.65);
        let q = nominal.inverse(&tcp).unwrap();
        let model = Elastic::new(&nominal, &compliances());
        assert!(matches!(
            model.deflection(&tcp, &q, &Wrench::zero()),
            Err(KinematicsError::Singular { .. })
        ));
        let model = Elastic::new(&l2(), &compliances());
        for wild in [f64::NAN, f64::INFINITY, f64::MAX] {
            let load = Wrench::from_array([wild; 6]);
            assert_eq!(
                model.deflection(&tcp, &q, &load),
                Err(KinematicsError::NotFinite)
            );
        }
    }
}
