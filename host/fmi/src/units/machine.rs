//! The simulated machine.

use std::sync::Arc;

use gantry_tau_core::control::axis::{InForce, Offsets, Reference};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::units::{OffsetNm, PositionNm};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_server::plant::interpolator::Motion;
use gantry_tau_server::plant::{Plant, Reading};
use gantry_tau_sim::load_generator::{Load, LoadGenerator, MAX_LOAD, load_generator};
use gantry_tau_sim::machine::SimulatedMachine;

use super::Unit;
use super::conversions::{
    MAX_FORCE_N, MAX_OFFSET_M, MAX_POSITION_M, MAX_TORQUE, MAX_VELOCITY_M_PER_S, home_m, metres,
    metres_per_s, offset, positions, share, torque, velocity,
};
use crate::log::Log;
use crate::variable::Causality::{Input, Output, Parameter};
use crate::variable::{Declarations, Domain, Group, Unit as UnitOf, Values};

/// Largest motion of the path, m.
const MAX_MOTION_M: f64 = 1.0;

/// Variables.
#[derive(Clone, Copy)]
struct MachinePorts<const N: usize> {
    reference: Group<N>,
    offset: Group<N>,
    velocity_offset: Group<N>,
    torque_offset: Group<N>,
    load_force: Group<3>,
    load_moment: Group<3>,
    reset: Group<1>,
    motion: Group<1>,
    quasi_static: Group<1>,
    nominal: Group<N>,
    position: Group<N>,
    velocity: Group<N>,
    torque: Group<N>,
    force: Group<3>,
    moment: Group<3>,
    displacement: Group<3>,
    turn: Group<3>,
    gauge: Group<3>,
    ok: Group<1>,
}

impl<const N: usize> MachinePorts<N> {
    fn declare(declared: &mut Declarations, home_m: [f64; N]) -> Self {
        let at_home = home_m.map(|home_m| ([-MAX_POSITION_M, MAX_POSITION_M], home_m));
        let real = Domain::Real;
        let within = |most: f64| ([-most, most], 0.0);
        let (metre, newton) = (real(UnitOf::Metre), real(UnitOf::Newton));
        let (per_s, moment) = (real(UnitOf::MetrePerSecond), real(UnitOf::NewtonMetre));
        let one = real(UnitOf::One);
        let inside = [within(MAX_POSITION_M); 3];
        let instrument = [within(f64::MAX); 3];
        Self {
            reference: declared.add(
                "reference",
                Input,
                metre,
                "Position reference of the drives: nominal plus offset",
                at_home,
            ),
            offset: declared.add(
                "offset",
                Input,
                metre,
                "Part of the reference that is an offset: the displacement is measured from the reference without it",
                [within(MAX_OFFSET_M); N],
            ),
            velocity_offset: declared.add(
                "velocity_offset",
                Input,
                per_s,
                "Additive velocity reference",
                [within(MAX_VELOCITY_M_PER_S); N],
            ),
            torque_offset: declared.add(
                "torque_offset",
                Input,
                one,
                "Additive torque reference, share of the rated torque",
                [within(MAX_TORQUE); N],
            ),
            load_force: declared.add(
                "load_force",
                Input,
                newton,
                "Force on the tool, world axes",
                [within(MAX_LOAD); 3],
            ),
            load_moment: declared.add(
                "load_moment",
                Input,
                moment,
                "Moment on the tool about the tool centre point, world axes",
                [within(MAX_LOAD); 3],
            ),
            reset: declared.switch(
                "reset",
                Input,
                "Acknowledges the faults of the drives",
                false,
            ),
            motion: declared.add(
                "motion",
                Parameter,
                metre,
                "Length of a back-and-forth motion of the nominal path on every axis; 0: it rests at home",
                [within(MAX_MOTION_M)],
            ),
            quasi_static: declared.switch(
                "quasi_static",
                Parameter,
                "The platform is in equilibrium in every cycle, as without masses in the robot file",
                false,
            ),
            nominal: declared.add(
                "nominal",
                Output,
                metre,
                "Nominal position of the path",
                at_home,
            ),
            position: declared.add(
                "position",
                Output,
                metre,
                "Position that the drive measures",
                at_home,
            ),
            velocity: declared.add(
                "velocity",
                Output,
                per_s,
                "Velocity that the drive measures",
                [within(MAX_VELOCITY_M_PER_S); N],
            ),
            torque: declared.add(
                "torque",
                Output,
                one,
                "Torque of the drive, share of the rated torque",
                [within(MAX_TORQUE); N],
            ),
            force: declared.add(
                "force",
                Output,
                newton,
                "Force that the sensor shows, with its zero error and the weight of the tool, sensor axes",
                [within(MAX_FORCE_N); 3],
            ),
            moment: declared.add(
                "moment",
                Output,
                moment,
                "Moment that the sensor shows, sensor axes",
                [within(MAX_FORCE_N); 3],
            ),
            displacement: declared.add(
                "displacement",
                Output,
                metre,
                "Displacement of the tool centre point from its nominal place, world axes",
                inside,
            ),
            turn: declared.add(
                "turn",
                Output,
                real(UnitOf::Radian),
                "Turn of the platform from its nominal orientation, rotation vector, world axes",
                instrument,
            ),
            gauge: declared.add(
                "gauge",
                Output,
                metre,
                "Displacement as the length gauges show it",
                inside,
            ),
            ok: declared.switch(
                "ok",
                Output,
                "The machine can be read: its drives follow their references",
                true,
            ),
        }
    }
}

