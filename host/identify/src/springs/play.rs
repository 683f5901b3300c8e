//! The jump `[T 5.2.2, 6.1]`: play of the joint of cluster 3, found as windows beyond a force of
//! its links.
//!
//! The joint rests at one end of its play by the preload `P0`, the sum of the tensions of links 31,
//! 32, 33 that the weight causes. It crosses where that sum, with the sum `F3` by the load, changes
//! its sign: at one `F3` while the force rises, and at another, with hysteresis, while it falls.
//! Every pair of such thresholds is tried, one projection each. A window inside the crossing
//! belongs to neither side.

mod crossing;

use super::active_set::ActiveSet;
use super::blocks::covariance;
use super::fit::{Solution, SpringsError, fit, series_errors};
use super::linearize::LinearizedWindow;
use super::problem::SpringsProblem;
use super::robust_fit::{RobustFit, TUKEY, deviations};
use super::state::FitState;
use crate::fit::statistics::float;
use crossing::{Crossing, thresholds};

/// Decrease of chi-squared that a play must bring: three unknowns.
const MIN_GAIN: f64 = 50.0;

/// The same without the windows inside the crossing. Less is asked: readings that disagree as a
/// whole without the play cost no more than if they were refused, so that a real one may explain
/// little.
const MIN_GAIN_OUTSIDE: f64 = 25.0;

/// Decrease of chi-squared that leaving out a window beside a crossing must bring.
const MIN_GAIN_OF_WINDOW: f64 = 30.0;

/// Most readings of the windows beside the crossings that are refused while those inside are looked
/// for.
const MAX_DISTURBED: usize = 4;

/// Standard deviations of the cluster force that an interval of the preload is wider on either
/// side.
const MARGIN_SD: f64 = 3.0;

/// Rounds of looking for the thresholds again with the play fitted.
const MAX_ROUNDS: u32 = 4;

/// The play as it was found.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FoundPlay {
    /// Play of the joint, m.
    pub(super) gap_m: f64,
    /// Sign of the elongation of the links beyond the jump.
    pub(super) sign: f64,
    /// Interval of the preload, N: while the force rises, while it falls; `None` where no window of
    /// the stroke is beyond the jump.
    pub(super) preload_n: [Option<[f64; 2]>; 2],
    /// Windows inside a crossing, which belong to neither side.
    pub(super) inside: Vec<usize>,
}

/// Looks for a play, and fits with it where it is there; `without` is the fit without it.
pub(super) fn with_play<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    without: &RobustFit<N>,
    is_robust: bool,
) -> Result<Option<(RobustFit<N>, FoundPlay)>, SpringsError> {
    let mut active = without.active.with_all_readings_but(problem.campaign, &[]);
    let Some(mut crossing) = thresholds(problem, &active, &without.solution) else {
        return Ok(None);
    };
    let mut found = None;
    for _ in 0..MAX_ROUNDS {
        active.is_crossed = crossing.is_crossed(active.is_crossed.len());
        let start = FitState {
            elongation_m: 0.0,
            ..without.solution.state.clone()
        };
        let robust_fit = RobustFit::find(problem, &active, start, is_robust)?;
        // Windows that disagree as a whole may only be on the wrong side.
        let again = with_whole_windows(&robust_fit.active, problem);
        let next = thresholds(problem, &again, &robust_fit.solution);
        found = Some(robust_fit);
        match next {
            Some(next) if next != crossing => crossing = next,
            _ => break,
        }
    }
    let Some(robust_fit) = found else {
        return Ok(None);
    };
    let Some(robust_fit) = without_inside(problem, &crossing, robust_fit, is_robust)? else {
        return Ok(None);
    };
    let (robust_fit, inside) = robust_fit;
    let gap_m = robust_fit.solution.state.elongation_m * crossing.sign;
    if gap_m <= 0.0 || !is_better(problem, without, &robust_fit, &inside, is_robust)? {
        return Ok(None);
    }
    let preload_n =
        [0, 1].map(|stroke| preload(problem, &crossing, &robust_fit.solution, &inside, stroke));
    if preload_n == [None, None] {
        return Ok(None);
    }
    Ok(Some((
        robust_fit,
        FoundPlay {
            gap_m,
            sign: crossing.sign,
            preload_n,
            inside,
        },
    )))
}

