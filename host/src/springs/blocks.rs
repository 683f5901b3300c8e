//! Whitened rows of a campaign, and the unknowns that nobody asks for, eliminated in three levels: zeros of the gauges in each series,
//! constants of each mounting, constants of the sensor.

use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

use super::choice::Choice;
use super::lines::{Lines, Question, State};
use crate::fit::least_squares::{Rows, eliminated, solve};

/// Rows of one level, and the unknowns that are eliminated there.
struct Level {
    unknowns: DMatrix<f64>,
    rest: DMatrix<f64>,
}

impl Level {
    /// Values of the unknowns that fit best what `combination` makes of the other columns.
    fn solve(&self, combination: &DVector<f64>) -> DVector<f64> {
        solve(self.unknowns.clone(), &self.rest * combination).0
    }

    fn eliminated(&self) -> DMatrix<f64> {
        eliminated(self.unknowns.clone(), self.rest.clone())
    }
}

/// A window, whitened.
struct Whitened {
    /// Index of its lines.
    line: usize,
    /// Those of its rows that are used.
    used: Vec<usize>,
    /// `L^-1`, where `L L^T` is the covariance of the used rows.
    whitening: DMatrix<f64>,
    /// `L^-1 H`.
    load: DMatrix<f64>,
}

/// One series.
struct Series {
    mounting: usize,
    windows: Vec<Whitened>,
    level: Level,
    /// Column of the zero of each reading, by window and row of its lines.
    zeros: Vec<Vec<Vec<(usize, f64)>>>,
}

/// A campaign as rows for the springs.
pub(crate) struct Blocks {
    series: Vec<Series>,
    mountings: Vec<Level>,
    sensor: Level,
    /// Rows for the springs, everything else eliminated.
    pub(crate) rows: Rows,
    /// The columns that were asked for besides, one per window, eliminated likewise.
    pub(crate) extras: DMatrix<f64>,
}

/// Values of the eliminated unknowns.
pub(crate) struct Eliminated {
    /// Change of the constants of the set-up, in standard deviations of their priors.
    pub(crate) setup: DVector<f64>,
    /// True load of each window.
    pub(crate) loads: Vec<Vector6<f64>>,
    /// Misclosures less the zeros, m: by window, row of its lines; those of unused readings too.
    pub(crate) left: Vec<DVector<f64>>,
}

/// Columns of the rows of a series: parameters, constants of the mounting, of the sensor, the misclosure, extras.
#[derive(Clone, Copy)]
struct Columns {
    parameters: usize,
    mounting: usize,
    sensor: usize,
    extras: usize,
}

impl Blocks {
    /// Whitens and eliminates. `extras`: columns that are carried along, for each window a row per row of its lines; empty: none.
    ///
    /// `None` where a covariance is not positive, which a checked campaign has not.
    pub(crate) fn new<const N: usize>(
        question: &Question<'_, N>,
        choice: &Choice,
        lines: &[Lines],
        setup: &DVector<f64>,
        extras: &[DMatrix<f64>],
    ) -> Option<Self> {
        let constants = &question.setup;
        let columns = Columns {
            parameters: lines.first()?.springs.ncols() + choice.besides_springs(),
            mounting: constants.per_mounting(),
            sensor: constants.of_sensor(),
            extras: extras.first().map_or(0, DMatrix::ncols),
        };
        let count = question.campaign.series.len();
        let series: Option<Vec<Series>> =
            (0..count).map(|index| Series::new(question, choice, lines, index, columns, extras)).collect();
        let series = series?;
        let prior = |first: usize, count: usize| setup.rows(first, count).into_owned();
        let mountings: Vec<Level> = (0..question.campaign.mountings.len())
            .map(|mounting| {
                let of_series = series.iter().filter(|series| series.mounting == mounting);
                let rows: Vec<DMatrix<f64>> = of_series.map(|series| series.level.eliminated()).collect();
                split(&rows, columns.parameters, &prior(constants.first(mounting), columns.mounting), columns)
            })
            .collect();
        let rows: Vec<DMatrix<f64>> = mountings.iter().map(Level::eliminated).collect();
        let columns = Columns { mounting: columns.sensor, sensor: 0, ..columns };
        let sensor = split(&rows, columns.parameters, &prior(constants.first_of_sensor(), columns.mounting), columns);
        let left = sensor.eliminated();
        let (residuals, extras) = (left.column(columns.parameters).into_owned(), columns.extras);
        let rows = Rows::new(residuals, left.columns(0, columns.parameters).into_owned());
        let extras = left.columns(columns.parameters + 1, extras).into_owned();
        Some(Self { series, mountings, sensor, rows, extras })
    }

