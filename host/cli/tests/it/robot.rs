//! `robot check`, and names of machines.

use std::process::Stdio;

use gantry_tau_machine::robot_file::text_of;

use crate::process::Folder;

#[test]
fn a_good_file_is_summed_up_with_its_units() {
    let folder = Folder::new("robot_good");
    for (robot, model, more) in [
        (
            "L2",
            "l2, 3 axes, 3 motors",
            [
                "carts, um/N           0.0406, 0.0509, 0.0600",
                "agitation, um/s",
                "18.00 N (0.00, 0.00, -18.00)",
                "low-pass 6 Hz of second order, 2 notches (Q 0.7)",
            ],
        ),
        (
            "f1",
            "f1, 6 axes, 9 motors",
            [
                "plates, urad/(N m)    2.0000, 2.0000, 2.0000",
                "tool",
                "ramp per ms",
                "low-pass 8 Hz of second order, 3 notches (Q 0.8)",
            ],
        ),
    ] {
        let said = folder.run(&["robot", "check", robot]).success();
        for words in [
            "no errors",
            model,
            "nominal travel, m",
            "offset, um",
            "links, um/N           0.500, 0.600, 0.550, 0.700, 0.650, 0.600",
            "springs and masses ",
            "corrections to first order",
            "reach in x, m",
            "condition number",
            "compliance, um/N",
        ]
        .into_iter()
        .chain(more)
        {
            assert!(said.contains(words), "{words}: {said}");
        }
    }
}

#[test]
fn every_error_has_a_line_with_its_key_and_reason() {
    let folder = Folder::new("robot_bad");
    let text = text_of("l2").unwrap();
    let changes = [
        ("gain = 1.0", "gian = 1.0"),
        ("cutoff_hz = 6.0", "cutoff_hz = -20.0"),
        ("axis_of_motor = [0, 1, 2]", "axis_of_motor = [0, 1, 1]"),
        ("seed = 2013", "seed = \"first\""),
    ];
    let bad = changes
        .iter()
        .fold(text, |text, (from, to)| text.replacen(from, to, 1));
    folder.write("bad.toml", &bad);
    let ended = folder.run(&["robot", "check", "bad.toml"]);
    assert_eq!(ended.code, Some(1));
    let said = ended.stderr;
    let lines: Vec<&str> = said.lines().collect();
    let expected = [
        "bad.toml: client.gian: unknown field `gian`",
        "bad.toml: client.gain: missing field `gain`",
        "bad.toml: simulation.seed: invalid type: string \"first\", expected u64",
        "bad.toml: motors.axis_of_motor: leaves axis 2 without a motor",
        "bad.toml: sensor.cutoff_hz: is -20; expected from 0.001 to 100000",
        "bad.toml: 5 errors",
    ];
    assert_eq!(lines.len(), expected.len(), "{said}");
    for (line, words) in lines.iter().zip(expected) {
        assert!(line.contains(words), "{words}: {said}");
    }
}

#[test]
fn a_machine_that_is_not_there_is_named_with_those_that_are() {
    let folder = Folder::new("robot_none");
    for arguments in [
        &["robot", "check", "l3"][..],
        &["demo", "--robot", "l3"],
        &["plan", "geometry", "--robot", "l3", "-o", "plan.toml"],
    ] {
        let line = folder.run(arguments).failure(1);
        assert!(
            line.contains("l3: No such file") && line.contains("built-in machines are l2 and f1"),
            "{line}"
        );
    }
    let said = folder.run(&["draw"]).stderr;
    assert!(said.contains("--robot <l2|f1|FILE>"), "{said}");
}

/// Scripts of before: the machine without its option, and the other names of outputs.
#[test]
fn earlier_names_of_options_are_still_taken() {
    let folder = Folder::new("robot_old");
    folder.run(&["draw", "l2", "--svg", "l2.svg"]).success();
    folder
        .run(&[
            "workspace",
            "F1",
            "--cells",
            "4",
            "--csv",
            "a.csv",
            "--plot",
            "a.html",
        ])
        .success();
    let plan = ["plan", "geometry", "l2", "--poses", "12", "-o", "p.toml"];
    folder.run(&plan).success();
    folder.run(&[&plan[..], &["--force"]].concat()).success();
    let twice = folder.run(&["draw", "l2", "--robot", "l2"]).failure(2);
    assert!(twice.contains("cannot be used with"), "{twice}");
    for name in ["l2.svg", "a.csv", "a.html", "p.toml"] {
        assert!(folder.path(name).exists(), "{name}");
    }
}

#[test]
fn solve_takes_a_name() {
    let folder = Folder::new("robot_solve");
    folder.write(
        "in",
        "{\"robot\":\"L2\",\"op\":\"ik\",\"T\":[0.0,0.5,0.65]}\n{\"robot\":\"l3\",\"op\":\"ik\"}\n",
    );
    let input = Stdio::from(std::fs::File::open(folder.path("in")).unwrap());
    let said = folder.start_with("solve", &["solve"], input).end();
    let said = said.success();
    assert!(
        said.contains("\"ok\"") && said.contains("0.62449"),
        "{said}"
    );
    assert!(
        said.contains("bad_robot") && said.contains("built-in machines are l2 and f1"),
        "{said}"
    );
}

/// A client with another geometry is not the computer's fault.
#[test]
fn a_client_of_another_machine_is_named_before_the_demo() {
    let folder = Folder::new("robot_client");
    let text = text_of("l2").unwrap();
    folder.write(
        "other.toml",
        &text.replace("L = [1.0, 1.1", "L = [1.0, 1.2"),
    );
    for (client, words) in [
        (
            "other.toml",
            "other.toml: its geometry or metres_per_q is not that of",
        ),
        ("f1", "f1: is not of the machine's kind, \"l2\""),
    ] {
        let ended = folder.run(&["demo", "--client", client]);
        assert!(!ended.stdout.contains("1 kHz"), "{}", ended.stdout);
        let line = ended.failure(1);
        assert!(line.contains(words), "{line}");
    }
}
