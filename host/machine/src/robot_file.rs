//! Robot files: `robots/*.toml`, read strictly: an unknown or missing key, or a number out of
//! range, is an error that names it.

mod check;
mod configurations;
mod drive_profile;
mod drives;
pub mod edit;
mod ethercat;
mod gauges;
mod keys;
mod learned;
mod masses;
pub mod position_loop;
mod problems;
mod read;
mod sections;

use std::any::Any;
use std::fmt;
use std::path::Path;

use gantry_tau_core::control::position_loop::config::LoopConfig;
use gantry_tau_core::control::session::config::AxisConfig;
use gantry_tau_core::model::robot::{Compliances, LINKS};
use gantry_tau_core::model::{f1, l2};
use gantry_tau_system::lines::read_text;
use gantry_tau_system::output::printable;
use nalgebra::{Matrix3, Vector3};

use crate::drive_cascade::POSITION_GAIN;
use crate::masses::Masses;
pub use crate::model::{CorrectionKind, WristJoint};
use crate::model::{F1, L2, MachineKind};
pub use configurations::CYCLE_US;
pub use drive_profile::{Interface, MAX_DELAY, Profile, RATED_FORCE_N, TORQUE_LIMIT};
pub use drives::DriveKeys;
pub use ethercat::{Clocks, Ethercat, EthercatDrive, EthercatForceSensor, ForceSensorKind};
pub use gauges::{EthercatGauge, MAX_GAUGES, problems_of_gauges};
pub use keys::{F1Keys, Keys, L2Keys};
pub use learned::{Calibrated, Identified, Play};
pub use masses::{DAMPING_RATIO, InertiaKeys};
pub use position_loop::PositionLoopKeys;
pub use problems::{Problem, Problems};
use read::GEOMETRY;
use sections::Sections;
pub use sections::{
    AccelerometerKeys, ClientKeys, DEFAULT_NOTCH_Q, DEFAULT_NOTCHES, FeedForwardKey, FilterKey,
    Motors, Sensor, Simulation, ToolKeys,
};

/// The text of `robots/l2.toml`.
const L2_TEXT: &str = include_str!(concat!(
    env!("CARGO_MANIFEST_DIR"),
    env!("GANTRY_TAU_ROBOTS"),
    "/l2.toml"
));
/// The text of `robots/f1.toml`.
const F1_TEXT: &str = include_str!(concat!(
    env!("CARGO_MANIFEST_DIR"),
    env!("GANTRY_TAU_ROBOTS"),
    "/f1.toml"
));

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
    /// Rated force of each motor of an axis at the drives' metre, N (`axes.torque.rated_n`).
    pub rated_n: Option<[f64; N]>,
    /// `[motors]`.
    pub motors: Motors,
    /// `[sensor]`.
    pub sensor: Sensor,
    /// `[client]`.
    pub client: ClientKeys,
    /// `[drives]`; absent: drives that know no failure, no latency and no encoder.
    pub drives: Option<DriveKeys>,
    /// `[position_loop]`.
    pub position_loop: Option<PositionLoopKeys>,
    /// Position loops of the server, of `[position_loop]` and `[drives]`; absent for drives that
    /// take positions.
    pub position_loops: Option<[LoopConfig; N]>,
    /// `[ethercat]`; absent in a file without a bus.
    pub ethercat: Option<Ethercat>,
    /// `[masses]`; absent: nothing is known of its dynamics.
    pub masses: Option<Masses<N>>,
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

/// Kind of machine, which decides the keys of a file.
enum ModelName {
    L2,
    F1,
}

