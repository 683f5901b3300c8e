//! From a raw force sample and the nominal positions to offsets, with core's sensor and compensator.

use std::fmt;

use gantry_tau_core::compensation::{Compensator, CompensatorConfig};
use gantry_tau_core::kinematics::{KinematicsError, Nominal};
use gantry_tau_core::message::Welcome;
use gantry_tau_core::robot::ARMS;
use gantry_tau_core::sensor::{ForceSensor, Reading, SensorConfig, SensorError};
use gantry_tau_core::statics::Wrench;
use gantry_tau_core::units::{OffsetNm, PositionNm};
use nalgebra::Matrix3;

use crate::robot_file::RobotFile;

/// Tares, filters and compensates, once per cycle.
#[derive(Clone, Debug)]
pub struct Compensation {
    sensor: ForceSensor,
    compensator: Compensator,
    metres_per_q: [f64; ARMS],
    load: Wrench,
    tared: bool,
}

/// Why a cycle has no correction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CompensationError {
    /// The sample cannot be used.
    Sensor(SensorError),
    /// The positions cannot be.
    Kinematics(KinematicsError),
}

impl fmt::Display for CompensationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sensor(error) => error.fmt(f),
            Self::Kinematics(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for CompensationError {}

impl Compensation {
    /// For the machine of a robot file, within the limits that the server announced.
    ///
    /// # Errors
    /// A sentence that names the parameter.
    pub fn new(robot: &RobotFile, welcome: &Welcome<ARMS>) -> Result<Self, String> {
        let said = |error: &dyn fmt::Display| format!("{}: {error}", robot.name);
        let nominal =
            Nominal::new(&robot.robot, &Matrix3::identity()).map_err(|error| said(&error))?;
        let compliances = robot.compliances.as_ref().ok_or_else(|| {
            said(&"c_link and c_cart are missing; a compensating client needs them")
        })?;
        let config = CompensatorConfig {
            gain: robot.client.gain,
            limits: welcome.limits.map(|axis| OffsetNm(axis.position.max())),
            metres_per_q: robot.axes.metres_per_q,
        };
        let compensator =
            Compensator::new(&nominal, compliances, config).map_err(|error| said(&error))?;
        let sensor = ForceSensor::new(SensorConfig {
            rotation: robot.sensor.rotation_matrix(),
            lever_m: robot.sensor.lever_m.into(),
            cutoff_hz: robot.sensor.cutoff_hz,
            cycle_s: f64::from(welcome.cycle_us) * 1e-6,
            tare_samples: robot.sensor.tare_samples,
        })
        .map_err(|error| said(&error))?;
        Ok(Self {
            sensor,
            compensator,
            metres_per_q: robot.axes.metres_per_q,
            load: Wrench::zero(),
            tared: false,
        })
    }

    /// One cycle: the raw sample (sensor axes) and the nominal positions to position offsets. Zero while taring.
    ///
    /// # Errors
    /// [`CompensationError`]; the state is what it was.
    pub fn cycle(
        &mut self,
        raw: &[f64; 6],
        nominal: &[PositionNm; ARMS],
    ) -> Result<[OffsetNm; ARMS], CompensationError> {
        let reading = self
            .sensor
            .update(&Wrench::from_array(*raw))
            .map_err(CompensationError::Sensor)?;
        match reading {
            Reading::Taring { .. } => Ok([OffsetNm(0); ARMS]),
            Reading::Load(load) => {
                self.tared = true;
                self.load = load;
                let [a, b, c] = nominal.map(|position| position.to_metres().0);
                let [sa, sb, sc] = self.metres_per_q;
                self.compensator
                    .correction(&[a / sa, b / sb, c / sc], &load)
                    .map(|correction| correction.offsets)
                    .map_err(CompensationError::Kinematics)
            }
        }
    }

    /// Whether the tare is done.
    #[must_use]
    pub const fn is_tared(&self) -> bool {
        self.tared
    }

    /// The load of the last cycle: force (N) and moment (N m), world axes.
    #[must_use]
    pub fn load(&self) -> [f64; 6] {
        let (f, m) = (&self.load.force_n, &self.load.moment_nm);
        [f.x, f.y, f.z, m.x, m.y, m.z]
    }
}
