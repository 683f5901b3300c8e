//! Rides of two position loops: a configuration, and ticks.

use gantry_tau_tests::fuzzed::{LOOP_CONFIG, LOOP_TICK};

use super::Seed;

type Config = [u8; LOOP_CONFIG];
type Tick = [u8; LOOP_TICK];

fn words(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// 80.2 1/s, 100 % and 40 kg; a lag of 3 ticks, a window of 2 mm and 10 ticks, 0.6 m/s and 20
/// m/s^2.
fn usual() -> Config {
    let bytes = [
        words(&[5_256, 1_024, 2_621, 20, 625]),
        vec![3],
        words(&[7_812]),
        vec![10],
        words(&[18_750, 20_000, 10_000]),
        vec![125, 62, 12, 0],
    ];
    bytes.concat().try_into().unwrap()
}

/// A tick in which the reference moves and the actual position is off by so much, nm.
fn tick(kind: u8, switches: u8, moved: i32, off: i32) -> Tick {
    let mut bytes = [0; LOOP_TICK];
    (bytes[0], bytes[1]) = (kind, switches);
    bytes[2..6].copy_from_slice(&moved.to_le_bytes());
    bytes[6..10].copy_from_slice(&off.to_le_bytes());
    // The reference of three ticks ago, which is two before this one is taken.
    bytes[13] = 2;
    bytes
}

const STOP: u8 = 0;
const REARM: u8 = 1;
const RUN: u8 = 2;
const REFUSED: u8 = 1;
const UNKNOWN: u8 = 8;

/// More ticks behind those that follow.
fn then(follows: &[Tick], more: &[Tick]) -> Vec<Tick> {
    [follows, more].concat()
}

/// The usual configuration, changed.
fn unusual(change: fn(&mut Config)) -> Config {
    let mut config = usual();
    change(&mut config);
    config
}

pub(super) fn seeds() -> Vec<Seed> {
    let begins = [tick(REARM, 0, 0, 0)];
    let follows = [&begins[..], &[tick(RUN, 0, 500_000, 5_000); 30]].concat();
    let usual = usual();
    let seeds: [(&str, Config, Vec<Tick>); 13] = [
        (
            "nothing_runs_before_a_rearm",
            usual,
            vec![tick(RUN, 0, 100, 100); 12],
        ),
        ("follows", usual, follows.clone()),
        (
            "stopped_and_rearmed",
            usual,
            then(
                &follows,
                &[[tick(STOP, 0, 0, 0); 70], [tick(REARM, 0, 0, 0); 70]].concat(),
            ),
        ),
        (
            "position_unknown",
            usual,
            then(&follows, &[tick(RUN, UNKNOWN, 0, 0); 5]),
        ),
        (
            "trips",
            usual,
            then(&follows, &[tick(RUN, 0, 0, 2_000_100); 12]),
        ),
        (
            "nearly_trips",
            usual,
            then(
                &follows,
                &[[tick(RUN, 0, 0, -2_000_100); 9], [tick(RUN, 0, 0, 0); 9]].concat(),
            ),
        ),
        (
            "refused_once",
            usual,
            then(&follows, &[tick(RUN, REFUSED, 0, 0), tick(REARM, 0, 0, 0)]),
        ),
        (
            "refused_for_long",
            usual,
            then(&follows, &[tick(RUN, REFUSED, 500_000, 0); 70]),
        ),
        (
            "reference_at_the_ends",
            usual,
            then(
                &follows,
                &[tick(RUN, 6, 0, 0), tick(RUN, 4, 0, 0), tick(RUN, 6, 0, 0)],
            ),
        ),
        (
            "integral_winds_up",
            unusual(|config| config[7] = 4),
            then(&follows, &[tick(RUN, 0, 0, 1_900_000); 40]),
        ),
        (
            "compared_with_this_tick",
            unusual(|config| config[10] = 0),
            follows.clone(),
        ),
        (
            "gain_too_large",
            unusual(|config| config[1] = 0x7f),
            follows.clone(),
        ),
        (
            "window_of_no_tick",
            unusual(|config| config[13] = 0),
            follows.clone(),
        ),
    ];
    let seeds = seeds.into_iter().map(|(name, config, ticks)| {
        let bytes = config.into_iter().chain(ticks.into_iter().flatten());
        (name.to_owned(), bytes.collect())
    });
    seeds.collect()
}
