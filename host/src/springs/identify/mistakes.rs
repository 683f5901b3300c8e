//! Columns with a wrong sign or unit: looked for where the readings contradict a campaign as it is, and told where they do not contradict it
//! with the column mended.
//!
//! A column is accused only if it carries a signal, the campaign as it is is rejected, the mended one is not, and it explains the readings far
//! better. Noise with the other sign is noise.

use crate::measurements::FileError;
use crate::measurements::springs::{Campaign, LOAD, Window};
use crate::springs::choice::Choice;
use crate::springs::decision::check_positive;
use crate::springs::fit::{Solved, rounds};
use crate::springs::lines::{Question, State, smooth_loads};

use super::doubts::MOST_OUTLIERS;
use super::{Found, IdentifyError, IdentifyOptions, find};
use crate::fit::goodness::LEAST_P;
use crate::fit::statistics::{chi_squared_above, float};

/// Chi-squared per degree of freedom up to which a mended campaign is not rejected.
const EXPLAINED: f64 = 1.5;
/// Decrease of the cost that a mended column must bring, and smallest factor.
const LEAST_GAIN: f64 = 50.0;
const LEAST_FACTOR: f64 = 1.2;
/// Sum of the squares of a column's changes, in variances of its noise, above which it carries a signal.
const SIGNAL: f64 = 100.0;
/// Chi-squared per degree of freedom of a plain fit that is grossly wrong, and smallest factor by which a mended column makes it smaller.
const GROSS: f64 = 10.0;
const GROSS_FACTOR: f64 = 5.0;
/// Linearisations of the fits that say which mistakes are likely, and number of those that are tried.
const STEPS: u32 = 4;
const MOST_TRIED: usize = 3;
/// Newtons of a kilogram's weight.
const NEWTONS_PER_KG: f64 = 9.806_65;
/// Forces, moments and all of the wrench.
const FORCES: [usize; 3] = [0, 1, 2];
const MOMENTS: [usize; 3] = [3, 4, 5];
const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];

/// Change of columns of a table.
enum Change {
    Load { columns: Vec<usize>, factor: f64 },
    Gauge { gauge: usize, factor: f64 },
    SwapLoads(usize, usize),
    SwapGauges(usize, usize),
}

/// Change that mends a table, and the sentence for it.
struct Mistake {
    change: Change,
    reason: &'static str,
}

