//! The whole machine behind [`Plant`]: interpolator, drives, springs, instruments.
//!
//! Order of a cycle: the references of the last `write` act; drives advance under the load that the
//! last pose puts on them; the platform takes its new pose with the motors at their positions; the
//! instruments measure; the interpolator moves on.
//!
//! With masses ([`SimulatedMachine::with_masses`]) the platform is a body in motion ([`MovingPlatform`]), in the same steps
//! as the drives, which move what is in front of the springs; without, it is in equilibrium in every
//! cycle, and a workpiece pushes with the force that belongs to the pose of the cycle before.
//!
//! *Displacement* is the tool's position minus its position on the unloaded rigid machine with the
//! carts at the nominal of the last `write`, without the offsets. It contains springs, play,
//! following errors and the offsets of a compensation, but neither the interpolator's motion nor
//! the delay of a cycle.
//!
//! Motors of one axis share its cart: its position is their mean, and each carries an equal part of
//! the load. With play or a bias (`[drives]`) they are bodies of their own in front of it.
//!
//! A drive that has stopped by itself ([`drive::supervision`]) fails every `read`, and stops the
//! others of its axis. The path waits until all drives follow again, as an NC does.
//!
//! With velocities (`drives.interface`) the axes stand until the server's loops follow the path,
//! and where the loops have stopped. The nominal references are then where the axes stand; once the
//! loops follow again the path goes from there back to where it was left.

use gantry_tau_core::control::axis::{Actual, InForce, Reference};
use gantry_tau_core::control::endpoint::MotorMap;
use gantry_tau_core::control::position_loop::VelocityReference;
use gantry_tau_core::control::position_loop::quick_stop::QuickStop;
use gantry_tau_core::model::f1;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{Metres, PositionNm, TorquePermille, VelocityUmS};
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose};
use gantry_tau_machine::masses::Masses;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{Interface, RobotFile, RobotFileError};
use gantry_tau_server::plant::interpolator::{Interpolator, Motion, OutOfRange};
use gantry_tau_server::plant::{
    DriveState, Plant, PlantError, Reading, ToolReading, VelocityPlant,
};
use nalgebra::{Vector3, Vector6};

use super::accelerometer::SimulatedAccelerometer;
use super::drive::supervision::Trip;
use super::drive::{self, Cart, Drive, SUBSTEPS, Settings, coupled};
use super::force_sensor::SimulatedForceSensor;
use super::load_generator::{AppliedLoad, Load, LoadGenerator};
use super::moving_platform::{Motors, MovingPlatform};
use super::parameters::{SimulationError, SimulationParameters, springs};
use super::springs::TrueSprings;
use super::workpiece::Workpiece;

/// Largest number of cycles that one `read` simulates; further time is skipped.
pub const MAX_CYCLES_PER_READ: u64 = 100;

/// A simulated machine with `N` axes and `M` motors `[T 4.2]`. A copy goes on from the same state, under
/// a load of its own.
#[derive(Clone, Debug)]
pub struct SimulatedMachine<const N: usize, const M: usize> {
    springs: TrueSprings<N>,
    motors: MotorMap<N, M>,
    /// Number of motors of each axis.
    motors_of_axis: [f64; N],
    drives: [Drive; M],
    /// Carts of the axes whose motors are bodies of their own.
    carts: [Option<Cart>; N],
    interpolator: Interpolator<N>,
    sensor: SimulatedForceSensor,
    accelerometer: Option<SimulatedAccelerometer>,
    gauge_resolution_m: f64,
    tool: AppliedLoad,
    workpiece: Option<Workpiece>,
    metres_per_q: [f64; N],
    /// Nominal of the last reading.
    nominal: [PositionNm; N],
    /// Parts of the references in force.
    in_force: [InForce; N],
    interface: Interface,
    quick_stop: Option<QuickStop>,
    /// With velocities: no loop follows the path.
    stands: bool,
    /// Of a machine with masses.
    moving: Option<Box<MovingPlatform<N>>>,
    /// The tool under load, and on the rigid machine at the nominal references in force.
    loaded: Equilibrium<N>,
    rigid: Equilibrium<N>,
    load: Load,
    /// The force sensor samples at a point of time, in place of the mean over a cycle.
    samples_points: bool,
    sample: Wrench,
    acceleration: Option<[f64; 6]>,
}

