//! Linear solves of any small system: Gauss with row and column equilibration and partial pivoting,
//! written without a panic path.

use core::mem;

use crate::model::kinematics::{KinematicsError, SINGULAR_PIVOT_RATIO};

/// Row of the factors.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Row<const N: usize> {
    /// Index of this row in the matrix that was given.
    source: usize,
    /// Factor that the row was multiplied by.
    scale: f64,
    /// `L` below the diagonal (its diagonal is 1), `U` on and above it.
    values: [f64; N],
}

/// Triangular factors of a square matrix: factored once, solved many times, as it stands and
/// transposed.
///
/// Columns, then rows, are scaled to a largest entry of 1 first, so that the measure of singularity
/// does not depend on the units of the columns (metres and radians). It may depend on those of the
/// rows, which are all in metres here.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Lu<const N: usize> {
    rows: [Row<N>; N],
    columns: [f64; N],
    /// True if the determinant is negative; it is never zero.
    det_is_negative: bool,
}

impl<const N: usize> Lu<N> {
    /// Factors the matrix, given by its rows.
    ///
    /// # Errors
    /// [`KinematicsError::NotFinite`], or [`KinematicsError::Singular`] with the ratio of the
    /// pivots, up to [`SINGULAR_PIVOT_RATIO`].
    pub(crate) fn factor(matrix: &[[f64; N]; N]) -> Result<Self, KinematicsError> {
        let columns = column_scales(matrix)?;
        let mut rows = scaled_rows(matrix, &columns)?;
        let mut smallest = f64::INFINITY;
        let mut largest = 0.0_f64;
        let mut det_is_negative = false;
        let mut rest = rows.as_mut_slice();
        for k in 0..N {
            let Some((pivot, below)) = mem::take(&mut rest).split_first_mut() else {
                break;
            };
            det_is_negative ^= bring_up_largest(k, pivot, below);
            let head = at(&pivot.values, k);
            det_is_negative ^= head < 0.0;
            if !head.is_finite() {
                return Err(KinematicsError::NotFinite);
            }
            smallest = smallest.min(head.abs());
            largest = largest.max(head.abs());
            // Also true for a zero pivot, so that nothing below divides by it.
            if smallest <= SINGULAR_PIVOT_RATIO * largest {
                return Err(KinematicsError::Singular {
                    measure: if largest > 0.0 {
                        smallest / largest
                    } else {
                        0.0
                    },
                });
            }
            for row in below.iter_mut() {
                eliminate(k, head, pivot, row);
            }
            rest = below;
        }
        Ok(Self {
            rows,
            columns,
            det_is_negative,
        })
    }

    #[inline]
    pub(crate) const fn det_is_negative(&self) -> bool {
        self.det_is_negative
    }

    /// `x` of `A x = b`. Not finite only where `b` is not or the result overflows.
    pub(crate) fn solve(&self, b: &[f64; N]) -> [f64; N] {
        let mut x = [0.0; N];
        for (k, row) in self.rows.iter().enumerate() {
            let known: f64 = row.values.iter().zip(&x).take(k).map(|(l, y)| l * y).sum();
            put(&mut x, k, row.scale * at(b, row.source) - known);
        }
        for (k, row) in self.rows.iter().enumerate().rev() {
            let after = k.saturating_add(1);
            let known: f64 = (row.values.iter().zip(&x))
                .skip(after)
                .map(|(u, y)| u * y)
                .sum();
            let value = (at(&x, k) - known) / at(&row.values, k);
            put(&mut x, k, value);
        }
        for (value, scale) in x.iter_mut().zip(&self.columns) {
            *value *= scale;
        }
        x
    }

    /// `x` of `A^T x = b`, from the same factors.
    pub(crate) fn solve_transposed(&self, b: &[f64; N]) -> [f64; N] {
        let mut y = *b;
        for (value, scale) in y.iter_mut().zip(&self.columns) {
            *value *= scale;
        }
        for (k, row) in self.rows.iter().enumerate() {
            let known = at(&y, k) / at(&row.values, k);
            put(&mut y, k, known);
            let after = k.saturating_add(1);
            for (value, u) in y.iter_mut().zip(&row.values).skip(after) {
                *value -= u * known;
            }
        }
        for (k, row) in self.rows.iter().enumerate().rev() {
            let known = at(&y, k);
            for (value, l) in y.iter_mut().zip(&row.values).take(k) {
                *value -= l * known;
            }
        }
        let mut x = [0.0; N];
        for (value, row) in y.iter().zip(&self.rows) {
            put(&mut x, row.source, row.scale * value);
        }
        x
    }
}