impl Mistake {
    fn all(gauges: usize) -> impl Iterator<Item = Self> {
        let of = |columns: &[usize], factor: f64, reason: &'static str| Self {
            change: Change::Load { columns: columns.to_vec(), factor },
            reason,
        };
        let reversed = "the wrench has the wrong sign: it is the load on the platform, not what the platform pulls with; negate these columns";
        let groups = [
            of(&ALL, -1.0, reversed),
            of(&FORCES, -1.0, "the forces have the wrong sign; negate these columns"),
            of(&MOMENTS, -1.0, "the moments have the wrong sign; negate these columns"),
            of(&FORCES, NEWTONS_PER_KG, "the forces are in kg; write newtons: 9.80665 times as much"),
            of(&FORCES, 1e3, "the forces are in kN; write newtons"),
            of(&MOMENTS, 1e-3, "the moments are in N mm; write N m"),
        ];
        let single = ALL.map(|column| of(&[column], -1.0, "this column has the wrong sign; negate it"));
        let gauge = |gauge: usize| Self {
            change: Change::Gauge { gauge, factor: -1.0 },
            reason: "the readings fall where by the others they should rise; the gauge's axis is reversed, or its sign",
        };
        let swapped = "these two columns are swapped";
        let loads = [(0, 1), (0, 2), (1, 2), (3, 4), (3, 5), (4, 5)]
            .map(|(one, other)| Self { change: Change::SwapLoads(one, other), reason: swapped });
        let pairs = (0..gauges).flat_map(move |one| (one + 1..gauges).map(move |other| (one, other)));
        let pairs = pairs.map(move |(one, other)| Self { change: Change::SwapGauges(one, other), reason: swapped });
        groups.into_iter().chain(single).chain((0..gauges).map(gauge)).chain(loads).chain(pairs)
    }

    fn taken_back<const N: usize>(&self, campaign: &Campaign<N>) -> Campaign<N> {
        let mut campaign = campaign.clone();
        for window in &mut campaign.windows {
            match &self.change {
                Change::Load { columns, factor } => columns.iter().for_each(|column| window.load[*column] *= factor),
                Change::Gauge { gauge, factor } => {
                    window.readings_m[*gauge] = window.readings_m[*gauge].map(|reading| reading * factor);
                }
                Change::SwapLoads(one, other) => window.load.swap_rows(*one, *other),
                Change::SwapGauges(one, other) => window.readings_m.swap(*one, *other),
            }
        }
        campaign
    }

    /// True if each of the columns, or of a group of columns one, changes by more than its noise.
    fn has_signal<const N: usize>(&self, question: &Question<'_, N>) -> bool {
        match &self.change {
            Change::Load { columns, .. } => any_load_has_signal(question, columns),
            Change::Gauge { gauge, .. } => gauge_has_signal(question.campaign, *gauge),
            Change::SwapLoads(one, other) => any_load_has_signal(question, &[*one, *other]),
            Change::SwapGauges(one, other) => {
                [*one, *other].iter().any(|gauge| gauge_has_signal(question.campaign, *gauge))
            }
        }
    }

    /// What a fit costs without the mistake, if it explains the readings.
    fn explains<const N: usize>(&self, question: &Question<'_, N>, options: &IdentifyOptions) -> Option<f64> {
        let plain = IdentifyOptions { has_two_regimes: false, has_hysteresis: false, ..options.clone() };
        let campaign = self.taken_back(question.campaign);
        let found = find(question.on(&campaign), &plain).ok().filter(is_explained)?;
        Some(found.agreement.cost())
    }

    fn error<const N: usize>(&self, campaign: &Campaign<N>) -> Option<FileError> {
        let load = |column: &usize| LOAD[*column].to_owned();
        let gauge = |gauge: &usize| format!("{}_um", campaign.gauges[*gauge].name);
        let (names, read): (Vec<String>, Option<usize>) = match &self.change {
            Change::Load { columns, .. } => (columns.iter().map(load).collect(), None),
            Change::Gauge { gauge: read, .. } => (vec![gauge(read)], Some(*read)),
            Change::SwapLoads(one, other) => ([one, other].map(load).into(), None),
            Change::SwapGauges(one, other) => ([one, other].map(gauge).into(), Some(*one)),
        };
        let is_read = |window: &&Window<N>| read.is_none_or(|gauge| window.readings_m[gauge].is_some());
        Some(campaign.error(campaign.windows.iter().find(is_read)?, &names.join(", "), self.reason))
    }
}

/// True if any of these columns of the load changes by more than its noise.
fn any_load_has_signal<const N: usize>(question: &Question<'_, N>, columns: &[usize]) -> bool {
    let sds = question.load_variances().map(f64::sqrt);
    let measured: Vec<_> = question.campaign.windows.iter().map(|window| window.load).collect();
    let smooth = smooth_loads(question.campaign, &measured);
    let of_column =
        |column: &usize| changes(question.campaign, |window| Some(smooth[window][*column] / sds[*column])).0;
    columns.iter().map(of_column).fold(0.0, f64::max) > SIGNAL
}

/// True if the readings of a gauge change by more than their noise.
fn gauge_has_signal<const N: usize>(campaign: &Campaign<N>, gauge: usize) -> bool {
    let noise_m = campaign.noise.gauge_um * 1e-6;
    let (squares, count) = changes(campaign, |window| Some(campaign.windows[window].readings_m[gauge]? / noise_m));
    squares - float(count) > SIGNAL
}

/// Sum of the squares of a value's deviations from its mean in each series, and their number.
fn changes<const N: usize>(campaign: &Campaign<N>, value: impl Fn(usize) -> Option<f64>) -> (f64, usize) {
    let of_series = |series: usize| {
        let windows = (0..campaign.windows.len()).filter(|window| campaign.windows[*window].series == series);
        let values: Vec<f64> = windows.filter_map(&value).collect();
        let mean = values.iter().sum::<f64>() / float(values.len().max(1));
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>(), values.len())
    };
    (0..campaign.series.len())
        .map(of_series)
        .fold((0.0, 0), |(sum, all), (squares, count)| (sum + squares, all + count))
}

