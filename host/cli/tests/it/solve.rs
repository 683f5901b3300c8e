//! `solve` through its pipes.

use std::fs::File;
use std::process::Stdio;

use serde_json::{Value, json};

use crate::process::Folder;

#[test]
fn good_and_bad_lines_are_answered_in_order() {
    let folder = Folder::new("solve");
    let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/l2.toml");
    let good = json!({"id": 1, "robot": robot, "op": "ik", "T": [0.0, 0.5, 0.65]});
    let far = json!({"id": "b", "robot": robot, "op": "ik", "T": [0.0, 9.0, 0.65]});
    folder.write("in", &format!("{good}\nnonsense\n{far}\n\n{good}"));
    let input = Stdio::from(File::open(folder.path("in")).unwrap());
    let said = folder
        .start_with("solve", &["solve"], input)
        .end()
        .success();
    let answers: Vec<Value> = said
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(answers.len(), 5, "{said}");
    let q = answers[0]["ok"]["q"][0].as_f64().unwrap();
    assert!((q - 0.6245).abs() < 1e-4, "{q}");
    assert_eq!(answers[1]["error"]["kind"], "bad_request");
    assert_eq!(answers[2]["id"], "b");
    assert_eq!(answers[2]["error"]["kind"], "unreachable");
    assert_eq!(answers[3]["error"]["kind"], "bad_request");
    assert_eq!(answers[4], answers[0]);
    assert_eq!(folder.run(&["solve"]).success(), "");
}

fn solve(folder: &Folder, request: &Value) -> Value {
    folder.write("in", &request.to_string());
    let input = Stdio::from(File::open(folder.path("in")).unwrap());
    let said = folder.start_with("solve", &["solve"], input).end();
    serde_json::from_str(said.success().trim()).unwrap()
}

/// There and back through the file of the six-axis machine.
#[test]
fn six_axes_are_solved_from_their_file() {
    let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/f1.toml");
    let folder = Folder::new("solve_f1");
    let there = json!([0.15, 0.05, 0.35]);
    let inverse = solve(
        &folder,
        &json!({"id": 1, "robot": robot, "op": "ik", "T": there}),
    );
    let q = inverse["ok"]["q"].clone();
    let back = solve(
        &folder,
        &json!({"id": 2, "robot": robot, "op": "fk", "q": q}),
    );
    for (found, wanted) in back["ok"]["T"]
        .as_array()
        .unwrap()
        .iter()
        .zip([0.15, 0.05, 0.35])
    {
        assert!((found.as_f64().unwrap() - wanted).abs() < 1e-10, "{back}");
    }
    let mut far = q;
    far[3] = json!(0.41);
    let refused = solve(
        &folder,
        &json!({"id": 3, "robot": robot, "op": "fk", "q": far}),
    );
    assert_eq!(refused["error"]["kind"], "out_of_range", "{refused}");
}
