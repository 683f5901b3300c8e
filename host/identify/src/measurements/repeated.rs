//! Numbers that instruments do not repeat: copies of rows, columns that stand still or are cut at
//! an end.
//!
//! Readings have noise. Where a column resolves it, the same number comes three times only by a
//! chance that can be counted. A column that was typed, or is coarse, repeats itself, and says
//! nothing here.

use std::collections::{HashMap, HashSet};

use super::FileError;
use crate::fit::statistics::float;

/// Probability of a repetition by chance at which it is refused.
const MIN_P: f64 = 1e-4;
/// Equal numbers in a column that are looked at.
pub(crate) const MANY: usize = 3;
/// Other numbers of a column that tell whether it repeats itself anyway, and the smallest share of
/// them that differ.
pub(crate) const OTHERS: usize = 8;
const DIFFERENT: f64 = 0.9;
/// Columns that resolve their noise, all of which a copied row repeats.
const COPIED: usize = 3;

/// A column of measured numbers, row by row.
pub(crate) struct Column {
    pub(crate) name: String,
    /// Standard deviation of the noise, in the unit of the values; `None` of a column that only
    /// tells rows apart.
    pub(crate) sd: Option<f64>,
    pub(crate) values: Vec<Option<f64>>,
}

impl Column {
    fn at(&self, row: usize) -> Option<f64> {
        self.values.get(row).copied().flatten()
    }

    /// True if no row has another number than zero.
    pub(crate) fn is_zero(&self) -> bool {
        self.values.iter().flatten().all(|value| *value == 0.0)
    }

    fn numbers(&self) -> Vec<u64> {
        self.values
            .iter()
            .flatten()
            .map(|value| value.to_bits())
            .collect()
    }

    /// True if it has numbers in at least so many rows, and each differs from all others.
    fn is_noisy(&self, least: usize) -> bool {
        let all = self.numbers();
        all.len() >= least && all.iter().collect::<HashSet<_>>().len() == all.len()
    }

    /// True if it has one number, in at least so many rows.
    fn is_still(&self, least: usize) -> bool {
        let all = self.numbers();
        all.len() >= least && all.iter().all(|number| Some(number) == all.first())
    }

    /// Values of some rows.
    fn of(&self, rows: &[usize]) -> Vec<(usize, f64)> {
        rows.iter()
            .filter_map(|row| Some((*row, self.at(*row)?)))
            .collect()
    }
}

/// A number that a column repeats.
#[derive(Clone, Debug, PartialEq)]
struct Repeated<'a> {
    /// First row with it.
    row: usize,
    /// Name of the column.
    column: &'a str,
    /// The sentence for it.
    reason: String,
}

/// Checks a table, whose rows stand in `lines`, and are named by a column.
///
/// # Errors
/// [`FileError`] for a row that is a copy of another one, and for a column that repeats a number.
pub(crate) fn check(
    table: &str,
    lines: &[u64],
    names: &str,
    columns: &[Column],
) -> Result<(), FileError> {
    if let Some([row, earlier]) = copy(columns) {
        let reason = format!(
            "measured is the same as in line {}, to the last digit: a copy, or no reading; remove it",
            line_of(lines, earlier)
        );
        return Err(FileError::at(table, line_of(lines, row), names, reason));
    }
    match repeated(columns) {
        Some(Repeated {
            row,
            column,
            reason,
        }) => Err(FileError::at(table, line_of(lines, row), column, reason)),
        None => Ok(()),
    }
}

fn line_of(lines: &[u64], row: usize) -> u64 {
    lines.get(row).copied().unwrap_or_default()
}

/// Refuses a column of one number, in at least so many rows, beside one that never repeats a
/// number.
///
/// # Errors
/// [`FileError`] for the column.
pub(crate) fn check_still<'a>(
    table: &str,
    lines: &[u64],
    least: usize,
    columns: impl Iterator<Item = &'a Column> + Clone,
) -> Result<(), FileError> {
    let Some(still) = columns
        .clone()
        .find(|column| column.is_still(least))
        .filter(|_| columns.clone().any(|column| column.is_noisy(least)))
    else {
        return Ok(());
    };
    let row = still
        .values
        .iter()
        .position(Option::is_some)
        .unwrap_or_default();
    let reason = format!(
        "all readings are {}, to the last digit, where other columns have noise: this channel stands still; connect it, and measure again",
        still.at(row).unwrap_or_default()
    );
    Err(FileError::at(
        table,
        line_of(lines, row),
        &still.name,
        reason,
    ))
}