/// Refuses a campaign that a few steps of a plain fit contradict grossly, and would not with a column mended: readings of which hardly any agree are
/// not worth a search for those that do.
///
/// # Errors
/// The mistake.
pub(super) fn gross<const N: usize>(
    question: &Question<'_, N>,
    options: &IdentifyOptions,
) -> Result<(), IdentifyError> {
    let as_it_is = after_steps(question);
    if as_it_is.as_ref().is_some_and(|solved| solved.rows.chi_squared() <= GROSS * float(solved.degrees())) {
        return Ok(());
    }
    let chi2 = as_it_is.map_or(f64::INFINITY, |solved| solved.rows.chi_squared());
    let best =
        likely(question, chi2 / GROSS_FACTOR).into_iter().find(|mistake| mistake.explains(question, options).is_some());
    best.and_then(|mistake| mistake.error(question.campaign)).map_or(Ok(()), |error| Err(error.into()))
}

/// Returns what was found; if the readings contradict it, and would not with a column mended, the error that says which.
///
/// # Errors
/// That of `found`, or the mistake.
pub(super) fn checked<'a, const N: usize>(
    found: Result<Found<'a, N>, IdentifyError>,
    question: &Question<'_, N>,
    options: &IdentifyOptions,
) -> Result<Found<'a, N>, IdentifyError> {
    let cost = match &found {
        Ok(found) if !is_rejected(found) => None,
        Ok(found) => Some(found.agreement.cost()),
        Err(IdentifyError::Fit { .. } | IdentifyError::Unseen { .. }) => Some(f64::INFINITY),
        Err(_) => None,
    };
    let Some(cost) = cost else { return found };
    let mended = |mistake: &Mistake| {
        let of_mended = mistake.explains(question, options)?;
        (cost - of_mended > LEAST_GAIN && cost > LEAST_FACTOR * of_mended).then_some(of_mended)
    };
    // A fit that fails costs all, though its springs, negative ones, leave little.
    let of_plain = after_steps(question).filter(|_| cost.is_finite());
    let chi2 = of_plain.map_or(f64::INFINITY, |solved| solved.rows.chi_squared());
    let best = likely(question, chi2).into_iter().filter_map(|mistake| Some((mended(&mistake)?, mistake)));
    let best = best.min_by(|(one, _), (other, _)| one.total_cmp(other));
    match best.and_then(|(_, mistake)| mistake.error(question.campaign)) {
        Some(error) => Err(error.into()),
        None => found,
    }
}

/// Mistakes without which a few steps of a plain fit go below this chi-squared with positive compliances, the likeliest first.
fn likely<const N: usize>(question: &Question<'_, N>, most: f64) -> Vec<Mistake> {
    let all = Mistake::all(question.campaign.gauges.len()).filter(|mistake| mistake.has_signal(question));
    let tried = all.filter_map(|mistake| {
        let mended = mistake.taken_back(question.campaign);
        let question = question.on(&mended);
        let solved = after_steps(&question).filter(|solved| check_positive(&question, solved).is_ok())?;
        let chi2 = solved.rows.chi_squared();
        (chi2 < most).then_some((chi2, mistake))
    });
    let mut tried: Vec<(f64, Mistake)> = tried.collect();
    tried.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    tried.into_iter().take(MOST_TRIED).map(|(_, mistake)| mistake).collect()
}

/// The fit of all readings after some steps from the robot file's springs.
fn after_steps<const N: usize>(question: &Question<'_, N>) -> Option<Solved<N>> {
    rounds(question, &Choice::all(question.campaign), State::start(question), STEPS).ok()
}

/// True if the readings contradict what was found.
fn is_rejected<const N: usize>(found: &Found<'_, N>) -> bool {
    let solved = &found.agreement.solved;
    let is_unlikely = chi_squared_above(solved.rows.chi_squared(), solved.degrees()) < LEAST_P;
    let is_wrong = found.intervals.is_scaled && !is_explained(found);
    (is_unlikely && !found.intervals.is_scaled) || is_wrong || has_many_outliers(found)
}

fn is_explained<const N: usize>(found: &Found<'_, N>) -> bool {
    let solved = &found.agreement.solved;
    solved.rows.chi_squared() <= EXPLAINED * float(solved.degrees()) && !has_many_outliers(found)
}

fn has_many_outliers<const N: usize>(found: &Found<'_, N>) -> bool {
    let refused = found.agreement.refused.len();
    let readings = found.agreement.solved.rows.residuals.len() + refused;
    float(refused) > MOST_OUTLIERS * float(readings)
}
