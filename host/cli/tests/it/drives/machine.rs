//! Drives that stop by themselves behind a server.

use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::message::{Capabilities, Cause, Phase};
use gantry_tau_core::units::{EpochRange, TorquePermille, VelocityUmS};
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS};
use gantry_tau_machine::robot_file::AnyRobotFile;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{DriveState, Plant, PlantError, Reading};
use gantry_tau_server::record::EventKind;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_server::server::event_log::EventLog;
use gantry_tau_server::state::StopLatch;
use gantry_tau_sim::load_generator::{Load, LoadGenerator, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;

use super::{F1, L2, without_drives};
use crate::process::Folder;

/// Exact measurements at once, so that what the drive sees can be counted.
const DRIVES: &str = "[drives]\ncommand_delay_cycles = 0\nactual_delay_cycles = 0\n\n[simulation]";

type L2Cycle = Cycle<3, L2_MOTORS, SimulatedMachine<3, L2_MOTORS>>;

fn walking<const N: usize>(home_m: [f64; N], by_m: f64) -> Motion<N> {
    Motion::BackAndForth {
        waypoints_m: vec![home_m.map(|metres| metres + by_m)],
        speed_m_per_s: 0.1,
        acceleration_m_per_s2: 2.0,
        dwell_cycles: 200,
    }
}

/// A server of the L2 in motion, and the hand on its tool.
fn server() -> (L2Cycle, LoadGenerator) {
    let text = L2.replacen("[simulation]", DRIVES, 1);
    let AnyRobotFile::L2(robot) = AnyRobotFile::parse("x.toml", &text).unwrap() else {
        panic!("an L2")
    };
    let (hand, tool) = load_generator();
    let home_m = robot.home_q().unwrap();
    let machine = SimulatedMachine::from_robot(&robot, tool, walking(home_m, 0.02)).unwrap();
    let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
    let (motors, listen) = (robot.motor_map().unwrap(), ([127, 0, 0, 1], 0));
    let listen = std::net::SocketAddr::from(listen);
    (
        Cycle::new(
            config,
            motors,
            machine,
            EpochRange::VOLATILE,
            StopLatch::volatile(),
            listen,
        )
        .unwrap(),
        hand,
    )
}

fn pull(newtons: f64) -> Load {
    Load {
        step: 1,
        force_n: [newtons, 0.0, 0.0],
        moment_nm: [0.0; 3],
    }
}

/// A force in x that loads the strongest axis with 4 kN, and that axis.
fn overload() -> (f64, usize) {
    let (mut server, mut hand) = server();
    hand.set(&pull(100.0)).unwrap();
    let mut row = None;
    for _ in 0..150 {
        row = Some(server.step(1, OperatorInputs::default()));
    }
    let torques = row.unwrap().state.axes.map(|axis| axis.actual.torque.0);
    let (axis, torque) = torques
        .iter()
        .enumerate()
        .max_by_key(|(_, torque)| torque.abs())
        .unwrap();
    assert!(torque.abs() > 20, "{torques:?}");
    (100.0 * 4_000.0 / f64::from(torque.abs()), axis)
}

/// No reference moves by more than the path does, 0.1 mm per tick, from one row to the next.
fn assert_no_step(rows: &[TickRecord<3>]) {
    for pair in rows.windows(2) {
        for axis in 0..3 {
            let step = pair[1].references[axis].position.0 - pair[0].references[axis].position.0;
            assert!(
                step.abs() <= 100_002,
                "tick {}: {step} nm",
                pair[1].state.tick.0
            );
        }
    }
}

/// Distance of an axis from its reference.
fn off_nm(row: &TickRecord<3>, axis: usize) -> i64 {
    (row.references[axis].position.0 - row.state.axes[axis].actual.position.0).abs()
}

#[test]
fn an_overload_trips_the_drive_and_only_a_reset_brings_it_back() {
    let (force_n, axis) = overload();
    let (mut server, mut hand) = server();
    let mut rows = Vec::new();
    rows.extend((0..230).map(|_| server.step(1, OperatorInputs::default())));
    assert!(
        rows.iter()
            .all(|row| !row.plant_failed && row.state.phase == Phase::Listening)
    );
    assert_eq!(
        rows.last().unwrap().drives,
        Some([DriveState::Operating; 3])
    );
    hand.set(&pull(force_n)).unwrap();
    rows.extend((0..50).map(|_| server.step(1, OperatorInputs::default())));
    hand.release();
    rows.extend((0..300).map(|_| server.step(1, OperatorInputs::default())));

    let failed = rows.iter().position(|row| row.plant_failed).unwrap();
    assert_eq!(
        (rows[failed].state.phase, rows[failed].ended),
        (Phase::Fault, Some(Cause::Stop))
    );
    let reason = rows[failed].failure.unwrap();
    assert!(reason.to_string().contains("following error"), "{reason}");
    // The tenth measurement outside is that of the tick that fails, which was not read.
    let outside = rows[..failed]
        .iter()
        .rev()
        .take_while(|row| off_nm(row, axis) > 1_900_000)
        .count();
    assert!((9..=11).contains(&outside), "{outside} cycles outside");
    assert_eq!(rows[failed].drives.unwrap()[axis], DriveState::QuickStop);
    assert!(
        rows[failed..]
            .iter()
            .all(|row| row.plant_failed && row.state.phase == Phase::Fault)
    );
    assert_eq!(
        rows.last().unwrap().drives.unwrap()[axis],
        DriveState::Fault
    );

    let mut log = EventLog::default();
    let told: Vec<_> = rows
        .iter()
        .flat_map(|row| log.see(row))
        .filter(|e| e.kind == EventKind::MachineFailed)
        .collect();
    assert_eq!(told.len(), 1);
    let expected = format!("axis {}: quick stop", axis + 1);
    assert!(
        told[0].text.contains("following error") && told[0].text.contains(&expected),
        "{}",
        told[0].text
    );

    // A stop that is held keeps the drives from their reset.
    let mut again = Vec::new();
    again.extend((0..50).map(|_| {
        server.step(
            1,
            OperatorInputs {
                stop: true,
                rearm: true,
                ..OperatorInputs::default()
            },
        )
    }));
    assert!(
        again
            .iter()
            .all(|row| row.drives.unwrap()[axis] == DriveState::Fault)
    );
    again.push(server.step(1, OperatorInputs::default()));
    let listening = (0..10_000).find(|_| {
        let row = server.step(
            1,
            OperatorInputs {
                stop: false,
                rearm: true,
                ..OperatorInputs::default()
            },
        );
        again.push(row);
        row.state.phase == Phase::Listening
    });
    assert!(listening.is_some(), "{:?}", again.last());
    assert!(
        again
            .iter()
            .any(|row| row.drives.unwrap()[axis] == DriveState::NotReady)
    );
    again.extend((0..300).map(|_| server.step(1, OperatorInputs::default())));
    let last = again.last().unwrap();
    assert_eq!(
        (last.state.phase, last.plant_failed),
        (Phase::Listening, false)
    );
    assert_eq!(last.drives, Some([DriveState::Operating; 3]));
    let off_nm = off_nm(last, axis);
    assert!(off_nm < 150_000, "{off_nm} nm");
    let all: Vec<TickRecord<3>> = rows.into_iter().chain(again).collect();
    assert_no_step(&all);
}

/// A server that skips four cycles has written nothing for three: the drives have stopped.
#[test]
fn a_server_that_is_late_finds_its_drives_stopped() {
    let (mut punctual, _hand) = server();
    let (mut late, _other) = server();
    for _ in 0..300 {
        punctual.step(1, OperatorInputs::default());
        late.step(1, OperatorInputs::default());
    }
    let row = punctual.step(3, OperatorInputs::default());
    assert!(!row.plant_failed, "{row:?}");
    let row = late.step(4, OperatorInputs::default());
    assert!(
        row.plant_failed && row.drives == Some([DriveState::QuickStop; 3]),
        "{row:?}"
    );
    assert!(
        row.failure
            .unwrap()
            .to_string()
            .contains("drives.watchdog_cycles")
    );
}

/// The second motor of a pair is led away: its drive stops first, the other one because of it, and
/// the reason is that of the first.
#[test]
fn the_reason_of_a_pair_is_that_of_the_drive_that_stopped_first() {
    let text = without_drives(F1).replacen("[simulation]", DRIVES, 1);
    let AnyRobotFile::F1(robot) = AnyRobotFile::parse("x.toml", &text).unwrap() else {
        panic!("an F1")
    };
    let (_hand, tool) = load_generator();
    let mut machine: SimulatedMachine<6, F1_MOTORS> =
        SimulatedMachine::from_robot(&robot, tool, Motion::Hold).unwrap();
    let map = robot.motor_map::<F1_MOTORS>().unwrap();
    let axis_of_motor = map.axis_of_motor();
    let second = (1..F1_MOTORS)
        .find(|motor| axis_of_motor[..*motor].contains(&axis_of_motor[*motor]))
        .unwrap();
    let parts = machine.in_force().unwrap();
    let mut failure = None;
    for cycle in 0..200 {
        if let Err(error) = machine.read(1) {
            failure = Some(error);
            break;
        }
        let mut references = axis_of_motor.map(|axis| Reference {
            position: parts[axis].nominal,
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        });
        if cycle > 20 {
            references[second].position.0 += 50_000_000;
        }
        machine.write(&references, &parts).unwrap();
    }
    let said = failure.unwrap().to_string();
    assert!(
        said.contains("following error") && !said.contains("another drive"),
        "{said}"
    );
    let stopped = machine.drives().unwrap()[axis_of_motor[second]];
    assert_eq!(stopped, DriveState::QuickStop);
}

/// The machine, and a check of what it is written.
struct Watched(SimulatedMachine<6, F1_MOTORS>, [usize; F1_MOTORS]);

impl Plant<6, F1_MOTORS> for Watched {
    type Error = PlantError;

    fn in_force(&mut self) -> Result<[InForce; 6], PlantError> {
        self.0.in_force()
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<6>, PlantError> {
        self.0.read(elapsed)
    }

    fn write(
        &mut self,
        references: &[Reference; F1_MOTORS],
        parts: &[InForce; 6],
    ) -> Result<(), PlantError> {
        for (motor, axis) in self.1.iter().enumerate() {
            let first = self.1.iter().position(|of| of == axis).unwrap();
            assert_eq!(
                references[motor], references[first],
                "motors {first} and {motor}"
            );
        }
        self.0.write(references, parts)
    }
}

/// Pairs with play and bias on the whole F1: equal references, and the tool comes back to where it
/// was from both sides.
#[test]
fn the_pairs_of_the_f1_follow_with_play_and_bias() {
    let drives =
        "[drives]\nbacklash_um = 20.0\nbias_permille = 200\nfriction_n = 30.0\n\n[simulation]";
    let text = without_drives(F1).replacen("[simulation]", drives, 1);
    let AnyRobotFile::F1(robot) = AnyRobotFile::parse("x.toml", &text).unwrap() else {
        panic!("an F1")
    };
    let (_hand, tool) = load_generator();
    let q = robot.home_q().unwrap();
    let home_m = std::array::from_fn(|axis| q[axis] * robot.metres_per_q[axis]);
    // 1 mm: the plates stay within their travel.
    let machine = SimulatedMachine::from_robot(&robot, tool, walking(home_m, 0.001)).unwrap();
    let motors = robot.motor_map().unwrap();
    let watched = Watched(machine, *motors.axis_of_motor());
    let config = robot.session_config(Capabilities::LOCKSTEP).unwrap();
    let listen = std::net::SocketAddr::from(([127, 0, 0, 1], 0));
    let mut cycle = Cycle::new(
        config,
        motors,
        watched,
        EpochRange::VOLATILE,
        StopLatch::volatile(),
        listen,
    )
    .unwrap();
    for _ in 0..1_500 {
        let row = cycle.step(1, OperatorInputs::default());
        assert!(!row.plant_failed, "{row:?}");
        for axis in &row.state.axes {
            let off = axis.nominal.0 - axis.actual.position.0;
            assert!(off.abs() < 400_000, "{off} nm");
        }
    }
}

/// Displacements of the demo at 60 N and 120 N without compensation, world axes, and what remains
/// with it; µm. Those without are the same in every run; those with contain the sensor's noise.
const GOLDEN_UM: [([f64; 3], f64); 2] = [
    ([39.001_518_781, 6.776_831_333, 4.288_049_707], 0.56),
    ([78.087_221_194, 13.576_366_579, 8.561_927_587], 1.115),
];

/// The default profile without latency, with its encoder and its supervision: every number of the
/// demo holds, within a count of the encoder.
#[test]
fn the_demo_is_as_good_with_the_default_profile() {
    let folder = Folder::new("demo_drives");
    // In equilibrium in every cycle.
    let (before, rest) = L2.split_once("[masses]").unwrap();
    let (_, simulation) = rest.split_once("[simulation]").unwrap();
    let massless = format!("{before}[simulation]{simulation}");
    folder.write("massless.toml", &massless);
    folder.write("drives.toml", &massless.replacen("[simulation]", DRIVES, 1));
    for (robot, within_um) in [("massless.toml", 1e-6), ("drives.toml", 0.01)] {
        let mut arguments = vec!["demo", "--robot", robot, "--json", "demo.json"];
        arguments.extend([
            "--pace",
            "lockstep",
            "--step-seconds",
            "1",
            "--force-max",
            "120",
        ]);
        let said = folder.run(&arguments).success();
        assert!(said.contains("All as it should be."), "{said}");
        let found: serde_json::Value = serde_json::from_str(&folder.read("demo.json")).unwrap();
        for (step, (golden_um, remaining_um)) in GOLDEN_UM.iter().enumerate() {
            let step = &found["steps"][step];
            for (axis, golden_um) in golden_um.iter().enumerate() {
                let um = step["uncompensated_um"][axis].as_f64().unwrap();
                assert!(
                    (um - golden_um).abs() < within_um,
                    "{robot}: {um} um instead of {golden_um}"
                );
            }
            let um = step["compensated_norm_um"].as_f64().unwrap();
            assert!(
                (um - remaining_um).abs() < 0.05,
                "{robot}: {um} um instead of {remaining_um}"
            );
        }
    }
}
