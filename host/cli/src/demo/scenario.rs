//! One session with force steps, without and with compensation, and a cable pulled at full offset.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;

use gantry_tau_client::force_sensor::SensorSource;
use gantry_tau_client::{
    self, ClientControls, ClientError, ClientOptions, ClientReport, Connection,
};
use gantry_tau_core::control::client::Requirements;
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::Key;
use gantry_tau_core::control::message::{Capabilities, Phase, Refusal};
use gantry_tau_core::control::monitor::{Monitor, Violation};
use gantry_tau_core::units::{EpochRange, Tick};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::black_box::{Window, swap_channel};
use gantry_tau_server::key_file;
use gantry_tau_server::links::accelerometer::AccelerometerPublisher;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::server::Server;
use gantry_tau_server::server::connections::Listening;
use gantry_tau_server::server::cycle::Cycle;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::{AppliedLoad, Load, LoadGenerator, load_generator};

use super::sampler::{Sampler, TickSample};
use super::{DemoError, DemoOptions, Loops, glide_cycles};
use crate::faults::plan::FaultPlan;
use crate::faults::relay::Relay;
use crate::terminal::Progress;

/// Added to the number of a step when it is compensated.
pub(super) const COMPENSATED: u32 = 1_000;
/// Ticks between the release of a load and the next part.
const REST_TICKS: u64 = 200;
/// Longest wait of a newcomer for the server's answer.
const NEWCOMER_SILENCE: Duration = Duration::from_secs(2);
/// Deadlines missed in the first second above which the steps are not tried in real time. Ten
/// seconds at this rate of independent misses contain two in a row, which end the session, with a
/// probability of one in four.
const PROBE_MISSES: u32 = 5;
/// Any free loopback port.
const LOOPBACK: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 0);

/// Everything that happened in one run.
pub(super) struct Recording<const N: usize> {
    pub(super) samples: Vec<TickSample<N>>,
    /// Tick of the first ramp step after the cable was pulled.
    pub(super) ended: TickSample<N>,
    /// Answer to a newcomer during the ramp.
    pub(super) refusal: Refusal,
    /// End of the client whose cable was pulled, in words.
    pub(super) client: String,
    /// Rows that came too fast to be sampled.
    pub(super) dropped: u64,
    /// The first broken limit and its tick.
    pub(super) violation: Option<(Tick, Violation)>,
    /// The black box of the pulled cable, if it was asked for.
    pub(super) black_box: Option<Window<N>>,
}

/// Reason why a run failed.
#[derive(Debug, PartialEq)]
pub(super) enum PlayError {
    /// This machine does not hold 1 kHz.
    Lost(String),
    /// Any other reason.
    Failed(String),
}

impl From<PlayError> for DemoError {
    fn from(failure: PlayError) -> Self {
        match failure {
            PlayError::Lost(reason) => Self::Lost(reason),
            PlayError::Failed(reason) => Self::Failed(reason),
        }
    }
}

impl<E: std::error::Error> From<E> for PlayError {
    fn from(error: E) -> Self {
        Self::Failed(error.to_string())
    }
}

struct Scenario<'a, K, const N: usize> {
    options: &'a DemoOptions<K, N>,
    progress: &'a Progress,
    ticks: TickSource,
    /// A machine that misses many deadlines in the first second ends the run.
    probe: bool,
    server: Server<N>,
    sampler: Sampler<N>,
    hand: LoadGenerator,
    /// Cycles in which the hand reaches a load.
    glide_cycles: u32,
    relay: Relay,
    controls: Arc<ClientControls>,
    key: Option<Key>,
    client: JoinHandle<Result<ClientReport, ClientError>>,
}

