//! `demo`: one session over loopback TCP, with force steps, compensation, and a pulled cable; ends
//! with a table and a report.

mod corrections;
mod motion;
mod report;
mod results;
mod sampler;
mod scenario;
mod table;

use std::path::PathBuf;

use gantry_tau_core::control::position_loop::config::LoopConfig;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_machine::dynamics::{MassiveMachine, Modes};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::stability::Place;
use gantry_tau_machine::stability::design::SETTLED;
use gantry_tau_record::recording::RecordTo;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::server::cycle::Cycle;
use gantry_tau_server::server::tick_source::TickSource;
use gantry_tau_sim::load_generator::AppliedLoad;
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_system::output::{Output, WriteError};

use crate::terminal::{Progress, complain, say};
pub use corrections::Corrections;
pub use motion::{InMotion, MotionNumbers};
pub use results::{ALLOWED_SHARE, ForceStep, LinkQuality, Ramp, Results};
use scenario::Recording;

/// Pace of the demo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaceChoice {
    /// Real time if this machine holds 1 kHz, lock-step otherwise.
    Auto,
    /// This one.
    Only(TickSource),
}

/// Options of the demo.
#[derive(Clone, Debug)]
pub struct DemoOptions<K, const N: usize> {
    /// The machine.
    pub robot: RobotFile<K, N>,
    /// The machine as the client knows it: that of [`robot`](Self::robot), or of another file.
    pub client: RobotFile<K, N>,
    /// Path of the key file of server and client, if frames are to have tags.
    pub key: Option<PathBuf>,
    /// Real time or lock-step.
    pub pace: PaceChoice,
    /// Largest force, N.
    pub force_max_n: f64,
    /// Difference between two steps, N.
    pub force_step_n: f64,
    /// Length of a step, s.
    pub step_seconds: f64,
    /// Path of the report.
    pub report: Output,
    /// Path of the numbers as JSON, if wanted.
    pub json: Option<Output>,
    /// Path of the client's recording, if wanted.
    pub record: Option<RecordTo>,
    /// Path of the black box of the pulled cable, if wanted.
    pub black_box: Option<Output>,
}

/// Reason why a demo failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DemoError {
    /// An option is out of range.
    #[error("{0}")]
    Option(String),
    /// The session ended by itself: this machine does not hold 1 kHz.
    #[error("{0}")]
    Lost(String),
    /// Any other failure.
    #[error("{0}")]
    Failed(String),
}

impl From<WriteError> for DemoError {
    fn from(error: WriteError) -> Self {
        Self::Failed(error.to_string())
    }
}

impl<K, const N: usize> DemoOptions<K, N> {
    /// Forces of the steps, N: multiples of the step up to the largest.
    fn forces_n(&self) -> Vec<f64> {
        let mut forces = Vec::new();
        let mut force = self.force_step_n;
        while force <= self.force_max_n * (1.0 + 1e-9) {
            forces.push(force);
            force += self.force_step_n;
        }
        forces
    }

    /// Length of a step in ticks of 1 ms.
    fn step_ticks(&self) -> u64 {
        (self.step_seconds * 1e3).round() as u64
    }

    /// Shortest step in which a client's filter of the load settles, s; 0 without masses.
    fn shortest_step_s(&self) -> f64
    where
        K: MachineKind<N>,
    {
        let place = Place::at_home(&self.client, 1.0).filter(|_| self.robot.masses.is_some());
        place.map_or(0.0, |place| 5.0 * place.filter().settling_s(SETTLED))
    }

    fn check(&self) -> Result<(), DemoError>
    where
        K: MachineKind<N>,
    {
        let shortest_s = self.shortest_step_s();
        if self.step_seconds < shortest_s {
            return Err(DemoError::Option(format!(
                "--step-seconds must be at least {:.2}: five times what the filter of the client takes to settle",
                (shortest_s * 100.0).ceil() / 100.0
            )));
        }
        let out_of_range = if !(50.0..=1_000.0).contains(&self.force_step_n) {
            "--force-step must be from 50 to 1000 N: smaller steps drown in noise"
        } else if !(self.force_step_n..=2_000.0).contains(&self.force_max_n) {
            "--force-max must be from one --force-step (default 60 N) to 2000 N"
        } else if !(0.2..=60.0).contains(&self.step_seconds) {
            "--step-seconds must be from 0.2 to 60: the tool needs time to settle"
        } else {
            return Ok(());
        };
        Err(DemoError::Option(out_of_range.to_owned()))
    }
}

/// Runs the demo on the simulated machine, prints progress and table, writes the report.
///
/// # Errors
/// [`DemoError`].
pub fn run<K: MachineKind<N>, const N: usize, const M: usize>(
    options: &DemoOptions<K, N>,
) -> Result<Results, DemoError> {
    run_on(
        options,
        |robot, tool| SimulatedMachine::<N, M>::moving_from_robot(robot, tool, Motion::Hold),
        Cycle::with_position_loops,
    )
}

/// Says that a file has no masses.
pub const NO_MASSES: &str = "no masses: the platform is in equilibrium in every cycle";

/// Cycles in which a load on a machine with masses is reached: two periods of its lowest mode at
/// home; 0 without masses.
#[must_use]
pub fn glide_cycles<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> u32 {
    lowest_hz(robot).map_or(0, |hz| (2.0e3 / hz).ceil() as u32)
}

