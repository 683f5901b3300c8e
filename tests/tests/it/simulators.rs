//! A machine in another process: what it is told and what it tells, to the nanometre, and everything
//! that it can do wrong.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gantry_tau_core::control::axis::{InForce, Offsets, Reference};
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::units::{OffsetNm, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_sim::load_generator::{Load, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_sim::remote::RemoteMachine;
use gantry_tau_system::dial::NEVER;
use gantry_tau_tests::client_session;
use gantry_tau_tests::simulator::{self, Conduct};
use serde_json::Value;

/// A machine under 300 N; equal ones do the same.
fn machine<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
) -> SimulatedMachine<N, M> {
    let (mut hand, tool) = load_generator();
    let load = Load {
        step: 0,
        force_n: [300.0, 0.0, -20.0],
        moment_nm: [0.0; 3],
    };
    hand.set(&load).unwrap();
    SimulatedMachine::moving_from_robot(robot, tool, Motion::Hold).unwrap()
}

/// The remote side of a machine that is simulated in a thread of this process.
fn remote<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    conduct: impl FnMut(&Value, &Value) -> Conduct + Send + 'static,
) -> RemoteMachine<N, M> {
    let address = simulator::spawn(machine::<K, N, M>(robot), conduct);
    RemoteMachine::connect(address.into(), robot, &NEVER).unwrap()
}

/// Parts of the references of a cycle: every unit and both signs.
fn parts<const N: usize>(from: &[InForce; N], cycle: i32) -> [InForce; N] {
    let mut axis = 0;
    from.map(|before| {
        axis += 1;
        InForce {
            nominal: PositionNm(before.nominal.0 + i64::from(axis * cycle)),
            offsets: Offsets {
                position: OffsetNm(-37 * axis * cycle),
                velocity: VelocityUmS(axis * (cycle - 50)),
                torque: TorquePermille(i16::try_from(axis - cycle).unwrap()),
            },
        }
    })
}

fn is_as_in_this_process<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
) {
    let mut here = machine::<K, N, M>(robot);
    let mut there = remote::<K, N, M>(robot, |_, _| Conduct::Answer);
    let map = robot.motor_map::<M>().unwrap();
    let start = here.in_force().unwrap();
    assert_eq!(there.in_force().unwrap(), start);
    for cycle in 1..=100 {
        let (mut one, mut other) = (here.read(1).unwrap(), there.read(1).unwrap());
        let [tool, remote] = [&mut one, &mut other].map(|reading| reading.tool.as_mut().unwrap());
        for axis in 0..3 {
            // Micrometres and back: two roundings.
            let off_m = (tool.displacement_m[axis] - remote.displacement_m[axis]).abs();
            let off_rad = (tool.turn_rad[axis] - remote.turn_rad[axis]).abs();
            assert!(off_m < 1e-18 && off_rad < 1e-18, "{off_m} {off_rad}");
        }
        // The last two are of the gauges and the load profile, which are not on the line.
        remote.displacement_m = tool.displacement_m;
        remote.turn_rad = tool.turn_rad;
        remote.gauges_m = tool.gauges_m;
        remote.step = tool.step;
        assert_eq!(one, other, "cycle {cycle}");
        assert_eq!(here.drives(), there.drives());
        let parts = parts(&start, cycle);
        let references = map.axis_of_motor().map(|axis| Reference {
            position: PositionNm(parts[axis].nominal.0 + i64::from(parts[axis].offsets.position.0)),
            velocity_offset: parts[axis].offsets.velocity,
            torque_offset: parts[axis].offsets.torque,
        });
        here.write(&references, &parts).unwrap();
        there.write(&references, &parts).unwrap();
        assert_eq!(there.in_force().unwrap(), parts);
    }
    let moved = here.read(1).unwrap().tool.unwrap().displacement_m;
    assert!(moved[0].abs() > 1e-6, "the load acts: {moved:?}");
}

#[test]
fn a_machine_in_another_process_is_as_one_in_this() {
    is_as_in_this_process::<_, ARMS, L2_MOTORS>(&RobotFile::builtin_l2().unwrap());
    is_as_in_this_process::<_, 6, F1_MOTORS>(&RobotFile::builtin_f1().unwrap());
}

/// Call of a kind that goes wrong, and how.
type Fault = fn(&Value, &Value) -> Conduct;

fn say(text: impl Into<String>) -> Conduct {
    Conduct::Say(text.into().into_bytes())
}

/// The answer with another value in the place of a field.
fn with(answer: &Value, field: &str, value: Value) -> Conduct {
    let mut answer = answer.clone();
    answer[field] = value;
    say(format!("{answer}\n"))
}

