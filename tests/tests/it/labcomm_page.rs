//! LabComm: the crate and a second decoder, written from the format's page alone, find the same in
//! any stream.

use std::path::Path;

use gantry_tau_labcomm::Version;
use gantry_tau_record::labcomm::{decode, encode};
use gantry_tau_tests::client::Noise;
use gantry_tau_tests::labcomm::agree;
use gantry_tau_tests::labcomm::second_decoder::Ending;
use serde_json::{Value, json};

/// Streams of random schemas and values, each in both versions.
const SCHEMAS: usize = 400;
/// Streams that are made of each by changing, removing or repeating bytes.
const CHANGES: usize = 60;

/// Recorded streams of the original programs.
fn recorded() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/labcomm");
    let files = std::fs::read_dir(folder)
        .unwrap()
        .map(|file| file.unwrap().path());
    let mut streams = Vec::new();
    for path in files.filter(|path| path.extension().is_some_and(|ending| ending == "json")) {
        let recording: Value =
            serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let several = recording.get("streams").unwrap_or(&recording);
        let several = several
            .as_array()
            .cloned()
            .unwrap_or_else(|| vec![several.clone()]);
        streams.extend(several.iter().map(|stream| {
            let hex = stream["hex"].as_str().unwrap();
            (0..hex.len())
                .step_by(2)
                .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap())
                .collect()
        }));
    }
    assert!(streams.len() > 30, "recorded streams");
    streams
}

#[test]
fn recorded_streams_and_every_cut_of_them_decode_to_the_same_events() {
    for stream in recorded() {
        for length in 0..=stream.len() {
            agree(&stream[..length]);
        }
    }
}

#[test]
fn recorded_streams_with_changed_bytes_decode_to_the_same_events() {
    let mut noise = Noise::new(1);
    let mut endings = [0_usize; 3];
    for stream in recorded() {
        for _ in 0..2_000 {
            count(&mut endings, &agree(&changed(&stream, &mut noise)).1);
        }
    }
    assert!(
        endings.iter().all(|count| *count > 500),
        "clean, incomplete, refused: {endings:?}"
    );
}

#[test]
fn random_schemas_and_values_decode_to_what_was_encoded_by_both() {
    let mut noise = Noise::new(2);
    let mut endings = [0_usize; 3];
    for _ in 0..SCHEMAS {
        let lines = lines(&mut noise);
        for version in [Version::V2006, Version::V2014] {
            let mut stream = Vec::new();
            let text: String = lines.iter().map(|line| format!("{line}\n")).collect();
            encode(version, text.as_bytes(), &mut stream).unwrap();
            let (events, ending) = agree(&stream);
            assert_eq!(ending, Ending::Clean);
            assert_eq!(
                events.len(),
                lines.len() + usize::from(version == Version::V2014),
                "an event for each line"
            );
            let mut decoded = Vec::new();
            assert!(decode(&stream[..], &mut decoded, true).unwrap());
            let decoded = String::from_utf8(decoded).unwrap();
            let events = decoded
                .lines()
                .map(|line| serde_json::from_str::<Value>(line).unwrap());
            for (event, line) in events
                .filter(|event| event["version"].is_null())
                .zip(&lines)
            {
                assert_eq!(event["value"], line["value"], "value in {version:?}");
                assert_eq!(event["type"], line["type"], "type in {version:?}");
            }
            for _ in 0..CHANGES {
                count(&mut endings, &agree(&changed(&stream, &mut noise)).1);
            }
        }
    }
    assert!(
        endings.iter().all(|count| *count > 500),
        "clean, incomplete, refused: {endings:?}"
    );
}

fn count(endings: &mut [usize; 3], ending: &Ending) {
    endings[match ending {
        Ending::Clean => 0,
        Ending::Incomplete => 1,
        Ending::Refused(_) => 2,
    }] += 1;
}

