//! `experiment` on the simulated machine, and over loopback with `serve --plan`, ended by a signal
//! and taken up again.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::process::{Ended, Folder, Running, address_behind};

/// A plan of the L2: one strap, gauges on platform and carts.
pub(crate) const PLAN: &str = r#"format = "gantry-tau springs 1"
model = "l2"
measurements = "springs.csv"
[noise]
gauge_um = 1.0
force_n = 1.0
moment_nm = 0.05
[[pose]]
name = "home"
T = [0.0, 0.5, 0.65]
[[gauge]]
name = "px"
on = "platform"
point_m = [0.14, 0.0, 0.05]
axis = [1.0, 0.0, 0.0]
[[gauge]]
name = "axis1"
on = "axis"
axis_number = 1
[[series]]
name = "x"
pose = "home"
mounting = "strap along x"
hook_m = [0.0, 0.0, -0.08]
direction = [1.0, 0.0, 0.0]
levels_n = [0.0, 60.0, 0.0]
gauges = ["px", "axis1"]
"#;

fn simulated(folder: &Folder, seed: &str, output: &str) -> Ended {
    folder.run(&["experiment", "plan.toml", "--simulated", seed, "-o", output])
}

#[test]
fn a_seed_gives_the_same_table_and_a_table_is_not_overwritten() {
    let folder = Folder::new("experiment-simulated");
    folder.write("plan.toml", PLAN);
    for (seed, output) in [("1", "springs.csv"), ("1", "again.csv"), ("2", "other.csv")] {
        simulated(&folder, seed, output).success();
    }
    assert_eq!(folder.read("springs.csv"), folder.read("again.csv"));
    assert_ne!(folder.read("springs.csv"), folder.read("other.csv"));
    assert_eq!(folder.read("springs.csv").lines().count(), 4);
    let refused = simulated(&folder, "1", "springs.csv").failure(1);
    assert_eq!(
        refused,
        "gantry-tau: springs.csv has rows; remove it, or name another file"
    );
    assert_eq!(folder.read("springs.csv"), folder.read("again.csv"));
}

#[test]
fn the_thesis_evaluation_is_a_page_beside_the_table() {
    let folder = Folder::new("experiment-thesis");
    folder.write("plan.toml", PLAN);
    let measured = [
        "experiment",
        "plan.toml",
        "--simulated",
        "1",
        "-o",
        "springs.csv",
        "--thesis",
        "thesis.html",
    ];
    let said = folder.run(&measured).success();
    assert!(
        said.contains("thesis.html: the thesis' evaluation"),
        "{said}"
    );
    let page = folder.read("thesis.html");
    // The one cart that has a gauge; three directions of gauges are wanting for links.
    assert!(
        page.contains("[T Table 5.1]")
            && page.contains("[T Table 5.2, used]")
            && page.contains("series x")
    );
    assert!(page.contains("No series has three gauges on the platform") && !page.contains("NaN"));
    folder
        .run(&["plan", "geometry", "--robot", "l2", "-o", "places.toml"])
        .success();
    let places = [
        "experiment",
        "places.toml",
        "--simulated",
        "-o",
        "other.csv",
        "--thesis",
        "thesis.html",
    ];
    assert_eq!(
        folder.run(&places).failure(1),
        "gantry-tau: --thesis is for springs; leave it out"
    );
    assert!(!folder.path("other.csv").exists());
}

/// The line of a table of ticks that is refused.
fn identify_ticks(folder: &Folder) -> String {
    let arguments = [
        "identify",
        "--raw",
        "raw.csv",
        "plan.toml",
        "--robot",
        "l2",
        "-o",
        "x.toml",
    ];
    let line = folder.run(&arguments).failure(1);
    assert!(!folder.path("x.toml").exists());
    line
}

#[test]
fn a_table_of_ticks_that_cannot_be_is_one_line() {
    let folder = Folder::new("identify-raw");
    folder.write("plan.toml", PLAN);
    assert!(identify_ticks(&folder).starts_with("gantry-tau: raw.csv: No such file"));
    // The table of windows is not one of ticks.
    folder
        .run(&[
            "experiment",
            "plan.toml",
            "--simulated",
            "1",
            "-o",
            "raw.csv",
        ])
        .success();
    assert_eq!(
        identify_ticks(&folder),
        "gantry-tau: raw.csv:1: force_x_n: this column is unknown"
    );
    folder.write("raw.csv", "tick,state,cause\n");
    assert_eq!(
        identify_ticks(&folder),
        "gantry-tau: raw.csv:1: missed: this column is missing"
    );
}

