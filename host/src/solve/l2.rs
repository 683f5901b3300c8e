//! Operations of the L2.

use gantry_tau_core::model::l2;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

use super::Failure;
use super::ops::{deflected, finite, rows, springs};
use super::request::{field, matrix, optional_field};

/// A request whose orientation is known.
struct Task<'a> {
    compliances: Option<&'a Compliances<{ l2::AXES }>>,
    request: &'a Value,
    kinematics: l2::Kinematics,
}

/// One of [`super::ops::NAMES`].
pub(super) fn solve(
    op: &str,
    robot: &l2::Robot,
    compliances: Option<&Compliances<{ l2::AXES }>>,
    request: &Value,
) -> Result<Value, Failure> {
    let task = Task { compliances, request, kinematics: l2::Kinematics::new(robot, &orientation(request)?)? };
    match op {
        "ik" => task.ik(),
        "fk" => task.fk(),
        "jacobian" => task.jacobian(),
        "statics" => task.statics(),
        "compliance" => task.compliance(),
        "deflection" => task.deflection(),
        "compensate" => task.compensate(),
        _ => Err(Failure::request(format!("op {op:?} is unknown"))),
    }
}

/// `R`, else that of a seed, else the identity.
fn orientation(request: &Value) -> Result<Matrix3<f64>, Failure> {
    let seeded = || match request.get("seed") {
        Some(seed) if seed.is_object() => optional_field(seed, "R"),
        _ => Ok(None),
    };
    let rows = match optional_field(request, "R")? {
        Some(rows) => Some(rows),
        None => seeded()?,
    };
    Ok(rows.map_or_else(Matrix3::identity, matrix))
}

impl Task<'_> {
    fn tcp(&self) -> Result<Vector3<f64>, Failure> {
        field(self.request, "T").map(|t: [f64; 3]| Vector3::from(t))
    }

    fn load(&self) -> Result<Wrench, Failure> {
        field(self.request, "w").map(Wrench::from_array)
    }

    /// The six links where `T` puts them, by the general path.
    fn lines(&self) -> Result<LineMatrix<{ l2::AXES }>, Failure> {
        let tcp = self.tcp()?;
        let q = self.kinematics.inverse_in_assembly(&tcp)?;
        Ok(self.kinematics.line_matrix(&self.kinematics.pose(tcp), &q)?)
    }

    fn residual(&self, tcp: Vector3<f64>, q: &[f64; 3]) -> Result<f64, Failure> {
        let residual = self.kinematics.residual_m(&self.kinematics.pose(tcp), q);
        finite([residual])?;
        Ok(residual)
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

    fn compliance(&self) -> Result<Value, Failure> {
        let springs = springs(self.compliances)?;
        let compliance = self.lines()?.compliance(springs)?;
        Ok(json!({"C": rows(&compliance.0)}))
    }

    fn deflection(&self) -> Result<Value, Failure> {
        deflected(&self.lines()?, springs(self.compliances)?, &self.load()?)
    }

    fn compensate(&self) -> Result<Value, Failure> {
        let model = l2::Elastic::new(&self.kinematics, springs(self.compliances)?);
        let tcp = self.tcp()?;
        let load = self.load()?;
        let q = self.kinematics.inverse_in_assembly(&tcp)?;
        let command = model.command(&tcp, &q, &load, 1.0)?;
        finite(command)?;
        Ok(json!({"q": command}))
    }
}
