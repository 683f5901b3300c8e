//! Disks that are full, at the start and in the middle: the session goes on, the ramp is whole, and
//! the log tells of it once it can.

use std::fs::File;
use std::io::Read;
use std::os::unix::net::UnixStream;
use std::process::{Command, Stdio};

use rustix::process::{Pid, Resource, Rlimit, prlimit};

use super::{Bench, binary, code, lines_of, shell};
use crate::experiment::PLAN;
use crate::process::{Folder, Running, Streams};

/// Makes every file of a process full, or takes that back. (To a process a limit is as a disk: the
/// write fails.)
fn fill_disks(process: &Running, is_full: bool) {
    let current = if is_full { Some(0) } else { None };
    let limit = Rlimit {
        current,
        maximum: None,
    };
    let process = Pid::from_raw(i32::try_from(process.id()).unwrap());
    prlimit(process, Resource::Fsize, limit).unwrap();
}

/// Log, recording, black box and stop latch at once, in Obtain; and then there is room again.
#[test]
fn in_the_middle_of_a_server() {
    let bench = Bench::new("disk-server");
    let streams = Streams {
        input: Stdio::piped(),
        ..Streams::default()
    };
    let further = [
        "--record",
        "full.csv",
        "--black-box",
        "boxes",
        "--epoch-file",
        "epoch",
    ];
    let mut server = bench.serve_to(&mut binary(), streams, &further);
    let mut monitor = bench.folder.start(
        "monitor",
        &["monitor", &bench.at(7003), "--record", "serve.csv"],
    );
    let owner = bench.paced_client();
    let from = bench.await_an_offset();
    assert!(!bench.has_lost_rows());
    fill_disks(&server, true);
    bench.await_more(from);
    server.write("stop\n");
    bench.await_that("the end of the ramp", || {
        bench
            .rows()
            .last()
            .is_some_and(|row| row.offsets_nm == [0; 3])
    });
    monitor.await_words("Fault");
    assert_eq!(code(owner), Some(6));
    assert!(
        bench.has_lost_rows(),
        "a reader that comes later is sent it"
    );
    fill_disks(&server, false);
    server.await_words("of the log lost: File too large");
    server.interrupt();
    let ended = server.end();
    assert_eq!(ended.code, Some(1), "{}", bench.said());
    assert!(
        ended.stdout.contains("all offsets are zero; ended"),
        "{}",
        ended.stdout
    );
    assert!(
        ended.stdout.contains(" rows to full.csv, at least "),
        "{}",
        ended.stdout
    );
    monitor.stop().success();
    bench.assert_ramped();
    // The latch was written as soon as it could be.
    let mut next = bench.serve_to(
        &mut binary(),
        Streams::default(),
        &["--epoch-file", "epoch"],
    );
    next.await_words("Ctrl-C");
    next.await_words("it starts in Fault");
    next.stop().success();
}

/// A recording that blocks, as on a disk that hangs: the session and what is published go on, and
/// so does the end of the ramp.
#[test]
fn that_hang_block_nothing_but_the_recording() {
    let bench = Bench::new("disk-hangs");
    let pipe = bench.folder.path("pipe.csv");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    // Opened, and not read: it takes some hundred rows.
    let reader = std::thread::spawn(move || File::open(pipe).unwrap());
    let mut server = bench.serve_to(&mut binary(), Streams::default(), &["--record", "pipe.csv"]);
    let monitor = bench.folder.start(
        "monitor",
        &["monitor", &bench.at(7003), "--record", "serve.csv"],
    );
    let owner = bench.paced_client();
    let from = bench.await_an_offset();
    bench.await_more(from);
    server.interrupt();
    server.await_words("all offsets are zero; ended");
    assert_eq!(code(owner), Some(6));
    let mut reader = reader.join().unwrap();
    let mut recorded = String::new();
    reader.read_to_string(&mut recorded).unwrap();
    let said = server.end().success();
    assert!(
        said.contains(&format!(
            "recorded {} rows to pipe.csv",
            recorded.lines().count() - 1
        )),
        "{said}"
    );
    monitor.stop().success();
    bench.assert_ramped();
}