    /// Rows of each series, its zeros eliminated; the constants of the set-up must be exact.
    pub(crate) fn series_rows(&self) -> Vec<Rows> {
        let rows = |series: &Series| {
            let left = series.level.eliminated();
            let parameters = self.rows.derivatives.ncols();
            Rows::new(left.column(parameters).into_owned(), left.columns(0, parameters).into_owned())
        };
        self.series.iter().map(rows).collect()
    }

    /// Returns the values of what was eliminated, after a step of the parameters.
    pub(crate) fn eliminated<const N: usize>(
        &self,
        question: &Question<'_, N>,
        lines: &[Lines],
        state: &State<N>,
        step: &DVector<f64>,
    ) -> Eliminated {
        let constants = &question.setup;
        let combination = |parts: &[&DVector<f64>], columns: usize| {
            let mut combination = DVector::zeros(columns);
            let mut first = 0;
            for part in parts {
                combination.rows_mut(first, part.len()).copy_from(&(-*part));
                first += part.len();
            }
            combination[first] = 1.0;
            combination
        };
        let sensor = self.sensor.solve(&combination(&[step], self.sensor.rest.ncols()));
        let mut change = DVector::zeros(constants.count());
        change.rows_mut(constants.first_of_sensor(), sensor.len()).copy_from(&sensor);
        for (index, mounting) in self.mountings.iter().enumerate() {
            let values = mounting.solve(&combination(&[step, &sensor], mounting.rest.ncols()));
            change.rows_mut(constants.first(index), values.len()).copy_from(&values);
        }
        let variances = question.load_variances();
        let windows = &question.campaign.windows;
        let mut loads: Vec<Vector6<f64>> = windows.iter().map(|window| window.load).collect();
        let mut left: Vec<DVector<f64>> = lines.iter().map(|lines| lines.misclosures.clone()).collect();
        let of_sensor = state.setup.rows(constants.first_of_sensor(), sensor.len()) + &sensor;
        for series in &self.series {
            let mounting = change.rows(constants.first(series.mounting), constants.per_mounting()).into_owned();
            let combination = combination(&[step, &mounting, &sensor], series.level.rest.ncols());
            let zeros = series.level.solve(&combination);
            let whitened = &series.level.rest * &combination - &series.level.unknowns * &zeros;
            let mut first = 0;
            for (window, zero_columns) in series.windows.iter().zip(&series.zeros) {
                let lines = &lines[window.line];
                let shift = window.load.tr_mul(&whitened.rows(first, window.used.len()));
                first += window.used.len();
                let known = question.setup.effect(&state.loads[lines.window]) * &of_sensor;
                loads[lines.window] +=
                    Vector6::from_fn(|component, _| variances[component] * shift[component] - known[component]);
                let left = &mut left[lines.window];
                *left -= &lines.mounting * &mounting + &lines.sensor * &sensor;
                for (row, columns) in zero_columns.iter().enumerate() {
                    left[row] -= columns.iter().map(|(column, share)| zeros[*column] * share).sum::<f64>();
                }
            }
        }
        Eliminated { setup: change, loads, left }
    }
}

/// Stacks rows, with the priors of the constants that are eliminated here: `constants` are their values, their columns begin at `first`.
fn split(rows: &[DMatrix<f64>], first: usize, constants: &DVector<f64>, columns: Columns) -> Level {
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
        all[(row + index, columns.parameters + columns.mounting + columns.sensor)] = -value;
    }
    let unknown = all.columns(first, unknowns).into_owned();
    Level { unknowns: unknown, rest: all.remove_columns(first, unknowns) }
}

