//! Gauges that do not follow the loads alike in every series: stuck, come loose, or without contact for a while.
//!
//! Chi-squared of a whole campaign does not show one gauge of a stiff part, whose readings change by a few standard deviations. The share that its
//! deviations have of what it should show, series by series, does: of a gauge that sticks from a series on, the fit takes a mean of both.

use std::collections::BTreeSet;
use std::ops::Range;

use super::Found;
use crate::fit::goodness::LEAST_P;
use crate::fit::statistics::{chi_squared_above, float};
use crate::measurements::FileError;
use crate::measurements::repeated::resolution;
use crate::measurements::springs::{Campaign, Window};
use crate::output::Name;
use crate::springs::agreement::deviations;
use crate::springs::lines::{Lines, Question};

/// Share of a gauge's readings, or of its series with a shift, that may be left out, and numbers.
const MOST_LEFT_OUT: f64 = 0.25;
const FEW: usize = 5;
const MANY_SHIFTED: usize = 3;

/// Probability of a scatter below which a gauge is quiet enough for its responses to count.
const QUIET: f64 = 0.05;

/// Share that the deviations of a gauge from the fit have of the changes that the robot file's springs predict, in a series or some.
#[derive(Clone, Copy, Debug, Default)]
struct Response {
    /// Sum of the products of both, and of the squares of the predicted changes; in variances of the noise.
    product: f64,
    squares: f64,
}

impl Response {
    /// Share of the predicted changes.
    fn share(self) -> f64 {
        self.product / self.squares
    }

    fn plus(self, other: Self) -> Self {
        Self { product: self.product + other.product, squares: self.squares + other.squares }
    }

    /// Of this share, chi-squared.
    fn chi2(self) -> f64 {
        self.product * self.share()
    }

    /// Of the difference of two shares, chi-squared.
    fn contrast(self, other: Self) -> f64 {
        self.chi2() + other.chi2() - self.plus(other).chi2()
    }
}

/// Series, and the response of a gauge in each that changes it.
type Responses = Vec<(usize, Response)>;

