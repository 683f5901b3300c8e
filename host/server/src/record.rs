//! Records of ticks and of sessions' events, for observers.

use gantry_tau_core::control::axis::Reference;
use gantry_tau_core::control::keys::KeyId;
use gantry_tau_core::control::message::{AxisState, Cause, Counters, Phase, State};
use gantry_tau_core::units::{Epoch, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS};

use crate::plant::{DriveState, PlantFailure, ToolReading};

/// Result of one cycle, for observers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TickRecord<const N: usize> {
    /// State of the tick: nominal references, offsets, actual values, counters.
    pub state: State<N>,
    /// References of the axes. The drives have them unless `plant_failed`, or the server's own
    /// position loops are stopped in Fault.
    pub references: [Reference; N],
    /// Measurements at the tool.
    pub tool: Option<ToolReading>,
    /// Cause of the end of a session, or of a stop, in this tick.
    pub ended: Option<Cause>,
    /// A session was granted in this tick.
    pub welcomed: bool,
    /// Name of the key of the session; `None` without a session, or without keys.
    pub key: Option<KeyId>,
    /// Hellos refused in this tick.
    pub refused: u8,
    /// Cycles since the last tick.
    pub elapsed: u32,
    /// Time from the departure of the last State to the arrival of its answer, µs; `None` without
    /// an answer or without a clock.
    pub round_trip_us: Option<u32>,
    /// The machine could not be read, or has not taken the references.
    pub plant_failed: bool,
    /// The reason, if the machine named it.
    pub failure: Option<PlantFailure>,
    /// States of the drives, if the machine tells them.
    pub drives: Option<[DriveState; N]>,
    /// A stop is latched: asserted by other than the end of the server, and not re-armed.
    pub latched: bool,
    /// The last change of the stop latch is not written, or not yet: it would not outlive the
    /// server.
    pub latch_lost: bool,
}

impl<const N: usize> TickRecord<N> {
    /// Returns the record of a server that listens, with all values zero.
    #[must_use]
    pub fn listening() -> Self {
        let state = State {
            tick: Tick(0),
            epoch: Epoch(0),
            accepted: Sequence(0),
            phase: Phase::Listening,
            cause: Cause::None,
            on_time_of_100: 100,
            arrival_us: 0,
            ramp_ticks_left: 0,
            counters: Counters::default(),
            sensor: None,
            axes: [AxisState::default(); N],
        };
        let zero = Reference {
            position: PositionNm(0),
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        };
        Self {
            state,
            references: [zero; N],
            tool: None,
            ended: None,
            welcomed: false,
            key: None,
            refused: 0,
            elapsed: 1,
            round_trip_us: None,
            plant_failed: false,
            failure: None,
            drives: None,
            latched: false,
            latch_lost: false,
        }
    }
}

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// A session was granted.
    Granted,
    /// Hellos were refused; the code is that of the phase.
    Refused,
    /// A session ended, or a stop came without one; the code is that of the cause.
    Ended,
    /// The phase changed; the code is that of the new one.
    Phase,
    /// The machine did not answer.
    MachineFailed,
    /// A recording, or what publishes, has lost its first row.
    RowsLost,
}

impl EventKind {
    const ALL: [Self; 6] = [
        Self::Granted,
        Self::Refused,
        Self::Ended,
        Self::Phase,
        Self::MachineFailed,
        Self::RowsLost,
    ];

    /// Code in the sample `session_event`.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Granted => 0,
            Self::Refused => 1,
            Self::Ended => 2,
            Self::Phase => 3,
            Self::MachineFailed => 4,
            Self::RowsLost => 5,
        }
    }

    /// Name for tables and schemas.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Granted => "granted",
            Self::Refused => "refused",
            Self::Ended => "ended",
            Self::Phase => "phase changed",
            Self::MachineFailed => "machine failed",
            Self::RowsLost => "rows lost",
        }
    }

    /// Kind of a code.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.code() == code)
    }
}

/// Name and value of a counter of a session.
pub type Counter = (&'static str, fn(&Counters) -> u32);

/// Counters of a session, in the order of the wire format.
pub const COUNTERS: [Counter; 11] = [
    ("received", |counters| counters.received),
    ("missed", |counters| counters.missed),
    ("late", |counters| counters.late),
    ("duplicate", |counters| counters.duplicate),
    ("stale", |counters| counters.stale),
    ("malformed", |counters| counters.malformed),
    ("out_of_range", |counters| counters.out_of_range),
    ("limited", |counters| counters.limited),
    ("clamped", |counters| counters.clamped),
    ("non_owner", |counters| counters.non_owner),
    ("longest_miss_run", |counters| {
        counters.longest_miss_run.into()
    }),
];

/// Something that happened to a session or to the machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Tick in which it happened.
    pub tick: u64,
    /// Kind.
    pub kind: EventKind,
    /// Code of the wire for the phase or cause; 0 for kinds without one.
    pub code: u8,
    /// The same in words.
    pub text: String,
}

impl Event {
    pub(crate) const fn new(tick: u64, kind: EventKind, code: u8, text: String) -> Self {
        Self {
            tick,
            kind,
            code,
            text,
        }
    }
}
