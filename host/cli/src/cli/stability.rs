//! `gantry-tau stability`.

use std::process::ExitCode;

use crate::terminal::{Progress, say};
use clap::Args;
use gantry_tau_machine::drive_cascade::VELOCITY_INTEGRAL_S;
use gantry_tau_machine::dynamics::MassiveMachine;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{FilterKey, RobotFile};
use gantry_tau_machine::stability::survey::{MIN_MARGIN, MIN_MARGIN_PER_AXIS};
use gantry_tau_machine::stability::{
    Compensation, Contact, DriveKind, FilterKind, Place, StabilitySurvey,
};
use gantry_tau_system::output::{Kind, Output};
use nalgebra::Vector3;
use serde_json::{Value, json};

use super::outputs::{NamedInput, file};
use super::{Failure, MachineCommand, Outcome, fail};

/// Smallest latency that is judged, cycles: one, and one of each direction of the drives.
const MIN_LATENCY: usize = 3;
/// Share of a step that a settled offset is within.
const SETTLED: f64 = 0.05;
/// Stiffnesses of workpieces that are judged at home, N/m.
const WORKPIECES_N_PER_M: [f64; 11] = [1e4, 3e4, 1e5, 3e5, 1e6, 3e6, 1e7, 3e7, 1e8, 3e8, 1e9];
/// Directions of contact.
const DIRECTIONS: [(&str, [f64; 3]); 4] = [
    ("x", [1.0, 0.0, 0.0]),
    ("y", [0.0, 1.0, 0.0]),
    ("z", [0.0, 0.0, 1.0]),
    ("xz", [1.0, 0.0, 1.0]),
];

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
        let progress = Progress::new(StabilitySurvey::candidates(&robot), "places");
        let survey = StabilitySurvey::of(&robot, &machine, &compensation, || progress.step());
        drop(progress);
        let survey =
            survey.ok_or_else(|| robot.refuse("masses", "the machine has no modes at home"))?;
        let report = Report::new(&robot, &machine, &compensation, &survey)?;
        if let Some(json) = &self.json {
            json.write(&format!("{:#}\n", report.json))?;
        }
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

/// Text, answer for programs, and the reasons to refuse a compensation.
struct Report {
    text: String,
    json: Value,
    faults: Vec<String>,
}

/// Lines of a report, each with its numbers for programs.
#[derive(Default)]
struct Lines {
    text: Vec<String>,
    json: serde_json::Map<String, Value>,
}

impl Lines {
    fn add(&mut self, name: &str, text: impl std::fmt::Display, key: &str, numbers: Value) {
        self.text.push(format!("{name:<26}{text}"));
        self.json.insert(key.to_owned(), numbers);
    }
}

impl Report {
    fn new<K: MachineKind<N>, const N: usize>(
        robot: &RobotFile<K, N>,
        machine: &MassiveMachine<N>,
        compensation: &Compensation<N>,
        survey: &StabilitySurvey<N>,
    ) -> Result<Self, Failure> {
        let mut lines = Lines::default();
        let mut faults = Vec::new();
        lines.text.push(format!("{}\n", robot.name));
        lines
            .json
            .insert("format".to_owned(), json!("gantry-tau stability 1"));
        lines.json.insert("robot".to_owned(), json!(robot.name));
        setup(machine, compensation, survey, &mut lines);
        modes(compensation, survey, &mut lines)?;
        margins(compensation, survey, &mut lines, &mut faults)?;
        contact(compensation, &survey.home, &mut lines)?;
        let verdict = if faults.is_empty() {
            "stable, with the required margin"
        } else {
            "refused"
        };
        lines.add("verdict", verdict, "faults", json!(faults));
        Ok(Self {
            text: lines.text.join("\n"),
            json: Value::Object(lines.json),
            faults,
        })
    }
}

