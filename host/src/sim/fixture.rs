//! The L2 geometry of `tests/data/tau_vectors.json`, for the tests of this folder.

use gantry_tau_core::robot::{Branch, Compliances, Configuration, Geometry, Robot};
use nalgebra::{Matrix6, Vector3};
use serde::Deserialize;

#[derive(Deserialize)]
struct Vectors {
    l2: L2,
    c_link: [f64; 6],
}

#[derive(Deserialize)]
#[serde(rename_all = "UPPERCASE")]
struct L2 {
    a0: [[f64; 3]; 6],
    v: [[f64; 3]; 3],
    #[serde(rename = "b")]
    platform: [[f64; 3]; 6],
    l: [f64; 3],
    #[serde(rename = "c")]
    inverse: [i32; 3],
    #[serde(rename = "cf")]
    forward: i32,
    #[serde(rename = "c_cart")]
    c_cart: [f64; 3],
    #[serde(rename = "cases")]
    cases: Vec<Case>,
}

/// One pose and load with what an independent implementation says about it.
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

fn vectors() -> Vectors {
    serde_json::from_str(include_str!("../../../tests/data/tau_vectors.json")).unwrap()
}

fn branch(sign: i32) -> Branch {
    if sign > 0 {
        Branch::Positive
    } else {
        Branch::Negative
    }
}

pub(crate) fn robot() -> Robot {
    let l2 = vectors().l2;
    Robot::new(Geometry {
        cart_joints_m: l2.a0.map(Vector3::from),
        guideways: l2.v.map(Vector3::from),
        platform_joints_m: l2.platform.map(Vector3::from),
        lengths_m: l2.l,
        configuration: Configuration {
            inverse: l2.inverse.map(branch),
            forward: branch(l2.forward),
        },
        travel: None,
    })
    .unwrap()
}

pub(crate) fn compliances() -> Compliances {
    let all = vectors();
    Compliances::new(all.c_link, all.l2.c_cart).unwrap()
}

pub(crate) fn cases() -> Vec<Case> {
    vectors().l2.cases
}

/// Mean of the cases' poses: inside the workspace, far from its edges.
pub(crate) fn home_m() -> [f64; 3] {
    let cases = cases();
    let count = u32::try_from(cases.len()).unwrap();
    let sum: Vector3<f64> = cases.iter().map(|case| Vector3::from(case.t)).sum();
    (sum / f64::from(count)).into()
}

/// Rows to matrix.
pub(crate) fn matrix6(rows: &[[f64; 6]; 6]) -> Matrix6<f64> {
    Matrix6::from_fn(|row, column| rows[row][column])
}