impl<const N: usize, const M: usize> SimulatedMachine<N, M> {
    /// Creates the machine of a robot file, under `tool`'s load.
    ///
    /// # Errors
    /// [`RobotFileError`] without compliances, or for invalid parameters of the simulation.
    pub fn from_robot<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        tool: AppliedLoad,
        motion: Motion<N>,
    ) -> Result<Self, RobotFileError> {
        let springs = springs(robot)?;
        let parameters = SimulationParameters::from_robot(robot, motion)?;
        let motors = robot.motor_map()?;
        Self::new(&robot.model.geometry(), &springs, motors, &parameters, tool)
            .map_err(|error| robot.refuse("simulation", error))
    }

    /// Creates a machine whose springs are near the `nominal` ones, at rest at home, under the load
    /// of `tool`.
    ///
    /// # Errors
    /// [`SimulationError`] naming the parameter.
    pub fn new(
        geometry: &f1::Geometry,
        nominal: &Springs<N>,
        motors: MotorMap<N, M>,
        parameters: &SimulationParameters<N>,
        tool: AppliedLoad,
    ) -> Result<Self, SimulationError> {
        let home_m =
            std::array::from_fn(|axis| parameters.home_q[axis] * parameters.metres_per_q[axis]);
        let springs = TrueSprings::new(geometry, nominal, parameters)?;
        let at_home = positions_nm(&home_m)?;
        let references = motors
            .axis_of_motor()
            .map(|axis| without_offsets(at_home[axis]));
        let start = Equilibrium::at_home(parameters.simulation.home_m);
        let settings = &parameters.drives;
        let drives = std::array::from_fn(|motor| {
            Drive::at_rest(&references[motor], settings)
                .biased(direction(motors.axis_of_motor(), motor))
        });
        let carts = std::array::from_fn(|axis| {
            let mut of_axis = drives
                .iter()
                .zip(motors.axis_of_motor())
                .filter(|(_, of)| **of == axis);
            let (drive, _) = of_axis.next()?;
            settings.has_cart(1 + of_axis.count()).then(|| drive.cart())
        });
        let mut machine = Self {
            springs,
            motors_of_axis: std::array::from_fn(|axis| motors_of(&motors, axis)),
            motors,
            drives,
            carts,
            interpolator: Interpolator::new(home_m, &parameters.motion)?,
            sensor: SimulatedForceSensor::new(&parameters.sensor, &parameters.simulation),
            accelerometer: parameters
                .sensor
                .accelerometer
                .map(|keys| SimulatedAccelerometer::new(keys.into(), &parameters.simulation)),
            gauge_resolution_m: parameters.simulation.gauge_resolution_m,
            tool,
            workpiece: None,
            metres_per_q: parameters.metres_per_q,
            nominal: at_home,
            in_force: at_home.map(InForce::at),
            interface: settings.interface,
            quick_stop: quick_stop(settings),
            stands: settings.interface == Interface::Velocity,
            moving: None,
            loaded: start,
            rigid: start,
            load: Load::default(),
            samples_points: false,
            sample: Wrench::zero(),
            acceleration: None,
        };
        machine
            .settle_platform()
            .map_err(SimulationError::Springs)?;
        machine.sample = machine
            .sensor
            .sample(&Wrench::zero(), &machine.loaded.pose.rotation);
        machine.measure_acceleration(&Vector6::zeros(), &Vector3::zeros());
        Ok(machine)
    }

    /// As [`from_robot`](Self::from_robot), and it moves by the masses of the file, if it has any.
    ///
    /// # Errors
    /// As [`from_robot`](Self::from_robot); for masses without modes at home.
    pub fn moving_from_robot<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        tool: AppliedLoad,
        motion: Motion<N>,
    ) -> Result<Self, RobotFileError> {
        let machine = Self::from_robot(robot, tool, motion)?;
        match &robot.masses {
            Some(masses) => machine
                .with_masses(masses)
                .map_err(|error| robot.refuse("masses", error)),
            None => Ok(machine),
        }
    }

    /// Lets the force sensor sample at a point of time in each cycle, as one without a low-pass of its
    /// own, in place of the mean over the cycle.
    #[must_use]
    pub fn sampling_points(self) -> Self {
        Self {
            samples_points: true,
            ..self
        }
    }

    /// Lets the machine, which is at rest at home, move by these masses; its drives hold what it
    /// weighs.
    ///
    /// # Errors
    /// [`SimulationError::NoModes`].
    pub fn with_masses(mut self, masses: &Masses<N>) -> Result<Self, SimulationError> {
        let elastic = *self.springs.machine();
        let motors = self.motor_motion();
        let moving = MovingPlatform::at_rest(elastic, *masses, &self.loaded, &motors.places)
            .ok_or(SimulationError::NoModes)?;
        let held = moving.drive_loads(&motors);
        for (motor, drive) in self.drives.iter_mut().enumerate() {
            let axis = self.motors.axis_of_motor()[motor];
            let motors = self.motors_of_axis[axis];
            *drive = drive
                .moving(masses.motors_kg[axis] / motors)
                .holding(held[axis] / self.metres_per_q[axis] / motors);
        }
        self.moving = Some(Box::new(moving));
        Ok(self)
    }

    /// Returns a generator for the load on its tool.
    #[must_use]
    pub fn load_generator(&self) -> LoadGenerator {
        self.tool.generator()
    }

    /// Returns the pose of the platform, if the machine moves by masses.
    #[must_use]
    pub fn moving_pose(&self) -> Option<Pose> {
        self.moving.as_ref().map(|_| self.loaded.pose)
    }

    /// Puts a workpiece below the tool, in addition to the load.
    #[must_use]
    pub fn above(self, workpiece: Workpiece) -> Self {
        Self {
            workpiece: Some(workpiece),
            ..self
        }
    }

    /// Returns links and axes, as they stand.
    #[must_use]
    pub const fn springs(&self) -> &ElasticMachine<N> {
        self.springs.machine()
    }

    /// Returns the machine under its load, since it began in a pose, with its wrist at these angles
    /// (rad; empty: at zero).
    #[must_use]
    pub fn seen_from(&self, began: Pose, wrist_rad: &[f64]) -> Loaded<N> {
        self.springs.loaded(
            began,
            self.loaded,
            self.load.wrench().to_array().into(),
            wrist_rad,
        )
    }

    /// Returns the true positions of the axes, on the side of the motors, m.
    #[must_use]
    pub fn positions_m(&self) -> [f64; N] {
        std::array::from_fn(|axis| drive::mean(self.drives_of(axis).map(Drive::position_m)))
    }

    /// Returns the true positions of the axes behind their springs, m; without masses those on the
    /// side of the motors.
    #[must_use]
    pub fn carts_m(&self) -> [f64; N] {
        match &self.moving {
            Some(moving) => {
                std::array::from_fn(|axis| moving.axes()[axis] * self.metres_per_q[axis])
            }
            None => self.positions_m(),
        }
    }

    /// Returns the load of the machine on each motor of an axis, N along the guideway.
    #[must_use]
    pub fn motor_loads_n(&self) -> [f64; N] {
        std::array::from_fn(|axis| self.motor_load_n(axis))
    }

    /// Power is the same in both units: `tau dq = F dx`.
    fn axis_load_n(&self, axis: usize) -> f64 {
        let along_q = match &self.moving {
            Some(moving) => moving.drive_loads(&self.motor_motion())[axis],
            None => self.loaded.axis_loads[axis],
        };
        along_q / self.metres_per_q[axis]
    }

    fn motor_load_n(&self, axis: usize) -> f64 {
        self.axis_load_n(axis) / self.motors_of_axis[axis]
    }

    /// Returns the motion of the axes in front of their springs.
    fn motor_motion(&self) -> Motors<N> {
        let mut motion = [(0.0, 0.0); N];
        for (drive, &axis) in self.drives.iter().zip(self.motors.axis_of_motor()) {
            motion[axis].0 += drive.position_m();
            motion[axis].1 += drive.velocity_m_per_s();
        }
        for (axis, motion) in motion.iter_mut().enumerate() {
            let motors = self.motors_of_axis[axis];
            *motion = match &self.carts[axis] {
                Some(cart) => cart.motion(),
                None => (motion.0 / motors, motion.1 / motors),
            };
        }
        Motors {
            places: std::array::from_fn(|axis| motion[axis].0 / self.metres_per_q[axis]),
            rates: std::array::from_fn(|axis| motion[axis].1 / self.metres_per_q[axis]),
        }
    }

    /// Runs one cycle of 1 ms.
    fn advance(&mut self) -> Result<(), &'static str> {
        self.load = self.tool.load();
        match self.moving.take() {
            Some(mut moving) => {
                let moved = self.advance_moving(&mut moving);
                self.moving = Some(moving);
                moved?;
            }
            None => self.advance_settled()?,
        }
        if self.stands {
            self.nominal = self.actual()?.map(|axis| axis.position);
            self.in_force = self.nominal.map(InForce::at);
            return Ok(());
        }
        if self.stopped().is_none() {
            self.interpolator.advance();
        }
        self.nominal = positions_nm(&self.interpolator.position_m())
            .map_err(|_| "a nominal position is out of range")?;
        Ok(())
    }

    /// Runs one cycle of a machine without masses.
    fn advance_settled(&mut self) -> Result<(), &'static str> {
        if let Some(workpiece) = &mut self.workpiece {
            let pushed = workpiece.force_n(&self.loaded.pose.translation_m);
            self.load.force_n = std::array::from_fn(|axis| self.load.force_n[axis] + pushed[axis]);
        }
        let axis_loads_n = std::array::from_fn(|axis| self.axis_load_n(axis));
        self.drives.iter_mut().for_each(Drive::begin);
        for substep in 0..SUBSTEPS {
            self.step_drives(substep, &axis_loads_n);
        }
        self.drives.iter_mut().for_each(Drive::end);
        self.stop_partners();
        self.settle_platform()
            .map_err(|_| "the springs find no equilibrium under this load")?;
        let mut seen = self.load.wrench();
        if self.samples_points {
            seen.force_n += self.tool.beyond_mean_n(SUBSTEPS - 1);
        }
        self.sample = self.sensor.sample(&seen, &self.loaded.pose.rotation);
        self.measure_acceleration(&Vector6::zeros(), &Vector3::zeros());
        Ok(())
    }

    /// Takes a sample of the accelerometer, if there is one.
    fn measure_acceleration(
        &mut self,
        acceleration: &Vector6<f64>,
        angular_velocity: &Vector3<f64>,
    ) {
        let platform = &self.loaded.pose.rotation;
        self.acceleration = (self.accelerometer.as_mut())
            .map(|instrument| instrument.sample(acceleration, angular_velocity, platform));
    }

    /// Runs one cycle of a machine with masses.
    fn advance_moving(&mut self, moving: &mut MovingPlatform<N>) -> Result<(), &'static str> {
        let load = Vector6::from(self.load.wrench().to_array());
        moving
            .begin_cycle(self.springs.machine())
            .ok_or("the machine has no natural frequencies here")?;
        self.drives.iter_mut().for_each(Drive::begin);
        // A cutter shakes the tool, whose inertia at the end of a cycle is not its mean over the cycle.
        let is_averaged = !self.samples_points && self.tool.changes_in_a_cycle();
        let (mut found, mut accelerations) = (Vector6::zeros(), Vector6::zeros());
        for substep in 0..SUBSTEPS {
            let motors = self.motor_motion();
            let mut load = load;
            let mut force_n = load.fixed_rows_mut::<3>(0);
            force_n += self.tool.beyond_mean_n(substep);
            let held = moving.step(&motors, &load, self.workpiece.as_ref());
            let axis_loads_n = std::array::from_fn(|axis| held[axis] / self.metres_per_q[axis]);
            self.step_drives(substep, &axis_loads_n);
            if is_averaged {
                found += moving.sensor_load() / f64::from(SUBSTEPS);
                accelerations += moving.accelerations() / f64::from(SUBSTEPS);
            }
        }
        self.drives.iter_mut().for_each(Drive::end);
        self.stop_partners();
        self.loaded = moving.equilibrium();
        if !moving.is_finite() {
            return Err("the machine has left every range");
        }
        self.springs.follow(self.loaded.cluster_3_n());
        self.settle_rigid()
            .map_err(|_| "the rigid machine has no place for these references")?;
        // Of the last step, with the mean of what changes in a cycle.
        let beyond_n = self.tool.beyond_mean_n(SUBSTEPS - 1);
        let on_tool = moving.load().fixed_rows::<3>(0) - beyond_n;
        self.load.force_n = on_tool.into();
        if !is_averaged {
            found = moving.sensor_load();
            accelerations = *moving.accelerations();
        }
        let found = Wrench::from_array(found.into());
        self.sample = self.sensor.sample(&found, &self.loaded.pose.rotation);
        self.measure_acceleration(&accelerations, &moving.angular_velocity());
        Ok(())
    }

    fn actual(&self) -> Result<[Actual; N], &'static str> {
        let mut actual = [Actual::default(); N];
        for (axis, report) in actual.iter_mut().enumerate() {
            *report = drive::report(self.drives_of(axis))
                .map_err(|_| "an axis has left the range of positions")?;
        }
        Ok(actual)
    }

    /// Runs one step of the drives under the loads on axes, N.
    fn step_drives(&mut self, substep: u32, axis_loads_n: &[f64; N]) {
        let axis_of_motor = self.motors.axis_of_motor();
        for (drive, &axis) in self.drives.iter_mut().zip(axis_of_motor) {
            if self.carts[axis].is_none() {
                drive.step(substep, axis_loads_n[axis] / self.motors_of_axis[axis]);
            }
        }
        for (axis, cart) in self.carts.iter_mut().enumerate() {
            if let Some(cart) = cart {
                let is_of_axis = |motor: usize| axis_of_motor[motor] == axis;
                coupled::step(
                    &mut self.drives,
                    is_of_axis,
                    cart,
                    substep,
                    axis_loads_n[axis],
                );
            }
        }
    }

    /// Stops every drive of an axis of which one has stopped by itself.
    fn stop_partners(&mut self) {
        for axis in 0..N {
            if self.drives_of(axis).any(|drive| drive.trip().is_some()) {
                let drives = self.drives.iter_mut().zip(self.motors.axis_of_motor());
                drives
                    .filter(|(_, of)| **of == axis)
                    .for_each(|(drive, _)| drive.stop_with_partner());
            }
        }
    }

    /// Returns the reason for which a drive does not follow its references.
    fn stopped(&self) -> Option<&'static str> {
        let drive = self
            .drives
            .iter()
            .find(|drive| drive.state() > DriveState::Ready)?;
        let first = self
            .drives
            .iter()
            .filter_map(Drive::trip)
            .find(|trip| *trip != Trip::Partner);
        let on_its_way = "a drive moves onto its reference after a reset";
        Some(first.or(drive.trip()).map_or(on_its_way, Trip::reason))
    }

    /// Returns the drives of one axis.
    fn drives_of(&self, axis: usize) -> impl Iterator<Item = &Drive> + Clone {
        let drives = self.drives.iter().zip(self.motors.axis_of_motor());
        drives.filter_map(move |(drive, of)| (*of == axis).then_some(drive))
    }

    /// Finds the poses for the motors and for the nominal in force.
    fn settle_platform(&mut self) -> Result<(), ElasticError> {
        let load = Vector6::from(self.load.wrench().to_array());
        let motors = self.motor_motion().places;
        self.loaded = self.springs.settle(&motors, &load, &self.loaded)?;
        self.settle_rigid()
    }

    /// Finds the pose for the nominal in force.
    fn settle_rigid(&mut self) -> Result<(), ElasticError> {
        let nominal = std::array::from_fn(|axis| {
            self.in_force[axis].nominal.to_metres().0 / self.metres_per_q[axis]
        });
        self.rigid =
            self.springs
                .machine()
                .equilibrium(&nominal, &Vector6::zeros(), &self.rigid)?;
        Ok(())
    }

    fn tool_reading(&self) -> ToolReading {
        let displaced = self.seen_from(self.rigid.pose, &[]).displacement();
        let displacement: [f64; 3] = displaced.translation_m.into();
        ToolReading {
            step: self.load.step,
            load: self.load.wrench().to_array(),
            sensor: self.sample.to_array(),
            sensor_age: 0,
            acceleration: self.acceleration,
            displacement_m: displacement,
            turn_rad: displaced.rotation_rad.into(),
            gauges_m: displacement.map(|length| whole_steps(length, self.gauge_resolution_m)),
        }
    }
}

