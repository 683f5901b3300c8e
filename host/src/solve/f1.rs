//! The operations of the 6-DOF machine.

use gantry_tau_core::model::compensation::SixLinkElastic;
use gantry_tau_core::model::kinematics::{
    COLD_ITERATIONS, Pose, ROTATION_TOLERANCE, SixLinkKinematics, Solved,
};
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_core::model::robot::{AXES, Compliances};
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

use super::Failure;
use super::ops::{deflected, rows, springs};
use super::request::{field, matrix, optional_field};

struct Task<'a> {
    kinematics: &'a SixLinkKinematics,
    compliances: Option<&'a Compliances<AXES>>,
    request: &'a Value,
}

/// One of [`super::ops::NAMES`].
pub(super) fn solve(
    op: &str,
    kinematics: &SixLinkKinematics,
    compliances: Option<&Compliances<AXES>>,
    request: &Value,
) -> Result<Value, Failure> {
    let task = Task {
        kinematics,
        compliances,
        request,
    };
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
        return Err(Failure::request(format!(
            "R is not a rotation: R^T R deviates by {deviation:e} from the identity"
        )));
    }
    Ok(Pose {
        position_m: Vector3::from(position),
        rotation,
    })
}

impl Task<'_> {
    fn load(&self) -> Result<Wrench, Failure> {
        field(self.request, "w").map(Wrench::from_array)
    }

    /// The axes that put the tool where the request says, in the assembly mode of the machine; plates start from the seed's.
    fn inverse(&self, pose: &Pose) -> Result<Solved<[f64; AXES]>, Failure> {
        let seed: Option<[f64; AXES]> = optional_field(self.request, "seed")?;
        let plates = seed.map(|[_, _, _, q4, q5, q6]| [q4, q5, q6]);
        Ok(self.kinematics.inverse_in_assembly(pose, plates)?)
    }

    fn lines(&self) -> Result<LineMatrix<AXES>, Failure> {
        let pose = pose(self.request)?;
        let q = self.inverse(&pose)?.answer;
        Ok(LineMatrix::of_six_link(self.kinematics, &pose, &q)?)
    }

    fn ik(&self) -> Result<Value, Failure> {
        let pose = pose(self.request)?;
        let solved = self.inverse(&pose)?;
        Ok(json!({
            "q": solved.answer,
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
            "T": <[f64; 3]>::from(solved.answer.position_m),
            "R": rows(&solved.answer.rotation),
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
        let machine = SixLinkElastic::new(*self.kinematics, *springs(self.compliances)?);
        let pose = pose(self.request)?;
        let q = self.inverse(&pose)?.answer;
        Ok(json!({"q": machine.compensated(&pose, &q, &self.load()?, 1.0)?}))
    }
}
