//! Columns with a wrong sign or unit: looked for where the readings contradict a campaign as it is,
//! and named where they do not contradict it with the column mended.
//!
//! A column is accused only if it carries a signal, the campaign as it is is rejected, the mended
//! one is not, and it explains the readings far better. Noise with the other sign is noise.

use std::iter;

use nalgebra::{Matrix6, Vector6};

use super::doubts::MAX_OUTLIERS;
use super::quiet::first_quiet;
use super::{IdentifiedSprings, IdentifyError, IdentifyOptions, find};
use crate::fit::goodness::{MIN_P, simplest};
use crate::fit::statistics::{chi_squared_above, float, squares_about_mean};
use crate::measurements::FileError;
use crate::measurements::mistaken_columns::{ALL, MistakenColumns, SWAPPED};
use crate::measurements::moved_rows::MovedRows;
use crate::measurements::springs::{Campaign, Window};
use crate::springs::active_set::ActiveSet;
use crate::springs::decision::check_positive;
use crate::springs::fit::{Solution, rounds};
use crate::springs::problem::SpringsProblem;
use crate::springs::smooth_loads::smooth_loads;
use crate::springs::state::FitState;

/// Chi-squared per degree of freedom up to which a mended campaign is not rejected.
const EXPLAINED: f64 = 1.5;
/// Decrease of the cost that a mended column must bring, and smallest factor.
const MIN_GAIN: f64 = 50.0;
const MIN_FACTOR: f64 = 1.2;
/// Sum of the squares of a column's changes, in variances of its noise, above which it carries a
/// signal.
const SIGNAL: f64 = 100.0;
/// Smallest share that it has of the largest such sum of a column of its kind, in N^2 or (N m)^2.
const MIN_OF_LARGEST: f64 = 0.01;
/// Chi-squared per degree of freedom of a plain fit that is grossly wrong, and smallest factor by
/// which a mended column makes it smaller.
const GROSS: f64 = 10.0;
const GROSS_FACTOR: f64 = 5.0;
/// Number of mistakes, the first after one step of a fit, that further steps are made for;
/// linearizations of these fits; and number of those that are tried.
const MAX_PROMISING: usize = 10;
const STEPS: u32 = 4;
const MAX_TRIED: usize = 3;

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
struct CampaignMistake {
    change: Change,
    reason: String,
}

impl CampaignMistake {
    /// All that are possible in a campaign, the simplest first.
    fn all<const N: usize>(campaign: &Campaign<N>) -> impl Iterator<Item = Self> {
        let gauges = campaign.gauges.len();
        let pairs =
            (0..gauges).flat_map(move |one| (one + 1..gauges).map(move |other| (one, other)));
        let pairs = pairs.map(move |(one, other)| Self {
            change: Change::SwapGauges(one, other),
            reason: SWAPPED.to_owned(),
        });
        let reversed = "the wrench has the wrong sign: it is the load on the platform, not what the platform pulls with; negate these columns";
        let wrench = iter::once(MistakenColumns::scaled(&ALL, -1.0, reversed))
            .chain(MistakenColumns::all(campaign.wrench.names));
        let rows = MovedRows::ALL.map(|moved| Self {
            change: Change::MoveReadings(moved),
            reason: format!("these columns {moved}"),
        });
        wrench
            .map(Self::of_columns)
            .chain((0..gauges).map(Self::reversed_gauge))
            .chain(pairs)
            .chain(rows)
    }

    fn of_columns(mistaken: MistakenColumns) -> Self {
        Self {
            change: Change::Load {
                columns: mistaken.columns,
                mended: Box::new(mistaken.mended),
            },
            reason: mistaken.reason,
        }
    }

    fn reversed_gauge(gauge: usize) -> Self {
        let reason = "the readings fall where by the others they should rise; the gauge's axis is reversed, or its sign";
        Self {
            change: Change::Gauge {
                gauge,
                factor: -1.0,
            },
            reason: reason.to_owned(),
        }
    }

    /// A campaign without this mistake.
    fn mended<const N: usize>(&self, campaign: &Campaign<N>) -> Campaign<N> {
        let mut campaign = campaign.clone();
        if let Change::MoveReadings(moved) = &self.change {
            let pairs = moved.pairs(&campaign.windows);
            campaign.windows = pairs
                .map(|(set, read)| Window {
                    readings_m: read.readings_m.clone(),
                    ..set.clone()
                })
                .collect();
        }
        for window in &mut campaign.windows {
            match &self.change {
                Change::MoveReadings(_) => {}
                Change::Load { mended, .. } => {
                    window.load = campaign.wrench.maps[window.pose].mended(mended, &window.load);
                }
                Change::Gauge { gauge, factor } => {
                    window.readings_m[*gauge] =
                        window.readings_m[*gauge].map(|reading| reading * factor);
                }
                Change::SwapGauges(one, other) => window.readings_m.swap(*one, *other),
            }
        }
        campaign
    }

