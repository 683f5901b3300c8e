//! `examples/compensation.c` and core: every number agrees to the bit. Here the machines come from
//! `robots/`, there from the headers that `gantry-tau header` writes of them. Offsets agree with
//! the robot file's own compensator as well.

use std::fmt::Write as _;

use gantry_tau_core::model::compensation::{CompensatorConfig, Correction};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::sensor::{ForceSensor, Reading, SensorConfig};
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::units::{Metres, OffsetNm, PositionNm};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{CorrectionKind, RobotFile};
use gantry_tau_machine::sensor;
use gantry_tau_machine::stability::NotchFinder;
use libtest_mimic::Failed;
use nalgebra::{Matrix3, Vector3};

use super::tools::{Program, assert_lines};

/// Largest difference of an offset from that of the robot file's compensator, nm. That one applies
/// the limits where it adds the wrist's share, with a second rounding to whole nanometres.
const TOLERANCE_NM: i32 = 1;

pub(crate) fn agrees(compiler: &str, flags: &[&str]) -> Result<(), Failed> {
    let program = Program::compile("examples/compensation.c", compiler, flags)?;
    compare(&program.run(&[])?);
    Ok(())
}

/// Compares the output of the program with core.
pub(crate) fn compare(said: &str) {
    let mut here = String::new();
    three_axes(&mut here);
    six_axes(&mut here);
    sensor(&mut here);
    put(&mut here, "crossing", ["1250000 nm"]);
    assert_lines(said, &here);
    assert!(
        said.contains("l2 correction        1  -150000 nm (limit)\n"),
        "{said}"
    );
}

/// Writes numbered lines.
fn put<T: std::fmt::Display>(text: &mut String, name: &str, values: impl IntoIterator<Item = T>) {
    for (index, value) in values.into_iter().enumerate() {
        writeln!(text, "{name:<20} {index}  {value}").unwrap();
    }
}

/// Writes numbers, as their bits and rounded.
fn put_floats(text: &mut String, name: &str, values: &[f64]) {
    put(
        text,
        name,
        values
            .iter()
            .map(|value| format!("{:016x}  ({value:.9})", value.to_bits())),
    );
}

fn put_positions<const N: usize>(text: &mut String, name: &str, positions: &[PositionNm; N]) {
    put(
        text,
        name,
        positions.map(|position| format!("{} nm", position.0)),
    );
}

fn put_offsets<const N: usize>(text: &mut String, name: &str, correction: &Correction<N>) {
    let offsets = correction.offsets.iter().zip(correction.saturated);
    let offsets = offsets.map(|(offset, saturated)| {
        let cut = if saturated { " (limit)" } else { "" };
        format!("{} nm{cut}", offset.0)
    });
    put(text, name, offsets);
}

fn put_statics<const N: usize>(
    text: &mut String,
    machine: &str,
    axis: &str,
    lines: &LineMatrix<N>,
) {
    let forces = lines.link_forces_n(&load()).unwrap();
    put_floats(text, &format!("{machine} link force"), &forces);
    put_floats(
        text,
        &format!("{machine} {axis} load"),
        &lines.cart_loads(&forces),
    );
}

fn load() -> Wrench {
    Wrench::from_array([300.0, -50.0, 100.0, 1.0, 2.0, -1.0])
}

/// Positions in nm, rounded, and the q-units that they stand for.
fn rounded<const N: usize>(q: [f64; N], metres_per_q: [f64; N]) -> ([PositionNm; N], [f64; N]) {
    let positions = std::array::from_fn(|axis| {
        PositionNm::from_metres(Metres(q[axis] * metres_per_q[axis])).unwrap()
    });
    (positions, q_units(&positions, metres_per_q))
}

fn q_units<const N: usize>(positions: &[PositionNm; N], metres_per_q: [f64; N]) -> [f64; N] {
    std::array::from_fn(|axis| positions[axis].to_metres().0 / metres_per_q[axis])
}

/// Compares corrections with those of the robot file's compensator, which a client of gantry-tau
/// uses.
fn is_the_files<K: MachineKind<N>, const N: usize>(
    file: &RobotFile<K, N>,
    limits: [OffsetNm; N],
    positions: &[PositionNm; N],
    corrections: [(CorrectionKind, &Correction<N>); 2],
) {
    for (kind, correction) in corrections {
        let mut file = file.clone();
        file.client.correction = Some(kind);
        let mut compensator = file.compensator(limits).unwrap();
        let pose = compensator.locate(positions).unwrap();
        let theirs = compensator.correct(&pose, positions, &load()).unwrap();
        assert_eq!(theirs.saturated, correction.saturated, "{kind:?}");
        for (ours, theirs) in correction.offsets.iter().zip(theirs.offsets) {
            assert!(
                (ours.0 - theirs.0).abs() <= TOLERANCE_NM,
                "{kind:?}: {ours:?} {theirs:?}"
            );
        }
    }
}

