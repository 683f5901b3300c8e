//! The operations, each a thin call of core.

use gantry_tau_core::compensation::compensated;
use gantry_tau_core::kinematics::{KinematicsError, Nominal, NominalError, Pose, residual_m};
use gantry_tau_core::statics::{LineMatrix, Wrench, cart_loads_from_jacobian};
use gantry_tau_core::stiffness::TauModel;
use nalgebra::{Matrix3, SMatrix, Vector3};
use serde_json::{Value, json};

use super::request::{Machine, field, matrix, optional_field};
use super::{Failure, Kind};

/// Every operation there is.
pub(super) const NAMES: [&str; 7] = [
    "ik",
    "fk",
    "jacobian",
    "statics",
    "compliance",
    "deflection",
    "compensate",
];

impl From<KinematicsError> for Failure {
    fn from(error: KinematicsError) -> Self {
        Self {
            kind: Kind::Core(error.kind()),
            message: error.to_string(),
        }
    }
}

impl From<NominalError> for Failure {
    fn from(error: NominalError) -> Self {
        match error {
            NominalError::NotRotation { .. } => Self::request(error.to_string()),
            NominalError::NotTau { .. } => Self::robot(error.to_string()),
        }
    }
}

/// A request whose robot and orientation are known.
struct Task<'a> {
    machine: &'a Machine,
    request: &'a Value,
    nominal: Nominal,
}

/// One of [`NAMES`].
pub(super) fn solve(op: &str, machine: &Machine, request: &Value) -> Result<Value, Failure> {
    let task = Task {
        machine,
        request,
        nominal: Nominal::new(&machine.robot, &orientation(request)?)?,
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

    fn pose(&self, position_m: Vector3<f64>) -> Pose {
        Pose {
            position_m,
            rotation: *self.nominal.rotation(),
        }
    }

    /// The six links where `T` puts them, by the general path.
    fn lines(&self) -> Result<LineMatrix, Failure> {
        let tcp = self.tcp()?;
        let q = self.nominal.inverse_in_assembly(&tcp)?;
        Ok(LineMatrix::new(&self.machine.robot, &self.pose(tcp), &q)?)
    }

    fn residual(&self, tcp: Vector3<f64>, q: &[f64; 3]) -> Result<f64, Failure> {
        let residual = residual_m(&self.machine.robot, &self.pose(tcp), q);
        finite([residual])?;
        Ok(residual)
    }

    fn ik(&self) -> Result<Value, Failure> {
        let tcp = self.tcp()?;
        let q = self.nominal.inverse_in_assembly(&tcp)?;
        let residual = self.residual(tcp, &q)?;
        Ok(json!({"q": q, "iterations": 0, "residual": residual}))
    }

    fn fk(&self) -> Result<Value, Failure> {
        let q = field(self.request, "q")?;
        let tcp = self.nominal.forward(&q)?;
        let residual = self.residual(tcp, &q)?;
        Ok(json!({
            "T": <[f64; 3]>::from(tcp),
            "R": rows(self.nominal.rotation()),
            "iterations": 0,
            "residual": residual,
        }))
    }

    fn jacobian(&self) -> Result<Value, Failure> {
        let jacobian = self.nominal.jacobian(&self.tcp()?)?;
        finite(jacobian.iter().copied())?;
        Ok(json!({"J": rows(&jacobian)}))
    }

    fn statics(&self) -> Result<Value, Failure> {
        let load = self.load()?;
        let forces = self.lines()?.link_forces_n(&load)?;
        let jacobian = self.nominal.jacobian(&self.tcp()?)?;
        let tau = cart_loads_from_jacobian(&jacobian, &load.force_n);
        finite(tau)?;
        Ok(json!({"f": forces, "tau": tau}))
    }

    fn compliance(&self) -> Result<Value, Failure> {
        let springs = self.machine.springs()?;
        let compliance = self.lines()?.compliance(springs)?;
        Ok(json!({"C": rows(&compliance.0)}))
    }

    fn deflection(&self) -> Result<Value, Failure> {
        let springs = self.machine.springs()?;
        let deflection = self.lines()?.deflection(springs, &self.load()?)?;
        Ok(json!({
            "r": deflection.carts,
            "dx_links": deflection.links.to_array(),
            "dx_total": deflection.total.to_array(),
        }))
    }

    fn compensate(&self) -> Result<Value, Failure> {
        let model = TauModel::new(&self.nominal, self.machine.springs()?);
        let tcp = self.tcp()?;
        let load = self.load()?;
        let q = self.nominal.inverse_in_assembly(&tcp)?;
        let command = compensated(&model, &tcp, &q, &load, 1.0)?;
        finite(command)?;
        Ok(json!({"q": command}))
    }
}

/// JSON has no word for what is not finite.
fn finite(values: impl IntoIterator<Item = f64>) -> Result<(), Failure> {
    if values.into_iter().all(f64::is_finite) {
        Ok(())
    } else {
        Err(KinematicsError::NotFinite.into())
    }
}

/// A matrix as nested arrays, by rows.
fn rows<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Vec<Vec<f64>> {
    (matrix.row_iter())
        .map(|row| row.iter().copied().collect())
        .collect()
}
