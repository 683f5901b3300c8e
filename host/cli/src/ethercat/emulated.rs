//! The simulated machine behind emulated drives: the whole path without hardware.

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::units::{TorquePermille, VelocityUmS};
use gantry_tau_ethercat::emulation::{
    Chain, ClockSetup, Drive, DriveSetup, EmulatedWire, ForceTerminal, ForceUnits, Identity,
    Instrument, Node, Process, SubDevice,
};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{Clocks, Ethercat, EthercatForceSensor, RobotFile};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{Plant, PlantError, ToolReading};
use gantry_tau_sim::load_generator::AppliedLoad;
use gantry_tau_sim::machine::SimulatedMachine;

use super::gauges::terminal;
use super::open::EthercatError;
use super::plant::{DriveMotor, MachineWire};

/// Following error at which an emulated drive trips, m, and the time for it, ms.
const FOLLOWING_ERROR_M: f64 = 2e-3;
const FOLLOWING_ERROR_MS: u16 = 10;
/// Deceleration of an emulated drive's quick stop, m/s².
const QUICK_STOP_M_PER_S2: f64 = 10.0;

/// Status of a force sensor beyond its range.
const SATURATED: u32 = 0x4000_0000;

/// Bits of 1C32h:04.
const SYNC0: u16 = 0x04;
const SYNC1: u16 = 0x08;

/// A bus in process, with the simulated machine behind it.
pub type EmulatedBus<const N: usize, const M: usize> =
    EmulatedWire<EmulatedMachine<SimulatedMachine<N, M>, N, M>>;

/// A machine as emulated drives move it; its own nominal path is not used.
#[derive(Debug)]
pub struct EmulatedMachine<P, const N: usize, const M: usize> {
    machine: P,
    motors: [DriveMotor; M],
    /// References of drives without torque: their brakes hold them there.
    braked: [Option<Reference>; M],
    parts: [InForce; N],
    tool: Option<ToolReading>,
    /// Reason for which the last step gave no measurements.
    failure: Option<PlantError>,
}

impl<P, const N: usize, const M: usize> Process for EmulatedMachine<P, N, M>
where
    P: Plant<N, M, Error = PlantError> + Send,
{
    fn measure(&mut self, instruments: &mut [SubDevice<Instrument>]) {
        for subdevice in instruments {
            let Instrument::Force(sensor) = subdevice.device_mut() else {
                continue;
            };
            match self.tool.and_then(|tool| force_counts(&tool.sensor)) {
                Some(counts) => {
                    sensor.set_counts(counts);
                    sensor.set_status(0);
                }
                None => sensor.set_status(SATURATED),
            }
        }
    }

    fn step(&mut self, drives: &mut [SubDevice]) {
        let mut references = [Reference {
            position: Default::default(),
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        }; M];
        let places = references
            .iter_mut()
            .zip(self.motors.iter().zip(&mut self.braked));
        for ((reference, (units, braked)), drive) in places.zip(drives.iter()) {
            let motor = drive.drive().motor();
            let Some(position) = units.scale.position(motor.reference) else {
                continue;
            };
            let velocity = units
                .velocity_um_s(motor.velocity_offset)
                .and_then(|um_s| i32::try_from(um_s).ok());
            let commanded = Reference {
                position,
                velocity_offset: VelocityUmS(velocity.unwrap_or(0)),
                torque_offset: TorquePermille(units.turned(motor.torque_offset)),
            };
            *braked = if motor.is_enabled {
                None
            } else {
                braked.or(Some(commanded))
            };
            *reference = braked.unwrap_or(commanded);
        }
        let parts = self.parts;
        let reading = match self
            .machine
            .write(&references, &parts)
            .and_then(|()| self.machine.read(1))
        {
            Ok(reading) => reading,
            // Loads beyond its springs: the motors' positions are not known then.
            Err(failure) => {
                (self.failure, self.tool) = (Some(failure), None);
                return;
            }
        };
        (self.failure, self.tool) = (None, reading.tool);
        for (units, drive) in self.motors.iter().zip(drives) {
            let Some(actual) = reading.actual.get(units.axis) else {
                continue;
            };
            let motor = drive.drive_mut().motor_mut();
            motor.position = units
                .scale
                .counts(actual.position)
                .map_or(motor.position, i64::from);
            let counts_s = units
                .scale
                .difference(i64::from(actual.velocity.0) * 1_000)
                .unwrap_or(0);
            motor.velocity = (f64::from(counts_s) / units.velocity_unit).round() as i32;
            motor.torque = units.turned(actual.torque.0);
        }
    }
}

