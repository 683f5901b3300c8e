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
