//! `gantry-tau identify`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use gantry_tau::files::write;
use gantry_tau::robot_file::AnyRobotFile;
use gantry_tau::springs::identify::{IdentifyOptions, identify};
use gantry_tau::terminal::say;

use super::{Outcome, fail};

/// Find the springs of a machine from forces on its tool and readings of length gauges
///
/// Reads a set-up (TOML) and its table (CSV), fits the compliances of all links and axes, the play of cluster 3 and what is uncertain of
/// the set-up, and writes the robot file of this machine: the old one with the compliances replaced, its comments kept.
///
/// Exit codes: 0 done; 1 nothing is written, the reason is printed; 2 usage; 3 done, and not to be trusted as it is; the reasons are printed,
/// the files are written.
#[derive(Debug, Args)]
pub(crate) struct Identify {
    /// Set-up of the measurements, format = "gantry-tau springs 1"
    #[arg(value_name = "SETUP.toml")]
    setup: PathBuf,
    /// The machine as it is known: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE")]
    robot: String,
    /// Robot file to be written; an existing one is replaced only with --force
    #[arg(short, value_name = "FILE.toml")]
    output: PathBuf,
    /// Replace an existing robot file
    #[arg(long)]
    force: bool,
    /// Page with springs, intervals and plots
    #[arg(long, value_name = "PAGE.html")]
    report: Option<PathBuf>,
    /// The answer for programs: parameters, intervals, covariance, outliers, play
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Take the noise from the residuals, not from the set-up
    #[arg(long)]
    scale: bool,
    /// Fit the hysteresis of each gauge
    #[arg(long)]
    hysteresis: bool,
    /// Fit a drift of each gauge in each series; the table needs time_s
    #[arg(long)]
    drift: bool,
    /// Keep readings that do not agree with the others
    #[arg(long)]
    no_robust: bool,
}

impl Identify {
    pub(super) fn run(self) -> Outcome {
        if self.output.exists() && !self.force {
            return Err(format!("{} exists; --force replaces it", self.output.display()).into());
        }
        let robot = AnyRobotFile::named(&self.robot)?;
        let options = IdentifyOptions {
            setup: self.setup,
            robot: self.robot,
            is_scaled: self.scale,
            is_robust: !self.no_robust,
            has_hysteresis: self.hysteresis,
            has_drift: self.drift,
        };
        let identification = match robot {
            AnyRobotFile::L2(robot) => identify(&robot, &options)?,
            AnyRobotFile::F1(robot) => identify(&robot, &options)?,
        };
        // What is written can be read, or nothing is.
        AnyRobotFile::parse(&self.output.display().to_string(), &identification.robot_file)?;
        write(&self.output, &identification.robot_file)?;
        if let Some(path) = &self.json {
            write(path, &identification.json)?;
        }
        if let Some(path) = &self.report {
            write(path, &identification.report)?;
        }
        say(format_args!("{}: {}", self.output.display(), identification.summary));
        for warning in &identification.warnings {
            say(format_args!("{warning}"));
        }
        if identification.doubts.is_empty() {
            return Ok(ExitCode::SUCCESS);
        }
        Ok(fail(3, identification.doubts.join("; ")))
    }
}
