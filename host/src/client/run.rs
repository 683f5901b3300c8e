//! A client's session from Hello to Goodbye.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::message::{
    Capabilities, Cause, ClientMessage, Command, Hello, Mode, Phase, ServerMessage, State, Welcome,
};
use gantry_tau_core::units::{OffsetNm, Sequence, Tick};

use super::compensate::{Compensation, CompensationError};
use super::connection::Connection;
use super::{ClientControls, ClientError, ClientOptions, ClientReport};
use crate::model::MachineKind;
use crate::record::{ClientRow, Recorder};
use crate::robot_file::CYCLE_US;
use crate::sensor_link::{Sample, SensorReader};

/// A server that says nothing for so long has vanished.
const SILENCE: Duration = Duration::from_secs(3);
/// How long to wait for an answer before a Hello is said again, where frames get lost.
const HELLO_AGAIN: Duration = Duration::from_millis(200);
/// States that the last usable force sample may serve.
const SAMPLE_STATES: u64 = 100;
/// States to wait for the first sample.
const FIRST_SAMPLE_STATES: u64 = 1_000;
/// States after a Goodbye in which the server may still not have seen it.
const GOODBYE_STATES: u64 = 100;

struct Session<'a, const N: usize> {
    link: Connection<N>,
    sensor: SensorReader,
    sample: Option<Sample>,
    compensation: Compensation<N>,
    welcome: Welcome<N>,
    sequence: u64,
    targets: [OffsetNm; N],
    /// Axes whose last correction was cut at its limit.
    cut: [bool; N],
    controls: &'a ClientControls,
    recorder: Option<Recorder<ClientRow<N>>>,
    last_tick: Option<Tick>,
    states: u64,
    states_without_sample: u64,
    held: u64,
    held_in_a_row: u64,
    saturated: u64,
    obtaining: bool,
}

/// Connects, submits, obtains, and leaves when told to.
///
/// # Errors
/// [`ClientError`] for every other way it can end. In each of them the server ramps the offsets to zero by itself.
pub fn run<K: MachineKind<N>, const N: usize>(
    options: &ClientOptions<K, N>,
    controls: &ClientControls,
) -> Result<ClientReport, ClientError> {
    let mut link = Connection::over(options.transport, options.server, SILENCE)?;
    let sensor =
        SensorReader::connect(options.sensor).map_err(|error| ClientError::Unreachable {
            what: "force sensor",
            address: options.sensor,
            error,
        })?;
    // After connecting, so that a server that is not there costs no earlier recording; before Hello, so that nothing moves yet.
    let recorder = match &options.record {
        Some(path) => Some(Recorder::start(path).map_err(|e| ClientError::Setup(e.to_string()))?),
        None => None,
    };
    let welcome = greet(&mut link)?;
    check_terms(options, &welcome)?;
    if let Err(denied) = crate::realtime::raise_priority() {
        tracing::warn!("client: no {}: {}", denied.privilege, denied.reason);
    }
    tracing::info!(
        "session granted (epoch {}); submitting while the force sensor is tared: keep the tool unloaded",
        welcome.epoch.0
    );
    controls.obtain.fetch_or(options.obtain, Ordering::Relaxed);
    let mut session = Session {
        link,
        sensor,
        sample: None,
        compensation: Compensation::new(&options.robot, &welcome).map_err(ClientError::Setup)?,
        welcome,
        sequence: 0,
        targets: [OffsetNm(0); N],
        cut: [false; N],
        controls,
        recorder,
        last_tick: None,
        states: 0,
        states_without_sample: 0,
        held: 0,
        held_in_a_row: 0,
        saturated: 0,
        obtaining: false,
    };
    let result = session.answer_until_done();
    let recorded = session.recorder.take().and_then(Recorder::finish);
    if let (Err(_), Some(recorded)) = (&result, &recorded) {
        tracing::info!("{recorded}");
    }
    result.map(|()| ClientReport {
        states: session.states,
        held: session.held,
        saturated: session.saturated,
        recorded,
    })
}