/// Returns a row and an earlier one that it repeats to the last digit, though at least three of
/// these columns resolve their noise.
fn copy(columns: &[Column]) -> Option<[usize; 2]> {
    let unique = unique_rows(columns);
    let measured = columns.iter().filter(|column| column.sd.is_some());
    let fine: Vec<&Column> = measured.filter(|column| is_fine(column, &unique)).collect();
    let rows = columns.first()?.values.len();
    let mut seen = HashMap::new();
    (0..rows).find_map(|row| {
        let earlier = *seen.entry(bits(columns, row)).or_insert(row);
        let shown = fine
            .iter()
            .filter(|column| column.at(row).is_some())
            .count();
        (earlier < row && shown >= COPIED).then_some([row, earlier])
    })
}

/// Returns the first number that a column repeats as noise would not.
fn repeated(columns: &[Column]) -> Option<Repeated<'_>> {
    let unique = unique_rows(columns);
    columns.iter().find_map(|column| {
        let sd = column.sd.filter(|_| is_fine(column, &unique))?;
        let mut sorted = column.of(&unique);
        sorted.sort_by(|(_, one), (_, other)| one.total_cmp(other));
        let group = sorted
            .chunk_by(|one, other| is_same(one.1, other.1))
            .find(|group| {
                group.len() >= MANY && ln_chance(sd, &sorted, group.len()) < MIN_P.ln()
            })?;
        let value = group.first()?.1;
        let row = group.iter().map(|(row, _)| *row).min()?;
        let is_end = [sorted.first(), sorted.last()]
            .iter()
            .flatten()
            .any(|(_, end)| is_same(*end, value));
        let is_still = column
            .of(&unique)
            .windows(group.len())
            .any(|run| run.iter().all(|(_, other)| is_same(*other, value)));
        let why = match (is_still, is_end) {
            (true, false) => "it stands still, stuck or not connected",
            (true, true) => "it stands still, stuck or at the end of the instrument's range",
            (false, true) => "it is cut there, at the end of the instrument's range",
            (false, false) => "numbers were copied",
        };
        let reason = format!(
            "{} rows from here on have the same number to the last digit, where noise would not repeat it: {why}; measure them again, or leave out these rows",
            group.len()
        );
        Some(Repeated {
            row,
            column: &column.name,
            reason,
        })
    })
}

/// Step from one number of a column to the next that differs; zero without one.
pub(crate) fn resolution(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let steps = sorted
        .iter()
        .zip(sorted.iter().skip(1))
        .map(|(one, next)| next - one)
        .filter(|step| *step > 0.0);
    steps.min_by(f64::total_cmp).unwrap_or(0.0)
}

/// Logarithm of the probability that any `count` of these numbers, of this standard deviation, are
/// equal.
fn ln_chance(sd: f64, values: &[(usize, f64)], count: usize) -> f64 {
    // Two readings of one value are equal by this chance, and of different ones less often.
    let equal = resolution(values.iter().map(|(_, value)| *value))
        / (2.0 * std::f64::consts::PI.sqrt() * sd);
    let chosen: f64 = (0..count)
        .map(|index| (float(values.len() - index) / float(index + 1)).ln())
        .sum();
    chosen + float(count - 1) * equal.ln().min(0.0)
}

/// True if the numbers of a column that come once or twice are many, and hardly any comes twice.
fn is_fine(column: &Column, rows: &[usize]) -> bool {
    let mut counts: HashMap<u64, usize> = HashMap::new();
    for (_, value) in column.of(rows) {
        *counts.entry(value.to_bits()).or_default() += 1;
    }
    let few = counts.values().filter(|count| **count < MANY);
    let (different, others) = few.fold((0, 0), |(different, others), count| {
        (different + 1, others + count)
    });
    others >= OTHERS && float(different) >= DIFFERENT * float(others)
}

