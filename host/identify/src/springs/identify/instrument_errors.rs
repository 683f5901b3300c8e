//! Errors of instruments of which the readings show a form: gauges that lag behind the load, drift,
//! or respond unevenly, a sensor of the load that does.
//!
//! Each is a column that a fit might have as well. How much of chi-squared it would take, and what
//! it would do to the springs, is known without that fit (a score test): the column, without what
//! zeros, set-up and springs have of it, against the residuals. The whole chi-squared does not show
//! them: a gauge of a stiff part moves by a few standard deviations, and a part of these is a
//! spring that is half too soft.

use nalgebra::{DMatrix, DVector, Vector6};

use super::{IdentifiedSprings, names};
use crate::fit::goodness::MIN_P;
use crate::fit::statistics::{chi_squared_above, f_above, float};
use crate::measurements::springs::NamedGauge;
use crate::springs::blocks::Blocks;
use crate::springs::linearize::LinearizedWindow;
use crate::springs::robust_fit::RobustFit;

/// Smallest share of a column that zeros, set-up and springs leave of it.
const MIN_LEFT: f64 = 1e-6;

/// Largest standard deviation of an error of the loads, as a share of the largest one, with which a
/// campaign can tell it. With loads of one size the springs take all of it but what the geometry
/// changes under load, and that says nothing of the sensor.
const MAX_LOAD_SD: f64 = 0.1;

/// Share of a gauge's largest displacement within which play of a lever is looked for, and beyond
/// which the end of a range is.
const PLAY: f64 = 0.3;
const END: f64 = 0.6;

/// Columns of one gauge that are not much the same: a lag, a drift, a bend.
const KINDS: usize = 3;

/// Form of an error: its size at a reading, up to a factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// Off by as much on the way up as on the way down, the other way.
    Hysteresis,
    /// Late on the way up, and on the way down, whichever way the gauge moves in a series.
    Lag,
    /// Grows with the time since the series began.
    Drift,
    /// Grows with the square of the displacement: less, or more, on one side.
    OneSided,
    /// The displacement, where it is small.
    Small,
    /// The displacement, but where it is large.
    NotLarge,
}

const FORMS: [Form; 6] = [
    Form::Hysteresis,
    Form::Lag,
    Form::Drift,
    Form::OneSided,
    Form::Small,
    Form::NotLarge,
];

impl Form {
    fn words(self) -> &'static str {
        match self {
            Self::Hysteresis => {
                "reads otherwise on the way down than on the way up; mend it, or fit that along (--hysteresis)"
            }
            Self::Lag => {
                "lags behind the load: friction, or play of its lever; mend it, or leave its readings empty"
            }
            Self::Drift => {
                "drifts with the time; wait until it does not, or fit that along (--drift)"
            }
            Self::OneSided | Self::Small | Self::NotLarge => {
                "does not respond to large and small loads alike: the end of its range, or play of its lever; measure it again, or leave its readings empty"
            }
        }
    }
}

/// A gauge, and how far its readings change, by the springs that were found.
struct GaugeMotion {
    gauge: usize,
    /// The largest magnitude, m.
    most_m: f64,
    /// By series, the sign of the largest change.
    ways: Vec<f64>,
}

/// Effect of a column, if it were fitted along.
struct Score {
    /// Decrease of chi-squared.
    gain: f64,
    /// Standard deviation of the size of the column.
    sd: f64,
    /// Changes of the parameters by what is in the readings of it now.
    moved: DVector<f64>,
}

/// Magnitude of the force of a load, N.
fn force_n(load: &Vector6<f64>) -> f64 {
    load.fixed_rows::<3>(0).norm()
}

