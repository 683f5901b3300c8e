//! Errors before anything moves: each is one line with problem and place.

use std::net::TcpListener;

use crate::process::Folder;

const L2: &str = include_str!("../../../../robots/l2.toml");
/// A server on free ports.
const SERVE: [&str; 3] = ["serve", "--listen", "127.0.0.1:0"];

#[track_caller]
fn assert_says(line: &str, words: &[&str]) {
    for word in words {
        assert!(line.contains(word), "{word} is not in: {line}");
    }
}

#[test]
fn a_port_in_use_is_named_and_costs_no_recording() {
    let folder = Folder::new("port");
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().to_string();
    folder.write("old.csv", "kept\n");
    for arguments in [
        &["--listen", &port][..],
        &["--listen", "127.0.0.1:0", "--labcomm", &port],
    ] {
        let all = [&["serve", "--record", "old.csv"], arguments].concat();
        let line = folder.run(&all).failure(1);
        assert_says(&line, &[&port, "in use"]);
    }
    assert_eq!(
        folder.read("old.csv"),
        "kept\n",
        "the last recording is gone"
    );
}

#[test]
fn a_server_that_is_not_there_is_named_and_costs_no_recording() {
    let folder = Folder::new("unreachable");
    folder.write("old.csv", "kept\n");
    // A free port of the system's choice could be another test's a moment later; the system never
    // assigns port 1.
    let address = "127.0.0.1:1";
    let line = folder
        .run(&["client", address, "--record", "old.csv"])
        .failure(3);
    assert_says(&line, &["server", address, "cannot be reached"]);
    // A server without a sensor.
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let there = server.local_addr().unwrap().to_string();
    let sensor = format!("labcomm:{address}");
    let line = folder
        .run(&["client", &there, "--sensor", &sensor, "--record", "old.csv"])
        .failure(3);
    assert_says(&line, &["force sensor", address, "cannot be reached"]);
    assert_eq!(
        folder.read("old.csv"),
        "kept\n",
        "the last recording is gone"
    );
}

#[test]
fn an_address_that_is_none_is_refused() {
    let folder = Folder::new("address");
    for arguments in [
        ["client", "127.0.0.1"],
        ["client", "127.0.0.1:99999"],
        ["client", "no.such.host.invalid:7000"],
        ["serve", "--listen=:"],
        ["serve", "--gauges=127.0.0.1:x"],
    ] {
        let line = folder.run(&arguments).failure(2);
        let value = arguments[1].rsplit('=').next().unwrap();
        assert_says(&line, &["invalid value", value]);
    }
}

#[test]
fn a_host_may_have_a_name() {
    let folder = Folder::new("name");
    let line = folder.run(&["client", "localhost:1"]).failure(3);
    assert_says(&line, &["cannot be reached"]);
}

#[test]
fn a_workpiece_that_cannot_be_simulated_is_refused() {
    let folder = Folder::new("workpiece");
    for (arguments, words) in [
        (
            ["--workpiece=1e7", "--quasi-static"],
            "stiffness of the workpiece (N/m) must be from 1e0 to 1e6",
        ),
        (["--workpiece", "NaN"], "stiffness of the workpiece"),
        (
            ["--workpiece=1e5", "--workpiece-gap=-1"],
            "gap above the workpiece (m) must be from 0e0 to 1e-2",
        ),
    ] {
        let line = folder.run(&[&SERVE[..], &arguments].concat()).failure(1);
        assert_says(&line, &[words]);
    }
    let line = folder
        .run(&[&SERVE[..], &["--workpiece=1e10"]].concat())
        .failure(1);
    assert_says(
        &line,
        &["stiffness of the workpiece (N/m) must be from 1e0 to 1e9"],
    );
    for arguments in [
        ["--workpiece=1e5", "--force-max=60"],
        ["--workpiece-gap", "3"],
        ["--milling=300", "--plan=campaign.toml"],
    ] {
        folder.run(&[&SERVE[..], &arguments].concat()).failure(2);
    }
}

#[test]
fn a_robot_file_is_refused_with_file_key_and_reason() {
    let folder = Folder::new("robot");
    for (from, to, words) in [
        ("gain = 1.0", "gain = 2.0", ["client.gain", "1"]),
        ("gain = 1.0", "gian = 1.0", ["gian", "unknown"]),
        ("gain = 1.0", "gain = \"much\"", ["gain", "string"]),
        ("gain = 1.0", "gain = ", ["gain", "line"]),
        ("gain = 1.0", "", ["gain", "missing"]),
        (
            "ramp_um = [0.1",
            "ramp_um = [0.0",
            ["ramp", "axes.position"],
        ),
        (
            "axis_of_motor = [0, 1, 2]",
            "axis_of_motor = [0, 1]",
            ["motors.axis_of_motor", "2"],
        ),
        ("c = [1, -1, 1]", "c = [1, -1, 3]", ["c[2]", "3"]),
    ] {
        assert!(L2.contains(from), "{from}");
        folder.write("mine.toml", &L2.replacen(from, to, 1));
        for command in ["demo", "serve", "client"] {
            let line = folder.run(&[command, "--robot", "mine.toml"]).failure(1);
            assert_says(&line, &["mine.toml"]);
            assert_says(&line, &words);
        }
    }
    for command in ["demo", "serve", "client"] {
        let line = folder.run(&[command, "--robot", "none.toml"]).failure(1);
        assert_says(&line, &["none.toml: No such file or directory"]);
    }
}

