//! Loads without what noise explains.

use nalgebra::{DMatrix, Vector6};

use crate::fit::statistics::float;
use crate::fit::svd::Svd;
use crate::measurements::springs::Campaign;

/// Loads of a campaign's windows, in each series without what noise explains: a strap pulls along
/// one line.
pub(super) fn smooth_loads<const N: usize>(
    campaign: &Campaign<N>,
    loads: &[Vector6<f64>],
) -> Vec<Vector6<f64>> {
    let sds = campaign.noise.load_variances().map(f64::sqrt);
    let mut smooth = loads.to_vec();
    for series in 0..campaign.series.len() {
        let windows: Vec<usize> = (0..campaign.windows.len())
            .filter(|window| campaign.windows[*window].series == series)
            .collect();
        let count = float(windows.len());
        let mean = windows
            .iter()
            .map(|window| smooth[*window])
            .sum::<Vector6<f64>>()
            / count;
        let svd = Svd::new(DMatrix::from_fn(windows.len(), 6, |row, column| {
            (smooth[windows[row]] - mean).component_div(&sds)[column]
        }));
        // Largest singular value that noise alone has, but for one in some thousands.
        let noise = count.sqrt() + 6.0_f64.sqrt() + 2.0;
        let directions = svd
            .values
            .iter()
            .zip(svd.directions.column_iter())
            .filter(|(value, _)| **value > noise);
        let along: Vec<Vector6<f64>> = directions
            .map(|(_, direction)| Vector6::from_iterator(direction.iter().copied()))
            .collect();
        for window in windows {
            let load = (smooth[window] - mean).component_div(&sds);
            let kept: Vector6<f64> = along
                .iter()
                .map(|direction| direction * direction.dot(&load))
                .sum();
            smooth[window] = mean + kept.component_mul(&sds);
        }
    }
    smooth
}
