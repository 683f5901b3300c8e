//! Wrench at the tool as the force sensor shows it, in integers: what a State tells its client.

use super::{ForceMn, MomentUnm, nearest_within};

/// Millinewtons per newton, then micronewton metres per newton metre.
const PER_SI: [f64; 6] = [1e3, 1e3, 1e3, 1e6, 1e6, 1e6];

/// Sample of the force sensor. Nothing in core depends on it: it goes from the input of a tick to
/// the State of the same tick.
///
/// At home of the L2 of `robots/l2.toml` half a unit of one component moves a correction by 0.5 nm
/// or less, half of the step of an offset.
///
/// ```
/// use gantry_tau_core::units::{ForceMn, MomentUnm, WrenchSample};
/// let sample = WrenchSample::from_si(&[1.5, 0.0, -20.0, 0.0, 0.25, 0.0], 0).unwrap();
/// assert_eq!(sample.force[2], ForceMn(-20_000));
/// assert_eq!(sample.moment[1], MomentUnm(250_000));
/// assert_eq!(WrenchSample::from_si(&[f64::NAN; 6], 0), None);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(kani, derive(kani::Arbitrary))]
pub struct WrenchSample {
    /// Ticks since it was measured. 0: in the reading of this tick; 255: 255 or more.
    pub age: u8,
    /// A component was cut to its range: not to be used as a measurement.
    pub is_cut: bool,
    /// Force, the sensor's axes.
    pub force: [ForceMn; 3],
    /// Moment about the sensor's origin, the sensor's axes.
    pub moment: [MomentUnm; 3],
}

impl WrenchSample {
    /// Rounds force (N), then moment (N m) to the nearest; what is beyond the range is cut, and
    /// said so. `None` with a NaN: there is no sample.
    #[must_use]
    pub fn from_si(wrench: &[f64; 6], age: u8) -> Option<Self> {
        let (mut counts, mut is_cut) = ([0; 6], false);
        for ((count, value), per_si) in counts.iter_mut().zip(wrench).zip(PER_SI) {
            let (nearest, beyond) = nearest_within(value * per_si, i32::MAX)?;
            *count = nearest;
            is_cut |= beyond;
        }
        Some(Self {
            is_cut,
            ..Self::of_counts(age, counts)
        })
    }

    /// Returns force (N), then moment (N m).
    #[must_use]
    pub fn to_si(&self) -> [f64; 6] {
        let mut wrench = self.counts().map(f64::from);
        for (value, per_si) in wrench.iter_mut().zip(PER_SI) {
            *value /= per_si;
        }
        wrench
    }

    /// Returns a sample that was not cut of force (mN), then moment (µN m).
    pub(crate) const fn of_counts(age: u8, counts: [i32; 6]) -> Self {
        let [fx, fy, fz, mx, my, mz] = counts;
        Self {
            age,
            is_cut: false,
            force: [ForceMn(fx), ForceMn(fy), ForceMn(fz)],
            moment: [MomentUnm(mx), MomentUnm(my), MomentUnm(mz)],
        }
    }

    /// Returns force (mN), then moment (µN m).
    pub(crate) const fn counts(&self) -> [i32; 6] {
        let ([fx, fy, fz], [mx, my, mz]) = (self.force, self.moment);
        [fx.0, fy.0, fz.0, mx.0, my.0, mz.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_rounded_to_the_nearest() {
        let sample = WrenchSample::from_si(&[0.0005, -0.0005, 1.2344, 5e-7, -4e-7, -0.0], 7);
        let sample = sample.unwrap();
        assert_eq!(sample.force.map(|force| force.0), [1, -1, 1_234]);
        assert_eq!(sample.moment.map(|moment| moment.0), [1, 0, 0]);
        assert_eq!((sample.age, sample.is_cut), (7, false));
    }

    /// The range ends at the largest integer; a component beyond it is cut, an infinite one too.
    #[test]
    fn components_beyond_the_range_are_cut() {
        let end = f64::from(i32::MAX);
        let within = [end / 1e3, 0.0, 0.0, 0.0, -end / 1e6, 0.0];
        assert!(!WrenchSample::from_si(&within, 0).unwrap().is_cut);
        for (component, value) in [
            (0, 2_147_483.648),
            (1, f64::NEG_INFINITY),
            (2, 1e300),
            (3, 2_147.483_648),
            (4, -2_147.483_648),
            (5, f64::INFINITY),
        ] {
            let mut wrench = [0.0; 6];
            wrench[component] = value;
            let sample = WrenchSample::from_si(&wrench, 0).unwrap();
            assert!(sample.is_cut, "{value}");
            let shown = sample.to_si()[component];
            assert_eq!(shown.is_sign_negative(), value.is_sign_negative());
            assert!(shown.abs() <= end / 1e3);
        }
    }

    #[test]
    fn nan_is_no_sample() {
        for component in 0..6 {
            let mut wrench = [1.0; 6];
            wrench[component] = f64::NAN;
            assert_eq!(WrenchSample::from_si(&wrench, 0), None);
        }
    }

    #[test]
    fn si_units_come_back() {
        let wrench = [12.345, -0.001, 2_000_000.0, 1.000_001, -2_000.0, 0.0];
        let sample = WrenchSample::from_si(&wrench, 0).unwrap();
        for (shown, given) in sample.to_si().into_iter().zip(wrench) {
            assert!((shown - given).abs() <= 1e-12 * given.abs());
        }
    }
}