impl ModelName {
    /// Kind of the built-in machine of this name, `l2` or `f1` in any letter case.
    fn built_in(name: &str) -> Option<Self> {
        match name.to_ascii_lowercase().as_str() {
            "l2" => Some(Self::L2),
            "f1" => Some(Self::F1),
            _ => None,
        }
    }
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
        let text =
            read_text(path, MAX_LEN).map_err(|reason| Problem::new("", reason).in_file(&name))?;
        Self::parse(&name, &text)
    }

    /// Checks a text; `name` stands for the file in errors.
    ///
    /// # Errors
    /// [`RobotFileError`], naming file, key and reason.
    pub fn parse(name: &str, text: &str) -> Result<Self, RobotFileError> {
        Self::checked(name, text).map_err(|problems| problems.into_first().in_file(name))
    }

    /// Checks a text as [`parse`](Self::parse) does, and finds all errors rather than the first. A
    /// section with a value that cannot be read is checked against others once it can.
    ///
    /// # Errors
    /// One or more, in the order of the sections.
    pub fn check(name: &str, text: &str) -> Result<Self, Vec<RobotFileError>> {
        Self::checked(name, text).map_err(|problems| {
            let all = problems.into_all().into_iter();
            all.map(|problem| problem.in_file(name)).collect()
        })
    }

    fn checked(name: &str, text: &str) -> Result<Self, Problems> {
        let kind = read::model(read::parse(text)?.get_ref()).map_err(Problems::from)?;
        Ok(match kind {
            ModelName::L2 => Self::L2(Box::new(RobotFile::checked::<L2Keys>(name, text)?)),
            ModelName::F1 => Self::F1(Box::new(RobotFile::checked::<F1Keys>(name, text)?)),
        })
    }

    /// A machine by its name (`l2` or `f1` in any letter case, built in) or by the path of its
    /// file.
    ///
    /// # Errors
    /// [`RobotFileError`], naming file, key and reason.
    pub fn named(name: &str) -> Result<Self, RobotFileError> {
        match ModelName::built_in(name) {
            Some(ModelName::L2) => Ok(Self::L2(Box::new(RobotFile::builtin_l2()?))),
            Some(ModelName::F1) => Ok(Self::F1(Box::new(RobotFile::builtin_f1()?))),
            None => Self::parse(name, &text_of(name)?),
        }
    }
}

/// Returns the text of a robot file, by its name as of [`AnyRobotFile::named`].
///
/// # Errors
/// [`RobotFileError`], naming file and reason.
pub fn text_of(name: &str) -> Result<String, RobotFileError> {
    match ModelName::built_in(name) {
        Some(ModelName::L2) => return Ok(L2_TEXT.to_owned()),
        Some(ModelName::F1) => return Ok(F1_TEXT.to_owned()),
        None => {}
    }
    let path = Path::new(name);
    read_text(path, MAX_LEN).map_err(|reason| {
        let hint = if path.exists() {
            ""
        } else {
            "; the built-in machines are l2 and f1"
        };
        Problem::new("", format!("{reason}{hint}")).in_file(name)
    })
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
    /// Gain of the drives' position loops, 1/s.
    #[must_use]
    pub fn position_gain_per_s(&self) -> f64 {
        let drives = self.drives.as_ref();
        drives.map_or(POSITION_GAIN, |drives| drives.position_gain_per_s)
    }

    /// Computation of corrections by a client of this machine.
    #[must_use]
    pub fn correction(&self) -> CorrectionKind {
        let usual = if self.identified.is_some() {
            CorrectionKind::Exact
        } else {
            CorrectionKind::FirstOrder
        };
        self.client.correction.unwrap_or(usual)
    }

    /// Home of the tool centre point, world axes, m.
    #[must_use]
    pub fn home_m(&self) -> Vector3<f64> {
        self.simulation.home_m.into()
    }
}

