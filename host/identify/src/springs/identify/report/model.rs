//! Section of the page that says if the model is right: what the fit leaves, by everything that it
//! could depend on.

use gantry_tau_report::page::{Page, Table, Text};
use gantry_tau_report::plots::{Curve, Plot};

use super::Point;
use crate::fit::runs::Runs;
use crate::fit::statistics::{float, normal_quantile};
use crate::springs::fit::series_errors;
use crate::springs::identify::IdentifiedSprings;
use crate::springs::identify::regimes::TwoRegimes;

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Compliances of the links beyond the jump, beside those before it.
    pub(super) fn add_regimes(&self, page: &mut Page) {
        let Some(Ok(TwoRegimes {
            links,
            f,
            degrees: [unknowns, rest],
            p,
        })) = &self.regimes
        else {
            return;
        };
        page.section("Beyond the jump");
        page.paragraph(format!(
            "Each link with a line of its own there, against the same compliances with offsets of their own: \
             F({unknowns}, {rest}) = {f:.2}, p = {p:.1e}; below 0.01 the compliances differ. Not written to the robot file. The thesis saw \
             0.43 to 0.62 [T Table 5.2]."
        ));
        let mut table = Table::new(["link", "before", "beyond over before", "95 % interval"]);
        for (index, link) in links.iter().enumerate() {
            let [low, high] = link.ends;
            let [ratio, interval] = if link.is_seen {
                [
                    format!("{:.3}", link.ratio),
                    format!("{low:.3} to {high:.3}"),
                ]
            } else {
                ["not seen".to_owned(), String::new()]
            };
            let before = format!("{:.4e} m/N", link.before);
            table.row([format!("c_link[{index}]"), before, ratio, interval]);
        }
        page.table(table);
    }

    pub(super) fn add_model(&self, page: &mut Page, points: &[Point]) {
        page.section("Is the model right?");
        page.paragraph(
            "Deviations of each reading from what the other gauges of its window predict, in standard deviations. \
             Left-out readings are not drawn. 19 of 20 lie between -2 and 2; a pattern against force or window says that the model lacks something.",
        );
        page.picture(&residuals(points, "force, N", |point| point.force_n).svg());
        page.picture(&residuals(points, "window of its series", |point| point.place).svg());
        page.picture(&quantiles(points).svg());
        self.add_repeated(page);
        self.add_contributions(page, points);
        self.add_left_out(page);
    }

    /// Pure error and lack of fit.
    fn add_repeated(&self, page: &mut Page) {
        page.subsection("Repeats");
        let Some(repeats) = &self.lack_of_fit else {
            page.paragraph(
                "No level was measured twice; strokes up and down would show the noise.",
            );
            return;
        };
        let mut table = Table::new([
            Text::default(),
            Text::from("chi").and(Text::raised("2")),
            "degrees of freedom".into(),
            "mean square".into(),
        ]);
        for (name, share) in [
            ("repeats of a level: noise", repeats.pure),
            ("levels: lack of fit", repeats.lack),
        ] {
            table.row([
                name.to_owned(),
                format!("{:.1}", share.chi2),
                share.degrees.to_string(),
                format!("{:.2}", share.mean()),
            ]);
        }
        page.table(table);
        page.paragraph(format!(
            "The noise is {:.2} of the stated one. Lack of fit against noise: F = {:.2}, p = {:.1e}.",
            repeats.pure.mean().sqrt(),
            repeats.f(),
            repeats.p()
        ));
    }

    /// Mean squares of the deviations by gauge, series and stroke, and runs of their signs along
    /// the force.
    fn add_contributions(&self, page: &mut Page, points: &[Point]) {
        page.subsection("By gauge, series and stroke");
        page.paragraph(
            "Mean squares of the deviations, 1 where noise and model are as stated. Runs: how often signs \
             follow each other along the force, found and expected; a small p says that deviations bend.",
        );
        let campaign = self.problem.campaign;
        let used: Vec<&Point> = points.iter().filter(|point| point.is_used).collect();
        let mut table = Table::new(["", "readings", "mean square", "runs", "expected", "p"]);
        for (gauge, named) in campaign.gauges.iter().enumerate() {
            let of_gauge = of(&used, |point| point.gauge == gauge);
            let runs = (0..campaign.series.len())
                .map(|series| along_force(of(&of_gauge, |point| point.series == series)))
                .fold(Runs::default(), Runs::and);
            add_contribution(
                &mut table,
                &format!("gauge {}", named.name),
                &of_gauge,
                Some(&runs),
            );
        }
        for (series, name) in campaign.series.iter().enumerate() {
            let of_series = of(&used, |point| point.series == series);
            add_contribution(&mut table, &format!("series {name}"), &of_series, None);
        }
        for (stroke, name) in [(1, "rising"), (-1, "falling"), (0, "start")] {
            let of_stroke = of(&used, |point| point.stroke == stroke);
            add_contribution(&mut table, name, &of_stroke, None);
        }
        page.table(table);
    }

    /// Prediction error of each series by the others, beside that of the fit.
    fn add_left_out(&self, page: &mut Page) {
        let errors = series_errors(
            &self.problem,
            &self.robust_fit.active,
            &self.robust_fit.solution,
        );
        let Some(errors) = errors else {
            return;
        };
        page.subsection("Series left out");
        page.paragraph(
            "Root mean squares in standard deviations: of the fit, and of the prediction by the other series. A series that \
             alone shows a spring is not predicted.",
        );
        let mut table = Table::new(["series", "fit", "prediction"]);
        for (name, errors) in self.problem.campaign.series.iter().zip(errors) {
            let left_out = errors
                .left_out
                .map_or_else(|| "-".to_owned(), |square| format!("{:.2}", square.sqrt()));
            table.row([
                name.to_string(),
                format!("{:.2}", errors.fitted.sqrt()),
                left_out,
            ]);
        }
        page.table(table);
    }
}

