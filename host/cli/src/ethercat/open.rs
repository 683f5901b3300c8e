//! From a robot file to a bus in SAFE-OP.

use gantry_tau_core::control::axis::{InForce, Offsets};
use gantry_tau_core::control::session::config::AxisConfig;
use gantry_tau_core::units::PositionNm;
use gantry_tau_ethercat::{
    BringUpError, ClockSettings, DevicePlace, DriveConfig, Drives, Extras, ForceSensorConfig,
    GaugeConfig, Initial, Settings,
};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{
    Clocks, Ethercat, EthercatDrive, EthercatForceSensor, RobotFile,
};
use gantry_tau_server::plant::interpolator::Interpolator;
use gantry_tau_server::plant::interpolator::Motion;

use super::bus_reports::BusReports;
use super::gauge_link::GaugeLink;
use super::initial_state::{APART_NM, axis_position, offsets_of};
use super::places::{gauge_configs, place};
use super::plant::{DriveMotor, EthercatPlant, MachineWire};

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

impl EthercatError {
    /// Error of another kind.
    pub(super) fn other(error: impl std::fmt::Display) -> Self {
        Self::Other(error.to_string())
    }
}

/// Returns a key of a motor's drive.
fn of_drive(motor: u8, name: &str) -> String {
    format!("ethercat.drives[{motor}].{name}")
}

/// Returns the key of the robot file that an error of the bus concerns.
fn key(error: &BringUpError) -> String {
    match error {
        BringUpError::Missing { motor, place, .. } | BringUpError::Ambiguous { motor, place } => {
            match place {
                DevicePlace::Alias(_) => of_drive(*motor, "alias"),
                DevicePlace::Position(_) => of_drive(*motor, "position"),
            }
        }
        BringUpError::Identity {
            motor,
            vendor,
            found_vendor,
            ..
        } if vendor != found_vendor => of_drive(*motor, "vendor"),
        BringUpError::Identity { motor, .. } => of_drive(*motor, "product"),
        BringUpError::Serial { motor, .. } => of_drive(*motor, "serial"),
        BringUpError::Encoder { motor, .. }
        | BringUpError::MissingObject {
            motor,
            object: 0x608F,
            ..
        } => of_drive(*motor, "counts_per_turn"),
        BringUpError::MissingObject { object: 0x60B1, .. } => "axes.velocity.max_um_s".to_owned(),
        BringUpError::MissingObject { object: 0x60B2, .. } => "axes.torque.max_permille".to_owned(),
        BringUpError::SoftwareLimits { .. } => "axes.machine_travel_m".to_owned(),
        BringUpError::Watchdog { .. }
        | BringUpError::WatchdogTime { .. }
        | BringUpError::WatchdogOff { .. } => "ethercat.watchdog_cycles".to_owned(),
        BringUpError::Clocks { .. }
        | BringUpError::NoClock { .. }
        | BringUpError::NoSync0 { .. }
        | BringUpError::ClockApart { .. }
        | BringUpError::ClockRegister { .. }
        | BringUpError::Synchronisation { .. } => "ethercat.clocks".to_owned(),
        BringUpError::MissingObject { motor, .. }
        | BringUpError::Refused { motor, .. }
        | BringUpError::Exchange { motor, .. } => format!("ethercat.drives[{motor}]"),
        BringUpError::ForceSensor { .. } => "ethercat.force_sensor".to_owned(),
        BringUpError::Gauge { gauge, .. } => format!("ethercat.gauges[{gauge}]"),
        BringUpError::Bus(_) => "ethercat".to_owned(),
    }
}

/// Returns the settings of distributed clocks; `None` for drives that run freely.
fn clocks(section: &Ethercat) -> Option<ClockSettings> {
    let has_sync1 = match section.clocks {
        Clocks::Free => return None,
        Clocks::Sync0 => false,
        Clocks::Sync0Sync1 => true,
    };
    Some(ClockSettings {
        sync0_ns: section.sync0_ns(),
        frame_to_sync0_ns: section.frame_to_sync0_us * 1_000,
        has_sync1,
    })
}

/// Returns what the bus has beside drives that run freely.
fn extras<'a>(section: &Ethercat, gauges: &'a [GaugeConfig]) -> Extras<'a> {
    Extras {
        clocks: clocks(section),
        force_sensor: section.force_sensor.as_ref().map(force_sensor),
        gauges,
    }
}

fn force_sensor(sensor: &EthercatForceSensor) -> ForceSensorConfig {
    ForceSensorConfig {
        place: place(sensor.alias, sensor.position),
        vendor: sensor.vendor,
        product: sensor.product,
        calibration: sensor.calibration,
    }
}

/// Returns the expectations of a drive.
fn config(drive: &EthercatDrive, motor: &DriveMotor, axis: &AxisConfig) -> DriveConfig {
    let travel = axis.machine_travel;
    let ends = [travel.lower, travel.upper].map(|end| motor.scale.counts(end).unwrap_or(0));
    DriveConfig {
        place: place(drive.alias, drive.position),
        vendor: drive.vendor,
        product: drive.product,
        serial: drive.serial,
        counts_per_turn: drive.counts_per_turn,
        travel: (ends[0].min(ends[1]), ends[0].max(ends[1])),
        needs_velocity_offset: axis.limits.velocity.max() > 0,
        needs_torque_offset: axis.limits.torque.max() > 0,
    }
}

