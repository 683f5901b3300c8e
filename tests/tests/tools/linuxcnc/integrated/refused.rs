//! Configurations that do not fit.

use super::super::run::{Machine, make};
use super::session::Session;
use super::variant;
use crate::capi::tools::target;

/// A configuration that LinuxCNC does not load, and the one line that says why.
fn refuses(test: &str, change: impl Fn(&Machine), why: &str) {
    let machine = Machine::obeying("l2", test, "").unwrap();
    change(&machine);
    let session = Session::start(&machine);
    let is_ready = session.is_ready;
    let said = session.close();
    assert!(!is_ready, "{said}");
    let lines: Vec<&str> = said
        .lines()
        .filter(|line| line.starts_with("gantry_tau: ") && !line.contains("rtapi_app_main"))
        .collect();
    assert_eq!(lines.len(), 1, "{said}");
    assert!(lines[0].contains(why), "{said}");
}

fn build_for_another_machine(machine: &Machine) {
    let robot = variant(
        machine,
        "other.toml",
        "\nL = [1.0, 1.1, 1.0]",
        "\nL = [1.0, 1.1, 1.001]",
    );
    let build = target().join("linuxcnc-other");
    make(&robot, &build, |header| header).unwrap();
    machine.module(&build.join("gantry_tau.so")).unwrap();
}

pub(super) fn misfits() {
    refuses(
        "joints",
        |machine| machine.edit("JOINTS = 3", "JOINTS = 6").unwrap(),
        "JOINTS = 6, but the modules are built for a machine with 3 joints",
    );
    refuses(
        "travel",
        |machine| {
            machine
                .edit("MIN_LIMIT = -2000", "MIN_LIMIT = -2001")
                .unwrap()
        },
        "[JOINT_1]MIN_LIMIT = -2001, beyond the nominal travel of the robot file, -2000",
    );
    refuses(
        "port",
        |machine| {
            machine
                .edit("file=epochs", "file=epochs port=70000")
                .unwrap()
        },
        "port=70000 is not a port, 1 to 65535",
    );
    refuses(
        "checksum",
        build_for_another_machine,
        "gantrytaukins and gantry_tau are built for different machines",
    );
    not_connected();
}

/// LinuxCNC loads, says what is missing, does not switch on, and publishes no force.
fn not_connected() {
    let machine = Machine::obeying("l2", "wires", "lockstep=1").unwrap();
    machine
        .edit_drives("=> gantry-tau.enable flipflop", "=> flipflop")
        .unwrap();
    machine.edit_drives("{$i < 6}", "{$i < 5}").unwrap();
    let mut session = Session::begin(&machine);
    session.wait("p('gantry-tau.tick') > 10");
    session.ask("try run.command.state(linuxcnc.STATE_ESTOP_RESET)");
    session.wait("s.task_state != linuxcnc.STATE_ESTOP");
    let shown = session.ask("errors");
    session.ask("try run.command.state(linuxcnc.STATE_ON)");
    session.ask("try time.sleep(0.3)");
    let errors = session.ask("errors");
    assert!(errors.contains("enable input is false"), "{errors}");
    assert_eq!(
        session.ask("pins gantry-tau.permit motion.motion-enabled gantry-tau.phase"),
        "0.0 0.0 5.0"
    );
    session.end();
    for line in [
        "gantry_tau: gantry-tau.enable is not connected: the machine is not permitted to be switched on",
        "gantry_tau: gantry-tau.wrench-0 to -5 are not all connected: no force is published",
    ] {
        assert_eq!(
            shown.matches(line).count(),
            1,
            "the operator sees it once: {shown}"
        );
    }
    let rows = super::read(&machine.file(""), &super::l2());
    super::judge(&rows, &super::l2());
    let moved = rows
        .iter()
        .flat_map(|row| row.reference.iter().zip(&rows[0].reference))
        .map(|(now, first)| (now - first).abs());
    assert!(moved.fold(0.0, f64::max) < 1.0, "nothing moves");
}
