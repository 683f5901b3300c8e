//! Page of an identification: springs with their intervals, and everything that says whether to believe them.

mod model;

use std::fmt::Write as _;

use gantry_tau_core::model::robot::LINKS;

use super::answer::Answer;
use super::{Found, IdentifyOptions};
use crate::fit::statistics::float;
use crate::plots::page::{escape, page};
use crate::plots::{Corner, Curve, Plot};
use crate::springs::agreement::deviations;
use crate::springs::decision::unheld;
use crate::springs::lines::Lines;
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
    /// Deviation from what the other gauges of its window let expect, in standard deviations.
    deviation: f64,
    is_used: bool,
}

impl<const N: usize> Found<'_, N> {
    /// Returns the page.
    pub(super) fn report(
        &self,
        answer: &Answer,
        options: &IdentifyOptions,
        doubts: &[String],
        warnings: &[String],
    ) -> String {
        let points = self.points();
        let campaign = self.question.campaign;
        let mut body = format!(
            "<h1>Springs of {}</h1><p>{} windows of {} (CRC-32 {:08x}), {} gauges; the last fit took {} rounds. {}</p>",
            escape(&options.robot),
            campaign.windows.len(),
            escape(&campaign.table),
            campaign.crc,
            campaign.gauges.len(),
            self.agreement.solved.rounds,
            escape(&self.summary(answer)),
        );
        for doubt in doubts {
            body += &format!("<p class=\"bad\">{}</p>", escape(doubt));
        }
        for warning in warnings {
            body += &format!("<p>{}</p>", escape(warning));
        }
        body += &self.springs(answer);
        body += &self.readings(&points);
        body += &self.regimes();
        body += &self.model(&points);
        body += &self.observability();
        body += &correlations(answer);
        body += &self.set_up(answer);
        body += &outliers(answer);
        page("gantry-tau identify", &body)
    }

    fn points(&self) -> Vec<Point> {
        let (solved, campaign) = (&self.agreement.solved, self.question.campaign);
        let deviations = deviations(&self.question, &self.agreement.choice, solved);
        let mut points = Vec::new();
        for (lines, left) in solved.lines.iter().zip(&solved.left) {
            let window = &campaign.windows[lines.window];
            let first = campaign.windows.iter().position(|other| other.series == window.series).unwrap_or(lines.window);
            for (row, gauge) in lines.gauges.iter().enumerate() {
                let Some(reading) = window.readings_m[*gauge] else { continue };
                points.push(Point {
                    series: window.series,
                    gauge: *gauge,
                    stroke: window.stroke,
                    place: float(lines.window - first),
                    force_n: window.load.fixed_rows::<3>(0).norm() + window.pushes_n.norm(),
                    reading_um: (reading - zero(lines, left, row)) * 1e6,
                    fitted_um: (reading - lines.misclosures[row]) * 1e6,
                    deviation: deviations[lines.window][*gauge],
                    is_used: self.agreement.choice.weights[lines.window][*gauge] > 0.0,
                });
            }
        }
        points
    }

    fn springs(&self, answer: &Answer) -> String {
        let file = self.question.file.vector();
        let thesis = evaluate_largest(&self.question);
        let of_noise = self.agreement.solved.covariance_of_noise(&self.question, &self.agreement.choice);
        let scale = self.intervals.variance(&self.agreement.solved);
        let uncertainty = self.uncertainty();
        let mut table = String::from(
            "<h2>Springs</h2><table><tr><th>parameter<th>status<th>value<th>95 % interval<th>sd, %<th>by the set-up<th>file<th>largest correlation",
        );
        let by_thesis = |index: usize| -> Option<f64> {
            let ThesisSprings { links, axes, .. } = thesis.as_ref()?;
            links.get(index).or_else(|| axes.get(index.checked_sub(LINKS)?))?.compliance
        };
        table += "<th>as in the thesis</tr>";
        for (index, parameter) in answer.parameters.iter().enumerate() {
            let number = |value: f64| format!("{value:.4e}");
            let variance = uncertainty.of_seen(index);
            let share = of_noise.as_ref().map_or(0.0, |of_noise| 1.0 - scale * of_noise[(index, index)] / variance);
            let correlated = correlated(answer, index).map_or_else(String::new, |(name, r)| format!("{r:+.2} {name}"));
            _ = write!(
                table,
                "<tr><td>{}<td>{}<td>{} {}<td>{}{}<td>{:.2}<td>{:.0} %<td>{}<td>{}<td>{}</tr>",
                escape(&parameter.name),
                parameter.status.name(),
                number(parameter.value),
                parameter.unit,
                parameter
                    .interval()
                    .map_or_else(|| "-".to_owned(), |[low, high]| format!("{} to {}", number(low), number(high))),
                if self.profiles.iter().any(|profiled| profiled.parameter == index) { " *" } else { "" },
                100.0 * parameter.sd / parameter.value.abs(),
                100.0 * share.max(0.0),
                file.get(index).map_or_else(String::new, |value| number(*value)),
                escape(&correlated),
                by_thesis(index).map_or_else(|| "-".to_owned(), number),
            );
        }
        table += "</table><p>By the set-up: share of the variance that comes from where gauges and sensor stand.";
        if !self.profiles.is_empty() {
            table += " *: by profile likelihood, as the standard deviation is above a fifth of the value.";
        }
        if let Some(ThesisSprings { series, .. }) = &thesis {
            table += &format!(
                " As in the thesis: a straight line per spring through series {}, the platform taken as if it did not turn [T 3.3, 4.2.9]; \
                 it gives negative springs where the platform turns [T Table 5.2].",
                escape(series)
            );
        }
        table + "</p>"
    }

    /// Reading against force, per gauge, with what the fit says.
    fn readings(&self, points: &[Point]) -> String {
        let campaign = self.question.campaign;
        let mut body = String::from(
            "<h2>Readings against force</h2><p>Per gauge and series, less its zero: dots are measured, lines are fitted [T figures 5.6 to 5.8].</p>",
        );
        for (gauge, named) in campaign.gauges.iter().enumerate() {
            let mut curves = Vec::new();
            for (series, name) in campaign.series.iter().enumerate() {
                let of_series = || points.iter().filter(|point| (point.series, point.gauge) == (series, gauge));
                if of_series().next().is_some() {
                    let colour = Some(series);
                    let line = of_series().map(|point| (point.force_n, point.fitted_um)).collect();
                    curves.push(Curve { colour, ..Curve::line(name, line) });
                    let dots = of_series().map(|point| (point.force_n, point.reading_um)).collect();
                    curves.push(Curve { colour, ..Curve::dots("", dots) });
                }
            }
            _ = write!(body, "<h3>{}</h3>", escape(&named.name));
            body += &plot("force, N", "reading, µm", curves);
        }
        if let Some(play) = &self.play {
            let strokes = ["rising", "falling"].into_iter().zip(play.preload_n);
            let passed = strokes.filter_map(|(stroke, ends)| {
                let [low, high] = ends?;
                Some(format!("{:.0} to {:.0} N {stroke}", -high, -low))
            });
            _ = write!(
                body,
                "<p>The joint of cluster 3 moves by {:.1} µm where the sum of its tensions passes {} [T 5.2.2, 6.1].</p>",
                play.gap_m * 1e6,
                passed.collect::<Vec<_>>().join(", ")
            );
        }
        body
    }

    fn observability(&self) -> String {
        let seen = unheld(&self.question, &self.agreement.choice, &self.agreement.solved);
        let mut body = String::from(
            "<h2>What can be seen</h2><p>Combinations of springs by falling standard deviation, in shares of the file's values; above 1 nothing is seen, \
             above 0.1 one digit at most.</p><table><tr><th>sd<th>combination</tr>",
        );
        let names = super::names(&self.question, &self.agreement.choice, self.play.is_some());
        let all = seen.all();
        let named = crate::fit::answer::Unobservable::list(&names, &all);
        for (direction, named) in all.iter().zip(named) {
            _ = write!(body, "<tr><td>{:.2e}<td>{}</tr>", direction.relative_sd, escape(&named.to_string()));
        }
        body + "</table>"
    }

    fn set_up(&self, answer: &Answer) -> String {
        if answer.setup.is_empty() {
            return "<h2>Set-up</h2><p>Taken as exact: the set-up states no [setup]. Half a millimetre and two milliradians make intervals two to five times as wide.</p>".to_owned();
        }
        let mut moved: Vec<_> = answer.setup.iter().collect();
        moved.sort_by(|one, other| other.moved_sd.abs().total_cmp(&one.moved_sd.abs()));
        let mut table =
            String::from("<h2>Set-up</h2><table><tr><th>constant<th>estimate<th>stated sd<th>moved by, sd</tr>");
        for constant in moved.iter().take(LISTED) {
            _ = write!(
                table,
                "<tr><td>{}<td>{:.3e}<td>{:.3e}<td>{:.2}</tr>",
                escape(&constant.name),
                constant.estimate,
                constant.prior_sd,
                constant.moved_sd
            );
        }
        table += "</table>";
        if moved.len() > LISTED {
            _ = write!(table, "<p>{} more have moved less.</p>", moved.len() - LISTED);
        }
        table
    }
}

