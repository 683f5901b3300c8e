//! The loop against a drive that moves by its velocity reference, with latency, and against errors
//! and stops made by hand.

use super::config::{
    LoopConfig, LoopConfigError, LoopValue, LoopValues, MAX_ERROR_NM, MAX_WINDOW_NM,
};
use super::terms::{INTEGRAL_SHIFT, difference, fed_forward, integrate, weighted};
use super::*;
use crate::control::channel::Limits;
use crate::control::fixture::limits;
use std::collections::VecDeque;
use std::vec::Vec;

const WINDOW_NM: i32 = 2_000_000;
const WINDOW_TICKS: u16 = 10;

/// 80.2 1/s and a cycle of latency each way, up to 0.6 m/s with 10 m/s^2.
fn values() -> LoopValues {
    LoopValues {
        gain: 5_256,
        velocity_feed_forward: 1_024,
        torque_feed_forward: 2_621,
        integral: 0,
        integral_max: 0,
        lag: 3,
        window_nm: WINDOW_NM,
        window_ticks: WINDOW_TICKS,
        velocity: limits(600_000, 10_000, 20_000, 10_000),
        torque: limits(300, 100, 200, 50),
    }
}

fn config(values: LoopValues) -> LoopConfig {
    LoopConfig::new(values).unwrap()
}

fn reference(nm: i64) -> Reference {
    Reference {
        position: PositionNm(nm),
        velocity_offset: VelocityUmS(0),
        torque_offset: TorquePermille(0),
    }
}

fn input(nm: i64, actual: i64) -> LoopInput {
    LoopInput {
        reference: reference(nm),
        actual: Some(PositionNm(actual)),
        permit: Enable::Run,
    }
}

/// A loop that runs, at rest at zero.
fn running(config: &LoopConfig) -> PositionLoop {
    let mut axis = PositionLoop::at_rest(PositionNm(0));
    axis.tick(
        config,
        &LoopInput {
            permit: Enable::Rearm,
            ..input(0, 0)
        },
    );
    assert_eq!(axis.stop(), None);
    axis
}

/// A drive that moves by the velocity of `command` cycles ago and reports the position of `actual`
/// cycles ago.
struct Mover {
    position: i64,
    commands: VecDeque<i32>,
    reports: VecDeque<i64>,
}

impl Mover {
    fn new(command: usize, actual: usize) -> Self {
        Self {
            position: 0,
            commands: std::iter::repeat_n(0, command).collect(),
            reports: std::iter::repeat_n(0, actual + 1).collect(),
        }
    }

    fn measured(&self) -> i64 {
        self.reports[0]
    }

    fn cycle(&mut self, velocity: VelocityUmS) {
        self.commands.push_back(velocity.0);
        // A µm/s is a nm per cycle.
        self.position += i64::from(self.commands.pop_front().unwrap());
        self.reports.push_back(self.position);
        self.reports.pop_front();
    }
}

/// Position at a tick of a path that accelerates to 0.5 m/s with 2 m/s^2, nm.
fn path(tick: i64) -> i64 {
    let (ramp, speed) = (250, 500_000);
    if tick < ramp {
        tick * tick * speed / ramp / 2
    } else {
        (tick - ramp / 2) * speed
    }
}

/// Largest error on the path, nm.
fn worst_on_path(values: LoopValues, command: usize, actual: usize) -> i64 {
    let config = config(values);
    let (mut axis, mut drive) = (running(&config), Mover::new(command, actual));
    let mut worst = 0;
    for tick in 0..800 {
        let velocity = axis
            .tick(&config, &input(path(tick), drive.measured()))
            .velocity;
        assert_eq!(axis.stop(), None, "tick {tick}");
        assert!(axis.is_valid(&config));
        // Against the reference that could have acted.
        let lag = i64::try_from(command).unwrap();
        drive.cycle(velocity);
        worst = worst.max((path((tick - lag).max(0)) - drive.position).abs());
    }
    worst
}

