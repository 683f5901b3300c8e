//! Masses of a machine, for its [`dynamics`](crate::dynamics).

use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};

use crate::halves::{halves, joined};

/// Acceleration of free fall, m/s^2, along -z of the world.
pub const GRAVITY_M_PER_S2: f64 = 9.806_65;
/// Plates of a machine with six axes.
pub const PLATES: usize = 3;

/// A rigid body on the platform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidBody {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass, from the tool centre point, platform axes, m.
    pub centre_m: Vector3<f64>,
    /// Inertia about the centre of mass, platform axes, kg m^2.
    pub inertia_kgm2: Matrix3<f64>,
}

impl RigidBody {
    /// Returns the mass matrix about the tool centre point, world axes, with the platform turned by
    /// `rotation`: `[m 1, -m [c]; m [c], I - m [c]^2]`.
    #[must_use]
    pub fn mass_matrix(&self, rotation: &UnitQuaternion<f64>) -> Matrix6<f64> {
        let (centre_m, inertia) = self.in_world(rotation);
        let mut matrix = point_mass_matrix(self.mass_kg, &centre_m);
        let mut about_centre = matrix.fixed_view_mut::<3, 3>(3, 3);
        about_centre += inertia;
        matrix
    }

    /// Returns the force and the moment about the tool centre point, world axes, that its motion
    /// takes: `m a_c` and `c x m a_c + I alpha + omega x I omega`, with
    /// `a_c = a + alpha x c + omega x (omega x c)`.
    ///
    /// `acceleration` is that of the tool centre point, m/s^2, and of the orientation, rad/s^2;
    /// `omega` the angular velocity, rad/s; world axes.
    #[must_use]
    pub fn inertial_load(
        &self,
        rotation: &UnitQuaternion<f64>,
        acceleration: &Vector6<f64>,
        omega: &Vector3<f64>,
    ) -> Vector6<f64> {
        let (centre_m, inertia) = self.in_world(rotation);
        let [linear, angular] = halves(acceleration);
        let of_centre = linear + angular.cross(&centre_m) + omega.cross(&omega.cross(&centre_m));
        let force_n = of_centre * self.mass_kg;
        let moment_nm =
            centre_m.cross(&force_n) + inertia * angular + omega.cross(&(inertia * omega));
        joined(&force_n, &moment_nm)
    }

    /// Returns the weight in a field (m/s^2, world axes), about the tool centre point.
    #[must_use]
    pub fn weight(&self, rotation: &UnitQuaternion<f64>, field: &Vector3<f64>) -> Vector6<f64> {
        let force_n = field * self.mass_kg;
        joined(&force_n, &(rotation * self.centre_m).cross(&force_n))
    }

    /// Centre and inertia in world axes.
    fn in_world(&self, rotation: &UnitQuaternion<f64>) -> (Vector3<f64>, Matrix3<f64>) {
        let matrix = rotation.to_rotation_matrix().into_inner();
        (
            rotation * self.centre_m,
            matrix * self.inertia_kgm2 * matrix.transpose(),
        )
    }
}

/// Returns the mass matrix of a point at `lever_m` from the tool centre point, world axes:
/// `m [1, -[l]; [l], -[l]^2]`.
pub(crate) fn point_mass_matrix(mass_kg: f64, lever_m: &Vector3<f64>) -> Matrix6<f64> {
    let lever = lever_m.cross_matrix();
    let mut matrix = Matrix6::zeros();
    let blocks = [
        ((0, 0), Matrix3::identity() * mass_kg),
        ((0, 3), lever * -mass_kg),
        ((3, 0), lever * mass_kg),
        ((3, 3), lever * lever * -mass_kg),
    ];
    for (place, block) in blocks {
        matrix
            .fixed_view_mut::<3, 3>(place.0, place.1)
            .copy_from(&block);
    }
    matrix
}

/// Masses of a machine with `N` axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Masses<const N: usize> {
    /// The platform, without the tool.
    pub platform: RigidBody,
    /// What the force sensor carries.
    pub tool: RigidBody,
    /// Links, uniform thin rods, link order, kg.
    pub links_kg: [f64; LINKS],
    /// What moves behind the spring of each cart's axis, its plate included, kg.
    pub carts_kg: [f64; ARMS],
    /// Inertia of the plates about the axes `q_4`, `q_5`, `q_6`, kg m^2; not used by a machine of
    /// three axes. What the products of inertia would add is left out.
    pub plates_kgm2: [f64; PLATES],
    /// What moves in front of the spring of each axis, its motors together, at the drives' metre,
    /// kg.
    pub motors_kg: [f64; N],
    /// Damping ratio of every mode.
    pub damping_ratio: f64,
    /// True if the parts have weight.
    pub has_weight: bool,
}

