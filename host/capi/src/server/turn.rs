//! What goes into a tick and what comes out of it.

use gantry_tau_core::control::axis::{Actual, Reference};
use gantry_tau_core::control::endpoint::{CONNECTIONS, Cycle, Turn};
use gantry_tau_core::control::message::{AxisFlags, AxisState, Cause, Counters, Phase, State};
use gantry_tau_core::units::{Epoch, PositionNm, TorquePermille, VelocityUmS};

use super::config::{first, gt_offsets};
use super::{GT_MAX_AXES, GT_MAX_CONNECTIONS, GT_MAX_MOTORS};

const _: () = assert!(
    GT_MAX_CONNECTIONS == CONNECTIONS,
    "every connection to be closed is named"
);

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

const _: () = assert!(
    GT_FLAG_TRAVEL == AxisFlags::TRAVEL.bits()
        && GT_FLAG_POSITION_LIMITED == AxisFlags::POSITION_LIMITED.bits()
        && GT_FLAG_VELOCITY_LIMITED == AxisFlags::VELOCITY_LIMITED.bits()
        && GT_FLAG_TORQUE_LIMITED == AxisFlags::TORQUE_LIMITED.bits()
        && GT_FLAG_NOMINAL_STEP == AxisFlags::NOMINAL_STEP.bits(),
    "the flags are core's"
);

/// What a drive measures.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct gt_actual {
    /// Position of the motor side of the axis, nm.
    pub position_nm: i64,
    /// Velocity, um/s.
    pub velocity_um_s: i32,
    /// Torque, per mille of rated torque.
    pub torque_permille: i16,
}

/// What one tick is given.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_cycle {
    /// Cycles since the last tick: 1 when on time; more after an overrun, and each skipped one is a miss. 0 counts as 1.
    pub elapsed: u32,
    /// Not 0: the stop at the machine is asserted.
    pub stop: u8,
    /// Not 0: somebody at the machine re-arms. It must be seen released in Fault before it counts.
    pub rearm: u8,
    /// When in the cycle the last Command arrived, us after the last State left; evidence only, 0 where it is not timed.
    pub arrival_us: u16,
    /// Epoch for the next session: above every epoch ever given, written to storage before this call.
    pub next_epoch: u64,
    /// Nominal references of this cycle, nm.
    pub nominal_nm: [i64; GT_MAX_AXES],
    /// What the drives measure.
    pub actual: [gt_actual; GT_MAX_AXES],
}

/// What one motor's drive receives.
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

/// Why a session ended, or why the server is not listening; numbers as on the wire.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum gt_cause {
    /// Nothing has ended.
    None = 0,
    /// Two deadlines in a row passed without any Command.
    ClientLate = 1,
    /// Two deadlines in a row passed, but Commands for older ticks did arrive.
    NetworkLate = 2,
    /// The server overran its own cycle.
    ServerLate = 3,
    /// A broken frame boundary or checksum on the owner's stream.
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
    /// The server started, or resumed, with offsets still in force.
    Restart = 12,
}

/// Counts since the session was granted; they saturate.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_counters {
    /// Frames of the owner, whatever their content.
    pub received: u32,
    /// Deadlines that passed without a fresh valid Command.
    pub missed: u32,
    /// Commands for a tick already past, or overtaken in the same tick.
    pub late: u32,
    /// Commands with the sequence of one that was accepted.
    pub duplicate: u32,
    /// Frames of another epoch, out of sequence, or echoing a tick that was never sent.
    pub stale: u32,
    /// Well-framed Commands with bad content, and frames that have no place in the phase.
    pub malformed: u32,
    /// Commands refused because a target lies beyond M.
    pub out_of_range: u32,
    /// Channel steps that step or accel held back.
    pub limited: u32,
    /// References that the travel clamped.
    pub clamped: u32,
    /// Frames from connections that own nothing, Hellos aside.
    pub strangers: u32,
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
    /// Where the offsets would be if Submit were Obtain; zero outside Submit.
    pub shadow: gt_offsets,
    /// What the drive measures.
    pub actual: gt_actual,
    /// What was clamped or limited in this tick: GT_FLAG_ bits.
    pub flags: u8,
}

/// The server after a tick: what the owner is told, for a monitor.
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
    /// Why the last session ended; it stays until the next end.
    pub cause: gt_cause,
    /// Ticks until every offset would be zero if the ramp began now.
    pub ramp_ticks_left: u32,
    /// When in the cycle the last Command arrived, us, as given.
    pub arrival_us: u16,
    /// On-time Commands among the last 100 deadlines.
    pub on_time_of_100: u8,
    /// Counts since the session was granted.
    pub counters: gt_counters,
    /// How many axes there are.
    pub axis_count: u32,
    /// The axes; those that are not there are zero.
    pub axes: [gt_axis_state; GT_MAX_AXES],
}

