use std::time::Duration;

use gantry_tau_core::control::message::{Cause, Phase};

use super::table::millimetres;
use super::*;
use crate::monitor::{AxisSnapshot, Channels, Counters, MachineName};

/// Screens of a terminal as it is opened, and of a large one.
const SMALL: Size = Size::USUAL;
const LARGE: Size = Size {
    columns: 132,
    rows: 43,
};

/// A machine in a crisis: every number is long, every flag set on one of its axes.
fn snapshot(axes: usize) -> Snapshot {
    let flags = [
        "clamped",
        "position_limited",
        "velocity_limited",
        "torque_limited",
        "nominal_step",
        "nominal_accel",
    ];
    let axis = AxisSnapshot {
        nominal_nm: -1_234_567_890,
        reference_nm: -1_234_567_890,
        offset: Channels {
            position_nm: -1_999_999,
            velocity_um_s: -2_000_000,
            torque_permille: -1_000,
        },
        shadow_nm: -1_999_999,
        actual: Channels {
            position_nm: -1_234_567_890,
            velocity_um_s: -2_000_000,
            torque_permille: -1_000,
        },
        lag_nm: Some(-12_345_600),
        flags: flags.to_vec(),
    };
    Snapshot {
        tick: 1_234_567_890,
        phase: Phase::SafeDisconnect,
        epoch: 1_234,
        cause: Cause::HandshakeTimeout,
        sequence: 1,
        on_time: 100,
        ramp_ticks_left: 20_000,
        counters: Counters::from([1_234_567, 123, 123, 123, 123, 123, 123, 123, 123, 123]),
        longest_miss_run: 123,
        machine_failed: true,
        rows_lost: true,
        axes: vec![axis; axes],
        drives: Some(vec!["quick_stop"; axes]),
        force: Some([-1_234.5; 6]),
        gauges_m: Some([-1.2345e-3; 3]),
        displacement_m: None,
        turn_rad: None,
        machine: Some(MachineName {
            name: "/home/someone/machines/a-machine-with-a-long-name/calibrated.toml".to_owned(),
            kinematics: 0x5f3a_09c1,
            lockstep: true,
        }),
    }
}

/// Events, the last first.
fn events() -> Vec<LoggedEvent> {
    (1..=50)
        .rev()
        .map(|number| LoggedEvent {
            number,
            at: UNIX_EPOCH,
            text: format!(
                "tick {number}: a machine failed, in so many words that they are longer than any screen is wide, up to the end, and there further, to here"
            ),
        })
        .collect()
}

fn shown(snapshot: &Snapshot, size: Size) -> Vec<String> {
    let connection = "connected to 127.0.0.1:7003";
    rendered(connection, Some(snapshot), events().iter(), size)
}

/// Numbers of the events that are shown.
fn numbers(lines: &[String]) -> Vec<u64> {
    lines
        .iter()
        .filter_map(|line| {
            line.split_once("Z tick ")?
                .1
                .split_once(':')?
                .0
                .parse()
                .ok()
        })
        .collect()
}

#[test]
fn the_screen_fits_and_leaves_out_nothing_but_old_events() {
    for (size, axes) in [(SMALL, 3), (SMALL, 6), (LARGE, 3), (LARGE, 6)] {
        let lines = shown(&snapshot(axes), size);
        assert_eq!(lines.len(), size.rows, "{lines:#?}");
        for line in &lines {
            assert!(line.chars().count() <= size.columns, "{line}");
        }
        let body: Vec<&String> = (lines.iter())
            .filter(|line| !line.contains("Z tick "))
            .collect();
        // Only the path of the robot file may be cut.
        for line in &body {
            assert!(
                !line.contains('…') || line.starts_with("machine "),
                "{line}"
            );
        }
        let text = body.iter().map(|line| line.as_str()).collect::<Vec<_>>();
        let text = text.join("\n");
        for words in [
            "connected to 127.0.0.1:7003",
            "machine /home/someone/machines",
            "LOCK-STEP: times are those of the machine",
            "safe disconnect epoch 1234",
            "tick 1 234 567 890",
            "on time 100/100",
            "cause of last end: handshake timeout",
            "ramp from here 20.0 s",
            "MACHINE FAILED",
            "ROWS LOST",
            "received 1 234 567",
            "missed 123 (longest 123)",
            "out of range 123",
            "strangers 123",
            "-1234.567 890",
            "-1999.999",
            "-12345.6",
            "-2000.000",
            "-100.0",
            "position limited",
            "nominal step",
            "nominal accel",
            "quick stop, quick stop, quick stop",
            "force -1234.5 -1234.5 -1234.5 N",
            "-1234.50 N m",
            "gauges -1234.5 -1234.5 -1234.5 µm",
        ] {
            assert!(text.contains(words), "{words}\n{text}");
        }
        let shown = numbers(&lines);
        let latest: Vec<u64> = (1..=50).rev().take(shown.len()).collect();
        assert_eq!(shown, latest);
    }
}

