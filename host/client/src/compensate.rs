//! Compensation of one cycle, from a raw force sample and the nominal positions to offsets, with
//! core's sensor and compensator.

use std::io;

use std::error::Error;

use gantry_tau_core::control::message::Welcome;
use gantry_tau_core::model::compensation::{CompensatorError, Correction};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::sensor::{ForceSensor, Reading, SensorError};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::{OffsetNm, PositionNm, Tick, TorquePermille};
use gantry_tau_machine::dynamics::MassiveMachine;
use gantry_tau_machine::elastic;
use gantry_tau_machine::model::{Compensate, MachineKind};
use gantry_tau_machine::robot_file::{FeedForwardKey, RobotFile, RobotFileError};
use gantry_tau_machine::sensor::{self, Mounting};
use gantry_tau_machine::stability::{FilterKind, NotchFinder};
use nalgebra::{Matrix3, Vector3, Vector6};

use crate::accelerometer::{AccelerometerError, MeasuredInertia};
use crate::feed_forward::{FeedForward, InertialLoads, TorqueScale};
use crate::notches::FollowingNotches;

/// Reason why a robot file gives no compensation.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// It has no compliances, or the compensator refuses a parameter.
    #[error(transparent)]
    Robot(#[from] RobotFileError),
    /// The force sensor refuses a parameter.
    #[error("{robot}: {reason}")]
    Sensor {
        /// Name of the robot file.
        robot: String,
        /// The reason.
        #[source]
        reason: SensorError,
    },
}

/// Samples of the instruments at the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Samples {
    /// Force (N) and moment (N m) as the force sensor shows them, its axes.
    pub wrench: Wrench,
    /// Linear (m/s^2), then angular acceleration (rad/s^2) as the accelerometer shows them, its axes;
    /// `None` without a sample that belongs to the wrench.
    pub acceleration: Option<[f64; 6]>,
}

/// Tare, filter and compensation, once per cycle. A copy goes on from the same state.
#[derive(Clone)]
pub struct Compensation<const N: usize> {
    sensor: ForceSensor,
    compensator: Box<dyn Compensate<N>>,
    /// Of a filter whose notches are at the natural frequencies of the machine.
    notches: Option<FollowingNotches<N>>,
    feed_forward: Option<FeedForward<N>>,
    /// Of a machine with an accelerometer.
    inertia: Option<MeasuredInertia>,
    /// Mounting of the force sensor, of a tool without weight.
    mounting: Mounting,
    metres_per_q: [f64; N],
    /// Load of the last cycle; `None` while taring.
    load: Option<Wrench>,
    /// Torques of the last cycle.
    torques: [TorquePermille; N],
    /// Turn of the platform by that load, and of the sensor on it: 2.5 mrad at 300 N on an L2,
    /// which is 0.75 N across.
    turn: Matrix3<f64>,
}

