//! Configurations of core from a robot file.

use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::session::config::{Config, Parameters};
use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::model::robot::Compliances;
use gantry_tau_core::units::OffsetNm;

use super::{RobotFile, RobotFileError};
use crate::model::{Compensate, CompensatorSetup, MachineKind};

/// Length of a cycle, µs.
pub const CYCLE_US: u32 = 1_000;

impl<K: MachineKind<N>, const N: usize> RobotFile<K, N> {
    /// Returns the error of a key of this file.
    pub fn refuse(&self, key: &str, reason: impl std::fmt::Display) -> RobotFileError {
        RobotFileError {
            file: self.name.clone(),
            key: key.to_owned(),
            reason: reason.to_string(),
        }
    }

    /// Positions of the axes with the tool at home and the platform unturned, q-units.
    ///
    /// # Errors
    /// None for a file that was read: it is checked.
    pub fn home_q(&self) -> Result<[f64; N], RobotFileError> {
        self.model
            .axes_at(&self.home_m())
            .map_err(|error| self.refuse("simulation.home_m", error))
    }

    /// Positions of the axes at home, m: [`home_q`](Self::home_q) on the path of the references.
    ///
    /// # Errors
    /// As [`home_q`](Self::home_q).
    pub fn home_axes_m(&self) -> Result<[f64; N], RobotFileError> {
        let mut axes_m = self.home_q()?;
        for (place, metres) in axes_m.iter_mut().zip(&self.metres_per_q) {
            *place *= metres;
        }
        Ok(axes_m)
    }

    /// The session's configuration in the thesis profile: no echo window, no miss budget.
    ///
    /// # Errors
    /// [`RobotFileError`] for limits the core refuses.
    pub fn session_config(&self, capabilities: Capabilities) -> Result<Config<N>, RobotFileError> {
        let thesis = Parameters::thesis(self.limits);
        Config::new(Parameters {
            capabilities,
            kinematics_checksum: self.checksum(),
            ..thesis
        })
        .map_err(|error| self.refuse("axes", error))
    }

    /// Returns the axis of each motor.
    ///
    /// # Errors
    /// [`RobotFileError`] unless there are `M` motors, each on an axis.
    pub fn motor_map<const M: usize>(&self) -> Result<MotorMap<N, M>, RobotFileError> {
        let key = "motors.axis_of_motor";
        let motors = &self.motors.axis_of_motor;
        let motors = <[usize; M]>::try_from(motors.as_slice()).map_err(|_| {
            self.refuse(
                key,
                format!(
                    "lists {} motors, this kind of machine has {M}",
                    motors.len()
                ),
            )
        })?;
        MotorMap::new(motors).map_err(|error| self.refuse(key, error))
    }

    /// A compensator for this machine, with offsets within `limits`.
    ///
    /// # Errors
    /// [`RobotFileError`] without compliances, or for a parameter that the compensator refuses.
    pub fn compensator(
        &self,
        limits: [OffsetNm; N],
    ) -> Result<Box<dyn Compensate<N>>, RobotFileError> {
        let compliances = (self.compliances.as_ref()).ok_or_else(|| {
            self.refuse(
                "c_link",
                "is missing; a compensating client needs compliances",
            )
        })?;
        let gain = self.client.gain;
        let setup = CompensatorSetup {
            compliances,
            config: CompensatorConfig {
                gain,
                limits,
                metres_per_q: self.metres_per_q,
            },
            correction: self.correction(),
            wrist: &self.wrist,
            home_m: self.home_m(),
        };
        self.model
            .compensator(&setup)
            .map_err(|reason| self.refuse("client", reason))
    }

    /// The compliances, where `purpose` needs them.
    pub fn compliances_for(&self, purpose: &str) -> Result<&Compliances<N>, RobotFileError> {
        self.compliances
            .as_ref()
            .ok_or_else(|| self.refuse("c_link", format_args!("is missing; {purpose}")))
    }
}
