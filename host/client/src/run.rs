//! A client's session from Hello to Goodbye.

use std::sync::atomic::Ordering;
use std::time::Duration;

use gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_core::control::message::{Capabilities, Cause, Mode, State};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::CYCLE_US;
use gantry_tau_record::recording::{ClientRow, Recorder, Recording, SessionEvents};
use gantry_tau_server::links::accelerometer::AccelerometerReader;

use super::accelerometer::MAX_APART;
use super::connection::Connection;
use super::controller::Controller;
use super::stability::HomeMargin;
use super::{ClientControls, ClientError, ClientOptions, ClientReport, Observer};
use crate::force_sensor::SensorConnection;

/// Longest time for each step: to connect, to be welcomed, to hear the next State, to leave. A
/// server that takes longer has vanished.
pub(crate) const PATIENCE: Duration = Duration::from_secs(3);

/// Warning at Obtain.
const NO_MASSES: &str = "no masses: stability in motion and contact is not known; cutoff_hz 2.0 with filter = \"second_order\" is safe for tools to 5 kg on machines like these";

struct ClientSession<'a, const N: usize> {
    link: Connection<'a, N>,
    sensor: SensorConnection,
    accelerometer: Option<AccelerometerReader>,
    controller: Controller<N>,
    controls: &'a ClientControls,
    observer: &'a mut dyn Observer<N>,
    recorder: Option<Recorder<ClientRow<N>, N>>,
    events: SessionEvents,
    /// States received.
    states: u64,
}

/// Connects, submits, obtains, and leaves when asked to.
///
/// # Errors
/// [`ClientError`] for every other end. In each of them the server ramps the offsets to zero by
/// itself.
pub fn run<K: MachineKind<N>, const N: usize>(
    options: &ClientOptions<K, N>,
    controls: &ClientControls,
) -> Result<ClientReport, ClientError> {
    run_observed(options, controls, &mut ())
}

/// As [`run`], with an observer. The report of a client that was asked to leave before a session was
/// granted has no States.
///
/// # Errors
/// As [`run`], and the observer's.
pub fn run_observed<K: MachineKind<N>, const N: usize>(
    options: &ClientOptions<K, N>,
    controls: &ClientControls,
    observer: &mut dyn Observer<N>,
) -> Result<ClientReport, ClientError> {
    match hold_session(options, controls, observer) {
        Err(ClientError::Quit) => Ok(ClientReport::default()),
        ended => ended,
    }
}

fn hold_session<K: MachineKind<N>, const N: usize>(
    options: &ClientOptions<K, N>,
    controls: &ClientControls,
    observer: &mut dyn Observer<N>,
) -> Result<ClientReport, ClientError> {
    let requirements = Requirements {
        capabilities: Capabilities::LOCKSTEP,
        cycle_us: Some(CYCLE_US),
        kinematics_checksum: Some(options.robot.checksum()),
    };
    let robot = &options.usable_robot();
    let margin = HomeMargin::of(robot);
    let is_asked = options.obtain || controls.obtain.load(Ordering::Relaxed);
    let reason = margin.against(robot.client.gain);
    if let Some(reason) = reason.filter(|_| is_asked && !options.accept_unstable) {
        return Err(ClientError::Setup(reason));
    }
    let (transport, server) = (options.transport, options.server.clone());
    let mut link =
        Connection::open_unless(&controls.quit, transport, server, PATIENCE, requirements)?
            .with_key(options.key.clone())?;
    let sensor = SensorConnection::connect(&options.sensor, &controls.quit)?;
    let accelerometer = match (&robot.sensor.accelerometer, &options.accelerometer) {
        (Some(_), Some(address)) => Some(
            AccelerometerReader::connect(address.clone(), &controls.quit)
                .map_err(|error| ClientError::unreachable("accelerometer", address, error))?,
        ),
        _ => None,
    };
    // After connecting: an absent server must not cost an earlier recording. Before Hello: nothing
    // moves yet.
    let recorder = options
        .record
        .as_ref()
        .map(|to| Recorder::start(Recording::create::<ClientRow<N>, K>(to, robot)?));
    let recorder = recorder.transpose();
    let recorder = recorder.map_err(|error| ClientError::Setup(error.to_string()))?;
    let welcome = link.greet()?;
    if let Err(denied) = gantry_tau_server::realtime::raise_priority() {
        tracing::warn!("client: no {}: {}", denied.privilege, denied.reason);
    }
    tracing::info!(
        "session granted (epoch {}); submitting while the force sensor is tared: keep the tool unloaded",
        welcome.epoch.0
    );
    observer.welcomed(&welcome);
    controls.obtain.fetch_or(options.obtain, Ordering::Relaxed);
    let controller = Controller::new(robot, &welcome, margin, options.accept_unstable)
        .map_err(|error| ClientError::Setup(error.to_string()))?;
    // A server in lock-step waits, and its sessions come out the same each time.
    let controller = if welcome.capabilities.contains(Capabilities::LOCKSTEP) {
        controller
    } else {
        controller.in_background().map_err(|error| {
            ClientError::Setup(format!("no thread for the notches of the filter: {error}"))
        })?
    };
    let mut session = ClientSession {
        link,
        sensor,
        accelerometer,
        controller,
        controls,
        observer,
        recorder,
        events: SessionEvents::default(),
        states: 0,
    };
    let result = session.answer_until_done();
    let recorded = session.recorder.and_then(|recorder| recorder.finish(0));
    if let (Err(_), Some(recorded)) = (&result, &recorded) {
        tracing::info!("{recorded}");
    }
    let counts = *session.controller.counts();
    result.map(|()| ClientReport {
        states: session.states,
        held: counts.held,
        saturated: counts.saturated,
        oscillations: counts.oscillations,
        last_oscillation: counts.last_oscillation,
        recorded,
    })
}

