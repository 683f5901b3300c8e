//! Machines and cases of `tests/data/tau_vectors.json`, for the tests of this folder.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::Compliances;
use nalgebra::{Matrix3, Matrix6, Vector3};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::model::MachineKind;
use crate::robot_file::RobotFile;

/// One pose and load of the L2 with what an independent implementation says about it.
#[derive(Clone, Deserialize)]
pub(crate) struct Case {
    #[serde(rename = "T")]
    pub(crate) t: [f64; 3],
    pub(crate) q: [f64; 3],
    pub(crate) w: [f64; 6],
    pub(crate) f: [f64; 6],
    pub(crate) tau: [f64; 3],
    pub(crate) q_comp: [f64; 3],
    #[serde(rename = "C_total")]
    pub(crate) c_total: [[f64; 6]; 6],
}

/// The same of the F1.
#[derive(Clone, Deserialize)]
pub(crate) struct SixCase {
    #[serde(rename = "T")]
    pub(crate) t: [f64; 3],
    #[serde(rename = "R")]
    pub(crate) r: [[f64; 3]; 3],
    pub(crate) q: [f64; 6],
    pub(crate) w: [f64; 6],
    pub(crate) f: [f64; 6],
    pub(crate) tau: [f64; 6],
    pub(crate) q_comp: [f64; 6],
}

fn cases_of<T: DeserializeOwned>(model: &str) -> Vec<T> {
    let text = include_str!("../../../tests/data/tau_vectors.json");
    let vectors: serde_json::Value = serde_json::from_str(text).unwrap();
    serde_json::from_value(vectors[model]["cases"].clone()).unwrap()
}

/// The L2 whose file the tests of [`crate::robot_file`] compare with the vectors.
pub(crate) fn geometry() -> f1::Geometry {
    RobotFile::builtin_l2().unwrap().model.geometry()
}

pub(crate) fn compliances() -> Compliances<3> {
    RobotFile::builtin_l2().unwrap().compliances.unwrap()
}

pub(crate) fn cases() -> Vec<Case> {
    cases_of("l2")
}

/// The F1.
pub(crate) fn six_links() -> f1::Geometry {
    RobotFile::builtin_f1().unwrap().model.geometry()
}

pub(crate) fn six_compliances() -> Compliances<6> {
    RobotFile::builtin_f1().unwrap().compliances.unwrap()
}

pub(crate) fn six_cases() -> Vec<SixCase> {
    cases_of("f1")
}

/// Mean of the L2's poses: inside the workspace, far from its edges.
pub(crate) fn home_m() -> [f64; 3] {
    let cases = cases();
    let count = u32::try_from(cases.len()).unwrap();
    let sum: Vector3<f64> = cases.iter().map(|case| Vector3::from(case.t)).sum();
    (sum / f64::from(count)).into()
}

/// The axes there.
pub(crate) fn home_q() -> [f64; 3] {
    let l2 = RobotFile::builtin_l2().unwrap().model;
    l2.axes_at(&Vector3::from(home_m())).unwrap()
}

/// Rows to matrix.
pub(crate) fn matrix3(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| rows[row][column])
}

/// Rows to matrix.
pub(crate) fn matrix6(rows: &[[f64; 6]; 6]) -> Matrix6<f64> {
    Matrix6::from_fn(|row, column| rows[row][column])
}
