//! The maths seam and small linear solves.
//!
//! Every root and every trigonometric function of core goes through this module: that is what makes a replay on a target
//! bit-equal to the host, and it is the one place where a prover may substitute a contract.
//! The solver is Gauss with row and column equilibration and partial pivoting, written without a panic path.

use core::fmt;
use core::mem;
use nalgebra::{Matrix3, Vector3};

/// Smallest ratio of pivots a solve accepts, after equilibration: beyond it fewer than four digits of a result would be left.
pub const SINGULAR_PIVOT_RATIO: f64 = 1e-12;

/// Longest rotation vector [`rotation_from_vector`] accepts, in radians; a longer one has lost its angle to rounding.
pub const MAX_ROTATION_RAD: f64 = 1e6;

/// Square of the angle below which the Taylor series of the rotation is exact to the last bit.
const SMALL_ANGLE_SQUARED: f64 = 1e-6;

/// Square root; NaN for negative arguments.
#[inline]
#[must_use]
#[expect(clippy::disallowed_methods, reason = "this is the seam")]
pub fn sqrt(x: f64) -> f64 {
    libm::sqrt(x)
}

/// Sine of an angle in radians.
#[inline]
#[must_use]
#[expect(clippy::disallowed_methods, reason = "this is the seam")]
pub fn sin(angle_rad: f64) -> f64 {
    libm::sin(angle_rad)
}

/// Cosine of an angle in radians.
#[inline]
#[must_use]
#[expect(clippy::disallowed_methods, reason = "this is the seam")]
pub fn cos(angle_rad: f64) -> f64 {
    libm::cos(angle_rad)
}

/// Sine and cosine of an angle in radians, computed together; cheaper than two calls.
#[inline]
#[must_use]
#[expect(clippy::disallowed_methods, reason = "this is the seam")]
pub fn sin_cos(angle_rad: f64) -> (f64, f64) {
    libm::sincos(angle_rad)
}

/// Euclidean length of a vector, in its unit.
#[inline]
#[must_use]
pub fn norm(v: &Vector3<f64>) -> f64 {
    sqrt(v.dot(v))
}

/// The max_propagating_nan of two; NaN where one is, which `f64::max` would drop: a residual that is not known is not small.
#[inline]
pub(crate) fn max_propagating_nan(one: f64, other: f64) -> f64 {
    if one > other || one.is_nan() { one } else { other }
}

/// The vector's direction; `None` when it has none (zero, not finite, or too small or large to square).
#[inline]
#[must_use]
pub fn unit(v: &Vector3<f64>) -> Option<Vector3<f64>> {
    let length = norm(v);
    // Written so that NaN fails it.
    (length > 0.0 && length < f64::INFINITY).then(|| v / length)
}

/// The matrix of the cross product: `cross_matrix(a) * b = a x b`.
#[inline]
#[must_use]
pub fn cross_matrix(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// `A v`, equal to nalgebra's product to the bit (NaN payloads apart). That product checks bounds, and an image optimised for size
/// keeps the check and its panic.
#[inline]
pub(crate) fn times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        a.m11 * v.x + a.m12 * v.y + a.m13 * v.z,
        a.m21 * v.x + a.m22 * v.y + a.m23 * v.z,
        a.m31 * v.x + a.m32 * v.y + a.m33 * v.z,
    )
}

/// `A B`, as [`times`].
#[inline]
pub(crate) fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let columns: [[f64; 3]; 3] = (*b).into();
    Matrix3::from(columns.map(|column| times(a, &Vector3::from(column)).into()))
}