    /// True if each of the columns, or of a group of columns one, changes by more than its noise.
    fn has_signal<const N: usize>(&self, problem: &SpringsProblem<'_, N>) -> bool {
        match &self.change {
            Change::Load { columns, .. } => any_load_has_signal(problem, columns),
            Change::Gauge { gauge, .. } => gauge_has_signal(problem.campaign, *gauge),
            Change::SwapGauges(one, other) => [*one, *other]
                .iter()
                .any(|gauge| gauge_has_signal(problem.campaign, *gauge)),
            Change::MoveReadings(_) => (0..problem.campaign.gauges.len())
                .any(|gauge| gauge_has_signal(problem.campaign, gauge)),
        }
    }

    /// Cost of a fit without the mistake, if it explains the readings, and true if nothing is left
    /// to doubt.
    fn explains<const N: usize>(
        &self,
        problem: &SpringsProblem<'_, N>,
        options: &IdentifyOptions,
    ) -> Option<(f64, bool)> {
        let plain = IdentifyOptions {
            has_two_regimes: false,
            has_hysteresis: false,
            ..options.clone()
        };
        let campaign = self.mended(problem.campaign);
        let found = find(problem.with_campaign(&campaign), &plain)
            .ok()
            .filter(is_explained)?;
        Some((found.robust_fit.cost(), !is_doubtful(&found)))
    }

    fn error<const N: usize>(&self, campaign: &Campaign<N>) -> Option<FileError> {
        // The gauge that must have a reading in the row that the error names.
        let read = match &self.change {
            Change::Gauge { gauge: read, .. } | Change::SwapGauges(read, _) => Some(*read),
            Change::Load { .. } | Change::MoveReadings(_) => None,
        };
        let window = campaign
            .windows
            .iter()
            .find(|window| read.is_none_or(|gauge| window.readings_m[gauge].is_some()))?;
        let columns = self.columns(campaign).join(", ");
        Some(campaign.error(window, &columns, &self.reason))
    }

    /// Names of the columns that are wrong.
    fn columns<const N: usize>(&self, campaign: &Campaign<N>) -> Vec<String> {
        let gauges = match &self.change {
            Change::Load { columns, .. } => {
                return columns
                    .iter()
                    .map(|column| campaign.wrench.names[*column].to_owned())
                    .collect();
            }
            Change::Gauge { gauge, .. } => vec![*gauge],
            Change::SwapGauges(one, other) => vec![*one, *other],
            Change::MoveReadings(_) => (0..campaign.gauges.len()).collect(),
        };
        gauges
            .into_iter()
            .map(|gauge| format!("{}_um", campaign.gauges[gauge].name))
            .collect()
    }
}

/// True if any of these columns of the load changes by more than its noise, and by more than a
/// small share of the others of its kind: a zero that drifts is not a load.
fn any_load_has_signal<const N: usize>(problem: &SpringsProblem<'_, N>, columns: &[usize]) -> bool {
    let sds = problem.load_variances().map(f64::sqrt);
    let measured: Vec<_> = problem
        .campaign
        .windows
        .iter()
        .map(|window| window.load)
        .collect();
    let smooth = smooth_loads(problem.campaign, &measured);
    let smooth: Vec<Vector6<f64>> = problem
        .campaign
        .windows
        .iter()
        .zip(smooth)
        .map(|(window, load)| problem.campaign.wrench.maps[window.pose].columns_of_load * load)
        .collect();
    let all = ALL.map(|column| {
        let (squares, _) = changes(problem.campaign, |window| {
            Some(smooth[window][column] / sds[column])
        });
        squares
    });
    columns.iter().any(|column| {
        let kind = if *column < 3 { 0..3 } else { 3..6 };
        let largest = kind
            .map(|other| all[other] * (sds[other] / sds[*column]).powi(2))
            .fold(0.0, f64::max);
        all[*column] > SIGNAL && all[*column] > MIN_OF_LARGEST * largest
    })
}

/// True if the readings of a gauge change by more than their noise.
fn gauge_has_signal<const N: usize>(campaign: &Campaign<N>, gauge: usize) -> bool {
    let noise_m = campaign.noise.gauge_um * 1e-6;
    let (squares, count) = changes(campaign, |window| {
        Some(campaign.windows[window].readings_m[gauge]? / noise_m)
    });
    squares - float(count) > SIGNAL
}

