//! The campaign on a machine behind a server. A client stays in Submit (or obtains, in series with
//! compensation or where it is asked for) in a thread of its own and answers every State; what it
//! sees goes to the campaign, which waits for poses and straps and takes the windows. A session
//! that is lost pauses the campaign; the windows are on disk.

mod campaign;
pub mod keyboard;
mod probe;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use gantry_tau_client::force_sensor::SensorSource;
use gantry_tau_client::{ClientControls, ClientError, ClientOptions, ClientReport, run_observed};
use gantry_tau_core::control::endpoint::Transport;
use gantry_tau_core::control::keys::Key;
use gantry_tau_core::control::message::Refusal;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::links::gauges::GaugeReader;
use gantry_tau_system::dial::Addresses;

use super::ExperimentError;
use super::prediction::Prediction;
use super::table::WindowTable;
use crate::measurements::plan::Plan;
use campaign::LiveCampaign;
use probe::{Probe, ProbeTick};

/// Ticks that may wait for the campaign, some 16 s.
const QUEUE: usize = 16_384;
/// Pause before a lost session is taken up again.
const RECONNECT: Duration = Duration::from_millis(500);
/// Pause when nothing has arrived.
const REST: Duration = Duration::from_millis(1);

/// Options of a live campaign.
#[derive(Clone, Debug)]
pub struct LiveOptions<K, const N: usize> {
    /// The machine.
    pub robot: RobotFile<K, N>,
    /// Plan to measure.
    pub plan: Plan<N>,
    /// Addresses of the server.
    pub server: Addresses,
    /// TCP or UDP.
    pub transport: Transport,
    /// Key of the server; `None` for a server without keys.
    pub key: Option<Key>,
    /// Source of the force samples.
    pub sensor: SensorSource,
    /// Addresses of the accelerometer's link, as of a [`ClientOptions`].
    pub accelerometer: Option<Addresses>,
    /// Addresses of the gauges; `None`: they are typed in.
    pub gauges: Option<Addresses>,
    /// Ask for Obtain in all series, not only in those with compensation.
    pub obtain: bool,
    /// A series begins once the gauges have been away, and no operator is asked.
    pub is_unattended: bool,
    /// Table of every tick of a series, if wanted.
    pub raw: Option<PathBuf>,
    /// Table of the windows.
    pub output: PathBuf,
}

/// Result of a live campaign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LiveReport {
    /// Windows taken.
    pub taken: usize,
    /// Windows of the plan that are not in the table.
    pub missing: usize,
}

/// Error of a live campaign.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The campaign cannot go on.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The session cannot begin, or cannot be taken up again.
    #[error(transparent)]
    Client(#[from] ClientError),
}

impl LiveError {
    /// Returns the exit code of the command line.
    #[must_use]
    pub const fn exit_code(&self) -> u8 {
        match self {
            Self::Experiment(_) => 1,
            Self::Client(error) => error.exit_code(),
        }
    }
}