fn setup<const N: usize>(
    machine: &MassiveMachine<N>,
    compensation: &Compensation<N>,
    survey: &StabilitySurvey<N>,
    lines: &mut Lines,
) {
    let masses = &machine.masses;
    let tool = format!("{:.2} kg", masses.tool.mass_kg);
    lines.add("tool", tool, "tool_kg", json!(masses.tool.mass_kg));
    let damping = format!("{} % of every mode", masses.damping_ratio * 1e2);
    lines.add(
        "damping",
        damping,
        "damping_ratio",
        json!(masses.damping_ratio),
    );
    let (name, cutoff_hz, notches) = match compensation.filter {
        FilterKind::FirstOrder { cutoff_hz } => ("first order", cutoff_hz, 0),
        FilterKind::SecondOrder { cutoff_hz } => ("second order", cutoff_hz, 0),
        FilterKind::Auto {
            cutoff_hz, notches, ..
        } => ("second order", cutoff_hz, notches),
    };
    let with = if notches > 0 {
        format!(", {notches} notches at the modes of each place")
    } else {
        String::new()
    };
    let numbers = json!({"kind": name, "cutoff_hz": cutoff_hz, "notches": notches});
    lines.add(
        "filter",
        format!("{name}, {cutoff_hz} Hz{with}"),
        "filter",
        numbers,
    );
    let settles_s = survey.home.filter().settling_s(SETTLED);
    let text = format!("to 5 % in {:.0} ms at home", settles_s * 1e3);
    lines.add("  settles", text, "settles_s", json!(settles_s));
    let latency = compensation.latency_cycles;
    lines.add(
        "latency",
        format!("{latency} cycles"),
        "latency_cycles",
        json!(latency),
    );
}

fn modes<const N: usize>(
    compensation: &Compensation<N>,
    survey: &StabilitySurvey<N>,
    lines: &mut Lines,
) -> Result<(), Failure> {
    let first: Vec<f64> = survey.home.modes_hz.iter().take(5).copied().collect();
    let texts: Vec<String> = first.iter().map(|hz| format!("{hz:.1}")).collect();
    lines.add(
        "modes at home, Hz",
        texts.join(", "),
        "modes_at_home_hz",
        json!(first),
    );
    let ranges = survey.modes_range_hz();
    let texts: Vec<String> = (ranges.iter())
        .map(|[low, high]| format!("{low:.1} to {high:.1}"))
        .collect();
    lines.add(
        "  in reach, Hz",
        texts.join(", "),
        "modes_in_reach_hz",
        json!(ranges),
    );
    if let DriveKind::Cascade {
        position_gain_per_s,
        ..
    } = compensation.drives
    {
        let limit_hz = (position_gain_per_s / VELOCITY_INTEGRAL_S).sqrt() / std::f64::consts::TAU;
        let vibrations = survey.home.vibrations().ok_or(NO_EIGENVALUES)?;
        let (hz, ratio) = (vibrations.into_iter())
            .min_by(|one, other| one.1.total_cmp(&other.1))
            .ok_or(NO_EIGENVALUES)?;
        let text = format!(
            "not passive below {limit_hz:.0} Hz; the least damped mode at home keeps {:.2} % at {hz:.1} Hz",
            ratio * 1e2
        );
        let numbers = json!({
            "position_gain_per_s": position_gain_per_s,
            "not_passive_below_hz": limit_hz,
            "least_damping_ratio": ratio,
            "at_hz": hz,
        });
        lines.add("drives", text, "drives", numbers);
    }
    Ok(())
}

