//! Measured remainders against predicted ones.
//!
//! The file's machine predicts every reading at the measured `q` and load. What remains of a
//! reading after the zero of its gauge moves the predicted displacement of the platform, by least
//! squares over the gauges of the window; what they do not see stays as predicted, and so does what
//! a wrist gives way. The covariance of a residual is that of gauge, zero and load, `J F F^T J^T`
//! by the springs, and that of the constants of the set-up.

use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::elastic::Equilibrium;
use gantry_tau_machine::elastic::gauge::{Body, Gauge};
use gantry_tau_machine::elastic::loaded::Loaded;
use gantry_tau_machine::model::MachineKind;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::Name;
use nalgebra::{DMatrix, DVector, Vector3};
use serde::Serialize;

use super::VerifyError;
use super::algebra::{chi_squared, deviation, pseudo_inverse};
use super::model::{FileModel, three};
use super::pairs::{SeriesPairs, is_unloaded, pairs};
use super::summary::Verification;
use crate::fit::answer::FitSummary;
use crate::fit::statistics::{NORMAL_95, float};
use crate::measurements::springs::Campaign;
use crate::springs::active_set::ActiveSet;
use crate::springs::blocks::{Blocks, covariance};
use crate::springs::linearize::{LinearizationError, LinearizedWindow};
use crate::springs::problem::SpringsProblem;
use crate::springs::state::FitState;

/// Lever that a turn counts with against a translation, m: that of the gauges.
const LEVER_M: f64 = 0.1;

/// Difference of two positions that are written to a nanometre, with a margin, m.
const ROUNDED_M: f64 = 1e-8;

/// One pair of windows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairResult {
    /// Series of both windows, or what the names of their two series have in common.
    pub series: String,
    /// Their name.
    pub window: Name,
    /// Tool centre point without load, world axes, m.
    pub tool_m: [f64; 3],
    /// Load with compensation: force, N, and moment, N m.
    pub load: [f64; 6],
    /// Measured displacement without compensation, m.
    pub before_m: f64,
    /// Measured displacement with compensation, m.
    pub after_m: f64,
    /// Predicted displacement with compensation, m.
    pub predicted_m: f64,
    /// 95 % interval of the prediction, by springs, gauges and loads, m.
    pub interval95_m: [f64; 2],
    /// Difference of measured and predicted displacement in standard deviations, root mean square
    /// over its directions.
    pub z: f64,
    /// True where cluster 3 may change sides: its play is not compensated.
    pub changes_sides: bool,
    /// True where an offset is at its limit, which cuts the correction.
    pub saturated: bool,
    /// Largest stable gain against the workpiece along the force.
    pub largest_gain: Option<f64>,
}

impl PairResult {
    /// True if neither play nor limits take part.
    #[must_use]
    pub const fn is_judged(&self) -> bool {
        !self.changes_sides && !self.saturated
    }
}

/// Compares a campaign of pairs with the prediction of a robot file; the workpiece is that of the
/// feedback margin.
///
/// # Errors
/// [`VerifyError`].
pub fn verify<K: MachineKind<N>, const N: usize>(
    file: &RobotFile<K, N>,
    campaign: &Campaign<N>,
    workpiece_n_per_m: f64,
) -> Result<Verification, VerifyError> {
    campaign.check_repeated()?;
    let model = FileModel::new(file)?;
    let campaign = &zeros_first(campaign);
    let of_series = pairs(campaign)?;
    let geometry = file.model.geometry();
    let problem = SpringsProblem::new(&geometry, &model.springs, campaign);
    let limits_m = file
        .limits
        .map(|axis| OffsetNm(axis.limits.position.max()).to_metres().0);
    let predicted = PredictedCampaign::new(&model, &problem, limits_m)?;
    let mut results = Vec::new();
    let mut active = ActiveSet::none(campaign);
    for sorted in of_series {
        for pair in &sorted.pairs {
            let result = predicted.judge(&sorted, pair, workpiece_n_per_m);
            let result = result.ok_or_else(|| {
                predicted.failed(
                    pair[1],
                    &"the gauges of the window have no zero, or its links no equilibrium",
                )
            })?;
            if !result.changes_sides {
                active.use_windows(pair);
            }
            results.push(result);
        }
        if !sorted.pairs.is_empty() {
            sorted
                .unloaded
                .iter()
                .for_each(|windows| active.use_windows(windows));
        }
    }
    let chi_squared = if results.is_empty() {
        None
    } else {
        predicted.chi_squared(&active)
    };
    let Some(fit) = chi_squared else {
        return Err(VerifyError::NoPairs {
            table: campaign.table.clone(),
        });
    };
    Ok(Verification::new(file, campaign, results, fit))
}

