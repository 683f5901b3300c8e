//! Page with the thesis' evaluation of every series, beside what `identify` finds in the same
//! windows, and what the thesis prints.

use std::path::Path;

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::elastic::springs::axes_key;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_report::page::{Page, Table, Text};
use gantry_tau_report::plots::{Curve, Plot};

use super::printed::{self, Printed};
use super::{SpringLine, ThesisSprings, evaluate};
use crate::fit::answer::{Parameter, Status};
use crate::measurements::springs;
use crate::springs::identify::{
    IdentifyError, IdentifyOptions, SpringsAnswer, answer_of, starting_springs,
};
use crate::springs::problem::SpringsProblem;

/// Micro: m/N to µm/N.
const MICRO: f64 = 1e6;
/// Evaluates a table of windows, measured for the set-up at `setup`, in the thesis' way and by
/// `identify`; returns the page.
///
/// # Errors
/// [`IdentifyError`]: a file is wrong. A table in which `identify` finds nothing is shown with the
/// reason.
pub fn page<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    setup: &Path,
    table: &Path,
) -> Result<String, IdentifyError> {
    let file = starting_springs(robot)?;
    let campaign = springs::read_table(setup, table, K::MODEL, &robot.metres_per_q)?;
    campaign.check_wrist(setup, robot.wrist.len())?;
    let geometry = robot.model.geometry();
    let asked = SpringsProblem::new(&geometry, &file, &campaign);
    let all: Vec<ThesisSprings> = (0..campaign.series.len())
        .filter_map(|series| evaluate(&asked, series))
        .collect();
    let options = IdentifyOptions::new(setup.to_owned(), &robot.name);
    let found = answer_of(asked, K::MODEL, &options);
    let file = file.vector();
    let file = file.as_slice();
    let evaluation = Evaluation {
        robot,
        campaign: &campaign,
        all: &all,
        found: &found,
        file,
    };
    Ok(evaluation.html())
}

/// Both evaluations of a table.
struct Evaluation<'a, K, const N: usize> {
    robot: &'a RobotFile<K, N>,
    campaign: &'a springs::Campaign<N>,
    all: &'a [ThesisSprings],
    found: &'a Result<(SpringsAnswer, Vec<String>), IdentifyError>,
    /// Springs of the robot file: links, then axes.
    file: &'a [f64],
}

