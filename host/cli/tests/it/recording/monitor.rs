//! Recordings by monitors of a server that records the same run.

use std::net::TcpListener;
use std::path::Path;

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_test_support::labcomm_port::{Double, FIRST_TICK, Scene};
use gantry_tau_test_support::recordings::{compare, csv_rows};
use serde_json::Value;

use super::{labcomm, mcap};
use crate::process::{Folder, relay_paced};
use crate::publication::ports;
use crate::signals::{await_obtain, serve_pulling};

const PORT: &str = "127.0.0.1:0=state,axes,tool,session_event,drives,machine";
const FILES: [&str; 3] = ["monitor.csv", "monitor.labcomm", "monitor.mcap"];

#[test]
fn a_monitor_records_what_the_server_records() {
    let folder = Folder::new("recording-monitor");
    let further = ["--record", "serve.csv", "--labcomm", PORT];
    let (mut server, address) = serve_pulling(&folder, ["60", "0.5"], &further);
    let port = ports(&mut server)[0].to_string();
    let monitors = FILES.map(|file| folder.start(file, &["monitor", &port, "--record", file]));
    // Buffers and chunks: with the first bytes of each file some ticks were received.
    server.await_that("ticks of the monitors", |_| {
        let mut files = FILES.iter().map(|file| folder.path(file).metadata());
        files.all(|file| file.is_ok_and(|file| file.len() > 0))
    });
    // So slowly that no monitor is dropped.
    let relay = TcpListener::bind("127.0.0.1:0").unwrap();
    let relayed = relay.local_addr().unwrap().to_string();
    relay_paced(relay, address);
    let client = folder.start("client", &["client", &relayed]);
    await_obtain(&mut server, 1);
    server.await_that("a thousand ticks", |_| {
        std::fs::metadata(folder.path(FILES[0])).unwrap().len() > 400_000
    });
    client.stop().success();
    server.await_words("SafeDisconnect -> Listening");
    server.stop().success();
    for mut monitor in monitors {
        // The end of the stream is behind all that was sent.
        monitor.await_words("the server has ended");
        let ended = monitor.stop();
        assert!(ended.stderr.contains("recorded "), "{}", ended.stderr);
        assert!(ended.stderr.contains(", 0 dropped"), "{}", ended.stderr);
        ended.success();
    }

    let all = csv_rows(&folder.path("serve.csv"));
    let table = csv_rows(&folder.path("monitor.csv"));
    assert!(table.len() > 1_000);
    for (tick, row) in &table {
        let expected = &all[tick];
        assert_eq!(row.len(), expected.len());
        for (column, value) in row {
            match column.as_str() {
                "round_trip_us" => assert_eq!(value, ""),
                // The tick before was not received.
                "elapsed_ticks" if !table.contains_key(&(tick - 1)) => {}
                _ => assert_eq!(value, &expected[column], "{column}"),
            }
        }
    }
    let labcomm = labcomm::samples(&folder.path("monitor.labcomm"));
    let mcap = mcap::samples(&std::fs::read(folder.path("monitor.mcap")).unwrap());
    for samples in [labcomm, mcap] {
        let ticks: Vec<i64> = samples
            .of("axes")
            .iter()
            .map(|axes| axes["tick"].as_i64().unwrap())
            .collect();
        assert!(ticks.len() > 1_000 && ticks.windows(2).all(|pair| pair[0] < pair[1]));
        let rows = ticks
            .iter()
            .map(|tick| (*tick, all[tick].clone()))
            .collect();
        compare(&samples, &rows, 3);
        assert!(
            ticks.windows(2).all(|pair| pair[0] + 1 == pair[1]),
            "no tick is left out"
        );
        for text in ["session granted", "Submit -> Obtain", "session ended"] {
            let mut events = samples.of("session_event").iter();
            assert!(
                events.any(|event| event["text"].as_str().unwrap().starts_with(text)),
                "{text}"
            );
        }
    }
}