/// Runs the whole session at one pace, on the machine that `build` makes. With `probe`, a computer
/// that misses many deadlines in the first second fails early.
pub(super) fn play<K, P, E, const N: usize, const M: usize>(
    options: &DemoOptions<K, N>,
    build: impl Fn(&RobotFile<K, N>, AppliedLoad) -> Result<P, E>,
    loops: Loops<N, M, P>,
    ticks: TickSource,
    probe: bool,
    progress: &Progress,
) -> Result<Recording<N>, PlayError>
where
    K: MachineKind<N>,
    P: Plant<N, M> + 'static,
    E: std::error::Error,
{
    let robot = &options.robot;
    let capabilities = match ticks {
        TickSource::RealTime => Capabilities::NONE,
        TickSource::Lockstep => Capabilities::LOCKSTEP,
    };
    let (mut hand, tool) = load_generator();
    let glide_cycles = glide_cycles(robot);
    hand.glide(glide_cycles);
    let machine = build(robot, tool)?;
    let config = robot.session_config(capabilities)?;
    let axes = config.parameters().axes;
    let travel = axes.map(|axis| axis.machine_travel);
    let monitor = Monitor::new(axes.map(|axis| axis.limits), Some(travel));
    let accelerometer = (robot.sensor.accelerometer.as_ref())
        .map(|_| AccelerometerPublisher::bind(LOOPBACK))
        .transpose()?;
    let accelerometer_address = (accelerometer.as_ref())
        .map(AccelerometerPublisher::address)
        .transpose()?;
    let key = (options.key.as_deref())
        .map(|path| key_file::read(path).map(|secret| secret.key()))
        .transpose()?;
    let keyring = key_file::keyring(options.key.as_slice())?;
    let cycle = Cycle::listening(
        config,
        robot.motor_map()?,
        machine,
        EpochRange::VOLATILE,
        StopLatch::volatile(),
        Listening::bind(&LOOPBACK.into())?.with_keys(keyring),
    )?;
    let mut cycle = loops(cycle, robot.position_loops)?;
    let (sender, mut black_boxes) = swap_channel::channel();
    if options.black_box.is_some() {
        cycle = cycle.with_black_box(sender);
    }
    if let Some(accelerometer) = accelerometer {
        cycle = cycle.with_accelerometer(accelerometer);
    }
    let (server, rows) = Server::spawn(cycle, ticks)?;
    let (relay, _) = Relay::spawn(
        LOOPBACK,
        server.address,
        Transport::Stream,
        FaultPlan::default(),
    )?;
    let controls = Arc::new(ClientControls::default());
    let client_options = ClientOptions {
        server: relay.address.into(),
        transport: Transport::Stream,
        sensor: SensorSource::States,
        accelerometer: accelerometer_address.map(Into::into),
        robot: options.client.clone(),
        key: key.clone(),
        record: options.record.clone(),
        obtain: false,
        accept_unstable: false,
    };
    let shared = Arc::clone(&controls);
    let client = std::thread::Builder::new()
        .name("client".to_owned())
        .spawn(move || gantry_tau_client::run(&client_options, &shared))?;
    let mut scenario = Scenario {
        options,
        progress,
        ticks,
        probe,
        server,
        sampler: Sampler::new(rows, monitor),
        hand,
        glide_cycles,
        relay,
        controls,
        key,
        client,
    };
    let played = scenario.run();
    scenario.controls.quit.store(true, Ordering::Relaxed);
    let Scenario {
        server,
        sampler,
        relay,
        client,
        ..
    } = scenario;
    let dropped = server.quit();
    drop(relay);
    let client = match client.join() {
        Ok(Ok(_)) => "left in good order".to_owned(),
        // Ends that no delay can cause.
        Ok(Err(
            error @ (ClientError::Setup(_)
            | ClientError::Incompatible(_)
            | ClientError::Refused(Refusal::Role)),
        )) => return Err(error.into()),
        Ok(Err(error)) => error.to_string(),
        Err(_) => "panicked".to_owned(),
    };
    let (ended, refusal) = played?;
    let dropped = dropped?;
    Ok(Recording {
        samples: sampler.samples,
        ended,
        refusal,
        client,
        dropped,
        violation: sampler.violation,
        // There are more boxes than sessions in a run, so the first one is never overwritten.
        black_box: black_boxes.receive(),
    })
}

