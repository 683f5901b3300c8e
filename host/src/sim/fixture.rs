//! Machines and cases of `tests/data/tau_vectors.json`, for the tests of this folder.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{ARMS, Compliances};
use nalgebra::{Matrix3, Matrix6, Rotation3, SVector, UnitQuaternion, Vector3, Vector6};
use serde_json::Value;

use super::drive::Settings;
use super::parameters::{Motion, SimulationParameters};
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticMachine, Pose};
use crate::model::MachineKind;
use crate::robot_file::{RobotFile, Simulation};
use crate::springs::compliances::Springs;

/// One machine, whose file the tests of [`crate::robot_file`] compare with the vectors, and its cases.
pub(crate) struct Vectors<const N: usize> {
    pub(crate) geometry: f1::Geometry,
    pub(crate) compliances: Compliances<N>,
    pub(crate) cases: Vec<Case<N>>,
}

/// One pose and load with the results of an independent implementation.
pub(crate) struct Case<const N: usize> {
    pub(crate) pose: Pose,
    pub(crate) q: [f64; N],
    pub(crate) load: Vector6<f64>,
    pub(crate) tensions_n: Vector6<f64>,
    pub(crate) axis_loads: SVector<f64, N>,
    pub(crate) q_compensated: [f64; N],
    /// Of the L2 only.
    pub(crate) compliance: Option<Matrix6<f64>>,
}

impl Vectors<ARMS> {
    pub(crate) fn l2() -> Self {
        let robot = RobotFile::builtin_l2().unwrap();
        Self { geometry: robot.model.geometry(), compliances: robot.compliances.unwrap(), cases: cases("l2") }
    }
}

impl Vectors<6> {
    pub(crate) fn f1() -> Self {
        let robot = RobotFile::builtin_f1().unwrap();
        Self { geometry: robot.model.geometry(), compliances: robot.compliances.unwrap(), cases: cases("f1") }
    }
}

impl<const N: usize> Vectors<N> {
    /// Nominal compliances; no wrist.
    pub(crate) fn springs(&self) -> Springs<N> {
        Springs::rigid_wrist(self.compliances)
    }

    /// The machine with rigid joints and nominal compliances.
    pub(crate) fn machine(&self) -> ElasticMachine<N> {
        ElasticMachine::new(self.geometry, self.compliances, Backlash::NONE)
    }
}

fn cases<const N: usize>(model: &str) -> Vec<Case<N>> {
    let text = include_str!("../../../tests/data/tau_vectors.json");
    let vectors: Value = serde_json::from_str(text).unwrap();
    let cases = vectors[model]["cases"].as_array().unwrap();
    cases.iter().map(Case::read).collect()
}

impl<const N: usize> Case<N> {
    fn read(case: &Value) -> Self {
        let rotation = case.get("R").map_or_else(Matrix3::identity, |rows| Matrix3::from_row_slice(&numbers(rows)));
        let per_axis = |key: &str| SVector::<f64, N>::from_row_slice(&numbers(&case[key]));
        let per_link = |key: &str| Vector6::from_row_slice(&numbers(&case[key]));
        Self {
            pose: Pose {
                translation_m: Vector3::from_row_slice(&numbers(&case["T"])),
                rotation: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
            },
            q: per_axis("q").into(),
            load: per_link("w"),
            tensions_n: per_link("f"),
            axis_loads: per_axis("tau"),
            q_compensated: per_axis("q_comp").into(),
            compliance: case.get("C_total").map(|rows| Matrix6::from_row_slice(&numbers(rows))),
        }
    }
}

/// Returns a motion with these waypoints (m), speed (m/s), acceleration (m/s^2) and dwell (cycles).
pub(crate) fn motion<const N: usize>(waypoints_m: &[[f64; N]], speed: f64, acceleration: f64, dwell: u32) -> Motion<N> {
    Motion::BackAndForth {
        waypoints_m: waypoints_m.to_vec(),
        speed_m_per_s: speed,
        acceleration_m_per_s2: acceleration,
        dwell_cycles: dwell,
    }
}

/// Returns the numbers of a list, or of a list of rows.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(parts) => parts.iter().flat_map(numbers).collect(),
        number => vec![number.as_f64().unwrap()],
    }
}

/// Returns a machine like the thesis' `[T 4.2, 5.2]`: true springs within 15 % of the nominal ones, the jump at 360 N, one metre per unit of
/// `q`. Its home is the mean of the L2's poses: inside the workspace, far from its edges.
pub(crate) fn parameters() -> SimulationParameters<ARMS> {
    let cases = Vectors::l2().cases;
    let home: Vector3<f64> =
        cases.iter().map(|case| case.pose.translation_m).sum::<Vector3<f64>>() / cases.len() as f64;
    let robot = RobotFile::builtin_l2().unwrap();
    SimulationParameters {
        simulation: Simulation {
            seed: 1,
            spring_deviation: 0.15,
            force_noise_n: 0.5,
            moment_noise_nm: 0.02,
            gauge_resolution_m: 0.5e-6,
            jump_force_n: 360.0,
            jump_gap_m: 40e-6,
            home_m: home.into(),
            ..robot.simulation
        },
        drives: Settings::IDEAL,
        sensor: robot.sensor,
        home_q: robot.model.axes_at(&home).unwrap(),
        metres_per_q: [1.0; ARMS],
        motion: Motion::Hold,
    }
}
