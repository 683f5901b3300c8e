//! Loads that change while they act: a tap, a milling cutter.
//!
//! They are forces in every step of the drives, of which a cycle has [`SUBSTEPS`].

use std::f64::consts::TAU;

use gantry_tau_machine::drive_cascade::{CYCLE_S, SUBSTEPS};
use gantry_tau_server::plant::interpolator::{OutOfRange, check};
use nalgebra::Vector3;

/// Radial cutting force as a share of the tangential one.
const RADIAL: f64 = 0.3;
/// Points of a turn whose forces are averaged for the mean.
const POINTS: u32 = 3_600;

/// A load over time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadPattern {
    /// A push in x, again and again.
    Tap {
        /// Force, N.
        force_n: f64,
        /// Cycles that it lasts.
        cycles: u32,
        /// Cycles from one to the next.
        every_cycles: u32,
    },
    /// A cutter at work.
    Milling(Milling),
}

/// A milling cutter that moves in x: in the cut each tooth has the tangential force `K sin(phi)`, as
/// the thickness of its chip, and 0.3 times that towards the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Milling {
    teeth: u32,
    turns_per_s: f64,
    /// Angle at which a tooth leaves the cut, which it enters at 0, rad.
    exit_rad: f64,
    /// `K`, N.
    scale_n: f64,
}

impl Milling {
    /// Cutter whose force has a mean of `mean_n` (N, its magnitude), with `immersion` of its diameter
    /// in the cut.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn new(mean_n: f64, teeth: u32, rpm: f64, immersion: f64) -> Result<Self, OutOfRange> {
        check("mean force", mean_n, 0.0, 2_000.0)?;
        check("number of teeth", teeth.into(), 1.0, 20.0)?;
        check("turns per minute", rpm, 1.0, 60_000.0)?;
        check("share of the diameter", immersion, 0.01, 1.0)?;
        let mut cutter = Self {
            teeth,
            turns_per_s: rpm / 60.0,
            exit_rad: (1.0 - 2.0 * immersion).acos(),
            scale_n: 1.0,
        };
        let sum: Vector3<f64> = (0..POINTS)
            .map(|point| cutter.at_angle(TAU * f64::from(point) / f64::from(POINTS)))
            .sum();
        cutter.scale_n = mean_n * f64::from(POINTS) / sum.norm();
        Ok(cutter)
    }

    /// Returns the frequency at which teeth enter the cut, Hz.
    #[must_use]
    pub fn tooth_hz(&self) -> f64 {
        self.turns_per_s * f64::from(self.teeth)
    }

    /// Returns the force at a time since it began, N.
    fn at(&self, time_s: f64) -> Vector3<f64> {
        self.at_angle(TAU * self.turns_per_s * time_s)
    }

    /// Returns the force with the first tooth at an angle, N.
    fn at_angle(&self, first_rad: f64) -> Vector3<f64> {
        let pitch_rad = TAU / f64::from(self.teeth);
        (0..self.teeth)
            .map(|tooth| (first_rad + pitch_rad * f64::from(tooth)).rem_euclid(TAU))
            .filter(|angle| *angle < self.exit_rad)
            .map(|angle| {
                let (sin, cos) = angle.sin_cos();
                let tangential_n = self.scale_n * sin;
                Vector3::new(-cos - RADIAL * sin, sin - RADIAL * cos, 0.0) * tangential_n
            })
            .sum()
    }
}

impl LoadPattern {
    /// Returns the force in a step of a cycle since it began, N, world axes.
    #[must_use]
    pub fn force_n(&self, cycle: u64, substep: u32) -> Vector3<f64> {
        match self {
            Self::Tap {
                force_n,
                cycles,
                every_cycles,
            } => {
                let since = cycle % u64::from((*every_cycles).max(1));
                if since < u64::from(*cycles) {
                    Vector3::x() * *force_n
                } else {
                    Vector3::zeros()
                }
            }
            Self::Milling(cutter) => {
                let substeps = f64::from(substep) / f64::from(SUBSTEPS);
                cutter.at((cycle as f64 + substeps) * CYCLE_S)
            }
        }
    }