#[test]
fn a_plan_that_cannot_be_is_one_line() {
    let folder = Folder::new("experiment-plans");
    let cases = [
        (
            "levels_n = [0.0, 60.0",
            "levels_n = [20.0, 60.0",
            "series.x.levels_n: must begin with 0",
        ),
        (
            "60.0, 0.0]",
            "nan, 0.0]",
            "series.x.levels_n: NaN is not from 0 to 1e5",
        ),
        (
            "direction = [1.0, 0.0",
            "direction = [1.0, 0.5",
            "series.x.direction: has length",
        ),
        (
            "direction = [1.0, 0.0",
            "direction = [nan, 0.0",
            "series.x.direction: has length NaN, not 1",
        ),
        (
            "pose = \"home\"",
            "pose = \"away\"",
            "series.x.pose: \"away\" is not in the set-up",
        ),
        (
            "[\"px\", \"axis1\"]",
            "[\"py\"]",
            "series.x.gauges: \"py\" is not in the set-up",
        ),
        ("T = [0.0, 0.5", "T = [9.0, 0.5", "pose home:"),
        ("mounting =", "mountings =", "unknown field"),
        (
            "model = \"l2\"",
            "model = \"f1\"",
            "the robot file's is \"l2\"",
        ),
    ];
    for (from, to, reason) in cases {
        assert!(PLAN.contains(from), "{from}");
        folder.write("plan.toml", &PLAN.replace(from, to));
        let said = folder
            .run(&["experiment", "plan.toml", "--simulated", "-o", "x.csv"])
            .failure(1);
        assert!(said.contains(reason), "{said}");
    }
    folder.write("plan.toml", PLAN.split_once("[[series]]").unwrap().0);
    let said = folder
        .run(&["experiment", "plan.toml", "--simulated", "-o", "x.csv"])
        .failure(1);
    assert_eq!(
        said,
        "gantry-tau: plan.toml: series: is missing: a plan has [[series]]"
    );
    // What is not a table is left alone.
    folder.write("plan.toml", PLAN);
    let said = folder
        .run(&["experiment", "plan.toml", "--simulated", "-o", "plan.toml"])
        .failure(1);
    assert!(
        said.starts_with("gantry-tau: cannot write plan.toml: "),
        "{said}"
    );
    assert_eq!(folder.read("plan.toml"), PLAN);
}

/// Starts the simulated machine of the plan; also returns the addresses of gauges and server.
pub(crate) fn serve(folder: &Folder) -> (Running, [String; 2]) {
    let free = "127.0.0.1:0";
    let mut server = folder.start(
        "serve",
        &[
            "serve",
            "--plan",
            "plan.toml",
            "--pace",
            "lockstep",
            "--listen",
            free,
            "--gauges",
            free,
        ],
    );
    server.await_words("Ctrl-C");
    let said = server.stdout();
    let addresses = ["plan.toml on ", "listening on "].map(|words| address_behind(&said, words));
    (server, addresses)
}

#[test]
fn a_signal_leaves_and_the_table_is_continued() {
    let folder = Folder::new("experiment-live");
    folder.write("plan.toml", PLAN);
    let (mut server, addresses) = serve(&folder);
    let [gauges, listen] = &addresses;
    let arguments = [
        "experiment",
        "plan.toml",
        "--server",
        listen,
        "--gauges",
        gauges,
        "--unattended",
        "-o",
        "springs.csv",
    ];
    let mut first = folder.start("first", &arguments);
    first.await_that("a window", |first| first.stderr().contains(": taken"));
    let Ended { code, stdout, .. } = first.stop();
    let before = folder.read("springs.csv");
    // It may have been faster than the signal.
    let rows = before.lines().count() - 1;
    assert_eq!(code, Some(if rows == 3 { 0 } else { 3 }), "{stdout}");
    assert!((1..=3).contains(&rows), "{before}");
    let second = folder.start("second", &arguments).end();
    second.success();
    let after = folder.read("springs.csv");
    assert!(after.starts_with(&before), "{before}{after}");
    assert_eq!(after.lines().count(), 4);
    server.await_words("the client said goodbye");
    server.stop().success();
}