impl<const N: usize> Found<'_, N> {
    /// Standard deviations of the readings, in stated ones.
    pub(super) fn scale(&self) -> f64 {
        let solved = &self.agreement.solved;
        let scaled = (solved.rows.chi_squared() / float(solved.degrees().max(1))).sqrt();
        if self.intervals.is_scaled { scaled } else { 1.0 }
    }

    /// Gauges that contradict the others in all series, or in some of them, with what to do.
    pub(super) fn uneven(&self) -> Vec<String> {
        let campaign = self.question.campaign;
        let named = |(gauge, responses): (usize, Responses)| said(campaign, &campaign.gauges[gauge].name, &responses);
        self.responses(|weight| weight > 0.0).into_iter().enumerate().filter_map(named).collect()
    }

    /// Gauges whose readings change by less than their noise, in a series or from one on.
    pub(super) fn quiet(&self) -> Vec<String> {
        let found = quiet(self.question.campaign, self.scale(), &self.responses(|_| true));
        found.into_iter().map(|quiet| quiet.said).collect()
    }

    /// Responses of all gauges, by the readings of some weights: readings of a gauge that has come loose may have none.
    fn responses(&self, counts: fn(f64) -> bool) -> Vec<Responses> {
        let scale = self.scale();
        let campaign = self.question.campaign;
        let deviations = deviations(&self.question, &self.agreement.choice, &self.agreement.solved);
        let weights = &self.agreement.choice.weights;
        let of_gauge = |gauge: usize| {
            let of_window = |lines: &Lines| {
                let deviation = deviations[lines.window][gauge] / scale;
                let is_used = counts(weights[lines.window][gauge]) && !deviation.is_nan();
                let change = predicted(&self.question, lines, gauge)? / scale;
                is_used.then_some((campaign.windows[lines.window].series, deviation, change))
            };
            let all: Vec<_> = self.agreement.solved.lines.iter().filter_map(of_window).collect();
            (0..campaign.series.len()).filter_map(|series| Some((series, response(&all, series)?))).collect()
        };
        (0..campaign.gauges.len()).map(of_gauge).collect()
    }

    /// Gauges that stay shifted from a window on in many series: a touch is one event.
    pub(super) fn often_shifted(&self) -> impl Iterator<Item = String> {
        let campaign = self.question.campaign;
        campaign.gauges.iter().enumerate().filter_map(move |(gauge, named)| {
            let shifts = self.agreement.choice.shifts.iter().filter(|shift| shift.gauge == gauge);
            let series: BTreeSet<usize> = shifts.map(|shift| shift.series).collect();
            let first = *series.first()?;
            (series.len() >= MANY_SHIFTED && float(series.len()) > MOST_LEFT_OUT * float(campaign.series.len())).then(|| {
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
        let campaign = self.question.campaign;
        campaign.gauges.iter().enumerate().filter_map(move |(gauge, named)| {
            let is_read = |window: &&Window<N>| window.readings_m[gauge].is_some();
            let read = campaign.windows.iter().filter(is_read).count();
            let refused = self.agreement.refused.iter().filter(move |(_, other)| *other == gauge);
            let first = refused.clone().map(|(window, _)| *window).min()?;
            let count = refused.count();
            (count >= FEW && float(count) > MOST_LEFT_OUT * float(read)).then(|| {
                let series = &campaign.series[campaign.windows[first].series];
                format!(
                    "{count} of {read} readings of gauge {} do not agree with the others, the first in series {series}: it may stick, have come loose, or lag behind the force (--hysteresis); measure it again, or leave them empty",
                    named.name
                )
            })
        })
    }
}

/// A gauge whose readings change by less than their noise.
struct Quiet {
    gauge: usize,
    /// The first series in which they do.
    series: usize,
    said: String,
}

/// The first gauge of a campaign without a fit whose readings change by less than the noise that is stated.
pub(super) fn first_quiet<const N: usize>(campaign: &Campaign<N>) -> Option<FileError> {
    let quiet = Some(campaign).filter(|campaign| campaign.is_noise_stated).map(|campaign| quiet(campaign, 1.0, &[]));
    let Quiet { gauge, series, said } = quiet?.into_iter().next()?;
    let is_of_it = |window: &&Window<N>| window.series == series && window.readings_m[gauge].is_some();
    let window = campaign.windows.iter().find(is_of_it)?;
    Some(campaign.error(window, &format!("{}_um", campaign.gauges[gauge].name), said))
}

/// Gauges whose readings change by less than their noise, in a series or from one on. Where a gauge falls short of the others there as well, by
/// its responses, both count. `scale`: standard deviations of the readings, in stated ones.
fn quiet<const N: usize>(campaign: &Campaign<N>, scale: f64, responses: &[Responses]) -> Vec<Quiet> {
    let of_gauge = |gauge: usize| {
        let scatters = scatters(campaign, scale, gauge)?;
        let responses = responses.get(gauge).map_or(&[][..], Vec::as_slice);
        let runs = (0..scatters.len()).flat_map(|first| [first + 1, scatters.len()].map(|end| first..end));
        let tests = float(2 * scatters.len() * campaign.gauges.len());
        let tested = runs.map(|run| {
            let (chi2, degrees) =
                scatters[run.clone()].iter().fold((0.0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
            let below = if degrees > 0 { 1.0 - chi_squared_above(chi2, degrees) } else { 1.0 };
            let together = if below < QUIET { both(below, falls_short(responses, &run)) } else { 1.0 };
            (below.min(together) * 2.0 * tests, run.start, (chi2 / float(degrees.max(1))).sqrt())
        });
        let (p, first, scatter) = tested.min_by(|(one, ..), (other, ..)| one.total_cmp(other))?;
        (p < LEAST_P).then(|| {
            let said = format!(
                "gauge {} scatters from series {} on by {scatter:.2} of its noise: it is stuck, or the stated noise is too large",
                campaign.gauges[gauge].name, campaign.series[first]
            );
            Quiet { gauge, series: first, said }
        })
    };
    (0..campaign.gauges.len()).filter_map(of_gauge).collect()
}

/// Scatter of a gauge's readings in each series, and its degrees of freedom. `None` of a column that does not resolve its noise: equal numbers are
/// no wonder there.
fn scatters<const N: usize>(campaign: &Campaign<N>, scale: f64, gauge: usize) -> Option<Vec<(f64, usize)>> {
    let noise_m = campaign.noise.gauge_um * 1e-6;
    let read = |window: &Window<N>| Some((window.readings_m[gauge]?, window.sds_m[gauge].unwrap_or(noise_m) * scale));
    let step_m = resolution(campaign.windows.iter().filter_map(read).map(|(reading, _)| reading));
    let of_series = |series: usize| {
        let windows = campaign.windows.iter().filter(|window| window.series == series);
        scatter(&windows.filter_map(read).collect::<Vec<_>>())
    };
    (step_m > 0.0 && step_m < noise_m).then(|| (0..campaign.series.len()).map(of_series).collect())
}

/// Probability that a gauge falls short of the others by as much in a run of series, and not elsewhere.
fn falls_short(responses: &[(usize, Response)], run: &Range<usize>) -> f64 {
    let (inside, outside): (Vec<_>, Vec<_>) = responses.iter().partition(|(series, _)| run.contains(series));
    let [inside, outside] = [inside, outside].map(|some| sum(&some));
    // NaN where nothing changes it.
    if inside.share() < outside.share() { chi_squared_above(inside.contrast(outside), 1) / 2.0 } else { 1.0 }
}

/// Probability that two independent ones are, by their product, as small by chance (Fisher).
fn both(one: f64, other: f64) -> f64 {
    let product = one * other;
    if product > 0.0 { product * (1.0 - product.ln()) } else { 0.0 }
}

/// Change of a gauge's reading by the robot file's springs, in standard deviations of its noise.
fn predicted<const N: usize>(question: &Question<'_, N>, lines: &Lines, gauge: usize) -> Option<f64> {
    let row = lines.gauges.iter().position(|other| *other == gauge)?;
    let changed_m = (lines.springs_shown.row(row) * question.file.vector())[0];
    Some(changed_m / lines.variances[row].sqrt())
}

/// Response of a gauge in a series; `None` where nothing changes. `all`: series, deviation and predicted reading.
fn response(all: &[(usize, f64, f64)], series: usize) -> Option<Response> {
    let here: Vec<_> = all.iter().filter(|(other, ..)| *other == series).collect();
    let mean = here.iter().map(|(.., predicted)| predicted).sum::<f64>() / float(here.len().max(1));
    let of_window = |(_, deviation, predicted): &&(usize, f64, f64)| Response {
        product: deviation * (predicted - mean),
        squares: (predicted - mean).powi(2),
    };
    let sum = here.iter().map(of_window).fold(Response::default(), Response::plus);
    (sum.squares > 1.0).then_some(sum)
}

fn sum(some: &[(usize, Response)]) -> Response {
    some.iter().map(|(_, one)| *one).fold(Response::default(), Response::plus)
}

/// Sum of the squares of the deviations of readings from their mean, in their variances, and degrees of freedom.
fn scatter(readings: &[(f64, f64)]) -> (f64, usize) {
    let mean = readings.iter().map(|(reading, _)| reading).sum::<f64>() / float(readings.len().max(1));
    let squares = readings.iter().map(|(reading, sd)| ((reading - mean) / sd).powi(2)).sum();
    (squares, readings.len().saturating_sub(1))
}

/// Sentence for a gauge whose responses, series by series, are not those of the other gauges.
fn said<const N: usize>(campaign: &Campaign<N>, name: &Name, responses: &[(usize, Response)]) -> Option<String> {
    let all = sum(responses);
    let tests = float(campaign.gauges.len() * (responses.len() + 1));
    let p = |chi2: f64, degrees: usize| chi_squared_above(chi2, degrees) * tests;
    let splits = (1..responses.len()).map(|split| {
        let (before, from) = responses.split_at(split);
        (sum(before).contrast(sum(from)), from[0].0)
    });
    let (contrast, from) = splits.max_by(|(one, _), (other, _)| one.total_cmp(other)).unwrap_or_default();
    let each = responses.iter().map(|(_, one)| one.chi2()).sum::<f64>() - all.chi2();
    let worst = responses.iter().max_by(|(_, one), (_, other)| one.chi2().total_cmp(&other.chi2()))?;
    let [overall, split, apart] = [p(all.chi2(), 1), p(contrast, 1), p(each, responses.len().max(2) - 1)];
    let least = overall.min(split).min(apart);
    let what = match least {
        _ if least >= LEAST_P => return None,
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
    use crate::springs::campaigns::{Bench, FINE, campaign_a, normal, seeded};

    const UM: f64 = 1e-6;

    fn close(one: f64, other: f64) {
        assert!((one - other).abs() < 1e-9 * other.abs().max(1.0), "{one} {other}");
    }

    /// By three standard deviations in eight series, above and below in turn: as many above as below, before as after.
    #[test]
    fn responses_that_differ_from_series_to_series_are_named_with_their_chance() {
        let bench: Bench<3> = campaign_a(FINE);
        let of =
            |series: usize| (series, Response { product: if series % 2 == 0 { 60.0 } else { -60.0 }, squares: 100.0 });
        let found = said(&bench.campaign, &bench.campaign.gauges[0].name, &[0, 1, 2, 3, 4, 5, 6, 7].map(of)).unwrap();
        assert!(found.contains("does not respond to the loads of every series alike"), "{found}");
        // Chi-squared is 36 in each series, none of them together; nine gauges, and nine tests of each.
        let p = chi_squared_above(8.0 * 36.0, 7) * 81.0;
        assert!(found.ends_with(&format!("(p = {p:.1e})")), "{found} {p:e}");
    }

    /// Gauge 0 shows 0 and 1 um in turn, and other steps elsewhere: its column resolves its noise.
    #[test]
    fn scatter_is_told_series_by_series_in_variances_of_each_reading() {
        let mut bench: Bench<3> = campaign_a(FINE);
        for (index, window) in bench.campaign.windows.iter_mut().enumerate() {
            let step_um = if window.series == 1 { 0.25 } else { 1.0 };
            window.readings_m[0] = Some(5.0 * UM + if index % 2 == 0 { 0.0 } else { step_um * UM });
        }
        // Eleven windows a series: six of one number and five of the other, whose squares about the mean are 30 / 11.
        let scatters_of = |bench: &Bench<3>| scatters(&bench.campaign, 2.0, 0).unwrap();
        let found = scatters_of(&bench);
        assert_eq!(found.len(), 9);
        close(found[0].0, 30.0 / 11.0 / 4.0);
        close(found[1].0, 30.0 / 11.0 / 4.0 / 16.0);
        assert!(found.iter().all(|(_, degrees)| *degrees == 10));
        // A reading that states its own deviation, and one that is missing.
        bench.campaign.windows.iter_mut().for_each(|window| window.sds_m[0] = Some(0.5 * UM));
        bench.campaign.windows[0].readings_m[0] = None;
        let found = scatters_of(&bench);
        // Five of each are left.
        assert_eq!(found[0].1, 9);
        close(found[0].0, 2.5);
        close(found[2].0, 30.0 / 11.0);
    }

    #[test]
    fn a_gauge_falls_short_where_its_share_is_smaller() {
        let of = |product: f64| Response { product, squares: 100.0 };
        let responses = [(0, of(0.0)), (1, of(0.0)), (2, of(-100.0)), (3, of(-100.0))];
        // Shares of 0 and -1 of 200 squares each: their difference has a variance of 1/100.
        close(falls_short(&responses, &(2..4)) / (chi_squared_above(100.0, 1) / 2.0), 1.0);
        close(falls_short(&responses, &(0..2)), 1.0);
        close(falls_short(&responses[..2], &(0..2)), 1.0);
        close(both(0.1, 0.1), 0.01 * (1.0 - 0.01_f64.ln()));
        close(both(0.0, 0.5), 0.0);
    }

    /// A tenth of the noise from series 6 on; by its readings alone, without a response.
    #[test]
    fn a_quiet_gauge_is_named_with_its_first_series() {
        let mut random = seeded(5);
        let mut bench: Bench<3> = campaign_a(FINE);
        for window in &mut bench.campaign.windows {
            let share = if window.series >= 6 { 0.1 } else { 1.0 };
            window.readings_m[0] = Some(share * UM * normal(&mut random));
            window.readings_m.iter_mut().skip(1).for_each(|reading| *reading = Some(UM * normal(&mut random)));
        }
        let found = quiet(&bench.campaign, 1.0, &[]);
        let [Quiet { gauge: 0, series: 6, said }] = &found[..] else { panic!("{}", found.len()) };
        let name = &bench.campaign.gauges[0].name;
        let said = said.strip_prefix(&format!("gauge {name} scatters from series 6 on by ")).unwrap();
        let share: f64 = said.split(' ').next().unwrap().parse().unwrap();
        assert!((0.07..0.13).contains(&share), "{said}");
        // All are, if the noise is stated ten times too large.
        let all = quiet(&bench.campaign, 10.0, &[]);
        assert_eq!(all.len(), bench.campaign.gauges.len());
    }
}
