//! `gantry-tau client`.

use std::process::ExitCode;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};

use crate::signals;
use crate::terminal::say;
use clap::Args;
use gantry_tau_client::force_sensor::Sample;
use gantry_tau_client::{ClientControls, ClientError, ClientOptions, Observer, operator};
use gantry_tau_core::control::message::{State, Welcome};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::dial::Addresses;

use super::key::KeyOption;
use super::outputs::NamedInput;
use super::recording::ClientRecording;
use super::{Instruments, MachineCommand, Outcome, fail, peer, read_keyboard, transport};

/// Connect to a server, compensate the measured force, leave with Ctrl-C
///
/// Connects, stays in Submit while the force sensor is tared (keep the tool unloaded), then
/// compensates in Obtain until Ctrl-C.
///
/// Type `submit` (the offsets move to zero, and are then computed and reported only), `obtain`
/// (they act), `gain X` (share of the correction, 0 to 1, in place of that of the robot file),
/// `status` or `quit`, and Enter. The end of the input is no quit.
///
/// Exit codes: 0 left with Goodbye; 1 setup; 3 unreachable; 4 refused; 5 incompatible server; 6
/// session ended by the server; 7 server vanished; 8 force sensor silent.
#[derive(Debug, Args)]
pub(crate) struct Client {
    /// Address of the server
    #[arg(default_value = "127.0.0.1:7000", value_name = "HOST:PORT", value_parser = peer)]
    server: Addresses,
    #[command(flatten)]
    key: KeyOption,
    #[command(flatten)]
    instruments: Instruments,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: NamedInput,
    /// UDP datagrams instead of a TCP stream; the server needs --udp as well
    #[arg(long)]
    udp: bool,
    /// Stay in Submit: offsets are computed and reported, but do not reach the drives
    #[arg(long)]
    submit_only: bool,
    /// Obtain even if the compensation may swing: with a margin of stability below 2 at home
    #[arg(long)]
    accept_unstable: bool,
    #[command(flatten)]
    recording: ClientRecording,
}

impl MachineCommand for Client {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        let controls = Arc::new(ClientControls::default());
        let shared = Arc::clone(&controls);
        signals::on_quit(move || shared.quit.store(true, Ordering::Relaxed));
        let options = ClientOptions {
            server: self.server,
            transport: transport(self.udp),
            sensor: self.instruments.sensor.unwrap_or_default(),
            accelerometer: Some(self.instruments.accelerometer),
            robot,
            key: self.key.read()?,
            record: self.recording.to(),
            obtain: false,
            accept_unstable: self.accept_unstable,
        };
        // Before the operator is heard, whose word comes later.
        controls.obtain.store(!self.submit_only, Ordering::Relaxed);
        let mut watch = Watch::default();
        listen_to_the_operator(Arc::clone(&controls), watch.clone());
        let report = match gantry_tau_client::run_observed(&options, &controls, &mut watch) {
            Ok(report) => report,
            Err(error) => return Ok(fail(error.exit_code(), &error)),
        };
        if report.states == 0 {
            say("left before a session was granted");
            return Ok(ExitCode::SUCCESS);
        }
        say(format_args!(
            "left with Goodbye after {} ticks ({} without a correction of their own, {} with a saturated one); the server ramps the offsets to zero",
            report.states, report.held, report.saturated
        ));
        if let Some(last) = report.last_oscillation {
            say(format_args!(
                "left Obtain because of oscillations: {}; the last: {last}",
                report.oscillations
            ));
        }
        if let Some(recorded) = report.recorded {
            say(recorded);
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// The State that was answered last, for the operator's `status`.
#[derive(Clone, Debug)]
struct Watch<const N: usize>(Arc<Mutex<Option<State<N>>>>);

impl<const N: usize> Default for Watch<N> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<const N: usize> Observer<N> for Watch<N> {
    fn welcomed(&mut self, _: &Welcome<N>) {}

    fn answered(&mut self, state: &State<N>, _: Option<&Sample>) -> Result<(), ClientError> {
        // While it is being read the cycle does not wait.
        if let Ok(mut last) = self.0.try_lock() {
            *last = Some(*state);
        }
        Ok(())
    }
}

impl<const N: usize> Watch<N> {
    /// Prints one line.
    fn say(&self) {
        let last = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(state) = last else {
            say("no State yet");
            return;
        };
        let offsets_nm = state.axes.map(|axis| axis.offsets.position.0);
        let computed_nm = state.axes.map(|axis| axis.shadow.position.0);
        say(format_args!(
            "tick {}, {}: offsets {} um, computed {} um; {} of the last 100 deadlines kept, {} missed",
            state.tick.0,
            state.phase,
            listed_um(&offsets_nm),
            listed_um(&computed_nm),
            state.on_time_of_100,
            state.counters.missed
        ));
    }
}

/// Text of these numbers in micrometres.
fn listed_um(numbers_nm: &[i32]) -> String {
    let um = numbers_nm
        .iter()
        .map(|nm| format!("{:.1}", f64::from(*nm) * 1e-3));
    um.collect::<Vec<_>>().join(", ")
}

/// Reads commands from the standard input, in a thread that ends with the process.
fn listen_to_the_operator<const N: usize>(controls: Arc<ClientControls>, watch: Watch<N>) {
    read_keyboard(move |input| operator::listen(input, &controls, || watch.say()));
}
