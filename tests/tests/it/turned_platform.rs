//! The F1 with its platform turned: the sensor turns along, so that weight and load are distinguished
//! as well as unturned.

use gantry_tau::compensated_machine::CompensatedMachine;
use gantry_tau_core::model::f1::AXES;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_machine::model::{F1, F1_MOTORS};
use gantry_tau_machine::robot_file::{RobotFile, ToolKeys};
use gantry_tau_server::plant::ToolReading;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_sim::load_generator::{Load, LoadGenerator, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;
use nalgebra::Vector3;

/// Ticks after which drives, filter and platform are at rest: the filter is within 5 % after 183.
const SETTLED: u32 = 1_000;
/// Ticks of the way to the turned pose.
const WAY: u32 = 6_000;

/// A simulated F1, its client, and the hand that pulls at the tool.
struct Bench {
    machine: CompensatedMachine<AXES, F1_MOTORS>,
    hand: LoadGenerator,
}

/// 5 kg, 15 cm below the tool centre point.
const TOOL: ToolKeys = ToolKeys {
    weight_n: [0.0, 0.0, -49.05],
    centre_m: [0.03, -0.02, -0.15],
};

/// The machine of `robots/f1.toml` with exact springs, ideal drives, no play, hardly any noise, and
/// a tool of 5 kg.
fn robot() -> RobotFile<F1, AXES> {
    let mut robot = RobotFile::builtin_f1().unwrap();
    robot.sensor.tool = TOOL;
    robot.drives = None;
    robot.simulation.spring_deviation = 0.0;
    robot.simulation.jump_gap_m = 0.0;
    (
        robot.simulation.force_noise_n,
        robot.simulation.moment_noise_nm,
    ) = (1e-6, 1e-6);
    robot
}

/// Positions of the axes at home with the platform turned like this, metres.
fn turned(robot: &RobotFile<F1, AXES>, [yaw, tilt]: [f64; 2]) -> [f64; AXES] {
    let [yaw, tilt] = [Vector3::z() * yaw, Vector3::y() * tilt]
        .map(|vector| rotation_from_vector(&vector).unwrap());
    let pose = Pose {
        position_m: robot.simulation.home_m.into(),
        rotation: yaw * tilt,
    };
    let q = robot.model.inverse_in_assembly(&pose, None).unwrap().value;
    std::array::from_fn(|axis| q[axis] * robot.metres_per_q[axis])
}

impl Bench {
    /// Tares at home with the platform unturned, and goes to the turned pose. The client takes the
    /// tool for `known`.
    fn in_pose(turn: [f64; 2], known: ToolKeys, gain: f64) -> Self {
        let robot = robot();
        let motion = Motion::BackAndForth {
            waypoints_m: vec![turned(&robot, turn)],
            speed_m_per_s: 0.2,
            acceleration_m_per_s2: 1.0,
            dwell_cycles: 10_000,
        };
        let (hand, applied) = load_generator();
        let machine = SimulatedMachine::from_robot(&robot, applied, motion).unwrap();
        let mut client = robot;
        client.sensor.tool = known;
        client.client.gain = gain;
        let mut bench = Self {
            machine: CompensatedMachine::new(machine, &client).unwrap(),
            hand,
        };
        bench.run(10_000 + WAY);
        bench
    }

    /// Runs cycles; returns what the instruments show in the last.
    fn run(&mut self, cycles: u32) -> ToolReading {
        let mut shown = None;
        for _ in 0..cycles {
            let (tool, offsets) = self.machine.read().unwrap();
            self.machine.write(&offsets).unwrap();
            shown = Some(tool);
        }
        shown.unwrap()
    }

    /// Pulls at the tool with 300 N.
    fn pull(&mut self) -> ToolReading {
        self.hand
            .set(&Load {
                step: 1,
                force_n: [300.0, 0.0, 0.0],
                moment_nm: [0.0; 3],
            })
            .unwrap();
        self.run(SETTLED)
    }
}

fn length_m(reading: &ToolReading) -> f64 {
    Vector3::from(reading.displacement_m).norm()
}

/// Yaw and tilt, radians.
const TURNS: [[f64; 2]; 2] = [[0.0, 0.0], [0.3, 0.3]];

#[test]
fn a_turned_platform_is_held_as_well_as_an_unturned_one() {
    for turn in TURNS {
        let held = Bench::in_pose(turn, TOOL, 1.0).pull();
        let given_way = Bench::in_pose(turn, TOOL, 0.0).pull();
        // To first order; what remains grows with the square of the load.
        let share = length_m(&held) / length_m(&given_way);
        assert!(share < 0.002, "{turn:?}: {share}, {held:?} {given_way:?}");
        assert!(length_m(&given_way) > 1e-3);
    }
}

#[test]
fn a_tool_that_is_known_weighs_nothing_in_any_pose() {
    for turn in TURNS {
        let mut bench = Bench::in_pose(turn, TOOL, 1.0);
        let idle = bench.run(SETTLED);
        let load = bench.machine.load();
        assert!(
            load.to_array()
                .iter()
                .all(|component| component.abs() < 1e-5),
            "{turn:?}: {load:?}"
        );
        assert!(length_m(&idle) < 2e-9, "{turn:?}: {idle:?}");
    }
}

/// Its weight is part of the tare then, and comes back as a load where the platform turns; the page
/// of the robot files says so.
#[test]
fn a_tool_that_is_not_known_comes_back_as_a_load() {
    let displaced =
        TURNS.map(|turn| length_m(&Bench::in_pose(turn, ToolKeys::default(), 1.0).run(SETTLED)));
    assert!(displaced[0] < 2e-9 && displaced[1] > 50e-6, "{displaced:?}");
}