/// A recording of a monitor into a pipe that is not read: Ctrl-C ends it. A pipe without a reader
/// is refused.
#[test]
fn that_hang_keep_no_monitor() {
    let bench = Bench::new("disk-monitor");
    let pipe = bench.folder.path("pipe.csv");
    assert!(
        Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let record = ["monitor", &bench.at(7003), "--record", "pipe.csv"];
    let refused = bench.folder.start("refused", &record).end().failure(1);
    assert!(
        refused.contains("pipe.csv: no program reads the pipe"),
        "{refused}"
    );
    // Opened, and not read: it takes some hundred rows.
    let reader = std::thread::spawn(move || File::open(pipe).unwrap());
    let server = bench.healthy_serve();
    let mut monitor = bench.folder.start("monitor", &record);
    let owner = bench.paced_client();
    monitor.await_words("Obtain");
    let from = bench.await_an_offset();
    bench.await_more(from);
    monitor.interrupt();
    let said = monitor.end().failure(1);
    assert!(said.contains("its disk or reader takes nothing"), "{said}");
    drop(reader.join().unwrap());
    owner.stop().success();
    server.stop().success();
    bench.assert_ramped();
}

/// Recording of a client: it compensates, and says what it has lost.
#[test]
fn in_the_middle_of_a_client() {
    let bench = Bench::new("disk-client");
    let server = bench.healthy_serve();
    let address = bench.at(7000);
    let arguments = ["client", &address, "--record", "full.csv"];
    let mut owner = bench.folder.start("client", &arguments);
    let from = bench.await_an_offset();
    fill_disks(&owner, true);
    bench.await_more(from);
    fill_disks(&owner, false);
    owner.interrupt();
    owner.await_words("left with Goodbye");
    let said = owner.end().success();
    assert!(said.contains(" rows to full.csv, at least "), "{said}");
    server.stop().success();
    bench.assert_ramped();
}

/// A disk without room at the start, with a pipe as the log.
fn said_on_a_full_disk(folder: &Folder, arguments: &[&str]) -> (Option<i32>, String) {
    let (mut ours, theirs) = UnixStream::pair().unwrap();
    let log = Some(Stdio::from(std::os::fd::OwnedFd::from(theirs)));
    let running = folder.start_by(
        &mut shell("ulimit -f 0;", ""),
        "full",
        arguments,
        Streams {
            log,
            ..Streams::default()
        },
    );
    let code = running.end().code;
    let mut said = String::new();
    ours.read_to_string(&mut said).unwrap();
    (code, said)
}

#[test]
fn at_the_start_is_one_line() {
    let bench = Bench::new("disk-start");
    bench.folder.write("plan.toml", PLAN);
    let serve = ["serve", "--listen", "127.0.0.1:0", "--epoch-file", "epoch"];
    let demo = [
        "demo",
        "--pace",
        "lockstep",
        "--step-seconds",
        "0.5",
        "--force-max",
        "60",
        "--report",
        "report.html",
    ];
    let experiment = [
        "experiment",
        "plan.toml",
        "--simulated",
        "-o",
        "springs.csv",
    ];
    for (arguments, named) in [
        (serve.as_slice(), "epoch"),
        (&demo, "report.html"),
        (&experiment, "springs.csv"),
    ] {
        let (code, said) = said_on_a_full_disk(&bench.folder, arguments);
        assert_eq!(code, Some(1), "{said}");
        assert!(
            said.lines()
                .any(|line| line.starts_with("gantry-tau: ") && line.contains(named)),
            "{said}"
        );
        assert!(!said.contains("panicked"), "{said}");
    }
}

/// The report of a demo: the demo ends with its name, and no part of it is left.
#[test]
fn in_the_middle_of_a_demo() {
    let bench = Bench::new("disk-demo");
    let (mut ours, theirs) = UnixStream::pair().unwrap();
    let log = Some(Stdio::from(std::os::fd::OwnedFd::from(theirs)));
    let arguments = [
        "demo",
        "--pace",
        "lockstep",
        "--step-seconds",
        "0.5",
        "--force-max",
        "60",
        "--report",
        "r.html",
    ];
    let demo = bench.folder.start_by(
        &mut binary(),
        "demo",
        &arguments,
        Streams {
            log,
            ..Streams::default()
        },
    );
    let mut begun = [0; 1];
    ours.read_exact(&mut begun).unwrap();
    fill_disks(&demo, true);
    assert_eq!(code(demo), Some(1), "{}", bench.said());
    let mut said = String::new();
    ours.read_to_string(&mut said).unwrap();
    assert!(
        said.lines()
            .any(|line| line.starts_with("gantry-tau: ") && line.contains("r.html")),
        "{said}"
    );
    assert!(!bench.folder.path("r.html").exists());
}

/// The table of a campaign: it ends with the name of the table, and the server hears a Goodbye.
#[test]
fn in_the_middle_of_an_experiment() {
    let bench = Bench::new("disk-experiment");
    let (before, series) = PLAN.split_once("levels_n").unwrap();
    let series = series.replacen(
        "[0.0, 60.0, 0.0]",
        "[0.0, 60.0, 0.0, 60.0, 0.0, 60.0, 0.0]",
        1,
    );
    bench
        .folder
        .write("plan.toml", &format!("{before}levels_n{series}"));
    let [server, gauges] = [7000, 7002].map(|port| bench.at(port));
    let addresses = ["--gauges", &gauges];
    let serve = [
        "serve",
        "--plan",
        "plan.toml",
        "--pace",
        "lockstep",
        "--listen",
        &server,
    ];
    let mut machine = bench
        .folder
        .start("serve", &[serve.as_slice(), &addresses].concat());
    machine.await_words("Ctrl-C");
    let (mut ours, theirs) = UnixStream::pair().unwrap();
    let log = Some(Stdio::from(std::os::fd::OwnedFd::from(theirs)));
    let arguments = [
        "experiment",
        "plan.toml",
        "--server",
        &server,
        "--unattended",
        "-o",
        "springs.csv",
    ];
    let arguments = [arguments.as_slice(), &addresses].concat();
    let streams = Streams {
        log,
        ..Streams::default()
    };
    let experiment = bench
        .folder
        .start_by(&mut binary(), "experiment", &arguments, streams);
    let table = bench.folder.path("springs.csv");
    bench.await_that("a window", || lines_of(&table) > 1);
    fill_disks(&experiment, true);
    assert_eq!(code(experiment), Some(1), "{}", bench.said());
    let mut said = String::new();
    ours.read_to_string(&mut said).unwrap();
    assert!(
        said.lines().last().unwrap().contains("springs.csv"),
        "{said}"
    );
    machine.await_words("the client said goodbye");
    machine.stop().success();
}
