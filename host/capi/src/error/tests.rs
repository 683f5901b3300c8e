//! Every error of core has a code of its own, and keeps all that it carries.

use std::collections::BTreeMap;
use std::path::Path;

use gantry_tau_core::control::axis::Offsets;
use gantry_tau_core::model::l2::OrientationError;
use gantry_tau_core::units::{OffsetNm, TorquePermille, VelocityUmS};

use super::*;

/// An error of core, and what its code comes with: index, parameter, iterations, value, lower and
/// upper end.
struct Example {
    family: &'static str,
    text: String,
    error: gt_error,
    carried: (i32, gt_parameter, i32, [f64; 3]),
}

/// One example of every variant, by type.
macro_rules! examples {
    ($($type:ident { $($example:expr => $carried:expr),+ $(,)? })+) => {
        vec![$($({
            let example: $type = $example;
            Example { family: stringify!($type), text: format!("{example:?}"), error: example.into(), carried: $carried }
        }),+),+]
    };
}

/// Code without anything else.
const ALONE: (i32, gt_parameter, i32, [f64; 3]) = (-1, gt_parameter::None, 0, [0.0; 3]);

/// Code with an index.
const fn at(index: i32) -> (i32, gt_parameter, i32, [f64; 3]) {
    (index, gt_parameter::None, 0, [0.0; 3])
}

fn all() -> Vec<Example> {
    use gt_parameter::{Cycle, Guideway, None};
    let offsets = Offsets {
        position: OffsetNm(-5),
        velocity: VelocityUmS(6),
        torque: TorquePermille(-7),
    };
    let parameter = Parameter::Guideway;
    examples! {
        LimitsError {
            LimitsError::NegativeMax { max: -3 } => (-1, None, 0, [-3.0, 0.0, 0.0]),
            LimitsError::RampNotPositive { ramp: -4 } => (-1, None, 0, [-4.0, 0.0, 0.0]),
            LimitsError::RampAboveStep { ramp: 5, step: 4 } => (-1, None, 0, [5.0, 0.0, 4.0]),
            LimitsError::AccelTooSmall { accel: 6, needed: 7 } => (-1, None, 0, [6.0, 7.0, 0.0]),
        }
        ConfigError {
            ConfigError::Axes { axes: 4 } => (-1, None, 0, [4.0, 0.0, 0.0]),
            ConfigError::HandshakeTicks => ALONE,
            ConfigError::BudgetWindow { window: 129 } => (-1, None, 0, [129.0, 0.0, 0.0]),
            ConfigError::TorqueMax { axis: 1 } => at(1),
            ConfigError::Travel { axis: 2 } => at(2),
            ConfigError::Margin { axis: 3 } => at(3),
            ConfigError::Agitation { axis: 1, nm_per_tick: 1_000_001 } => (1, None, 0, [1_000_001.0, 0.0, 0.0]),
        }
        StartError {
            StartError::OffsetInForce { axis: 2, offsets } => (2, None, 0, [-5.0, 6.0, -7.0]),
        }
        MotorMapError {
            MotorMapError { motor: 8, axis: 7, axes: 6 } => (8, None, 0, [7.0, 0.0, 6.0]),
        }
        Full {
            Full => ALONE,
        }
        RobotError {
            RobotError::NotFinite { parameter, index: 2 } => (2, Guideway, 0, [0.0; 3]),
            RobotError::OutOfRange { parameter, index: 1, lower: 0.5, upper: 1.5 } => (1, Guideway, 0, [0.0, 0.5, 1.5]),
            RobotError::Reversed { parameter, index: 0 } => (0, Guideway, 0, [0.0; 3]),
        }
        OrientationError {
            OrientationError::NotRotation { deviation: 0.25 } => (-1, None, 0, [0.25, 0.0, 0.0]),
            OrientationError::NotTau { link: 4, mismatch_m: 0.125 } => (4, None, 0, [0.125, 0.0, 0.0]),
        }
        CompensatorError {
            CompensatorError::Gain => ALONE,
            CompensatorError::Limit { axis: 1 } => at(1),
            CompensatorError::MetresPerQ { axis: 2 } => at(2),
        }
        KinematicsError {
            KinematicsError::NotFinite => ALONE,
            KinematicsError::Unreachable { arm: 1 } => at(1),
            KinematicsError::NoAssembly => ALONE,
            KinematicsError::OtherBranch { arm: Some(2) } => at(2),
            KinematicsError::Singular { measure: 1e-5 } => (-1, None, 0, [1e-5, 0.0, 0.0]),
            KinematicsError::OutOfRange { axis: 1, q: 3.0, lower: 1.0, upper: 2.0 } => (1, None, 0, [3.0, 1.0, 2.0]),
            KinematicsError::NotConverged { iterations: 10, residual_m: 0.5 } => (-1, None, 10, [0.5, 0.0, 0.0]),
            KinematicsError::SeedRequired => ALONE,
            KinematicsError::Inconsistent { arm: 2 } => at(2),
        }
        SensorError {
            SensorError::NotRotation => ALONE,
            SensorError::PlatformNotRotation => ALONE,
            SensorError::OutOfRange { parameter: "cycle_s", lower: 1e-6, upper: 10.0 } => (-1, Cycle, 0, [0.0, 1e-6, 10.0]),
            SensorError::BadReading => ALONE,
            SensorError::InvalidState => ALONE,
        }
        CrossingError {
            CrossingError::NotFinite => ALONE,
            CrossingError::OutOfRange { limit_nm: 9 } => (-1, None, 0, [0.0, -9.0, 9.0]),
        }
    }
}

