//! `serve --masses` and `client`: a machine with mass, with the filter of its file and with one that
//! is too fast for it.

use gantry_tau_machine::robot_file::text_of;

use crate::process::{Folder, Running};
use crate::signals::{assert_no_jump, rows, serve_pulling};

/// The L2 with a tool of 5 kg and a fast filter of first order: it grows by some 10/s in free air.
fn fast(folder: &Folder, name: &str, changes: &[(&str, &str)]) {
    let mut text = text_of("l2").unwrap();
    let of_all = [
        (
            "weight_n = [0.0, 0.0, -18.0]",
            "weight_n = [0.0, 0.0, -49.03]",
        ),
        (
            "cutoff_hz = 6.0",
            "filter = \"first_order\"\ncutoff_hz = 20.0",
        ),
    ];
    for (from, to) in of_all.iter().chain(changes) {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        text = text.replace(from, to);
    }
    folder.write(name, &text);
}

const NO_BUDGET: (&str, &str) = ("agitation_um_per_s = [100, 100, 100]\n", "");
const NO_DETECTOR: (&str, &str) = ("gain = 1.0", "gain = 1.0\nleave_on_oscillation = false");

/// Starts a server and a client of a robot file, in lock-step.
fn start(folder: &Folder, robot: &str, served: &[&str], option: &[&str]) -> [Running; 2] {
    let served = [&["--robot", robot, "--record", "serve.csv"], served].concat();
    let (server, [address, sensor]) = serve_pulling(folder, ["60", "1"], &served);
    let arguments = ["client", &address, "--sensor", &sensor, "--robot", robot];
    let client = folder.start("client", &[&arguments[..], option].concat());
    [server, client]
}

/// Returns what a client says that runs for six steps of the load and is stopped.
fn stopped(folder: &Folder, robot: &str, served: &[&str], option: &[&str]) -> String {
    let [server, mut client] = start(folder, robot, served, option);
    let record = folder.path("serve.csv");
    // A row has at most 1000 bytes.
    client.await_that("rows", |_| record.metadata().unwrap().len() > 6_000_000);
    let ended = client.stop();
    server.stop().success();
    ended.success()
}

#[test]
fn the_filter_of_the_file_compensates_a_machine_with_masses() {
    let folder = Folder::new("masses");
    for robot in ["l2", "f1"] {
        let said = stopped(&folder, robot, &["--masses"], &[]);
        assert!(said.contains("left with Goodbye after "), "{said}");
        assert!(!said.contains("oscillat"), "{said}");
    }
}

#[test]
fn a_filter_that_is_too_fast_is_refused() {
    let folder = Folder::new("masses-refused");
    fast(&folder, "fast.toml", &[]);
    // Before a server is asked for.
    let said = folder
        .run(&["client", "127.0.0.1:1", "--robot", "fast.toml"])
        .failure(1);
    assert!(
        said.contains("fast.toml: the compensation may swing"),
        "{said}"
    );
}

/// Accepted all the same, it swings: the client leaves by itself. Without masses in the simulation
/// the same client sees nothing.
#[test]
fn an_unstable_client_leaves_by_itself() {
    let folder = Folder::new("masses-detector");
    fast(&folder, "fast.toml", &[NO_BUDGET]);
    let accepted = &["--accept-unstable"];
    let said = stopped(&folder, "fast.toml", &["--masses"], accepted);
    let left = "left Obtain because of oscillations: 1";
    assert!(said.contains(left), "{said}");
    assert_no_jump(&rows(&folder));
    let said = stopped(&folder, "fast.toml", &[], accepted);
    assert!(!said.contains("oscillat"), "{said}");
}

/// A client that does not leave is ended by the server's budget.
#[test]
fn a_client_that_shakes_the_machine_is_ended_by_the_server() {
    let folder = Folder::new("masses-budget");
    fast(&folder, "fast.toml", &[NO_DETECTOR]);
    let option = &["--accept-unstable"];
    let [mut server, client] = start(&folder, "fast.toml", &["--masses"], option);
    let said = client.end().failure(6);
    assert!(
        said.contains("shaken by more than its agitation budget"),
        "{said}"
    );
    server.await_words("SafeDisconnect -> Listening");
    server.stop().success();
    assert_no_jump(&rows(&folder));
}

#[test]
fn a_file_without_masses_is_refused() {
    let folder = Folder::new("masses-none");
    let text = text_of("l2").unwrap();
    let (before, rest) = text.split_once("[masses]").unwrap();
    let (_, after) = rest.split_once("\n[simulation]").unwrap();
    folder.write("massless.toml", &format!("{before}\n[simulation]{after}"));
    let arguments = [
        "serve",
        "--masses",
        "--robot",
        "massless.toml",
        "--first-run",
    ];
    let said = folder.run(&arguments).failure(1);
    assert!(said.contains("massless.toml: masses: is missing"), "{said}");
}
