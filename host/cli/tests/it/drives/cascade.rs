//! Following error of the profiles, and latency.

use gantry_tau_sim::drive::{Drive, Settings};

use super::{accelerating, actual, at, close, ideal, um};

/// Returns the largest lag on the way to 0.5 m/s, um.
fn lag_um(settings: &Settings) -> f64 {
    let mut drive = Drive::at_rest(&at(0), settings);
    let lags = (1..1_000).map(|cycle| {
        drive.command(&at(accelerating(cycle)));
        drive.advance(0.0);
        (accelerating(cycle) - actual(&drive).position.0).abs()
    });
    um(lags.max().unwrap())
}

/// The first is v / Kv, the third the same with the integral's `s / (s + Kv) (s + 1 / T)`: computed
/// apart, by a model in Python.
#[test]
fn feed_forward_and_integral_decide_the_lag() {
    for (position_integral_s, feed_forward, expected_um) in [
        (None, 0.0, 3_333.0),
        (None, 1.0, 5.3),
        (Some(0.05), 0.0, 664.0),
        (Some(0.05), 1.0, 4.8),
    ] {
        let lag_um = lag_um(&Settings {
            position_integral_s,
            feed_forward,
            ..ideal()
        });
        let of = (position_integral_s, feed_forward);
        assert!(
            close(lag_um, expected_um, 0.05),
            "{of:?}: {lag_um} um instead of {expected_um}"
        );
    }
}

/// The bits of reports without load, with this latency.
fn reports(settings: &Settings) -> Vec<(i64, i32, i16)> {
    let mut drive = Drive::at_rest(&at(0), settings);
    (1..600)
        .map(|cycle| {
            drive.command(&at(accelerating(cycle)));
            drive.advance(0.0);
            let actual = actual(&drive);
            (actual.position.0, actual.velocity.0, actual.torque.0)
        })
        .collect()
}

#[test]
fn latency_delays_and_changes_nothing_else() {
    let now = reports(&ideal());
    for (command_delay_cycles, actual_delay_cycles) in [(1, 0), (0, 1), (1, 1), (5, 5)] {
        let later = reports(&Settings {
            command_delay_cycles,
            actual_delay_cycles,
            ..ideal()
        });
        let delay = usize::from(command_delay_cycles + actual_delay_cycles);
        assert_eq!(later[..delay], vec![(0, 0, 0); delay]);
        assert_eq!(later[delay..], now[..now.len() - delay]);
    }
}

/// An overcurrent of 1.5 rated torques uses up the area of 2 rated torques for 7 s after 14 / 1.5
/// s.
#[test]
fn a_peak_current_ends() {
    let mut drive = Drive::at_rest(
        &at(0),
        &Settings {
            peak_s: Some(7.0),
            ..ideal()
        },
    );
    let limited = (1..20_000).find(|_| {
        drive.advance(-2_500.0);
        actual(&drive).torque.0 <= 1_001
    });
    let seconds = f64::from(limited.unwrap()) * 1e-3;
    assert!(close(seconds, 14.0 / 1.5, 0.01), "{seconds} s");
    for _ in 0..100 {
        drive.advance(-2_500.0);
        assert!(actual(&drive).torque.0 <= 1_001);
    }
    // Half of the area comes back in 7 s without current, and then the whole limit.
    let before = actual(&drive).position.0;
    assert!(
        before < -1_000_000,
        "rated torque does not hold it: {before} nm"
    );
    for _ in 0..9_000 {
        drive.advance(0.0);
    }
    for _ in 0..200 {
        drive.advance(-2_500.0);
    }
    assert!((actual(&drive).torque.0 - 2_500).abs() < 10, "{drive:?}");
}

/// A cart on a guideway with friction coasts v^2 m / (2 F), and a force below the breakaway does
/// not move it.
#[test]
fn friction_sticks_and_slides() {
    use gantry_tau_sim::drive::profile::Friction;
    let settings = Settings {
        friction: Friction {
            sliding_n: 60.0,
            breakaway_n: 90.0,
        },
        ..ideal()
    };
    let mut drive = Drive::at_rest(&at(0), &settings);
    for load_n in [50.0, -89.0] {
        for _ in 0..50 {
            drive.advance(load_n);
        }
        assert_eq!(
            (drive.position_m(), actual(&drive).torque.0),
            (0.0, 0),
            "{load_n} N"
        );
    }
    for _ in 0..300 {
        drive.advance(100.0);
    }
    // It has moved once, was brought back, and sticks with what the friction holds.
    let held = f64::from(actual(&drive).torque.0);
    assert!((-190.0..=-10.0).contains(&held), "{held} N");
    // In slow motion the torque is that of sliding, both ways.
    for sign in [1.0, -1.0] {
        let step = if sign > 0.0 { 2_000 } else { -2_000 };
        let start = actual(&drive).position.0;
        for cycle in 1..2_000 {
            drive.command(&at(start + cycle * step));
            drive.advance(0.0);
        }
        let torque = f64::from(actual(&drive).torque.0) * sign;
        assert!(close(torque, 60.0 + 200.0 * 2e-3, 0.05), "{torque} N");
    }
}
