//! Any bytes as lines for `solve`: one answer per line, in order, each an `ok` or an `error` of a
//! known kind, every number finite.

use gantry_tau::solve::run;
use serde_json::Value;

const KINDS: [&str; 8] = [
    "not_converged",
    "unreachable",
    "singular",
    "out_of_range",
    "not_finite",
    "seed_required",
    "bad_robot",
    "bad_request",
];

/// The bytes are the lines. Lines that name a file are left out: what is in files is `config`'s
/// business, and a fuzzer finds `/dev/zero`.
pub fn solve(data: &[u8]) {
    let lines: Vec<&[u8]> = data.split_inclusive(|byte| *byte == b'\n').collect();
    let read: Vec<Option<Value>> = lines.iter().map(|line| parse(line)).collect();
    let mut robots = read.iter().flatten().filter_map(|line| line.get("robot"));
    // One that names a file.
    if robots.any(Value::is_string) {
        return;
    }
    let answers = answers(data);
    assert_eq!(answers.len(), lines.len(), "one answer per line");
    for (request, answer) in read.iter().zip(&answers) {
        let id = request.as_ref().and_then(|request| request.get("id"));
        assert_eq!(&answer["id"], id.unwrap_or(&Value::Null), "its own id");
        is_answer(answer);
    }
}

fn parse(line: &[u8]) -> Option<Value> {
    serde_json::from_slice(line).ok()
}

fn answers(data: &[u8]) -> Vec<Value> {
    let mut said = Vec::new();
    assert!(run(data, &mut said).is_ok(), "nothing in a line ends it");
    let said = String::from_utf8(said).unwrap();
    said.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

fn is_answer(answer: &Value) {
    let keys: Vec<&str> = answer
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect();
    match answer.get("ok") {
        Some(ok) => {
            assert_eq!(keys, ["id", "ok"], "{answer}");
            is_finite(ok);
            if let Some(residual) = ok.get("residual") {
                // A link is at most a kilometre long.
                let within = (0.0..=1e-6).contains(&residual.as_f64().unwrap());
                assert!(within, "T13: the links keep their lengths: {answer}");
            }
        }
        None => {
            assert_eq!(keys, ["error", "id"], "{answer}");
            let kind = answer["error"]["kind"].as_str().unwrap();
            assert!(KINDS.contains(&kind), "{answer}");
            assert!(answer["error"]["message"] != "", "{answer}");
        }
    }
}

/// JSON has no NaN: it would be written as null.
fn is_finite(value: &Value) {
    match value {
        Value::Array(list) => list.iter().for_each(is_finite),
        Value::Object(object) => object.values().for_each(is_finite),
        other => assert!(other.is_number(), "T13: finite"),
    }
}
