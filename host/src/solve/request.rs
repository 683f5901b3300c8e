//! Reading requests: the inline robot, and named numbers.

use gantry_tau_core::robot::{
    ARMS, Branch, Compliances, Configuration, Geometry, LINKS, Robot, RobotError,
};
use nalgebra::{Matrix3, Vector3};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::Failure;

/// A robot of a request.
#[derive(Clone, Copy, Debug)]
pub(super) struct Machine {
    pub(super) robot: Robot,
    pub(super) compliances: Option<Compliances>,
}

impl Machine {
    /// The compliances, for the operations that need them.
    pub(super) fn springs(&self) -> Result<&Compliances, Failure> {
        (self.compliances.as_ref())
            .ok_or_else(|| Failure::robot("c_link and c_cart are missing, and this op needs them"))
    }
}

/// A robot given as an object; unknown keys are ignored.
pub(super) fn inline(robot: &Value) -> Result<Machine, Failure> {
    match robot.get("model").and_then(Value::as_str) {
        Some("l2") => {}
        Some("f1") => return Err(Failure::robot("model \"f1\" is not supported yet")),
        _ => return Err(Failure::robot("model must be \"l2\"")),
    }
    let a0: [[f64; 3]; LINKS] = key(robot, "A0")?;
    let v: [[f64; 3]; ARMS] = key(robot, "V")?;
    let b: [[f64; 3]; LINKS] = key(robot, "b")?;
    let [c1, c2, c3]: [f64; ARMS] = key(robot, "c")?;
    let travel: Option<[(f64, f64); ARMS]> = optional_key(robot, "travel")?;
    let robot_error = |error: RobotError| Failure::robot(error.to_string());
    let geometry = Geometry {
        cart_joints_m: a0.map(Vector3::from),
        guideways: v.map(Vector3::from),
        platform_joints_m: b.map(Vector3::from),
        lengths_m: key(robot, "L")?,
        configuration: Configuration {
            inverse: [
                branch("c[0]", c1)?,
                branch("c[1]", c2)?,
                branch("c[2]", c3)?,
            ],
            forward: branch("cf", key(robot, "cf")?)?,
        },
        travel,
    };
    let links: Option<[f64; LINKS]> = optional_key(robot, "c_link")?;
    let carts: Option<[f64; ARMS]> = optional_key(robot, "c_cart")?;
    let compliances = match (links, carts) {
        (Some(links), Some(carts)) => Some(Compliances::new(links, carts).map_err(robot_error)?),
        // Only the operations that use them ask for both.
        _ => None,
    };
    Ok(Machine {
        robot: Robot::new(geometry).map_err(robot_error)?,
        compliances,
    })
}

/// A sign; scripts write it as an integer or as a float.
fn branch(key: &str, sign: f64) -> Result<Branch, Failure> {
    if (sign - 1.0).abs() < f64::EPSILON {
        Ok(Branch::Positive)
    } else if (sign + 1.0).abs() < f64::EPSILON {
        Ok(Branch::Negative)
    } else {
        Err(Failure::robot(format!(
            "{key} is {sign}, it must be 1 or -1"
        )))
    }
}

/// A key of the robot.
fn key<T: DeserializeOwned>(robot: &Value, name: &str) -> Result<T, Failure> {
    optional_key(robot, name)?.ok_or_else(|| Failure::robot(format!("{name} is missing")))
}

fn optional_key<T: DeserializeOwned>(robot: &Value, name: &str) -> Result<Option<T>, Failure> {
    optional(robot, name).map_err(Failure::robot)
}

/// A field of the request.
pub(super) fn field<T: DeserializeOwned>(request: &Value, name: &str) -> Result<T, Failure> {
    optional_field(request, name)?.ok_or_else(|| Failure::request(format!("{name} is missing")))
}

/// A field of the request that may be absent or null.
pub(super) fn optional_field<T: DeserializeOwned>(
    request: &Value,
    name: &str,
) -> Result<Option<T>, Failure> {
    optional(request, name).map_err(Failure::request)
}

fn optional<T: DeserializeOwned>(object: &Value, name: &str) -> Result<Option<T>, String> {
    match object.get(name) {
        None | Some(Value::Null) => Ok(None),
        Some(value) => {
            (T::deserialize(value).map(Some)).map_err(|error| format!("{name}: {error}"))
        }
    }
}

/// A matrix from its rows.
pub(super) fn matrix(rows: [[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from(rows).transpose()
}