impl Series {
    fn new<const N: usize>(
        question: &Question<'_, N>,
        choice: &Choice,
        lines: &[Lines],
        index: usize,
        columns: Columns,
        extras: &[DMatrix<f64>],
    ) -> Option<Self> {
        let campaign = question.campaign;
        let load_variances = question.load_variances();
        let gauges = campaign.gauges.len();
        let (mut windows, mut zeros, mut mounting, mut height) = (Vec::new(), Vec::new(), 0, 0);
        let mut begin_s = None;
        for (line, lines) in lines.iter().enumerate() {
            let window = &campaign.windows[lines.window];
            if window.series != index {
                continue;
            }
            mounting = window.mounting;
            let weights = &choice.weights[lines.window];
            let used: Vec<usize> = (0..lines.gauges.len()).filter(|row| weights[lines.gauges[*row]] > 0.0).collect();
            let load = lines.load.select_rows(&used);
            let variances = used.iter().map(|row| lines.variances[*row] / weights[lines.gauges[*row]]);
            let whitening = whitening(covariance(&load, variances, &load_variances))?;
            height += used.len();
            windows.push(Whitened { line, load: &whitening * load, used, whitening });
            let seconds = window.time_s.unwrap_or_default() - *begin_s.get_or_insert(window.time_s.unwrap_or_default());
            let zero_columns = |gauge: &usize| zero_columns(gauges, choice, (index, lines.window), seconds, *gauge);
            zeros.push(lines.gauges.iter().map(zero_columns).collect::<Vec<_>>());
        }
        let width = columns.parameters + columns.mounting + columns.sensor + 1 + columns.extras;
        let mut level =
            Level { unknowns: DMatrix::zeros(height, zero_count(gauges, choice)), rest: DMatrix::zeros(height, width) };
        let mut first = 0;
        for (window, zeros) in windows.iter().zip(&zeros) {
            let lines = &lines[window.line];
            let rest = rest(question, choice, lines, columns, extras.get(window.line)).select_rows(&window.used);
            let mut unknowns = DMatrix::zeros(window.used.len(), level.unknowns.ncols());
            for (place, row) in window.used.iter().enumerate() {
                for (column, share) in &zeros[*row] {
                    unknowns[(place, *column)] = *share;
                }
            }
            level.rest.rows_mut(first, window.used.len()).copy_from(&(&window.whitening * rest));
            level.unknowns.rows_mut(first, window.used.len()).copy_from(&(&window.whitening * unknowns));
            first += window.used.len();
        }
        Some(Self { mounting, windows, level, zeros })
    }
}

/// Covariance of the readings of a window, whose gauges share the error of its load: `diag(sigma^2) + H Sigma_w H^T`.
pub(crate) fn covariance(
    load: &DMatrix<f64>,
    variances: impl IntoIterator<Item = f64>,
    load_variances: &Vector6<f64>,
) -> DMatrix<f64> {
    let mut covariance = load * Matrix6::from_diagonal(load_variances) * load.transpose();
    for (place, variance) in variances.into_iter().enumerate() {
        covariance[(place, place)] += variance;
    }
    covariance
}

/// `L^-1` of a covariance `L L^T`; `None` if it is not positive.
pub(crate) fn whitening(covariance: DMatrix<f64>) -> Option<DMatrix<f64>> {
    covariance.cholesky()?.l().try_inverse()
}

/// Number of unknowns of a series: a zero per gauge, a drift per gauge, and a second zero per shift.
fn zero_count(gauges: usize, choice: &Choice) -> usize {
    gauges * (1 + usize::from(choice.has_drift)) + choice.shifts.len()
}

/// Unknowns of its series that a reading contains, and their shares, `seconds` after the first window of the series.
fn zero_columns(
    gauges: usize,
    choice: &Choice,
    (series, window): (usize, usize),
    seconds: f64,
    gauge: usize,
) -> Vec<(usize, f64)> {
    let mut columns = vec![(gauge, 1.0)];
    if choice.has_drift {
        columns.push((gauges + gauge, seconds));
    }
    let first = zero_count(gauges, choice) - choice.shifts.len();
    for (index, shift) in choice.shifts.iter().enumerate() {
        if shift.series == series && shift.gauge == gauge && window >= shift.window {
            columns.push((first + index, 1.0));
        }
    }
    columns
}

/// All columns of a window, before whitening.
fn rest<const N: usize>(
    question: &Question<'_, N>,
    choice: &Choice,
    lines: &Lines,
    columns: Columns,
    extras: Option<&DMatrix<f64>>,
) -> DMatrix<f64> {
    let rows = lines.gauges.len();
    let mut rest = DMatrix::zeros(rows, columns.parameters + columns.mounting + columns.sensor + 1 + columns.extras);
    let springs = lines.springs.ncols();
    rest.columns_mut(0, springs).copy_from(&lines.springs);
    let mut next = springs;
    if choice.has_play() {
        if choice.is_crossed[lines.window] {
            rest.column_mut(next).copy_from(&lines.play());
            let of_links = choice.beyond.columns(&lines.lengths, &lines.springs);
            rest.columns_mut(next + 1, of_links.ncols()).copy_from(&of_links);
        }
        next += 1 + choice.of_links();
    }
    let stroke = f64::from(question.campaign.windows[lines.window].stroke);
    for (place, gauge) in choice.hysteresis.iter().enumerate() {
        if let Some(row) = lines.gauges.iter().position(|other| other == gauge) {
            rest[(row, next + place)] = stroke;
        }
    }
    rest.columns_mut(columns.parameters, columns.mounting).copy_from(&lines.mounting);
    rest.columns_mut(columns.parameters + columns.mounting, columns.sensor).copy_from(&lines.sensor);
    let constants = columns.parameters + columns.mounting + columns.sensor;
    rest.column_mut(constants).copy_from(&lines.misclosures);
    if let Some(extras) = extras {
        rest.columns_mut(constants + 1, columns.extras).copy_from(extras);
    }
    rest
}
