//! Low-pass of second order for a load, and notches behind it.
//!
//! A tool of mass reads its own inertia, so that a compensation is a loop in free air. A low-pass of
//! second order far below the first natural frequency of the machine turns the phase there by about
//! half a circle, and a notch at that frequency takes what is left.
//!
//! Sections are state-variable filters by the trapezoidal rule, with `g = tan(pi f T)` and damping
//! `d = 1 / Q`, exact at their frequency `f`:
//!
//! ```text
//! v_1 = (s_1 + g (x - s_2)) / (1 + g (g + d)),   v_2 = s_2 + g v_1
//! s_1' = 2 v_1 - s_1,                            s_2' = 2 v_2 - s_2
//! ```
//!
//! `v_2` is the low-pass, `x - d v_1` the notch. Without input `s_1^2 + s_2^2` never grows, for any
//! `g` and `d`: coefficients may move while it runs.
//!
//! Reference: V. Zavalishin, *The Art of VA Filter Design*, 2018, chapters 4 and 6.

use core::f64::consts::{PI, SQRT_2};
use nalgebra::Vector3;

use crate::model::linalg::tan;
use crate::model::statics::Wrench;

/// Largest number of notches.
pub const MAX_NOTCHES: usize = 3;
/// Sections of second order: the low-pass and the notches.
pub const SECTIONS: usize = 1 + MAX_NOTCHES;
/// Highest frequency of a section, as a share of the sampling frequency.
pub const MAX_FREQUENCY: f64 = 0.45;
/// Cycles in which a notch comes, goes, or moves to another frequency.
pub const GLIDE_CYCLES: u32 = 50;

/// A notch: `(s^2 + w^2) / (s^2 + w s / Q + w^2)` with `w = 2 pi f`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Notch {
    /// `f`: frequency that it takes out, Hz.
    pub hz: f64,
    /// `Q`: the higher, the narrower.
    pub q: f64,
}

/// Integrators of a section, for six channels.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SectionState {
    /// `s_1`.
    pub band: Wrench,
    /// `s_2`.
    pub low: Wrench,
}

impl SectionState {
    /// At rest, without a load.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            band: Wrench::zero(),
            low: Wrench::zero(),
        }
    }
}

/// Coefficients of a section.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Section {
    /// `g`.
    frequency: f64,
    /// `d`.
    damping: f64,
    /// Share of the notch that is in use: 0 without it.
    depth: f64,
}

impl Section {
    fn new(hz: f64, damping: f64, cycle_s: f64) -> Self {
        Self {
            frequency: tan(PI * hz * cycle_s),
            damping,
            depth: 1.0,
        }
    }

    /// Takes a sample of three channels; `s_1` and `s_2` become those after it. Returns `v_1` and
    /// `v_2`.
    fn next(
        &self,
        band: &mut Vector3<f64>,
        low: &mut Vector3<f64>,
        sample: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let g = self.frequency;
        let v_1 = (*band + (sample - *low) * g) / (1.0 + g * (g + self.damping));
        let v_2 = *low + v_1 * g;
        *band = v_1 * 2.0 - *band;
        *low = v_2 * 2.0 - *low;
        (v_1, v_2)
    }

    /// Takes a sample. Returns `v_1` and `v_2`.
    fn step(&self, state: &mut SectionState, load: &Wrench) -> (Wrench, Wrench) {
        let SectionState { band, low } = state;
        let force = self.next(&mut band.force_n, &mut low.force_n, &load.force_n);
        let moment = self.next(&mut band.moment_nm, &mut low.moment_nm, &load.moment_nm);
        let [v_1, v_2] = [(force.0, moment.0), (force.1, moment.1)]
            .map(|(force_n, moment_nm)| Wrench { force_n, moment_nm });
        (v_1, v_2)
    }
}

/// A notch, on its way to where it was set.
#[derive(Clone, Copy, Debug, PartialEq)]
struct MovingNotch {
    now: Section,
    target: Section,
    remaining: u32,
}