impl<const N: usize> Compensation<N> {
    /// Creates the compensation for the machine of a robot file, within its limits and those that
    /// the server announced. The notches of its filter, if it has any, are those of home.
    ///
    /// # Errors
    /// [`SetupError`], which names the parameter.
    pub fn new<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        welcome: &Welcome<N>,
    ) -> Result<Self, SetupError> {
        let mut limits = welcome.limits.map(|axis| OffsetNm(axis.position.max()));
        // A ceiling of its own: what a server allows beyond the robot file is not asked for.
        for (limit, own) in limits.iter_mut().zip(&robot.limits) {
            limit.0 = limit.0.min(own.limits.position.max());
        }
        let compensator = robot.compensator(limits)?;
        let refused = |reason| SetupError::Sensor {
            robot: robot.name.clone(),
            reason,
        };
        let mut sensor = ForceSensor::new(sensor::config(robot)).map_err(refused)?;
        let mut notches = None;
        let finder = NotchFinder::of(robot);
        if let Some(finder) =
            finder.filter(|finder| matches!(finder.filter, FilterKind::Auto { .. }))
        {
            let home = Pose::at(robot.home_m());
            let at_home = finder.at(&home, &robot.home_q()?);
            sensor
                .set_notches(&at_home.unwrap_or_default())
                .map_err(refused)?;
            notches = Some(FollowingNotches::new(finder, home));
        }
        let feed_forward = match robot.client.feed_forward {
            FeedForwardKey::None => None,
            FeedForwardKey::Inertia | FeedForwardKey::InertiaAndTorque => {
                let torques = torque_scale(robot, welcome);
                MassiveMachine::of(robot).map(|machine| {
                    let gain = robot.client.gain;
                    FeedForward::new(machine, robot.metres_per_q, limits, torques, gain)
                })
            }
        };
        Ok(Self {
            sensor,
            compensator,
            notches,
            feed_forward,
            inertia: MeasuredInertia::of(robot),
            mounting: Mounting {
                weight_n: Vector3::zeros(),
                ..Mounting::from(&robot.sensor)
            },
            metres_per_q: robot.metres_per_q,
            load: None,
            torques: [TorquePermille(0); N],
            turn: Matrix3::identity(),
        })
    }

    /// Finds the notches of the filter in a thread of its own, which ends with this value: for a client
    /// in real time, whose cycle has no time for it.
    ///
    /// # Errors
    /// The system has no thread.
    pub fn in_background(self) -> io::Result<Self> {
        let notches = self.notches.map(FollowingNotches::in_background);
        Ok(Self {
            notches: notches.transpose()?,
            ..self
        })
    }

    /// Returns the position offsets of one cycle for the samples and the nominal positions of a tick.
    /// Zero while taring.
    ///
    /// # Errors
    /// A sample is invalid or missing, or the positions have no solution.
    pub fn cycle(
        &mut self,
        tick: Tick,
        samples: &Samples,
        nominal: &[PositionNm; N],
    ) -> Result<Correction<N>, Box<dyn Error>> {
        // Those of a cycle that fails belong to another motion.
        self.torques = [TorquePermille(0); N];
        let pose = self.compensator.locate(nominal)?;
        let axes = self.q_of(nominal);
        self.follow(&pose, &axes)?;
        let inertia = (self.feed_forward.as_mut())
            .map(|motion| motion.update(tick.0, &(&pose).into(), &axes));
        let raw = self.without_inertia(samples, inertia.as_ref(), &pose)?;
        match self.sensor.update(&raw, &(self.turn * pose.rotation))? {
            Reading::Taring { .. } => Ok(Correction::ZERO),
            Reading::Load(load) => {
                if let (Some(loads), Some(motion)) = (&inertia, &self.feed_forward) {
                    self.torques = motion.torques(&(&pose).into(), &axes, loads);
                }
                self.load = Some(load);
                let turned_rad = self.compensator.turned_rad(&pose, nominal, &load)?;
                self.turn = rotation_from_vector(&turned_rad).unwrap_or_else(Matrix3::identity);
                self.correct(&pose, nominal, &load, inertia.as_ref())
            }
        }
    }

    /// Returns nominal positions in q-units.
    fn q_of(&self, nominal: &[PositionNm; N]) -> [f64; N] {
        let mut axes = [0.0; N];
        for ((axis, nominal), metres) in axes.iter_mut().zip(nominal).zip(&self.metres_per_q) {
            *axis = nominal.to_metres().0 / metres;
        }
        axes
    }

    /// Takes over notches that were found for another place.
    fn follow(&mut self, pose: &Pose, axes: &[f64; N]) -> Result<(), SensorError> {
        let Some(following) = &mut self.notches else {
            return Ok(());
        };
        match following.follow(pose, axes) {
            Some(notches) => self.sensor.set_notches(&notches),
            None => Ok(()),
        }
    }

    /// Returns a reading without the tool's inertia: the share that an accelerometer measures, and of
    /// the rest what the nominal motion makes of it. That is fed forward, and the filter of the load
    /// could not follow it.
    fn without_inertia(
        &mut self,
        samples: &Samples,
        nominal: Option<&InertialLoads<N>>,
        pose: &Pose,
    ) -> Result<Wrench, AccelerometerError> {
        let mut wrench = Vector6::from(samples.wrench.to_array());
        if let Some(inertia) = &mut self.inertia {
            let turned = Pose {
                rotation: self.turn * pose.rotation,
                ..*pose
            };
            let turned = elastic::Pose::from(&turned).rotation;
            let load = inertia.update(samples.acceleration.as_ref(), &turned)?;
            wrench += self.mounting.seen(&load, &turned);
        }
        if let Some(nominal) = nominal {
            let pose = elastic::Pose::from(pose);
            wrench -= self.mounting.seen(&nominal.on_sensor, &pose.rotation);
        }
        Ok(Wrench::from_array(wrench.into()))
    }

    /// Returns the offsets for a load and for the loads of the nominal motion.
    fn correct(
        &self,
        pose: &Pose,
        nominal: &[PositionNm; N],
        load: &Wrench,
        inertia: Option<&InertialLoads<N>>,
    ) -> Result<Correction<N>, Box<dyn Error>> {
        let (Some(inertia), Some(motion)) = (inertia, &self.feed_forward) else {
            return Ok(self.compensator.correct(pose, nominal, load)?);
        };
        let both = Vector6::from(load.to_array()) + inertia.on_machine.platform;
        let both = Wrench::from_array(both.into());
        let mut correction = self.compensator.correct(pose, nominal, &both)?;
        motion.correct_axes(&inertia.on_machine.axes, &mut correction)?;
        Ok(correction)
    }

    /// Asks for another share of the correction, 0 to 1.
    ///
    /// # Errors
    /// The share is out of range; the one before stays.
    pub fn set_gain(&mut self, gain: f64) -> Result<(), CompensatorError> {
        self.compensator.set_gain(gain)?;
        if let Some(motion) = &mut self.feed_forward {
            motion.gain = gain;
        }
        Ok(())
    }

    /// Returns the torque offsets of the last cycle; zero unless the robot file asks for them.
    #[must_use]
    pub const fn torques(&self) -> [TorquePermille; N] {
        self.torques
    }

    /// True if the tare is done.
    #[must_use]
    pub const fn is_tared(&self) -> bool {
        self.load.is_some()
    }

    /// Returns the load of the last cycle, world axes; zero while taring.
    #[must_use]
    pub fn load(&self) -> Wrench {
        self.load.unwrap_or_else(Wrench::zero)
    }
}

