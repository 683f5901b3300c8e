//! Accelerometer on the platform.

use gantry_tau_machine::accelerometer::{Accelerometer, MeasuredAxes};
use gantry_tau_machine::robot_file::Simulation;
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Stream of the seeded generator, apart from those of the other instruments.
const NOISE_STREAM: u64 = 9;
/// Noise of an angular acceleration by that of a linear one, rad/m. ASSUMED.
const ANGULAR_NOISE_PER_M: f64 = 10.0;
/// Zero error, in its axes. ASSUMED; a client tares it.
const BIAS: [f64; 6] = [0.08, -0.05, 0.1, 0.3, -0.2, 0.1];

/// A noisy accelerometer with a zero error.
#[derive(Clone, Debug)]
pub(crate) struct SimulatedAccelerometer {
    accelerometer: Accelerometer,
    noise: Vector6<f64>,
    random: ChaCha8Rng,
}

impl SimulatedAccelerometer {
    pub(crate) fn new(accelerometer: Accelerometer, simulation: &Simulation) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(simulation.seed);
        random.set_stream(NOISE_STREAM);
        let linear = simulation.acceleration_noise_m_per_s2;
        let angular = ANGULAR_NOISE_PER_M * linear;
        Self {
            accelerometer,
            noise: Vector6::new(linear, linear, linear, angular, angular, angular),
            random,
        }
    }

    /// Returns a sample, in its axes: linear (m/s^2), then angular acceleration (rad/s^2). The
    /// motion is that of the tool centre point and of the orientation, world axes.
    pub(crate) fn sample(
        &mut self,
        acceleration: &Vector6<f64>,
        angular_velocity: &Vector3<f64>,
        platform: &UnitQuaternion<f64>,
    ) -> [f64; 6] {
        let random = &mut self.random;
        let unit = Vector6::from_fn(|_, _| StandardNormal.sample(random));
        let seen = self
            .accelerometer
            .seen(acceleration, angular_velocity, platform);
        let off = Vector6::from(BIAS) + self.noise.component_mul(&unit);
        let mut sample = seen + off;
        if self.accelerometer.axes == MeasuredAxes::Three {
            sample.fixed_rows_mut::<3>(3).fill(0.0);
        }
        sample.into()
    }
}

#[cfg(test)]
mod tests {
    use gantry_tau_core::control::axis::InForce;
    use gantry_tau_machine::masses::GRAVITY_M_PER_S2;
    use gantry_tau_machine::model::L2_MOTORS;
    use gantry_tau_machine::robot_file::{AccelerometerKeys, RobotFile};
    use gantry_tau_server::plant::Plant;
    use gantry_tau_server::plant::interpolator::Motion;

    use super::*;
    use crate::load_generator::load_generator;
    use crate::machine::SimulatedMachine;

    /// Against the second difference of the path, whose jerk of some 50 m/s^3 changes the acceleration
    /// by 0.05 m/s^2 in a tick.
    #[test]
    fn a_moving_machine_shows_its_acceleration_and_gravity() {
        let mut robot = RobotFile::builtin_l2().unwrap();
        robot.simulation.acceleration_noise_m_per_s2 = 0.0;
        robot.sensor.accelerometer = Some(AccelerometerKeys {
            place_m: [0.0; 3],
            axes: 3,
            rotation: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            share: 0.9,
            gravity: true,
        });
        let mut to_m = robot.home_q().unwrap();
        to_m.iter_mut().for_each(|place_m| *place_m += 0.2);
        let motion = Motion::BackAndForth {
            waypoints_m: vec![to_m],
            speed_m_per_s: 0.5,
            acceleration_m_per_s2: 3.0,
            dwell_cycles: 0,
        };
        let (_hand, tool) = load_generator();
        let mut machine =
            SimulatedMachine::<3, L2_MOTORS>::moving_from_robot(&robot, tool, motion).unwrap();
        let motors = robot.motor_map::<L2_MOTORS>().unwrap();
        let mut places_m = Vec::new();
        let mut most: f64 = 0.0;
        for _ in 0..400 {
            let reading = machine.read(1).unwrap();
            let references = reading.nominal.map(crate::machine::without_offsets);
            let references = motors.spread(&references).unwrap();
            machine
                .write(&references, &reading.nominal.map(InForce::at))
                .unwrap();
            places_m.push(machine.moving_pose().unwrap().translation_m);
            let Some([one, two, three]) = places_m.last_chunk::<3>() else {
                continue;
            };
            let moved = (three - two * 2.0 + one) * 1e6;
            let [x, y, z, turns @ ..] = reading.tool.unwrap().acceleration.unwrap();
            // Its x is y of the platform, its y is -x.
            let shown = Vector3::new(-(y - BIAS[1]), x - BIAS[0], z - BIAS[2] - GRAVITY_M_PER_S2);
            assert!((shown - moved).norm() < 0.15, "{shown} {moved}");
            assert_eq!(turns, [0.0; 3]);
            most = most.max(moved.norm());
        }
        assert!(most > 2.0, "{most}");
    }
}
