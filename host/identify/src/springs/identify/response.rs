//! Gauges that do not follow the loads alike in every series: stuck, come loose, or without contact
//! for a while.
//!
//! Chi-squared of a whole campaign does not show one gauge of a stiff part, whose readings change
//! by a few standard deviations. The share that its deviations have of what it should show, series
//! by series, does: of a gauge that sticks from a series on, the fit takes a mean of both.

use std::collections::BTreeSet;

use gantry_tau_system::output::Name;

use super::IdentifiedSprings;
use crate::fit::goodness::MIN_P;
use crate::fit::statistics::{chi_squared_above, float};
use crate::measurements::springs::Campaign;
use crate::springs::linearize::LinearizedWindow;
use crate::springs::problem::SpringsProblem;
use crate::springs::robust_fit::{RobustFit, deviations};

/// Share of a gauge's readings, or of its series with a shift, that may be left out, and numbers.
const MAX_LEFT_OUT: f64 = 0.25;
const FEW: usize = 5;
const MANY_SHIFTED: usize = 3;

/// Share that the deviations of a gauge from the fit have of the changes that the robot file's
/// springs predict, in a series or some.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Response {
    /// Sum of the products of both, and of the squares of the predicted changes; in variances of
    /// the noise.
    pub(super) product: f64,
    pub(super) squares: f64,
}

impl Response {
    /// Share of the predicted changes.
    pub(super) fn share(self) -> f64 {
        self.product / self.squares
    }

    fn plus(self, other: Self) -> Self {
        Self {
            product: self.product + other.product,
            squares: self.squares + other.squares,
        }
    }

    /// Of this share, chi-squared.
    fn chi2(self) -> f64 {
        self.product * self.share()
    }

    /// Of the difference of two shares, chi-squared.
    pub(super) fn contrast(self, other: Self) -> f64 {
        self.chi2() + other.chi2() - self.plus(other).chi2()
    }
}

/// Series, and the response of a gauge in each that changes it.
pub(super) type Responses = Vec<(usize, Response)>;

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Standard deviations of the readings, in stated ones.
    pub(super) fn scale(&self) -> f64 {
        let solution = &self.robust_fit.solution;
        let scaled = (solution.rows.chi_squared() / float(solution.degrees().max(1))).sqrt();
        if self.intervals.is_scaled {
            scaled
        } else {
            1.0
        }
    }

    /// Gauges that contradict the others in all series, or in some of them, with what to do.
    pub(super) fn uneven(&self) -> Vec<String> {
        let campaign = self.problem.campaign;
        campaign
            .gauges
            .iter()
            .zip(self.responses(|weight| weight > 0.0))
            .filter_map(|(gauge, responses)| sentence(campaign, &gauge.name, &responses))
            .collect()
    }

    /// Responses of all gauges, by the readings of some weights: readings of a gauge that has come
    /// loose may have none.
    pub(super) fn responses(&self, counts: fn(f64) -> bool) -> Vec<Responses> {
        let deviations = deviations(
            &self.problem,
            &self.robust_fit.active,
            &self.robust_fit.solution,
        );
        (0..self.problem.campaign.gauges.len())
            .map(|gauge| self.responses_of(gauge, &deviations, counts))
            .collect()
    }

    fn responses_of(
        &self,
        gauge: usize,
        deviations: &[Vec<f64>],
        counts: fn(f64) -> bool,
    ) -> Responses {
        let scale = self.scale();
        let campaign = self.problem.campaign;
        let RobustFit {
            solution, active, ..
        } = &self.robust_fit;
        let mut all = Vec::new();
        for linearized in &solution.linearized {
            let window = linearized.window;
            let deviation = deviations[window][gauge] / scale;
            let Some(change) = predicted(&self.problem, linearized, gauge) else {
                continue;
            };
            if counts(active.weights[window][gauge]) && !deviation.is_nan() {
                all.push((campaign.windows[window].series, deviation, change / scale));
            }
        }
        (0..campaign.series.len())
            .filter_map(|series| Some((series, response(&all, series)?)))
            .collect()
    }

    /// Gauges that stay shifted from a window on in many series: a touch is one event.
    pub(super) fn often_shifted(&self) -> impl Iterator<Item = String> {
        let campaign = self.problem.campaign;
        campaign.gauges.iter().enumerate().filter_map(move |(gauge, named)| {
            let shifts = self.robust_fit.active.shifts.iter().filter(|shift| shift.gauge == gauge);
            let series: BTreeSet<usize> = shifts.map(|shift| shift.series).collect();
            let first = *series.first()?;
            (series.len() >= MANY_SHIFTED && float(series.len()) > MAX_LEFT_OUT * float(campaign.series.len())).then(|| {
                format!(
                    "gauge {} is shifted from a window on in {} of {} series, the first in series {}: it lags behind the load (friction, or play of its lever), or is loose; mend it, or fit a lag along (--hysteresis)",
                    named.name,
                    series.len(),
                    campaign.series.len(),
                    campaign.series[first]
                )
            })
        })
    }

    /// Gauges many of whose readings are left out.
    pub(super) fn mostly_left_out(&self) -> impl Iterator<Item = String> {
        let campaign = self.problem.campaign;
        campaign.gauges.iter().enumerate().filter_map(move |(gauge, named)| {
            let read = campaign.windows.iter().filter(|window| window.readings_m[gauge].is_some()).count();
            let refused = self.robust_fit.refused.iter().filter(move |(_, other)| *other == gauge);
            let first = refused.clone().map(|(window, _)| *window).min()?;
            let count = refused.count();
            (count >= FEW && float(count) > MAX_LEFT_OUT * float(read)).then(|| {
                let series = &campaign.series[campaign.windows[first].series];
                format!(
                    "{count} of {read} readings of gauge {} do not agree with the others, the first in series {series}: it may stick, have come loose, or lag behind the force (--hysteresis); measure it again, or leave them empty",
                    named.name
                )
            })
        })
    }
}

