//! Six-axis force sensor at the tool: ATI Mini85 `[T 4.2.5]`.

use gantry_tau_core::model::statics::Wrench;
use gantry_tau_machine::robot_file::{Sensor, Simulation};
use gantry_tau_machine::sensor::Mounting;
use nalgebra::{UnitQuaternion, Vector6};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Stream of the seeded generator, apart from the springs' stream.
const NOISE_STREAM: u64 = 2;
/// Zero error, N and N m, sensor axes. ASSUMED; a client tares it.
const BIAS: [f64; 6] = [1.5, -0.8, 2.0, 0.05, -0.1, 0.02];

/// A noisy sensor with a zero error.
#[derive(Clone, Debug)]
pub struct SimulatedForceSensor {
    mounting: Mounting,
    noise: Vector6<f64>,
    random: ChaCha8Rng,
}

impl SimulatedForceSensor {
    /// Creates the sensor with this mounting, and with noise and seed of the simulation.
    #[must_use]
    pub fn new(mounting: &Sensor, simulation: &Simulation) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(simulation.seed);
        random.set_stream(NOISE_STREAM);
        let (force, moment) = (simulation.force_noise_n, simulation.moment_noise_nm);
        let noise = Vector6::new(force, force, force, moment, moment, moment);
        Self {
            mounting: mounting.into(),
            noise,
            random,
        }
    }

    /// Returns a raw sample under `load`, in sensor axes, with the platform turned by `platform`
    /// (platform to world).
    pub fn sample(&mut self, load: &Wrench, platform: &UnitQuaternion<f64>) -> Wrench {
        let random = &mut self.random;
        let unit = Vector6::from_fn(|_, _| StandardNormal.sample(random));
        let seen = self.mounting.seen(&load.to_array().into(), platform);
        let sample = seen + Vector6::from(BIAS) + self.noise.component_mul(&unit);
        Wrench::from_array(sample.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn noise_has_the_stated_spread_about_the_bias() {
        let parameters = fixture::parameters();
        let mut sensor = SimulatedForceSensor::new(&parameters.sensor, &parameters.simulation);
        let unloaded = sensor
            .mounting
            .seen(&Vector6::zeros(), &UnitQuaternion::identity());
        let count = 20_000;
        let (mut sum, mut squares) = (Vector6::zeros(), Vector6::zeros());
        for _ in 0..count {
            let sample = sensor.sample(&Wrench::zero(), &UnitQuaternion::identity());
            let off = Vector6::from(sample.to_array()) - Vector6::from(BIAS) - unloaded;
            sum += off;
            squares += off.component_mul(&off);
        }
        let (mean, variance) = (sum / f64::from(count), squares / f64::from(count));
        for axis in 0..6 {
            let expected = if axis < 3 { 0.5 } else { 0.02 };
            assert!(mean[axis].abs() < 0.03 * expected);
            assert!((variance[axis].sqrt() / expected - 1.0).abs() < 0.03);
        }
    }
}
