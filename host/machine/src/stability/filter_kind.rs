//! Kinds of filters, and what each is for a machine in one place.

use gantry_tau_core::model::load_filter::Notch;
use gantry_tau_core::model::sensor::LowPass;

use super::{Filter, LinearMachine, LoopResponse};
use crate::robot_file::{FilterKey, RobotFile, Sensor};

/// Lowest modes among which notches are chosen.
const CANDIDATES: usize = 6;

/// Filter of a compensation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FilterKind {
    /// Low-pass of first order.
    FirstOrder {
        /// Cut-off, Hz.
        cutoff_hz: f64,
    },
    /// Butterworth low-pass of second order.
    SecondOrder {
        /// Cut-off, Hz.
        cutoff_hz: f64,
    },
    /// Butterworth low-pass of second order, and notches at the modes of the place that the loop
    /// feels most.
    Auto {
        /// Cut-off, Hz.
        cutoff_hz: f64,
        /// Number of notches.
        notches: usize,
        /// Their Q.
        notch_q: f64,
    },
}

impl FilterKind {
    /// Filter of the load in a client of this machine: [`Auto`](Self::Auto) by default with masses,
    /// else [`FirstOrder`](Self::FirstOrder).
    #[must_use]
    pub fn of<K, const N: usize>(robot: &RobotFile<K, N>) -> Self {
        let usual = match robot.masses {
            Some(_) => FilterKey::Auto,
            None => FilterKey::FirstOrder,
        };
        Self::of_keys(
            robot.sensor.filter.unwrap_or(usual),
            robot.sensor.cutoff_hz,
            &robot.sensor,
        )
    }

    /// Filter of this key and cut-off (Hz), with the notches of a force sensor's keys.
    #[must_use]
    pub fn of_keys(key: FilterKey, cutoff_hz: f64, sensor: &Sensor) -> Self {
        let Sensor {
            notches, notch_q, ..
        } = *sensor;
        match key {
            FilterKey::FirstOrder => Self::FirstOrder { cutoff_hz },
            FilterKey::SecondOrder => Self::SecondOrder { cutoff_hz },
            FilterKey::Auto => Self::Auto {
                cutoff_hz,
                notches: notches.into(),
                notch_q,
            },
        }
    }

    /// Returns the kind of its low-pass.
    #[must_use]
    pub const fn low_pass(&self) -> LowPass {
        match self {
            Self::FirstOrder { .. } => LowPass::FirstOrder,
            Self::SecondOrder { .. } | Self::Auto { .. } => LowPass::SecondOrder,
        }
    }

    /// Returns the cut-off of its low-pass, Hz.
    #[must_use]
    pub const fn cutoff_hz(&self) -> f64 {
        match *self {
            Self::FirstOrder { cutoff_hz }
            | Self::SecondOrder { cutoff_hz }
            | Self::Auto { cutoff_hz, .. } => cutoff_hz,
        }
    }

    /// Returns the notches for a machine, lowest first: at those of its lowest modes where the loop
    /// has the largest gain behind the low-pass. `None` if eigenvalues are not found.
    #[must_use]
    pub fn notches<const N: usize>(
        &self,
        machine: &LinearMachine<N>,
        response: &LoopResponse<N>,
    ) -> Option<Vec<Notch>> {
        let Self::Auto {
            cutoff_hz,
            notches,
            notch_q,
        } = *self
        else {
            return Some(Vec::new());
        };
        let low_pass = Filter::butterworth(cutoff_hz);
        let mut modes: Vec<(f64, f64)> = (machine.modes.hz().into_iter())
            .take(CANDIDATES)
            .map(|hz| Some((response.radius(hz)? * low_pass.gain(hz), hz)))
            .collect::<Option<_>>()?;
        modes.sort_by(|one, other| other.0.total_cmp(&one.0));
        modes.truncate(notches);
        modes.sort_by(|one, other| one.1.total_cmp(&other.1));
        let at = |(_, hz): (f64, f64)| Notch { hz, q: notch_q };
        Some(modes.into_iter().map(at).collect())
    }

    /// Returns the filter with notches whose frequencies are taken for `modes_factor` times what
    /// they are.
    #[must_use]
    pub fn with(&self, notches: &[Notch], modes_factor: f64) -> Filter {
        let low_pass = match *self {
            Self::FirstOrder { cutoff_hz } => Filter::first_order(cutoff_hz),
            Self::SecondOrder { cutoff_hz } | Self::Auto { cutoff_hz, .. } => {
                Filter::butterworth(cutoff_hz)
            }
        };
        notches.iter().fold(low_pass, |filter, notch| {
            filter.with_notch(notch.hz * modes_factor, notch.q)
        })
    }
}