/// One over the largest magnitude of each column.
fn column_scales<const N: usize>(matrix: &[[f64; N]; N]) -> Result<[f64; N], KinematicsError> {
    let mut largest = [0.0_f64; N];
    for row in matrix {
        for (value, entry) in largest.iter_mut().zip(row) {
            if !entry.is_finite() {
                return Err(KinematicsError::NotFinite);
            }
            *value = value.max(entry.abs());
        }
    }
    for value in &mut largest {
        *value = inverse_scale(*value)?;
    }
    Ok(largest)
}

/// The rows with their columns scaled, then each scaled itself.
fn scaled_rows<const N: usize>(
    matrix: &[[f64; N]; N],
    columns: &[f64; N],
) -> Result<[Row<N>; N], KinematicsError> {
    let mut rows = [Row {
        source: 0,
        scale: 1.0,
        values: [0.0; N],
    }; N];
    for ((index, row), given) in rows.iter_mut().enumerate().zip(matrix) {
        row.source = index;
        let mut largest = 0.0_f64;
        for ((value, entry), column) in row.values.iter_mut().zip(given).zip(columns) {
            *value = entry * column;
            largest = largest.max(value.abs());
        }
        row.scale = inverse_scale(largest)?;
        for value in &mut row.values {
            *value *= row.scale;
        }
    }
    Ok(rows)
}

/// One over a magnitude; a row or column of zeros makes the matrix singular.
fn inverse_scale(largest: f64) -> Result<f64, KinematicsError> {
    let scale = 1.0 / largest;
    if scale.is_finite() {
        Ok(scale)
    } else {
        Err(KinematicsError::Singular { measure: 0.0 })
    }
}

/// Swaps the row with the largest entry in column `k` into the pivot's place; returns true if it
/// swapped.
fn bring_up_largest<const N: usize>(k: usize, pivot: &mut Row<N>, below: &mut [Row<N>]) -> bool {
    let mut largest = at(&pivot.values, k).abs();
    let mut chosen = None;
    for (index, row) in below.iter().enumerate() {
        let candidate = at(&row.values, k).abs();
        if candidate > largest {
            largest = candidate;
            chosen = Some(index);
        }
    }
    let row = chosen.and_then(|index| below.get_mut(index));
    let found = row.is_some();
    if let Some(row) = row {
        mem::swap(pivot, row);
    }
    found
}

/// Takes the multiple of the pivot row from `row` that clears its column `k`, and keeps the
/// multiplier there.
fn eliminate<const N: usize>(k: usize, head: f64, pivot: &Row<N>, row: &mut Row<N>) {
    let multiplier = at(&row.values, k) / head;
    let after = k.saturating_add(1);
    for (value, p) in row.values.iter_mut().zip(&pivot.values).skip(after) {
        *value -= multiplier * p;
    }
    put(&mut row.values, k, multiplier);
}

/// Entry `k`; every caller's `k` is below `N`, and the compiler need not know.
#[inline]
fn at<const N: usize>(values: &[f64; N], k: usize) -> f64 {
    values.get(k).copied().unwrap_or(0.0)
}

