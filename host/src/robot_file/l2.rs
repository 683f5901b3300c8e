//! `model = "l2"`: three axes.

use gantry_tau_core::model::l2;
use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::Vector3;
use serde::Deserialize;

use super::{
    Axes, Client, Motors, Problem, RobotFile, Sections, Sensor, Simulation, branch, branches, check, compliances,
    robot_problem,
};
use crate::model::L2;

/// The file as TOML states it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileToml {
    /// Read and checked before the rest.
    #[serde(rename = "model")]
    _model: serde::de::IgnoredAny,
    #[serde(rename = "A0")]
    a0: [[f64; 3]; LINKS],
    #[serde(rename = "V")]
    v: [[f64; 3]; ARMS],
    b: [[f64; 3]; LINKS],
    #[serde(rename = "L")]
    l: [f64; ARMS],
    c: [i64; ARMS],
    cf: i64,
    c_link: Option<[f64; LINKS]>,
    c_cart: Option<[f64; l2::AXES]>,
    axes: Axes<{ l2::AXES }>,
    motors: Motors,
    sensor: Sensor,
    client: Client,
    simulation: Simulation,
}

pub(super) fn read(name: &str, text: &str) -> Result<RobotFile<L2, { l2::AXES }>, Problem> {
    let toml: FileToml = toml::from_str(text).map_err(|error| check::syntax(text, &error))?;
    let scales = toml.v.map(|guideway| Some(Vector3::from(guideway).norm()));
    let travel = check::travel_in_q(&toml.axes, &scales)?;
    let robot = l2::Robot::new(l2::Geometry {
        cart_joints_m: toml.a0.map(Vector3::from),
        guideways: toml.v.map(Vector3::from),
        platform_joints_m: toml.b.map(Vector3::from),
        lengths_m: toml.l,
        configuration: l2::Configuration { inverse: branches(toml.c)?, forward: branch("cf", toml.cf)? },
        travel: Some(travel),
    })
    .map_err(|error| robot_problem(error, "c_cart"))?;
    let model = L2::new(&robot).map_err(|error| Problem::new("A0", error.to_string()))?;
    let springs = compliances(toml.c_link, "c_cart", toml.c_cart)?;
    let sections = Sections {
        axes: toml.axes,
        motors: toml.motors,
        sensor: toml.sensor,
        client: toml.client,
        simulation: toml.simulation,
    };
    sections.complete(name, model, springs)
}
