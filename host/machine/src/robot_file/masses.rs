//! `[masses]`: what moves, for the dynamics of the machine.

use nalgebra::Matrix3;
use serde::Deserialize;

use super::matrix;
use super::problems::Problems;
use super::sections::{Motors, ToolKeys};
use crate::drive_cascade::MOTOR_MASS_KG;
use crate::masses::{GRAVITY_M_PER_S2, Masses, RigidBody};

/// Damping ratio of every mode where a file has none.
pub const DAMPING_RATIO: f64 = 0.02;
/// Axes of a machine without plates.
const CARTS: usize = 3;

/// `[masses]`, as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MassKeys {
    platform_kg: f64,
    #[serde(default)]
    platform_centre_m: [f64; 3],
    platform_inertia_kgm2: InertiaKeys,
    link_kg: [f64; 6],
    cart_kg: [f64; 3],
    plate_inertia_kgm2: Option<[f64; 3]>,
    motor_kg: Option<Vec<f64>>,
    tool_inertia_kgm2: Option<InertiaKeys>,
    #[serde(default = "usual_damping")]
    damping_ratio: f64,
    #[serde(default = "usual_gravity")]
    gravity: bool,
}

/// An inertia: its diagonal, or all of it by rows, kg m^2.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "expected 3 numbers, or 3 rows of 3 numbers")]
pub enum InertiaKeys {
    /// Moments about the axes.
    Diagonal([f64; 3]),
    /// The whole matrix.
    Rows([[f64; 3]; 3]),
}

impl From<InertiaKeys> for Matrix3<f64> {
    fn from(keys: InertiaKeys) -> Self {
        match keys {
            InertiaKeys::Diagonal(moments) => Self::from_diagonal(&moments.into()),
            InertiaKeys::Rows(rows) => matrix(rows),
        }
    }
}

const fn usual_damping() -> f64 {
    DAMPING_RATIO
}

const fn usual_gravity() -> bool {
    true
}

/// Checks the section with the tool and the motors of its file.
pub(super) fn check<const N: usize>(
    keys: &MassKeys,
    tool: &ToolKeys,
    motors: &Motors,
    problems: &mut Problems,
) -> Option<Masses<N>> {
    let plates_kgm2 = plates(keys, N, problems);
    let motors_kg = motors_kg(keys, motors, problems);
    let tool_kg = nalgebra::Vector3::from(tool.weight_n).norm() / GRAVITY_M_PER_S2;
    if tool_kg == 0.0 {
        let reason = "needs the tool's weight in sensor.tool: the tool would be without mass";
        problems.add("masses", reason);
        return None;
    }
    let masses = Masses {
        platform: RigidBody {
            mass_kg: keys.platform_kg,
            centre_m: keys.platform_centre_m.into(),
            inertia_kgm2: keys.platform_inertia_kgm2.into(),
        },
        tool: RigidBody {
            mass_kg: tool_kg,
            centre_m: tool.centre_m.into(),
            inertia_kgm2: keys
                .tool_inertia_kgm2
                .map_or_else(Matrix3::zeros, Matrix3::from),
        },
        links_kg: keys.link_kg,
        carts_kg: keys.cart_kg,
        plates_kgm2: plates_kgm2?,
        motors_kg: motors_kg?,
        damping_ratio: keys.damping_ratio,
        has_weight: keys.gravity,
    };
    let errors = masses.errors();
    for error in &errors {
        problems.add(format!("masses.{}", error.key()), error);
    }
    errors.is_empty().then_some(masses)
}

fn plates(keys: &MassKeys, axes: usize, problems: &mut Problems) -> Option<[f64; 3]> {
    let key = "masses.plate_inertia_kgm2";
    match keys.plate_inertia_kgm2 {
        None if axes > CARTS => {
            problems.add(key, "is missing; a machine with six axes has plates");
            None
        }
        Some(_) if axes <= CARTS => {
            problems.add(key, "is of a machine with six axes; this one has no plates");
            None
        }
        plates => Some(plates.unwrap_or_default()),
    }
}

/// Returns the mass of the motors of each axis together.
fn motors_kg<const N: usize>(
    keys: &MassKeys,
    motors: &Motors,
    problems: &mut Problems,
) -> Option<[f64; N]> {
    let count = motors.axis_of_motor.len();
    let each = (keys.motor_kg.clone()).unwrap_or_else(|| vec![MOTOR_MASS_KG; count]);
    if each.len() != count {
        let reason = format!("has {} entries, the machine has {count} motors", each.len());
        problems.add("masses.motor_kg", reason);
        return None;
    }
    // `[motors]` is refused for it.
    if (0..N).any(|axis| !motors.axis_of_motor.contains(&axis)) {
        return None;
    }
    problems
        .none_in(|problems| {
            for (motor, mass_kg) in each.iter().enumerate() {
                problems.range(&format!("masses.motor_kg[{motor}]"), *mass_kg, 1.0, 1e4);
            }
        })
        .then(|| std::array::from_fn(|axis| motors.sum_on(axis, each.iter().copied())))
}
