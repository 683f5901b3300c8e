//! The pacer beside a channel that follows what it asks for, as a server's does.

use super::*;
use crate::control::fixture;
use std::vec::Vec;

const SETTINGS: Settings = Settings {
    latency_ticks: 60,
    hold_ticks: 200,
    give_up_ticks: 500,
    horizon_ticks: 10_000,
};

/// The thesis profile for positions: 2 mm, 5 µm per tick.
fn limits() -> Limits<OffsetNm> {
    fixture::limits(2_000_000, 5_000, 10_000, 100)
}

fn pacer() -> Pacer<1> {
    Pacer::new([limits()], SETTINGS, Tick(0)).unwrap()
}

fn target(at: u64, nm: i32) -> Target<1> {
    Target {
        at: Tick(at),
        offsets: [OffsetNm(nm)],
    }
}

/// Offset that the pacer asks for; `None` once it has given up.
fn asked(pacer: &mut Pacer<1>, now: u64) -> Option<i32> {
    match pacer.tick(Tick(now)) {
        Paced::Targets([offset]) => Some(offset.0),
        Paced::GiveUp => None,
    }
}

#[test]
fn targets_are_played_on_straight_lines_after_the_latency() {
    let wanted = |tick: u64| {
        let place = i32::try_from(tick).unwrap() - 1_500;
        500_000 - place * place / 5
    };
    let mut pacer = pacer();
    for now in 1..=3_000_u64 {
        // 30 Hz, each sent as it is wanted.
        if now % 33 == 0 {
            pacer.push(target(now, wanted(now))).unwrap();
        }
        let asked = asked(&mut pacer, now).unwrap();
        // Until then it is on its way to the first one.
        if now < 300 {
            continue;
        }
        let played = now - 60;
        let rest = i32::try_from(played % 33).unwrap();
        let from = wanted(played - played % 33);
        let to = wanted(played - played % 33 + 33);
        // To a nanometre.
        let off = (asked - from) * 33 - (to - from) * rest;
        assert!(off.abs() <= 33, "{now}: {asked} from {from} to {to}");
    }
}

#[test]
fn the_order_in_which_targets_come_does_not_matter() {
    let play = |order: [u64; 4]| {
        let mut pacer = pacer();
        for at in order {
            pacer
                .push(target(at, i32::try_from(at).unwrap() * 10))
                .unwrap();
        }
        (1..=200)
            .map(|now| asked(&mut pacer, now).unwrap())
            .collect::<Vec<_>>()
    };
    let expected = play([10, 40, 80, 120]);
    assert_eq!(play([120, 80, 40, 10]), expected);
    assert_eq!(play([80, 10, 120, 40]), expected);
    assert_eq!(expected[139], 800, "80 ticks and the latency");
}

#[test]
fn a_later_word_on_the_same_time_counts() {
    let mut pacer = pacer();
    pacer.push(target(10, 500)).unwrap();
    pacer.push(target(10, 300)).unwrap();
    assert_eq!(asked(&mut pacer, 70), Some(300));
}

#[test]
fn what_cannot_be_played_is_refused() {
    let mut pacer = pacer();
    assert!(asked(&mut pacer, 1_000).is_none(), "silent for too long");
    let mut pacer = self::pacer();
    for now in 1..=100 {
        asked(&mut pacer, now);
    }
    assert_eq!(
        pacer.push(target(40, 0)),
        Err(TargetError::Late { ticks: 0 })
    );
    assert_eq!(
        pacer.push(target(15, 0)),
        Err(TargetError::Late { ticks: 25 })
    );
    assert_eq!(
        pacer.push(target(10_103, 0)),
        Err(TargetError::Far { ticks: 3 })
    );
    assert_eq!(pacer.silent_ticks(), 100, "none of them was heard");
    for at in 0..u64::try_from(MAX_WAITING).unwrap() {
        pacer.push(target(200 + at, 0)).unwrap();
    }
    assert_eq!(pacer.push(target(150, 0)), Err(TargetError::Full));
    assert_eq!(
        pacer.push(target(200, 1)),
        Ok(()),
        "a word on one that waits"
    );
}

