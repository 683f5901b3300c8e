//! Measured remainders against predicted ones.
//!
//! The file's machine predicts every reading at the measured `q` and load. What remains of a reading after the zero of its gauge moves the
//! predicted displacement of the platform, by least squares over the gauges of the window; what they do not see stays as predicted, and so
//! does what a wrist gives way. The covariance of a residual is that of gauge, zero and load, `J F F^T J^T` by the springs, and that of the
//! constants of the set-up.

use gantry_tau_core::units::OffsetNm;
use nalgebra::{DMatrix, DVector, Vector3};
use serde::Serialize;

use super::VerifyError;
use super::algebra::{chi_squared, deviation, pseudo_inverse};
use super::model::{FileModel, three};
use super::pairs::{SeriesPairs, is_unloaded, pairs};
use super::summary::Verification;
use crate::elastic::Equilibrium;
use crate::fit::statistics::{NORMAL_95, float};
use crate::measurements::springs::Campaign;
use crate::model::MachineKind;
use crate::output::Name;
use crate::robot_file::RobotFile;
use crate::springs::blocks::{Blocks, covariance};
use crate::springs::choice::Choice;
use crate::springs::gauge::{Body, Gauge};
use crate::springs::lines::{Lines, LinesError, Question, State};
use crate::springs::loaded::Loaded;

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
    /// Difference of measured and predicted displacement in standard deviations, root mean square over its directions.
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

/// Compares a campaign of pairs with the prediction of a robot file; the workpiece is that of the feedback margin.
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
    let question = Question::new(&geometry, &model.springs, campaign);
    let limits_m = file.limits.map(|axis| OffsetNm(axis.limits.position.max()).to_metres().0);
    let predicted = Predicted::new(&model, &question, limits_m)?;
    let (mut results, mut choice) = (Vec::new(), Choice::none(campaign));
    for sorted in of_series {
        for pair in &sorted.pairs {
            let result = predicted.judge(&sorted, pair, workpiece_n_per_m);
            let result = result.ok_or_else(|| {
                predicted.failed(pair[1], &"the gauges of the window have no zero, or its links no equilibrium")
            })?;
            if !result.changes_sides {
                choice.use_windows(pair);
            }
            results.push(result);
        }
        if !sorted.pairs.is_empty() {
            sorted.unloaded.iter().for_each(|windows| choice.use_windows(windows));
        }
    }
    let no_pairs = || VerifyError::NoPairs { table: campaign.table.clone() };
    if results.is_empty() {
        return Err(no_pairs());
    }
    let (chi2, dof) = predicted.chi_squared(&choice).ok_or_else(no_pairs)?;
    Ok(Verification::new(file, campaign, results, chi2, dof))
}

/// The campaign with the rows without a load first: a series begins in the pose of its first row, which must have no offsets.
fn zeros_first<const N: usize>(campaign: &Campaign<N>) -> Campaign<N> {
    let mut sorted = campaign.clone();
    sorted.windows.sort_by_key(|window| !is_unloaded(campaign, window));
    sorted
}

/// All windows of a campaign, as the file predicts them.
struct Predicted<'a, const N: usize> {
    model: &'a FileModel<N>,
    question: &'a Question<'a, N>,
    loaded: Vec<Loaded<N>>,
    lines: Vec<Lines>,
    /// Limits of the offsets.
    limits_m: [f64; N],
}

impl<'a, const N: usize> Predicted<'a, N> {
    fn new(model: &'a FileModel<N>, question: &'a Question<'a, N>, limits_m: [f64; N]) -> Result<Self, VerifyError> {
        let campaign = question.campaign;
        let failed = |LinesError::Window { line, error }| VerifyError::Pair {
            table: campaign.table.clone(),
            line,
            reason: error.to_string(),
        };
        let state = State::start(question);
        let loaded = question.loaded(&state, &vec![false; campaign.windows.len()]).map_err(failed)?;
        let lines = loaded.iter().enumerate().map(|(index, loaded)| question.linearised(&state, index, loaded));
        let lines = lines.collect::<Result<_, _>>().map_err(failed)?;
        Ok(Self { model, question, loaded, lines, limits_m })
    }

    fn failed(&self, window: usize, reason: &dyn std::fmt::Display) -> VerifyError {
        let campaign = self.question.campaign;
        let line = campaign.windows[window].line;
        VerifyError::Pair { table: campaign.table.clone(), line, reason: reason.to_string() }
    }

    /// Chi-squared of the readings that are used, and its degrees of freedom.
    fn chi_squared(&self, choice: &Choice) -> Option<(f64, usize)> {
        let assumed = DVector::zeros(self.question.setup.count());
        let blocks = Blocks::new(self.question, choice, &self.lines, &assumed, &[])?;
        Some(chi_squared(&blocks.rows, &self.model.factor))
    }

    /// Covariance of the residuals of a window by the noise of gauges and load.
    fn noise(&self, lines: &Lines) -> DMatrix<f64> {
        let variances = lines.variances.iter().copied();
        covariance(&lines.load, variances, &self.question.load_variances())
    }

