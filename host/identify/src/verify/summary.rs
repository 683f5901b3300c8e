//! Results of a verification in numbers: for people in lines, for programs in JSON, and the reasons
//! not to trust the file.

use std::fmt;

use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use serde::Serialize;

use super::measured::PairResult;
use crate::fit::answer::FitSummary;
use crate::fit::goodness::{self, MIN_P};
use crate::measurements::springs::Campaign;

/// Format of the JSON.
const FORMAT: &str = "gantry-tau verified 1";

/// Measured and predicted remainders.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verification {
    format: &'static str,
    model: &'static str,
    /// Table of the measurements.
    pub measurements: String,
    /// True if the robot file carries the covariance of its springs; without it they count as
    /// exact.
    pub identified: bool,
    /// Pair by pair.
    pub pairs: Vec<PairResult>,
    /// Statistics of the pairs that are judged.
    pub judged: Statistics,
    /// Statistics of those under which cluster 3 may change sides.
    pub at_the_jump: Statistics,
    /// Statistics of the others, whose corrections a limit of the offsets cuts.
    pub saturated: Statistics,
    /// Residuals of all pairs, their correlation by springs and zeros taken into account; degrees
    /// of freedom are readings less zeros.
    #[serde(flatten)]
    pub fit: FitSummary,
    /// Smallest of the largest stable gains against the workpiece.
    pub largest_gain: f64,
}

/// Statistics of pairs; lengths in m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Statistics {
    /// Number of pairs.
    pub pairs: usize,
    /// Measured without compensation, root mean square.
    pub before_rms_m: f64,
    /// Measured with compensation: root mean square.
    pub after_rms_m: f64,
    /// Value that 95 % of them stay below.
    pub after_95_m: f64,
    /// The largest.
    pub after_largest_m: f64,
    /// Share that remains, of the root mean squares.
    pub share: f64,
    /// Predicted with compensation, root mean square.
    pub predicted_rms_m: f64,
    /// Root mean square of the z-scores.
    pub z_rms: f64,
}

pub(super) fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let mut squares = 0.0;
    let mut count = 0.0;
    for value in values {
        squares += value * value;
        count += 1.0;
    }
    if count > 0.0 {
        f64::sqrt(squares / count)
    } else {
        0.0
    }
}

/// Returns the value that 95 % stay below, and the largest; 0 of nothing.
pub(super) fn upper(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    [values.len() * 19 / 20, values.len().saturating_sub(1)]
        .map(|index| values.get(index).copied().unwrap_or(0.0))
}

/// A length in micrometres; a turn in microradians.
pub(super) fn um(metres: f64) -> f64 {
    metres * 1e6
}

impl Statistics {
    fn of<'a>(pairs: impl Iterator<Item = &'a PairResult> + Clone) -> Self {
        let before_rms_m = rms(pairs.clone().map(|pair| pair.before_m));
        let after_rms_m = rms(pairs.clone().map(|pair| pair.after_m));
        let [after_95_m, after_largest_m] = upper(pairs.clone().map(|pair| pair.after_m).collect());
        Self {
            pairs: pairs.clone().count(),
            before_rms_m,
            after_rms_m,
            after_95_m,
            after_largest_m,
            share: if before_rms_m > 0.0 {
                after_rms_m / before_rms_m
            } else {
                0.0
            },
            predicted_rms_m: rms(pairs.clone().map(|pair| pair.predicted_m)),
            z_rms: rms(pairs.map(|pair| pair.z)),
        }
    }
}

impl Verification {
    pub(super) fn new<K: MachineKind<N>, const N: usize>(
        file: &RobotFile<K, N>,
        campaign: &Campaign<N>,
        pairs: Vec<PairResult>,
        fit: FitSummary,
    ) -> Self {
        let judged = Statistics::of(pairs.iter().filter(|pair| pair.is_judged()));
        let at_the_jump = Statistics::of(pairs.iter().filter(|pair| pair.changes_sides));
        let saturated = Statistics::of(
            pairs
                .iter()
                .filter(|pair| pair.saturated && !pair.changes_sides),
        );
        let gains = pairs.iter().filter_map(|pair| pair.largest_gain);
        Self {
            format: FORMAT,
            model: K::MODEL,
            measurements: campaign.table.clone(),
            identified: file.identified.is_some(),
            largest_gain: gains.fold(f64::INFINITY, f64::min),
            judged,
            at_the_jump,
            saturated,
            fit,
            pairs,
        }
    }

    /// Returns the reasons not to trust the file; empty where there are none.
    #[must_use]
    pub fn doubts(&self, tolerance_m: f64) -> Vec<String> {
        let mut doubts = Vec::new();
        if self.fit.p < MIN_P {
            let farthest = self
                .pairs
                .iter()
                .max_by(|one, other| one.z.abs().total_cmp(&other.z.abs()));
            let farthest = farthest.map(|pair| {
                format!(
                    ", window {} of series {} most of all, by {:.1} standard deviations",
                    pair.window, pair.series, pair.z
                )
            });
            doubts.push(format!(
                "the readings are not those of this file's machine: chi2/dof is {:.2} ({}){}",
                self.fit.reduced(),
                goodness::p_value_text(self.fit.p),
                farthest.unwrap_or_default()
            ));
        }
        if self.judged.pairs == 0 {
            let [jump, limit] = [self.at_the_jump.pairs, self.saturated.pairs];
            doubts.push(format!(
                "no pair is judged: {jump} across the jump, {limit} at an offset limit"
            ));
        }
        let worst = self.pairs.iter().filter(|pair| pair.is_judged());
        let worst = worst.max_by(|one, other| one.after_m.total_cmp(&other.after_m));
        if let Some(pair) = worst.filter(|pair| pair.after_m > tolerance_m) {
            let PairResult {
                series,
                window,
                after_m,
                ..
            } = pair;
            doubts.push(format!(
                "series {series}, window {window}: {:.1} um remain; {:.1} um are tolerated",
                um(*after_m),
                um(tolerance_m)
            ));
        }
        doubts
    }
}

impl fmt::Display for Verification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (name, of) in [
            ("pairs", &self.judged),
            ("across the jump", &self.at_the_jump),
            ("at an offset limit", &self.saturated),
        ] {
            if of.pairs == 0 {
                continue;
            }
            writeln!(f, "{name:<19} {}, z-scores {:.2} rms", of.pairs, of.z_rms)?;
            writeln!(
                f,
                "{:<19} {:.2} um rms",
                "  uncompensated",
                um(of.before_rms_m)
            )?;
            writeln!(
                f,
                "{:<19} {:.2} um rms, 95 % below {:.2} um, largest {:.2} um; {:.2} % remain",
                "  compensated",
                um(of.after_rms_m),
                um(of.after_95_m),
                um(of.after_largest_m),
                100.0 * of.share
            )?;
            writeln!(
                f,
                "{:<19} {:.2} um rms",
                "  predicted",
                um(of.predicted_rms_m)
            )?;
        }
        if !self.identified {
            writeln!(
                f,
                "{:<19} without [identified]: counted as exact",
                "springs"
            )?;
        }
        writeln!(
            f,
            "{:<19} {:.3} with {} degrees of freedom, p = {:.2e}",
            "chi2/dof",
            self.fit.reduced(),
            self.fit.dof,
            self.fit.p
        )?;
        write!(
            f,
            "{:<19} {:.3} against the workpiece (97.5 %)",
            "largest static gain", self.largest_gain
        )
    }
}
