//! Columns with a wrong sign or unit: looked for where the readings contradict a campaign as it is, and told where they do not contradict it
//! with the column mended.
//!
//! A column is accused only if it carries a signal, the campaign as it is is rejected, the mended one is not, and it explains the readings far
//! better. Noise with the other sign is noise.

use std::iter;

use nalgebra::{Matrix6, Vector6};

use crate::measurements::FileError;
use crate::measurements::mistaken_columns::{ALL, MistakenColumns, SWAPPED};
use crate::measurements::moved_rows::MovedRows;
use crate::measurements::springs::{Campaign, Window};
use crate::springs::choice::Choice;
use crate::springs::decision::check_positive;
use crate::springs::fit::{Solved, rounds};
use crate::springs::lines::{Question, State, smooth_loads};

use super::doubts::MOST_OUTLIERS;
use super::response::first_quiet;
use super::{Found, IdentifyError, IdentifyOptions, find};
use crate::fit::goodness::{LEAST_P, simplest};
use crate::fit::statistics::{chi_squared_above, float, squares_about_mean};

/// Chi-squared per degree of freedom up to which a mended campaign is not rejected.
const EXPLAINED: f64 = 1.5;
/// Decrease of the cost that a mended column must bring, and smallest factor.
const LEAST_GAIN: f64 = 50.0;
const LEAST_FACTOR: f64 = 1.2;
/// Sum of the squares of a column's changes, in variances of its noise, above which it carries a signal.
const SIGNAL: f64 = 100.0;
/// Smallest share that it has of the largest such sum of a column of its kind, in N^2 or (N m)^2.
const LEAST_OF_LARGEST: f64 = 0.01;
/// Chi-squared per degree of freedom of a plain fit that is grossly wrong, and smallest factor by which a mended column makes it smaller.
const GROSS: f64 = 10.0;
const GROSS_FACTOR: f64 = 5.0;
/// Number of mistakes, the first after one step of a fit, that further steps are made for; linearisations of these fits; and number of those that
/// are tried.
const MOST_PROMISING: usize = 10;
const STEPS: u32 = 4;
const MOST_TRIED: usize = 3;

/// Change of columns of a table.
enum Change {
    /// The wrench, made of these columns, is this matrix times that of the table.
    Load {
        columns: Vec<usize>,
        mended: Box<Matrix6<f64>>,
    },
    Gauge {
        gauge: usize,
        factor: f64,
    },
    SwapGauges(usize, usize),
    /// The readings of a row belong to the load of another one.
    MoveReadings(MovedRows),
}

/// Change that mends a table, and the sentence for it.
struct Mistake {
    change: Change,
    reason: String,
}

impl Mistake {
    /// All that are possible in a campaign, the simplest first.
    fn all<const N: usize>(campaign: &Campaign<N>) -> impl Iterator<Item = Self> {
        let gauges = campaign.gauges.len();
        let load = |MistakenColumns { columns, mended, reason }| Self {
            change: Change::Load { columns, mended: Box::new(mended) },
            reason,
        };
        let gauge = |gauge: usize| Self {
            change: Change::Gauge { gauge, factor: -1.0 },
            reason: "the readings fall where by the others they should rise; the gauge's axis is reversed, or its sign"
                .to_owned(),
        };
        let pairs = (0..gauges).flat_map(move |one| (one + 1..gauges).map(move |other| (one, other)));
        let pairs =
            pairs.map(move |(one, other)| Self { change: Change::SwapGauges(one, other), reason: SWAPPED.to_owned() });
        let reversed = "the wrench has the wrong sign: it is the load on the platform, not what the platform pulls with; negate these columns";
        let wrench = iter::once(MistakenColumns::scaled(&ALL, -1.0, reversed))
            .chain(MistakenColumns::all(campaign.wrench.names));
        let rows = MovedRows::ALL
            .map(|moved| Self { change: Change::MoveReadings(moved), reason: format!("these columns {moved}") });
        wrench.map(load).chain((0..gauges).map(gauge)).chain(pairs).chain(rows)
    }