impl<K: MachineKind<N>, const N: usize> Evaluation<'_, K, N> {
    /// True if plates are among the axes.
    const HAS_PLATES: bool = N == LINKS;

    fn html(&self) -> String {
        let (links, axes) = (self.links(), self.axes());
        let mut page = Page::new(
            "gantry-tau: the thesis' evaluation",
            "Springs by the thesis' evaluation",
        );
        self.introduce(&mut page);
        if Self::HAS_PLATES {
            page.section("Carts and plates");
            page.paragraph("µm/N; of plates, µrad/(N m).");
        } else {
            page.section("Carts");
            page.paragraph("µm/N.");
        }
        page.table(axes.table());
        page.section("Links");
        page.paragraph("µm/N.");
        page.table(links.table());
        page.paragraph(links.negative());
        self.add_lessons(&mut page);
        page.paragraph(
            "The thesis' machines are not this one: of its tables only size and sign can be compared.",
        );
        page.section("Carts: displacement against load");
        axes.add_plots(&mut page);
        page.section("Links: elongation against tension, the platform taken as if it did not turn");
        links.add_plots(&mut page);
        page.html()
    }

    fn introduce(&self, page: &mut Page) {
        let text = Text::from(format!(
            "{} windows of {}, {} series, evaluated for {}. The thesis draws a straight line per \
             spring through the windows of one series: carts from their gauges [T 4.2.9, Table 5.1], links from the translation of the platform, \
             which is taken as if it did not turn [T 3.3, Table 5.2]. ",
            self.campaign.windows.len(),
            self.campaign.table,
            self.all.len(),
            self.robot.name
        ));
        page.paragraph(text.and(Text::emphasis("identify")).and(
            " takes all series at once, and lets the platform turn. Behind ± is half of a 95 % interval by the scatter about the line; the thesis states none.",
        ));
        if let Err(error) = self.found {
            page.warning(format!("identify finds nothing in this table: {error}"));
        }
    }

    /// Adds the doubts of `identify`: springs that the campaign does not show, and straps that
    /// would show them.
    fn add_lessons(&self, page: &mut Page) {
        let doubts = self.found.as_ref().map_or(&[][..], |(_, doubts)| doubts);
        if doubts.is_empty() {
            return;
        }
        page.paragraph(Text::emphasis("identify").and(" says of this campaign:"));
        page.list(doubts);
    }

    /// Parameters that identify found of the springs in `places`; empty if it found nothing.
    fn found(&self, places: std::ops::Range<usize>) -> &[Parameter] {
        self.found
            .as_ref()
            .map_or(&[], |(answer, _)| &answer.parameters[places])
    }

    fn links(&self) -> Springs<'_> {
        Springs {
            names: (0..LINKS).map(|link| format!("c_link[{link}]")).collect(),
            lines: self
                .all
                .iter()
                .map(|thesis| (&*thesis.series, &thesis.links[..]))
                .collect(),
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
            lines: self
                .all
                .iter()
                .map(|thesis| (&*thesis.series, &thesis.axes[..]))
                .collect(),
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
    fn table(&self) -> Table {
        let names = self.names.iter().map(String::as_str);
        let mut table = Table::new(std::iter::once("").chain(names));
        for (series, lines) in &self.lines {
            table.named_row(format!("series {series}"), lines.iter().map(slope));
        }
        if !self.found.is_empty() {
            table.named_row("identify", self.found.iter().map(estimate));
            table.named_row("95 % interval", self.found.iter().map(interval));
        }
        let file = self.file.iter().map(|value| number(*value));
        table.named_row("robot file", file);
        for Printed {
            table: name,
            values,
        } in self.printed
        {
            let printed = (0..self.names.len())
                .map(|place| cell(values.get(place).map(|value| value / MICRO)));
            table.named_row(format!("[T {name}]"), printed);
        }
        table
    }

    /// Says how many lines have a slope that no spring has.
    fn negative(&self) -> String {
        let slopes: Vec<f64> = self
            .lines
            .iter()
            .flat_map(|(_, lines)| lines.iter().filter_map(|line| line.compliance))
            .collect();
        let negative = slopes.iter().filter(|slope| **slope < 0.0).count();
        match slopes.len() {
            0 => "No series has three gauges on the platform in three directions, as the evaluation needs.".to_owned(),
            count => format!("{negative} of {count} lines have a negative slope, which no spring has."),
        }
    }

    fn add_plots(&self, page: &mut Page) {
        for (spring, name) in self.names.iter().enumerate() {
            page.subsection(name);
            let curves = self.curves(spring);
            if curves.is_empty() {
                page.paragraph("No series loads it, or shows it.");
                continue;
            }
            let [x_axis, y_axis] = self.axes;
            let title = format!("{name}: {y_axis} over {x_axis}");
            page.picture(&Plot::new(title, x_axis, y_axis, curves).svg());
        }
    }

    /// Windows and line of each series for a spring, and what identify finds.
    fn curves(&self, spring: usize) -> Vec<Curve> {
        let mut curves = Vec::new();
        let mut most = [0.0_f64; 2];
        for (place, (series, lines)) in self.lines.iter().enumerate() {
            let line = &lines[spring];
            let Some(ends) = line.ends() else { continue };
            most = [most[0].min(ends[0].0), most[1].max(ends[1].0)];
            curves.push(Curve::dots(series, scaled(&line.points)).styled(place));
            curves.push(Curve::line("", scaled(&ends)).styled(place));
        }
        if let Some(found) = self.found.get(spring).filter(|_| !curves.is_empty()) {
            let ends = most.map(|load| (load, load * found.value));
            curves.push(Curve::line("identify", scaled(&ends)).in_ink());
        }
        curves
    }
}

/// Loads and displacements, the latter in millionths.
fn scaled(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let points = points.iter();
    points.map(|(load, moved)| (*load, moved * MICRO)).collect()
}

fn slope(line: &SpringLine) -> Text {
    let cell = cell(line.compliance);
    match line.half_width() {
        None => cell,
        Some(half_width) => cell.and(format!(" ± {}", number(half_width))),
    }
}

fn estimate(parameter: &Parameter) -> Text {
    match parameter.status {
        Status::Kept => "not seen".into(),
        Status::Identified | Status::Weak | Status::Depends => {
            Text::strong(&number(parameter.value))
        }
    }
}

fn interval(parameter: &Parameter) -> String {
    match parameter.interval() {
        None => "-".to_owned(),
        Some([low, high]) => format!("{} to {}", number(low), number(high)),
    }
}

fn number(value: f64) -> String {
    format!("{:.4}", value * MICRO)
}

fn cell(value: Option<f64>) -> Text {
    match value {
        None => "-".into(),
        Some(value) if value < 0.0 => Text::bad(&number(value)),
        Some(value) => number(value).into(),
    }
}
