//! `serve --plant ethercat:`, run as a user runs it. The program under test is built with the
//! features of these tests: with EtherCAT by `cargo test` of the whole workspace, without it by
//! `cargo test -p gantry-tau`. Each finds what it should.

use std::net::SocketAddr;
use std::process::Stdio;

use gantry_tau_server::links::gauges::GaugeReader;
use gantry_tau_system::dial::NEVER;

use crate::process::{Ended, Folder, address_behind};

/// The program was built with EtherCAT.
const HAS_ETHERCAT: bool = cfg!(all(feature = "ethercat", target_os = "linux"));
const FREE: &str = "127.0.0.1:0";

/// The L2's robot file with another section.
fn robot(section: &str) -> String {
    let robot =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../robots/l2.toml"))
            .unwrap();
    format!("{robot}\n{section}")
}

/// The L2's drives on a bus.
fn bus() -> String {
    let drives = [1_001, 1_002, 1_003].map(|alias| {
        format!(
            "[[ethercat.drives]]\nalias = {alias}\nvendor = 0x0A11\nproduct = 1\ncounts_per_q = 104857600.0\nsign = 1\nzero_counts = 0\n"
        )
    });
    format!(
        "[ethercat]\ncycle_us = 1000\nwatchdog_cycles = 5\n{}",
        drives.concat()
    )
}

fn serve(folder: &Folder, robot: &str, plant: &str) -> Ended {
    folder.run(&[
        "serve", "--robot", robot, "--listen", FREE, "--plant", plant,
    ])
}

/// Writes a robot file whose drives have clocks. Returns the arguments that serve it on the emulated bus.
fn serve_with_clocks(folder: &Folder) -> [&'static str; 7] {
    let section = bus().replace("[ethercat]\n", "[ethercat]\nclocks = \"sync0\"\n");
    folder.write("bus.toml", &robot(&section));
    let [option, plant] = ["--plant", "ethercat:emulated"];
    [
        "serve", "--robot", "bus.toml", "--listen", FREE, option, plant,
    ]
}

/// Without the feature the program says so, for any bus.
fn assert_built_without(ended: Ended) {
    let said = ended.failure(1);
    assert!(
        said.contains("built without EtherCAT") && said.contains("--features ethercat"),
        "{said}"
    );
}

#[test]
fn an_emulated_bus_is_served_and_ends_in_order() {
    let folder = Folder::new("ethercat-emulated");
    folder.write("drives.toml", &robot("[drives]\n"));
    folder.write("bus.toml", &robot(&bus()));
    for file in ["l2", "drives.toml", "bus.toml"] {
        let arguments = [
            "serve",
            "--robot",
            file,
            "--listen",
            FREE,
            "--pace",
            "lockstep",
            "--plant",
            "ethercat:emulated",
        ];
        let mut server = folder.start_with("serve", &arguments, Stdio::piped());
        if !HAS_ETHERCAT {
            assert_built_without(server.end());
            continue;
        }
        server.await_words("Ctrl-C");
        let said = server.stdout();
        let listen = address_behind(&said, "listening on ");
        let mut client = folder.start("client", &["client", &listen, "--robot", file]);
        server.await_words("Submit -> Obtain");
        server.write("quit\n");
        let ended = server.end();
        assert_eq!(
            ended.stderr.contains("drives.toml: drives: not used"),
            file == "drives.toml",
            "{}",
            ended.stderr
        );
        assert!(!ended.stderr.contains("EtherCAT: "), "{}", ended.stderr);
        assert!(ended.success().contains("all offsets are zero; ended"));
        client.await_that("the client's end", |client| {
            client.stderr().contains("ended") || client.stdout().contains("ended")
        });
    }
}

#[test]
fn gauges_beside_the_drives_are_published_and_named_in_the_log() {
    if !HAS_ETHERCAT {
        return;
    }
    let folder = Folder::new("ethercat-gauges");
    let gauge = "[[ethercat.gauges]]\nname = \"gauge_x\"\nposition = 3\nproduct = 0x13ED3052\num_per_count = 0.5\n";
    folder.write("bus.toml", &robot(&format!("{}{gauge}", bus())));
    let serve = ["serve", "--robot", "bus.toml", "--listen", FREE];
    let options = ["--gauges", FREE, "--plant", "ethercat:emulated"];
    let mut server = folder.start_with("serve", &[&serve[..], &options].concat(), Stdio::piped());
    server.await_words("Ctrl-C");
    let address = address_behind(&server.stdout(), "gauges of bus.toml on ");
    let address: SocketAddr = address.parse().unwrap();
    let mut reader = GaugeReader::connect(address, &NEVER).unwrap();
    server.await_that("the length of the gauge, which stands", |_| {
        let latest = reader.latest().unwrap();
        latest.is_some_and(|lengths| lengths.lengths_m() == [0.0])
    });
    server.await_words("EtherCAT: gauge_x: counts");
    server.write("quit\n");
    assert!(
        server
            .end()
            .success()
            .contains("all offsets are zero; ended")
    );
}

