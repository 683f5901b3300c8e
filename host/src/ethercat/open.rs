//! From a robot file to a bus in SAFE-OP.

use gantry_tau_core::control::axis::{InForce, Offsets};
use gantry_tau_core::units::PositionNm;
use gantry_tau_ethercat::{BringUpError, DriveConfig, Drives, Initial, Place, Settings};

use super::plant::{EthercatPlant, Machine, Motor};
use super::standing::{APART_NM, axis_position, offsets_of};
use crate::model::MachineKind;
use crate::robot_file::{Ethercat, EthercatDrive, RobotFile};
use crate::sim::interpolator::Interpolator;
use crate::sim::parameters::Motion;

/// Longest wait for the answer of a cycle, µs: half of it.
const ANSWER_US: u32 = 500;

/// Error of a bus.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EthercatError {
    /// The robot file has no drives.
    #[error("{file}: ethercat: is missing; list the drive of each motor in [[ethercat.drives]]")]
    NoSection {
        /// The robot file.
        file: String,
    },
    /// The bus is not that of the file.
    #[error("{file}: {key}: {error}")]
    BringUp {
        /// The robot file.
        file: String,
        /// Key that does not fit, or the section.
        key: String,
        /// Error of the bring-up.
        error: BringUpError,
    },
    /// The drives are not where the machine can be, or disagree.
    #[error("{file}: {key}: {reason}")]
    Drives {
        /// The robot file.
        file: String,
        /// Key that does not fit.
        key: String,
        /// The reason.
        reason: String,
    },
    /// Another file or number does not fit.
    #[error("{0}")]
    Other(String),
}

/// Returns the key of the robot file that an error of the bus concerns.
fn key(error: &BringUpError) -> String {
    let of = |motor: u8, name: &str| format!("ethercat.drives[{motor}].{name}");
    let of_place = |motor: u8, place: &Place| match place {
        Place::Alias(_) => of(motor, "alias"),
        Place::Position(_) => of(motor, "position"),
    };
    match error {
        BringUpError::Missing { motor, place, .. } | BringUpError::Ambiguous { motor, place } => {
            of_place(*motor, place)
        }
        BringUpError::Identity { motor, vendor, found_vendor, .. } if vendor != found_vendor => of(*motor, "vendor"),
        BringUpError::Identity { motor, .. } => of(*motor, "product"),
        BringUpError::Serial { motor, .. } => of(*motor, "serial"),
        BringUpError::Encoder { motor, .. } | BringUpError::MissingObject { motor, object: 0x608F, .. } => {
            of(*motor, "counts_per_turn")
        }
        BringUpError::MissingObject { object: 0x60B1, .. } => "axes.velocity.max_um_s".to_owned(),
        BringUpError::MissingObject { object: 0x60B2, .. } => "axes.torque.max_permille".to_owned(),
        BringUpError::SoftwareLimits { .. } => "axes.machine_travel_m".to_owned(),
        BringUpError::Watchdog { .. } | BringUpError::WatchdogTime { .. } | BringUpError::WatchdogOff { .. } => {
            "ethercat.watchdog_cycles".to_owned()
        }
        BringUpError::MissingObject { motor, .. }
        | BringUpError::Refused { motor, .. }
        | BringUpError::Exchange { motor, .. } => format!("ethercat.drives[{motor}]"),
        BringUpError::Silent
        | BringUpError::TooMany
        | BringUpError::Bus { .. }
        | BringUpError::Overdue { .. }
        | BringUpError::Unhandled => "ethercat".to_owned(),
    }
}

/// Returns the expectations of a drive.
fn config(
    drive: &EthercatDrive,
    motor: &Motor,
    axis: &gantry_tau_core::control::session::config::AxisConfig,
) -> DriveConfig {
    let travel = axis.machine_travel;
    let ends = [travel.lower, travel.upper].map(|end| motor.scale.counts(end).unwrap_or(0));
    DriveConfig {
        place: match (drive.alias, drive.position) {
            (Some(alias), _) => Place::Alias(alias),
            (None, position) => Place::Position(position.unwrap_or(0)),
        },
        vendor: drive.vendor,
        product: drive.product,
        serial: drive.serial,
        counts_per_turn: drive.counts_per_turn,
        travel: (ends[0].min(ends[1]), ends[0].max(ends[1])),
        needs_velocity_offset: axis.limits.velocity.max() > 0,
        needs_torque_offset: axis.limits.torque.max() > 0,
    }
}

