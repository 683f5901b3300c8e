//! `labcomm`: recorded streams of the original implementation, there and back, and cut at every
//! place.

use std::fs::File;
use std::path::Path;
use std::process::Stdio;

use gantry_tau_labcomm::Version;
use gantry_tau_record::labcomm::{decode, encode, schema};
use serde_json::{Value, json};

use crate::process::Folder;

/// Recorded streams: file, and its contents.
fn recordings() -> Vec<(String, Value)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/labcomm");
    let files = std::fs::read_dir(folder)
        .unwrap()
        .map(|file| file.unwrap().path());
    let mut recordings: Vec<_> = files
        .filter(|path| path.extension().is_some_and(|ending| ending == "json"))
        .map(|path| {
            let text = std::fs::read_to_string(&path).unwrap();
            (
                path.file_name().unwrap().to_string_lossy().into_owned(),
                serde_json::from_str(&text).unwrap(),
            )
        })
        .collect();
    recordings.sort_by(|(a, _), (b, _)| a.cmp(b));
    recordings
}

/// Every stream that must decode, with its label.
fn streams() -> Vec<(String, Value)> {
    let streams = recordings()
        .into_iter()
        .filter(|(file, _)| file != "refused.json")
        .flat_map(|(file, recording)| {
            let streams = recording["streams"]
                .as_array()
                .cloned()
                .unwrap_or_else(|| vec![recording.clone()]);
            streams.into_iter().map(move |stream| {
                (
                    format!("{file}, {}, {}", stream["version"], stream["encoder"]),
                    stream,
                )
            })
        });
    streams.collect()
}

fn bytes(hex: &Value) -> Vec<u8> {
    let hex = hex.as_str().unwrap();
    (0..hex.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap())
        .collect()
}

/// Events of bytes, and whether they end without an error.
fn decoded(bytes: &[u8], bits: bool) -> (Vec<Value>, bool) {
    let mut lines = Vec::new();
    let is_whole = decode(bytes, &mut lines, bits).unwrap();
    let lines = String::from_utf8(lines).unwrap();
    (
        lines
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect(),
        is_whole,
    )
}

fn encoded(version: Version, lines: &str) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    encode(version, lines.as_bytes(), &mut bytes)
        .map(|()| bytes)
        .map_err(|error| error.to_string())
}

fn version(stream: &Value) -> Version {
    match stream["version"].as_str().unwrap() {
        "2006" => Version::V2006,
        _ => Version::V2014,
    }
}

#[test]
fn every_recorded_stream_decodes_to_its_events() {
    let streams = streams();
    assert_eq!(streams.len(), 31 + 6, "recorded streams");
    for (label, stream) in &streams {
        let (events, is_whole) = decoded(&bytes(&stream["hex"]), true);
        assert!(is_whole, "{label}");
        assert_eq!(events, *stream["events"].as_array().unwrap(), "{label}");
    }
}

/// Byte for byte, from lines with the bits of floats; without them wherever every float is a
/// number.
#[test]
fn every_recorded_stream_is_encoded_again() {
    for (label, stream) in streams() {
        let hex = bytes(&stream["hex"]);
        if ["x01", "x02", "x06"]
            .iter()
            .any(|file| label.starts_with(file))
        {
            // What is never sent: type definitions, references; and the older version text, below.
            continue;
        }
        for bits in [true, false] {
            let (events, _) = decoded(&hex, bits);
            let lines: String = events.iter().map(|event| format!("{event}\n")).collect();
            if !lines.contains("\"nan\"") {
                assert_eq!(
                    encoded(version(&stream), &lines),
                    Ok(hex.clone()),
                    "{label}"
                );
            }
        }
    }
    let (_, release) = streams()
        .into_iter()
        .find(|(label, _)| label.starts_with("x06"))
        .unwrap();
    let lines: String = decoded(&bytes(&release["hex"]), true)
        .0
        .iter()
        .map(|event| format!("{event}\n"))
        .collect();
    assert_eq!(
        encoded(Version::V2014_0, &lines),
        Ok(bytes(&release["hex"]))
    );
}

#[test]
fn every_cut_gives_the_whole_events_before_it() {
    for (label, stream) in streams() {
        let hex = bytes(&stream["hex"]);
        let (events, _) = decoded(&hex, true);
        let ends = events
            .iter()
            .skip(1)
            .map(|event| event["at"].as_u64().unwrap());
        let ends: Vec<usize> = ends
            .map(|at| usize::try_from(at).unwrap())
            .chain([hex.len()])
            .collect();
        for cut in 0..hex.len() {
            let (mut got, is_whole) = decoded(&hex[..cut], true);
            let whole = ends.iter().filter(|end| **end <= cut).count();
            assert_eq!(
                is_whole,
                cut == 0 || ends.contains(&cut),
                "{label}, cut at {cut}"
            );
            if !is_whole {
                assert_eq!(
                    got.pop().unwrap()["error"]["kind"],
                    "incomplete",
                    "{label}, cut at {cut}"
                );
            }
            assert_eq!(got, events[..whole], "{label}, cut at {cut}");
        }
    }
}

