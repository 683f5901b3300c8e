//! Recording of what a monitor receives: rows as the server's own recording has them.

use gantry_tau_core::control::axis::{Actual, Offsets, Reference};
use gantry_tau_core::control::message::{AxisFlags, AxisState, Counters, Phase, State};
use gantry_tau_core::units::{
    Epoch, OffsetNm, PositionNm, Sequence, Tick, TorquePermille, VelocityUmS,
};
use gantry_tau_labcomm::samples;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_record::recording::{self, RecordError, RecordTo, Recorded, Recording};
use gantry_tau_server::plant::{DriveState, ToolReading};
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::record::{Event, EventKind};
use gantry_tau_system::output::GrowingFile;

use super::assembly::ReceivedTick;
use super::machine::ServerMachine;
use super::stream::{Happened, StreamError};

/// Events that wait for their tick at most: more than a server sends, and a bound on what another
/// one can cause.
const WAITING: usize = 64;
/// Events of a row at most, which [`Ticks`](gantry_tau_server::publication::Ticks) has room for;
/// the others are written with the next rows.
const PER_ROW: usize = 4;

/// Receiver of what a monitor receives.
pub trait Tap {
    /// Takes note that what follows comes over another connection, from a server that may have been
    /// started again.
    fn connected(&mut self);

    /// Takes note of the machine that the server names, before its ticks.
    fn machine(&mut self, machine: &ServerMachine);

    /// Adds an event. Those of a tick come before or after it.
    fn happened(&mut self, event: &Happened);

    /// Adds a whole tick.
    ///
    /// # Errors
    /// [`StreamError`]: the tick is of another machine, or of another version of the program.
    fn tick(&mut self, tick: &ReceivedTick) -> Result<(), StreamError>;

    /// Completes the file; `None` if it has none, or if its thread panicked.
    fn finish(self: Box<Self>) -> Option<Recorded>;
}

/// Returns a recording of a machine; without one, of the machine that the server names.
///
/// # Errors
/// [`RecordError`]: the file cannot be made, or there is no further thread.
pub fn tap(to: RecordTo, robot: Option<&AnyRobotFile>) -> Result<Box<dyn Tap>, RecordError> {
    match robot {
        Some(robot) => recorder(&to, robot),
        None => {
            let stage = RecordingStage::Awaited {
                reason: StreamError::UnknownMachine,
                _place: to.probe()?,
            };
            Ok(Box::new(ServedRecorder { to, stage }))
        }
    }
}

fn recorder(to: &RecordTo, robot: &AnyRobotFile) -> Result<Box<dyn Tap>, RecordError> {
    Ok(match robot {
        AnyRobotFile::L2(robot) => Box::new(TickRecorder::start(to, robot)?),
        AnyRobotFile::F1(robot) => Box::new(TickRecorder::start(to, robot)?),
    })
}

/// Recording that begins when the server has named its machine.
struct ServedRecorder {
    to: RecordTo,
    stage: RecordingStage,
}

enum RecordingStage {
    /// Nothing is recorded yet, for this reason. A pipe is open, so that its reader waits.
    Awaited {
        reason: StreamError,
        _place: GrowingFile,
    },
    Recorded(Box<dyn Tap>),
    Failed(RecordError),
}

impl Tap for ServedRecorder {
    fn connected(&mut self) {
        match &mut self.stage {
            RecordingStage::Awaited { reason, .. } => *reason = StreamError::UnknownMachine,
            RecordingStage::Recorded(recorder) => recorder.connected(),
            RecordingStage::Failed(_) => {}
        }
    }

    fn machine(&mut self, machine: &ServerMachine) {
        if let RecordingStage::Awaited { reason, .. } = &mut self.stage {
            let Some(robot) = machine.robot() else {
                let sent = machine.name.kinematics;
                *reason = StreamError::UnknownKinematics { sent };
                return;
            };
            self.stage = recorder(&self.to, &robot)
                .map_or_else(RecordingStage::Failed, RecordingStage::Recorded);
        }
        if let RecordingStage::Recorded(recorder) = &mut self.stage {
            recorder.machine(machine);
        }
    }

    fn happened(&mut self, event: &Happened) {
        if let RecordingStage::Recorded(recorder) = &mut self.stage {
            recorder.happened(event);
        }
    }

    fn tick(&mut self, tick: &ReceivedTick) -> Result<(), StreamError> {
        match &mut self.stage {
            RecordingStage::Awaited { reason, .. } => Err(*reason),
            RecordingStage::Recorded(recorder) => recorder.tick(tick),
            // Told at the end.
            RecordingStage::Failed(_) => Ok(()),
        }
    }

    fn finish(self: Box<Self>) -> Option<Recorded> {
        match self.stage {
            RecordingStage::Awaited { reason, .. } => {
                tracing::warn!("ticks are not in the recording: {reason}");
                None
            }
            RecordingStage::Recorded(recorder) => recorder.finish(),
            RecordingStage::Failed(failure) => Some(Recorded {
                path: self.to.path().to_owned(),
                written: 0,
                lost: 0,
                failure: Some(failure),
                full: None,
            }),
        }
    }
}

