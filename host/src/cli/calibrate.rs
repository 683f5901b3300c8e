//! `gantry-tau calibrate`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use gantry_tau::files::write;
use gantry_tau::geometry::calibrate::{CalibrateOptions, calibrate_f1, calibrate_l2};
use gantry_tau::robot_file::AnyRobotFile;
use gantry_tau::terminal::say;

use super::{Outcome, fail};

/// Find the geometry of a machine from poses that a camera, an arm or a tracker has measured
///
/// Reads a set-up (TOML) and its table (CSV), fits all kinematic parameters, moves them into the robot's frame, and writes the robot
/// file of this machine: the old one with the geometry replaced, its comments kept.
///
/// Exit codes: 3 done, and not to be trusted as it is; the reasons are printed, the files are written.
#[derive(Debug, Args)]
pub(crate) struct Calibrate {
    /// Set-up of the measurements, format = "gantry-tau poses 1"
    #[arg(value_name = "POSES.toml")]
    poses: PathBuf,
    /// The machine as it is known: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE")]
    robot: String,
    /// Robot file to be written; an existing one is replaced only with --force
    #[arg(short, value_name = "FILE.toml")]
    output: PathBuf,
    /// Replace an existing robot file
    #[arg(long)]
    force: bool,
    /// The answer for programs: parameters, intervals, covariance, outliers
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Largest expected error of a place over the workspace, mm
    #[arg(long, value_name = "MM", default_value_t = 0.1)]
    tolerance: f64,
}

impl Calibrate {
    pub(super) fn run(self) -> Outcome {
        if self.output.exists() && !self.force {
            return Err(format!("{} exists; --force replaces it", self.output.display()).into());
        }
        let robot = AnyRobotFile::named(&self.robot)?;
        let options = CalibrateOptions { poses: self.poses, robot: self.robot, tolerance_m: self.tolerance * 1e-3 };
        let calibration = match robot {
            AnyRobotFile::L2(robot) => calibrate_l2(&robot, &options)?,
            AnyRobotFile::F1(robot) => calibrate_f1(&robot, &options)?,
        };
        // What is written can be read, or nothing is.
        AnyRobotFile::parse(&self.output.display().to_string(), &calibration.robot_file)?;
        write(&self.output, &calibration.robot_file)?;
        if let Some(path) = &self.json {
            write(path, &calibration.json)?;
        }
        say(format_args!("{}: {}", self.output.display(), calibration.summary));
        if calibration.doubts.is_empty() {
            return Ok(ExitCode::SUCCESS);
        }
        Ok(fail(3, calibration.doubts.join("; ")))
    }
}
