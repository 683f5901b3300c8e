//! What is written is read back, bit for bit; what was edited is replayed, or refused with line and reason.

use gantry_tau_core::control::axis::{Actual, Offsets};
use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::message::{
    AxisLimits, Capabilities, ClientMessage, Command, Hello, Mode,
};
use gantry_tau_core::control::session::config::{AxisConfig, MissBudget, Parameters, Travel};
use gantry_tau_core::control::session::fsm::Connection;
use gantry_tau_core::control::session::{Cycle, Event, Events, Input, replay};
use gantry_tau_core::control::wire::{ContentError, FrameError};
use gantry_tau_core::units::{OffsetNm, PositionNm, Sequence, TorquePermille, VelocityUmS};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::replay::Findings;
use crate::replay::picture::Picture;

const OWNER: Connection = Connection(u64::MAX);

fn config<const N: usize>(random: &mut ChaCha8Rng) -> Config<N> {
    let step = random.random_range(100..50_000);
    let limits = AxisLimits {
        position: Limits::new(2_000_000, step, 2 * step, random.random_range(1..=step)).unwrap(),
        velocity: Limits::new(5_000, 200, 400, 50).unwrap(),
        torque: Limits::new(50, 5, 10, 1).unwrap(),
    };
    let reach = Travel::around_zero(random.random_range(1_000..1_000_000_000));
    let axis = AxisConfig {
        limits,
        ..AxisConfig::position_only(limits.position, reach, random.random())
    };
    let budget = MissBudget {
        window: random.random_range(1..=128),
        allowed: random.random(),
    };
    Config::new(Parameters {
        budget: random.random_bool(0.5).then_some(budget),
        capabilities: Capabilities(random.random()),
        kinematics_checksum: random.random(),
        echo_window: random.random(),
        ..Parameters::thesis([axis; N])
    })
    .unwrap()
}

fn offsets(random: &mut ChaCha8Rng) -> Offsets {
    let small = random.random_bool(0.9);
    Offsets {
        position: OffsetNm(if small {
            random.random_range(-9_999..=9_999)
        } else {
            random.random()
        }),
        velocity: VelocityUmS(if small {
            random.random_range(-999..=999)
        } else {
            random.random()
        }),
        torque: TorquePermille(random.random_range(-50..=50)),
    }
}

/// The command that answers the last State.
fn answer<const N: usize>(session: &Session<N>, random: &mut ChaCha8Rng) -> Event<N> {
    let discrete = &session.parts().discrete;
    Event::Message(ClientMessage::Command(Command {
        epoch: discrete.epoch,
        sequence: Sequence(discrete.accepted.0 + random.random_range(1..3)),
        echo: discrete.tick,
        mode: if random.random_bool(0.8) {
            Mode::Obtain
        } else {
            Mode::Submit
        },
        targets: std::array::from_fn(|_| offsets(random)),
    }))
}

/// Any event that a connection can make, of all kinds there are.
fn event<const N: usize>(session: &Session<N>, random: &mut ChaCha8Rng) -> Event<N> {
    let received = random.random();
    match random.random_range(0..19) {
        0 => Event::Flood,
        1 => Event::Closed,
        2 => Event::Broken(FrameError::Checksum),
        3 => Event::Broken(FrameError::Version { received }),
        4 => Event::Dropped(FrameError::Magic),
        5 => Event::Dropped(FrameError::Length),
        6 => Event::Dropped(FrameError::TooLong {
            length: random.random(),
        }),
        7 => Event::Malformed(ContentError::Reserved),
        8 => Event::Malformed(ContentError::Limits),
        9 => Event::Malformed(ContentError::Kind { received }),
        10 => Event::Malformed(ContentError::Code { received }),
        11 => Event::Malformed(ContentError::Axes {
            expected: N,
            received,
        }),
        12 => Event::Malformed(ContentError::Length {
            expected: 0,
            received: random.random_range(0..usize::MAX),
        }),
        13 => Event::Message(ClientMessage::Stop(Epoch(random.random()))),
        14 => Event::Message(ClientMessage::Goodbye(session.parts().discrete.epoch)),
        15 => Event::Message(ClientMessage::Hello(Hello {
            axes: received,
            capabilities: Capabilities(random.random()),
        })),
        16 => Event::Message(ClientMessage::Command(Command {
            epoch: Epoch(random.random()),
            sequence: Sequence(random.random()),
            echo: Tick(random.random()),
            mode: Mode::Submit,
            targets: std::array::from_fn(|_| offsets(random)),
        })),
        _ => answer(session, random),
    }
}

