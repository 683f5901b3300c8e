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

/// Found by another engine: the comment of the L2 had the displacement by the links alone.
#[test]
fn built_in_files_say_what_is_solved() {
    let folder = Folder::new("solve_comments");
    let cases = [
        (
            "l2",
            json!([0.0, 0.5, 0.65]),
            1e6,
            0,
            include_str!("../../../../robots/l2.toml"),
        ),
        (
            "f1",
            json!([0.1, 0.0, 0.3]),
            1e3,
            2,
            include_str!("../../../../robots/f1.toml"),
        ),
    ];
    for (robot, home, scale, digits, text) in cases {
        let ask = |op: &str| {
            let load = [300.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            let request = json!({"id": 1, "robot": robot, "op": op, "T": home, "w": load});
            solve(&folder, &request)["ok"].clone()
        };
        let listed = |numbers: Vec<f64>| {
            let all = numbers
                .iter()
                .map(|number| format!("{:.digits$}", number * scale));
            format!("({})", all.collect::<Vec<_>>().join(", "))
        };
        let first_three = |value: &Value| -> Vec<f64> {
            let all = value.as_array().unwrap().iter().take(3);
            all.map(|number| number.as_f64().unwrap()).collect()
        };
        let moved = listed(first_three(&ask("deflection")["dx_total"]));
        let [nominal, corrected] = ["ik", "compensate"].map(|op| first_three(&ask(op)["q"]));
        let offsets = corrected
            .iter()
            .zip(&nominal)
            .map(|(there, here)| there - here);
        let offsets = listed(offsets.collect());
        assert!(
            text.contains(&format!("moves the tool by {moved}")),
            "{robot}: {moved}"
        );
        assert!(text.contains(&offsets), "{robot}: {offsets}");
    }
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

/// Cases of `tests/data/dynamics.json`, whose accelerations Pinocchio agrees with, and whose loops
/// an implementation in another language computed.
mod dynamics {
    use super::*;

    const VECTORS: &str = include_str!("../../../../tests/data/dynamics.json");

    /// Answers of `solve` to the cases of one list, each with its request.
    fn answered(list: &str, op: &str) -> Vec<(Value, Value)> {
        let vectors: Value = serde_json::from_str(VECTORS).unwrap();
        let mut requests = Vec::new();
        for kind in ["l2", "f1"] {
            let robot = &vectors["robots"][kind];
            for case in robot[list].as_array().unwrap() {
                let mut request = case.clone();
                request["robot"] = json!(kind);
                request["op"] = json!(op);
                if request.get("masses").is_none() {
                    request["masses"] = robot["masses"].clone();
                }
                requests.push(request);
            }
        }
        let folder = Folder::new("solve_dynamics");
        let lines: Vec<String> = requests.iter().map(Value::to_string).collect();
        folder.write("in", &lines.join("\n"));
        let input = Stdio::from(File::open(folder.path("in")).unwrap());
        let said = folder
            .start_with("solve", &["solve"], input)
            .end()
            .success();
        let answers = said.lines().map(|line| {
            let answer: Value = serde_json::from_str(line).unwrap();
            assert!(answer.get("ok").is_some(), "{answer}");
            answer["ok"].clone()
        });
        let answers: Vec<Value> = answers.collect();
        assert_eq!(answers.len(), requests.len());
        requests.into_iter().zip(answers).collect()
    }

    fn numbers(value: &Value) -> Vec<f64> {
        match value.as_array() {
            Some(list) => list.iter().flat_map(numbers).collect(),
            None => vec![value.as_f64().unwrap()],
        }
    }

    /// Largest difference, as a share of the largest number.
    fn difference(found: &Value, expected: &Value) -> f64 {
        let (found, expected) = (numbers(found), numbers(expected));
        assert_eq!(found.len(), expected.len());
        let largest = expected.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let pairs = found.iter().zip(&expected);
        pairs.fold(0.0, |most: f64, (one, other)| most.max((one - other).abs())) / largest
    }

    /// 1e-9 is asked for; the orientation as a quaternion, and tensions of micrometres of a metre,
    /// leave 1e-12.
    #[test]
    fn motion_is_that_of_an_independent_engine() {
        let cases = answered("accelerations", "dynamics");
        assert_eq!(cases.len(), 20);
        for (request, answer) in cases {
            for key in [
                "mass_matrix",
                "accelerations",
                "link_tensions",
                "sensor_load",
            ] {
                let off = difference(&answer[key], &request[key]);
                assert!(off < 1e-9, "{key}: {off:e} of {request}");
            }
        }
    }

    #[test]
    fn modes_are_those_of_an_independent_engine() {
        let cases = answered("modes", "modes");
        assert_eq!(cases.len(), 36);
        for (request, answer) in cases {
            let key = "first_five_modes_hz";
            let off = difference(&answer[key], &request[key]);
            assert!(off < 1e-9, "{off:e} of {request}");
        }
    }

    /// The stated tolerances: growth within 0.02 /s and 1 %, margins within 2 %. The
    /// frequency of a margin is not compared: its peak may be broad.
    #[test]
    fn loops_are_those_of_an_independent_implementation() {
        let cases = answered("stability", "loop");
        assert_eq!(cases.len(), 72);
        for (request, answer) in cases {
            let number = |of: &Value, key: &str| of[key].as_f64().unwrap();
            let close = |key: &str, absolute: f64, relative: f64| {
                let expected = number(&request, key);
                let off = (number(&answer, key) - expected).abs();
                assert!(
                    off <= absolute + relative * expected.abs(),
                    "{key}: {answer} of {request}"
                );
            };
            close("closed_loop_growth_per_s", 0.02, 0.01);
            close("at_hz", 0.02, 0.001);
            close("any_phase_margin", 0.0, 0.02);
        }
    }

    #[test]
    fn what_no_machine_has_is_refused_by_name() {
        let folder = Folder::new("solve_bad_masses");
        let home = json!({"robot": "l2", "op": "loop", "tcp_m": [0.0, 0.5, 0.65], "filter": "first_order_20"});
        let masses = json!({
            "platform_kg": 12.0, "platform_centre": [0, 0, 0], "platform_I": [0.1, 0.1, 0.1],
            "link_kg": [2, 2, 2, 2, 2, 2], "cart_kg": [25, 25, 25],
            "tool_kg": 1.8, "tool_centre": [0, 0, 0], "tool_I": [0.01, 0.01, 0.01],
        });
        let with = |key: &str, value: Value| {
            let mut masses = masses.clone();
            masses[key] = value;
            ("masses", masses)
        };
        for ((key, value), words) in [
            (("tool_kg", json!(0.0)), "tool_kg is 0; expected from 0.001"),
            (("tool_kg", json!(-1.0)), "tool_kg is -1"),
            (
                ("damping_ratio", json!(0.0)),
                "damping_ratio is 0; expected from 0.001 to 0.3",
            ),
            (("damping_ratio", json!(1.0)), "damping_ratio is 1"),
            (
                ("latency_cycles", json!(0)),
                "latency_cycles is 0; expected from 1",
            ),
            (("position_gain", json!(500.0)), "position_gain is 500"),
            (
                ("drives", json!("stiff")),
                "drives is \"stiff\"; expected \"ideal\" or \"cascade\"",
            ),
            (
                ("axes", json!([0.6, -0.7])),
                "axes has 2 numbers; the machine has 3 axes",
            ),
            (
                ("rotation", json!([[1, 0, 0], [0, 2, 0], [0, 0, 1]])),
                "rotation is not a rotation matrix",
            ),
            (
                ("filter", json!("third_order_3")),
                "filter is \"third_order_3\"; expected first_order_HZ",
            ),
            (
                ("filter", json!("first_order_NaN")),
                "frequency of the filter is NaN",
            ),
            (
                ("filter", json!("butterworth2_6_notch_0_q0.7")),
                "with the numbers of modes",
            ),
            (
                ("filter", json!("butterworth2_6_notch_1_q0")),
                "q of the notches is 0",
            ),
            (
                ("filter", json!("butterworth2_6_notch_1_1_1_1_1_1_1_q0.7")),
                "more than 6 notches",
            ),
            (
                with("platform_kg", json!(0.0)),
                "platform_kg is 0; expected from 0.1",
            ),
            (
                with("cart_kg", json!([25.0, -1.0, 25.0])),
                "cart_kg[1] is -1",
            ),
            (with("link_kg", json!([2.0, 2.0])), "masses: "),
            (
                with("platform_I", json!([0.1, 0.1, 0.3])),
                "platform_inertia_kgm2 is the inertia of no body",
            ),
            (
                with("platform_I", json!([0.1, 0.0, 0.1])),
                "platform_inertia_kgm2 is the inertia of no body",
            ),
            (
                with("tool_I", json!([[1, 2, 0], [0, 1, 0], [0, 0, 1]])),
                "tool_inertia_kgm2 is the inertia of no body",
            ),
            (with("plate_I", json!([1.0])), "plate_I has 1 numbers"),
            (
                with("motor_kg", json!([1.0])),
                "motor_kg has 1 numbers; the machine has 3 axes",
            ),
        ] {
            let mut request = home.clone();
            request[key] = value;
            let answer = solve(&folder, &request);
            let said = answer["error"]["message"].as_str().unwrap_or_default();
            assert!(said.contains(words), "{request}: {answer}");
        }
        assert!(solve(&folder, &home).get("ok").is_some());
        let mut massless = home;
        massless["robot"] = json!({"model": "l2"});
        assert_eq!(solve(&folder, &massless)["error"]["kind"], "bad_robot");
    }
}