#[test]
fn other_generations_are_refused() {
    let (_, refused) = recordings()
        .into_iter()
        .find(|(file, _)| file == "refused.json")
        .unwrap();
    let kinds = refused.as_array().unwrap().iter().map(|stream| {
        let (events, is_whole) = decoded(&bytes(&stream["hex"]), true);
        assert!(!is_whole);
        events.last().unwrap()["error"].clone()
    });
    let kinds: Vec<Value> = kinds.collect();
    assert_eq!(kinds[0]["kind"], "version");
    assert!(
        kinds[0]["message"]
            .as_str()
            .unwrap()
            .contains("LabComm2013")
    );
    assert_eq!(kinds[1]["kind"], "malformed");
}

/// The line that defines `v` with a type.
fn definition(ty: &Value) -> String {
    json!({"define": "v", "index": 128, "type": ty}).to_string()
}

/// Values that JSON has no number for, and arrays without elements or without indices.
#[test]
fn odd_values_survive() {
    for (ty, value) in [
        (json!("float"), json!("-inf")),
        (json!("double"), json!("nan")),
        (json!("float"), json!(0.1)),
        (json!("double"), json!(5e-324)),
        (json!("long"), json!(i64::MIN)),
        (json!("string"), json!({"bytes": "ff00"})),
        (json!(["array", [0, 3], "int"]), json!([])),
        (json!(["array", [2, 0], "int"]), json!([])),
        (json!(["array", [], "int"]), json!(7)),
        (
            json!(["array", [2, 0, 2], "byte"]),
            json!([[[1, 2], [3, 4], [5, 6]], [[7, 8], [9, 10], [11, 12]]]),
        ),
        (
            json!(["array", [0], ["array", [0], "byte"]]),
            json!([[1], [], [2, 3]]),
        ),
    ] {
        let sample = json!({"sample": "v", "index": 128, "value": value});
        let lines = format!("{}\n{sample}\n", definition(&ty));
        for version in [Version::V2006, Version::V2014] {
            let bytes = encoded(version, &lines).unwrap();
            let (events, is_whole) = decoded(&bytes, false);
            assert!(is_whole);
            assert_eq!(events.last().unwrap()["value"], value, "{ty}");
        }
    }
}

/// The reason for which a line behind a definition is refused.
fn refused(define: &str, line: &str) -> String {
    encoded(Version::V2014, &format!("{define}\n{line}")).unwrap_err()
}

#[test]
fn a_line_that_cannot_be_encoded_is_named() {
    let define = r#"{"define":"v","type":["array",[0,2],"byte"]}"#;
    for (line, reason) in [
        (
            r#"{"sample":"v","value":[[1,2],[3]]}"#,
            "line 2: lists of one index have different lengths",
        ),
        (
            r#"{"sample":"v","value":[[1,2,3]]}"#,
            "line 2: expected a list of 2, got one of 3",
        ),
        (
            r#"{"sample":"v","value":[[1,256]]}"#,
            "line 2: expected a value of type byte, got 256",
        ),
        (
            r#"{"sample":"v","value":3}"#,
            "line 2: expected lists within each other, one level for each of 2 indices",
        ),
        (
            r#"{"sample":"w","value":3}"#,
            "line 2: no definition of \"w\"",
        ),
        (
            r#"{"sample":"v","index":65,"value":[]}"#,
            "line 2: no definition of \"v\"",
        ),
        (
            r#"{"define":"v","index":64,"type":"int"}"#,
            "line 2: index 0x40 is defined again, with another name or type",
        ),
        (
            r#"{"define":"w","index":3,"type":"int"}"#,
            "line 2: a definition has index 0x3; indices begin at 0x40",
        ),
        (
            r#"{"define":"w","type":"integer"}"#,
            "line 2: \"integer\" is not a type",
        ),
        (
            r#"{"define":"w","type":["array",[0],["struct",[]]]}"#,
            "line 2: an array has elements that take no bytes",
        ),
        (
            r#"{"define":"w","type":["struct",[["a","int"],["a","int"]]]}"#,
            "line 2: a structure has two fields named a; values could not tell them apart",
        ),
        (
            r#"{"at":3,"error":{"kind":"limit"}}"#,
            "line 2: the recording ends with an error: {\"kind\":\"limit\"}",
        ),
        (
            r#"{"value":3}"#,
            "line 2: expected \"define\" or \"sample\"",
        ),
        (
            r#"{"define":{"bytes":"+f"},"type":"int"}"#,
            "line 2: expected a text or {\"bytes\":\"hex\"}, got {\"bytes\":\"+f\"}",
        ),
    ] {
        assert_eq!(refused(define, line), reason);
    }
    assert!(refused(define, "nonsense").starts_with("line 2: not JSON: "));
    for (ty, digits) in [("float", "+1234567"), ("double", "+123456789abcdef")] {
        let lines = format!(
            "{{\"define\":\"f\",\"type\":\"{ty}\"}}\n{{\"sample\":\"f\",\"value\":\"{digits}\"}}"
        );
        let reason = format!("line 2: expected a value of type {ty}, got \"{digits}\"");
        assert_eq!(encoded(Version::V2014, &lines).unwrap_err(), reason);
    }
}

