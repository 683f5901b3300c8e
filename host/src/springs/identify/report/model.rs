//! Section of the page that says if the model is right: what the fit leaves, by everything that it could depend on.

use std::fmt::Write as _;

use super::{Point, plot};
use crate::fit::runs::Runs;
use crate::fit::statistics::{float, normal_quantile};
use crate::plots::Curve;
use crate::plots::page::escape;
use crate::springs::fit::series_errors;
use crate::springs::identify::Found;
use crate::springs::identify::regimes::TwoRegimes;

impl<const N: usize> Found<'_, N> {
    /// Compliances of the links beyond the jump, beside those before it.
    pub(super) fn regimes(&self) -> String {
        let Some(Ok(TwoRegimes { links, f, degrees: [unknowns, rest], p })) = &self.regimes else {
            return String::new();
        };
        let mut table = format!(
            "<h2>Beyond the jump</h2><p>Each link with a line of its own there, against the same compliances with offsets of their own: \
             F({unknowns}, {rest}) = {f:.2}, p = {p:.1e}; below 0.01 the compliances differ. Not written to the robot file. The thesis saw \
             0.43 to 0.62 [T Table 5.2].</p><table><tr><th>link<th>before<th>beyond over before<th>95 % interval</tr>"
        );
        for (index, link) in links.iter().enumerate() {
            let [low, high] = link.ends;
            let ratio = if link.is_seen {
                format!("{:.3}<td>{low:.3} to {high:.3}", link.ratio)
            } else {
                "not seen<td>".to_owned()
            };
            _ = write!(table, "<tr><td>c_link[{index}]<td>{:.4e} m/N<td>{ratio}</tr>", link.before);
        }
        table + "</table>"
    }

    pub(super) fn model(&self, points: &[Point]) -> String {
        let mut body = String::from(
            "<h2>Is the model right?</h2><p>Deviations of each reading from what the other gauges of its window let expect, in standard deviations. \
             Left-out readings are not drawn. 19 of 20 lie between -2 and 2; a pattern against force or window says that the model lacks something.</p>",
        );
        body += &residuals(points, "force, N", |point| point.force_n);
        body += &residuals(points, "window of its series", |point| point.place);
        body += &quantiles(points);
        body += &self.repeated();
        body += &self.contributions(points);
        body += &self.left_out();
        body
    }

    /// Pure error and lack of fit.
    fn repeated(&self) -> String {
        let Some(repeats) = &self.repeats else {
            return "<h3>Repeats</h3><p>No level was measured twice; strokes up and down would show the noise.</p>"
                .to_owned();
        };
        let mut table = String::from(
            "<h3>Repeats</h3><table><tr><th><th>chi<sup>2</sup><th>degrees of freedom<th>mean square</tr>",
        );
        for (name, share) in [("repeats of a level: noise", repeats.pure), ("levels: lack of fit", repeats.lack)] {
            _ = write!(table, "<tr><td>{name}<td>{:.1}<td>{}<td>{:.2}</tr>", share.chi2, share.degrees, share.mean());
        }
        _ = write!(
            table,
            "</table><p>The noise is {:.2} of the stated one. Lack of fit against noise: F = {:.2}, p = {:.1e}.</p>",
            repeats.pure.mean().sqrt(),
            repeats.f(),
            repeats.p()
        );
        table
    }

    /// Mean squares of the deviations by gauge, series and stroke, and runs of their signs along the force.
    fn contributions(&self, points: &[Point]) -> String {
        let campaign = self.question.campaign;
        let mut table = String::from(
            "<h3>By gauge, series and stroke</h3><p>Mean squares of the deviations, 1 where noise and model are as stated. Runs: how often signs \
             follow each other along the force, found and expected; a small p says that deviations bend.</p>\
             <table><tr><th><th>readings<th>mean square<th>runs<th>expected<th>p</tr>",
        );
        let used = || points.iter().filter(|point| point.is_used);
        for (gauge, named) in campaign.gauges.iter().enumerate() {
            let of_gauge: Vec<&Point> = used().filter(|point| point.gauge == gauge).collect();
            let runs = (0..campaign.series.len())
                .map(|series| along_force(of_gauge.iter().copied().filter(|point| point.series == series)))
                .fold(Runs::default(), Runs::and);
            let runs = format!("{}<td>{:.1}<td>{:.1e}", runs.found, runs.expected, runs.p());
            table += &row(&format!("gauge {}", named.name), &of_gauge, &runs);
        }
        for (series, name) in campaign.series.iter().enumerate() {
            let of_series: Vec<&Point> = used().filter(|point| point.series == series).collect();
            table += &row(&format!("series {name}"), &of_series, "<td><td>");
        }
        for (stroke, name) in [(1, "rising"), (-1, "falling"), (0, "start")] {
            let of_stroke: Vec<&Point> = used().filter(|point| point.stroke == stroke).collect();
            table += &row(name, &of_stroke, "<td><td>");
        }
        table + "</table>"
    }

    /// Prediction error of each series by the others, beside that of the fit.
    fn left_out(&self) -> String {
        let errors = series_errors(&self.question, &self.agreement.choice, &self.agreement.solved);
        let Some(errors) = errors else { return String::new() };
        let mut table = String::from(
            "<h3>Series left out</h3><p>Root mean squares in standard deviations: of the fit, and of the prediction by the other series. A series that \
             alone shows a spring is not predicted.</p><table><tr><th>series<th>fit<th>prediction</tr>",
        );
        for (name, errors) in self.question.campaign.series.iter().zip(errors) {
            let left_out = errors.left_out.map_or_else(|| "-".to_owned(), |square| format!("{:.2}", square.sqrt()));
            _ = write!(table, "<tr><td>{}<td>{:.2}<td>{left_out}</tr>", escape(name), errors.fitted.sqrt());
        }
        table + "</table>"
    }
}

/// Runs of the signs of deviations along the force.
fn along_force<'a>(points: impl Iterator<Item = &'a Point>) -> Runs {
    let mut points: Vec<&Point> = points.collect();
    points.sort_by(|one, other| one.force_n.total_cmp(&other.force_n));
    Runs::of(&points.into_iter().map(|point| point.deviation).collect::<Vec<_>>())
}

/// Row of a table of contributions; nothing without readings.
fn row(name: &str, points: &[&Point], runs: &str) -> String {
    if points.is_empty() {
        return String::new();
    }
    let mean = points.iter().map(|point| point.deviation * point.deviation).sum::<f64>() / float(points.len());
    format!("<tr><td>{}<td>{}<td>{mean:.2}<td>{runs}</tr>", escape(name), points.len())
}

fn residuals(points: &[Point], x_axis: &'static str, x: impl Fn(&Point) -> f64) -> String {
    let used = points.iter().filter(|point| point.is_used);
    plot(x_axis, "standard deviations", vec![Curve::dots("", used.map(|point| (x(point), point.deviation)).collect())])
}

/// Normal quantiles: a straight line of slope one where the noise is normal and as stated.
fn quantiles(points: &[Point]) -> String {
    let mut deviations: Vec<f64> = points.iter().filter(|point| point.is_used).map(|point| point.deviation).collect();
    deviations.sort_by(f64::total_cmp);
    let count = float(deviations.len());
    let place = |index: usize| normal_quantile((float(index) + 0.5) / count);
    let dots = deviations.iter().enumerate().map(|(index, deviation)| (place(index), *deviation)).collect();
    plot(
        "normal quantile",
        "standard deviations",
        vec![Curve::dots("readings", dots), Curve::line("as stated", vec![(-3.0, -3.0), (3.0, 3.0)])],
    )
}
