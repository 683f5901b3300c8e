//! One Newton step of the platform: `s . dT + m . dtheta = e` for every link, with `m = l x s`.
//!
//! Two blocks of three instead of one system of six; where either is near singular a pivoting solve of all six decides.

use nalgebra::Vector3;

use crate::model::block_solve::BlockFactors;
use crate::model::kinematics::KinematicsError;
use crate::model::lu::Lu;
use crate::model::robot::LINKS;
use crate::model::statics::rows;

/// The system, row by row in link order.
#[derive(Clone, Copy, Debug)]
pub(super) struct System {
    /// `s_ij`: from platform to plate, to first order of unit length.
    pub(super) directions: [Vector3<f64>; LINKS],
    /// `l_ij x s_ij`, metres.
    pub(super) moments_m: [Vector3<f64>; LINKS],
    /// `e_ij`: error of each link's length, metres.
    pub(super) errors_m: [f64; LINKS],
}

/// Its solution.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// `dT`, metres.
    pub(super) translation_m: Vector3<f64>,
    /// `dtheta`, radians.
    pub(super) rotation_rad: Vector3<f64>,
    /// True if the determinant of the system is negative: its sign changes where assembly modes meet.
    pub(super) det_is_negative: bool,
}

impl System {
    /// True if every link has its length; false for NaN.
    #[inline]
    pub(super) fn is_settled(&self, converged_m: f64) -> bool {
        let [e11, e21, e22, e31, e32, e33] = &self.errors_m;
        let within = |error: &f64| error.abs() <= converged_m;
        within(e11) && within(e21) && within(e22) && within(e31) && within(e32) && within(e33)
    }

    /// # Errors
    /// `Singular` and `NotFinite`.
    #[inline]
    pub(super) fn solve(&self) -> Result<Step, KinematicsError> {
        match self.solve_block() {
            Some(step) => Ok(step),
            None => self.solve_full(),
        }
    }

    #[inline]
    fn solve_block(&self) -> Option<Step> {
        let factors = BlockFactors::new(&self.directions, &self.moments_m)?;
        let (translation_m, rotation_rad) = factors.solve(&self.errors_m);
        Some(Step { translation_m, rotation_rad, det_is_negative: factors.det_is_negative() })
    }

    #[cold]
    #[inline(never)]
    fn solve_full(&self) -> Result<Step, KinematicsError> {
        let factors = Lu::factor(&rows(&self.directions, &self.moments_m))?;
        let [x, y, z, a, b, c] = factors.solve(&self.errors_m);
        Ok(Step {
            translation_m: Vector3::new(x, y, z),
            rotation_rad: Vector3::new(a, b, c),
            det_is_negative: factors.det_is_negative(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]
        /// Two systems of three, or one of six: the same step, and the same side of the singularity.
        #[test]
        fn two_systems_of_three_are_the_one(
            directions in prop::array::uniform6(prop::array::uniform3(-1.0..1.0_f64)),
            levers in prop::array::uniform6(prop::array::uniform3(-1.0..1.0_f64)),
            errors_m in prop::array::uniform6(-1.0..1.0_f64),
        ) {
            let directions = directions.map(Vector3::from);
            let mut moments_m = levers.map(Vector3::from);
            for (m, s) in moments_m.iter_mut().zip(&directions) {
                *m = m.cross(s);
            }
            let system = System { directions, moments_m, errors_m };
            let (Some(two), Ok(one)) = (system.solve_block(), system.solve_full()) else {
                return Ok(());
            };
            prop_assert_eq!(two.det_is_negative, one.det_is_negative);
            let size = one.translation_m.amax().max(one.rotation_rad.amax());
            // Both lose as many digits as they are near singular, 1e-4 and again 1e-4.
            prop_assert!((two.translation_m - one.translation_m).amax() <= 1e-7 * size.max(1.0));
            prop_assert!((two.rotation_rad - one.rotation_rad).amax() <= 1e-7 * size.max(1.0));
        }
    }

    #[test]
    fn dependent_links_are_singular() {
        let directions = [Vector3::x(); LINKS];
        let moments_m = [Vector3::z(); LINKS];
        let system = System { directions, moments_m, errors_m: [0.0; LINKS] };
        assert!(matches!(system.solve(), Err(KinematicsError::Singular { .. })));
        let directions = [Vector3::x() * f64::NAN; LINKS];
        let system = System { directions, ..system };
        assert_eq!(system.solve().unwrap_err(), KinematicsError::NotFinite);
    }
}
