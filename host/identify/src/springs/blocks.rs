//! Whitened rows of a campaign, and its nuisance parameters, eliminated in three levels: zeros of
//! the gauges in each series, constants of each mounting, constants of the sensor.

use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

use super::active_set::ActiveSet;
use super::linearize::LinearizedWindow;
use super::problem::SpringsProblem;
use super::state::FitState;
use crate::fit::least_squares::{Factors, Rows};

/// Rows of one level, and the unknowns that are eliminated there.
struct Elimination {
    unknowns: DMatrix<f64>,
    /// Factors of `unknowns`.
    factors: Factors,
    rest: DMatrix<f64>,
}

impl Elimination {
    fn new(unknowns: DMatrix<f64>, rest: DMatrix<f64>) -> Self {
        Self {
            factors: Factors::new(unknowns.clone()),
            unknowns,
            rest,
        }
    }

    /// Values of the unknowns that fit best what `combination` makes of the other columns.
    fn solve(&self, combination: &DVector<f64>) -> DVector<f64> {
        self.factors.solve(&self.rest * combination).0
    }

    fn eliminated(&self) -> DMatrix<f64> {
        self.factors.eliminated(self.rest.clone())
    }
}

/// A window, whitened.
struct WhitenedWindow {
    /// Its index among the linearized windows.
    line: usize,
    /// Those of its rows that are used.
    used: Vec<usize>,
    /// `L^-1`, where `L L^T` is the covariance of the used rows.
    whitening: DMatrix<f64>,
    /// `L^-1 H`.
    load: DMatrix<f64>,
}

impl WhitenedWindow {
    /// `L^-1` times columns of the used rows. (Not in [`SeriesBlock::new`], whose callers'
    /// packages compile it, most with less optimisation than this one.)
    fn whitened(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        &self.whitening * columns
    }
}

/// One series.
struct SeriesBlock {
    mounting: usize,
    windows: Vec<WhitenedWindow>,
    level: Elimination,
    /// Columns of the zero of each reading, and shares in them; by window and reading.
    zeros: Vec<Vec<Vec<(usize, f64)>>>,
}

/// A campaign as rows for the springs.
pub(crate) struct Blocks {
    series: Vec<SeriesBlock>,
    mountings: Vec<Elimination>,
    sensor: Elimination,
    /// Rows for the springs, everything else eliminated.
    pub(crate) rows: Rows,
    /// The columns that were carried along, one per window, everything else eliminated.
    pub(crate) extras: DMatrix<f64>,
}

/// Values of the eliminated unknowns.
pub(crate) struct EliminatedUnknowns {
    /// Change of the constants of the set-up, in standard deviations of their priors.
    pub(crate) setup: DVector<f64>,
    /// True load of each window.
    pub(crate) loads: Vec<Vector6<f64>>,
    /// Misclosures less the zeros, m: by window and reading, those of unused readings too.
    pub(crate) left: Vec<DVector<f64>>,
}

/// Columns of the rows of a series: parameters, constants of the mounting, of the sensor, the
/// misclosure, extras.
#[derive(Clone, Copy)]
struct ColumnCounts {
    parameters: usize,
    mounting: usize,
    sensor: usize,
    extras: usize,
}