    fn taken_back<const N: usize>(&self, campaign: &Campaign<N>) -> Campaign<N> {
        let mut campaign = campaign.clone();
        if let Change::MoveReadings(moved) = &self.change {
            let of_row =
                |(set, read): (&Window<N>, &Window<N>)| Window { readings_m: read.readings_m.clone(), ..set.clone() };
            campaign.windows = moved.pairs(&campaign.windows).map(of_row).collect();
        }
        for window in &mut campaign.windows {
            match &self.change {
                Change::MoveReadings(_) => {}
                Change::Load { mended, .. } => {
                    window.load = campaign.wrench.maps[window.pose].mended(mended, &window.load);
                }
                Change::Gauge { gauge, factor } => {
                    window.readings_m[*gauge] = window.readings_m[*gauge].map(|reading| reading * factor);
                }
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
            Change::SwapGauges(one, other) => {
                [*one, *other].iter().any(|gauge| gauge_has_signal(question.campaign, *gauge))
            }
            Change::MoveReadings(_) => {
                (0..question.campaign.gauges.len()).any(|gauge| gauge_has_signal(question.campaign, gauge))
            }
        }
    }

    /// Cost of a fit without the mistake, if it explains the readings, and true if nothing is left to doubt.
    fn explains<const N: usize>(&self, question: &Question<'_, N>, options: &IdentifyOptions) -> Option<(f64, bool)> {
        let plain = IdentifyOptions { has_two_regimes: false, has_hysteresis: false, ..options.clone() };
        let campaign = self.taken_back(question.campaign);
        let found = find(question.on(&campaign), &plain).ok().filter(is_explained)?;
        Some((found.agreement.cost(), !is_doubtful(&found)))
    }

    fn error<const N: usize>(&self, campaign: &Campaign<N>) -> Option<FileError> {
        let load = |column: &usize| campaign.wrench.names[*column].to_owned();
        let gauge = |gauge: &usize| format!("{}_um", campaign.gauges[*gauge].name);
        let (names, read): (Vec<String>, Option<usize>) = match &self.change {
            Change::Load { columns, .. } => (columns.iter().map(load).collect(), None),
            Change::Gauge { gauge: read, .. } => (vec![gauge(read)], Some(*read)),
            Change::SwapGauges(one, other) => ([one, other].map(gauge).into(), Some(*one)),
            Change::MoveReadings(_) => ((0..campaign.gauges.len()).map(|each| gauge(&each)).collect(), None),
        };
        let is_read = |window: &&Window<N>| read.is_none_or(|gauge| window.readings_m[gauge].is_some());
        Some(campaign.error(campaign.windows.iter().find(is_read)?, &names.join(", "), &self.reason))
    }
}

/// True if any of these columns of the load changes by more than its noise, and by more than a small share of the others of its kind: a zero that
/// drifts is no load.
fn any_load_has_signal<const N: usize>(question: &Question<'_, N>, columns: &[usize]) -> bool {
    let sds = question.load_variances().map(f64::sqrt);
    let measured: Vec<_> = question.campaign.windows.iter().map(|window| window.load).collect();
    let smooth = smooth_loads(question.campaign, &measured);
    let of_window =
        |(window, load): (&Window<N>, Vector6<f64>)| question.campaign.wrench.maps[window.pose].columns_of_load * load;
    let smooth: Vec<_> = question.campaign.windows.iter().zip(smooth).map(of_window).collect();
    let of_column = |column: usize| changes(question.campaign, |window| Some(smooth[window][column] / sds[column])).0;
    let all = ALL.map(of_column);
    let largest = |column: usize| {
        let kind = if column < 3 { 0..3 } else { 3..6 };
        kind.map(|other| all[other] * (sds[other] / sds[column]).powi(2)).fold(0.0, f64::max)
    };
    columns.iter().any(|column| all[*column] > SIGNAL && all[*column] > LEAST_OF_LARGEST * largest(*column))
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
        (squares_about_mean(&values), values.len())
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
        Ok(found) if !is_doubtful(found) => None,
        Ok(found) => Some(found.agreement.cost()),
        Err(IdentifyError::Fit { .. } | IdentifyError::Unseen { .. }) => Some(f64::INFINITY),
        Err(_) => None,
    };
    let Some(cost) = cost else { return found };
    let mended = |mistake: &Mistake| {
        let (of_mended, is_clean) = mistake.explains(question, options)?;
        (cost - of_mended > LEAST_GAIN && (is_clean || cost > LEAST_FACTOR * of_mended)).then_some(of_mended)
    };
    // A fit that fails costs all, though its springs, negative ones, leave little.
    let of_plain = after_steps(question).filter(|_| cost.is_finite());
    let chi2 = of_plain.map_or(f64::INFINITY, |solved| solved.rows.chi_squared());
    let explaining = likely(question, chi2).into_iter().filter_map(|mistake| Some((mended(&mistake)?, mistake)));
    match simplest(explaining, LEAST_GAIN).and_then(|mistake| mistake.error(question.campaign)) {
        Some(error) => Err(error.into()),
        None => found.map_err(|error| first_quiet(question.campaign).map_or(error, IdentifyError::from)),
    }
}

