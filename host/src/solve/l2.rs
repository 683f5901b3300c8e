//! Operations of the L2.

use gantry_tau_core::model::l2;
use gantry_tau_core::model::statics::LineMatrix;
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

use super::Failure;
use super::ops::{Operations, Task, finite, rows};
use super::request::{field, optional_field};
use crate::robot_file::matrix;

/// Kinematics in the orientation of a request: `R`, else that of a seed, else the identity.
pub(super) fn kinematics(robot: &l2::Robot, request: &Value) -> Result<l2::Kinematics, Failure> {
    let seeded = || match request.get("seed") {
        Some(seed) if seed.is_object() => optional_field(seed, "R"),
        _ => Ok(None),
    };
    let rows = match optional_field(request, "R")? {
        Some(rows) => Some(rows),
        None => seeded()?,
    };
    Ok(l2::Kinematics::new(robot, &rows.map_or_else(Matrix3::identity, matrix))?)
}

impl Task<'_, l2::Kinematics, { l2::AXES }> {
    fn tcp(&self) -> Result<Vector3<f64>, Failure> {
        field(self.request, "T").map(|t: [f64; 3]| Vector3::from(t))
    }

    fn residual(&self, tcp: Vector3<f64>, q: &[f64; 3]) -> Result<f64, Failure> {
        let residual = self.kinematics.residual_m(&self.kinematics.pose(tcp), q);
        finite([residual])?;
        Ok(residual)
    }
}

impl Operations<{ l2::AXES }> for Task<'_, l2::Kinematics, { l2::AXES }> {
    fn lines(&self) -> Result<LineMatrix<{ l2::AXES }>, Failure> {
        let tcp = self.tcp()?;
        let q = self.kinematics.inverse_in_assembly(&tcp)?;
        Ok(self.kinematics.line_matrix(&self.kinematics.pose(tcp), &q)?)
    }

    fn ik(&self) -> Result<Value, Failure> {
        let tcp = self.tcp()?;
        let q = self.kinematics.inverse_in_assembly(&tcp)?;
        let residual = self.residual(tcp, &q)?;
        Ok(json!({"q": q, "iterations": 0, "residual": residual}))
    }

    fn fk(&self) -> Result<Value, Failure> {
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

    fn jacobian(&self) -> Result<Value, Failure> {
        let jacobian = self.kinematics.jacobian(&self.tcp()?)?;
        finite(jacobian.iter().copied())?;
        Ok(json!({"J": rows(&jacobian)}))
    }

    fn statics(&self) -> Result<Value, Failure> {
        let load = self.load()?;
        let forces = self.lines()?.link_forces_n(&load)?;
        let jacobian = self.kinematics.jacobian(&self.tcp()?)?;
        let tau = l2::cart_loads_from_jacobian(&jacobian, &load.force_n);
        finite(tau)?;
        Ok(json!({"f": forces, "tau": tau}))
    }

    fn compensate(&self) -> Result<Value, Failure> {
        let model = l2::Elastic::new(self.kinematics, self.springs()?);
        let tcp = self.tcp()?;
        let load = self.load()?;
        let q = self.kinematics.inverse_in_assembly(&tcp)?;
        let command = model.command(&tcp, &q, &load, 1.0)?;
        finite(command)?;
        Ok(json!({"q": command}))
    }
}
