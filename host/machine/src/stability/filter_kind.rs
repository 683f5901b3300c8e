//! Kinds of filters, and what each is for a machine in one place.

use super::{Filter, LinearMachine, LoopGain};

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
    /// Returns the filter for a machine whose modes are taken for `modes_factor` times what they
    /// are. `None` if eigenvalues are not found.
    #[must_use]
    pub fn designed<const N: usize>(
        &self,
        machine: &LinearMachine<N>,
        gain: &LoopGain,
        modes_factor: f64,
    ) -> Option<Filter> {
        match *self {
            Self::FirstOrder { cutoff_hz } => Some(Filter::first_order(cutoff_hz)),
            Self::SecondOrder { cutoff_hz } => Some(Filter::butterworth(cutoff_hz)),
            Self::Auto {
                cutoff_hz,
                notches,
                notch_q,
            } => {
                let low_pass = Filter::butterworth(cutoff_hz);
                let mut modes: Vec<(f64, f64)> = (machine.modes.hz().into_iter())
                    .take(CANDIDATES)
                    .map(|hz| Some((gain.radius(hz)? * low_pass.gain(hz), hz)))
                    .collect::<Option<_>>()?;
                modes.sort_by(|one, other| other.0.total_cmp(&one.0));
                let chosen = modes.into_iter().take(notches);
                Some(chosen.fold(low_pass, |filter, (_, hz)| {
                    filter.with_notch(hz * modes_factor, notch_q)
                }))
            }
        }
    }
}