/// Sum of the squares of a value's deviations from its mean in each series, and their number.
fn changes<const N: usize>(
    campaign: &Campaign<N>,
    value: impl Fn(usize) -> Option<f64>,
) -> (f64, usize) {
    let mut squares = 0.0;
    let mut count = 0;
    for series in 0..campaign.series.len() {
        let windows =
            (0..campaign.windows.len()).filter(|window| campaign.windows[*window].series == series);
        let values: Vec<f64> = windows.filter_map(&value).collect();
        squares += squares_about_mean(&values);
        count += values.len();
    }
    (squares, count)
}

/// Refuses a campaign that a few steps of a plain fit contradict grossly, and would not with a
/// column mended: readings of which hardly any agree are not worth a search for those that do.
///
/// # Errors
/// The mistake.
pub(super) fn check_gross<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    options: &IdentifyOptions,
) -> Result<(), IdentifyError> {
    let as_it_is = after_steps(problem);
    if as_it_is
        .as_ref()
        .is_some_and(|solution| solution.rows.chi_squared() <= GROSS * float(solution.degrees()))
    {
        return Ok(());
    }
    let chi2 = as_it_is.map_or(f64::INFINITY, |solution| solution.rows.chi_squared());
    let best = likely(problem, chi2 / GROSS_FACTOR)
        .into_iter()
        .find(|mistake| mistake.explains(problem, options).is_some());
    best.and_then(|mistake| mistake.error(problem.campaign))
        .map_or(Ok(()), |error| Err(error.into()))
}

/// Returns what was found; if the readings contradict it, and would not with a column mended, the
/// error that says which.
///
/// # Errors
/// That of `found`, or the mistake.
pub(super) fn check<'a, const N: usize>(
    found: Result<IdentifiedSprings<'a, N>, IdentifyError>,
    problem: &SpringsProblem<'_, N>,
    options: &IdentifyOptions,
) -> Result<IdentifiedSprings<'a, N>, IdentifyError> {
    let cost = match &found {
        Ok(found) if !is_doubtful(found) => None,
        Ok(found) => Some(found.robust_fit.cost()),
        Err(IdentifyError::Fit { .. } | IdentifyError::Unseen { .. }) => Some(f64::INFINITY),
        Err(_) => None,
    };
    let Some(cost) = cost else { return found };
    // A fit that fails costs all, though its springs, negative ones, leave little.
    let of_plain = after_steps(problem).filter(|_| cost.is_finite());
    let chi2 = of_plain.map_or(f64::INFINITY, |solution| solution.rows.chi_squared());
    let explaining = likely(problem, chi2).into_iter().filter_map(|mistake| {
        let (of_mended, is_clean) = mistake.explains(problem, options)?;
        let is_far_better =
            cost - of_mended > MIN_GAIN && (is_clean || cost > MIN_FACTOR * of_mended);
        is_far_better.then_some((of_mended, mistake))
    });
    match simplest(explaining, MIN_GAIN).and_then(|mistake| mistake.error(problem.campaign)) {
        Some(error) => Err(error.into()),
        None => {
            found.map_err(|error| first_quiet(problem.campaign).map_or(error, IdentifyError::from))
        }
    }
}

/// Mistakes without which a few steps of a plain fit go below this chi-squared with positive
/// compliances, the likeliest first; of those that are as likely the simplest.
fn likely<const N: usize>(problem: &SpringsProblem<'_, N>, most: f64) -> Vec<CampaignMistake> {
    let all = CampaignMistake::all(problem.campaign).filter(|mistake| mistake.has_signal(problem));
    let promising = all.enumerate().filter_map(|(rank, mistake)| {
        let mended = mistake.mended(problem.campaign);
        Some(RankedMistake {
            chi2: after_one_step(&problem.with_campaign(&mended))?,
            rank,
            mistake,
        })
    });
    let tried = best_of(promising.collect(), MAX_PROMISING)
        .into_iter()
        .filter_map(|tried| {
            let mended = tried.mistake.mended(problem.campaign);
            let problem = problem.with_campaign(&mended);
            let solution = after_steps(&problem)
                .filter(|solution| check_positive(&problem, solution).is_ok())?;
            let chi2 = solution.rows.chi_squared();
            (chi2 < most).then_some(RankedMistake { chi2, ..tried })
        });
    let mut best = best_of(tried.collect(), MAX_TRIED);
    let least = best.first().map_or(0.0, |first| first.chi2);
    best.sort_by_key(|tried| {
        if tried.chi2 < least + MIN_GAIN {
            tried.rank
        } else {
            usize::MAX
        }
    });
    best.into_iter().map(|tried| tried.mistake).collect()
}

/// A mistake, its place among all, and chi-squared of all readings without it.
struct RankedMistake {
    chi2: f64,
    rank: usize,
    mistake: CampaignMistake,
}

