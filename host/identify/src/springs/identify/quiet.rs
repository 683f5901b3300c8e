//! Gauges whose readings change by less than their noise: stuck, or with a noise that is stated too
//! large.

use std::ops::Range;

use super::IdentifiedSprings;
use super::response::{Response, Responses, sum};
use crate::fit::goodness::MIN_P;
use crate::fit::statistics::{chi_squared_above, float};
use crate::measurements::FileError;
use crate::measurements::repeated::resolution;
use crate::measurements::springs::Campaign;

/// Probability of a scatter below which a gauge is quiet enough for its responses to count.
const QUIET: f64 = 0.05;

/// A gauge whose readings change by less than their noise.
struct QuietGauge {
    gauge: usize,
    /// The first series in which they do.
    series: usize,
    sentence: String,
}

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Gauges whose readings change by less than their noise, in a series or from one on.
    pub(super) fn quiet(&self) -> Vec<String> {
        let found = quiet(
            self.problem.campaign,
            self.scale(),
            &self.responses(|_| true),
        );
        found.into_iter().map(|quiet| quiet.sentence).collect()
    }
}

/// The first gauge of a campaign without a fit whose readings change by less than the noise that is
/// stated.
pub(super) fn first_quiet<const N: usize>(campaign: &Campaign<N>) -> Option<FileError> {
    let quiet = Some(campaign)
        .filter(|campaign| campaign.is_noise_stated)
        .map(|campaign| quiet(campaign, 1.0, &[]));
    let QuietGauge {
        gauge,
        series,
        sentence,
    } = quiet?.into_iter().next()?;
    let window = campaign
        .windows
        .iter()
        .find(|window| window.series == series && window.readings_m[gauge].is_some())?;
    Some(campaign.error(
        window,
        &format!("{}_um", campaign.gauges[gauge].name),
        sentence,
    ))
}

/// Gauges whose readings change by less than their noise, in a series or from one on. Where a gauge
/// falls short of the others there as well, by its responses, both count. `scale`: standard
/// deviations of the readings, in stated ones.
fn quiet<const N: usize>(
    campaign: &Campaign<N>,
    scale: f64,
    responses: &[Responses],
) -> Vec<QuietGauge> {
    (0..campaign.gauges.len())
        .filter_map(|gauge| {
            let responses = responses.get(gauge).map_or(&[][..], Vec::as_slice);
            quiet_gauge(campaign, scale, responses, gauge)
        })
        .collect()
}

