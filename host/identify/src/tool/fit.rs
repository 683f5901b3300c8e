//! Fit of weight, centre of gravity and bias to readings in several orientations.
//!
//! With `R` of the platform, world axes from platform axes, `R_s` and `p` of the sensor's mounting,
//! a tool of weight `G` at `c` reads
//!
//! - `F_s = R_s^T R^T G + b_F`,
//! - `M_s = R_s^T ((c - p) x R^T G) + b_M`.
//!
//! The bias is eliminated: weight and centre are fitted to the Helmert contrasts of the readings,
//! each less the mean of those before it, which are independent and without a bias. So a weight
//! that the orientations do not distinguish from a bias keeps the file's value entirely, and the
//! bias, the mean of what the tool leaves, takes the difference.

use std::convert::Infallible;

use gantry_tau_core::model::sensor::Tool;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_machine::sensor::Mounting;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6xX, Vector6};

use crate::fit::answer::{Status, Uncertainty};
use crate::fit::goodness::MIN_P;
use crate::fit::least_squares::{Fit, FitError, Observability, Rows, fit};
use crate::fit::statistics::{chi_squared_above, float};
use crate::measurements::tool::ReadingNoise;

/// Parameters of the tool: weight and centre of gravity. As many follow for the bias.
pub const TOOL: usize = 6;
/// Changes that would matter: of weight and centre, N, m.
const TOOL_SCALES: [f64; TOOL] = [1.0, 1.0, 1.0, 0.01, 0.01, 0.01];
/// Changes that would matter: of the bias, N, N m.
const BIAS_SCALES: [f64; 6] = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1];
/// Factor of these at which hardly anything counts as lost.
const FREE: f64 = 1e3;
/// Fits that may change what is kept.
const MAX_BEGINNINGS: u32 = 4;
/// Largest change of a reading by one scale of a parameter, in standard deviations, that is
/// rounding of a rotation.
const ROUNDING_SD: f64 = 1e-6;

/// A mean reading in an orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turned {
    /// `R`: world axes from platform axes.
    pub rotation: Matrix3<f64>,
    /// Reading, untared, sensor axes, about the sensor's origin.
    pub raw: Wrench,
}

/// A tool with what the readings say of it.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedTool {
    /// Weight and centre of gravity.
    pub tool: Tool,
    /// Bias, sensor axes.
    pub bias: Wrench,
    /// Covariance of weight, centre, force and moment of the bias; N, m, N, N m. What the readings
    /// do not see of the tool has a standard deviation of 1 N and 10 mm; of what is kept there is
    /// none.
    pub covariance: DMatrix<f64>,
    /// Fit of weight and centre, with chi-squared, degrees of freedom and lost directions.
    pub fit: Fit<Tool>,
    /// Uncertainty of weight and centre.
    uncertainty: Uncertainty,
    /// Variances of the bias by the readings, and by what they do not see of the tool.
    of_bias: [Vector6<f64>; 2],
}

/// Fits a tool; `start`, the file's, stays where the readings do not see it.
///
/// # Errors
/// [`FitError::TooFew`] for one reading; [`FitError`].
pub fn fit_tool(
    mounting: &Mounting,
    readings: &[Turned],
    noise: ReadingNoise,
    start: Tool,
) -> Result<FittedTool, FitError<Infallible>> {
    let scales = DVector::from_row_slice(&TOOL_SCALES);
    let sds = Vector6::from_fn(|row, _| {
        if row < 3 {
            noise.force_n
        } else {
            noise.moment_nm
        }
    });
    // Moments with a wrong weight or centre would pull the fit to another minimum: forces alone,
    // which are linear, give the weight to begin with.
    let forces_only = sds.map_with_location(|row, _, sd| if row < 3 { sd } else { f64::INFINITY });
    let weighed = fit_from(mounting, readings, &forces_only, start, &scales)?.state;
    let free = fit_from(mounting, readings, &sds, weighed, &(&scales * FREE)).ok();
    let kept = keeping(&start, &weighed, |begin| {
        fit_from(mounting, readings, &sds, begin, &scales)
    })?;
    // A value of the file that the readings contradict is not kept, however badly they know it.
    let contradicting = free.filter(|free| {
        let count = kept.degrees().saturating_sub(free.degrees());
        count > 0 && chi_squared_above(kept.chi_squared() - free.chi_squared(), count) < MIN_P
    });
    let fit = match contradicting {
        Some(free) => Fit {
            seen: Observability::holding(&free.rows, &scales, &free.held),
            ..free
        },
        None => kept,
    };
    Ok(FittedTool::new(mounting, readings, &sds, fit))
}