impl<W: MachineWire<N>, const N: usize, const M: usize> EthercatPlant<W, N, M> {
    /// Opens the bus of a robot file, up to SAFE-OP;
    /// [`Plant::start`](gantry_tau_server::plant::Plant::start) enables the drives. `motion` gets
    /// the positions at which the axes stand, m.
    ///
    /// # Errors
    /// [`EthercatError`]: another bus than the file's, drives whose objects or limits do not fit,
    /// or that stand where the machine cannot be.
    pub fn open<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        section: &Ethercat,
        wire: W,
        motion: impl FnOnce([f64; N]) -> Motion<N>,
    ) -> Result<Self, EthercatError> {
        let map = robot.motor_map::<M>().map_err(EthercatError::other)?;
        let mut motors = Vec::new();
        let mut configs = Vec::new();
        for (drive, &axis) in section.drives.iter().zip(map.axis_of_motor()) {
            let (Some(metres), Some(limits)) =
                (robot.metres_per_q.get(axis), robot.limits.get(axis))
            else {
                continue;
            };
            let Some(scale) = drive.scale(*metres) else {
                continue;
            };
            let motor = DriveMotor {
                axis,
                scale,
                velocity_unit: drive.velocity_unit_counts_per_s,
            };
            configs.push(config(drive, &motor, limits));
            motors.push(motor);
        }
        let (Ok(motors), Ok(configs)) = (
            <[DriveMotor; M]>::try_from(motors),
            <[DriveConfig; M]>::try_from(configs),
        ) else {
            return Err(EthercatError::NoSection {
                file: robot.name.clone(),
            });
        };
        let settings = Settings {
            cycle_us: section.cycle_us,
            watchdog_cycles: section.watchdog_cycles,
            answer_us: ANSWER_US,
        };
        let gauges = gauge_configs(&section.gauges);
        let extras = extras(section, &gauges);
        let drives = Drives::bring_up_with(wire, &configs, settings, extras);
        let drives = drives.map_err(|error| EthercatError::BringUp {
            file: robot.name.clone(),
            key: key(&error),
            error,
        })?;
        let in_force = in_force(robot, &motors, &drives.initial())?;
        let nominal = in_force.map(|in_force| in_force.nominal);
        let path = Interpolator::new(nominal.map(metres), &motion(nominal.map(metres)))
            .map_err(EthercatError::other)?;
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
            reports: BusReports::of_gauges(section.gauges.len()),
            gauges: GaugeLink::of(&section.gauges),
        })
    }
}

fn metres(position: PositionNm) -> f64 {
    position.to_metres().0
}

/// Returns what the axes have in force: the offsets of their drives, and the nominal references
/// that put them where the motors stand.
fn in_force<K, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    motors: &[DriveMotor; M],
    initial: &[Initial; M],
) -> Result<[InForce; N], EthercatError> {
    let mut all = [InForce::at(PositionNm(0)); N];
    for (axis, (in_force, limits)) in all.iter_mut().zip(&robot.limits).enumerate() {
        let position = position(axis, limits, motors, initial);
        let offsets = position.and_then(|position| Ok((position, offsets(axis, motors, initial)?)));
        let (position, offsets) = offsets.map_err(|refused| EthercatError::Drives {
            file: robot.name.clone(),
            key: refused.key(),
            reason: refused.reason,
        })?;
        *in_force = InForce {
            nominal: PositionNm(position.0.saturating_sub(offsets.position.0.into())),
            offsets,
        };
    }
    Ok(all)
}

/// Refusal of what a drive has in force.
struct RefusedOffset {
    motor: Option<usize>,
    reason: String,
}

impl RefusedOffset {
    fn key(&self) -> String {
        self.motor
            .map_or_else(String::new, |motor| format!("ethercat.drives[{motor}]"))
    }
}

/// Returns where an axis stands.
fn position<const M: usize>(
    axis: usize,
    limits: &AxisConfig,
    motors: &[DriveMotor; M],
    initial: &[Initial; M],
) -> Result<PositionNm, RefusedOffset> {
    let travel = limits.machine_travel;
    let positions = initial.map(|initial| initial.position);
    let reason = match axis_position(axis, motors, &positions) {
        None => "the drive's position is out of range".to_owned(),
        Some((_, apart_nm)) if apart_nm > APART_NM => format!(
            "the motors of axis {axis} stand {} um apart; are counts_per_q, sign and zero_counts right?",
            apart_nm / 1_000
        ),
        Some((position, _)) if position < travel.lower || position > travel.upper => format!(
            "the drive stands at {:.6} m, outside the travel of {} to {} m; are counts_per_q, sign and zero_counts right?",
            metres(position),
            metres(travel.lower),
            metres(travel.upper)
        ),
        Some((position, _)) => return Ok(position),
    };
    Err(RefusedOffset {
        motor: motors.iter().position(|motor| motor.axis == axis),
        reason,
    })
}

/// Returns the offsets that the drives of an axis have in force.
fn offsets<const M: usize>(
    axis: usize,
    motors: &[DriveMotor; M],
    initial: &[Initial; M],
) -> Result<Offsets, RefusedOffset> {
    let mut offsets = None::<Offsets>;
    let own = motors.iter().zip(initial).enumerate();
    for (motor, (units, initial)) in own.filter(|(_, (motor, _))| motor.axis == axis) {
        let found = offsets_of(units, initial).ok_or_else(|| RefusedOffset {
            motor: Some(motor),
            reason: "its offsets are out of range".to_owned(),
        })?;
        // Counts of two drives round the same offset differently.
        let differs = offsets.is_some_and(|first| {
            (i64::from(first.position.0) - i64::from(found.position.0)).abs() > 1_000
                || (i64::from(first.velocity.0) - i64::from(found.velocity.0)).abs() > 1_000
                || first.torque != found.torque
        });
        if differs {
            return Err(RefusedOffset {
                motor: Some(motor),
                reason: format!(
                    "the drives of axis {axis} have different offsets in force; set 60B0h to 60B2h to 0"
                ),
            });
        }
        offsets = offsets.or(Some(found));
    }
    Ok(offsets.unwrap_or_default())
}