fn input<const N: usize>(session: &Session<N>, random: &mut ChaCha8Rng) -> Input<N> {
    let mut events = Events::new();
    let parameters = session.config().parameters();
    if session.owner().is_none() && random.random_bool(0.5) {
        let axes = u8::try_from(N).unwrap();
        let hello = Hello {
            axes,
            capabilities: parameters.capabilities,
        };
        events
            .push((OWNER, Event::Message(ClientMessage::Hello(hello))))
            .unwrap();
    } else if random.random_bool(0.9) {
        events.push((OWNER, answer(session, random))).unwrap();
    }
    let strange = random.random_bool(0.1);
    for _ in 0..if strange {
        random.random_range(1..8)
    } else {
        0
    } {
        let from = if random.random_bool(0.3) {
            OWNER
        } else {
            Connection(random.random())
        };
        events.push((from, event(session, random))).unwrap();
    }
    let wild = random.random_bool(0.02);
    let position = |random: &mut ChaCha8Rng| {
        PositionNm(if wild {
            random.random()
        } else {
            random.random_range(-99..99)
        })
    };
    let cycle = Cycle {
        elapsed: if wild { random.random() } else { 1 },
        nominal: std::array::from_fn(|_| position(random)),
        actual: std::array::from_fn(|_| Actual {
            position: PositionNm(random.random()),
            velocity: VelocityUmS(random.random()),
            torque: TorquePermille(random.random()),
        }),
        stop: random.random_bool(0.02),
        rearm: random.random_bool(0.5),
        next_epoch: Epoch(session.parts().discrete.epoch.0 + 1),
        arrival_us: random.random(),
    };
    Input { cycle, events }
}

/// A window of a session in which anything may have happened.
fn window<const N: usize>(seed: u64) -> Window<N> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let in_force = [Offsets {
        position: OffsetNm(random.random_range(-9..9)),
        ..Offsets::default()
    }; N];
    let tick = Tick(random.random_range(0..u64::MAX / 2));
    let epoch = Epoch(random.random_range(0..u64::MAX / 2));
    let config = config(&mut random);
    let mut session = Session::new(config, &in_force, [PositionNm(0); N], tick, epoch).unwrap();
    let mut black_box = Box::new(BlackBox::<N, 16>::new());
    for _ in 0..random.random_range(1..200) {
        let input = input(&session, &mut random);
        black_box.before_tick(&session);
        let output = session.tick(&input);
        black_box.after_tick(&input, &output, output.ended.is_some());
    }
    Window::of(&black_box).unwrap()
}

fn round_trip<const N: usize>(seed: u64) {
    let window = window::<N>(seed);
    let text = window.encode();
    let read = Window::decode("x", text.as_bytes()).unwrap();
    assert_eq!(read, window);
    assert_eq!(read.encode(), text);
    assert_eq!(axes("x", text.as_bytes()), Ok(N));
    assert_eq!(
        replay(&read.before, &read.entries).agreeing,
        read.entries.len()
    );
}

#[test]
fn an_empty_black_box_is_no_window() {
    assert_eq!(Window::of(&BlackBox::<3, 4>::new()), None);
}

#[test]
fn the_first_difference_is_the_field_that_was_changed() {
    let window = window::<6>(1);
    let recorded = &window.entries[0].output;
    assert_eq!(first_difference(recorded, recorded), None);
    let mut other = recorded.clone();
    other.state.axes[4].offsets.torque.0 = 7;
    let (field, _, replayed) = first_difference(recorded, &other).unwrap();
    assert_eq!((&*field, &*replayed), ("state.axes[4].offsets.torque", "7"));
}