/// Rotation about the direction of `vector` by its length in radians (Rodrigues' formula, the exponential of `vector x`).
///
/// `None` when the vector is not finite or longer than [`MAX_ROTATION_RAD`].
#[must_use]
pub fn rotation_from_vector(vector: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let squared = vector.dot(vector);
    // NaN is not within.
    let within = squared <= MAX_ROTATION_RAD * MAX_ROTATION_RAD;
    if !within {
        return None;
    }
    // sin(t) / t and (1 - cos(t)) / t^2; the latter over the half angle, which does not cancel.
    let (sine, cosine) = if squared < SMALL_ANGLE_SQUARED {
        (1.0 - squared / 6.0 * (1.0 - squared / 20.0), 0.5 - squared / 24.0 * (1.0 - squared / 30.0))
    } else {
        let angle = sqrt(squared);
        let half = sin(0.5 * angle);
        (sin(angle) / angle, 2.0 * half * half / squared)
    };
    let k = cross_matrix(vector);
    Some(Matrix3::identity() + k * sine + product(&k, &k) * cosine)
}

/// Largest deviation of `R^T R` from the identity; infinite when `R` det_is_negative or is not finite.
#[must_use]
pub fn rotation_deviation(rotation: &Matrix3<f64>) -> f64 {
    let mut deviation = 0.0_f64;
    for entry in (product(&rotation.transpose(), rotation) - Matrix3::identity()).iter() {
        if !entry.is_finite() {
            return f64::INFINITY;
        }
        deviation = deviation.max(entry.abs());
    }
    if rotation.determinant() > 0.0 { deviation } else { f64::INFINITY }
}

/// Error of a linear solve.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LinearError {
    /// The matrix holds a number that is not finite.
    NotFinite,
    /// The equilibrated matrix is singular, or too close to it.
    Singular {
        /// Smallest pivot over largest; [`SINGULAR_PIVOT_RATIO`] would have been accepted.
        ratio: f64,
    },
}

impl fmt::Display for LinearError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite => f.write_str("matrix is not finite"),
            Self::Singular { ratio } => write!(f, "matrix is singular: pivot ratio {ratio:e}"),
        }
    }
}

impl core::error::Error for LinearError {}

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

/// Triangular factors of a square matrix: factored once, solved many times, as it stands and transposed.
///
/// Columns and rows are scaled to a largest entry of 1 first, so that the measure of singularity
/// does not depend on the units of either.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lu<const N: usize> {
    rows: [Row<N>; N],
    columns: [f64; N],
    ratio: f64,
    /// True if the determinant is negative.
    det_is_negative: bool,
}

