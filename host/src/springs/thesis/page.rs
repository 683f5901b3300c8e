//! Page with the thesis' evaluation of every series, beside what `identify` finds in the same windows, and what the thesis prints.

use std::fmt::Write as _;
use std::path::Path;

use gantry_tau_core::model::robot::LINKS;

use super::printed::{self, Printed};
use super::{SpringLine, ThesisSprings, evaluate};
use crate::fit::answer::{Parameter, Status};
use crate::measurements::springs;
use crate::model::MachineKind;
use crate::plots::page::{escape, page as html};
use crate::plots::{Corner, Curve, Plot};
use crate::robot_file::RobotFile;
use crate::springs::compliances::axes_key;
use crate::springs::identify::{Answer, IdentifyError, IdentifyOptions, answer_of, starting_springs};
use crate::springs::lines::Question;

/// Micro: m/N to µm/N.
const MICRO: f64 = 1e6;
/// Most series that a plot names.
const NAMED: usize = 9;
/// Number of the black colour.
const BLACK: usize = 7;

/// Evaluates a table of windows, measured for the set-up at `setup`, in the thesis' way and by `identify`; returns the page.
///
/// # Errors
/// [`IdentifyError`]: a file is wrong. A table in which `identify` finds nothing is shown with the reason.
pub fn page<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    setup: &Path,
    table: &Path,
) -> Result<String, IdentifyError> {
    let file = starting_springs(robot)?;
    let campaign = springs::read_table(setup, table, K::MODEL, &robot.metres_per_q)?;
    campaign.check_wrist(setup, robot.wrist.len())?;
    let geometry = robot.model.geometry();
    let question = || Question::new(&geometry, &file, &campaign);
    let asked = question();
    let all: Vec<ThesisSprings> = (0..campaign.series.len()).filter_map(|series| evaluate(&asked, series)).collect();
    let options = IdentifyOptions::new(setup.to_owned(), &robot.name);
    let found = answer_of(question(), K::MODEL, &options);
    let file = file.vector();
    let file = file.as_slice();
    let evaluation = Evaluation { robot, campaign: &campaign, all: &all, found: &found, file };
    Ok(html("gantry-tau: the thesis' evaluation", &evaluation.body()))
}

/// Both evaluations of a table.
struct Evaluation<'a, K, const N: usize> {
    robot: &'a RobotFile<K, N>,
    campaign: &'a springs::Campaign<N>,
    all: &'a [ThesisSprings],
    found: &'a Result<(Answer, Vec<String>), IdentifyError>,
    /// Springs of the robot file: links, then axes.
    file: &'a [f64],
}

