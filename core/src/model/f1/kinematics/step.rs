//! One Newton step of the platform: `w . dT + (l x w) . dtheta = (|w|^2 - L^2) / 2` for every link.
//!
//! Two blocks of three instead of one system of six; where either is near singular a pivoting solve
//! of all six decides.

use nalgebra::Vector3;

use crate::model::block_solve::BlockFactors;
use crate::model::kinematics::KinematicsError;
use crate::model::lu::Lu;
use crate::model::robot::LINKS;
use crate::model::statics::{moments, rows};
use crate::zip::zip;

/// The system, row by row in link order.
#[derive(Clone, Copy, Debug)]
pub(super) struct System {
    /// `w_ij`: from platform to plate, metres.
    pub(super) links_m: [Vector3<f64>; LINKS],
    /// `l_ij = R b_ij`: from the tool centre point to the platform joint, metres.
    pub(super) levers_m: [Vector3<f64>; LINKS],
    /// Surplus of each link, see [`surplus`](super::surplus).
    pub(super) surpluses: [f64; LINKS],
}

/// Its solution.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// `dT`, metres.
    pub(super) translation_m: Vector3<f64>,
    /// `dtheta`, radians.
    pub(super) rotation_rad: Vector3<f64>,
    /// True if the determinant of the system is negative: its sign changes where assembly modes
    /// meet.
    pub(super) det_is_negative: bool,
}

impl System {
    /// True if every surplus is at most its `settled`; false for NaN.
    #[inline]
    pub(super) fn is_settled(&self, settled: &[f64; LINKS]) -> bool {
        zip(&self.surpluses, settled).all(|(surplus, most)| surplus.abs() <= *most)
    }

    /// `l_ij x w_ij`.
    #[inline]
    pub(super) fn moments(&self) -> [Vector3<f64>; LINKS] {
        moments(&self.levers_m, &self.links_m)
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
        let factors = BlockFactors::new(&self.links_m, &self.moments())?;
        let (translation_m, rotation_rad) = factors.solve(&self.surpluses);
        Some(Step {
            translation_m,
            rotation_rad,
            det_is_negative: factors.det_is_negative(),
        })
    }

    #[cold]
    #[inline(never)]
    fn solve_full(&self) -> Result<Step, KinematicsError> {
        let factors = Lu::factor(&rows(&self.links_m, &self.moments()))?;
        let [x, y, z, a, b, c] = factors.solve(&self.surpluses);
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
        /// Two systems of three, or one of six: the same step, and the same side of the
        /// singularity.
        #[test]
        fn two_systems_of_three_are_the_one(
            links in prop::array::uniform6(prop::array::uniform3(-1.0..1.0_f64)),
            levers in prop::array::uniform6(prop::array::uniform3(-1.0..1.0_f64)),
            surpluses in prop::array::uniform6(-1.0..1.0_f64),
        ) {
            let (links_m, levers_m) = (links.map(Vector3::from), levers.map(Vector3::from));
            let system = System { links_m, levers_m, surpluses };
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
        let system = System {
            links_m: [Vector3::x(); LINKS],
            levers_m: [Vector3::y(); LINKS],
            surpluses: [0.0; LINKS],
        };
        assert!(matches!(
            system.solve(),
            Err(KinematicsError::Singular { .. })
        ));
        let system = System {
            links_m: [Vector3::x() * f64::NAN; LINKS],
            ..system
        };
        assert_eq!(system.solve().unwrap_err(), KinematicsError::NotFinite);
    }
}