/// Returns the scale of the torques that a robot file asks for, within its limits and those that the
/// server announced.
fn torque_scale<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    welcome: &Welcome<N>,
) -> Option<TorqueScale<N>> {
    if robot.client.feed_forward != FeedForwardKey::InertiaAndTorque {
        return None;
    }
    let motors: [f64; N] = robot.motors.per_axis();
    let mut permille_per_n = robot.rated_n?;
    for (scale, motors) in permille_per_n.iter_mut().zip(motors) {
        *scale = 1e3 / (*scale * motors);
    }
    let mut most = [0; N];
    let limits = robot.limits.iter().zip(&welcome.limits);
    for (most, (own, allowed)) in most.iter_mut().zip(limits) {
        let least = own.limits.torque.max().min(allowed.torque.max());
        *most = i16::try_from(least).unwrap_or(i16::MAX);
    }
    Some(TorqueScale {
        permille_per_n,
        most,
    })
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::control::message::Capabilities;
    use gantry_tau_core::units::{Epoch, Metres};

    use super::*;
    use gantry_tau_machine::elastic::backlash::Backlash;
    use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium};

    /// The sensor turns with the platform under the load that it measures: 300 N in y would be
    /// taken 0.7 N across wrong.
    #[test]
    fn a_load_that_turns_its_sensor_is_measured_where_it_acts() {
        let robot = RobotFile::builtin_l2().unwrap();
        let welcome = Welcome {
            epoch: Epoch(1),
            tick: Tick(0),
            cycle_us: 1_000,
            echo_window: 0,
            capabilities: Capabilities::NONE,
            kinematics_checksum: 0,
            limits: robot.limits.map(|axis| axis.limits),
        };
        let mut compensation = Compensation::new(&robot, &welcome).unwrap();
        let q = robot.model.axes_at(&robot.home_m()).unwrap();
        let nominal = q.map(|q| PositionNm::from_metres(Metres(q)).unwrap());
        let machine = ElasticMachine::new(
            robot.model.geometry(),
            robot.compliances.unwrap(),
            Backlash::NONE,
        );
        let home = Equilibrium::at_home(robot.home_m().into());
        let mounting = Mounting::from(&robot.sensor);
        let load = Vector6::new(0.0, 300.0, 0.0, 0.0, 0.0, 0.0);
        let [(unloaded, _), (raw, turned_rad)] = [Vector6::zeros(), load].map(|load| {
            let equilibrium = machine.equilibrium(&q, &load, &home).unwrap();
            let platform = equilibrium.pose.rotation;
            let samples = Samples {
                wrench: Wrench::from_array(mounting.seen(&load, &platform).into()),
                acceleration: None,
            };
            (samples, platform.angle())
        });
        let tared = u64::from(robot.sensor.tare_samples);
        for tick in 0..tared {
            (compensation.cycle(Tick(tick), &unloaded, &nominal)).unwrap();
        }
        // The filter has settled.
        for tick in tared..tared + 1000 {
            compensation.cycle(Tick(tick), &raw, &nominal).unwrap();
        }
        let off = Vector6::from(compensation.load().to_array()) - load;
        let off = Vector3::new(off[0], off[1], off[2]).norm();
        assert!(turned_rad * 300.0 > 0.3, "{turned_rad}");
        // What the second order leaves of the turning.
        assert!(off < 0.02 * turned_rad * 300.0, "{off} N");
    }
}
