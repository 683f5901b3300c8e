//! Columns with a wrong sign or unit: looked for where the readings contradict a campaign as it is, and told where they do not contradict it
//! with the column mended.
//!
//! A column is accused only if it carries a signal, the campaign as it is is rejected, the mended one is not, and it explains the readings far
//! better. Noise with the other sign is noise.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

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
/// Number of mistakes, the first after one step of a fit, that further steps are made for; linearisations of these fits; and number of those that
/// are tried.
const MOST_PROMISING: usize = 10;
const STEPS: u32 = 4;
const MOST_TRIED: usize = 3;
/// Newtons of a kilogram's weight.
const NEWTONS_PER_KG: f64 = 9.806_65;
/// Forces, moments and all of the wrench.
const FORCES: [usize; 3] = [0, 1, 2];
const MOMENTS: [usize; 3] = [3, 4, 5];
const ALL: [usize; 6] = [0, 1, 2, 3, 4, 5];
const SWAPPED: &str = "these two columns are swapped";

/// Change of columns of a table.
enum Change {
    /// The wrench, made of these columns, is this matrix times that of the table.
    Load {
        columns: Vec<usize>,
        mended: Matrix6<f64>,
    },
    Gauge {
        gauge: usize,
        factor: f64,
    },
    SwapGauges(usize, usize),
}

/// Change that mends a table, and the sentence for it.
struct Mistake {
    change: Change,
    reason: String,
}

impl Mistake {
    /// All of them, the simplest first.
    fn all(gauges: usize) -> impl Iterator<Item = Self> {
        let of = |columns: &[usize], factor: f64, reason: &str| {
            let factors = Vector6::from_fn(|column, _| if columns.contains(&column) { factor } else { 1.0 });
            let mended = Matrix6::from_diagonal(&factors);
            Self { change: Change::Load { columns: columns.to_vec(), mended }, reason: reason.to_owned() }
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
            reason: "the readings fall where by the others they should rise; the gauge's axis is reversed, or its sign"
                .to_owned(),
        };
        let pairs = (0..gauges).flat_map(move |one| (one + 1..gauges).map(move |other| (one, other)));
        let pairs =
            pairs.map(move |(one, other)| Self { change: Change::SwapGauges(one, other), reason: SWAPPED.to_owned() });
        groups.into_iter().chain(single).chain((0..gauges).map(gauge)).chain(orders()).chain(pairs)
    }

    /// The columns of the wrench in another order, or along other axes.
    fn ordered(forces: &Matrix3<f64>, moments: &Matrix3<f64>) -> Self {
        let mut mended = Matrix6::zeros();
        mended.fixed_view_mut::<3, 3>(0, 0).copy_from(forces);
        mended.fixed_view_mut::<3, 3>(3, 3).copy_from(moments);
        let touched = |column: &usize| mended[(*column, *column)] < 1.0;
        let columns: Vec<usize> = ALL.into_iter().filter(touched).collect();
        let swapped = columns.len() == 2 && mended.iter().all(|entry| *entry >= 0.0);
        let reason = if swapped {
            SWAPPED.to_owned()
        } else {
            let written: Vec<String> = columns.iter().map(|column| signed(&mended.row(*column).transpose())).collect();
            format!("the wrench is along other axes than the world's; write {} in their place", written.join(", "))
        };
        Self { change: Change::Load { columns, mended }, reason }
    }

    fn taken_back<const N: usize>(&self, campaign: &Campaign<N>) -> Campaign<N> {
        let mut campaign = campaign.clone();
        for window in &mut campaign.windows {
            match &self.change {
                Change::Load { mended, .. } => window.load = mended * window.load,
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
            Change::SwapGauges(one, other) => ([one, other].map(gauge).into(), Some(*one)),
        };
        let is_read = |window: &&Window<N>| read.is_none_or(|gauge| window.readings_m[gauge].is_some());
        Some(campaign.error(campaign.windows.iter().find(is_read)?, &names.join(", "), &self.reason))
    }
}

/// Orders of the columns of forces, of moments, and axes of the whole wrench, other than the right ones.
fn orders() -> impl Iterator<Item = Mistake> {
    let all = signed_permutations();
    let is_other = |matrix: &Matrix3<f64>| *matrix != Matrix3::identity();
    let plain: Vec<_> = all.iter().filter(|matrix| is_other(matrix) && matrix.min() >= 0.0).copied().collect();
    let turned: Vec<_> = all.into_iter().filter(|matrix| is_other(matrix) && matrix.determinant() > 0.0).collect();
    let swapped = plain.clone().into_iter().filter(|matrix| matrix.determinant() < 0.0);
    let one = plain.clone().into_iter().map(|matrix| Mistake::ordered(&matrix, &Matrix3::identity()));
    let other = plain.into_iter().map(|matrix| Mistake::ordered(&Matrix3::identity(), &matrix));
    one.chain(other).chain(swapped.chain(turned).map(|matrix| Mistake::ordered(&matrix, &matrix)))
}

/// The 48 matrices that put three axes in another order, and reverse some.
fn signed_permutations() -> Vec<Matrix3<f64>> {
    let order = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let signs = (0..8_u8).map(|bits| Vector3::from_fn(|axis, _| if bits >> axis & 1 == 1 { -1.0 } else { 1.0 }));
    signs
        .flat_map(|signs| {
            order.map(|order| Matrix3::from_fn(|row, column| if order[row] == column { signs[row] } else { 0.0 }))
        })
        .collect()
}

/// The one column that a row of a signed permutation takes, with its sign.
fn signed(row: &Vector6<f64>) -> String {
    let column = row.iamax();
    format!("{}{}", if row[column] < 0.0 { "-" } else { "" }, LOAD[column])
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
    let explaining = likely(question, chi2).into_iter().filter_map(|mistake| Some((mended(&mistake)?, mistake)));
    let better = |one: (f64, Mistake), other: (f64, Mistake)| if other.0 < one.0 - LEAST_GAIN { other } else { one };
    let best = explaining.reduce(better);
    match best.and_then(|(_, mistake)| mistake.error(question.campaign)) {
        Some(error) => Err(error.into()),
        None => found,
    }
}

/// Mistakes without which a few steps of a plain fit go below this chi-squared with positive compliances, the likeliest first; of those that are as
/// likely the simplest.
fn likely<const N: usize>(question: &Question<'_, N>, most: f64) -> Vec<Mistake> {
    let all = Mistake::all(question.campaign.gauges.len()).filter(|mistake| mistake.has_signal(question));
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
