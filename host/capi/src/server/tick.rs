//! Inputs and outputs of a tick.

use core::ptr::null_mut;

use gantry_tau_core::control::axis::{Actual, InForce, Reference};
use gantry_tau_core::control::endpoint::{CONNECTIONS, MotorMap, Write};
use gantry_tau_core::control::message::{AxisFlags, AxisState, Cause, Counters, Phase, State};
use gantry_tau_core::control::session::{Held, Output, Reading, TickInput};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{
    ForceMn, MomentUnm, PositionNm, TorquePermille, VelocityUmS, WrenchSample,
};

use super::config::{gt_in_force, gt_offsets};
use super::{GT_MAX_AXES, GT_MAX_CONNECTIONS, GT_MAX_MOTORS};
use crate::code::gt_code;
use crate::error::{gt_error, gt_parameter, small};
use crate::machine::gt_wrench;
use crate::memory::{Reply, answer, read, resized};
use crate::padding::{padded, without_padding};

const _: () = assert!(GT_MAX_CONNECTIONS == CONNECTIONS, "the constant is core's");

/// The reference was clamped to the machine's travel.
pub const GT_FLAG_TRAVEL: u8 = 1;
/// The position offset could not reach its target within step and accel.
pub const GT_FLAG_POSITION_LIMITED: u8 = 2;
/// The same for the velocity offset.
pub const GT_FLAG_VELOCITY_LIMITED: u8 = 4;
/// The same for the torque offset.
pub const GT_FLAG_TORQUE_LIMITED: u8 = 8;
/// The nominal reference stepped further than nominal_step_nm.
pub const GT_FLAG_NOMINAL_STEP: u8 = 16;
/// The nominal reference accelerated more than nominal_accel_nm.
pub const GT_FLAG_NOMINAL_ACCEL: u8 = 32;

const _: () = assert!(
    GT_FLAG_TRAVEL == AxisFlags::TRAVEL.bits()
        && GT_FLAG_POSITION_LIMITED == AxisFlags::POSITION_LIMITED.bits()
        && GT_FLAG_VELOCITY_LIMITED == AxisFlags::VELOCITY_LIMITED.bits()
        && GT_FLAG_TORQUE_LIMITED == AxisFlags::TORQUE_LIMITED.bits()
        && GT_FLAG_NOMINAL_STEP == AxisFlags::NOMINAL_STEP.bits()
        && GT_FLAG_NOMINAL_ACCEL == AxisFlags::NOMINAL_ACCEL.bits(),
    "the flags are core's"
);

/// Measurements of a drive.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct gt_actual {
    /// Position of the motor side of the axis, nm.
    pub position_nm: i64,
    /// Velocity, um/s.
    pub velocity_um_s: i32,
    /// Torque, per mille of rated torque.
    pub torque_permille: i16,
}

/// The switch or button is released.
pub const GT_RELEASED: u8 = 1;
/// The switch or button is pressed.
pub const GT_PRESSED: u8 = 2;

/// The machine was read.
pub const GT_READING_DONE: u8 = 1;
/// The machine could not be read: `nominal_nm` and `actual` are not looked at.
pub const GT_READING_FAILED: u8 = 2;

/// The drives took the references.
pub const GT_WRITE_ACCEPTED: u8 = 1;
/// The drives did not take them, which stops; they were read back and have the values of
/// `in_force`.
pub const GT_WRITE_REFUSED: u8 = 2;
/// The drives did not take them, which stops, and cannot be read back.
pub const GT_WRITE_UNKNOWN: u8 = 3;