#[test]
fn alignment_decides() {
    let wide = LoopValues {
        window_nm: MAX_WINDOW_NM,
        ..values()
    };
    // On an ideal drive the aligned feed-forward leaves its rounding, and nothing else.
    for (command, actual) in [(0, 0), (1, 0), (1, 1), (2, 2), (4, 5)] {
        let lag = u8::try_from(1 + command + actual).unwrap();
        let gain = u16::try_from(32_768 / (u32::from(lag) + 1))
            .unwrap()
            .min(5_256);
        let aligned = LoopValues { lag, gain, ..wide };
        assert!(
            worst_on_path(aligned, command, actual) < 2_100,
            "{command} + {actual}"
        );
        if lag == 3 {
            let without = worst_on_path(
                LoopValues {
                    velocity_feed_forward: 0,
                    ..aligned
                },
                command,
                actual,
            );
            assert!(
                (6_200_000..6_300_000).contains(&without),
                "v / Kv: {without}"
            );
            let misaligned = worst_on_path(LoopValues { lag: 0, ..aligned }, command, actual);
            assert!(
                (1_450_000..1_550_000).contains(&misaligned),
                "three cycles: {misaligned}"
            );
        }
    }
}

#[test]
fn a_step_is_followed_within_the_limits_and_without_overshoot() {
    let config = config(values());
    let (mut axis, mut drive) = (running(&config), Mover::new(1, 1));
    for _ in 0..300 {
        let velocity = axis
            .tick(&config, &input(1_000_000, drive.measured()))
            .velocity;
        drive.cycle(velocity);
        assert!(drive.position <= 1_000_000 + 1_000, "{}", drive.position);
    }
    assert!(
        (drive.position - 1_000_000).abs() < 20,
        "{}",
        drive.position
    );
}

#[test]
fn the_integral_takes_a_standing_error_away_and_keeps_its_limit() {
    for (integral_max, torque, is_enough) in [
        (20_000, values().torque, true),
        (20_000, Limits::DISABLED, true),
        (5_000, values().torque, false),
    ] {
        let config = config(LoopValues {
            integral: 20,
            integral_max,
            torque,
            ..values()
        });
        let (mut axis, mut drive) = (running(&config), Mover::new(1, 1));
        for _ in 0..2_000 {
            let velocity = axis.tick(&config, &input(0, drive.measured())).velocity;
            // Something pushes with 10 mm/s.
            drive.cycle(VelocityUmS(velocity.0 + 10_000));
            assert!(axis.parts().integral.abs() <= i64::from(integral_max) << INTEGRAL_SHIFT);
        }
        assert_eq!(drive.position.abs() < 100, is_enough, "{}", drive.position);
    }
}

#[test]
fn stopped_it_ramps_by_rho_and_waits_for_a_rearm_at_rest() {
    let config = config(values());
    for (stopped, why) in [
        (
            LoopInput {
                permit: Enable::Stop,
                ..input(0, 0)
            },
            LoopStop::NotPermitted,
        ),
        (
            LoopInput {
                actual: None,
                ..input(0, 0)
            },
            LoopStop::NoActual,
        ),
    ] {
        let mut axis = running(&config);
        let mut velocity = 0;
        while velocity < 35_000 {
            velocity = axis.tick(&config, &input(0, -1_500_000)).velocity.0;
        }
        axis.tick(&config, &stopped);
        assert_eq!(axis.stop(), Some(why));
        let mut left = velocity - 10_000;
        while left > 0 {
            left = (left - 10_000).max(0);
            // Allowed again, and re-armed, before it rests: it goes on to rest.
            let rearmed = LoopInput {
                permit: Enable::Rearm,
                ..input(0, 0)
            };
            assert_eq!(axis.tick(&config, &rearmed).velocity.0, left);
        }
        assert_eq!(
            axis.tick(&config, &input(0, -1_000_000)).velocity.0,
            0,
            "not without a re-arm"
        );
        let far = LoopInput {
            permit: Enable::Rearm,
            ..input(i64::from(WINDOW_NM) + 1, 0)
        };
        assert_eq!(
            (axis.tick(&config, &far).velocity.0, axis.stop()),
            (0, Some(why)),
            "not onto a far reference"
        );
        let near = LoopInput {
            permit: Enable::Rearm,
            ..input(i64::from(WINDOW_NM), 0)
        };
        assert!(axis.tick(&config, &near).velocity.0 > 0);
        assert_eq!(axis.stop(), None);
    }
}