/// Units of the emulated force sensor: 0.01 mN and 1 µN m, to ±21 kN and ±2.1 kN m.
const FORCE_UNITS: ForceUnits = ForceUnits {
    force: 2,
    torque: 3,
    counts_per_force: 100_000,
    counts_per_torque: 1_000_000,
};

/// Counts of a load at the emulated force sensor; `None` for one that it cannot measure.
fn force_counts(load: &[f64; 6]) -> Option<[i32; 6]> {
    let (force, torque) = (FORCE_UNITS.counts_per_force, FORCE_UNITS.counts_per_torque);
    let per_unit = [force, force, force, torque, torque, torque];
    let mut counts = [0; 6];
    for ((place, load), per_unit) in counts.iter_mut().zip(load).zip(per_unit) {
        let exact = (load * f64::from(per_unit)).round();
        if exact.is_nan() || exact.abs() > f64::from(i32::MAX) {
            return None;
        }
        *place = exact as i32;
    }
    Some(counts)
}

impl<P, const N: usize, const M: usize> MachineWire<N> for EmulatedWire<EmulatedMachine<P, N, M>>
where
    P: Plant<N, M, Error = PlantError> + Send,
{
    fn note(&mut self, parts: &[InForce; N]) {
        self.bench().chain.process_mut().parts = *parts;
    }

    fn tool(&mut self) -> Option<ToolReading> {
        self.bench().chain.process_mut().tool
    }

    fn failure(&mut self) -> Option<PlantError> {
        self.bench().chain.process_mut().failure
    }
}

/// Builds a bus of the drives of a robot file in front of a simulated machine, which stands at home
/// under the load of `tool`.
///
/// The emulated drives are the drives, with states and supervision of their own: the machine behind
/// them has ideal ones, and `[drives]` of the file is not used.
///
/// # Errors
/// [`EthercatError`] for drives that the file gives other positions than the order of the motors,
/// and for a file without a simulation.
pub fn emulated_bus<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    section: &Ethercat,
    tool: AppliedLoad,
) -> Result<EmulatedBus<N, M>, EthercatError> {
    if robot.drives.is_some() {
        tracing::warn!(
            "{}: drives: not used; the emulated drives of the bus take their place",
            robot.name
        );
    }
    let ideal = RobotFile {
        drives: None,
        ..robot.clone()
    };
    let machine = SimulatedMachine::<N, M>::from_robot(&ideal, tool, Motion::Hold);
    emulated_bus_of(robot, section, machine.map_err(EthercatError::other)?)
}

