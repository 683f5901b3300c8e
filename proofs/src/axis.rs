//! The second half of a tick, for one axis: T3 at the drive.

use gantry_tau_core::axis::Offsets;
use gantry_tau_core::session::act::drive_reference;
use gantry_tau_core::session::config::{AxisConfig, MAX_POSITION_NM};
use gantry_tau_core::units::PositionNm;

/// T3: what reaches a drive is inside the machine's travel, whatever the nominal reference and the offset; and it is
/// nominal plus offset wherever the nominal reference keeps to its own travel and the offset to `M`.
///
/// # Panics
/// When it does not hold.
pub fn reference_is_inside_travel(axis: &AxisConfig, nominal: PositionNm, offsets: &Offsets) {
    let travel = &axis.machine_travel;
    let (reference, _) = drive_reference(nominal, offsets, travel);
    let inside = travel.lower <= reference.position && reference.position <= travel.upper;
    assert!(inside, "T3: inside the travel");
    let own = &axis.nominal_travel;
    let within = own.lower <= nominal && nominal <= own.upper;
    if within && axis.limits.position.admits(offsets.position.0) {
        let sum = i128::from(nominal.0) + i128::from(offsets.position.0);
        assert!(
            i128::from(reference.position.0) == sum,
            "T3: only a faulty nominal clamps"
        );
    }
}

/// T3: from one tick to the next, with a fixed travel, the reference changes by at most what the nominal reference and the offset
/// change together. `|nominal| <= 2^61` nm.
///
/// # Panics
/// When it does not hold.
pub fn reference_moves_no_further(
    axis: &AxisConfig,
    (from, to): (PositionNm, PositionNm),
    (before, after): (&Offsets, &Offsets),
) {
    let bounded = |nominal: PositionNm| nominal.0.unsigned_abs() <= MAX_POSITION_NM.unsigned_abs();
    if !bounded(from) || !bounded(to) {
        return;
    }
    let travel = &axis.machine_travel;
    let (first, _) = drive_reference(from, before, travel);
    let (second, _) = drive_reference(to, after, travel);
    let nominal = from.0.abs_diff(to.0);
    let offset = before.position.0.abs_diff(after.position.0);
    assert!(
        first.position.0.abs_diff(second.position.0) <= nominal + u64::from(offset),
        "T3: no further than nominal and offset together"
    );
}
