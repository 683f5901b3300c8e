//! Recordings of a program that was killed: every row but the last moment's is there, for the usual
//! readers.

use std::path::Path;

use gantry_tau_machine::model::L2_MOTORS;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_record::recording::recover;
use gantry_tau_test_support::sessions;
use rustix::process::{Pid, Resource, Rlimit, prlimit};

use super::labcomm::decoded;
use super::to;
use crate::process::Folder;
use crate::signals::serve;

/// Kills of each format.
const KILLS: u64 = 17;

/// Numbers that look random, the same in every run.
fn draw(seed: u64) -> u64 {
    (seed + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40
}

/// The same command line after every kill: each run leaves a recording of its own, which its reader
/// takes.
#[test]
fn every_recording_is_readable_after_a_kill_and_none_is_overwritten() {
    for format in ["csv", "labcomm", "mcap"] {
        let folder = Folder::new(&format!("killed-{format}"));
        let asked = format!("run.{format}");
        let mut kept: Vec<(String, Vec<u8>)> = Vec::new();
        for kill in 0..KILLS {
            let name = if kill == 0 {
                asked.clone()
            } else {
                format!("run-{}.{format}", kill + 1)
            };
            let (mut server, _) = serve(&folder, &["--record", &asked]);
            // With at least a byte; with many rows; in the middle of the second chunk of a second.
            let bytes = 1 + draw(kill) % if format == "mcap" { 1_500_000 } else { 60_000 };
            let path = folder.path(&name);
            server.await_that(&name, |_| {
                std::fs::metadata(&path).is_ok_and(|file| file.len() >= bytes)
            });
            server.kill();
            kept.push((name, std::fs::read(&path).unwrap()));
        }
        let mut rows = 0;
        for (name, bytes) in &kept {
            assert!(
                std::fs::read(folder.path(name)).unwrap() == *bytes,
                "{name} was written to by a later run"
            );
            rows += match format {
                "csv" => csv_rows(name, bytes),
                "labcomm" => decoded(&folder.path(name))
                    .iter()
                    .filter(|line| line["sample"] == "axes")
                    .count(),
                _ => {
                    let said = folder.run(&["recover", name]).success();
                    let recovered = name.replace(".mcap", "-recovered.mcap");
                    assert!(said.starts_with(&recovered), "{said}");
                    let bytes = std::fs::read(folder.path(&recovered)).unwrap();
                    super::mcap::samples(&bytes).of("axes").len()
                }
            };
        }
        assert!(rows > 500, "{format}: {rows} rows");
    }
}

/// Size of a file, bytes; 0 if it is not there.
fn size_of(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |file| file.len())
}

/// A disk that takes a part of a row and no more. (To a process a limit is as a disk.) The
/// recording ends with the row before.
#[test]
fn a_recording_on_a_disk_that_fills_up_ends_with_a_whole_row() {
    for format in ["csv", "labcomm"] {
        for odd in [1, 191] {
            let folder = Folder::new(&format!("filled-{format}-{odd}"));
            let name = format!("run.{format}");
            let (mut server, _) = serve(&folder, &["--record", &name]);
            let path = folder.path(&name);
            server.await_that(&name, |_| size_of(&path) > 20_000);
            let current = Some(size_of(&path) + 100_000 + odd);
            let process = Pid::from_raw(i32::try_from(server.id()).unwrap());
            prlimit(
                process,
                Resource::Fsize,
                Rlimit {
                    current,
                    maximum: None,
                },
            )
            .unwrap();
            server.await_words("its rows are lost from here on");
            assert!(
                current > Some(size_of(&path)) && size_of(&path) > 100_000,
                "{} of {current:?}",
                size_of(&path)
            );
            let ended = server.stop();
            assert_eq!(ended.code, Some(1), "{}", ended.stderr);
            let bytes = std::fs::read(&path).unwrap();
            let rows = match format {
                "csv" => csv_rows(&name, &bytes),
                _ => decoded(&path)
                    .iter()
                    .filter(|line| line["sample"] == "axes")
                    .count(),
            };
            let written = format!("recorded at most {rows} rows to {name}, at least ");
            assert!(
                ended.stdout.contains(&written),
                "{written}: {}",
                ended.stdout
            );
        }
    }
}

