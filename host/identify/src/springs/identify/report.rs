//! Page of an identification: springs with their intervals, and everything that says whether to
//! believe them.

mod model;

use gantry_tau_core::model::robot::LINKS;
use gantry_tau_report::page::{Cell, Page, Table};
use gantry_tau_report::plots::{Curve, Plot};

use super::answer::SpringsAnswer;
use super::{IdentifiedSprings, IdentifyOptions};
use crate::fit::statistics::float;
use crate::springs::decision::unheld;
use crate::springs::linearize::LinearizedWindow;
use crate::springs::robust_fit::deviations;
use crate::springs::thesis::{ThesisSprings, evaluate_largest};

/// Largest number of constants of the set-up that the page lists, the farthest moved first.
const LISTED: usize = 20;

/// A reading at its window.
struct Point {
    series: usize,
    gauge: usize,
    stroke: i8,
    /// Index of the window in its series.
    place: f64,
    /// Force on the platform, and on axes, N.
    force_n: f64,
    /// Reading less its zero, µm.
    reading_um: f64,
    /// Fitted reading at the measured load, µm.
    fitted_um: f64,
    /// Deviation from the prediction by the other gauges of its window, in standard deviations.
    deviation: f64,
    is_used: bool,
}

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Returns the page.
    pub(super) fn report(
        &self,
        answer: &SpringsAnswer,
        options: &IdentifyOptions,
        doubts: &[String],
        warnings: &[String],
    ) -> String {
        let points = self.points();
        let campaign = self.problem.campaign;
        let mut page = Page::new(
            "gantry-tau identify",
            format!("Springs of {}", options.robot),
        );
        page.paragraph(format!(
            "{} windows of {} (CRC-32 {:08x}), {} gauges; the last fit took {} rounds. {}",
            campaign.windows.len(),
            campaign.table,
            campaign.crc,
            campaign.gauges.len(),
            self.robust_fit.solution.rounds,
            self.summary(answer),
        ));
        for doubt in doubts {
            page.warning(doubt);
        }
        for warning in warnings {
            page.paragraph(warning);
        }
        self.add_springs(&mut page, answer);
        self.add_readings(&mut page, &points);
        self.add_regimes(&mut page);
        self.add_model(&mut page, &points);
        self.add_directions(&mut page);
        add_correlations(&mut page, answer);
        add_set_up(&mut page, answer);
        add_outliers(&mut page, answer);
        page.html()
    }

    fn points(&self) -> Vec<Point> {
        let solution = &self.robust_fit.solution;
        let campaign = self.problem.campaign;
        let deviations = deviations(&self.problem, &self.robust_fit.active, solution);
        let mut points = Vec::new();
        for (lines, left) in solution.linearized.iter().zip(&solution.left) {
            let window = &campaign.windows[lines.window];
            let first = campaign
                .windows
                .iter()
                .position(|other| other.series == window.series)
                .unwrap_or(lines.window);
            for (row, gauge) in lines.gauges.iter().enumerate() {
                let Some(reading) = window.readings_m[*gauge] else {
                    continue;
                };
                points.push(Point {
                    series: window.series,
                    gauge: *gauge,
                    stroke: window.stroke,
                    place: float(lines.window - first),
                    force_n: window.load.fixed_rows::<3>(0).norm() + window.pushes_n.norm(),
                    reading_um: (reading - zero(lines, left, row)) * 1e6,
                    fitted_um: (reading - lines.misclosures[row]) * 1e6,
                    deviation: deviations[lines.window][*gauge],
                    is_used: self.robust_fit.active.weights[lines.window][*gauge] > 0.0,
                });
            }
        }
        points
    }

    fn add_springs(&self, page: &mut Page, answer: &SpringsAnswer) {
        let file = self.problem.file.vector();
        let thesis = evaluate_largest(&self.problem);
        let by_set_up = self.shares_of_the_set_up(answer);
        page.section("Springs");
        let mut table = Table::new([
            "parameter",
            "status",
            "value",
            "95 % interval",
            "sd, %",
            "by the set-up",
            "file",
            "largest correlation",
            "as in the thesis",
        ]);
        for (index, parameter) in answer.parameters.iter().enumerate() {
            let is_profiled = self
                .profiles
                .iter()
                .any(|profiled| profiled.parameter == index);
            let interval = parameter.interval().map_or_else(
                || "-".to_owned(),
                |[low, high]| format!("{low:.4e} to {high:.4e}"),
            );
            let by_thesis = thesis.as_ref().and_then(|thesis| slope(thesis, index));
            table.row([
                parameter.name.clone(),
                parameter.status.name().to_owned(),
                format!("{:.4e} {}", parameter.value, parameter.unit),
                format!("{interval}{}", if is_profiled { " *" } else { "" }),
                format!("{:.2}", 100.0 * parameter.sd / parameter.value.abs()),
                format!("{:.0} %", 100.0 * by_set_up[index].max(0.0)),
                file.get(index)
                    .map_or_else(String::new, |value| format!("{value:.4e}")),
                correlated(answer, index)
                    .map_or_else(String::new, |(name, r)| format!("{r:+.2} {name}")),
                by_thesis.map_or_else(|| "-".to_owned(), |value| format!("{value:.4e}")),
            ]);
        }
        page.table(table);
        let mut text =
            "By the set-up: share of the variance that comes from where gauges and sensor stand."
                .to_owned();
        if !self.profiles.is_empty() {
            text += " *: by profile likelihood, as the standard deviation is above a fifth of the value.";
        }
        if let Some(ThesisSprings { series, .. }) = &thesis {
            text += &format!(
                " As in the thesis: a straight line per spring through series {series}, the platform taken as if it did not turn [T 3.3, 4.2.9]; \
                 it gives negative springs where the platform turns [T Table 5.2]."
            );
        }
        page.paragraph(text);
    }

    /// Share of each parameter's variance that does not come from the noise of the readings.
    fn shares_of_the_set_up(&self, answer: &SpringsAnswer) -> Vec<f64> {
        let of_noise = self
            .robust_fit
            .solution
            .covariance_of_noise(&self.problem, &self.robust_fit.active);
        let scale = self.intervals.variance(&self.robust_fit.solution);
        let uncertainty = self.uncertainty();
        let shares = (0..answer.parameters.len()).map(|index| {
            let variance = uncertainty.of_seen(index);
            of_noise.as_ref().map_or(0.0, |of_noise| {
                1.0 - scale * of_noise[(index, index)] / variance
            })
        });
        shares.collect()
    }

    /// Reading against force, per gauge, with what the fit says.
    fn add_readings(&self, page: &mut Page, points: &[Point]) {
        page.section("Readings against force");
        page.paragraph(
            "Per gauge and series, less its zero: dots are measured, lines are fitted [T figures 5.6 to 5.8].",
        );
        for (gauge, named) in self.problem.campaign.gauges.iter().enumerate() {
            page.subsection(&*named.name);
            let title = format!("Reading of {} against force", &*named.name);
            let curves = self.curves_of(gauge, points);
            page.picture(&Plot::new(title, "force, N", "reading, µm", curves).svg());
        }
        if let Some(play) = &self.play {
            let strokes = ["rising", "falling"].into_iter().zip(play.preload_n);
            let passed = strokes.filter_map(|(stroke, ends)| {
                let [low, high] = ends?;
                Some(format!("{:.0} to {:.0} N {stroke}", -high, -low))
            });
            page.paragraph(format!(
                "The joint of cluster 3 moves by {:.1} µm where the sum of its tensions passes {} [T 5.2.2, 6.1].",
                play.gap_m * 1e6,
                passed.collect::<Vec<_>>().join(", ")
            ));
        }
    }

    /// Readings and fit of a gauge, one look for each series.
    fn curves_of(&self, gauge: usize, points: &[Point]) -> Vec<Curve> {
        let mut curves = Vec::new();
        for (series, name) in self.problem.campaign.series.iter().enumerate() {
            let of_series = points
                .iter()
                .filter(|point| (point.series, point.gauge) == (series, gauge));
            let of_series: Vec<&Point> = of_series.collect();
            if of_series.is_empty() {
                continue;
            }
            let of_series = of_series.iter();
            let line = of_series
                .clone()
                .map(|point| (point.force_n, point.fitted_um));
            curves.push(Curve::line(name, line.collect()).styled(series));
            let dots = of_series.map(|point| (point.force_n, point.reading_um));
            curves.push(Curve::dots("", dots.collect()).styled(series));
        }
        curves
    }

    fn add_directions(&self, page: &mut Page) {
        let seen = unheld(
            &self.problem,
            &self.robust_fit.active,
            &self.robust_fit.solution,
        );
        page.section("What can be seen");
        page.paragraph(
            "Combinations of springs by falling standard deviation, in shares of the file's values; above 1 nothing is seen, \
             above 0.1 one digit at most.",
        );
        let names = super::names(&self.problem, &self.robust_fit.active, self.play.is_some());
        let all = seen.all();
        let named = crate::fit::answer::Unobservable::list(&names, &all);
        let mut table = Table::new(["sd", "combination"]);
        for (direction, named) in all.iter().zip(named) {
            table.row([format!("{:.2e}", direction.relative_sd), named.to_string()]);
        }
        page.table(table);
    }
}

