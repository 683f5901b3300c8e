//! Robot files: `robots/*.toml`, read strictly: an unknown or missing key, or a number out of range, is an error that names it.

mod build;
mod check;
mod f1;
mod l2;
mod sections;

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use gantry_tau_core::model::robot::{ARMS, Branch, Compliances, LINKS, Parameter, RobotError};
use gantry_tau_core::model::{f1 as core_f1, l2 as core_l2};
use nalgebra::{Matrix3, Vector3};

use crate::model::{F1, L2, MachineKind};
pub use build::CYCLE_US;
use check::Kind;
pub use sections::{
    Axes, AxisLimits, ChannelLimits, Client, Motors, PositionSection, Sensor, Simulation, TorqueSection,
    VelocitySection,
};

/// The text of `robots/l2.toml`.
const L2_TEXT: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), env!("GANTRY_TAU_ROBOTS"), "/l2.toml"));
/// The text of `robots/f1.toml`.
const F1_TEXT: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), env!("GANTRY_TAU_ROBOTS"), "/f1.toml"));

/// Longest robot file that is read, bytes.
const MAX_LEN: u64 = 1 << 20;

/// A machine with `N` axes as its file describes it, every number checked.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotFile<K, const N: usize> {
    /// Name of the file in messages.
    pub name: String,
    /// The kinematics. Its travel is the nominal travel, in q-units.
    pub model: K,
    /// Compliances of links and axes; absent when the file has none.
    pub compliances: Option<Compliances<N>>,
    /// `[axes]`, as written.
    pub axes: Axes<N>,
    /// `[axes]` in the units of the reference path, one per axis.
    pub limits: [AxisLimits; N],
    /// `[motors]`.
    pub motors: Motors,
    /// `[sensor]`.
    pub sensor: Sensor,
    /// `[client]`.
    pub client: Client,
    /// `[simulation]`.
    pub simulation: Simulation,
}

/// A machine of either kind.
#[derive(Clone, Debug, PartialEq)]
pub enum AnyRobotFile {
    /// `model = "l2"`: three axes.
    L2(Box<RobotFile<L2, { core_l2::AXES }>>),
    /// `model = "f1"`: six axes.
    F1(Box<RobotFile<F1, { core_f1::AXES }>>),
}

/// Error of a robot file, in one line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RobotFileError {
    /// Path of the file, or its name.
    pub file: String,
    /// Key, with its section and index; empty when the error concerns the whole file.
    pub key: String,
    /// Description of the error.
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

impl AnyRobotFile {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// [`RobotFileError`], naming file, key and reason.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, RobotFileError> {
        let path = path.as_ref();
        let name = path.display().to_string();
        let text = read_text(path).map_err(|reason| Problem::new("", reason).in_file(&name))?;
        Self::parse(&name, &text)
    }

    /// Checks a text; `name` stands for the file in errors.
    ///
    /// # Errors
    /// [`RobotFileError`], naming file, key and reason.
    pub fn parse(name: &str, text: &str) -> Result<Self, RobotFileError> {
        let kind = check::model(text).map_err(|problem| problem.in_file(name))?;
        Ok(match kind {
            Kind::L2 => Self::L2(Box::new(RobotFile::l2(name, text)?)),
            Kind::F1 => Self::F1(Box::new(RobotFile::f1(name, text)?)),
        })
    }

    /// A machine by its name (`l2` or `f1`, built in) or by the path of its file.
    ///
    /// # Errors
    /// [`RobotFileError`], naming file, key and reason.
    pub fn named(name: &str) -> Result<Self, RobotFileError> {
        match name {
            "l2" => Ok(Self::L2(Box::new(RobotFile::builtin_l2()?))),
            "f1" => Ok(Self::F1(Box::new(RobotFile::builtin_f1()?))),
            path => Self::load(path),
        }
    }
}

/// Reads at most [`MAX_LEN`] bytes, so a device file cannot hang.
fn read_text(path: &Path) -> Result<String, String> {
    let file = File::open(path).map_err(|error| error.to_string())?;
    let mut text = String::new();
    let limited = &mut file.take(MAX_LEN + 1);
    let length = (limited.read_to_string(&mut text)).map_err(|error| error.to_string())?;
    if u64::try_from(length).is_ok_and(|length| length <= MAX_LEN) {
        Ok(text)
    } else {
        Err(format!("is longer than {MAX_LEN} bytes"))
    }
}

impl RobotFile<L2, { core_l2::AXES }> {
    /// The built-in L2, `robots/l2.toml`.
    ///
    /// # Errors
    /// None in a build that passed its tests.
    pub fn builtin_l2() -> Result<Self, RobotFileError> {
        Self::l2("robots/l2.toml (built in)", L2_TEXT)
    }

