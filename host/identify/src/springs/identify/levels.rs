//! Windows of a series at the same level: repeats of one measurement.

use nalgebra::SVector;

use crate::fit::statistics::{float, median};
use crate::measurements::plan::before_remount;
use crate::measurements::springs::{Campaign, SeriesEntry, Window};
use crate::springs::fit::Solution;

/// Largest difference between windows of a level, in steps from level to level.
const CLOSE: f64 = 0.25;

/// Returns the number of its level for each window; windows of one series at one level have the
/// same. Levels are those of the plan; without a plan, windows are at one level if loads *and*
/// readings differ by less than a quarter of the step of the series.
pub(super) fn levels<const N: usize>(campaign: &Campaign<N>, solution: &Solution<N>) -> Vec<usize> {
    let mut levels = vec![0; campaign.windows.len()];
    let mut next = 0;
    for (series, name) in campaign.series.iter().enumerate() {
        let windows: Vec<usize> = (0..campaign.windows.len())
            .filter(|window| campaign.windows[*window].series == series)
            .collect();
        let of_series = entry(campaign, name)
            .or_else(|| entry(campaign, before_remount(name)))
            .and_then(|entry| planned(campaign, entry, &windows))
            .unwrap_or_else(|| {
                grouped(&windows, &[&loads(campaign), &readings(campaign, solution)])
            });
        for (window, level) in windows.iter().zip(&of_series) {
            levels[*window] = next + level;
        }
        next += of_series.iter().max().map_or(0, |most| most + 1);
    }
    levels
}

/// Entry of a series in the plan.
fn entry<'a, const N: usize>(campaign: &'a Campaign<N>, name: &str) -> Option<&'a SeriesEntry> {
    campaign.plan.iter().find(|entry| entry.name == *name)
}

/// Levels by the plan; `None` where a window is not of the plan. A window has the number of its
/// level, from 1.
fn planned<const N: usize>(
    campaign: &Campaign<N>,
    entry: &SeriesEntry,
    windows: &[usize],
) -> Option<Vec<usize>> {
    windows
        .iter()
        .map(|window| {
            let number: usize = campaign.windows[*window].window.parse().ok()?;
            let level = entry.levels_n.get(number.checked_sub(1)?)?;
            entry
                .levels_n
                .iter()
                .position(|other| other.to_bits() == level.to_bits())
        })
        .collect()
}

type Distance<'a> = dyn Fn(usize, usize) -> f64 + 'a;

