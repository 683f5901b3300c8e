//! The agitation budget over sockets: who shakes is ended, the machine makes no step, and the black
//! box replays. A compensation that swings on a machine with mass is one who shakes.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use gantry_tau::replay::Findings;
use gantry_tau_client::ClientControls;
use gantry_tau_core::control::agitation::AgitationBudget;
use gantry_tau_core::control::message::{Cause, Mode, Phase};
use gantry_tau_core::control::session::config::Parameters;
use gantry_tau_core::units::EpochRange;
use gantry_tau_machine::masses::GRAVITY_M_PER_S2;
use gantry_tau_machine::model::L2_MOTORS;
use gantry_tau_machine::robot_file::{FilterKey, RobotFile};
use gantry_tau_record::black_box;
use gantry_tau_server::black_box::HALF;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_sim::load_generator::{Load, load_generator};
use gantry_tau_sim::load_pattern::LoadPattern;
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_sim::workpiece::Workpiece;
use gantry_tau_tests::client_session;
use gantry_tau_tests::fake_plant::Bus;
use gantry_tau_tests::server_fixture::{ServerFixture, parameters};
use gantry_tau_tests::session_fixture::SessionFixture;

/// Targets either side of zero, nm.
const SWING: i32 = 2_000;
/// Ticks of Obtain until the second differences, 8 um per tick, are above the budget of 100 um.
const SWINGS: usize = 14;

/// A server whose first axis has a budget of 100 nm per tick.
fn with_budget<const N: usize>() -> ServerFixture<N> {
    let mut parameters: Parameters<N> = parameters();
    parameters.axes[0].agitation = AgitationBudget::new(100);
    ServerFixture::start(parameters, Bus::default(), EpochRange::VOLATILE).unwrap()
}

/// Targets of a tick: every axis swings, or all but the first.
fn targets<const N: usize>(tick: usize, first: bool) -> [i32; N] {
    let swing = if tick % 2 == 0 { SWING } else { -SWING };
    let mut targets = [swing; N];
    if !first {
        targets[0] = 0;
    }
    targets
}

/// Every tick is watched by the monitor of the fixture, which knows the limits of all channels.
fn shaken<const N: usize>() {
    let (server, mut windows) = with_budget::<N>().handing_over();
    let mut session = SessionFixture::submitted_on(server);
    for tick in 0..SWINGS {
        let row = session.answer(Mode::Obtain, targets(tick, true));
        assert_eq!(
            (row.state.phase, row.ended),
            (Phase::Obtain, None),
            "{tick}"
        );
    }
    let last = session.server.bus.positions();
    let frame = session.client.frame(Mode::Obtain, targets(SWINGS, true));
    session.deliver(&frame);
    let mut server = session.assert_disconnect(last, Cause::Agitated);
    for _ in 0..HALF {
        server.step();
    }
    let window = windows.receive().expect("no black box was handed over");
    assert_eq!(window.end().cause, Some(Cause::Agitated));
    let text = black_box::encode(&window);
    let read = black_box::decode::<N>(&window.file_name(), text.as_bytes()).unwrap();
    assert_eq!(read, window);
    let findings = Findings::of(&read);
    assert_eq!(
        (findings.agreeing, findings.difference),
        (findings.ticks, None)
    );
    // Who shakes an axis without a budget is not ended; nor is who comes to rest.
    let mut session = SessionFixture::submitted_on(server);
    for tick in 0..10 * SWINGS {
        let row = session.answer(Mode::Obtain, targets(tick, false));
        assert_eq!(
            (row.state.phase, row.ended),
            (Phase::Obtain, None),
            "{tick}"
        );
    }
}

#[test]
fn a_client_that_shakes_is_ended_with_its_cause() {
    shaken::<3>();
    shaken::<6>();
}

/// Steps of 9 um, one in 200 ms: second differences of 50 um/s.
#[test]
fn a_client_that_works_is_not_ended() {
    let mut session = SessionFixture::submitted_on(with_budget::<3>());
    for tick in 0..3_000 {
        let side = if tick / 200 % 2 == 0 { 4_500 } else { -4_500 };
        let row = session.answer(Mode::Obtain, [side; 3]);
        assert_eq!(
            (row.state.phase, row.ended),
            (Phase::Obtain, None),
            "{tick}"
        );
    }
}

