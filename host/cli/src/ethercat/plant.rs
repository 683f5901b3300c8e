//! A server's machine on a bus.

use gantry_tau_core::control::axis::{Actual, InForce, Offsets, Reference};
use gantry_tau_core::control::session::config::Travel;
use gantry_tau_core::units::{Metres, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_ethercat::{
    Condition, Drives, Fault, Input, Offset, PowerState, RawSocket, Target, Wire,
};
use gantry_tau_machine::encoder_scale::EncoderScale;
use gantry_tau_machine::robot_file::CYCLE_US;
use gantry_tau_server::links::gauges::GaugePublisher;
use gantry_tau_server::plant::interpolator::Interpolator;
use gantry_tau_server::plant::{DriveState, Plant, PlantError, Reading, ToolReading};
use gantry_tau_server::realtime;

use super::bus_reports::BusReports;
use super::fault_log::FaultLog;
use super::gauge_link::GaugeLink;
use super::initial_state::{APART_NM, axis_position, targets};

/// Re-arms of an axis that may fail.
const ENABLE: [&str; 6] = [
    "enable the drives of axis 0",
    "enable the drives of axis 1",
    "enable the drives of axis 2",
    "enable the drives of axis 3",
    "enable the drives of axis 4",
    "enable the drives of axis 5",
];
/// Errors of the bus.
const OPERATION: &str = "exchange process data with the drives";

/// Wire of a machine with instruments at its tool.
pub trait MachineWire<const N: usize>: Wire {
    /// Takes note of what the references of the coming exchange are made of. Interfaces need not
    /// know it.
    fn note(&mut self, parts: &[InForce; N]) {
        let _ = parts;
    }

    /// Returns the measurements at the tool.
    fn tool(&mut self) -> Option<ToolReading> {
        None
    }

    /// Returns the reason for which the measurements of the last exchange are old although the
    /// drives gave them. Interfaces know of none.
    fn failure(&mut self) -> Option<PlantError> {
        None
    }
}

impl<const N: usize> MachineWire<N> for RawSocket {}

/// Units of one motor's drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DriveMotor {
    pub(super) axis: usize,
    pub(super) scale: EncoderScale,
    /// Counts per second of the drive's unit of velocity.
    pub(super) velocity_unit: f64,
}

impl DriveMotor {
    /// Velocity of the axis, µm/s, of one of the drive.
    pub(super) fn velocity_um_s(&self, velocity: i32) -> Option<i64> {
        let counts = (f64::from(velocity) * self.velocity_unit).round() as i64;
        self.scale.nanometres(counts).map(|nm_s| nm_s / 1_000)
    }

    /// Torque with the sign of the axis, or of the drive.
    pub(super) const fn turned(&self, torque: i16) -> i16 {
        if self.scale.sign() < 0 {
            torque.saturating_neg()
        } else {
            torque
        }
    }

    /// References of the drive: the sum is rounded once, so that offset and position cannot
    /// disagree.
    pub(super) fn target(&self, sum: PositionNm, offsets: &Offsets) -> Option<Target> {
        let position = self.scale.difference(offsets.position.0.into())?;
        let counts_s = self
            .scale
            .difference(i64::from(offsets.velocity.0) * 1_000)?;
        let velocity = (f64::from(counts_s) / self.velocity_unit).round() as i32;
        let offset = Offset {
            position,
            velocity,
            torque: self.turned(offsets.torque.0),
        };
        Some(Target {
            position: self.scale.counts(sum)?.checked_sub(position)?,
            offset,
        })
    }
}

/// Drives over EtherCAT as the machine of a server with `N` axes and `M` motors.
///
/// Each `write` is one exchange: the references leave, and what the drives measured comes back; the
/// next `read` hands it out. A reading whose exchange failed is an error, never an old one.
#[derive(Debug)]
pub struct EthercatPlant<W: Wire, const N: usize, const M: usize> {
    pub(super) drives: Drives<W, M>,
    pub(super) motors: [DriveMotor; M],
    /// The nominal path, in place of the NC kernel.
    pub(super) path: Interpolator<N>,
    /// The drives have the present place of the path: the next one may come.
    pub(super) taken: bool,
    /// The path was left: the nominal references stand here.
    pub(super) held: bool,
    pub(super) nominal: [PositionNm; N],
    /// Parts of the references that the drives are known to have.
    pub(super) in_force: [InForce; N],
    /// Parts of the references that were sent last.
    pub(super) sent: [InForce; N],
    /// Outcome of the last exchange.
    pub(super) last: Result<(), Fault>,
    /// Reason for which its measurements are old nevertheless.
    pub(super) failure: Option<PlantError>,
    /// Reason for which the last re-arm was refused.
    pub(super) refusal: Option<PlantError>,
    /// Travel of the axes.
    pub(super) travel: [Travel; N],
    pub(super) faults: Option<rtrb::Producer<Fault>>,
    pub(super) reports: BusReports,
    pub(super) gauges: GaugeLink,
}

