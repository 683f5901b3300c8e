//! Lines of `gantry-tau stability`, each with its numbers for programs.

use gantry_tau_machine::drive_cascade::VELOCITY_INTEGRAL_S;
use gantry_tau_machine::dynamics::MassiveMachine;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::stability::design::{
    self, MAX_TOOL_KG, SETTLED, TriedFilter, fastest, heaviest_tool_kg,
};
use gantry_tau_machine::stability::survey::{MIN_MARGIN, MIN_MARGIN_PER_AXIS};
use gantry_tau_machine::stability::{
    Compensation, Contact, DriveKind, FilterKind, Growth, Place, StabilitySurvey,
};
use nalgebra::Vector3;
use serde_json::{Value, json};

use crate::cli::Failure;

/// Stiffnesses of workpieces that are judged at home, N/m.
pub(super) const WORKPIECES_N_PER_M: [f64; 11] =
    [1e4, 3e4, 1e5, 3e5, 1e6, 3e6, 1e7, 3e7, 1e8, 3e8, 1e9];
/// Directions of contact.
pub(super) const DIRECTIONS: [(&str, [f64; 3]); 4] = [
    ("x", [1.0, 0.0, 0.0]),
    ("y", [0.0, 1.0, 0.0]),
    ("z", [0.0, 0.0, 1.0]),
    ("xz", [1.0, 0.0, 1.0]),
];
/// Places with the least margins, in which the heaviest tool is looked for.
const LEAST: usize = 6;

/// A compensation that was judged.
pub(super) struct Judged<'a, K, const N: usize> {
    pub(super) robot: &'a RobotFile<K, N>,
    pub(super) machine: &'a MassiveMachine<N>,
    pub(super) compensation: &'a Compensation<N>,
    pub(super) survey: &'a StabilitySurvey<N>,
}

/// Text, answer for programs, and the reasons to refuse a compensation.
pub(super) struct Report {
    pub(super) text: String,
    pub(super) faults: Vec<String>,
    json: serde_json::Map<String, Value>,
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
    pub(super) fn new<K, const N: usize>(judged: &Judged<'_, K, N>) -> Result<Self, Failure> {
        let Judged {
            robot,
            machine,
            compensation,
            survey,
        } = judged;
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
        heaviest_tool(machine, compensation, survey, &mut lines);
        let verdict = if faults.is_empty() {
            "stable, with the required margin"
        } else {
            "refused"
        };
        lines.add("verdict", verdict, "faults", json!(faults));
        Ok(Self {
            text: lines.text.join("\n"),
            json: lines.json,
            faults,
        })
    }

    /// Adds the filters of second order that were tried, and the fastest of them.
    pub(super) fn design<K, const N: usize>(
        &mut self,
        judged: &Judged<'_, K, N>,
    ) -> Result<(), Failure> {
        let tried = design::try_filters(judged.survey, judged.robot.sensor.notch_q)
            .ok_or(NO_EIGENVALUES)?;
        let fastest = fastest(&tried);
        let mut lines = vec![
            "\n".to_owned(),
            format!(
                "{:>10}  {:>7}  {:>9}  {:>6}  {:>10}  {:>14}",
                "cutoff, Hz", "notches", "5 %, ms", "margin", "20 % wrong", "phase per axis"
            ),
        ];
        lines.extend(tried.iter().map(tried_line));
        lines.push(match fastest {
            Some(filter) => format!(
                "fastest with the required margins: {}, 5 % after {:.0} ms",
                filter_text(&filter.kind),
                filter.settles_s * 1e3
            ),
            None => "none has the required margins".to_owned(),
        });
        self.text += &lines.join("\n");
        let tried: Vec<Value> = tried.iter().map(tried_json).collect();
        let fastest = fastest.map(tried_json);
        self.json.insert(
            "design".to_owned(),
            json!({"tried": tried, "fastest": fastest}),
        );
        Ok(())
    }

    /// Returns the answer for programs.
    pub(super) fn json(&self) -> Value {
        Value::Object(self.json.clone())
    }
}

fn tried_line(tried: &TriedFilter) -> String {
    let TriedFilter {
        kind,
        settles_s,
        margins,
    } = tried;
    format!(
        "{:>10}  {:>7}  {:>9.0}  {:>6.2}  {:>10.2}  {:>14.2}{}",
        kind.cutoff_hz(),
        notches(kind),
        settles_s * 1e3,
        margins.exact.any_phase,
        margins.wrong_modes.any_phase,
        margins.wrong_modes.phase_per_axis,
        if margins.suffice() { "  stable" } else { "" }
    )
}

fn tried_json(tried: &TriedFilter) -> Value {
    json!({
        "cutoff_hz": tried.kind.cutoff_hz(),
        "notches": notches(&tried.kind),
        "settles_s": tried.settles_s,
        "margin_any_phase": tried.margins.exact.any_phase,
        "margin_modes_wrong": tried.margins.wrong_modes.any_phase,
        "margin_phase_per_axis": tried.margins.wrong_modes.phase_per_axis,
        "suffices": tried.margins.suffice(),
    })
}

fn notches(kind: &FilterKind) -> usize {
    match *kind {
        FilterKind::Auto { notches, .. } => notches,
        FilterKind::FirstOrder { .. } | FilterKind::SecondOrder { .. } => 0,
    }
}

