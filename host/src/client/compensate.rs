//! Compensation of one cycle, from a raw force sample and the nominal positions to offsets, with core's sensor and compensator.

use std::error::Error;

use gantry_tau_core::control::message::Welcome;
use gantry_tau_core::model::compensation::Correction;
use gantry_tau_core::model::sensor::{ForceSensor, Reading, SensorConfig};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{OffsetNm, PositionNm};

use crate::model::{Compensator, MachineKind};
use crate::robot_file::RobotFile;

/// Tare, filter and compensation, once per cycle.
pub struct Compensation<const N: usize> {
    sensor: ForceSensor,
    compensator: Box<dyn Compensator<N>>,
    /// Load of the last cycle; `None` while taring.
    load: Option<Wrench>,
}

impl<const N: usize> Compensation<N> {
    /// Creates the compensation for the machine of a robot file, within the limits that the server announced.
    ///
    /// # Errors
    /// A sentence that names the parameter.
    pub fn new<K: MachineKind<N>>(robot: &RobotFile<K, N>, welcome: &Welcome<N>) -> Result<Self, String> {
        let limits = welcome.limits.map(|axis| OffsetNm(axis.position.max()));
        let compensator = robot.compensator(limits).map_err(|error| error.to_string())?;
        let sensor = ForceSensor::new(SensorConfig {
            rotation: robot.sensor.rotation_matrix(),
            lever_m: robot.sensor.lever_m.into(),
            tool: robot.sensor.tool.into(),
            cutoff_hz: robot.sensor.cutoff_hz,
            cycle_s: f64::from(welcome.cycle_us) * 1e-6,
            tare_samples: robot.sensor.tare_samples,
        })
        .map_err(|error| format!("{}: {error}", robot.name))?;
        Ok(Self { sensor, compensator, load: None })
    }

    /// Returns the position offsets of one cycle for a raw sample (sensor axes) and nominal positions. Zero while taring.
    ///
    /// # Errors
    /// The sample is invalid, or the positions have no solution.
    pub fn cycle(&mut self, raw: &[f64; 6], nominal: &[PositionNm; N]) -> Result<Correction<N>, Box<dyn Error>> {
        let pose = self.compensator.locate(nominal)?;
        match self.sensor.update(&Wrench::from_array(*raw), &pose.rotation)? {
            Reading::Taring { .. } => Ok(Correction::ZERO),
            Reading::Load(load) => {
                self.load = Some(load);
                Ok(self.compensator.correct(&pose, nominal, &load)?)
            }
        }
    }

    /// True if the tare is done.
    #[must_use]
    pub const fn is_tared(&self) -> bool {
        self.load.is_some()
    }

    /// Returns the load of the last cycle: force (N) and moment (N m), world axes; zero while taring.
    #[must_use]
    pub fn load(&self) -> [f64; 6] {
        self.load.map_or([0.0; 6], |Wrench { force_n: f, moment_nm: m }| [f.x, f.y, f.z, m.x, m.y, m.z])
    }
}
