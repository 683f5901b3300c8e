//! `gantry-tau plan`.

use std::path::Path;

use crate::terminal::say;
use clap::{Args, Subcommand, ValueEnum};
use gantry_tau_identify::measurements::springs::{Noise, read_gauges};
use gantry_tau_identify::plan::geometry::{GeometryOptions, PlannedMachine, plan_geometry};
use gantry_tau_identify::plan::springs::{SpringsOptions, plan_springs};
use gantry_tau_identify::plan::verify::plan_verify;
use gantry_tau_identify::plan::{self, Criterion, PlanError, Written};
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_system::output::{Kind, Output, write_all};

use super::machine::MachineOption;
use super::outputs::InputFile;
use super::{Outcome, doubted};

/// Plan measurements: straps, gauges and poses that make springs or geometry observable, and how
/// well they will be known
///
/// From a robot file and the noise of the instruments alone: standard deviations to expect
/// (Cramer-Rao), what cannot be seen and by name, observability indices, the time it takes. Writes
/// a plan (TOML), its empty table (CSV) and a sheet to follow at the machine (HTML), all three
/// beside each other.
///
/// Exit codes: 3 done, and not to be measured as it is; the reasons are printed, the files are
/// written.
#[derive(Debug, Args)]
pub(crate) struct Plan {
    #[command(subcommand)]
    task: Task,
}

#[derive(Debug, Subcommand)]
enum Task {
    Springs(Straps),
    Geometry(GeometryPlan),
    Verify(Verify),
    Check(Check),
}

/// Quantity that a plan makes small.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum By {
    /// Mean predicted variance of the tool's displacement, or of its place, over poses
    I,
    /// Volume of the parameters' confidence ellipsoid
    D,
}

impl From<By> for Criterion {
    fn from(by: By) -> Self {
        match by {
            By::I => Self::I,
            By::D => Self::D,
        }
    }
}

/// Plan, whose name gives table and sheet theirs.
fn plan_file(text: &str) -> Result<Output, &'static str> {
    match Path::new(text).extension() {
        Some(extension) if extension == "toml" => Ok(Output::new(text, Kind::Plan)),
        _ => Err("a plan ends in .toml; its table is a .csv, its sheet an .html"),
    }
}

/// Table and sheet beside a plan, `f1.csv` and `f1.html` of `f1.toml`; none beside other outputs.
pub(super) fn beside(plan: &Output) -> Vec<Output> {
    if plan.kind() != Kind::Plan {
        return Vec::new();
    }
    [("csv", Kind::Table), ("html", Kind::Sheet)]
        .map(|(extension, kind)| Output::new(plan.path().with_extension(extension), kind))
        .into()
}

/// Machine and output file.
#[derive(Debug, Args)]
struct Files {
    #[command(flatten)]
    machine: MachineOption,
    /// Plan to be written, with the table and the sheet beside it; existing ones are replaced only
    /// with --overwrite
    #[arg(short, long, value_name = "PLAN.toml", value_parser = plan_file)]
    output: Output,
    /// Replace existing files
    #[arg(long, alias = "force")]
    overwrite: bool,
}

impl Files {
    /// Name of the table, as the plan has it.
    fn table(&self) -> String {
        let table = self.output.path().with_extension("csv");
        table
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    }

    fn write(&self, written: &Written) -> Outcome {
        let beside = beside(&self.output);
        let texts = [&written.plan, &written.header, &written.sheet];
        let files = [&self.output]
            .into_iter()
            .chain(&beside)
            .zip(texts.map(String::as_str));
        write_all(&files.collect::<Vec<_>>())?;
        let paths: Vec<_> = beside
            .iter()
            .map(|output| output.path().display().to_string())
            .collect();
        let plan = self.output.path().display();
        say(format_args!(
            "{}\n\nplan: {plan}; table and sheet: {}",
            written.summary,
            paths.join(", ")
        ));
        Ok(doubted(&written.doubts))
    }
}

/// Options of straps and gauges.
#[derive(Debug, Args)]
struct Bench {
    /// Largest force, N
    #[arg(long, value_name = "N", default_value_t = 300.0)]
    force_max: f64,
    /// Gauges, a file of [[gauge]] tables as in a set-up; without it six on the platform and one
    /// per axis
    #[arg(long, value_name = "FILE.toml")]
    gauges: Option<InputFile>,
    /// Standard deviation of a gauge's mean over a window, um
    #[arg(long, value_name = "X", default_value_t = Noise::USUAL.gauge_um)]
    noise_um: f64,
    /// Standard deviation of each component of the force, N; of the moment 0.05 m of it
    #[arg(long, value_name = "Y", default_value_t = Noise::USUAL.force_n)]
    noise_n: f64,
}

impl Bench {
    fn options<K, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> Result<SpringsOptions, PlanError> {
        let gauges = self
            .gauges
            .as_deref()
            .map(|path| read_gauges(path, &robot.metres_per_q))
            .transpose()?;
        let moment_nm = self.noise_n * Noise::USUAL.moment_nm / Noise::USUAL.force_n;
        let noise = Noise {
            gauge_um: self.noise_um,
            force_n: self.noise_n,
            moment_nm,
        };
        Ok(SpringsOptions {
            force_max_n: self.force_max,
            noise,
            gauges,
            ..SpringsOptions::default()
        })
    }
}

