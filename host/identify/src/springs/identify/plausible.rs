//! Campaigns that cannot be what they say: refused before a fit, by line and column.

use gantry_tau_machine::elastic::ElasticMachine;
use gantry_tau_machine::elastic::backlash::Backlash;
use nalgebra::{DVector, Vector3};

use crate::fit::statistics::{float, median};
use crate::measurements::FileError;
use crate::measurements::repeated::{is_same, resolution};
use crate::measurements::springs::{Campaign, Window};
use crate::springs::linearize::LinearizedWindow;
use crate::springs::problem::SpringsProblem;

/// Largest distance between the pose that the set-up names and the one by the axes, m, and largest
/// turn, rad.
const FAR_M: f64 = 0.05;
const TURNED_RAD: f64 = 0.1;
/// Smallest change of the load in a series, in standard deviations of its noise.
const MIN_LOAD_SD: f64 = 5.0;
/// Largest factor between the changes of a gauge's readings and those that the robot file predicts.
/// A wrong unit is a factor of a thousand.
const MAX_FACTOR: f64 = 200.0;
/// Share of the changes that the robot file predicts below which a gauge shows nothing, and
/// standard deviations by which it must be below.
const MIN_SHARE: f64 = 0.25;
const SURE_SD: f64 = 3.0;
/// Equal readings that are looked at, and the sum of squares of the changes that they hide at
/// least, in variances of the noise.
const MANY: usize = 3;
const HIDDEN: f64 = 30.0;
/// Share of each compliance by which the robot file's may be wrong.
const WRONG: f64 = 0.5;
/// Smallest share of the squares of the predicted changes that is left then; of one spring it is a
/// quarter.
const MIN_SURE: f64 = 0.1;

/// Checks poses, loads and gauges of a campaign.
///
/// # Errors
/// [`FileError`], naming line, column and what to do.
pub(super) fn check<const N: usize>(problem: &SpringsProblem<'_, N>) -> Result<(), FileError> {
    poses(problem)?;
    loads(problem.campaign)?;
    problem.campaign.check_repeated()
}

/// Axes of a row must put the machine where the set-up says it stood.
fn poses<const N: usize>(problem: &SpringsProblem<'_, N>) -> Result<(), FileError> {
    let campaign = problem.campaign;
    let machine = ElasticMachine::new(*problem.geometry, problem.file.machine, Backlash::NONE);
    for window in &campaign.windows {
        let (name, pose) = &campaign.poses[window.pose];
        let found = problem.unloaded(&machine, window).map_err(|error| {
            let reason = format!("with these axes the robot file's machine does not reach the pose {name:?}: {error}; check q, and the robot file");
            campaign.error(window, "pose", reason)
        })?;
        let away = (found.pose.translation_m - pose.position_m).norm();
        let turned = found
            .pose
            .rotation
            .angle_to(&nalgebra::UnitQuaternion::from_matrix(&pose.rotation));
        if away > FAR_M || turned > TURNED_RAD {
            let reason = format!(
                "with these axes the robot file's machine stands {:.0} mm and {:.0} mrad away from the pose {name:?}; check q, the pose, and the robot file",
                away * 1e3,
                turned * 1e3
            );
            return Err(campaign.error(window, "pose", reason));
        }
    }
    Ok(())
}

/// A series must change its load.
fn loads<const N: usize>(campaign: &Campaign<N>) -> Result<(), FileError> {
    for (series, name) in campaign.series.iter().enumerate() {
        let windows: Vec<_> = campaign
            .windows
            .iter()
            .filter(|window| window.series == series)
            .collect();
        let Some(first) = windows.first() else {
            continue;
        };
        let largest = windows
            .iter()
            .map(|window| change_sd(campaign, first, window))
            .fold(0.0, f64::max);
        if largest < MIN_LOAD_SD {
            return Err(campaign.error(
                first,
                "series",
                format!(
                    "the load of {name:?} changes by {largest:.1} standard deviations of its noise only: its strap pulls nothing; measure it again, or remove it"
                ),
            ));
        }
    }
    Ok(())
}

/// Change of the load from one window to another, in standard deviations of its noise: the largest
/// of force, moment and pushes.
fn change_sd<const N: usize>(campaign: &Campaign<N>, one: &Window<N>, other: &Window<N>) -> f64 {
    let change = other.load - one.load;
    let force = Vector3::new(change[0], change[1], change[2]) / campaign.noise.force_n;
    let moment = Vector3::new(change[3], change[4], change[5]) / campaign.noise.moment_nm;
    let pushed = (other.pushes_n - one.pushes_n).amax() / campaign.noise.force_n;
    force.norm().max(moment.norm()).max(pushed)
}