/// Points that a condition holds for.
fn of<'a>(points: &[&'a Point], condition: impl Fn(&Point) -> bool) -> Vec<&'a Point> {
    let points = points.iter().copied();
    points.filter(|point| condition(point)).collect()
}

/// Runs of the signs of deviations along the force.
fn along_force(mut points: Vec<&Point>) -> Runs {
    points.sort_by(|one, other| one.force_n.total_cmp(&other.force_n));
    Runs::of(
        &points
            .into_iter()
            .map(|point| point.deviation)
            .collect::<Vec<_>>(),
    )
}

/// Adds a row of a table of contributions; nothing without readings.
fn add_contribution(table: &mut Table, name: &str, points: &[&Point], runs: Option<&Runs>) {
    if points.is_empty() {
        return;
    }
    let mean = points
        .iter()
        .map(|point| point.deviation * point.deviation)
        .sum::<f64>()
        / float(points.len());
    let [found, expected, p] = runs.map_or_else(Default::default, |runs| {
        [
            runs.found.to_string(),
            format!("{:.1}", runs.expected),
            format!("{:.1e}", runs.p()),
        ]
    });
    table.row([
        name.to_owned(),
        points.len().to_string(),
        format!("{mean:.2}"),
        found,
        expected,
        p,
    ]);
}

fn residuals(points: &[Point], x_axis: &str, x: impl Fn(&Point) -> f64) -> Plot {
    let used = points.iter().filter(|point| point.is_used);
    let dots = used.map(|point| (x(point), point.deviation)).collect();
    Plot::new(
        format!("Deviations against {x_axis}"),
        x_axis,
        "standard deviations",
        vec![Curve::dots("", dots)],
    )
}

/// Normal quantiles: a straight line of slope one where the noise is normal and as stated.
fn quantiles(points: &[Point]) -> Plot {
    let mut deviations: Vec<f64> = points
        .iter()
        .filter(|point| point.is_used)
        .map(|point| point.deviation)
        .collect();
    deviations.sort_by(f64::total_cmp);
    let count = float(deviations.len());
    let dots = deviations.iter().enumerate().map(|(index, deviation)| {
        let quantile = normal_quantile((float(index) + 0.5) / count);
        (quantile, *deviation)
    });
    Plot::new(
        "Deviations against normal quantiles",
        "normal quantile",
        "standard deviations",
        vec![
            Curve::dots("readings", dots.collect()),
            Curve::line("as stated", vec![(-3.0, -3.0), (3.0, 3.0)]),
        ],
    )
}
