//! A machine in another process: what it is told and what it tells, to the nanometre, and everything
//! that it can do wrong.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gantry_tau_client::ClientControls;
use gantry_tau_core::control::message::Phase;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::record::TickRecord;
use gantry_tau_server::server::cycle::{Cycle, OperatorInputs};
use gantry_tau_sim::load_generator::{Load, LoadGenerator, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;
use gantry_tau_sim::remote::RemoteMachine;
use gantry_tau_system::dial::NEVER;
use gantry_tau_tests::client_session;
use gantry_tau_tests::simulator::{self, Conduct};
use serde_json::Value;

/// Rows of Obtain before the load acts, and with it.
const BEFORE: usize = 50;
const LOADED: usize = 300;

fn machine<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
) -> (LoadGenerator, SimulatedMachine<N, M>) {
    let (hand, tool) = load_generator();
    let machine = SimulatedMachine::moving_from_robot(robot, tool, Motion::Hold).unwrap();
    (hand, machine)
}

/// The remote side of a machine that is simulated in a thread of this process.
fn remote<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: &RobotFile<K, N>,
    conduct: impl FnMut(&Value, &Value) -> Conduct + Send + 'static,
) -> (LoadGenerator, RemoteMachine<N, M>) {
    let (hand, machine) = machine::<K, N, M>(robot);
    let address = simulator::spawn(machine, conduct);
    let remote = RemoteMachine::connect(address.into(), robot, &NEVER).unwrap();
    (hand, remote)
}

/// Rows of a session in which the real client compensates a load of 300 N.
fn compensated<K: MachineKind<N>, const N: usize, const M: usize, P>(
    robot: RobotFile<K, N>,
    (mut hand, machine): (LoadGenerator, P),
) -> Vec<TickRecord<N>>
where
    P: Plant<N, M> + 'static,
{
    let cycle = client_session::cycle::<_, N, M, _>(&robot, machine);
    let mut obtaining = 0;
    let controls: Arc<ClientControls> = Arc::default();
    let (report, rows) = client_session::play(robot, cycle, None, &controls, |row| {
        obtaining += usize::from(row.state.phase == Phase::Obtain);
        if obtaining == BEFORE {
            hand.set(&Load {
                step: 1,
                force_n: [300.0, 0.0, 0.0],
                moment_nm: [0.0; 3],
            })
            .unwrap();
        }
        if obtaining == BEFORE + LOADED {
            controls.quit.store(true, Ordering::Relaxed);
        }
    });
    report.unwrap();
    rows
}

/// From the row on in which the load acts: offsets of the axes, nm, and displacement of the tool, m.
fn under_load<const N: usize>(rows: &[TickRecord<N>]) -> Vec<([i32; N], [f64; 3])> {
    let is_loaded = |row: &TickRecord<N>| row.tool.unwrap().load.iter().any(|part| *part != 0.0);
    let first = rows.iter().position(is_loaded).unwrap();
    let rows = rows[first..].iter();
    rows.take_while(|row| row.state.phase == Phase::Obtain)
        .map(|row| {
            let offsets = row.state.axes.map(|axis| axis.offsets.position.0);
            (offsets, row.tool.unwrap().displacement_m)
        })
        .take(LOADED / 2)
        .collect()
}

fn is_as_in_this_process<K: MachineKind<N>, const N: usize, const M: usize>(
    robot: impl Fn() -> RobotFile<K, N>,
) {
    let mut prepared = robot();
    prepared.sensor.tare_samples = 50;
    // Sessions begin in any tick, and noise goes with the ticks; so does what still swings.
    prepared.masses = None;
    prepared.simulation.force_noise_n = 0.0;
    prepared.simulation.moment_noise_nm = 0.0;
    let here = compensated::<_, N, M, _>(prepared.clone(), machine::<_, N, M>(&prepared));
    let there = compensated::<_, N, M, _>(
        prepared.clone(),
        remote::<_, N, M>(&prepared, |_, _| Conduct::Answer),
    );
    let (here, there) = (under_load(&here), under_load(&there));
    assert_eq!(here.len(), LOADED / 2);
    assert!(here.last().unwrap().0.iter().any(|nm| nm.abs() > 10_000));
    for (here, there) in here.iter().zip(&there) {
        // Drives come to rest from their start, which is another tick, to nanometres.
        let differs = |axis: usize| (here.0[axis] - there.0[axis]).abs() > 2;
        assert!(!(0..N).any(differs), "offsets, nm: {here:?} {there:?}");
        let off = (0..3).map(|axis| (here.1[axis] - there.1[axis]).abs());
        let off = off.fold(0.0, f64::max);
        assert!(off < 5e-9, "displacement: {off:e} m");
    }
    assert_eq!(here.len(), there.len());
}

#[test]
fn a_machine_in_another_process_is_as_one_in_this() {
    is_as_in_this_process::<_, ARMS, L2_MOTORS>(|| RobotFile::builtin_l2().unwrap());
    is_as_in_this_process::<_, 6, F1_MOTORS>(|| RobotFile::builtin_f1().unwrap());
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
    let cases: [(&str, &str, Fault, &str); 17] = [
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
            "no object of JSON",
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
        let mut has_started = false;
        let (_hand, remote) = remote::<_, ARMS, L2_MOTORS>(&robot, move |call, answer| {
            has_started |= call["call"] == "start";
            assert!(has_started, "{call}");
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
    }
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
