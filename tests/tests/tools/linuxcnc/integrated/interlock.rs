//! Wiring that does not agree: `permit` is withheld, one line says which joint and by how much, and
//! nothing moves.

use super::super::run::Machine;
use super::session::Session;

/// `drives.tcl` with another text; the line that the operator reads.
fn refuses(test: &str, from: &str, to: &str, line: &str) {
    let machine = Machine::obeying("l2", test, "lockstep=1").unwrap();
    machine.edit_drives(from, to).unwrap();
    let mut session = Session::begin(&machine);
    // Said once it has lasted for five thousand periods; LinuxCNC's joints are at 0 until it has
    // started.
    session.wait("p('gantry-tau.tick') > 7000");
    session.ask("try run.command.state(linuxcnc.STATE_ESTOP_RESET)");
    session.wait("s.task_state != linuxcnc.STATE_ESTOP");
    // Messages pass through LinuxCNC's task.
    session.ask("try time.sleep(0.5)");
    let shown = session.ask("errors");
    assert_eq!(
        shown
            .matches("gantry_tau: not permitted to be switched on: ")
            .count(),
        1,
        "{shown}"
    );
    assert!(shown.contains(line), "{shown}");
    session.ask("try run.command.state(linuxcnc.STATE_ON)");
    session.ask("try time.sleep(0.5)");
    let errors = session.ask("errors");
    assert!(errors.contains("enable input is false"), "{errors}");
    assert_eq!(
        session.ask("pins gantry-tau.permit motion.motion-enabled gantry-tau.phase"),
        "0.0 0.0 5.0"
    );
    session.end();
    let rows = super::read(&machine.file(""), &super::l2());
    let moved = rows
        .iter()
        .flat_map(|row| row.reference.iter().zip(&rows[0].reference));
    let largest = moved
        .map(|(now, first)| (now - first).abs())
        .fold(0.0, f64::max);
    assert!(largest < 1.0, "a reference has moved by {largest} nm");
    assert!(
        rows.iter().all(|row| !row.permit && !row.is_on),
        "never permitted"
    );
}

/// The line of HAL that runs `gantry-tau.read` is forgotten: LinuxCNC takes every joint to be at 0.
pub(super) fn read_is_forgotten() {
    refuses(
        "forgotten",
        "addf gantry-tau.read servo-thread\n",
        "",
        "gantry-tau.read does not run before every gantry-tau.write: addf gantry-tau.read before motion-controller",
    );
}

/// The commands of two joints are crossed.
pub(super) fn commands_are_crossed() {
    refuses(
        "crossed",
        "joint.$joint.motor-pos-cmd => gantry-tau.$joint.nominal",
        "joint.$joint.motor-pos-cmd => gantry-tau.[lindex {1 0 2} $joint].nominal",
        "from the nominal position in force: check the wires of joint.",
    );
}

/// The feedback of two joints is crossed.
pub(super) fn feedback_is_crossed() {
    refuses(
        "feedback",
        "gantry-tau.$joint.feedback => joint.$joint.motor-pos-fb",
        "gantry-tau.$joint.feedback => joint.[lindex {0 2 1} $joint].motor-pos-fb",
        "from the nominal position in force: check the wires of joint.",
    );
}

/// The drives' positions of two joints are crossed: each is beyond the other's travel.
pub(super) fn positions_are_crossed() {
    refuses(
        "positions",
        "lowpass.$joint.out => gantry-tau.$joint.position $stand.in1",
        "lowpass.$joint.out => gantry-tau.[lindex {1 0 2} $joint].position $stand.in1",
        "joint 0: gantry-tau.0.position is -696.419",
    );
}
