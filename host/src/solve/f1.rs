//! Operations of the F1.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{COLD_ITERATIONS, Pose, ROTATION_TOLERANCE, Solution};
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

use super::Failure;
use super::ops::{deflected, rows, springs};
use super::request::{field, matrix, optional_field};

struct Task<'a> {
    kinematics: &'a f1::Kinematics,
    compliances: Option<&'a Compliances<{ f1::AXES }>>,
    request: &'a Value,
}

/// One of [`super::ops::NAMES`].
pub(super) fn solve(
    op: &str,
    kinematics: &f1::Kinematics,
    compliances: Option<&Compliances<{ f1::AXES }>>,
    request: &Value,
) -> Result<Value, Failure> {
    let task = Task { kinematics, compliances, request };
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

/// `T`, and `R` or the identity.
fn pose(object: &Value) -> Result<Pose, Failure> {
    let position: [f64; 3] = field(object, "T")?;
    let rotation = optional_field(object, "R")?.map_or_else(Matrix3::identity, matrix);
    let deviation = rotation_deviation(&rotation);
    if deviation > ROTATION_TOLERANCE {
        return Err(Failure::request(format!("R is not a rotation matrix (deviation {deviation:e})")));
    }
    Ok(Pose { position_m: Vector3::from(position), rotation })
}

impl Task<'_> {
    fn load(&self) -> Result<Wrench, Failure> {
        field(self.request, "w").map(Wrench::from_array)
    }

    /// Inverse kinematics of the request, in the assembly mode of the machine; plates start from the seed's.
    fn inverse(&self, pose: &Pose) -> Result<Solution<[f64; f1::AXES]>, Failure> {
        let seed: Option<[f64; f1::AXES]> = optional_field(self.request, "seed")?;
        let plates = seed.map(|[_, _, _, q4, q5, q6]| [q4, q5, q6]);
        Ok(self.kinematics.inverse_in_assembly(pose, plates)?)
    }

    fn lines(&self) -> Result<LineMatrix<{ f1::AXES }>, Failure> {
        let pose = pose(self.request)?;
        let q = self.inverse(&pose)?.value;
        Ok(self.kinematics.line_matrix(&pose, &q)?)
    }

    fn ik(&self) -> Result<Value, Failure> {
        let pose = pose(self.request)?;
        let solved = self.inverse(&pose)?;
        Ok(json!({
            "q": solved.value,
            "iterations": solved.iterations,
            "residual": solved.residual_m,
        }))
    }

    fn fk(&self) -> Result<Value, Failure> {
        let q = field(self.request, "q")?;
        let solved = match self.request.get("seed") {
            None | Some(Value::Null) => self.kinematics.forward(&q)?,
            Some(seed) => (self.kinematics).forward_from(&q, &pose(seed)?, COLD_ITERATIONS)?,
        };
        Ok(json!({
            "T": <[f64; 3]>::from(solved.value.position_m),
            "R": rows(&solved.value.rotation),
            "iterations": solved.iterations,
            "residual": solved.residual_m,
        }))
    }

    fn jacobian(&self) -> Result<Value, Failure> {
        Ok(json!({"J": rows(&self.lines()?.jacobian()?)}))
    }

    fn statics(&self) -> Result<Value, Failure> {
        let lines = self.lines()?;
        let forces = lines.link_forces_n(&self.load()?)?;
        Ok(json!({"f": forces, "tau": lines.cart_loads(&forces)}))
    }

    fn compliance(&self) -> Result<Value, Failure> {
        let compliance = self.lines()?.compliance(springs(self.compliances)?)?;
        Ok(json!({"C": rows(&compliance.0)}))
    }

    fn deflection(&self) -> Result<Value, Failure> {
        deflected(&self.lines()?, springs(self.compliances)?, &self.load()?)
    }

    fn compensate(&self) -> Result<Value, Failure> {
        let machine = f1::Elastic::new(self.kinematics, springs(self.compliances)?);
        let pose = pose(self.request)?;
        let q = self.inverse(&pose)?.value;
        Ok(json!({"q": machine.command(&pose, &q, &self.load()?, 1.0)?}))
    }
}