/// Levels by distances between windows, each in steps of its own.
fn grouped(windows: &[usize], distances: &[&Distance<'_>]) -> Vec<usize> {
    let steps: Vec<f64> = distances
        .iter()
        .map(|distance| step(windows, distance))
        .collect();
    let mut firsts: Vec<usize> = Vec::new();
    let mut levels = Vec::with_capacity(windows.len());
    for window in windows {
        let same = firsts.iter().position(|first| {
            distances
                .iter()
                .zip(&steps)
                .all(|(distance, step)| distance(*first, *window) < CLOSE * step)
        });
        levels.push(same.unwrap_or_else(|| {
            firsts.push(*window);
            firsts.len() - 1
        }));
    }
    levels
}

/// Usual distance between windows that follow each other, those of one level not counted.
fn step(windows: &[usize], distance: &Distance<'_>) -> f64 {
    let changes: Vec<f64> = windows
        .windows(2)
        .map(|pair| distance(pair[0], pair[1]))
        .collect();
    let largest = changes.iter().copied().fold(0.0, f64::max);
    median(
        changes
            .into_iter()
            .filter(|change| *change >= CLOSE * largest)
            .collect(),
    )
}

/// Distance of loads: forces and pushes, N; moments count by the ratio of their noises.
fn loads<const N: usize>(campaign: &Campaign<N>) -> impl Fn(usize, usize) -> f64 {
    let arm_m = campaign.noise.moment_nm / campaign.noise.force_n;
    move |one, other| {
        let [one, other]: [&Window<N>; 2] = [one, other].map(|window| &campaign.windows[window]);
        let load = one.load - other.load;
        let pushes: SVector<f64, N> = one.pushes_n - other.pushes_n;
        let moment = load.fixed_rows::<3>(3).norm() / arm_m;
        load.fixed_rows::<3>(0)
            .norm()
            .hypot(moment)
            .hypot(pushes.norm())
    }
}

/// Root mean square distance of readings that both windows have, m; what the fit takes for zeros,
/// drift and moved gauges is taken off.
fn readings<const N: usize>(
    campaign: &Campaign<N>,
    solution: &Solution<N>,
) -> impl Fn(usize, usize) -> f64 {
    let mut corrected = vec![vec![None; campaign.gauges.len()]; campaign.windows.len()];
    for (linearized, left) in solution.linearized.iter().zip(&solution.left) {
        for (row, gauge) in linearized.gauges.iter().enumerate() {
            let zero = linearized.misclosures[row] - left[row];
            corrected[linearized.window][*gauge] =
                campaign.windows[linearized.window].readings_m[*gauge].map(|y| y - zero);
        }
    }
    move |one, other| {
        let pairs = corrected[one].iter().zip(&corrected[other]);
        let changes: Vec<f64> = pairs
            .filter_map(|(one, other)| Some((*one)? - (*other)?))
            .collect();
        (changes.iter().map(|change| change * change).sum::<f64>() / float(changes.len().max(1)))
            .sqrt()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::measurements::springs::Noise;
    use crate::springs::active_set::ActiveSet;
    use crate::springs::fit::rounds;
    use crate::springs::fixture::{FINE, campaign_a};
    use crate::springs::state::FitState;

    #[test]
    fn windows_within_a_quarter_of_a_step_are_one_level() {
        let loads: [f64; 8] = [0.3, 60.9, 118.0, 179.0, 121.5, 62.0, -0.8, -1.0];
        let distance = distances_of(loads);
        let windows: Vec<usize> = (0..8).collect();
        assert!(
            (step(&windows, &distance) - 59.75).abs() < 2.0,
            "dwelling at 0 N is not a step"
        );
        assert_eq!(grouped(&windows, &[&distance]), [0, 1, 2, 3, 2, 1, 0, 0]);
        // The same load and other readings: not the same level.
        let readings: [f64; 8] = [0.0, 10.0, 20.0, 30.0, 25.0, 10.2, 0.1, 0.0];
        assert_eq!(
            grouped(&windows, &[&distance, &distances_of(readings)]),
            [0, 1, 2, 3, 4, 1, 0, 0]
        );
    }

    fn distances_of(values: [f64; 8]) -> impl Fn(usize, usize) -> f64 {
        move |one, other| (values[one] - values[other]).abs()
    }

    #[test]
    fn moments_count_by_the_ratio_of_the_noises() {
        let mut bench = campaign_a(Noise {
            gauge_um: 1.0,
            force_n: 2.0,
            moment_nm: 0.5,
        });
        bench.campaign.windows[0].load = Vector6::new(10.0, 0.0, 3.0, 4.0, 5.0, 6.0);
        bench.campaign.windows[1].load = Vector6::new(10.0, 0.0, 3.0, 4.0, 7.0, 6.0);
        // 2 N m are 8 N; with 6 N of a push 10.
        assert!((loads(&bench.campaign)(0, 1) - 8.0).abs() < 1e-12);
        bench.campaign.windows[1].pushes_n[2] = -6.0;
        assert!((loads(&bench.campaign)(0, 1) - 10.0).abs() < 1e-12);
    }

    /// Readings count by their mean square, however many of them two windows share; zeros and moved
    /// gauges do not.
    #[test]
    fn readings_that_are_missing_bring_windows_no_closer() {
        let mut bench = campaign_a(FINE);
        bench.campaign.windows.truncate(3);
        bench.campaign.windows[1].readings_m.fill(Some(10e-6));
        // A gauge that was moved by 4 um.
        bench.campaign.windows[2].readings_m.fill(None);
        bench.campaign.windows[2].readings_m[0] = Some(14e-6);
        let problem = bench.problem();
        let mut solution = rounds(
            &problem,
            &ActiveSet::all(&bench.campaign),
            FitState::start(&problem),
            1,
        )
        .unwrap();
        // No zeros, but that one.
        solution.left = solution
            .linearized
            .iter()
            .map(|linearized| linearized.misclosures.clone())
            .collect();
        solution.left[2][0] -= 4e-6;
        let distance = readings(&bench.campaign, &solution);
        assert!((distance(0, 1) - 10e-6).abs() < 1e-12 && (distance(0, 2) - 10e-6).abs() < 1e-12);
    }
}