/// Inputs of one tick. Zero is refused where a forgotten value would be dangerous: reading, stop,
/// rearm.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct gt_tick_input {
    /// Cycles since the last tick: 1 when on time; each further one is a missed deadline. 0 counts
    /// as 1.
    pub elapsed_cycles: u32,
    /// GT_READING_DONE, or GT_READING_FAILED: then the server stops, and the last nominal
    /// references stand until the path comes back to them.
    pub reading: u8,
    /// The stop at the machine: GT_RELEASED or GT_PRESSED.
    pub stop: u8,
    /// Not 0: the program is to end, which ramps as a stop does and latches nothing. Hold it until
    /// the program ends.
    pub quit: u8,
    /// The re-arm at the machine: GT_RELEASED or GT_PRESSED. It counts only after it was seen
    /// released in Fault.
    pub rearm: u8,
    /// Sample of the force sensor, for the client; zero without one.
    pub sensor: gt_wrench_sample,
    /// Nominal references of this cycle, nm.
    pub nominal_nm: [i64; GT_MAX_AXES],
    /// Measurements of the drives.
    pub actual: [gt_actual; GT_MAX_AXES],
}

/// There is no sample.
pub const GT_SAMPLE_NONE: u8 = 0;
/// There is a sample.
pub const GT_SAMPLE_DONE: u8 = 1;
/// There is a sample, with a component that was cut to its range: not to be used as a measurement.
pub const GT_SAMPLE_CUT: u8 = 2;

/// Sample of the force sensor. The server decides nothing by it: its State carries it to the client.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct gt_wrench_sample {
    /// GT_SAMPLE_NONE: the rest is not looked at; GT_SAMPLE_DONE or GT_SAMPLE_CUT.
    pub status: u8,
    /// Ticks since it was measured: 0 in this tick, 255 for 255 or more.
    pub age: u8,
    /// Force, the sensor's axes, mN.
    pub force_mn: [i32; 3],
    /// Moment about the sensor's origin, the sensor's axes, uN m.
    pub moment_unm: [i32; 3],
}

/// Rounds a raw sample of a force sensor (sensor axes, about its origin) to the nearest mN and uN m.
/// A component beyond 2^31 - 1 of them is cut, and `status` says so; with a NaN there is no sample.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_wrench_sample_of(
    raw: *const gt_wrench,
    age: u8,
    sample: *mut gt_wrench_sample,
) -> gt_code {
    // SAFETY: the header's rules for pointers; null is allowed for the error.
    unsafe {
        answer(sample, null_mut(), || {
            let raw = Wrench::from(read(raw)?);
            let sample = WrenchSample::from_si(&raw.to_array(), age);
            Ok(sample.into())
        })
    }
}

/// References that one motor's drive receives.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct gt_reference {
    /// Position reference: nominal plus offset, inside the machine's travel, nm.
    pub position_nm: i64,
    /// Additive velocity reference, um/s.
    pub velocity_offset_um_s: i32,
    /// Additive torque reference, per mille of rated torque.
    pub torque_offset_permille: i16,
}

/// References of a cycle in which no tick is run.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_held {
    /// Not 0: write `motors` to the drives. 0: nothing may be written.
    pub write: u8,
    /// Not 0: `motors` are on the nominal references of this cycle; 0: on those of the last tick.
    pub follows: u8,
    /// Number of motors.
    pub motor_count: u32,
    /// References of every motor; unused entries are zero, all of them if `write` is 0.
    pub motors: [gt_reference; GT_MAX_MOTORS],
}

/// Phases of a session; numbers as on the wire.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum gt_phase {
    /// No session. All offsets are zero.
    Listening = 0,
    /// A session is granted, its first Command is awaited. All offsets are zero.
    Handshake = 1,
    /// Commands move a shadow that is only reported. All offsets are zero.
    Submit = 2,
    /// Commands move the references.
    Obtain = 3,
    /// The session is over, every offset ramps to zero.
    SafeDisconnect = 4,
    /// Stopped: every offset ramps to zero, and only a local re-arm leads out.
    Fault = 5,
}

