//! The examples of host/python: each does what it says, within the limits in every tick.

use std::io::{BufRead, BufReader, Write};
use std::net::SocketAddr;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use gantry_tau_client::pace::PaceOptions;
use gantry_tau_core::control::axis::{InForce, Offsets, Reference};
use gantry_tau_core::control::message::Cause;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_machine::model::L2_MOTORS;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::TickSource;
use gantry_tau_sim::remote::RemoteMachine;
use gantry_tau_system::dial::NEVER;
use gantry_tau_tests::pacing::Pacing;
use gantry_tau_tests::wait_for;

use super::{folder, python};
use crate::firmware::program;
use crate::session::{Session, Tool};

/// Trials of this file.
pub(super) const TRIALS: &[(&str, super::Check)] = &[
    ("constant_offset_is_reached_and_left", constant_offset),
    ("submit_only_never_reaches_a_drive", submit_only),
    ("compensation_by_solve_holds_the_tool", compensation),
    (
        "force_control_settles_after_a_set_point_out_of_reach",
        force_control,
    ),
    ("slow_program_moves_the_first_axis", slow_program),
    ("simulator_follows_its_references_and_is_pulled", simulator),
];

/// An example with the address of the server.
fn example(name: &str, server: &str, arguments: &[&str]) -> Command {
    let mut python = python();
    python
        .arg(folder().join("examples").join(name))
        .arg(server)
        .args(arguments);
    python
}

/// An example that asks `gantry-tau solve`, built before the session: a server that is not watched
/// loses rows.
fn solving(name: &str, solver: &Path, session: &Session, arguments: &[&str]) -> Child {
    let mut example = example(name, &session.address(), arguments);
    example
        .arg("--robot")
        .arg(folder().join("../../robots/l2.toml"));
    example.arg("--gantry-tau").arg(solver).spawn().unwrap()
}

/// Attempts of an example whose solver is a process of its own: on a busy machine it may get no
/// processor for the second that a step may take.
const ATTEMPTS: u32 = 3;

/// Runs an example that asks the solver until each of its steps has returned in time, and checks
/// the rest.
fn in_time(tool: impl Fn() -> Tool, name: &str, arguments: &[&str], check: impl Fn(&Session)) {
    let solver = program::build();
    for attempt in 1..=ATTEMPTS {
        let mut session = Session::new(tool());
        let program = solving(name, &solver, &session, arguments);
        let (code, said) = session.end_of(program);
        if said.contains("has not returned within 1 s") && attempt < ATTEMPTS {
            assert_eq!(
                (code, session.ramped()),
                (Some(10), Cause::Goodbye),
                "{said}"
            );
            eprintln!("{name}, attempt {attempt}: {said}");
            session.quit();
            continue;
        }
        has_left(&mut session, code, &said);
        check(&session);
        session.quit();
        return;
    }
}

/// It leaves in good order, and nothing remains.
fn left(session: &mut Session, program: Child) {
    let (code, said) = session.end_of(program);
    has_left(session, code, &said);
}

fn has_left(session: &mut Session, code: Option<i32>, said: &str) {
    assert_eq!(code, Some(0), "{said}");
    assert!(said.starts_with("left with Goodbye after "), "{said}");
    assert_eq!(session.ramped(), Cause::Goodbye);
    let missed = session
        .obtained()
        .iter()
        .map(|row| row.state.counters.missed)
        .max();
    assert_eq!(missed, Some(0));
}

fn constant_offset() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let arguments = ["--offset-um", "12.5,-7,0", "--states", "300"];
    let program = example("constant_offset.py", &session.address(), &arguments)
        .spawn()
        .unwrap();
    left(&mut session, program);
    let held = session
        .obtained()
        .last()
        .unwrap()
        .state
        .axes
        .map(|axis| axis.offsets.position.0);
    assert_eq!(held, [12_500, -7_000, 0]);
    session.quit();
}

fn slow_program() {
    let pacing = Pacing::new(TickSource::Lockstep);
    // A program that gets no processor for most of a second is not late.
    let options = PaceOptions {
        latency: Duration::from_millis(900),
        period: Duration::from_millis(10),
        is_hurried: false,
        ..pacing.options()
    };
    let report = pacing.with(&options, |port| {
        let mut program = python();
        program
            .arg(folder().join("examples/slow_program.py"))
            .args(["--port", &port.port().to_string(), "--seconds", "5"]);
        let output = program.output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{output:?}");
        assert!(said.contains(", submit: offset 0.0 um, force ["), "{said}");
        let last = said.lines().last().unwrap();
        assert!(
            last.contains(", obtain: offset ") && !last.contains("offset 0.0 "),
            "{said}"
        );
    });
    assert_eq!((report.programs, report.refused), (1, 0));
}

