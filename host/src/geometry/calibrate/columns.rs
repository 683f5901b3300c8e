//! Columns of a table of poses with a wrong sign, or in the place of each other: told apart by the robot file's machine, whose places would
//! then lie as the measured ones do.

use std::fmt;

use nalgebra::Vector3;

use crate::fit::statistics::median;
use crate::geometry::MeasuredPose;
use crate::geometry::frames::{apply, rigid_trimmed};

/// Median distance between places from which on something is wrong, m.
const LEAST_OFF_M: f64 = 0.05;
/// Factor by which the distance falls if the mistake is taken back.
const TELLING: f64 = 5.0;

/// A mistake in the columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mistake {
    /// Axis with the wrong sign, counted from 0.
    Negated(usize),
    /// Axes in the place of each other, counted from 0.
    Swapped(usize, usize),
    /// Places in a left-handed frame.
    Mirrored,
}

impl Mistake {
    /// Finds the mistake without which the measured places lie as the file's do; `place_m` is the forward kinematics of the file. `None` if
    /// the places lie so already, or nothing explains them.
    pub(super) fn find<const N: usize>(
        poses: &[MeasuredPose<N>],
        place_m: impl Fn(&[f64; N]) -> Option<Vector3<f64>>,
    ) -> Option<Self> {
        let off_m = |mistake: Option<Self>| {
            let pair = |pose: &MeasuredPose<N>| {
                let (q, seen_m) = mistake.map_or((pose.q, pose.position_m), |mistake| mistake.taken_back(pose));
                Some((place_m(&q)?, seen_m))
            };
            let pairs: Vec<_> = poses.iter().filter_map(pair).collect();
            // Half of the poses, to tell by: another machine reaches few of them.
            let motion = rigid_trimmed(&pairs).filter(|_| 2 * pairs.len() > poses.len())?;
            Some(median(pairs.iter().map(|(from, to)| (to - apply(&motion, from)).norm()).collect()))
        };
        let as_it_is = off_m(None).unwrap_or(f64::INFINITY);
        let axes = (0..N).map(Self::Negated);
        let pairs = (0..N).flat_map(|one| (one + 1..N).map(move |other| Self::Swapped(one, other)));
        let found =
            axes.chain(pairs).chain([Self::Mirrored]).filter_map(|mistake| Some((mistake, off_m(Some(mistake))?)));
        let (mistake, left_m) = found.min_by(|(_, one), (_, other)| one.total_cmp(other))?;
        (as_it_is > LEAST_OFF_M && left_m * TELLING < as_it_is).then_some(mistake)
    }

    fn taken_back<const N: usize>(self, pose: &MeasuredPose<N>) -> ([f64; N], Vector3<f64>) {
        let (mut q, mut place_m) = (pose.q, pose.position_m);
        match self {
            Self::Negated(axis) => q.iter_mut().skip(axis).take(1).for_each(|q| *q = -*q),
            Self::Swapped(one, other) => q.swap(one, other),
            // Of a frame that is anywhere each reflection is the same.
            Self::Mirrored => place_m.x = -place_m.x,
        }
        (q, place_m)
    }
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Negated(axis) => write!(f, "column q_{0}: has the wrong sign; negate q_{0}", axis + 1),
            Self::Swapped(one, other) => {
                write!(f, "columns q_{0}, q_{1}: are in the place of each other; swap them", one + 1, other + 1)
            }
            Self::Mirrored => f.write_str(
                "columns x_m, y_m, z_m: are in a left-handed frame; one of them has the wrong sign, or two of them are in the place of each other",
            ),
        }
    }
}