/// A machine in use.
struct RunningMachine<const N: usize, const M: usize> {
    machine: SimulatedMachine<N, M>,
    hand: LoadGenerator,
}

impl<const N: usize, const M: usize> Clone for RunningMachine<N, M> {
    fn clone(&self) -> Self {
        let machine = self.machine.clone();
        let hand = machine.load_generator();
        Self { machine, hand }
    }
}

/// The unit.
#[derive(Clone)]
pub(super) struct MachineUnit<K, const N: usize, const M: usize> {
    robot: Arc<RobotFile<K, N>>,
    motors: MotorMap<N, M>,
    ports: MachinePorts<N>,
    running: Option<RunningMachine<N, M>>,
}

impl<K: MachineKind<N>, const N: usize, const M: usize> MachineUnit<K, N, M> {
    pub(super) fn new(robot: RobotFile<K, N>, declared: &mut Declarations) -> Result<Self, String> {
        let motors = robot.motor_map().map_err(|error| error.to_string())?;
        robot
            .compliances_for("the simulation needs compliances")
            .map_err(|error| error.to_string())?;
        Ok(Self {
            motors,
            ports: MachinePorts::declare(declared, home_m(&robot)?),
            robot: Arc::new(robot),
            running: None,
        })
    }

    fn built(&self, values: &Values) -> Result<SimulatedMachine<N, M>, String> {
        let is_quasi_static = values.is_set(self.ports.quasi_static);
        let robot = RobotFile {
            masses: self.robot.masses.filter(|_| !is_quasi_static),
            ..(*self.robot).clone()
        };
        let [motion_m] = values.get(self.ports.motion);
        let home_m = robot.home_axes_m().map_err(|error| error.to_string())?;
        let motion = Motion::by(home_m, motion_m);
        let (_hand, tool) = load_generator();
        SimulatedMachine::moving_from_robot(&robot, tool, motion).map_err(|error| error.to_string())
    }