/// Hello, and what it brings. A server without room says so before it has heard anything, and closes:
/// what it said counts more than a Hello that could not be sent.
///
/// Where frames get lost the Hello is said again: until the server has given up a session whose Welcome got lost, and beyond.
fn greet<const N: usize>(link: &mut Connection<N>) -> Result<Welcome<N>, ClientError> {
    if !link.loses_frames() {
        let sent = link.send(&hello::<N>());
        return match link.receive() {
            Ok(ServerMessage::Welcome(welcome)) => Ok(welcome),
            Ok(ServerMessage::Refusal(refusal)) => Err(ClientError::Refused(refusal)),
            Ok(ServerMessage::State(_)) => Err(ClientError::Incompatible(
                "a State before the Welcome".to_owned(),
            )),
            Err(error) => sent.and(Err(error)),
        };
    }
    let since = Instant::now();
    while since.elapsed() < SILENCE {
        link.send(&hello::<N>())?;
        let said = Instant::now();
        // States that overtook the Welcome, or whose Welcome was lost, do not tell the terms.
        while let Some(left) = HELLO_AGAIN.checked_sub(said.elapsed()) {
            match link.receive_within(left)? {
                Some(ServerMessage::Welcome(welcome)) => return Ok(welcome),
                Some(ServerMessage::Refusal(refusal)) => return Err(ClientError::Refused(refusal)),
                Some(ServerMessage::State(_)) | None => {}
            }
        }
    }
    let reason = "it does not answer".to_owned();
    Err(ClientError::Vanished(reason))
}

fn hello<const N: usize>() -> ClientMessage<N> {
    ClientMessage::Hello(Hello {
        axes: u8::try_from(N).unwrap_or(u8::MAX),
        capabilities: Capabilities::LOCKSTEP,
    })
}

/// The server must run the same cycle and hold the same machine.
fn check_terms<K: MachineKind<N>, const N: usize>(
    options: &ClientOptions<K, N>,
    welcome: &Welcome<N>,
) -> Result<(), ClientError> {
    if welcome.cycle_us != CYCLE_US {
        return Err(ClientError::Incompatible(format!(
            "its cycle is {} us, this client's {CYCLE_US} us",
            welcome.cycle_us
        )));
    }
    let own = options.robot.model.checksum();
    if welcome.kinematics_checksum != own {
        return Err(ClientError::Incompatible(format!(
            "its machine has checksum {:08x}, {} has {own:08x}",
            welcome.kinematics_checksum, options.robot.name
        )));
    }
    Ok(())
}

