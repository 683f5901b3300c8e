//! `solve` against the oracle vectors, and against lines that are not requests.

use gantry_tau::solve::{MAX_LINE, answer, run};
use serde_json::{Value, json};

use crate::oracle_vectors::{close, flatten, machine};

/// The vectors' L2 as an inline robot; its further keys are ignored.
fn robot() -> Value {
    machine("l2").0
}

fn f1() -> Value {
    machine("f1").0
}

fn robot_path() -> &'static str {
    concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/l2.toml")
}

fn ask(request: &Value) -> Value {
    let line = answer(&request.to_string());
    assert!(!line.contains('\n'), "{line}");
    serde_json::from_str(&line).unwrap()
}

/// The answer has these numbers, to a relative 1e-9.
fn agree(answer: &Value, name: &str, reference: &Value) {
    assert!(!answer["ok"][name].is_null(), "{answer}");
    close(
        &flatten(&answer["ok"][name]),
        &flatten(reference),
        1e-9,
        name,
    );
}

#[test]
fn every_l2_case_agrees_inline_and_by_file() {
    let (_, cases) = machine("l2");
    let identity = json!([[1, 0, 0], [0, 1.0, 0], [0, 0, 1]]);
    for case in cases {
        let (t, q, w) = (&case["T"], &case["q"], &case["w"]);
        for robot in [robot(), robot_path().into()] {
            let ik = ask(&json!({"id": 7, "robot": robot, "op": "ik", "T": t, "seed": [0, 0, 0]}));
            assert_eq!(ik["id"], 7);
            agree(&ik, "q", q);
            assert_eq!(ik["ok"]["iterations"], 0);
            assert!(ik["ok"]["residual"].as_f64().unwrap() < 1e-12);
            let fk =
                ask(&json!({"robot": robot, "op": "fk", "q": q, "seed": {"T": t, "R": identity}}));
            agree(&fk, "T", t);
            agree(&fk, "R", &identity);
            assert!(fk["ok"]["residual"].as_f64().unwrap() < 1e-12);
            let jacobian = ask(&json!({"robot": robot, "op": "jacobian", "T": t, "R": identity}));
            agree(&jacobian, "J", &case["J"]);
            let statics = ask(&json!({"robot": robot, "op": "statics", "T": t, "w": w}));
            agree(&statics, "f", &case["f"]);
            agree(&statics, "tau", &case["tau"]);
            let compliance = ask(&json!({"robot": robot, "op": "compliance", "T": t}));
            agree(&compliance, "C", &case["C_total"]);
            let deflection = ask(&json!({"robot": robot, "op": "deflection", "T": t, "w": w}));
            agree(&deflection, "r", &case["r"]);
            agree(&deflection, "dx_links", &case["dx_links"]);
            agree(&deflection, "dx_total", &product(&case["C_total"], w));
            let compensate = ask(&json!({"robot": robot, "op": "compensate", "T": t, "w": w}));
            agree(&compensate, "q", &case["q_comp"]);
        }
    }
}

#[test]
fn every_f1_case_agrees() {
    for case in machine("f1").1 {
        let (t, r, q, w) = (&case["T"], &case["R"], &case["q"], &case["w"]);
        for seed in [Value::Null, json!([1, 1, 1, 0.1, -0.1, 0.1])] {
            let ik = ask(&json!({"robot": f1(), "op": "ik", "T": t, "R": r, "seed": seed}));
            agree(&ik, "q", q);
            assert!(ik["ok"]["residual"].as_f64().unwrap() < 1e-10);
            assert!(ik["ok"]["iterations"].as_u64().unwrap() <= 10);
        }
        for seed in [Value::Null, json!({"T": [0.0, 0.0, t[2]]})] {
            let fk = ask(&json!({"robot": f1(), "op": "fk", "q": q, "seed": seed}));
            agree(&fk, "T", t);
            agree(&fk, "R", r);
            assert!(fk["ok"]["residual"].as_f64().unwrap() < 1e-10);
        }
        let [jacobian, statics, deflection, compliance, compensate] = [
            "jacobian",
            "statics",
            "deflection",
            "compliance",
            "compensate",
        ]
        .map(|op| ask(&json!({"robot": f1(), "op": op, "T": t, "R": r, "w": w})));
        agree(&jacobian, "J", &case["J"]);
        agree(&statics, "f", &case["f"]);
        agree(&statics, "tau", &case["tau"]);
        agree(&deflection, "r", &case["r"]);
        agree(&deflection, "dx_links", &case["dx_links"]);
        agree(&deflection, "dx_total", &product(&compliance["ok"]["C"], w));
        agree(&compensate, "q", &case["q_comp"]);
    }
}

fn with(mut robot: Value, key: &str, value: Value) -> Value {
    robot[key] = value;
    robot
}

fn ik(robot: Value, t: &Value) -> Value {
    json!({"robot": robot, "op": "ik", "T": t})
}

fn fk(robot: Value, q: &Value) -> Value {
    json!({"robot": robot, "op": "fk", "q": q})
}

