//! Results in numbers: for people in lines, for programs in JSON, and the reasons not to trust them.

use std::fmt;

use serde::Serialize;

use super::measured::PairResult;
use super::predict::{PlacePrediction, Prediction, Remainder};
use crate::fit::statistics::{chi_squared_above, float};
use crate::measurements::springs::Campaign;
use crate::model::MachineKind;
use crate::robot_file::RobotFile;

/// Smallest probability of the readings at which a file is believed.
const LEAST_P: f64 = 1e-3;
/// Format of the JSON of a verification, and of a prediction.
const FORMATS: [&str; 2] = ["gantry-tau verified 1", "gantry-tau predicted 1"];

/// Measured and predicted remainders.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verification {
    format: &'static str,
    model: &'static str,
    /// Table of the measurements.
    pub measurements: String,
    /// True if the robot file carries the covariance of its springs; without it they count as exact.
    pub identified: bool,
    /// Pair by pair.
    pub pairs: Vec<PairResult>,
    /// Statistics of the pairs under which cluster 3 stays on its side.
    pub judged: Statistics,
    /// Statistics of the others.
    pub at_the_jump: Statistics,
    /// Sum of the squares of all residuals in standard deviations, their correlation by springs and zeros taken into account.
    pub chi2: f64,
    /// Its degrees of freedom: readings less zeros.
    pub dof: usize,
    /// Its probability.
    pub p: f64,
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
    /// What 95 % of them stay below.
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

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (mut squares, mut count) = (0.0, 0.0);
    for value in values {
        squares += value * value;
        count += 1.0;
    }
    if count > 0.0 { f64::sqrt(squares / count) } else { 0.0 }
}

/// Returns the value that 95 % stay below, and the largest; 0 of nothing.
fn upper(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    let at = |index: usize| values.get(index).copied().unwrap_or(0.0);
    [at(values.len() * 19 / 20), at(values.len().saturating_sub(1))]
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
            share: if before_rms_m > 0.0 { after_rms_m / before_rms_m } else { 0.0 },
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
        chi2: f64,
        dof: usize,
    ) -> Self {
        let [format, _] = FORMATS;
        let judged = Statistics::of(pairs.iter().filter(|pair| !pair.changes_sides));
        let at_the_jump = Statistics::of(pairs.iter().filter(|pair| pair.changes_sides));
        let gains = pairs.iter().filter_map(|pair| pair.largest_gain);
        Self {
            format,
            model: K::MODEL,
            measurements: campaign.table.clone(),
            identified: file.identified.is_some(),
            largest_gain: gains.fold(f64::INFINITY, f64::min),
            judged,
            at_the_jump,
            chi2,
            dof,
            p: chi_squared_above(chi2, dof),
            pairs,
        }
    }

    /// Returns the reasons not to trust the file; empty where there are none.
    #[must_use]
    pub fn doubts(&self, tolerance_m: f64) -> Vec<String> {
        let mut doubts = Vec::new();
        if self.p < LEAST_P {
            let reduced = self.chi2 / float(self.dof);
            doubts.push(format!(
                "the readings are not those of this file's machine: chi2/dof is {reduced:.2} (p = {:.1e})",
                self.p
            ));
        }
        let worst = self.pairs.iter().filter(|pair| !pair.changes_sides);
        let worst = worst.max_by(|one, other| one.after_m.total_cmp(&other.after_m));
        if let Some(pair) = worst.filter(|pair| pair.after_m > tolerance_m) {
            let PairResult { series, window, after_m, .. } = pair;
            doubts.push(format!(
                "series {series}, window {window}: {:.1} um remain; {:.1} um are tolerated",
                after_m * 1e6,
                tolerance_m * 1e6
            ));
        }
        doubts
    }
}

impl fmt::Display for Verification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let um = |metres: f64| metres * 1e6;
        for (name, of) in [("pairs", &self.judged), ("across the jump", &self.at_the_jump)] {
            if of.pairs == 0 {
                continue;
            }
            writeln!(f, "{name:<19} {}, z-scores {:.2} rms", of.pairs, of.z_rms)?;
            writeln!(f, "{:<19} {:.2} um rms", "  uncompensated", um(of.before_rms_m))?;
            writeln!(
                f,
                "{:<19} {:.2} um rms, 95 % below {:.2} um, largest {:.2} um; {:.2} % remain",
                "  compensated",
                um(of.after_rms_m),
                um(of.after_95_m),
                um(of.after_largest_m),
                100.0 * of.share
            )?;
            writeln!(f, "{:<19} {:.2} um rms", "  predicted", um(of.predicted_rms_m))?;
        }
        if !self.identified {
            writeln!(f, "{:<19} without [identified]: counted as exact", "springs")?;
        }
        let reduced = self.chi2 / float(self.dof);
        writeln!(f, "{:<19} {reduced:.3} with {} degrees of freedom, p = {:.2e}", "chi2/dof", self.dof, self.p)?;
        write!(f, "{:<19} {:.3} against the workpiece (97.5 %)", "largest gain", self.largest_gain)
    }
}