/// Ticks of Obtain before the load.
const BEFORE: usize = 50;
/// Ticks of Obtain after which a client that was not ended leaves.
const LONGEST: usize = 3_000;

/// Set-up in which a filter of first order at 20 Hz swings.
struct Swinging {
    tool_kg: f64,
    damping_ratio: f64,
    /// It is pressed on a workpiece of 1e7 N/m; else tapped.
    on_workpiece: bool,
}

/// Runs a client that does not watch itself, against a server with the budget of `l2.toml`. Returns
/// the ticks from the load to the end, its cause, and the largest displacement of the tool, um.
fn swings(set_up: &Swinging) -> (usize, Option<Cause>, f64) {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.sensor.filter = Some(FilterKey::FirstOrder);
    robot.sensor.cutoff_hz = 20.0;
    robot.sensor.tare_samples = 50;
    robot.sensor.tool.weight_n = [0.0, 0.0, -set_up.tool_kg * GRAVITY_M_PER_S2];
    robot.client.leave_on_oscillation = false;
    let masses = robot.masses.as_mut().unwrap();
    masses.tool.mass_kg = set_up.tool_kg;
    masses.damping_ratio = set_up.damping_ratio;
    let (mut hand, tool) = load_generator();
    let mut machine =
        SimulatedMachine::<3, L2_MOTORS>::moving_from_robot(&robot, tool, Motion::Hold).unwrap();
    if set_up.on_workpiece {
        let home_m = &robot.simulation.home_m;
        machine = machine.above(Workpiece::below(home_m, 1e7, 0.0, true).unwrap());
    }
    let cycle = client_session::cycle::<_, 3, L2_MOTORS, _>(&robot, machine);
    let mut obtaining = 0;
    let controls: Arc<ClientControls> = Arc::default();
    let (_, rows) = client_session::play(robot, cycle, None, &controls, |row| {
        obtaining += usize::from(row.state.phase == Phase::Obtain);
        if obtaining > BEFORE + LONGEST {
            controls.quit.store(true, Ordering::Relaxed);
        }
        if obtaining != BEFORE {
            return;
        }
        if set_up.on_workpiece {
            hand.set(&Load {
                step: 1,
                force_n: [0.0, 0.0, -100.0],
                moment_nm: [0.0; 3],
            })
            .unwrap();
        } else {
            hand.begin(LoadPattern::Tap {
                force_n: 100.0,
                cycles: 20,
                every_cycles: u32::MAX,
            });
        }
    });
    let is_loaded = |load: [f64; 6]| load.iter().any(|part| part.abs() > 20.0);
    let loaded = rows
        .iter()
        .position(|row| is_loaded(row.tool.unwrap().load));
    let loaded = &rows[loaded.unwrap()..];
    let moved_um = loaded.iter().map(|row| {
        let [x, y, z] = row.tool.unwrap().displacement_m;
        x.hypot(y).hypot(z) * 1e6
    });
    (
        loaded.len(),
        loaded.last().unwrap().ended,
        moved_um.fold(0.0, f64::max),
    )
}

/// With the budget of 100 um/s: 0.6 s at most.
#[test]
fn a_compensation_that_swings_is_ended() {
    for (tool_kg, damping_ratio, on_workpiece) in [
        (1.835, 0.01, false),
        (5.0, 0.02, false),
        (1.835, 0.02, true),
    ] {
        let (ticks, ended, moved_um) = swings(&Swinging {
            tool_kg,
            damping_ratio,
            on_workpiece,
        });
        println!("{tool_kg} kg, {damping_ratio}: {ticks} ms, {moved_um:.0} um");
        assert_eq!(ended, Some(Cause::Agitated));
        assert!(
            ticks <= 600 && moved_um < 200.0,
            "{ticks} ms, {moved_um} um"
        );
    }
}