#[test]
fn errors_of_the_f1_have_their_kind() {
    let (t, q) = (
        json!([0.0, 0.0, 0.3]),
        json!([1.5, 1.5, 1.5, 0.0, 0.0, 0.0]),
    );
    let crossed = json!([[0.1, -0.15, 0.03], [0.2, 0.15, 0.03]]);
    let mut unequal = f1()["b"].clone();
    unequal[1] = crossed[0].clone();
    unequal[2] = crossed[1].clone();
    let travel = json!([[0, 9], [0, 9], [0, 9], [-1, 1], [0.5, 1], [-1, 1]]);
    for (request, kind) in [
        (ik(f1(), &json!([5.0, 0.0, 0.3])), "unreachable"),
        (ik(f1(), &json!([1e300, 0.0, 0.3])), "unreachable"),
        (ik(with(f1(), "travel", travel), &t), "out_of_range"),
        (ik(with(f1(), "ax", json!([0, 0, 0])), &t), "bad_robot"),
        (ik(with(f1(), "sigma4", json!(0.5)), &t), "bad_robot"),
        (ik(with(f1(), "P", json!([[0, 0, 0]])), &t), "bad_robot"),
        (ik(with(f1(), "L", json!([1.7, 1.7])), &t), "bad_robot"),
        (
            json!({"robot": f1(), "op": "ik", "T": t, "R": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}),
            "bad_request",
        ),
        (
            json!({"robot": f1(), "op": "ik", "T": t, "seed": [1, 2]}),
            "bad_request",
        ),
        (
            fk(f1(), &json!([9.0, 1.5, 1.5, 0.0, 0.0, 0.0])),
            "unreachable",
        ),
        (fk(with(f1(), "b", unequal), &q), "seed_required"),
        (
            json!({"robot": f1(), "op": "fk", "q": q, "seed": {"T": [0.0, 0.0, 3.0]}}),
            "unreachable",
        ),
        (
            json!({"robot": with(f1(), "c_act", Value::Null), "op": "compliance", "T": t}),
            "bad_robot",
        ),
    ] {
        let answer = ask(&request);
        assert_eq!(answer["error"]["kind"], kind, "{request} {answer}");
    }
    // One length per arm says the same as one per link.
    let arms = ask(&ik(with(f1(), "L", json!([1.7, 1.7, 1.7])), &t));
    assert_eq!(arms, ask(&ik(f1(), &t)));
    let links = json!([1.0, 1.1, 1.1, 1.0, 1.0, 1.0]);
    let mut l2 = robot();
    l2["L"] = links;
    let at = json!([0.0, 0.5, 0.65]);
    assert_eq!(ask(&ik(l2.clone(), &at)), ask(&ik(robot(), &at)));
    l2["L"][2] = json!(1.2);
    assert_eq!(ask(&ik(l2, &at))["error"]["kind"], "bad_robot");
}

fn product(matrix: &Value, vector: &Value) -> Value {
    let x = flatten(vector);
    let matrix = flatten(matrix);
    let rows = matrix
        .chunks(x.len())
        .map(|row| row.iter().zip(&x).map(|(a, b)| a * b).sum::<f64>());
    rows.collect::<Vec<_>>().into()
}

#[test]
fn numbers_survive_the_way_out_and_back() {
    let (robot, cases) = machine("l2");
    for case in cases {
        let ik = ask(&json!({"robot": robot, "op": "ik", "T": case["T"]}));
        let fk = ask(&json!({"robot": robot, "op": "fk", "q": ik["ok"]["q"]}));
        let again = ask(&json!({"robot": robot, "op": "ik", "T": fk["ok"]["T"]}));
        let far = [flatten(&fk["ok"]["T"]), flatten(&again["ok"]["q"])].concat();
        let text = serde_json::to_string(&far).unwrap();
        let back: Vec<f64> = serde_json::from_str(&text).unwrap();
        assert!(
            far.iter()
                .zip(&back)
                .all(|(a, b)| a.to_bits() == b.to_bits())
        );
        agree(&again, "q", &ik["ok"]["q"]);
    }
}