impl<W: MachineWire<N>, const N: usize, const M: usize> EthercatPlant<W, N, M> {
    /// Returns the log of faults, to be written by another thread. The first call has it.
    pub fn fault_log(&mut self) -> FaultLog {
        let (log, faults, reports) = FaultLog::new(self.gauges.names());
        self.faults = Some(faults);
        self.reports.report_to(reports);
        log
    }

    /// Publishes the lengths of the gauges on the bus.
    pub fn publish_gauges(&mut self, link: GaugePublisher) {
        self.gauges.publish_on(link);
    }

    /// Returns the drives.
    #[must_use]
    pub const fn drives_on_the_bus(&self) -> &Drives<W, M> {
        &self.drives
    }

    /// Returns what is known of the tool. The force sensor of the bus was read in the last exchange,
    /// as the drives were.
    fn tool(&mut self) -> Option<ToolReading> {
        let tool = self.drives.wire_mut().tool();
        let Some(reading) = self.drives.force() else {
            return tool;
        };
        Some(ToolReading {
            sensor: reading.unwrap_or([f64::NAN; 6]),
            sensor_age: 1,
            ..tool.unwrap_or(ToolReading::UNKNOWN)
        })
    }

    fn note(&mut self, outcome: Result<(), Fault>) {
        self.last = outcome;
        if let (Err(fault), Some(faults)) = (outcome, &mut self.faults) {
            // A full queue has enough to log.
            let _full = faults.push(fault);
        }
    }

    /// Moves what is in force to where the motors stand, with the offsets that they have.
    fn stand(&mut self) {
        for (axis, in_force) in self.in_force.iter_mut().enumerate() {
            stand_axis(axis, in_force, &self.motors, self.drives.inputs());
        }
    }

    /// Returns the reason for which the drives must not be enabled where they stand: the motors of
    /// an axis get one position, inside the travel. As when the bus was opened; since then somebody
    /// may have moved them.
    fn disagreement(&self) -> Option<PlantError> {
        let counts = self.drives.inputs().map(|input| input.position);
        self.travel.iter().enumerate().find_map(|(axis, travel)| {
            let reason = match axis_position(axis, &self.motors, &counts) {
                None => "its position is out of range",
                Some((_, apart_nm)) if apart_nm > APART_NM => {
                    "its motors stand more than 0.5 mm apart"
                }
                Some((position, _)) if position < travel.lower || position > travel.upper => {
                    "it stands outside of the machine's travel"
                }
                Some(_) => return None,
            };
            Some(PlantError {
                operation: ENABLE
                    .get(axis)
                    .copied()
                    .unwrap_or("enable the drives of an axis"),
                reason,
            })
        })
    }

    fn actual(&self) -> Option<[Actual; N]> {
        let inputs = self.drives.inputs();
        let counts = inputs.map(|input| input.position);
        let mut actual = [Actual::default(); N];
        for (axis, report) in actual.iter_mut().enumerate() {
            report.position = axis_position(axis, &self.motors, &counts)?.0;
            let motors = self.motors.iter().zip(inputs);
            let own = motors.filter(|(motor, _)| motor.axis == axis);
            let count = i64::try_from(own.clone().count())
                .ok()
                .filter(|count| *count > 0)?;
            let velocity: i64 = own
                .clone()
                .filter_map(|(motor, input)| motor.velocity_um_s(input.velocity))
                .sum();
            let torque: i64 = own
                .map(|(motor, input)| i64::from(motor.turned(input.torque)))
                .sum();
            let clamped = velocity
                .checked_div(count)?
                .clamp(i32::MIN.into(), i32::MAX.into());
            report.velocity = VelocityUmS(i32::try_from(clamped).ok()?);
            report.torque = TorquePermille(i16::try_from(torque.checked_div(count)?).ok()?);
        }
        Some(actual)
    }
}

