//! `header`: a machine as a C header, for programs over the C interface (`host/capi`).

use std::fmt::{Debug, Write as _};
use std::str::FromStr;

use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::session::config::AxisConfig;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::robot::Branch;
use gantry_tau_core::model::sensor::LowPass;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{AnyRobotFile, CorrectionKind, RobotFile};
use gantry_tau_machine::sensor;
use gantry_tau_machine::stability::NotchFinder;
use gantry_tau_system::output::{Output, WriteError};
use nalgebra::{Matrix3, Vector3};

/// Options of the header.
#[derive(Clone, Debug)]
pub struct HeaderOptions {
    /// The machine.
    pub robot: AnyRobotFile,
    /// First part of every name in the header; a program with two machines gives each its own.
    pub prefix: Prefix,
    /// Output file.
    pub output: Output,
}

/// First part of the names in a header: letters, digits and underscores, the first a letter, in
/// lower case.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Prefix(String);

impl Default for Prefix {
    fn default() -> Self {
        Self("gantry_tau".to_owned())
    }
}

/// A text that is not a prefix of names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected lower-case letters, digits and underscores, beginning with a letter")]
pub struct ParsePrefixError;

impl FromStr for Prefix {
    type Err = ParsePrefixError;

    fn from_str(text: &str) -> Result<Self, ParsePrefixError> {
        let is_name = text
            .bytes()
            .all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'_'));
        if is_name && text.starts_with(|first: char| first.is_ascii_lowercase()) {
            Ok(Self(text.to_owned()))
        } else {
            Err(ParsePrefixError)
        }
    }
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
    options
        .output
        .write(&text(&options.robot, &options.prefix)?)?;
    Ok(())
}

/// Returns the header of a machine, with names that begin with `prefix`.
///
/// # Errors
/// [`HeaderError::Axes`]: the C interface would compute another checksum.
pub fn text(robot: &AnyRobotFile, prefix: &Prefix) -> Result<String, HeaderError> {
    let mut header = Header {
        text: String::new(),
        prefix: prefix.0.clone(),
        macros: prefix.0.to_uppercase(),
    };
    match robot {
        AnyRobotFile::L2(robot) => header.machine(robot, |header| header.l2(robot)),
        AnyRobotFile::F1(robot) => {
            let same = f1::Robot::new(robot.model.geometry());
            if same.as_ref().map(f1::Robot::geometry) != Ok(robot.model.robot().geometry()) {
                return Err(HeaderError::Axes(robot.name.clone()));
            }
            header.machine(robot, |header| header.f1(robot));
        }
    }
    Ok(header.text)
}

/// A header so far.
struct Header {
    text: String,
    /// First part of the names of constants.
    prefix: String,
    /// The same of macros.
    macros: String,
}

impl Header {
    fn line(&mut self, text: impl AsRef<str>) {
        self.text.push_str(text.as_ref());
        self.text.push('\n');
    }

    fn define(&mut self, name: &str, value: impl std::fmt::Display) {
        self.line(format!("#define {}_{name} {value}", self.macros));
    }

    /// Begins a constant, with a comment.
    fn constant(&mut self, comment: &str, kind: &str, name: &str) {
        self.line(format!(
            "\n/* {comment} */\nstatic const {kind} {}_{name} = {{",
            self.prefix
        ));
    }

    fn end(&mut self) {
        self.line("};");
    }

    /// A constant that is an array; `size` is a number or one of the header's macros.
    fn array(&mut self, comment: &str, kind: &str, name: &str, size: &str, values: &str) {
        self.line(format!(
            "\n/* {comment} */\nstatic const {kind} {}_{name}[{size}] = {values};",
            self.prefix
        ));
    }

    /// A field of a struct.
    fn field(&mut self, name: &str, value: impl AsRef<str>) {
        self.line(format!("    .{name} = {},", value.as_ref()));
    }