/// Error of a machine's masses.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MassError {
    /// A number is NaN or outside of its range.
    #[error("is {value}; expected from {lower} to {upper}")]
    OutOfRange {
        /// Key, as of `[masses]` in a robot file.
        key: String,
        /// The number.
        value: f64,
        /// Smallest number accepted.
        lower: f64,
        /// Largest number accepted.
        upper: f64,
    },
    /// A matrix that is the inertia of no body.
    #[error(
        "is the inertia of no body: it must be symmetric, its principal moments positive, and none larger than the sum of the others"
    )]
    NotInertia {
        /// Key, as of `[masses]` in a robot file.
        key: &'static str,
    },
}

impl MassError {
    /// Key that it concerns, as of `[masses]` in a robot file.
    #[must_use]
    pub fn key(&self) -> &str {
        match self {
            Self::OutOfRange { key, .. } => key,
            Self::NotInertia { key } => key,
        }
    }
}

impl<const N: usize> Masses<N> {
    /// Returns all errors; none of masses that a machine can have.
    #[must_use]
    pub fn errors(&self) -> Vec<MassError> {
        let mut errors = Vec::new();
        let ranges = [
            ("platform_kg", &[self.platform.mass_kg][..], (0.1, 1e4)),
            (
                "platform_centre_m",
                self.platform.centre_m.as_slice(),
                (-10.0, 10.0),
            ),
            ("tool_kg", &[self.tool.mass_kg], (1e-3, 1e4)),
            (
                "tool_centre_m",
                self.tool.centre_m.as_slice(),
                (-10.0, 10.0),
            ),
            ("link_kg", &self.links_kg, (0.0, 1e3)),
            ("cart_kg", &self.carts_kg, (0.1, 1e4)),
            ("motor_kg", &self.motors_kg, (1.0, 1e5)),
            ("damping_ratio", &[self.damping_ratio], (1e-3, 0.3)),
        ];
        for (key, values, range) in ranges {
            check_range(key, values, range, &mut errors);
        }
        if N > ARMS {
            check_range(
                "plate_inertia_kgm2",
                &self.plates_kgm2,
                (1e-6, 1e4),
                &mut errors,
            );
        }
        if !is_inertia(&self.platform.inertia_kgm2) {
            errors.push(MassError::NotInertia {
                key: "platform_inertia_kgm2",
            });
        }
        let tool = &self.tool.inertia_kgm2;
        // A point.
        if *tool != Matrix3::zeros() && !is_inertia(tool) {
            errors.push(MassError::NotInertia {
                key: "tool_inertia_kgm2",
            });
        }
        errors
    }
}

fn check_range(key: &str, values: &[f64], range: (f64, f64), errors: &mut Vec<MassError>) {
    let (lower, upper) = range;
    for (index, &value) in values.iter().enumerate() {
        if !(lower..=upper).contains(&value) {
            let key = if values.len() == 1 {
                key.to_owned()
            } else {
                format!("{key}[{index}]")
            };
            errors.push(MassError::OutOfRange {
                key,
                value,
                lower,
                upper,
            });
        }
    }
}

/// Largest difference across the diagonal, and smallest excess of two moments over the third, as a
/// share of the largest entry.
const TOLERANCE: f64 = 1e-9;
/// Largest moment of inertia, kg m^2.
const MAX_INERTIA: f64 = 1e6;

/// True for the inertia of a body.
fn is_inertia(matrix: &Matrix3<f64>) -> bool {
    let largest = matrix.amax();
    let is_symmetric = (matrix - matrix.transpose()).amax() <= TOLERANCE * largest;
    if !(is_symmetric && largest <= MAX_INERTIA && matrix.iter().all(|entry| entry.is_finite())) {
        return false;
    }
    let moments = matrix.symmetric_eigenvalues();
    moments.min() > 0.0 && 2.0 * moments.max() <= moments.sum() + TOLERANCE * largest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of matrices small and large, as the tolerance is a share.
    #[test]
    fn only_the_inertia_of_a_body_is_taken() {
        let sphere = Matrix3::from_diagonal_element(1.0);
        let with = |row, column, entry| {
            let mut matrix = sphere;
            matrix[(row, column)] = entry;
            matrix
        };
        for (matrix, is_of_body) in [
            (sphere, true),
            // A disc: the largest moment is the sum of the others.
            (with(2, 2, 2.0), true),
            (with(2, 2, 2.0 + 1e-6), false),
            // A rod, which a moment of inertia about itself is left of.
            (with(2, 2, 1e-6), true),
            (with(2, 2, 0.0), false),
            (with(2, 2, -1e-6), false),
            (with(0, 1, 1e-6), false),
            (with(0, 1, f64::NAN), false),
            (with(2, 2, f64::INFINITY), false),
        ] {
            for scale in [1e-5, 1.0, 1e5] {
                let scaled = matrix * scale;
                assert_eq!(is_inertia(&scaled), is_of_body, "{scaled}");
            }
        }
        assert!(!is_inertia(&(sphere * 2.0 * MAX_INERTIA)));
    }
}
