//! Terms of a position loop: one multiplication each. The proportional and the torque term are in
//! sign and magnitude, so that they are odd (T20).

use super::config::MAX_ERROR_NM;

/// `from - to`, cut to ± [`MAX_ERROR_NM`]; total.
#[inline]
#[must_use]
pub fn difference(from: i64, to: i64) -> i64 {
    match from.checked_sub(to) {
        Some(difference)
            if MAX_ERROR_NM.wrapping_neg() <= difference && difference <= MAX_ERROR_NM =>
        {
            difference
        }
        _ => beyond(from, to),
    }
}

/// Difference of positions that are far apart.
#[cold] // Otherwise both cases are computed every time: 7 % more instructions per tick.
const fn beyond(from: i64, to: i64) -> i64 {
    if from < to {
        MAX_ERROR_NM.wrapping_neg()
    } else {
        MAX_ERROR_NM
    }
}

/// Product of a value within ± 2^25 and a weight: below 2^41, so nothing wraps. A function of its
/// own, because a solver cannot compare two products: in proofs any function takes its place.
#[inline]
#[must_use]
pub fn product(value: i64, weight: u16) -> i64 {
    value.wrapping_mul(i64::from(weight))
}

/// Weights a value within ± 2^25 by `weight * 2^-16`, rounding towards zero.
#[inline]
#[must_use]
pub fn weighted(value: i64, weight: u16) -> i64 {
    let magnitude = product(value.wrapping_abs(), weight) >> 16;
    if value < 0 {
        magnitude.wrapping_neg()
    } else {
        magnitude
    }
}

/// Weights a change within ± 2^25 by `weight * 2^-10`, rounding down; exact with a weight of 1 024.
#[inline]
#[must_use]
pub fn fed_forward(change: i64, weight: u16) -> i64 {
    product(change, weight) >> 10
}

/// Integral of the loop, in 2^-10 µm/s: grows by `growth`, and stays within `most` (µm/s). It does
/// not grow towards `short`, by which the output is short of what was wanted.
#[inline]
#[must_use]
pub fn integrate(integral: i64, growth: i64, short: i64, most: i32) -> i64 {
    let winds_up = short != 0 && (growth < 0) == (short < 0);
    let most = i64::from(most) << INTEGRAL_SHIFT;
    let grown = if winds_up {
        integral
    } else {
        integral.saturating_add(growth)
    };
    grown.max(most.saturating_neg()).min(most)
}

/// Binary digits of the integral below 1 µm/s.
pub const INTEGRAL_SHIFT: u32 = 10;