/// Checks the readings of each gauge against what the robot file's springs predict, where the
/// windows are linearized.
///
/// # Errors
/// [`FileError`], naming the column.
pub(super) fn gauges<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &[LinearizedWindow],
) -> Result<(), FileError> {
    (0..problem.campaign.gauges.len()).try_for_each(|gauge| {
        check_still(problem, linearized, gauge)?;
        check_changes(problem, linearized, gauge)
    })
}

fn column<const N: usize>(campaign: &Campaign<N>, gauge: usize) -> String {
    format!("{}_um", campaign.gauges[gauge].name)
}

/// Refuses a gauge that shows one number although its reading should change.
fn check_still<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &[LinearizedWindow],
    gauge: usize,
) -> Result<(), FileError> {
    let Some(ConstantReadings {
        windows,
        predicted_m,
    }) = still(problem, linearized, gauge)
    else {
        return Ok(());
    };
    let campaign = problem.campaign;
    let reason = format!(
        "{} rows from here on show one number, where by the robot file's springs it changes by {:.1} um: the gauge is stuck, or at the end of its range; measure them again, or leave these cells empty",
        windows.len(),
        predicted_m * 1e6
    );
    let first = &campaign.windows[windows[0]];
    Err(campaign.error(first, &column(campaign, gauge), reason))
}

/// Refuses a gauge whose readings change by far less or far more than predicted.
fn check_changes<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &[LinearizedWindow],
    gauge: usize,
) -> Result<(), FileError> {
    let campaign = problem.campaign;
    let pairs = changes(problem, linearized, gauge);
    let Some((first, _)) = pairs.first() else {
        return Ok(());
    };
    let window = &campaign.windows[*first];
    let noise = campaign.noise.gauge_um * 1e-6;
    let measured: Vec<f64> = pairs.iter().map(|(_, [measured, _])| *measured).collect();
    let predicted: Vec<f64> = pairs.iter().map(|(_, [_, predicted])| *predicted).collect();
    let is_nothing =
        norm(&predicted) > HIDDEN * noise && norm(&measured) * MAX_FACTOR < norm(&predicted);
    let [share, sd] = shown(campaign, &pairs, noise);
    let is_little = share.abs() + SURE_SD * sd < MIN_SHARE && is_sure(problem, linearized, gauge);
    if is_nothing || is_little {
        let reason = format!(
            "the readings change by {:.1} % of what the robot file's springs predict; the column is in um, and the gauge must touch (a part that is this stiff: write so in the robot file first)",
            share * 100.0
        );
        return Err(campaign.error(window, &column(campaign, gauge), reason));
    }
    let [measured, predicted] = [measured, predicted].map(|changes| median_size(&changes));
    if measured > MAX_FACTOR * (predicted + noise) {
        let reason = format!(
            "the readings change by {:.0} um where the robot file's springs predict {:.1} um; the column is in um",
            measured * 1e6,
            predicted * 1e6
        );
        return Err(campaign.error(window, &column(campaign, gauge), reason));
    }
    Ok(())
}

/// Median of the magnitudes.
fn median_size(changes: &[f64]) -> f64 {
    median(changes.iter().map(|change| change.abs()).collect())
}

/// Root of the sum of the squares.
fn norm(changes: &[f64]) -> f64 {
    changes
        .iter()
        .map(|change| change * change)
        .sum::<f64>()
        .sqrt()
}

/// Parts that the springs of the robot file have of the readings of a gauge, by window.
fn parts<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &[LinearizedWindow],
    gauge: usize,
) -> Vec<(usize, DVector<f64>)> {
    let file = problem.file.vector();
    linearized
        .iter()
        .filter_map(|linearized| {
            let row = linearized.row_of(gauge)?;
            let shown = linearized.springs_shown.row(row).transpose();
            Some((linearized.window, shown.component_mul(&file)))
        })
        .collect()
}

/// Changes from their mean of the readings of one series, by their parts: predicted, and the least
/// if each spring may be wrong by [`WRONG`].
fn predicted(parts: &[&DVector<f64>]) -> Vec<[f64; 2]> {
    let Some(first) = parts.first() else {
        return Vec::new();
    };
    let sum = parts
        .iter()
        .fold(DVector::zeros(first.len()), |sum, parts| sum + *parts);
    let mean = sum / float(parts.len());
    parts
        .iter()
        .map(|parts| {
            let change = *parts - &mean;
            let predicted = change.sum().abs();
            [predicted, (predicted - WRONG * change.lp_norm(1)).max(0.0)]
        })
        .collect()
}