/// Cause of the end of a session; numbers as on the wire.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum gt_cause {
    /// No session has ended.
    None = 0,
    /// Two consecutive deadlines passed without a Command.
    ClientLate = 1,
    /// Two consecutive deadlines passed; Commands arrived, but late.
    NetworkLate = 2,
    /// The server overran its own cycle.
    ServerLate = 3,
    /// A broken frame boundary, checksum or tag on the owner's stream.
    Malformed = 4,
    /// The owner's connection was closed, or could not take a State.
    Closed = 5,
    /// The owner said goodbye.
    Goodbye = 6,
    /// More misses within the window than the budget allows.
    Budget = 7,
    /// A stop, at the machine or by the owner.
    Stop = 8,
    /// The nominal reference stepped further than its limit.
    Nominal = 9,
    /// The owner sent more frames in one tick than are read.
    Flood = 10,
    /// No Command followed the Welcome in time.
    HandshakeTimeout = 11,
    /// Offsets were in force that the server did not expect: at its start, or after a refused
    /// write.
    Restart = 12,
    /// The position offset of an axis was shaken by more than its agitation budget allows.
    Agitated = 13,
    /// A cause without a number of its own here.
    Other = 255,
}

/// Counts since the session was granted; they saturate.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_counters {
    /// Frames of the owner, valid or not.
    pub received: u32,
    /// Deadlines that passed without a fresh valid Command.
    pub missed: u32,
    /// Commands for a tick already past, or overtaken in the same tick.
    pub late: u32,
    /// Commands with the sequence of one that was accepted.
    pub duplicate: u32,
    /// Frames of another epoch, out of sequence, or echoing a tick that was never sent.
    pub stale: u32,
    /// Frames of the owner with bad content, or not allowed in the phase.
    pub malformed: u32,
    /// Commands refused because a target lies beyond M.
    pub out_of_range: u32,
    /// Channel steps that step or accel held back.
    pub limited: u32,
    /// References that the travel clamped.
    pub clamped: u32,
    /// Frames of non-owners, Hellos aside.
    pub non_owner: u32,
    /// Longest run of consecutive misses.
    pub longest_miss_run: u16,
}

/// One axis after a tick.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_axis_state {
    /// Nominal reference, without offset, nm.
    pub nominal_nm: i64,
    /// Offsets in force.
    pub offsets: gt_offsets,
    /// Offsets that would be in force if Submit were Obtain; zero outside Submit.
    pub shadow: gt_offsets,
    /// Measurements of the drive.
    pub actual: gt_actual,
    /// Values that were clamped or limited in this tick: GT_FLAG_ bits.
    pub flags: u8,
}

/// State of the server after a tick, as the owner receives it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_state {
    /// Number of this tick.
    pub tick: u64,
    /// Epoch of the current or last session.
    pub epoch: u64,
    /// Sequence of the last accepted Command; 0 before the first.
    pub accepted: u64,
    /// The phase.
    pub phase: gt_phase,
    /// Cause of the end of the last session; it stays until the next end.
    pub cause: gt_cause,
    /// Ticks until every offset would be zero if the ramp began now.
    pub ramp_ticks_left: u32,
    /// Arrival of the last Command, us, as given.
    pub arrival_us: u16,
    /// On-time Commands among the last 100 deadlines.
    pub on_time_of_100: u8,
    /// Counts since the session was granted.
    pub counters: gt_counters,
    /// Sample of the force sensor, as given.
    pub sensor: gt_wrench_sample,
    /// Number of axes.
    pub axis_count: u32,
    /// The axes; unused entries are zero.
    pub axes: [gt_axis_state; GT_MAX_AXES],
}

/// Outputs of one tick.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_tick_output {
    /// Not 0: write `motors` to the drives. 0: the values in force at the drives are unknown, so
    /// nothing may be written.
    pub write: u8,
    /// Number of motors.
    pub motor_count: u32,
    /// References of every motor; unused entries are zero, all of them if `write` is 0.
    pub motors: [gt_reference; GT_MAX_MOTORS],
    /// Hellos refused in this tick.
    pub refused: u32,
    /// Not 0: a session was granted in this tick.
    pub welcomed: u8,
    /// Not 0: `owner` has a session, or still receives States after its end.
    pub has_owner: u8,
    /// Connection of the owner.
    pub owner: u64,
    /// Cause of an end of a session, or of a stop, in this tick; GT_CAUSE_NONE without one.
    pub ended: gt_cause,
    /// Not 0: a stop is latched, by other than `quit`, and not re-armed. Store it before the motors
    /// are written; it is the `stop_latched` of the next start, in this process or a later one.
    pub latched: u8,
    /// State after the tick, as it is sent if the drives take the references.
    pub state: gt_state,
}