    fn l2(name: &str, text: &str) -> Result<Self, RobotFileError> {
        l2::read(name, text).map_err(|problem| problem.in_file(name))
    }
}

impl RobotFile<F1, { core_f1::AXES }> {
    /// The built-in F1, `robots/f1.toml`.
    ///
    /// # Errors
    /// None in a build that passed its tests.
    pub fn builtin_f1() -> Result<Self, RobotFileError> {
        Self::f1("robots/f1.toml (built in)", F1_TEXT)
    }

    fn f1(name: &str, text: &str) -> Result<Self, RobotFileError> {
        f1::read(name, text).map_err(|problem| problem.in_file(name))
    }
}

impl<K, const N: usize> RobotFile<K, N> {
    /// Home of the tool centre point, world axes, m.
    #[must_use]
    pub fn home_m(&self) -> Vector3<f64> {
        Vector3::from(self.simulation.home_m)
    }
}

/// Sections of every kind of machine.
struct Sections<const N: usize> {
    axes: Axes<N>,
    motors: Motors,
    sensor: Sensor,
    client: Client,
    simulation: Simulation,
}

impl<const N: usize> Sections<N> {
    /// Checks the sections against the machine.
    fn complete<K: MachineKind<N>>(
        self,
        name: &str,
        model: K,
        compliances: Option<Compliances<N>>,
    ) -> Result<RobotFile<K, N>, Problem> {
        let limits = check::limits(&self.axes)?;
        check::motors(&self.motors, N)?;
        check::sensor(&self.sensor)?;
        check::range("client.gain", self.client.gain, 0.0, 1.0)?;
        check::simulation(&self.simulation)?;
        (model.axes_at(&Vector3::from(self.simulation.home_m)))
            .map_err(|error| Problem::new("simulation.home_m", error.to_string()))?;
        Ok(RobotFile {
            name: name.to_owned(),
            model,
            compliances,
            axes: self.axes,
            limits,
            motors: self.motors,
            sensor: self.sensor,
            client: self.client,
            simulation: self.simulation,
        })
    }
}

/// Compliances of the links and of the axes (under `key`): both, or neither.
fn compliances<const N: usize>(
    links: Option<[f64; LINKS]>,
    key: &str,
    axes: Option<[f64; N]>,
) -> Result<Option<Compliances<N>>, Problem> {
    match (links, axes) {
        (Some(links), Some(axes)) => match Compliances::new(links, axes) {
            Ok(compliances) => Ok(Some(compliances)),
            Err(error) => Err(robot_problem(error, key)),
        },
        (None, None) => Ok(None),
        (None, Some(_)) => Err(Problem::new("c_link", format!("is missing beside {key}"))),
        (Some(_), None) => Err(Problem::new(key, "is missing beside c_link")),
    }
}

/// The branches of the three arms.
fn branches(signs: [i64; ARMS]) -> Result<[Branch; ARMS], Problem> {
    let [c1, c2, c3] = signs;
    Ok([branch("c[0]", c1)?, branch("c[1]", c2)?, branch("c[2]", c3)?])
}

/// Key and description of an error; the file's name is added later.
struct Problem {
    key: String,
    reason: String,
}

impl Problem {
    fn new(key: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { key: key.into(), reason: reason.into() }
    }

    fn in_file(self, file: &str) -> RobotFileError {
        let one_line = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        RobotFileError { file: one_line(file), key: one_line(&self.key), reason: one_line(&self.reason) }
    }
}

/// Branch of a sign.
fn branch(key: &str, sign: i64) -> Result<Branch, Problem> {
    match sign {
        1 => Ok(Branch::Positive),
        -1 => Ok(Branch::Negative),
        _ => Err(Problem::new(key, format!("is {sign}; expected 1 or -1"))),
    }
}

/// Splits core's error into key and reason. Compliances of axes stand under `axes_key`.
fn robot_problem(error: RobotError, axes_key: &str) -> Problem {
    let (RobotError::NotFinite { parameter, index }
    | RobotError::OutOfRange { parameter, index, .. }
    | RobotError::Reversed { parameter, index }) = error;
    let said = format!("{}[{index}]", parameter.key());
    let text = error.to_string();
    let reason = text.strip_prefix(&said).unwrap_or(&text).trim_start();
    let key = match parameter {
        Parameter::CartCompliance => format!("{axes_key}[{index}]"),
        _ => said.clone(),
    };
    Problem::new(key, reason)
}

/// A matrix from its rows.
fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| rows.get(row).and_then(|row| row.get(column)).copied().unwrap_or(f64::NAN))
}

#[cfg(test)]
mod tests;
