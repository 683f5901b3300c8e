//! Length gauges of a campaign `[T 4.2.6, 4.2.9]`: flat faces on platform and tool, and carts against their rails, with zeros, drift, and errors of
//! where they stand, all drawn by seed.

use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::measurements::plan::Plan;
use crate::robot_file::Simulation;
use crate::springs::gauge::Gauge;
use crate::springs::loaded::Loaded;

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
    /// Draws the errors of a plan's gauges: of their places per mounting, of zeros and drifts per series.
    #[must_use]
    pub fn new<const N: usize>(plan: &Plan<N>, simulation: &Simulation) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(simulation.seed);
        random.set_stream(STREAM);
        let mut normal = |sd: f64| sd * Distribution::<f64>::sample(&StandardNormal, &mut random);
        let (point_m, turn_rad) = (simulation.gauge_point_mm * 1e-3, simulation.gauge_axis_mrad * 1e-3);
        let mut off = |sd: f64| Vector3::from_fn(|_, _| normal(sd));
        let mut misplaced = |gauge: &Gauge| match *gauge {
            Gauge::Face { body, point_m: point, axis } => {
                // A turn about the axis itself changes nothing.
                let turn = UnitQuaternion::from_scaled_axis(off(turn_rad));
                Gauge::Face { body, point_m: point + off(point_m), axis: turn * axis }
            }
            gauge @ Gauge::Axis { .. } => gauge,
        };
        let mountings = plan.mountings.iter();
        let mountings = mountings.map(|_| plan.gauges.iter().map(|named| misplaced(&named.gauge)).collect()).collect();
        let drift_m_per_s = simulation.drift_um_per_min * 1e-6 / 60.0;
        let zeros = |_| plan.gauges.iter().map(|_| (normal(ZERO_SD_M), normal(drift_m_per_s))).collect();
        Self { mountings, series: plan.series.iter().map(zeros).collect() }
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