#[test]
fn a_simulator_that_does_wrong_is_a_machine_that_cannot_be_read() {
    let cases: [(&str, &str, Fault, &str); 18] = [
        (
            "read",
            "is silent",
            |_, _| Conduct::IsSilent,
            "it has not answered in time",
        ),
        (
            "read",
            "vanishes",
            |_, _| Conduct::Leaves,
            "it has closed the connection",
        ),
        (
            "write",
            "vanishes",
            |_, _| Conduct::Leaves,
            "it has closed the connection",
        ),
        (
            "read",
            "answers twice",
            |_, answer| say(format!("{answer}\n{answer}\n")),
            "it has answered twice",
        ),
        (
            "read",
            "answers another call",
            |_, answer| with(answer, "n", 3.into()),
            "it answered call 3 in place of",
        ),
        ("read", "has no number", |_, _| say("{}\n"), "no number n"),
        (
            "read",
            "says NaN",
            |call, _| {
                say(format!(
                    "{{\"n\":{},\"nominal_mm\":[NaN,0,0]}}\n",
                    call["n"]
                ))
            },
            "its answer has NaN, and JSON has finite numbers only",
        ),
        (
            "read",
            "has another number of axes",
            |_, answer| with(answer, "actual_mm", vec![0.0; 4].into()),
            "actual_mm: 4 numbers for 3 axes",
        ),
        (
            "read",
            "has a place out of range",
            |_, answer| with(answer, "nominal_mm", vec![1e300, 0.0, 0.0].into()),
            "nominal_mm: 1e300 is out of range",
        ),
        (
            "read",
            "lacks a field",
            |call, _| say(format!("{{\"n\":{}}}\n", call["n"])),
            "missing field `nominal_mm`",
        ),
        (
            "read",
            "has a field too many",
            |_, answer| with(answer, "nominal_m", vec![0.0; 3].into()),
            "unknown field `nominal_m`",
        ),
        (
            "read",
            "has drives in no state",
            |_, answer| {
                with(
                    answer,
                    "drives",
                    vec!["operating", "ready", "asleep"].into(),
                )
            },
            "drives: \"asleep\" is no state",
        ),
        (
            "read",
            "has a list in place of the tool",
            |_, answer| with(answer, "tool", vec![0.0; 3].into()),
            "tool: expected an object, not [0.0,0.0,0.0]",
        ),
        (
            "read",
            "says why",
            |_, answer| with(answer, "error", "no power".into()),
            "no power",
        ),
        (
            "read",
            "sends half a line",
            |_, _| say("{\"n\":"),
            "it has not answered in time",
        ),
        (
            "read",
            "sends a line without an end",
            |_, _| Conduct::Say(vec![b' '; 10_000_000]),
            "its answer has more than 65536 bytes",
        ),
        (
            "read",
            "sends no text",
            |_, _| Conduct::Say(vec![0xFF, b'\n']),
            "no object of JSON",
        ),
        (
            "write",
            "answers with a field",
            |_, answer| with(answer, "position_mm", 1.into()),
            "unknown field position_mm",
        ),
    ];
    for (kind, what, fault, reason) in cases {
        let robot = RobotFile::builtin_l2().unwrap();
        let calls = AtomicU64::new(0);
        let (starts, resets) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
        let counted = [Arc::clone(&starts), Arc::clone(&resets)];
        let remote = remote::<_, ARMS, L2_MOTORS>(&robot, move |call, answer| {
            for (name, count) in ["start", "reset"].iter().zip(&counted) {
                count.fetch_add(u64::from(call["call"] == *name), Ordering::Relaxed);
            }
            assert!(counted[0].load(Ordering::Relaxed) > 0, "{call}");
            let is_of_kind = call["call"] == kind;
            if is_of_kind && calls.fetch_add(1, Ordering::Relaxed) == 5 {
                fault(call, answer)
            } else {
                Conduct::Answer
            }
        });
        let mut cycle = client_session::cycle(&robot, remote);
        let row = step_until(&mut cycle, |row| row.state.phase == Phase::Fault);
        let failure = row.failure.unwrap();
        assert!(failure.as_str().contains(reason), "{what}: {failure:?}");
        let nominal = row.state.axes.map(|axis| axis.nominal);
        // It answers again once it is connected again.
        let rearmed = OperatorInputs {
            rearm: true,
            ..OperatorInputs::default()
        };
        let row = (0..4)
            .map(|_| cycle.step(1, rearmed))
            .find(|row| row.state.phase == Phase::Listening);
        let row = row.unwrap_or_else(|| panic!("{what}: not re-armed"));
        assert_eq!(row.state.axes.map(|axis| axis.nominal), nominal, "{what}");
        // Who says what failed has broken nothing, and is reset; others are connected to again.
        let [starts, resets] = [&starts, &resets].map(|count| count.load(Ordering::Relaxed));
        if what == "says why" {
            assert!(starts == 1 && resets > 0, "{what}: {starts}, {resets}");
        } else {
            assert_eq!(starts, 2, "{what}");
        }
    }
}

#[test]
fn values_in_force_as_a_list_of_axes_are_refused_by_name() {
    let robot = RobotFile::builtin_l2().unwrap();
    let mut remote = remote::<_, ARMS, L2_MOTORS>(&robot, |call, answer| {
        if call["call"] == "in_force" {
            with(
                answer,
                "axes",
                vec![serde_json::json!({"nominal_mm": 0.0}); 3].into(),
            )
        } else {
            Conduct::Answer
        }
    });
    let error = remote.in_force().unwrap_err().to_string();
    assert!(
        error.contains(r#"axes: expected an object, not [{"nominal_mm":0.0}"#),
        "{error}"
    );
}

/// Steps without an operator until a row is as wanted.
fn step_until<const N: usize, const M: usize, P: Plant<N, M>>(
    cycle: &mut Cycle<N, M, P>,
    wanted: impl Fn(&TickRecord<N>) -> bool,
) -> TickRecord<N> {
    (0..20)
        .map(|_| cycle.step(1, OperatorInputs::default()))
        .find(wanted)
        .expect("it happens within 20 ticks")
}
