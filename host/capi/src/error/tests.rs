//! Every error of core has a code of its own, and loses nothing on the way to it.

use std::collections::BTreeMap;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::units::{OffsetNm, TorquePermille, VelocityUmS};

use super::*;

/// One of each variant.
macro_rules! variants {
    ($($type:ty: $($variant:pat => $example:expr),+;)+) => {{
        let mut all: Vec<(String, gt_error)> = Vec::new();
        $(
            // Exhaustive: a new variant of core does not compile until it is listed.
            let _listed = |error: &$type| match error { $($variant => {})+ _ => {} };
            $({
                let example: $type = $example;
                all.push((format!("{}: {example:?}", stringify!($type)), example.into()));
            })+
        )+
        all
    }};
}

fn all() -> Vec<(String, gt_error)> {
    let offsets = Offsets {
        position: OffsetNm(-5),
        velocity: VelocityUmS(6),
        torque: TorquePermille(-7),
    };
    let parameter = Parameter::Guideway;
    variants! {
        LimitsError:
            LimitsError::NegativeMax { .. } => LimitsError::NegativeMax { max: -3 },
            LimitsError::RampNotPositive { .. } => LimitsError::RampNotPositive { ramp: -4 },
            LimitsError::RampAboveStep { .. } => LimitsError::RampAboveStep { ramp: 5, step: 4 },
            LimitsError::AccelTooSmall { .. } => LimitsError::AccelTooSmall { accel: 6, needed: 7 };
        ConfigError:
            ConfigError::Axes { .. } => ConfigError::Axes { axes: 4 },
            ConfigError::HandshakeTicks => ConfigError::HandshakeTicks,
            ConfigError::BudgetWindow { .. } => ConfigError::BudgetWindow { window: 129 },
            ConfigError::TorqueMax { .. } => ConfigError::TorqueMax { axis: 1 },
            ConfigError::Travel { .. } => ConfigError::Travel { axis: 2 },
            ConfigError::Margin { .. } => ConfigError::Margin { axis: 3 };
        StartError:
            StartError::OffsetInForce { .. } => StartError::OffsetInForce { axis: 2, offsets };
        MotorMapError:
            MotorMapError { .. } => MotorMapError { motor: 8, axis: 7, axes: 6 };
        Full:
            Full => Full;
        RobotError:
            RobotError::NotFinite { .. } => RobotError::NotFinite { parameter, index: 2 },
            RobotError::OutOfRange { .. } => RobotError::OutOfRange { parameter, index: 1, lower: 0.5, upper: 1.5 },
            RobotError::Reversed { .. } => RobotError::Reversed { parameter, index: 0 };
        NominalError:
            NominalError::NotRotation { .. } => NominalError::NotRotation { deviation: 0.25 },
            NominalError::NotTau { .. } => NominalError::NotTau { link: 4, mismatch_m: 0.125 };
        CompensatorError:
            CompensatorError::Gain => CompensatorError::Gain,
            CompensatorError::Limit { .. } => CompensatorError::Limit { axis: 1 },
            CompensatorError::MetresPerQ { .. } => CompensatorError::MetresPerQ { axis: 2 };
        KinematicsError:
            KinematicsError::NotFinite => KinematicsError::NotFinite,
            KinematicsError::Unreachable { .. } => KinematicsError::Unreachable { arm: 1 },
            KinematicsError::NoAssembly => KinematicsError::NoAssembly,
            KinematicsError::OtherBranch { .. } => KinematicsError::OtherBranch { arm: Some(2) },
            KinematicsError::Singular { .. } => KinematicsError::Singular { measure: 1e-5 },
            KinematicsError::OutOfRange { .. } => KinematicsError::OutOfRange { axis: 1, q: 3.0, lower: 1.0, upper: 2.0 },
            KinematicsError::NotConverged { .. } => KinematicsError::NotConverged { iterations: 10, residual_m: 0.5 },
            KinematicsError::SeedRequired => KinematicsError::SeedRequired,
            KinematicsError::Inconsistent { .. } => KinematicsError::Inconsistent { arm: 2 };
        SensorError:
            SensorError::NotRotation => SensorError::NotRotation,
            SensorError::OutOfRange { .. } => SensorError::OutOfRange { parameter: "cycle_s", lower: 1e-6, upper: 10.0 },
            SensorError::BadReading => SensorError::BadReading,
            SensorError::InvalidState => SensorError::InvalidState;
        CrossingError:
            CrossingError::NotFinite => CrossingError::NotFinite,
            CrossingError::OutOfRange { .. } => CrossingError::OutOfRange { limit_nm: 9 };
    }
}