/// Measures a plan, from the first window that the table does not have, until all are taken or
/// `quit` is set. `keys` are lines typed: empty to begin a series; `again`, `skip`, `remount`,
/// `quit`; or the readings of the gauges.
///
/// # Errors
/// [`LiveError`]: the first session does not begin; or the plan, the gauges' records or the table
/// are not usable. Other ends of a session are waited out.
pub fn run<K: MachineKind<N>, const N: usize>(
    options: LiveOptions<K, N>,
    quit: &AtomicBool,
    keys: &Receiver<String>,
) -> Result<LiveReport, LiveError> {
    let LiveOptions {
        robot,
        mut plan,
        server,
        transport,
        key,
        sensor,
        accelerometer,
        gauges,
        obtain,
        is_unattended,
        raw,
        output,
    } = options;
    if obtain {
        plan.series
            .iter_mut()
            .for_each(|series| series.compensated = true);
    }
    let prediction = Prediction::new(&robot).map_err(ExperimentError::from)?;
    let table = WindowTable::open(&output, &plan, true)?;
    let count = if gauges.is_some() {
        plan.gauges.len()
    } else {
        0
    };
    let link = GaugeLink {
        gauges,
        count,
        metres_per_q: robot.metres_per_q,
    };
    let mut campaign = LiveCampaign::new(&robot, plan, table, prediction, raw.as_deref())?;
    campaign.set_instruments(link.gauges.is_some(), is_unattended);
    let mut client = ClientOptions {
        server,
        transport,
        sensor,
        accelerometer,
        robot,
        key,
        record: None,
        obtain,
        accept_unstable: false,
    };
    let mut was_granted = false;
    while !campaign.is_done() && !quit.load(Ordering::Relaxed) {
        client.obtain = campaign.is_compensated();
        let (granted, ended) = link.session(&client, &mut campaign, quit, keys);
        was_granted |= granted;
        match ended {
            // Left for the other mode, too: pose and tare must be found again.
            Ok(()) => campaign.pause(),
            Err(LiveError::Client(error))
                if (was_granted && !is_final(&error)) || is_passing(&error) =>
            {
                tracing::warn!(
                    "{error}; the campaign pauses until the session can be taken up again"
                );
                campaign.pause();
                let since = Instant::now();
                while since.elapsed() < RECONNECT && !quit.load(Ordering::Relaxed) {
                    std::thread::sleep(REST);
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(campaign.report())
}

/// True if another session would end in the same way.
const fn is_final(error: &ClientError) -> bool {
    matches!(error, ClientError::Setup(_) | ClientError::Incompatible(_))
}

/// True if the server only needs a moment: the session before has hardly ended.
const fn is_passing(error: &ClientError) -> bool {
    matches!(error, ClientError::Refused(Refusal::Ramping { .. }))
}

/// Gauges beside the server.
struct GaugeLink<const N: usize> {
    gauges: Option<Addresses>,
    /// Number of gauges of the plan that are read over the link.
    count: usize,
    metres_per_q: [f64; N],
}

impl<const N: usize> GaugeLink<N> {
    /// Runs one session; also returns whether it was granted.
    fn session<K: MachineKind<N>>(
        &self,
        client: &ClientOptions<K, N>,
        campaign: &mut LiveCampaign<N>,
        quit: &AtomicBool,
        keys: &Receiver<String>,
    ) -> (bool, Result<(), LiveError>) {
        let connected = self.gauges.as_ref().map(|address| {
            GaugeReader::connect(address.clone(), quit)
                .map_err(|error| ClientError::unreachable("gauges", address, error))
        });
        let gauges = match connected.transpose() {
            Ok(gauges) => gauges,
            Err(error) => return (false, Err(error.into())),
        };
        let (queue, mut ticks) = rtrb::RingBuffer::new(QUEUE);
        let controls = ClientControls::default();
        let mut probe = Probe::new(
            quit,
            &controls,
            gauges,
            self.count,
            self.metres_per_q,
            queue,
        );
        std::thread::scope(|scope| {
            // The probe ends with the session, and the queue with the probe.
            let shared = &controls;
            let running = scope.spawn(move || {
                let ended = run_observed(client, shared, &mut probe);
                (probe.was_granted(), ended)
            });
            let leaving = Leaving(&controls);
            let measured = follow(&mut ticks, campaign, client.obtain, &controls, quit, keys);
            drop(leaving);
            match running.join() {
                Ok((granted, ended)) => (
                    granted,
                    measured
                        .map_err(LiveError::from)
                        .and(ended.and_then(stayed).map_err(LiveError::from)),
                ),
                Err(_) => (
                    false,
                    Err(ClientError::Setup("the client's thread panicked".to_owned()).into()),
                ),
            }
        })
    }
}

/// Refuses a session that left Obtain by itself: what follows is not measured with compensation.
fn stayed(report: ClientReport) -> Result<(), ClientError> {
    match report.last_oscillation {
        None => Ok(()),
        Some(oscillation) => Err(ClientError::Setup(format!(
            "{oscillation}: the series cannot be measured with compensation (`gantry-tau stability` tells which filter is stable)"
        ))),
    }
}

/// Makes the client leave when the campaign has ended, however it did.
struct Leaving<'a>(&'a ClientControls);

impl Drop for Leaving<'_> {
    fn drop(&mut self) {
        self.0.quit.store(true, Ordering::Relaxed);
    }
}

/// Feeds the campaign until the client has ended. It leaves when the campaign is done, or the next
/// series wants compensation on where it is off, or off where it is on: `obtain`; or when it left
/// Obtain by itself.
fn follow<const N: usize>(
    ticks: &mut rtrb::Consumer<ProbeTick<N>>,
    campaign: &mut LiveCampaign<N>,
    obtain: bool,
    controls: &ClientControls,
    quit: &AtomicBool,
    keys: &Receiver<String>,
) -> Result<(), ExperimentError> {
    loop {
        let is_abandoned = ticks.is_abandoned();
        while let Ok(line) = keys.try_recv() {
            if line.trim() == "quit" {
                quit.store(true, Ordering::Relaxed);
            } else {
                campaign.key(line.trim())?;
            }
        }
        // The client has left Obtain by itself; the tare comes after the wish to obtain.
        let has_left = obtain
            && controls.tared.load(Ordering::Relaxed)
            && !controls.obtain.load(Ordering::Relaxed);
        let is_other_mode = has_left || campaign.is_compensated() != obtain;
        if quit.load(Ordering::Relaxed) || campaign.is_done() || is_other_mode {
            controls.quit.store(true, Ordering::Relaxed);
        }
        match ticks.pop() {
            Ok(_) if is_other_mode => {}
            Ok(tick) => campaign.feed(&tick)?,
            Err(_) if is_abandoned => return Ok(()),
            Err(_) => std::thread::sleep(REST),
        }
    }
}

#[cfg(test)]
mod tests;
