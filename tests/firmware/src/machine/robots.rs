//! Machines of the firmware, core's presets, with their server, sensor and compensation. The test
//! compares their checksums with `robots/*.toml`.

use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::message::{AxisLimits, Capabilities};
use gantry_tau_core::control::session::config::{AxisConfig, Parameters, Travel};
use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::model::nalgebra::{Matrix3, Vector3};
pub(crate) use gantry_tau_core::model::presets::F1_METRES_PER_Q;
use gantry_tau_core::model::robot::{Compliances, RobotError};
use gantry_tau_core::model::sensor::{LowPass, SensorConfig, Tool};
use gantry_tau_core::model::{f1, l2, presets};
use gantry_tau_core::units::OffsetNm;

use super::{AXES, SetupError};

/// The L2. A constant, so that it is copied; a function builds it number by number, which takes
/// twice the memory.
const L2: l2::Geometry = presets::l2();
/// The F1, its travel unchecked.
const F1: f1::Geometry = f1::Geometry {
    travel: None,
    ..presets::f1()
};

/// The L2 and its springs.
pub(crate) fn l2() -> Result<(l2::Robot, Compliances<{ l2::AXES }>), RobotError> {
    Ok((l2::Robot::new(L2)?, presets::l2_compliances()))
}

/// The F1 and its springs.
pub(crate) fn f1() -> Result<(f1::Robot, Compliances<AXES>), RobotError> {
    Ok((f1::Robot::new(F1)?, presets::f1_compliances()))
}

/// Mounting of the force sensor; the tare is shorter than that of the files, so that a recording
/// need not wait for it.
pub(crate) fn sensor() -> SensorConfig {
    SensorConfig {
        rotation: Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        lever_m: Vector3::new(0.0, 0.0, -0.08),
        tool: Tool {
            weight_n: Vector3::new(0.0, 0.0, -18.0),
            centre_m: Vector3::new(0.01, 0.0, -0.12),
        },
        low_pass: LowPass::FirstOrder,
        cutoff_hz: 20.0,
        cycle_s: 1e-3,
        tare_samples: 100,
    }
}

/// Compensation of either machine, given the length of one unit of each `q`, m.
pub(super) fn compensation<const N: usize>(metres_per_q: [f64; N]) -> CompensatorConfig<N> {
    CompensatorConfig {
        gain: 1.0,
        limits: [OffsetNm(4_000_000); N],
        metres_per_q,
    }
}

/// Server of the F1, with its limits of offsets. The travel is one for all axes, and wide enough
/// for both machines.
pub(crate) fn parameters(
    kinematics_checksum: u32,
    capabilities: Capabilities,
) -> Result<Parameters<AXES>, SetupError> {
    let limits = AxisLimits {
        position: limits(4_000_000, 20_000, 40_000, 100)?,
        velocity: limits(5_000, 200, 400, 50)?,
        torque: limits(50, 5, 10, 1)?,
    };
    let axis = AxisConfig::position_only(
        limits.position,
        Travel::around_zero(3_100_000_000),
        2_000_000,
    );
    Ok(Parameters {
        kinematics_checksum,
        capabilities,
        ..Parameters::thesis([AxisConfig { limits, ..axis }; AXES])
    })
}

fn limits<U>(max: i32, step: i32, accel: i32, ramp: i32) -> Result<Limits<U>, SetupError> {
    let values = LimitValues {
        max,
        step,
        accel,
        ramp,
    };
    Limits::new(values).map_err(|_| SetupError::Limits)
}
