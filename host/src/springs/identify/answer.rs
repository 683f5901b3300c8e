//! Answers of an identification for programs: `"gantry-tau identified 1"`. SI units.

use serde::Serialize;

use crate::fit::answer::{Parameter, Unobservable};

/// First field of an answer.
pub const FORMAT: &str = "gantry-tau identified 1";

/// Answer of an identification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Answer {
    /// [`FORMAT`].
    pub format: &'static str,
    /// `l2` or `f1`.
    pub model: &'static str,
    /// Compliances of links, axes and joints of the wrist; the play, where there is one; hysteresis of gauges, where it was asked for.
    pub parameters: Vec<Parameter>,
    /// Covariance of the parameters, by rows.
    pub covariance: Vec<Vec<f64>>,
    /// Sum of the squares of the residuals, in standard deviations.
    pub chi2: f64,
    /// Degrees of freedom.
    pub dof: usize,
    /// Probability of such a sum, or a larger one, if the model and the noise are right.
    pub p: f64,
    /// Readings that do not agree, and were left out. Of a gauge that stays shifted, the first.
    pub outliers: Vec<Outlier>,
    /// Combinations of parameters that are not seen (`relative_sd` above 1), or hardly (above 0.1).
    pub unobservable: Vec<Unobservable>,
    /// The play of cluster 3, where there is one.
    pub play: Option<PlayAnswer>,
    /// Constants of the set-up.
    pub setup: Vec<SetupAnswer>,
}

/// A reading that does not agree with the others.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Outlier {
    /// Its series.
    pub series: String,
    /// Its window.
    pub window: String,
    /// Its gauge.
    pub gauge: String,
}

/// The play of the joint of cluster 3.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlayAnswer {
    /// How far the joint moves, m.
    pub gap_m: f64,
    /// Its standard deviation, m.
    pub sd_m: f64,
    /// Interval of the preload while forces rise, N.
    pub preload_rising_n: [f64; 2],
    /// Interval of the preload while they fall, N.
    pub preload_falling_n: [f64; 2],
}

/// A constant of the set-up, as the fit found it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetupAnswer {
    /// Its name, with the mounting.
    pub name: String,
    /// Its deviation from the assumed value; m, rad, relative.
    pub estimate: f64,
    /// Standard deviation of its prior, in the same unit.
    pub prior_sd: f64,
    /// Its deviation, in standard deviations of the prior.
    pub moved_sd: f64,
}
