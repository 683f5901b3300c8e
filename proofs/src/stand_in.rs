//! Stand-ins for functions that a solver cannot compare with themselves: an unknown function each, of
//! which some numbers are chosen.
//!
//! They return a bit or a byte of their arguments, no matter which, so that two calls agree only if
//! both see the same arguments.

#[cfg(feature = "keys")]
mod keys;

use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use gantry_tau_core::control::session::config::{AxisConfig, NominalAccel};
use gantry_tau_core::units::PositionNm;
use gantry_tau_core::verification::control::Axis;

#[cfg(feature = "keys")]
pub use keys::{Places, choose_tag, mac, new_key, tag};

static BIT: AtomicU32 = AtomicU32::new(0);
static KEY: AtomicU32 = AtomicU32::new(0);
static PLACE: AtomicUsize = AtomicUsize::new(0);

/// Chooses the bit that [`nominal_stepped`] and [`nominal_accelerated`] return.
pub fn choose_bit(bit: u32) {
    BIT.store(bit, Ordering::Relaxed);
}

/// Comparison of a nominal reference with its limit, which is a product of two unknowns: an unknown
/// bit of the arguments. One that stands still is within any limit.
#[must_use]
pub fn nominal_stepped(from: PositionNm, to: PositionNm, axis: &AxisConfig, cycles: u32) -> bool {
    let limit = i64::from(axis.nominal_step_nm).rotate_left(32);
    let mixed = from.0 ^ to.0.rotate_left(16) ^ limit ^ i64::from(cycles);
    from != to && mixed.rotate_right(BIT.load(Ordering::Relaxed)) & 1 == 1
}

/// Comparison of the second difference of a nominal reference with its limit, of any machine at
/// once: an unknown bit of the arguments.
#[must_use]
pub fn nominal_accelerated(axis: &Axis, to: PositionNm, limit: NominalAccel) -> bool {
    let limit = i64::from(limit.nm.get()).rotate_left(32);
    let places = axis.nominal.0 ^ to.0.rotate_left(16) ^ axis.nominal_before.0.rotate_left(48);
    (places ^ limit).rotate_right(BIT.load(Ordering::Relaxed)) & 1 == 1
}

/// Chooses the byte that [`checksum`] depends on, and a key.
pub fn choose_checksum(key: u32, place: usize) {
    KEY.store(key, Ordering::Relaxed);
    PLACE.store(place, Ordering::Relaxed);
}

/// CRC-32: an unknown function of the number of bytes and of an unknown one of them.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u32 {
    let byte = bytes
        .get(PLACE.load(Ordering::Relaxed))
        .copied()
        .unwrap_or(0);
    let length = u16::try_from(bytes.len()).unwrap_or(u16::MAX);
    KEY.load(Ordering::Relaxed) ^ u32::from(byte) ^ (u32::from(length) << 8)
}