/// Straps and gauges that tell the springs of links, carts and plates
#[derive(Debug, Args)]
struct Straps {
    #[command(flatten)]
    files: Files,
    /// Number of series: one strap each, levels up and down
    #[arg(long, value_name = "N", default_value_t = SpringsOptions::default().series)]
    series: usize,
    /// Largest number of poses; moving the gauges takes a quarter of an hour
    #[arg(long, value_name = "N", default_value_t = SpringsOptions::default().poses)]
    poses: usize,
    /// Quantity that the plan makes small
    #[arg(long, value_enum, default_value_t = By::I)]
    criterion: By,
    /// Add a series of small steps around the force at which the platform leaves cart 3
    #[arg(long)]
    around_jump: bool,
    #[command(flatten)]
    bench: Bench,
}

/// Poses of a target that tell the geometry
#[derive(Debug, Args)]
struct GeometryPlan {
    #[command(flatten)]
    files: Files,
    /// Number of poses
    #[arg(long, value_name = "N", default_value_t = GeometryOptions::default().poses)]
    poses: usize,
    /// Quantity that the plan makes small
    #[arg(long, value_enum, default_value_t = By::I)]
    criterion: By,
    /// Standard deviation of each coordinate of a measured place, um; of an orientation (F1), as of
    /// a place half a metre away
    #[arg(long, value_name = "X", default_value_t = GeometryOptions::default().noise_um)]
    noise_um: f64,
}

/// Straps at poses, hooks and directions that plan springs does not use, each with compensation off
/// and on
#[derive(Debug, Args)]
struct Verify {
    #[command(flatten)]
    files: Files,
    /// Number of straps
    #[arg(long, value_name = "N", default_value_t = 6)]
    series: usize,
    /// Largest number of poses
    #[arg(long, value_name = "N", default_value_t = 6)]
    poses: usize,
    #[command(flatten)]
    bench: Bench,
}

/// Judge a plan that somebody has written: standard deviations, lost directions, limits
#[derive(Debug, Args)]
struct Check {
    /// The plan, of springs or of poses
    #[arg(value_name = "PLAN.toml")]
    plan: InputFile,
    #[command(flatten)]
    machine: MachineOption,
    /// Ask for the links alone: the springs of the axes are known, or compensation holds the carts
    #[arg(long)]
    links_only: bool,
}

impl Plan {
    pub(super) fn run(self) -> Outcome {
        match self.task {
            Task::Springs(straps) => straps.run(),
            Task::Geometry(geometry) => geometry.run(),
            Task::Verify(verify) => verify.run(),
            Task::Check(check) => check.run(),
        }
    }
}

impl Straps {
    fn run(self) -> Outcome {
        let written = match self.files.machine.read()? {
            AnyRobotFile::L2(robot) => self.planned(&robot),
            AnyRobotFile::F1(robot) => self.planned(&robot),
        };
        self.files.write(&written?)
    }

    fn planned<K: PlannedMachine<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> Result<Written, PlanError> {
        let options = SpringsOptions {
            series: self.series,
            poses: self.poses,
            criterion: self.criterion.into(),
            around_jump: self.around_jump,
            ..self.bench.options(robot)?
        };
        plan_springs(robot, &options, &self.files.table())
    }
}

impl GeometryPlan {
    fn run(self) -> Outcome {
        let options = GeometryOptions {
            poses: self.poses,
            criterion: self.criterion.into(),
            noise_um: self.noise_um,
        };
        let written = match self.files.machine.read()? {
            AnyRobotFile::L2(robot) => plan_geometry(&*robot, &options, &self.files.table()),
            AnyRobotFile::F1(robot) => plan_geometry(&*robot, &options, &self.files.table()),
        };
        self.files.write(&written?)
    }
}

impl Verify {
    fn run(self) -> Outcome {
        let written = match self.files.machine.read()? {
            AnyRobotFile::L2(robot) => self.planned(&robot),
            AnyRobotFile::F1(robot) => self.planned(&robot),
        };
        self.files.write(&written?)
    }

    fn planned<K: PlannedMachine<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> Result<Written, PlanError> {
        let options = SpringsOptions {
            series: self.series,
            poses: self.poses,
            ..self.bench.options(robot)?
        };
        plan_verify(robot, &options, &self.files.table())
    }
}

impl Check {
    fn run(self) -> Outcome {
        let (summary, doubts) = match self.machine.read()? {
            AnyRobotFile::L2(robot) => checked(&robot, &self.plan, self.links_only)?,
            AnyRobotFile::F1(robot) => checked(&robot, &self.plan, self.links_only)?,
        };
        say(summary);
        Ok(doubted(&doubts))
    }
}

fn checked<K: PlannedMachine<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    path: &Path,
    is_links_only: bool,
) -> Result<(String, Vec<String>), PlanError> {
    plan::check(robot, path, is_links_only)
}