/// Change of a gauge's reading by the robot file's springs, in standard deviations of its noise.
fn predicted<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &LinearizedWindow,
    gauge: usize,
) -> Option<f64> {
    let row = linearized.row_of(gauge)?;
    let changed_m = (linearized.springs_shown.row(row) * problem.file.vector())[0];
    Some(changed_m / linearized.variances[row].sqrt())
}

/// Response of a gauge in a series; `None` where nothing changes. `all`: series, deviation and
/// predicted reading.
fn response(all: &[(usize, f64, f64)], series: usize) -> Option<Response> {
    let here: Vec<_> = all.iter().filter(|(other, ..)| *other == series).collect();
    let mean = here.iter().map(|(.., predicted)| predicted).sum::<f64>() / float(here.len().max(1));
    let sum = here
        .iter()
        .map(|(_, deviation, predicted)| Response {
            product: deviation * (predicted - mean),
            squares: (predicted - mean).powi(2),
        })
        .fold(Response::default(), Response::plus);
    (sum.squares > 1.0).then_some(sum)
}

pub(super) fn sum(some: &[(usize, Response)]) -> Response {
    some.iter()
        .map(|(_, one)| *one)
        .fold(Response::default(), Response::plus)
}

/// Sentence for a gauge whose responses, series by series, are not those of the other gauges.
fn sentence<const N: usize>(
    campaign: &Campaign<N>,
    name: &Name,
    responses: &[(usize, Response)],
) -> Option<String> {
    let all = sum(responses);
    let tests = float(campaign.gauges.len() * (responses.len() + 1));
    let splits = (1..responses.len()).map(|split| {
        let (before, from) = responses.split_at(split);
        (sum(before).contrast(sum(from)), from[0].0)
    });
    let (contrast, from) = splits
        .max_by(|(one, _), (other, _)| one.total_cmp(other))
        .unwrap_or_default();
    let each = responses.iter().map(|(_, one)| one.chi2()).sum::<f64>() - all.chi2();
    let worst = responses
        .iter()
        .max_by(|(_, one), (_, other)| one.chi2().total_cmp(&other.chi2()))?;
    let [overall, split, apart] = [
        (all.chi2(), 1),
        (contrast, 1),
        (each, responses.len().max(2) - 1),
    ]
    .map(|(chi2, degrees)| chi_squared_above(chi2, degrees) * tests);
    let least = overall.min(split).min(apart);
    let what = match least {
        _ if least >= MIN_P => return None,
        _ if least >= overall => format!(
            "shows {:.0} % of what the robot file's springs predict {} than the other gauges show; look at its sign, unit and contact",
            all.share().abs() * 100.0,
            if all.share() < 0.0 { "less" } else { "more" }
        ),
        _ if least >= split => format!(
            "responds to loads otherwise from series {} on: it may stick, or have come loose; measure it again, or leave its readings empty",
            campaign.series[from]
        ),
        _ => format!(
            "does not respond to the loads of every series alike, least of all in {}; measure it again, or leave its readings empty",
            campaign.series[worst.0]
        ),
    };
    Some(format!("gauge {name} {what} (p = {least:.1e})"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::springs::fixture::{FINE, TestBench, campaign_a};

    /// By three standard deviations in eight series, above and below in turn: as many above as
    /// below, before as after.
    #[test]
    fn responses_that_differ_from_series_to_series_are_named_with_their_chance() {
        let bench: TestBench<3> = campaign_a(FINE);
        let responses = [0, 1, 2, 3, 4, 5, 6, 7].map(|series| {
            let product = if series % 2 == 0 { 60.0 } else { -60.0 };
            let squares = 100.0;
            (series, Response { product, squares })
        });
        let found = sentence(&bench.campaign, &bench.campaign.gauges[0].name, &responses).unwrap();
        assert!(
            found.contains("does not respond to the loads of every series alike"),
            "{found}"
        );
        // Chi-squared is 36 in each series, none of them together; nine gauges, and nine tests of
        // each.
        let p = chi_squared_above(8.0 * 36.0, 7) * 81.0;
        assert!(found.ends_with(&format!("(p = {p:.1e})")), "{found} {p:e}");
    }
}