/// The campaign with the rows without a load first: a series begins in the pose of its first row,
/// which must have no offsets.
fn zeros_first<const N: usize>(campaign: &Campaign<N>) -> Campaign<N> {
    let mut sorted = campaign.clone();
    sorted
        .windows
        .sort_by_key(|window| !is_unloaded(campaign, window));
    sorted
}

/// Error of a window that the file's machine cannot be in.
fn refused<const N: usize>(
    campaign: &Campaign<N>,
    LinearizationError::Window { line, error }: LinearizationError,
) -> VerifyError {
    VerifyError::Pair {
        table: campaign.table.clone(),
        line,
        reason: error.to_string(),
    }
}

/// All windows of a campaign, as the file predicts them.
struct PredictedCampaign<'a, const N: usize> {
    model: &'a FileModel<N>,
    problem: &'a SpringsProblem<'a, N>,
    loaded: Vec<Loaded<N>>,
    linearized: Vec<LinearizedWindow>,
    /// Limits of the offsets.
    limits_m: [f64; N],
}

impl<'a, const N: usize> PredictedCampaign<'a, N> {
    fn new(
        model: &'a FileModel<N>,
        problem: &'a SpringsProblem<'a, N>,
        limits_m: [f64; N],
    ) -> Result<Self, VerifyError> {
        let campaign = problem.campaign;
        let state = FitState::start(problem);
        let loaded = problem
            .loaded(&state, &vec![false; campaign.windows.len()])
            .map_err(|error| refused(campaign, error))?;
        let linearized = loaded
            .iter()
            .enumerate()
            .map(|(index, loaded)| problem.linearize_window(&state, index, loaded));
        let linearized = linearized
            .collect::<Result<_, _>>()
            .map_err(|error| refused(campaign, error))?;
        Ok(Self {
            model,
            problem,
            loaded,
            linearized,
            limits_m,
        })
    }

    fn failed(&self, window: usize, reason: &dyn std::fmt::Display) -> VerifyError {
        let campaign = self.problem.campaign;
        let line = campaign.windows[window].line;
        VerifyError::Pair {
            table: campaign.table.clone(),
            line,
            reason: reason.to_string(),
        }
    }

    /// Chi-squared of the readings that are used.
    fn chi_squared(&self, active: &ActiveSet) -> Option<FitSummary> {
        let assumed = DVector::zeros(self.problem.setup.count());
        let blocks = Blocks::new(self.problem, active, &self.linearized, &assumed, &[])?;
        Some(chi_squared(&blocks.rows, &self.model.factor))
    }

    /// Covariance of the residuals of a window by the noise of gauges and load.
    fn noise(&self, linearized: &LinearizedWindow) -> DMatrix<f64> {
        covariance(
            &linearized.load,
            &linearized.variances,
            &self.problem.load_variances(),
        )
    }

    /// Mean residuals of some gauges in unloaded windows, and their covariance; `None` if one was
    /// not read there.
    fn zeros(&self, gauges: &[usize], unloaded: &[usize]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let mut zeros_m = DVector::zeros(gauges.len());
        let mut covariance = DMatrix::zeros(gauges.len(), gauges.len());
        let counts: Vec<usize> = gauges
            .iter()
            .map(|gauge| {
                unloaded
                    .iter()
                    .filter(|window| self.linearized[**window].row_of(*gauge).is_some())
                    .count()
            })
            .collect();
        if counts.contains(&0) {
            return None;
        }
        for &window in unloaded {
            let linearized = &self.linearized[window];
            let mut shares = DMatrix::zeros(gauges.len(), linearized.gauges.len());
            for (row, (gauge, count)) in gauges.iter().zip(&counts).enumerate() {
                if let Some(place) = linearized.row_of(*gauge) {
                    shares[(row, place)] = 1.0 / float(*count);
                }
            }
            zeros_m += &shares * &linearized.misclosures;
            covariance += &shares * self.noise(linearized) * shares.transpose();
        }
        Some((zeros_m, covariance))
    }

