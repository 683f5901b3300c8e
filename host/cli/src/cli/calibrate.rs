//! `gantry-tau calibrate`.

use crate::terminal::say;
use clap::{Args, ValueEnum};
use gantry_tau_identify::geometry::calibrate::{
    CalibrateOptions, FrameOption, GuidewaysOption, calibrate_f1, calibrate_l2,
};
use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_system::output::{Kind, Output};

use super::outputs::{InputFile, NamedInput, file, write_learned};
use super::{OptionError, Outcome, doubted};

/// Find the geometry of a machine from poses that a camera, an arm or a tracker has measured
///
/// Reads a set-up (TOML) and its table (CSV), fits all kinematic parameters, moves them into the
/// robot's frame, and writes the robot file of this machine: the old one with the geometry
/// replaced, its comments kept.
///
/// Exit codes: 0 done; 1 nothing is written, the reason is printed; 2 usage; 3 done, and not to be
/// trusted as it is; the reasons are printed, the files are written.
#[derive(Debug, Args)]
pub(crate) struct Calibrate {
    /// Set-up of the measurements, format = "gantry-tau poses 1"
    #[arg(value_name = "POSES.toml")]
    poses: InputFile,
    /// The machine as it is known: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE")]
    robot: NamedInput,
    /// Robot file to be written; an existing one is replaced only with --overwrite
    #[arg(short, long, value_name = "FILE.toml", value_parser = file(Kind::Robot))]
    output: Output,
    /// Replace an existing robot file
    #[arg(long, alias = "force")]
    overwrite: bool,
    /// The answer for programs: parameters, intervals, covariance, outliers
    #[arg(long, value_name = "FILE", value_parser = file(Kind::Answer))]
    json: Option<Output>,
    /// Page with what is left, expected errors and parameters
    #[arg(long, value_name = "PAGE.html", value_parser = file(Kind::Page))]
    report: Option<Output>,
    /// Frame of the machine in the file: nominal (where the robot file has it), measured (the
    /// device's), or a file of three or more points of the base that the device has measured,
    /// format = "gantry-tau frame 1"
    #[arg(long, value_name = "nominal|measured|FILE", default_value = "nominal")]
    frame: NamedInput,
    /// Guideways of an L2: free (21 parameters) or parallel (15)
    #[arg(long, value_enum, default_value_t = Guideways::Free)]
    guideways: Guideways,
    /// Centre of the target from the tool centre point, platform axes, m; without it, that of an L2
    /// is at the tool centre point, and that of an F1 is found
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, allow_hyphen_values = true)]
    target: Option<[f64; 3]>,
    /// Largest expected error of a place over the workspace, mm
    #[arg(long, value_name = "MM", default_value_t = 0.1)]
    tolerance: f64,
}

/// Guideways of an L2.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Guideways {
    /// Each has its own direction
    Free,
    /// All have one direction
    Parallel,
}

/// Three numbers, separated by commas.
fn triple(text: &str) -> Result<[f64; 3], OptionError> {
    let numbers: Result<Vec<f64>, _> = text
        .split(',')
        .map(|number| number.trim().parse::<f64>())
        .collect();
    <[f64; 3]>::try_from(numbers?)
        .ok()
        .filter(|numbers| numbers.iter().all(|number| number.abs() <= 10.0))
        .ok_or_else(|| "three numbers of metres, X,Y,Z, are needed".into())
}

impl Calibrate {
    pub(super) fn run(self) -> Outcome {
        let robot = AnyRobotFile::named(&self.robot)?;
        let options = CalibrateOptions {
            poses: self.poses.into(),
            robot: self.robot.into(),
            frame: match &*self.frame {
                "nominal" => FrameOption::Nominal,
                "measured" => FrameOption::Measured,
                path => FrameOption::Points(path.into()),
            },
            guideways: match self.guideways {
                Guideways::Free => GuidewaysOption::Free,
                Guideways::Parallel => GuidewaysOption::Parallel,
            },
            target_m: self.target,
            tolerance_m: self.tolerance * 1e-3,
        };
        let calibration = match robot {
            AnyRobotFile::L2(robot) => calibrate_l2(&robot, &options)?,
            AnyRobotFile::F1(robot) => calibrate_f1(&robot, &options)?,
        };
        let json = (self.json.as_ref(), calibration.json.as_str());
        let page = (self.report.as_ref(), calibration.report.as_str());
        write_learned(&self.output, &calibration.robot_file, &[json, page])?;
        say(format_args!(
            "{}: {}",
            self.output.path().display(),
            calibration.summary
        ));
        for remark in &calibration.remarks {
            say(format_args!("{remark}"));
        }
        Ok(doubted(&calibration.doubts))
    }
}