fn lowest_hz<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) -> Option<f64> {
    let machine = MassiveMachine::of(robot)?;
    let home = Pose::at(robot.home_m());
    let modes = Modes::of(&machine, &(&home).into(), &robot.home_q().ok()?)?;
    modes.hz().first().copied()
}

/// Gives a cycle the position loops of a robot file; of a machine that takes positions, none.
pub type Loops<const N: usize, const M: usize, P> =
    fn(
        Cycle<N, M, P>,
        Option<[LoopConfig; N]>,
    ) -> Result<Cycle<N, M, P>, gantry_tau_server::server::ServerError>;

/// Runs the demo on a machine that `build` makes, with this load on its tool. It has the masses of the file.
///
/// # Errors
/// [`DemoError`].
pub fn run_on<K, P, E, const N: usize, const M: usize>(
    options: &DemoOptions<K, N>,
    build: impl Fn(&RobotFile<K, N>, AppliedLoad) -> Result<P, E>,
    loops: Loops<N, M, P>,
) -> Result<Results, DemoError>
where
    K: MachineKind<N>,
    P: Plant<N, M> + 'static,
    E: std::error::Error,
{
    options.check()?;
    if options.robot.masses.is_none() {
        say(NO_MASSES);
    }
    // A path that cannot be written is found before the demo, not after it.
    let files = [&options.json, &options.black_box];
    for output in std::iter::once(&options.report).chain(files.into_iter().flatten()) {
        output.check(false)?;
    }
    if let Err(denied) = gantry_tau_server::realtime::lock_memory() {
        tracing::warn!("no {}: {}", denied.privilege, denied.reason);
    }
    // Before the session: what fails here costs no recording.
    let in_motion = InMotion::of::<K, N, M>(options)?;
    let (pace, recording) = match options.pace {
        PaceChoice::Only(pace) => (pace, play(options, &build, loops, pace, false)?),
        PaceChoice::Auto => {
            say(
                "real time at 1 kHz; if this machine does not hold it, the demo starts again in lock-step",
            );
            match play(options, &build, loops, TickSource::RealTime, true) {
                Ok(recording) => (TickSource::RealTime, recording),
                Err(DemoError::Lost(reason)) => {
                    say(format_args!(
                        "{reason}\nOther programs delay this one; a session tolerates one missed deadline, not two in a row.\n\
                         Starting again from the beginning in lock-step (the server waits for its client, link times mean nothing)."
                    ));
                    let ticks = TickSource::Lockstep;
                    (ticks, play(options, &build, loops, ticks, false)?)
                }
                Err(error) => return Err(error),
            }
        }
    };
    let numbers = in_motion.as_ref().map(InMotion::numbers);
    let results = Results::of(options, pace, &recording, numbers);
    say(format_args!("\n{}", table::render(&results)));
    // One that cannot be written costs no other.
    let written = [
        write_report(options, &results, &recording, in_motion.as_ref()),
        write_json(options, &results),
        write_black_box(options, &recording),
    ];
    let mut failures = written.into_iter().filter_map(Result::err);
    match failures.next() {
        None => Ok(results),
        Some(first) => {
            failures.for_each(complain);
            Err(first)
        }
    }
}

fn write_report<K: MachineKind<N>, const N: usize>(
    options: &DemoOptions<K, N>,
    results: &Results,
    recording: &Recording<N>,
    in_motion: Option<&InMotion>,
) -> Result<(), DemoError> {
    options
        .report
        .write(&report::render(options, results, recording, in_motion))?;
    say(format_args!("report: {}", options.report.path().display()));
    Ok(())
}

fn write_json<K, const N: usize>(
    options: &DemoOptions<K, N>,
    results: &Results,
) -> Result<(), DemoError> {
    let Some(output) = &options.json else {
        return Ok(());
    };
    let json = serde_json::to_string_pretty(results)
        .map_err(|error| DemoError::Failed(error.to_string()))?;
    output.write(&json)?;
    Ok(())
}

fn write_black_box<K, const N: usize>(
    options: &DemoOptions<K, N>,
    recording: &Recording<N>,
) -> Result<(), DemoError> {
    let Some(output) = &options.black_box else {
        return Ok(());
    };
    let black_box = recording.black_box.as_ref().ok_or_else(|| {
        DemoError::Failed("the black box of the pulled cable was not received".to_owned())
    })?;
    let path = output.write(&gantry_tau_record::black_box::encode(black_box))?;
    let path = path.display();
    say(format_args!(
        "black box of the pulled cable: {path}; gantry-tau replay {path} runs it again"
    ));
    Ok(())
}

fn play<K, P, E, const N: usize, const M: usize>(
    options: &DemoOptions<K, N>,
    build: impl Fn(&RobotFile<K, N>, AppliedLoad) -> Result<P, E>,
    loops: Loops<N, M, P>,
    ticks: TickSource,
    probe: bool,
) -> Result<Recording<N>, DemoError>
where
    K: MachineKind<N>,
    P: Plant<N, M> + 'static,
    E: std::error::Error,
{
    let steps = 2 * options.forces_n().len() as u64;
    let tare = u64::from(options.robot.sensor.tare_samples);
    // Half a second of rests, three of ramp.
    let progress = Progress::new(tare + steps * options.step_ticks() + 3_500, "ticks");
    Ok(scenario::play(
        options, build, loops, ticks, probe, &progress,
    )?)
}
