//! The real client against a real server in lock-step, with a force sensor whose reading swings
//! wider and wider: the client leaves Obtain, the server ramps, and the client obtains again when it
//! is asked to.

use std::f64::consts::TAU;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use gantry_tau_client::ClientReport;
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::model::L2_MOTORS;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::record::TickRecord;
use gantry_tau_tests::client_session;

use super::bad_sensor::{Lie, Told, machine};

/// Frequency of the swinging load, Hz: above 0.6 times the lowest mode of an L2 at home, 12.4 Hz.
const HZ: f64 = 14.0;
/// Ticks from which the load swings, and from which it rests.
const SWINGS: u64 = 1_000;
const RESTS: u64 = 4_000;
/// Ticks from which the operator asks for Obtain again, and for Goodbye.
const ASKED: u64 = 6_000;
const QUITS: u64 = 8_000;

/// A load along x that swings from 4 N on, `e` times as wide every third of a second, up to 400 N;
/// then 30 N.
fn growing(tick: u64) -> Told {
    let swinging = u32::try_from(tick.saturating_sub(SWINGS)).unwrap();
    let t = f64::from(swinging) * 1e-3;
    let force_n = match tick {
        ..SWINGS => 0.0,
        SWINGS..RESTS => (4.0 * (3.0 * t).exp()).min(400.0) * (TAU * HZ * t).sin(),
        _ => 30.0,
    };
    Told::now([force_n, 0.0, 0.0, 0.0, 0.0, 0.0])
}

/// Load steps of 60 N, two a second.
fn steps(tick: u64) -> Told {
    let is_pulled = tick > SWINGS && (tick / 250) % 2 == 0;
    let force_n = if is_pulled { 60.0 } else { 0.0 };
    Told::now([force_n, 0.0, 0.0, 0.0, 0.0, 0.0])
}

/// Runs a client until the tick [`QUITS`], and asks for Obtain at [`ASKED`]. Returns its report and
/// the rows of the server.
fn session(lie: Lie, leave_on_oscillation: bool) -> (ClientReport, Vec<TickRecord<ARMS>>) {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.tare_samples = 50;
    robot.client.leave_on_oscillation = leave_on_oscillation;
    // The server does not end it either.
    for axis in &mut robot.limits {
        axis.agitation = None;
    }
    let liar = machine(&robot, lie);
    let cycle = client_session::cycle::<_, ARMS, L2_MOTORS, _>(&robot, liar);
    let controls = Arc::default();
    let (report, rows) = client_session::play(robot, cycle, None, &controls, |row| {
        if row.state.tick.0 == ASKED {
            controls.obtain.store(true, Ordering::Relaxed);
        }
        if row.state.tick.0 >= QUITS {
            controls.quit.store(true, Ordering::Relaxed);
        }
    });
    (report.unwrap(), rows)
}

/// Phases in their order, each with the tick that it begins in.
fn phases(rows: &[TickRecord<ARMS>]) -> Vec<(Phase, u64)> {
    let mut all = rows.iter().map(|row| (row.state.phase, row.state.tick.0));
    let mut phases: Vec<(Phase, u64)> = all.next().into_iter().collect();
    for (phase, tick) in all {
        if phases.last().is_some_and(|last| last.0 != phase) {
            phases.push((phase, tick));
        }
    }
    phases
}

fn offsets_nm(row: &TickRecord<ARMS>) -> [i32; ARMS] {
    row.state.axes.map(|axis| axis.offsets.position.0)
}

/// Checks that no offset jumps: it changes by 5 µm per tick at most, and the change by 10 µm.
fn nothing_jumps(rows: &[TickRecord<ARMS>]) {
    for ticks in rows.windows(3) {
        let [first, second, third] = [0, 1, 2].map(|tick| offsets_nm(&ticks[tick]));
        for axis in 0..ARMS {
            let before = second[axis] - first[axis];
            let now = third[axis] - second[axis];
            let tick = ticks[2].state.tick;
            assert!(now.abs() <= 5_000, "{tick:?}, axis {axis}: {now} nm");
            assert!((now - before).abs() <= 10_000, "{tick:?}, axis {axis}");
        }
    }
}

#[test]
fn a_client_leaves_an_oscillation_and_obtains_when_asked() {
    let (report, rows) = session(growing, true);
    let phases = phases(&rows);
    let order: Vec<Phase> = phases.iter().map(|phase| phase.0).collect();
    let begin = order
        .iter()
        .position(|phase| *phase == Phase::Obtain)
        .unwrap();
    let expected = [
        Phase::Obtain,
        Phase::Submit,
        Phase::Obtain,
        Phase::SafeDisconnect,
    ];
    assert_eq!(order[begin..], expected, "{phases:?}");
    // Before the swings are at their widest, 1.5 s after their begin.
    let left = phases[begin + 1].1;
    assert!((SWINGS..SWINGS + 1_500).contains(&left), "{phases:?}");
    assert!(phases[begin + 2].1 >= ASKED, "{phases:?}");
    nothing_jumps(&rows);
    // The server is in Submit once the offsets are at zero; they stay there until the operator asks.
    for row in &rows {
        let (tick, is_zero) = (row.state.tick.0, offsets_nm(row) == [0; ARMS]);
        match tick {
            _ if (left..ASKED).contains(&tick) => assert!(is_zero, "{tick}"),
            _ if tick == left - 20 || tick == QUITS => assert!(!is_zero, "{tick}"),
            _ => {}
        }
    }
    assert_eq!(report.oscillations, 1);
    let oscillation = report.last_oscillation.unwrap();
    assert!(oscillation.is_growing && oscillation.axis < ARMS);
    assert!((oscillation.hz() - HZ).abs() < 1.0, "{oscillation}");
    // Three times the hysteresis of 3 µm, and below what is sustained.
    assert!(
        (9_000..60_000).contains(&oscillation.swing_nm),
        "{oscillation}"
    );
    let sentence = oscillation.to_string();
    let begin = format!("axis {}: the targets oscillate at ", oscillation.axis + 1);
    assert!(
        sentence.starts_with(&begin) && sentence.ends_with(" um, growing"),
        "{sentence}"
    );
}

/// In Obtain until the Goodbye.
fn is_undisturbed(lie: Lie, leave_on_oscillation: bool) {
    let (report, rows) = session(lie, leave_on_oscillation);
    let order: Vec<Phase> = phases(&rows).iter().map(|phase| phase.0).collect();
    let last = order.len() - 2;
    assert_eq!(order[last..], [Phase::Obtain, Phase::SafeDisconnect]);
    let obtained = order.iter().filter(|phase| **phase == Phase::Obtain);
    assert_eq!(obtained.count(), 1, "{order:?}");
    assert_eq!((report.oscillations, report.last_oscillation), (0, None));
    nothing_jumps(&rows);
}

#[test]
fn load_steps_are_left_alone() {
    is_undisturbed(steps, true);
}

#[test]
fn a_client_that_may_not_leave_stays() {
    is_undisturbed(growing, false);
}
