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
/// Equal readings that are looked at, and the sum of squares of the changes that they hide at least, in variances of the noise.
const MANY: usize = 3;
const HIDDEN: f64 = 30.0;
/// Share of each compliance by which the robot file's may be wrong.
const WRONG: f64 = 0.5;

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
        let is_shown = norm(&predicted) > 30.0 * noise;
        if is_shown && norm(&measured) * MOST_FACTOR < norm(&predicted) {
            let reason =
                "the readings hardly change under loads that move it; the column is in um, and the gauge must touch";
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

/// Windows in which a gauge shows one number although its reading should change.
struct Still {
    windows: Vec<usize>,
    /// Largest change from their mean in a series, by the robot file's springs, m.
    predicted_m: f64,
}

/// Looks for equal readings that should differ: of a column that is too coarse to tell by itself.
fn still<const N: usize>(question: &Question<'_, N>, lines: &[Lines], gauge: usize) -> Option<Still> {
    let campaign = question.campaign;
    let file = question.file.vector();
    // Window, reading, and what each spring of the robot file has of it.
    let mut readings: Vec<(usize, f64, DVector<f64>)> = lines
        .iter()
        .filter_map(|lines| {
            let row = lines.gauges.iter().position(|other| *other == gauge)?;
            let parts = lines.springs.row(row).transpose().component_mul(&file);
            Some((lines.window, campaign.windows[lines.window].readings_m[gauge]?, parts))
        })
        .collect();
    let step_m = resolution(readings.iter().map(|(_, reading, _)| *reading));
    let variance = (campaign.noise.gauge_um * 1e-6).powi(2) + step_m.powi(2) / 12.0;
    readings.sort_by(|one, other| one.1.total_cmp(&other.1));
    readings.chunk_by(|one, other| is_same(one.1, other.1)).filter(|equal| equal.len() >= MANY).find_map(|equal| {
        let (mut squares, mut predicted_m) = (0.0, 0.0_f64);
        for series in 0..campaign.series.len() {
            let here = equal.iter().filter(|(window, ..)| campaign.windows[*window].series == series);
            let parts: Vec<&DVector<f64>> = here.map(|(.., parts)| parts).collect();
            let mean =
                parts.iter().fold(DVector::zeros(file.len()), |sum, parts| sum + *parts) / float(parts.len().max(1));
            for parts in parts {
                let change = parts - &mean;
                let least = change.sum().abs() - WRONG * change.lp_norm(1);
                squares += least.max(0.0).powi(2);
                predicted_m = predicted_m.max(change.sum().abs());
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
