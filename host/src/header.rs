//! `header`: a machine as a C header, for programs over the C interface (`host/capi`).

use std::fmt::{Debug, Write as _};
use std::path::PathBuf;

use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::session::config::AxisConfig;
use gantry_tau_core::model::robot::Branch;
use gantry_tau_core::model::{f1, l2};
use nalgebra::{Matrix3, Vector3};

use crate::files::{WriteError, write};
use crate::model::MachineKind;
use crate::robot_file::{AnyRobotFile, RobotFile};

/// Options of the header.
#[derive(Clone, Debug)]
pub struct HeaderOptions {
    /// The machine.
    pub robot: AnyRobotFile,
    /// Output file.
    pub output: PathBuf,
}

/// Failures of [`run`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum HeaderError {
    /// The directions `ax` and `ax6` do not survive the way through the header.
    #[error(
        "{0}: ax, ax6: unit vectors of these change when they are normalised again; write them with another length"
    )]
    Axes(String),
    /// The header cannot be written.
    #[error(transparent)]
    File(#[from] WriteError),
}

/// Writes the header.
///
/// # Errors
/// [`HeaderError`]; nothing is written then.
pub fn run(options: &HeaderOptions) -> Result<(), HeaderError> {
    Ok(write(&options.output, &text(&options.robot)?)?)
}

/// Returns the header of a machine.
///
/// # Errors
/// [`HeaderError::Axes`]: the C interface would compute another checksum.
pub fn text(robot: &AnyRobotFile) -> Result<String, HeaderError> {
    let mut header = Header(String::new());
    match robot {
        AnyRobotFile::L2(robot) => header.machine(robot, |header| header.l2(robot)),
        AnyRobotFile::F1(robot) => {
            let same = f1::Robot::new(robot.model.geometry());
            if same.map(|same| same.kinematics_checksum()) != Ok(robot.model.checksum()) {
                return Err(HeaderError::Axes(robot.name.clone()));
            }
            header.machine(robot, |header| header.f1(robot));
        }
    }
    Ok(header.0)
}

/// Text of the header so far.
struct Header(String);

impl Header {
    fn line(&mut self, text: impl AsRef<str>) {
        self.0.push_str(text.as_ref());
        self.0.push('\n');
    }

    fn define(&mut self, name: &str, value: impl std::fmt::Display) {
        self.line(format!("#define GANTRY_TAU_{name} {value}"));
    }

    /// A field of the geometry.
    fn field(&mut self, name: &str, value: impl AsRef<str>) {
        self.line(format!("    .{name} = {},", value.as_ref()));
    }

    fn machine<K: MachineKind<N>, const N: usize>(
        &mut self,
        robot: &RobotFile<K, N>,
        geometry: impl FnOnce(&mut Self),
    ) {
        self.line("/* A machine for the C interface of gantry-tau. Written by `gantry-tau header`. Do not edit. */");
        self.line("#ifndef GANTRY_TAU_MACHINE_H\n#define GANTRY_TAU_MACHINE_H\n\n#include \"gantry_tau.h\"\n");
        self.line(format!("#define GANTRY_TAU_MODEL_{}", K::MODEL.to_uppercase()));
        self.define("ROBOT", string(&robot.name));
        self.define("AXES", N);
        self.define("MOTORS", robot.motors.axis_of_motor.len());
        self.define("KINEMATICS_CHECKSUM", format!("0x{:08x}u", robot.model.checksum()));
        self.line(format!("\nstatic const struct gt_{}_geometry gantry_tau_geometry = {{", K::MODEL));
        geometry(self);
        self.field("metres_per_q", list(&robot.metres_per_q));
        self.line("};\n\n/* Home of the tool centre point, world axes, m. */");
        self.line(format!("static const double gantry_tau_home_m[3] = {};\n", vector(&robot.home_m())));
        self.line("/* Length of one unit of each axis, m. */");
        let metres_per_q = list(&robot.metres_per_q);
        self.line(format!("static const double gantry_tau_metres_per_q[GANTRY_TAU_AXES] = {metres_per_q};\n"));
        self.line("/* Limits of the offsets and travel of each axis. */");
        self.line("static const struct gt_axis_config gantry_tau_limits[GANTRY_TAU_AXES] = {");
        for axis in &robot.limits {
            self.limits(axis);
        }
        self.line("};\n\n/* Axis of each motor. */");
        let axis_of_motor = list(&robot.motors.axis_of_motor);
        self.line(format!(
            "static const uint8_t gantry_tau_axis_of_motor[GANTRY_TAU_MOTORS] = {axis_of_motor};\n\n#endif"
        ));
    }

