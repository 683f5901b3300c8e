//! One Newton step of the platform: `s . dT + m . dtheta = e` for every link, with `m = l x s`.
//!
//! Two systems of three instead of one of six: `dT` is eliminated by one link of each arm, whose directions are far from
//! dependent, and what the other three links leave is solved for `dtheta`. Where either is near singular a pivoting solve of all
//! six decides. In the Tau case the links of a cluster are parallel, and the second system is one of the clusters' levers alone.

use nalgebra::Vector3;

use super::{KinematicsError, SINGULAR_MEASURE};
use crate::linalg::Lu;
use crate::robot::LINKS;

/// The system, row by row in link order.
#[derive(Clone, Copy, Debug)]
pub(super) struct System {
    /// `s_ij`: from platform to plate, to first order of unit length.
    pub(super) directions: [Vector3<f64>; LINKS],
    /// `l_ij x s_ij`, metres.
    pub(super) moments_m: [Vector3<f64>; LINKS],
    /// `e_ij`: by how much each link is too long, metres.
    pub(super) errors_m: [f64; LINKS],
}

/// Its solution.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// `dT`, metres.
    pub(super) translation_m: Vector3<f64>,
    /// `dtheta`, radians.
    pub(super) rotation_rad: Vector3<f64>,
    /// Whether the determinant of the system is below zero: it changes its sign where assembly modes meet.
    pub(super) mirrors: bool,
}

/// The inverse of a matrix given by its rows, as columns; none near a singularity or for NaN.
struct Inverse {
    columns: [Vector3<f64>; 3],
    mirrors: bool,
}

impl Inverse {
    /// `None` unless `|det| > SINGULAR_MEASURE |r_1| |r_2| |r_3|`.
    #[inline]
    fn of_rows([r1, r2, r3]: [&Vector3<f64>; 3]) -> Option<Self> {
        let (c1, c2, c3) = (r2.cross(r3), r3.cross(r1), r1.cross(r2));
        let determinant = r1.dot(&c1);
        let volume_squared = r1.dot(r1) * r2.dot(r2) * r3.dot(r3);
        let least_squared = SINGULAR_MEASURE * SINGULAR_MEASURE * volume_squared;
        let scale = 1.0 / determinant;
        (determinant * determinant > least_squared).then(|| Self {
            columns: [c1 * scale, c2 * scale, c3 * scale],
            mirrors: determinant < 0.0,
        })
    }

    #[inline]
    fn times(&self, [y1, y2, y3]: [f64; 3]) -> Vector3<f64> {
        let [c1, c2, c3] = &self.columns;
        c1 * y1 + c2 * y2 + c3 * y3
    }

    /// `row` times the inverse.
    #[inline]
    fn weights(&self, row: &Vector3<f64>) -> [f64; 3] {
        let [c1, c2, c3] = &self.columns;
        [row.dot(c1), row.dot(c2), row.dot(c3)]
    }
}

impl System {
    /// # Errors
    /// `Singular` and `NotFinite`.
    #[inline]
    pub(super) fn solve(&self) -> Result<Step, KinematicsError> {
        match self.solve_in_two() {
            Some(step) => Ok(step),
            None => self.solve_as_one(),
        }
    }

    #[inline]
    fn solve_in_two(&self) -> Option<Step> {
        let [s11, s21, s22, s31, s32, s33] = &self.directions;
        let [m11, m21, m22, m31, m32, m33] = &self.moments_m;
        let [e11, e21, e22, e31, e32, e33] = self.errors_m;
        let first = Inverse::of_rows([s11, s21, s31])?;
        // What another link leaves, once dT is eliminated.
        let left = |s: &Vector3<f64>, m: &Vector3<f64>, e: f64| {
            let [a1, a2, a3] = first.weights(s);
            let row = m - (m11 * a1 + m21 * a2 + m31 * a3);
            (row, e - (a1 * e11 + a2 * e21 + a3 * e31))
        };
        let (n22, r22) = left(s22, m22, e22);
        let (n32, r32) = left(s32, m32, e32);
        let (n33, r33) = left(s33, m33, e33);
        let second = Inverse::of_rows([&n22, &n32, &n33])?;
        let rotation_rad = second.times([r22, r32, r33]);
        let translation_m = first.times([
            e11 - m11.dot(&rotation_rad),
            e21 - m21.dot(&rotation_rad),
            e31 - m31.dot(&rotation_rad),
        ]);
        Some(Step {
            translation_m,
            rotation_rad,
            // Link 31 stands before link 22 here, which turns the sign once.
            mirrors: !(first.mirrors ^ second.mirrors),
        })
    }

    #[cold]
    #[inline(never)]
    fn solve_as_one(&self) -> Result<Step, KinematicsError> {
        let mut rows = [[0.0; 6]; LINKS];
        let links = self.directions.iter().zip(&self.moments_m);
        for (row, (s, m)) in rows.iter_mut().zip(links) {
            *row = [s.x, s.y, s.z, m.x, m.y, m.z];
        }
        let factors = Lu::factor(&rows)?;
        let [x, y, z, a, b, c] = factors.solve(&self.errors_m);
        Ok(Step {
            translation_m: Vector3::new(x, y, z),
            rotation_rad: Vector3::new(a, b, c),
            mirrors: factors.mirrors(),
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
        fn two_systems_are_the_one(
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
            let (Some(two), Ok(one)) = (system.solve_in_two(), system.solve_as_one()) else {
                return Ok(());
            };
            prop_assert_eq!(two.mirrors, one.mirrors);
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
        let system = System {
            directions,
            moments_m,
            errors_m: [0.0; LINKS],
        };
        assert!(matches!(
            system.solve(),
            Err(KinematicsError::Singular { .. })
        ));
        let directions = [Vector3::x() * f64::NAN; LINKS];
        let system = System {
            directions,
            ..system
        };
        assert_eq!(system.solve().unwrap_err(), KinematicsError::NotFinite);
    }
}