/// Numbers of a prediction; lengths in m, over all places and loads that are judged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PredictionSummary {
    /// Places that are reached, and at most ten times as compliant as home.
    pub places: usize,
    /// Places that are reached, and more compliant.
    pub too_compliant: usize,
    /// Loads that are judged.
    pub judged: usize,
    /// Loads under which cluster 3 may change sides.
    pub across_the_jump: usize,
    /// Loads whose correction is cut at a limit of the offsets.
    pub saturated: usize,
    /// Displacement without compensation, root mean square.
    pub before_rms_m: f64,
    /// Expected displacement with compensation: root mean square.
    pub expected_rms_m: f64,
    /// What 95 % of them stay below.
    pub expected_95_m: f64,
    /// The largest.
    pub expected_largest_m: f64,
    /// Part of the method: with the springs of the file, root mean square.
    pub method_rms_m: f64,
    /// Part of the springs' uncertainty, root mean square.
    pub springs_rms_m: f64,
    /// Turn of the tool without and with compensation, root mean square, rad.
    pub turn_rms_rad: [f64; 2],
    /// Smallest of the largest stable gains against the workpiece.
    pub largest_gain: f64,
}

impl Prediction {
    /// Returns the numbers.
    #[must_use]
    pub fn summary(&self) -> PredictionSummary {
        let loads = || self.places.iter().flat_map(|place| &place.loads);
        let judged = || loads().filter(|load| load.is_judged());
        let [expected_95_m, expected_largest_m] = upper(judged().map(Remainder::expected_m).collect());
        PredictionSummary {
            places: self.places.len(),
            too_compliant: self.too_compliant,
            judged: judged().count(),
            across_the_jump: loads().filter(|load| load.changes_sides).count(),
            saturated: loads().filter(|load| load.saturated).count(),
            before_rms_m: rms(judged().map(|load| load.before_m)),
            expected_rms_m: rms(judged().map(Remainder::expected_m)),
            expected_95_m,
            expected_largest_m,
            method_rms_m: rms(judged().map(|load| load.after_m)),
            springs_rms_m: rms(judged().map(|load| load.sd_m)),
            turn_rms_rad: [rms(judged().map(|load| load.before_rad)), rms(judged().map(|load| load.after_rad))],
            largest_gain: self.places.iter().map(|place| place.largest_gain).fold(f64::INFINITY, f64::min),
        }
    }

    /// Returns the answer for programs, JSON; `model` is that of the robot file.
    ///
    /// # Errors
    /// None that finite numbers lead to.
    pub fn json(&self, model: &'static str) -> Result<String, serde_json::Error> {
        let [_, format] = FORMATS;
        serde_json::to_string_pretty(&PredictionAnswer {
            format,
            model,
            force_n: self.force_n,
            workpiece_n_per_m: self.workpiece_n_per_m,
            summary: self.summary(),
            directions: super::predict::directions().into_iter().map(Into::into).collect(),
            places: &self.places,
        })
    }
}

/// The JSON of a prediction.
#[derive(Serialize)]
struct PredictionAnswer<'a> {
    format: &'static str,
    model: &'static str,
    force_n: f64,
    workpiece_n_per_m: f64,
    summary: PredictionSummary,
    directions: Vec<[f64; 3]>,
    places: &'a [PlacePrediction],
}

impl PredictionSummary {
    /// Returns the reasons not to trust the file; empty where there are none.
    #[must_use]
    pub fn doubts(&self, tolerance_m: f64) -> Vec<String> {
        if self.expected_95_m <= tolerance_m {
            return Vec::new();
        }
        let (expected, tolerated) = (self.expected_95_m * 1e6, tolerance_m * 1e6);
        vec![format!(
            "5 % of the loads are expected to leave {expected:.1} um or more; {tolerated:.1} um are tolerated"
        )]
    }
}

impl fmt::Display for PredictionSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let um = |metres: f64| metres * 1e6;
        let [turned, held] = self.turn_rms_rad;
        let Self { places, too_compliant, judged, across_the_jump, saturated, .. } = self;
        writeln!(
            f,
            "{:<19} {places} places; {too_compliant} more, over ten times as compliant as home, are left out",
            "reached"
        )?;
        writeln!(
            f,
            "{:<19} {judged}; apart: {across_the_jump} across the jump, {saturated} beyond the limits of the offsets",
            "loads"
        )?;
        writeln!(f, "{:<19} {:.2} um rms, turned by {:.1} urad", "uncompensated", um(self.before_rms_m), um(turned))?;
        writeln!(
            f,
            "{:<19} {:.2} um rms, 95 % below {:.2} um, largest {:.2} um; turned by {:.1} urad",
            "expected remainder",
            um(self.expected_rms_m),
            um(self.expected_95_m),
            um(self.expected_largest_m),
            um(held)
        )?;
        writeln!(
            f,
            "{:<19} {:.2} um rms by the method, {:.2} um by the springs",
            "  of which",
            um(self.method_rms_m),
            um(self.springs_rms_m)
        )?;
        write!(f, "{:<19} {:.3} against the workpiece (97.5 %)", "largest gain", self.largest_gain)
    }
}
