//! Core's presets against the oracle vectors, where `solve` does not say it: `solve_vectors` asks
//! everything else.

use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2, presets};
use gantry_tau_core::units::OffsetNm;
use nalgebra::{Matrix3, Vector3, Vector6};
use serde_json::Value;

/// One case of the vectors.
struct Case(Value);

pub(crate) fn vectors() -> Value {
    serde_json::from_str(include_str!("../../data/tau_vectors.json")).unwrap()
}

/// A machine of the vectors as `solve` takes it in a request, and its cases.
pub(crate) fn machine(model: &str) -> (Value, Vec<Value>) {
    let vectors = vectors();
    let mut robot = vectors[model].clone();
    let cases = robot["cases"].take().as_array().unwrap().clone();
    assert_eq!(cases.len(), 10);
    robot.as_object_mut().unwrap().remove("cases");
    robot["model"] = model.into();
    robot["c_link"] = vectors["c_link"].clone();
    (robot, cases)
}

/// The numbers of nested arrays, in their order.
pub(crate) fn flatten(value: &Value) -> Vec<f64> {
    match value.as_array() {
        Some(list) => list.iter().flat_map(flatten).collect(),
        None => vec![value.as_f64().unwrap()],
    }
}

fn numbers<const K: usize>(value: &Value) -> [f64; K] {
    flatten(value).try_into().unwrap()
}

impl Case {
    fn all(model: &str) -> Vec<Self> {
        machine(model).1.into_iter().map(Self).collect()
    }

    /// The numbers of a field, a matrix by rows.
    fn get<const K: usize>(&self, field: &str) -> [f64; K] {
        numbers(&self.0[field])
    }

    fn tcp(&self) -> Vector3<f64> {
        self.get::<3>("T").into()
    }

    fn load(&self) -> Wrench {
        Wrench::from_array(self.get("w"))
    }

    fn agrees<const K: usize>(&self, field: &str, ours: [f64; K]) {
        close(&ours, &self.get::<K>(field), 1e-9, field);
    }
}

/// Largest difference over largest magnitude of the reference.
pub(crate) fn close(ours: &[f64], reference: &[f64], tolerance: f64, what: &str) {
    let magnitude = reference.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    assert_eq!(ours.len(), reference.len(), "{what}");
    for (a, b) in ours.iter().zip(reference) {
        assert!(
            (a - b).abs() <= tolerance * magnitude,
            "{what}: {ours:?} {reference:?}"
        );
    }
}

fn by_rows<const K: usize>(numbers: impl IntoIterator<Item = f64>) -> [f64; K] {
    numbers.into_iter().collect::<Vec<_>>().try_into().unwrap()
}

#[test]
fn l2_agrees() {
    let robot = l2::Robot::new(presets::l2()).unwrap();
    let kinematics = l2::Kinematics::new(&robot, &Matrix3::identity()).unwrap();
    let springs = presets::l2_compliances();
    let elastic = l2::Elastic::new(&kinematics, &springs);
    let compensator = l2::Compensator::new(
        &kinematics,
        &springs,
        CompensatorConfig {
            gain: 1.0,
            limits: [OffsetNm(2_000_000); 3],
            metres_per_q: [1.0; 3],
        },
    )
    .unwrap();
    for case in Case::all("l2") {
        let (tcp, load) = (case.tcp(), case.load());
        let found = kinematics.inverse(&tcp).unwrap();
        case.agrees("q", found);
        assert!(kinematics.residual_m(&Pose::at(tcp), &found) < 1e-15);

        let q = case.get("q");
        let lines = kinematics.line_matrix(&Pose::at(tcp), &q).unwrap();
        let forces = lines.link_forces_n(&load).unwrap();
        case.agrees("tau", lines.cart_loads(&forces));
        let general = lines.deflection(&springs, &load).unwrap();
        let total = lines.compliance(&springs).unwrap();
        let moved: [f64; 6] = (total.0 * Vector6::from(load.to_array())).into();
        close(&moved, &general.total.to_array(), 1e-12, "C w");

        let cyclic = elastic.deflection(&tcp, &q, &load).unwrap();
        case.agrees("r", cyclic.carts);
        let (t, r) = (cyclic.translation_m, cyclic.rotation_rad);
        case.agrees::<6>("dx_links", by_rows(t.iter().chain(r.iter()).copied()));
        let correction = compensator.correct_q(&q, &load).unwrap();
        let expected = case.get::<3>("q_comp");
        for axis in 0..3 {
            let offset_m = correction.offsets[axis].to_metres().0;
            assert!((offset_m - (expected[axis] - q[axis])).abs() < 1e-9);
        }
        assert_eq!(correction.saturated, [false; 3]);
    }
}

#[test]
fn f1_agrees() {
    let geometry = f1::Geometry {
        travel: None,
        ..presets::f1()
    };
    let kinematics = f1::Kinematics::new(&f1::Robot::new(geometry).unwrap());
    let actuators = numbers(&vectors()["f1"]["c_act"]);
    let springs = Compliances::new(numbers(&vectors()["c_link"]), actuators).unwrap();
    for case in Case::all("f1") {
        let pose = Pose {
            position_m: case.tcp(),
            rotation: Matrix3::from_row_slice(&case.get::<9>("R")),
        };
        let (q, load) = (case.get("q"), case.load());
        let inverse = kinematics.inverse(&pose, None).unwrap();
        case.agrees("q", inverse.value);
        assert!(inverse.residual_m < 1e-12, "{inverse:?}");
        let forward = kinematics.forward(&q).unwrap().value;
        assert!((forward.rotation - pose.rotation).amax() < 1e-10);

        let lines = kinematics.line_matrix(&pose, &q).unwrap();
        let jacobian = lines.jacobian().unwrap().transpose();
        case.agrees(
            "tau",
            lines.cart_loads(&lines.link_forces_n(&load).unwrap()),
        );
        // tau = J^T w.
        let work = jacobian * Vector6::from(load.to_array());
        case.agrees::<6>("tau", work.into());

        let deflection = lines.deflection(&springs, &load).unwrap();
        let compliance = lines.compliance(&springs).unwrap();
        let moved: [f64; 6] = (compliance.0 * Vector6::from(load.to_array())).into();
        close(&moved, &deflection.total.to_array(), 1e-12, "C w");
    }
}
