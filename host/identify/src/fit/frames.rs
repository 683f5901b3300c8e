//! Rigid motions between a device's frame and the robot's.

use std::convert::Infallible;

use gantry_tau_core::model::linalg::cross_matrix;
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Matrix4, Quaternion, SymmetricEigen, Translation3,
    UnitQuaternion, Vector3,
};

use crate::fit::least_squares::{Rows, fit};
use crate::fit::statistics::{float, median};

/// Lever by which a turn counts beside a place, m; also that of the noise of rotations where none
/// is stated.
pub(crate) const LEVER_M: f64 = 0.5;

/// Returns the motion `H` with the smallest sum of squares of `to - H from`; `None` for fewer than
/// three pairs.
///
/// The rotation is the eigenvector of the largest eigenvalue of a symmetric 4 x 4 matrix (B. K. P.
/// Horn, "Closed-form solution of absolute orientation using unit quaternions", 1987).
#[must_use]
pub fn rigid(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Isometry3<f64>> {
    if pairs.len() < 3 {
        return None;
    }
    let count = float(pairs.len());
    let from_mean = pairs.iter().map(|(from, _)| from).sum::<Vector3<f64>>() / count;
    let to_mean = pairs.iter().map(|(_, to)| to).sum::<Vector3<f64>>() / count;
    let m: Matrix3<f64> = pairs
        .iter()
        .map(|(from, to)| (from - from_mean) * (to - to_mean).transpose())
        .sum();
    // tr M, d^T
    // d,    M + M^T - tr M
    let d = Vector3::new(
        m[(1, 2)] - m[(2, 1)],
        m[(2, 0)] - m[(0, 2)],
        m[(0, 1)] - m[(1, 0)],
    );
    let mut horn = Matrix4::from_element(m.trace());
    horn.fixed_view_mut::<3, 1>(1, 0).copy_from(&d);
    horn.fixed_view_mut::<1, 3>(0, 1).tr_copy_from(&d);
    horn.fixed_view_mut::<3, 3>(1, 1)
        .copy_from(&(m + m.transpose() - Matrix3::identity() * m.trace()));
    if !horn.iter().all(|entry| entry.is_finite()) {
        return None;
    }
    let eigen = SymmetricEigen::new(horn);
    let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    let rotation =
        UnitQuaternion::new_normalize(Quaternion::new(axis[0], axis[1], axis[2], axis[3]));
    Some(Isometry3::from_parts(
        Translation3::from(to_mean - rotation * from_mean),
        rotation,
    ))
}

/// As [`rigid`], of the pairs that agree: those further away than three times the median distance
/// are left out, until nothing changes. Begun from the motion of all or of a few of them, of which
/// the median is smallest: a pair may be wrong by kilometres.
#[must_use]
pub fn rigid_trimmed(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Isometry3<f64>> {
    let parts = pairs.len() / FEW;
    let of_parts = (0..parts).filter_map(|first| {
        let part: Vec<_> = pairs.iter().skip(first).step_by(parts).copied().collect();
        rigid(&part)
    });
    let motions = std::iter::once(rigid(pairs)?).chain(of_parts);
    let mut motion =
        motions.min_by(|one, other| median_m(pairs, one).total_cmp(&median_m(pairs, other)))?;
    for _ in 0..10 {
        let limit = 3.0 * median_m(pairs, &motion);
        let agreeing: Vec<_> = pairs
            .iter()
            .filter(|pair| distance_m(pair, &motion) <= limit)
            .copied()
            .collect();
        let next = rigid(&agreeing)?;
        let settled = (next.to_homogeneous() - motion.to_homogeneous()).amax() < 1e-12;
        motion = next;
        if settled {
            break;
        }
    }
    Some(motion)
}

/// Indices of the pairs that a motion brings together, at most three times as far apart as the
/// median; all of them without a motion.
#[must_use]
pub fn near(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Vec<usize> {
    let Some(motion) = rigid_trimmed(pairs) else {
        return (0..pairs.len()).collect();
    };
    let limit = 3.0 * median_m(pairs, &motion);
    (0..pairs.len())
        .filter(|index| distance_m(&pairs[*index], &motion) <= limit)
        .collect()
}

/// Distance that a motion leaves in a pair, m.
fn distance_m((from, to): &(Vector3<f64>, Vector3<f64>), motion: &Isometry3<f64>) -> f64 {
    (to - apply(motion, from)).norm()
}

fn median_m(pairs: &[(Vector3<f64>, Vector3<f64>)], motion: &Isometry3<f64>) -> f64 {
    median(pairs.iter().map(|pair| distance_m(pair, motion)).collect())
}

/// Pairs of a part that a motion begins from.
const FEW: usize = 4;

/// Numbers of the target's place among the twelve of the frames: device (place, turn), target
/// (place, turn).
const TARGET_PLACE: std::ops::Range<usize> = 6..9;

/// The robot's frame in the device's, and the target on the platform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frames {
    /// Takes a place of the robot's frame to the device's.
    pub device: Isometry3<f64>,
    /// The target's centre and axes in those of the platform.
    pub target: Isometry3<f64>,
}

impl Frames {
    /// The same frame, and the target at the tool centre point.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            device: Isometry3::identity(),
            target: Isometry3::identity(),
        }
    }

    /// Returns the frames with the smallest sum of squares of what is left between
    /// `device pose target` and the measured pose: `pairs` are poses of the robot's model and
    /// measured ones. A radian counts as a metre. The target's centre on the platform is
    /// `target_m`, or fitted along where absent. `None` where the frames do not follow from the
    /// poses.
    #[must_use]
    pub fn fitted(
        pairs: &[(Isometry3<f64>, Isometry3<f64>)],
        target_m: Option<Vector3<f64>>,
    ) -> Option<Self> {
        let centre = target_m.unwrap_or_else(Vector3::zeros);
        let places: Vec<_> = pairs
            .iter()
            .map(|(pose, seen)| (apply(pose, &centre), seen.translation.vector))
            .collect();
        let device = rigid_trimmed(&places)?;
        // Of the target the first pose has an opinion; the fit hears the others.
        let (pose, seen) = pairs.first()?;
        let target = (device * pose).rotation.inverse() * seen.rotation;
        let start = Self {
            device,
            target: Isometry3::from_parts(Translation3::from(centre), target),
        };
        let free: Vec<usize> = (0..12)
            .filter(|number| target_m.is_none() || !TARGET_PLACE.contains(number))
            .collect();
        let scales = DVector::repeat(free.len(), 1.0);
        let found = fit(
            start,
            &scales,
            |frames| frames.free_rows(pairs, &free),
            |frames, step| frames.freely_stepped(&free, step),
        )
        .ok()?;
        (found.seen.kept() == free.len()).then_some(found.state)
    }

    /// Rows for the numbers that are free.
    fn free_rows(
        &self,
        pairs: &[(Isometry3<f64>, Isometry3<f64>)],
        free: &[usize],
    ) -> Result<Rows, Infallible> {
        let Rows {
            residuals,
            derivatives,
        } = self.rows(pairs);
        Ok(Rows::new(residuals, derivatives.select_columns(free)))
    }

    /// The frames after a step of the numbers that are free.
    fn freely_stepped(&self, free: &[usize], step: &DVector<f64>) -> Self {
        let mut whole = DVector::zeros(12);
        free.iter()
            .zip(step)
            .for_each(|(number, value)| whole[*number] = *value);
        self.stepped(&whole)
    }

    fn rows(&self, pairs: &[(Isometry3<f64>, Isometry3<f64>)]) -> Rows {
        let mut residuals = DVector::zeros(6 * pairs.len());
        let mut derivatives = DMatrix::zeros(6 * pairs.len(), 12);
        for (row, (pose, seen)) in pairs.iter().enumerate() {
            let predicted = self.device * pose * self.target;
            let turned = predicted.rotation.to_rotation_matrix().into_inner();
            let left = seen.rotation.to_rotation_matrix().into_inner() * turned.transpose();
            residuals
                .fixed_rows_mut::<3>(6 * row)
                .copy_from(&(seen.translation.vector - predicted.translation.vector));
            residuals
                .fixed_rows_mut::<3>(6 * row + 3)
                .copy_from(&rotation_vector(&left));
            let mut block = derivatives.view_mut((6 * row, 0), (6, 12));
            block.view_mut((0, 0), (3, 3)).fill_with_identity();
            block
                .view_mut((0, 3), (3, 3))
                .copy_from(&-cross_matrix(&predicted.translation.vector));
            block.view_mut((3, 3), (3, 3)).fill_with_identity();
            block.view_mut((0, 6), (3, 3)).copy_from(&turned);
            block.view_mut((3, 9), (3, 3)).copy_from(&turned);
        }
        // A standard deviation of the rows is a thousandth of a metre.
        Rows::new(residuals * 1e3, derivatives * 1e3)
    }

    fn stepped(&self, step: &DVector<f64>) -> Self {
        Self {
            device: motion_of(step, 0) * self.device,
            target: self.target * motion_of(step, 6),
        }
    }
}