/// A recording in a thread of its own, and the tick that waits for its events.
struct TickRecorder<const N: usize> {
    recording: recording::Recorder<TickRecord<N>, N>,
    /// The recording draws the machine, and so needs its name.
    draws: bool,
    /// Checksum of the machine's kinematic parameters.
    kinematics: u32,
    /// The same of the server's machine; `None` until it has named it.
    sent: Option<u32>,
    waiting: Option<TickRecord<N>>,
    /// Events that are not written, at most [`WAITING`].
    events: Vec<Event>,
    /// Events for which there was no place.
    lost: u64,
    /// Reason for which ticks were not recorded.
    other: Option<StreamError>,
}

impl<const N: usize> TickRecorder<N> {
    fn start<K: MachineKind<N>>(
        to: &RecordTo,
        robot: &RobotFile<K, N>,
    ) -> Result<Self, RecordError> {
        let recording = Recording::create::<TickRecord<N>, K>(to, robot)?;
        Ok(Self {
            draws: recording.draws(),
            recording: recording::Recorder::start(recording)?,
            kinematics: robot.checksum(),
            sent: None,
            waiting: None,
            events: Vec::new(),
            lost: 0,
            other: None,
        })
    }

    /// Returns the reason for which a tick is not of this recording's machine.
    fn other_machine(&self, tick: &ReceivedTick) -> Option<StreamError> {
        let sent = tick.axes.count;
        if sent != N {
            return Some(StreamError::OtherMachine { sent, expected: N });
        }
        match self.sent {
            Some(sent) if sent != self.kinematics => Some(StreamError::OtherKinematics {
                sent,
                expected: self.kinematics,
            }),
            None if self.draws => Some(StreamError::UnknownMachine),
            _ => None,
        }
    }

    /// Writes the tick that waits, with the events up to it.
    fn write(&mut self) {
        let Some(row) = self.waiting.take() else {
            return;
        };
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

impl<const N: usize> Tap for TickRecorder<N> {
    /// Another connection begins another file, so that time never goes back in one, and two runs
    /// never share one.
    fn connected(&mut self) {
        self.write();
        self.events.clear();
        self.sent = None;
        self.recording.begin_next();
    }

    fn machine(&mut self, machine: &ServerMachine) {
        self.sent = Some(machine.name.kinematics);
    }

    fn happened(&mut self, happened: &Happened) {
        if self.events.len() == WAITING {
            self.lost = self.lost.saturating_add(1);
            return;
        }
        let tick = unsigned(happened.tick);
        self.events
            .extend(EventKind::from_code(happened.kind).map(|kind| Event {
                tick,
                kind,
                code: happened.code,
                text: happened.text.clone(),
            }));
    }

    fn tick(&mut self, tick: &ReceivedTick) -> Result<(), StreamError> {
        if let Some(other) = self.other_machine(tick) {
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
            tracing::warn!(
                "{} events are not in the recording: more than {WAITING} waited for their ticks",
                self.lost
            );
        }
        self.recording.finish(0)
    }
}

/// Record of the server for a tick, with what is published: no round trip.
fn row<const N: usize>(
    tick: &ReceivedTick,
    before: Option<u64>,
) -> Result<TickRecord<N>, StreamError> {
    let ReceivedTick {
        state,
        axes,
        tool,
        drives,
    } = tick;
    let mut of_axes = axes.axis.iter();
    let axes: [samples::Axis; N] = std::array::from_fn(|_| {
        of_axes
            .next()
            .copied()
            .unwrap_or(gantry_tau_labcomm::Field::ZERO)
    });
    let mut states = [AxisState::default(); N];
    for (place, axis) in states.iter_mut().zip(&axes) {
        *place = axis_state(axis)?;
    }
    let drives = match drives {
        Some(drives) => <[DriveState; N]>::try_from(drives.states()?).ok(),
        None => None,
    };
    let number = unsigned(state.tick);
    let elapsed = before
        .and_then(|before| number.checked_sub(before))
        .unwrap_or(1);
    Ok(TickRecord {
        state: State {
            tick: Tick(number),
            epoch: Epoch(unsigned(state.epoch)),
            accepted: Sequence(unsigned(state.sequence)),
            phase: Phase::from_code(state.phase).ok_or(StreamError::UnknownCode {
                field: "phase",
                code: state.phase,
            })?,
            cause: super::cause(state.cause)?,
            on_time_of_100: state.on_time,
            arrival_us: 0,
            ramp_ticks_left: count(state.ramp_ticks_left),
            counters: counters(state),
            sensor: None,
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
            sensor_age: 0,
            acceleration: None,
            displacement_m: tool.displacement_m,
            turn_rad: tool.turn_rad,
            gauges_m: tool.gauges_m,
        }),
        ended: None,
        welcomed: false,
        key: None,
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
        flags: AxisFlags::from_bits(axis.flags).ok_or(StreamError::UnknownCode {
            field: "flags",
            code: axis.flags,
        })?,
    })
}

fn counters(state: &samples::State) -> Counters {
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
        non_owner,
    ] = state.counters.map(count);
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