impl<K: MachineKind<N>, const N: usize> RobotFile<K, N> {
    /// Checksum of the kinematics, `metres_per_q` included; the client compares it with the
    /// server's.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        self.model.checksum(&self.metres_per_q)
    }

    /// Checksum of springs and masses, by which two files are told apart that have the same
    /// kinematics; nothing compares it. A file without either has that of no numbers, 0.
    #[must_use]
    pub fn springs_checksum(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        let mut add = |numbers: &[f64]| {
            for number in numbers {
                // -0.0 + 0.0 is +0.0.
                hasher.update(&(number + 0.0).to_bits().to_le_bytes());
            }
        };
        if let Some(compliances) = &self.compliances {
            add(compliances.link_m_per_n());
            add(compliances.cart_m_per_n());
        }
        for joint in &self.wrist {
            add(&joint.axis);
            add(&joint.point_m);
            add(&[joint.c_rad_per_nm]);
        }
        if let Some(masses) = &self.masses {
            for body in [&masses.platform, &masses.tool] {
                add(&[body.mass_kg]);
                add(body.centre_m.as_slice());
                add(body.inertia_kgm2.as_slice());
            }
            add(&masses.links_kg);
            add(&masses.carts_kg);
            add(&masses.plates_kgm2);
            add(&masses.motors_kg);
            add(&[masses.damping_ratio, f64::from(masses.has_weight)]);
        }
        hasher.finalize()
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
        match robot.downcast::<Self>() {
            Ok(robot) => Ok(*robot),
            Err(_) => {
                let reason = format!("is not of the machine's kind, {:?}", K::MODEL);
                Err(Problem::new("", reason).in_file(name))
            }
        }
    }

    /// Reads the text of a machine with the keys `T`.
    fn read<T: Keys<N, Model = K>>(name: &str, text: &str) -> Result<Self, RobotFileError> {
        Self::checked::<T>(name, text).map_err(|problems| problems.into_first().in_file(name))
    }

    /// Reads the text, and finds all errors.
    fn checked<T: Keys<N, Model = K>>(name: &str, text: &str) -> Result<Self, Problems> {
        let mut problems = Problems::default();
        let Some((keys, sections)) = read::tables::<T, N>(text, &mut problems) else {
            return Err(problems);
        };
        let machine = machine(&keys, &sections, &mut problems);
        let drives = check_drives(&sections, &mut problems);
        let masses = check_masses(&sections, &mut problems);
        problems.of(&["masses", "sensor", "client"], |problems| {
            let has_masses = sections.masses.is_some();
            check::filter(&sections.sensor, has_masses, problems);
            check::accelerometer(&sections.sensor, has_masses, problems);
            check::feed_forward(&sections.client, &sections.axes, has_masses, problems);
        });
        check_rest::<T, N>(&sections, machine.as_ref(), &mut problems);
        let (Some(machine), Some(drives), true) = (machine, drives, problems.is_empty()) else {
            return Err(problems);
        };
        Ok(Self {
            name: printable(name),
            model: machine.model,
            compliances: machine.compliances,
            metres_per_q: sections.axes.metres_per_q.0,
            limits: drives.limits,
            rated_n: sections.axes.torque.rated_n.map(|each| each.0),
            motors: sections.motors,
            sensor: sections.sensor,
            client: sections.client,
            drives: sections.drives,
            position_loop: sections.position_loop,
            position_loops: drives.position_loops,
            ethercat: sections.ethercat,
            masses,
            simulation: sections.simulation,
            calibrated: sections.calibrated,
            identified: sections.identified,
            play: sections.play,
            wrist: sections.wrist,
        })
    }
}

/// Kinematics and springs of a file.
struct Machine<K, const N: usize> {
    model: K,
    compliances: Option<Compliances<N>>,
    /// The kinematics know the travel.
    has_travel: bool,
}