#[test]
fn a_bus_that_is_not_there_is_an_error() {
    let folder = Folder::new("ethercat-missing");
    folder.write("bus.toml", &robot(&bus()));
    let ended = [
        serve(&folder, "l2", "ethercat:nosuch"),
        serve(&folder, "bus.toml", "ethercat:nosuch"),
    ];
    if !HAS_ETHERCAT {
        ended.into_iter().for_each(assert_built_without);
        return;
    }
    let [no_section, no_interface] = ended.map(|ended| ended.failure(1));
    let expected = "gantry-tau: robots/l2.toml (built in): ethercat: is missing; list the drive of each motor in [[ethercat.drives]]";
    assert_eq!(no_section, expected);
    // Who may not open raw sockets gets that reason first.
    let reasons = [
        "there is no network interface nosuch; `ip link` lists them",
        "raw sockets are not permitted",
    ];
    assert!(
        reasons.iter().any(|reason| no_interface.contains(reason)),
        "{no_interface}"
    );
}

#[test]
fn another_word_is_refused_with_the_choices() {
    let folder = Folder::new("ethercat-word");
    for plant in ["ethercat:", "ethercat", "simulation"] {
        let said = serve(&folder, "l2", plant).failure(2);
        assert!(
            said.contains(
                "expected simulated, socket:HOST:PORT, ethercat:emulated, or ethercat: with the name"
            ),
            "{said}"
        );
    }
    folder.write(
        "bus.toml",
        &robot(&bus().replace("watchdog_cycles = 5", "watchdog_cycles = 100")),
    );
    let said = serve(&folder, "bus.toml", "ethercat:emulated").failure(1);
    assert!(
        said.starts_with(
            "gantry-tau: bus.toml: ethercat.watchdog_cycles: is 100; expected from 1 to 10"
        ),
        "{said}"
    );
}

/// Keys of the distributed clocks that cannot be, and a pace that cannot follow them.
#[test]
fn clocks_that_cannot_be_are_refused_by_their_keys() {
    let folder = Folder::new("ethercat-clocks");
    let reasons = [
        ("clocks = \"dc\"", "ethercat.clocks: "),
        (
            "sync0_us = 0",
            "ethercat.sync0_us: is 0; expected a multiple of 62.5 that divides the cycle of 1000 us",
        ),
        ("sync0_us = 300", "ethercat.sync0_us: is 300; "),
        ("sync0_us = 2000", "ethercat.sync0_us: is 2000; "),
        ("sync0_us = nan", "ethercat.sync0_us: is NaN; "),
        (
            "frame_to_sync0_us = 199",
            "ethercat.frame_to_sync0_us: is 199; expected from 200 to 800",
        ),
        (
            "frame_to_sync0_us = 801",
            "ethercat.frame_to_sync0_us: is 801; ",
        ),
    ];
    for (key, reason) in reasons {
        let section = bus().replace("[ethercat]\n", &format!("[ethercat]\n{key}\n"));
        folder.write("bus.toml", &robot(&section));
        let ended = folder.run(&["robot", "check", "bus.toml"]);
        assert_eq!(ended.code, Some(1), "{key}");
        assert!(ended.stderr.contains(reason), "{key}: {}", ended.stderr);
    }
    let lockstep = [&serve_with_clocks(&folder)[..], &["--pace", "lockstep"]].concat();
    let ended = folder.run(&lockstep);
    if !HAS_ETHERCAT {
        return assert_built_without(ended);
    }
    assert_eq!(
        ended.failure(1),
        "gantry-tau: bus.toml: ethercat.clocks: a cycle in lock-step (--pace lockstep) cannot follow SYNC0; expected \"free\""
    );
}

/// By the clock of this computer, the cycle is steered to that of the emulated bus.
#[test]
fn an_emulated_bus_with_clocks_is_served_in_phase() {
    if !HAS_ETHERCAT {
        return;
    }
    let folder = Folder::new("ethercat-sync0");
    let mut server = folder.start_with("serve", &serve_with_clocks(&folder), Stdio::piped());
    server.await_words("EtherCAT: the cycle is in phase with SYNC0");
    server.write("quit\n");
    assert!(server.end().success().contains("ended"));
}
