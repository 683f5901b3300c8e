//! `gantry-tau experiment`.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};

use crate::signals;
use crate::terminal::say;
use clap::Args;
use gantry_tau_identify::experiment::live::{self, LiveOptions, keyboard};
use gantry_tau_identify::experiment::simulated::simulate;
use gantry_tau_identify::experiment::table::WindowTable;
use gantry_tau_identify::experiment::tracker::{Tracked, TrackedMachine, track};
use gantry_tau_identify::measurements::format_of;
use gantry_tau_identify::measurements::plan::{self, Plan};
use gantry_tau_identify::measurements::poses::{self, PosesPlan};
use gantry_tau_identify::springs::thesis;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use gantry_tau_system::dial::Addresses;
use gantry_tau_system::output::{Kind, Output, rows};

use super::key::KeyOption;
use super::machine::client_of;
use super::outputs::{ContinuedTable, InputFile, NamedInput, file};
use super::{Instruments, MachineCommand, Outcome, fail, peer, read_keyboard, run_on, transport};

/// Measure a campaign of forces and gauges, window by window
///
/// Reads a plan, and writes the table of windows that `identify` takes: means of axes, forces and
/// gauges at each level. It does not move the machine: it waits until the poses of the plan are
/// taken, says what to mount and how far to pull, and takes each window once everything has
/// settled. It stays in Submit, so no offset reaches a drive, except in series with
/// `compensated = true`: those are measured in a session that obtains, and the axes in the table
/// contain its offsets. A table that exists is continued: rows stay as they are, and their windows
/// are not taken again.
///
/// Type Enter to begin a series with the strap slack; `again` to take the last window once more;
/// `skip`; `remount` if a gauge or the strap was touched, which begins the series again; `quit`.
///
/// Exit codes: 0 done; 1 setup; 3 done, and windows are missing, or the server, the sensor or the
/// gauges are unreachable; 4 refused; 5 incompatible server; 6 to 9 the first session ended before
/// it was granted.
#[derive(Debug, Args)]
pub(crate) struct Experiment {
    /// The plan: a set-up with [[series]], format = "gantry-tau springs 1"; simulated also with
    /// [[pose]], format = "gantry-tau poses 1"
    #[arg(value_name = "PLAN.toml")]
    plan: InputFile,
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE", default_value = "l2")]
    pub(super) robot: NamedInput,
    /// Measure the simulated machine, without a server; SEED decides its springs and every error
    /// [default: the robot file's]
    #[arg(long, value_name = "SEED", num_args = 0..=1, conflicts_with_all = ["udp", "obtain", "raw", "ask_gauges", "unattended"])]
    simulated: Option<Option<u64>>,
    /// With --simulated: robot file of the client, whose springs compensate and predict how far the
    /// sensor turns, while those of --robot are the machine's [default: as --robot]
    #[arg(long, value_name = "l2|f1|FILE", requires = "simulated")]
    client: Option<NamedInput>,
    /// Address of the server
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7000", value_parser = peer)]
    server: Addresses,
    #[command(flatten)]
    key: KeyOption,
    #[command(flatten)]
    instruments: Instruments,
    /// Address of the gauges
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:7002", value_parser = peer)]
    gauges: Addresses,
    /// Type the readings of the gauges in
    #[arg(long, conflicts_with = "unattended")]
    ask_gauges: bool,
    /// UDP datagrams instead of a TCP stream; the server needs --udp as well
    #[arg(long)]
    udp: bool,
    /// Obtain: the compensation runs in all series
    #[arg(long)]
    obtain: bool,
    /// Begin each series by itself, once the gauges have been away and are back; for `serve --plan`
    #[arg(long)]
    unattended: bool,
    /// Record every tick of a series, from its slack level on, for `identify --raw`; continued
    /// where the table is
    #[arg(long, value_name = "FILE.csv")]
    raw: Option<ContinuedTable>,
    /// Page with the thesis' own evaluation of every series, beside that of `identify` and the
    /// thesis' tables 5.1 to 5.3
    #[arg(long, value_name = "PAGE.html", value_parser = file(Kind::Page))]
    thesis: Option<Output>,
    /// Table to be written, or continued
    #[arg(short, long, value_name = "MEASURED.csv")]
    output: ContinuedTable,
}

impl MachineCommand for Experiment {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        let plan = plan::read(&self.plan, K::MODEL, &robot.metres_per_q)?;
        plan.check_wrist(&self.plan, robot.wrist.len())?;
        match self.simulated {
            Some(seed) => self.simulated(robot, &plan, seed),
            None => self.live(robot, plan),
        }
    }
}

