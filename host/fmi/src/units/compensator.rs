//! Compensation alone: tare, filter, correction.

use std::sync::Arc;

use gantry_tau_client::{Compensation, Samples};
use gantry_tau_core::control::message::{Capabilities, Welcome};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{Epoch, Tick};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{CYCLE_US, RobotFile};

use super::Unit;
use super::conversions::{corrected, home_m, positions, share};
use super::ports::{ForceInputs, LoadOutputs, largest_offsets_m, nominal_inputs};
use crate::log::Log;
use crate::variable::Causality::Output;
use crate::variable::{Declarations, Domain, Group, Unit as UnitOf, Values};

/// Variables.
#[derive(Clone, Copy)]
struct CompensatorPorts<const N: usize> {
    sample: ForceInputs,
    nominal: Group<N>,
    target: Group<N>,
    torque_target: Group<N>,
    saturated: Group<N>,
    tared: Group<1>,
    held: Group<1>,
    load: LoadOutputs,
}

/// The unit.
#[derive(Clone)]
pub(super) struct CompensatorUnit<K, const N: usize> {
    robot: Arc<RobotFile<K, N>>,
    ports: CompensatorPorts<N>,
    running: Option<(Compensation<N>, Tick)>,
}

impl<K: MachineKind<N>, const N: usize> CompensatorUnit<K, N> {
    pub(super) fn new(robot: RobotFile<K, N>, declared: &mut Declarations) -> Result<Self, String> {
        let most_m = largest_offsets_m(&robot);
        let sample = ForceInputs::declare(declared);
        let nominal = nominal_inputs(declared, home_m(&robot)?);
        let unit = Self {
            ports: CompensatorPorts {
                sample,
                nominal,
                target: declared.add(
                    "target",
                    Output,
                    Domain::Real(UnitOf::Metre),
                    "Offset that holds the tool under the load; 0 while taring",
                    most_m.map(|most| ([-most, most], 0.0)),
                ),
                torque_target: declared.add(
                    "torque_target",
                    Output,
                    Domain::Real(UnitOf::One),
                    "Torque offset, share of the rated torque; 0 unless the robot file asks for it",
                    [([-1.0, 1.0], 0.0); N],
                ),
                saturated: declared.add(
                    "saturated",
                    Output,
                    Domain::Boolean,
                    "The target is cut at the largest offset",
                    [([0.0, 1.0], 0.0); N],
                ),
                tared: declared.switch(
                    "tared",
                    Output,
                    "The tare of the force sensor is done",
                    false,
                ),
                held: declared.switch(
                    "held",
                    Output,
                    "No target can be computed: the last one stands",
                    false,
                ),
                load: LoadOutputs::declare(declared),
            },
            robot: Arc::new(robot),
            running: None,
        };
        // What the file lacks is found when the unit is made.
        unit.built()?;
        Ok(unit)
    }

    fn built(&self) -> Result<Compensation<N>, String> {
        let terms = Welcome {
            epoch: Epoch(1),
            tick: Tick(0),
            cycle_us: CYCLE_US,
            echo_window: 0,
            capabilities: Capabilities::LOCKSTEP,
            kinematics_checksum: self.robot.checksum(),
            limits: self.robot.limits.map(|axis| axis.limits),
        };
        let compensation = Compensation::new(&self.robot, &terms);
        compensation.map_err(|error| error.to_string())
    }
}

impl<K: MachineKind<N>, const N: usize> Unit for CompensatorUnit<K, N> {
    fn begin(&mut self, _: &mut Values) -> Result<(), String> {
        self.running = Some((self.built()?, Tick(0)));
        Ok(())
    }

    fn cycle(&mut self, values: &mut Values, log: &mut Log) -> Result<(), String> {
        let ports = &self.ports;
        let (compensation, tick) = (self.running.as_mut()).ok_or("the unit has not begun")?;
        tick.0 += 1;
        let samples = Samples {
            wrench: Wrench::from_array(ports.sample.read(values)),
            acceleration: None,
        };
        let nominal = positions(values.get(ports.nominal));
        let was_held = values.is_set(ports.held);
        match compensation.cycle(*tick, &samples, &nominal) {
            Ok(correction) => {
                let (targets_m, saturated) = corrected(&correction);
                values.put(ports.target, targets_m);
                values.put(ports.saturated, saturated);
                values.put_switch(ports.held, false);
            }
            Err(error) => {
                if !was_held {
                    log.warn(format!(
                        "no target can be computed, the last one stands: {error}"
                    ));
                }
                values.put_switch(ports.held, true);
            }
        }
        values.put(ports.torque_target, compensation.torques().map(share));
        values.put_switch(ports.tared, compensation.is_tared());
        ports.load.show(&compensation.load(), values);
        Ok(())
    }

    fn copy(&self) -> Box<dyn Unit> {
        Box::new(self.clone())
    }
}
