//! `[ethercat]`: the drives of a bus, one for each motor.

use gantry_tau_core::control::session::config::AxisConfig;
use serde::Deserialize;

use super::Motors;
use super::gauges::{EthercatGauge, problems_of_gauges};
use super::problems::Problems;
use crate::encoder_scale::EncoderScale;
use crate::robot_file::CYCLE_US;

/// Largest number of cycles of the drives' watchdogs; EtherCAT's default would be 100 ms.
const MAX_WATCHDOG_CYCLES: u32 = 10;

/// `[ethercat]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ethercat {
    /// Length of a cycle, us: the server's.
    pub cycle_us: u32,
    /// Cycles without new references after which a drive stops by itself, 1 to 10.
    pub watchdog_cycles: u32,
    /// Clocks that the drives run by.
    #[serde(default)]
    pub clocks: Clocks,
    /// Period of SYNC0, us; the cycle without it.
    pub sync0_us: Option<f64>,
    /// Time from the passage of a frame at the reference clock to SYNC0, us.
    #[serde(default = "half_a_cycle")]
    pub frame_to_sync0_us: u32,
    /// Drive of each motor, in the order of `motors.axis_of_motor`.
    pub drives: Vec<EthercatDrive>,
    /// Force sensor on the same bus.
    pub force_sensor: Option<EthercatForceSensor>,
    /// Gauges on the same bus.
    #[serde(default)]
    pub gauges: Vec<EthercatGauge>,
}

/// Clocks that drives run by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clocks {
    /// Each one by its own, and by the arrival of frames.
    #[default]
    Free,
    /// By SYNC0 of the distributed clocks.
    Sync0,
    /// By SYNC0 and SYNC1.
    Sync0Sync1,
}

/// `[[ethercat.drives]]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EthercatDrive {
    /// Alias in the drive's EEPROM; or `position`.
    pub alias: Option<u16>,
    /// Number of devices before it on the bus; or `alias`.
    pub position: Option<u16>,
    /// Vendor in the drive's EEPROM.
    pub vendor: u32,
    /// Product code in the drive's EEPROM.
    pub product: u32,
    /// Serial number in the drive's EEPROM; absent: not compared. Drives of one kind that are named
    /// by their position differ by nothing else.
    pub serial: Option<u32>,
    /// Counts per unit of `q`, positive.
    pub counts_per_q: f64,
    /// 1, or -1 for a drive that counts against the axis.
    pub sign: i8,
    /// Counts at `q` = 0.
    pub zero_counts: i64,
    /// Counts per turn of the encoder, compared with the drive's object 608Fh.
    pub counts_per_turn: Option<u32>,
    /// Velocity unit of the drive (606Ch, 60B1h), in counts per second.
    #[serde(default = "one")]
    pub velocity_unit_counts_per_s: f64,
}

/// `[ethercat.force_sensor]`.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EthercatForceSensor {
    /// Alias in the sensor's EEPROM; or `position`.
    pub alias: Option<u16>,
    /// Number of devices before it on the bus; or `alias`.
    pub position: Option<u16>,
    /// Vendor in the sensor's EEPROM.
    pub vendor: u32,
    /// Product code in the sensor's EEPROM.
    pub product: u32,
    /// Objects of the sensor.
    pub kind: ForceSensorKind,
    /// Calibration that the sensor uses, 0 to 15.
    #[serde(default)]
    pub calibration: u8,
}

/// Objects of a force sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ForceSensorKind {
    /// Those of the ATI EtherCAT F/T.
    Ati,
}

/// Largest number of a calibration.
const MAX_CALIBRATION: u8 = 15;

const fn one() -> f64 {
    1.0
}

const fn half_a_cycle() -> u32 {
    CYCLE_US / 2
}

/// Unit of SYNC0's period, us.
const PERIOD_UNIT_US: f64 = 62.5;