/// Equal to the last digit.
pub(crate) const fn is_same(one: f64, other: f64) -> bool {
    one.to_bits() == other.to_bits()
}

/// Rows without those that are copies of earlier ones.
fn unique_rows(columns: &[Column]) -> Vec<usize> {
    let rows = columns.first().map_or(0, |column| column.values.len());
    let mut seen = HashSet::new();
    (0..rows)
        .filter(|row| seen.insert(bits(columns, *row)))
        .collect()
}

/// A row, to be compared.
fn bits(columns: &[Column], row: usize) -> Vec<Option<u64>> {
    columns
        .iter()
        .map(|column| column.at(row).map(f64::to_bits))
        .collect()
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn column(values: impl Iterator<Item = f64>) -> Column {
        Column {
            name: String::new(),
            sd: Some(1.0),
            values: values.map(Some).collect(),
        }
    }

    fn noise(count: usize) -> impl Iterator<Item = f64> {
        seeded(7, count)
    }

    fn seeded(seed: u64, count: usize) -> impl Iterator<Item = f64> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        (0..count).map(move |_| random.random_range(-2.0..2.0))
    }

    fn found(values: impl Iterator<Item = f64>) -> Option<(usize, usize, bool)> {
        let values: Vec<f64> = values.collect();
        let beside = seeded(8, values.len());
        let columns = [column(values.into_iter()), column(beside)];
        let found = repeated(&columns)?;
        let count = found.reason.split(' ').next().unwrap().parse().unwrap();
        Some((found.row, count, found.reason.contains("cut")))
    }

    #[test]
    fn a_column_of_zeros_is_one_with_empty_rows_too() {
        let zeros = Column {
            name: String::new(),
            sd: None,
            values: vec![Some(0.0), None, Some(-0.0)],
        };
        assert!(zeros.is_zero() && !column([0.0, 1e-9].into_iter()).is_zero());
    }

    #[test]
    fn what_stands_still_and_what_is_cut_is_found() {
        assert_eq!(found(noise(99)), None);
        assert_eq!(
            found(
                noise(99)
                    .enumerate()
                    .map(|(row, value)| if row < 25 { value } else { 0.5 })
            ),
            Some((25, 74, false))
        );
        // Two that come three times each are not the resolution of the others.
        let resolved = noise(12).chain([1.0, 1.0 + 1e-6]);
        assert!(found(resolved.chain([0.5; MANY]).chain([0.7; MANY])).is_some());
        let cut = noise(99).map(|value| value.min(1.5));
        assert!(matches!(found(cut), Some((_, 8.., true))));
        let cut = noise(99).map(|value| value.clamp(-1.5, 1.5));
        assert!(matches!(found(cut), Some((_, 8.., true))));
    }

    #[test]
    fn what_is_typed_or_coarse_repeats_itself() {
        let levels =
            (0..99).map(|row| 60.0 * f64::from([0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0][row % 11]));
        assert_eq!(found(levels.clone()), None);
        // The lever of each pose differs by rounding.
        assert_eq!(
            found(
                levels
                    .enumerate()
                    .map(|(row, value)| value * (1.0 + float(row / 50) * 1e-15))
            ),
            None
        );
        for resolution in [0.01, 0.1, 0.5, 2.0] {
            assert_eq!(
                found(noise(999).map(|value| (value / resolution).round() * resolution)),
                None,
                "{resolution}"
            );
        }
    }

    #[test]
    fn a_copy_is_found_among_rows_that_resolve_their_noise() {
        for (resolution, copied) in [(1e-9, Some([20, 3])), (2.0, None)] {
            let random: Vec<f64> = noise(120)
                .map(|value| (value / resolution).round() * resolution)
                .collect();
            let mut rows: Vec<&[f64]> = random.chunks(4).collect();
            rows[20] = rows[3];
            let columns: Vec<Column> = (0..4)
                .map(|index| column(rows.iter().map(|row| row[index])))
                .collect();
            assert_eq!(copy(&columns), copied);
        }
    }
}