#[test]
fn every_error_of_core_has_its_own_code_named_after_it() {
    let mut codes = BTreeMap::new();
    for (name, error) in all() {
        let code = format!("{:?}", error.code);
        // "LimitsError: NegativeMax { max: -3 }" is LimitsNegativeMax; a struct gives its family's name alone.
        let (family, variant) = name.split_once("Error: ").unwrap_or((&name, ""));
        let family = family.split(':').next().unwrap();
        let variant = variant.split([' ', '(']).next().unwrap();
        let variant = variant.strip_suffix("Error").map_or(variant, |_| "");
        assert_eq!(code, format!("{family}{variant}"));
        assert_eq!(codes.insert(code, name.clone()), None, "{name}");
    }
    assert_eq!(codes.len(), 36);
}

#[test]
fn nothing_that_an_error_carries_is_lost() {
    let of = |wanted: &str| {
        let mut found = all().into_iter().filter(|(name, _)| name.contains(wanted));
        let error = found.next().unwrap().1;
        let gt_error {
            index,
            parameter,
            iterations,
            value,
            lower,
            upper,
            ..
        } = error;
        (index, parameter, iterations, [value, lower, upper])
    };
    use gt_parameter::{Cycle, Guideway, None};
    assert_eq!(of("NegativeMax"), (-1, None, 0, [-3.0, 0.0, 0.0]));
    assert_eq!(of("RampAboveStep"), (-1, None, 0, [5.0, 0.0, 4.0]));
    assert_eq!(of("AccelTooSmall"), (-1, None, 0, [6.0, 7.0, 0.0]));
    assert_eq!(of("Axes {"), (-1, None, 0, [4.0, 0.0, 0.0]));
    assert_eq!(of("BudgetWindow"), (-1, None, 0, [129.0, 0.0, 0.0]));
    assert_eq!(of("Margin"), (3, None, 0, [0.0, 0.0, 0.0]));
    assert_eq!(of("OffsetInForce"), (2, None, 0, [-5.0, 6.0, -7.0]));
    assert_eq!(of("MotorMapError"), (8, None, 0, [7.0, 0.0, 6.0]));
    assert_eq!(
        of("RobotError: OutOfRange"),
        (1, Guideway, 0, [0.0, 0.5, 1.5])
    );
    assert_eq!(of("NotTau"), (4, None, 0, [0.125, 0.0, 0.0]));
    assert_eq!(
        of("KinematicsError: OutOfRange"),
        (1, None, 0, [3.0, 1.0, 2.0])
    );
    assert_eq!(of("NotConverged"), (-1, None, 10, [0.5, 0.0, 0.0]));
    assert_eq!(
        of("SensorError: OutOfRange"),
        (-1, Cycle, 0, [0.0, 1e-6, 10.0])
    );
    assert_eq!(
        of("CrossingError: OutOfRange"),
        (-1, None, 0, [0.0, -9.0, 9.0])
    );
}

#[test]
fn no_arm_is_not_the_first_arm() {
    let index = |arm| gt_error::from(KinematicsError::OtherBranch { arm }).index;
    assert_eq!([None, Some(0), Some(2)].map(index), [-1, 0, 2]);
}

#[test]
fn core_names_no_parameter_of_a_sensor_that_is_not_known_here() {
    use gantry_tau_core::model::sensor::{ForceSensor, SensorConfig};
    use nalgebra::{Matrix3, Vector3};
    let good = SensorConfig {
        rotation: Matrix3::identity(),
        lever_m: Vector3::zeros(),
        cutoff_hz: 20.0,
        cycle_s: 1e-3,
        tare_samples: 1,
    };
    let bad = [
        (
            SensorConfig {
                lever_m: Vector3::new(0.0, 11.0, 0.0),
                ..good
            },
            gt_parameter::Lever,
        ),
        (
            SensorConfig {
                cutoff_hz: 0.0,
                ..good
            },
            gt_parameter::Cutoff,
        ),
        (
            SensorConfig {
                cycle_s: 0.0,
                ..good
            },
            gt_parameter::Cycle,
        ),
        (
            SensorConfig {
                tare_samples: 0,
                ..good
            },
            gt_parameter::TareSamples,
        ),
    ];
    for (config, parameter) in bad {
        let error = gt_error::from(ForceSensor::new(config).unwrap_err());
        assert_eq!(
            (error.code, error.parameter),
            (gt_code::SensorOutOfRange, parameter)
        );
    }
}
