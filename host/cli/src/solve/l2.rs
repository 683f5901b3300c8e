//! Operations of the L2.

use gantry_tau_core::model::l2;
use gantry_tau_core::model::statics::LineMatrix;
use gantry_tau_machine::robot_file::matrix;
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

use super::SolveError;
use super::ops::{Operations, SolveTask, finite, rows};
use super::request::{field, optional_field};

/// Kinematics in the orientation of a request: `R`, else that of a seed, else the identity.
pub(super) fn kinematics(robot: &l2::Robot, request: &Value) -> Result<l2::Kinematics, SolveError> {
    let seed = request.get("seed").filter(|seed| seed.is_object());
    let rows = match (optional_field(request, "R")?, seed) {
        (None, Some(seed)) => optional_field(seed, "R")?,
        (rows, _) => rows,
    };
    Ok(l2::Kinematics::new(
        robot,
        &rows.map_or_else(Matrix3::identity, matrix),
    )?)
}

impl SolveTask<'_, l2::Kinematics, { l2::AXES }> {
    fn tcp(&self) -> Result<Vector3<f64>, SolveError> {
        field(self.request, "T").map(|t: [f64; 3]| Vector3::from(t))
    }

    fn residual(&self, tcp: Vector3<f64>, q: &[f64; 3]) -> Result<f64, SolveError> {
        let residual = self.kinematics.residual_m(&self.kinematics.pose(tcp), q);
        finite([residual])?;
        Ok(residual)
    }
}

impl Operations<{ l2::AXES }> for SolveTask<'_, l2::Kinematics, { l2::AXES }> {
    fn lines(&self) -> Result<LineMatrix<{ l2::AXES }>, SolveError> {
        let tcp = self.tcp()?;
        let q = self.kinematics.inverse_in_assembly(&tcp)?;
        Ok(self
            .kinematics
            .line_matrix(&self.kinematics.pose(tcp), &q)?)
    }

    fn ik(&self) -> Result<Value, SolveError> {
        let tcp = self.tcp()?;
        let q = self.kinematics.inverse_in_assembly(&tcp)?;
        let residual = self.residual(tcp, &q)?;
        Ok(json!({"q": q, "iterations": 0, "residual": residual}))
    }

    fn fk(&self) -> Result<Value, SolveError> {
        let q = field(self.request, "q")?;
        let tcp = self.kinematics.forward(&q)?;
        let residual = self.residual(tcp, &q)?;
        Ok(json!({
            "T": <[f64; 3]>::from(tcp),
            "R": rows(self.kinematics.rotation()),
            "iterations": 0,
            "residual": residual,
        }))
    }

    fn jacobian(&self) -> Result<Value, SolveError> {
        let jacobian = self.kinematics.jacobian(&self.tcp()?)?;
        finite(jacobian.iter().copied())?;
        Ok(json!({"J": rows(&jacobian)}))
    }

    fn statics(&self) -> Result<Value, SolveError> {
        let load = self.load()?;
        let forces = self.lines()?.link_forces_n(&load)?;
        let jacobian = self.kinematics.jacobian(&self.tcp()?)?;
        let tau = l2::cart_loads_from_jacobian(&jacobian, &load.force_n);
        finite(tau)?;
        Ok(json!({"f": forces, "tau": tau}))
    }

    fn compensate(&self) -> Result<Value, SolveError> {
        let model = l2::Elastic::new(self.kinematics, self.springs()?);
        let tcp = self.tcp()?;
        let load = self.load()?;
        let q = self.kinematics.inverse_in_assembly(&tcp)?;
        let command = model.command(&tcp, &q, &load, 1.0)?;
        finite(command)?;
        Ok(json!({"q": command}))
    }
}
