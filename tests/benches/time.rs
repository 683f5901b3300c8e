//! Wall time per call, reported and not judged: `cargo bench -p gantry-tau-tests --bench time`.
#![allow(
    clippy::unwrap_used,
    clippy::arithmetic_side_effects,
    reason = "a measurement that cannot be made must stop"
)]

mod setup;

use divan::{Bencher, black_box};
use gantry_tau_core::control::axis::{InForce, Reference};
use gantry_tau_core::control::message::{ClientMessage, Mode};
use gantry_tau_core::control::wire::{Deframer, Feed, Frame, decode_client, encode_client};
use gantry_tau_core::model::kinematics::WARM_ITERATIONS;
use gantry_tau_core::units::{TorquePermille, VelocityUmS};
use gantry_tau_machine::model::{F1_MOTORS, L2_MOTORS, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::Plant;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_sim::load_generator::load_generator;
use gantry_tau_sim::machine::SimulatedMachine;

fn main() {
    divan::main();
}

#[divan::bench]
fn nominal_inverse(bencher: Bencher<'_, '_>) {
    let (nominal, tcp, _) = setup::l2();
    bencher.bench_local(|| nominal.inverse(black_box(&tcp)));
}

#[divan::bench]
fn nominal_forward(bencher: Bencher<'_, '_>) {
    let (nominal, _, q) = setup::l2();
    bencher.bench_local(|| nominal.forward(black_box(&q)));
}

#[divan::bench]
fn l2_compensation(bencher: Bencher<'_, '_>) {
    let (compensator, nominal) = setup::l2_compensator();
    let load = setup::load();
    bencher.bench_local(|| compensator.correct(black_box(&nominal), black_box(&load)));
}

#[divan::bench]
fn six_inverse(bencher: Bencher<'_, '_>) {
    let (kinematics, pose, ..) = setup::six();
    bencher.bench_local(|| kinematics.inverse(black_box(&pose), None));
}

#[divan::bench]
fn six_forward_warm(bencher: Bencher<'_, '_>) {
    let (kinematics, _, q, before) = setup::six();
    bencher.bench_local(|| {
        kinematics.forward_from(black_box(&q), black_box(&before), WARM_ITERATIONS)
    });
}

#[divan::bench]
fn six_jacobian(bencher: Bencher<'_, '_>) {
    let (kinematics, pose, q, _) = setup::six();
    bencher.bench_local(|| kinematics.jacobian(black_box(&pose), &q));
}

#[divan::bench]
fn six_compensation(bencher: Bencher<'_, '_>) {
    let (compensator, pose, q) = setup::six_compensator();
    let load = setup::load();
    bencher.bench_local(|| compensator.correct_at(black_box(&pose), &q, black_box(&load)));
}

/// One command in, one state out; the command is made and encoded, too.
#[divan::bench]
fn client_and_server_tick(bencher: Bencher<'_, '_>) {
    let mut server = setup::a_command().0;
    bencher.bench_local(|| {
        let command = server.command(Mode::Obtain);
        server.cycle(&encode_client(&ClientMessage::Command(command)));
    });
}

#[divan::bench]
fn deframe_and_decode(bencher: Bencher<'_, '_>) {
    let bytes = encode_client(&ClientMessage::Command(setup::a_command().1));
    let mut deframer = Deframer::new();
    bencher.bench_local(|| match deframer.feed(black_box(&bytes)) {
        Feed::Frame { frame, .. } => decode_client::<6>(&frame).ok(),
        Feed::Incomplete | Feed::Broken(_) => None,
    });
}

#[divan::bench]
fn parse_a_datagram(bencher: Bencher<'_, '_>) {
    let bytes = encode_client(&ClientMessage::Command(setup::a_command().1));
    bencher.bench_local(|| Frame::parse(black_box(&bytes)).is_ok());
}

/// A cycle of a machine with masses on its way: a millisecond of its time. Most cost what the median
/// says; every 5 mm its damping is found again, and those are the slowest.
fn moving_machine<K: MachineKind<N>, const N: usize, const M: usize>(
    bencher: Bencher<'_, '_>,
    robot: &RobotFile<K, N>,
) {
    let (_hand, tool) = load_generator();
    let home_q = robot.home_q().unwrap();
    let mut to_m = home_q;
    for (place, metres) in to_m.iter_mut().zip(&robot.metres_per_q) {
        *place *= metres;
    }
    to_m.iter_mut().take(3).for_each(|metres| *metres += 0.2);
    let motion = Motion::BackAndForth {
        waypoints_m: vec![to_m],
        speed_m_per_s: 0.2,
        acceleration_m_per_s2: 1.0,
        dwell_cycles: 0,
    };
    let machine = SimulatedMachine::<N, M>::moving_from_robot(robot, tool, motion);
    let (mut machine, motors) = (machine.unwrap(), robot.motor_map::<M>().unwrap());
    bencher.bench_local(|| {
        let nominal = machine.read(1).unwrap().nominal;
        let references = nominal.map(|position| Reference {
            position,
            velocity_offset: VelocityUmS(0),
            torque_offset: TorquePermille(0),
        });
        let references = motors.spread(&references).unwrap();
        machine.write(&references, &nominal.map(InForce::at))
    });
}

#[divan::bench(sample_size = 1, sample_count = 10_000)]
fn moving_l2(bencher: Bencher<'_, '_>) {
    moving_machine::<_, 3, L2_MOTORS>(bencher, &RobotFile::builtin_l2().unwrap());
}

#[divan::bench(sample_size = 1, sample_count = 10_000)]
fn moving_f1(bencher: Bencher<'_, '_>) {
    moving_machine::<_, 6, F1_MOTORS>(bencher, &RobotFile::builtin_f1().unwrap());
}
