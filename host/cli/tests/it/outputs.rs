//! Outputs of commands: never onto inputs, never over measured data, whole or not at all.

use crate::process::Folder;

/// Rows that somebody has measured.
const MEASURED: &str = "series,mounting,pose,window,stroke\na,1,p,1,1\n";
const SETUP: &str =
    "format = \"gantry-tau springs 1\"\nmodel = \"l2\"\nmeasurements = \"springs.csv\"\n";

/// Runs a command that must not write `kept`; returns its error.
#[track_caller]
fn refused(folder: &Folder, kept: &str, arguments: &[&str]) -> String {
    let before = folder.read(kept);
    let line = folder.run(arguments).failure(1);
    assert!(folder.read(kept) == before, "{arguments:?} wrote {kept}");
    assert!(line.contains(kept), "{line}");
    line
}

#[test]
fn an_answer_is_not_written_onto_the_measurements() {
    let folder = Folder::new("onto_measurements");
    folder.write("springs.csv", MEASURED);
    folder.write("setup.toml", SETUP);
    for command in ["identify", "calibrate", "verify"] {
        for option in ["--json", "--report"] {
            let mut arguments = vec![
                command,
                "setup.toml",
                "--robot",
                "l2",
                option,
                "springs.csv",
            ];
            if command != "verify" {
                arguments.extend(["-o", "new.toml"]);
            }
            refused(&folder, "springs.csv", &arguments);
            assert!(!folder.path("new.toml").exists());
        }
    }
    refused(
        &folder,
        "setup.toml",
        &[
            "identify",
            "setup.toml",
            "--robot",
            "l2",
            "-o",
            "setup.toml",
            "--overwrite",
        ],
    );
}

/// A table under the name of a page was written beside the page of the default name.
#[test]
fn a_name_of_another_kind_is_refused_before_the_work() {
    let folder = Folder::new("names");
    for (arguments, name, said) in [
        (
            ["workspace", "--robot", "l2", "-o"],
            "map.html",
            "a table of `workspace`, whose name does not end in .html",
        ),
        (
            ["workspace", "--robot", "l2", "--report"],
            "map.csv",
            "a page of results, whose name does not end in .csv",
        ),
        (
            ["draw", "--robot", "l2", "-o"],
            "l2.HTML",
            "a picture, whose name does not end in .html",
        ),
        (
            ["header", "--robot", "l2", "-o"],
            "l2.toml",
            "a C header, whose name does not end in .toml",
        ),
    ] {
        let line = folder.run(&[&arguments[..], &[name]].concat()).failure(1);
        assert!(
            line.contains(&format!("cannot write {name}: the output is {said}")),
            "{line}"
        );
        assert!(!folder.path(name).exists() && !folder.path("workspace.html").exists());
    }
    // An extension that no kind has.
    folder
        .run(&["draw", "--robot", "l2", "-o", "picture.txt"])
        .success();
}

#[test]
fn a_picture_is_not_written_onto_its_machine() {
    let folder = Folder::new("onto_machine");
    folder.write(
        "x.toml",
        &gantry_tau_machine::robot_file::text_of("l2").unwrap(),
    );
    refused(
        &folder,
        "x.toml",
        &["draw", "--robot", "x.toml", "-o", "x.toml"],
    );
    refused(
        &folder,
        "x.toml",
        &["header", "--robot", "x.toml", "-o", "x.toml"],
    );
    // Not by the name of its own kind either: the same file under another one.
    std::fs::hard_link(folder.path("x.toml"), folder.path("other.toml")).unwrap();
    let line = refused(
        &folder,
        "x.toml",
        &[
            "calibrate",
            "x.toml",
            "--robot",
            "x.toml",
            "-o",
            "other.toml",
            "--overwrite",
        ],
    )
    .replace("other.toml", "");
    assert!(line.contains("the same command reads this file"), "{line}");
}

#[test]
fn a_plan_leaves_measured_tables_and_reports_leave_its_sheet() {
    let folder = Folder::new("plan_outputs");
    let plan = [
        "plan", "geometry", "--robot", "l2", "--poses", "12", "-o", "f1.toml",
    ];
    folder.write("springs.csv", MEASURED);
    folder.write("poses.csv", MEASURED);
    folder.run(&plan).success();
    assert!(
        folder.read("f1.toml").contains("measurements = \"f1.csv\""),
        "{}",
        folder.read("f1.toml")
    );
    assert_eq!(
        folder.read("springs.csv") + &folder.read("poses.csv"),
        MEASURED.repeat(2)
    );
    folder
        .run(&[&plan[..], &["--overwrite"]].concat())
        .success();
    let measured = folder.read("f1.csv").trim_end().to_owned() + "\n1,2,3\n";
    folder.write("f1.csv", &measured);
    refused(&folder, "f1.csv", &[&plan[..], &["--overwrite"]].concat());
    // The sheet to follow at the machine is not a page of results.
    for command in ["verify", "identify", "calibrate"] {
        let mut arguments = vec![command, "f1.toml", "--robot", "l2", "--report", "f1.html"];
        if command != "verify" {
            arguments.extend(["-o", "new.toml"]);
        }
        refused(&folder, "f1.html", &arguments);
    }
}

/// An interrupted command leaves what was there, and no piece of what it was about to write.
#[cfg(unix)]
#[test]
fn an_interrupted_command_leaves_whole_files_alone() {
    let folder = Folder::new("interrupted");
    folder
        .run(&["workspace", "--robot", "l2", "--cells", "4"])
        .success();
    let before = [folder.read("workspace.html"), folder.read("workspace.csv")];
    for milliseconds in [0, 5, 50, 200] {
        let running = folder.start("long", &["workspace", "--robot", "f1", "--cells", "200"]);
        std::thread::sleep(std::time::Duration::from_millis(milliseconds));
        running.interrupt();
        drop(running);
        assert!(
            [folder.read("workspace.html"), folder.read("workspace.csv")] == before,
            "after {milliseconds} ms"
        );
        let names = std::fs::read_dir(folder.path("."))
            .unwrap()
            .map(|entry| entry.unwrap().file_name());
        let new: Vec<_> = names
            .filter(|name| name.to_string_lossy().ends_with(".new"))
            .collect();
        assert!(new.is_empty(), "{new:?}");
    }
}

#[cfg(unix)]
#[test]
fn devices_and_pipes_take_their_bytes() {
    let folder = Folder::new("devices");
    let said = folder
        .run(&["draw", "--robot", "l2", "-o", "/dev/stdout"])
        .success();
    assert!(said.contains("<svg"), "{said}");
    folder
        .run(&["header", "--robot", "l2", "-o", "/dev/null"])
        .success();
}
