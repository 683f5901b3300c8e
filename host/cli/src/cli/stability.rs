//! `gantry-tau stability`.

mod page;
mod report;

use std::process::ExitCode;

use crate::terminal::{Progress, say};
use clap::Args;
use gantry_tau_machine::dynamics::MassiveMachine;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{FilterKey, RobotFile};
use gantry_tau_machine::stability::{Compensation, DriveKind, FilterKind, StabilitySurvey};
use gantry_tau_system::output::{Kind, Output, write_all};

use self::report::{Judged, Report};

use super::outputs::{NamedInput, file};
use super::{Failure, MachineCommand, Outcome, fail};

/// Smallest latency that is judged, cycles: one, and one of each direction of the drives.
const MIN_LATENCY: usize = 3;

/// Tell whether the compensation is stable on a machine with mass, and by what margin
///
/// The force sensor between platform and tool reads the tool's inertia too: the compensation is a
/// loop in free air as well. Judges it every 0.1 m over the reach of the machine: a margin of 2
/// against any phase is required, with the natural frequencies as they are and taken for 20 % less
/// or more. Needs a section [masses] in the robot file.
///
/// Exit codes: 0 stable with the margin; 1 cannot run; 2 the file has no masses, or an option is
/// wrong; 3 not stable, or a margin is below 2.
#[derive(Debug, Args)]
pub(crate) struct Stability {
    /// The machine: l2 or f1 (built in), or a robot file
    #[arg(long, value_name = "l2|f1|FILE")]
    pub(super) robot: NamedInput,
    /// Mass of the tool, kg; the default is that of its weight in the robot file
    #[arg(long, value_name = "KG", value_parser = within(1e-3, 1e3))]
    tool: Option<f64>,
    /// Damping ratio of every mode; the default is that of the robot file
    #[arg(long, value_name = "RATIO", value_parser = within(1e-3, 0.3))]
    damping: Option<f64>,
    /// Cycles from a reading to the reference that answers it, at least 3; the default is 1 and the
    /// delays of [drives]
    #[arg(long, value_name = "CYCLES", value_parser = clap::value_parser!(u8).range(3..=50))]
    latency: Option<u8>,
    /// Filter of the load, low-pass of first or second order, or the latter with notches at the modes
    /// of each place that the loop feels most; the default is that of the robot file
    #[arg(long, value_name = "first-order|second-order|auto", value_parser = filter)]
    filter: Option<FilterKey>,
    /// Cut-off of the filter, Hz; the default is that of the robot file
    #[arg(long, value_name = "HZ", value_parser = within(0.01, 450.0))]
    cutoff: Option<f64>,
    /// Gain of the drives' position loops, 1/s; the default is that of the robot file
    #[arg(long, value_name = "1/s", value_parser = within(1.0, 499.0))]
    position_gain: Option<f64>,
    /// Try filters of second order from 2 to 20 Hz, with none to two notches, and name the fastest
    /// with the required margins
    #[arg(long)]
    design: bool,
    /// Path of a page: margins over tool and cut-off, growth on workpieces, maps over the travel
    #[arg(long, value_name = "FILE.html", value_parser = file(Kind::Page))]
    page: Option<Output>,
    /// The answer for programs
    #[arg(long, value_name = "FILE", value_parser = file(Kind::Answer))]
    json: Option<Output>,
}

fn filter(text: &str) -> Result<FilterKey, String> {
    match text {
        "first-order" => Ok(FilterKey::FirstOrder),
        "second-order" => Ok(FilterKey::SecondOrder),
        "auto" => Ok(FilterKey::Auto),
        _ => Err("expected first-order, second-order or auto".to_owned()),
    }
}

fn within(lower: f64, upper: f64) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let value: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
        if (lower..=upper).contains(&value) {
            Ok(value)
        } else {
            Err(format!("expected from {lower} to {upper}"))
        }
    }
}

impl MachineCommand for Stability {
    fn run_on<K: MachineKind<N>, const N: usize, const M: usize>(
        self,
        robot: RobotFile<K, N>,
    ) -> Outcome {
        robot.compliances_for("stability needs compliances")?;
        let parts = (
            MassiveMachine::of(&robot),
            DriveKind::cascade(
                &robot,
                self.position_gain.unwrap_or(robot.position_gain_per_s()),
            ),
        );
        let (Some(mut machine), Some(drives)) = parts else {
            let reason = "is missing; stability in motion needs the masses";
            return Ok(fail(2, robot.refuse("masses", reason)));
        };
        let masses = &mut machine.masses;
        masses.tool.mass_kg = self.tool.unwrap_or(masses.tool.mass_kg);
        masses.damping_ratio = self.damping.unwrap_or(masses.damping_ratio);
        let compensation = self.compensation(&robot, drives)?;
        // A path that cannot be written is found before the survey, not after it.
        for output in [&self.json, &self.page].into_iter().flatten() {
            output.check(false)?;
        }
        let progress = Progress::new(StabilitySurvey::candidates(&robot), "places");
        let survey = StabilitySurvey::of(&robot, &machine, &compensation, || progress.step());
        drop(progress);
        let survey =
            survey.ok_or_else(|| robot.refuse("masses", "the machine has no modes at home"))?;
        let judged = Judged {
            robot: &robot,
            machine: &machine,
            compensation: &compensation,
            survey: &survey,
        };
        let mut report = Report::new(&judged)?;
        if self.design {
            report.design(&judged)?;
        }
        let json = format!("{:#}\n", report.json());
        let page = match self.page {
            Some(_) => page::page(&judged, &report.text)?,
            None => String::new(),
        };
        let outputs = [(&self.json, &*json), (&self.page, &*page)];
        let files = outputs
            .into_iter()
            .filter_map(|(output, text)| Some((output.as_ref()?, text)));
        write_all(&files.collect::<Vec<_>>())?;
        say(&report.text);
        if report.faults.is_empty() {
            Ok(ExitCode::SUCCESS)
        } else {
            Ok(fail(3, report.faults.join("; ")))
        }
    }
}

impl Stability {
    fn compensation<K: MachineKind<N>, const N: usize>(
        &self,
        robot: &RobotFile<K, N>,
        drives: DriveKind<N>,
    ) -> Result<Compensation<N>, Failure> {
        let cutoff_hz = self.cutoff.unwrap_or(robot.sensor.cutoff_hz);
        if !(0.01..=450.0).contains(&cutoff_hz) {
            let reason = format!("is {cutoff_hz}; a filter is judged from 0.01 to 450 Hz");
            return Err(robot.refuse("sensor.cutoff_hz", reason).into());
        }
        let key = self.filter.or(robot.sensor.filter);
        let filter = FilterKind::of_keys(key.unwrap_or(FilterKey::Auto), cutoff_hz, &robot.sensor);
        let of_drives = robot.drives.as_ref().map_or(1, |drives| {
            1 + usize::from(drives.command_delay_cycles) + usize::from(drives.actual_delay_cycles)
        });
        Ok(Compensation {
            filter,
            drives,
            latency_cycles: self.latency.map_or(of_drives, usize::from).max(MIN_LATENCY),
            gain: robot.client.gain,
        })
    }
}