impl<K: MachineKind<N>, const N: usize> Evaluation<'_, K, N> {
    /// True if plates are among the axes.
    const HAS_PLATES: bool = N == LINKS;

    fn body(&self) -> String {
        let (links, axes) = (self.links(), self.axes());
        let unit = if Self::HAS_PLATES { "µm/N; of plates, µrad/(N m)" } else { "µm/N" };
        [
            self.introduction(),
            format!("<h2>Carts{}</h2><p>{unit}.</p>", if Self::HAS_PLATES { " and plates" } else { "" }),
            axes.table(),
            "<h2>Links</h2><p>µm/N.</p>".to_owned(),
            links.table(),
            links.negative(),
            self.lessons(),
            "<p>The thesis' machines are not this one: of its tables only size and sign can be compared.</p>"
                .to_owned(),
            "<h2>Carts: displacement against load</h2>".to_owned(),
            axes.plots(),
            "<h2>Links: elongation against tension, the platform taken as if it did not turn</h2>".to_owned(),
            links.plots(),
        ]
        .concat()
    }

    fn introduction(&self) -> String {
        let mut body = format!(
            "<h1>Springs by the thesis' evaluation</h1><p>{} windows of {}, {} series, evaluated for {}. The thesis draws a straight line per \
             spring through the windows of one series: carts from their gauges [T 4.2.9, Table 5.1], links from the translation of the platform, \
             which is taken as if it did not turn [T 3.3, Table 5.2]. <i>identify</i> takes all series at once, and lets the platform turn. Behind ± is half of a 95 % interval by the scatter about the line; the thesis states none.</p>",
            self.campaign.windows.len(),
            escape(&self.campaign.table),
            self.all.len(),
            escape(&self.robot.name)
        );
        if let Err(error) = self.found {
            let error = escape(&error.to_string());
            _ = write!(body, "<p class=\"bad\">identify finds nothing in this table: {error}</p>");
        }
        body
    }

    /// Doubts of `identify`: springs that the campaign does not show, and straps that would show them.
    fn lessons(&self) -> String {
        let doubts = self.found.as_ref().map_or(&[][..], |(_, doubts)| doubts);
        if doubts.is_empty() {
            return String::new();
        }
        let items: String = doubts.iter().map(|doubt| format!("<li>{}", escape(doubt))).collect();
        format!("<p><i>identify</i> says of this campaign:</p><ul>{items}</ul>")
    }

    /// Parameters that identify found of the springs in `places`; empty if it found nothing.
    fn found(&self, places: std::ops::Range<usize>) -> &[Parameter] {
        self.found.as_ref().map_or(&[], |(answer, _)| &answer.parameters[places])
    }

    fn links(&self) -> Springs<'_> {
        Springs {
            names: (0..LINKS).map(|link| format!("c_link[{link}]")).collect(),
            lines: self.all.iter().map(|thesis| (&*thesis.series, &thesis.links[..])).collect(),
            found: self.found(0..LINKS),
            file: &self.file[..LINKS],
            printed: printed::links::<N>(),
            axes: ["tension, N", "elongation, µm"],
        }
    }

    fn axes(&self) -> Springs<'_> {
        let key = axes_key::<N>();
        Springs {
            names: (0..N).map(|axis| format!("{key}[{axis}]")).collect(),
            lines: self.all.iter().map(|thesis| (&*thesis.series, &thesis.axes[..])).collect(),
            found: self.found(LINKS..LINKS + N),
            file: &self.file[LINKS..LINKS + N],
            printed: printed::axes::<N>(),
            axes: if Self::HAS_PLATES {
                ["load, N or N m", "displacement, µm or µrad"]
            } else {
                ["load, N", "displacement, µm"]
            },
        }
    }
}

/// Springs of one kind.
struct Springs<'a> {
    names: Vec<String>,
    /// Name and lines of each series.
    lines: Vec<(&'a str, &'a [SpringLine])>,
    /// Result of identify; empty if there is none.
    found: &'a [Parameter],
    file: &'a [f64],
    printed: &'static [Printed],
    /// Names of the axes of a plot.
    axes: [&'static str; 2],
}