impl<K: MachineKind<N>, const N: usize> Scenario<'_, K, N> {
    fn run(&mut self) -> Result<(TickSample<N>, Refusal), PlayError> {
        self.tare()?;
        self.say("force steps without compensation (Submit: offsets are reported, drives do not see them)");
        self.steps(0)?;
        self.release_and_rest()?;
        self.controls.obtain.store(true, Ordering::Relaxed);
        self.wait_for(Phase::Obtain)?;
        self.say("force steps with compensation (Obtain: offsets act)");
        self.steps(COMPENSATED)?;
        let ended = self.pull_the_cable()?;
        let refusal = self.newcomer_during_the_ramp()?;
        self.wait_for(Phase::Listening)?;
        self.release_and_rest()?;
        self.newcomer_after_the_ramp()?;
        Ok((ended, refusal))
    }

    /// The client tares its sensor in Submit for a second. In real time that second also probes
    /// this machine.
    fn tare(&mut self) -> Result<(), PlayError> {
        match self.ticks {
            TickSource::RealTime => {
                self.say("the client tares its sensor; meanwhile: does this machine hold 1 kHz?")
            }
            TickSource::Lockstep => self.say("the client tares its sensor"),
        }
        let Self {
            progress,
            controls,
            client,
            sampler,
            ..
        } = self;
        sampler.until(
            false,
            |_| progress.step(),
            |_| controls.tared.load(Ordering::Relaxed) || has_failed(client, controls),
        )?;
        if has_failed(client, controls) {
            return Err(PlayError::Failed(
                "the client ended before its first command".to_owned(),
            ));
        }
        if self.ticks == TickSource::RealTime {
            let last = self.sampler.samples.last();
            let missed = last.map_or(0, |sample| sample.missed);
            if self.probe {
                judge(missed)?;
            }
            self.say(&format!(
                "it did for that second: {missed} deadlines missed, never two in a row"
            ));
        }
        Ok(())
    }

    fn steps(&mut self, base: u32) -> Result<(), PlayError> {
        for (number, force_x) in (1..).zip(self.options.forces_n()) {
            let load = Load {
                step: base + number,
                force_n: [force_x, 0.0, 0.0],
                moment_nm: [0.0; 3],
            };
            self.hand.set(&load)?;
            let first = self.wait(|sample| sample.step == load.step)?;
            let last = self.wait_ticks(first.tick, self.options.step_ticks())?;
            let squares = last.displacement_um.map(|d| d * d);
            let norm = squares.iter().sum::<f64>().sqrt();
            self.say(&format!(
                "  {force_x:5.0} N: tool displaced by {norm:6.1} um"
            ));
        }
        Ok(())
    }

    fn release_and_rest(&mut self) -> Result<(), PlayError> {
        self.hand.release();
        let released = self.wait(|sample| sample.step == 0)?;
        self.wait_ticks(released.tick, u64::from(self.glide_cycles) + REST_TICKS)?;
        Ok(())
    }

    /// Silences the connection without closing it. The second missed deadline ends the session and
    /// takes the first ramp step.
    fn pull_the_cable(&mut self) -> Result<TickSample<N>, PlayError> {
        self.say("pulling the client's cable; both sockets stay open");
        self.relay.cut();
        let silent = &self.server.controls.link_silent;
        silent.store(true, Ordering::Relaxed);
        let ended = (self.sampler).until(true, |_| {}, |sample| sample.ended.is_some())?;
        silent.store(false, Ordering::Relaxed);
        let left = ended.offset_nm.iter().map(|nm| nm.unsigned_abs()).max();
        self.say(&format!(
            "second deadline missed: SafeDisconnect, {:.1} um of offset ramp to zero at 0.1 um/ms",
            f64::from(left.unwrap_or(0)) / 1e3
        ));
        Ok(ended)
    }

    fn newcomer_during_the_ramp(&mut self) -> Result<Refusal, PlayError> {
        match self.newcomer()?.greet() {
            Err(ClientError::Refused(refusal)) => {
                self.say(&format!("a newcomer is refused: {refusal}"));
                Ok(refusal)
            }
            Err(error) => Err(error.into()),
            Ok(_) => Err(PlayError::Failed(
                "a newcomer was granted the session during the ramp".to_owned(),
            )),
        }
    }

    fn newcomer_after_the_ramp(&mut self) -> Result<(), PlayError> {
        let mut link = self.newcomer()?;
        let welcome = match link.greet() {
            Err(ClientError::Refused(_)) => {
                return Err(PlayError::Failed(
                    "a newcomer was not granted the session after the ramp".to_owned(),
                ));
            }
            answer => answer?,
        };
        self.say(&format!(
            "all offsets are zero: a newcomer is granted session {}",
            welcome.epoch.0
        ));
        link.goodbye()?;
        for phase in [Phase::SafeDisconnect, Phase::Listening] {
            (self.sampler).until(true, |_| {}, |sample| sample.phase == phase)?;
        }
        Ok(())
    }

    /// Connects another client.
    fn newcomer(&self) -> Result<Connection<'static, N>, ClientError> {
        let requirements = Requirements {
            capabilities: Capabilities::LOCKSTEP,
            ..Requirements::default()
        };
        let address = self.server.address;
        Connection::open(Transport::Stream, address, NEWCOMER_SILENCE, requirements)?
            .with_key(self.key.clone())
    }

    fn wait_for(&mut self, phase: Phase) -> Result<TickSample<N>, PlayError> {
        self.wait(|sample| sample.phase == phase)
    }

    fn wait_ticks(&mut self, from: u64, ticks: u64) -> Result<TickSample<N>, PlayError> {
        self.wait(|sample| sample.tick >= from + ticks)
    }

    fn wait(
        &mut self,
        found: impl FnMut(&TickSample<N>) -> bool,
    ) -> Result<TickSample<N>, PlayError> {
        let progress = self.progress;
        self.sampler.until(false, |_| progress.step(), found)
    }

    fn say(&self, line: &str) {
        self.progress.say(line);
    }
}

/// True if the client has ended before its first command: no session whose end could be sampled.
fn has_failed<T>(client: &JoinHandle<T>, controls: &ClientControls) -> bool {
    client.is_finished() && controls.commands.load(Ordering::Relaxed) == 0
}

/// Judges the probe: the deadlines missed in the first second, before any step.
fn judge(missed: u32) -> Result<(), PlayError> {
    if missed <= PROBE_MISSES {
        return Ok(());
    }
    Err(PlayError::Lost(format!(
        "this machine does not hold 1 kHz: {missed} deadlines missed in the first second, before any step"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_five_misses_of_the_probe_are_too_many() {
        assert_eq!(judge(5), Ok(()));
        let Err(PlayError::Lost(reason)) = judge(6) else {
            panic!("6 misses are taken");
        };
        assert!(
            reason.contains("6 deadlines missed in the first second"),
            "{reason}"
        );
    }
}
