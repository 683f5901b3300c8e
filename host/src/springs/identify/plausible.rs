//! Campaigns that cannot be what they say: refused before a fit, by line and column.

use nalgebra::{DVector, Vector3};

use crate::elastic::ElasticMachine;
use crate::elastic::backlash::Backlash;
use crate::fit::statistics::{float, median};
use crate::measurements::FileError;
use crate::measurements::repeated::{is_same, resolution};
use crate::measurements::springs::Campaign;
use crate::springs::lines::{Lines, Question};

/// Largest distance between the pose that the set-up names and the one by the axes, m, and largest turn, rad.
const FAR_M: f64 = 0.05;
const TURNED_RAD: f64 = 0.1;
/// Smallest change of the load in a series, in standard deviations of its noise.
const LEAST_LOAD_SD: f64 = 5.0;
/// Largest factor between the changes of a gauge's readings and those that the robot file predicts. A wrong unit is a factor of a thousand.
const MOST_FACTOR: f64 = 200.0;
/// Share of the changes that the robot file predicts below which a gauge shows nothing, and standard deviations by which it must be below.
const LEAST_SHARE: f64 = 0.25;
const SURE_SD: f64 = 3.0;
/// Equal readings that are looked at, and the sum of squares of the changes that they hide at least, in variances of the noise.
const MANY: usize = 3;
const HIDDEN: f64 = 30.0;
/// Share of each compliance by which the robot file's may be wrong.
const WRONG: f64 = 0.5;
/// Smallest share of the squares of the predicted changes that is left then; of one spring it is a quarter.
const LEAST_SURE: f64 = 0.1;

/// Checks poses, loads and gauges of a campaign.
///
/// # Errors
/// [`FileError`], naming line, column and what to do.
pub(super) fn check<const N: usize>(question: &Question<'_, N>) -> Result<(), FileError> {
    poses(question)?;
    loads(question.campaign)?;
    question.campaign.check_repeated()
}

/// Axes of a row must put the machine where the set-up says it stood.
fn poses<const N: usize>(question: &Question<'_, N>) -> Result<(), FileError> {
    let campaign = question.campaign;
    let machine = ElasticMachine::new(*question.geometry, question.file.machine, Backlash::NONE);
    for window in &campaign.windows {
        let (name, pose) = &campaign.poses[window.pose];
        let refused = |reason: String| campaign.error(window, "pose", reason);
        let found = question.unloaded(&machine, window).map_err(|error| {
            refused(format!("with these axes the robot file's machine does not reach the pose {name:?}: {error}; check q, and the robot file"))
        })?;
        let away = (found.pose.translation_m - pose.position_m).norm();
        let turned = found.pose.rotation.angle_to(&nalgebra::UnitQuaternion::from_matrix(&pose.rotation));
        if away > FAR_M || turned > TURNED_RAD {
            return Err(refused(format!(
                "with these axes the robot file's machine stands {:.0} mm and {:.0} mrad away from the pose {name:?}; check q, the pose, and the robot file",
                away * 1e3,
                turned * 1e3
            )));
        }
    }
    Ok(())
}