#[test]
fn errors_have_their_kind() {
    let t = json!([0.0, 0.5, 0.65]);
    for (request, kind) in [
        (ik(robot(), &json!([0.0, 1.5, 0.6])), "unreachable"),
        (ik(robot(), &json!([0.0, -0.6, 0.6])), "unreachable"),
        (ik(robot(), &json!([0.0, 1.0, 1.25])), "singular"),
        (ik(robot(), &json!([1e300, 0.5, 0.6])), "unreachable"),
        (
            ik(
                with(robot(), "travel", json!([[0, 1], [-2, 2], [0, 0.1]])),
                &t,
            ),
            "out_of_range",
        ),
        (
            ik(with(robot(), "travel", json!([[1, 0], [0, 1], [0, 1]])), &t),
            "bad_robot",
        ),
        (ik(with(robot(), "model", "f1".into()), &t), "bad_robot"),
        (ik(with(robot(), "model", Value::Null), &t), "bad_robot"),
        (ik(with(robot(), "L", json!([1.0, 1.1])), &t), "bad_robot"),
        (
            ik(with(robot(), "L", json!([1.0, 1.1, -1.0])), &t),
            "bad_robot",
        ),
        (ik(with(robot(), "c", json!([1, 0, 1])), &t), "bad_robot"),
        (
            ik(
                with(robot(), "V", json!([[1, 0, 0], [0, 0, 0], [1, 0, 0]])),
                &t,
            ),
            "bad_robot",
        ),
        (ik("no/such/file.toml".into(), &t), "bad_robot"),
        (ik(7.into(), &t), "bad_request"),
        (ik(robot(), &json!([0.0, 0.5])), "bad_request"),
        (ik(robot(), &json!([0.0, 0.5, null])), "bad_request"),
        (ik(robot(), &Value::Null), "bad_request"),
        (
            json!({"robot": robot(), "op": "ik", "T": t, "R": [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}),
            "bad_request",
        ),
        (
            json!({"robot": robot(), "op": "ik", "T": t, "R": [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}),
            "bad_robot",
        ),
        (
            json!({"robot": robot(), "op": "fk", "q": [0, 50, 0]}),
            "unreachable",
        ),
        (
            json!({"robot": robot(), "op": "dance", "T": t}),
            "bad_request",
        ),
        (json!({"robot": robot(), "op": 3, "T": t}), "bad_request"),
        (json!({"robot": robot(), "T": t}), "bad_request"),
        (json!({"op": "ik", "T": t}), "bad_request"),
        (
            json!({"robot": robot(), "op": "statics", "T": t}),
            "bad_request",
        ),
        (
            json!({"robot": with(robot(), "c_cart", Value::Null), "op": "compliance", "T": t}),
            "bad_robot",
        ),
        (
            json!({"robot": with(robot(), "c_cart", json!([1e-8, -1e-8, 1e-8])), "op": "compliance", "T": t}),
            "bad_robot",
        ),
        (
            json!({"robot": robot(), "op": "statics", "T": t, "w": [1e308, 1e308, 1e308, 1e308, 1e308, 1e308]}),
            "not_finite",
        ),
    ] {
        let answer = ask(&request);
        assert_eq!(answer["error"]["kind"], kind, "{request} {answer}");
        assert!(!answer["error"]["message"].as_str().unwrap().is_empty());
        assert!(answer.get("ok").is_none());
    }
}

#[test]
fn errors_of_a_robot_name_the_key() {
    for (key, value, said) in [
        ("L", json!([1.0, 1.1]), "L: "),
        (
            "L",
            json!([1.0, 1.1, 1.2, 1.0, 1.0, 1.0]),
            "L differs within a cluster",
        ),
        ("c", json!([1, 0, 1]), "c[1] is 0; expected 1 or -1"),
        ("V", json!([[1, 0, 0], [0, 0, 0], [1, 0, 0]]), "V[1] "),
        ("c_cart", json!([1e-8, -1e-8, 1e-8]), "c_cart[1] "),
    ] {
        let mut robot = robot();
        robot[key] = value;
        let answer = ask(&json!({"robot": robot, "op": "compliance", "T": [0.0, 0.5, 0.65]}));
        let message = answer["error"]["message"].as_str().unwrap();
        assert!(message.starts_with(said), "{said}: {message}");
    }
}

/// A request with an answer.
fn good(id: Value) -> String {
    json!({"id": id, "robot": robot(), "op": "ik", "T": [0.0, 0.5, 0.65]}).to_string()
}

#[test]
fn every_line_is_answered_in_order() {
    let mut input = Vec::new();
    for line in [
        good(json!("first")).into_bytes(),
        b"{\"id\": 2, \"op\": ".to_vec(),
        b"\xff\xfe not text".to_vec(),
        b"".to_vec(),
        b"[1, 2]".to_vec(),
        format!("{{\"id\": 5, \"junk\": \"{}\"}}", "x".repeat(MAX_LINE)).into_bytes(),
        "[".repeat(100_000).into_bytes(),
        b"{\"id\": {\"a\": [1]}, \"op\": \"dance\"}\r".to_vec(),
        b"{\"id\": 1e999}".to_vec(),
        good(json!(["last", null])).into_bytes(),
    ] {
        input.extend(line);
        input.push(b'\n');
    }
    // The last line needs no newline.
    input.pop();
    let mut output = Vec::new();
    run(input.as_slice(), &mut output).unwrap();
    let text = String::from_utf8(output).unwrap();
    let answers: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert_eq!(answers.len(), 10, "{text}");
    let ids: Vec<&Value> = answers.iter().map(|answer| &answer["id"]).collect();
    assert_eq!(*ids[0], json!("first"));
    assert!(ids[1..7].iter().all(|id| id.is_null()));
    assert_eq!(*ids[7], json!({"a": [1]}));
    assert!(ids[8].is_null());
    assert_eq!(*ids[9], json!(["last", null]));
    for answer in &answers[1..9] {
        assert_eq!(answer["error"]["kind"], "bad_request");
    }
    assert!(answers[0]["ok"].is_object() && answers[9]["ok"].is_object());
    let mut nothing = Vec::new();
    run(&b""[..], &mut nothing).unwrap();
    assert!(nothing.is_empty());
}