impl<W: Machine<N>, const N: usize, const M: usize> EthercatPlant<W, N, M> {
    /// Opens the bus of a robot file, up to SAFE-OP; [`Plant::start`](crate::plant::Plant::start) enables the drives.
    /// `motion` gets the positions at which the axes stand, m.
    ///
    /// # Errors
    /// [`EthercatError`]: another bus than the file's, drives whose objects or limits do not fit, or that stand where the machine cannot be.
    pub fn open<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        section: &Ethercat,
        wire: W,
        motion: impl FnOnce([f64; N]) -> Motion<N>,
    ) -> Result<Self, EthercatError> {
        let other = |error: &dyn std::fmt::Display| EthercatError::Other(error.to_string());
        let map = robot.motor_map::<M>().map_err(|error| other(&error))?;
        let mut motors = Vec::new();
        let mut configs = Vec::new();
        for (drive, &axis) in section.drives.iter().zip(map.axis_of_motor()) {
            let (Some(metres), Some(limits)) = (robot.metres_per_q.get(axis), robot.limits.get(axis)) else { continue };
            let Some(scale) = drive.scale(*metres) else { continue };
            let motor = Motor { axis, scale, velocity_unit: drive.velocity_unit_counts_per_s };
            configs.push(config(drive, &motor, limits));
            motors.push(motor);
        }
        let (Ok(motors), Ok(configs)) = (<[Motor; M]>::try_from(motors), <[DriveConfig; M]>::try_from(configs)) else {
            return Err(EthercatError::NoSection { file: robot.name.clone() });
        };
        let settings =
            Settings { cycle_us: section.cycle_us, watchdog_cycles: section.watchdog_cycles, answer_us: ANSWER_US };
        let drives = Drives::bring_up(wire, &configs, settings).map_err(|error| EthercatError::BringUp {
            file: robot.name.clone(),
            key: key(&error),
            error,
        })?;
        let in_force = in_force(robot, &motors, &drives.initial())?;
        let nominal = in_force.map(|in_force| in_force.nominal);
        let path =
            Interpolator::new(nominal.map(metres), &motion(nominal.map(metres))).map_err(|error| other(&error))?;
        Ok(Self {
            drives,
            motors,
            path,
            taken: true,
            held: false,
            nominal,
            in_force,
            sent: in_force,
            last: Ok(()),
            failure: None,
            refusal: None,
            travel: robot.limits.map(|limits| limits.machine_travel),
            faults: None,
        })
    }
}

fn metres(position: PositionNm) -> f64 {
    position.to_metres().0
}

/// Returns what the axes have in force: the offsets of their drives, and the nominal references that put them where the motors stand.
fn in_force<K, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    motors: &[Motor; M],
    initial: &[Initial; M],
) -> Result<[InForce; N], EthercatError> {
    let refuse = |key: String, reason: String| EthercatError::Drives { file: robot.name.clone(), key, reason };
    let mut all = [InForce::at(PositionNm(0)); N];
    for (axis, (in_force, limits)) in all.iter_mut().zip(&robot.limits).enumerate() {
        let own = || motors.iter().zip(initial).enumerate().filter(move |(_, (motor, _))| motor.axis == axis);
        let counts = |motor: usize| initial.get(motor).map_or(0, |initial| initial.position);
        let key = own().next().map_or_else(String::new, |(motor, _)| format!("ethercat.drives[{motor}]"));
        let Some((position, apart_nm)) = axis_position(axis, motors, counts) else {
            return Err(refuse(key, "the drive's position is out of range".to_owned()));
        };
        if apart_nm > APART_NM {
            let reason = format!(
                "the motors of axis {axis} stand {} um apart; are counts_per_q, sign and zero_counts right?",
                apart_nm / 1_000
            );
            return Err(refuse(key, reason));
        }
        let travel = limits.machine_travel;
        if position < travel.lower || position > travel.upper {
            let reason = format!(
                "the drive stands at {:.6} m, outside the travel of {} to {} m; are counts_per_q, sign and zero_counts right?",
                metres(position),
                metres(travel.lower),
                metres(travel.upper)
            );
            return Err(refuse(key, reason));
        }
        let mut offsets = None::<Offsets>;
        for (motor, (units, initial)) in own() {
            let found = offsets_of(units, initial).ok_or_else(|| {
                refuse(format!("ethercat.drives[{motor}]"), "its offsets are out of range".to_owned())
            })?;
            // Counts of two drives round the same offset differently.
            let differs = offsets.is_some_and(|first| {
                (i64::from(first.position.0) - i64::from(found.position.0)).abs() > 1_000
                    || (i64::from(first.velocity.0) - i64::from(found.velocity.0)).abs() > 1_000
                    || first.torque != found.torque
            });
            if differs {
                let reason =
                    format!("the drives of axis {axis} have different offsets in force; set 60B0h to 60B2h to 0");
                return Err(refuse(format!("ethercat.drives[{motor}]"), reason));
            }
            offsets = offsets.or(Some(found));
        }
        let offsets = offsets.unwrap_or_default();
        *in_force = InForce { nominal: PositionNm(position.0.saturating_sub(offsets.position.0.into())), offsets };
    }
    Ok(all)
}