/// Moves what is in force on one axis to where its motors stand. Beyond the range it stays: the
/// targets are refused then.
fn stand_axis<const M: usize>(
    axis: usize,
    in_force: &mut InForce,
    motors: &[DriveMotor; M],
    inputs: &[Input; M],
) {
    let counts = inputs.map(|input| input.position);
    if let Some((position, _)) = axis_position(axis, motors, &counts) {
        in_force.nominal = PositionNm(
            position
                .0
                .saturating_sub(in_force.offsets.position.0.into()),
        );
    }
}

/// Error of a fault.
const fn failed(fault: &Fault) -> PlantError {
    PlantError {
        operation: OPERATION,
        reason: fault.name(),
    }
}

impl<W: MachineWire<N>, const N: usize, const M: usize> Plant<N, M> for EthercatPlant<W, N, M> {
    type Error = PlantError;

    fn start(&mut self) -> Result<(), PlantError> {
        let motors = &self.motors;
        let in_force = &mut self.in_force;
        self.drives.start(|inputs| {
            for (axis, in_force) in in_force.iter_mut().enumerate() {
                stand_axis(axis, in_force, motors, inputs);
            }
            // Checked when the bus was opened: the motors stand within their range.
            targets(motors, in_force).unwrap_or_else(|| {
                inputs.map(|input| Target {
                    position: input.position,
                    ..Target::default()
                })
            })
        });
        self.nominal = self.in_force.map(|in_force| in_force.nominal);
        self.sent = self.in_force;
        if let Condition::Stopped(fault) = self.drives.condition() {
            if matches!(fault, Fault::Clock(_) | Fault::NotInPhase) {
                return Err(failed(&fault));
            }
            // A drive that is still in fault waits for the re-arm: the server starts, and stops.
            self.held = true;
            self.note(Err(fault));
        }
        Ok(())
    }

    fn first_deadline_ns(&mut self) -> Option<u64> {
        let next_ns = self.drives.next_cycle_ns()?;
        let ahead_ns = next_ns.saturating_sub(self.drives.wire_mut().now_ns());
        Some(realtime::now_ns().saturating_add(ahead_ns))
    }

    fn deadline_shift_ns(&mut self) -> i64 {
        self.drives.take_shift_ns()
    }

