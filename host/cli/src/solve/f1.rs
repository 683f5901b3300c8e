//! Operations of the F1.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{COLD_ITERATIONS, Pose, Solution};
use gantry_tau_core::model::statics::LineMatrix;
use serde_json::{Value, json};

use super::SolveError;
use super::ops::{Operations, SolveTask, rows};
use super::request::{self, field, optional_field};

/// `T`, and `R` or the identity.
fn pose(object: &Value) -> Result<Pose, SolveError> {
    request::pose(object, "T", "R")
}

impl SolveTask<'_, f1::Kinematics, { f1::AXES }> {
    /// Inverse kinematics of the request, in the assembly mode of the machine; plates start from
    /// the seed's.
    fn inverse(&self, pose: &Pose) -> Result<Solution<[f64; f1::AXES]>, SolveError> {
        let seed: Option<[f64; f1::AXES]> = optional_field(self.request, "seed")?;
        let plates = seed.map(|[_, _, _, q4, q5, q6]| [q4, q5, q6]);
        Ok(self.kinematics.inverse_in_assembly(pose, plates)?)
    }
}

impl Operations<{ f1::AXES }> for SolveTask<'_, f1::Kinematics, { f1::AXES }> {
    fn lines(&self) -> Result<LineMatrix<{ f1::AXES }>, SolveError> {
        let pose = pose(self.request)?;
        let q = self.inverse(&pose)?.value;
        Ok(self.kinematics.line_matrix(&pose, &q)?)
    }

    fn ik(&self) -> Result<Value, SolveError> {
        let pose = pose(self.request)?;
        let solved = self.inverse(&pose)?;
        Ok(json!({
            "q": solved.value,
            "iterations": solved.iterations,
            "residual": solved.residual_m,
        }))
    }

    fn fk(&self) -> Result<Value, SolveError> {
        let q = field(self.request, "q")?;
        let solved = match self.request.get("seed") {
            None | Some(Value::Null) => self.kinematics.forward(&q)?,
            Some(seed) => self
                .kinematics
                .forward_from(&q, &pose(seed)?, COLD_ITERATIONS)?,
        };
        Ok(json!({
            "T": <[f64; 3]>::from(solved.value.position_m),
            "R": rows(&solved.value.rotation),
            "iterations": solved.iterations,
            "residual": solved.residual_m,
        }))
    }

    fn jacobian(&self) -> Result<Value, SolveError> {
        Ok(json!({"J": rows(&self.lines()?.jacobian()?)}))
    }

    fn statics(&self) -> Result<Value, SolveError> {
        let lines = self.lines()?;
        let forces = lines.link_forces_n(&self.load()?)?;
        Ok(json!({"f": forces, "tau": lines.cart_loads(&forces)}))
    }

    fn compensate(&self) -> Result<Value, SolveError> {
        let machine = f1::Elastic::new(self.kinematics, self.springs()?);
        let pose = pose(self.request)?;
        let q = self.inverse(&pose)?.value;
        Ok(json!({"q": machine.command(&pose, &q, &self.load()?, 1.0)?}))
    }
}
