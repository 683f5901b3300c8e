//! Links and carts as springs for the cyclic path: two 3x3 solves instead of one 6x6.
//!
//! In the nominal model the links of a cluster are parallel (the Tau property), so `W f + w = 0` falls apart. With the links
//! kept at their length, `w_i = L_i s_i`, and tensions per metre of link, `phi_ij = f_ij / L_i`:
//!
//! - forces: `sum_i Phi_i w_i = -F` for the sums `Phi_i` of each cluster, a 3x3 solve;
//! - moments: one link of each cluster expressed by its sum, what remains are differences of levers,
//!   `phi_21 (l_21 - l_22) x w_2 + phi_32 (l_32 - l_31) x w_3 + phi_33 (l_33 - l_31) x w_3 = -M - sum_i Phi_i l_i x w_i`, another 3x3 solve.
//!
//! The displacement solves the same two matrices transposed, in the other order. No root is taken.

use nalgebra::Vector3;

use crate::model::kinematics::{KinematicsError, LinkFrame, Nominal, SINGULAR_MEASURE};
use crate::model::linalg::norm;
use crate::model::robot::{ARMS, Compliances, LINKS};
use crate::model::statics::Wrench;

/// What a load does, as the compensation needs it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TauDeflection {
    /// `r = c tau`: how far each cart yields, q-units, arm order.
    pub carts: [f64; ARMS],
    /// `dT_links`: translation of the tool centre point by the links alone, world axes, m.
    pub translation_m: Vector3<f64>,
    /// `dtheta_links`: rotation of the platform by the links alone, world axes, rad. A 3-DOF machine cannot correct it.
    pub rotation_rad: Vector3<f64>,
}

/// The elastic nominal model, with everything that does not change from pose to pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TauModel {
    nominal: Nominal,
    /// The same without travel, for corrections.
    corrections: Nominal,
    /// `l_11`, `l_22`, `l_31`: levers of the links that are expressed by their cluster's sum, m.
    levers_m: [Vector3<f64>; ARMS],
    /// `l_21 - l_22`, `l_32 - l_31`, `l_33 - l_31`, m.
    spreads_m: [Vector3<f64>; ARMS],
    /// `c_ij L_i^2`: elongation times `L_i` per `phi_ij`, link order.
    links: [f64; LINKS],
    /// `c_i`, arm order.
    carts: [f64; ARMS],
    /// Smallest determinant of the moments' matrix that is not singular, m^6.
    moments_min: f64,
}

impl TauModel {
    /// The model of a machine whose springs are known.
    #[must_use]
    pub fn new(nominal: &Nominal, compliances: &Compliances) -> Self {
        let [l11, l21, l22, l31, l32, l33] = *nominal.levers_m();
        let [c11, c21, c22, c31, c32, c33] = *compliances.link_m_per_n();
        let [a1, a2, a3] = nominal.lengths_squared();
        let spreads_m = [l21 - l22, l32 - l31, l33 - l31];
        let [d1, d2, d3] = spreads_m.map(|spread| norm(&spread));
        // Each column is a spread times a link; links of arms 2, 3 and 3.
        let scale = d1 * d2 * d3 * a3 * crate::model::linalg::sqrt(a2);
        Self {
            nominal: *nominal,
            corrections: nominal.without_travel(),
            levers_m: [l11, l22, l31],
            spreads_m,
            links: [c11 * a1, c21 * a2, c22 * a2, c31 * a3, c32 * a3, c33 * a3],
            carts: *compliances.cart_m_per_n(),
            moments_min: SINGULAR_MEASURE * scale,
        }
    }

    /// The rigid model inside.
    #[inline]
    #[must_use]
    pub const fn nominal(&self) -> &Nominal {
        &self.nominal
    }

    /// The rigid model with travel unchecked: a correction may leave the nominal travel.
    #[inline]
    pub(crate) const fn corrections(&self) -> &Nominal {
        &self.corrections
    }

    /// What `load` does at `tcp_m` (world axes, metres) with the carts at `q` (q-units).
    ///
    /// # Errors
    /// As [`Nominal::link_frame`]; also [`KinematicsError::Singular`] when the platform could turn without a link
    /// changing its length, and `NotFinite`.
    #[inline]
    pub fn deflection(
        &self,
        tcp_m: &Vector3<f64>,
        q: &[f64; ARMS],
        load: &Wrench,
    ) -> Result<TauDeflection, KinematicsError> {
        let frame = self.nominal.link_frame(tcp_m, q)?;
        self.deflection_in(&frame, load)
    }