/// The first by their chi-squared.
fn best_of(mut tried: Vec<RankedMistake>, most: usize) -> Vec<RankedMistake> {
    tried.sort_by(|one, other| one.chi2.total_cmp(&other.chi2));
    tried.truncate(most);
    tried
}

/// Chi-squared of all readings after a step from the robot file's springs, to first order.
fn after_one_step<const N: usize>(problem: &SpringsProblem<'_, N>) -> Option<f64> {
    let Solution { rows, seen, .. } = rounds(
        problem,
        &ActiveSet::all(problem.campaign),
        FitState::start(problem),
        1,
    )
    .ok()?;
    let step = seen.scored_step(&rows);
    Some((&rows.residuals - &rows.derivatives * step).norm_squared())
}

/// The fit of all readings after some steps from the robot file's springs.
fn after_steps<const N: usize>(problem: &SpringsProblem<'_, N>) -> Option<Solution<N>> {
    rounds(
        problem,
        &ActiveSet::all(problem.campaign),
        FitState::start(problem),
        STEPS,
    )
    .ok()
}

/// True if the readings contradict what was found, all of them or those of a gauge, or if its
/// springs are not the robot file's by far.
fn is_doubtful<const N: usize>(found: &IdentifiedSprings<'_, N>) -> bool {
    is_rejected(found)
        || !found.not_positive.is_empty()
        || !found.uneven().is_empty()
        || !found.far_off().is_empty()
}

/// True if the readings contradict what was found.
fn is_rejected<const N: usize>(found: &IdentifiedSprings<'_, N>) -> bool {
    let solution = &found.robust_fit.solution;
    let is_unlikely = chi_squared_above(solution.rows.chi_squared(), solution.degrees()) < MIN_P;
    let is_wrong = found.intervals.is_scaled && !is_explained(found);
    (is_unlikely && !found.intervals.is_scaled) || is_wrong || has_many_outliers(found)
}

fn is_explained<const N: usize>(found: &IdentifiedSprings<'_, N>) -> bool {
    let solution = &found.robust_fit.solution;
    solution.rows.chi_squared() <= EXPLAINED * float(solution.degrees())
        && !has_many_outliers(found)
}

fn has_many_outliers<const N: usize>(found: &IdentifiedSprings<'_, N>) -> bool {
    let refused = found.robust_fit.refused.len();
    let readings = found.robust_fit.solution.rows.residuals.len() + refused;
    float(refused) > MAX_OUTLIERS * float(readings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::springs::fixture::{FINE, TestBench, campaign_a, never, normal, seeded};
    use crate::springs::identify::weak_campaigns::options;

    fn measured() -> TestBench<3> {
        let mut bench = campaign_a(FINE);
        let mut random = seeded(4);
        let truth = bench.true_springs(&mut random);
        bench.measure(&truth, &mut random, 0.0, never);
        bench
    }

    fn is_positive(bench: &TestBench<3>) -> bool {
        let problem = bench.problem();
        check_positive(&problem, &after_steps(&problem).unwrap()).is_ok()
    }

    #[test]
    fn a_gauge_that_is_reversed_makes_a_spring_negative() {
        let mut bench = measured();
        assert!(is_positive(&bench));
        for window in &mut bench.campaign.windows {
            window
                .readings_m
                .iter_mut()
                .flatten()
                .for_each(|reading| *reading = -*reading);
        }
        assert!(!is_positive(&bench));
    }

    /// Noise that is stated a quarter too small is not an outlier, and cannot be chance.
    #[test]
    fn readings_that_scatter_by_too_much_are_rejected() {
        for (stated, expected) in [(1.0, false), (0.75, true)] {
            let mut bench = measured();
            bench.campaign.noise.gauge_um *= stated;
            bench.campaign.noise.force_n *= stated;
            bench.campaign.noise.moment_nm *= stated;
            let found = find(bench.problem(), &options()).unwrap();
            assert_eq!(is_rejected(&found), expected, "{stated}");
        }
    }

    #[test]
    fn noise_is_no_signal_of_a_gauge() {
        for seed in 0..20 {
            let mut random = seeded(seed);
            let mut bench: TestBench<3> = campaign_a(FINE);
            for window in &mut bench.campaign.windows {
                window.readings_m[0] = Some(FINE.gauge_um * 1e-6 * normal(&mut random));
            }
            assert!(!gauge_has_signal(&bench.campaign, 0), "{seed}");
            // One window of 99 is off by 20 standard deviations: 400, less its share of the mean of
            // eleven.
            bench.campaign.windows[4].readings_m[0] = Some(20e-6);
            assert!(gauge_has_signal(&bench.campaign, 0), "{seed}");
        }
    }
}
