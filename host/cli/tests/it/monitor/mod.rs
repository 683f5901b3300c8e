//! `monitor`, against a double of the server's LabComm port.

#[cfg(target_os = "linux")]
mod screen;
#[cfg(unix)]
mod served;
mod web;

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_labcomm::samples::{Axes, SessionEvent, State};
use gantry_tau_labcomm::{Encoder, Field, Text, Version};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_test_support::labcomm_port::{Double, FIRST_TICK, HOME_NM, Scene};
use serde_json::{Value, json};

use crate::process::{Ended, Folder};

fn status(folder: &Folder, double: &Double) -> Ended {
    folder.run(&["monitor", &double.address.to_string(), "--status"])
}

/// Phase, cause, their names in JSON, exit status.
const PHASES: [(Phase, Cause, &str, &str, i32); 6] = [
    (Phase::Listening, Cause::None, "listening", "none", 0),
    (
        Phase::Handshake,
        Cause::HandshakeTimeout,
        "handshake",
        "handshake_timeout",
        0,
    ),
    (Phase::Submit, Cause::Closed, "submit", "closed", 0),
    (Phase::Obtain, Cause::Goodbye, "obtain", "goodbye", 0),
    (
        Phase::SafeDisconnect,
        Cause::ClientLate,
        "safe_disconnect",
        "client_late",
        3,
    ),
    (Phase::Fault, Cause::Stop, "fault", "stop", 4),
];

/// An axis of a scene that moves by 2 µm per tick, as `--status` prints it.
fn axis(number: i32, tick: i64) -> Value {
    let home = HOME_NM[usize::try_from(number).unwrap() - 1];
    let nominal = home + 2_000 * tick;
    let reference = nominal - 10_000 * i64::from(number);
    // The drive is 4 nm behind the reference of the tick before.
    let lag = if tick > FIRST_TICK {
        json!(4)
    } else {
        Value::Null
    };
    json!({
        "nominal_nm": nominal, "reference_nm": reference,
        "offset": {"position_nm": -10_000 * number, "velocity_um_s": number, "torque_permille": -2},
        "shadow_nm": 0,
        "actual": {"position_nm": reference - 2_004, "velocity_um_s": -3, "torque_permille": -12},
        "lag_nm": lag,
        "flags": if number == 2 { json!(["position_limited"]) } else { json!([]) },
    })
}

#[test]
fn the_status_has_every_number_and_the_exit_status_of_the_phase() {
    let folder = Folder::new("monitor_status");
    let own = RobotFile::builtin_l2().unwrap();
    for ((phase, cause, phase_key, cause_key, code), version) in PHASES.into_iter().zip(
        [Version::V2006, Version::V2014, Version::V2014_0]
            .into_iter()
            .cycle(),
    ) {
        let scene = Scene {
            version,
            step_nm: 2_000,
            ..Scene::of(phase, cause)
        };
        let ended = status(&folder, &Double::of(scene));
        assert_eq!(ended.code, Some(code), "{phase_key}: {}", ended.stderr);
        assert_eq!(ended.stdout.lines().count(), 1);
        let said: Value = serde_json::from_str(&ended.stdout).unwrap();
        let tick = said["tick"].as_i64().unwrap();
        assert!(tick >= FIRST_TICK);
        let expected = json!({
            "tick": tick, "phase": phase_key, "epoch": 7, "cause": cause_key, "sequence": tick - 100, "on_time": 99,
            "ramp_ticks_left": 1_890,
            "counters": {
                "received": 41_234, "missed": 3, "late": 2, "duplicate": 1, "stale": 4, "malformed": 5, "out_of_range": 6,
                "limited": 12, "clamped": 7, "strangers": 8,
            },
            "longest_miss_run": 1,
            "machine_failed": false, "rows_lost": false,
            "axes": [axis(1, tick), axis(2, tick), axis(3, tick)],
            "drives": ["operating", "ready", "quick_stop"],
            "force": [300.25, -0.5, -18.0, 0.05, -0.1, 0.02],
            "gauges_m": [0.000_19, 0.000_036, 0.000_024],
            "displacement_m": [1e-4, -5e-5, 2e-5],
            "turn_rad": [1e-5, 2e-5, 0.0],
            "machine": {"name": own.name, "kinematics": format!("{:08x}", own.checksum()), "lockstep": false},
        });
        assert_eq!(said, expected);
    }
}

