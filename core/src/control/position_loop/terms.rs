//! Terms of a position loop: one multiplication each, in sign and magnitude, so that each is odd (T20).

use super::config::MAX_ERROR_NM;

/// `from - to`, cut to [`MAX_ERROR_NM`]; total.
#[inline]
#[must_use]
pub fn difference(from: i64, to: i64) -> i32 {
    let most = i64::from(MAX_ERROR_NM);
    let cut = from.saturating_sub(to).max(most.saturating_neg()).min(most);
    // Within ± 2^24.
    i32::try_from(cut).unwrap_or(0)
}

/// Weights a value by `weight * 2^-SHIFT`, rounding towards zero. For values within ± 2^25 the result is exact.
#[inline]
#[must_use]
pub fn weighted<const SHIFT: u32>(value: i32, weight: u16) -> i32 {
    let magnitude = u64::from(value.unsigned_abs()).saturating_mul(u64::from(weight)) >> SHIFT;
    let magnitude = i32::try_from(magnitude).unwrap_or(i32::MAX);
    if value < 0 { magnitude.saturating_neg() } else { magnitude }
}

/// Integral of the loop, in 2^-10 µm/s: grows by `growth`, and stays within `most` (µm/s). It does not grow towards `short`, by which
/// the output is short of what was wanted.
#[inline]
#[must_use]
pub fn integrate(integral: i64, growth: i64, short: i64, most: i32) -> i64 {
    let winds_up = growth > 0 && short > 0 || growth < 0 && short < 0;
    let most = i64::from(most) << INTEGRAL_SHIFT;
    let grown = if winds_up { integral } else { integral.saturating_add(growth) };
    grown.max(most.saturating_neg()).min(most)
}

/// Binary digits of the integral below 1 µm/s.
pub const INTEGRAL_SHIFT: u32 = 10;
