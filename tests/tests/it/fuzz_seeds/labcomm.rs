//! Recorded streams of LabComm, and lines to encode.

use gantry_tau_record::labcomm::decode;
use serde_json::Value;

use super::Seed;

/// The recorded streams, and their fronts.
pub(crate) fn streams() -> Vec<Seed> {
    let whole = recorded();
    // Refused by its fifth byte, or when a sixth comes.
    let large = (
        "number_that_goes_on".to_owned(),
        b"\x01\x0f\x0eLabComm2014.v1\x8d\x8d\x8d\xc3\xb6".to_vec(),
    );
    whole
        .iter()
        .filter(|(name, _)| name.starts_with('x'))
        .map(|(name, stream)| {
            (
                format!("{name}_cut"),
                stream[..stream.len() * 2 / 3].to_vec(),
            )
        })
        .chain(whole.clone())
        .chain([large])
        .collect()
}

/// The lines of the recorded streams, and lines with mistakes.
pub(crate) fn lines() -> Vec<Seed> {
    let lines = recorded().into_iter().map(|(name, stream)| {
        let mut lines = Vec::new();
        let _ = decode(&stream[..], &mut lines, name.ends_with("2006")).unwrap();
        (name, lines)
    });
    let define = r#"{"define":"v","type":["array",[0,2],"byte"]}"#;
    let mistakes = [
        ("ragged", r#"{"sample":"v","value":[[1,2],[3]]}"#),
        ("out_of_range", r#"{"sample":"v","value":[[1,256]]}"#),
        ("no_rows", r#"{"sample":"v","value":[]}"#),
        (
            "elements_without_bytes",
            r#"{"define":"w","type":["array",[0],["struct",[]]]}"#,
        ),
        (
            "field_named_twice",
            r#"{"define":"w","type":["struct",[["a","int"],["a","int"]]]}
{"sample":"w","value":{"a":1,"b":2}}"#,
        ),
        ("index_of_a_tag", r#"{"define":"w","index":2,"type":"int"}"#),
        (
            "not_finite",
            "{\"define\":\"f\",\"type\":\"float\"}\n{\"sample\":\"f\",\"value\":\"-inf\"}",
        ),
        (
            "name_of_bytes",
            r#"{"define":{"bytes":"ff00"},"type":"boolean"}"#,
        ),
    ];
    let mistakes =
        mistakes.map(|(name, line)| (name.to_owned(), format!("{define}\n{line}\n").into_bytes()));
    lines.chain(mistakes).collect()
}

/// Every recorded stream by its file and version.
fn recorded() -> Vec<Seed> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/data/labcomm");
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|file| file.unwrap().path())
        .collect();
    files.retain(|path| path.extension().is_some_and(|ending| ending == "json"));
    files.sort();
    let mut all: Vec<Seed> = Vec::new();
    for path in files {
        let recording: Value =
            serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let streams = recording["streams"]
            .as_array()
            .or(recording.as_array())
            .cloned();
        for stream in streams.unwrap_or_else(|| vec![recording.clone()]) {
            let id = recording["id"]
                .as_str()
                .or(stream["id"].as_str())
                .unwrap()
                .to_owned();
            let name = stream["version"]
                .as_str()
                .map_or(id.clone(), |version| format!("{id}_{version}"));
            let name = if all.iter().any(|(known, _)| *known == name) {
                format!("{name}_python")
            } else {
                name
            };
            let hex = stream["hex"].as_str().unwrap();
            let bytes = (0..hex.len())
                .step_by(2)
                .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap());
            all.push((name, bytes.collect()));
        }
    }
    all
}
