//! Pairs of windows, compensation off and on, in the tables that springs are identified from.
//!
//! In each series:
//! - rows without a load give the zeros of the gauges; without a load means every component within [`UNLOADED_SD`] standard deviations of 0;
//! - two rows with a load and the same `window` are a pair. Off is the one whose `q` is nearer to that of the rows without a load; the `q`
//!   of the other contains the offsets of the compensation.

use std::collections::HashMap;

use nalgebra::{SVector, Vector6};

use super::VerifyError;
use crate::measurements::springs::{Campaign, Window};

/// Load, in standard deviations of each component, up to which a row counts as unloaded.
pub const UNLOADED_SD: f64 = 5.0;
/// Largest difference of the loads of a pair, relative, besides their noise.
const SAME_LOAD: f64 = 0.1;

/// Windows of one series, by index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct SeriesPairs {
    /// Rows without a load.
    pub(super) unloaded: Vec<usize>,
    /// Off and on.
    pub(super) pairs: Vec<[usize; 2]>,
}

/// Sorts the windows of a campaign, series by series.
pub(super) fn pairs<const N: usize>(campaign: &Campaign<N>) -> Result<Vec<SeriesPairs>, VerifyError> {
    let mut of_series = vec![Vec::new(); campaign.series.len()];
    for (index, window) in campaign.windows.iter().enumerate() {
        of_series[window.series].push(index);
    }
    of_series.iter().map(|windows| sorted(campaign, windows)).collect()
}

fn sorted<const N: usize>(campaign: &Campaign<N>, windows: &[usize]) -> Result<SeriesPairs, VerifyError> {
    let (unloaded, loaded): (Vec<usize>, Vec<usize>) =
        windows.iter().partition(|index| is_unloaded(campaign, &campaign.windows[**index]));
    let mut by_name: HashMap<&str, Vec<usize>> = HashMap::new();
    for &index in &loaded {
        by_name.entry(&campaign.windows[index].window).or_default().push(index);
    }
    let mut pairs = Vec::new();
    for &index in &loaded {
        let window = &campaign.windows[index];
        let Some(zero) = unloaded.first() else {
            return Err(refused(campaign, window, "its series has no row without a load, so its gauges have no zero"));
        };
        match by_name.get(window.window.as_str()).map(Vec::as_slice) {
            Some([one, other]) if *one == index => pairs.push(pair(campaign, [*one, *other], *zero)?),
            // The second of a pair.
            Some([_, _]) => {}
            _ => {
                let name = &window.window;
                let reason = format!("window {name:?} must stand twice in its series, with compensation off and on");
                return Err(refused(campaign, window, &reason));
            }
        }
    }
    Ok(SeriesPairs { unloaded, pairs })
}

/// Off and on of two windows; `zero` is one without a load.
fn pair<const N: usize>(campaign: &Campaign<N>, both: [usize; 2], zero: usize) -> Result<[usize; 2], VerifyError> {
    let [one, other] = both.map(|index| &campaign.windows[index]);
    if !is_same_load(campaign, &one.load, &other.load) {
        let reason = format!("the load is not that of line {}, the other window of the pair", one.line);
        return Err(refused(campaign, other, &reason));
    }
    let away = |window: &Window<N>| (SVector::from(window.q) - SVector::from(campaign.windows[zero].q)).norm();
    let (here, there) = (away(one), away(other));
    if (here - there).abs() <= f64::EPSILON {
        let reason = format!("q is that of line {}; with compensation on it contains the offsets", one.line);
        return Err(refused(campaign, other, &reason));
    }
    let [one, other] = both;
    Ok(if here < there { [one, other] } else { [other, one] })
}

fn refused<const N: usize>(campaign: &Campaign<N>, window: &Window<N>, reason: &str) -> VerifyError {
    VerifyError::Pair { table: campaign.table.clone(), line: window.line, reason: reason.to_owned() }
}

fn noise<const N: usize>(campaign: &Campaign<N>) -> Vector6<f64> {
    let (force, moment) = (campaign.noise.force_n, campaign.noise.moment_nm);
    Vector6::new(force, force, force, moment, moment, moment)
}

fn is_unloaded<const N: usize>(campaign: &Campaign<N>, window: &Window<N>) -> bool {
    let is_pushed = window.pushes_n.amax() > UNLOADED_SD * campaign.noise.force_n;
    !is_pushed && window.load.iter().zip(&noise(campaign)).all(|(value, sd)| value.abs() <= UNLOADED_SD * sd)
}

fn is_same_load<const N: usize>(campaign: &Campaign<N>, one: &Vector6<f64>, other: &Vector6<f64>) -> bool {
    let (force, moment) = (one.fixed_rows::<3>(0).norm(), one.fixed_rows::<3>(3).norm());
    let sizes = [force, force, force, moment, moment, moment];
    let differences = (one - other).abs();
    let allowed = noise(campaign) * (2.0 * UNLOADED_SD);
    differences
        .iter()
        .zip(&allowed)
        .zip(sizes)
        .all(|((difference, noise), size)| *difference <= noise + SAME_LOAD * size)
}
