//! The force sensor: a reading turned, tared, and filtered.

use std::hint::black_box;

use gantry_tau_core::model::load_filter::{MAX_NOTCHES, Notch};
use gantry_tau_core::model::sensor::{ForceSensor, LowPass, Reading, SensorConfig, Tool};
use gantry_tau_core::model::statics::Wrench;
use nalgebra::{Matrix3, Vector3};

use super::measured;

pub(super) fn first_order() {
    update(LowPass::FirstOrder, [None; MAX_NOTCHES]);
}

/// With all notches on their way, which costs most.
pub(super) fn second_order() {
    let notches = [20.7, 47.6, 84.2].map(|hz| Some(Notch { hz, q: 0.7 }));
    update(LowPass::SecondOrder, notches);
}

fn update(low_pass: LowPass, notches: [Option<Notch>; MAX_NOTCHES]) {
    let mut sensor = ForceSensor::new(SensorConfig {
        rotation: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].into(),
        lever_m: Vector3::new(0.0, 0.0, -0.08),
        tool: Tool {
            weight_n: Vector3::new(0.0, 0.0, -18.0),
            centre_m: Vector3::new(0.01, 0.0, -0.12),
        },
        low_pass,
        cutoff_hz: 6.0,
        cycle_s: 1e-3,
        tare_samples: 1,
    })
    .unwrap();
    let raw = Wrench::from_array([360.0, -12.5, 0.0, 0.25, -1.0, 3.0]);
    let upright = Matrix3::identity();
    sensor.update(&raw, &upright).unwrap();
    sensor.set_notches(&notches).unwrap();
    let (raw, upright) = black_box((raw, upright));
    let reading = black_box(measured(|| sensor.update(&raw, &upright)));
    assert!(matches!(reading, Ok(Reading::Load(_))));
}
