//! Pairs of windows, compensation off and on, in the tables that springs are identified from.
//!
//! In each series:
//! - rows without a load give the zeros of the gauges; without a load means every component within [`UNLOADED_SD`] standard deviations of 0;
//! - two rows with a load and the same `window` are a pair. Off is the one whose `q` is nearer to that of the rows without a load; the `q`
//!   of the other contains the offsets of the compensation.

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
    (0..campaign.series.len()).map(|series| of_series(campaign, series)).collect()
}

fn of_series<const N: usize>(campaign: &Campaign<N>, series: usize) -> Result<SeriesPairs, VerifyError> {
    let windows = || campaign.windows.iter().enumerate().filter(move |(_, window)| window.series == series);
    let mut found = SeriesPairs::default();
    found.unloaded.extend(windows().filter(|(_, window)| is_unloaded(campaign, window)).map(|(index, _)| index));
    let refused = |window: &Window<N>, reason: String| VerifyError::Pair {
        table: campaign.table.clone(),
        line: window.line,
        reason,
    };
    let zero_q = windows().find(|(_, window)| is_unloaded(campaign, window)).map(|(_, window)| window.q);
    let loaded: Vec<(usize, &Window<N>)> = windows().filter(|(_, window)| !is_unloaded(campaign, window)).collect();
    for (at, &(index, window)) in loaded.iter().enumerate() {
        let zero_q = zero_q.ok_or_else(|| {
            refused(window, "its series has no row without a load, so its gauges have no zero".to_owned())
        })?;
        let is_partner = |other: &&(usize, &Window<N>)| other.1.window == window.window && other.0 != index;
        let mut partners = loaded.iter().filter(is_partner);
        let (Some(&(partner, other)), None) = (partners.next(), partners.next()) else {
            let reason =
                format!("window {:?} must stand twice in its series, with compensation off and on", window.window);
            return Err(refused(window, reason));
        };
        if loaded.iter().take(at).any(|(earlier, _)| *earlier == partner) {
            continue;
        }
        if !is_same_load(campaign, &window.load, &other.load) {
            let reason = format!("the load is not that of line {}, the other window of the pair", window.line);
            return Err(refused(other, reason));
        }
        let away = |window: &Window<N>| (SVector::from(window.q) - SVector::from(zero_q)).norm();
        let (here, there) = (away(window), away(other));
        if (here - there).abs() <= f64::EPSILON {
            let reason = format!("q is that of line {}; with compensation on it contains the offsets", window.line);
            return Err(refused(other, reason));
        }
        found.pairs.push(if here < there { [index, partner] } else { [partner, index] });
    }
    Ok(found)
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
