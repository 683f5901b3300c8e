//! Conversion of core's errors, with all that they carry.

use gantry_tau_core::control::channel::LimitsError;
use gantry_tau_core::control::endpoint::{Full, MotorMapError};
use gantry_tau_core::control::session::StartError;
use gantry_tau_core::control::session::config::ConfigError;
use gantry_tau_core::model::compensation::CompensatorError;
use gantry_tau_core::model::kinematics::KinematicsError;
use gantry_tau_core::model::l2;
use gantry_tau_core::model::robot::{Parameter, RobotError};
use gantry_tau_core::model::sensor::SensorError;
use gantry_tau_core::units::CrossingError;

use crate::code::gt_code;
use crate::padding::{padded, without_padding};
use gt_code as Code;

/// Parameter that an error is about.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum gt_parameter {
    /// None, or implied by the code.
    None = 0,
    /// cart_joints_m; the index is the link.
    CartJoint = 1,
    /// guideways; the index is the arm.
    Guideway = 2,
    /// platform_joints_m; the index is the link.
    PlatformJoint = 3,
    /// lengths_m; the index is the arm (L2) or the link (F1).
    Length = 4,
    /// travel; the index is the axis.
    Travel = 5,
    /// link_m_per_n; the index is the link.
    LinkCompliance = 6,
    /// axis_per_n; the index is the axis.
    CartCompliance = 7,
    /// carts_m; the index is the arm.
    Cart = 8,
    /// plate_joints_m; the index is the link.
    PlateJoint = 9,
    /// turn_axis.
    TurnAxis = 10,
    /// tilt_axis.
    TiltAxis = 11,
    /// lever_m of a sensor.
    Lever = 12,
    /// cutoff_hz of a sensor.
    Cutoff = 13,
    /// cycle_s of a sensor.
    Cycle = 14,
    /// tare_samples of a sensor.
    TareSamples = 15,
    /// The position channel; the index is the axis.
    Position = 16,
    /// The velocity channel; the index is the axis.
    Velocity = 17,
    /// The torque channel; the index is the axis.
    Torque = 18,
    /// metres_per_q; the index is the axis.
    MetresPerQ = 19,
    /// `stop` of a gt_tick_input.
    Stop = 20,
    /// `rearm` of a gt_tick_input.
    Rearm = 21,
    /// `reading` of a gt_tick_input.
    Reading = 23,
    /// tool_weight_n of a sensor.
    ToolWeight = 24,
    /// tool_centre_m of a sensor.
    ToolCentre = 25,
    /// order of a sensor's low-pass.
    Order = 26,
    /// Frequency of a notch.
    NotchFrequency = 27,
    /// Q of a notch.
    NotchQ = 28,
    /// `status` of the sensor of a gt_tick_input.
    Sensor = 29,
}

/// Details of an error. The meaning of a field depends on the code; a field that the code does not
/// use is 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_error {
    /// The code that the call returned, GT_CODE_OK included.
    pub code: gt_code,
    /// Axis, arm, link or motor, counted from 0; -1 for none.
    pub index: i32,
    /// Parameter.
    pub parameter: gt_parameter,
    /// Number of linear solves.
    pub iterations: i32,
    /// Refused value, or a measure of its error.
    pub value: f64,
    /// Smallest accepted value.
    pub lower: f64,
    /// Largest accepted value.
    pub upper: f64,
}

without_padding!(gt_parameter);

padded! {
    gt_error { code index parameter iterations value lower upper }
}

impl gt_error {
    /// No error.
    pub(crate) const OK: Self = Self::new(Code::Ok);

    /// Creates an error without details.
    pub(crate) const fn new(code: gt_code) -> Self {
        Self {
            code,
            index: -1,
            parameter: gt_parameter::None,
            iterations: 0,
            value: 0.0,
            lower: 0.0,
            upper: 0.0,
        }
    }

    /// Sets the axis, arm, link or motor.
    pub(crate) fn at(self, index: usize) -> Self {
        let index = i32::try_from(index).unwrap_or(-1);
        Self { index, ..self }
    }