    fn machine<K: MachineKind<N>, const N: usize>(
        &mut self,
        robot: &RobotFile<K, N>,
        geometry: impl FnOnce(&mut Self),
    ) {
        let (axes, motors) = (
            format!("{}_AXES", self.macros),
            format!("{}_MOTORS", self.macros),
        );
        self.line("/* A machine for the C interface of gantry-tau. Written by `gantry-tau header`. Do not edit. */");
        let guard = format!("{}_MACHINE_H", self.macros);
        self.line(format!(
            "#ifndef {guard}\n#define {guard}\n\n#include \"gantry_tau.h\"\n"
        ));
        self.line(format!(
            "#define {}_MODEL_{}",
            self.macros,
            K::MODEL.to_uppercase()
        ));
        self.define("ROBOT", string(&robot.name));
        self.define("AXES", N);
        self.define("MOTORS", robot.motors.axis_of_motor.len());
        self.define(
            "KINEMATICS_CHECKSUM",
            format!("0x{:08x}u", robot.checksum()),
        );
        self.constant(
            "Geometry, with the length of one unit of each axis.",
            &format!("gt_{}_geometry", K::MODEL),
            "geometry",
        );
        geometry(self);
        self.field("metres_per_q", list(&robot.metres_per_q));
        self.end();
        let home_m = vector(&robot.home_m());
        let metres_per_q = list(&robot.metres_per_q);
        self.array(
            "Home of the tool centre point, world axes, m.",
            "double",
            "home_m",
            "3",
            &home_m,
        );
        self.array(
            "Length of one unit of each axis, m.",
            "double",
            "metres_per_q",
            &axes,
            &metres_per_q,
        );
        self.constant(
            "Limits of the offsets and travel of each axis.",
            "gt_axis_config",
            &format!("limits[{axes}]"),
        );
        for axis in &robot.limits {
            self.limits(axis);
        }
        self.end();
        let axis_of_motor = list(&robot.motors.axis_of_motor);
        self.array(
            "Axis of each motor.",
            "uint8_t",
            "axis_of_motor",
            &motors,
            &axis_of_motor,
        );
        self.springs(robot);
        self.sensor(robot);
        self.line("\n#endif");
    }

    /// Springs, share and limits of the correction; absent in a file without compliances.
    fn springs<K: MachineKind<N>, const N: usize>(&mut self, robot: &RobotFile<K, N>) {
        self.line(
            "\n/* 1: the robot file has compliances, and there is a compensator; 0: it must be identified first. */",
        );
        self.define("HAS_COMPENSATOR", u8::from(robot.compliances.is_some()));
        self.line(
            "/* 1: correct by the exact map (gt_..._exact_correction); 0: to first order (gt_..._correction). */",
        );
        self.define(
            "EXACT_CORRECTION",
            u8::from(robot.correction() == CorrectionKind::Exact),
        );
        self.line("/* Joints between platform and tool that give way; the C interface does not correct for them. */");
        self.define("WRIST_JOINTS", robot.wrist.len());
        let Some(compliances) = &robot.compliances else {
            return;
        };
        let about = "Compliances of links and axes, limits of position offsets, and share of the correction.";
        self.constant(about, "gt_compensator_config", "compensator");
        self.field("link_m_per_n", list(compliances.link_m_per_n()));
        self.field("axis_per_n", list(compliances.cart_m_per_n()));
        self.field(
            "limits_nm",
            list(&robot.limits.map(|axis| axis.limits.position.max())),
        );
        self.field("gain", format!("{:?}", robot.client.gain));
        self.end();
    }

    fn sensor<K: MachineKind<N>, const N: usize>(&mut self, robot: &RobotFile<K, N>) {
        let config = sensor::config(robot);
        if robot.sensor.accelerometer.is_some() {
            self.line("\n/* Its filter is for a load without the tool's inertia, as an accelerometer measures it; the C interface has none. */");
            self.define("NEEDS_ACCELEROMETER", 1);
        }
        self.constant(
            "Force sensor: mounting, tool and filter, for one sample per cycle.",
            "gt_sensor_config",
            "sensor",
        );
        self.field("rotation", rows(&config.rotation));
        self.field("lever_m", vector(&config.lever_m));
        self.field("tool_weight_n", vector(&config.tool.weight_n));
        self.field("tool_centre_m", vector(&config.tool.centre_m));
        self.field("cutoff_hz", format!("{:?}", config.cutoff_hz));
        self.field("cycle_s", format!("{:?}", config.cycle_s));
        self.field("tare_samples", config.tare_samples.to_string());
        let order = match config.low_pass {
            LowPass::FirstOrder => 1,
            LowPass::SecondOrder => 2,
        };
        self.field("order", order.to_string());
        self.end();
        self.notches(robot);
    }