impl Blocks {
    /// Whitens and eliminates. `extras`: columns that are carried along, for each window a row per
    /// row of its lines; empty: none.
    ///
    /// `None` where a covariance is not positive, which a checked campaign has not.
    pub(crate) fn new<const N: usize>(
        problem: &SpringsProblem<'_, N>,
        active: &ActiveSet,
        linearized: &[LinearizedWindow],
        setup: &DVector<f64>,
        extras: &[DMatrix<f64>],
    ) -> Option<Self> {
        let constants = &problem.setup;
        let columns = ColumnCounts {
            parameters: linearized.first()?.springs.ncols() + active.further_unknowns(),
            mounting: constants.per_mounting(),
            sensor: constants.of_sensor(),
            extras: extras.first().map_or(0, DMatrix::ncols),
        };
        let count = problem.campaign.series.len();
        let series: Option<Vec<SeriesBlock>> = (0..count)
            .map(|index| SeriesBlock::new(problem, active, linearized, index, columns, extras))
            .collect();
        let series = series?;
        let mountings: Vec<Elimination> = (0..problem.campaign.mountings.len())
            .map(|mounting| {
                let of_series = series.iter().filter(|series| series.mounting == mounting);
                let rows: Vec<DMatrix<f64>> =
                    of_series.map(|series| series.level.eliminated()).collect();
                split(
                    &rows,
                    columns.parameters,
                    &setup
                        .rows(constants.first(mounting), columns.mounting)
                        .into_owned(),
                    columns,
                )
            })
            .collect();
        let rows: Vec<DMatrix<f64>> = mountings.iter().map(Elimination::eliminated).collect();
        let columns = ColumnCounts {
            mounting: columns.sensor,
            sensor: 0,
            ..columns
        };
        let sensor = split(
            &rows,
            columns.parameters,
            &setup
                .rows(constants.first_of_sensor(), columns.mounting)
                .into_owned(),
            columns,
        );
        let left = sensor.eliminated();
        Some(Self {
            series,
            mountings,
            sensor,
            rows: first_rows(&left, columns.parameters),
            extras: left
                .columns(columns.parameters + 1, columns.extras)
                .into_owned(),
        })
    }

    /// Rows of each series, its zeros eliminated; the constants of the set-up must be exact.
    pub(crate) fn series_rows(&self) -> Vec<Rows> {
        let parameters = self.rows.derivatives.ncols();
        self.series
            .iter()
            .map(|series| first_rows(&series.level.eliminated(), parameters))
            .collect()
    }

    /// Returns the values of what was eliminated, after a step of the parameters.
    pub(crate) fn eliminated<const N: usize>(
        &self,
        problem: &SpringsProblem<'_, N>,
        linearized: &[LinearizedWindow],
        state: &FitState<N>,
        step: &DVector<f64>,
    ) -> EliminatedUnknowns {
        let constants = &problem.setup;
        let sensor = self
            .sensor
            .solve(&combination(&[step], self.sensor.rest.ncols()));
        let mut change = DVector::zeros(constants.count());
        change
            .rows_mut(constants.first_of_sensor(), sensor.len())
            .copy_from(&sensor);
        for (index, mounting) in self.mountings.iter().enumerate() {
            let values = mounting.solve(&combination(&[step, &sensor], mounting.rest.ncols()));
            change
                .rows_mut(constants.first(index), values.len())
                .copy_from(&values);
        }
        let variances = problem.load_variances();
        let windows = &problem.campaign.windows;
        let mut loads: Vec<Vector6<f64>> = windows.iter().map(|window| window.load).collect();
        let mut left: Vec<DVector<f64>> = linearized
            .iter()
            .map(|linearized| linearized.misclosures.clone())
            .collect();
        let of_sensor = state.setup.rows(constants.first_of_sensor(), sensor.len()) + &sensor;
        for series in &self.series {
            let mounting = change
                .rows(constants.first(series.mounting), constants.per_mounting())
                .into_owned();
            let combination = combination(&[step, &mounting, &sensor], series.level.rest.ncols());
            let zeros = series.level.solve(&combination);
            let whitened = &series.level.rest * &combination - &series.level.unknowns * &zeros;
            let mut first = 0;
            for (window, zero_columns) in series.windows.iter().zip(&series.zeros) {
                let linearized = &linearized[window.line];
                let shift = window.load.tr_mul(&whitened.rows(first, window.used.len()));
                first += window.used.len();
                let known = problem.setup.effect(&state.loads[linearized.window]) * &of_sensor;
                loads[linearized.window] += Vector6::from_fn(|component, _| {
                    variances[component] * shift[component] - known[component]
                });
                let left = &mut left[linearized.window];
                *left -= &linearized.mounting * &mounting + &linearized.sensor * &sensor;
                for (row, columns) in zero_columns.iter().enumerate() {
                    left[row] -= columns
                        .iter()
                        .map(|(column, share)| zeros[*column] * share)
                        .sum::<f64>();
                }
            }
        }
        EliminatedUnknowns {
            setup: change,
            loads,
            left,
        }
    }
}