impl MovingNotch {
    const ABSENT: Self = {
        let section = Section {
            frequency: 0.0,
            damping: 1.0,
            depth: 0.0,
        };
        Self {
            now: section,
            target: section,
            remaining: 0,
        }
    };

    /// Sets another place, to be reached in this number of cycles.
    fn set(&mut self, notch: Option<Notch>, cycle_s: f64, cycles: u32) {
        self.target = match notch {
            Some(Notch { hz, q }) => Section::new(hz, 1.0 / q, cycle_s),
            None => Section {
                depth: 0.0,
                ..self.now
            },
        };
        if cycles == 0 {
            self.now = self.target;
        } else if self.now.depth == 0.0 {
            // It has no effect yet.
            self.now = Section {
                depth: 0.0,
                ..self.target
            };
        }
        self.remaining = cycles;
    }

    fn advance(&mut self) {
        let Some(rest) = self.remaining.checked_sub(1) else {
            return;
        };
        let share = 1.0 / f64::from(self.remaining);
        let (now, target) = (&mut self.now, &self.target);
        now.frequency += (target.frequency - now.frequency) * share;
        now.damping += (target.damping - now.damping) * share;
        now.depth += (target.depth - now.depth) * share;
        self.remaining = rest;
        if rest == 0 {
            self.now = self.target;
        }
    }
}

/// Coefficients of the low-pass and of the notches; their state is a [`SectionState`] each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LoadFilter {
    low_pass: Section,
    notches: [MovingNotch; MAX_NOTCHES],
}

impl LoadFilter {
    /// Butterworth low-pass, without notches.
    pub(super) fn new(cutoff_hz: f64, cycle_s: f64) -> Self {
        Self {
            low_pass: Section::new(cutoff_hz, SQRT_2, cycle_s),
            notches: [MovingNotch::ABSENT; MAX_NOTCHES],
        }
    }

    /// Moves the notches to other frequencies, in this number of cycles.
    pub(super) fn set_notches(
        &mut self,
        notches: &[Option<Notch>; MAX_NOTCHES],
        cycle_s: f64,
        cycles: u32,
    ) {
        for (moving, notch) in self.notches.iter_mut().zip(notches) {
            moving.set(*notch, cycle_s, cycles);
        }
    }

    /// Takes a sample, once per cycle. Returns the filtered load.
    pub(super) fn next(&mut self, states: &mut [SectionState; SECTIONS], load: &Wrench) -> Wrench {
        let [first, rest @ ..] = states;
        let (_, mut filtered) = self.low_pass.step(first, load);
        for (notch, state) in self.notches.iter_mut().zip(rest) {
            notch.advance();
            if notch.now.depth == 0.0 {
                // As if the load had always been this one, for when the notch comes.
                *state = SectionState {
                    band: Wrench::zero(),
                    low: filtered,
                };
                continue;
            }
            let (band, _) = notch.now.step(state, &filtered);
            let share = notch.now.depth * notch.now.damping;
            filtered.force_n -= band.force_n * share;
            filtered.moment_nm -= band.moment_nm * share;
        }
        filtered
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frequency, damping and depth each move by equal steps.
    #[test]
    fn a_notch_glides_evenly() {
        let mut notch = MovingNotch::ABSENT;
        notch.set(Some(Notch { hz: 20.0, q: 0.7 }), 1e-3, 0);
        let from = notch.now;
        notch.set(Some(Notch { hz: 40.0, q: 2.0 }), 1e-3, 10);
        let to = notch.target;
        for cycle in 1..=10 {
            notch.advance();
            let share = f64::from(cycle) / 10.0;
            for (now, from, to) in [
                (notch.now.frequency, from.frequency, to.frequency),
                (notch.now.damping, from.damping, to.damping),
                (notch.now.depth, from.depth, to.depth),
            ] {
                assert!((now - from - (to - from) * share).abs() < 1e-12, "{cycle}");
            }
        }
        assert_eq!(notch.now, to);
        notch.set(None, 1e-3, 2);
        notch.advance();
        assert!((notch.now.depth - 0.5).abs() < 1e-12);
    }
}