impl<const N: usize> Session<'_, N> {
    fn answer_until_done(&mut self) -> Result<(), ClientError> {
        loop {
            let state = self.next_state()?;
            if !is_live(state.phase) {
                return Err(ended(&state));
            }
            if self.controls.wants_to_quit() {
                return self.leave();
            }
            if self.link.has_unread_bytes() {
                // A newer State is waiting: answering this one would only be late.
                continue;
            }
            if let Err(silent) = self.compensate(&state) {
                // Without force samples, leave in good order instead of compensating an old force.
                self.leave()?;
                return Err(silent);
            }
            self.answer(&state)?;
        }
    }

    /// Goodbye, and wait until the server has heard it: a connection closed at once would be the cause instead.
    /// The ramp that follows is the server's; it needs no witness.
    fn leave(&mut self) -> Result<(), ClientError> {
        let goodbye = ClientMessage::Goodbye(self.welcome.epoch);
        self.link.send(&goodbye)?;
        for _ in 0..GOODBYE_STATES {
            if !is_live(self.next_state()?.phase) {
                return Ok(());
            }
            if self.link.loses_frames() {
                self.link.send(&goodbye)?;
            }
        }
        let reason = format!("it has not acknowledged the Goodbye within {GOODBYE_STATES} States");
        Err(ClientError::Vanished(reason))
    }

    /// The next State that is newer than the last: datagrams come twice, and overtake each other.
    fn next_state(&mut self) -> Result<State<N>, ClientError> {
        loop {
            let ServerMessage::State(state) = self.link.receive()? else {
                if self.link.loses_frames() {
                    continue;
                }
                let reason = "a second Welcome or Refusal".to_owned();
                return Err(ClientError::Incompatible(reason));
            };
            if self.last_tick.is_some_and(|last| state.tick <= last) {
                continue;
            }
            self.last_tick = Some(state.tick);
            self.states += 1;
            return Ok(state);
        }
    }

    fn answer(&mut self, state: &State<N>) -> Result<(), ClientError> {
        let tared = self.compensation.is_tared();
        self.controls.tared.store(tared, Ordering::Relaxed);
        let obtain = tared
            && self.controls.obtain.load(Ordering::Relaxed)
            && state.phase != Phase::Handshake;
        self.sequence += 1;
        let command = Command {
            epoch: self.welcome.epoch,
            sequence: Sequence(self.sequence),
            echo: state.tick,
            mode: if obtain { Mode::Obtain } else { Mode::Submit },
            targets: self.targets.map(|position| Offsets {
                position,
                ..Offsets::default()
            }),
        };
        if obtain && !self.obtaining {
            tracing::info!("tared; obtaining: from here on the offsets act. Ctrl-C leaves");
        }
        self.obtaining = obtain;
        self.link.send(&ClientMessage::Command(command))?;
        self.controls.commands.fetch_add(1, Ordering::Relaxed);
        self.record(state);
        Ok(())
    }

    /// New targets from a new sample; without one the last targets stand, for a while.
    fn compensate(&mut self, state: &State<N>) -> Result<(), ClientError> {
        let silent = |reason: &str| ClientError::SensorSilent(reason.to_owned());
        let latest = self.sensor.latest();
        let latest = latest.map_err(|error| silent(&error.to_string()))?;
        let Some(sample) = latest.filter(|latest| self.sample != Some(*latest)) else {
            self.states_without_sample += 1;
            let patience = match self.sample {
                None => FIRST_SAMPLE_STATES,
                Some(_) => SAMPLE_STATES,
            };
            if self.states_without_sample > patience {
                return Err(silent("none has come for too long"));
            }
            return Ok(());
        };
        if sample.tick.abs_diff(state.tick.0) > SAMPLE_STATES {
            return Err(silent("their ticks are not the server's"));
        }
        self.sample = Some(sample);
        self.states_without_sample = 0;
        let nominal = state.axes.map(|axis| axis.nominal);
        match self.compensation.cycle(&sample.wrench, &nominal) {
            Ok(correction) => {
                self.targets = correction.offsets;
                self.held_in_a_row = 0;
                self.note_saturation(&correction.saturated);
                Ok(())
            }
            Err(error) => self.hold(&error),
        }
    }

    /// Counts a correction that was cut; logs the first.
    fn note_saturation(&mut self, saturated: &[bool; N]) {
        self.cut = *saturated;
        let Some(axis) = saturated.iter().position(|cut| *cut) else {
            return;
        };
        if self.saturated == 0 {
            tracing::warn!(
                "axis {}: the correction is cut at the limit of the offset; the load is beyond what the offsets can compensate",
                axis + 1
            );
        }
        self.saturated += 1;
    }

    /// Sends the last targets again; said once, counted always, and not for ever.
    fn hold(&mut self, error: &CompensationError) -> Result<(), ClientError> {
        if self.held == 0 {
            tracing::warn!("a correction cannot be computed, the last one is held: {error}");
        }
        self.held += 1;
        self.held_in_a_row += 1;
        if self.held_in_a_row > SAMPLE_STATES {
            let reason = format!("{SAMPLE_STATES} in a row could not be used: {error}");
            return Err(ClientError::SensorSilent(reason));
        }
        Ok(())
    }

    fn record(&mut self, state: &State<N>) {
        if let Some(recorder) = &mut self.recorder {
            recorder.push(ClientRow {
                state: *state,
                targets: self.targets,
                saturated: self.cut,
                load: self.compensation.load(),
            });
        }
    }
}

const fn is_live(phase: Phase) -> bool {
    matches!(phase, Phase::Handshake | Phase::Submit | Phase::Obtain)
}

fn ended<const N: usize>(state: &State<N>) -> ClientError {
    match state.cause {
        Cause::None => ClientError::Vanished("it forgot the session".to_owned()),
        cause => ClientError::Ended(cause),
    }
}