/// Columns of the parameters, and the misclosures behind them.
fn first_rows(left: &DMatrix<f64>, parameters: usize) -> Rows {
    Rows::new(
        left.column(parameters).into_owned(),
        left.columns(0, parameters).into_owned(),
    )
}

/// Combination of columns that a step leaves of the misclosure: minus the `parts`, then one, and
/// nothing of the others.
fn combination(parts: &[&DVector<f64>], columns: usize) -> DVector<f64> {
    let mut combination = DVector::zeros(columns);
    let mut first = 0;
    for part in parts {
        combination.rows_mut(first, part.len()).copy_from(&(-*part));
        first += part.len();
    }
    combination[first] = 1.0;
    combination
}

/// Stacks rows, with the priors of the constants that are eliminated here: `constants` are their
/// values, their columns begin at `first`.
fn split(
    rows: &[DMatrix<f64>],
    first: usize,
    constants: &DVector<f64>,
    columns: ColumnCounts,
) -> Elimination {
    let unknowns = constants.len();
    let width = columns.parameters + columns.mounting + columns.sensor + 1 + columns.extras;
    let height: usize = rows.iter().map(DMatrix::nrows).sum();
    let mut all = DMatrix::zeros(height + unknowns, width);
    let mut row = 0;
    for rows in rows {
        all.view_mut((row, 0), rows.shape()).copy_from(rows);
        row += rows.nrows();
    }
    for (index, value) in constants.iter().enumerate() {
        all[(row + index, first + index)] = 1.0;
        all[(
            row + index,
            columns.parameters + columns.mounting + columns.sensor,
        )] = -value;
    }
    let unknown = all.columns(first, unknowns).into_owned();
    Elimination::new(unknown, all.remove_columns(first, unknowns))
}

impl SeriesBlock {
    fn new<const N: usize>(
        problem: &SpringsProblem<'_, N>,
        active: &ActiveSet,
        linearized: &[LinearizedWindow],
        index: usize,
        columns: ColumnCounts,
        extras: &[DMatrix<f64>],
    ) -> Option<Self> {
        let campaign = problem.campaign;
        let load_variances = problem.load_variances();
        let gauges = campaign.gauges.len();
        let mut windows = Vec::new();
        let mut zeros = Vec::new();
        let mut mounting = 0;
        let mut height = 0;
        let mut begin_s = None;
        for (line, linearized) in linearized.iter().enumerate() {
            let window = &campaign.windows[linearized.window];
            if window.series != index {
                continue;
            }
            mounting = window.mounting;
            let weights = &active.weights[linearized.window];
            let used: Vec<usize> = (0..linearized.gauges.len())
                .filter(|row| weights[linearized.gauges[*row]] > 0.0)
                .collect();
            let load = linearized.load.select_rows(&used);
            let variances: Vec<f64> = used
                .iter()
                .map(|row| linearized.variances[*row] / weights[linearized.gauges[*row]])
                .collect();
            let whitening = whitening(covariance(&load, &variances, &load_variances))?;
            height += used.len();
            windows.push(WhitenedWindow {
                line,
                load: &whitening * load,
                used,
                whitening,
            });
            let seconds = window.time_s.unwrap_or_default()
                - *begin_s.get_or_insert(window.time_s.unwrap_or_default());
            let of_window = linearized.gauges.iter().map(|gauge| {
                zero_columns(gauges, active, (index, linearized.window), seconds, *gauge)
            });
            zeros.push(of_window.collect::<Vec<_>>());
        }
        let width = columns.parameters + columns.mounting + columns.sensor + 1 + columns.extras;
        let mut all_unknowns = DMatrix::zeros(height, zero_count(gauges, active));
        let mut all_rest = DMatrix::zeros(height, width);
        let mut first = 0;
        for (window, zeros) in windows.iter().zip(&zeros) {
            let linearized = &linearized[window.line];
            let rest = rest(
                problem,
                active,
                linearized,
                columns,
                extras.get(window.line),
            )
            .select_rows(&window.used);
            let mut unknowns = DMatrix::zeros(window.used.len(), all_unknowns.ncols());
            for (place, row) in window.used.iter().enumerate() {
                for (column, share) in &zeros[*row] {
                    unknowns[(place, *column)] = *share;
                }
            }
            all_rest
                .rows_mut(first, window.used.len())
                .copy_from(&window.whitened(&rest));
            all_unknowns
                .rows_mut(first, window.used.len())
                .copy_from(&window.whitened(&unknowns));
            first += window.used.len();
        }
        Some(Self {
            mounting,
            windows,
            level: Elimination::new(all_unknowns, all_rest),
            zeros,
        })
    }
}