    /// Notches behind the low-pass at home.
    fn notches<K: MachineKind<N>, const N: usize>(&mut self, robot: &RobotFile<K, N>) {
        let home = Pose::at(robot.home_m());
        let at_home = NotchFinder::of(robot)
            .zip(robot.home_q().ok())
            .and_then(|(finder, axes)| finder.at(&home, &axes));
        let hz = at_home
            .unwrap_or_default()
            .map(|notch| notch.map_or(0.0, |notch| notch.hz));
        self.array(
            "Frequencies of the notches of the force sensor's filter with the tool at home, Hz, for gt_sensor_set_notches; 0: no notch.",
            "double",
            "notches_hz",
            "3",
            &list(&hz),
        );
        self.line("/* Their Q. */");
        self.define("NOTCH_Q", format!("{:?}", robot.sensor.notch_q));
    }

    fn l2(&mut self, robot: &RobotFile<gantry_tau_machine::model::L2, { l2::AXES }>) {
        let geometry = robot.model.robot().geometry();
        self.field("cart_joints_m", vectors(&geometry.cart_joints_m));
        self.field("guideways", vectors(&geometry.guideways));
        self.field("platform_joints_m", vectors(&geometry.platform_joints_m));
        self.field("lengths_m", list(&geometry.lengths_m));
        self.field("rotation", rows(robot.model.rotation()));
        self.field(
            "inverse_branch",
            list(&geometry.configuration.inverse.map(sign)),
        );
        self.field(
            "forward_branch",
            sign(geometry.configuration.forward).to_string(),
        );
        self.travel(geometry.travel.as_ref());
    }

    fn f1(&mut self, robot: &RobotFile<gantry_tau_machine::model::F1, { f1::AXES }>) {
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
            self.field(
                "travel",
                joined(travel.iter().map(|&(lower, upper)| list(&[lower, upper]))),
            );
        }
    }

    fn limits(&mut self, axis: &AxisConfig) {
        self.line("    {");
        self.line(format!(
            "        .position = {},",
            channel(&axis.limits.position)
        ));
        self.line(format!(
            "        .velocity = {},",
            channel(&axis.limits.velocity)
        ));
        self.line(format!(
            "        .torque = {},",
            channel(&axis.limits.torque)
        ));
        let (nominal, machine) = (axis.nominal_travel, axis.machine_travel);
        self.line(format!(
            "        .nominal_lower_nm = {}, .nominal_upper_nm = {},",
            nominal.lower.0, nominal.upper.0
        ));
        self.line(format!(
            "        .machine_lower_nm = {}, .machine_upper_nm = {},",
            machine.lower.0, machine.upper.0
        ));
        self.line(format!(
            "        .nominal_step_nm = {},",
            axis.nominal_step_nm
        ));
        if let Some(limit) = axis.nominal_accel {
            self.line(format!(
                "        .nominal_accel_nm = {}, .nominal_accel_is_fault = {},",
                limit.nm,
                u8::from(limit.is_fault)
            ));
        }
        if let Some(budget) = axis.agitation {
            self.line(format!(
                "        .agitation_nm_per_tick = {},",
                budget.nm_per_tick
            ));
        }
        self.line("    },");
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
        assert_eq!(
            string("\"\\?\u{e9}\n1"),
            "\"\\042\\134\\077\\303\\251\\0121\""
        );
    }

    /// A prefix is the beginning of a name in C.
    #[test]
    fn a_prefix_is_the_beginning_of_a_name() {
        assert_eq!("gantry_tau".parse(), Ok(Prefix::default()));
        assert!("l2".parse::<Prefix>().is_ok());
        for wrong in ["", "2l", "_l2", "l 2", "L2", "l2;", "\u{e9}"] {
            assert!(wrong.parse::<Prefix>().is_err(), "{wrong:?}");
        }
    }
}
