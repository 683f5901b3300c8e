//! Counts of a drive's encoder, and nanometres of the reference path. Integers only: one
//! multiplication and one shift each way.

use gantry_tau_core::units::PositionNm;

/// Bits behind the point of a factor.
const FRACTION: u32 = 40;
/// Largest magnitude that is converted, nm or counts: products stay far within 128 bits.
const MAX_COUNT: u64 = 1 << 53;

/// Scale of one drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EncoderScale {
    /// Counts per nanometre, with its sign, in steps of 2^-40.
    counts_per_nm: i64,
    /// Nanometres per count, in the same form.
    nm_per_count: i64,
    /// Counts at position zero.
    zero: i64,
}

impl EncoderScale {
    /// Creates a scale of `counts_per_m` counts per metre, negative for a drive that counts
    /// backwards, with `zero` counts at position zero. `None` beyond 10^6 to 10^12 counts per
    /// metre, and for a `zero` beyond 32 bits.
    #[must_use]
    pub fn new(counts_per_m: f64, zero: i64) -> Option<Self> {
        if !(1e6..=1e12).contains(&counts_per_m.abs()) || i32::try_from(zero).is_err() {
            return None;
        }
        let one = 2_f64.powi(40);
        let counts_per_nm = (counts_per_m * 1e-9 * one).round() as i64;
        let nm_per_count = (1e9 / counts_per_m * one).round() as i64;
        Some(Self {
            counts_per_nm,
            nm_per_count,
            zero,
        })
    }

    /// Counts of a position; `None` beyond the 32 bits of object 607Ah.
    #[must_use]
    pub fn counts(&self, position: PositionNm) -> Option<i32> {
        i32::try_from(scaled(position.0, self.counts_per_nm)?.checked_add(self.zero)?).ok()
    }

    /// Position of counts.
    #[must_use]
    pub fn position(&self, counts: i64) -> Option<PositionNm> {
        scaled(counts.checked_sub(self.zero)?, self.nm_per_count).map(PositionNm)
    }

    /// Counts of a difference of positions, or of a velocity in nm/s; `None` beyond 32 bits.
    #[must_use]
    pub fn difference(&self, nm: i64) -> Option<i32> {
        i32::try_from(scaled(nm, self.counts_per_nm)?).ok()
    }

    /// Difference of positions, nm, of a difference of counts.
    #[must_use]
    pub fn nanometres(&self, counts: i64) -> Option<i64> {
        scaled(counts, self.nm_per_count)
    }

    /// 1, or -1 for a drive that counts backwards.
    #[must_use]
    pub const fn sign(&self) -> i64 {
        self.counts_per_nm.signum()
    }
}

/// Product, rounded to the nearest integer; `None` beyond the range.
fn scaled(value: i64, factor: i64) -> Option<i64> {
    if value.unsigned_abs() > MAX_COUNT {
        return None;
    }
    let half = 1_i128 << (FRACTION - 1);
    i64::try_from((i128::from(value) * i128::from(factor) + half) >> FRACTION).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_come_back_within_half_a_count() {
        // 2^20 counts for 10 mm; a coarse one; a fine one; each both ways.
        for counts_per_m in [1_048_576e2, 1.0e6, 1.0e9, -1_048_576e2, -3.3e7] {
            let scale = EncoderScale::new(counts_per_m, -123_456).unwrap();
            for nm in [0, 1, -1, 999_999_999, -2_000_000_000, 1_234_567_891] {
                let Some(counts) = scale.counts(PositionNm(nm)) else {
                    assert!(
                        (nm as f64 * 1e-9 * counts_per_m).abs() > 2.1e9,
                        "{counts_per_m} {nm}"
                    );
                    continue;
                };
                // Independently, in floats: exact far beyond a count here.
                let expected = nm as f64 * 1e-9 * counts_per_m - 123_456.0;
                assert!(
                    (f64::from(counts) - expected).abs() < 0.51,
                    "{counts_per_m} {nm}: {counts} {expected}"
                );
                let back = scale.position(counts.into()).unwrap();
                let half_a_count = 0.5 / (counts_per_m.abs() * 1e-9) + 0.51;
                assert!(
                    ((back.0 - nm) as f64).abs() <= half_a_count,
                    "{counts_per_m} {nm}: {back:?}"
                );
            }
        }
    }

    #[test]
    fn neighbours_are_in_order() {
        let scale = EncoderScale::new(1_048_576e2, 0).unwrap();
        let mut last = scale.counts(PositionNm(-10_000)).unwrap();
        for nm in -9_999..10_000 {
            let next = scale.counts(PositionNm(nm)).unwrap();
            assert!((0..=1).contains(&(next - last)), "{nm}");
            last = next;
        }
    }

    #[test]
    fn what_cannot_be_a_scale_is_none() {
        for counts_per_m in [0.0, 1e5, 1e13, f64::NAN, f64::INFINITY] {
            assert_eq!(EncoderScale::new(counts_per_m, 0), None);
        }
        assert_eq!(EncoderScale::new(1e8, 1 << 31), None);
        let scale = EncoderScale::new(1e9, 0).unwrap();
        assert_eq!(scale.counts(PositionNm(1 << 31)), None);
        assert_eq!(scale.counts(PositionNm(i64::MAX)), None);
        assert_eq!(scale.position(i64::MIN), None);
    }
}