/// Slope of the thesis' line for a parameter, if it is a spring.
fn slope(thesis: &ThesisSprings, parameter: usize) -> Option<f64> {
    let ThesisSprings { links, axes, .. } = thesis;
    links
        .get(parameter)
        .or_else(|| axes.get(parameter.checked_sub(LINKS)?))?
        .compliance
}

fn add_set_up(page: &mut Page, answer: &SpringsAnswer) {
    page.section("Set-up");
    if answer.setup.is_empty() {
        page.paragraph(
            "Taken as exact: the set-up states no [setup]. Half a millimetre and two milliradians make intervals two to five times as wide.",
        );
        return;
    }
    let mut moved: Vec<_> = answer.setup.iter().collect();
    moved.sort_by(|one, other| other.moved_sd.abs().total_cmp(&one.moved_sd.abs()));
    let mut table = Table::new(["constant", "estimate", "stated sd", "moved by, sd"]);
    for constant in moved.iter().take(LISTED) {
        table.row([
            constant.name.clone(),
            format!("{:.3e}", constant.estimate),
            format!("{:.3e}", constant.prior_sd),
            format!("{:.2}", constant.moved_sd),
        ]);
    }
    page.table(table);
    if moved.len() > LISTED {
        page.paragraph(format!("{} more have moved less.", moved.len() - LISTED));
    }
}

