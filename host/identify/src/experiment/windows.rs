//! Windows from samples: after a change of level the machine must settle, then the mean is taken
//! `[T 4.2.9]`.
//!
//! A level has settled after [`WindowRules::settle_s`], as soon as the slope of force and of every
//! gauge over the last [`WindowRules::slope_s`] is below [`WindowRules::slope_errors`] standard
//! errors, or moves a mean by less than a tenth of its stated noise. The mean of the next
//! [`WindowRules::mean_s`] is the window; where the force has drifted by more than
//! [`WindowRules::max_drift`] meanwhile, it is refused and the level settles again. Standard errors
//! are those of the effective number of samples, `n / (1 + 2 sum rho_k)`: neighbours are alike.
//! Time is that of the ticks.

mod statistics;

use std::collections::VecDeque;

use gantry_tau_server::links::gauges::MAX_GAUGES;
use nalgebra::Vector3;

use crate::measurements::springs::Noise;
use statistics::{MIN_SAMPLES, Slope, effective, mean, variance};

/// Time of a tick, s.
pub const TICK_S: f64 = 1e-3;
/// Ticks between two settle tests.
const TEST_TICKS: u64 = 100;
/// Most ticks between two samples of one window.
const GAP_TICKS: u64 = 100;
/// Share of the stated noise of a mean that a slope may move it by.
const NEGLIGIBLE: f64 = 0.1;
/// Rules of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowRules {
    /// Least time from a change of level to the window, s.
    pub settle_s: f64,
    /// Time over which slopes are tested, s.
    pub slope_s: f64,
    /// Length of a window, s.
    pub mean_s: f64,
    /// Largest slope, in its standard errors.
    pub slope_errors: f64,
    /// Largest drift of the force in a window, as a share of the force.
    pub max_drift: f64,
    /// Noise of a mean, as the set-up states it.
    pub noise: Noise,
}

impl WindowRules {
    /// The thesis' windows of 2 s, after 3 s at least.
    #[must_use]
    pub const fn new(noise: Noise) -> Self {
        Self {
            settle_s: 3.0,
            slope_s: 1.0,
            mean_s: 2.0,
            slope_errors: 3.0,
            max_drift: 0.02,
            noise,
        }
    }
}

/// Instruments in one tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InstrumentSample<const N: usize> {
    /// The tick.
    pub tick: u64,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Force (N), then moment (N m), in any axes that stay.
    pub wrench: [f64; 6],
    /// Gauges, m; the first `gauges` entries.
    pub lengths_m: [f64; MAX_GAUGES],
    /// Number of gauges.
    pub gauges: usize,
}

impl<const N: usize> InstrumentSample<N> {
    fn is_finite(&self) -> bool {
        self.q
            .iter()
            .chain(&self.wrench)
            .chain(self.lengths_m())
            .all(|value| value.is_finite())
    }

    fn lengths_m(&self) -> &[f64] {
        self.lengths_m.get(..self.gauges).unwrap_or(&self.lengths_m)
    }
}

/// Mean of a gauge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean, m.
    pub length_m: f64,
    /// Standard deviation of the mean, m.
    pub sd_m: f64,
}

/// Means of a window.
#[derive(Clone, Debug, PartialEq)]
pub struct Means<const N: usize> {
    /// Tick of its first sample.
    pub first_tick: u64,
    /// Number of samples.
    pub samples: u64,
    /// Positions of the axes, q-units.
    pub q: [f64; N],
    /// Force (N), then moment (N m), in the axes of the samples.
    pub wrench: [f64; 6],
    /// Gauges.
    pub gauges: Vec<Mean>,
}

/// Progress of a level.
#[derive(Clone, Debug, PartialEq)]
pub enum Progress<const N: usize> {
    /// It settles.
    Settling,
    /// The mean is being taken.
    Averaging,
    /// The force has drifted by this share of itself; the level settles again.
    Refused {
        /// Drift, N.
        drift_n: f64,
    },
    /// The window.
    Taken(Means<N>),
}

/// Windows of one level after another.
#[derive(Clone, Debug)]
pub struct WindowCollector<const N: usize> {
    rules: WindowRules,
    /// Samples of the slope, or of the mean.
    samples: VecDeque<InstrumentSample<N>>,
    /// First tick of the level.
    since: Option<u64>,
    /// The last sample.
    last: Option<InstrumentSample<N>>,
    last_test: u64,
    is_averaging: bool,
}

impl<const N: usize> WindowCollector<N> {
    /// Begins with a new level.
    #[must_use]
    pub const fn new(rules: WindowRules) -> Self {
        Self {
            rules,
            samples: VecDeque::new(),
            since: None,
            last: None,
            last_test: 0,
            is_averaging: false,
        }
    }

    /// Begins a new level.
    pub fn restart(&mut self) {
        *self = Self::new(self.rules);
    }

