//! Every command times every standard stream times every way to fail.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::process::{Command, Stdio};

use super::{Bench, binary, code, lines_of, shell, terminal};
use crate::experiment::PLAN;
use crate::process::{Running, Streams};

/// A way to fail.
#[derive(Clone, Copy, Debug)]
enum Failure {
    /// Closed before the start.
    Closed,
    /// Every write fails: no space.
    Full,
    /// No write returns.
    Blocked,
    /// The reader ends in Obtain.
    ReaderDies,
    /// The terminal is gone in Obtain.
    TerminalGone,
}

const FAILURES: [Failure; 5] = [
    Failure::Closed,
    Failure::Full,
    Failure::Blocked,
    Failure::ReaderDies,
    Failure::TerminalGone,
];

/// Streams that fail.
#[derive(Clone, Copy, Debug)]
enum Failing {
    Output,
    Log,
    Both,
}

/// The other end of a stream; dropped, the stream fails.
type OtherEnd = Option<Box<dyn std::any::Any>>;

impl Failure {
    /// Returns the program and the streams of a command, and the other end of those that fail.
    fn streams(self, failing: Failing) -> (Command, Streams, OtherEnd) {
        let (stream, other): (Option<OwnedFd>, OtherEnd) = match self {
            Self::Closed => (None, None),
            Self::Full => (
                Some(
                    File::options()
                        .write(true)
                        .open("/dev/full")
                        .unwrap()
                        .into(),
                ),
                None,
            ),
            Self::Blocked => {
                let (mut ours, theirs) = UnixStream::pair().unwrap();
                // Filled to the last byte.
                theirs.set_nonblocking(true).unwrap();
                for size in [1 << 16, 1] {
                    while (&theirs).write(&vec![0; size]).is_ok() {}
                }
                theirs.set_nonblocking(false).unwrap();
                ours.flush().unwrap();
                (Some(theirs.into()), Some(Box::new(ours)))
            }
            Self::ReaderDies => {
                let (ours, theirs) = UnixStream::pair().unwrap();
                (Some(theirs.into()), Some(Box::new(ours)))
            }
            Self::TerminalGone => {
                let (user, program) = terminal();
                (Some(program), Some(Box::new(user)))
            }
        };
        let (output, log) = match failing {
            Failing::Output => (true, false),
            Failing::Log => (false, true),
            Failing::Both => (true, true),
        };
        let [to_output, to_log] = [output, log].map(|is_wanted| {
            let stream = stream.as_ref().filter(|_| is_wanted)?;
            Some(Stdio::from(stream.try_clone().unwrap()))
        });
        let program = match self {
            Self::Closed => {
                let behind = [(output, ">&-"), (log, "2>&-")]
                    .map(|(closed, word)| if closed { word } else { "" });
                shell("", &behind.join(" "))
            }
            _ => binary(),
        };
        (
            program,
            Streams {
                output: to_output,
                log: to_log,
                ..Streams::default()
            },
            other,
        )
    }

    /// Checks that the stream that is left tells of the other. (A closed stream is `/dev/null` to
    /// every Rust program.)
    fn assert_told(self, failing: Failing, output: &str, log: &str) {
        assert!(
            !format!("{output}{log}").contains("panicked"),
            "{output}{log}"
        );
        match (self, failing) {
            (Self::Closed, _) | (_, Failing::Both) => {}
            (_, Failing::Output) => assert!(
                log.contains("of the standard output lost: "),
                "{self:?}: {log}"
            ),
            (_, Failing::Log) => {
                assert!(output.contains("of the log lost: "), "{self:?}: {output}")
            }
        }
    }
}

/// Calls `walk` with every failure of both streams, and of each alone where the other tells of it.
fn each(walk: impl Fn(&str, Failure, Failing)) {
    for failure in FAILURES {
        let alone = matches!(failure, Failure::Full | Failure::Blocked);
        for failing in [Failing::Both, Failing::Output, Failing::Log] {
            if alone || matches!(failing, Failing::Both) {
                walk(&format!("{failure:?}-{failing:?}"), failure, failing);
            }
        }
    }
}

#[test]
fn of_a_server() {
    each(|name, failure, failing| {
        let bench = Bench::new(&format!("server-{name}"));
        let (mut program, streams, other) = failure.streams(failing);
        let server = bench.serve(&mut program, streams, &[]);
        let owner = bench.client(&mut binary(), Streams::default());
        let from = bench.await_an_offset();
        drop(other);
        bench.await_more(from);
        let ended = server.stop();
        assert_eq!(ended.code, Some(0), "{name}: {}", bench.said());
        bench.assert_ramped();
        failure.assert_told(failing, &ended.stdout, &ended.stderr);
        assert_eq!(code(owner), Some(6), "{name}");
    });
}

#[test]
fn of_a_client() {
    each(|name, failure, failing| {
        let bench = Bench::new(&format!("client-{name}"));
        let server = bench.healthy_serve();
        let (mut program, streams, other) = failure.streams(failing);
        let owner = bench.client(&mut program, streams);
        let from = bench.await_an_offset();
        drop(other);
        bench.await_more(from);
        let ended = owner.stop();
        assert_eq!(ended.code, Some(0), "{name}: {}", bench.said());
        failure.assert_told(failing, &ended.stdout, &ended.stderr);
        let ended = server.stop();
        assert!(
            ended.stderr.contains("the client said goodbye"),
            "{}",
            ended.stderr
        );
        ended.success();
        bench.assert_ramped();
    });
}