impl<const N: usize, const M: usize> Plant<N, M> for SimulatedMachine<N, M> {
    type Error = PlantError;

    fn in_force(&mut self) -> Result<[InForce; N], PlantError> {
        Ok(self.in_force)
    }

    fn read(&mut self, elapsed: u64) -> Result<Reading<N>, PlantError> {
        for _ in 0..elapsed.min(MAX_CYCLES_PER_READ) {
            self.advance().map_err(not_advanced)?;
        }
        if let Some(reason) = self.stopped() {
            return Err(PlantError {
                operation: "follow its references",
                reason,
            });
        }
        let actual = self.actual().map_err(not_advanced)?;
        Ok(Reading {
            nominal: self.nominal,
            actual,
            tool: Some(self.tool_reading()),
        })
    }

    fn write(
        &mut self,
        references: &[Reference; M],
        parts: &[InForce; N],
    ) -> Result<(), PlantError> {
        if self.interface == Interface::Velocity {
            let reason = "its drives take velocities (drives.interface)";
            return Err(PlantError {
                operation: "write positions",
                reason,
            });
        }
        for (drive, reference) in self.drives.iter_mut().zip(references) {
            drive.command(reference);
        }
        self.in_force = *parts;
        Ok(())
    }

    fn drives(&self) -> Option<[DriveState; N]> {
        Some(std::array::from_fn(|axis| {
            self.drives_of(axis)
                .map(Drive::state)
                .max()
                .unwrap_or(DriveState::NotReady)
        }))
    }