/// The readings of an active set, and all of every window that has lost a third of them.
fn with_whole_windows<const N: usize>(
    active: &ActiveSet,
    problem: &SpringsProblem<'_, N>,
) -> ActiveSet {
    let mut active = active.clone();
    for (weights, window) in active.weights.iter_mut().zip(&problem.campaign.windows) {
        let read = window.readings_m.iter().flatten().count();
        let lost = weights
            .iter()
            .zip(&window.readings_m)
            .filter(|(weight, reading)| reading.is_some() && **weight <= 0.0);
        if lost.count() * 3 >= read {
            weights.fill(1.0);
        }
    }
    active
}

/// Leaves out the windows inside the crossing: beside each threshold none, the last before or the
/// first behind, that which brings most.
fn without_inside<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    crossing: &Crossing,
    robust_fit: RobustFit<N>,
    is_robust: bool,
) -> Result<Option<(RobustFit<N>, Vec<usize>)>, SpringsError> {
    let beside = [0, 1].map(|stroke| crossing.beside(stroke));
    let mut active = robust_fit.active.clone();
    for window in beside.iter().flatten().flatten() {
        active.weights[*window].fill(1.0);
    }
    let mut best: Option<(f64, Vec<usize>, ActiveSet)> = None;
    for rising in [None, beside[0][0], beside[0][1]] {
        for falling in [None, beside[1][0], beside[1][1]] {
            let inside: Vec<usize> = rising.into_iter().chain(falling).collect();
            let mut tried = active.clone();
            inside
                .iter()
                .for_each(|window| tried.weights[*window].fill(0.0));
            let windows: Vec<usize> = beside.iter().flatten().flatten().copied().collect();
            let most = if is_robust { MAX_DISTURBED } else { 0 };
            let start = robust_fit.solution.state.clone();
            let Ok(cost) = cost_of_windows(problem, &mut tried.clone(), start, &windows, most)
            else {
                continue;
            };
            let cost = cost + MIN_GAIN_OF_WINDOW * float(inside.len());
            if best.as_ref().is_none_or(|(least, ..)| cost < *least) {
                best = Some((cost, inside, tried));
            }
        }
    }
    let Some((_, inside, _)) = best else {
        return Ok(None);
    };
    if inside.is_empty() {
        return Ok(Some((robust_fit, inside)));
    }
    let active = robust_fit
        .active
        .with_all_readings_but(problem.campaign, &inside);
    if !active.has_play() {
        return Ok(None);
    }
    let start = robust_fit.solution.state;
    Ok(Some((
        RobustFit::find(problem, &active, start, is_robust)?,
        inside,
    )))
}

/// Smallest chi-squared of an active set, with every reading of these windows that is refused at
/// the limit, at most so many: a disturbed reading does not put its window inside a crossing.
fn cost_of_windows<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &mut ActiveSet,
    mut start: FitState<N>,
    windows: &[usize],
    most: usize,
) -> Result<f64, SpringsError> {
    let mut least = f64::INFINITY;
    for refused in 0..=most {
        let solution = fit(problem, active, start)?;
        least = least.min(solution.rows.chi_squared() + TUKEY * TUKEY * float(refused));
        let deviations = deviations(problem, active, &solution);
        let readings = windows
            .iter()
            .flat_map(|window| (0..active.weights[*window].len()).map(|gauge| (*window, gauge)));
        let used = readings.filter(|(window, gauge)| active.weights[*window][*gauge] > 0.0);
        let of_used = used.map(|(window, gauge)| (deviations[window][gauge].abs(), window, gauge));
        let worst = of_used
            .filter(|(deviation, ..)| *deviation > TUKEY)
            .max_by(|one, other| one.0.total_cmp(&other.0));
        let Some((_, window, gauge)) = worst else {
            break;
        };
        active.weights[window][gauge] = 0.0;
        start = solution.state;
    }
    Ok(least)
}