#[test]
fn it_trips_in_the_last_tick_of_the_window_and_not_before() {
    // From rest to the velocity of the window's edge within the window's ticks.
    let config = config(LoopValues {
        velocity: limits(600_000, 20_000, 40_000, 10_000),
        ..values()
    });
    let far = i64::from(WINDOW_NM) + 1;
    for sign in [1, -1] {
        let mut axis = running(&config);
        for _ in 0..100 {
            axis.tick(&config, &input(0, sign * i64::from(WINDOW_NM)));
        }
        for _ in 0..WINDOW_TICKS - 1 {
            axis.tick(&config, &input(0, sign * far));
        }
        assert_eq!(axis.stop(), None);
        let before = axis.parts().velocity.count();
        axis.tick(&config, &input(0, sign * far));
        assert_eq!(axis.stop(), Some(LoopStop::FollowingError));
        assert_eq!(
            axis.parts().velocity.count().abs(),
            before.abs() - 10_000,
            "the first ramp step in that tick"
        );
        let mut other = running(&config);
        for tick in 0..200 {
            other.tick(
                &config,
                &input(0, if tick % 10 == 9 { 0 } else { sign * far }),
            );
        }
        assert_eq!(other.stop(), None, "nine of ten are not in a row");
    }
}

#[test]
fn limits_that_cut_the_velocity_for_longer_than_the_window_trip() {
    for (sign, torque) in [1, -1]
        .into_iter()
        .flat_map(|sign| [(sign, values().torque), (sign, Limits::DISABLED)])
    {
        let config = config(LoopValues { torque, ..values() });
        let mut axis = running(&config);
        // 160 mm/s are wanted, and 10 mm/s more per tick allowed.
        let edge = input(0, sign * i64::from(WINDOW_NM));
        for _ in 0..WINDOW_TICKS {
            axis.tick(&config, &edge);
            assert_eq!(axis.stop(), None);
        }
        let reached = axis.parts().velocity.count().abs();
        axis.tick(&config, &edge);
        assert_eq!(axis.stop(), Some(LoopStop::Limited));
        assert_eq!(
            axis.parts().velocity.count().abs(),
            reached - 10_000,
            "the first ramp step in that tick"
        );
        let mut other = running(&config);
        for tick in 0..200 {
            other.tick(
                &config,
                &input(
                    0,
                    if tick / 5 % 2 == 0 {
                        0
                    } else {
                        sign * i64::from(WINDOW_NM) / 4
                    },
                ),
            );
        }
        assert_eq!(other.stop(), None, "five ticks at a time");
    }
}

/// Found by the proofs' author: a window of the largest error that acts had nothing outside.
#[test]
fn an_error_beyond_all_bounds_trips_the_largest_window() {
    let config = config(LoopValues {
        window_nm: MAX_WINDOW_NM,
        ..values()
    });
    for far in [MAX_ERROR_NM, i64::MAX, i64::MIN] {
        let mut axis = running(&config);
        for _ in 0..WINDOW_TICKS {
            axis.tick(&config, &input(0, far));
        }
        assert_eq!(axis.stop(), Some(LoopStop::FollowingError), "{far}");
        while !axis.is_at_rest() {
            axis.tick(
                &config,
                &LoopInput {
                    permit: Enable::Stop,
                    ..input(0, far)
                },
            );
        }
        axis.tick(
            &config,
            &LoopInput {
                permit: Enable::Rearm,
                ..input(0, far)
            },
        );
        assert!(axis.stop().is_some(), "not onto a reference {far} away");
    }
    assert!(
        LoopConfig::new(LoopValues {
            window_nm: MAX_WINDOW_NM + 1,
            ..values()
        })
        .is_err()
    );
}

#[test]
fn offsets_are_added_and_bounded_too() {
    let config = config(values());
    let mut axis = running(&config);
    let pushed = Reference {
        velocity_offset: VelocityUmS(-700),
        torque_offset: TorquePermille(i16::MIN),
        ..reference(0)
    };
    let out = axis.tick(
        &config,
        &LoopInput {
            reference: pushed,
            ..input(0, 0)
        },
    );
    assert_eq!((out.velocity.0, out.torque.0), (-700, -100));
    for _ in 0..10 {
        axis.tick(
            &config,
            &LoopInput {
                reference: pushed,
                ..input(0, 0)
            },
        );
    }
    assert_eq!(axis.parts().torque.count(), -300);
}