#[test]
fn silence_holds_and_then_gives_up() {
    let mut pacer = pacer();
    pacer.push(target(2_000, 200_000)).unwrap();
    let asked: Vec<_> = (1..=502).map(|now| asked(&mut pacer, now)).collect();
    let at = |tick: usize| asked[tick - 1];
    assert!(at(150) < at(200), "on its way");
    assert_eq!(at(201), at(200));
    assert_eq!(at(500), at(200));
    assert_eq!(at(501), None);
    assert_eq!(at(502), None);
}

#[test]
fn targets_after_a_silence_go_on_from_where_it_held() {
    let mut pacer = pacer();
    pacer.push(target(60, 30_000)).unwrap();
    for now in 1..=400 {
        asked(&mut pacer, now);
    }
    pacer.push(target(440, 60_000)).unwrap();
    // From 340, which was played last, to 440.
    assert_eq!(asked(&mut pacer, 401), Some(30_300));
    for now in 402..=500 {
        asked(&mut pacer, now);
    }
    assert_eq!(asked(&mut pacer, 501), Some(60_000));
}

#[test]
fn a_server_with_the_same_limits_limits_nothing() {
    let mut server = Channel::ZERO;
    let mut pacer = pacer();
    let far = [2_000_000, -2_000_000, i32::MAX, i32::MIN, 0];
    for now in 1..=5_000 {
        if now % 7 == 0 {
            let nm = far[usize::try_from(now).unwrap() % far.len()];
            let _ = pacer.push(target(now - now % 3, nm));
        }
        let wanted = OffsetNm(asked(&mut pacer, now).unwrap());
        server = server.follow(wanted, &limits());
        assert_eq!(server.value(), wanted, "{now}");
    }
}

#[test]
fn it_begins_again_from_what_is_in_force() {
    let mut pacer = pacer();
    pacer.push(target(60, 30_000)).unwrap();
    for now in 1..=100 {
        asked(&mut pacer, now);
    }
    pacer.restart(&[OffsetNm(1_000)]);
    assert_eq!(
        asked(&mut pacer, 101),
        Some(2_450),
        "a twentieth of the way"
    );
    pacer.restart(&[OffsetNm(3_000_000)]);
    assert_eq!(
        asked(&mut pacer, 102),
        Some(1_578),
        "from zero: no server has that"
    );
}

#[test]
fn ticks_that_go_back_or_far_ahead_do_no_harm() {
    let mut pacer = pacer();
    pacer.push(target(1, 1_000)).unwrap();
    assert_eq!(asked(&mut pacer, u64::MAX), None);
    let mut pacer = Pacer::new([limits()], SETTINGS, Tick(u64::MAX)).unwrap();
    assert_eq!(pacer.push(target(u64::MAX, 1_000)), Ok(()));
    assert_eq!(asked(&mut pacer, 0), Some(0));
    assert_eq!(pacer.silent_ticks(), 1);
}

#[test]
fn settings_are_checked() {
    let with = |change: fn(&mut Settings)| {
        let mut settings = SETTINGS;
        change(&mut settings);
        Pacer::<1>::new([limits()], settings, Tick(0)).err()
    };
    assert_eq!(with(|_| ()), None);
    assert_eq!(
        with(|settings| settings.latency_ticks = 100_001),
        Some(SettingsError::Latency(100_001))
    );
    assert_eq!(
        with(|settings| settings.give_up_ticks = 199),
        Some(SettingsError::GiveUp {
            give_up_ticks: 199,
            hold_ticks: 200
        })
    );
    assert_eq!(
        with(|settings| settings.horizon_ticks = 0),
        Some(SettingsError::Horizon(0))
    );
}