fn fit_from(
    mounting: &Mounting,
    readings: &[Turned],
    sds: &Vector6<f64>,
    begin: Tool,
    scales: &DVector<f64>,
) -> Result<Fit<Tool>, FitError<Infallible>> {
    fit(
        begin,
        scales,
        |tool| Ok(contrasts(mounting, readings, sds, tool)),
        stepped,
    )
}

/// A tool changed by a step of its parameters.
fn stepped(tool: &Tool, step: &DVector<f64>) -> Tool {
    Tool {
        weight_n: tool.weight_n + step.fixed_rows::<3>(0),
        centre_m: tool.centre_m + step.fixed_rows::<3>(3),
    }
}

/// Fits from the weight of the forces alone, but for what the readings do not see: that keeps the
/// value of `start`.
fn keeping(
    start: &Tool,
    weighed: &Tool,
    fit_from: impl Fn(Tool) -> Result<Fit<Tool>, FitError<Infallible>>,
) -> Result<Fit<Tool>, FitError<Infallible>> {
    let scales = DVector::from_row_slice(&TOOL_SCALES);
    let mut whole = DVector::zeros(TOOL);
    whole
        .fixed_rows_mut::<3>(0)
        .copy_from(&(weighed.weight_n - start.weight_n));
    whole
        .fixed_rows_mut::<3>(3)
        .copy_from(&(weighed.centre_m - start.centre_m));
    whole.component_div_assign(&scales);
    let mut found = fit_from(*weighed)?;
    if found.held.count() == 0 {
        return Ok(found);
    }
    for _ in 0..MAX_BEGINNINGS {
        let directions = found.held.directions();
        let mut step = &whole - directions * directions.tr_mul(&whole);
        found.held.kept().iter().for_each(|kept| step[*kept] = 0.0);
        let next = fit_from(stepped(start, &step.component_mul(&scales)))?;
        let is_same = next.held.agrees(&found.held);
        found = next;
        if is_same {
            return Ok(found);
        }
    }
    fit_from(*start)
}

/// Whitened Helmert contrasts of what a tool leaves of the readings.
fn contrasts(mounting: &Mounting, readings: &[Turned], sds: &Vector6<f64>, tool: &Tool) -> Rows {
    let count = 6 * readings.len().saturating_sub(1);
    let mut residuals = DVector::zeros(count);
    let mut all = DMatrix::zeros(count, TOOL);
    let mut mean_left = Vector6::zeros();
    let mut mean_derivatives = Matrix6::zeros();
    for (before, reading) in readings.iter().enumerate() {
        let (left, derivatives) = left(mounting, reading, tool);
        let off = left - mean_left;
        let off_derivatives = derivatives - mean_derivatives;
        if before > 0 {
            let first = 6 * (before - 1);
            let weight = (float(before) / float(before + 1)).sqrt();
            let mut whitened = off_derivatives * weight;
            for (mut row, sd) in whitened.row_iter_mut().zip(sds) {
                row /= *sd;
            }
            for (mut column, scale) in whitened.column_iter_mut().zip(TOOL_SCALES) {
                column.apply(|entry| {
                    *entry = if entry.abs() * scale < ROUNDING_SD {
                        0.0
                    } else {
                        *entry
                    }
                });
            }
            residuals
                .fixed_rows_mut::<6>(first)
                .copy_from(&(off.component_div(sds) * weight));
            all.fixed_rows_mut::<6>(first).copy_from(&whitened);
        }
        mean_left += off / float(before + 1);
        mean_derivatives += off_derivatives / float(before + 1);
    }
    Rows::new(residuals, all)
}

/// Returns what a tool leaves of a reading, and the derivatives of its own reading by weight and
/// centre.
fn left(mounting: &Mounting, reading: &Turned, tool: &Tool) -> (Vector6<f64>, Matrix6<f64>) {
    let in_sensor = mounting.rotation.transpose();
    let to_platform = reading.rotation.transpose();
    let weight_n = to_platform * tool.weight_n;
    let arm_m = tool.centre_m - mounting.lever_m;
    let raw = Vector6::from(reading.raw.to_array());
    let left = raw - mounting.tool_seen(tool, &reading.rotation);
    let mut derivatives = Matrix6::zeros();
    derivatives
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&(in_sensor * to_platform));
    derivatives
        .fixed_view_mut::<3, 3>(3, 0)
        .copy_from(&(in_sensor * arm_m.cross_matrix() * to_platform));
    derivatives
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(-in_sensor * weight_n.cross_matrix()));
    (left, derivatives)
}

