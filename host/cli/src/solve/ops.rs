//! Operations, and the parts that both machines share.

use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::l2::OrientationError;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use gantry_tau_machine::model::MachineKind;
use nalgebra::{Dim, Matrix, RawStorage};
use serde_json::{Value, json};

use super::dynamics::Bodies;
use super::request::{SolvedMachine, field};
use super::{SolveError, l2};

/// Names of all operations.
pub(super) const NAMES: [&str; 10] = [
    "ik",
    "fk",
    "jacobian",
    "statics",
    "compliance",
    "deflection",
    "compensate",
    "dynamics",
    "modes",
    "loop",
];

impl From<KinematicsError> for SolveError {
    fn from(error: KinematicsError) -> Self {
        Self {
            kind: error.kind(),
            message: error.to_string(),
        }
    }
}

impl From<OrientationError> for SolveError {
    fn from(error: OrientationError) -> Self {
        match error {
            OrientationError::NotRotation { .. } => Self::request(error.to_string()),
            OrientationError::NotTau { .. } => Self::robot(error.to_string()),
        }
    }
}

/// Runs one of [`NAMES`].
pub(super) fn solve(
    op: &str,
    machine: &SolvedMachine,
    request: &Value,
) -> Result<Value, SolveError> {
    match machine {
        SolvedMachine::L2 {
            robot,
            compliances,
            bodies,
        } => {
            let kinematics = l2::kinematics(robot, request)?;
            SolveTask {
                kinematics: &kinematics,
                compliances: compliances.as_ref(),
                bodies,
                request,
            }
            .solve(op)
        }
        SolvedMachine::F1 {
            kinematics,
            compliances,
            bodies,
        } => SolveTask {
            kinematics,
            compliances: compliances.as_ref(),
            bodies,
            request,
        }
        .solve(op),
    }
}

/// A request to a machine with `N` axes.
pub(super) struct SolveTask<'a, K, const N: usize> {
    pub(super) kinematics: &'a K,
    pub(super) compliances: Option<&'a Compliances<N>>,
    pub(super) bodies: &'a Bodies<N>,
    pub(super) request: &'a Value,
}

/// Operations of one kind of machine.
pub(super) trait Operations<const N: usize> {
    fn ik(&self) -> Result<Value, SolveError>;
    fn fk(&self) -> Result<Value, SolveError>;
    fn jacobian(&self) -> Result<Value, SolveError>;
    fn statics(&self) -> Result<Value, SolveError>;
    fn compensate(&self) -> Result<Value, SolveError>;

    /// The six links where `T` puts them.
    fn lines(&self) -> Result<LineMatrix<N>, SolveError>;
}

impl<K: MachineKind<N>, const N: usize> SolveTask<'_, K, N>
where
    Self: Operations<N>,
{
    fn solve(&self, op: &str) -> Result<Value, SolveError> {
        match op {
            "ik" => self.ik(),
            "fk" => self.fk(),
            "jacobian" => self.jacobian(),
            "statics" => self.statics(),
            "compliance" => self.compliance(),
            "deflection" => self.deflection(),
            "compensate" => self.compensate(),
            "dynamics" => self.dynamics(),
            "modes" => self.modes(),
            "loop" => self.closed_loop(),
            _ => Err(SolveError::request(format!("op {op:?} is unknown"))),
        }
    }

    pub(super) fn load(&self) -> Result<Wrench, SolveError> {
        field(self.request, "w").map(Wrench::from_array)
    }

    /// Returns the compliances for an operation that needs them.
    pub(super) fn springs(&self) -> Result<&Compliances<N>, SolveError> {
        let axes = if N == 3 { "c_cart" } else { "c_act" };
        self.compliances.ok_or_else(|| {
            SolveError::robot(format!(
                "c_link and {axes} are missing, and this op needs them"
            ))
        })
    }

    fn compliance(&self) -> Result<Value, SolveError> {
        let compliance = self.lines()?.compliance(self.springs()?)?;
        Ok(json!({"C": rows(&compliance.0)}))
    }

    fn deflection(&self) -> Result<Value, SolveError> {
        let deflection = self.lines()?.deflection(self.springs()?, &self.load()?)?;
        Ok(json!({
            "r": deflection.carts.as_slice(),
            "dx_links": deflection.links.to_array(),
            "dx_total": deflection.total.to_array(),
        }))
    }
}

/// Checks that all values are finite: JSON cannot represent others.
pub(super) fn finite(values: impl IntoIterator<Item = f64>) -> Result<(), SolveError> {
    if values.into_iter().all(f64::is_finite) {
        Ok(())
    } else {
        Err(KinematicsError::NotFinite.into())
    }
}

/// Returns a matrix as nested arrays, by rows.
pub(super) fn rows<R: Dim, C: Dim, S: RawStorage<f64, R, C>>(
    matrix: &Matrix<f64, R, C, S>,
) -> Vec<Vec<f64>> {
    (matrix.row_iter())
        .map(|row| row.iter().copied().collect())
        .collect()
}