    fn reset(&mut self) {
        self.drives.iter_mut().for_each(Drive::reset);
    }
}

impl<const N: usize, const M: usize> VelocityPlant<N, M> for SimulatedMachine<N, M> {
    fn write_velocity(
        &mut self,
        velocities: &[VelocityReference; M],
        parts: Option<&[InForce; N]>,
    ) -> Result<(), PlantError> {
        if self.interface == Interface::Position {
            let reason = "its drives take positions (drives.interface)";
            return Err(PlantError {
                operation: "write velocities",
                reason,
            });
        }
        for (drive, reference) in self.drives.iter_mut().zip(velocities) {
            drive.command_velocity(reference);
        }
        if let (Some(parts), true) = (parts, self.stands) {
            self.interpolator
                .go_on_from(parts.map(|axis| axis.nominal.to_metres().0));
        }
        self.stands = parts.is_none();
        if let Some(parts) = parts {
            self.in_force = *parts;
        }
        Ok(())
    }

    fn quick_stop(&self) -> Option<QuickStop> {
        self.quick_stop
    }
}

/// Returns the number of motors of an axis.
fn motors_of<const N: usize, const M: usize>(motors: &MotorMap<N, M>, axis: usize) -> f64 {
    let of_axis = motors.axis_of_motor().iter().filter(|of| **of == axis);
    of_axis.count() as f64
}

