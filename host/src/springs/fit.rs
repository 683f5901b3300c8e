//! Maximum likelihood of the compliances, where gauges *and* loads are measured (the Gauss-Helmert model).
//!
//! Minimised is `sum |y - h(c, w*) - z|^2 / sigma^2 + |w - w*|^2 / Sigma_w` over the compliances `c`, the true loads `w*` and the zero `z` of each
//! gauge in each series. (Weighted least squares at the measured loads is off by up to 0.8 standard deviations.) A round linearises at `w*`:
//!
//!     r = y - h(c, w*) - H (w - w*),    Cov = diag(sigma^2) + H Sigma_w H^T,    w* <- w + Sigma_w H^T Cov^-1 (r - J dc - z)
//!
//! with one block of `Cov` per window, whose gauges share the error of its load. The zeros are projected out.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{Compliances, LINKS, RobotError};
use nalgebra::{DMatrix, DVector, SVector, UnitQuaternion, Vector6};

use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticError, ElasticMachine, Equilibrium, Pose};
use crate::fit::least_squares::{Rows, Seen, solve_linear};
use crate::measurements::springs::{Campaign, Window};

/// Rounds after which a fit has failed; three to five are usual.
const MAX_ROUNDS: u32 = 30;
/// Longest step of a fit that has converged, in standard deviations.
const CONVERGED_SD: f64 = 1e-4;
/// Largest factor that a compliance changes by in a round: none becomes negative.
const MOST_CHANGE: f64 = 20.0;

/// Reason why there is no fit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringsError {
    /// The compliances have left their range.
    #[error("the compliances leave their range: {0}")]
    Compliances(#[from] RobotError),
    /// A window has no equilibrium.
    #[error("line {line}: {error}")]
    Window {
        /// Line of the table.
        line: u64,
        /// What the elastic model says.
        error: ElasticError,
    },
    /// Fewer readings than unknowns.
    #[error("{readings} readings are too few for {parameters} springs")]
    TooFew {
        /// Readings, less the zeros.
        readings: usize,
        /// Springs.
        parameters: usize,
    },
    /// It still moves.
    #[error("no convergence after {MAX_ROUNDS} rounds: the last step is {step_sd:.1e} standard deviations long")]
    NotConverged {
        /// Length of the last step, in standard deviations.
        step_sd: f64,
    },
}

/// Springs that fit a campaign.
#[derive(Clone, Debug, PartialEq)]
pub struct SpringsFit<const N: usize> {
    /// The compliances.
    pub compliances: Compliances<N>,
    /// Whitened rows there, the zeros projected out.
    pub rows: Rows,
    /// What they see, in shares of the file's compliances.
    pub seen: Seen,
    /// True load of each window, as far as the gauges know better than the sensor.
    pub loads: Vec<Vector6<f64>>,
    /// Rounds.
    pub rounds: u32,
}

/// Fits the springs of a machine to a campaign; `file` are those that the search starts from, and that stay where nothing is seen.
///
/// # Errors
/// [`SpringsError`].
pub fn fit_springs<const N: usize>(
    geometry: &f1::Geometry,
    file: &Compliances<N>,
    campaign: &Campaign<N>,
) -> Result<SpringsFit<N>, SpringsError> {
    let scales = vector(file);
    let mut compliances = *file;
    let mut loads: Vec<Vector6<f64>> = campaign.windows.iter().map(|window| window.load).collect();
    for rounds in 1..=MAX_ROUNDS {
        let machine = ElasticMachine::new(*geometry, compliances, Backlash::NONE);
        let blocks = blocks(&machine, campaign, &loads)?;
        let rows = stacked(&blocks, scales.len());
        if rows.degrees < scales.len() {
            return Err(SpringsError::TooFew { readings: rows.degrees, parameters: scales.len() });
        }
        let seen = Seen::new(&rows, &scales);
        let step_sd = seen.step_sd();
        if step_sd < CONVERGED_SD {
            return Ok(SpringsFit { compliances, rows, seen, loads, rounds });
        }
        if rounds == MAX_ROUNDS {
            return Err(SpringsError::NotConverged { step_sd });
        }
        let step = bounded(&vector(&compliances), seen.step(0.0));
        compliances = compliances_of(&(vector(&compliances) + &step))?;
        for block in &blocks {
            block.update(campaign, &step, &mut loads);
        }
    }
    Err(SpringsError::NotConverged { step_sd: f64::INFINITY })
}