/// What one tick gives back.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct gt_turn {
    /// How many motors there are.
    pub motor_count: u32,
    /// What every motor receives, in every tick; those that are not there are zero.
    pub motors: [gt_reference; GT_MAX_MOTORS],
    /// How many frames wait to be written: gt_server_frame.
    pub frame_count: u32,
    /// How many connections are to be closed once their frames are written. The server has forgotten them already.
    pub close_count: u32,
    /// Those connections.
    pub close: [u64; GT_MAX_CONNECTIONS],
    /// Hellos refused in this tick.
    pub refused: u32,
    /// Not 0: a session was granted in this tick, and next_epoch is used up.
    pub welcomed: u8,
    /// Not 0: `owner` has a session, or is still told how it ends.
    pub has_owner: u8,
    /// The owner's connection.
    pub owner: u64,
    /// Why a session ended, or the server stopped, in this tick; GT_CAUSE_NONE: neither.
    pub ended: gt_cause,
    /// The state after the tick.
    pub state: gt_state,
}

impl gt_cycle {
    pub(super) fn to_core<const N: usize>(self) -> Cycle<N> {
        Cycle {
            elapsed: self.elapsed,
            nominal: first(&self.nominal_nm, 0, PositionNm),
            actual: first(&self.actual, gt_actual::default(), Actual::from),
            stop: self.stop != 0,
            rearm: self.rearm != 0,
            next_epoch: Epoch(self.next_epoch),
            arrival_us: self.arrival_us,
        }
    }
}

impl gt_turn {
    /// What a tick gave, with so many motors and frames.
    pub(super) fn new<const N: usize>(
        turn: &Turn<N, GT_MAX_MOTORS>,
        motors: usize,
        frames: usize,
    ) -> Self {
        let small = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let output = &turn.output;
        let mut references = [gt_reference::default(); GT_MAX_MOTORS];
        for (to, from) in references.iter_mut().zip(&turn.motors).take(motors) {
            *to = (*from).into();
        }
        let mut close = [0; GT_MAX_CONNECTIONS];
        for (to, from) in close.iter_mut().zip(&turn.close) {
            *to = from.0;
        }
        Self {
            motor_count: small(motors),
            motors: references,
            frame_count: small(frames),
            close_count: small(turn.close.len()),
            close,
            refused: small(output.refusals.len()),
            welcomed: output.welcome.is_some().into(),
            has_owner: output.owner.is_some().into(),
            owner: output.owner.map_or(0, |owner| owner.0),
            ended: output.ended.unwrap_or_default().into(),
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

impl From<Phase> for gt_phase {
    fn from(phase: Phase) -> Self {
        match phase {
            Phase::Listening => Self::Listening,
            Phase::Handshake => Self::Handshake,
            Phase::Submit => Self::Submit,
            Phase::Obtain => Self::Obtain,
            Phase::SafeDisconnect => Self::SafeDisconnect,
            Phase::Fault => Self::Fault,
        }
    }
}

impl From<Cause> for gt_cause {
    fn from(cause: Cause) -> Self {
        match cause {
            Cause::None => Self::None,
            Cause::ClientLate => Self::ClientLate,
            Cause::NetworkLate => Self::NetworkLate,
            Cause::ServerLate => Self::ServerLate,
            Cause::Malformed => Self::Malformed,
            Cause::Closed => Self::Closed,
            Cause::Goodbye => Self::Goodbye,
            Cause::Budget => Self::Budget,
            Cause::Stop => Self::Stop,
            Cause::Nominal => Self::Nominal,
            Cause::Flood => Self::Flood,
            Cause::HandshakeTimeout => Self::HandshakeTimeout,
            Cause::Restart => Self::Restart,
        }
    }
}

impl From<Counters> for gt_counters {
    fn from(counters: Counters) -> Self {
        let Counters {
            received,
            missed,
            late,
            duplicate,
            stale,
            malformed,
            out_of_range,
            limited,
            clamped,
            strangers,
            longest_miss_run,
        } = counters;
        Self {
            received,
            missed,
            late,
            duplicate,
            stale,
            malformed,
            out_of_range,
            limited,
            clamped,
            strangers,
            longest_miss_run,
        }
    }
}

impl From<AxisState> for gt_axis_state {
    fn from(axis: AxisState) -> Self {
        let AxisState {
            nominal,
            offsets,
            shadow,
            actual,
            flags,
        } = axis;
        Self {
            nominal_nm: nominal.0,
            offsets: offsets.into(),
            shadow: shadow.into(),
            actual: actual.into(),
            flags: flags.bits(),
        }
    }
}

impl<const N: usize> From<&State<N>> for gt_state {
    fn from(state: &State<N>) -> Self {
        let axes = core::array::from_fn(|index| {
            let axis = state.axes.get(index).copied();
            axis.unwrap_or_default().into()
        });
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
            axis_count: u32::try_from(N).unwrap_or(0),
            axes,
        }
    }
}
