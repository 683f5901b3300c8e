//! The maths seam, and rotations.
//!
//! Every root and every trigonometric function of core goes through this module: that is what makes
//! a replay on a target bit-equal to the host, and it is the one place where a prover may
//! substitute a contract.

use nalgebra::{Matrix3, Vector3};

/// Longest rotation vector [`rotation_from_vector`] accepts, in radians; a longer one has lost its
/// angle to rounding.
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

/// Tangent of an angle in radians.
#[inline]
#[must_use]
pub fn tan(angle_rad: f64) -> f64 {
    libm::tan(angle_rad)
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

/// The larger of two; NaN where one is, which `f64::max` would drop: a residual that is not known
/// is not small.
#[inline]
pub(crate) fn max_propagating_nan(one: f64, other: f64) -> f64 {
    if one > other || one.is_nan() {
        one
    } else {
        other
    }
}

/// True if every number is finite: zero times one is zero, and times any other NaN. Adding up costs
/// less than looking at each.
#[inline]
pub(crate) fn are_finite(values: &[f64]) -> bool {
    values.iter().fold(0.0, |sum, value| sum + value * 0.0) == 0.0
}

/// The vector's direction; `None` when it has none (zero, not finite, or too small or large to
/// square).
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

/// `A v`, equal to nalgebra's product to the bit (NaN payloads apart). That product checks bounds,
/// and an image optimised for size keeps the check and its panic.
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

/// Rotation about the direction of `vector` by its length in radians (Rodrigues' formula, the
/// exponential of `vector x`).
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
        (
            1.0 - squared / 6.0 * (1.0 - squared / 20.0),
            0.5 - squared / 24.0 * (1.0 - squared / 30.0),
        )
    } else {
        let angle = sqrt(squared);
        let half = sin(0.5 * angle);
        (sin(angle) / angle, 2.0 * half * half / squared)
    };
    // K = vector x, and K^2 = vector vector^T - squared I, which is symmetric.
    let (k, scaled) = (vector * sine, vector * cosine);
    let (xy, yz, zx) = (
        vector.x * scaled.y,
        vector.y * scaled.z,
        vector.z * scaled.x,
    );
    let (xx, yy, zz) = (
        vector.x * scaled.x,
        vector.y * scaled.y,
        vector.z * scaled.z,
    );
    Some(Matrix3::new(
        1.0 - (yy + zz),
        xy - k.z,
        zx + k.y,
        xy + k.z,
        1.0 - (zz + xx),
        yz - k.x,
        zx - k.y,
        yz + k.x,
        1.0 - (xx + yy),
    ))
}

/// Largest deviation of `R^T R` from the identity; infinite when `R` mirrors or is not finite.
#[must_use]
pub fn rotation_deviation(rotation: &Matrix3<f64>) -> f64 {
    let [x, y, z] = <[[f64; 3]; 3]>::from(*rotation).map(Vector3::from);
    // R^T R is symmetric: six entries are all.
    let deviations = [
        x.dot(&x) - 1.0,
        y.dot(&y) - 1.0,
        z.dot(&z) - 1.0,
        x.dot(&y),
        y.dot(&z),
        z.dot(&x),
    ];
    if !are_finite(&deviations) || x.cross(&y).dot(&z) <= 0.0 {
        return f64::INFINITY;
    }
    deviations
        .iter()
        .fold(0.0, |most, deviation| most.max(deviation.abs()))
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
    let [a, b, c] = any_three();
    let [d, e, f] = any_three();
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

    /// Bits of a number; `None` for NaN, whose payload is not specified.
    fn bits(x: f64) -> Option<u64> {
        (!x.is_nan()).then(|| x.to_bits())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn products_are_nalgebras_to_the_bit(
            a in prop::array::uniform9(entry()),
            b in prop::array::uniform9(entry()),
        ) {
            let (a, b) = (Matrix3::from_row_slice(&a), Matrix3::from_row_slice(&b));
            prop_assert_eq!(product(&a, &b).map(bits), (a * b).map(bits));
            prop_assert_eq!(product(&a.transpose(), &b).map(bits), a.tr_mul(&b).map(bits));
            let v = b.column(1).into_owned();
            prop_assert_eq!(times(&a, &v).map(bits), (a * v).map(bits));
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

    /// Its series, at the largest angle that takes it, leaves rounding only; so does the other form.
    #[test]
    fn small_rotations_are_as_exact_as_large_ones() {
        for share in [0.999_999, 1.000_001] {
            let angle = sqrt(SMALL_ANGLE_SQUARED) * share;
            let rotation = rotation_from_vector(&Vector3::new(0.0, 0.0, angle)).unwrap();
            assert!((rotation.m21 / sin(angle) - 1.0).abs() < 1e-14);
            let versed = 2.0 * sin(0.5 * angle).powi(2);
            assert!((rotation.m11 + versed - 1.0).abs() < 2e-16);
        }
    }

    #[test]
    fn a_cross_product_has_its_matrix() {
        let (a, b) = (Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.5, 7.0, -4.0));
        assert_eq!(cross_matrix(&a) * b, a.cross(&b));
    }

    #[test]
    fn the_maximum_keeps_nan() {
        assert_eq!(
            (max_propagating_nan(1.0, 2.0), max_propagating_nan(2.0, 1.0)),
            (2.0, 2.0)
        );
        assert!(
            max_propagating_nan(f64::NAN, 1.0).is_nan()
                && max_propagating_nan(1.0, f64::NAN).is_nan()
        );
    }

    #[test]
    fn directions_and_rotations_refuse_what_has_none() {
        assert_eq!(unit(&Vector3::zeros()), None);
        assert_eq!(unit(&Vector3::new(f64::NAN, 0.0, 0.0)), None);
        assert_eq!(unit(&Vector3::new(f64::INFINITY, 0.0, 0.0)), None);
        assert_eq!(unit(&Vector3::new(0.0, -2.0, 0.0)), Some(-Vector3::y()));
        assert_eq!(
            rotation_from_vector(&Vector3::new(f64::NAN, 0.0, 0.0)),
            None
        );
        assert_eq!(rotation_from_vector(&Vector3::new(1e7, 0.0, 0.0)), None);
        assert_eq!(
            rotation_from_vector(&Vector3::zeros()),
            Some(Matrix3::identity())
        );
        assert!(rotation_deviation(&-Matrix3::<f64>::identity()).is_infinite());
    }
}
