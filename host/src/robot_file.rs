//! Robot files: `robots/*.toml`, read strictly: an unknown or missing key, or a number out of range, is an error that names it.

mod check;

use std::fmt;
use std::path::Path;

use gantry_tau_core::robot::{
    ARMS, Branch, Compliances, Configuration, Geometry, LINKS, Robot, RobotError,
};
use gantry_tau_core::units::PositionNm;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

/// The text of `robots/l2.toml`.
const L2: &str = include_str!("../../robots/l2.toml");

/// A machine as its file describes it, every number checked.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotFile {
    /// What the file is called in messages.
    pub name: String,
    /// The kinematics. Its travel is the nominal travel, in q-units; it has the Tau property with axes parallel to the world's.
    pub robot: Robot,
    /// Compliances of links and carts; absent when the file has none.
    pub compliances: Option<Compliances>,
    /// `[axes]`, as written.
    pub axes: Axes,
    /// `[axes]` in the units of the reference path, one per axis.
    pub limits: [AxisLimits; ARMS],
    /// `[motors]`.
    pub motors: Motors,
    /// `[sensor]`.
    pub sensor: Sensor,
    /// `[client]`.
    pub client: Client,
    /// `[simulation]`.
    pub simulation: Simulation,
}

/// `[axes]`: one entry per axis.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axes {
    /// Where the nominal path may be, `[lower, upper]`, m.
    pub nominal_travel_m: [[f64; 2]; ARMS],
    /// Where the machine may be, `[lower, upper]`, m: wider than the nominal travel by at least the position offset's limit.
    pub machine_travel_m: [[f64; 2]; ARMS],
    /// Length of one unit of `q`, m: `|v_i|`.
    pub metres_per_q: [f64; ARMS],
    /// Largest step of the nominal reference, µm per tick.
    pub nominal_step_um: [f64; ARMS],
    /// Limits of the position offset.
    pub position: PositionSection,
    /// Limits of the velocity offset.
    pub velocity: VelocitySection,
    /// Limits of the torque offset.
    pub torque: TorqueSection,
}

/// `[axes.position]`, µm per tick where a rate; whole nanometres.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionSection {
    /// Largest magnitude, µm; 0 disables the channel.
    pub max_um: [f64; ARMS],
    /// Largest change per tick, µm.
    pub step_um: [f64; ARMS],
    /// Largest change of the change, µm.
    pub accel_um: [f64; ARMS],
    /// Change per tick on the way back to zero, µm.
    pub ramp_um: [f64; ARMS],
}

/// `[axes.velocity]`, µm/s.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocitySection {
    /// Largest magnitude, µm/s; 0 disables the channel.
    pub max_um_s: [i32; ARMS],
    /// Largest change per tick, µm/s.
    pub step_um_s: [i32; ARMS],
    /// Largest change of the change, µm/s.
    pub accel_um_s: [i32; ARMS],
    /// Change per tick on the way back to zero, µm/s.
    pub ramp_um_s: [i32; ARMS],
}

/// `[axes.torque]`, per mille of rated torque.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TorqueSection {
    /// Largest magnitude, ‰; 0 disables the channel.
    pub max_permille: [i16; ARMS],
    /// Largest change per tick, ‰.
    pub step_permille: [i16; ARMS],
    /// Largest change of the change, ‰.
    pub accel_permille: [i16; ARMS],
    /// Change per tick on the way back to zero, ‰.
    pub ramp_permille: [i16; ARMS],
}

/// `[motors]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motors {
    /// Which axis each motor drives, counted from 0; every axis has one.
    pub axis_of_motor: Vec<usize>,
}

/// `[sensor]`: the force sensor on the platform.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// World axes from sensor axes, by rows.
    pub rotation: [[f64; 3]; 3],
    /// From the tool centre point to the sensor's origin, world axes, m.
    pub lever_m: [f64; 3],
    /// Cut-off of the low-pass, Hz.
    pub cutoff_hz: f64,
    /// How many samples the tare averages.
    pub tare_samples: u32,
}

impl Sensor {
    /// World axes from sensor axes.
    #[must_use]
    pub fn rotation_matrix(&self) -> Matrix3<f64> {
        matrix(&self.rotation)
    }
}

/// `[client]`: the compensating client.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Client {
    /// Share of the computed correction that is asked for, 0 to 1.
    pub gain: f64,
}

/// `[simulation]`: the simulated machine.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Simulation {
    /// Seed of deviations and noise.
    pub seed: u64,
    /// Each true compliance is the nominal one times `1 + uniform(-spring_deviation..spring_deviation)`.
    pub spring_deviation: f64,
    /// Standard deviation of the sensor's forces, N.
    pub force_noise_n: f64,
    /// Standard deviation of the sensor's moments, N m.
    pub moment_noise_nm: f64,
    /// One step of the length gauges, m.
    pub gauge_resolution_m: f64,
    /// Force in x at which the platform leaves cart 3, N.
    pub jump_force_n: f64,
    /// The play it crosses then, m.
    pub jump_gap_m: f64,
    /// Home of the tool centre point, world axes, m.
    pub home_m: [f64; 3],
}

/// The four limits of one channel, in the channel's integer unit (nm, µm/s or ‰): `0 <= max`, `0 < ramp <= step`, `step + ramp <= accel`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelLimits {
    /// Largest magnitude; 0 disables the channel.
    pub max: i32,
    /// Largest change per tick.
    pub step: i32,
    /// Largest change of the change.
    pub accel: i32,
    /// Change per tick on the way back to zero.
    pub ramp: i32,
}

