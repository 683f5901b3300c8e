//! A part program, compensated.

use gantry_tau_machine::robot_file::AnyRobotFile;
use nalgebra::{Rotation3, Vector3};

use super::super::record::{LISTENING, OBTAIN, SAFE_DISCONNECT};
use super::super::run::Machine;
use super::judged::{Limits, ends};
use super::session::Session;
use super::{CLOSED, GOODBYE, end, l2, l2_part, turns, weightless};

/// Offsets are whole nanometres, of a reference that is one too; the filter has settled.
const ROUNDING_NM: f64 = 2.0;

pub(super) fn of_l2() {
    compensates(
        [300.0, -200.0],
        "l2",
        &l2(),
        [1.0; 3],
        &l2_part(2),
        [0.02, 0.5075, 0.65225],
    );
}

pub(super) fn of_f1() {
    let AnyRobotFile::F1(robot) = AnyRobotFile::named("f1").unwrap() else {
        panic!("the F1 has six axes")
    };
    let metres = robot.metres_per_q;
    let nm = std::array::from_fn(|axis| {
        if axis < 3 {
            1e6
        } else {
            metres[axis] * 1e9 * 1_f64.to_radians()
        }
    });
    let part = turns(2, [100.0, 0.0, 300.0], "X120 Y7.5 Z302.25 A0 B0 C0");
    let part = part.replace("\no100 endrepeat", " A2 B-1 C3\no100 endrepeat");
    compensates(
        [60.0, -40.0],
        "f1",
        &Limits {
            axes: robot.limits,
            nm,
        },
        metres,
        &part,
        [0.12, 0.0075, 0.30225],
    );
}

/// A program runs while a force along the platform's x is compensated, and one against it; the
/// client is killed in mid-path; the next one gets in after the ramp. At rest the offsets are those
/// of `gantry-tau solve`.
fn compensates<const N: usize>(
    [force_n, opposite_n]: [f64; 2],
    robot: &'static str,
    limits: &Limits<N>,
    metres_per_q: [f64; N],
    part: &str,
    at: [f64; 3],
) {
    let machine = Machine::obeying(robot, "compensates", "lockstep=1").unwrap();
    machine.program(part).unwrap();
    // The sample does not depend on the pose: nothing that the sensor carries has a weight.
    let file = weightless(&machine);
    let mut session = Session::begin(&machine);
    session.switch_on();
    session.rearm();
    session.ask("run");
    session.pass(500);
    let first = session.obtain(&file);
    session.load(force_n);
    session.pass(800);
    session.load(opposite_n);
    session.pass(800);
    first.signal("KILL");
    let last = session.obtain(&file);
    session.load(force_n);
    session.pass(300);
    assert_eq!(
        session.ask("wait 0 s.interp_state != linuxcnc.INTERP_IDLE"),
        "done",
        "the program still runs"
    );
    session.wait("s.interp_state == linuxcnc.INTERP_IDLE and s.inpos and s.queue == 0");
    session.pass(1500);
    last.signal("INT");
    assert_eq!(last.end(), Some(0));
    session.wait_phase(LISTENING);
    let rows = end(session, &machine, limits);

    assert_eq!(
        ends(&rows),
        [[SAFE_DISCONNECT, CLOSED], [SAFE_DISCONNECT, GOODBYE]]
    );
    let obtained: Vec<_> = rows.iter().filter(|row| row.phase == OBTAIN).collect();
    assert!(obtained.len() > 3000, "{}", obtained.len());
    assert!(
        obtained.iter().all(|row| row.missed == 0),
        "in lock-step no deadline is missed"
    );
    let step = i64::from(limits.axes[1].limits.position.step());
    let fastest = rows
        .windows(2)
        .map(|pair| (pair[1].offset[1] - pair[0].offset[1]).abs())
        .max()
        .unwrap();
    assert_eq!(fastest, step, "the limit of a step was met");
    let settled = obtained.last().unwrap().offset;
    let expected = offsets(force_n, robot, at, metres_per_q);
    for (axis, (found, expected)) in settled.iter().zip(expected).enumerate() {
        let error = f64::from(i32::try_from(*found).unwrap()) - expected;
        assert!(
            error.abs() < ROUNDING_NM,
            "axis {axis}: {found}, expected {expected}"
        );
    }
}

/// Numbers of the answer of `solve`, at a place under a load.
fn solve(robot: &str, at: [f64; 3], op: &str, load: &[f64; 6], key: &str) -> Vec<f64> {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots");
    let asked = format!(
        "{{\"id\":0,\"robot\":\"{file}/{robot}.toml\",\"op\":\"{op}\",\"T\":{at:?},\"w\":{load:?}}}\n"
    );
    let mut answer = Vec::new();
    gantry_tau::solve::run(asked.as_bytes(), &mut answer).unwrap();
    let answer: serde_json::Value = serde_json::from_slice(&answer).unwrap();
    let numbers = answer["ok"][key]
        .as_array()
        .unwrap_or_else(|| panic!("{answer}"));
    numbers
        .iter()
        .map(|number| number.as_f64().unwrap())
        .collect()
}

/// Offsets by `gantry-tau solve`, nm, for a raw sample that is a force along the platform's x: the
/// load turns the platform, and the sensor on it, so that the load on the world's axes is found in
/// a few rounds.
fn offsets<const N: usize>(
    force_n: f64,
    robot: &str,
    at: [f64; 3],
    metres_per_q: [f64; N],
) -> [f64; N] {
    // Of both robot files: the sensor is 0.08 m below the tool centre point.
    let force = Vector3::new(force_n, 0.0, 0.0);
    let moment = Vector3::new(0.0, 0.0, -0.08).cross(&force);
    let mut load = [force.x, force.y, force.z, moment.x, moment.y, moment.z];
    // Six axes hold the orientation as well.
    for _ in 0..if N == 3 { 4 } else { 0 } {
        let moved = solve(robot, at, "deflection", &load, "dx_total");
        let turned = Rotation3::from_scaled_axis(Vector3::new(moved[3], moved[4], moved[5]));
        let (force, moment) = (turned * force, turned * moment);
        load = [force.x, force.y, force.z, moment.x, moment.y, moment.z];
    }
    let (commanded, nominal) = (
        solve(robot, at, "compensate", &load, "q"),
        solve(robot, at, "ik", &load, "q"),
    );
    std::array::from_fn(|axis| (commanded[axis] - nominal[axis]) * metres_per_q[axis] * 1e9)
}