/// Covariance between the bias and the tool, and of the bias, that follow from the covariance of the
/// tool.
fn following(
    mean_derivatives: &Matrix6<f64>,
    of_tool: &DMatrix<f64>,
) -> (Matrix6xX<f64>, Matrix6<f64>) {
    let cross = -mean_derivatives * of_tool;
    let of_bias = -&cross * mean_derivatives.transpose();
    (cross, of_bias)
}

impl FittedTool {
    /// Takes a fit for the tool; the bias, and the covariance of both, follow from the readings.
    fn new(mounting: &Mounting, readings: &[Turned], sds: &Vector6<f64>, fit: Fit<Tool>) -> Self {
        let tool = fit.state;
        let count = float(readings.len());
        let mut bias = Vector6::zeros();
        let mut mean_derivatives = Matrix6::zeros();
        for reading in readings {
            let (left, derivatives) = left(mounting, reading, &tool);
            bias += left / count;
            mean_derivatives += derivatives / count;
        }
        let uncertainty = Uncertainty::new(&fit.rows, &fit.seen, &fit.held);
        let of_noise = Matrix6::from_diagonal(&sds.map(|sd| sd * sd / count));
        let (_, seen) = following(&mean_derivatives, &fit.seen.covariance());
        let (cross, whole) = following(&mean_derivatives, &uncertainty.whole_covariance());
        let of_bias = [(of_noise + seen).diagonal(), (whole - seen).diagonal()];
        let mut covariance = DMatrix::zeros(2 * TOOL, 2 * TOOL);
        covariance
            .view_mut((0, 0), (TOOL, TOOL))
            .copy_from(&uncertainty.covariance());
        covariance
            .view_mut((TOOL, 0), (TOOL, TOOL))
            .copy_from(&cross);
        for kept in fit.held.kept() {
            covariance.column_mut(*kept).fill(0.0);
        }
        let cross = covariance.view((TOOL, 0), (TOOL, TOOL)).transpose();
        covariance
            .view_mut((0, TOOL), (TOOL, TOOL))
            .copy_from(&cross);
        covariance
            .view_mut((TOOL, TOOL), (TOOL, TOOL))
            .copy_from(&(of_noise + whole));
        Self {
            tool,
            bias: Wrench::from_array(bias.into()),
            covariance,
            fit,
            uncertainty,
            of_bias,
        }
    }

    /// Values of all parameters, in the order of the covariance.
    #[must_use]
    pub fn values(&self) -> DVector<f64> {
        let tool = self
            .tool
            .weight_n
            .iter()
            .chain(self.tool.centre_m.iter())
            .copied();
        DVector::from_iterator(2 * TOOL, tool.chain(self.bias.to_array()))
    }

    /// Chi-squared and degrees of freedom of the forces, and of the moments: their rows, less what
    /// each part shows of the unknowns (the sum of its leverages, rounded).
    #[must_use]
    pub fn parts(&self) -> [(f64, usize); 2] {
        let Rows {
            residuals,
            derivatives,
        } = &self.fit.rows;
        let leverages = derivatives * self.fit.seen.half_covariance();
        [0, 3].map(|first| {
            let rows: Vec<usize> = (0..residuals.len())
                .filter(|row| (first..first + 3).contains(&(row % 6)))
                .collect();
            let chi2 = rows
                .iter()
                .map(|row| residuals[*row] * residuals[*row])
                .sum();
            let leverage: f64 = rows
                .iter()
                .map(|row| leverages.row(*row).norm_squared())
                .sum();
            let unknowns = (0..rows.len())
                .filter(|count| float(*count) + 0.5 < leverage)
                .count();
            (chi2, rows.len() - unknowns)
        })
    }

    /// Status of a parameter by the readings.
    #[must_use]
    pub fn status(&self, parameter: usize) -> Status {
        let Some(component) = parameter.checked_sub(TOOL) else {
            return self.uncertainty.status(parameter);
        };
        let [seen, unseen] = self
            .of_bias
            .map(|variances| variances[component].max(0.0).sqrt());
        Status::of(seen, unseen, BIAS_SCALES[component])
    }
}