    /// Sets the parameter.
    pub(crate) const fn of(self, parameter: gt_parameter) -> Self {
        Self { parameter, ..self }
    }

    /// Sets the value.
    pub(crate) const fn value(self, value: f64) -> Self {
        Self { value, ..self }
    }

    /// Sets the accepted range.
    pub(crate) const fn range(self, lower: f64, upper: f64) -> Self {
        Self {
            lower,
            upper,
            ..self
        }
    }
}

/// Converts a count; all counts here are far below 2^53.
#[expect(clippy::as_conversions, reason = "total; rounds above 2^53")]
pub(crate) const fn count(count: usize) -> f64 {
    count as f64
}

/// Converts a count; all counts here are far below 2^32.
pub(crate) fn small(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// As [`count`].
#[expect(clippy::as_conversions, reason = "total; rounds above 2^53")]
const fn whole(number: i64) -> f64 {
    number as f64
}

impl From<gt_code> for gt_error {
    fn from(code: gt_code) -> Self {
        Self::new(code)
    }
}

impl From<LimitsError> for gt_error {
    fn from(error: LimitsError) -> Self {
        match error {
            LimitsError::NegativeMax { max } => {
                Self::new(Code::LimitsNegativeMax).value(max.into())
            }
            LimitsError::RampNotPositive { ramp } => {
                Self::new(Code::LimitsRampNotPositive).value(ramp.into())
            }
            LimitsError::RampAboveStep { ramp, step } => Self::new(Code::LimitsRampAboveStep)
                .value(ramp.into())
                .range(0.0, step.into()),
            LimitsError::AccelTooSmall { accel, needed } => Self::new(Code::LimitsAccelTooSmall)
                .value(accel.into())
                .range(whole(needed), 0.0),
            _ => Code::Other.into(),
        }
    }
}

impl From<ConfigError> for gt_error {
    fn from(error: ConfigError) -> Self {
        match error {
            ConfigError::Axes { axes } => Self::new(Code::ConfigAxes).value(count(axes)),
            ConfigError::HandshakeTicks => Code::ConfigHandshakeTicks.into(),
            ConfigError::BudgetWindow { window } => {
                Self::new(Code::ConfigBudgetWindow).value(window.into())
            }
            ConfigError::TorqueMax { axis } => Self::new(Code::ConfigTorqueMax).at(axis),
            ConfigError::Travel { axis } => Self::new(Code::ConfigTravel).at(axis),
            ConfigError::Margin { axis } => Self::new(Code::ConfigMargin).at(axis),
            ConfigError::Agitation { axis, nm_per_tick } => Self::new(Code::ConfigAgitation)
                .at(axis)
                .value(nm_per_tick.into()),
            _ => Code::Other.into(),
        }
    }
}

impl From<StartError> for gt_error {
    fn from(error: StartError) -> Self {
        match error {
            StartError::OffsetInForce { axis, offsets } => Self::new(Code::StartOffsetInForce)
                .at(axis)
                .value(offsets.position.0.into())
                .range(offsets.velocity.0.into(), offsets.torque.0.into()),
            _ => Code::Other.into(),
        }
    }
}

impl From<MotorMapError> for gt_error {
    fn from(error: MotorMapError) -> Self {
        let MotorMapError { motor, axis, axes } = error;
        Self::new(Code::MotorMap)
            .at(motor)
            .value(count(axis))
            .range(0.0, count(axes))
    }
}

impl From<Full> for gt_error {
    fn from(Full: Full) -> Self {
        Code::Full.into()
    }
}

impl From<RobotError> for gt_error {
    fn from(error: RobotError) -> Self {
        match error {
            RobotError::NotFinite { parameter, index } => Self::new(Code::RobotNotFinite)
                .of(parameter.into())
                .at(index),
            RobotError::OutOfRange {
                parameter,
                index,
                lower,
                upper,
            } => Self::new(Code::RobotOutOfRange)
                .of(parameter.into())
                .at(index)
                .range(lower, upper),
            RobotError::Reversed { parameter, index } => Self::new(Code::RobotReversed)
                .of(parameter.into())
                .at(index),
        }
    }
}

by_name!(Parameter => gt_parameter {
    CartJoint Guideway PlatformJoint Length Travel LinkCompliance CartCompliance Cart PlateJoint TurnAxis TiltAxis
});

impl From<l2::OrientationError> for gt_error {
    fn from(error: l2::OrientationError) -> Self {
        match error {
            l2::OrientationError::NotRotation { deviation } => {
                Self::new(Code::OrientationNotRotation).value(deviation)
            }
            l2::OrientationError::NotTau { link, mismatch_m } => Self::new(Code::OrientationNotTau)
                .at(link)
                .value(mismatch_m),
        }
    }
}

impl From<CompensatorError> for gt_error {
    fn from(error: CompensatorError) -> Self {
        match error {
            CompensatorError::Gain => Code::CompensatorGain.into(),
            CompensatorError::Limit { axis } => Self::new(Code::CompensatorLimit).at(axis),
            CompensatorError::MetresPerQ { axis } => {
                Self::new(Code::CompensatorMetresPerQ).at(axis)
            }
        }
    }
}

impl From<KinematicsError> for gt_error {
    fn from(error: KinematicsError) -> Self {
        match error {
            KinematicsError::NotFinite => Code::KinematicsNotFinite.into(),
            KinematicsError::Unreachable { arm } => Self::new(Code::KinematicsUnreachable).at(arm),
            KinematicsError::NoAssembly => Code::KinematicsNoAssembly.into(),
            KinematicsError::OtherBranch { arm: Some(arm) } => {
                Self::new(Code::KinematicsOtherBranch).at(arm)
            }
            KinematicsError::OtherBranch { arm: None } => Code::KinematicsOtherBranch.into(),
            KinematicsError::Singular { measure } => {
                Self::new(Code::KinematicsSingular).value(measure)
            }
            KinematicsError::OutOfRange {
                axis,
                q,
                lower,
                upper,
            } => Self::new(Code::KinematicsOutOfRange)
                .at(axis)
                .value(q)
                .range(lower, upper),
            KinematicsError::NotConverged {
                iterations,
                residual_m,
            } => Self {
                iterations: iterations.into(),
                ..Self::new(Code::KinematicsNotConverged).value(residual_m)
            },
            KinematicsError::SeedRequired => Code::KinematicsSeedRequired.into(),
            KinematicsError::Inconsistent { arm } => {
                Self::new(Code::KinematicsInconsistent).at(arm)
            }
        }
    }
}

impl From<SensorError> for gt_error {
    fn from(error: SensorError) -> Self {
        match error {
            SensorError::NotRotation => Code::SensorNotRotation.into(),
            SensorError::OutOfRange {
                parameter,
                lower,
                upper,
            } => Self::new(Code::SensorOutOfRange)
                .of(sensor_parameter(parameter))
                .range(lower, upper),
            SensorError::BadReading => Code::SensorBadReading.into(),
            SensorError::InvalidState => Code::SensorInvalidState.into(),
            SensorError::PlatformNotRotation => Code::SensorPlatformNotRotation.into(),
        }
    }
}

/// Returns the parameter for the name of a field of core's `SensorConfig`.
fn sensor_parameter(name: &str) -> gt_parameter {
    match name {
        "lever_m" => gt_parameter::Lever,
        "cutoff_hz" => gt_parameter::Cutoff,
        "cycle_s" => gt_parameter::Cycle,
        "tare_samples" => gt_parameter::TareSamples,
        "tool.weight_n" => gt_parameter::ToolWeight,
        "tool.centre_m" => gt_parameter::ToolCentre,
        "notch.hz" => gt_parameter::NotchFrequency,
        "notch.q" => gt_parameter::NotchQ,
        _ => gt_parameter::None,
    }
}

impl From<CrossingError> for gt_error {
    fn from(error: CrossingError) -> Self {
        match error {
            CrossingError::NotFinite => Code::CrossingNotFinite.into(),
            CrossingError::OutOfRange { limit_nm } => Self::new(Code::CrossingOutOfRange)
                .range(whole(limit_nm.saturating_neg()), whole(limit_nm)),
        }
    }
}

#[cfg(test)]
mod tests;