#[test]
fn terms_are_total_and_exact_where_they_say() {
    assert_eq!(difference(i64::MAX, i64::MIN), MAX_ERROR_NM);
    assert_eq!(difference(i64::MIN, i64::MAX), -MAX_ERROR_NM);
    for value in [0, 1, 7, 1_000, MAX_ERROR_NM, 2 * MAX_ERROR_NM] {
        for weight in [0, 1, 5_256, 32_767] {
            let exact = (i128::from(value) * i128::from(weight)) >> 16;
            assert_eq!(i128::from(weighted(value, weight)), exact);
            assert_eq!(weighted(-value, weight), -weighted(value, weight));
        }
    }
    assert_eq!(
        [-1, 0, 1].map(|change| fed_forward(change, 512)),
        [-1, 0, 0],
        "rounded down"
    );
    assert_eq!(
        [difference(5, 0), difference(0, 5), difference(3, 3)],
        [5, -5, 0]
    );
    assert_eq!(integrate(0, i64::MAX, 0, 5), 5 << INTEGRAL_SHIFT);
    assert_eq!(integrate(7, 1, 1, 5), 7, "short above");
    assert_eq!(integrate(7, -1, 1, 5), 6);
    assert_eq!(integrate(7, -1, -1, 5), 7, "short below");
}

fn refused(values: LoopValues) -> LoopConfigError {
    LoopConfig::new(values).unwrap_err()
}

#[test]
fn configurations_are_refused_by_name() {
    for (values, value, found, lower, upper) in [
        (
            LoopValues {
                gain: 32_768,
                ..values()
            },
            LoopValue::Gain,
            32_768,
            0,
            32_767,
        ),
        (
            LoopValues {
                velocity_feed_forward: 1_229,
                ..values()
            },
            LoopValue::VelocityFeedForward,
            1_229,
            0,
            1_228,
        ),
        (
            LoopValues {
                torque_feed_forward: 32_768,
                ..values()
            },
            LoopValue::TorqueFeedForward,
            32_768,
            0,
            32_767,
        ),
        (
            LoopValues {
                integral: 1_229,
                ..values()
            },
            LoopValue::Integral,
            1_229,
            0,
            1_228,
        ),
        (
            LoopValues {
                integral_max: -1,
                ..values()
            },
            LoopValue::IntegralMax,
            -1,
            0,
            i32::MAX,
        ),
        (
            LoopValues {
                lag: 11,
                ..values()
            },
            LoopValue::Lag,
            11,
            0,
            10,
        ),
        (
            LoopValues {
                window_nm: 0,
                ..values()
            },
            LoopValue::WindowNm,
            0,
            1,
            MAX_WINDOW_NM,
        ),
        (
            LoopValues {
                window_ticks: 0,
                ..values()
            },
            LoopValue::WindowTicks,
            0,
            1,
            65_535,
        ),
        (
            LoopValues {
                torque: limits(32_768, 2, 4, 1),
                ..values()
            },
            LoopValue::TorqueMax,
            32_768,
            0,
            32_767,
        ),
    ] {
        assert_eq!(
            refused(values),
            LoopConfigError::OutOfRange {
                value,
                found,
                lower,
                upper
            }
        );
    }
    let fast = LoopValues {
        gain: 8_193,
        ..values()
    };
    assert_eq!(
        refused(fast),
        LoopConfigError::GainTimesLag {
            gain: 8_193,
            lag: 3
        }
    );
    assert!(
        LoopConfig::new(LoopValues {
            gain: 8_192,
            ..values()
        })
        .is_ok()
    );
    assert!(LoopConfig::new(LoopConfig::DISABLED.into()).is_ok());
}

fn channel(value: i32) -> Channel<VelocityUmS> {
    Channel::from_parts(VelocityUmS(value), 0, &limits(i32::MAX, 1, 2, 1)).unwrap()
}

#[test]
fn a_loop_of_the_wrong_shape_is_none() {
    let config = config(LoopValues {
        integral_max: 5,
        ..values()
    });
    let good = *running(&config).parts();
    let most = 5 << INTEGRAL_SHIFT;
    let torque = Channel::from_parts(TorquePermille(301), 0, &limits(400, 1, 2, 1)).unwrap();
    for (parts, is_valid) in [
        (good, true),
        (
            LoopParts {
                integral: most,
                outside: 9,
                velocity: channel(-600_000),
                ..good
            },
            true,
        ),
        (
            LoopParts {
                integral: most + 1,
                ..good
            },
            false,
        ),
        (
            LoopParts {
                integral: i64::MIN,
                ..good
            },
            false,
        ),
        (
            LoopParts {
                velocity: channel(600_001),
                ..good
            },
            false,
        ),
        (LoopParts { torque, ..good }, false),
        (
            LoopParts {
                outside: 10,
                ..good
            },
            false,
        ),
        (
            LoopParts {
                outside: 10,
                stop: Some(LoopStop::FollowingError),
                ..good
            },
            true,
        ),
    ] {
        let found = PositionLoop::from_parts(parts, &config);
        assert_eq!(found.map(|axis| *axis.parts()), is_valid.then_some(parts));
    }
}