impl Springs<'_> {
    fn table(&self) -> String {
        let mut table = format!("<table><tr><th><th>{}</tr>", self.names.join("<th>"));
        let mut row = |name: &str, cells: Vec<String>| {
            _ = write!(table, "<tr><th>{}<td>{}</tr>", escape(name), cells.join("<td>"));
        };
        for (series, lines) in &self.lines {
            row(&format!("series {series}"), lines.iter().map(slope).collect());
        }
        if !self.found.is_empty() {
            let value = |parameter: &Parameter| match parameter.status {
                Status::Kept => "not seen".to_owned(),
                Status::Identified | Status::Weak | Status::Depends => format!("<b>{}</b>", number(parameter.value)),
            };
            row("identify", self.found.iter().map(value).collect());
            let interval = |parameter: &Parameter| match parameter.interval() {
                None => "-".to_owned(),
                Some([low, high]) => format!("{} to {}", number(low), number(high)),
            };
            row("95 % interval", self.found.iter().map(interval).collect());
        }
        row("robot file", self.file.iter().map(|value| number(*value)).collect());
        for Printed { table, values } in self.printed {
            let printed = |place: usize| cell(values.get(place).map(|value| value / MICRO));
            row(&format!("[T {table}]"), (0..self.names.len()).map(printed).collect());
        }
        table + "</table>"
    }

    /// Says how many lines have a slope that no spring has.
    fn negative(&self) -> String {
        let slopes: Vec<f64> =
            self.lines.iter().flat_map(|(_, lines)| lines.iter().filter_map(|line| line.compliance)).collect();
        let negative = slopes.iter().filter(|slope| **slope < 0.0).count();
        match slopes.len() {
            0 => "<p>No series has three gauges on the platform in three directions, as the evaluation needs.</p>"
                .to_owned(),
            count => format!("<p>{negative} of {count} lines have a negative slope, which no spring has.</p>"),
        }
    }

    fn plots(&self) -> String {
        let plots = (0..self.names.len()).map(|spring| {
            let plot = self.plot(spring);
            format!("<h3>{}</h3>{plot}", self.names[spring])
        });
        plots.collect()
    }

    fn plot(&self, spring: usize) -> String {
        let scaled = |points: &[(f64, f64)]| points.iter().map(|(load, moved)| (*load, moved * MICRO)).collect();
        let mut curves = Vec::new();
        let mut most = (0.0_f64, 0.0_f64);
        for (place, (series, lines)) in self.lines.iter().enumerate() {
            let line = &lines[spring];
            let Some(ends) = line.ends() else { continue };
            let (name, colour) = (if self.lines.len() <= NAMED { series } else { "" }, Some(place % BLACK));
            most = (most.0.min(ends[0].0), most.1.max(ends[1].0));
            curves.push(Curve { colour, ..Curve::dots(name, scaled(&line.points)) });
            curves.push(Curve { colour, ..Curve::line("", scaled(&ends)) });
        }
        if curves.is_empty() {
            return "<p>No series loads it, or shows it.</p>".to_owned();
        }
        if let Some(found) = self.found.get(spring) {
            let ends = [most.0, most.1].map(|load| (load, load * found.value));
            curves.push(Curve { colour: Some(BLACK), ..Curve::line("identify", scaled(&ends)) });
        }
        let [x_axis, y_axis] = self.axes;
        let key = emptiest(&curves);
        Plot { x_axis, y_axis, curves, bands: Vec::new(), y_names: Vec::new(), key }.svg()
    }
}

/// Corner of a plot in which fewest points lie.
fn emptiest(curves: &[Curve]) -> Corner {
    let points = || curves.iter().flat_map(|curve| &curve.points);
    let middle = |coordinate: &dyn Fn(&(f64, f64)) -> f64| {
        let values = || points().map(coordinate);
        f64::midpoint(values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    };
    let (x, y) = (middle(&|point| point.0), middle(&|point| point.1));
    let within = |is_right: bool, is_upper: bool| {
        points().filter(|point| (point.0 > x) == is_right && (point.1 > y) == is_upper).count()
    };
    let corners = [
        (within(false, true), Corner::UpperLeft),
        (within(true, true), Corner::UpperRight),
        (within(false, false), Corner::LowerLeft),
        (within(true, false), Corner::LowerRight),
    ];
    corners.into_iter().min_by_key(|(count, _)| *count).map_or(Corner::UpperLeft, |(_, corner)| corner)
}

fn slope(line: &SpringLine) -> String {
    let cell = cell(line.compliance);
    line.half_width().map_or_else(|| cell.clone(), |half_width| format!("{cell} ± {}", number(half_width)))
}

fn number(value: f64) -> String {
    format!("{:.4}", value * MICRO)
}

fn cell(value: Option<f64>) -> String {
    match value {
        None => "-".to_owned(),
        Some(value) if value < 0.0 => format!("<span class=\"bad\">{}</span>", number(value)),
        Some(value) => number(value),
    }
}
