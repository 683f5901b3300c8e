//! Readers for parts of requests: the inline robot, and named numbers.

use gantry_tau_core::model::kinematics::{Pose, ROTATION_TOLERANCE};
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_machine::robot_file::{F1Keys, Keys, L2Keys, Problem, Problems, matrix};
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::SolveError;
use super::dynamics::Bodies;

/// Way of a plate's screw per radian where a robot does not say it, m.
const SCREW_M_PER_RAD: f64 = 0.1;

/// A robot of a request.
#[derive(Clone, Copy, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "a few of them are kept, each for many requests"
)]
pub(super) enum SolvedMachine {
    L2 {
        robot: l2::Robot,
        compliances: Option<Compliances<{ l2::AXES }>>,
        bodies: Bodies<{ l2::AXES }>,
    },
    F1 {
        kinematics: f1::Kinematics,
        compliances: Option<Compliances<{ f1::AXES }>>,
        bodies: Bodies<{ f1::AXES }>,
    },
}

impl From<Problem> for SolveError {
    fn from(Problem { key, reason }: Problem) -> Self {
        Self::robot(format!("{key} {reason}"))
    }
}

/// Reads a robot given as an object with the keys of a robot file.
pub(super) fn inline(robot: &Value) -> Result<SolvedMachine, SolveError> {
    match robot.get("model").and_then(Value::as_str) {
        Some("l2") => {
            let (robot, compliances, metres_per_q) = read::<L2Keys, { l2::AXES }>(robot)?;
            Ok(SolvedMachine::L2 {
                robot,
                compliances,
                bodies: Bodies::massless(metres_per_q, &[1; l2::AXES]),
            })
        }
        Some("f1") => {
            let (robot, compliances, metres_per_q) = read::<F1Keys, { f1::AXES }>(robot)?;
            Ok(SolvedMachine::F1 {
                kinematics: f1::Kinematics::new(&robot),
                compliances,
                bodies: Bodies::massless(metres_per_q, &[2, 2, 2, 1, 1, 1]),
            })
        }
        _ => Err(SolveError::robot("model must be \"l2\" or \"f1\"")),
    }
}

/// Geometry, compliances, and the length of one unit of each `q`, m.
type Read<K, const N: usize> = (<K as Keys<N>>::Robot, Option<Compliances<N>>, [f64; N]);

/// Reads the keys of a machine, and `travel` in q-units. Unknown keys are ignored.
fn read<K: Keys<N>, const N: usize>(robot: &Value) -> Result<Read<K, N>, SolveError>
where
    [(f64, f64); N]: DeserializeOwned,
{
    let keys: K = serde_path_to_error::deserialize(robot)
        .map_err(|error| SolveError::robot(error.to_string()))?;
    let travel = optional(robot.get("travel"))
        .map_err(|error| SolveError::robot(format!("travel: {error}")))?;
    let mut problems = Problems::default();
    // Wrong numbers have others in their places.
    match keys.robot(travel, &mut problems) {
        Some(robot) if problems.is_empty() => {
            let metres_per_q =
                (keys.metres_per_q()).map(|length| length.unwrap_or(SCREW_M_PER_RAD));
            Ok((robot, keys.compliances()?, metres_per_q))
        }
        _ => Err(problems.into_first().into()),
    }
}

/// Reads a pose: a place (m), and an orientation or the identity.
pub(super) fn pose(object: &Value, place: &str, orientation: &str) -> Result<Pose, SolveError> {
    let position: [f64; 3] = field(object, place)?;
    let rotation = optional_field(object, orientation)?.map_or_else(Matrix3::identity, matrix);
    let deviation = rotation_deviation(&rotation);
    if deviation > ROTATION_TOLERANCE {
        return Err(SolveError::request(format!(
            "{orientation} is not a rotation matrix (deviation {deviation:e})"
        )));
    }
    Ok(Pose {
        position_m: Vector3::from(position),
        rotation,
    })
}

/// Reads a field of the request.
pub(super) fn field<T: DeserializeOwned>(request: &Value, name: &str) -> Result<T, SolveError> {
    optional_field(request, name)?.ok_or_else(|| SolveError::request(format!("{name} is missing")))
}

/// Reads a field of the request that may be absent or null.
pub(super) fn optional_field<T: DeserializeOwned>(
    request: &Value,
    name: &str,
) -> Result<Option<T>, SolveError> {
    optional(request.get(name)).map_err(|error| SolveError::request(format!("{name}: {error}")))
}

fn optional<T: DeserializeOwned>(value: Option<&Value>) -> Result<Option<T>, serde_json::Error> {
    Option::deserialize(value.unwrap_or(&Value::Null))
}
