//! Recording of what a monitor receives: rows as the server's own recording has them.

use gantry_tau_core::control::axis::{Actual, Offsets, Reference};
use gantry_tau_core::control::message::{AxisFlags, AxisState, Counters, Phase, State};
use gantry_tau_core::units::{Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS};
use gantry_tau_labcomm::samples;

use super::assembly::Tick as Received;
use super::snapshot::MachineName;
use super::stream::{Happened, StreamError};
use crate::plant::{DriveState, ToolReading};
use crate::record::{self, RecordError, Recorded, Recording};
use crate::server::cycle::Row;
use crate::server::event_log::{Event, EventKind};

/// Events that wait for their tick at most: more than a server sends, and a bound on what another one can cause.
const WAITING: usize = 64;
/// Events of a row at most, which [`Ticks`](crate::publication::Ticks) has room for; the others are written with the next rows.
const PER_ROW: usize = 4;

/// Takes what a monitor receives.
pub trait Tap {
    /// Takes note that what follows comes over another connection, from a server that may have been started again.
    fn connected(&mut self);

    /// Takes an event. Those of a tick come before or after it.
    fn happened(&mut self, event: &Happened);

    /// Takes a whole tick, of the machine that the server names.
    ///
    /// # Errors
    /// [`StreamError`]: the tick is of another machine, or of another version of the program.
    fn tick(&mut self, tick: &Received, machine: Option<&MachineName>) -> Result<(), StreamError>;

    /// Completes the file; `None` if its thread panicked.
    fn finish(self: Box<Self>) -> Option<Recorded>;
}

/// A recording in a thread of its own, and the tick that waits for its events.
struct Recorder<const N: usize> {
    recording: record::Recorder<Row<N>, N>,
    /// The recording draws the machine, and so needs its name.
    draws: bool,
    /// Checksum of the machine's kinematic parameters.
    kinematics: u32,
    waiting: Option<Row<N>>,
    /// Events that are not written, at most [`WAITING`].
    events: Vec<Event>,
    /// Events for which there was no place.
    lost: u64,
    /// Machine whose ticks were not taken.
    other: Option<StreamError>,
}

/// Takes a recording of a machine of `N` axes, whose kinematic parameters have this checksum.
///
/// # Errors
/// [`RecordError`]: there is no further thread.
pub fn tap<const N: usize>(recording: Recording<N>, kinematics: u32) -> Result<Box<dyn Tap>, RecordError> {
    let draws = recording.draws();
    let recording = record::Recorder::start(recording)?;
    Ok(Box::new(Recorder { recording, draws, kinematics, waiting: None, events: Vec::new(), lost: 0, other: None }))
}

impl<const N: usize> Recorder<N> {
    /// Returns the reason for which a tick is not of this recording's machine.
    fn other_machine(&self, tick: &Received, machine: Option<&MachineName>) -> Option<StreamError> {
        let (sent, expected) = (tick.axes.count, N);
        if sent != expected {
            return Some(StreamError::OtherMachine { sent, expected });
        }
        match machine {
            Some(machine) if machine.kinematics != self.kinematics => {
                Some(StreamError::OtherKinematics { sent: machine.kinematics, expected: self.kinematics })
            }
            None if self.draws => Some(StreamError::UnknownMachine),
            _ => None,
        }
    }

    /// Writes the tick that waits, with the events up to it.
    fn write(&mut self) {
        let Some(row) = self.waiting.take() else { return };
        let mut room = PER_ROW;
        let (now, later) = self.events.drain(..).partition(|event: &Event| {
            let is_now = event.tick <= row.state.tick.0 && room > 0;
            room = room.saturating_sub(usize::from(is_now));
            is_now
        });
        self.events = later;
        self.recording.push_patiently(row, now);
    }
}

impl<const N: usize> Tap for Recorder<N> {
    /// Another connection begins another file, so that time never goes back in one, and two runs never share one.
    fn connected(&mut self) {
        self.write();
        self.events.clear();
        self.recording.begin_next();
    }

    fn happened(&mut self, happened: &Happened) {
        if self.events.len() == WAITING {
            self.lost = self.lost.saturating_add(1);
            return;
        }
        let tick = unsigned(happened.tick);
        self.events.extend(EventKind::from_code(happened.kind).map(|kind| Event {
            tick,
            kind,
            code: happened.code,
            text: happened.text.clone(),
        }));
    }