    /// Mean residuals of some gauges in unloaded windows, and their covariance; `None` if one was not read there.
    fn zeros(&self, gauges: &[usize], unloaded: &[usize]) -> Option<(DVector<f64>, DMatrix<f64>)> {
        let place = |window: usize, gauge: usize| self.lines[window].gauges.iter().position(|other| *other == gauge);
        let mut zeros_m = DVector::zeros(gauges.len());
        let mut covariance = DMatrix::zeros(gauges.len(), gauges.len());
        let read = |gauge: &usize| unloaded.iter().filter(|window| place(**window, *gauge).is_some()).count();
        let counts: Vec<usize> = gauges.iter().map(read).collect();
        if counts.contains(&0) {
            return None;
        }
        for &window in unloaded {
            let lines = &self.lines[window];
            let mut shares = DMatrix::zeros(gauges.len(), lines.gauges.len());
            for (row, (gauge, count)) in gauges.iter().zip(&counts).enumerate() {
                if let Some(place) = place(window, *gauge) {
                    shares[(row, place)] = 1.0 / float(*count);
                }
            }
            zeros_m += &shares * &lines.misclosures;
            covariance += &shares * self.noise(lines) * shares.transpose();
        }
        Some((zeros_m, covariance))
    }

    /// Measured less predicted displacement of the tool, m, and the covariance of both together.
    fn displaced(&self, window: usize, unloaded: &[usize]) -> Option<(Vector3<f64>, DMatrix<f64>)> {
        let lines = &self.lines[window];
        let (zeros_m, of_zeros) = self.zeros(&lines.gauges, unloaded)?;
        let left = &lines.misclosures - zeros_m;
        let mut covariance = self.noise(lines) + of_zeros;
        covariance += self.model.covariance(&lines.springs);
        covariance += &lines.mounting * lines.mounting.transpose() + &lines.sensor * lines.sensor.transpose();
        let ways = self.ways(lines);
        let solve = (pseudo_inverse(&ways) * ways.transpose()).rows(0, 3).into_owned();
        let moved = &solve * left;
        Some((Vector3::new(moved[0], moved[1], moved[2]), &solve * covariance * solve.transpose()))
    }

    /// Readings by the displacement of the tool: translation, turn times lever. Of the gauges on the tool; without three of them of all
    /// on a body, as if the wrist gave way as predicted.
    fn ways(&self, lines: &Lines) -> DMatrix<f64> {
        let faces = lines.gauges.iter().map(|gauge| match self.question.campaign.gauges[*gauge].gauge {
            Gauge::Face { body, point_m, axis } => Some((body, point_m, axis)),
            Gauge::Axis { .. } => None,
        });
        let faces: Vec<_> = faces.collect();
        let on_tool = |body: Body| body == Body::Tool;
        let has_tool = faces.iter().flatten().filter(|(body, ..)| on_tool(*body)).count() >= 3;
        let mut ways = DMatrix::zeros(faces.len(), 6);
        for (row, face) in faces.iter().enumerate() {
            let Some((_, point_m, axis)) = face.filter(|(body, ..)| !has_tool || on_tool(*body)) else { continue };
            let turn = point_m.cross(&axis) / LEVER_M;
            ways.row_mut(row).copy_from_slice(&[axis.x, axis.y, axis.z, turn.x, turn.y, turn.z]);
        }
        ways
    }

    /// True if an offset between these windows is at its limit.
    fn is_saturated(&self, off: usize, on: usize) -> bool {
        let Campaign { windows, metres_per_q, .. } = self.question.campaign;
        let ways = windows[on].q.iter().zip(&windows[off].q).zip(metres_per_q);
        let offsets_m = ways.map(|((on, off), metres)| ((on - off) * metres).abs());
        offsets_m.zip(self.limits_m).any(|(offset_m, limit_m)| offset_m >= limit_m - ROUNDED_M)
    }

    fn judge(&self, sorted: &SeriesPairs, &[off, on]: &[usize; 2], workpiece_n_per_m: f64) -> Option<PairResult> {
        let window = &self.question.campaign.windows[on];
        let tool = |index: usize| self.loaded[index].displacement().translation_m;
        // Off is of the first series, on of the last.
        let (more_before, _) = self.displaced(off, sorted.unloaded.first()?)?;
        let (more, covariance) = self.displaced(on, sorted.unloaded.last()?)?;
        let (predicted, covariance) = (tool(on), three(&covariance));
        let half_m = NORMAL_95 * covariance.symmetric_eigenvalues().max().max(0.0).sqrt();
        let predicted_m = predicted.norm();
        let force = window.load.fixed_rows::<3>(0).into_owned();
        let began = Equilibrium::unloaded(self.loaded[on].began);
        Some(PairResult {
            series: sorted.name.clone(),
            window: window.window.clone(),
            tool_m: began.pose.translation_m.into(),
            load: window.load.into(),
            before_m: (tool(off) + more_before).norm(),
            after_m: (predicted + more).norm(),
            predicted_m,
            interval95_m: [(predicted_m - half_m).max(0.0), predicted_m + half_m],
            z: deviation(&more, &covariance),
            changes_sides: [off, on].into_iter().any(|index| self.model.changes_sides(&self.loaded[index].now)),
            saturated: self.is_saturated(off, on),
            largest_gain: force
                .try_normalize(1e-9)
                .and_then(|normal| self.model.largest_gain(&window.q, &began, &normal, workpiece_n_per_m)),
        })
    }
}
