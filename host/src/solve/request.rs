//! Readers for parts of requests: the inline robot, and named numbers.

use gantry_tau_core::model::kinematics::TAU_TOLERANCE;
use gantry_tau_core::model::robot::{ARMS, Branch, Compliances, LINKS, RobotError};
use gantry_tau_core::model::{f1, l2};
use nalgebra::{Matrix3, Vector3};
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::Failure;

/// A robot of a request.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::large_enum_variant, reason = "a few of them are kept, each for many requests")]
pub(super) enum Machine {
    L2 { robot: l2::Robot, compliances: Option<Compliances<{ l2::AXES }>> },
    F1 { kinematics: f1::Kinematics, compliances: Option<Compliances<{ f1::AXES }>> },
}

/// Reads a robot given as an object; unknown keys are ignored.
pub(super) fn inline(robot: &Value) -> Result<Machine, Failure> {
    match robot.get("model").and_then(Value::as_str) {
        Some("l2") => Ok(Machine::L2 {
            robot: l2::Robot::new(l2(robot)?).map_err(refused)?,
            compliances: compliances(robot, "c_cart")?,
        }),
        Some("f1") => {
            let checked = f1::Robot::new(f1(robot)?).map_err(refused)?;
            Ok(Machine::F1 { kinematics: f1::Kinematics::new(&checked), compliances: compliances(robot, "c_act")? })
        }
        _ => Err(Failure::robot("model must be \"l2\" or \"f1\"")),
    }
}

fn refused(error: RobotError) -> Failure {
    Failure::robot(error.to_string())
}

fn l2(robot: &Value) -> Result<l2::Geometry, Failure> {
    Ok(l2::Geometry {
        cart_joints_m: vectors(robot, "A0")?,
        guideways: vectors(robot, "V")?,
        platform_joints_m: vectors(robot, "b")?,
        lengths_m: arm_lengths(robot)?,
        configuration: l2::Configuration { inverse: branches(robot)?, forward: branch("cf", key(robot, "cf")?)? },
        travel: optional_key(robot, "travel")?,
    })
}

fn f1(robot: &Value) -> Result<f1::Geometry, Failure> {
    let axis = |name| key(robot, name).map(|axis: [f64; 3]| Vector3::from(axis));
    Ok(f1::Geometry {
        carts_m: vectors(robot, "C")?,
        guideways: vectors(robot, "V")?,
        plate_joints_m: vectors(robot, "P")?,
        platform_joints_m: vectors(robot, "b")?,
        lengths_m: lengths(robot)?,
        configuration: branches(robot)?,
        turn_axis: axis("ax")?,
        tilt_axis: axis("ax6")?,
        turn_signs: [branch("sigma4", key(robot, "sigma4")?)?, branch("sigma5", key(robot, "sigma5")?)?],
        travel: optional_key(robot, "travel")?,
    })
}

/// Reads one length per link, or one per arm.
fn lengths(robot: &Value) -> Result<[f64; LINKS], Failure> {
    if robot.get("L").and_then(Value::as_array).map(Vec::len) != Some(ARMS) {
        return key(robot, "L");
    }
    let [l1, l2, l3]: [f64; ARMS] = key(robot, "L")?;
    Ok([l1, l2, l2, l3, l3, l3])
}

/// Reads one length per arm, or one per link where those of a cluster are equal: the Tau property.
fn arm_lengths(robot: &Value) -> Result<[f64; ARMS], Failure> {
    let [l11, l21, l22, l31, l32, l33] = lengths(robot)?;
    let same = |one: f64, other: f64| (one - other).abs() <= TAU_TOLERANCE * one;
    if same(l21, l22) && same(l31, l32) && same(l31, l33) {
        return Ok([l11, l21, l31]);
    }
    Err(Failure::robot("L: the links of a cluster differ, so the machine has no Tau property"))
}

fn vectors<const K: usize>(robot: &Value, name: &str) -> Result<[Vector3<f64>; K], Failure>
where
    [[f64; 3]; K]: DeserializeOwned,
{
    key(robot, name).map(|rows: [[f64; 3]; K]| rows.map(Vector3::from))
}

fn branches(robot: &Value) -> Result<[Branch; ARMS], Failure> {
    let [c1, c2, c3]: [f64; ARMS] = key(robot, "c")?;
    Ok([branch("c[0]", c1)?, branch("c[1]", c2)?, branch("c[2]", c3)?])
}

/// Reads the compliances; `None` unless both are given. The operations that need them ask.
fn compliances<const N: usize>(robot: &Value, axes: &str) -> Result<Option<Compliances<N>>, Failure>
where
    [f64; N]: DeserializeOwned,
{
    let links: Option<[f64; LINKS]> = optional_key(robot, "c_link")?;
    let axes: Option<[f64; N]> = optional_key(robot, axes)?;
    match (links, axes) {
        (Some(links), Some(axes)) => Compliances::new(links, axes).map(Some).map_err(refused),
        _ => Ok(None),
    }
}

/// Reads a sign; scripts write it as an integer or as a float.
fn branch(key: &str, sign: f64) -> Result<Branch, Failure> {
    if (sign - 1.0).abs() < f64::EPSILON {
        Ok(Branch::Positive)
    } else if (sign + 1.0).abs() < f64::EPSILON {
        Ok(Branch::Negative)
    } else {
        Err(Failure::robot(format!("{key} is {sign}; expected 1 or -1")))
    }
}

/// Reads a key of the robot.
fn key<T: DeserializeOwned>(robot: &Value, name: &str) -> Result<T, Failure> {
    optional_key(robot, name)?.ok_or_else(|| Failure::robot(format!("{name} is missing")))
}

fn optional_key<T: DeserializeOwned>(robot: &Value, name: &str) -> Result<Option<T>, Failure> {
    optional(robot, name).map_err(Failure::robot)
}

/// Reads a field of the request.
pub(super) fn field<T: DeserializeOwned>(request: &Value, name: &str) -> Result<T, Failure> {
    optional_field(request, name)?.ok_or_else(|| Failure::request(format!("{name} is missing")))
}

/// Reads a field of the request that may be absent or null.
pub(super) fn optional_field<T: DeserializeOwned>(request: &Value, name: &str) -> Result<Option<T>, Failure> {
    optional(request, name).map_err(Failure::request)
}

fn optional<T: DeserializeOwned>(object: &Value, name: &str) -> Result<Option<T>, String> {
    match object.get(name) {
        None | Some(Value::Null) => Ok(None),
        Some(value) => (T::deserialize(value).map(Some)).map_err(|error| format!("{name}: {error}")),
    }
}

/// Returns a matrix from its rows.
pub(super) fn matrix(rows: [[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from(rows).transpose()
}
