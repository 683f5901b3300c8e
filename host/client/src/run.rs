//! A client's session from Hello to Goodbye.

use std::fmt::Display;
use std::sync::atomic::Ordering;
use std::time::Duration;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::control::client::{Event, Requirements};
use gantry_tau_core::control::message::{Capabilities, Cause, Mode, State};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::CYCLE_US;
use gantry_tau_record::recording::{ClientRow, Recorder, Recording, SessionEvents};
use gantry_tau_server::links::accelerometer::AccelerometerReader;

use super::accelerometer::MAX_APART;
use super::compensate::{Compensation, Samples};
use super::connection::Connection;
use super::oscillation::Oscillations;
use super::stability::HomeMargin;
use super::{ClientControls, ClientError, ClientOptions, ClientReport, Observer};
use crate::force_sensor::{Sample, SensorConnection};

/// Longest time for each step: to connect, to be welcomed, to hear the next State, to leave. A
/// server that takes longer has vanished.
pub(crate) const PATIENCE: Duration = Duration::from_secs(3);
/// States that the last usable force sample may serve.
const SAMPLE_STATES: u64 = 100;

/// Warning at Obtain.
const NO_MASSES: &str = "no masses: stability in motion and contact is not known; cutoff_hz 2.0 with filter = \"second_order\" is safe for tools to 5 kg on machines like these";

