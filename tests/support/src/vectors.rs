//! Machines and cases of `tests/data/tau_vectors.json`.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{ARMS, Compliances};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::{Matrix3, Matrix6, Rotation3, SVector, UnitQuaternion, Vector3, Vector6};
use serde_json::Value;

/// One machine, whose file the tests of the robot files compare with the vectors, and its cases.
pub struct Vectors<const N: usize> {
    /// Geometry of the built-in robot file.
    pub geometry: f1::Geometry,
    /// Compliances of the built-in robot file.
    pub compliances: Compliances<N>,
    /// The cases.
    pub cases: Vec<Case<N>>,
}

/// One pose and load with the results of an independent implementation.
pub struct Case<const N: usize> {
    /// Tool centre point, world axes, m.
    pub translation_m: Vector3<f64>,
    /// Orientation of the platform.
    pub rotation: UnitQuaternion<f64>,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Load on the tool: force (N), moment (N m), world axes.
    pub load: Vector6<f64>,
    /// Tensions of the links, N.
    pub tensions_n: Vector6<f64>,
    /// Loads of the axes.
    pub axis_loads: SVector<f64, N>,
    /// Positions of the axes that compensate the load, q-units.
    pub q_compensated: [f64; N],
    /// Compliance at the tool; of the L2 only.
    pub compliance: Option<Matrix6<f64>>,
}

impl Vectors<ARMS> {
    /// The L2.
    #[must_use]
    pub fn l2() -> Self {
        let robot = RobotFile::builtin_l2().unwrap();
        Self {
            geometry: robot.model.geometry(),
            compliances: robot.compliances.unwrap(),
            cases: cases("l2"),
        }
    }
}

impl Vectors<6> {
    /// The F1.
    #[must_use]
    pub fn f1() -> Self {
        let robot = RobotFile::builtin_f1().unwrap();
        Self {
            geometry: robot.model.geometry(),
            compliances: robot.compliances.unwrap(),
            cases: cases("f1"),
        }
    }
}

fn cases<const N: usize>(model: &str) -> Vec<Case<N>> {
    let text = include_str!("../../data/tau_vectors.json");
    let vectors: Value = serde_json::from_str(text).unwrap();
    let cases = vectors[model]["cases"].as_array().unwrap();
    cases.iter().map(Case::read).collect()
}

impl<const N: usize> Case<N> {
    fn read(case: &Value) -> Self {
        let rotation = case.get("R").map_or_else(Matrix3::identity, |rows| {
            Matrix3::from_row_slice(&numbers(rows))
        });
        let [q, axis_loads, q_compensated] = ["q", "tau", "q_comp"]
            .map(|key| SVector::<f64, N>::from_row_slice(&numbers(&case[key])));
        let [load, tensions_n] =
            ["w", "f"].map(|key| Vector6::from_row_slice(&numbers(&case[key])));
        Self {
            translation_m: Vector3::from_row_slice(&numbers(&case["T"])),
            rotation: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
                rotation,
            )),
            q: q.into(),
            load,
            tensions_n,
            axis_loads,
            q_compensated: q_compensated.into(),
            compliance: case
                .get("C_total")
                .map(|rows| Matrix6::from_row_slice(&numbers(rows))),
        }
    }
}

/// Returns the numbers of a list, or of a list of rows.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(parts) => parts.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}