without_padding!(gt_phase gt_cause);

padded! {
    gt_actual { position_nm velocity_um_s torque_permille }
    gt_reference { position_nm velocity_offset_um_s torque_offset_permille }
    gt_wrench_sample { status age force_mn moment_unm }
    gt_held { write follows motor_count motors }
    gt_counters {
        received missed late duplicate stale malformed out_of_range limited clamped non_owner longest_miss_run
    }
    gt_axis_state { nominal_nm offsets shadow actual flags }
    gt_state { tick epoch accepted phase cause ramp_ticks_left arrival_us on_time_of_100 counters sensor axis_count axes }
    gt_tick_output { write motor_count motors refused welcomed has_owner owner ended latched state }
}

/// Reads a switch or button.
fn pressed(value: u8, field: gt_parameter) -> Reply<bool> {
    match value {
        GT_RELEASED => Ok(false),
        GT_PRESSED => Ok(true),
        _ => Err(refused(value, field)),
    }
}

fn refused(value: u8, field: gt_parameter) -> gt_error {
    gt_error::new(gt_code::TickInput)
        .of(field)
        .value(value.into())
}

impl gt_tick_input {
    pub(crate) fn to_core<const N: usize>(self) -> Reply<TickInput<N>> {
        Ok(TickInput {
            elapsed_cycles: self.elapsed_cycles,
            reading: match self.reading {
                GT_READING_DONE => Some(Reading {
                    nominal: resized(&self.nominal_nm, 0).map(PositionNm),
                    actual: resized(&self.actual, gt_actual::default()).map(Actual::from),
                }),
                GT_READING_FAILED => None,
                other => return Err(refused(other, gt_parameter::Reading)),
            },
            sensor: self.sensor.to_core()?,
            stop: pressed(self.stop, gt_parameter::Stop)?,
            quit: self.quit != 0,
            rearm: pressed(self.rearm, gt_parameter::Rearm)?,
        })
    }
}

impl gt_wrench_sample {
    fn to_core(self) -> Reply<Option<WrenchSample>> {
        let is_cut = match self.status {
            GT_SAMPLE_NONE => return Ok(None),
            GT_SAMPLE_DONE => false,
            GT_SAMPLE_CUT => true,
            other => return Err(refused(other, gt_parameter::Sensor)),
        };
        Ok(Some(WrenchSample {
            age: self.age,
            is_cut,
            force: self.force_mn.map(ForceMn),
            moment: self.moment_unm.map(MomentUnm),
        }))
    }
}

impl From<Option<WrenchSample>> for gt_wrench_sample {
    fn from(sample: Option<WrenchSample>) -> Self {
        let Some(sample) = sample else {
            return Self::default();
        };
        Self {
            status: if sample.is_cut {
                GT_SAMPLE_CUT
            } else {
                GT_SAMPLE_DONE
            },
            age: sample.age,
            force_mn: sample.force.map(|force| force.0),
            moment_unm: sample.moment.map(|moment| moment.0),
        }
    }
}

/// Says of references what became of them; `in_force` is asked for values that were read back.
pub(crate) fn say<const N: usize>(
    write: Write<'_, N>,
    fate: u8,
    in_force: impl FnOnce() -> Reply<[gt_in_force; N]>,
) -> Reply {
    match (fate, write) {
        (GT_WRITE_ACCEPTED, Write::Due(write)) => write.accepted(),
        (GT_WRITE_ACCEPTED, write) => {
            write.unknown();
            return Err(gt_code::Withheld.into());
        }
        (GT_WRITE_REFUSED, write) => {
            let in_force = in_force()?.map(InForce::from);
            match write {
                Write::Due(write) => write.refused(in_force),
                Write::Withheld(drives) => drives.read_back(in_force),
            }
        }
        (GT_WRITE_UNKNOWN, write) => write.unknown(),
        _ => return Err(gt_code::Write.into()),
    }
    Ok(())
}

