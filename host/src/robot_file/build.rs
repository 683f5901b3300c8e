//! Configurations of core and simulation, built from a robot file.

use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::message::Capabilities;
use gantry_tau_core::control::session::config::{Config, Parameters};
use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::units::OffsetNm;

use gantry_tau_core::model::robot::Compliances;

use super::{Drives, RobotFile, RobotFileError};
use crate::gauge_link::GaugePublisher;
use crate::measurements::plan::Plan;
use crate::model::{Compensator, CompensatorSetup, MachineKind, Wrist};
use crate::sim::campaign::CampaignMachine;
use crate::sim::load_generator::{AppliedLoad, load_generator};
use crate::sim::machine::SimulatedMachine;
use crate::sim::parameters::{Motion, SimulationParameters};
use crate::sim::springs::TrueSprings;
use crate::springs::compliances::Springs;

/// Length of a cycle, µs.
pub const CYCLE_US: u32 = 1_000;

impl<K: MachineKind<N>, const N: usize> RobotFile<K, N> {
    fn refuse(&self, key: &str, reason: impl std::fmt::Display) -> RobotFileError {
        RobotFileError { file: self.name.clone(), key: key.to_owned(), reason: reason.to_string() }
    }

    /// Positions of the axes with the tool at home and the platform unturned, q-units.
    ///
    /// # Errors
    /// None for a file that was read: it is checked.
    pub fn home_q(&self) -> Result<[f64; N], RobotFileError> {
        self.model.axes_at(&self.home_m()).map_err(|error| self.refuse("simulation.home_m", error))
    }

    /// The session's configuration in the thesis profile: no echo window, no miss budget.
    ///
    /// # Errors
    /// [`RobotFileError`] for limits the core refuses.
    pub fn session_config(&self, capabilities: Capabilities) -> Result<Config<N>, RobotFileError> {
        let thesis = Parameters::thesis(self.limits);
        Config::new(Parameters { capabilities, kinematics_checksum: self.checksum(), ..thesis })
            .map_err(|error| self.refuse("axes", error))
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

    /// A compensator for this machine, with offsets within `limits`.
    ///
    /// # Errors
    /// [`RobotFileError`] without compliances, or for a parameter that the compensator refuses.
    pub fn compensator(&self, limits: [OffsetNm; N]) -> Result<Box<dyn Compensator<N>>, RobotFileError> {
        let compliances = (self.compliances.as_ref())
            .ok_or_else(|| self.refuse("c_link", "is missing; a compensating client needs compliances"))?;
        let gain = self.client.gain;
        let setup = CompensatorSetup {
            compliances,
            config: CompensatorConfig { gain, limits, metres_per_q: self.metres_per_q },
            correction: self.correction(),
            wrist: &self.wrist,
            home_m: self.home_m(),
        };
        self.model.compensator(&setup).map_err(|reason| self.refuse("client", reason))
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
        let springs = self.springs_for("the simulation needs compliances")?;
        let parameters = self.simulation_parameters(motion)?;
        let motors = self.motor_map()?;
        let geometry = self.model.geometry();
        SimulatedMachine::new(&geometry, &springs, motors, &parameters, tool)
            .map_err(|error| self.refuse("simulation", error))
    }

    /// The springs of the simulated machine: those of the file, each deviated by its seeded share.
    ///
    /// # Errors
    /// As [`simulated_machine`](Self::simulated_machine).
    pub fn true_springs(&self) -> Result<TrueSprings<N>, RobotFileError> {
        let springs = self.springs_for("the simulation needs compliances")?;
        let parameters = self.simulation_parameters(Motion::Hold)?;
        TrueSprings::new(&self.model.geometry(), &springs, &parameters)
            .map_err(|error| self.refuse("simulation", error))
    }

    fn springs_for(&self, purpose: &str) -> Result<Springs<N>, RobotFileError> {
        let machine = *self.compliances_for(purpose)?;
        Ok(Springs { machine: machine.into(), wrist: Wrist::new(&self.wrist) })
    }

    /// The compliances, where `purpose` needs them.
    pub(crate) fn compliances_for(&self, purpose: &str) -> Result<&Compliances<N>, RobotFileError> {
        self.compliances.as_ref().ok_or_else(|| self.refuse("c_link", format_args!("is missing; {purpose}")))
    }

    fn simulation_parameters(&self, motion: Motion<N>) -> Result<SimulationParameters<N>, RobotFileError> {
        Ok(SimulationParameters {
            simulation: self.simulation.clone(),
            sensor: self.sensor.clone(),
            drives: self.drives.as_ref().map(Drives::settings).unwrap_or_default(),
            home_q: self.home_q()?,
            metres_per_q: self.metres_per_q,
            motion,
        })
    }

    /// The simulated machine of this file in a campaign; its gauges are shown on `link`.
    ///
    /// # Errors
    /// As [`simulated_machine`](Self::simulated_machine), and for a pose of the plan that the machine cannot take.
    pub fn campaign_machine<const M: usize>(
        &self,
        plan: Plan<N>,
        link: GaugePublisher,
    ) -> Result<CampaignMachine<N, M>, RobotFileError> {
        let (hand, tool) = load_generator();
        let machine = self.simulated_machine(tool, Motion::Hold)?;
        let places = plan.poses.iter().map(|(name, pose)| {
            self.model.axes_for(pose).map_err(|error| self.refuse(&format!("pose {name} of the plan"), error))
        });
        let places = places.collect::<Result<Vec<[f64; N]>, RobotFileError>>()?;
        CampaignMachine::new(machine, hand, plan, places, &self.simulation, &self.home_q()?, link)
            .map_err(|error| self.refuse("simulation", error))
    }
}