#[test]
fn a_file_that_cannot_be_written_is_named() {
    let folder = Folder::new("files");
    folder.write("file", "");
    let short = [
        "demo",
        "--pace",
        "lockstep",
        "--step-seconds",
        "0.5",
        "--force-max",
        "60",
    ];
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap().to_string();
    // A folder that does not exist, a folder that is a file, a file that is a folder.
    std::fs::create_dir(folder.path("folder.mcap")).unwrap();
    let recordings = ["no/such.csv", "file/such.labcomm", "folder.mcap"];
    for (index, bad) in ["no/such.x", "file/such.x", "."].into_iter().enumerate() {
        for (command, option) in [
            (&SERVE[..], "--record"),
            (&SERVE[..], "--epoch-file"),
            (&["client", &address][..], "--record"),
            (&short[..], "--record"),
            (&short[..], "--report"),
            (&short[..], "--json"),
            (&short[..], "--black-box"),
        ] {
            if (bad, option) == ("no/such.x", "--epoch-file") {
                // The folder of the epoch file is made.
                continue;
            }
            let mut arguments = command.to_vec();
            // A recording has the extension of its format.
            let bad = if option == "--record" {
                recordings[index]
            } else {
                bad
            };
            arguments.extend([option, bad]);
            let line = folder.run(&arguments).failure(1);
            let reason = if (bad, option) == (".", "--epoch-file") {
                "names a folder"
            } else {
                "os error"
            };
            assert_says(&line, &[bad, reason]);
        }
    }
}

#[test]
fn a_recording_of_no_known_format_is_refused_with_the_formats() {
    let folder = Folder::new("format");
    for command in ["serve", "client", "demo", "monitor"] {
        for name in ["run", "run.txt", ".csv", "run.CSV"] {
            let line = folder.run(&[command, "--record", name]).failure(2);
            assert_says(&line, &[name, "FILE.csv", "FILE.labcomm", "FILE.mcap"]);
        }
    }
}

#[test]
fn an_epoch_file_that_is_no_counter_is_not_overwritten() {
    let folder = Folder::new("epoch");
    folder.write("epoch", "seven");
    let mut arguments = SERVE.to_vec();
    arguments.extend(["--epoch-file", "epoch"]);
    let line = folder.run(&arguments).failure(1);
    assert_says(&line, &["epoch", "does not contain a counter"]);
    assert_eq!(folder.read("epoch"), "seven");
}

#[test]
fn a_bad_option_is_named_with_its_range() {
    let folder = Folder::new("options");
    for (option, value) in [
        ("--force-max", "-3"),
        ("--force-max", "nan"),
        ("--force-max", "1e9"),
        ("--force-step", "0"),
        ("--force-step", "49"),
        ("--step-seconds", "0.1"),
        ("--step-seconds", "inf"),
    ] {
        let line = folder.run(&["demo", option, value]).failure(1);
        assert_says(&line, &[option]);
    }
    for (option, value) in [
        ("--force-max", "nan"),
        ("--force-max", "-1"),
        ("--step-seconds", "-1"),
        ("--step-seconds", "nan"),
        ("--motion", "nan"),
        ("--motion", "-1e9"),
    ] {
        let mut arguments = SERVE.to_vec();
        arguments.extend([option, value]);
        let line = folder.run(&arguments).failure(1);
        assert_says(&line, &[option]);
    }
    for arguments in [
        &["demo", "--force-max", "much"][..],
        &["demo", "--pace", "fast"],
        &["serve", "--pace"],
        &["client", "--bogus"],
        &["bogus"],
        &["solve", "file.json"],
        &["serve", "--labcomm-version", "2014"],
    ] {
        let line = folder.run(arguments).failure(2);
        assert!(line.starts_with("error: "), "{line}");
    }
}

/// Runs the binary behind a command of the shell; returns its exit code and what it complains of.
#[cfg(target_os = "linux")]
fn run_by_shell(folder: &Folder, before: &str, arguments: &str) -> (Option<i32>, String) {
    let line = format!("{before} exec \"$0\" {arguments}");
    let output = std::process::Command::new("sh")
        .args(["-c", &line, crate::process::BINARY])
        .current_dir(folder.path(""))
        .output()
        .unwrap();
    (
        output.status.code(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

/// A full standard output and a file at its limit are errors, and no part of a file is left.
#[cfg(target_os = "linux")]
#[test]
fn a_short_command_whose_output_is_full_fails_in_one_line() {
    let folder = Folder::new("short-full");
    let (code, said) = run_by_shell(&folder, "", "follow > /dev/full");
    assert_eq!((code, said.lines().count()), (Some(1), 1), "{said}");
    assert!(
        said.contains("standard output: No space left on device"),
        "{said}"
    );
    for (arguments, file) in [
        ("workspace --robot l2 -o w.csv", "w.csv"),
        ("plan springs --robot l2 -o p.toml", "p.toml"),
        ("header --robot l2 -o l2.h", "l2.h"),
    ] {
        let (code, said) = run_by_shell(&folder, "ulimit -f 1;", arguments);
        assert_eq!(
            (code, said.lines().count()),
            (Some(1), 1),
            "{arguments}: {said}"
        );
        assert!(
            said.contains(file) && said.contains("File too large"),
            "{arguments}: {said}"
        );
    }
    let left: Vec<_> = std::fs::read_dir(folder.path(""))
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    assert_eq!(
        left,
        ["follow.html"],
        "written before its table was printed"
    );
}

/// Texts of files cannot command the terminal.
#[test]
fn texts_of_files_are_shown_escaped() {
    let folder = Folder::new("escaped");
    folder.write("robot.toml", "model = \"l2\"\n\"a\\u001b[31mb\" = 1\n");
    folder.write("\u{1b}[31m.toml", "x = 1\n");
    for file in ["robot.toml", "\u{1b}[31m.toml"] {
        let said = folder.run(&["draw", "--robot", file]).failure(1);
        assert!(
            !said.contains('\u{1b}') && said.contains("u{1b}[31m"),
            "{said:?}"
        );
    }
}