/// Checks geometry and springs.
fn machine<T: Keys<N>, const N: usize>(
    keys: &T,
    sections: &Sections<N>,
    problems: &mut Problems,
) -> Option<Machine<T::Model, N>> {
    let travel = problems
        .of(&[GEOMETRY, "axes"], |problems| {
            check::travel_in_q(&sections.axes, &keys.metres_per_q(), problems)
        })
        .flatten();
    problems.of(&[GEOMETRY], |problems| {
        let robot = keys.robot(travel, problems);
        let model = robot.and_then(|robot| problems.keep(T::model(&robot)));
        let has_springs = problems.none_in(|problems| check::springs(keys, problems));
        let compliances = if has_springs {
            problems.keep(keys.compliances())
        } else {
            None
        };
        Some(Machine {
            model: model?,
            compliances: compliances?,
            has_travel: travel.is_some(),
        })
    })?
}

/// Limits of the axes, and position loops of their drives.
struct Driven<const N: usize> {
    limits: [AxisConfig; N],
    position_loops: Option<[LoopConfig; N]>,
}

/// Checks axes, motors and drives.
fn check_drives<const N: usize>(
    sections: &Sections<N>,
    problems: &mut Problems,
) -> Option<Driven<N>> {
    let axes = &sections.axes;
    let motors = &sections.motors;
    let limits = problems
        .of(&["axes"], |problems| check::limits(axes, problems))
        .flatten();
    problems.of(&["motors"], |problems| check::motors(motors, N, problems));
    if let Some(drives) = &sections.drives {
        problems.of(&["drives"], |problems| drives::check(drives, problems));
        problems.of(&["drives", "axes", "motors"], |problems| {
            drives::check_machine(drives, axes, motors, problems);
        });
    }
    let position_loops = problems
        .of(&["drives", "position_loop"], |problems| {
            let section = sections.position_loop.as_ref();
            position_loop::check(
                section,
                sections.drives.as_ref(),
                limits.as_ref()?,
                problems,
            )
        })
        .flatten();
    if let Some(section) = &sections.ethercat {
        problems.of(&["ethercat", "motors"], |problems| {
            let metres_per_q = &axes.metres_per_q.0;
            ethercat::check(section, motors, metres_per_q, limits.as_ref(), problems);
        });
    }
    Some(Driven {
        limits: limits?,
        position_loops,
    })
}

/// Checks the masses, which need those of tool and motors.
fn check_masses<const N: usize>(
    sections: &Sections<N>,
    problems: &mut Problems,
) -> Option<Masses<N>> {
    let keys = sections.masses.as_ref()?;
    problems
        .of(&["masses", "sensor", "motors"], |problems| {
            masses::check(keys, &sections.sensor.tool, &sections.motors, problems)
        })
        .flatten()
}

/// Checks the other sections.
fn check_rest<T: Keys<N>, const N: usize>(
    sections: &Sections<N>,
    machine: Option<&Machine<T::Model, N>>,
    problems: &mut Problems,
) {
    let sensor = &sections.sensor;
    problems.of(&["sensor"], |problems| check::sensor(sensor, problems));
    problems.range("client.gain", sections.client.gain, 0.0, 1.0);
    problems.of(&["simulation"], |problems| {
        check::simulation(&sections.simulation, problems);
    });
    problems.of(&["wrist"], |problems| {
        learned::wrist(&sections.wrist, problems);
    });
    if let Some(calibrated) = &sections.calibrated {
        learned::calibrated(calibrated, T::PARAMETERS, problems);
    }
    if let Some(play) = &sections.play {
        learned::play(play, problems);
    }
    if let Some(identified) = &sections.identified {
        let springs = LINKS + N + sections.wrist.len();
        problems.of(&["wrist"], |problems| {
            learned::identified(identified, springs, problems);
        });
    }
    // Where it is reached within the travel.
    if let Some(machine) = machine.filter(|machine| machine.has_travel) {
        problems.of(&["simulation"], |problems| {
            let home_m = sections.simulation.home_m.into();
            let reached = machine.model.axes_at(&home_m);
            problems.keep(reached.map_err(|error| Problem::new("simulation.home_m", error)))
        });
    }
}

/// A matrix from its rows.
pub fn matrix(rows: [[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from(rows).transpose()
}

#[cfg(test)]
mod tests;