fn not_advanced(reason: &'static str) -> PlantError {
    PlantError {
        operation: "advance the simulation",
        reason,
    }
}

/// Returns the direction in which a motor pushes with its bias: the first of a pair forwards, the
/// second backwards, any other not.
fn direction(axis_of_motor: &[usize], motor: usize) -> f64 {
    let mut of_axis = axis_of_motor
        .iter()
        .enumerate()
        .filter(|(_, axis)| **axis == axis_of_motor[motor]);
    match (of_axis.clone().count(), of_axis.next()) {
        (2, Some((first, _))) if first == motor => 1.0,
        (2, _) => -1.0,
        _ => 0.0,
    }
}

/// Returns the stop of drives that take velocities.
fn quick_stop(settings: &Settings) -> Option<QuickStop> {
    let limits = settings
        .limits
        .filter(|_| settings.interface == Interface::Velocity)?;
    Some(QuickStop {
        watchdog_cycles: limits.watchdog_cycles,
        quick_stop_m_per_s2: settings.quick_stop_m_per_s2,
    })
}

/// Converts metres to the reference path.
fn positions_nm<const N: usize>(
    positions_m: &[f64; N],
) -> Result<[PositionNm; N], SimulationError> {
    let mut positions = [PositionNm(0); N];
    for (nm, metres) in positions.iter_mut().zip(positions_m) {
        *nm = PositionNm::from_metres(Metres(*metres)).map_err(|_| {
            SimulationError::OutOfRange(OutOfRange {
                parameter: "axis position (q times metres_per_q)",
                lower: -9e6,
                upper: 9e6,
            })
        })?;
    }
    Ok(positions)
}

pub(crate) fn without_offsets(position: PositionNm) -> Reference {
    Reference {
        position,
        velocity_offset: VelocityUmS(0),
        torque_offset: TorquePermille(0),
    }
}

/// Returns what an incremental length gauge shows: the nearest whole step, in metres.
fn whole_steps(length_m: f64, step_m: f64) -> f64 {
    (length_m / step_m).round() * step_m
}

#[cfg(test)]
mod tests;