#[test]
fn the_schema_is_made_of_the_types_that_are_sent() {
    let three = schema::<3>();
    for line in [
        "sample int data[3];",
        "sample float forcesensor[6];",
        "  int counters[10];\n  short longest_miss_run;\n} state;",
        "  struct {\n    long nominal_nm;\n    long reference_nm;\n",
        "    byte flags;\n  } axis[3];\n} axes;",
        "  double displacement_m[3];",
        "  string text;\n} session_event;",
        "  byte state[3];\n} drives;",
        "sample struct {\n  long kinematics;\n  string name;\n  byte lockstep;\n  string robot_file;\n} machine;",
    ] {
        assert!(three.contains(line), "{three}");
    }
    assert_eq!(
        schema::<6>(),
        three
            .replace("axis[3]", "axis[6]")
            .replace("state[3]", "state[6]")
    );
}

/// A byte of each element becomes 1900 of text: 190 MB, where the limit is 128 MiB.
#[test]
fn a_value_with_too_long_a_text_ends_the_stream_with_an_error() {
    let name = "n".repeat(1_900);
    let ty = json!(["array", [0], ["struct", [[name, "byte"]]]]);
    let mut bytes = encoded(Version::V2006, &definition(&ty)).unwrap();
    let before = bytes.len();
    bytes.extend([128_u32.to_be_bytes(), 100_000_u32.to_be_bytes()].concat());
    bytes.extend([7; 100_000]);
    let (events, is_whole) = decoded(&bytes, false);
    assert!(!is_whole);
    assert_eq!(events.len(), 2);
    assert_eq!(events[1]["at"], before);
    assert_eq!(events[1]["error"]["kind"], "limit");
    let message = events[1]["error"]["message"].as_str().unwrap();
    assert!(
        message.starts_with("the text of a value is longer than 134217728 bytes"),
        "{message}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_line_without_an_end_is_refused() {
    let line = Folder::new("endless")
        .run(&["labcomm", "encode", "/dev/zero"])
        .failure(1);
    assert!(
        line.contains("/dev/zero: line 1: is longer than 16777216 bytes"),
        "{line}"
    );
}

#[test]
fn errors_name_the_file() {
    let folder = Folder::new("labcomm-errors");
    let said = folder.run(&["labcomm", "decode", "."]).failure(1);
    assert!(said.contains(".: "), "{said}");
    folder.write("bad.jsonl", "{}\n{}\n");
    let said = folder.run(&["labcomm", "encode", "bad.jsonl"]).failure(1);
    assert!(said.contains("bad.jsonl: line 1: expected"), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_output_is_told() {
    let (_, stream) = streams().swap_remove(0);
    let folder = Folder::new("labcomm-full");
    std::fs::write(folder.path("stream"), bytes(&stream["hex"])).unwrap();
    folder.write("lines", "{\"define\":\"a\",\"type\":\"int\"}\n");
    for arguments in [
        ["decode", "stream"],
        ["encode", "lines"],
        ["schema", "--robot=l2"],
    ] {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_gantry-tau"))
            .arg("labcomm")
            .args(arguments)
            .current_dir(folder.path("."))
            .stdout(File::create("/dev/full").unwrap())
            .stderr(Stdio::piped())
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(
            said.contains("standard output: No space left on device"),
            "{said}"
        );
    }
}

#[test]
fn the_commands_go_through_pipes() {
    let folder = Folder::new("labcomm");
    let (_, stream) = streams()
        .into_iter()
        .find(|(label, _)| label.starts_with("p01.json, \"2006\""))
        .unwrap();
    let hex = bytes(&stream["hex"]);
    std::fs::write(folder.path("stream"), &hex).unwrap();
    let input = Stdio::from(File::open(folder.path("stream")).unwrap());
    let lines = folder
        .start_with("decode", &["labcomm", "decode", "--bits"], input)
        .end()
        .success();
    assert_eq!(
        lines,
        folder
            .run(&[
                "labcomm",
                "decode",
                "--bits",
                folder.path("stream").to_str().unwrap()
            ])
            .success()
    );
    assert_eq!(lines.lines().count(), 5);
    folder.write("lines", &lines);
    let input = Stdio::from(File::open(folder.path("lines")).unwrap());
    let _ = folder
        .start_with("encode", &["labcomm", "encode", "--version", "2006"], input)
        .end();
    assert_eq!(std::fs::read(folder.path("encode.out")).unwrap(), hex);
    std::fs::write(folder.path("stream"), &hex[..hex.len() - 1]).unwrap();
    let cut = folder.run(&["labcomm", "decode", folder.path("stream").to_str().unwrap()]);
    assert_eq!(cut.code, Some(1));
    assert!(cut.stdout.contains("\"incomplete\""), "{}", cut.stdout);
    assert!(
        folder
            .run(&["labcomm", "schema", "--robot", "f1"])
            .success()
            .contains("axis[6]")
    );
}
