//! Files are read back bit for bit; edited files are replayed, or refused with line and reason.

use gantry_tau_core::control::session::{BlackBox, replay};
use gantry_tau_server::black_box::swap_channel;
use gantry_tau_test_support::black_boxes::window;

use super::*;

fn round_trip<const N: usize>(seed: u64) {
    let window = window::<N>(seed);
    let text = encode(&window);
    let read = decode("x", text.as_bytes()).unwrap();
    assert_eq!(read, window);
    assert_eq!(encode(&read), text);
    assert_eq!(axes("x", text.as_bytes()), Ok(N));
    let binary = binary(&window);
    assert_eq!(decode("x", &binary), Ok(read.clone()));
    assert_eq!(axes("x", &binary), Ok(N));
    assert_eq!(
        replay(&read.before, &read.entries).agreeing,
        read.entries.len()
    );
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

/// Found from outside: servers that end before their first session name their boxes alike, and all
/// but the first were lost.
#[test]
fn a_box_whose_name_is_taken_gets_the_next_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (_cycle, windows) = swap_channel::channel::<3>();
    let mut writer = writer::BlackBoxWriter::open(folder, windows).unwrap();
    let window = window::<3>(1);
    (0..3).for_each(|_| writer.write(&window, true));
    writer.finish().unwrap();
    let name = window.file_name();
    for name in [
        name.clone(),
        name.replace(".jsonl", "-2.jsonl"),
        name.replace(".jsonl", "-3.jsonl"),
    ] {
        assert_eq!(
            std::fs::read_to_string(folder.join(name)).unwrap(),
            encode(&window)
        );
    }
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 3);
}

/// Adds a part to a binary file: its length, and its content.
fn add_part(file: &mut Vec<u8>, content: &impl serde::Serialize) {
    let mut room = [0; 8_192];
    let part = postcard::to_slice(content, &mut room).unwrap();
    file.extend(u32::try_from(part.len()).unwrap().to_le_bytes());
    file.extend(&*part);
}

/// Returns the file that a program in C would write.
fn binary<const N: usize>(window: &Window<N>) -> Vec<u8> {
    let mut file = b"GTBB\x08".to_vec();
    file.push(u8::try_from(N).unwrap());
    file.extend(u32::try_from(window.entries.len()).unwrap().to_le_bytes());
    add_part(&mut file, &window.before);
    for entry in &window.entries {
        add_part(&mut file, entry);
    }
    file
}

/// An edited copy of a file is refused with these words.
#[track_caller]
fn refused(file: &[u8], edit: impl FnOnce(&mut Vec<u8>), words: &str) {
    let mut file = file.to_vec();
    edit(&mut file);
    let refused = decode::<3>("a", &file).unwrap_err().to_string();
    assert!(refused.starts_with(words), "{words} is not in: {refused}");
}