/// The stream with one to three bytes changed, removed, repeated, or its end cut off. Half of the
/// new bytes are codes of the format.
fn changed(stream: &[u8], noise: &mut Noise) -> Vec<u8> {
    let mut stream = stream.to_vec();
    for _ in 0..=noise.below(3) {
        if stream.is_empty() {
            break;
        }
        let at = noise.below(stream.len());
        let codes = [
            0x00, 0x01, 0x02, 0x03, 0x05, 0x10, 0x11, 0x20, 0x27, 0x28, 0x3f, 0x40, 0x41, 0x7f,
            0x80, 0xff,
        ];
        let byte = if noise.below(2) == 0 {
            codes[noise.below(codes.len())]
        } else {
            stream[noise.below(stream.len())]
        };
        match noise.below(8) {
            0 => stream.truncate(at),
            1 => drop(stream.remove(at)),
            2 => stream.insert(at, byte),
            3 => stream[at] = stream[at].wrapping_add(1),
            4 => stream[at] = stream[at].wrapping_sub(1),
            _ => stream[at] = byte,
        }
    }
    stream
}

/// Lines of one stream: one to four definitions, each with up to three samples.
fn lines(noise: &mut Noise) -> Vec<Value> {
    let mut lines = Vec::new();
    for number in 0..=noise.below(4) {
        let (name, of) = (format!("s{number}"), ty(noise, 3));
        lines.push(json!({"define": name, "type": of}));
        for _ in 0..noise.below(4) {
            lines.push(json!({"sample": name, "value": value(noise, &of)}));
        }
    }
    lines
}

/// A type of at most this many arrays and structures within each other, without elements that take
/// no bytes.
fn ty(noise: &mut Noise, depth: usize) -> Value {
    match noise.below(if depth == 0 { 8 } else { 14 }) {
        primitive @ 0..8 => {
            json!(
                [
                    "boolean", "byte", "short", "int", "long", "float", "double", "string"
                ][primitive]
            )
        }
        8..11 => {
            let sizes: Vec<usize> = (0..noise.below(4)).map(|_| noise.below(4)).collect();
            let element = loop {
                let element = ty(noise, depth - 1);
                if takes_bytes(&element) {
                    break element;
                }
            };
            json!(["array", sizes, element])
        }
        _ => {
            let fields: Vec<Value> = (0..noise.below(5))
                .map(|field| json!([format!("f{field}"), ty(noise, depth - 1)]))
                .collect();
            json!(["struct", fields])
        }
    }
}

fn takes_bytes(ty: &Value) -> bool {
    ty[0] != "struct"
        || ty[1]
            .as_array()
            .unwrap()
            .iter()
            .any(|field| takes_bytes(&field[1]))
}

fn value(noise: &mut Noise, of: &Value) -> Value {
    if let Some(primitive) = of.as_str() {
        let bits = noise.number();
        let [.., a, b, c, d] = bits.to_be_bytes();
        return match primitive {
            "boolean" => json!(bits % 2 == 1),
            "byte" => json!(d),
            "short" => json!(i16::from_be_bytes([c, d])),
            "int" => json!(i32::from_be_bytes([a, b, c, d])),
            "long" => json!(i64::from_ne_bytes(bits.to_ne_bytes())),
            "float" => json!(format!("{:08x}", bits >> 32)),
            "double" => json!(format!("{bits:016x}")),
            _ => json!(
                "a\u{1f9be}\n\0é"
                    .chars()
                    .cycle()
                    .take(noise.below(9))
                    .collect::<String>()
            ),
        };
    }
    if of[0] == "array" {
        let sizes = of[1]
            .as_array()
            .unwrap()
            .iter()
            .map(|size| match size.as_u64().unwrap() {
                0 => noise.below(4),
                fixed => usize::try_from(fixed).unwrap(),
            });
        let sizes: Vec<usize> = sizes.collect();
        return list(noise, &sizes, &of[2]);
    }
    let fields = of[1].as_array().unwrap().iter();
    Value::Object(
        fields
            .map(|field| {
                (
                    field[0].as_str().unwrap().to_owned(),
                    value(noise, &field[1]),
                )
            })
            .collect(),
    )
}

/// Elements in lists, one level per index; `[]` if there are none.
fn list(noise: &mut Noise, sizes: &[usize], element: &Value) -> Value {
    match sizes {
        [] => value(noise, element),
        _ if sizes.contains(&0) => json!([]),
        [first, rest @ ..] => (0..*first).map(|_| list(noise, rest, element)).collect(),
    }
}