fn vector<const N: usize>(compliances: &Compliances<N>) -> DVector<f64> {
    let all = compliances.link_m_per_n().iter().chain(compliances.cart_m_per_n());
    DVector::from_iterator(LINKS + N, all.copied())
}

fn compliances_of<const N: usize>(vector: &DVector<f64>) -> Result<Compliances<N>, RobotError> {
    let links = std::array::from_fn(|link| vector[link]);
    let axes = std::array::from_fn(|axis| vector[LINKS + axis]);
    Compliances::new(links, axes)
}

/// Cuts a step, so that no compliance changes by more than [`MOST_CHANGE`].
fn bounded(from: &DVector<f64>, step: DVector<f64>) -> DVector<f64> {
    let cut = |from: f64, step: f64| (from + step).clamp(from / MOST_CHANGE, from * MOST_CHANGE) - from;
    from.zip_map(&step, cut)
}

/// One window of a series, linearised and whitened.
struct WindowRows {
    index: usize,
    /// Gauges that were read.
    gauges: Vec<usize>,
    residuals: DVector<f64>,
    springs: DMatrix<f64>,
    /// `L^-1`, `Cov = L L^T`: also the columns of the zeros.
    whitening: DMatrix<f64>,
    /// `L^-1 H`.
    load: DMatrix<f64>,
}

/// All windows of one series: they share the zeros of their gauges.
struct Series {
    windows: Vec<WindowRows>,
    gauges: usize,
}

/// Linearises the campaign, series by series.
fn blocks<const N: usize>(
    machine: &ElasticMachine<N>,
    campaign: &Campaign<N>,
    loads: &[Vector6<f64>],
) -> Result<Vec<Series>, SpringsError> {
    let mut series: Vec<Series> =
        (campaign.series.iter()).map(|_| Series { windows: Vec::new(), gauges: campaign.gauges.len() }).collect();
    let mut began: Vec<Option<Equilibrium<N>>> = vec![None; series.len()];
    let mut last: Vec<Option<Equilibrium<N>>> = vec![None; series.len()];
    for (index, window) in campaign.windows.iter().enumerate() {
        let failed = |error| SpringsError::Window { line: window.line, error };
        let first = match began[window.series] {
            Some(first) => first,
            None => unloaded(machine, campaign, window).map_err(failed)?,
        };
        began[window.series] = Some(first);
        let start = last[window.series].unwrap_or(first);
        let pushes = generalised(campaign, window);
        let now = machine.pushed_equilibrium(&window.q, &loads[index], &pushes, &start).map_err(failed)?;
        last[window.series] = Some(now);
        let rows = linearised(machine, campaign, index, &first.pose, &now, &loads[index]);
        series[window.series].windows.push(rows.ok_or_else(|| failed(ElasticError::Singular))?);
    }
    Ok(series)
}

/// The machine in the pose of a window, unloaded.
fn unloaded<const N: usize>(
    machine: &ElasticMachine<N>,
    campaign: &Campaign<N>,
    window: &Window<N>,
) -> Result<Equilibrium<N>, ElasticError> {
    let (_, seed) = &campaign.poses[window.pose];
    let rotation = UnitQuaternion::from_matrix(&seed.rotation);
    let start = Equilibrium::unloaded(Pose { translation_m: seed.position_m, rotation });
    machine.equilibrium(&window.q, &Vector6::zeros(), &start)
}

/// Pushes at the axes, per unit of `q`.
fn generalised<const N: usize>(campaign: &Campaign<N>, window: &Window<N>) -> SVector<f64, N> {
    window.pushes_n.component_mul(&SVector::from(campaign.metres_per_q))
}