    /// Takes the next sample. One that is not finite, or comes after a gap, begins the level again.
    pub fn feed(&mut self, sample: &InstrumentSample<N>) -> Progress<N> {
        if self.last.is_some_and(|last| last.tick >= sample.tick) {
            return self.state();
        }
        let follows = self.last.is_none_or(|last| {
            sample.tick - last.tick <= GAP_TICKS
                && last.gauges == sample.gauges
                && sample.is_finite()
        });
        if !follows {
            self.restart();
        }
        if !sample.is_finite() {
            return self.state();
        }
        self.last = Some(*sample);
        let since = *self.since.get_or_insert(sample.tick);
        self.samples.push_back(*sample);
        if self.is_averaging {
            return self.average(sample.tick);
        }
        while self.span_ticks() >= ticks(self.rules.slope_s) {
            self.samples.pop_front();
        }
        let is_due = sample.tick - since >= ticks(self.rules.settle_s)
            && sample.tick - self.last_test >= TEST_TICKS;
        if is_due {
            self.last_test = sample.tick;
            if self.has_settled() {
                self.is_averaging = true;
                self.samples.clear();
            }
        }
        self.state()
    }

    const fn state(&self) -> Progress<N> {
        if self.is_averaging {
            Progress::Averaging
        } else {
            Progress::Settling
        }
    }

    /// Ticks from the first sample to the last.
    fn span_ticks(&self) -> u64 {
        self.samples
            .front()
            .zip(self.samples.back())
            .map_or(0, |(first, last)| last.tick - first.tick)
    }

    fn has_settled(&self) -> bool {
        let Noise {
            gauge_um, force_n, ..
        } = self.rules.noise;
        let gauges = self.samples.back().map_or(0, |sample| sample.gauges);
        (0..3).all(|axis| self.is_flat(|sample| sample.wrench[axis], force_n))
            && (0..gauges)
                .all(|gauge| self.is_flat(|sample| sample.lengths_m[gauge], gauge_um * 1e-6))
    }

    /// True if a value of this noise does not change.
    fn is_flat(&self, value: impl Fn(&InstrumentSample<N>) -> f64, noise: f64) -> bool {
        self.slope(value).is_some_and(|slope| {
            let moved = slope.per_s.abs() * self.rules.mean_s;
            slope.per_s.abs() <= self.rules.slope_errors * slope.error_per_s
                || moved <= NEGLIGIBLE * noise
        })
    }

    fn slope(&self, value: impl Fn(&InstrumentSample<N>) -> f64) -> Option<Slope> {
        let first = self.samples.front()?.tick;
        let points: Vec<(f64, f64)> = self
            .samples
            .iter()
            .map(|sample| ((sample.tick - first) as f64 * TICK_S, value(sample)))
            .collect();
        Slope::of(&points)
    }

    fn average(&mut self, tick: u64) -> Progress<N> {
        let first = self.samples.front().map_or(tick, |first| first.tick);
        if tick - first + 1 < ticks(self.rules.mean_s) {
            return Progress::Averaging;
        }
        let Some(means) = self.means(first) else {
            self.restart();
            return Progress::Settling;
        };
        let drift = Vector3::from_fn(|axis, _| {
            self.slope(|sample| sample.wrench[axis])
                .map_or(0.0, |slope| slope.per_s)
        });
        let drift_n = drift.norm() * self.rules.mean_s;
        let force_n = Vector3::new(means.wrench[0], means.wrench[1], means.wrench[2]).norm();
        self.is_averaging = false;
        self.samples.clear();
        if drift_n > (self.rules.max_drift * force_n).max(self.rules.noise.force_n) {
            return Progress::Refused { drift_n };
        }
        self.restart();
        Progress::Taken(means)
    }

    fn means(&self, first_tick: u64) -> Option<Means<N>> {
        let count = self.samples.len();
        if count < MIN_SAMPLES {
            return None;
        }
        let gauges = self.samples.back()?.gauges;
        let gauges = (0..gauges).map(|gauge| {
            let values = self.values(|sample| sample.lengths_m[gauge]);
            let length_m = mean(&values);
            Mean {
                length_m,
                sd_m: (variance(&values, length_m) / effective(&values)).sqrt(),
            }
        });
        Some(Means {
            first_tick,
            samples: count as u64,
            q: std::array::from_fn(|axis| mean(&self.values(|sample| sample.q[axis]))),
            wrench: std::array::from_fn(|component| {
                mean(&self.values(|sample| sample.wrench[component]))
            }),
            gauges: gauges.collect(),
        })
    }

    fn values(&self, value: impl Fn(&InstrumentSample<N>) -> f64) -> Vec<f64> {
        self.samples.iter().map(value).collect()
    }
}

fn ticks(seconds: f64) -> u64 {
    (seconds / TICK_S).round() as u64
}

#[cfg(test)]
mod tests;
