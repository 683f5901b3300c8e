//! Length gauges of a campaign `[T 4.2.6, 4.2.9]`: flat faces on platform and tool, and carts
//! against their rails, with zeros, drift, and errors of where they stand, all drawn by seed.

use gantry_tau_machine::elastic::gauge::Gauge;
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::robot_file::Simulation;
use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::noise::normal;
use crate::measurements::plan::Plan;

/// Stream of the seeded generator, apart from those of springs and force sensor.
const STREAM: u64 = 3;
/// Standard deviation of a gauge's zero, m.
const ZERO_SD_M: f64 = 1e-4;

/// The gauges of a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedGauges {
    /// Gauges where they really stand, by mounting.
    mountings: Vec<Vec<Gauge>>,
    /// Zero (m) and drift (m/s) of each gauge, by series.
    series: Vec<Vec<(f64, f64)>>,
}

impl SimulatedGauges {
    /// Draws the errors of a plan's gauges: of their places per mounting, of zeros and drifts per
    /// series.
    #[must_use]
    pub fn new<const N: usize>(plan: &Plan<N>, simulation: &Simulation) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(simulation.seed);
        random.set_stream(STREAM);
        let mountings = plan.mountings.iter().map(|_| {
            let gauges = plan.gauges.iter();
            gauges
                .map(|named| misplaced(&named.gauge, simulation, &mut random))
                .collect()
        });
        let mountings = mountings.collect();
        let drift_m_per_s = simulation.drift_um_per_min * 1e-6 / 60.0;
        let series = plan.series.iter().map(|_| {
            let gauges = plan.gauges.iter().map(|_| {
                let zero_m = normal(&mut random, ZERO_SD_M);
                (zero_m, normal(&mut random, drift_m_per_s))
            });
            gauges.collect()
        });
        Self {
            mountings,
            series: series.collect(),
        }
    }

    /// Returns what a gauge shows, m, `seconds` after its series began.
    #[must_use]
    pub fn read<const N: usize>(
        &self,
        (series, mounting, gauge): (usize, usize, usize),
        loaded: &Loaded<N>,
        seconds: f64,
    ) -> f64 {
        let (zero_m, drift_m_per_s) = self.series[series][gauge];
        let length_m = self.mountings[mounting][gauge].read(loaded).length_m;
        length_m + zero_m + drift_m_per_s * seconds
    }
}

/// A gauge where it really stands.
fn misplaced(gauge: &Gauge, simulation: &Simulation, random: &mut ChaCha8Rng) -> Gauge {
    let Gauge::Face {
        body,
        point_m,
        axis,
    } = *gauge
    else {
        return *gauge;
    };
    let turn_sd_rad = simulation.gauge_axis_mrad * 1e-3;
    let point_sd_m = simulation.gauge_point_mm * 1e-3;
    // A turn about the axis itself changes nothing.
    let turn = Vector3::from_fn(|_, _| normal(random, turn_sd_rad));
    let shift_m = Vector3::from_fn(|_, _| normal(random, point_sd_m));
    Gauge::Face {
        body,
        point_m: point_m + shift_m,
        axis: UnitQuaternion::from_scaled_axis(turn) * axis,
    }
}