    fn tick(&mut self, tick: &Received, machine: Option<&MachineName>) -> Result<(), StreamError> {
        if let Some(other) = self.other_machine(tick, machine) {
            self.other = Some(other);
            return Err(other);
        }
        let before = self.waiting.map(|row| row.state.tick.0);
        self.write();
        self.waiting = Some(row(tick, before)?);
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Option<Recorded> {
        self.write();
        if let Some(other) = self.other {
            tracing::warn!("ticks are not in the recording: {other}");
        }
        if self.lost > 0 {
            tracing::warn!("{} events are not in the recording: more than {WAITING} waited for their ticks", self.lost);
        }
        self.recording.finish(0)
    }
}

/// Row of the server for a tick, of which no other is told than is sent: no round trip.
fn row<const N: usize>(tick: &Received, before: Option<u64>) -> Result<Row<N>, StreamError> {
    let Received { state, axes, tool, drives } = tick;
    let mut of_axes = axes.axis.iter();
    let axes: [samples::Axis; N] =
        std::array::from_fn(|_| of_axes.next().copied().unwrap_or(gantry_tau_labcomm::Field::ZERO));
    let mut states = [AxisState::default(); N];
    for (place, axis) in states.iter_mut().zip(&axes) {
        *place = axis_state(axis)?;
    }
    let drives = match drives {
        Some(drives) => <[DriveState; N]>::try_from(drives.states()?).ok(),
        None => None,
    };
    let number = unsigned(state.tick);
    let elapsed = before.and_then(|before| number.checked_sub(before)).unwrap_or(1);
    Ok(Row {
        state: State {
            tick: Tick(number),
            epoch: Epoch(unsigned(state.epoch)),
            accepted: Sequence(unsigned(state.sequence)),
            phase: Phase::from_code(state.phase)
                .ok_or(StreamError::UnknownCode { field: "phase", code: state.phase })?,
            cause: super::cause(state.cause)?,
            on_time_of_100: state.on_time,
            arrival_us: 0,
            ramp_ticks_left: count(state.ramp_ticks_left),
            counters: counters(state),
            axes: states,
        },
        references: axes.map(|axis| Reference {
            position: PositionNm(axis.reference_nm),
            velocity_offset: VelocityUmS(axis.velocity_offset_um_s),
            torque_offset: TorquePermille(axis.torque_offset_permille),
        }),
        tool: tool.map(|tool| ToolReading {
            step: count(tool.step),
            load: tool.load,
            sensor: [0.0; 6],
            displacement_m: tool.displacement_m,
            turn_rad: tool.turn_rad,
            gauges_m: tool.gauges_m,
        }),
        ended: None,
        welcomed: false,
        refused: 0,
        elapsed: u32::try_from(elapsed).unwrap_or(u32::MAX),
        round_trip_us: None,
        plant_failed: false,
        failure: None,
        drives,
        // Not published.
        latched: false,
        latch_lost: false,
    })
}

fn axis_state(axis: &samples::Axis) -> Result<AxisState, StreamError> {
    Ok(AxisState {
        nominal: PositionNm(axis.nominal_nm),
        offsets: Offsets {
            position: OffsetNm(axis.position_offset_nm),
            velocity: VelocityUmS(axis.velocity_offset_um_s),
            torque: TorquePermille(axis.torque_offset_permille),
        },
        shadow: Offsets::position(OffsetNm(axis.shadow_nm)),
        actual: Actual {
            position: PositionNm(axis.actual_nm),
            velocity: VelocityUmS(axis.actual_velocity_um_s),
            torque: TorquePermille(axis.actual_torque_permille),
        },
        flags: AxisFlags::from_bits(axis.flags).ok_or(StreamError::UnknownCode { field: "flags", code: axis.flags })?,
    })
}

fn counters(state: &samples::State) -> Counters {
    let [received, missed, late, duplicate, stale, malformed, out_of_range, limited, clamped, non_owner] =
        state.counters.map(count);
    Counters {
        received,
        missed,
        late,
        duplicate,
        stale,
        malformed,
        out_of_range,
        limited,
        clamped,
        non_owner,
        longest_miss_run: u16::try_from(state.longest_miss_run).unwrap_or_default(),
    }
}

/// A number that is never negative, which LabComm's `long` cannot say.
fn unsigned(number: i64) -> u64 {
    u64::try_from(number).unwrap_or_default()
}

/// As [`unsigned`], for `int`.
fn count(number: i32) -> u32 {
    u32::try_from(number).unwrap_or_default()
}
