//! Results of a prediction in numbers: for people in lines, for programs in JSON, and the reasons
//! not to trust the file.

use std::fmt;

use serde::Serialize;

use super::predict::{PlacePrediction, Prediction, Remainder, directions};
use super::summary::{rms, um, upper};

/// Format of the JSON.
const FORMAT: &str = "gantry-tau predicted 1";

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
    /// Value that 95 % of them stay below.
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
        let loads = self.places.iter().flat_map(|place| &place.loads);
        let judged = loads.clone().filter(|load| load.is_judged());
        let [expected_95_m, expected_largest_m] =
            upper(judged.clone().map(Remainder::expected_m).collect());
        PredictionSummary {
            places: self.places.len(),
            too_compliant: self.too_compliant,
            judged: judged.clone().count(),
            across_the_jump: loads.clone().filter(|load| load.changes_sides).count(),
            saturated: loads.filter(|load| load.saturated).count(),
            before_rms_m: rms(judged.clone().map(|load| load.before_m)),
            expected_rms_m: rms(judged.clone().map(Remainder::expected_m)),
            expected_95_m,
            expected_largest_m,
            method_rms_m: rms(judged.clone().map(|load| load.after_m)),
            springs_rms_m: rms(judged.clone().map(|load| load.sd_m)),
            turn_rms_rad: [
                rms(judged.clone().map(|load| load.before_rad)),
                rms(judged.map(|load| load.after_rad)),
            ],
            largest_gain: self
                .places
                .iter()
                .map(|place| place.largest_gain)
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// Returns the answer for programs, JSON; `model` is that of the robot file.
    ///
    /// # Errors
    /// None that finite numbers lead to.
    pub fn json(&self, model: &'static str) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(&PredictionAnswer {
            format: FORMAT,
            model,
            force_n: self.force_n,
            workpiece_n_per_m: self.workpiece_n_per_m,
            summary: self.summary(),
            directions: directions().into_iter().map(Into::into).collect(),
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
        let [expected, tolerated] = [self.expected_95_m, tolerance_m].map(um);
        vec![format!(
            "5 % of the loads are expected to leave {expected:.1} um or more; {tolerated:.1} um are tolerated"
        )]
    }
}

impl fmt::Display for PredictionSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [turned, held] = self.turn_rms_rad;
        let Self {
            places,
            too_compliant,
            judged,
            across_the_jump,
            saturated,
            ..
        } = self;
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
        writeln!(
            f,
            "{:<19} {:.2} um rms, turned by {:.1} urad",
            "uncompensated",
            um(self.before_rms_m),
            um(turned)
        )?;
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
        write!(
            f,
            "{:<19} {:.3} against the workpiece (97.5 %)",
            "largest static gain", self.largest_gain
        )
    }
}