impl<const N: usize> Lu<N> {
    /// Factors the matrix, given by its rows.
    ///
    /// # Errors
    /// [`LinearError::NotFinite`], or [`LinearError::Singular`] below [`SINGULAR_PIVOT_RATIO`].
    pub fn factor(matrix: &[[f64; N]; N]) -> Result<Self, LinearError> {
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
                return Err(LinearError::NotFinite);
            }
            smallest = smallest.min(head.abs());
            largest = largest.max(head.abs());
            // Also true for a zero pivot, so that nothing below divides by it.
            if smallest <= SINGULAR_PIVOT_RATIO * largest {
                return Err(LinearError::Singular { ratio: if largest > 0.0 { smallest / largest } else { 0.0 } });
            }
            for row in below.iter_mut() {
                eliminate(k, head, pivot, row);
            }
            rest = below;
        }
        Ok(Self { rows, columns, ratio: smallest / largest, det_is_negative })
    }

    /// True if the determinant is negative; it is never zero.
    #[inline]
    #[must_use]
    pub const fn det_is_negative(&self) -> bool {
        self.det_is_negative
    }

    /// Smallest pivot over largest, 0 to 1: the measure of singularity.
    #[must_use]
    pub const fn pivot_ratio(&self) -> f64 {
        self.ratio
    }

    /// `x` of `A x = b`. Not finite only where `b` is not or the result overflows.
    #[must_use]
    pub fn solve(&self, b: &[f64; N]) -> [f64; N] {
        let mut x = [0.0; N];
        for (k, row) in self.rows.iter().enumerate() {
            let known: f64 = row.values.iter().zip(&x).take(k).map(|(l, y)| l * y).sum();
            put(&mut x, k, row.scale * at(b, row.source) - known);
        }
        for (k, row) in self.rows.iter().enumerate().rev() {
            let after = k.saturating_add(1);
            let known: f64 = (row.values.iter().zip(&x)).skip(after).map(|(u, y)| u * y).sum();
            let value = (at(&x, k) - known) / at(&row.values, k);
            put(&mut x, k, value);
        }
        for (value, scale) in x.iter_mut().zip(&self.columns) {
            *value *= scale;
        }
        x
    }

    /// `x` of `A^T x = b`, from the same factors.
    #[must_use]
    pub fn solve_transposed(&self, b: &[f64; N]) -> [f64; N] {
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
fn column_scales<const N: usize>(matrix: &[[f64; N]; N]) -> Result<[f64; N], LinearError> {
    let mut largest = [0.0_f64; N];
    for row in matrix {
        for (value, entry) in largest.iter_mut().zip(row) {
            if !entry.is_finite() {
                return Err(LinearError::NotFinite);
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
fn scaled_rows<const N: usize>(matrix: &[[f64; N]; N], columns: &[f64; N]) -> Result<[Row<N>; N], LinearError> {
    let mut rows = [Row { source: 0, scale: 1.0, values: [0.0; N] }; N];
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
fn inverse_scale(largest: f64) -> Result<f64, LinearError> {
    let scale = 1.0 / largest;
    if scale.is_finite() { Ok(scale) } else { Err(LinearError::Singular { ratio: 0.0 }) }
}

/// Swaps the row with the largest entry in column `k` into the pivot's place; returns true if it swapped.
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

/// Takes the multiple of the pivot row from `row` that clears its column `k`, and keeps the multiplier there.
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

/// Any numbers.
#[cfg(kani)]
pub(crate) fn any_vector() -> Vector3<f64> {
    Vector3::from(kani::any::<[f64; 3]>())
}

/// Three vectors of any numbers. Listed by hand: a prover would have to unwind a loop.
#[cfg(kani)]
pub(crate) fn any_three() -> [Vector3<f64>; 3] {
    [any_vector(), any_vector(), any_vector()]
}

/// Six vectors of any numbers.
#[cfg(kani)]
pub(crate) fn any_six() -> [Vector3<f64>; 6] {
    let ([a, b, c], [d, e, f]) = (any_three(), any_three());
    [a, b, c, d, e, f]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Any number, most of them of usual size.
    fn entry() -> impl Strategy<Value = f64> {
        prop_oneof![6 => -1e3..1e3_f64, 1 => prop::num::f64::ANY, 1 => Just(0.0), 1 => Just(-0.0)]
    }

    fn multiply<const N: usize>(a: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
        core::array::from_fn(|i| (0..N).map(|j| a[i][j] * x[j]).sum())
    }

    fn transpose<const N: usize>(a: &[[f64; N]; N]) -> [[f64; N]; N] {
        core::array::from_fn(|i| core::array::from_fn(|j| a[j][i]))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn products_are_nalgebras_to_the_bit(
            a in prop::array::uniform9(entry()),
            b in prop::array::uniform9(entry()),
        ) {
            let (a, b) = (Matrix3::from_row_slice(&a), Matrix3::from_row_slice(&b));
            // The payload of a NaN is not specified.
            let bits = |x: f64| if x.is_nan() { None } else { Some(x.to_bits()) };
            prop_assert_eq!(product(&a, &b).map(bits), (a * b).map(bits));
            prop_assert_eq!(product(&a.transpose(), &b).map(bits), a.tr_mul(&b).map(bits));
            let v = b.column(1).into_owned();
            prop_assert_eq!(times(&a, &v).map(bits), (a * v).map(bits));
        }

        #[test]
        fn solves_both_ways_in_any_units(
            a in prop::array::uniform6(prop::array::uniform6(-1.0..1.0_f64)),
            x in prop::array::uniform6(-1.0..1.0_f64),
            row_units in prop::array::uniform6(-9..9_i32),
        ) {
            let mut scaled = a;
            for (row, unit) in scaled.iter_mut().zip(row_units) {
                for value in row {
                    *value *= 10.0_f64.powi(unit);
                }
            }
            let Ok(lu) = Lu::factor(&scaled) else { return Ok(()); };
            let tolerance = 1e-13 / lu.pivot_ratio();
            for (got, want) in lu.solve(&multiply(&scaled, &x)).iter().zip(x) {
                prop_assert!((got - want).abs() <= tolerance, "{got} {want}");
            }
            // The unknowns of the transposed system carry the rows' units, inverted.
            let mut y = x;
            for (value, unit) in y.iter_mut().zip(row_units) {
                *value *= 10.0_f64.powi(0_i32.saturating_sub(unit));
            }
            let got = lu.solve_transposed(&multiply(&transpose(&scaled), &y));
            for ((got, want), unit) in got.iter().zip(y).zip(row_units) {
                prop_assert!((got - want).abs() * 10.0_f64.powi(unit) <= tolerance, "{got} {want}");
            }
        }

        #[test]
        fn rotations_are_rotations(v in prop::array::uniform3(-4.0..4.0_f64), scale in -9..1_i32) {
            let v = Vector3::from(v) * 10.0_f64.powi(scale);
            let r = rotation_from_vector(&v).unwrap();
            prop_assert!(rotation_deviation(&r) < 1e-13);
            prop_assert!(norm(&(r * v - v)) <= 1e-14 * norm(&v));
            let peer = nalgebra::Rotation3::new(v);
            prop_assert!((r - peer.matrix()).amax() < 1e-14);
        }
    }

    #[test]
    fn singular_matrices_are_refused_whatever_their_scale() {
        for scale in [1e-200, 1e-9, 1.0, 1e9, 1e200] {
            let s = scale;
            let dependent = [[s, 2.0 * s, 3.0 * s], [4.0 * s, 5.0 * s, 6.0 * s], [7.0 * s, 8.0 * s, 9.0 * s]];
            assert!(matches!(Lu::factor(&dependent), Err(LinearError::Singular { .. })));
            let regular = [[0.0, s, 0.0], [s, 0.0, 0.0], [0.0, 0.0, s]];
            assert!(Lu::factor(&regular).is_ok());
        }
        assert_eq!(Lu::factor(&[[0.0; 3]; 3]), Err(LinearError::Singular { ratio: 0.0 }));
        assert_eq!(Lu::factor(&[[f64::NAN]]), Err(LinearError::NotFinite));
        assert_eq!(Lu::factor(&[[f64::INFINITY]]), Err(LinearError::NotFinite));
    }

    #[test]
    fn the_maximum_keeps_nan() {
        assert_eq!((max_propagating_nan(1.0, 2.0), max_propagating_nan(2.0, 1.0)), (2.0, 2.0));
        assert!(max_propagating_nan(f64::NAN, 1.0).is_nan() && max_propagating_nan(1.0, f64::NAN).is_nan());
    }

    #[test]
    fn directions_and_rotations_refuse_what_has_none() {
        assert_eq!(unit(&Vector3::zeros()), None);
        assert_eq!(unit(&Vector3::new(f64::NAN, 0.0, 0.0)), None);
        assert_eq!(unit(&Vector3::new(f64::INFINITY, 0.0, 0.0)), None);
        assert_eq!(unit(&Vector3::new(0.0, -2.0, 0.0)), Some(-Vector3::y()));
        assert_eq!(rotation_from_vector(&Vector3::new(f64::NAN, 0.0, 0.0)), None);
        assert_eq!(rotation_from_vector(&Vector3::new(1e7, 0.0, 0.0)), None);
        assert_eq!(rotation_from_vector(&Vector3::zeros()), Some(Matrix3::identity()));
        assert!(rotation_deviation(&-Matrix3::<f64>::identity()).is_infinite());
    }
}