impl Ethercat {
    /// Drives of an emulated bus: aliases from 1001, 2^20 counts per 10 mm.
    #[must_use]
    pub fn emulated(axis_of_motor: &[usize], metres_per_q: &[f64]) -> Self {
        let aliases = 1_001_u16..;
        let drives = aliases
            .zip(axis_of_motor)
            .map(|(alias, axis)| EthercatDrive {
                alias: Some(alias),
                position: None,
                vendor: 0x0A11,
                product: 1,
                serial: None,
                counts_per_q: 1_048_576e2 * metres_per_q.get(*axis).copied().unwrap_or(1.0),
                sign: if alias % 2 == 0 { -1 } else { 1 },
                zero_counts: 0,
                counts_per_turn: Some(1 << 20),
                velocity_unit_counts_per_s: 1.0,
            });
        Self {
            cycle_us: CYCLE_US,
            watchdog_cycles: 5,
            clocks: Clocks::Free,
            sync0_us: None,
            frame_to_sync0_us: half_a_cycle(),
            drives: drives.collect(),
            force_sensor: None,
            gauges: Vec::new(),
        }
    }

    /// Returns the period of SYNC0, ns.
    #[must_use]
    pub fn sync0_ns(&self) -> u32 {
        let us = self.sync0_us.unwrap_or_else(|| self.cycle_us.into());
        // Whole: a multiple of 62.5 us, which was checked.
        (us * 1_000.0).round() as u32
    }
}

impl EthercatDrive {
    /// Returns the scale of the drive of an axis.
    #[must_use]
    pub fn scale(&self, metres_per_q: f64) -> Option<EncoderScale> {
        EncoderScale::new(
            self.counts_per_q / metres_per_q * f64::from(self.sign),
            self.zero_counts,
        )
    }
}

/// Checks the section. `limits` are absent where `[axes]` is wrong.
pub(super) fn check<const N: usize>(
    section: &Ethercat,
    motors: &Motors,
    metres_per_q: &[f64; N],
    limits: Option<&[AxisConfig; N]>,
    problems: &mut Problems,
) {
    if section.cycle_us != CYCLE_US {
        let reason = format!(
            "is {}; the server's cycle is {CYCLE_US} us",
            section.cycle_us
        );
        problems.add("ethercat.cycle_us", reason);
    } else {
        check_clocks(section, problems);
    }
    if !(1..=MAX_WATCHDOG_CYCLES).contains(&section.watchdog_cycles) {
        let reason = format!(
            "is {}; expected from 1 to {MAX_WATCHDOG_CYCLES} (EtherCAT's default of 100 ms is too long)",
            section.watchdog_cycles
        );
        problems.add("ethercat.watchdog_cycles", reason);
    }
    if let Some(sensor) = &section.force_sensor {
        check_force_sensor(sensor, &section.drives, problems);
    }
    check_gauges(section, problems);
    let (drives, count) = (section.drives.len(), motors.axis_of_motor.len());
    if drives != count {
        let reason = format!("lists {drives} drives, [motors] has {count} motors");
        problems.add("ethercat.drives", reason);
        return;
    }
    for (motor, drive) in section.drives.iter().enumerate() {
        check_identity(section, motor, drive, problems);
    }
    for (motor, (drive, axis)) in section.drives.iter().zip(&motors.axis_of_motor).enumerate() {
        let limits = limits.and_then(|limits| limits.get(*axis));
        if let (Some(metres), Some(limits)) = (metres_per_q.get(*axis), limits) {
            check_scale(motor, drive, *metres, limits, problems);
        }
    }
}

/// Checks where the force sensor is, and its calibration.
fn check_force_sensor(
    sensor: &EthercatForceSensor,
    drives: &[EthercatDrive],
    problems: &mut Problems,
) {
    let place = (sensor.alias, sensor.position);
    let alias = "ethercat.force_sensor.alias";
    if sensor.alias.is_some() == sensor.position.is_some() {
        problems.add(alias, "expected either alias or position");
    } else if sensor.alias == Some(0) {
        let reason = "is 0, which is no alias; give the sensor one, or use position";
        problems.add(alias, reason);
    } else if drives
        .iter()
        .any(|drive| (drive.alias, drive.position) == place)
    {
        problems.add(alias, "names the drive of a motor");
    }
    if sensor.calibration > MAX_CALIBRATION {
        let reason = format!(
            "is {}; expected from 0 to {MAX_CALIBRATION}",
            sensor.calibration
        );
        problems.add("ethercat.force_sensor.calibration", reason);
    }
}

