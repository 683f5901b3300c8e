//! The machine after one tick, as `monitor --status` prints it: one JSON object with stable keys.

use gantry_tau_core::control::message::{AxisFlags, Cause, Phase};
use gantry_tau_labcomm::samples;
use serde::{Serialize, Serializer};

use super::machine::MachineName;

/// Machine and session after one tick. Numbers are those of the wire: nm, µm/s, per mille of rated
/// torque.
///
/// A value that the server does not send is `null`: force, gauges and displacement of a machine
/// without instruments at the tool, and the lag in a tick whose predecessor was not received; the
/// drives of a machine that does not tell their states.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Snapshot {
    /// Number of the tick.
    pub tick: i64,
    /// Phase; in JSON its name in lower case, words joined by `_`.
    #[serde(serialize_with = "phase_key")]
    pub phase: Phase,
    /// Epoch of the current or last session.
    pub epoch: i64,
    /// Cause of the end of the last session; in JSON as `phase`.
    #[serde(serialize_with = "cause_key")]
    pub cause: Cause,
    /// Sequence number of the last accepted command.
    pub sequence: i64,
    /// Commands on time among the last 100.
    pub on_time: u8,
    /// Ticks until every offset is zero, if the ramp began now.
    pub ramp_ticks_left: i32,
    /// Counts since the session was granted.
    pub counters: Counters,
    /// Longest run of missed ticks since the session was granted.
    pub longest_miss_run: i16,
    /// The machine did not answer, and the server has not listened since.
    pub machine_failed: bool,
    /// Rows of the server's recording, or of its publication, are lost.
    pub rows_lost: bool,
    /// The axes, axis order.
    pub axes: Vec<AxisSnapshot>,
    /// States of the drives, axis order: `not_ready`, `ready`, `operating`, `quick_stop`, `fault`.
    pub drives: Option<Vec<&'static str>>,
    /// Force (N) and moment (N m) on the platform, world axes.
    pub force: Option<[f64; 6]>,
    /// Lengths of the gauges, m.
    pub gauges_m: Option<[f64; 3]>,
    /// Displacement of the tool from its nominal position, world axes, m.
    pub displacement_m: Option<[f64; 3]>,
    /// Turn of the platform from its nominal orientation, rotation vector, world axes, rad.
    pub turn_rad: Option<[f64; 3]>,
    /// The machine; `None` of a server that does not say, as those of earlier versions.
    pub machine: Option<MachineName>,
}

/// Counts since the session was granted, as in `wire.md`; at most 2^31 - 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[expect(missing_docs, reason = "wire.md describes them")]
pub struct Counters {
    pub received: i32,
    pub missed: i32,
    pub late: i32,
    pub duplicate: i32,
    pub stale: i32,
    pub malformed: i32,
    pub out_of_range: i32,
    pub limited: i32,
    pub clamped: i32,
    /// Frames of peers that do not own the session.
    pub strangers: i32,
}

impl From<[i32; 10]> for Counters {
    fn from(counts: [i32; 10]) -> Self {
        let [
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
        ] = counts;
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
        }
    }
}

/// One axis.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct AxisSnapshot {
    /// Nominal position, nm.
    pub nominal_nm: i64,
    /// Reference written to the drive, nm.
    pub reference_nm: i64,
    /// Offsets in force.
    pub offset: Channels<i32>,
    /// Position offset that would be in force in Obtain, nm; 0 outside Submit.
    pub shadow_nm: i32,
    /// Measurements of the drive.
    pub actual: Channels<i64>,
    /// Position lag, nm: reference of the tick before less actual position. The drive has followed
    /// that reference when it is measured.
    pub lag_nm: Option<i64>,
    /// Names of the flags that are set.
    pub flags: Vec<&'static str>,
}

/// Position, velocity and torque.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Channels<P> {
    /// Position, nm.
    pub position_nm: P,
    /// Velocity, µm/s.
    pub velocity_um_s: i32,
    /// Torque, per mille of rated torque.
    pub torque_permille: i16,
}

impl AxisSnapshot {
    /// An axis as it was received, with its reference of the tick before.
    pub(super) fn new(axis: &samples::Axis, reference_before_nm: Option<i64>) -> Self {
        Self {
            nominal_nm: axis.nominal_nm,
            reference_nm: axis.reference_nm,
            offset: Channels {
                position_nm: axis.position_offset_nm,
                velocity_um_s: axis.velocity_offset_um_s,
                torque_permille: axis.torque_offset_permille,
            },
            shadow_nm: axis.shadow_nm,
            actual: Channels {
                position_nm: axis.actual_nm,
                velocity_um_s: axis.actual_velocity_um_s,
                torque_permille: axis.actual_torque_permille,
            },
            lag_nm: reference_before_nm.and_then(|before| before.checked_sub(axis.actual_nm)),
            flags: flag_names(axis.flags),
        }
    }
}

/// Names of flags, in the order of their bits.
const FLAGS: [(AxisFlags, &str); 6] = [
    (AxisFlags::TRAVEL, "clamped"),
    (AxisFlags::POSITION_LIMITED, "position_limited"),
    (AxisFlags::VELOCITY_LIMITED, "velocity_limited"),
    (AxisFlags::TORQUE_LIMITED, "torque_limited"),
    (AxisFlags::NOMINAL_STEP, "nominal_step"),
    (AxisFlags::NOMINAL_ACCEL, "nominal_accel"),
];

fn flag_names(bits: u8) -> Vec<&'static str> {
    FLAGS
        .iter()
        .filter(|(flag, _)| bits & flag.bits() != 0)
        .map(|(_, name)| *name)
        .collect()
}

/// Exit status of `monitor --status` without a server.
pub const NO_SERVER: u8 = 6;

impl Snapshot {
    /// Exit status of `monitor --status`: 0 with or without a session, 3 while offsets ramp to
    /// zero, 4 in Fault, 5 after the machine failed.
    #[must_use]
    pub const fn exit_status(&self) -> u8 {
        if self.machine_failed {
            return 5;
        }
        match self.phase {
            Phase::Listening | Phase::Handshake | Phase::Submit | Phase::Obtain => 0,
            Phase::SafeDisconnect => 3,
            Phase::Fault => 4,
        }
    }

    /// The object on one line.
    #[must_use]
    pub fn json(&self) -> String {
        // Keys are text and values are numbers, so writing to a `String` does not fail.
        serde_json::to_string(self).unwrap_or_default()
    }
}

/// `SafeDisconnect` as `safe_disconnect`.
pub(super) fn key_of(name: &str) -> String {
    let mut key = String::new();
    for letter in name.chars() {
        if letter.is_ascii_uppercase() && !key.is_empty() {
            key.push('_');
        }
        key.push(letter.to_ascii_lowercase());
    }
    key
}

fn phase_key<S: Serializer>(phase: &Phase, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&key_of(phase.name()))
}

fn cause_key<S: Serializer>(cause: &Cause, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&key_of(cause.name()))
}
