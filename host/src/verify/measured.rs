//! Measured remainders against predicted ones.
//!
//! The file's machine predicts every reading at the measured `q` and load. What remains of a reading after the zero of its gauge moves the
//! predicted displacement of the platform, by least squares over the gauges of the window; what they do not see stays as predicted, and so
//! does what a wrist gives way. The covariance of a residual is that of gauge, zero and load, `J F F^T J^T` by the springs, and that of the
//! constants of the set-up.

use gantry_tau_core::model::robot::LINKS;
use nalgebra::{DMatrix, DVector, SVector, UnitQuaternion, Vector3, Vector6};
use serde::Serialize;

use super::VerifyError;
use super::algebra::{chi_squared, deviation, pseudo_inverse};
use super::model::{FileModel, three};
use super::pairs::{SeriesPairs, pairs};
use super::setup::{self, GAUGE, SENSOR};
use super::summary::Verification;
use crate::elastic::{Equilibrium, Pose};
use crate::fit::least_squares::Rows;
use crate::fit::statistics::{NORMAL_95, float};
use crate::measurements::springs::{Campaign, Window};
use crate::model::MachineKind;
use crate::robot_file::RobotFile;
use crate::springs::gauge::Gauge;

/// Lever that a turn counts with against a translation, m: that of the gauges.
const LEVER_M: f64 = 0.1;

/// One pair of windows.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairResult {
    /// Series of both windows, or what the names of their two series have in common.
    pub series: String,
    /// Their name.
    pub window: String,
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
    /// True where cluster 3 may change sides: judged apart.
    pub changes_sides: bool,
    /// Largest stable gain against the workpiece along the force.
    pub largest_gain: Option<f64>,
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
    let model = FileModel::new(file)?;
    let mut results = Vec::new();
    let mut rows = Vec::new();
    for sorted in pairs(campaign)? {
        let Some(series) = Series::new(&model, campaign, &sorted)? else { continue };
        for (pair, windows) in sorted.pairs.iter().zip(&series.pairs) {
            results.push(series.judge(windows, pair, workpiece_n_per_m).ok_or_else(|| series.failed(pair))?);
        }
        rows.push(series.rows().ok_or_else(|| VerifyError::NoPairs { table: campaign.table.clone() })?);
    }
    if results.is_empty() {
        return Err(VerifyError::NoPairs { table: campaign.table.clone() });
    }
    let (chi2, dof) = chi_squared(&rows, shared(&model));
    Ok(Verification::new(file, campaign, results, chi2, dof))
}

/// One window, linearised at the prediction of the file.
struct Linear<const N: usize> {
    /// Its series, as one of those that the pairs are from.
    series: usize,
    /// The machine without a load when the series began.
    began: Equilibrium<N>,
    now: Equilibrium<N>,
    gauges: Vec<usize>,
    /// Readings less predictions, m, without zeros.
    residuals: DVector<f64>,
    /// Derivatives by unit variables that all windows share: springs, then the sensor.
    shared: DMatrix<f64>,
    /// Derivatives by unit variables of the mounting: gauge by gauge.
    mounted: DMatrix<f64>,
    /// Covariance by gauges and load.
    covariance: DMatrix<f64>,
}

/// The series of some pairs: one, or one without and one with compensation. Each has zeros of its own.
struct Series<'a, const N: usize> {
    model: &'a FileModel<N>,
    campaign: &'a Campaign<N>,
    name: &'a str,
    /// Number of series.
    count: usize,
    unloaded: Vec<Linear<N>>,
    /// Off and on.
    pairs: Vec<[Linear<N>; 2]>,
}

impl<'a, const N: usize> Series<'a, N> {
    /// Predicts the windows of a series; `None` without pairs.
    fn new(
        model: &'a FileModel<N>,
        campaign: &'a Campaign<N>,
        sorted: &'a SeriesPairs,
    ) -> Result<Option<Self>, VerifyError> {
        if sorted.pairs.is_empty() {
            return Ok(None);
        }
        let firsts = sorted.unloaded.iter().filter_map(|rows| rows.first());
        let began = firsts.map(|first| begun(model, campaign, &campaign.windows[*first]));
        let began = began.collect::<Result<Vec<_>, VerifyError>>()?;
        // Off is of the first series, on of the last.
        let last = began.len() - 1;
        let linear = |index: &usize, series: usize| {
            linearised(model, campaign, &campaign.windows[*index], (series, &began[series]))
        };
        let rows = sorted.unloaded.iter().enumerate();
        let rows = rows.flat_map(|(series, rows)| rows.iter().map(move |row| (row, series)));
        let unloaded = rows.map(|(row, series)| linear(row, series)).collect::<Result<_, _>>()?;
        let both = |[off, on]: &[usize; 2]| Ok::<_, VerifyError>([linear(off, 0)?, linear(on, last)?]);
        let pairs = sorted.pairs.iter().map(both).collect::<Result<_, _>>()?;
        Ok(Some(Self { model, campaign, name: &sorted.name, count: began.len(), unloaded, pairs }))
    }