impl Experiment {
    pub(super) fn run(self) -> Outcome {
        if format_of(&self.plan)? != poses::FORMAT {
            return run_on(AnyRobotFile::named(&self.robot), self);
        }
        let Some(seed) = self.simulated else {
            let reason = "poses are measured by a camera, an arm or a tracker; --simulated [SEED] simulates one";
            return Err(format!("{}: {reason}", self.plan.display()).into());
        };
        if self.thesis.is_some() {
            return Err("--thesis is for springs; leave it out".into());
        }
        let Tracked { table, skipped } = match AnyRobotFile::named(&self.robot)? {
            AnyRobotFile::L2(robot) => self.tracked(*robot, seed)?,
            AnyRobotFile::F1(robot) => self.tracked(*robot, seed)?,
        };
        let is_taken = self.output.is_file()
            && std::fs::read_to_string(&*self.output).is_ok_and(|old| rows(&old) > 0);
        if is_taken {
            return Err(format!(
                "{} has rows; remove it, or name another file",
                self.output.display()
            )
            .into());
        }
        Output::new(&*self.output, Kind::Table).write(&table)?;
        let poses = table.lines().count().saturating_sub(1);
        say(format_args!(
            "{}: {poses} poses of the simulated machine",
            self.output.display()
        ));
        for pose in skipped {
            tracing::warn!("pose {pose} is skipped: the machine cannot stand there");
        }
        Ok(ExitCode::SUCCESS)
    }

    fn tracked<K: TrackedMachine<N>, const N: usize>(
        &self,
        mut robot: RobotFile<K, N>,
        seed: Option<u64>,
    ) -> Result<Tracked, Box<dyn std::error::Error>> {
        robot.simulation.seed = seed.unwrap_or(robot.simulation.seed);
        let (plan, noise) = PosesPlan::read(&self.plan, K::MODEL)?;
        Ok(track(&robot, &plan, &noise)?)
    }

    fn simulated<K: MachineKind<N>, const N: usize>(
        &self,
        mut robot: RobotFile<K, N>,
        plan: &Plan<N>,
        seed: Option<u64>,
    ) -> Outcome {
        let client = client_of(&robot, self.client.as_ref())?;
        robot.simulation.seed = seed.unwrap_or(robot.simulation.seed);
        let mut table = WindowTable::open(&self.output, plan, false)?;
        if !table.is_empty() {
            return Err(format!(
                "{} has rows; remove it, or name another file",
                self.output.display()
            )
            .into());
        }
        let rows = simulate(&robot, &client, plan)?.rows;
        for row in &rows {
            table.write(plan, row)?;
        }
        say(format_args!(
            "{}: {} windows of the simulated machine",
            self.output.display(),
            rows.len()
        ));
        note_table(&plan.table, &self.output);
        self.evaluate(&client)?;
        Ok(ExitCode::SUCCESS)
    }

    /// Writes the page of the thesis' evaluation, if it is wanted.
    fn evaluate<K: MachineKind<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
    ) -> Result<(), Box<dyn std::error::Error>> {
        let Some(page) = &self.thesis else {
            return Ok(());
        };
        page.write(&thesis::page(robot, &self.plan, &self.output)?)?;
        say(format_args!(
            "{}: the thesis' evaluation, beside that of identify",
            page.path().display()
        ));
        Ok(())
    }

    fn live<K: MachineKind<N>, const N: usize>(
        self,
        robot: RobotFile<K, N>,
        plan: Plan<N>,
    ) -> Outcome {
        let (named, known) = (plan.table.clone(), robot.clone());
        let quit = Arc::new(AtomicBool::new(false));
        let shared = Arc::clone(&quit);
        signals::on_quit(move || shared.store(true, Ordering::Relaxed));
        let options = LiveOptions {
            robot,
            plan,
            server: self.server.clone(),
            transport: transport(self.udp),
            key: self.key.read()?,
            sensor: self.instruments.sensor.clone().unwrap_or_default(),
            accelerometer: Some(self.instruments.accelerometer.clone()),
            gauges: (!self.ask_gauges).then(|| self.gauges.clone()),
            obtain: self.obtain,
            is_unattended: self.unattended,
            raw: self.raw.as_ref().map(|raw| raw.to_path_buf()),
            output: self.output.to_path_buf(),
        };
        let report = match live::run(options, &quit, &lines_typed()) {
            Ok(report) => report,
            Err(error) => return Ok(fail(error.exit_code(), &error)),
        };
        say(format_args!(
            "{}: {} windows taken, {} of the plan missing",
            self.output.display(),
            report.taken,
            report.missing
        ));
        note_table(&named, &self.output);
        if let Err(error) = self.evaluate(&known) {
            say(format_args!("--thesis: {error}"));
        }
        Ok(if report.missing == 0 {
            ExitCode::SUCCESS
        } else {
            ExitCode::from(3)
        })
    }
}

/// Lines that wait.
const WAITING_LINES: usize = 64;

/// Lines of the keyboard, from a thread that ends with the process.
fn lines_typed() -> Receiver<String> {
    let (lines, typed) = sync_channel(WAITING_LINES);
    read_keyboard(move |input| keyboard::listen(input, &lines));
    typed
}

/// Says so if the set-up names another table than was written.
fn note_table(named: &Path, written: &Path) {
    let is_same = matches!((named.canonicalize(), written.canonicalize()), (Ok(named), Ok(written)) if named == written);
    if !is_same {
        tracing::warn!(
            "the set-up names {} as its table, and `identify` reads that",
            named.display()
        );
    }
}
