//! Operations, and the parts that both machines share.

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::l2::OrientationError;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use nalgebra::SMatrix;
use serde_json::{Value, json};

use super::request::Machine;
use super::{Failure, Kind, f1, l2};

/// Names of all operations.
pub(super) const NAMES: [&str; 7] = ["ik", "fk", "jacobian", "statics", "compliance", "deflection", "compensate"];

impl From<KinematicsError> for Failure {
    fn from(error: KinematicsError) -> Self {
        Self { kind: Kind::Core(error.kind()), message: error.to_string() }
    }
}

impl From<OrientationError> for Failure {
    fn from(error: OrientationError) -> Self {
        match error {
            OrientationError::NotRotation { .. } => Self::request(error.to_string()),
            OrientationError::NotTau { .. } => Self::robot(error.to_string()),
        }
    }
}

/// Runs one of [`NAMES`].
pub(super) fn solve(op: &str, machine: &Machine, request: &Value) -> Result<Value, Failure> {
    match machine {
        Machine::L2 { robot, compliances } => l2::solve(op, robot, compliances.as_ref(), request),
        Machine::F1 { kinematics, compliances } => f1::solve(op, kinematics, compliances.as_ref(), request),
    }
}

/// Returns the compliances for an operation that needs them.
pub(super) fn springs<const N: usize>(compliances: Option<&Compliances<N>>) -> Result<&Compliances<N>, Failure> {
    let axes = if N == 3 { "c_cart" } else { "c_act" };
    compliances.ok_or_else(|| Failure::robot(format!("c_link and {axes} are missing, and this op needs them")))
}

/// Returns the deflection under a load as JSON.
pub(super) fn deflected<const N: usize>(
    lines: &LineMatrix<N>,
    springs: &Compliances<N>,
    load: &Wrench,
) -> Result<Value, Failure> {
    let deflection = lines.deflection(springs, load)?;
    Ok(json!({
        "r": deflection.carts.as_slice(),
        "dx_links": deflection.links.to_array(),
        "dx_total": deflection.total.to_array(),
    }))
}

/// Checks that all values are finite: JSON cannot represent others.
pub(super) fn finite(values: impl IntoIterator<Item = f64>) -> Result<(), Failure> {
    if values.into_iter().all(f64::is_finite) { Ok(()) } else { Err(KinematicsError::NotFinite.into()) }
}

/// Returns a matrix as nested arrays, by rows.
pub(super) fn rows<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Vec<Vec<f64>> {
    (matrix.row_iter()).map(|row| row.iter().copied().collect()).collect()
}
