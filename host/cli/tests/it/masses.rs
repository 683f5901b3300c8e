//! `serve` and `client`: a machine with mass, with the filter of its file and with one that
//! is too fast for it.

use gantry_tau_machine::robot_file::text_of;

use crate::process::{Ended, Folder, Running, address_behind};
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
    let (server, address) = serve_pulling(folder, ["60", "1"], &served);
    let arguments = ["client", &address, "--robot", robot];
    let client = folder.start("client", &[&arguments[..], option].concat());
    [server, client]
}

/// Returns what a client says that runs for six steps of the load and is stopped.
fn stopped(folder: &Folder, robot: &str, served: &[&str], option: &[&str]) -> String {
    let [server, client] = start(folder, robot, served, option);
    let ended = after_six_seconds(folder, client);
    server.stop().success();
    ended.success()
}

/// Stops a client after about six seconds of Obtain, by the recording of the server.
fn after_six_seconds(folder: &Folder, mut client: Running) -> Ended {
    client.await_words("tared; obtaining");
    let record = folder.path("serve.csv");
    let length = || record.metadata().map_or(0, |file| file.len());
    let began = length();
    // A row has some 300 bytes.
    client.await_that("rows", |_| length() > began + 2_000_000);
    client.stop()
}

#[test]
fn the_filter_of_the_file_compensates_a_machine_with_masses() {
    for robot in ["l2", "f1"] {
        let folder = Folder::new(&format!("masses-{robot}"));
        let said = stopped(&folder, robot, &[], &[]);
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
    let said = stopped(&folder, "fast.toml", &[], accepted);
    let left = "left Obtain because of oscillations: 1";
    assert!(said.contains(left), "{said}");
    assert_no_jump(&rows(&folder));
    let folder = Folder::new("masses-quasi-static");
    fast(&folder, "fast.toml", &[NO_BUDGET]);
    let said = stopped(&folder, "fast.toml", &["--quasi-static"], accepted);
    assert!(!said.contains("oscillat"), "{said}");
}

/// The L2 with an accelerometer of three axes at the centre of its tool, and a faster filter.
pub(crate) fn with_accelerometer(folder: &Folder) {
    let mut text = text_of("l2").unwrap();
    let section = "\n[sensor.accelerometer]\nplace_m = [0.01, 0.0, -0.12]\naxes = 3\n";
    for (from, to) in [
        ("cutoff_hz = 6.0", "cutoff_hz = 10.0"),
        ("\n[sensor.tool]\n", &format!("{section}\n[sensor.tool]\n")),
    ] {
        assert_eq!(text.matches(from).count(), 1, "{from}");
        text = text.replace(from, to);
    }
    folder.write("felt.toml", &text);
}

#[test]
fn an_accelerometer_of_the_file_has_a_link_that_the_client_needs() {
    let folder = Folder::new("masses-accelerometer");
    with_accelerometer(&folder);
    let said = folder.run(&["robot", "check", "felt.toml"]).success();
    let line =
        "accelerometer         10.0, 0.0, -120.0 mm from the tool centre point, 3 axes; takes 90 %";
    assert!(said.contains(line), "{said}");
    let robot = ["--robot", "felt.toml", "--record", "serve.csv"];
    let served = [&robot[..], &["--accelerometer", "127.0.0.1:0"]].concat();
    let (server, address) = serve_pulling(&folder, ["60", "1"], &served);
    let link = address_behind(&server.stdout(), "accelerometer on ");
    let arguments = ["client", &address, "--robot", "felt.toml"];
    let there = [&arguments[..], &["--accelerometer", &link]].concat();
    let ended = after_six_seconds(&folder, folder.start("client", &there));
    let said = ended.success();
    assert!(
        said.contains("(0 without a correction of their own"),
        "{said}"
    );
    assert!(!said.contains("oscillat"), "{said}");
    let elsewhere = [&arguments[..], &["--accelerometer", "127.0.0.1:1"]].concat();
    let said = folder.run(&elsewhere).failure(3);
    assert!(
        said.contains("the accelerometer at 127.0.0.1:1 cannot be reached"),
        "{said}"
    );
    server.stop().success();
    assert_no_jump(&rows(&folder));
}

/// A client that does not leave is ended by the server's budget.
#[test]
fn a_client_that_shakes_the_machine_is_ended_by_the_server() {
    let folder = Folder::new("masses-budget");
    fast(&folder, "fast.toml", &[NO_DETECTOR]);
    let option = &["--accept-unstable"];
    let [mut server, client] = start(&folder, "fast.toml", &[], option);
    let said = client.end().failure(6);
    assert!(
        said.contains("shaken by more than its agitation budget"),
        "{said}"
    );
    server.await_words("SafeDisconnect -> Listening");
    server.stop().success();
    assert_no_jump(&rows(&folder));
}

/// Text of a built-in file without its masses.
pub(crate) fn massless(robot: &str) -> String {
    let text = text_of(robot).unwrap();
    let (before, rest) = text.split_once("[masses]").unwrap();
    let (_, after) = rest.split_once("\n[simulation]").unwrap();
    format!("{before}\n[simulation]{after}")
}

#[test]
fn a_file_without_masses_is_in_equilibrium_and_says_so() {
    let folder = Folder::new("masses-none");
    folder.write("massless.toml", &massless("l2"));
    let [mut server, mut client] = start(&folder, "massless.toml", &[], &[]);
    server.await_words("no masses: the platform is in equilibrium in every cycle");
    client.await_words("tared; obtaining");
    client.stop().success();
    server.stop().success();
}

/// A tap and a cutter act while a client is in Obtain, and what no cutter has is refused.
#[test]
fn taps_and_cutters_load_the_tool() {
    for (option, least_n) in [("--tap=200,20", 150.0), ("--milling=100,4,3000,0.5", 80.0)] {
        let folder = Folder::new("masses-load");
        let served = ["--listen", "127.0.0.1:0"];
        let arguments = [
            "serve",
            "--pace",
            "lockstep",
            "--record",
            "serve.csv",
            option,
        ];
        let mut server = folder.start("serve", &[&arguments[..], &served].concat());
        server.await_words("Ctrl-C");
        let said = server.stdout();
        let address = address_behind(&said, "listening on ");
        let client = folder.start("client", &["client", &address]);
        after_six_seconds(&folder, client).success();
        server.stop().success();
        let table = folder.read("serve.csv");
        let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
        let of = |name: &str| header.iter().position(|column| *column == name).unwrap();
        let (phase, force) = (of("state"), of("force_x_n"));
        let mut largest_n: f64 = 0.0;
        for line in table.lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            let force_n: f64 = cells[force].parse().unwrap();
            if cells[phase] == "Submit" {
                assert!(force_n.abs() < 1e-9, "{line}");
            }
            largest_n = largest_n.max(force_n.abs());
        }
        assert!(largest_n > least_n, "{option}: {largest_n} N");
    }
    let folder = Folder::new("masses-load-refused");
    for (option, reason) in [
        ("--tap=1e9,20", "the force must be from -2000 to 2000 N"),
        ("--tap=100", "expected N,MS"),
        ("--milling=300,0", "number of teeth must be from"),
        ("--milling=nan", "mean force must be from"),
        ("--milling=300,4,3000,0.5,1", "at most four numbers"),
    ] {
        let said = folder.run(&["serve", option]).failure(2);
        assert!(said.contains(reason), "{said}");
    }
}