/// Number of variants of a public enum in core's sources, which are rustfmt's; 1 for a struct. The
/// compiler cannot tell: a `#[non_exhaustive]` enum matches outside its crate with a wildcard only.
fn variants_in_core(folder: &Path, name: &str) -> usize {
    let mut found = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found += variants_in_core(&path, name);
            continue;
        }
        let source = std::fs::read_to_string(&path).unwrap();
        if source.contains(&format!("\npub struct {name}")) {
            found += 1;
        }
        if let Some((_, body)) = source.split_once(&format!("\npub enum {name} {{\n")) {
            let lines = body.lines().take_while(|line| *line != "}");
            let names = lines.filter_map(|line| line.strip_prefix("    "));
            found += names
                .filter(|name| name.starts_with(char::is_uppercase))
                .count();
        }
    }
    found
}

#[test]
fn every_error_of_core_has_its_own_code_named_after_it_and_loses_nothing() {
    let mut codes = BTreeMap::new();
    let mut types = BTreeMap::new();
    for Example {
        family,
        text,
        error,
        carried,
    } in all()
    {
        let gt_error {
            code,
            index,
            parameter,
            iterations,
            value,
            lower,
            upper,
        } = error;
        assert_eq!(
            (index, parameter, iterations, [value, lower, upper]),
            carried,
            "{family}: {text}"
        );
        let code = format!("{code:?}");
        // LimitsError::NegativeMax is LimitsNegativeMax; a struct has the name of its family.
        let variant = text.split([' ', '(']).next().unwrap();
        let variant = variant.strip_prefix(family).unwrap_or(variant);
        let name = family.strip_suffix("Error").unwrap_or(family);
        assert_eq!(code, format!("{name}{variant}"));
        assert_eq!(codes.insert(code, text.clone()), None, "{text}");
        *types.entry(family).or_insert(0) += 1;
    }
    let core = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../core/src");
    for (name, examples) in types {
        assert_eq!(
            variants_in_core(&core, name),
            examples,
            "variants of {name}"
        );
    }
}

#[test]
fn no_arm_is_not_the_first_arm() {
    for (arm, index) in [(None, -1), (Some(0), 0), (Some(2), 2)] {
        let error = gt_error::from(KinematicsError::OtherBranch { arm });
        assert_eq!(error.index, index);
    }
}
