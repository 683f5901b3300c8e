//! Files are read back bit for bit; edited files are replayed, or refused with line and reason.

use gantry_tau_core::control::axis::{Actual, InForce, Offsets};
use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::message::{
    AxisLimits, Capabilities, ClientMessage, Command, ContentError, FrameError, Hello, Mode,
};
use gantry_tau_core::control::session::config::{AxisConfig, Config, MissBudget, Parameters, Travel};
use gantry_tau_core::control::session::{
    Connection, Event, Events, Input, LastWrite, Reading, Start, TickInput, replay,
};
use gantry_tau_core::units::{EpochRange, OffsetNm, PositionNm, Sequence, TorquePermille, VelocityUmS};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::replay::Findings;
use crate::replay::picture::Picture;

const OWNER: Connection = Connection(u64::MAX);

fn limits<U>(max: i32, step: i32, accel: i32, ramp: i32) -> Limits<U> {
    let values = LimitValues { max, step, accel, ramp };
    Limits::new(values).unwrap()
}

fn config<const N: usize>(random: &mut ChaCha8Rng) -> Config<N> {
    let step = random.random_range(100..50_000);
    let limits = AxisLimits {
        position: limits(2_000_000, step, 2 * step, random.random_range(1..=step)),
        velocity: limits(5_000, 200, 400, 50),
        torque: limits(50, 5, 10, 1),
    };
    let reach = Travel::around_zero(random.random_range(1_000..1_000_000_000));
    let axis = AxisConfig { limits, ..AxisConfig::position_only(limits.position, reach, random.random()) };
    let budget = MissBudget { window: random.random_range(1..=128), allowed: random.random() };
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
    let is_small = random.random_bool(0.9);
    let mut value = |small: i32| match is_small {
        true => random.random_range(-small..=small),
        false => random.random(),
    };
    Offsets {
        position: OffsetNm(value(9_999)),
        velocity: VelocityUmS(value(999)),
        torque: TorquePermille(random.random_range(-50..=50)),
    }
}

/// Returns the command that answers the last State; `accepted` is the sequence of the last accepted command.
fn answer<const N: usize>(session: &Session<N>, accepted: Sequence, random: &mut ChaCha8Rng) -> Event<N> {
    Event::Message(ClientMessage::Command(Command {
        epoch: session.epoch(),
        sequence: Sequence(accepted.0 + random.random_range(1..3)),
        echo: session.last_tick(),
        mode: if random.random_bool(0.8) { Mode::Obtain } else { Mode::Submit },
        targets: std::array::from_fn(|_| offsets(random)),
    }))
}

/// Returns an event of any kind.
fn event<const N: usize>(session: &Session<N>, accepted: Sequence, random: &mut ChaCha8Rng) -> Event<N> {
    let received = random.random();
    match random.random_range(0..19) {
        0 => Event::Flood,
        1 => Event::Closed,
        2 => Event::Broken(FrameError::Checksum),
        3 => Event::Broken(FrameError::Version { received }),
        4 => Event::Dropped(FrameError::Magic),
        5 => Event::Dropped(FrameError::Length),
        6 => Event::Dropped(FrameError::TooLong { length: random.random() }),
        7 => Event::Malformed(ContentError::Reserved),
        8 => Event::Malformed(ContentError::Limits),
        9 => Event::Malformed(ContentError::Kind { received }),
        10 => Event::Malformed(ContentError::Code { received }),
        11 => Event::Malformed(ContentError::Axes { expected: N, received }),
        12 => Event::Malformed(ContentError::Length { expected: 0, received: random.random_range(0..usize::MAX) }),
        13 => Event::Message(ClientMessage::Stop(Epoch(random.random()))),
        14 => Event::Message(ClientMessage::Goodbye(session.epoch())),
        15 => {
            Event::Message(ClientMessage::Hello(Hello { axes: received, capabilities: Capabilities(random.random()) }))
        }
        16 => Event::Message(ClientMessage::Command(Command {
            epoch: Epoch(random.random()),
            sequence: Sequence(random.random()),
            echo: Tick(random.random()),
            mode: Mode::Submit,
            targets: std::array::from_fn(|_| offsets(random)),
        })),
        _ => answer(session, accepted, random),
    }
}

