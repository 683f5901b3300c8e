//! Configurations of core and simulation, built from a robot file.

use gantry_tau_core::control::channel::{LimitValues, Limits};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::{AxisLimits, Capabilities};
use gantry_tau_core::control::session::config::{AxisConfig, Config, Parameters, Travel};

use super::{ChannelLimits, RobotFile, RobotFileError};
use crate::model::MachineKind;
use crate::sim::load_generator::AppliedLoad;
use crate::sim::machine::SimulatedMachine;
use crate::sim::parameters::{Motion, SimulationParameters};

/// Length of a cycle, µs.
pub const CYCLE_US: u32 = 1_000;

impl<K: MachineKind<N>, const N: usize> RobotFile<K, N> {
    fn refuse(&self, key: &str, reason: impl std::fmt::Display) -> RobotFileError {
        RobotFileError { file: self.name.clone(), key: key.to_owned(), reason: reason.to_string() }
    }

    /// The session's configuration in the thesis profile: no echo window, no miss budget.
    ///
    /// # Errors
    /// [`RobotFileError`] for limits the core refuses.
    pub fn session_config(&self, capabilities: Capabilities) -> Result<Config<N>, RobotFileError> {
        let axes: Result<Vec<_>, _> = self.limits.iter().map(|axis| self.axis(axis)).collect();
        let axes = <[AxisConfig; N]>::try_from(axes?).map_err(|_| self.refuse("axes", "have another number"))?;
        Config::new(Parameters { capabilities, kinematics_checksum: self.model.checksum(), ..Parameters::thesis(axes) })
            .map_err(|error| self.refuse("axes", error))
    }

    fn axis(&self, limits: &super::AxisLimits) -> Result<AxisConfig, RobotFileError> {
        let travel = |(lower, upper)| Travel { lower, upper };
        Ok(AxisConfig {
            limits: AxisLimits {
                position: self.channel("axes.position", &limits.position)?,
                velocity: self.channel("axes.velocity", &limits.velocity)?,
                torque: self.channel("axes.torque", &limits.torque)?,
            },
            nominal_travel: travel(limits.nominal_travel),
            machine_travel: travel(limits.machine_travel),
            nominal_step_nm: u32::try_from(limits.nominal_step_nm)
                .map_err(|error| self.refuse("axes.nominal_step_um", error))?,
        })
    }

    fn channel<U>(&self, key: &str, limits: &ChannelLimits) -> Result<Limits<U>, RobotFileError> {
        let values = LimitValues { max: limits.max, step: limits.step, accel: limits.accel, ramp: limits.ramp };
        Limits::new(values).map_err(|error| self.refuse(key, error))
    }

    /// Returns the axis of each motor.
    ///
    /// # Errors
    /// [`RobotFileError`] unless there are `M` motors, each on an axis.
    pub fn motor_map<const M: usize>(&self) -> Result<MotorMap<N, M>, RobotFileError> {
        let key = "motors.axis_of_motor";
        let motors = &self.motors.axis_of_motor;
        let motors = <[usize; M]>::try_from(motors.as_slice())
            .map_err(|_| self.refuse(key, format!("lists {} motors, this kind of machine has {M}", motors.len())))?;
        MotorMap::new(motors).map_err(|error| self.refuse(key, error))
    }

    /// The simulated machine of this file, under `tool`'s load.
    ///
    /// # Errors
    /// [`RobotFileError`] without compliances, or for invalid parameters of the simulation.
    pub fn simulated_machine<const M: usize>(
        &self,
        tool: AppliedLoad,
        motion: Motion<N>,
    ) -> Result<SimulatedMachine<N, M>, RobotFileError> {
        let compliances = self
            .compliances
            .as_ref()
            .ok_or_else(|| self.refuse("c_link", "is missing; the simulation needs compliances"))?;
        let home_q = (self.model.axes_at(&self.home_m())).map_err(|error| self.refuse("simulation.home_m", error))?;
        let parameters = SimulationParameters {
            simulation: self.simulation.clone(),
            sensor: self.sensor.clone(),
            home_q,
            metres_per_q: self.axes.metres_per_q,
            motion,
        };
        let motors = self.motor_map()?;
        let geometry = self.model.geometry();
        SimulatedMachine::new(&geometry, compliances, motors, &parameters, tool)
            .map_err(|error| self.refuse("simulation", error))
    }
}