fn margins<const N: usize>(
    compensation: &Compensation<N>,
    survey: &StabilitySurvey<N>,
    lines: &mut Lines,
    faults: &mut Vec<String>,
) -> Result<(), Failure> {
    let judged = survey.places.len();
    let text = format!(
        "{judged}, every 0.1 m; {} more are over 10 times as compliant as home",
        survey.too_compliant
    );
    let numbers = json!({"judged": judged, "too_compliant": survey.too_compliant});
    lines.add("places", text, "places", numbers);
    let worst = survey.worst(|place| place.margin.any_phase);
    let wrong = survey.worst(|place| place.wrong_modes_margin.any_phase);
    let per_axis = survey.worst(|place| place.wrong_modes_margin.phase_per_axis);
    for (name, key, place, value, hz, required) in [
        (
            "margin, any phase",
            "margin_any_phase",
            worst,
            worst.margin.any_phase,
            Some(worst.margin.hz),
            MIN_MARGIN,
        ),
        (
            "  modes 20 % wrong",
            "margin_modes_wrong",
            wrong,
            wrong.wrong_modes_margin.any_phase,
            Some(wrong.wrong_modes_margin.hz),
            MIN_MARGIN,
        ),
        (
            "  and a phase per axis",
            "margin_phase_per_axis",
            per_axis,
            per_axis.wrong_modes_margin.phase_per_axis,
            None,
            MIN_MARGIN_PER_AXIS,
        ),
    ] {
        let at = at(place);
        let frequency = hz.map(|hz| format!(", {hz:.1} Hz")).unwrap_or_default();
        let text = format!("{value:.2} at {at} m{frequency} (required: {required})");
        let place_m: [f64; 3] = place.pose.translation_m.into();
        let numbers = json!({"value": value, "at_m": place_m, "hz": hz, "required": required});
        lines.add(name, text, key, numbers);
        if value < required {
            faults.push(format!("{} is {value:.2}, below {required}", name.trim()));
        }
    }
    let growth = worst
        .growth(compensation.latency_cycles)
        .ok_or(NO_EIGENVALUES)?;
    let text = format!(
        "{:+.2} 1/s at {:.1} Hz, where the margin is least",
        growth.per_s, growth.hz
    );
    let numbers = json!({"per_s": growth.per_s, "hz": growth.hz});
    lines.add("growth", text, "growth", numbers);
    if growth.per_s >= 0.0 {
        faults.push(format!(
            "it swings in free air, {:+.2} 1/s at {:.1} Hz",
            growth.per_s, growth.hz
        ));
    }
    Ok(())
}

/// Growth on workpieces, at home. It is told, and refuses nothing: force control has a gain of its
/// own for it.
fn contact<const N: usize>(
    compensation: &Compensation<N>,
    home: &Place<N>,
    lines: &mut Lines,
) -> Result<(), Failure> {
    let mut numbers = serde_json::Map::new();
    let mut texts = Vec::new();
    for (name, direction) in DIRECTIONS {
        let mut stiffest = None;
        let mut growths = Vec::new();
        let mut is_stable = true;
        for stiffness_n_per_m in WORKPIECES_N_PER_M {
            let contact = Contact {
                stiffness_n_per_m,
                direction: Vector3::from(direction),
            };
            let growth = (home.growth_in_contact(&contact, compensation)).ok_or(NO_EIGENVALUES)?;
            is_stable &= growth.per_s < 0.0;
            if is_stable {
                stiffest = Some(stiffness_n_per_m);
            }
            growths.push(json!({
                "n_per_m": stiffness_n_per_m,
                "per_s": growth.per_s,
                "hz": growth.hz,
            }));
        }
        texts.push(match stiffest {
            Some(stiffness) => format!("{name} to {stiffness:.0e}"),
            None => format!("{name} none"),
        });
        numbers.insert(name.to_owned(), json!(growths));
    }
    let text = format!("{} N/m, at home", texts.join(", "));
    lines.add("stable in contact", text, "contact", Value::Object(numbers));
    Ok(())
}

const NO_EIGENVALUES: &str = "the eigenvalues of the loop are not found";

fn at<const N: usize>(place: &Place<N>) -> String {
    let place_m = place.pose.translation_m;
    let turn = place.pose.rotation.angle().to_degrees();
    let turned = if turn > 1e-6 {
        format!(" turned by {turn:.0} degrees")
    } else {
        String::new()
    };
    format!(
        "({:.2}, {:.2}, {:.2}){turned}",
        place_m.x, place_m.y, place_m.z
    )
}