fn input<const N: usize>(
    session: &Session<N>,
    accepted: Sequence,
    epochs: EpochRange,
    random: &mut ChaCha8Rng,
) -> Input<N> {
    let mut events = Events::new();
    let parameters = session.config().parameters();
    if session.owner().is_none() && random.random_bool(0.5) {
        let hello =
            ClientMessage::Hello(Hello { axes: u8::try_from(N).unwrap(), capabilities: parameters.capabilities });
        events.push((OWNER, Event::Message(hello))).unwrap();
    } else if random.random_bool(0.9) {
        let answer = answer(session, accepted, random);
        events.push((OWNER, answer)).unwrap();
    }
    let is_odd = random.random_bool(0.1);
    let others = if is_odd { random.random_range(1..8) } else { 0 };
    for _ in 0..others {
        let is_owner = random.random_bool(0.3);
        let other = (!is_owner).then(|| Connection(random.random()));
        let event = event(session, accepted, random);
        events.push((other.unwrap_or(OWNER), event)).unwrap();
    }
    let wild = random.random_bool(0.02);
    let position =
        |random: &mut ChaCha8Rng| PositionNm(if wild { random.random() } else { random.random_range(-99..99) });
    let last_write = match random.random_range(0..100) {
        0 => LastWrite::Unknown,
        1 => LastWrite::Refused {
            in_force: std::array::from_fn(|_| InForce { nominal: position(random), offsets: offsets(random) }),
        },
        _ => LastWrite::Accepted,
    };
    let tick = TickInput {
        elapsed_cycles: if wild { random.random() } else { 1 },
        reading: random.random_bool(0.98).then(|| Reading {
            nominal: std::array::from_fn(|_| position(random)),
            actual: std::array::from_fn(|_| Actual {
                position: PositionNm(random.random()),
                velocity: VelocityUmS(random.random()),
                torque: TorquePermille(random.random()),
            }),
        }),
        stop: random.random_bool(0.02),
        quit: random.random_bool(0.01),
        rearm: random.random_bool(0.5),
        last_write,
        arrival_us: random.random(),
    };
    Input { tick, epochs, events }
}

/// Returns a window of a session with random events.
fn window<const N: usize>(seed: u64) -> Window<N> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let offsets = Offsets { position: OffsetNm(random.random_range(-9..9)), ..Offsets::default() };
    let nominal = PositionNm(0);
    let start = Start { in_force: [InForce { nominal, offsets }; N], stop_latched: random.random_bool(0.1) };
    let epochs = EpochRange { first: Epoch(random.random_range(1..u64::MAX / 2)), last: Epoch(u64::MAX) };
    let mut session = Session::new(config(&mut random), &start).unwrap();
    let mut accepted = Sequence(0);
    let mut black_box = Box::new(BlackBox::<N, 16>::new());
    for _ in 0..random.random_range(1..200) {
        let input = input(&session, accepted, epochs, &mut random);
        black_box.before_tick(&session);
        let output = session.tick(&input);
        black_box.after_tick(&input, &output, output.ended.is_some());
        accepted = output.state.accepted;
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
    let binary = binary(&window);
    assert_eq!(Window::decode("x", &binary), Ok(read.clone()));
    assert_eq!(axes("x", &binary), Ok(N));
    assert_eq!(replay(&read.before, &read.entries).agreeing, read.entries.len());
}

