//! `demo`, in ticks instead of milliseconds.

use serde_json::Value;

use crate::process::Folder;

#[test]
fn the_demo_compensates_ramps_and_reports() {
    let folder = Folder::new("demo");
    let mut arguments = vec![
        "demo",
        "--pace",
        "lockstep",
        "--step-seconds",
        "0.5",
        "--force-max",
        "120",
    ];
    arguments.extend([
        "--json",
        "demo.json",
        "--report",
        "demo.html",
        "--record",
        "demo.csv",
    ]);
    let said = folder.run(&arguments).success();
    assert!(said.contains("All as it should be."), "{said}");
    assert!(said.contains("demo.html"), "{said}");
    assert_numbers(&serde_json::from_str(&folder.read("demo.json")).unwrap());
    let report = folder.read("demo.html");
    assert_eq!(report.matches("<svg").count(), 6);
    assert!(report.trim_end().ends_with("</html>"));
    assert_rows(&folder.read("demo.csv"));
}

#[test]
fn the_demo_of_six_axes_compensates_turning_as_well() {
    let folder = Folder::new("demo_f1");
    let mut arguments = vec!["demo", "--robot", "f1", "--pace", "lockstep"];
    arguments.extend(["--step-seconds", "1", "--force-max", "120"]);
    arguments.extend(["--json", "f1.json", "--black-box", "box.jsonl"]);
    let said = folder.run(&arguments).success();
    assert!(said.contains("turning of the platform"), "{said}");
    assert!(said.contains("All as it should be."), "{said}");
    let results: Value = serde_json::from_str(&folder.read("f1.json")).unwrap();
    assert_eq!(results["axes"], 6);
    assert_eq!(results["complaints"], Value::Array(Vec::new()));
    for step in results["steps"].as_array().unwrap() {
        let turned = step["turn_urad"][0].as_f64().unwrap();
        assert!(turned > 100.0, "hardly any turning: {step}");
        let share = step["remaining_turn_share"].as_f64().unwrap();
        assert!((0.0..=0.05).contains(&share), "{share}");
    }
    let offsets = results["ramp"]["start_offset_nm"].as_array().unwrap();
    assert_eq!(offsets.len(), 6);
    let replayed = folder.run(&["replay", "box.jsonl"]).success();
    assert!(replayed.contains("6 axes"), "{replayed}");
    assert!(replayed.contains("agree bit for bit"), "{replayed}");
}

#[test]
fn the_demo_runs_under_a_key() {
    let folder = Folder::new("demo_key");
    folder.run(&["key", "new", "control.key"]).success();
    let mut arguments = vec!["demo", "--key", "control.key", "--pace", "lockstep"];
    arguments.extend(["--step-seconds", "0.5", "--force-max", "120"]);
    let said = folder.run(&arguments).success();
    assert!(said.contains("All as it should be."), "{said}");
    // The holder of a key that may only read gets no session.
    folder
        .run(&["key", "new", "read.key", "--role", "read"])
        .success();
    let refused = folder.run(&["demo", "--key", "read.key", "--pace", "lockstep"]);
    let said = refused.failure(1);
    assert!(said.contains("may only read"), "{said}");
}

/// A full disk, and a pipe that is open and not read.
#[cfg(target_os = "linux")]
#[test]
fn an_output_of_a_demo_that_cannot_be_written_costs_no_other() {
    let folder = Folder::new("demo_report");
    let pipe = folder.path("report.html");
    assert!(
        std::process::Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let reader = std::thread::spawn(move || std::fs::File::open(pipe).unwrap());
    for (report, reason) in [
        ("report.html", "its reader takes nothing"),
        ("/dev/full", "No space left"),
    ] {
        let mut arguments = vec![
            "demo",
            "--pace",
            "lockstep",
            "--step-seconds",
            "0.5",
            "--force-max",
            "120",
        ];
        arguments.extend([
            "--report",
            report,
            "--json",
            "demo.json",
            "--black-box",
            "box.jsonl",
        ]);
        let said = folder.run(&arguments).failure(1);
        assert!(said.contains(&format!("{report}: {reason}")), "{said}");
        assert_numbers(&serde_json::from_str(&folder.read("demo.json")).unwrap());
        assert!(
            folder
                .run(&["replay", "box.jsonl"])
                .success()
                .contains("agree bit for bit")
        );
        for written in ["demo.json", "box.jsonl"] {
            std::fs::remove_file(folder.path(written)).unwrap();
        }
    }
    drop(reader.join().unwrap());
}

fn assert_numbers(results: &Value) {
    assert_eq!(results["pace"], "lockstep");
    let steps = results["steps"].as_array().unwrap();
    assert_eq!(steps.len(), 2);
    for (step, force) in steps.iter().zip([60.0, 120.0]) {
        assert_eq!(step["force_n"], force);
        let share = step["remaining_share"].as_f64().unwrap();
        assert!((0.0..=0.05).contains(&share), "{share}");
        assert!(step["uncompensated_norm_um"].as_f64().unwrap() > 0.5 * force);
    }
    // The same machine without noise: an exact correction by the true springs leaves rounding only.
    let corrections = &results["corrections"];
    let [first_order, exact] =
        [0, 1].map(|kind| corrections["true_springs_um"][kind].as_f64().unwrap());
    assert!(exact < 0.01 && first_order > 0.1, "{corrections}");
    let ramp = &results["ramp"];
    let offsets = ramp["start_offset_nm"].as_array().unwrap();
    let largest = offsets.iter().map(|nm| nm.as_i64().unwrap().unsigned_abs());
    let expected = largest.max().unwrap().div_ceil(100);
    assert!(expected > 100, "hardly an offset: {ramp}");
    assert_eq!(ramp["ticks"], expected);
    assert_eq!(ramp["expected_ticks"], expected);
    assert_eq!(ramp["largest_change_nm"], 100);
    let change = results["largest_reference_change_nm"].as_u64().unwrap();
    assert!((100..=5_000).contains(&change), "{change}");
    assert_eq!(results["complaints"], Value::Array(Vec::new()));
}

fn assert_rows(csv: &str) {
    let mut lines = csv.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    for column in [
        "tick",
        "state",
        "offset_1_nm",
        "reference_3_nm",
        "target_2_nm",
        "force_x_n",
        "velocity_offset_1_um_s",
    ] {
        assert!(header.contains(&column), "{column}: {header:?}");
    }
    let rows: Vec<&str> = lines.collect();
    // Tare, two steps without and two with compensation.
    assert!(rows.len() > 1_000 + 4 * 200, "{} rows", rows.len());
    for row in rows {
        assert_eq!(row.split(',').count(), header.len(), "{row}");
    }
}