fn quiet_gauge<const N: usize>(
    campaign: &Campaign<N>,
    scale: f64,
    responses: &[(usize, Response)],
    gauge: usize,
) -> Option<QuietGauge> {
    let scatters = scatters(campaign, scale, gauge)?;
    let runs =
        (0..scatters.len()).flat_map(|first| [first + 1, scatters.len()].map(|end| first..end));
    let tests = float(2 * scatters.len() * campaign.gauges.len());
    let tested = runs.map(|run| {
        let (chi2, degrees) = scatters[run.clone()]
            .iter()
            .fold((0.0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
        let below = if degrees > 0 {
            1.0 - chi_squared_above(chi2, degrees)
        } else {
            1.0
        };
        let together = if below < QUIET {
            both(below, falls_short(responses, &run))
        } else {
            1.0
        };
        (
            below.min(together) * 2.0 * tests,
            run.start,
            (chi2 / float(degrees.max(1))).sqrt(),
        )
    });
    let (p, first, scatter) = tested.min_by(|(one, ..), (other, ..)| one.total_cmp(other))?;
    (p < MIN_P).then(|| QuietGauge {
        gauge,
        series: first,
        sentence: format!(
            "gauge {} scatters from series {} on by {scatter:.2} of its noise: it is stuck, or the stated noise is too large",
            campaign.gauges[gauge].name, campaign.series[first]
        ),
    })
}

/// Scatter of a gauge's readings in each series, and its degrees of freedom. `None` of a column
/// that does not resolve its noise: there equal numbers mean nothing.
fn scatters<const N: usize>(
    campaign: &Campaign<N>,
    scale: f64,
    gauge: usize,
) -> Option<Vec<(f64, usize)>> {
    let noise_m = campaign.noise.gauge_um * 1e-6;
    let step_m = resolution(
        campaign
            .windows
            .iter()
            .filter_map(|window| window.readings_m[gauge]),
    );
    let mut readings = vec![Vec::new(); campaign.series.len()];
    for window in &campaign.windows {
        if let Some(reading_m) = window.readings_m[gauge] {
            let sd_m = window.sds_m[gauge].unwrap_or(noise_m) * scale;
            readings[window.series].push((reading_m, sd_m));
        }
    }
    (step_m > 0.0 && step_m < noise_m)
        .then(|| readings.iter().map(|series| scatter(series)).collect())
}

/// Probability that a gauge falls short of the others by as much in a run of series, and not
/// elsewhere.
fn falls_short(responses: &[(usize, Response)], run: &Range<usize>) -> f64 {
    let (inside, outside): (Vec<_>, Vec<_>) = responses
        .iter()
        .partition(|(series, _)| run.contains(series));
    let [inside, outside] = [inside, outside].map(|some| sum(&some));
    // NaN where nothing changes it.
    if inside.share() < outside.share() {
        chi_squared_above(inside.contrast(outside), 1) / 2.0
    } else {
        1.0
    }
}

/// Probability that two independent ones are, by their product, as small by chance (Fisher).
fn both(one: f64, other: f64) -> f64 {
    let product = one * other;
    if product > 0.0 {
        product * (1.0 - product.ln())
    } else {
        0.0
    }
}

/// Sum of the squares of the deviations of readings from their mean, in their variances, and
/// degrees of freedom.
fn scatter(readings: &[(f64, f64)]) -> (f64, usize) {
    let mean =
        readings.iter().map(|(reading, _)| reading).sum::<f64>() / float(readings.len().max(1));
    let squares = readings
        .iter()
        .map(|(reading, sd)| ((reading - mean) / sd).powi(2))
        .sum();
    (squares, readings.len().saturating_sub(1))
}
#[cfg(test)]
mod tests {
    use super::*;
    use crate::springs::fixture::{FINE, TestBench, campaign_a, normal, seeded};

    const UM: f64 = 1e-6;

    fn close(one: f64, other: f64) {
        assert!(
            (one - other).abs() < 1e-9 * other.abs().max(1.0),
            "{one} {other}"
        );
    }

    /// Gauge 0 shows 0 and 1 um in turn, and other steps elsewhere: its column resolves its noise.
    #[test]
    fn scatter_is_computed_series_by_series_in_variances_of_each_reading() {
        let mut bench: TestBench<3> = campaign_a(FINE);
        for (index, window) in bench.campaign.windows.iter_mut().enumerate() {
            let step_um = if window.series == 1 { 0.25 } else { 1.0 };
            window.readings_m[0] = Some(5.0 * UM + if index % 2 == 0 { 0.0 } else { step_um * UM });
        }
        // Eleven windows a series: six of one number and five of the other, whose squares about the
        // mean are 30 / 11.
        let found = scatters(&bench.campaign, 2.0, 0).unwrap();
        assert_eq!(found.len(), 9);
        close(found[0].0, 30.0 / 11.0 / 4.0);
        close(found[1].0, 30.0 / 11.0 / 4.0 / 16.0);
        assert!(found.iter().all(|(_, degrees)| *degrees == 10));
        // A reading that states its own deviation, and one that is missing.
        bench
            .campaign
            .windows
            .iter_mut()
            .for_each(|window| window.sds_m[0] = Some(0.5 * UM));
        bench.campaign.windows[0].readings_m[0] = None;
        let found = scatters(&bench.campaign, 2.0, 0).unwrap();
        // Five of each are left.
        assert_eq!(found[0].1, 9);
        close(found[0].0, 2.5);
        close(found[2].0, 30.0 / 11.0);
    }

    fn of_100_squares(product: f64) -> Response {
        Response {
            product,
            squares: 100.0,
        }
    }

    #[test]
    fn a_gauge_falls_short_where_its_share_is_smaller() {
        let responses = [(0, 0.0), (1, 0.0), (2, -100.0), (3, -100.0)]
            .map(|(series, product)| (series, of_100_squares(product)));
        // Shares of 0 and -1 of 200 squares each: their difference has a variance of 1/100.
        close(
            falls_short(&responses, &(2..4)) / (chi_squared_above(100.0, 1) / 2.0),
            1.0,
        );
        close(falls_short(&responses, &(0..2)), 1.0);
        close(falls_short(&responses[..2], &(0..2)), 1.0);
        close(both(0.1, 0.1), 0.01 * (1.0 - 0.01_f64.ln()));
        close(both(0.0, 0.5), 0.0);
    }

    /// A tenth of the noise from series 6 on; by its readings alone, without a response.
    #[test]
    fn a_quiet_gauge_is_named_with_its_first_series() {
        let mut random = seeded(5);
        let mut bench: TestBench<3> = campaign_a(FINE);
        for window in &mut bench.campaign.windows {
            let share = if window.series >= 6 { 0.1 } else { 1.0 };
            window.readings_m[0] = Some(share * UM * normal(&mut random));
            window
                .readings_m
                .iter_mut()
                .skip(1)
                .for_each(|reading| *reading = Some(UM * normal(&mut random)));
        }
        let found = quiet(&bench.campaign, 1.0, &[]);
        let [
            QuietGauge {
                gauge: 0,
                series: 6,
                sentence,
            },
        ] = &found[..]
        else {
            panic!("{}", found.len())
        };
        let name = &bench.campaign.gauges[0].name;
        let sentence = sentence
            .strip_prefix(&format!("gauge {name} scatters from series 6 on by "))
            .unwrap();
        let share: f64 = sentence.split(' ').next().unwrap().parse().unwrap();
        assert!((0.07..0.13).contains(&share), "{sentence}");
        // All are, if the noise is stated ten times too large.
        let all = quiet(&bench.campaign, 10.0, &[]);
        assert_eq!(all.len(), bench.campaign.gauges.len());
    }
}