struct ClientSession<'a, const N: usize> {
    link: Connection<'a, N>,
    sensor: SensorConnection,
    accelerometer: Option<AccelerometerReader>,
    sample: Option<Sample>,
    compensation: Compensation<N>,
    targets: [OffsetNm; N],
    /// Axes whose last correction was cut at its limit.
    cut: [bool; N],
    controls: &'a ClientControls,
    observer: &'a mut dyn Observer<N>,
    recorder: Option<Recorder<ClientRow<N>, N>>,
    events: SessionEvents,
    report: ClientReport,
    /// States in a row without a usable sample.
    states_without_sample: u64,
    obtaining: bool,
    margin: HomeMargin,
    accept_unstable: bool,
    /// Share of the correction that is asked for.
    gain: f64,
    /// Absent if the robot file turns them off.
    oscillations: Option<Oscillations<N>>,
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
    let mut session = ClientSession {
        link,
        sensor,
        accelerometer,
        sample: None,
        compensation: Compensation::new(robot, &welcome)
            .map_err(|error| ClientError::Setup(error.to_string()))?,
        targets: [OffsetNm(0); N],
        cut: [false; N],
        controls,
        observer,
        recorder,
        events: SessionEvents::default(),
        report: ClientReport::default(),
        states_without_sample: 0,
        obtaining: false,
        margin,
        accept_unstable: options.accept_unstable,
        gain: robot.client.gain,
        oscillations: Oscillations::new(robot, &welcome),
    };
    let result = session.answer_until_done();
    let recorded = session.recorder.and_then(|recorder| recorder.finish(0));
    if let (Err(_), Some(recorded)) = (&result, &recorded) {
        tracing::info!("{recorded}");
    }
    result.map(|()| ClientReport {
        recorded,
        ..session.report
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
            let sample = self
                .sample
                .as_ref()
                .filter(|_| self.states_without_sample == 0);
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
        if let Some(reason) = self.reason_against(gain).filter(|_| obtains) {
            tracing::warn!("gain {gain}: {reason}");
            return;
        }
        match self.compensation.set_gain(gain) {
            Ok(()) => {
                self.gain = gain;
                tracing::info!("gain {gain}: the server moves the offsets within its limits");
            }
            Err(error) => tracing::warn!("gain {gain}: {error}"),
        }
    }

    /// Returns the reason against this share of the correction, unless it is accepted.
    fn reason_against(&self, gain: f64) -> Option<String> {
        self.margin.against(gain).filter(|_| !self.accept_unstable)
    }

    /// Returns the mode to ask for: Submit until the sensor is tared, and where the compensation
    /// may swing.
    fn mode(&mut self) -> Mode {
        let tared = self.compensation.is_tared();
        self.controls.tared.store(tared, Ordering::Relaxed);
        if !(tared && self.controls.obtain.load(Ordering::Relaxed)) {
            return Mode::Submit;
        }
        match self.reason_against(self.gain).filter(|_| !self.obtaining) {
            Some(reason) => {
                tracing::warn!("not obtaining: {reason}");
                self.controls.obtain.store(false, Ordering::Relaxed);
                Mode::Submit
            }
            None => Mode::Obtain,
        }
    }

    fn leave(&mut self) -> Result<(), ClientError> {
        self.report.states += self.link.leave()?;
        Ok(())
    }

    /// Waits for the next State of the session or its end.
    fn next_event(&mut self) -> Result<Event<N>, ClientError> {
        let event = self.link.next_event()?;
        self.report.states += 1;
        Ok(event)
    }

    fn answer(&mut self, state: &State<N>) -> Result<(), ClientError> {
        let mode = self.mode();
        let mut targets = self.targets.map(Offsets::position);
        for (target, torque) in targets.iter_mut().zip(self.compensation.torques()) {
            target.torque = torque;
        }
        let Some(answer) = self.link.answer(mode, &targets)? else {
            return Ok(());
        };
        let obtaining = answer.command.mode == Mode::Obtain;
        if obtaining && !self.obtaining {
            tracing::info!("tared; obtaining: from here on the offsets act. Ctrl-C leaves");
            if self.margin.is_unknown() {
                tracing::warn!("{NO_MASSES}");
            }
        } else if self.obtaining && !obtaining {
            tracing::info!(
                "submitting: the server moves the offsets to zero; then they are computed and reported only"
            );
        }
        self.obtaining = obtaining;
        for (cut, axis) in self.cut.iter_mut().zip(answer.saturated) {
            *cut |= axis.position;
        }
        self.controls.commands.fetch_add(1, Ordering::Relaxed);
        if let Some(recorder) = &mut self.recorder {
            let row = ClientRow {
                state: *state,
                targets: answer.command.targets.map(|target| target.position),
                saturated: self.cut,
                load: self.compensation.load().to_array(),
            };
            recorder.push(row, self.events.observe(state));
        }
        Ok(())
    }

    /// Asks for Submit from the next answer on if the targets of an answered State oscillate, until
    /// asked to obtain again.
    fn leave_oscillation(&mut self, state: &State<N>) {
        let Some(oscillations) = &mut self.oscillations else {
            return;
        };
        if !self.obtaining {
            oscillations.restart();
            return;
        }
        let nominal = state.axes.map(|axis| axis.nominal);
        let Some(oscillation) = oscillations.update(state.tick.0, &self.targets, &nominal) else {
            return;
        };
        self.controls.obtain.store(false, Ordering::Relaxed);
        self.report.oscillations += 1;
        self.report.last_oscillation = Some(oscillation);
        tracing::warn!(
            "{oscillation}: leaving Obtain until asked to obtain again (`gantry-tau stability` tells which filter is stable)"
        );
    }

    /// Computes new targets from a new sample; without one the last targets are sent again, for a
    /// while.
    fn compensate(&mut self, state: &State<N>) -> Result<(), ClientError> {
        let latest = self
            .sensor
            .latest(state)
            .map_err(|error| ClientError::SensorSilent(error.to_string()))?;
        let is_new = |latest: &Sample| {
            self.sample != Some(*latest) && state.tick.0.abs_diff(latest.tick) <= SAMPLE_STATES
        };
        let Some(sample) = latest.filter(is_new) else {
            return self.wait_for_sample(|patient| patient.sensor.silence());
        };
        if sample.is_cut {
            return self.hold(&"the force is beyond the range of a State");
        }
        self.sample = Some(sample);
        let nominal = state.axes.map(|axis| axis.nominal);
        let samples = Samples {
            wrench: Wrench::from_array(sample.wrench),
            acceleration: self.acceleration(sample.tick)?,
        };
        match self.compensation.cycle(state.tick, &samples, &nominal) {
            Ok(correction) => {
                self.targets = correction.offsets;
                self.states_without_sample = 0;
                self.note_saturation(&correction.saturated);
                Ok(())
            }
            Err(error) => self.hold(&error),
        }
    }

    /// Returns the sample of the accelerometer that belongs to a force sample of this tick.
    fn acceleration(&mut self, tick: u64) -> Result<Option<[f64; 6]>, ClientError> {
        let Some(accelerometer) = &mut self.accelerometer else {
            return Ok(None);
        };
        let latest = accelerometer
            .latest()
            .map_err(|error| ClientError::AccelerometerSilent(error.to_string()))?;
        let belonging = latest.filter(|latest| latest.tick.abs_diff(tick) <= MAX_APART);
        Ok(belonging.map(|latest| latest.components))
    }

    /// Counts a correction that was cut; logs the first.
    fn note_saturation(&mut self, saturated: &[bool; N]) {
        self.cut = *saturated;
        let Some(axis) = saturated.iter().position(|cut| *cut) else {
            return;
        };
        if self.report.saturated == 0 {
            tracing::warn!(
                "axis {}: the correction is cut at the limit of the offset; the load is beyond what the offsets can compensate",
                axis + 1
            );
        }
        self.report.saturated += 1;
    }

    /// Keeps the last targets: logs the first such cycle, counts each, and fails after too many in
    /// a row.
    fn hold(&mut self, error: &dyn Display) -> Result<(), ClientError> {
        if self.report.held == 0 {
            tracing::warn!("a correction cannot be computed, the last one is held: {error}");
        }
        self.report.held += 1;
        self.wait_for_sample(|_| format!("none of {SAMPLE_STATES} could be used: {error}"))
    }

    /// Counts a State without a usable sample, missing or held. Fails after too many in a row.
    fn wait_for_sample(&mut self, reason: impl FnOnce(&Self) -> String) -> Result<(), ClientError> {
        self.states_without_sample += 1;
        let patience = match self.sample {
            None => self.sensor.patience(),
            Some(_) => SAMPLE_STATES,
        };
        if self.states_without_sample > patience {
            return Err(ClientError::SensorSilent(reason(self)));
        }
        Ok(())
    }
}

/// Returns the error of a session that has ended.
pub(crate) fn ended<const N: usize>(state: &State<N>) -> ClientError {
    match state.cause {
        Cause::None => ClientError::Vanished("it forgot the session".to_owned()),
        cause => ClientError::Ended(cause),
    }
}