/// True if a play is better than none: by all readings, by those outside the crossing, by those
/// that agree with it, and by series that are left out.
fn is_better<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    without: &RobustFit<N>,
    with: &RobustFit<N>,
    inside: &[usize],
    is_robust: bool,
) -> Result<bool, SpringsError> {
    if without.cost() - with.cost() <= MIN_GAIN {
        return Ok(false);
    }
    // The windows inside the crossing are missing in both fits: their disturbed readings are no
    // merit of the play.
    let active = without
        .active
        .with_all_readings_but(problem.campaign, inside);
    let none = RobustFit::find(problem, &active, without.solution.state.clone(), is_robust)?;
    if none.cost() - with.cost() <= MIN_GAIN_OUTSIDE {
        return Ok(false);
    }
    // From the same readings it is the square of the play in its variances.
    let active = ActiveSet {
        is_crossed: vec![false; with.active.is_crossed.len()],
        ..with.active.clone()
    };
    let none = fit(
        problem,
        &active,
        FitState {
            elongation_m: 0.0,
            ..with.solution.state.clone()
        },
    )?;
    let gained = none.rows.chi_squared() - with.solution.rows.chi_squared();
    Ok(gained > MIN_GAIN && predicts_better(problem, (&active, &none), with))
}

/// True if the series that do not cross, or more than one that does, are predicted better by the
/// others with the play than without it, from the same readings.
fn predicts_better<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    (active, none): (&ActiveSet, &Solution<N>),
    with: &RobustFit<N>,
) -> bool {
    let none = series_errors(problem, active, none);
    let with = series_errors(problem, &with.active, &with.solution);
    let (Some(none), Some(with)) = (none, with) else {
        return false;
    };
    let pairs = none
        .into_iter()
        .zip(with)
        .filter_map(|(none, with)| Some((none.left_out?, with.left_out?)));
    let (none, with) = pairs.fold((0.0, 0.0), |sums, pair| (sums.0 + pair.0, sums.1 + pair.1));
    with <= none
}

/// Interval of the preload by the windows beside a crossing, N; `None` if no window of the stroke
/// is beyond.
fn preload<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    crossing: &Crossing,
    solution: &Solution<N>,
    inside: &[usize],
    stroke: usize,
) -> Option<[f64; 2]> {
    let [before, behind] = crossing.sides(stroke);
    // Without a window before it the joint has crossed somewhere above no force at all.
    let [near, near_sd] = nearest_force(problem, solution, inside, &before).unwrap_or_default();
    let [far, far_sd] = nearest_force(problem, solution, inside, &behind)?;
    // The preload is minus the force that takes it away.
    let ends = [
        -(near - crossing.sign * MARGIN_SD * near_sd),
        -(far + crossing.sign * MARGIN_SD * far_sd),
    ];
    Some([ends[0].min(ends[1]), ends[0].max(ends[1])])
}

/// Cluster force of the nearest window of a side that is clear of the crossing, and its standard
/// deviation, N.
fn nearest_force<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    solution: &Solution<N>,
    inside: &[usize],
    side: &[usize],
) -> Option<[f64; 2]> {
    let outside = side.iter().filter(|window| !inside.contains(window));
    let clear: Vec<&LinearizedWindow> = outside
        .filter_map(|window| {
            solution
                .linearized
                .iter()
                .find(|linearized| linearized.window == *window)
        })
        .collect();
    // A window that cannot tell its side from the middle of the play may be inside the crossing:
    // the next one is the end.
    let is_sure = clear
        .first()
        .is_some_and(|linearized| tells_its_side(problem, linearized, solution.state.elongation_m));
    clear
        .get(usize::from(!is_sure))
        .or(clear.last())
        .map(|linearized| linearized.cluster_3_n)
}

/// True if half the play would stand out in the readings of this window alone, as a window inside a
/// crossing must to be left out.
fn tells_its_side<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &LinearizedWindow,
    elongation_m: f64,
) -> bool {
    let covariance = covariance(
        &linearized.load,
        &linearized.variances,
        &problem.load_variances(),
    );
    let play = linearized.play() * (0.5 * elongation_m);
    covariance
        .cholesky()
        .is_some_and(|factor| play.dot(&factor.solve(&play)) > MIN_GAIN_OF_WINDOW)
}

#[cfg(test)]
mod tests;
