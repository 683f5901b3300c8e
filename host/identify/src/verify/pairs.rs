//! Pairs of windows, compensation off and on, in the tables that springs are identified from.
//!
//! Rows without a load give the zeros of the gauges, series by series; without a load means every
//! component within [`UNLOADED_SD`] standard deviations of 0. Of the others two are a pair:
//! - in one series, two with the same `window`. Off is the one whose `q` is nearer to that of the
//!   rows without a load; the `q` of the other contains the offsets of the compensation;
//! - in two series of one strap, pose and mounting, as `plan verify` writes them, those with the
//!   same `window`. One series is compensated: its plan says so, or its name ends in ` on`. The
//!   names are the same, but for that and the ` off` of the other.
//!
//! A series that was mounted again (`x on.2` after `x on`) takes the place of the one before.

use std::collections::HashMap;

use nalgebra::{SVector, Vector6};

use super::VerifyError;
use crate::measurements::plan::before_remount;
use crate::measurements::springs::{Campaign, Window};

/// Load, in standard deviations of each component, up to which a row counts as unloaded.
pub const UNLOADED_SD: f64 = 5.0;
/// Largest difference of the loads of a pair, relative; their noise is added to it.
const SAME_LOAD: f64 = 0.1;

/// Pairs of one series, or of two; windows by index.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct SeriesPairs {
    /// Name of the series, or what two have in common.
    pub(super) name: String,
    /// Rows without a load, series by series.
    pub(super) unloaded: Vec<Vec<usize>>,
    /// Off and on.
    pub(super) pairs: Vec<[usize; 2]>,
}

/// Sorts the windows of a campaign.
pub(super) fn pairs<const N: usize>(
    campaign: &Campaign<N>,
) -> Result<Vec<SeriesPairs>, VerifyError> {
    let mut of_series = vec![Vec::new(); campaign.series.len()];
    for (index, window) in campaign.windows.iter().enumerate() {
        of_series[window.series].push(index);
    }
    let all: Vec<SeriesHalf<'_>> = of_series
        .iter()
        .enumerate()
        .map(|(series, own)| SeriesHalf::new(campaign, series, own))
        .collect();
    let mut sorted = Vec::new();
    for half in &all {
        let [off, on] = [false, true].map(|compensated| {
            all.iter()
                .rev()
                .find(|other| other.strap == half.strap && other.compensated == compensated)
        });
        sorted.push(match (off, on) {
            (Some(off), Some(on)) if std::ptr::eq(off, half) => across(campaign, off, on)?,
            // The second of two, or one that was mounted again.
            (Some(_), Some(_)) => continue,
            _ => within(campaign, half)?,
        });
    }
    Ok(sorted)
}

/// A series, which may be half of two.
struct SeriesHalf<'a> {
    /// Name without that of its state and the number of its remount, pose, mounting.
    strap: (&'a str, usize, usize),
    /// Its own name.
    name: &'a str,
    compensated: bool,
    unloaded: Vec<usize>,
    loaded: Vec<usize>,
}

impl<'a> SeriesHalf<'a> {
    fn new<const N: usize>(campaign: &'a Campaign<N>, series: usize, windows: &[usize]) -> Self {
        let name = campaign.series[series].as_str();
        let planned = before_remount(name);
        let is_stated = campaign
            .plan
            .iter()
            .any(|entry| entry.compensated && [name, planned].contains(&&*entry.name));
        let (bare, is_on) = match (planned.strip_suffix(" on"), planned.strip_suffix(" off")) {
            (Some(bare), _) => (bare, true),
            (None, Some(bare)) => (bare, false),
            (None, None) => (planned, false),
        };
        let place = windows.first().map(|index| &campaign.windows[*index]);
        let (unloaded, loaded) = windows
            .iter()
            .partition(|index| is_unloaded(campaign, &campaign.windows[**index]));
        Self {
            strap: (
                bare,
                place.map_or(0, |window| window.pose),
                place.map_or(0, |window| window.mounting),
            ),
            name,
            compensated: is_stated || is_on,
            unloaded,
            loaded,
        }
    }

    /// Returns the first row without a load; `window` is the one that wants it.
    fn zero<const N: usize>(
        &self,
        campaign: &Campaign<N>,
        window: usize,
    ) -> Result<usize, VerifyError> {
        self.unloaded.first().copied().ok_or_else(|| {
            let reason = "its series has no row without a load, so its gauges have no zero";
            refused(campaign, &campaign.windows[window], reason)
        })
    }

    /// Windows with a load by their names.
    fn by_name<'c, const N: usize>(
        &self,
        campaign: &'c Campaign<N>,
    ) -> HashMap<&'c str, Vec<usize>> {
        let mut by_name: HashMap<&str, Vec<usize>> = HashMap::new();
        for &index in &self.loaded {
            by_name
                .entry(&campaign.windows[index].window)
                .or_default()
                .push(index);
        }
        by_name
    }
}

