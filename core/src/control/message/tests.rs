//! Flags and names, which are read beside the wire: in files, by scripts.

use std::collections::BTreeSet;
use std::format;

use super::*;
use crate::control::fixture::REFUSALS;

#[test]
fn bits_without_a_name_are_no_flags() {
    let named = [
        AxisFlags::TRAVEL,
        AxisFlags::POSITION_LIMITED,
        AxisFlags::VELOCITY_LIMITED,
        AxisFlags::TORQUE_LIMITED,
        AxisFlags::NOMINAL_STEP,
        AxisFlags::NOMINAL_ACCEL,
    ];
    let mut all = AxisFlags::default();
    for flag in named {
        assert!(!all.contains(flag));
        assert_eq!(
            AxisFlags::LIMITED.contains(flag),
            named[1..4].contains(&flag)
        );
        all = all.with(flag, true);
        assert_eq!(all.with(flag, true), all, "set twice is set");
        assert_eq!(all.with(AxisFlags::ALL, false), all);
    }
    assert_eq!(all, AxisFlags::ALL);
    for bits in 0..=u8::MAX {
        let read = AxisFlags::try_from(bits);
        let expected = if bits < 64 {
            Ok(bits)
        } else {
            Err(ContentError::Reserved)
        };
        assert_eq!(read.map(u8::from), expected);
    }
}

#[test]
fn a_refusal_has_the_name_of_its_variant() {
    let names: BTreeSet<_> = REFUSALS.iter().map(Refusal::name).collect();
    assert_eq!(names.len(), REFUSALS.len());
    for refusal in REFUSALS {
        let debug = format!("{refusal:?}");
        assert_eq!(debug.split(' ').next(), Some(refusal.name()));
    }
}