/// Mistakes without which a few steps of a plain fit go below this chi-squared with positive compliances, the likeliest first; of those that are as
/// likely the simplest.
fn likely<const N: usize>(question: &Question<'_, N>, most: f64) -> Vec<Mistake> {
    let all = Mistake::all(question.campaign).filter(|mistake| mistake.has_signal(question));
    let promising = all.enumerate().filter_map(|(rank, mistake)| {
        let mended = mistake.taken_back(question.campaign);
        Some(Tried { chi2: after_one_step(&question.on(&mended))?, rank, mistake })
    });
    let tried = best_of(promising.collect(), MOST_PROMISING).into_iter().filter_map(|tried| {
        let mended = tried.mistake.taken_back(question.campaign);
        let question = question.on(&mended);
        let solved = after_steps(&question).filter(|solved| check_positive(&question, solved).is_ok())?;
        let chi2 = solved.rows.chi_squared();
        (chi2 < most).then_some(Tried { chi2, ..tried })
    });
    let mut best = best_of(tried.collect(), MOST_TRIED);
    let least = best.first().map_or(0.0, |first| first.chi2);
    best.sort_by_key(|tried| if tried.chi2 < least + LEAST_GAIN { tried.rank } else { usize::MAX });
    best.into_iter().map(|tried| tried.mistake).collect()
}

/// A mistake, its place among all, and chi-squared of all readings without it.
struct Tried {
    chi2: f64,
    rank: usize,
    mistake: Mistake,
}

/// The first by their chi-squared.
fn best_of(mut tried: Vec<Tried>, most: usize) -> Vec<Tried> {
    tried.sort_by(|one, other| one.chi2.total_cmp(&other.chi2));
    tried.truncate(most);
    tried
}

/// Chi-squared of all readings after a step from the robot file's springs, to first order.
fn after_one_step<const N: usize>(question: &Question<'_, N>) -> Option<f64> {
    let Solved { rows, seen, .. } =
        rounds(question, &Choice::all(question.campaign), State::start(question), 1).ok()?;
    let step = seen.scored_step(&rows);
    Some((&rows.residuals - &rows.derivatives * step).norm_squared())
}

/// The fit of all readings after some steps from the robot file's springs.
fn after_steps<const N: usize>(question: &Question<'_, N>) -> Option<Solved<N>> {
    rounds(question, &Choice::all(question.campaign), State::start(question), STEPS).ok()
}

/// True if the readings contradict what was found, all of them or those of a gauge, or if its springs are not the robot file's by far.
fn is_doubtful<const N: usize>(found: &Found<'_, N>) -> bool {
    is_rejected(found) || !found.not_positive.is_empty() || !found.uneven().is_empty() || !found.far_off().is_empty()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::springs::campaigns::{Bench, FINE, campaign_a, never, normal, seeded};
    use crate::springs::identify::weak::options;

    #[test]
    fn a_gauge_that_is_reversed_makes_a_spring_negative() {
        let mut bench = campaign_a(FINE);
        let mut random = seeded(4);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        let is_positive = |bench: &Bench<3>| {
            let question = bench.question();
            check_positive(&question, &after_steps(&question).unwrap()).is_ok()
        };
        assert!(is_positive(&bench));
        for window in &mut bench.campaign.windows {
            window.readings_m.iter_mut().flatten().for_each(|reading| *reading = -*reading);
        }
        assert!(!is_positive(&bench));
    }

    /// Noise that is stated a quarter too small is no outlier, and cannot be chance.
    #[test]
    fn readings_that_scatter_by_too_much_are_rejected() {
        let is_rejected = |stated: f64| {
            let mut bench = campaign_a(FINE);
            let mut random = seeded(4);
            let truth = bench.true_springs(&mut random);
            bench.measure(&truth, &mut random, 0.0, never);
            bench.campaign.noise.gauge_um *= stated;
            bench.campaign.noise.force_n *= stated;
            bench.campaign.noise.moment_nm *= stated;
            is_rejected(&find(bench.question(), &options()).unwrap())
        };
        assert!(!is_rejected(1.0) && is_rejected(0.75));
    }

    #[test]
    fn noise_is_no_signal_of_a_gauge() {
        for seed in 0..20 {
            let mut random = seeded(seed);
            let mut bench: Bench<3> = campaign_a(FINE);
            for window in &mut bench.campaign.windows {
                window.readings_m[0] = Some(FINE.gauge_um * 1e-6 * normal(&mut random));
            }
            assert!(!gauge_has_signal(&bench.campaign, 0), "{seed}");
            // One window of 99 is off by 20 standard deviations: 400, less its share of the mean of eleven.
            bench.campaign.windows[4].readings_m[0] = Some(20e-6);
            assert!(gauge_has_signal(&bench.campaign, 0), "{seed}");
        }
    }
}
