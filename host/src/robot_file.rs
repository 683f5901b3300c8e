//! Robot files: `robots/*.toml`, read strictly: an unknown or missing key, or a number out of range, is an error that names it.

mod build;
mod check;
mod drives;
pub mod edit;
mod ethercat;
mod keys;
mod learned;
pub mod position_loop;
mod sections;

use std::any::Any;
use std::fmt;
use std::path::Path;

use gantry_tau_core::control::position_loop::config::LoopConfig;
use gantry_tau_core::control::session::config::AxisConfig;
use gantry_tau_core::model::robot::{Compliances, LINKS};
use gantry_tau_core::model::{f1, l2};
use nalgebra::{Matrix3, Vector3};

use crate::lines::read_text;
use crate::model::{F1, L2, MachineKind};
use crate::output::printable;
pub use build::CYCLE_US;
use check::Kind;
pub use drives::Drives;
pub use ethercat::{Ethercat, EthercatDrive};
pub(crate) use keys::{F1Keys, Keys, L2Keys};
pub use learned::{Calibrated, Identified, Play, WristJoint};
pub use position_loop::PositionLoopKeys;
pub use sections::{Client, CorrectionKind, Motors, Sensor, Simulation, Tool};

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
    /// Length of one unit of each `q`, m: `|v_i|` of a cart.
    pub metres_per_q: [f64; N],
    /// `[axes]` in the units of the reference path.
    pub limits: [AxisConfig; N],
    /// `[motors]`.
    pub motors: Motors,
    /// `[sensor]`.
    pub sensor: Sensor,
    /// `[client]`.
    pub client: Client,
    /// `[drives]`; absent: drives that know no failure, no latency and no encoder.
    pub drives: Option<Drives>,
    /// `[position_loop]`.
    pub position_loop: Option<PositionLoopKeys>,
    /// Position loops of the server, of `[position_loop]` and `[drives]`; absent for drives that take positions.
    pub position_loops: Option<[LoopConfig; N]>,
    /// `[ethercat]`; absent in a file without a bus.
    pub ethercat: Option<Ethercat>,
    /// `[simulation]`.
    pub simulation: Simulation,
    /// `[calibrated]`; absent in a file that was not calibrated.
    pub calibrated: Option<Calibrated>,
    /// `[identified]`; absent in a file whose springs were not measured.
    pub identified: Option<Identified>,
    /// `[play]`; absent where none was found.
    pub play: Option<Play>,
    /// `[[wrist]]`, from the platform to the tool.
    pub wrist: Vec<WristJoint>,
}