/// Returns order, cut-off and notches of a filter.
pub(super) fn filter_text(kind: &FilterKind) -> String {
    let order = match kind {
        FilterKind::FirstOrder { .. } => "first",
        FilterKind::SecondOrder { .. } | FilterKind::Auto { .. } => "second",
    };
    let cutoff_hz = kind.cutoff_hz();
    match notches(kind) {
        0 => format!("{order} order, {cutoff_hz} Hz"),
        1 => format!("{order} order, {cutoff_hz} Hz, 1 notch at a mode of each place"),
        more => format!("{order} order, {cutoff_hz} Hz, {more} notches at the modes of each place"),
    }
}

/// Adds the heaviest tool with the required margins.
fn heaviest_tool<const N: usize>(
    machine: &MassiveMachine<N>,
    compensation: &Compensation<N>,
    survey: &StabilitySurvey<N>,
    lines: &mut Lines,
) {
    let mut places: Vec<&Place<N>> = survey.places.iter().collect();
    places.sort_by(|one, other| {
        let [one, other] = [one, other].map(|place| place.margins.wrong_modes.any_phase);
        one.total_cmp(&other)
    });
    places.truncate(LEAST);
    let heaviest = heaviest_tool_kg(machine, compensation, &places);
    let text = match heaviest {
        Some(kg) if kg >= MAX_TOOL_KG => format!("{MAX_TOOL_KG} kg or more"),
        Some(kg) => format!("{kg:.1} kg, by the {LEAST} places with the least margins"),
        None => "none".to_owned(),
    };
    lines.add("heaviest tool", text, "heaviest_tool_kg", json!(heaviest));
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
    if let Some(accelerometer) = &machine.accelerometer {
        let (share, axes) = (accelerometer.share, accelerometer.axes.count());
        lines.add(
            "accelerometer",
            format!("of {axes} axes, takes out {} % of the inertia", share * 1e2),
            "accelerometer",
            json!({"axes": axes, "share": share}),
        );
    }
    let kind = &compensation.filter;
    let order = match kind {
        FilterKind::FirstOrder { .. } => "first order",
        FilterKind::SecondOrder { .. } | FilterKind::Auto { .. } => "second order",
    };
    let numbers = json!({
        "kind": order,
        "cutoff_hz": kind.cutoff_hz(),
        "notches": notches(kind),
    });
    lines.add("filter", filter_text(kind), "filter", numbers);
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
    let worst = survey.worst(|place| place.margins.exact.any_phase);
    let wrong = survey.worst(|place| place.margins.wrong_modes.any_phase);
    let per_axis = survey.worst(|place| place.margins.wrong_modes.phase_per_axis);
    for (name, key, place, value, hz, required) in [
        (
            "margin, any phase",
            "margin_any_phase",
            worst,
            worst.margins.exact.any_phase,
            Some(worst.margins.exact.hz),
            MIN_MARGIN,
        ),
        (
            "  modes 20 % wrong",
            "margin_modes_wrong",
            wrong,
            wrong.margins.wrong_modes.any_phase,
            Some(wrong.margins.wrong_modes.hz),
            MIN_MARGIN,
        ),
        (
            "  and a phase per axis",
            "margin_phase_per_axis",
            per_axis,
            per_axis.margins.wrong_modes.phase_per_axis,
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

/// Returns the growths with the tool on each of [`WORKPIECES_N_PER_M`], by [`DIRECTIONS`].
pub(super) fn growths_in_contact<const N: usize>(
    place: &Place<N>,
    compensation: &Compensation<N>,
) -> Result<Vec<Vec<Growth>>, Failure> {
    let contacts: Vec<_> = (DIRECTIONS.iter())
        .flat_map(|(_, direction)| {
            WORKPIECES_N_PER_M.map(|stiffness_n_per_m| Contact {
                stiffness_n_per_m,
                direction: Vector3::from(*direction),
            })
        })
        .collect();
    let growths = (place.growths_in_contact(&contacts, compensation)).ok_or(NO_EIGENVALUES)?;
    let by_direction = growths.chunks(WORKPIECES_N_PER_M.len());
    Ok(by_direction.map(<[Growth]>::to_vec).collect())
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
    let growths = growths_in_contact(home, compensation)?;
    for ((name, _), growths) in DIRECTIONS.iter().zip(&growths) {
        let on_workpieces = || WORKPIECES_N_PER_M.iter().zip(growths);
        let stiffest = on_workpieces()
            .take_while(|(_, growth)| growth.per_s < 0.0)
            .last();
        texts.push(match stiffest {
            Some((stiffness, _)) => format!("{name} to {stiffness:.0e}"),
            None => format!("{name} none"),
        });
        let growths = on_workpieces().map(|(stiffness, growth)| {
            json!({"n_per_m": stiffness, "per_s": growth.per_s, "hz": growth.hz})
        });
        numbers.insert((*name).to_owned(), growths.collect());
    }
    let text = format!("{} N/m, at home", texts.join(", "));
    lines.add("stable in contact", text, "contact", Value::Object(numbers));
    Ok(())
}

pub(super) const NO_EIGENVALUES: &str = "the eigenvalues of the loop are not found";

pub(super) fn at<const N: usize>(place: &Place<N>) -> String {
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