/// Writes entry `k`.
#[inline]
fn put<const N: usize>(values: &mut [f64; N], k: usize, value: f64) {
    if let Some(entry) = values.get_mut(k) {
        *entry = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::array::uniform6;
    use proptest::prelude::*;

    fn transpose(a: [[f64; 6]; 6]) -> [[f64; 6]; 6] {
        std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
    }

    /// `(|L| |U|)` of the matrix that was factored, its rows as they were given, in its units.
    ///
    /// The rounding of a solve is bounded by it (Higham, "Accuracy and Stability of Numerical
    /// Algorithms", theorem 9.4), and not by the matrix itself: a row whose largest entry is alone
    /// in its column may lose digits of its others.
    fn magnitudes(lu: &Lu<6>) -> [[f64; 6]; 6] {
        let mut magnitudes = [[0.0; 6]; 6];
        for (k, row) in lu.rows.iter().enumerate() {
            for (j, column) in lu.columns.iter().enumerate() {
                let scaled = (0..=k.min(j))
                    .map(|i| {
                        let lower = if i == k { 1.0 } else { row.values[i].abs() };
                        lower * lu.rows[i].values[j].abs()
                    })
                    .sum::<f64>();
                magnitudes[row.source][j] = scaled / (row.scale * column);
            }
        }
        magnitudes
    }

    /// Requires `a x = b`, each row to rounding.
    fn holds(a: &[[f64; 6]; 6], magnitudes: &[[f64; 6]; 6], x: &[f64; 6], b: &[f64; 6]) {
        for ((row, magnitudes), b) in a.iter().zip(magnitudes).zip(b) {
            let allowed = magnitudes
                .iter()
                .zip(x)
                .map(|(a, x)| a * x.abs())
                .sum::<f64>()
                + b.abs();
            let error = row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>() - b;
            // 3 n = 18 roundings of the solve, 6 of the scales, 8 of this sum, each half an
            // epsilon.
            assert!(
                error.abs() <= 16.0 * f64::EPSILON * allowed,
                "{error:e} {allowed:e}"
            );
        }
    }

    /// The pivots are 1, 2 and `e`.
    #[test]
    fn a_matrix_is_singular_by_the_ratio_of_its_pivots() {
        for (e, is_singular) in [
            (1.5 * SINGULAR_PIVOT_RATIO, true),
            (2.5 * SINGULAR_PIVOT_RATIO, false),
        ] {
            let rows = [[1.0, 1.0, 1.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 1.0 + e]];
            match Lu::factor(&rows) {
                Ok(_) => assert!(!is_singular, "{e}"),
                Err(KinematicsError::Singular { measure }) => {
                    assert!(
                        is_singular && (measure / (0.5 * e) - 1.0).abs() < 1e-3,
                        "{e}"
                    );
                }
                Err(error) => panic!("{error}"),
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn solves_both_ways_in_any_units(
            a in uniform6(uniform6(-1.0..1.0_f64)), b in uniform6(-1.0..1.0_f64), units in uniform6(-9..9_i32),
        ) {
            let units = units.map(|unit| 10.0_f64.powi(unit));
            let scaled = std::array::from_fn(|i| a[i].map(|value| value * units[i]));
            let Ok(lu) = Lu::factor(&scaled) else { return Ok(()); };
            // Partial pivoting, without which the magnitudes have no bound.
            prop_assert!(lu.rows.iter().enumerate().all(|(k, row)| row.values.iter().take(k).all(|l| l.abs() <= 1.0)));
            let right = std::array::from_fn(|i| b[i] * units[i]);
            let magnitudes = magnitudes(&lu);
            holds(&scaled, &magnitudes, &lu.solve(&right), &right);
            holds(&transpose(scaled), &transpose(magnitudes), &lu.solve_transposed(&b), &b);
        }
    }

    #[test]
    fn singular_matrices_are_refused_whatever_their_scale() {
        for scale in [1e-200, 1e-9, 1.0, 1e9, 1e200] {
            let s = scale;
            let dependent = [
                [s, 2.0 * s, 3.0 * s],
                [4.0 * s, 5.0 * s, 6.0 * s],
                [7.0 * s, 8.0 * s, 9.0 * s],
            ];
            assert!(matches!(
                Lu::factor(&dependent),
                Err(KinematicsError::Singular { .. })
            ));
            let regular = [[0.0, s, 0.0], [s, 0.0, 0.0], [0.0, 0.0, s]];
            assert!(Lu::factor(&regular).is_ok());
        }
        assert_eq!(
            Lu::factor(&[[0.0; 3]; 3]),
            Err(KinematicsError::Singular { measure: 0.0 })
        );
        assert_eq!(Lu::factor(&[[f64::NAN]]), Err(KinematicsError::NotFinite));
        assert_eq!(
            Lu::factor(&[[f64::INFINITY]]),
            Err(KinematicsError::NotFinite)
        );
    }
}
