//! Answers of an identification for programs: `"gantry-tau identified 1"`. SI units.

use gantry_tau_system::output::Name;
use nalgebra::DMatrix;
use serde::Serialize;

use super::{IdentifiedSprings, names};
use crate::fit::answer::{FitSummary, Parameter, Uncertainty, Unobservable};
use crate::fit::statistics::NORMAL_95;
use crate::measurements::springs::Campaign;
use crate::springs::decision::{uncertainty, unobservable};
use crate::springs::problem::SpringsProblem;
use crate::springs::robust_fit::RobustFit;

/// First field of an answer.
pub const FORMAT: &str = "gantry-tau identified 1";

/// Answer of an identification.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SpringsAnswer {
    /// [`FORMAT`].
    pub format: &'static str,
    /// `l2` or `f1`.
    pub model: &'static str,
    /// Compliances of links, axes and joints of the wrist; the play, where there is one;
    /// half-widths of the hysteresis of gauges, those that were asked for and are two standard
    /// deviations or more.
    pub parameters: Vec<Parameter>,
    /// Covariance of the parameters, by rows.
    pub covariance: Vec<Vec<f64>>,
    /// Its residuals beside the stated noise.
    #[serde(flatten)]
    pub fit: FitSummary,
    /// Readings that do not agree, and were left out. Of a gauge that stays shifted, the first.
    pub outliers: Vec<Outlier>,
    /// Combinations of parameters that are not seen (`relative_sd` above 1, here or on the way
    /// here), or hardly (above 0.1).
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
    pub series: Name,
    /// Its window.
    pub window: Name,
    /// Its gauge.
    pub gauge: Name,
}

/// The play of the joint of cluster 3.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlayAnswer {
    /// Play of the joint, m.
    pub gap_m: f64,
    /// Its standard deviation, m.
    pub sd_m: f64,
    /// Interval of the preload while forces rise, N; `None` (null) if no rising window is beyond
    /// the jump.
    pub preload_rising_n: Option<[f64; 2]>,
    /// Interval of the preload while they fall, N; `None` (null) if no falling window is beyond the
    /// jump.
    pub preload_falling_n: Option<[f64; 2]>,
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

impl Outlier {
    fn of<const N: usize>(campaign: &Campaign<N>, window: usize, gauge: usize) -> Self {
        let window = &campaign.windows[window];
        Self {
            series: campaign.series[window.series].clone(),
            window: window.window.clone(),
            gauge: campaign.gauges[gauge].name.clone(),
        }
    }
}

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Returns the answer; `model` is `l2` or `f1`.
    pub(super) fn answer(&self, model: &'static str) -> SpringsAnswer {
        let RobustFit {
            solution,
            active,
            refused,
        } = &self.robust_fit;
        let uncertainty = self.uncertainty();
        let mut values = solution.values(active);
        let mut covariance = uncertainty.covariance();
        if let Some(play) = &self.play {
            let index = self.problem.file.count();
            values[index] *= play.sign;
            covariance.row_mut(index).scale_mut(play.sign);
            covariance.column_mut(index).scale_mut(play.sign);
        }
        let mut fit = FitSummary::new(solution.rows.chi_squared(), solution.degrees());
        if self.intervals.is_scaled {
            // Scaled noise says nothing about the model.
            fit.p = 1.0;
        }
        let names = names(&self.problem, active, self.play.is_some());
        let mut parameters = Parameter::list(&names, &values, &covariance, |index| {
            uncertainty.status(index)
        });
        for (index, parameter) in parameters.iter_mut().enumerate() {
            parameter.set_interval(self.interval(index, parameter.value, &uncertainty));
        }
        let unobservable = unobservable(&self.problem, active, solution).concat();
        let campaign = self.problem.campaign;
        let readings = refused
            .iter()
            .map(|(window, gauge)| Outlier::of(campaign, *window, *gauge));
        let shifts = active
            .shifts
            .iter()
            .map(|shift| Outlier::of(campaign, shift.window, shift.gauge));
        SpringsAnswer {
            format: FORMAT,
            model,
            covariance: rows(&covariance),
            fit,
            outliers: readings.chain(shifts).collect(),
            unobservable: Unobservable::list(&names, &unobservable),
            play: self.play.as_ref().map(|play| PlayAnswer {
                gap_m: play.gap_m,
                sd_m: parameters[self.problem.file.count()].sd,
                preload_rising_n: play.preload_n[0],
                preload_falling_n: play.preload_n[1],
            }),
            parameters,
            setup: self.setup(),
        }
    }

    /// Uncertainty of the parameters.
    pub(super) fn uncertainty(&self) -> Uncertainty {
        let RobustFit {
            solution, active, ..
        } = &self.robust_fit;
        uncertainty(&self.problem, active, solution).scaled(self.intervals.variance(solution))
    }

    /// Central 95 % interval of a parameter: by what the readings say, widened by what it depends
    /// on. A compliance is not negative.
    fn interval(&self, parameter: usize, value: f64, uncertainty: &Uncertainty) -> [f64; 2] {
        let reach =
            self.intervals.reach(&self.robust_fit.solution) * uncertainty.of_seen(parameter).sqrt();
        let profiled = self
            .profiles
            .iter()
            .find(|profiled| profiled.parameter == parameter);
        let [low, high] = profiled.map_or([value - reach, value + reach], |profiled| profiled.ends);
        let dependence = NORMAL_95 * uncertainty.of_unseen(parameter).sqrt();
        let [low, high] = [
            value - (value - low).hypot(dependence),
            value + (high - value).hypot(dependence),
        ];
        if parameter < self.problem.file.count() {
            [low.max(0.0), high]
        } else {
            [low, high]
        }
    }

    fn setup(&self) -> Vec<SetupAnswer> {
        let SpringsProblem {
            campaign, setup, ..
        } = &self.problem;
        let constants = setup
            .list(campaign)
            .into_iter()
            .zip(self.robust_fit.solution.state.setup.iter());
        let answer = constants.map(|(constant, moved_sd)| SetupAnswer {
            estimate: moved_sd * constant.prior_sd,
            name: constant.name,
            prior_sd: constant.prior_sd,
            moved_sd: *moved_sd,
        });
        answer.collect()
    }
}

/// A matrix by rows.
fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix
        .row_iter()
        .map(|row| row.iter().copied().collect())
        .collect()
}