#[test]
fn a_larger_screen_shows_more() {
    let [small, large] = [SMALL, LARGE].map(|size| shown(&snapshot(6), size));
    assert!(numbers(&large).len() > numbers(&small).len() + 15);
    // The flags are beside their axes where there is room, and below them otherwise.
    let mut calm = snapshot(6);
    calm.axes.iter_mut().for_each(|axis| axis.flags.truncate(2));
    let large = shown(&calm, LARGE);
    assert!(
        large
            .iter()
            .any(|line| line.contains("-100.0  clamped position limited"))
    );
    assert!(
        small
            .iter()
            .any(|line| line.starts_with("clamped 1 2 3 4 5 6   position limited 1"))
    );
    // With a screen of few lines the state comes before the events.
    let few = shown(
        &snapshot(3),
        Size {
            columns: 40,
            rows: 5,
        },
    );
    assert_eq!(few.len(), 5);
    assert!(few[0].starts_with("connected to"));
}

/// As a user sees it on opening a terminal: heads above their numbers.
#[test]
fn columns_stand_below_their_heads() {
    for (size, ends) in [
        (
            SMALL,
            &[
                "nominal mm",
                "offset µm",
                "shadow µm",
                "actual mm",
                "lag µm",
                "v mm/s",
                "torque %",
            ],
        ),
        (
            LARGE,
            &[
                "nominal mm",
                "offset µm",
                "shadow µm",
                "actual mm",
                "lag µm",
                "v mm/s",
                "torque %",
            ],
        ),
    ] {
        let mut snapshot = snapshot(3);
        snapshot.phase = Phase::Submit;
        let lines = shown(&snapshot, size);
        let place = lines
            .iter()
            .position(|line| line.contains("nominal mm"))
            .unwrap();
        let (head, row): (Vec<char>, Vec<char>) = (
            lines[place].chars().collect(),
            lines[place + 1].chars().collect(),
        );
        for end in ends {
            let words: Vec<char> = end.chars().collect();
            let start = head
                .windows(words.len())
                .position(|window| window == words)
                .unwrap();
            let last = start + words.len() - 1;
            assert!(row[last].is_ascii_digit(), "{end}: {row:?}");
            assert!(row.get(last + 1).is_none_or(|next| *next == ' '), "{end}");
        }
    }
}

#[test]
fn a_server_that_is_lost_is_told_in_whole() {
    let trouble = "NO TICKS: no server answers on 127.0.0.1:7003 (connection refused); start one with `gantry-tau serve --labcomm 127.0.0.1:7003=state,axes,tool,session_event,drives,machine`";
    let lines = rendered(trouble, None, std::iter::empty(), SMALL);
    assert!(lines.len() <= 4, "{lines:#?}");
    assert_eq!(lines.join(" "), trouble);
}

#[test]
fn numbers_are_grouped_by_thousands() {
    for (number, text) in [
        (0, "0"),
        (999, "999"),
        (-1_000, "-1 000"),
        (1_234_567, "1 234 567"),
    ] {
        assert_eq!(grouped(number), text);
    }
    for (nm, text) in [
        (624_500_000, "624.500 000"),
        (-4, "-0.000 004"),
        (i64::MIN, "-9223372036854.775 808"),
    ] {
        assert_eq!(millimetres(nm), text);
    }
}

#[test]
fn the_time_of_day_is_that_of_the_epoch_modulo_a_day() {
    let at = UNIX_EPOCH + Duration::from_millis(86_400_000 * 20_000 + 43_201_123);
    assert_eq!(time_of_day(at), "12:00:01.123Z");
}