#[test]
fn a_machine_that_failed_counts_more_than_the_phase() {
    let folder = Folder::new("monitor_failed");
    for (phase, failed) in [
        (Phase::Obtain, true),
        (Phase::Fault, true),
        (Phase::Listening, false),
    ] {
        let double = Double::of(Scene {
            machine_fails: true,
            ..Scene::of(phase, Cause::Stop)
        });
        // A second on: long after the failure.
        let ended = folder.run(&[
            "monitor",
            &double.address.to_string(),
            "--status",
            "--every",
            "0.05",
            "--quit-after",
            "1",
        ]);
        let last: Value = serde_json::from_str(ended.stdout.lines().last().unwrap()).unwrap();
        assert_eq!(last["machine_failed"], failed, "{phase:?}");
        assert_eq!(ended.code, Some(if failed { 5 } else { 0 }), "{phase:?}");
    }
}

#[test]
fn without_a_server_the_exit_status_is_six_and_the_command_to_start_one_is_told() {
    let folder = Folder::new("monitor_none");
    let address = Double::of(Scene::of(Phase::Obtain, Cause::None))
        .address
        .to_string();
    let said = folder.run(&["monitor", &address, "--status"]).failure(6);
    for word in [
        &address,
        "gantry-tau serve --labcomm",
        "state,axes,tool,session_event",
    ] {
        assert!(said.contains(word), "{said}");
    }
}