/// Covariance of the readings of a window, whose gauges share the error of its load:
/// `diag(sigma^2) + H Sigma_w H^T`.
pub(crate) fn covariance(
    load: &DMatrix<f64>,
    variances: &[f64],
    load_variances: &Vector6<f64>,
) -> DMatrix<f64> {
    let mut covariance = load * Matrix6::from_diagonal(load_variances) * load.transpose();
    for (place, variance) in variances.iter().enumerate() {
        covariance[(place, place)] += *variance;
    }
    covariance
}

/// `L^-1` of a covariance `L L^T`; `None` if it is not positive.
pub(crate) fn whitening(covariance: DMatrix<f64>) -> Option<DMatrix<f64>> {
    covariance.cholesky()?.l().try_inverse()
}

/// Number of unknowns of a series: a zero per gauge, a drift per gauge, and a second zero per
/// shift.
fn zero_count(gauges: usize, active: &ActiveSet) -> usize {
    gauges * (1 + usize::from(active.has_drift)) + active.shifts.len()
}

/// Unknowns of its series that a reading contains, and their shares, `seconds` after the first
/// window of the series.
fn zero_columns(
    gauges: usize,
    active: &ActiveSet,
    (series, window): (usize, usize),
    seconds: f64,
    gauge: usize,
) -> Vec<(usize, f64)> {
    let mut columns = vec![(gauge, 1.0)];
    if active.has_drift {
        columns.push((gauges + gauge, seconds));
    }
    let first = zero_count(gauges, active) - active.shifts.len();
    for (index, shift) in active.shifts.iter().enumerate() {
        if shift.series == series && shift.gauge == gauge && window >= shift.window {
            columns.push((first + index, 1.0));
        }
    }
    columns
}

/// All columns of a window, before whitening.
fn rest<const N: usize>(
    problem: &SpringsProblem<'_, N>,
    active: &ActiveSet,
    linearized: &LinearizedWindow,
    columns: ColumnCounts,
    extras: Option<&DMatrix<f64>>,
) -> DMatrix<f64> {
    let rows = linearized.gauges.len();
    let mut rest = DMatrix::zeros(
        rows,
        columns.parameters + columns.mounting + columns.sensor + 1 + columns.extras,
    );
    let springs = linearized.springs.ncols();
    rest.columns_mut(0, springs).copy_from(&linearized.springs);
    let mut next = springs;
    if active.has_play() {
        if active.is_crossed[linearized.window] {
            rest.column_mut(next).copy_from(&linearized.play());
            let of_links = active
                .post_jump
                .columns(&linearized.lengths, &linearized.springs);
            rest.columns_mut(next + 1, of_links.ncols())
                .copy_from(&of_links);
        }
        next += 1 + active.link_unknowns();
    }
    let stroke = f64::from(problem.campaign.windows[linearized.window].stroke);
    for (place, gauge) in active.hysteresis.iter().enumerate() {
        if let Some(row) = linearized.row_of(*gauge) {
            rest[(row, next + place)] = stroke;
        }
    }
    rest.columns_mut(columns.parameters, columns.mounting)
        .copy_from(&linearized.mounting);
    rest.columns_mut(columns.parameters + columns.mounting, columns.sensor)
        .copy_from(&linearized.sensor);
    let constants = columns.parameters + columns.mounting + columns.sensor;
    rest.column_mut(constants)
        .copy_from(&linearized.misclosures);
    if let Some(extras) = extras {
        rest.columns_mut(constants + 1, columns.extras)
            .copy_from(extras);
    }
    rest
}