impl gt_held {
    /// Converts references, with `motors` motors in use.
    pub(super) fn new<const N: usize>(
        held: Option<&Held<N>>,
        map: &MotorMap<N, GT_MAX_MOTORS>,
        motors: usize,
    ) -> Self {
        let references = held.and_then(|held| map.spread(&held.references));
        Self {
            write: references.is_some().into(),
            follows: held.is_some_and(|held| held.follows).into(),
            motor_count: small(motors),
            motors: places(references.as_ref(), motors),
        }
    }
}

/// References of the `motors` motors in use; the other places are zero.
fn places(
    references: Option<&[Reference; GT_MAX_MOTORS]>,
    motors: usize,
) -> [gt_reference; GT_MAX_MOTORS] {
    let mut places = [gt_reference::default(); GT_MAX_MOTORS];
    for (to, from) in places
        .iter_mut()
        .zip(references.into_iter().flatten())
        .take(motors)
    {
        *to = (*from).into();
    }
    places
}

impl gt_tick_output {
    /// Converts the references and the output of a tick, with `motors` motors in use.
    pub(crate) fn new<const N: usize>(
        references: Option<&[Reference; GT_MAX_MOTORS]>,
        output: &Output<N>,
        motors: usize,
    ) -> Self {
        Self {
            write: references.is_some().into(),
            motor_count: small(motors),
            motors: places(references, motors),
            refused: small(output.refusals.len()),
            welcomed: output.welcome.is_some().into(),
            has_owner: output.owner.is_some().into(),
            owner: output.owner.map_or(0, |owner| owner.0),
            ended: output.ended.unwrap_or_default().into(),
            latched: output.latched.into(),
            state: (&output.state).into(),
        }
    }
}

impl From<gt_actual> for Actual {
    fn from(actual: gt_actual) -> Self {
        Self {
            position: PositionNm(actual.position_nm),
            velocity: VelocityUmS(actual.velocity_um_s),
            torque: TorquePermille(actual.torque_permille),
        }
    }
}

impl From<Actual> for gt_actual {
    fn from(actual: Actual) -> Self {
        Self {
            position_nm: actual.position.0,
            velocity_um_s: actual.velocity.0,
            torque_permille: actual.torque.0,
        }
    }
}

impl From<Reference> for gt_reference {
    fn from(reference: Reference) -> Self {
        Self {
            position_nm: reference.position.0,
            velocity_offset_um_s: reference.velocity_offset.0,
            torque_offset_permille: reference.torque_offset.0,
        }
    }
}

by_name!(Phase => gt_phase { Listening Handshake Submit Obtain SafeDisconnect Fault });

by_name!(Cause => gt_cause {
    None ClientLate NetworkLate ServerLate Malformed Closed Goodbye Budget Stop Nominal Flood HandshakeTimeout Restart
    Agitated; else Other
});

impl From<Counters> for gt_counters {
    fn from(counters: Counters) -> Self {
        Self {
            received: counters.received,
            missed: counters.missed,
            late: counters.late,
            duplicate: counters.duplicate,
            stale: counters.stale,
            malformed: counters.malformed,
            out_of_range: counters.out_of_range,
            limited: counters.limited,
            clamped: counters.clamped,
            non_owner: counters.non_owner,
            longest_miss_run: counters.longest_miss_run,
        }
    }
}

impl From<AxisState> for gt_axis_state {
    fn from(axis: AxisState) -> Self {
        Self {
            nominal_nm: axis.nominal.0,
            offsets: axis.offsets.into(),
            shadow: axis.shadow.into(),
            actual: axis.actual.into(),
            flags: axis.flags.bits(),
        }
    }
}

impl<const N: usize> From<&State<N>> for gt_state {
    fn from(state: &State<N>) -> Self {
        Self {
            tick: state.tick.0,
            epoch: state.epoch.0,
            accepted: state.accepted.0,
            phase: state.phase.into(),
            cause: state.cause.into(),
            ramp_ticks_left: state.ramp_ticks_left,
            arrival_us: state.arrival_us,
            on_time_of_100: state.on_time_of_100,
            counters: state.counters.into(),
            sensor: state.sensor.into(),
            axis_count: small(N),
            axes: resized(&state.axes, AxisState::default()).map(gt_axis_state::from),
        }
    }
}