/// Pairs within a series.
fn within<const N: usize>(
    campaign: &Campaign<N>,
    series: &SeriesHalf<'_>,
) -> Result<SeriesPairs, VerifyError> {
    let by_name = series.by_name(campaign);
    let mut pairs = Vec::new();
    for &index in &series.loaded {
        let window = &campaign.windows[index];
        let zero = series.zero(campaign, index)?;
        match by_name.get(window.window.as_str()).map(Vec::as_slice) {
            Some([one, other]) if *one == index => {
                let away = [*one, *other].map(|index| away(campaign, index, zero));
                check(campaign, [*one, *other], away)?;
                pairs.push(if away[0] < away[1] {
                    [*one, *other]
                } else {
                    [*other, *one]
                });
            }
            // The second of a pair.
            Some([_, _]) => {}
            _ => {
                let name = &window.window;
                let reason = format!(
                    "window {name:?} must occur twice in its series, with compensation off and on, or once in each of two series"
                );
                return Err(refused(campaign, window, &reason));
            }
        }
    }
    Ok(SeriesPairs {
        name: series.name.to_owned(),
        unloaded: vec![series.unloaded.clone()],
        pairs,
    })
}

/// Pairs of a series without compensation and one with it.
fn across<const N: usize>(
    campaign: &Campaign<N>,
    off: &SeriesHalf<'_>,
    on: &SeriesHalf<'_>,
) -> Result<SeriesPairs, VerifyError> {
    let [of_off, of_on] = [off, on].map(|half| half.by_name(campaign));
    for (half, other, of_other) in [(off, on, &of_on), (on, off, &of_off)] {
        for &index in &half.loaded {
            let window = &campaign.windows[index];
            if of_other
                .get(window.window.as_str())
                .is_none_or(|found| found.len() != 1)
            {
                let reason = format!(
                    "window {:?} must stand once in series {:?}, its other half",
                    window.window, other.name
                );
                return Err(refused(campaign, window, &reason));
            }
        }
    }
    let mut pairs = Vec::new();
    for &index in &off.loaded {
        let partner = of_on
            .get(campaign.windows[index].window.as_str())
            .and_then(|found| found.first());
        let Some(&partner) = partner else { continue };
        let zeros = [off.zero(campaign, index)?, on.zero(campaign, partner)?];
        let away = [
            away(campaign, index, zeros[0]),
            away(campaign, partner, zeros[1]),
        ];
        check(campaign, [index, partner], away)?;
        if away[0] > away[1] {
            let reason = "q has moved from that of its rows without a load: compensation was on";
            return Err(refused(campaign, &campaign.windows[index], reason));
        }
        pairs.push([index, partner]);
    }
    let unloaded = vec![off.unloaded.clone(), on.unloaded.clone()];
    Ok(SeriesPairs {
        name: off.strap.0.to_owned(),
        unloaded,
        pairs,
    })
}

/// Distance of the axes of two windows, q-units.
fn away<const N: usize>(campaign: &Campaign<N>, window: usize, zero: usize) -> f64 {
    (SVector::from(campaign.windows[window].q) - SVector::from(campaign.windows[zero].q)).norm()
}

/// Checks that two windows have the same load, and that the axes, `away` from where they are
/// without one, tell off from on.
fn check<const N: usize>(
    campaign: &Campaign<N>,
    pair: [usize; 2],
    away: [f64; 2],
) -> Result<(), VerifyError> {
    let [one, other] = pair.map(|index| &campaign.windows[index]);
    if !is_same_load(campaign, &one.load, &other.load) {
        let reason = format!(
            "the load is not that of line {}, the other window of the pair",
            one.line
        );
        return Err(refused(campaign, other, &reason));
    }
    if (away[0] - away[1]).abs() <= f64::EPSILON {
        let reason = format!(
            "q is that of line {}; with compensation on it contains the offsets",
            one.line
        );
        return Err(refused(campaign, other, &reason));
    }
    Ok(())
}

fn refused<const N: usize>(
    campaign: &Campaign<N>,
    window: &Window<N>,
    reason: &str,
) -> VerifyError {
    VerifyError::Pair {
        table: campaign.table.clone(),
        line: window.line,
        reason: reason.to_owned(),
    }
}

fn noise<const N: usize>(campaign: &Campaign<N>) -> Vector6<f64> {
    let force = campaign.noise.force_n;
    let moment = campaign.noise.moment_nm;
    Vector6::new(force, force, force, moment, moment, moment)
}

pub(super) fn is_unloaded<const N: usize>(campaign: &Campaign<N>, window: &Window<N>) -> bool {
    let is_pushed = window.pushes_n.amax() > UNLOADED_SD * campaign.noise.force_n;
    !is_pushed
        && window
            .load
            .iter()
            .zip(&noise(campaign))
            .all(|(value, sd)| value.abs() <= UNLOADED_SD * sd)
}

fn is_same_load<const N: usize>(
    campaign: &Campaign<N>,
    one: &Vector6<f64>,
    other: &Vector6<f64>,
) -> bool {
    let force = one.fixed_rows::<3>(0).norm();
    let moment = one.fixed_rows::<3>(3).norm();
    let sizes = [force, force, force, moment, moment, moment];
    let differences = (one - other).abs();
    let allowed = noise(campaign) * (2.0 * UNLOADED_SD);
    differences
        .iter()
        .zip(&allowed)
        .zip(sizes)
        .all(|((difference, noise), size)| *difference <= noise + SAME_LOAD * size)
}