    fn failed(&self, [_, on]: &[usize; 2]) -> VerifyError {
        failed(
            self.campaign,
            &self.campaign.windows[*on],
            &"the gauges of the window have no zero, or its links no equilibrium",
        )
    }

    /// Mean residual of a gauge without load in a series, and the number of readings behind it.
    fn zero(&self, gauge: usize, series: usize) -> Option<(f64, f64)> {
        let read = |window: &Linear<N>| {
            let place = window.gauges.iter().position(|other| *other == gauge)?;
            Some(window.residuals[place])
        };
        let own = self.unloaded.iter().filter(|window| window.series == series);
        let all: Vec<f64> = own.filter_map(read).collect();
        let count = float(all.len());
        (!all.is_empty()).then(|| (all.iter().sum::<f64>() / count, count))
    }

    /// Measured less predicted displacement of the platform's tool centre point, m, and the covariance of both together.
    fn displaced(&self, window: &Linear<N>) -> Option<(Vector3<f64>, DMatrix<f64>)> {
        let (mut left, mut covariance) = (window.residuals.clone(), window.covariance.clone());
        let mut ways = DMatrix::zeros(left.len(), 6);
        for (row, &gauge) in window.gauges.iter().enumerate() {
            let (zero_m, count) = self.zero(gauge, window.series)?;
            left[row] -= zero_m;
            covariance[(row, row)] += (self.campaign.noise.gauge_um * 1e-6).powi(2) / count;
            if let Gauge::Platform { point_m, axis } = self.campaign.gauges[gauge].gauge {
                let turn = point_m.cross(&axis) / LEVER_M;
                ways.row_mut(row).copy_from_slice(&[axis.x, axis.y, axis.z, turn.x, turn.y, turn.z]);
            }
        }
        covariance += &window.shared * window.shared.transpose() + &window.mounted * window.mounted.transpose();
        let solve = (pseudo_inverse(&ways) * ways.transpose()).rows(0, 3).into_owned();
        let moved = &solve * left;
        Some((Vector3::new(moved[0], moved[1], moved[2]), &solve * covariance * solve.transpose()))
    }

    fn judge(&self, [off, on]: &[Linear<N>; 2], pair: &[usize; 2], workpiece_n_per_m: f64) -> Option<PairResult> {
        let window = &self.campaign.windows[pair[1]];
        let tool = |linear: &Linear<N>, index: usize| {
            self.model.tool(&linear.began, &linear.now, &self.campaign.windows[index].load).translation_m
        };
        let (more_before, _) = self.displaced(off)?;
        let (more, covariance) = self.displaced(on)?;
        let predicted = tool(on, pair[1]);
        let covariance = three(&covariance);
        let half_m = NORMAL_95 * covariance.symmetric_eigenvalues().max().max(0.0).sqrt();
        let predicted_m = predicted.norm();
        let force = window.load.fixed_rows::<3>(0).into_owned();
        Some(PairResult {
            series: self.name.to_owned(),
            window: window.window.clone(),
            tool_m: on.began.pose.translation_m.into(),
            load: window.load.into(),
            before_m: (tool(off, pair[0]) + more_before).norm(),
            after_m: (predicted + more).norm(),
            predicted_m,
            interval95_m: [(predicted_m - half_m).max(0.0), predicted_m + half_m],
            z: deviation(&more, &covariance),
            changes_sides: [off, on].into_iter().any(|linear| self.model.changes_sides(&linear.now)),
            largest_gain: force
                .try_normalize(1e-9)
                .and_then(|normal| self.model.largest_gain(&window.q, &on.began, &normal, workpiece_n_per_m)),
        })
    }

