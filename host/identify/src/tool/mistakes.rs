//! Readings that no tool explains: columns that are not what they say, or one reading that is not
//! like the others.

use gantry_tau_core::model::sensor::Tool;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_machine::sensor::Mounting;
use nalgebra::{Matrix6, Vector6};

use super::fit::{FittedTool, Turned, fit_tool};
use super::pulls_upwards;
use crate::fit::goodness::{simplest, too_large};
use crate::fit::statistics::squares_about_mean;
use crate::measurements::FileError;
use crate::measurements::mistaken_columns::MistakenColumns;
use crate::measurements::moved_rows::MovedRows;
use crate::measurements::springs::LOAD;
use crate::measurements::tool::{ReadingNoise, ToolReading, ToolReadings};

/// Chi-squared by which one explanation must be better than a simpler one.
const MIN_GAIN: f64 = 20.0;
/// Sum of the squares of a column's changes, in variances of its noise, above which it carries a
/// signal.
const SIGNAL: f64 = 100.0;
/// Readings of which one can be shown to differ from the others.
const MIN_READINGS: usize = 5;

/// Readings of a tool, and what they are fitted with.
pub(super) struct ToolProblem<'a, const N: usize> {
    pub(super) measured: &'a ToolReadings<N>,
    pub(super) mounting: &'a Mounting,
    pub(super) readings: &'a [Turned],
    /// The robot file's tool.
    pub(super) start: Tool,
}

impl<const N: usize> ToolProblem<'_, N> {
    /// Checks readings that the fitted tool does not explain, or that no tool was fitted to.
    /// Returns a sentence about the one reading without which a tool explains them.
    ///
    /// # Errors
    /// [`FileError`] that names the columns that are mistaken.
    pub(super) fn check(&self, fitted: Option<&FittedTool>) -> Result<Option<String>, FileError> {
        let said =
            fitted.and_then(|fitted| too_large(fitted.fit.chi_squared(), fitted.fit.degrees()));
        if fitted.is_some() && said.is_none() {
            return Ok(None);
        }
        if let Some(reading) = self
            .unlike_the_others()
            .and_then(|index| self.measured.readings.get(index))
        {
            let ToolReading { name, line, .. } = reading;
            let reason =
                "this reading does not agree with the others; measure it again, or remove it";
            return match fitted {
                Some(_) => Ok(Some(format!("pose {name} (line {line}): {reason}"))),
                None => Err(self.measured.error(reading, "pose", reason)),
            };
        }
        let Some(first) = self.measured.readings.first() else {
            return Ok(None);
        };
        if let Some((columns, reason)) = self.mistaken() {
            return Err(self.measured.error(first, &columns, reason));
        }
        if let Some(said) = said
            .filter(|_| fitted.is_some_and(|fitted| pulls_upwards(fitted, &self.start.weight_n)))
        {
            let reason = format!(
                "no tool explains the readings, the best would pull upwards, and {said}; look at signs, units and order of the columns, and at q"
            );
            return Err(self.measured.error(first, LOAD[0], reason));
        }
        Ok(None)
    }

    /// True if one of the mistaken columns, mended, changes by more than its noise.
    fn has_signal(&self, mistake: &MistakenColumns, readings: &[Turned]) -> bool {
        let ReadingNoise { force_n, moment_nm } = self.measured.noise;
        let changes = mistake.columns.iter().map(|column| {
            let sd = if *column < 3 { force_n } else { moment_nm };
            let values = readings
                .iter()
                .filter_map(|reading| reading.raw.to_array().get(*column).map(|one| one / sd));
            squares_about_mean(&values.collect::<Vec<_>>())
        });
        changes.fold(0.0, f64::max) > SIGNAL
    }

    /// Chi-squared of readings that a tool which pulls downwards explains.
    fn explained(&self, readings: &[Turned]) -> Option<f64> {
        let fitted = fit_tool(self.mounting, readings, self.measured.noise, self.start).ok()?;
        let chi2 = fitted.fit.chi_squared();
        let is_explained = too_large(chi2, fitted.fit.degrees()).is_none()
            && !pulls_upwards(&fitted, &self.start.weight_n);
        is_explained.then_some(chi2)
    }

    /// Columns, and the reason, of the simplest mistake without which a tool explains the readings.
    fn mistaken(&self) -> Option<(String, String)> {
        let of_columns = MistakenColumns::all(LOAD).filter_map(|mistake| {
            let mended = mended(self.readings, &mistake.mended);
            let chi2 = self.explained(&mended)?;
            self.has_signal(&mistake, &mended)
                .then(|| (chi2, (mistake.list(&LOAD), mistake.reason)))
        });
        // Few readings are explained without one of them, in any order.
        let moved = MovedRows::ALL
            .into_iter()
            .filter(|_| self.readings.len() >= MIN_READINGS);
        let of_rows = moved.filter_map(|moved| {
            let mended: Vec<_> = moved
                .pairs(self.readings)
                .map(|(set, measured)| Turned {
                    raw: measured.raw,
                    ..*set
                })
                .collect();
            Some((
                self.explained(&mended)?,
                (LOAD.join(", "), format!("these columns {moved}")),
            ))
        });
        simplest(of_columns.chain(of_rows), MIN_GAIN)
    }

    /// The one reading without which a tool explains the others.
    fn unlike_the_others(&self) -> Option<usize> {
        if self.readings.len() < MIN_READINGS {
            return None;
        }
        let best = (0..self.readings.len())
            .filter_map(|index| {
                let mut others = self.readings.to_vec();
                others.remove(index);
                Some((self.explained(&others)?, index))
            })
            .min_by(|(one, _), (other, _)| one.total_cmp(other));
        best.map(|(_, index)| index)
    }
}

/// Readings whose wrenches are this matrix times those of the table.
fn mended(readings: &[Turned], by: &Matrix6<f64>) -> Vec<Turned> {
    readings
        .iter()
        .map(|reading| {
            let raw = by * Vector6::from(reading.raw.to_array());
            Turned {
                raw: Wrench::from_array(raw.into()),
                ..*reading
            }
        })
        .collect()
}
