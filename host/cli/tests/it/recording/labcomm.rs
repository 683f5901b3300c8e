//! A recording as a stream of LabComm.

use std::fs::File;
use std::path::Path;

use gantry_tau_core::units::Tick;
use gantry_tau_labcomm::Version;
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_record::labcomm::decode;
use gantry_tau_record::recording::Recording;
use gantry_tau_server::record::TickRecord;
use gantry_tau_test_support::recordings::{Samples, compare, csv_rows};
use gantry_tau_test_support::sessions;
use serde_json::Value;

use super::to;
use crate::process::Folder;

/// Lines that `labcomm decode` prints of a recording.
pub(super) fn decoded(path: &Path) -> Vec<Value> {
    let mut lines = Vec::new();
    assert!(
        decode(File::open(path).unwrap(), &mut lines, false).unwrap(),
        "the stream ends between two events"
    );
    let lines = String::from_utf8(lines).unwrap();
    lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

pub(super) fn samples(path: &Path) -> Samples {
    let mut samples = Samples::default();
    for mut line in decoded(path) {
        if let Some(name) = line["sample"].as_str().map(str::to_owned) {
            samples.add(&name, line["value"].take());
        }
    }
    samples
}

fn check<K: MachineKind<N>, const N: usize, const M: usize>(name: &str, robot: &RobotFile<K, N>) {
    let folder = Folder::new(&format!("recording-{name}"));
    let files = [
        "server.csv",
        "server.labcomm",
        "release.labcomm",
        "old.labcomm",
    ]
    .map(|name| to(&folder, name));
    let [csv, labcomm, release, old] = files;
    let server_files = [
        csv,
        labcomm,
        release.with_version(Version::V2014_0),
        old.with_version(Version::V2006),
    ];
    let (rows, events, recorded) =
        sessions::run::<K, N, M>(robot, &server_files, to(&folder, "client.labcomm"));
    assert!(
        recorded
            .iter()
            .all(|file| file.lost == 0 && file.failure.is_none()),
        "{recorded:?}"
    );
    let table = csv_rows(&folder.path("server.csv"));
    assert_eq!(table.len(), rows.len());
    for (file, version) in [
        ("server", Some("LabComm2014.v1")),
        ("release", Some("LabComm2014")),
        ("old", None),
    ] {
        let path = folder.path(&format!("{file}.labcomm"));
        let lines = decoded(&path);
        assert_eq!(lines[0]["version"].as_str(), version);
        let names: Vec<&str> = lines
            .iter()
            .filter_map(|line| line["define"].as_str())
            .collect();
        assert_eq!(names, ["axes", "state", "tool", "session_event", "drives"]);
        let samples = samples(&path);
        compare(&samples, &table, N);
        let sent: Vec<(u64, &str)> = samples.of("session_event").iter().map(event).collect();
        let seen: Vec<(u64, &str)> = events
            .iter()
            .map(|event| (event.tick, event.text.as_str()))
            .collect();
        assert_eq!(sent, seen);
    }
    // Of its own ticks the client tells what the server tells.
    let client = samples(&folder.path("client.labcomm"));
    let server = samples(&folder.path("server.labcomm"));
    assert!(client.of("axes").len() > 400);
    for axes in client.of("axes") {
        let mut of_server = server.of("axes").iter();
        assert_eq!(
            of_server.find(|other| other["tick"] == axes["tick"]),
            Some(axes)
        );
    }
    let sent: Vec<(u64, &str)> = client.of("session_event").iter().map(event).collect();
    assert_eq!(sent[0].1, "session granted (epoch 1)");
    assert_eq!(sent[sent.len() - 1].1, "Submit -> Obtain");
    assert!(
        sent[1..].iter().all(|one| events
            .iter()
            .any(|event| (event.tick, event.text.as_str()) == *one)),
        "{sent:?}"
    );
    let tool = client.of("tool").last().unwrap();
    assert_eq!(
        (&tool["displacement_m"][0], tool["load"][0].is_f64()),
        (&Value::from("nan"), true)
    );
}

fn event(value: &Value) -> (u64, &str) {
    (
        value["tick"].as_u64().unwrap(),
        value["text"].as_str().unwrap(),
    )
}

#[test]
fn a_stream_equals_the_table_of_the_same_run() {
    check::<_, 3, L2_MOTORS>("l2", &RobotFile::builtin_l2().unwrap());
    check::<_, 6, F1_MOTORS>("f1", &RobotFile::builtin_f1().unwrap());
}

#[test]
fn a_recorded_minute_decodes_to_its_samples() {
    let folder = Folder::new("recording-minute");
    let robot = RobotFile::builtin_l2().unwrap();
    let (rows, ..) = sessions::run::<_, 3, L2_MOTORS>(&robot, &[], to(&folder, "client.csv"));
    let path = folder.path("minute.labcomm");
    let mut recording =
        Recording::<3>::create::<TickRecord<3>, _>(&to(&folder, "minute.labcomm"), &robot).unwrap();
    for (tick, row) in (1..=60_000).zip(rows.iter().cycle()) {
        let mut row = *row;
        row.state.tick = Tick(tick);
        recording.write(&row, &[]);
    }
    assert_eq!(recording.finish(0).written, 60_000);
    let mut lines = Vec::new();
    assert!(decode(File::open(&path).unwrap(), &mut lines, false).unwrap());
    let lines = String::from_utf8(lines).unwrap();
    for name in ["axes", "state", "tool"] {
        let start = format!("\"sample\":\"{name}\"");
        assert_eq!(
            lines.lines().filter(|line| line.contains(&start)).count(),
            60_000,
            "{name}"
        );
    }
    let last: Value = serde_json::from_str(lines.lines().next_back().unwrap()).unwrap();
    assert_eq!(last["value"]["tick"], 60_000);
}