/// True if the changes that are predicted of a gauge do not hang on how far its springs are wrong.
fn is_sure<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &[LinearizedWindow],
    gauge: usize,
) -> bool {
    let parts = parts(problem, linearized, gauge);
    let mut all = 0.0;
    let mut sure = 0.0;
    for series in 0..problem.campaign.series.len() {
        let here: Vec<&DVector<f64>> = parts
            .iter()
            .filter(|(window, _)| problem.campaign.windows[*window].series == series)
            .map(|(_, parts)| parts)
            .collect();
        for [predicted, least] in predicted(&here) {
            all += predicted * predicted;
            sure += least * least;
        }
    }
    sure > MIN_SURE * all
}

/// Share of the changes that the robot file predicts which the readings of a gauge show, and its
/// standard deviation.
fn shown<const N: usize>(
    campaign: &Campaign<N>,
    pairs: &[(usize, [f64; 2])],
    noise_m: f64,
) -> [f64; 2] {
    let mut product = 0.0;
    let mut squares = 0.0;
    for series in 0..campaign.series.len() {
        let here = pairs
            .iter()
            .filter(|(window, _)| campaign.windows[*window].series == series);
        let count = float(here.clone().count().max(1));
        let mean = here
            .clone()
            .map(|(_, [_, predicted])| predicted)
            .sum::<f64>()
            / count;
        for (_, [measured, predicted]) in here {
            product += measured * (predicted - mean);
            squares += (predicted - mean).powi(2);
        }
    }
    [product / squares, noise_m / squares.sqrt()]
}

/// Windows in which a gauge shows one number although its reading should change.
struct ConstantReadings {
    windows: Vec<usize>,
    /// Largest change from their mean in a series, by the robot file's springs, m.
    predicted_m: f64,
}

/// Looks for equal readings that should differ: of a column that is too coarse to tell by itself.
fn still<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &[LinearizedWindow],
    gauge: usize,
) -> Option<ConstantReadings> {
    let campaign = problem.campaign;
    // Window, reading, and what each spring of the robot file has of it.
    let mut readings: Vec<(usize, f64, DVector<f64>)> = parts(problem, linearized, gauge)
        .into_iter()
        .filter_map(|(window, parts)| {
            Some((window, campaign.windows[window].readings_m[gauge]?, parts))
        })
        .collect();
    let step_m = resolution(readings.iter().map(|(_, reading, _)| *reading));
    let variance = (campaign.noise.gauge_um * 1e-6).powi(2) + step_m.powi(2) / 12.0;
    readings.sort_by(|one, other| one.1.total_cmp(&other.1));
    readings
        .chunk_by(|one, other| is_same(one.1, other.1))
        .filter(|equal| equal.len() >= MANY)
        .find_map(|equal| {
            let mut squares = 0.0;
            let mut predicted_m = 0.0_f64;
            for series in 0..campaign.series.len() {
                let here = equal
                    .iter()
                    .filter(|(window, ..)| campaign.windows[*window].series == series);
                for [change, least] in predicted(&here.map(|(.., parts)| parts).collect::<Vec<_>>())
                {
                    squares += least.powi(2);
                    predicted_m = predicted_m.max(change);
                }
            }
            (squares > HIDDEN * variance).then(|| {
                let mut windows: Vec<usize> = equal.iter().map(|(window, ..)| *window).collect();
                windows.sort_unstable();
                ConstantReadings {
                    windows,
                    predicted_m,
                }
            })
        })
}