    fn in_force(&mut self) -> Result<[InForce; N], PlantError> {
        Ok(self.in_force)
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<N>, PlantError> {
        self.drives
            .wire_mut()
            .begin_cycles(elapsed, CYCLE_US.into());
        self.gauges.begin_cycles(elapsed);
        self.refusal.map_or(Ok(()), Err)?;
        self.last.map_err(|fault| failed(&fault))?;
        self.failure.map_or(Ok(()), Err)?;
        if self.taken && !self.held && self.drives.condition() == Condition::Running {
            // One cycle of the path for each one that the drives took: neither a delay nor a lost
            // frame makes a leap.
            self.path.advance();
            self.taken = false;
            for (nominal, metres) in self.nominal.iter_mut().zip(self.path.position_m()) {
                let beyond = PlantError {
                    operation: "follow the nominal path",
                    reason: "a position is out of range",
                };
                *nominal = PositionNm::from_metres(Metres(metres)).map_err(|_| beyond)?;
            }
        }
        let beyond = PlantError {
            operation: OPERATION,
            reason: "a measurement is out of range",
        };
        let actual = self.actual().ok_or(beyond)?;
        Ok(Reading {
            nominal: self.nominal,
            actual,
            tool: self.tool(),
        })
    }

    /// An error after a lost frame, whose references are sent again until an answer confirms them:
    /// it is not known whether the drives have them, and the next ones must not add to them.
    fn write(
        &mut self,
        references: &[Reference; M],
        parts: &[InForce; N],
    ) -> Result<(), PlantError> {
        let is_running = self.drives.condition() == Condition::Running;
        if matches!(self.drives.condition(), Condition::Rearming { .. }) {
            self.stand();
        }
        let wanted = match (self.drives.takes_targets(), is_running) {
            (false, _) => Some(*self.drives.sent()),
            (true, true) => demanded(&self.motors, references, parts),
            (true, false) => targets(&self.motors, &self.in_force),
        };
        let beyond = PlantError {
            operation: OPERATION,
            reason: "a reference is beyond the range of its drive",
        };
        let wanted = wanted.ok_or(beyond)?;
        if self.drives.takes_targets() {
            self.sent = if is_running { *parts } else { self.in_force };
        }
        self.drives.wire_mut().note(&self.sent);
        let outcome = self.drives.cycle(&wanted);
        self.reports.see(&self.drives);
        self.gauges.put(self.drives.gauge_counts());
        self.failure = self.drives.wire_mut().failure();
        if self.drives.is_confirmed() {
            self.in_force = self.sent;
        }
        // The references were not taken, but the measurements are good.
        self.note(outcome.or_else(|fault| {
            if fault == Fault::Resent {
                Ok(())
            } else {
                Err(fault)
            }
        }));
        if is_running {
            self.taken = self.in_force.map(|axis| axis.nominal) == self.nominal;
            return outcome.map_err(|fault| failed(&fault));
        }
        outcome.map_err(|fault| failed(&fault))?;
        // Enabled again, where the motors stand: the server goes on from there.
        self.held = true;
        self.nominal = self.in_force.map(|in_force| in_force.nominal);
        Err(failed(&Fault::Rearming))
    }

    /// Not ready while the last frame had no right answer: what the drives do is not known then.
    fn drives(&self) -> Option<[DriveState; N]> {
        if !self.drives.is_confirmed() {
            return Some([DriveState::NotReady; N]);
        }
        let mut states = [DriveState::Operating; N];
        for (motor, input) in self.motors.iter().zip(self.drives.inputs()) {
            if let Some(state) = states.get_mut(motor.axis) {
                *state = (*state).max(drive_state(input.state()));
            }
        }
        Some(states)
    }

    fn reset(&mut self) {
        self.refusal = self.disagreement();
        if self.refusal.is_none() {
            self.drives.rearm();
        }
    }
}

/// References of every motor for a server's demand.
fn demanded<const N: usize, const M: usize>(
    motors: &[DriveMotor; M],
    references: &[Reference; M],
    parts: &[InForce; N],
) -> Option<[Target; M]> {
    let mut targets = [Target::default(); M];
    for (target, (motor, reference)) in targets.iter_mut().zip(motors.iter().zip(references)) {
        let offsets = Offsets {
            position: parts.get(motor.axis)?.offsets.position,
            velocity: reference.velocity_offset,
            torque: reference.torque_offset,
        };
        *target = motor.target(reference.position, &offsets)?;
    }
    Some(targets)
}

/// State of a drive as the server shows it.
const fn drive_state(state: PowerState) -> DriveState {
    match state {
        PowerState::OperationEnabled => DriveState::Operating,
        PowerState::SwitchedOn => DriveState::Ready,
        PowerState::NotReady | PowerState::SwitchOnDisabled | PowerState::ReadyToSwitchOn => {
            DriveState::NotReady
        }
        PowerState::QuickStopActive => DriveState::QuickStop,
        PowerState::FaultReactionActive | PowerState::Fault => DriveState::Fault,
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::control::axis::Offsets;
    use gantry_tau_core::units::{OffsetNm, TorquePermille, VelocityUmS};

    use super::*;

    /// Drives whose unit of velocity is not a count per second, with and against their axis: 10 nm
    /// to a count.
    #[test]
    fn velocities_are_in_the_unit_of_the_drive() {
        for sign in [1, -1] {
            let scale = EncoderScale::new(1e8 * f64::from(sign), 5_000).unwrap();
            let motor = DriveMotor {
                axis: 0,
                scale,
                velocity_unit: 20.0,
            };
            // 1 000 units are 20 000 counts/s: 200 µm/s.
            assert_eq!(motor.velocity_um_s(1_000 * sign), Some(200));
            let offsets = Offsets {
                position: OffsetNm(3_000),
                velocity: VelocityUmS(200),
                torque: TorquePermille(7),
            };
            let target = motor.target(PositionNm(1_003_000), &offsets).unwrap();
            assert_eq!(
                (target.offset.position, target.offset.velocity),
                (300 * sign, 1_000 * sign)
            );
            assert_eq!(i32::from(target.offset.torque), 7 * sign);
            assert_eq!(
                target.position,
                5_000 + 100_000 * sign,
                "sum and offset are rounded once"
            );
        }
    }
}
