//! The component `gantry_tau` in LinuxCNC, between the motion controller and drives that lag, with
//! the unchanged `gantry-tau client`: the configurations of `host/linuxcnc/config`, in lock-step,
//! judged period by period.

mod compensation;
mod ends;
mod interlock;
mod judged;
mod late;
mod refused;
mod session;

use gantry_tau_machine::robot_file::{AnyRobotFile, text_of};

use super::run::Machine;
use judged::{Limits, Row, judge, read};
use session::Session;

/// Trials of this folder.
pub(super) const TRIALS: &[(&str, super::Check)] = &[
    ("l2_compensates_while_a_program_runs", || {
        done(compensation::of_l2)
    }),
    ("f1_compensates_while_a_program_runs", || {
        done(compensation::of_f1)
    }),
    (
        "sessions_end_by_machine_off_estop_stop_and_an_unreachable_pose",
        || done(ends::by_the_machine),
    ),
    (
        "sessions_end_by_a_pulled_cable_a_stopped_client_and_a_silent_sensor",
        || done(ends::by_the_client),
    ),
    (
        "killed_linuxcnc_starts_again_where_its_drives_stand",
        || done(ends::by_a_kill),
    ),
    ("bursts_hold_offsets", || done(late::bursts)),
    ("floods_do_not_block_the_thread", || done(late::flood)),
    ("permit_needs_read_to_run", || {
        done(interlock::read_is_forgotten)
    }),
    ("permit_needs_commands_that_are_not_crossed", || {
        done(interlock::commands_are_crossed)
    }),
    ("permit_needs_feedback_that_is_not_crossed", || {
        done(interlock::feedback_is_crossed)
    }),
    ("permit_needs_positions_that_are_not_crossed", || {
        done(interlock::positions_are_crossed)
    }),
    ("misfits_are_refused_in_one_line_and_nothing_moves", || {
        done(refused::misfits)
    }),
];

/// A test that fails by panicking.
fn done(test: fn()) -> Result<(), libtest_mimic::Failed> {
    test();
    Ok(())
}

/// Causes, as on the wire.
const CLIENT_LATE: u8 = 1;
const CLOSED: u8 = 5;
const GOODBYE: u8 = 6;
const STOP: u8 = 8;

/// Lines and arcs with blending in the XY plane about a point, mm, again and again; 6 s each time.
fn turns(number: u32, [x, y, z]: [f64; 3], end: &str) -> String {
    let (left, right, near, far, up) = (x - 30.0, x + 30.0, y - 20.0, y + 20.0, z + 10.0);
    format!(
        "G21 G90 G17 G64 P0.05\no100 repeat [{number}]\nG1 X{left} Y{near} Z{z} F6000\nG1 X{right}\nG1 Y{far}\nG1 X{left}\nG1 Y{near}\n\
         G2 X{x} Y{up_y} I0 J30 F4500\nG3 X{right} Y{near} I30 J0 Z{up}\no100 endrepeat\nG1 {end}\nM2\n",
        up_y = near + 30.0,
    )
}

/// The part of most tests.
fn l2_part(number: u32) -> String {
    turns(number, [0.0, 500.0, 650.0], "X20 Y507.5 Z652.25")
}

fn l2() -> Limits<3> {
    let AnyRobotFile::L2(robot) = AnyRobotFile::named("l2").unwrap() else {
        panic!("the L2 has three axes")
    };
    Limits {
        axes: robot.limits,
        nm: [1e6; 3],
    }
}

/// A robot file with another text; next to the configuration.
fn variant(machine: &Machine, name: &str, from: &str, to: &str) -> String {
    let text = text_of(machine.name).unwrap();
    write(machine, name, &replaced(&text, from, to))
}

/// Writes the robot file with a tool that has no weight, and so without masses. Returns its path.
fn weightless(machine: &Machine) -> String {
    let text = text_of(machine.name).unwrap();
    let masses =
        &text[text.find("[masses]").unwrap()..text.find("# The simulated machine.").unwrap()];
    let text = replaced(&text, masses, "");
    let text = replaced(
        &text,
        "weight_n = [0.0, 0.0, -18.0]",
        "weight_n = [0.0, 0.0, 0.0]",
    );
    write(machine, "weightless.toml", &text)
}

/// Returns a text with its only `from` replaced.
fn replaced(text: &str, from: &str, to: &str) -> String {
    assert_eq!(text.matches(from).count(), 1, "{from}");
    text.replace(from, to)
}

/// Writes a file beside the configuration. Returns its path.
fn write(machine: &Machine, name: &str, text: &str) -> String {
    let path = machine.file(name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

/// Ends a session. Returns its periods, judged.
fn end<const N: usize>(session: Session, machine: &Machine, limits: &Limits<N>) -> Vec<Row<N>> {
    session.end();
    let rows = read(&machine.file(""), limits);
    judge(&rows, limits);
    rows
}