/// Builds a bus of the drives of a robot file in front of another machine, which stands at home and
/// has ideal drives.
///
/// # Errors
/// As [`emulated_bus`].
pub fn emulated_bus_of<K: MachineKind<N>, P, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    section: &Ethercat,
    mut machine: P,
) -> Result<EmulatedWire<EmulatedMachine<P, N, M>>, EthercatError>
where
    P: Plant<N, M, Error = PlantError> + Send,
{
    let map = robot.motor_map::<M>().map_err(EthercatError::other)?;
    let parts = machine.in_force().map_err(EthercatError::other)?;
    let mut motors = Vec::new();
    let mut setups = Vec::new();
    for ((index, drive), &axis) in (0_u16..).zip(&section.drives).zip(map.axis_of_motor()) {
        let (Some(metres), Some(at)) = (robot.metres_per_q.get(axis), parts.get(axis)) else {
            continue;
        };
        let Some(scale) = drive.scale(*metres) else {
            continue;
        };
        if drive.position.is_some_and(|position| position != index) {
            let key = format!("ethercat.drives[{index}].position");
            let reason = "the emulated bus has the drives in the order of the motors".to_owned();
            return Err(EthercatError::Drives {
                file: robot.name.clone(),
                key,
                reason,
            });
        }
        let counts_per_m = drive.counts_per_q / metres;
        setups.push(DriveSetup {
            identity: Identity {
                vendor: drive.vendor,
                product: drive.product,
                revision: 1,
                serial: drive.serial.unwrap_or(u32::from(index) + 1),
            },
            alias: drive.alias.unwrap_or(0),
            position: scale.counts(at.nominal).unwrap_or(0),
            missing: Vec::new(),
            software_limits: (0, 0),
            encoder: (drive.counts_per_turn.unwrap_or(1 << 20), 1),
            following_error: (
                (FOLLOWING_ERROR_M * counts_per_m) as u32,
                FOLLOWING_ERROR_MS,
            ),
            quick_stop: (QUICK_STOP_M_PER_S2 * counts_per_m) as u32,
            has_watchdog: true,
            watchdog_is_writable: true,
        });
        motors.push(DriveMotor {
            axis,
            scale,
            velocity_unit: drive.velocity_unit_counts_per_s,
        });
    }
    let Ok(motors) = <[DriveMotor; M]>::try_from(motors) else {
        return Err(EthercatError::NoSection {
            file: robot.name.clone(),
        });
    };
    let machine = EmulatedMachine {
        machine,
        motors,
        braked: [None; M],
        parts,
        tool: None,
        failure: None,
    };
    let mut nodes: Vec<Node> = (0_u32..)
        .zip(&setups)
        .map(|(index, setup)| Node::Drive(drive(index, setup, section.clocks)))
        .collect();
    nodes.extend(instruments(robot, section, M)?);
    Ok(EmulatedWire::new(Chain::of(nodes, machine)))
}

/// Returns the emulated instruments, which stand behind the drives, from this position on.
fn instruments<K, const N: usize>(
    robot: &RobotFile<K, N>,
    section: &Ethercat,
    first: usize,
) -> Result<Vec<Node>, EthercatError> {
    let sensor = section.force_sensor.iter();
    let sensor = sensor.map(|sensor| {
        let key = "ethercat.force_sensor.position".to_owned();
        (sensor.position, key, force_sensor(sensor))
    });
    let gauges = section.gauges.iter().enumerate();
    let gauges = gauges.map(|(index, gauge)| {
        let key = format!("ethercat.gauges[{index}].position");
        (gauge.position, key, terminal(gauge))
    });
    let mut all: Vec<_> = sensor.chain(gauges).collect();
    all.sort_by_key(|(position, ..)| *position);
    let mut nodes = Vec::new();
    for (expected, (position, key, node)) in (first..).zip(all) {
        if position.map(usize::from) != Some(expected) {
            return Err(EthercatError::Drives {
                file: robot.name.clone(),
                key,
                reason: format!(
                    "the emulated bus has the instruments behind the drives, without gaps; one is expected at {expected}"
                ),
            });
        }
        nodes.push(node);
    }
    Ok(nodes)
}

/// Returns an emulated force sensor.
fn force_sensor(sensor: &EthercatForceSensor) -> Node {
    let identity = Identity {
        vendor: sensor.vendor,
        product: sensor.product,
        ..ForceTerminal::IDENTITY
    };
    Node::Instrument(SubDevice::of(Instrument::Force(ForceTerminal::new(
        identity,
        FORCE_UNITS,
    ))))
}

/// Returns an emulated drive. With clocks it is one that runs on SYNC0 alone, and whose clock has a
/// drift of its own.
fn drive(index: u32, setup: &DriveSetup, clocks: Clocks) -> SubDevice {
    let drive = Drive::new(setup);
    if clocks == Clocks::Free {
        return SubDevice::of(drive);
    }
    let types = match clocks {
        Clocks::Free | Clocks::Sync0 => SYNC0,
        Clocks::Sync0Sync1 => SYNC0 | SYNC1,
    };
    let drive = drive.with_synchronisation(types).requiring_sync0();
    let drift_ppb = match index % 3 {
        0 => 20_000,
        1 => -35_000,
        _ => 50_000,
    };
    SubDevice::of(drive).with_clock(ClockSetup {
        drift_ppb,
        offset_ns: u64::from(index) * 7_654_321,
    })
}