#[test]
fn an_empty_black_box_has_no_window() {
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

/// Found from outside: servers that end before their first session name their boxes alike, and all but the first were lost.
#[test]
fn a_box_whose_name_is_taken_gets_the_next_one() {
    let folder = std::env::temp_dir().join(format!("gantry-tau-boxes-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&folder);
    let (_cycle, windows) = swap_channel::channel::<3>();
    let mut writer = writer::Writer::open(&folder, windows).unwrap();
    let window = window::<3>(1);
    (0..3).for_each(|_| writer.write(&window, true));
    writer.finish().unwrap();
    let name = window.file_name();
    for name in [name.clone(), name.replace(".jsonl", "-2.jsonl"), name.replace(".jsonl", "-3.jsonl")] {
        assert_eq!(std::fs::read_to_string(folder.join(name)).unwrap(), window.encode());
    }
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 3);
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Returns the file that a program in C would write.
fn binary<const N: usize>(window: &Window<N>) -> Vec<u8> {
    let mut file = b"GTBB\x04".to_vec();
    file.push(u8::try_from(N).unwrap());
    file.extend(u32::try_from(window.entries.len()).unwrap().to_le_bytes());
    let mut add = |part: &[u8]| {
        file.extend(u32::try_from(part.len()).unwrap().to_le_bytes());
        file.extend(part);
    };
    let mut room = [0; 8_192];
    add(postcard::to_slice(&window.before, &mut room).unwrap());
    for entry in &window.entries {
        add(postcard::to_slice(entry, &mut room).unwrap());
    }
    file
}

#[test]
fn an_edited_binary_file_is_refused_with_part_and_reason() {
    let mut window = window::<3>(3);
    window.entries.truncate(5);
    let file = binary(&window);
    let session = u32::from_le_bytes(file[10..14].try_into().unwrap());
    let ticks = 14 + usize::try_from(session).unwrap();
    let refused = |edit: &dyn Fn(&mut Vec<u8>), words: &str| {
        let mut file = file.clone();
        edit(&mut file);
        let refused = Window::<3>::decode("a", &file).unwrap_err().to_string();
        assert!(refused.starts_with(words), "{words} is not in: {refused}");
    };
    refused(&|file| file[3] = b'b', "a, line 1: this is not a black box");
    refused(&|file| file[4] = 3, "a, part 0: version is 3; this program reads version 4");
    refused(&|file| file[5] = 6, "a, part 0: axes is 6, expected 3");
    refused(&|file| file[6] = 0, "a, part 0: ticks is 0: there is nothing");
    refused(&|file| file[6] = 4, "a, part 5: ");
    refused(&|file| file[6] = 6, "a, part 7: the file ends before this part");
    refused(&|file| file.truncate(9), "a, part 0: the file ends within the first 10 bytes");
    refused(&|file| file.truncate(13), "a, part 1: the file ends within the length");
    refused(&|file| file.truncate(ticks - 1), "a, part 1: the file ends after ");
    refused(&|file| file.truncate(ticks), "a, part 2: the file ends before this part");
    refused(&|file| file[ticks + 3] = 1, "a, part 2: the file ends after ");
    refused(&|file| file.push(7), "a, part 6: 1 bytes follow the 5 ticks");
    let last = file.len() - 1;
    refused(&|file| file[last] = 99, "a, part 6: the content is not valid: ");
    refused(
        &|file| {
            file.insert(ticks, 0);
            file[10..14].copy_from_slice(&(session + 1).to_le_bytes());
        },
        "a, part 1: a number is longer than needed, or bytes follow",
    );
    for end in 0..file.len() {
        Window::<3>::decode("x", &file[..end]).unwrap_err();
    }
}

/// Replaces `from`, once, in the line of that number.
fn edited(text: &str, line: usize, from: &str, to: &str) -> String {
    let lines = text.lines().enumerate().map(|(index, words)| {
        if index + 1 == line {
            assert!(words.contains(from), "{from} is not in line {line}: {words}");
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
        (1, "black box", "white box", "line 1: this is not a black box"),
        (1, "\"version\":4", "\"version\":3", "line 1: version is 3; this program reads version 4"),
        (1, "\"axes\":3", "\"axes\":4", "line 1: axes is 4, expected 3"),
        (1, "\"axes\":3", "\"axes\":-3", "line 1: axes: invalid value: integer `-3`, expected usize"),
        (1, "\"ticks\":", "\"ticks\":1", "line 1 announces 1"),
        (1, "\"ticks\":", "\"tacks\":", "line 1: missing field `ticks`"),
        (1, "}", ",\"more\":1}", "line 1: a field is missing, unknown"),
        (2, "config", "confug", "line 2: missing field `config`"),
        (2, "\"accel\":400", "\"accel\":1", "line 2: config.axes[0].limits.velocity: accel is 1"),
        (2, "\"max\":50,", "\"max\":50000,", "line 2: config: axis 0: torque max"),
        (2, "\"handshake_ticks\":1000", "\"handshake_ticks\":0", "line 2: config: handshake_ticks"),
        (2, "\"echo_window\":", "\"echo_window\":1000", "line 2: config.echo_window: invalid value: integer `1000"),
        (
            2,
            "\"torque\":{\"value\":0",
            "\"torque\":{\"value\":51",
            "line 2: the state of the session contradicts its configuration: axis 0 has an offset beyond its limits",
        ),
        (2, "\"phase\":\"", "\"phase\":\"Not", "line 2: parts.discrete.phase: unknown variant `Not"),
        (2, "\"history\":", "\"history\":-1", "line 2: parts.discrete.history: "),
        (2, "\"budget\":", "\"badget\":", "line 2: a field is missing"),
        (2, "\"misses\":", "\"misses\":2", "line 2: the state of the session contradicts"),
        (3, "\"stop\":", "\"stop\":1,\"x\":", "line 3: input.tick.stop: invalid type: integer `1`, expected a boolean"),
        (
            3,
            "\"elapsed_cycles\":1",
            "\"elapsed_cycles\":1.5",
            "line 3: input.tick.elapsed_cycles: invalid type: floating point `1.5",
        ),
        (3, "{", "[", "line 3: "),
        (3, "{", " {", "line 3: a field is missing, unknown"),
        (
            4,
            "\"events\":[",
            "\"events\":[[1,\"Flood\"],[1,\"Flut\"]],\"x\":[",
            "line 4: input.events[1][1]: unknown variant `Flut`",
        ),
        (
            4,
            "\"references\":[",
            "\"references\":[],\"x\":[",
            "line 4: output.references: invalid length 0, expected 3 elements",
        ),
    ] {
        let file = edited(&text, line, from, to);
        let refused = Window::<3>::decode("a.jsonl", file.as_bytes()).unwrap_err().to_string();
        assert!(refused.starts_with("a.jsonl, line "), "{refused}");
        assert!(refused.contains(words), "{words} is not in: {refused}");
    }
    let seventeen = format!("\"events\":[{}],\"x\":[", vec!["[1,\"Flood\"]"; 17].join(","));
    let file = edited(&text, 3, "\"events\":[", &seventeen);
    let refused = Window::<3>::decode("a", file.as_bytes()).unwrap_err().to_string();
    assert!(refused.contains("line 3: input.events"), "{refused}");
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

    /// Any change of bytes gives a window or a reason, never a panic.
    #[test]
    fn noise_is_read_or_refused(seed in 0..8_u64, places: Vec<(usize, u8)>) {
        let mut bytes = window::<3>(seed).encode().into_bytes();
        let length = bytes.len();
        for (place, byte) in places {
            bytes[place % length] = byte;
        }
        let _ = Window::<3>::decode("x", &bytes);
    }

    /// As above, of a file in the binary form; what is read is what the file says.
    #[test]
    fn noise_in_a_binary_file_is_read_or_refused(seed in 0..8_u64, places: Vec<(usize, u8)>) {
        let mut bytes = binary(&window::<3>(seed));
        let length = bytes.len();
        for (place, byte) in places {
            bytes[place % length] = byte;
        }
        if let Ok(window) = Window::<3>::decode("x", &bytes) {
            proptest::prop_assert!(binary(&window) == bytes);
        }
    }

    /// A file with other digits is replayed and drawn, whatever its numbers, or refused.
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