/// Everything about one axis, in the units of the reference path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AxisLimits {
    /// Lower and upper end of the nominal travel.
    pub nominal_travel: (PositionNm, PositionNm),
    /// Lower and upper end of the machine's travel.
    pub machine_travel: (PositionNm, PositionNm),
    /// Largest step of the nominal reference per tick, nm.
    pub nominal_step_nm: i64,
    /// Position offset, nm.
    pub position: ChannelLimits,
    /// Velocity offset, µm/s.
    pub velocity: ChannelLimits,
    /// Torque offset, ‰.
    pub torque: ChannelLimits,
}

/// Why a robot file was refused, in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RobotFileError {
    /// Path of the file, or its name.
    pub file: String,
    /// Which key, with its section and index; empty when it concerns the whole file.
    pub key: String,
    /// What is wrong with it.
    pub reason: String,
}

impl fmt::Display for RobotFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.key.is_empty() {
            write!(f, "{}: {}", self.file, self.reason)
        } else {
            write!(f, "{}: {}: {}", self.file, self.key, self.reason)
        }
    }
}

impl std::error::Error for RobotFileError {}

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
    c_cart: Option<[f64; ARMS]>,
    axes: Axes,
    motors: Motors,
    sensor: Sensor,
    client: Client,
    simulation: Simulation,
}

impl RobotFile {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`RobotFileError`], naming file, key and reason.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RobotFileError> {
        let path = path.as_ref();
        let name = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(text) => Self::parse(&name, &text),
            Err(error) => Err(Problem::new("", error.to_string()).in_file(&name)),
        }
    }

    /// Checks a text; `name` stands for the file in errors.
    ///
    /// # Errors
    /// [`RobotFileError`], naming file, key and reason.
    pub fn parse(name: &str, text: &str) -> Result<Self, RobotFileError> {
        read(name, text).map_err(|problem| problem.in_file(name))
    }

    /// The built-in L2, `robots/l2.toml`.
    ///
    /// # Errors
    /// None in a build that passed its tests.
    pub fn builtin_l2() -> Result<Self, RobotFileError> {
        Self::parse("robots/l2.toml (built in)", L2)
    }

    /// CRC-32 of the kinematic part, as [`Robot::kinematics_checksum`].
    #[must_use]
    pub fn kinematics_checksum(&self) -> u32 {
        self.robot.kinematics_checksum()
    }

    /// Home of the tool centre point, world axes, m.
    #[must_use]
    pub fn home_m(&self) -> Vector3<f64> {
        Vector3::from(self.simulation.home_m)
    }
}

/// A key and what is wrong with it; the file's name comes later.
struct Problem {
    key: String,
    reason: String,
}

impl Problem {
    fn new(key: impl Into<String>, reason: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            reason: reason.into(),
        }
    }

    fn in_file(self, file: &str) -> RobotFileError {
        let one_line = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        RobotFileError {
            file: one_line(file),
            key: one_line(&self.key),
            reason: one_line(&self.reason),
        }
    }
}

fn read(name: &str, text: &str) -> Result<RobotFile, Problem> {
    check::model(text)?;
    let toml: FileToml = toml::from_str(text).map_err(|error| check::syntax(text, &error))?;
    let travel = check::travel_in_q(&toml.axes, &toml.v)?;
    let robot = Robot::new(Geometry {
        cart_joints_m: toml.a0.map(Vector3::from),
        guideways: toml.v.map(Vector3::from),
        platform_joints_m: toml.b.map(Vector3::from),
        lengths_m: toml.l,
        configuration: Configuration {
            inverse: [
                branch("c[0]", toml.c[0])?,
                branch("c[1]", toml.c[1])?,
                branch("c[2]", toml.c[2])?,
            ],
            forward: branch("cf", toml.cf)?,
        },
        travel: Some(travel),
    })
    .map_err(robot_problem)?;
    let compliances = match (toml.c_link, toml.c_cart) {
        (Some(link), Some(cart)) => Some(Compliances::new(link, cart).map_err(robot_problem)?),
        (None, None) => None,
        (None, Some(_)) => return Err(Problem::new("c_link", "is missing beside c_cart")),
        (Some(_), None) => return Err(Problem::new("c_cart", "is missing beside c_link")),
    };
    let limits = check::limits(&toml.axes)?;
    check::motors(&toml.motors)?;
    check::sensor(&toml.sensor)?;
    check::range("client.gain", toml.client.gain, 0.0, 1.0)?;
    check::simulation(&toml.simulation, &robot)?;
    Ok(RobotFile {
        name: name.to_owned(),
        robot,
        compliances,
        axes: toml.axes,
        limits,
        motors: toml.motors,
        sensor: toml.sensor,
        client: toml.client,
        simulation: toml.simulation,
    })
}

/// The sign that chooses a branch.
fn branch(key: &str, sign: i64) -> Result<Branch, Problem> {
    match sign {
        1 => Ok(Branch::Positive),
        -1 => Ok(Branch::Negative),
        _ => Err(Problem::new(key, format!("is {sign}, it must be 1 or -1"))),
    }
}

/// Splits core's error into key and reason.
fn robot_problem(error: RobotError) -> Problem {
    let (RobotError::NotFinite { parameter, index }
    | RobotError::OutOfRange {
        parameter, index, ..
    }
    | RobotError::Reversed { parameter, index }) = error;
    let key = format!("{}[{index}]", parameter.key());
    let text = error.to_string();
    let reason = text.strip_prefix(&key).unwrap_or(&text).trim_start();
    Problem::new(key, reason)
}

/// A matrix from its rows.
fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| {
        rows.get(row)
            .and_then(|row| row.get(column))
            .copied()
            .unwrap_or(f64::NAN)
    })
}

#[cfg(test)]
mod tests;
