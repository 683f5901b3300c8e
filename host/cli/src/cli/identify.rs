//! `gantry-tau identify`.

use std::path::{Path, PathBuf};

use crate::terminal::say;
use clap::Args;
use gantry_tau_identify::measurements;
use gantry_tau_identify::springs::identify::{IdentifyError, IdentifyOptions, identify};
use gantry_tau_identify::springs::thesis;
use gantry_tau_identify::tool::{self, ToolOptions};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_system::output::{Kind, Output};

use super::outputs::{InputFile, NamedInput, file, write_learned};
use super::{Outcome, doubted};

/// Find the springs of a machine from forces and length gauges, or the weight of its tool from
/// turned poses
///
/// Reads a set-up (TOML) and its table (CSV), fits the compliances of all links and axes, the play
/// of cluster 3 and what is uncertain of the set-up, and writes the robot file of this machine: the
/// old one with the compliances replaced, its comments kept.
///
/// A set-up with format = "gantry-tau tool 1" has readings of the force sensor in several
/// orientations, with nothing touching the tool: from them weight and centre of gravity of the
/// tool, `[sensor.tool]` of the robot file, and the bias of the sensor.
///
/// Exit codes: 0 done; 1 nothing is written, the reason is printed; 2 usage; 3 done, and not to be
/// trusted as it is; the reasons are printed, the files are written.
#[derive(Debug, Args)]
pub(crate) struct Identify {
    /// Set-up of the measurements, format = "gantry-tau springs 1" or "gantry-tau tool 1"
    #[arg(value_name = "SETUP.toml")]
    setup: InputFile,
    /// The machine as it is known: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE")]
    robot: NamedInput,
    /// Robot file to be written; an existing one is replaced only with --overwrite
    #[arg(short, long, value_name = "FILE.toml", value_parser = file(Kind::Robot))]
    output: Output,
    /// Replace an existing robot file
    #[arg(long, alias = "force")]
    overwrite: bool,
    /// Make the windows of this table of every tick, of `experiment --raw` or `serve --record`,
    /// instead of the set-up's table
    #[arg(long, value_name = "TABLE.csv")]
    raw: Option<InputFile>,
    /// Page with springs, intervals and plots
    #[arg(long, value_name = "PAGE.html", value_parser = file(Kind::Page))]
    report: Option<Output>,
    /// Page with the thesis' own evaluation of every series, beside the springs found and the
    /// thesis' tables 5.1 to 5.3
    #[arg(long, value_name = "PAGE.html", value_parser = file(Kind::Page), conflicts_with = "raw")]
    thesis: Option<Output>,
    /// The answer for programs: parameters, intervals, covariance, outliers, play
    #[arg(long, value_name = "FILE", value_parser = file(Kind::Answer))]
    json: Option<Output>,
    /// Take the noise from the residuals, not from the set-up
    #[arg(long)]
    scale: bool,
    /// Compare compliances of the links of their own beyond the jump with those before it;
    /// reported, not written
    #[arg(long)]
    two_regimes: bool,
    /// Fit the hysteresis of each gauge; below two standard deviations it is dropped
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
        let robot = AnyRobotFile::named(&self.robot)?;
        if measurements::format_of(&self.setup)? == measurements::tool::FORMAT {
            return self.run_tool(&robot);
        }
        let setup = PathBuf::from(self.setup);
        let thesis = self.thesis.as_ref().map(|_| match &robot {
            AnyRobotFile::L2(robot) => thesis_page(robot, &setup),
            AnyRobotFile::F1(robot) => thesis_page(robot, &setup),
        });
        let thesis = thesis.transpose()?.unwrap_or_default();
        let options = IdentifyOptions {
            setup,
            raw: self.raw.map(Into::into),
            robot: self.robot.into(),
            is_scaled: self.scale,
            is_robust: !self.no_robust,
            has_two_regimes: self.two_regimes,
            has_hysteresis: self.hysteresis,
            has_drift: self.drift,
        };
        let identification = match robot {
            AnyRobotFile::L2(robot) => identify(&robot, &options)?,
            AnyRobotFile::F1(robot) => identify(&robot, &options)?,
        };
        let json = (self.json.as_ref(), identification.json.as_str());
        let page = (self.report.as_ref(), identification.report.as_str());
        write_learned(
            &self.output,
            &identification.robot_file,
            &[json, page, (self.thesis.as_ref(), &thesis)],
        )?;
        say(format_args!(
            "{}: {}",
            self.output.path().display(),
            identification.summary
        ));
        for warning in &identification.warnings {
            say(format_args!("{warning}"));
        }
        Ok(doubted(&identification.doubts))
    }

    fn run_tool(self, robot: &AnyRobotFile) -> Outcome {
        let fits =
            self.scale || self.two_regimes || self.hysteresis || self.drift || self.no_robust;
        if self.raw.is_some() || self.report.is_some() || self.thesis.is_some() || fits {
            return Err(
                "--raw, --report, --thesis, --scale, --two-regimes, --hysteresis, --drift and --no-robust are for springs; leave them out"
                    .into(),
            );
        }
        let identified = tool::identify(
            robot,
            &ToolOptions {
                setup: self.setup.into(),
                robot: self.robot.into(),
            },
        )?;
        write_learned(
            &self.output,
            &identified.robot_file,
            &[(self.json.as_ref(), &identified.json)],
        )?;
        say(format_args!(
            "{}: {}",
            self.output.path().display(),
            identified.summary
        ));
        Ok(doubted(&identified.doubts))
    }
}

/// The page of the thesis' evaluation.
fn thesis_page<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    setup: &Path,
) -> Result<String, IdentifyError> {
    let table = measurements::table_of(setup).unwrap_or_default();
    thesis::page(robot, setup, &table)
}
