//! Readers for parts of requests: the inline robot, and named numbers.

use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_machine::robot_file::{F1Keys, Keys, L2Keys, Problem, Problems};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::SolveError;

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
    },
    F1 {
        kinematics: f1::Kinematics,
        compliances: Option<Compliances<{ f1::AXES }>>,
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
            let (robot, compliances) = read::<L2Keys, { l2::AXES }>(robot)?;
            Ok(SolvedMachine::L2 { robot, compliances })
        }
        Some("f1") => {
            let (robot, compliances) = read::<F1Keys, { f1::AXES }>(robot)?;
            Ok(SolvedMachine::F1 {
                kinematics: f1::Kinematics::new(&robot),
                compliances,
            })
        }
        _ => Err(SolveError::robot("model must be \"l2\" or \"f1\"")),
    }
}

/// Reads the keys of a machine, and `travel` in q-units. Unknown keys are ignored.
fn read<K: Keys<N>, const N: usize>(
    robot: &Value,
) -> Result<(K::Robot, Option<Compliances<N>>), SolveError>
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
        Some(robot) if problems.is_empty() => Ok((robot, keys.compliances()?)),
        _ => Err(problems.into_first().into()),
    }
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