/// The machine of `robots/l2.toml`, first order and exact.
fn three_axes(text: &mut String) {
    let file = RobotFile::builtin_l2().unwrap();
    let robot: l2::Robot = *file.model.robot();
    let nominal = l2::Kinematics::new(&robot, &Matrix3::identity()).unwrap();
    let tcp_m = Vector3::new(0.0, 0.5, 0.65);
    let (positions, q) = rounded(nominal.inverse_in_assembly(&tcp_m).unwrap(), [1.0; 3]);
    let pose = Pose::at(nominal.forward(&q).unwrap());
    put_positions(text, "l2 positions", &positions);
    put_floats(text, "l2 tcp", pose.position_m.as_slice());
    put_floats(
        text,
        "l2 jacobian",
        nominal.jacobian(&tcp_m).unwrap().transpose().as_slice(),
    );
    put_statics(
        text,
        "l2",
        "cart",
        &robot.line_matrix(&Pose::at(tcp_m), &q).unwrap(),
    );

    let limits = [2_000_000, 150_000, 2_000_000].map(OffsetNm);
    let config = CompensatorConfig {
        gain: file.client.gain,
        limits,
        metres_per_q: file.metres_per_q,
    };
    let compensator =
        l2::Compensator::new(&nominal, file.compliances.as_ref().unwrap(), config).unwrap();
    let first_order = compensator.correct(&positions, &load()).unwrap();
    put_offsets(text, "l2 correction", &first_order);
    let exact = compensator.correct_exact_at(&pose, &q, &load()).unwrap();
    put_offsets(text, "l2 exact", &exact);
    let corrections = [
        (CorrectionKind::FirstOrder, &first_order),
        (CorrectionKind::Exact, &exact),
    ];
    is_the_files(&file, limits, &positions, corrections);
}

/// The machine of `robots/f1.toml`, turned by 0.1 rad about z; three cycles of a tracker, and
/// compensation by the same one.
fn six_axes(text: &mut String) {
    let file = RobotFile::builtin_f1().unwrap();
    let (kinematics, metres_per_q) = (file.model, file.metres_per_q);
    let (sine, cosine) = (0.09983341664682815, 0.995_004_165_278_025_8);
    let pose = Pose {
        position_m: Vector3::new(0.05, 0.02, 0.45),
        rotation: Matrix3::new(cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0),
    };
    let solved = kinematics.inverse(&pose, None).unwrap();
    assert!(solved.iterations > 0, "a pose that takes some work");
    let (mut positions, _) = rounded(solved.value, metres_per_q);
    put(text, "f1 iterations", [solved.iterations]);
    put_positions(text, "f1 positions", &positions);
    let mut tracker = f1::PoseTracker::default();
    for cycle in 0..3 {
        positions[0].0 += 500_000;
        let tracked = tracker
            .track(&kinematics, &q_units(&positions, metres_per_q))
            .unwrap();
        writeln!(text, "{:<20} {cycle}  {}", "f1 tracked", tracked.iterations).unwrap();
        put_floats(text, "f1 position", tracked.value.position_m.as_slice());
    }
    let pose = tracker.last.unwrap();
    let [_, _, _, q4, q5, q6] = q_units(&positions, metres_per_q);
    let (positions, q) = rounded(
        kinematics.inverse(&pose, Some([q4, q5, q6])).unwrap().value,
        metres_per_q,
    );
    put_positions(text, "f1 positions", &positions);
    let lines = kinematics.line_matrix(&pose, &q).unwrap();
    put_floats(
        text,
        "f1 jacobian",
        lines.jacobian().unwrap().transpose().as_slice(),
    );
    put_statics(text, "f1", "axis", &lines);

    let limits = file.limits.map(|axis| OffsetNm(axis.limits.position.max()));
    let config = CompensatorConfig {
        gain: file.client.gain,
        limits,
        metres_per_q,
    };
    let compensator =
        f1::Compensator::new(&kinematics, file.compliances.as_ref().unwrap(), config).unwrap();
    let first_order = compensator
        .correct_at(&tracker.track(&kinematics, &q).unwrap().value, &q, &load())
        .unwrap();
    put_offsets(text, "f1 correction", &first_order);
    let exact = compensator
        .correct_exact_at(&tracker.track(&kinematics, &q).unwrap().value, &q, &load())
        .unwrap();
    put_offsets(text, "f1 exact", &exact);
    let corrections = [
        (CorrectionKind::FirstOrder, &first_order),
        (CorrectionKind::Exact, &exact),
    ];
    is_the_files(&file, limits, &positions, corrections);
}

/// Two samples of tare, then 48 of the load.
fn sensor(text: &mut String) {
    let robot = RobotFile::builtin_l2().unwrap();
    let mut sensor = ForceSensor::new(SensorConfig {
        tare_samples: 2,
        ..sensor::config(&robot)
    })
    .unwrap();
    let home = Pose::at(robot.home_m());
    let finder = NotchFinder::of(&robot).unwrap();
    let notches = finder.at(&home, &robot.home_q().unwrap()).unwrap();
    sensor.set_notches(&notches).unwrap();
    let mut load = Wrench::zero();
    for sample in 0..50 {
        let force = if sample < 2 { 1.0 } else { 11.0 };
        let raw = Wrench::from_array([force, 2.0, 3.0, 0.0, 0.0, 0.0]);
        if let Reading::Load(wrench) = sensor.update(&raw, &Matrix3::identity()).unwrap() {
            load = wrench;
        }
    }
    put_floats(text, "sensor force", load.force_n.as_slice());
    put_floats(text, "sensor moment", load.moment_nm.as_slice());
}