    fn l2(&mut self, robot: &RobotFile<crate::model::L2, { l2::AXES }>) {
        let geometry = robot.model.robot().geometry();
        self.field("cart_joints_m", vectors(&geometry.cart_joints_m));
        self.field("guideways", vectors(&geometry.guideways));
        self.field("platform_joints_m", vectors(&geometry.platform_joints_m));
        self.field("lengths_m", list(&geometry.lengths_m));
        self.field("rotation", rows(robot.model.rotation()));
        self.field("inverse_branch", list(&geometry.configuration.inverse.map(sign)));
        self.field("forward_branch", sign(geometry.configuration.forward).to_string());
        self.travel(geometry.travel.as_ref());
    }

    fn f1(&mut self, robot: &RobotFile<crate::model::F1, { f1::AXES }>) {
        let geometry = robot.model.robot().geometry();
        self.field("carts_m", vectors(&geometry.carts_m));
        self.field("guideways", vectors(&geometry.guideways));
        self.field("plate_joints_m", vectors(&geometry.plate_joints_m));
        self.field("platform_joints_m", vectors(&geometry.platform_joints_m));
        self.field("lengths_m", list(&geometry.lengths_m));
        self.field("inverse_branch", list(&geometry.configuration.map(sign)));
        self.field("turn_axis", vector(&geometry.turn_axis));
        self.field("tilt_axis", vector(&geometry.tilt_axis));
        self.field("turn_signs", list(&geometry.turn_signs.map(sign)));
        self.travel(geometry.travel.as_ref());
    }

    fn travel<const N: usize>(&mut self, travel: Option<&[(f64, f64); N]>) {
        if let Some(travel) = travel {
            self.field("has_travel", "1");
            self.field("travel", joined(travel.iter().map(|&(lower, upper)| list(&[lower, upper]))));
        }
    }

    fn limits(&mut self, axis: &AxisConfig) {
        self.line("    {");
        self.line(format!("        .position = {},", channel(&axis.limits.position)));
        self.line(format!("        .velocity = {},", channel(&axis.limits.velocity)));
        self.line(format!("        .torque = {},", channel(&axis.limits.torque)));
        let (nominal, machine) = (axis.nominal_travel, axis.machine_travel);
        self.line(format!("        .nominal_lower_nm = {}, .nominal_upper_nm = {},", nominal.lower.0, nominal.upper.0));
        self.line(format!("        .machine_lower_nm = {}, .machine_upper_nm = {},", machine.lower.0, machine.upper.0));
        self.line(format!("        .nominal_step_nm = {},\n    }},", axis.nominal_step_nm));
    }
}

/// A string literal; what C does not print goes in as octal escapes.
fn string(text: &str) -> String {
    let mut literal = String::from('"');
    for byte in text.bytes() {
        // A question mark could begin a trigraph.
        if byte.is_ascii_graphic() && !matches!(byte, b'"' | b'\\' | b'?') || byte == b' ' {
            literal.push(byte.into());
        } else {
            // Writing to a string cannot fail.
            let _ = write!(literal, "\\{byte:03o}");
        }
    }
    literal + "\""
}

/// Numbers that a C compiler reads back to the bit.
fn list<T: Debug>(numbers: &[T]) -> String {
    joined(numbers.iter().map(|number| format!("{number:?}")))
}

fn joined(items: impl Iterator<Item = String>) -> String {
    format!("{{{}}}", items.collect::<Vec<_>>().join(", "))
}

fn vector(vector: &Vector3<f64>) -> String {
    list(vector.as_slice())
}

fn vectors(all: &[Vector3<f64>]) -> String {
    joined(all.iter().map(vector))
}

fn rows(matrix: &Matrix3<f64>) -> String {
    joined(matrix.row_iter().map(|row| vector(&row.transpose())))
}

const fn sign(branch: Branch) -> i32 {
    match branch {
        Branch::Positive => 1,
        Branch::Negative => -1,
    }
}

fn channel<U>(limits: &Limits<U>) -> String {
    let (max, step, accel, ramp) = (limits.max(), limits.step(), limits.accel(), limits.ramp());
    format!("{{.max = {max}, .step = {step}, .accel = {accel}, .ramp = {ramp}}}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A name with quotes, a trigraph and letters beyond ASCII stays inside its literal.
    #[test]
    fn any_name_is_one_literal() {
        assert_eq!(string("a b"), "\"a b\"");
        assert_eq!(string("\"\\?\u{e9}\n1"), "\"\\042\\134\\077\\303\\251\\0121\"");
    }
}
