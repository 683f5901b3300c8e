//! Recordings as MCAP, read back by the official reader in Python, their messages validated against
//! their schemas: the packages `mcap` and `jsonschema` of PyPI.
//!
//! Their Python is that of `target/mcap-reader`, where `.ci/run` installs them, or else `python3`.
//! A trial without the packages is reported as ignored; with `GANTRY_TAU_REQUIRE_MCAP=1` it fails
//! instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

use std::path::Path;
use std::process::Command;

use gantry_tau_machine::model::L2_MOTORS;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_record::recording::{RecordTo, recover};
use gantry_tau_test_support::recordings::{Samples, compare, csv_rows};
use gantry_tau_test_support::sessions;
use libtest_mimic::Trial;
use serde_json::Value;

use crate::needing;
use crate::python_packages::python_with;

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let python = python_with("mcap-reader", "mcap.reader, jsonschema");
    let missing = python
        .is_none()
        .then(|| "mcap or jsonschema of PyPI missing".to_owned());
    let name = "mcap::the_official_reader_reads_what_the_table_has".to_owned();
    vec![needing::trial(
        name,
        missing,
        "GANTRY_TAU_REQUIRE_MCAP",
        move || {
            check(&python.unwrap_or_default());
            Ok(())
        },
    )]
}

fn record_to(path: &Path) -> RecordTo {
    path.to_str().unwrap().parse().unwrap()
}

/// Samples of a recording, by the official reader.
fn read(python: &Path, path: &Path) -> Samples {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/mcap/read.py");
    let read = Command::new(python)
        .arg("-B")
        .arg(script)
        .arg(path)
        .output()
        .unwrap();
    assert!(
        read.status.success(),
        "{}",
        String::from_utf8_lossy(&read.stderr)
    );
    let lines = String::from_utf8(read.stdout).unwrap();
    let mut samples = Samples::default();
    for line in lines.lines() {
        let mut line: Value = serde_json::from_str(line).unwrap();
        assert_eq!(line["encoding"], serde_json::json!(["json", "jsonschema"]));
        let topic = line["topic"]
            .as_str()
            .unwrap()
            .trim_start_matches('/')
            .to_owned();
        let schema = if topic == "scene" {
            "foxglove.SceneUpdate".to_owned()
        } else {
            format!("gantry_tau.{topic}")
        };
        assert_eq!(line["schema"], schema);
        let value = line["value"].take();
        if let Some(tick) = value["tick"].as_u64() {
            assert_eq!(line["time"], tick * 1_000_000);
        }
        samples.add(&topic, value);
    }
    samples
}

fn check(python: &Path) {
    let folder = tempfile::tempdir().unwrap();
    let [csv, mcap, of_client, killed] =
        ["server.csv", "server.mcap", "client.mcap", "killed.mcap"]
            .map(|name| folder.path().join(name));
    let robot = RobotFile::builtin_l2().unwrap();
    let (rows, events, recorded) = sessions::run::<_, 3, L2_MOTORS>(
        &robot,
        &[record_to(&csv), record_to(&mcap)],
        record_to(&of_client),
    );
    assert!(
        recorded
            .iter()
            .all(|file| file.lost == 0 && file.failure.is_none()),
        "{recorded:?}"
    );
    let server = read(python, &mcap);
    compare(&server, &csv_rows(&csv), 3);
    assert_eq!(server.of("session_event").len(), events.len());
    assert_eq!(server.of("scene").len(), rows.len().div_ceil(33));
    let client = read(python, &of_client);
    assert!(client.of("axes").len() > 400);
    // Killed in the middle of a chunk, it has no summary; what is recovered has one, and is a part
    // of it.
    let whole = std::fs::read(&of_client).unwrap();
    std::fs::write(&killed, &whole[..whole.len() / 2]).unwrap();
    let recovered = recover(&killed).unwrap();
    let saved = read(python, &recovered.path);
    let (saved, all) = (saved.of("axes"), client.of("axes"));
    assert!(
        saved.len() > all.len() / 4 && saved == &all[..saved.len()],
        "{} of {}",
        saved.len(),
        all.len()
    );
}