#[test]
fn an_edited_binary_file_is_refused_with_part_and_reason() {
    let mut window = window::<3>(3);
    window.entries.truncate(5);
    let file = binary(&window);
    let session = u32::from_le_bytes(file[10..14].try_into().unwrap());
    let ticks = 14 + usize::try_from(session).unwrap();
    refused(
        &file,
        |file| file[3] = b'b',
        "a, line 1: this is not a black box",
    );
    refused(
        &file,
        |file| file[4] = 7,
        "a, part 0: version is 7; this program reads version 8",
    );
    refused(
        &file,
        |file| file[5] = 6,
        "a, part 0: axes is 6, expected 3",
    );
    refused(
        &file,
        |file| file[6] = 0,
        "a, part 0: ticks is 0: there is nothing",
    );
    refused(&file, |file| file[6] = 4, "a, part 5: ");
    refused(
        &file,
        |file| file[6] = 6,
        "a, part 7: the file ends before this part",
    );
    refused(
        &file,
        |file| file.truncate(9),
        "a, part 0: the file ends within the first 10 bytes",
    );
    refused(
        &file,
        |file| file.truncate(13),
        "a, part 1: the file ends within the length",
    );
    refused(
        &file,
        |file| file.truncate(ticks - 1),
        "a, part 1: the file ends after ",
    );
    refused(
        &file,
        |file| file.truncate(ticks),
        "a, part 2: the file ends before this part",
    );
    refused(
        &file,
        |file| file[ticks + 3] = 1,
        "a, part 2: the file ends after ",
    );
    refused(
        &file,
        |file| file.push(7),
        "a, part 6: 1 bytes follow the 5 ticks",
    );
    let last = file.len() - 1;
    refused(
        &file,
        |file| file[last] = 99,
        "a, part 6: the content is not valid: ",
    );
    refused(
        &file,
        |file| {
            file.insert(ticks, 0);
            file[10..14].copy_from_slice(&(session + 1).to_le_bytes());
        },
        "a, part 1: a number is longer than needed, or bytes follow",
    );
    for end in 0..file.len() {
        decode::<3>("x", &file[..end]).unwrap_err();
    }
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
    let text = encode(&window::<3>(3));
    for (line, from, to, words) in [
        (
            1,
            "black box",
            "white box",
            "line 1: this is not a black box",
        ),
        (
            1,
            "\"version\":8",
            "\"version\":7",
            "line 1: version is 7; this program reads version 8",
        ),
        (
            1,
            "\"axes\":3",
            "\"axes\":4",
            "line 1: axes is 4, expected 3",
        ),
        (
            1,
            "\"axes\":3",
            "\"axes\":-3",
            "line 1: axes: invalid value: integer `-3`, expected usize",
        ),
        (1, "\"ticks\":", "\"ticks\":1", "line 1 announces 1"),
        (
            1,
            "\"ticks\":",
            "\"tacks\":",
            "line 1: missing field `ticks`",
        ),
        (
            1,
            "}",
            ",\"more\":1}",
            "line 1: a field is missing, unknown",
        ),
        (2, "config", "confug", "line 2: missing field `config`"),
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
            "line 2: config.echo_window: invalid value: integer `1000",
        ),
        (
            2,
            "\"torque\":{\"value\":0",
            "\"torque\":{\"value\":51",
            "line 2: the state of the session contradicts its configuration: axis 0 has an offset beyond its limits",
        ),
        (
            2,
            "\"phase\":\"",
            "\"phase\":\"Not",
            "line 2: parts.discrete.phase: unknown variant `Not",
        ),
        (
            2,
            "\"history\":",
            "\"history\":-1",
            "line 2: parts.discrete.history: ",
        ),
        (
            2,
            "\"budget\":",
            "\"badget\":",
            "line 2: a field is missing",
        ),
        (
            2,
            "\"misses\":",
            "\"misses\":2",
            "line 2: the state of the session contradicts",
        ),
        (
            3,
            "\"stop\":",
            "\"stop\":1,\"x\":",
            "line 3: input.tick.stop: invalid type: integer `1`, expected a boolean",
        ),
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
        let refused = decode::<3>("a.jsonl", file.as_bytes())
            .unwrap_err()
            .to_string();
        assert!(refused.starts_with("a.jsonl, line "), "{refused}");
        assert!(refused.contains(words), "{words} is not in: {refused}");
    }
    let seventeen = format!(
        "\"events\":[{}],\"x\":[",
        vec!["[1,\"Flood\"]"; 17].join(",")
    );
    let file = edited(&text, 3, "\"events\":[", &seventeen);
    let refused = decode::<3>("a", file.as_bytes()).unwrap_err().to_string();
    assert!(refused.contains("line 3: input.events"), "{refused}");
}

#[test]
fn a_file_cut_anywhere_is_refused_and_never_panics() {
    let text = encode(&window::<3>(4));
    assert!(decode::<3>("x", text.as_bytes()).is_ok());
    // Without the last line's end it is still whole.
    for end in (0..text.len() - 1).rev().step_by(97) {
        let refused = decode::<3>("x", &text.as_bytes()[..end]).unwrap_err();
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
        let mut bytes = encode(&window::<3>(seed)).into_bytes();
        let length = bytes.len();
        for (place, byte) in places {
            bytes[place % length] = byte;
        }
        let _ = decode::<3>("x", &bytes);
    }

    /// As above, of a file in the binary form; what is read is what the file says.
    #[test]
    fn noise_in_a_binary_file_is_read_or_refused(seed in 0..8_u64, places: Vec<(usize, u8)>) {
        let mut bytes = binary(&window::<3>(seed));
        let length = bytes.len();
        for (place, byte) in places {
            bytes[place % length] = byte;
        }
        if let Ok(window) = decode::<3>("x", &bytes) {
            proptest::prop_assert!(binary(&window) == bytes);
        }
    }
}