/// A series must change its load.
fn loads<const N: usize>(campaign: &Campaign<N>) -> Result<(), FileError> {
    for (series, name) in campaign.series.iter().enumerate() {
        let windows: Vec<_> = campaign.windows.iter().filter(|window| window.series == series).collect();
        let Some(first) = windows.first() else { continue };
        let force = |load: &nalgebra::Vector6<f64>| Vector3::new(load[0], load[1], load[2]) / campaign.noise.force_n;
        let moment = |load: &nalgebra::Vector6<f64>| Vector3::new(load[3], load[4], load[5]) / campaign.noise.moment_nm;
        let largest = windows.iter().map(|window| {
            let change = window.load - first.load;
            let pushed = (window.pushes_n - first.pushes_n).amax() / campaign.noise.force_n;
            force(&change).norm().max(moment(&change).norm()).max(pushed)
        });
        let largest = largest.fold(0.0, f64::max);
        if largest < LEAST_LOAD_SD {
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

/// Checks the readings of each gauge against what the robot file's springs predict; `lines` are linearised there.
///
/// # Errors
/// [`FileError`], naming the column.
pub(super) fn gauges<const N: usize>(question: &Question<'_, N>, lines: &[Lines]) -> Result<(), FileError> {
    let campaign = question.campaign;
    for (gauge, named) in campaign.gauges.iter().enumerate() {
        let column = format!("{}_um", named.name);
        if let Some(still) = still(question, lines, gauge) {
            let Still { windows, predicted_m } = &still;
            let reason = format!(
                "{} rows from here on show one number, where by the robot file's springs it changes by {:.1} um: the gauge is stuck, or at the end of its range; measure them again, or leave these cells empty",
                windows.len(),
                predicted_m * 1e6
            );
            return Err(campaign.error(&campaign.windows[windows[0]], &column, reason));
        }
        let pairs = changes(question, lines, gauge);
        let Some((first, _)) = pairs.first() else { continue };
        let window = &campaign.windows[*first];
        let noise = campaign.noise.gauge_um * 1e-6;
        let measured: Vec<f64> = pairs.iter().map(|(_, [measured, _])| *measured).collect();
        let predicted: Vec<f64> = pairs.iter().map(|(_, [_, predicted])| *predicted).collect();
        let size = |changes: &[f64]| median(changes.iter().map(|change| change.abs()).collect());
        let norm = |changes: &[f64]| changes.iter().map(|change| change * change).sum::<f64>().sqrt();
        let is_nothing = norm(&predicted) > HIDDEN * noise && norm(&measured) * MOST_FACTOR < norm(&predicted);
        let [share, sd] = shown(campaign, &pairs, noise);
        let is_little = share.abs() + SURE_SD * sd < LEAST_SHARE && is_sure(question, lines, gauge);
        if is_nothing || is_little {
            let reason = format!(
                "the readings change by {:.1} % of what the robot file's springs predict; the column is in um, and the gauge must touch (a part that is this stiff: write so in the robot file first)",
                share * 100.0
            );
            return Err(campaign.error(window, &column, reason));
        }
        if size(&measured) > MOST_FACTOR * (size(&predicted) + noise) {
            let reason = format!(
                "the readings change by {:.0} um where the robot file's springs let expect {:.1} um; the column is in um",
                size(&measured) * 1e6,
                size(&predicted) * 1e6
            );
            return Err(campaign.error(window, &column, reason));
        }
    }
    Ok(())
}

/// Parts that the springs of the robot file have of the readings of a gauge, by window.
fn parts<const N: usize>(question: &Question<'_, N>, lines: &[Lines], gauge: usize) -> Vec<(usize, DVector<f64>)> {
    let file = question.file.vector();
    let of_window = |lines: &Lines| {
        let row = lines.gauges.iter().position(|other| *other == gauge)?;
        Some((lines.window, lines.springs_shown.row(row).transpose().component_mul(&file)))
    };
    lines.iter().filter_map(of_window).collect()
}

/// Changes from their mean of the readings of one series, by their parts: predicted, and the least if each spring may be wrong by [`WRONG`].
fn predicted(parts: &[&DVector<f64>]) -> Vec<[f64; 2]> {
    let Some(first) = parts.first() else { return Vec::new() };
    let sum = parts.iter().fold(DVector::zeros(first.len()), |sum, parts| sum + *parts);
    let mean = sum / float(parts.len());
    let of_window = |parts: &&DVector<f64>| {
        let change = *parts - &mean;
        let predicted = change.sum().abs();
        [predicted, (predicted - WRONG * change.lp_norm(1)).max(0.0)]
    };
    parts.iter().map(of_window).collect()
}

/// True if the changes that are predicted of a gauge do not hang on how far its springs are wrong.
fn is_sure<const N: usize>(question: &Question<'_, N>, lines: &[Lines], gauge: usize) -> bool {
    let parts = parts(question, lines, gauge);
    let (mut all, mut sure) = (0.0, 0.0);
    for series in 0..question.campaign.series.len() {
        let is_here = |(window, _): &&(usize, DVector<f64>)| question.campaign.windows[*window].series == series;
        let here: Vec<&DVector<f64>> = parts.iter().filter(is_here).map(|(_, parts)| parts).collect();
        for [predicted, least] in predicted(&here) {
            all += predicted * predicted;
            sure += least * least;
        }
    }
    sure > LEAST_SURE * all
}

/// Share of the changes that the robot file predicts which the readings of a gauge show, and its standard deviation.
fn shown<const N: usize>(campaign: &Campaign<N>, pairs: &[(usize, [f64; 2])], noise_m: f64) -> [f64; 2] {
    let (mut product, mut squares) = (0.0, 0.0);
    for series in 0..campaign.series.len() {
        let here = pairs.iter().filter(|(window, _)| campaign.windows[*window].series == series);
        let count = float(here.clone().count().max(1));
        let mean = here.clone().map(|(_, [_, predicted])| predicted).sum::<f64>() / count;
        for (_, [measured, predicted]) in here {
            product += measured * (predicted - mean);
            squares += (predicted - mean).powi(2);
        }
    }
    [product / squares, noise_m / squares.sqrt()]
}

/// Windows in which a gauge shows one number although its reading should change.
struct Still {
    windows: Vec<usize>,
    /// Largest change from their mean in a series, by the robot file's springs, m.
    predicted_m: f64,
}

/// Looks for equal readings that should differ: of a column that is too coarse to tell by itself.
fn still<const N: usize>(question: &Question<'_, N>, lines: &[Lines], gauge: usize) -> Option<Still> {
    let campaign = question.campaign;
    // Window, reading, and what each spring of the robot file has of it.
    let with_reading =
        |(window, parts): (usize, DVector<f64>)| Some((window, campaign.windows[window].readings_m[gauge]?, parts));
    let mut readings: Vec<(usize, f64, DVector<f64>)> =
        parts(question, lines, gauge).into_iter().filter_map(with_reading).collect();
    let step_m = resolution(readings.iter().map(|(_, reading, _)| *reading));
    let variance = (campaign.noise.gauge_um * 1e-6).powi(2) + step_m.powi(2) / 12.0;
    readings.sort_by(|one, other| one.1.total_cmp(&other.1));
    readings.chunk_by(|one, other| is_same(one.1, other.1)).filter(|equal| equal.len() >= MANY).find_map(|equal| {
        let (mut squares, mut predicted_m) = (0.0, 0.0_f64);
        for series in 0..campaign.series.len() {
            let here = equal.iter().filter(|(window, ..)| campaign.windows[*window].series == series);
            for [change, least] in predicted(&here.map(|(.., parts)| parts).collect::<Vec<_>>()) {
                squares += least.powi(2);
                predicted_m = predicted_m.max(change);
            }
        }
        (squares > HIDDEN * variance).then(|| {
            let mut windows: Vec<usize> = equal.iter().map(|(window, ..)| *window).collect();
            windows.sort_unstable();
            Still { windows, predicted_m }
        })
    })
}

/// Changes of the readings of a gauge since the first window of their series: measured and predicted.
fn changes<const N: usize>(question: &Question<'_, N>, lines: &[Lines], gauge: usize) -> Vec<(usize, [f64; 2])> {
    let campaign = question.campaign;
    let mut first: Vec<Option<[f64; 2]>> = vec![None; campaign.series.len()];
    let mut changes = Vec::new();
    for lines in lines {
        let window = &campaign.windows[lines.window];
        let Some(row) = lines.gauges.iter().position(|other| *other == gauge) else { continue };
        let Some(measured) = window.readings_m[gauge] else { continue };
        // At the measured load a misclosure is what was measured less what is predicted.
        let here = [measured, measured - lines.misclosures[row]];
        let [measured, predicted] = *first[window.series].get_or_insert(here);
        changes.push((lines.window, [here[0] - measured, here[1] - predicted]));
    }
    changes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::springs::campaigns::{Bench, FINE, campaign_a};
    use crate::springs::choice::Choice;
    use crate::springs::fit::rounds;
    use crate::springs::lines::State;

    /// Three tenths of what is predicted, with a zero in each series.
    #[test]
    fn the_share_that_a_gauge_shows_is_that_of_its_changes() {
        let bench: Bench<3> = campaign_a(FINE);
        let predicted_m = |window: usize| 1e-6 * float(window % 11);
        let pairs: Vec<(usize, [f64; 2])> = (0..bench.campaign.windows.len())
            .map(|window| (window, predicted_m(window), 1e-3 * float(bench.campaign.windows[window].series)))
            .map(|(window, predicted_m, zero_m)| (window, [zero_m + 0.3 * predicted_m, predicted_m]))
            .collect();
        let [share, sd] = shown(&bench.campaign, &pairs, 1e-6);
        // Eleven steps of a micrometre in each of nine series: 110 um^2 about their mean.
        assert!((share - 0.3).abs() < 1e-9 && (sd - 1.0 / f64::sqrt(9.0 * 110.0)).abs() < 1e-9, "{share} {sd}");
    }

    /// Zeros of gauges, in each series another one, are no changes, and a first window may be under load.
    #[test]
    fn changes_are_those_since_the_first_window_of_their_series() {
        let mut bench: Bench<3> = campaign_a(FINE);
        bench.campaign.windows.retain(|window| window.load.norm() > 0.0);
        for window in &mut bench.campaign.windows {
            window.readings_m[0] = Some(1e-3 * float(window.series + 1) + 1e-6 * window.load.norm());
        }
        let question = bench.question();
        let lines = rounds(&question, &Choice::all(&bench.campaign), State::start(&question), 1).unwrap().lines;
        let changes = changes(&question, &lines, 0);
        assert_eq!(changes.len(), 9 * 9);
        for (window, [measured, predicted]) in changes {
            let moved_m = 1e-6
                * (bench.campaign.windows[window].load.norm() - bench.campaign.windows[window / 9 * 9].load.norm());
            assert!((measured - moved_m).abs() < 1e-12, "{window}: {measured}");
            let is_first = window % 9 == 0;
            assert!(predicted.abs() < 9e-4 && (!is_first || predicted.abs() < 1e-12), "{window}: {predicted}");
        }
    }

    /// A cart gives way by one spring, the platform by sums of several with either sign, some of which nearly cancel.
    #[test]
    fn what_one_spring_predicts_is_sure() {
        for series in 0..9 {
            let mut bench: Bench<3> = campaign_a(FINE);
            bench.campaign.windows.retain(|window| window.series == series);
            let question = bench.question();
            let lines = rounds(&question, &Choice::all(&bench.campaign), State::start(&question), 1).unwrap().lines;
            let of_carts = (6..9).all(|gauge| is_sure(&question, &lines, gauge));
            assert!(of_carts && !is_sure(&question, &lines, 4), "{series}");
        }
    }

    /// Campaign A, whose first series has no load but what `change` makes of its fourth window.
    fn with_load(change: impl Fn(&mut crate::measurements::springs::Window<3>)) -> Result<(), FileError> {
        let mut bench: Bench<3> = campaign_a(FINE);
        let first = bench.campaign.windows.iter_mut().filter(|window| window.series == 0);
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
        let sds = [FINE.force_n, FINE.force_n, FINE.force_n, FINE.moment_nm, FINE.moment_nm, FINE.moment_nm];
        for (component, sd) in sds.into_iter().enumerate() {
            with_load(|window| window.load[component] = -5.1 * sd).unwrap();
            let refused = with_load(|window| window.load[component] = 4.9 * sd).unwrap_err().to_string();
            assert!(refused.contains("changes by 4.9 standard deviations"), "{refused}");
        }
        with_load(|window| window.pushes_n[1] = 5.1 * FINE.force_n).unwrap();
        let refused = with_load(|_| ()).unwrap_err().to_string();
        assert!(refused.contains("changes by 0.0 standard deviations"), "{refused}");
    }
}
