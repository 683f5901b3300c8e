//! The real client against a real server in lock-step, with a force sensor that lies or falls
//! silent: it leaves in good order and says why, instead of compensating a force that is not
//! measured.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use gantry_tau_client::{ClientControls, ClientError, ClientReport};
use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::model::{L2, L2_MOTORS};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{Plant, PlantError, Reading};
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_tests::client_session;
use gantry_tau_tests::liar::Liar;

/// Samples the tare of these tests takes.
const TARE: u32 = 50;
const LOAD: [f64; 6] = [30.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Sample that a sensor tells in a tick.
#[derive(Clone, Copy)]
pub(super) struct Told {
    /// Force (N) then moment (N m); with NaN nothing.
    wrench: [f64; 6],
    /// Ticks since it was measured.
    age: u8,
}

impl Told {
    pub(super) const NOTHING: Self = Self::now([f64::NAN; 6]);

    pub(super) const fn now(wrench: [f64; 6]) -> Self {
        Self { wrench, age: 0 }
    }
}

/// Conduct of a sensor, by tick.
pub(super) type Lie = fn(u64) -> Told;

/// Machine under no load, with a sensor that says what `lie` makes of each tick.
pub(super) fn machine(
    robot: &RobotFile<L2, ARMS>,
    lie: Lie,
) -> impl Plant<ARMS, L2_MOTORS, Error = PlantError> + use<> {
    let (_hand, tool) = load_generator();
    let machine = SimulatedMachine::from_robot(robot, tool, Motion::Hold).unwrap();
    let speak = move |tick, reading: &mut Reading<ARMS>| {
        let told = lie(tick);
        let tool = reading.tool.as_mut().unwrap();
        (tool.sensor, tool.sensor_age) = (told.wrench, told.age);
    };
    Liar::new(machine, speak)
}

/// Runs a client whose sensor lies, until it ends or, from a tick on, is asked to quit. Returns its
/// result, whether it reached Obtain, and the last tick of the session.
fn session(lie: Lie, quit_at: u64) -> (Result<ClientReport, ClientError>, bool, u64) {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.tare_samples = TARE;
    let liar = machine(&robot, lie);
    let cycle = client_session::cycle::<_, ARMS, L2_MOTORS, _>(&robot, liar);
    let controls: Arc<ClientControls> = Arc::default();
    let (result, rows) = client_session::play(robot, cycle, None, &controls, |row| {
        if row.state.tick.0 >= quit_at {
            controls.quit.store(true, Ordering::Relaxed);
        }
    });
    let last = rows.last().unwrap();
    assert_eq!(last.ended, Some(Cause::Goodbye), "it leaves in good order");
    if let Ok(report) = &result {
        // Every State has its Command, but the last one, and that of the Goodbye, which may also
        // follow a Command at once; and those that the server sent while it waited for one: a
        // client that the machine is slow to run is not what is judged here.
        let commands = controls.commands.load(Ordering::Relaxed);
        let handshake = rows
            .iter()
            .filter(|row| row.state.phase == Phase::Handshake);
        let waiting =
            u64::try_from(handshake.count()).unwrap() - 1 + u64::from(last.state.counters.missed);
        assert!(
            (1..=2 + waiting).contains(&(report.states - commands)),
            "{commands} {report:?}"
        );
    }
    let obtained = rows.iter().any(|row| row.state.phase == Phase::Obtain);
    (result, obtained, last.state.tick.0)
}

const fn honest(tick: u64) -> [f64; 6] {
    if tick < 1_000 { [0.0; 6] } else { LOAD }
}

/// A sample of an earlier tick, as long as an age can tell it.
fn taken_at(then: u64, tick: u64) -> Told {
    Told {
        wrench: honest(then),
        age: u8::try_from(tick - then).unwrap_or(u8::MAX),
    }
}

#[test]
fn a_sensor_that_lies_or_falls_silent_is_left() {
    let cases: [(&str, Lie, bool, &str); 9] = [
        (
            "freezes",
            |tick| taken_at(tick.min(2_000), tick),
            true,
            "none has come for too long",
        ),
        (
            "says NaN in one component",
            |tick| {
                let mut wrench = honest(tick);
                wrench[4] = if tick > 2_000 { f64::NAN } else { 0.0 };
                Told::now(wrench)
            },
            true,
            "none has come for too long",
        ),
        (
            "is beyond its range",
            |tick| match tick {
                ..=2_000 => Told::now(honest(tick)),
                _ => Told::now([1e300, f64::NEG_INFINITY, 0.0, 0.0, 0.0, 0.0]),
            },
            true,
            "none of 100 could be used: the force is beyond the range of a State",
        ),
        (
            "has a moment beyond its range",
            |tick| {
                let mut wrench = honest(tick);
                wrench[5] = if tick > 2_000 { 2_147.483_648 } else { 0.0 };
                Told::now(wrench)
            },
            true,
            "the force is beyond the range of a State",
        ),
        // What cannot be used is no better than nothing: together they are no longer waited for.
        (
            "is beyond its range now and then, and else silent",
            |tick| match tick {
                ..=2_000 => Told::now(honest(tick)),
                _ if tick % 40 == 0 => Told::now([1e300; 6]),
                _ => Told::NOTHING,
            },
            true,
            "none has come for too long",
        ),
        (
            "never speaks",
            |_| Told::NOTHING,
            false,
            "none has come for too long with the States",
        ),
        (
            "repeats one sample",
            |tick| taken_at(tick.min(5), tick),
            false,
            "none has come for too long",
        ),
        (
            "is old from the first sample on",
            |tick| Told {
                age: u8::MAX,
                ..Told::now(honest(tick))
            },
            false,
            "none has come for too long",
        ),
        (
            "becomes too old",
            |tick| Told {
                age: if tick > 2_000 { 101 } else { 0 },
                ..Told::now(honest(tick))
            },
            true,
            "none has come for too long",
        ),
    ];
    for (case, lie, obtains, reason) in cases {
        let (result, obtained, last) = session(lie, u64::MAX);
        let error = result.unwrap_err();
        assert_eq!(obtained, obtains, "{case}");
        assert!(!obtains || (2_100..2_110).contains(&last), "{case}: {last}");
        assert!(
            matches!(error, ClientError::SensorSilent(_)),
            "{case}: {error}"
        );
        assert!(error.to_string().contains(reason), "{case}: {error}");
        assert_eq!(error.exit_code(), 8, "{case}");
    }
}

/// A client gives up after 1 000 States without a first sample.
#[test]
fn the_first_sample_is_waited_for() {
    fn late(tick: u64) -> Told {
        let is_silent = tick < 900;
        if is_silent {
            Told::NOTHING
        } else {
            Told::now([0.0; 6])
        }
    }
    let (result, obtained, _) = session(late, 2_000);
    assert!(result.is_ok() && obtained, "{result:?}");
    let (result, _, last) = session(|_| Told::NOTHING, u64::MAX);
    assert!(result.is_err() && (1_000..1_100).contains(&last), "{last}");
}

/// A sensor slower than the cycle repeats its sample with the age that it has: it is used once, and
/// the session goes on.
#[test]
fn a_sensor_slower_than_the_cycle_is_used() {
    let lie: Lie = |tick| taken_at(tick - tick % 20, tick);
    let (result, obtained, _) = session(lie, 6_000);
    assert!(obtained);
    assert_eq!(result.unwrap().held, 0);
}

/// Bad samples now and then, each time fewer than end a session and together more: the last
/// correction is held, and every one is counted.
#[test]
fn short_bursts_of_bad_samples_are_tolerated() {
    const BURST: u64 = 90;
    const fn is_bad(tick: u64) -> bool {
        tick > 2_000 && tick % 500 < BURST
    }
    let lie: Lie = |tick| {
        Told::now(if is_bad(tick) {
            [1e300; 6]
        } else {
            honest(tick)
        })
    };
    let (result, obtained, last) = session(lie, 6_000);
    let report = result.unwrap();
    assert!(obtained);
    let bad: u64 = (0..last).map(|tick| u64::from(is_bad(tick))).sum();
    // The last State is answered with Goodbye.
    assert!(
        bad > 2 * BURST && bad.abs_diff(report.held) <= 1,
        "{} of {bad}: {report:?}",
        report.held
    );
}