/// Zero of a gauge as the fit found it, m.
fn zero(lines: &LinearizedWindow, left: &nalgebra::DVector<f64>, row: usize) -> f64 {
    lines.misclosures[row] - left[row]
}

/// The parameter that one is correlated with most.
fn correlated(answer: &SpringsAnswer, index: usize) -> Option<(&str, f64)> {
    let others = (0..answer.parameters.len()).filter(|other| *other != index);
    let all = others.map(|other| (other, correlation(answer, index, other)));
    let (most, r) = all.max_by(|(_, one), (_, other)| one.abs().total_cmp(&other.abs()))?;
    Some((&answer.parameters[most].name, r))
}

fn correlation(answer: &SpringsAnswer, one: usize, other: usize) -> f64 {
    let covariance = &answer.covariance;
    let size = (covariance[one][one] * covariance[other][other]).sqrt();
    if size > 0.0 {
        covariance[one][other] / size
    } else {
        0.0
    }
}

/// Adds correlations as a table with colours.
fn add_correlations(page: &mut Page, answer: &SpringsAnswer) {
    page.section("Correlations");
    let names = answer.parameters.iter().map(|parameter| &parameter.name);
    let mut table = Table::new(std::iter::once("").chain(names.clone().map(String::as_str)));
    for (row, name) in names.enumerate() {
        let cells = (0..answer.parameters.len()).map(|column| {
            let r = correlation(answer, row, column);
            Cell::shaded(format!("{r:+.2}"), r)
        });
        table.named_row(name, cells);
    }
    page.table(table);
}

fn add_outliers(page: &mut Page, answer: &SpringsAnswer) {
    page.section("Left out");
    if answer.outliers.is_empty() {
        page.paragraph("No reading.");
        return;
    }
    page.paragraph(
        "Readings that do not agree with the others; of a gauge that stays shifted, the first.",
    );
    let mut table = Table::new(["series", "window", "gauge"]);
    for outlier in &answer.outliers {
        table.row([&*outlier.series, &*outlier.window, &*outlier.gauge]);
    }
    page.table(table);
}