    /// What `load` does to the links of `frame`, which [`nominal`](Self::nominal) has made.
    ///
    /// # Errors
    /// [`KinematicsError::Singular`] when the platform could turn without a link changing its length, `NotFinite`.
    #[inline]
    pub fn deflection_in(
        &self,
        frame: &LinkFrame,
        load: &Wrench,
    ) -> Result<TauDeflection, KinematicsError> {
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
        let [s1, s2, s3] = self.carts;
        Ok(TauDeflection {
            carts: [-s1 * g1 * p1, -s2 * g2 * p2, -s3 * g3 * p3],
            translation_m,
            rotation_rad,
        })
        .and_then(TauDeflection::checked)
    }

    #[cold]
    #[inline(never)]
    fn not_regular(&self, determinant: f64) -> KinematicsError {
        let measure = determinant.abs() * SINGULAR_MEASURE / self.moments_min;
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

impl TauDeflection {
    /// An infinity or NaN among the numbers makes their sum infinite or NaN.
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
    use crate::model::kinematics::tests::{
        Case, close, compliances, geometry, l2, machine, skewed,
    };
    use crate::model::robot::Robot;
    use crate::model::statics::LineMatrix;
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    #[test]
    fn agrees_with_the_oracle() {
        let model = TauModel::new(&l2(), &compliances());
        for case in Case::all() {
            let load = Wrench::from_array(case.numbers("w").try_into().unwrap());
            let deflection = model
                .deflection(&case.tcp(), &case.three("q"), &load)
                .unwrap();
            case.agrees("r", deflection.carts);
            let (t, r) = (deflection.translation_m, deflection.rotation_rad);
            case.agrees("dx_links", t.iter().chain(r.iter()).copied());
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(5_000))]
        #[test]
        fn equals_the_six_by_six_path(
            x in -0.4..0.4_f64, y in 0.2..0.6_f64, z in 0.5..0.8_f64, skew: bool,
            load in prop::array::uniform6(-500.0..500.0_f64),
        ) {
            let (geometry, rotation) = if skew { skewed() } else { (geometry(), Matrix3::identity()) };
            let nominal = machine(geometry, &rotation);
            let position_m = rotation * Vector3::new(x, y, z);
            let Ok(q) = nominal.inverse(&position_m) else { return Ok(()); };
            let load = Wrench::from_array(load);
            let Ok(ours) = TauModel::new(&nominal, &compliances()).deflection(&position_m, &q, &load) else {
                return Ok(());
            };
            let pose = Pose { position_m, rotation };
            let lines = LineMatrix::new(&Robot::new(geometry).unwrap(), &pose, &q).unwrap();
            let general = lines.deflection(&compliances(), &load).unwrap();
            close(&ours.carts, &general.carts, 1e-9, "r");
            close(ours.translation_m.as_slice(), general.links.translation_m.as_slice(), 1e-9, "dT");
            close(ours.rotation_rad.as_slice(), general.links.rotation_rad.as_slice(), 1e-9, "dtheta");
        }
    }

    #[test]
    fn a_platform_that_can_turn_freely_is_refused() {
        let mut flat = geometry();
        // Links 31, 32 and 33 side by side: nothing holds a rotation about their common direction in the plane.
        let shift = Vector3::new(0.12, -0.05, 0.05) - flat.cart_joints_m[5];
        flat.cart_joints_m[5] += shift;
        flat.platform_joints_m[5] += shift;
        let nominal = machine(flat, &Matrix3::identity());
        let tcp = Vector3::new(0.0, 0.5, 0.65);
        let q = nominal.inverse(&tcp).unwrap();
        let model = TauModel::new(&nominal, &compliances());
        assert!(matches!(
            model.deflection(&tcp, &q, &Wrench::zero()),
            Err(KinematicsError::Singular { .. })
        ));
        let model = TauModel::new(&l2(), &compliances());
        for wild in [f64::NAN, f64::INFINITY, f64::MAX] {
            let load = Wrench::from_array([wild; 6]);
            assert_eq!(
                model.deflection(&tcp, &q, &load),
                Err(KinematicsError::NotFinite)
            );
        }
    }
}
