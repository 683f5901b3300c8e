//! Samples of the steering of a bus' cycle.

use gantry_tau_tests::fuzzed::{SAMPLE, SETTINGS};

use super::Seed;

/// First pulse of SYNC0, ns.
const START_NS: u64 = 1_000_000_000;

/// Settings and samples as the target reads them.
fn bytes(cycle_ns: u32, drift_ppm: i16, samples: &[(Option<u64>, u64)]) -> Vec<u8> {
    let mut bytes = cycle_ns.to_le_bytes().to_vec();
    bytes.extend(500_000_u32.to_le_bytes());
    bytes.extend(START_NS.to_le_bytes());
    bytes.extend(drift_ppm.to_le_bytes());
    assert_eq!(bytes.len(), SETTINGS);
    for (time_ns, late_ns) in samples {
        bytes.push(u8::from(time_ns.is_some()));
        bytes.extend(time_ns.unwrap_or(0).to_le_bytes());
        bytes.extend(late_ns.to_le_bytes());
    }
    assert_eq!((bytes.len() - SETTINGS) % SAMPLE, 0);
    bytes
}

/// Times of frames that pass by so much later than they should, a millisecond apart.
fn times(late_ns: i64, count: u64) -> Vec<(Option<u64>, u64)> {
    let time = |cycle: u64| (START_NS + cycle * 1_000_000 + 500_000).saturating_add_signed(late_ns);
    (0..count).map(|cycle| (Some(time(cycle)), 0)).collect()
}

pub(super) fn seeds() -> Vec<Seed> {
    let mut with_a_gap = times(1_000, 10);
    with_a_gap[5].0 = None;
    with_a_gap[6].1 = 200_000;
    let standing = vec![(Some(START_NS), 0); 5];
    let before_the_first_pulse = vec![(Some(START_NS - 3_200_000), 0), (Some(0), 0)];
    let named = [
        ("in_phase", bytes(1_000_000, 0, &times(0, 10))),
        ("late", bytes(1_000_000, 400, &times(30_000, 20))),
        ("far", bytes(1_000_000, -400, &times(450_000, 10))),
        (
            "one_missing_and_one_late_cycle",
            bytes(1_000_000, 20, &with_a_gap),
        ),
        ("standing", bytes(1_000_000, 1, &standing)),
        (
            "before_the_first_pulse",
            bytes(1_000_000, 0, &before_the_first_pulse),
        ),
        ("cycle_of_nothing", bytes(0, 0, &times(0, 3))),
        ("shortest_cycle", bytes(1, 0, &times(0, 3))),
        ("longest_cycle", bytes(u32::MAX, 0, &times(0, 3))),
    ];
    named.map(|(name, bytes)| (name.to_owned(), bytes)).into()
}