impl<const N: usize> IdentifiedSprings<'_, N> {
    /// Instruments with such an error, with what to do.
    pub(super) fn instrument_errors(&self) -> Vec<String> {
        let scores = self.scores();
        let (of_load, of_gauges) = scores
            .split_last()
            .map_or((None, &[][..]), |(last, rest)| (last.as_ref(), rest));
        let found: Vec<(f64, String)> = self
            .problem
            .campaign
            .gauges
            .iter()
            .zip(of_gauges.chunks(FORMS.len()))
            .filter_map(|(gauge, scores)| self.error_of_gauge(gauge, scores))
            .collect();
        // A force sensor with such an error makes gauges look so.
        let most = found.iter().map(|(gain, _)| *gain).fold(0.0, f64::max);
        let of_load = of_load
            .filter(|score| score.gain > most && score.sd < MAX_LOAD_SD)
            .and_then(|score| self.significance(score, 1));
        let of_load = of_load.map(|why| {
            format!("the readings do not rise in proportion to the loads: look at range and calibration of the force sensor ({why})")
        });
        of_load.map_or_else(
            || found.into_iter().map(|(_, sentence)| sentence).collect(),
            |sentence| vec![sentence],
        )
    }

    /// The error of a gauge with the largest gain, with that gain, if it is not chance. `scores`:
    /// those of [`FORMS`].
    fn error_of_gauge(
        &self,
        gauge: &NamedGauge,
        scores: &[Option<Score>],
    ) -> Option<(f64, String)> {
        let (score, form) = scores
            .iter()
            .zip(FORMS)
            .filter_map(|(score, form)| Some((score.as_ref()?, form)))
            .max_by(|(one, _), (other, _)| one.gain.total_cmp(&other.gain))?;
        let why = self.significance(score, KINDS * self.problem.campaign.gauges.len())?;
        Some((
            score.gain,
            format!("gauge {} {} ({why})", gauge.name, form.words()),
        ))
    }

    /// Scores of all forms, gauge by gauge, and that of the load; `None` where zeros, set-up and
    /// springs take all of a column.
    fn scores(&self) -> Vec<Option<Score>> {
        let RobustFit {
            solution, active, ..
        } = &self.robust_fit;
        let moved: Vec<GaugeMotion> = (0..self.problem.campaign.gauges.len())
            .map(|gauge| self.moved(gauge))
            .collect();
        let loads = solution.state.loads.iter().map(force_n);
        // Without any load the column is zero, and nothing is left of it.
        let most_n = loads.fold(f64::MIN_POSITIVE, f64::max);
        let columns: Vec<DMatrix<f64>> = solution
            .linearized
            .iter()
            .map(|linearized| self.columns(linearized, &moved, most_n))
            .collect();
        let blocks = Blocks::new(
            &self.problem,
            active,
            &solution.linearized,
            &solution.state.setup,
            &columns,
        );
        let Some(Blocks { rows, extras, .. }) = blocks else {
            return Vec::new();
        };
        let half = solution.seen.half_covariance();
        let image = &rows.derivatives * &half;
        extras
            .column_iter()
            .map(|whole| {
                let shares = image.tr_mul(&whole);
                let left = whole - &image * &shares;
                let squares = left.norm_squared();
                let size = left.dot(&rows.residuals) / squares;
                let is_left = squares > MIN_LEFT * whole.norm_squared();
                is_left.then(|| Score {
                    gain: size * size * squares,
                    sd: (self.intervals.variance(solution) / squares).sqrt(),
                    moved: &half * shares * -size,
                })
            })
            .collect()
    }

    /// Returns probability and effect of an error that is not chance; `tests`: number of columns
    /// that were tried.
    fn significance(&self, score: &Score, tests: usize) -> Option<String> {
        let solution = &self.robust_fit.solution;
        let p = if self.intervals.is_scaled {
            let degrees = solution.degrees().saturating_sub(1);
            f_above(
                score.gain * float(degrees) / (solution.rows.chi_squared() - score.gain),
                1,
                degrees,
            )
        } else {
            chi_squared_above(score.gain, 1)
        };
        let p = p * float(tests);
        let (spring, shift_sd) = self.most_moved(&score.moved)?;
        (p < MIN_P)
            .then(|| format!("p = {p:.1e}; it moves {spring} by {shift_sd:.1} standard deviations"))
    }

    /// Change of a gauge's reading in a window, m.
    fn change_m(&self, linearized: &LinearizedWindow, gauge: usize) -> Option<f64> {
        let row = linearized.row_of(gauge)?;
        Some(
            (linearized.springs_shown.row(row) * self.robust_fit.solution.state.springs.vector())
                [0],
        )
    }

    fn moved(&self, gauge: usize) -> GaugeMotion {
        let campaign = self.problem.campaign;
        let mut largest_m = vec![0.0_f64; campaign.series.len()];
        for linearized in &self.robust_fit.solution.linearized {
            let here = &mut largest_m[campaign.windows[linearized.window].series];
            let change_m = self.change_m(linearized, gauge).unwrap_or(0.0);
            if change_m.abs() > here.abs() {
                *here = change_m;
            }
        }
        let most_m = largest_m
            .iter()
            .fold(0.0, |most: f64, largest| most.max(largest.abs()));
        GaugeMotion {
            gauge,
            most_m,
            ways: largest_m.into_iter().map(f64::signum).collect(),
        }
    }

    /// Columns of a window: of each gauge each form, then the load, whose largest force is `most_n`.
    fn columns(
        &self,
        linearized: &LinearizedWindow,
        moved: &[GaugeMotion],
        most_n: f64,
    ) -> DMatrix<f64> {
        let mut columns = DMatrix::zeros(linearized.gauges.len(), moved.len() * FORMS.len() + 1);
        for (row, gauge) in linearized.gauges.iter().enumerate() {
            let sizes = self.sizes(linearized, &moved[*gauge]);
            columns
                .view_mut((row, gauge * FORMS.len()), (1, FORMS.len()))
                .copy_from_slice(&sizes);
        }
        // A sensor that shows the load off by a share that grows with the force.
        let load = &self.robust_fit.solution.state.loads[linearized.window];
        let off = load * (force_n(load) / most_n);
        columns.set_column(
            moved.len() * FORMS.len(),
            &(&linearized.load * DVector::from_column_slice(off.as_slice())),
        );
        columns
    }

    /// Size of each form of error at the reading of a gauge; zero where the fit has it, or cannot
    /// know.
    fn sizes(&self, linearized: &LinearizedWindow, moved: &GaugeMotion) -> [f64; FORMS.len()] {
        let GaugeMotion {
            gauge,
            most_m,
            ways,
        } = moved;
        let change_m = self.change_m(linearized, *gauge).unwrap_or(0.0);
        let window = &self.problem.campaign.windows[linearized.window];
        let stroke = f64::from(window.stroke);
        let active = &self.robust_fit.active;
        FORMS.map(|form| match form {
            Form::Hysteresis if active.hysteresis.contains(gauge) => 0.0,
            Form::Hysteresis => stroke,
            Form::Lag => stroke * ways[window.series],
            Form::Drift if active.has_drift => 0.0,
            Form::Drift => window.time_s.unwrap_or(0.0),
            Form::OneSided => change_m * change_m,
            Form::Small => change_m.clamp(-PLAY * most_m, PLAY * most_m),
            Form::NotLarge => change_m.clamp(-END * most_m, END * most_m),
        })
    }

    /// The parameter that is moved most, and by how many of its standard deviations.
    fn most_moved(&self, moved: &DVector<f64>) -> Option<(String, f64)> {
        let names = names(&self.problem, &self.robust_fit.active, self.play.is_some());
        let covariance = self.robust_fit.solution.seen.covariance()
            * self.intervals.variance(&self.robust_fit.solution);
        let in_sd = moved
            .iter()
            .enumerate()
            .map(|(index, moved)| moved.abs() / covariance[(index, index)].sqrt());
        let known = in_sd.zip(names).filter(|(shift, _)| shift.is_finite());
        let (shift_sd, (name, _)) = known.max_by(|(one, _), (other, _)| one.total_cmp(other))?;
        Some((name, shift_sd))
    }
}