/// Zero of a gauge as the fit found it, m.
fn zero(lines: &Lines, left: &nalgebra::DVector<f64>, row: usize) -> f64 {
    lines.misclosures[row] - left[row]
}

fn plot(x_axis: &'static str, y_axis: &'static str, curves: Vec<Curve>) -> String {
    Plot { x_axis, y_axis, curves, bands: Vec::new(), y_names: Vec::new(), key: Corner::UpperLeft }.svg()
}

/// The parameter that one is correlated with most.
fn correlated(answer: &Answer, index: usize) -> Option<(&str, f64)> {
    let r = |other: usize| correlation(answer, index, other);
    let others = (0..answer.parameters.len()).filter(|other| *other != index);
    let most = others.max_by(|one, other| r(*one).abs().total_cmp(&r(*other).abs()))?;
    Some((&answer.parameters[most].name, r(most)))
}

fn correlation(answer: &Answer, one: usize, other: usize) -> f64 {
    let covariance = &answer.covariance;
    let size = (covariance[one][one] * covariance[other][other]).sqrt();
    if size > 0.0 { covariance[one][other] / size } else { 0.0 }
}

/// Correlations as a table with colours.
fn correlations(answer: &Answer) -> String {
    let count = answer.parameters.len();
    let mut table = String::from("<h2>Correlations</h2><table><tr><th>");
    for parameter in &answer.parameters {
        table += &format!("<th>{}", escape(&parameter.name));
    }
    for row in 0..count {
        _ = write!(table, "<tr><th>{}", escape(&answer.parameters[row].name));
        for column in 0..count {
            let r = correlation(answer, row, column);
            let (hue, strength) = (if r < 0.0 { 220 } else { 20 }, 100.0 - 45.0 * r.abs());
            _ = write!(table, "<td style=\"background:hsl({hue},80%,{strength:.0}%)\">{r:+.2}");
        }
        table += "</tr>";
    }
    table + "</table>"
}

fn outliers(answer: &Answer) -> String {
    if answer.outliers.is_empty() {
        return "<h2>Left out</h2><p>No reading.</p>".to_owned();
    }
    let mut table = String::from(
        "<h2>Left out</h2><p>Readings that do not agree with the others; of a gauge that stays shifted, the first.</p>\
         <table><tr><th>series<th>window<th>gauge</tr>",
    );
    for outlier in &answer.outliers {
        _ = write!(
            table,
            "<tr><td>{}<td>{}<td>{}</tr>",
            escape(&outlier.series),
            escape(&outlier.window),
            escape(&outlier.gauge)
        );
    }
    table + "</table>"
}
