//! `model = "f1"`: six axes.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::Vector3;
use serde::{Deserialize, Deserializer};

use super::{
    Axes, Client, Motors, Problem, RobotFile, Sections, Sensor, Simulation, branch, branches, check, compliances,
    robot_problem,
};
use crate::model::F1;

/// The file as TOML states it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileToml {
    /// Read and checked before the rest.
    #[serde(rename = "model")]
    _model: serde::de::IgnoredAny,
    #[serde(rename = "C")]
    c0: [[f64; 3]; ARMS],
    #[serde(rename = "V")]
    v: [[f64; 3]; ARMS],
    #[serde(rename = "P")]
    p: [[f64; 3]; LINKS],
    b: [[f64; 3]; LINKS],
    #[serde(rename = "L", deserialize_with = "lengths")]
    l: [f64; LINKS],
    c: [i64; ARMS],
    ax: [f64; 3],
    ax6: [f64; 3],
    sigma4: i64,
    sigma5: i64,
    c_link: Option<[f64; LINKS]>,
    c_act: Option<[f64; f1::AXES]>,
    axes: Axes<{ f1::AXES }>,
    motors: Motors,
    sensor: Sensor,
    client: Client,
    simulation: Simulation,
}

/// One length per arm, or one per link.
fn lengths<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; LINKS], D::Error> {
    match Vec::deserialize(deserializer)?.as_slice() {
        &[l1, l2, l3] => Ok([l1, l2, l2, l3, l3, l3]),
        &[l11, l21, l22, l31, l32, l33] => Ok([l11, l21, l22, l31, l32, l33]),
        lengths => Err(serde::de::Error::custom(format!(
            "has {} lengths, it must have 3 (one per arm) or 6 (one per link)",
            lengths.len()
        ))),
    }
}

pub(super) fn read(name: &str, text: &str) -> Result<RobotFile<F1, { f1::AXES }>, Problem> {
    let toml: FileToml = toml::from_str(text).map_err(|error| check::syntax(text, &error))?;
    // The screws of the plates have a law of their own.
    let [v1, v2, v3] = toml.v.map(|guideway| Some(Vector3::from(guideway).norm()));
    let travel = check::travel_in_q(&toml.axes, &[v1, v2, v3, None, None, None])?;
    let robot = f1::Robot::new(f1::Geometry {
        carts_m: toml.c0.map(Vector3::from),
        guideways: toml.v.map(Vector3::from),
        plate_joints_m: toml.p.map(Vector3::from),
        platform_joints_m: toml.b.map(Vector3::from),
        lengths_m: toml.l,
        configuration: branches(toml.c)?,
        turn_axis: Vector3::from(toml.ax),
        tilt_axis: Vector3::from(toml.ax6),
        turn_signs: [branch("sigma4", toml.sigma4)?, branch("sigma5", toml.sigma5)?],
        travel: Some(travel),
    })
    .map_err(|error| robot_problem(error, "c_act"))?;
    let springs = compliances(toml.c_link, "c_act", toml.c_act)?;
    let sections = Sections {
        axes: toml.axes,
        motors: toml.motors,
        sensor: toml.sensor,
        client: toml.client,
        simulation: toml.simulation,
    };
    sections.complete(name, F1::new(&robot), springs)
}