    /// Whitened rows of all windows on this side of the jump, by the unit variables; the zeros projected out.
    fn rows(&self) -> Option<Rows> {
        let judged = |pair: &&[Linear<N>; 2]| !pair.iter().any(|linear| self.model.changes_sides(&linear.now));
        let windows: Vec<&Linear<N>> = self.unloaded.iter().chain(self.pairs.iter().filter(judged).flatten()).collect();
        let size = windows.iter().map(|window| window.gauges.len()).sum();
        let gauges = self.campaign.gauges.len();
        let shared = shared(self.model);
        let (mut residuals, mut derivatives) = (DVector::zeros(size), DMatrix::zeros(size, shared + GAUGE * gauges));
        let mut zeros = DMatrix::zeros(size, gauges * self.count);
        let mut first = 0;
        for window in windows {
            let whitening = window.covariance.clone().cholesky()?.l().try_inverse()?;
            let count = window.gauges.len();
            residuals.rows_mut(first, count).copy_from(&(&whitening * &window.residuals));
            derivatives.view_mut((first, 0), (count, shared)).copy_from(&(&whitening * &window.shared));
            derivatives.view_mut((first, shared), (count, GAUGE * gauges)).copy_from(&(&whitening * &window.mounted));
            for (column, &gauge) in window.gauges.iter().enumerate() {
                zeros
                    .view_mut((first, window.series * gauges + gauge), (count, 1))
                    .copy_from(&whitening.column(column));
            }
            first += count;
        }
        Some(Rows::new(residuals, derivatives).without(zeros))
    }
}

/// Number of unit variables that all windows share.
fn shared<const N: usize>(model: &FileModel<N>) -> usize {
    model.factor.ncols() + SENSOR
}

fn failed<const N: usize>(campaign: &Campaign<N>, window: &Window<N>, reason: &dyn std::fmt::Display) -> VerifyError {
    VerifyError::Pair { table: campaign.table.clone(), line: window.line, reason: reason.to_string() }
}

/// The machine without a load, as in the first such window of a series.
fn begun<const N: usize>(
    model: &FileModel<N>,
    campaign: &Campaign<N>,
    first: &Window<N>,
) -> Result<Equilibrium<N>, VerifyError> {
    let (_, seed) = &campaign.poses[first.pose];
    let seed = Pose { translation_m: seed.position_m, rotation: UnitQuaternion::from_matrix(&seed.rotation) };
    let began = model.machine.equilibrium(&first.q, &Vector6::zeros(), &Equilibrium::unloaded(seed));
    began.map_err(|error| failed(campaign, first, &error))
}

fn linearised<const N: usize>(
    model: &FileModel<N>,
    campaign: &Campaign<N>,
    window: &Window<N>,
    (series, began): (usize, &Equilibrium<N>),
) -> Result<Linear<N>, VerifyError> {
    let refused = |reason: &dyn std::fmt::Display| failed(campaign, window, reason);
    let machine = &model.machine;
    let pushes = window.pushes_n.component_mul(&SVector::from(campaign.metres_per_q));
    let now = machine.pushed_equilibrium(&window.q, &window.load, &pushes, began).map_err(|error| refused(&error))?;
    let through = machine.transmission(&window.q, &now).ok_or_else(|| refused(&"the links cannot carry the load"))?;
    let read = window.readings_m.iter().enumerate().filter_map(|(gauge, reading)| Some((gauge, (*reading)?)));
    let read: Vec<(usize, f64)> = read.collect();
    let count = read.len();
    let (mut residuals, mut springs) = (DVector::zeros(count), DMatrix::zeros(count, model.springs()));
    let (mut by_load, mut covariance) = (DMatrix::zeros(count, 6), DMatrix::zeros(count, count));
    let mut mounted = DMatrix::zeros(count, GAUGE * campaign.gauges.len());
    for (row, (index, reading_m)) in read.iter().enumerate() {
        let gauge = &campaign.gauges[*index].gauge;
        let predicted = gauge.read(machine, &began.pose, &now);
        let by = predicted.derivatives(machine, &through, &now);
        residuals[row] = reading_m - predicted.length_m;
        springs.view_mut((row, 0), (1, LINKS)).copy_from(&by.links.transpose());
        springs.view_mut((row, LINKS), (1, N)).copy_from(&by.axes.transpose());
        by_load.view_mut((row, 0), (1, 6)).copy_from(&by.load.transpose());
        covariance[(row, row)] = window.sds_m[*index].unwrap_or(campaign.noise.gauge_um * 1e-6).powi(2);
        let constants = setup::of_gauge(&campaign.setup, gauge, machine, began, &now);
        mounted.view_mut((row, GAUGE * index), (1, GAUGE)).copy_from_slice(&constants);
    }
    covariance += &by_load * setup::load_noise(campaign.noise.force_n, campaign.noise.moment_nm) * by_load.transpose();
    let sensor = setup::of_sensor(&campaign.setup, &model.sensor_axes, &window.load);
    let mut shared = DMatrix::zeros(count, shared(model));
    shared.columns_mut(0, model.factor.ncols()).copy_from(&(springs * &model.factor));
    shared.columns_mut(model.factor.ncols(), SENSOR).copy_from(&(by_load * sensor));
    let gauges = read.into_iter().map(|(gauge, _)| gauge).collect();
    Ok(Linear { series, began: *began, now, gauges, residuals, shared, mounted, covariance })
}