/// Replaces `from`, once, in the line of that number.
fn edited(text: &str, line: usize, from: &str, to: &str) -> String {
    let lines = text.lines().enumerate().map(|(index, words)| {
        if index + 1 == line {
            assert!(
                words.contains(from),
                "{from} is not in line {line}: {words}"
            );
            words.replacen(from, to, 1)
        } else {
            words.to_owned()
        }
    });
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn an_edited_file_is_refused_with_line_and_reason() {
    let text = window::<3>(3).encode();
    for (line, from, to, words) in [
        (1, "black box", "white box", "line 1: this is no black box"),
        (1, "\"version\":1", "\"version\":2", "line 1: version is 2"),
        (
            1,
            "\"axes\":3",
            "\"axes\":4",
            "line 1: axes is 4, it must be 3",
        ),
        (
            1,
            "\"axes\":3",
            "\"axes\":-3",
            "line 1: axes: is -3, it must be from 0",
        ),
        (1, "\"ticks\":", "\"ticks\":1", "line 1 announces 1"),
        (1, "\"ticks\":", "\"tacks\":", "line 1: ticks: is missing"),
        (1, "}", ",\"more\":1}", "line 1: more: is unknown"),
        (2, "config", "confug", "line 2: config: is missing"),
        (
            2,
            "\"accel\":400",
            "\"accel\":1",
            "line 2: config.axes[0].limits.velocity: accel is 1",
        ),
        (
            2,
            "\"max\":50,",
            "\"max\":50000,",
            "line 2: config: axis 0: torque max",
        ),
        (
            2,
            "\"handshake_ticks\":1000",
            "\"handshake_ticks\":0",
            "line 2: config: handshake_ticks",
        ),
        (
            2,
            "\"echo_window\":",
            "\"echo_window\":1000",
            "line 2: config.echo_window: is 1000",
        ),
        (
            3,
            "\"torque\":{\"value\":0",
            "\"torque\":{\"value\":51",
            "line 3: before.axes[0].channels.torque: value 51",
        ),
        (
            3,
            "\"phase\":\"",
            "\"phase\":\"Not",
            "line 3: before.discrete.phase: \"Not",
        ),
        (
            3,
            "\"history\":\"0x",
            "\"history\":\"0xg",
            "line 3: before.discrete.history: must be",
        ),
        (
            3,
            "\"misses\":",
            "\"misses\":2",
            "line 3: before: contradicts itself",
        ),
        (
            4,
            "\"stop\":",
            "\"stop\":1,\"x\":",
            "line 4: input.cycle.stop: must be true or false",
        ),
        (
            4,
            "\"elapsed\":1",
            "\"elapsed\":1.5",
            "line 4: input.cycle.elapsed: is 1.5",
        ),
        (4, "{", "[", "line 4: "),
        (
            5,
            "\"events\":[",
            "\"events\":[[1,\"Flood\"],[1,\"Flut\"]],\"x\":[",
            "line 5: input.events[1][1]: \"Flut\"",
        ),
        (
            5,
            "\"references\":[",
            "\"references\":[],\"x\":[",
            "line 5: output.references: has 0 entries",
        ),
    ] {
        let file = edited(&text, line, from, to);
        let refused = Window::<3>::decode("a.jsonl", file.as_bytes())
            .unwrap_err()
            .to_string();
        assert!(refused.starts_with("a.jsonl, line "), "{refused}");
        assert!(refused.contains(words), "{words} is not in: {refused}");
    }
    let seventeen = format!(
        "\"events\":[{}],\"x\":[",
        vec!["[1,\"Flood\"]"; 17].join(",")
    );
    let file = edited(&text, 4, "\"events\":[", &seventeen);
    let refused = Window::<3>::decode("a", file.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("line 4: input.events: has 17 entries, at most 16"),
        "{refused}"
    );
}

#[test]
fn a_file_cut_anywhere_is_refused_and_never_panics() {
    let text = window::<3>(4).encode();
    assert!(Window::<3>::decode("x", text.as_bytes()).is_ok());
    // Without the last line's end it is still whole.
    for end in (0..text.len() - 1).rev().step_by(97) {
        let refused = Window::<3>::decode("x", &text.as_bytes()[..end]).unwrap_err();
        assert!(refused.to_string().starts_with("x, line "), "{refused}");
    }
}

proptest::proptest! {
    #[test]
    fn every_window_survives_the_round_trip(seed: u64) {
        round_trip::<3>(seed);
        round_trip::<6>(seed);
    }

    /// Whatever is done to a byte: a window or a reason, no panic.
    #[test]
    fn noise_is_read_or_refused(seed in 0..8_u64, places: Vec<(usize, u8)>) {
        let mut bytes = window::<3>(seed).encode().into_bytes();
        let length = bytes.len();
        for (place, byte) in places {
            bytes[place % length] = byte;
        }
        let _ = Window::<3>::decode("x", &bytes);
    }

    /// Other digits make another window: it replays to some finding and can be drawn, whatever its numbers say.
    #[test]
    fn any_digits_are_replayed_and_drawn(seed in 0..8_u64, places: Vec<(usize, u8)>) {
        let mut bytes = window::<3>(seed).encode().into_bytes();
        let head = bytes.iter().position(|byte| *byte == b'\n').unwrap();
        let digits: Vec<usize> = (head..bytes.len()).filter(|at| bytes[*at].is_ascii_digit()).collect();
        for (place, digit) in places.iter().take(8) {
            bytes[digits[place % digits.len()]] = b'1' + digit % 9;
        }
        if let Ok(window) = Window::<3>::decode("x", &bytes) {
            let findings = Findings::of(&window);
            proptest::prop_assert!(Picture::of(&window, &findings).svg("x").ends_with("</svg>\n"));
        }
    }
}
