//! `examples/compensation.c` and core: every number agrees to the bit. The machines come from `robots/`, which shows that the example's
//! are the same.

use std::collections::BTreeMap;

use gantry_tau::robot_file::RobotFile;
use gantry_tau_core::model::compensation::{CompensatorConfig, Correction};
use gantry_tau_core::model::kinematics::{Pose, WARM_ITERATIONS};
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::sensor::{ForceSensor, Reading, SensorConfig};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2, presets};
use gantry_tau_core::units::OffsetNm;
use libtest_mimic::Failed;
use nalgebra::{Matrix3, Vector3};

use super::tools::Program;

/// Texts of the numbers of each name, in order.
pub(crate) type Numbers = BTreeMap<String, Vec<String>>;

pub(crate) fn agrees(compiler: &str, flags: &[&str]) -> Result<(), Failed> {
    let program = Program::compile("examples/compensation.c", compiler, flags)?;
    compare(&program.run(&[])?);
    Ok(())
}

/// Compares the output of the program with core.
pub(crate) fn compare(said: &str) {
    let mut there = Numbers::new();
    for line in said.lines() {
        let (name, rest) = line.split_at(20);
        let number = rest.split_whitespace().nth(1).unwrap();
        there.entry(name.trim().to_owned()).or_default().push(number.to_owned());
    }
    let mut here = Numbers::new();
    three_axes(&mut here);
    six_axes(&mut here);
    sensor(&mut here);
    here.insert("crossing".to_owned(), vec!["1250000".to_owned()]);
    for (name, here) in &here {
        assert_eq!(there.get(name), Some(here), "{name}");
    }
    assert_eq!(there.len(), here.len());
    assert!(said.contains("l2 correction        1  -150000 nm (limit)\n"), "{said}");
}

/// A number as its bits.
fn float(value: f64) -> String {
    format!("{:016x}", value.to_bits())
}

fn put(numbers: &mut Numbers, name: &str, values: &[f64]) {
    let texts = values.iter().map(|value| float(*value)).collect();
    numbers.insert(name.to_owned(), texts);
}

fn put_offsets<const N: usize>(numbers: &mut Numbers, name: &str, correction: &Correction<N>) {
    let texts = correction.offsets.iter().map(|offset| offset.0.to_string());
    numbers.insert(name.to_owned(), texts.collect());
}

fn load() -> Wrench {
    Wrench::from_array([300.0, -50.0, 100.0, 1.0, 2.0, -1.0])
}

/// The machine of `robots/l2.toml`, first order and exact.
fn three_axes(numbers: &mut Numbers) {
    let robot: l2::Robot = *RobotFile::builtin_l2().unwrap().model.robot();
    let nominal = l2::Kinematics::new(&robot, &Matrix3::identity()).unwrap();
    let tcp_m = Vector3::new(0.0, 0.5, 0.65);
    let q = nominal.inverse_in_assembly(&tcp_m).unwrap();
    let jacobian = nominal.jacobian(&tcp_m).unwrap();
    let lines = robot.line_matrix(&Pose::at(tcp_m), &q).unwrap();
    let forces = lines.link_forces_n(&load()).unwrap();
    put(numbers, "l2 q", &q);
    put(numbers, "l2 tcp", nominal.forward(&q).unwrap().as_slice());
    put(numbers, "l2 jacobian", jacobian.transpose().as_slice());
    put(numbers, "l2 link force", &forces);
    put(numbers, "l2 cart load", &lines.cart_loads(&forces));

    let springs = presets::l2_compliances();
    let config =
        CompensatorConfig { gain: 1.0, limits: [2_000_000, 150_000, 2_000_000].map(OffsetNm), metres_per_q: [1.0; 3] };
    let compensator = l2::Compensator::new(&nominal, &springs, config).unwrap();
    let pose = Pose::at(nominal.forward(&q).unwrap());
    put_offsets(numbers, "l2 correction", &compensator.correct_q(&q, &load()).unwrap());
    put_offsets(numbers, "l2 exact", &compensator.correct_exact_at(&pose, &q, &load()).unwrap());
}

/// The machine of `robots/f1.toml`, turned by 0.1 rad about z.
fn six_axes(numbers: &mut Numbers) {
    let kinematics = RobotFile::builtin_f1().unwrap().model;
    let (sine, cosine) = (0.09983341664682815, 0.995_004_165_278_025_8);
    let pose = Pose {
        position_m: Vector3::new(0.05, 0.02, 0.45),
        rotation: Matrix3::new(cosine, -sine, 0.0, sine, cosine, 0.0, 0.0, 0.0, 1.0),
    };
    let solved = kinematics.inverse(&pose, None).unwrap();
    let q = solved.value;
    let back = kinematics.forward_from(&q, &pose, WARM_ITERATIONS).unwrap();
    let lines = kinematics.line_matrix(&pose, &q).unwrap();
    let forces = lines.link_forces_n(&load()).unwrap();
    assert!(solved.iterations > 0, "a pose that takes some work");
    numbers.insert("f1 iterations".to_owned(), vec![solved.iterations.to_string()]);
    put(numbers, "f1 q", &q);
    put(numbers, "f1 position", back.value.position_m.as_slice());
    put(numbers, "f1 jacobian", lines.jacobian().unwrap().transpose().as_slice());
    put(numbers, "f1 link force", &forces);
    put(numbers, "f1 axis load", &lines.cart_loads(&forces));

    let links = *presets::f1_compliances().link_m_per_n();
    let springs = Compliances::new(links, [4.0e-6, 5.0e-6, 6.0e-6, 2.0e-6, 2.0e-6, 2.0e-6]).unwrap();
    let config = CompensatorConfig {
        gain: 1.0,
        limits: [OffsetNm(5_000_000); 6],
        metres_per_q: [1.0, 1.0, 1.0, 0.05, 0.05, 0.05],
    };
    let compensator = f1::Compensator::new(&kinematics, &springs, config).unwrap();
    let first_order = compensator.correct_at(&pose, &q, &load()).unwrap();
    let exact = compensator.correct_exact_at(&pose, &q, &load()).unwrap();
    put_offsets(numbers, "f1 correction", &first_order);
    put_offsets(numbers, "f1 exact", &exact);
}

/// Two samples of tare, then 48 of the load.
fn sensor(numbers: &mut Numbers) {
    let mut sensor = ForceSensor::new(SensorConfig {
        rotation: Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        lever_m: Vector3::new(0.0, 0.0, -0.08),
        cutoff_hz: 20.0,
        cycle_s: 1e-3,
        tare_samples: 2,
    })
    .unwrap();
    let mut load = Wrench::zero();
    for sample in 0..50 {
        let force = if sample < 2 { 1.0 } else { 11.0 };
        let raw = Wrench::from_array([force, 2.0, 3.0, 0.0, 0.0, 0.0]);
        if let Reading::Load(wrench) = sensor.update(&raw).unwrap() {
            load = wrench;
        }
    }
    put(numbers, "sensor force", load.force_n.as_slice());
    put(numbers, "sensor moment", load.moment_nm.as_slice());
}
