//! Oscillation of the targets.
//!
//! A force sensor between platform and tool reads the inertia of the tool as well. A compensation
//! whose filter is too fast for the machine, or whose workpiece is too stiff, excites the machine's
//! modes: the targets of an axis swing wider and wider, until the limits of the server bound them.
//!
//! | module | contents |
//! |---|---|
//! | [`turning_points`] | swings of a sequence of targets |
//! | [`detector`] | swings that grow, or that stay wide |
//! | [`lowest_mode`] | lowest natural frequency of the machine in its present place |
//!
//! A swing slower than half a period at 0.6 times the lowest natural frequency of the machine is
//! work, not an oscillation of the machine.

mod detector;
mod lowest_mode;
#[cfg(test)]
mod on_a_linear_machine;
mod turning_points;

use std::fmt;

use gantry_tau_core::control::message::Welcome;
use gantry_tau_core::units::{OffsetNm, PositionNm};
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::{CYCLE_US, RobotFile};

use detector::Detector;
use lowest_mode::LowestMode;

/// Lowest frequency of an oscillation, as a share of that of the lowest mode.
const LOWEST_SHARE: f64 = 0.6;
/// The same for a machine whose modes are not known, Hz.
const LOWEST_WITHOUT_MODES_HZ: f64 = 3.0;

/// Oscillation of the targets of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Oscillation {
    /// Index of the axis, from 0.
    pub axis: usize,
    /// True if the swings grew; false if they stayed wide.
    pub is_growing: bool,
    /// Mean period, µs; positive.
    pub period_us: u64,
    /// Last swing, from one turning point to the next, nm.
    pub swing_nm: u32,
}

impl Oscillation {
    /// Returns the frequency, Hz.
    #[must_use]
    pub fn hz(&self) -> f64 {
        1e6 / self.period_us as f64
    }
}

impl fmt::Display for Oscillation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let course = if self.is_growing {
            "growing"
        } else {
            "not decaying"
        };
        write!(
            f,
            "axis {}: the targets oscillate at {:.1} Hz with swings of {:.1} um, {course}",
            self.axis + 1,
            self.hz(),
            f64::from(self.swing_nm) * 1e-3
        )
    }
}

/// Detectors of all axes.
#[derive(Clone, Debug)]
pub(crate) struct Oscillations<const N: usize> {
    detectors: [Detector; N],
    lowest_mode: Option<LowestMode<N>>,
}

impl<const N: usize> Oscillations<N> {
    /// Detectors for a machine and the limits of its server. `None` if the robot file turns them
    /// off.
    pub(crate) fn new<K: MachineKind<N>>(
        robot: &RobotFile<K, N>,
        welcome: &Welcome<N>,
    ) -> Option<Self> {
        let steps_nm = welcome.limits.map(|axis| axis.position.step());
        robot.client.leave_on_oscillation.then(|| Self {
            detectors: steps_nm.map(|step_nm| Detector::new(step_nm.unsigned_abs())),
            lowest_mode: LowestMode::of(robot),
        })
    }

    /// Forgets the past targets.
    pub(crate) fn restart(&mut self) {
        for detector in &mut self.detectors {
            detector.restart();
        }
    }

    /// Takes the targets of a tick in Obtain, and the nominal positions that they were computed
    /// for. Returns the oscillation of the first axis that has one, and restarts.
    pub(crate) fn update(
        &mut self,
        tick: u64,
        targets: &[OffsetNm; N],
        nominal: &[PositionNm; N],
    ) -> Option<Oscillation> {
        let longest = self.longest_swing_ticks(nominal);
        let mut found = None;
        for (axis, (detector, target)) in self.detectors.iter_mut().zip(targets).enumerate() {
            let pattern = detector.update(tick, target.0, longest);
            found = found.or(pattern.map(|pattern| Oscillation {
                axis,
                is_growing: pattern.is_growing,
                period_us: pattern.period_us,
                swing_nm: pattern.swing_nm,
            }));
        }
        if found.is_some() {
            self.restart();
        }
        found
    }

    /// Returns half a period of the lowest frequency that is an oscillation, in ticks.
    fn longest_swing_ticks(&mut self, nominal: &[PositionNm; N]) -> u64 {
        let mode_hz = self.lowest_mode.as_mut().and_then(|mode| mode.at(nominal));
        let lowest_hz = mode_hz.map_or(LOWEST_WITHOUT_MODES_HZ, |hz| LOWEST_SHARE * hz);
        (0.5e6 / lowest_hz / f64::from(CYCLE_US)) as u64
    }
}