fn linearised<const N: usize>(
    machine: &ElasticMachine<N>,
    campaign: &Campaign<N>,
    index: usize,
    began: &Pose,
    now: &Equilibrium<N>,
    load: &Vector6<f64>,
) -> Option<WindowRows> {
    let window = &campaign.windows[index];
    let through = machine.transmission(&window.q, now)?;
    let gauges: Vec<usize> = (0..campaign.gauges.len()).filter(|gauge| window.readings_m[*gauge].is_some()).collect();
    let count = gauges.len();
    let (mut residuals, mut springs) = (DVector::zeros(count), DMatrix::zeros(count, LINKS + N));
    let (mut by_load, mut covariance) = (DMatrix::zeros(count, 6), DMatrix::zeros(count, count));
    for (row, &gauge) in gauges.iter().enumerate() {
        let reading = campaign.gauges[gauge].gauge.read(machine, began, now);
        let derivatives = reading.derivatives(machine, &through, now);
        springs.view_mut((row, 0), (1, LINKS)).copy_from(&derivatives.links.transpose());
        springs.view_mut((row, LINKS), (1, N)).copy_from(&derivatives.axes.transpose());
        by_load.view_mut((row, 0), (1, 6)).copy_from(&derivatives.load.transpose());
        residuals[row] = window.readings_m[gauge]? - reading.length_m - derivatives.load.dot(&(window.load - load));
        covariance[(row, row)] = window.sds_m[gauge].unwrap_or(campaign.noise.gauge_um * 1e-6).powi(2);
    }
    covariance += &by_load * DMatrix::from_diagonal(&load_variances(campaign)) * by_load.transpose();
    let whitening = covariance.cholesky()?.l().try_inverse()?;
    let (residuals, springs, load) = (&whitening * residuals, &whitening * springs, &whitening * by_load);
    Some(WindowRows { index, gauges, residuals, springs, whitening, load })
}

/// Variances of a load's components: N^2, (N m)^2.
fn load_variances<const N: usize>(campaign: &Campaign<N>) -> DVector<f64> {
    let (force, moment) = (campaign.noise.force_n.powi(2), campaign.noise.moment_nm.powi(2));
    DVector::from_vec(vec![force, force, force, moment, moment, moment])
}

/// The rows of all series, the zeros projected out.
fn stacked(series: &[Series], springs: usize) -> Rows {
    let all: Vec<Rows> = series.iter().map(Series::without_zeros).collect();
    let size = all.iter().map(|rows| rows.residuals.len()).sum();
    let (mut residuals, mut derivatives) = (DVector::zeros(size), DMatrix::zeros(size, springs));
    let (mut first, mut degrees) = (0, 0);
    for rows in &all {
        let count = rows.residuals.len();
        residuals.rows_mut(first, count).copy_from(&rows.residuals);
        derivatives.rows_mut(first, count).copy_from(&rows.derivatives);
        first += count;
        degrees += rows.degrees;
    }
    Rows { residuals, derivatives, degrees }
}

impl Series {
    /// Rows, and the columns of the zeros.
    fn rows(&self) -> (Rows, DMatrix<f64>) {
        let size: usize = self.windows.iter().map(|window| window.gauges.len()).sum();
        let springs = self.windows.first().map_or(0, |window| window.springs.ncols());
        let (mut residuals, mut derivatives) = (DVector::zeros(size), DMatrix::zeros(size, springs));
        let mut zeros = DMatrix::zeros(size, self.gauges);
        let mut first = 0;
        for window in &self.windows {
            let count = window.gauges.len();
            residuals.rows_mut(first, count).copy_from(&window.residuals);
            derivatives.rows_mut(first, count).copy_from(&window.springs);
            for (column, &gauge) in window.gauges.iter().enumerate() {
                zeros.view_mut((first, gauge), (count, 1)).copy_from(&window.whitening.column(column));
            }
            first += count;
        }
        (Rows::new(residuals, derivatives), zeros)
    }

    fn without_zeros(&self) -> Rows {
        let (rows, zeros) = self.rows();
        rows.without(&zeros)
    }

    /// Takes the loads to where gauges and sensor together put them, after a step of the springs.
    fn update<const N: usize>(&self, campaign: &Campaign<N>, step: &DVector<f64>, loads: &mut [Vector6<f64>]) {
        let (rows, zeros) = self.rows();
        let left = &rows.residuals - &rows.derivatives * step;
        let read: Vec<usize> = (0..self.gauges).filter(|gauge| zeros.column(*gauge).amax() > 0.0).collect();
        let columns = zeros.select_columns(&read);
        let Some(found) = solve_linear(columns.clone(), left.clone()) else { return };
        let left = left - columns * found;
        let variances = load_variances(campaign);
        let mut first = 0;
        for window in &self.windows {
            let count = window.gauges.len();
            let shift = window.load.transpose() * left.rows(first, count);
            let shift = Vector6::from_fn(|component, _| variances[component] * shift[component]);
            loads[window.index] = campaign.windows[window.index].load + shift;
            first += count;
        }
    }
}

#[cfg(test)]
mod tests;