impl<const N: usize> ClientSession<'_, N> {
    fn answer_until_done(&mut self) -> Result<(), ClientError> {
        loop {
            let state = match self.next_event() {
                Ok(Event::State(state)) => state,
                Ok(Event::Ended(state)) => return Err(ended(&state)),
                Ok(_) => continue,
                // A server that sends nothing is left as well.
                Err(ClientError::Quit) => return self.leave(),
                Err(error) => return Err(error),
            };
            if self.controls.quit.load(Ordering::Relaxed) {
                return self.leave();
            }
            self.set_gain();
            if self.link.has_unread_bytes() {
                // A newer State is waiting: an answer to this one would be late.
                continue;
            }
            if let Err(silent) = self.compensate(&state) {
                // Without force samples, leave in good order instead of compensating an old force.
                self.leave()?;
                return Err(silent);
            }
            self.answer(&state)?;
            self.leave_oscillation(&state);
            let sample = self.controller.new_sample();
            if let Err(stopped) = self.observer.answered(&state, sample) {
                self.leave()?;
                return Err(stopped);
            }
        }
    }

    /// Takes over a gain that was set, unless it is being set.
    fn set_gain(&mut self) {
        let Some(gain) = self
            .controls
            .gain
            .try_lock()
            .ok()
            .and_then(|mut gain| gain.take())
        else {
            return;
        };
        let obtains = self.controls.obtain.load(Ordering::Relaxed);
        match self.controller.set_gain(gain, obtains) {
            Ok(()) => tracing::info!("gain {gain}: the server moves the offsets within its limits"),
            Err(reason) => tracing::warn!("gain {gain}: {reason}"),
        }
    }

    /// Returns the mode to ask for: Submit until the sensor is tared, and where the compensation
    /// may swing.
    fn mode(&mut self) -> Mode {
        let tared = self.controller.is_tared();
        self.controls.tared.store(tared, Ordering::Relaxed);
        let obtains = self.controls.obtain.load(Ordering::Relaxed);
        self.controller.mode(obtains).unwrap_or_else(|reason| {
            tracing::warn!("not obtaining: {reason}");
            self.controls.obtain.store(false, Ordering::Relaxed);
            Mode::Submit
        })
    }

    fn leave(&mut self) -> Result<(), ClientError> {
        self.states += self.link.leave()?;
        Ok(())
    }

    /// Waits for the next State of the session or its end.
    fn next_event(&mut self) -> Result<Event<N>, ClientError> {
        let event = self.link.next_event()?;
        self.states += 1;
        Ok(event)
    }

    fn answer(&mut self, state: &State<N>) -> Result<(), ClientError> {
        let mode = self.mode();
        let targets = self.controller.targets();
        let Some(answer) = self.link.answer(mode, &targets)? else {
            return Ok(());
        };
        let is_new = self.controller.note_answer(&answer);
        if is_new && self.controller.is_obtaining() {
            tracing::info!("tared; obtaining: from here on the offsets act. Ctrl-C leaves");
            if self.controller.has_unknown_margin() {
                tracing::warn!("{NO_MASSES}");
            }
        } else if is_new {
            tracing::info!(
                "submitting: the server moves the offsets to zero; then they are computed and reported only"
            );
        }
        self.controls.commands.fetch_add(1, Ordering::Relaxed);
        if let Some(recorder) = &mut self.recorder {
            let row = ClientRow {
                state: *state,
                targets: answer.command.targets.map(|target| target.position),
                saturated: *self.controller.cut(),
                load: self.controller.load().to_array(),
            };
            recorder.push(row, self.events.observe(state));
        }
        Ok(())
    }

    /// Asks for Submit from the next answer on if the targets of an answered State oscillate, until
    /// asked to obtain again.
    fn leave_oscillation(&mut self, state: &State<N>) {
        let Some(oscillation) = self.controller.oscillation(state) else {
            return;
        };
        self.controls.obtain.store(false, Ordering::Relaxed);
        tracing::warn!(
            "{oscillation}: leaving Obtain until asked to obtain again (`gantry-tau stability` tells which filter is stable)"
        );
    }

    /// Takes the samples that belong to a State.
    fn compensate(&mut self, state: &State<N>) -> Result<(), ClientError> {
        let accelerometer = &mut self.accelerometer;
        self.controller.compensate(state, &mut self.sensor, |tick| {
            acceleration(accelerometer.as_mut(), tick)
        })
    }
}

/// Returns the sample of the accelerometer that belongs to a force sample of this tick.
fn acceleration(
    accelerometer: Option<&mut AccelerometerReader>,
    tick: u64,
) -> Result<Option<[f64; 6]>, ClientError> {
    let Some(accelerometer) = accelerometer else {
        return Ok(None);
    };
    let latest = accelerometer
        .latest()
        .map_err(|error| ClientError::AccelerometerSilent(error.to_string()))?;
    let belonging = latest.filter(|latest| latest.tick.abs_diff(tick) <= MAX_APART);
    Ok(belonging.map(|latest| latest.components))
}

/// Returns the error of a session that has ended.
pub(crate) fn ended<const N: usize>(state: &State<N>) -> ClientError {
    match state.cause {
        Cause::None => ClientError::Vanished("it forgot the session".to_owned()),
        cause => ClientError::Ended(cause),
    }
}