    /// Measured less predicted displacement of the tool, m, and the covariance of both together.
    fn displaced(&self, window: usize, unloaded: &[usize]) -> Option<(Vector3<f64>, DMatrix<f64>)> {
        let linearized = &self.linearized[window];
        let (zeros_m, of_zeros) = self.zeros(&linearized.gauges, unloaded)?;
        let left = &linearized.misclosures - zeros_m;
        let mut covariance = self.noise(linearized) + of_zeros;
        covariance += self.model.covariance(&linearized.springs);
        covariance += &linearized.mounting * linearized.mounting.transpose()
            + &linearized.sensor * linearized.sensor.transpose();
        let ways = self.ways(linearized);
        let solve = (pseudo_inverse(&ways) * ways.transpose())
            .rows(0, 3)
            .into_owned();
        let moved = &solve * left;
        Some((
            Vector3::new(moved[0], moved[1], moved[2]),
            &solve * covariance * solve.transpose(),
        ))
    }

    /// Readings by the displacement of the tool: translation, turn times lever. Of the gauges on
    /// the tool; without three of them of all on a body, as if the wrist gave way as predicted.
    fn ways(&self, linearized: &LinearizedWindow) -> DMatrix<f64> {
        let faces = linearized.gauges.iter().map(|gauge| {
            match self.problem.campaign.gauges[*gauge].gauge {
                Gauge::Face {
                    body,
                    point_m,
                    axis,
                } => Some((body, point_m, axis)),
                Gauge::Axis { .. } => None,
            }
        });
        let faces: Vec<_> = faces.collect();
        let has_tool = faces
            .iter()
            .flatten()
            .filter(|(body, ..)| *body == Body::Tool)
            .count()
            >= 3;
        let mut ways = DMatrix::zeros(faces.len(), 6);
        for (row, face) in faces.iter().enumerate() {
            let Some((_, point_m, axis)) =
                face.filter(|(body, ..)| !has_tool || *body == Body::Tool)
            else {
                continue;
            };
            let turn = point_m.cross(&axis) / LEVER_M;
            ways.row_mut(row)
                .copy_from_slice(&[axis.x, axis.y, axis.z, turn.x, turn.y, turn.z]);
        }
        ways
    }

    /// True if an offset between these windows is at its limit.
    fn is_saturated(&self, off: usize, on: usize) -> bool {
        let Campaign {
            windows,
            metres_per_q,
            ..
        } = self.problem.campaign;
        let ways = windows[on].q.iter().zip(&windows[off].q).zip(metres_per_q);
        let offsets_m = ways.map(|((on, off), metres)| ((on - off) * metres).abs());
        offsets_m
            .zip(self.limits_m)
            .any(|(offset_m, limit_m)| offset_m >= limit_m - ROUNDED_M)
    }

    fn judge(
        &self,
        sorted: &SeriesPairs,
        &[off, on]: &[usize; 2],
        workpiece_n_per_m: f64,
    ) -> Option<PairResult> {
        let window = &self.problem.campaign.windows[on];
        // Off is of the first series, on of the last.
        let (more_before, _) = self.displaced(off, sorted.unloaded.first()?)?;
        let (more, covariance) = self.displaced(on, sorted.unloaded.last()?)?;
        let [predicted_before, predicted] =
            [off, on].map(|index| self.loaded[index].displacement().translation_m);
        let covariance = three(&covariance);
        let half_m = NORMAL_95 * covariance.symmetric_eigenvalues().max().max(0.0).sqrt();
        let predicted_m = predicted.norm();
        let force = window.load.fixed_rows::<3>(0).into_owned();
        let began = Equilibrium::unloaded(self.loaded[on].began);
        Some(PairResult {
            series: sorted.name.clone(),
            window: window.window.clone(),
            tool_m: began.pose.translation_m.into(),
            load: window.load.into(),
            before_m: (predicted_before + more_before).norm(),
            after_m: (predicted + more).norm(),
            predicted_m,
            interval95_m: [(predicted_m - half_m).max(0.0), predicted_m + half_m],
            z: deviation(&more, &covariance),
            changes_sides: [off, on]
                .into_iter()
                .any(|index| self.model.changes_sides(&self.loaded[index].now)),
            saturated: self.is_saturated(off, on),
            largest_gain: force.try_normalize(1e-9).and_then(|normal| {
                self.model
                    .largest_gain(&window.q, &began, &normal, workpiece_n_per_m)
            }),
        })
    }
}
