//! A bus has one owner: a second server on the same interface ends before its first frame.

use std::cell::Cell;
use std::fmt::Write as _;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use gantry_tau::ethercat::{EthercatPlant, emulated_bus};
use gantry_tau_ethercat::{RawSocket, RawSocketError};
use gantry_tau_machine::robot_file::{Ethercat, RobotFile};
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_tests::short_demo;

use super::{ENDS, FarEnd, NearEnd, connect, succeeds};
use crate::firmware::program;

/// The L2's robot file with the drives of the emulated bus.
fn robot_file(section: &Ethercat) -> String {
    let mut text = include_str!("../../../../robots/l2.toml").to_owned();
    let (cycle_us, watchdog_cycles) = (section.cycle_us, section.watchdog_cycles);
    write!(
        text,
        "\n[ethercat]\ncycle_us = {cycle_us}\nwatchdog_cycles = {watchdog_cycles}\n"
    )
    .unwrap();
    for drive in &section.drives {
        let (place, vendor, product) = (drive.alias.unwrap(), drive.vendor, drive.product);
        write!(
            text,
            "[[ethercat.drives]]\nalias = {place}\nvendor = {vendor}\nproduct = {product}\n"
        )
        .unwrap();
        write!(
            text,
            "counts_per_q = {:?}\nsign = {}\nzero_counts = 0\n",
            drive.counts_per_q, drive.sign
        )
        .unwrap();
    }
    text
}

/// Runs a second server, which ends; returns its exit code and its errors.
fn serve(program: &Path, folder: &Path, prefix: &[&str], name: &str) -> (Option<i32>, String) {
    let words = [
        prefix,
        &[
            program.to_str().unwrap(),
            "serve",
            "--name",
            name,
            "--robot",
            "bus.toml",
        ],
    ]
    .concat();
    let mut command = Command::new(words[0]);
    command.args(&words[1..]).args(["--listen", "127.0.0.1:0"]);
    let plant = format!("ethercat:{}", ENDS[0]);
    let output = command
        .args(["--plant", &plant])
        .env("STATE_DIRECTORY", folder)
        .env("HOME", folder)
        .current_dir(folder)
        .output();
    let output = output.unwrap();
    (
        output.status.code(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

/// Found by trial: the same command typed twice took all drives of the running machine to INIT, in
/// motion.
pub(super) fn second_server() {
    let program = program::build();
    connect();
    let folder = tempfile::tempdir().unwrap();
    std::fs::set_permissions(folder.path(), std::fs::Permissions::from_mode(0o777)).unwrap();
    // Another login, which may open raw sockets.
    let other_login = [
        "setpriv",
        "--reuid=65534",
        "--clear-groups",
        "--inh-caps=+net_raw",
        "--ambient-caps=+net_raw",
    ];
    let has_login = succeeds(
        Command::new(other_login[0])
            .args(&other_login[1..])
            .arg("true"),
    );
    let seconds = Cell::new(0);
    let robot = RobotFile::builtin_l2().unwrap();
    let complaints = short_demo::complaints(
        folder.path(),
        robot,
        |robot, tool| {
            let section = Ethercat::emulated(&robot.motors.axis_of_motor, &robot.metres_per_q);
            std::fs::write(folder.path().join("bus.toml"), robot_file(&section)).unwrap();
            let bus = emulated_bus::<_, 3, 3>(robot, &section, tool)?;
            let far = FarEnd::start(bus.clone(), None);
            let near = NearEnd {
                socket: RawSocket::open(ENDS[0]).unwrap(),
                bus,
                _far: far,
            };
            let plant = EthercatPlant::<_, 3, 3>::open(robot, &section, near, |_| Motion::Hold);
            // The drives are in SAFE-OP, and the demo begins when the second servers have ended.
            let prefixes = [&[][..], &other_login];
            for (name, prefix) in ["other-ports", "other-login"].into_iter().zip(prefixes) {
                if prefix.is_empty() || has_login {
                    let (code, said) = serve(&program, folder.path(), prefix, name);
                    let owner = format!(
                        "network interface {} is in use by pid {}; ",
                        ENDS[0],
                        std::process::id()
                    );
                    assert_eq!(code, Some(1), "{said}");
                    assert!(said.lines().last().unwrap().contains(&owner), "{said}");
                    seconds.set(seconds.get() + 1);
                }
            }
            let expected = RawSocketError::Owned {
                interface: ENDS[0].to_owned(),
                owner: format!("pid {}", std::process::id()),
            };
            assert_eq!(RawSocket::open(ENDS[0]).err(), Some(expected));
            plant
        },
        |cycle, _| Ok(cycle),
    );
    assert_eq!(complaints, Vec::<String>::new());
    assert!(seconds.get() > 0);
    // It is free again. Nothing answers now.
    let (code, said) = serve(&program, folder.path(), &[], "other-ports");
    assert!(
        code == Some(1) && said.contains("bus.toml: ethercat: "),
        "{said}"
    );
}