/// Bytes of a stream that an encoder writes.
fn stream(write: impl FnOnce(&mut Encoder<'_>)) -> Vec<u8> {
    let mut buffer = [0; 2_048];
    let mut encoder = Encoder::new(Version::V2006, &mut buffer);
    write(&mut encoder);
    encoder.bytes().to_vec()
}

#[test]
fn a_port_with_other_samples_is_told_by_name() {
    mod other {
        gantry_tau_labcomm::structure! {
            /// A sample with the name of the state.
            pub struct State {
                /// Number of the tick.
                pub tick: i64,
            }
        }
        impl gantry_tau_labcomm::Sample for State {
            const NAME: &'static str = "state";
        }
    }
    let folder = Folder::new("monitor_other");
    let state_only = stream(|encoder| {
        encoder.define::<State>(0x80).unwrap();
        encoder.data(0x80, &State::ZERO).unwrap();
    });
    let other_state = stream(|encoder| {
        encoder.define::<other::State>(0x80).unwrap();
        encoder.define::<Axes<3>>(0x81).unwrap();
        encoder.data(0x80, &other::State { tick: 1 }).unwrap();
    });
    let unknown_phase = stream(|encoder| {
        encoder.define::<State>(0x80).unwrap();
        encoder.define::<Axes<3>>(0x81).unwrap();
        encoder
            .data(
                0x80,
                &State {
                    phase: 9,
                    ..State::ZERO
                },
            )
            .unwrap();
        encoder.data(0x81, &Axes::<3>::ZERO).unwrap();
    });
    let long_text = [
        stream(|encoder| {
            encoder.define::<State>(0x80).unwrap();
            encoder.define::<Axes<3>>(0x81).unwrap();
            encoder.define::<SessionEvent>(0x82).unwrap();
        }),
        // Index, tick, kind and cause; the text's length, and the text.
        [&[0, 0, 0, 0x82][..], &[0; 10], &[0, 0, 1, 1], &[b'x'; 257]].concat(),
    ]
    .concat();
    let cases = [
        (
            long_text,
            "a sample `session_event` with a text above 256 bytes",
        ),
        (state_only, "does not publish the sample `axes`"),
        (other_state, "a sample `state` of another type"),
        (unknown_phase, "phase 9, which is unknown"),
        (
            b"HTTP/1.1 400 Bad Request\r\n\r\n".to_vec(),
            "does not send LabComm",
        ),
        (vec![0; 4_096], "does not send LabComm"),
        (Vec::new(), "the server is stopped or hangs"),
    ];
    for (bytes, words) in cases {
        let said = status(&folder, &Double::of_bytes(bytes)).failure(6);
        assert!(said.contains(words), "{said}");
    }
}

/// Bytes of definitions, then of these events, then of ticks 1 to `ticks`.
fn events_then_ticks(events: impl Iterator<Item = (i64, String)>, ticks: i64) -> Vec<u8> {
    let define = stream(|encoder| {
        encoder.define::<State>(0x80).unwrap();
        encoder.define::<Axes<3>>(0x81).unwrap();
        encoder.define::<SessionEvent>(0x82).unwrap();
    });
    let events = events.map(|(tick, text)| {
        let event = SessionEvent {
            tick,
            kind: 0,
            cause: 0,
            text: Text::cut(&text),
        };
        stream(|encoder| encoder.data(0x82, &event).unwrap())
    });
    let ticks = (1..=ticks).map(|tick| {
        stream(|encoder| {
            encoder
                .data(
                    0x80,
                    &State {
                        tick,
                        ..State::ZERO
                    },
                )
                .unwrap();
            encoder
                .data(0x81, &Axes::<3> { tick, ..Axes::ZERO })
                .unwrap();
        })
    });
    std::iter::once(define)
        .chain(events)
        .chain(ticks)
        .flatten()
        .collect()
}

fn number_between(line: &str, before: &str, after: &str) -> Option<usize> {
    let (front, _) = line.split_once(after)?;
    front.rsplit_once(before)?.1.parse().ok()
}

/// 60 events at once, of which a monitor keeps 50: the others are counted, and no order is changed.
#[test]
fn the_events_of_a_status_are_logged_in_their_order() {
    let folder = Folder::new("monitor_order");
    let events = (0..60).map(|number| (1, format!("event {number};")));
    let double = Double::of_bytes(events_then_ticks(events, 3));
    let mut monitor = folder.start(
        "run",
        &[
            "monitor",
            &double.address.to_string(),
            "--status",
            "--every",
            "0.05",
        ],
    );
    monitor.await_words("connected to");
    let said = monitor.stop().stderr;
    let shown: Vec<usize> = said
        .lines()
        .filter_map(|line| number_between(line, "event ", ";"))
        .collect();
    let lost: usize = said
        .lines()
        .filter_map(|line| number_between(line, " ", " events before this one"))
        .sum();
    assert_eq!(shown.last(), Some(&59), "{said}");
    assert!(shown.windows(2).all(|pair| pair[0] < pair[1]), "{said}");
    assert_eq!(shown.len() + lost, 60, "{said}");
}

/// Events of a tick that is far ahead, and more than a row has room for: some are recorded, and the
/// others counted.
#[test]
fn events_that_wait_for_their_tick_are_bounded() {
    let folder = Folder::new("monitor_waiting");
    let events = (0..1_000).map(|_| (20, "x".repeat(256)));
    let double = Double::of_bytes(events_then_ticks(events, 60));
    let address = double.address.to_string();
    let arguments = [
        "monitor",
        &address,
        "--status",
        "--every",
        "0.05",
        "--robot",
        "l2",
        "--record",
        "waiting.labcomm",
    ];
    let mut monitor = folder.start("run", &arguments);
    monitor.await_words("\"tick\":60");
    let said = monitor.stop().stderr;
    assert!(
        said.contains("936 events are not in the recording"),
        "{said}"
    );
    let lines = folder
        .run(&["labcomm", "decode", "waiting.labcomm"])
        .success();
    assert_eq!(lines.matches("\"sample\":\"session_event\"").count(), 64);
    assert_eq!(lines.matches("\"sample\":\"axes\"").count(), 60);
}

#[test]
fn a_lost_server_is_told_and_tried_again() {
    let folder = Folder::new("monitor_lost");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let address = double.address;
    let mut monitor = folder.start(
        "monitor",
        &[
            "monitor",
            &address.to_string(),
            "--status",
            "--every",
            "0.05",
        ],
    );
    monitor.await_words("\"phase\":\"submit\"");
    drop(double);
    monitor.await_words("the server has ended, or dropped this reader");
    monitor.await_words("no server answers");
    let again = Double::at(address, Scene::of(Phase::Obtain, Cause::None));
    monitor.await_words("\"phase\":\"obtain\"");
    drop(again);
}

#[test]
fn the_screen_shows_axes_force_and_events() {
    let folder = Folder::new("monitor_screen");
    let double = Double::of(Scene {
        offset_nm: -189_000,
        ..Scene::of(Phase::Obtain, Cause::Goodbye)
    });
    let mut monitor = folder.start(
        "monitor",
        &["monitor", &double.address.to_string(), "--quit-after", "30"],
    );
    // The lag is known from the second tick on.
    monitor.await_words("      0.0     -0.003");
    let said = monitor.stdout();
    for words in [
        "obtain          epoch 7",
        "on time 99/100   cause of last end: goodbye   ramp from here 1.9 s",
        "received 41 234  missed 3 (longest 1)  late 2",
        "\n1        624.500 000     -189.000            -      624.310 996      0.0     -0.003      -1.2\n",
        "\n2       -696.400 000     -378.000            -     -696.778 004      0.0     -0.003      -1.2  position limited\n",
        "\nmachine ",
        "\ndrives operating, ready, quick stop\n",
        "force   300.2    -0.5   -18.0 N     0.05  -0.10   0.02 N m   gauges   190.0    36.0    24.0 µm",
    ] {
        assert!(said.contains(words), "{words}\n{said}");
    }
    // A file is not a terminal: no escape sequences.
    assert!(!said.contains('\x1b'));
}