/// Position of axis 2 in a window.
fn q_2(table: &str, series: &str, window: &str) -> f64 {
    let row = table
        .lines()
        .find(|line| line.starts_with(series) && line.split(',').nth(3) == Some(window));
    row.unwrap().split(',').nth(6).unwrap().parse().unwrap()
}

/// Off and on of one strap, as `plan verify` writes them: the session ends between the two, and
/// what was measured is a pair.
#[test]
fn series_with_compensation_are_measured_in_obtain() {
    let folder = Folder::new("experiment-compensated");
    let (before, series) = PLAN.split_once("[[series]]").unwrap();
    let [off, on] = ["\"x off\"", "\"x on\""].map(|name| series.replace("\"x\"", name));
    folder.write(
        "plan.toml",
        &format!("{before}[[series]]{off}[[series]]{on}compensated = true\n"),
    );
    let (server, [gauges, listen]) = serve(&folder);
    let addresses = ["--server", &listen, "--gauges", &gauges];
    let arguments = [
        "experiment",
        "plan.toml",
        "--unattended",
        "-o",
        "springs.csv",
    ];
    folder
        .run(&[arguments.as_slice(), &addresses].concat())
        .success();
    server.stop().success();
    let table = folder.read("springs.csv");
    assert_eq!(table.lines().count(), 7, "{table}");
    // `solve` says that 60 N in x at this hook ask for an offset of -78 um of axis 2; the springs,
    // 3 % off, do not matter to it.
    let [off, on] =
        ["x off", "x on"].map(|series| q_2(&table, series, "2") - q_2(&table, series, "1"));
    assert!(off.abs() < 1e-9, "{table}");
    assert!((on + 78e-6).abs() < 2e-6, "{table}");
    let said = folder
        .run(&["verify", "plan.toml", "--robot", "l2"])
        .success();
    assert!(said.contains("pairs               1,"), "{said}");
}

/// Gauges that are gone end the session, with a Goodbye and not with a connection that breaks; the
/// campaign waits for them.
#[test]
fn gauges_that_are_gone_are_reported_and_the_server_hears_a_goodbye() {
    let folder = Folder::new("experiment-gauges-gone");
    let levels = format!("levels_n = [{}0.0]", "0.0, 60.0, ".repeat(40));
    folder.write(
        "plan.toml",
        &PLAN.replacen("levels_n = [0.0, 60.0, 0.0]", &levels, 1),
    );
    let (mut server, [gauges, listen]) = serve(&folder);
    let relay = TcpListener::bind("127.0.0.1:0").unwrap();
    let relayed = relay.local_addr().unwrap().to_string();
    let addresses = ["--server", &listen, "--gauges", &relayed];
    let arguments = [
        "experiment",
        "plan.toml",
        "--unattended",
        "-o",
        "springs.csv",
    ];
    let mut experiment = folder.start("experiment", &[arguments.as_slice(), &addresses].concat());
    let (mut to, _) = relay.accept().unwrap();
    // Another connection would be refused.
    drop(relay);
    let mut from = TcpStream::connect(gauges).unwrap();
    let is_cut = Arc::new(AtomicBool::new(false));
    let cut = Arc::clone(&is_cut);
    let copy = std::thread::spawn(move || {
        let mut bytes = [0; 4_096];
        while !is_cut.load(Ordering::Relaxed) {
            let count = from.read(&mut bytes).unwrap();
            to.write_all(&bytes[..count]).unwrap();
        }
    });
    server.await_words("Handshake -> Submit");
    cut.store(true, Ordering::Relaxed);
    copy.join().unwrap();
    experiment.await_words("; the campaign pauses until the session can be taken up again");
    server.await_words("the client said goodbye");
    let ended = experiment.stop();
    assert_eq!(ended.code, Some(3), "{}", ended.stderr);
    assert!(
        ended.stderr.contains("WARN no gauges: "),
        "{}",
        ended.stderr
    );
    server.stop().success();
}

#[test]
fn an_absent_server_is_one_line() {
    let folder = Folder::new("experiment-absent");
    folder.write("plan.toml", PLAN);
    let absent = "127.0.0.1:9";
    let arguments = [
        "experiment",
        "plan.toml",
        "--server",
        absent,
        "--gauges",
        absent,
        "-o",
        "x.csv",
    ];
    let said = folder.run(&arguments).failure(3);
    assert!(
        said.starts_with("gantry-tau: the gauges at 127.0.0.1:9 cannot be reached"),
        "{said}"
    );
}