    /// Returns the mean force over a cycle, N, world axes.
    #[must_use]
    pub fn mean_n(&self, cycle: u64) -> Vector3<f64> {
        let sum: Vector3<f64> = (0..SUBSTEPS)
            .map(|substep| self.force_n(cycle, substep))
            .sum();
        sum / f64::from(SUBSTEPS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean over a second is that asked for; the force returns with the teeth.
    #[test]
    fn a_cutter_has_its_mean_and_its_frequency() {
        let cutter = Milling::new(300.0, 4, 3_000.0, 0.5).unwrap();
        assert!((cutter.tooth_hz() - 200.0).abs() < 1e-9);
        let pattern = LoadPattern::Milling(cutter);
        let mean: Vector3<f64> = (0..1_000)
            .map(|cycle| pattern.mean_n(cycle))
            .sum::<Vector3<f64>>()
            / 1e3;
        // A tooth leaves the cut at its largest force, somewhere between two of 80 steps.
        assert!((mean.norm() - 300.0).abs() < 300.0 / 80.0, "{mean}");
        for cycle in 0..20 {
            for substep in 0..SUBSTEPS {
                let [now, later] = [cycle, cycle + 5].map(|cycle| pattern.force_n(cycle, substep));
                assert!((now - later).norm() < 1e-6);
            }
        }
        // One tooth at a time with half of the diameter in the cut: it swings by more than its mean.
        let forces = (0..5).map(|cycle| pattern.force_n(cycle, 0).norm());
        assert!(forces.clone().fold(0.0, f64::max) > 400.0);
        assert!(forces.fold(f64::MAX, f64::min) < 100.0);
    }

    /// A full cut of two opposite teeth: `F_x` of both is `-K` times the mean of `sin cos` and 0.3
    /// `sin^2`, over half a turn each.
    #[test]
    fn a_full_cut_is_that_of_the_integral() {
        let cutter = Milling::new(100.0, 2, 6_000.0, 1.0).unwrap();
        // Of sin^2 over half a turn: pi / 2; of sin cos: 0. Two teeth, over a turn of 2 pi.
        let per_scale = Vector3::new(-RADIAL, 1.0, 0.0) * 0.5;
        assert!((cutter.scale_n * per_scale.norm() - 100.0).abs() < 0.1);
        // The other tooth is outside of the cut.
        let quarter = cutter.at_angle(0.25 * TAU);
        assert!((quarter - Vector3::new(-RADIAL, 1.0, 0.0) * cutter.scale_n).norm() < 1e-9);
        let late = cutter.at_angle(0.45 * TAU);
        let (sin, cos) = (0.45 * TAU).sin_cos();
        let expected = Vector3::new(-cos - RADIAL * sin, sin - RADIAL * cos, 0.0);
        assert!(late.x > 0.0 && late.y > 0.0);
        assert!((late - expected * (cutter.scale_n * sin)).norm() < 1e-9);
    }

    #[test]
    fn a_tap_comes_again() {
        let tap = LoadPattern::Tap {
            force_n: 100.0,
            cycles: 20,
            every_cycles: 1_000,
        };
        for (cycle, force_n) in [
            (0, 100.0),
            (19, 100.0),
            (20, 0.0),
            (999, 0.0),
            (1_000, 100.0),
        ] {
            assert_eq!(tap.mean_n(cycle), Vector3::x() * force_n, "{cycle}");
        }
    }

    #[test]
    fn numbers_that_no_cutter_has_are_refused() {
        for (mean_n, teeth, rpm, immersion, parameter) in [
            (f64::NAN, 2, 3e3, 0.5, "mean force"),
            (300.0, 0, 3e3, 0.5, "number of teeth"),
            (300.0, 2, f64::INFINITY, 0.5, "turns per minute"),
            (300.0, 2, 3e3, 0.0, "share of the diameter"),
        ] {
            let refused = Milling::new(mean_n, teeth, rpm, immersion).unwrap_err();
            assert_eq!(refused.parameter, parameter);
        }
    }
}
