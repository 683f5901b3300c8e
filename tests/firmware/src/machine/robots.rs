//! The machines of `robots/l2.toml` and `robots/f1.toml`: a target reads no files. The test compares their checksums.

use gantry_tau_core::control::channel::Limits;
use gantry_tau_core::control::message::{AxisLimits, Capabilities};
use gantry_tau_core::control::session::config::{AxisConfig, Parameters, Travel};
use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::model::robot::{Branch, Compliances, RobotError};
use gantry_tau_core::model::sensor::SensorConfig;
use gantry_tau_core::model::{f1, l2};
use gantry_tau_core::units::OffsetNm;
use nalgebra::{Matrix3, Vector3};

use super::{AXES, Refused};

/// Link compliances of both, m/N; assumed.
const LINKS_M_PER_N: [f64; 6] = [5.0e-7, 6.0e-7, 5.5e-7, 7.0e-7, 6.5e-7, 6.0e-7];

/// Length of one unit of each `q` of the F1, m.
pub(crate) const F1_METRES_PER_Q: [f64; AXES] = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1];

/// The L2 and its springs.
pub(crate) fn l2() -> Result<(l2::Robot, Compliances), RobotError> {
    let robot = l2::Robot::new(l2::Geometry {
        cart_joints_m: [
            Vector3::new(0.10, -0.05, 1.28),
            Vector3::new(-0.10, -0.29, 0.75),
            Vector3::new(0.10, -0.29, 0.75),
            Vector3::new(-0.12, -0.05, 0.05),
            Vector3::new(0.12, -0.05, 0.05),
            Vector3::new(0.00, 0.08, 0.05),
        ],
        guideways: [Vector3::x(); 3],
        platform_joints_m: [
            Vector3::new(0.10, -0.05, 0.03),
            Vector3::new(-0.10, 0.06, 0.05),
            Vector3::new(0.10, 0.06, 0.05),
            Vector3::new(-0.12, -0.05, -0.05),
            Vector3::new(0.12, -0.05, -0.05),
            Vector3::new(0.00, 0.08, -0.05),
        ],
        lengths_m: [1.0, 1.1, 1.0],
        configuration: l2::Configuration {
            inverse: [Branch::Positive, Branch::Negative, Branch::Positive],
            forward: Branch::Negative,
        },
        travel: Some([(-0.5, 2.0), (-2.0, 0.5), (-0.5, 2.0)]),
    })?;
    Ok((
        robot,
        Compliances::new(LINKS_M_PER_N, [4.06e-8, 5.09e-8, 6.00e-8])?,
    ))
}

/// The F1 and its springs.
pub(crate) fn f1() -> Result<(f1::Robot, Compliances<AXES>), RobotError> {
    let robot = f1::Robot::new(f1::Geometry {
        carts_m: [
            Vector3::new(-0.25, -1.12, 0.0),
            Vector3::new(1.15, 0.05, 0.0),
            Vector3::new(-1.0, 0.55, 0.0),
        ],
        guideways: [Vector3::z(); 3],
        plate_joints_m: [
            Vector3::new(-0.05, -0.1, 0.02),
            Vector3::new(0.0, -0.15, 0.0),
            Vector3::new(0.0, 0.15, 0.0),
            Vector3::new(0.11, -0.04, 0.0),
            Vector3::new(-0.11, -0.04, 0.0),
            Vector3::new(0.0, 0.1, 0.0),
        ],
        platform_joints_m: [
            Vector3::new(-0.05, -0.1, 0.02),
            Vector3::new(0.1, -0.15, 0.03),
            Vector3::new(0.1, 0.15, 0.03),
            Vector3::new(0.06, 0.1, 0.0),
            Vector3::new(-0.16, 0.1, 0.0),
            Vector3::new(-0.05, 0.24, 0.0),
        ],
        lengths_m: [1.7; 6],
        configuration: [Branch::Positive; 3],
        turn_axis: Vector3::z(),
        tilt_axis: Vector3::y(),
        turn_signs: [Branch::Negative, Branch::Positive],
        travel: None,
    })?;
    let axes = [4.2081e-6, 7.5215e-6, 5.5578e-6, 2.0e-6, 2.0e-6, 2.0e-6];
    Ok((robot, Compliances::new(LINKS_M_PER_N, axes)?))
}

/// How the force sensor is mounted; with a shorter tare than that of the files, which a recording need not wait for.
pub(crate) fn sensor() -> SensorConfig {
    SensorConfig {
        rotation: Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        lever_m: Vector3::new(0.0, 0.0, -0.08),
        cutoff_hz: 20.0,
        cycle_s: 1e-3,
        tare_samples: 100,
    }
}

/// The compensation of either machine, given the length of one unit of each `q`, m.
pub(super) fn compensation<const N: usize>(metres_per_q: [f64; N]) -> CompensatorConfig<N> {
    CompensatorConfig {
        gain: 1.0,
        limits: [OffsetNm(4_000_000); N],
        metres_per_q,
    }
}

/// The server of the F1, with its limits of offsets. The travel is one for all axes, and wide enough for both machines.
pub(crate) fn parameters(
    kinematics_checksum: u32,
    capabilities: Capabilities,
) -> Result<Parameters<AXES>, Refused> {
    let limits =
        |max, step, accel, ramp| Limits::new(max, step, accel, ramp).map_err(|_| Refused::Limits);
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