fn simulator() {
    let mut program = python()
        .arg(folder().join("examples/simulator.py"))
        .args(["--port", "0"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = String::new();
    let mut lines = BufReader::new(program.stdout.take().unwrap());
    lines.read_line(&mut said).unwrap();
    let address = said.trim().strip_prefix("waiting for a server at ");
    let address: SocketAddr = address.unwrap().parse().unwrap();
    let robot = RobotFile::builtin_l2().unwrap();
    let mut machine =
        RemoteMachine::<ARMS, L2_MOTORS>::connect(address.into(), &robot, &NEVER).unwrap();
    let home = machine.in_force().unwrap();
    let moved = home.map(|axis| InForce {
        offsets: Offsets::position(OffsetNm(-1_234)),
        ..axis
    });
    let references = moved.map(|axis| Reference {
        position: PositionNm(axis.nominal.0 - 1_234),
        velocity_offset: VelocityUmS(0),
        torque_offset: TorquePermille(0),
    });
    machine.write(&references, &moved).unwrap();
    assert_eq!(machine.in_force().unwrap(), moved);
    let reading = machine.read(1).unwrap();
    assert_eq!(reading.nominal, home.map(|axis| axis.nominal));
    let actual = reading.actual.map(|axis| axis.position);
    assert_eq!(actual, references.map(|reference| reference.position));
    let sensor = reading.tool.unwrap().sensor;
    assert!(sensor.iter().all(|part| part.abs() < 1e-9), "{sensor:?}");
    writeln!(program.stdin.as_mut().unwrap()).unwrap();
    wait_for("the force", || {
        let [x, rest @ ..] = machine.read(1).unwrap().tool.unwrap().sensor;
        (x - 100.0).abs() < 1e-9 && rest.iter().all(|part| part.abs() < 1e-9)
    });
    program.kill().unwrap();
    program.wait().unwrap();
}

fn submit_only() {
    let mut session = Session::new(Tool::Steps(0.0, 1.0));
    let arguments = ["--submit-only", "--states", "300"];
    let program = example("constant_offset.py", &session.address(), &arguments)
        .spawn()
        .unwrap();
    let (code, said) = session.end_of(program);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(session.ramped(), Cause::Goodbye);
    assert!(session.obtained().is_empty());
    let shadows = session
        .rows
        .iter()
        .map(|row| row.state.axes[0].shadow.position.0);
    assert_eq!(shadows.max(), Some(10_000));
    session.quit();
}

/// Force in x, N, and displacement of the tool by all axes, um.
fn loaded(row: &TickRecord<ARMS>) -> (f64, f64) {
    let tool = row.tool.unwrap();
    (
        tool.load[0],
        tool.displacement_m
            .iter()
            .map(|along| along * along)
            .sum::<f64>()
            .sqrt()
            * 1e6,
    )
}

/// 300 N displace this machine by 195 um. What remains: three per cent of deviation of the springs,
/// and 20 Hz of filtered noise.
fn compensation() {
    in_time(
        || Tool::Steps(300.0, 0.5),
        "compensation.py",
        &["--states", "4000"],
        compensated,
    );
}

fn compensated(session: &Session) {
    let rows = session.obtained();
    let (force_n, displaced_um) = loaded(rows.last().unwrap());
    assert!((force_n - 300.0).abs() < 1e-9, "{force_n}");
    assert!((0.0..6.0).contains(&displaced_um), "{displaced_um}");
    // The step itself is seen: the offsets follow it.
    let worst_um = rows.iter().map(|row| loaded(row).1).fold(0.0, f64::max);
    assert!(worst_um > 20.0, "{worst_um}");
    let offsets_um = rows
        .last()
        .unwrap()
        .state
        .axes
        .map(|axis| f64::from(axis.offsets.position.0) * 1e-3);
    // Of the robot file: what the nominal springs ask for at 300 N.
    for (offset, expected) in offsets_um.iter().zip([-189.0, -238.0, -149.0]) {
        assert!((offset - expected).abs() < 3.0, "{offsets_um:?}");
    }
}

/// 30 N, 60 N, then 2000 N, which are beyond the reach of 0.5 mm, and 30 N again: without
/// anti-windup the integral of the third would take minutes to come back.
fn force_control() {
    let arguments = [
        "--forces",
        "30,60,2000,30",
        "--each",
        "1500",
        "--states",
        "6900",
    ];
    in_time(|| Tool::Above(2e5), "force_control.py", &arguments, settled);
}

fn settled(session: &Session) {
    const EACH: usize = 1_500;
    let forces: Vec<f64> = session
        .obtained()
        .iter()
        .map(|row| row.tool.unwrap().load[2])
        .collect();
    for (phase, expected_n) in [(1, 30.0), (2, 60.0)] {
        let settled = &forces[EACH * phase - 200..EACH * phase - 5];
        assert!(
            settled.iter().all(|force| (force - expected_n).abs() < 0.5),
            "{expected_n}: {settled:?}"
        );
    }
    let reach = forces[EACH * 3 - 5];
    assert!((70.0..100.0).contains(&reach), "{reach}");
    // 500 ticks after the last set point, and at the end: the third did not wind up.
    for tick in [EACH * 3 + 700, forces.len() - 1] {
        assert!(
            (forces[tick] - 30.0).abs() < 0.5,
            "{tick}: {}",
            forces[tick]
        );
    }
    let steps = forces
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .fold(0.0, f64::max);
    assert!(steps < 5.0, "the force does not jump: {steps} N");
}
