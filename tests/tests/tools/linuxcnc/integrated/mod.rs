//! The component `gantry_tau` in LinuxCNC, between the motion controller and drives that lag, with the unchanged `gantry-tau client`: the
//! configurations of `host/linuxcnc/config`, in lock-step, judged period by period.

mod judged;
mod session;

use std::f64::consts::PI;

use gantry_tau::model::L2;
use gantry_tau::robot_file::{AnyRobotFile, RobotFile};
use libtest_mimic::Failed;

use super::run::Machine;
use judged::{FAULT, Limits, OBTAIN, Row, SAFE_DISCONNECT, ends, judge, read};
use session::{Session, rest};

/// Trials of this file.
pub(super) const TRIALS: &[(&str, super::Check)] = &[
    ("l2_compensates_while_a_program_runs", l2_compensates),
];

/// Causes, as on the wire.
const CLOSED: u8 = 5;
const GOODBYE: u8 = 6;
const STOP: u8 = 8;

/// Lines and arcs with blending, for longer than a test takes, and an end.
fn program(turns: u32) -> String {
    format!(
        "G21 G90 G17 G64 P0.05\no100 repeat [{turns}]\nG1 X-30 Y480 Z640 F6000\nG1 X30\nG1 Y520\nG1 X-30\nG1 Y480\n\
         G2 X0 Y510 I0 J30 F4500\nG3 X30 Y480 I30 J0 Z660\no100 endrepeat\nG1 X20 Y507.5 Z652.25\nM2\n"
    )
}

fn l2() -> (Limits<3>, Box<RobotFile<L2, 3>>) {
    let AnyRobotFile::L2(robot) = AnyRobotFile::named("l2").unwrap() else { panic!("the L2 has three axes") };
    (Limits { axes: robot.limits, nm: [1e6; 3] }, robot)
}

/// A program runs while 300 N and -200 N are compensated; the client is killed in mid-path; the next one gets in after the ramp.
fn l2_compensates() -> Result<(), Failed> {
    let (limits, _) = l2();
    let machine = Machine::obeying("l2", "compensates", "lockstep=1")?;
    machine.program(&program(4))?;
    let mut session = Session::begin(&machine);
    session.switch_on();
    session.rearm();
    session.ask("run");
    session.pass(500);
    let first = session.obtain("l2");
    session.load(300.0);
    session.pass(1000);
    session.load(-200.0);
    session.pass(1000);
    first.signal("KILL");
    let last = session.obtain("l2");
    session.load(300.0);
    session.pass(300);
    assert_eq!(session.ask("wait 0 s.interp_state != linuxcnc.INTERP_IDLE"), "done", "the program still runs");
    session.wait("s.interp_state == linuxcnc.INTERP_IDLE and s.inpos and s.queue == 0");
    session.pass(1000);
    last.signal("INT");
    assert_eq!(last.end(), Some(0));
    session.wait_phase(0);
    let said = session.end();
    let rows = read(&machine.file(""), &limits);
    judge(&rows, &limits);
    assert_eq!(ends(&rows), [[SAFE_DISCONNECT, CLOSED], [SAFE_DISCONNECT, GOODBYE]], "{said}");
    Ok(())
}
