//! `demo`: one session over real loopback TCP, with force steps, compensation, and a pulled cable; ends with a table and a report.

mod report;
mod results;
mod stage;
mod table;
mod watch;

use std::fmt;
use std::path::PathBuf;

use indicatif::{ProgressBar, ProgressStyle};

use crate::model::Model;
use crate::robot_file::RobotFile;
use crate::server::pace::Pace;
use crate::terminal::say;
use stage::{Failure, Recording};

pub use results::{ALLOWED_SHARE, LinkQuality, Ramp, Results, Step};

/// Which pace the demo shall take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaceChoice {
    /// Real time if this machine holds it, lock-step otherwise.
    Auto,
    /// This one.
    Only(Pace),
}

/// What the demo is told.
#[derive(Clone, Debug)]
pub struct DemoOptions<K, const N: usize> {
    /// The machine.
    pub robot: RobotFile<K, N>,
    /// Clock or lock-step.
    pub pace: PaceChoice,
    /// Largest force, N.
    pub force_max_n: f64,
    /// Difference between two steps, N.
    pub force_step_n: f64,
    /// Length of a step, s.
    pub step_seconds: f64,
    /// Where the report goes.
    pub report: PathBuf,
    /// Where the numbers go, if anywhere.
    pub json: Option<PathBuf>,
    /// Where the client records, if anywhere.
    pub record: Option<PathBuf>,
    /// Where the black box of the pulled cable goes, if anywhere.
    pub black_box: Option<PathBuf>,
}

/// Why a demo came to no end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DemoError {
    /// An option is out of range.
    Option(String),
    /// The pace was forced and the session ended by itself.
    Lost(String),
    /// Something else failed.
    Failed(String),
}

impl fmt::Display for DemoError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Option(text) | Self::Lost(text) | Self::Failed(text) => f.write_str(text),
        }
    }
}

impl std::error::Error for DemoError {}

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
        let ticks = (self.step_seconds * 1e3).round();
        // `check` has limited the length; counting avoids a cast.
        (0..)
            .take_while(|tick| f64::from(*tick) < ticks)
            .count()
            .try_into()
            .unwrap_or(u64::MAX)
    }

    fn check(&self) -> Result<(), DemoError> {
        let bad = |text: &str| Err(DemoError::Option(text.to_owned()));
        if !(50.0..=1_000.0).contains(&self.force_step_n) {
            return bad("--force-step must be from 50 to 1000 N: smaller steps drown in noise");
        }
        if !(self.force_step_n..=2_000.0).contains(&self.force_max_n) {
            return bad(
                "--force-max must be from one --force-step (60 N unless you say otherwise) to 2000 N",
            );
        }
        if !(0.2..=60.0).contains(&self.step_seconds) {
            return bad("--step-seconds must be from 0.2 to 60: the tool needs time to settle");
        }
        Ok(())
    }
}

/// Plays the demo, prints progress and table, writes the report.
///
/// # Errors
/// [`DemoError`].
pub fn run<K: Model<N>, const N: usize, const M: usize>(
    options: &DemoOptions<K, N>,
) -> Result<Results, DemoError> {
    options.check()?;
    // Found out now rather than after the whole demo.
    let files = [&options.json, &options.black_box];
    for path in std::iter::once(&options.report).chain(files.into_iter().flatten()) {
        write(path, "")?;
    }
    if let Err(denied) = crate::realtime::lock_memory() {
        tracing::warn!("no {}: {}", denied.privilege, denied.reason);
    }
    let (pace, recording) = match options.pace {
        PaceChoice::Only(pace) => (pace, play::<K, N, M>(options, pace)?),
        PaceChoice::Auto => match play::<K, N, M>(options, Pace::RealTime) {
            Ok(recording) => (Pace::RealTime, recording),
            Err(DemoError::Lost(reason)) => {
                say(format_args!(
                    "{reason}\nThat is the one-miss rule at work on a busy machine. Starting again in lock-step: time is ticks, the server waits for its client."
                ));
                (Pace::Lockstep, play::<K, N, M>(options, Pace::Lockstep)?)
            }
            Err(error) => return Err(error),
        },
    };
    let results = Results::of(options, pace, &recording);
    say(format_args!("\n{}", table::render(&results)));
    write(
        &options.report,
        &report::render(options, &results, &recording),
    )?;
    say(format_args!("report: {}", options.report.display()));
    if let Some(path) = &options.json {
        let json = serde_json::to_string_pretty(&results)
            .map_err(|error| DemoError::Failed(error.to_string()))?;
        write(path, &json)?;
    }
    if let Some(path) = &options.black_box {
        let lost = || DemoError::Failed("the black box of the pulled cable is lost".to_owned());
        let window = recording.black_box.as_ref().ok_or_else(lost)?;
        write(path, &window.encode())?;
        let path = path.display();
        say(format_args!(
            "black box of the pulled cable: {path}; gantry-tau replay {path} runs it again"
        ));
    }
    Ok(results)
}

fn play<K: Model<N>, const N: usize, const M: usize>(
    options: &DemoOptions<K, N>,
    pace: Pace,
) -> Result<Recording<N>, DemoError> {
    let bar = progress_bar(options);
    let played = stage::play::<K, N, M>(options, pace, &bar);
    bar.finish_and_clear();
    played.map_err(|failure| match failure {
        Failure::Lost(lost) => DemoError::Lost(format!(
            "this machine does not hold 1 kHz throughout: in tick {} the session ended by itself ({})",
            lost.tick.0,
            lost.cause
        )),
        Failure::Error(error) => error,
    })
}

fn progress_bar<K, const N: usize>(options: &DemoOptions<K, N>) -> ProgressBar {
    let steps = u64::try_from(2 * options.forces_n().len()).unwrap_or(0);
    let tare = u64::from(options.robot.sensor.tare_samples);
    // Half a second of rests, three of ramp.
    let bar = ProgressBar::new(tare + steps * options.step_ticks() + 3_500);
    if let Ok(style) = ProgressStyle::with_template("[{elapsed}] {bar:40} {pos}/{len} ticks") {
        bar.set_style(style);
    }
    bar
}

fn write(path: &std::path::Path, text: &str) -> Result<(), DemoError> {
    std::fs::write(path, text)
        .map_err(|error| DemoError::Failed(format!("cannot write {}: {error}", path.display())))
}
