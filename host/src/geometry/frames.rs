//! Rigid motions between a device's frame and the robot's.

use nalgebra::{Isometry3, Matrix3, Matrix4, Quaternion, SymmetricEigen, Translation3, UnitQuaternion, Vector3};

use crate::fit::statistics::{float, median};

/// Returns the motion `H` with the smallest sum of squares of `to - H from`; `None` for fewer than three pairs.
///
/// The rotation is the eigenvector of the largest eigenvalue of a symmetric 4 x 4 matrix (B. K. P. Horn, "Closed-form solution of absolute
/// orientation using unit quaternions", 1987).
#[must_use]
pub fn rigid(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Isometry3<f64>> {
    if pairs.len() < 3 {
        return None;
    }
    let count = float(pairs.len());
    let from_mean = pairs.iter().map(|(from, _)| from).sum::<Vector3<f64>>() / count;
    let to_mean = pairs.iter().map(|(_, to)| to).sum::<Vector3<f64>>() / count;
    let m: Matrix3<f64> = pairs.iter().map(|(from, to)| (from - from_mean) * (to - to_mean).transpose()).sum();
    #[rustfmt::skip]
    let horn = Matrix4::new(
        m[(0, 0)] + m[(1, 1)] + m[(2, 2)], m[(1, 2)] - m[(2, 1)], m[(2, 0)] - m[(0, 2)], m[(0, 1)] - m[(1, 0)],
        m[(1, 2)] - m[(2, 1)], m[(0, 0)] - m[(1, 1)] - m[(2, 2)], m[(0, 1)] + m[(1, 0)], m[(2, 0)] + m[(0, 2)],
        m[(2, 0)] - m[(0, 2)], m[(0, 1)] + m[(1, 0)], m[(1, 1)] - m[(0, 0)] - m[(2, 2)], m[(1, 2)] + m[(2, 1)],
        m[(0, 1)] - m[(1, 0)], m[(2, 0)] + m[(0, 2)], m[(1, 2)] + m[(2, 1)], m[(2, 2)] - m[(0, 0)] - m[(1, 1)],
    );
    if !horn.iter().all(|entry| entry.is_finite()) {
        return None;
    }
    let eigen = SymmetricEigen::new(horn);
    let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(axis[0], axis[1], axis[2], axis[3]));
    Some(Isometry3::from_parts(Translation3::from(to_mean - rotation * from_mean), rotation))
}

/// As [`rigid`], of the pairs that agree: those further away than three times the median distance are left out, until nothing changes.
#[must_use]
pub fn rigid_trimmed(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Isometry3<f64>> {
    let mut motion = rigid(pairs)?;
    for _ in 0..10 {
        let distance = |(from, to): &(Vector3<f64>, Vector3<f64>)| (to - apply(&motion, from)).norm();
        let limit = 3.0 * median(pairs.iter().map(distance).collect());
        let agreeing: Vec<_> = pairs.iter().filter(|pair| distance(pair) <= limit).copied().collect();
        let next = rigid(&agreeing)?;
        let settled = (next.to_homogeneous() - motion.to_homogeneous()).amax() < 1e-12;
        motion = next;
        if settled {
            break;
        }
    }
    Some(motion)
}

/// Returns the rotation vector of a rotation by less than half a turn, small ones to the last digit (unlike the arc cosine of the trace).
#[must_use]
pub fn rotation_vector(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let r = rotation;
    let skew = Vector3::new(r.m32 - r.m23, r.m13 - r.m31, r.m21 - r.m12) / 2.0;
    let (sine, cosine) = (skew.norm(), (r.trace() - 1.0) / 2.0);
    // The limit of angle / sine is 1.
    if sine > 0.0 { skew * (sine.atan2(cosine) / sine) } else { skew }
}

/// Returns where a motion takes a place.
#[must_use]
pub fn apply(motion: &Isometry3<f64>, place: &Vector3<f64>) -> Vector3<f64> {
    motion.rotation * place + motion.translation.vector
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> Vec<Vector3<f64>> {
        (0..20_u8)
            .map(f64::from)
            .map(|k| Vector3::new((k * 1.7).sin(), (k * 2.9).cos(), (k * 0.7).sin() * 0.5))
            .collect()
    }

    #[test]
    fn a_motion_is_found_exactly_and_despite_wrong_pairs() {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(2.0, -1.5, 0.7));
        let motion = Isometry3::from_parts(Translation3::new(3.0, -2.0, 7.0), rotation);
        let mut pairs: Vec<_> = cloud().into_iter().map(|place| (place, apply(&motion, &place))).collect();
        let off = |found: Isometry3<f64>| (found.to_homogeneous() - motion.to_homogeneous()).amax();
        assert!(off(rigid(&pairs).unwrap()) < 1e-13);
        for wrong in [3, 11, 17] {
            pairs[wrong].1.x += 0.4;
        }
        assert!(off(rigid(&pairs).unwrap()) > 1e-3);
        assert!(off(rigid_trimmed(&pairs).unwrap()) < 1e-9);
        assert!(rigid(&pairs[..2]).is_none());
    }
}