/// Checks the gauges, and that each has a place of its own.
fn check_gauges(section: &Ethercat, problems: &mut Problems) {
    for (key, reason) in problems_of_gauges(&section.gauges) {
        problems.add(format!("ethercat.gauges{key}"), reason);
    }
    let drives = section.drives.iter();
    let drives = drives.map(|drive| (drive.alias, drive.position));
    let sensor = section.force_sensor.iter();
    let taken = drives.chain(sensor.map(|sensor| (sensor.alias, sensor.position)));
    for (index, gauge) in section.gauges.iter().enumerate() {
        let place = (gauge.alias, gauge.position);
        let is_taken = taken.clone().any(|taken| taken == place);
        if let Some((key, _)) = gauge.place().filter(|_| is_taken) {
            let key = format!("ethercat.gauges[{index}].{key}");
            problems.add(key, "names a drive or the force sensor");
        }
    }
}

/// Checks the keys of the distributed clocks.
fn check_clocks(section: &Ethercat, problems: &mut Problems) {
    let cycle_us = f64::from(section.cycle_us);
    if let Some(us) = section.sync0_us {
        let fits = |unit: f64, whole: f64| (whole / unit).fract() == 0.0;
        if !(us >= PERIOD_UNIT_US && fits(PERIOD_UNIT_US, us) && fits(us, cycle_us)) {
            let reason = format!(
                "is {us}; expected a multiple of {PERIOD_UNIT_US} that divides the cycle of {cycle_us} us"
            );
            problems.add("ethercat.sync0_us", reason);
        }
    }
    let (least, most) = (section.cycle_us / 5, section.cycle_us / 5 * 4);
    if !(least..=most).contains(&section.frame_to_sync0_us) {
        let reason = format!(
            "is {}; expected from {least} to {most}",
            section.frame_to_sync0_us
        );
        problems.add("ethercat.frame_to_sync0_us", reason);
    }
}

/// Key of a drive.
fn keyed(motor: usize, name: &str) -> String {
    format!("ethercat.drives[{motor}].{name}")
}

/// Checks what names a drive, and how it counts.
fn check_identity(
    section: &Ethercat,
    motor: usize,
    drive: &EthercatDrive,
    problems: &mut Problems,
) {
    let alias = keyed(motor, "alias");
    let is_here =
        |other: &&EthercatDrive| (other.alias, other.position) == (drive.alias, drive.position);
    if drive.alias.is_some() == drive.position.is_some() {
        problems.add(alias, "expected either alias or position");
    } else if drive.alias == Some(0) {
        let reason = "is 0, which is no alias; give the drive one, or use position";
        problems.add(alias, reason);
    } else if section.drives.iter().filter(is_here).count() > 1 {
        problems.add(alias, "names the drive of another motor too");
    }
    if ![-1, 1].contains(&drive.sign) {
        let reason = format!("is {}; expected 1 or -1", drive.sign);
        problems.add(keyed(motor, "sign"), reason);
    }
    problems.range(
        &keyed(motor, "velocity_unit_counts_per_s"),
        drive.velocity_unit_counts_per_s,
        1e-6,
        1e6,
    );
}

/// Checks the counts over the travel of the axis.
fn check_scale(
    motor: usize,
    drive: &EthercatDrive,
    metres_per_q: f64,
    limits: &AxisConfig,
    problems: &mut Problems,
) {
    let key = keyed(motor, "counts_per_q");
    let Some(scale) = drive.scale(metres_per_q) else {
        let reason = format!(
            "is {}; expected 10^6 to 10^12 counts per metre of the axis",
            drive.counts_per_q
        );
        problems.add(key, reason);
        return;
    };
    let travel = limits.machine_travel;
    if scale.counts(travel.lower).is_none() || scale.counts(travel.upper).is_none() {
        let reason =
            "takes the machine's travel beyond the 32 bits of a drive's position; see zero_counts";
        problems.add(key, reason);
    }
}