/// A machine of either kind.
#[derive(Clone, Debug, PartialEq)]
pub enum AnyRobotFile {
    /// `model = "l2"`: three axes.
    L2(Box<RobotFile<L2, { l2::AXES }>>),
    /// `model = "f1"`: six axes.
    F1(Box<RobotFile<F1, { f1::AXES }>>),
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
        let text = read_text(path, MAX_LEN).map_err(|reason| Problem::new("", reason).in_file(&name))?;
        Self::parse(&name, &text)
    }

    /// Checks a text; `name` stands for the file in errors.
    ///
    /// # Errors
    /// [`RobotFileError`], naming file, key and reason.
    pub fn parse(name: &str, text: &str) -> Result<Self, RobotFileError> {
        let kind = check::model(text).map_err(|problem| problem.in_file(name))?;
        Ok(match kind {
            Kind::L2 => Self::L2(Box::new(RobotFile::read::<L2Keys>(name, text)?)),
            Kind::F1 => Self::F1(Box::new(RobotFile::read::<F1Keys>(name, text)?)),
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

/// Returns the text of a robot file, by its name as of [`AnyRobotFile::named`].
///
/// # Errors
/// [`RobotFileError`], naming file and reason.
pub fn text_of(name: &str) -> Result<String, RobotFileError> {
    match name {
        "l2" => Ok(L2_TEXT.to_owned()),
        "f1" => Ok(F1_TEXT.to_owned()),
        path => read_text(Path::new(path), MAX_LEN).map_err(|reason| Problem::new("", reason).in_file(path)),
    }
}

impl RobotFile<L2, { l2::AXES }> {
    /// The built-in L2, `robots/l2.toml`.
    ///
    /// # Errors
    /// None in a build that passed its tests.
    pub fn builtin_l2() -> Result<Self, RobotFileError> {
        Self::read::<L2Keys>("robots/l2.toml (built in)", L2_TEXT)
    }
}

impl RobotFile<F1, { f1::AXES }> {
    /// The built-in F1, `robots/f1.toml`.
    ///
    /// # Errors
    /// None in a build that passed its tests.
    pub fn builtin_f1() -> Result<Self, RobotFileError> {
        Self::read::<F1Keys>("robots/f1.toml (built in)", F1_TEXT)
    }
}

impl<K, const N: usize> RobotFile<K, N> {
    /// Computation of corrections by a client of this machine.
    #[must_use]
    pub fn correction(&self) -> CorrectionKind {
        let usual = if self.identified.is_some() { CorrectionKind::Exact } else { CorrectionKind::FirstOrder };
        self.client.correction.unwrap_or(usual)
    }

    /// Home of the tool centre point, world axes, m.
    #[must_use]
    pub fn home_m(&self) -> Vector3<f64> {
        self.simulation.home_m.into()
    }
}

impl<K: MachineKind<N>, const N: usize> RobotFile<K, N> {
    /// Checksum of the kinematics, `metres_per_q` included; the client compares it with the server's.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        self.model.checksum(&self.metres_per_q)
    }

    /// A machine of this kind, as of [`AnyRobotFile::named`].
    ///
    /// # Errors
    /// [`RobotFileError`]: that of the file, or that it is of the other kind.
    pub fn named(name: &str) -> Result<Self, RobotFileError> {
        let robot: Box<dyn Any> = match AnyRobotFile::named(name)? {
            AnyRobotFile::L2(robot) => robot,
            AnyRobotFile::F1(robot) => robot,
        };
        let other = || Problem::new("model", format!("is not {:?}, that of the machine", K::MODEL)).in_file(name);
        robot.downcast::<Self>().map(|robot| *robot).map_err(|_| other())
    }

    /// Reads the text of a machine with the keys `T`.
    fn read<T: Keys<N, Model = K>>(name: &str, text: &str) -> Result<Self, RobotFileError> {
        Self::checked::<T>(name, text).map_err(|problem| problem.in_file(name))
    }

    fn checked<T: Keys<N, Model = K>>(name: &str, text: &str) -> Result<Self, Problem> {
        let (keys, sections) = check::tables::<T, N>(text)?;
        let travel = check::travel_in_q(&sections.axes, &keys.metres_per_q())?;
        let model = T::model(&keys.robot(Some(travel))?)?;
        check::springs(&keys)?;
        let compliances = keys.compliances()?;
        let limits = check::limits(&sections.axes)?;
        check::motors(&sections.motors, N)?;
        if let Some(drives) = &sections.drives {
            drives::check(drives, &sections.axes, &sections.motors)?;
        }
        let position_loops = position_loop::check(sections.position_loop.as_ref(), sections.drives.as_ref(), &limits)?;
        if let Some(section) = &sections.ethercat {
            ethercat::check(section, &sections.motors, &sections.axes.metres_per_q.0, &limits)?;
        }
        check::sensor(&sections.sensor)?;
        check::range("client.gain", sections.client.gain, 0.0, 1.0)?;
        check::simulation(&sections.simulation)?;
        learned::wrist(&sections.wrist)?;
        sections.calibrated.as_ref().map_or(Ok(()), |section| learned::calibrated(section, T::PARAMETERS))?;
        sections.play.as_ref().map_or(Ok(()), learned::play)?;
        if let Some(identified) = &sections.identified {
            learned::identified(identified, LINKS + N + sections.wrist.len())?;
        }
        (model.axes_at(&sections.simulation.home_m.into()))
            .map_err(|error| Problem::new("simulation.home_m", error))?;
        Ok(Self {
            name: printable(name),
            model,
            compliances,
            metres_per_q: sections.axes.metres_per_q.0,
            limits,
            motors: sections.motors,
            sensor: sections.sensor,
            client: sections.client,
            drives: sections.drives,
            position_loop: sections.position_loop,
            position_loops,
            ethercat: sections.ethercat,
            simulation: sections.simulation,
            calibrated: sections.calibrated,
            identified: sections.identified,
            play: sections.play,
            wrist: sections.wrist,
        })
    }
}

/// Key and description of an error; the file's name is added later.
pub(crate) struct Problem {
    pub(crate) key: String,
    pub(crate) reason: String,
}

impl Problem {
    fn new(key: impl Into<String>, reason: impl ToString) -> Self {
        Self { key: key.into(), reason: reason.to_string() }
    }

    fn in_file(self, file: &str) -> RobotFileError {
        let one_line = |text: &str| printable(&text.split_whitespace().collect::<Vec<_>>().join(" "));
        RobotFileError { file: one_line(file), key: one_line(&self.key), reason: one_line(&self.reason) }
    }
}

/// A matrix from its rows.
pub(crate) fn matrix(rows: [[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from(rows).transpose()
}

#[cfg(test)]
mod tests;