/// Of the relay between server and client.
#[test]
fn of_a_relay() {
    each(|name, failure, failing| {
        let bench = Bench::new(&format!("relay-{name}"));
        let server = bench.healthy_serve();
        let (listen, to) = (bench.at(7100), bench.at(7000));
        let (mut program, streams, other) = failure.streams(failing);
        let arguments = ["faults", "--listen", &listen, "--to", &to, "--json"];
        let relay = bench
            .folder
            .start_by(&mut program, "faults", &arguments, streams);
        bench.await_port(7100);
        let owner = bench.folder.start("client", &["client", &listen]);
        let from = bench.await_an_offset();
        drop(other);
        bench.await_more(from);
        owner.stop().success();
        let ended = relay.stop();
        assert_eq!(ended.code, Some(0), "{name}: {}", bench.said());
        // Its output is for programs, and has nothing but its format.
        if matches!(failing, Failing::Log) {
            serde_json::from_str::<serde_json::Value>(&ended.stdout).unwrap();
        }
        server.stop().success();
        bench.assert_ramped();
    });
}

/// Of a monitor that records: the recording goes on.
#[test]
fn of_a_monitor() {
    each(|name, failure, failing| {
        let bench = Bench::new(&format!("monitor-{name}"));
        let server = bench.healthy_serve();
        let owner = bench.paced_client();
        let (labcomm, page) = (bench.at(7003), bench.at(8080));
        let forms: [&[&str]; 3] = [&[], &["--status", "--every", "0.05"], &["--web", &page]];
        let mut monitors: Vec<(Running, String)> = Vec::new();
        let mut ends = Vec::new();
        for (number, form) in forms.iter().enumerate() {
            let (mut program, streams, other) = failure.streams(failing);
            let file = format!("monitor{number}.csv");
            let arguments = [["monitor", &labcomm, "--record", &file].as_slice(), form].concat();
            let running = bench.folder.start_by(
                &mut program,
                &format!("monitor{number}"),
                &arguments,
                streams,
            );
            monitors.push((running, file));
            ends.push(other);
        }
        let from = bench.await_an_offset();
        monitors
            .iter()
            .for_each(|(_, file)| bench.await_growth(file));
        ends.clear();
        bench.await_more(from);
        monitors
            .iter()
            .for_each(|(_, file)| bench.await_growth(file));
        for (monitor, _) in monitors {
            assert_eq!(monitor.stop().code, Some(0), "{name}: {}", bench.said());
        }
        owner.stop().success();
        server.stop().success();
    });
}

/// A monitor without a recording ends with its reader.
#[test]
fn of_a_monitor_alone_end_it() {
    for form in [[].as_slice(), &["--status", "--every", "0.05"]] {
        let bench = Bench::new(&format!("monitor-alone-{}", form.len()));
        let server = bench.healthy_serve();
        let (ours, theirs) = UnixStream::pair().unwrap();
        let streams = Streams {
            output: Some(OwnedFd::from(theirs).into()),
            ..Streams::default()
        };
        let labcomm = bench.at(7003);
        let monitor = bench.folder.start_by(
            &mut binary(),
            "monitor",
            &[["monitor", &labcomm].as_slice(), form].concat(),
            streams,
        );
        let mut line = String::new();
        BufReader::new(ours).read_line(&mut line).unwrap();
        assert!(!line.is_empty());
        assert_eq!(code(monitor), Some(0), "{}", bench.said());
        server.stop().success();
    }
}

/// On a terminal each screen is written over the last one; into a pipe they follow each other.
#[test]
fn of_a_monitor_are_a_screen_on_a_terminal() {
    let bench = Bench::new("monitor-screen");
    let server = bench.healthy_serve();
    let labcomm = bench.at(7003);
    let (user, program) = terminal();
    let streams = Streams {
        output: Some(program.into()),
        ..Streams::default()
    };
    let monitor = bench
        .folder
        .start_by(&mut binary(), "monitor", &["monitor", &labcomm], streams);
    let (mut text, mut bytes, mut screen) = (String::new(), [0; 4_096], File::from(user));
    while text.matches("\x1b[H").count() < 3 {
        let count = screen.read(&mut bytes).unwrap();
        text.push_str(&String::from_utf8_lossy(&bytes[..count]));
    }
    assert!(text.starts_with("\x1b[2J\x1b[H"), "{text:?}");
    // Its end of the line adds one of its own; each line is erased before its text.
    assert!(text.contains("\r\r\n\x1b[K"), "{text:?}");
    monitor.stop().success();
    server.stop().success();
}

#[test]
fn of_a_demo() {
    each(|name, failure, failing| {
        let bench = Bench::new(&format!("demo-{name}"));
        let (mut program, streams, other) = failure.streams(failing);
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
        let demo = bench
            .folder
            .start_by(&mut program, "demo", &arguments, streams);
        // The relay to the client is the first that listens; the phase does not matter to the demo.
        drop(other);
        let ended = demo.end();
        assert_eq!(ended.code, Some(0), "{name}: {}", bench.said());
        assert!(bench.folder.read("r.html").contains("</html>"));
    });
}

/// Of a campaign over a session: windows are taken.
#[test]
fn of_an_experiment() {
    for failure in FAILURES {
        let bench = Bench::new(&format!("experiment-{failure:?}"));
        bench.folder.write("plan.toml", PLAN);
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
        let (mut program, streams, other) = failure.streams(Failing::Both);
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
        let experiment = bench
            .folder
            .start_by(&mut program, "experiment", &arguments, streams);
        machine.await_words("Handshake -> Submit");
        drop(other);
        let table = bench.folder.path("springs.csv");
        bench.await_that("a window", || lines_of(&table) > 1);
        let ended = experiment.stop();
        // It may have been faster than the signal.
        let complete = lines_of(&table) == 4;
        assert_eq!(
            ended.code,
            Some(if complete { 0 } else { 3 }),
            "{failure:?}: {}",
            bench.said()
        );
        machine.await_words("the client said goodbye");
        machine.stop().success();
    }
}