/// Two runs of a server, each in a file of its own with its origin, in which ticks never go back.
#[test]
fn a_restart_of_the_server_begins_another_file() {
    let folder = Folder::new("recording-restart");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let address = double.address;
    let server = address.to_string();
    let monitors = ["run.csv", "run.mcap"].map(|file| {
        let mut monitor = folder.start(
            file,
            &[
                "monitor", &server, "--status", "--every", "0.05", "--record", file,
            ],
        );
        monitor.await_words("connected to");
        monitor
    });
    drop(double);
    let again = Double::at(address, Scene::of(Phase::Obtain, Cause::None));
    for mut monitor in monitors {
        monitor.await_words("the next connection begins another file");
        monitor.await_that("the second run", |running| {
            running.stdout().contains("\"obtain\"")
        });
        // One line later its first ticks are behind the line that was seen.
        let ended = monitor.stop();
        assert_eq!(ended.code, Some(0), "{}", ended.stderr);
    }
    drop(again);
    let tables = ["run.csv", "run-2.csv"].map(|name| {
        let path = folder.path(name);
        let ticks: Vec<i64> = csv_ticks(&path);
        assert!(
            ticks[0] >= FIRST_TICK && ticks.windows(2).all(|pair| pair[0] < pair[1]),
            "{name}"
        );
        let origin = std::fs::read(folder.path(&format!("{name}.json"))).unwrap();
        let origin: serde_json::Map<_, _> = serde_json::from_slice(&origin).unwrap();
        (ticks, origin)
    });
    let files = ["run.mcap", "run-2.mcap"].map(|name| {
        let bytes = std::fs::read(folder.path(name)).unwrap();
        let samples = mcap::samples(&bytes);
        let ticks: Vec<i64> = samples
            .of("axes")
            .iter()
            .map(|axes| axes["tick"].as_i64().unwrap())
            .collect();
        assert!(
            ticks[0] >= FIRST_TICK && ticks.windows(2).all(|pair| pair[0] < pair[1]),
            "{name}"
        );
        (ticks, mcap::origin(&bytes))
    });
    assert!(
        !folder.path("run.mcap.json").exists(),
        "it has its origin within"
    );
    for [(_, first), (_, second)] in [tables, files] {
        assert!(started_ns(&first) < started_ns(&second));
        for origin in [&first, &second] {
            // To the second, the last one or this one.
            let seconds = started_ns(origin) / 1_000_000_000;
            let text = origin["started"].as_str().unwrap();
            let of_day: Vec<u128> = text[11..19]
                .split(':')
                .map(|part| part.parse().unwrap())
                .collect();
            assert_eq!(
                of_day[0] * 3_600 + of_day[1] * 60 + of_day[2],
                seconds % 86_400,
                "{text}"
            );
            assert!(
                text.starts_with("20") && text.ends_with('Z') && text.len() == 20,
                "{text}"
            );
        }
        for key in [
            "written_by",
            "robot",
            "model",
            "kinematics_checksum",
            "host",
            "tick_ms",
        ] {
            assert!(
                first[key].as_str().is_some_and(|text| !text.is_empty()),
                "{key}: {first:?}"
            );
            assert_eq!(first[key], second[key], "{key}");
        }
    }
}

fn started_ns(origin: &serde_json::Map<String, Value>) -> u128 {
    origin["started_ns"].as_str().unwrap().parse().unwrap()
}

/// A recording that is as long as it may be ends there, whole, and says so; the monitor goes on.
#[test]
fn a_limit_ends_a_recording_and_nothing_else() {
    let folder = Folder::new("recording-limit");
    let double = Double::of(Scene::of(Phase::Submit, Cause::None));
    let arguments = [
        "--status",
        "--every",
        "0.05",
        "--record",
        "run.csv",
        "--record-limit",
        "100k",
    ];
    let mut monitor = folder.start(
        "monitor",
        &[
            &["monitor", &double.address.to_string()],
            arguments.as_slice(),
        ]
        .concat(),
    );
    monitor.await_words("it ends here");
    let before = monitor.stdout().lines().count();
    monitor.await_that("further lines", |monitor| {
        monitor.stdout().lines().count() > before + 2
    });
    let ended = monitor.stop();
    assert!(ended.stderr.contains(" dropped after "), "{}", ended.stderr);
    ended.success();
    let text = folder.read("run.csv");
    // It is looked at every 250 rows.
    assert!(
        text.len() >= 100_000 && text.len() < 100_000 + 250 * 500,
        "{}",
        text.len()
    );
    assert!(text.ends_with('\n') && csv_ticks(&folder.path("run.csv")).len() > 20);
}

/// Ticks of a table, in their order.
fn csv_ticks(path: &Path) -> Vec<i64> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let column = lines
        .next()
        .unwrap()
        .split(',')
        .position(|name| name == "tick")
        .unwrap();
    lines
        .map(|line| line.split(',').nth(column).unwrap().parse().unwrap())
        .collect()
}

#[test]
fn a_machine_with_other_axes_is_not_recorded() {
    let folder = Folder::new("recording-other");
    let (mut server, _) = serve_pulling(&folder, ["0", "0.5"], &["--labcomm", PORT]);
    let port = ports(&mut server)[0].to_string();
    let arguments = [
        "monitor",
        &port,
        "--status",
        "--robot",
        "f1",
        "--record",
        "f1.labcomm",
    ];
    let ended = folder.run(&arguments);
    assert_eq!(ended.code, Some(6), "{}", ended.stderr);
    assert!(
        ended
            .stderr
            .contains("the server sends 3 axes, and the machine of --robot has 6"),
        "{}",
        ended.stderr
    );
    assert!(
        ended.stderr.contains("recorded 0 rows to f1.labcomm"),
        "{}",
        ended.stderr
    );
    server.stop().success();
}