/// Inputs of two axes with the reference at zero.
fn inputs(permit: Enable, actual: [Option<i64>; 2]) -> [LoopInput; 2] {
    actual.map(|actual| LoopInput {
        permit,
        actual: actual.map(PositionNm),
        ..input(0, 0)
    })
}

#[test]
fn axes_stop_together_and_run_together() {
    let config = [config(values()); 2];
    let mut loops = PositionLoops::at_rest(config, [PositionNm(0); 2]);
    assert_eq!(loops.stop(), Some((0, LoopStop::NotPermitted)));
    loops.tick(&inputs(Enable::Rearm, [Some(0), Some(-3_000_000)]), true);
    assert!(
        !loops.is_running() && loops.is_valid(),
        "one is too far away"
    );
    loops.tick(&inputs(Enable::Rearm, [Some(0), Some(-1_000_000)]), true);
    assert!(loops.is_running() && loops.stop().is_none());
    for _ in 0..5 {
        loops.tick(
            &inputs(Enable::Run, [Some(1_000_000), Some(-1_000_000)]),
            true,
        );
    }
    let moving = loops.axes().map(|axis| axis.parts().velocity.count());
    let out = loops.tick(&inputs(Enable::Run, [None, Some(-1_000_000)]), true);
    assert_eq!(
        out.map(|axis| axis.velocity.0),
        moving.map(|velocity| velocity - velocity.signum() * 10_000)
    );
    assert_eq!(loops.stop(), Some((0, LoopStop::NoActual)));
    assert_eq!(loops.axes()[1].stop(), Some(LoopStop::OtherAxis));
    assert!(loops.is_valid() && !loops.is_at_rest());
    let mut ticks = 0;
    while !loops.is_running() {
        loops.tick(&inputs(Enable::Rearm, [Some(0); 2]), true);
        ticks += 1;
        assert!(ticks < 100 && loops.is_valid());
    }
    let one_runs = [
        *running(&config[0]).parts(),
        *PositionLoop::at_rest(PositionNm(0)).parts(),
    ];
    let one_runs = one_runs.map(|parts| PositionLoop::from_parts(parts, &config[0]).unwrap());
    assert!(PositionLoops::from_parts(config, one_runs, one_runs).is_none());
    let histories: Vec<_> = loops
        .axes()
        .iter()
        .map(|axis| axis.parts().history)
        .collect();
    assert_eq!(histories, [[PositionNm(0); HISTORY]; 2]);
}

#[test]
fn refused_references_are_not_in_force() {
    let config = [config(values()); 2];
    let mut loops = PositionLoops::at_rest(config, [PositionNm(0); 2]);
    let actual = [Some(-1_000_000); 2];
    loops.tick(&inputs(Enable::Rearm, actual), true);
    let mut in_force = [0; 2];
    for _ in 0..4 {
        in_force = loops
            .tick(&inputs(Enable::Run, actual), true)
            .map(|axis| axis.velocity.0);
    }
    // Refused from here on: the drives keep what they have, and the next references begin there.
    for refused in 0..50 {
        let out = loops
            .tick(&inputs(Enable::Run, actual), refused == 0)
            .map(|axis| axis.velocity.0);
        let step = if refused == 0 { 10_000 } else { -10_000 };
        assert_eq!(out, in_force.map(|velocity| velocity + step), "{refused}");
        assert!(loops.is_valid());
    }
    assert_eq!(loops.stop(), Some((0, LoopStop::Refused)));
    let rearmed = loops
        .tick(&inputs(Enable::Rearm, actual), true)
        .map(|axis| axis.velocity.0);
    assert_eq!(
        rearmed,
        in_force.map(|velocity| velocity - 20_000),
        "accepted again: on to rest, and no re-arm before"
    );
}