/// Changes of the readings of a gauge since the first window of their series: measured and
/// predicted.
fn changes<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    linearized: &[LinearizedWindow],
    gauge: usize,
) -> Vec<(usize, [f64; 2])> {
    let campaign = problem.campaign;
    let mut first: Vec<Option<[f64; 2]>> = vec![None; campaign.series.len()];
    let mut changes = Vec::new();
    for linearized in linearized {
        let window = &campaign.windows[linearized.window];
        let Some(row) = linearized.row_of(gauge) else {
            continue;
        };
        let Some(measured) = window.readings_m[gauge] else {
            continue;
        };
        // At the measured load a misclosure is what was measured less what is predicted.
        let here = [measured, measured - linearized.misclosures[row]];
        let [measured, predicted] = *first[window.series].get_or_insert(here);
        changes.push((linearized.window, [here[0] - measured, here[1] - predicted]));
    }
    changes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::springs::active_set::ActiveSet;
    use crate::springs::fit::rounds;
    use crate::springs::fixture::{FINE, TestBench, campaign_a};
    use crate::springs::state::FitState;

    /// Three tenths of what is predicted, with a zero in each series.
    #[test]
    fn the_share_that_a_gauge_shows_is_that_of_its_changes() {
        let bench: TestBench<3> = campaign_a(FINE);
        let pairs: Vec<(usize, [f64; 2])> = bench
            .campaign
            .windows
            .iter()
            .enumerate()
            .map(|(index, window)| {
                let predicted_m = 1e-6 * float(index % 11);
                let zero_m = 1e-3 * float(window.series);
                (index, [zero_m + 0.3 * predicted_m, predicted_m])
            })
            .collect();
        let [share, sd] = shown(&bench.campaign, &pairs, 1e-6);
        // Eleven steps of a micrometre in each of nine series: 110 um^2 about their mean.
        assert!(
            (share - 0.3).abs() < 1e-9 && (sd - 1.0 / f64::sqrt(9.0 * 110.0)).abs() < 1e-9,
            "{share} {sd}"
        );
    }

    /// Zeros of gauges, in each series another one, are not changes, and a first window may be
    /// under load.
    #[test]
    fn changes_are_those_since_the_first_window_of_their_series() {
        let mut bench: TestBench<3> = campaign_a(FINE);
        bench
            .campaign
            .windows
            .retain(|window| window.load.norm() > 0.0);
        for window in &mut bench.campaign.windows {
            window.readings_m[0] =
                Some(1e-3 * float(window.series + 1) + 1e-6 * window.load.norm());
        }
        let problem = bench.problem();
        let linearized = rounds(
            &problem,
            &ActiveSet::all(&bench.campaign),
            FitState::start(&problem),
            1,
        )
        .unwrap()
        .linearized;
        let changes = changes(&problem, &linearized, 0);
        assert_eq!(changes.len(), 9 * 9);
        for (window, [measured, predicted]) in changes {
            let moved_m = 1e-6
                * (bench.campaign.windows[window].load.norm()
                    - bench.campaign.windows[window / 9 * 9].load.norm());
            assert!((measured - moved_m).abs() < 1e-12, "{window}: {measured}");
            let is_first = window % 9 == 0;
            assert!(
                predicted.abs() < 9e-4 && (!is_first || predicted.abs() < 1e-12),
                "{window}: {predicted}"
            );
        }
    }

    /// A cart gives way by one spring, the platform by sums of several with either sign, some of
    /// which nearly cancel.
    #[test]
    fn what_one_spring_predicts_is_sure() {
        for series in 0..9 {
            let mut bench: TestBench<3> = campaign_a(FINE);
            bench
                .campaign
                .windows
                .retain(|window| window.series == series);
            let problem = bench.problem();
            let linearized = rounds(
                &problem,
                &ActiveSet::all(&bench.campaign),
                FitState::start(&problem),
                1,
            )
            .unwrap()
            .linearized;
            let of_carts = (6..9).all(|gauge| is_sure(&problem, &linearized, gauge));
            assert!(of_carts && !is_sure(&problem, &linearized, 4), "{series}");
        }
    }

    /// Campaign A, whose first series has no load but what `change` makes of its fourth window.
    fn with_load(change: impl Fn(&mut Window<3>)) -> Result<(), FileError> {
        let mut bench: TestBench<3> = campaign_a(FINE);
        let first = bench
            .campaign
            .windows
            .iter_mut()
            .filter(|window| window.series == 0);
        for (index, window) in first.enumerate() {
            window.load = nalgebra::Vector6::zeros();
            if index == 3 {
                change(window);
            }
        }
        loads(&bench.campaign)
    }

    #[test]
    fn a_load_of_one_component_is_one() {
        let sds = [
            FINE.force_n,
            FINE.force_n,
            FINE.force_n,
            FINE.moment_nm,
            FINE.moment_nm,
            FINE.moment_nm,
        ];
        for (component, sd) in sds.into_iter().enumerate() {
            with_load(|window| window.load[component] = -5.1 * sd).unwrap();
            let refused = with_load(|window| window.load[component] = 4.9 * sd)
                .unwrap_err()
                .to_string();
            assert!(
                refused.contains("changes by 4.9 standard deviations"),
                "{refused}"
            );
        }
        with_load(|window| window.pushes_n[1] = 5.1 * FINE.force_n).unwrap();
        let refused = with_load(|_| ()).unwrap_err().to_string();
        assert!(
            refused.contains("changes by 0.0 standard deviations"),
            "{refused}"
        );
    }
}