/// The motion that six numbers of a step say, from the `first` on: place, then turn.
fn motion_of(step: &DVector<f64>, first: usize) -> Isometry3<f64> {
    let place = step.fixed_rows::<3>(first).into_owned();
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(first + 3).into_owned());
    Isometry3::from_parts(Translation3::from(place), turn)
}

/// Returns the rotation vector of a rotation by less than half a turn, small ones to the last digit
/// (unlike the arc cosine of the trace).
#[must_use]
pub fn rotation_vector(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let r = rotation;
    let skew = Vector3::new(r.m32 - r.m23, r.m13 - r.m31, r.m21 - r.m12) / 2.0;
    let (sine, cosine) = (skew.norm(), (r.trace() - 1.0) / 2.0);
    // The limit of angle / sine is 1.
    if sine > 0.0 {
        skew * (sine.atan2(cosine) / sine)
    } else {
        skew
    }
}

/// Returns where a motion takes a place.
#[must_use]
pub fn apply(motion: &Isometry3<f64>, place: &Vector3<f64>) -> Vector3<f64> {
    motion.rotation * place + motion.translation.vector
}

/// Returns two unit vectors across a direction, and each other.
pub(crate) fn across(axis: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = axis.normalize();
    let least = Vector3::ith(axis.iamin(), 1.0);
    let first = axis.cross(&least).normalize();
    [first, axis.cross(&first)]
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

    /// Largest difference of two motions' matrices.
    fn off(one: &Isometry3<f64>, other: &Isometry3<f64>) -> f64 {
        (one.to_homogeneous() - other.to_homogeneous()).amax()
    }

    fn motion(turn: [f64; 3], shift: [f64; 3]) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::from(shift),
            UnitQuaternion::from_scaled_axis(turn.into()),
        )
    }

    #[test]
    fn a_motion_is_found_exactly_and_despite_wrong_pairs() {
        let motion = motion([2.0, -1.5, 0.7], [3.0, -2.0, 7.0]);
        let mut pairs: Vec<_> = cloud()
            .into_iter()
            .map(|place| (place, apply(&motion, &place)))
            .collect();
        assert!(off(&rigid(&pairs).unwrap(), &motion) < 1e-13);
        for wrong in [3, 11, 17] {
            pairs[wrong].1.x += 0.4;
        }
        assert!(off(&rigid(&pairs).unwrap(), &motion) > 1e-3);
        assert!(off(&rigid_trimmed(&pairs).unwrap(), &motion) < 1e-9);
        assert!(rigid(&pairs[..2]).is_none());
        // Each round shows those that the last one hid.
        let shifts = [3.0, 2.0, 1.0, 0.5, 0.25, 0.12, 0.06, 0.03];
        for (index, shift) in shifts.into_iter().enumerate() {
            pairs[2 * index + 1].1 =
                apply(&motion, &pairs[2 * index + 1].0) + Vector3::repeat(shift);
        }
        assert!(off(&rigid_trimmed(&pairs).unwrap(), &motion) < 1e-9);
    }

    #[test]
    fn two_unit_vectors_are_across_a_direction_and_each_other() {
        for axis in [
            Vector3::x() * 3.0,
            Vector3::new(1.0, 2.0, -3.0),
            Vector3::new(-0.1, 0.1, 0.1),
        ] {
            let [one, other] = across(&axis);
            assert!(
                (one.cross(&other) - axis.normalize()).amax() < 1e-12,
                "{one} {other}"
            );
            assert!(
                (one.norm() - 1.0).abs() < 1e-12 && one.dot(&other).abs() < 1e-12,
                "{one} {other}"
            );
        }
    }

    #[test]
    fn device_and_target_are_found_together() {
        let frames = Frames {
            device: motion([1.0, -1.5, 0.7], [3.0, -2.0, 7.0]),
            target: motion([0.5, 2.0, -0.3], [0.05, -0.1, 0.02]),
        };
        let turns = (0..20_u8)
            .map(f64::from)
            .map(|k| [0.3 * k.sin(), 0.3 * (1.3 * k).cos(), 0.2 * (2.1 * k).sin()]);
        let pairs: Vec<_> = (cloud().into_iter().zip(turns))
            .map(|(place, turn)| motion(turn, place.into()))
            .map(|pose| (pose, frames.device * pose * frames.target))
            .collect();
        let found = Frames::fitted(&pairs, None).unwrap();
        assert!(
            off(&found.device, &frames.device) < 1e-8 && off(&found.target, &frames.target) < 1e-8,
            "{found:?}"
        );
        // A target that is known stays in its place.
        let place = frames.target.translation.vector;
        let known = Frames::fitted(&pairs, Some(place)).unwrap();
        assert!(
            off(&known.device, &frames.device) < 1e-8 && off(&known.target, &frames.target) < 1e-8,
            "{known:?}"
        );
        let beside = Frames::fitted(&pairs, Some(place + Vector3::x() * 0.01)).unwrap();
        assert!(
            (beside.target.translation.vector - place - Vector3::x() * 0.01).norm() < 1e-12,
            "{beside:?}"
        );
        // Without turns the target's place and the device's are collinear.
        let upright: Vec<_> = cloud()
            .into_iter()
            .map(|place| {
                (
                    motion([0.0; 3], place.into()),
                    motion([0.0; 3], place.into()),
                )
            })
            .collect();
        assert_eq!(Frames::fitted(&upright, None), None);
    }
}