    /// Returns the references of the motors, and their parts.
    fn references(&self, values: &Values) -> Result<([Reference; M], [InForce; N]), String> {
        let position = positions(values.get(self.ports.reference));
        let mut of_axes = position.map(|position| Reference {
            position,
            velocity_offset: velocity(0.0),
            torque_offset: torque(0.0),
        });
        let mut parts = position.map(InForce::at);
        let offsets = values.get(self.ports.offset).map(offset);
        let velocities = values.get(self.ports.velocity_offset).map(velocity);
        let torques = values.get(self.ports.torque_offset).map(torque);
        let each = of_axes.iter_mut().zip(&mut parts);
        let given = offsets.into_iter().zip(velocities).zip(torques);
        for ((reference, part), ((position, velocity), torque)) in each.zip(given) {
            reference.velocity_offset = velocity;
            reference.torque_offset = torque;
            *part = parts_of(reference.position, position);
            part.offsets.velocity = velocity;
            part.offsets.torque = torque;
        }
        let references = self.motors.spread(&of_axes).ok_or("a motor has no axis")?;
        Ok((references, parts))
    }
}

/// Returns the parts of a position reference.
const fn parts_of(reference: PositionNm, offset: OffsetNm) -> InForce {
    InForce {
        nominal: PositionNm(reference.0 - offset.0 as i64),
        offsets: Offsets::position(offset),
    }
}

impl<const N: usize> MachinePorts<N> {
    fn show(&self, reading: &Reading<N>, values: &mut Values) {
        values.put(self.nominal, metres(reading.nominal));
        values.put(
            self.position,
            metres(reading.actual.map(|axis| axis.position)),
        );
        let velocities = reading.actual.map(|axis| metres_per_s(axis.velocity));
        values.put(self.velocity, velocities);
        let torques = reading.actual.map(|axis| share(axis.torque));
        values.put(self.torque, torques);
        let Some(tool) = &reading.tool else { return };
        let [fx, fy, fz, mx, my, mz] = tool.sensor;
        values.put(self.force, [fx, fy, fz]);
        values.put(self.moment, [mx, my, mz]);
        values.put(self.displacement, tool.displacement_m);
        values.put(self.turn, tool.turn_rad);
        values.put(self.gauge, tool.gauges_m);
    }
}

impl<const N: usize, const M: usize> RunningMachine<N, M> {
    fn load(&mut self, force_n: [f64; 3], moment_nm: [f64; 3]) -> Result<(), String> {
        let load = Load {
            step: 0,
            force_n,
            moment_nm,
        };
        self.hand.set(&load).map_err(|error| error.to_string())
    }
}

impl<K: MachineKind<N>, const N: usize, const M: usize> Unit for MachineUnit<K, N, M> {
    /// A server reads its machine before it listens, and once more in its first tick.
    fn begin(&mut self, values: &mut Values) -> Result<(), String> {
        let machine = self.built(values)?;
        let hand = machine.load_generator();
        let mut running = RunningMachine { machine, hand };
        let ports = &self.ports;
        running.load(values.get(ports.load_force), values.get(ports.load_moment))?;
        let mut read = || running.machine.read(1).map_err(|error| error.to_string());
        read()?;
        ports.show(&read()?, values);
        self.running = Some(running);
        Ok(())
    }

    /// The references act, and then the machine is read for the next tick of a server.
    fn cycle(&mut self, values: &mut Values, log: &mut Log) -> Result<(), String> {
        let (references, parts) = self.references(values)?;
        let ports = &self.ports;
        let running = (self.running.as_mut()).ok_or("the machine has not begun")?;
        running.load(values.get(ports.load_force), values.get(ports.load_moment))?;
        (running.machine.write(&references, &parts)).map_err(|error| error.to_string())?;
        if values.is_set(ports.reset) {
            running.machine.reset();
        }
        let was_ok = values.is_set(ports.ok);
        match running.machine.read(1) {
            Ok(reading) => {
                ports.show(&reading, values);
                values.put_switch(ports.ok, true);
            }
            Err(error) => {
                if was_ok {
                    log.warn(error.to_string());
                }
                values.put_switch(ports.ok, false);
            }
        }
        Ok(())
    }

    fn copy(&self) -> Box<dyn Unit> {
        Box::new(self.clone())
    }
}