/// Rows of a table that ends with a whole line, or is empty.
fn csv_rows(name: &str, bytes: &[u8]) -> usize {
    assert!(
        bytes.is_empty() || bytes.ends_with(b"\n"),
        "{name} ends in the middle of a line"
    );
    let mut reader = csv::Reader::from_reader(bytes);
    let rows: Result<Vec<_>, _> = reader.records().collect();
    rows.unwrap_or_else(|error| panic!("{name}: {error}")).len()
}

/// A recording cut at any byte, as a power failure may: `recover` keeps what is whole, and the file
/// is complete then.
#[test]
fn a_recording_cut_anywhere_is_recovered() {
    let folder = Folder::new("recovered");
    let robot = RobotFile::builtin_l2().unwrap();
    sessions::run::<_, 3, L2_MOTORS>(
        &robot,
        &[to(&folder, "whole.mcap")],
        to(&folder, "client.mcap"),
    );
    let whole = std::fs::read(folder.path("whole.mcap")).unwrap();
    let all = super::mcap::samples(&whole);
    assert!(
        recover(&folder.path("whole.mcap"))
            .unwrap_err()
            .to_string()
            .contains("is complete")
    );
    let mut most = 0;
    for cut in 0..50 {
        let length = usize::try_from(draw(cut)).unwrap() % whole.len();
        folder.write("cut.mcap", "");
        std::fs::write(folder.path("cut.mcap"), &whole[..length]).unwrap();
        let recovered = match recover(&folder.path("cut.mcap")) {
            // Not even the head is there.
            Err(error) => {
                assert!(length < 100, "{length}: {error}");
                continue;
            }
            Ok(recovered) => recovered,
        };
        let bytes = std::fs::read(&recovered.path).unwrap();
        let stats = ::mcap::Summary::read(&bytes)
            .unwrap()
            .unwrap()
            .stats
            .unwrap();
        assert_eq!(stats.message_count, recovered.messages, "{length}");
        let samples = super::mcap::samples(&bytes);
        // What is there is the beginning of the whole.
        for name in ["axes", "state", "tool", "drives"] {
            let kept = samples.of(name);
            assert_eq!(kept, &all.of(name)[..kept.len()], "{name}, cut at {length}");
        }
        // As much of it as there is of the file, but for what is not yet a whole message, and the
        // indexes.
        let kept = samples.of("axes").len();
        let there = all.of("axes").len() * length / whole.len();
        assert!(
            kept + 60 > there * 9 / 10,
            "{kept} of {there}, cut at {length}"
        );
        most = most.max(kept);
        std::fs::remove_file(&recovered.path).unwrap();
    }
    assert!(most > 300, "{most}");
    // A bit that has changed ends the recovery at its chunk. Between two chunks lie indexes, which
    // are not looked at.
    let chunks = ::mcap::Summary::read(&whole)
        .unwrap()
        .unwrap()
        .chunk_indexes;
    let chunk = &chunks[chunks.len() / 2];
    let mut damaged = whole[..whole.len() - 8].to_vec();
    damaged[usize::try_from(chunk.chunk_start_offset + chunk.chunk_length / 2).unwrap()] ^= 1;
    std::fs::write(folder.path("damaged.mcap"), &damaged).unwrap();
    let recovered = recover(&folder.path("damaged.mcap")).unwrap();
    let samples = super::mcap::samples(&std::fs::read(&recovered.path).unwrap());
    let before_ns = chunk.message_start_time;
    let ticks = all.of("axes").iter().map(|axes| axes["tick"].as_u64());
    let expected = ticks
        .filter(|tick| tick.unwrap() * 1_000_000 < before_ns)
        .count();
    assert!(expected > 100, "{expected}");
    let kept = samples.of("axes");
    // The first message of the chunk may be a later one of its tick.
    assert!(
        (expected..=expected + 1).contains(&kept.len()),
        "{} of {expected}",
        kept.len()
    );
    assert_eq!(kept, &all.of("axes")[..kept.len()]);
    folder.write("other.mcap", "not MCAP");
    assert!(
        recover(&folder.path("other.mcap"))
            .unwrap_err()
            .to_string()
            .contains("is not an MCAP recording")
    );
}
