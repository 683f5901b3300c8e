//! Columns of a table of poses with a wrong sign, or in the place of each other: found by the robot
//! file's machine, whose places would then lie as the measured ones do.

use std::fmt;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};

use crate::fit::frames::{Frames, LEVER_M, apply, near, rigid_trimmed};
use crate::fit::statistics::median;
use crate::measurements::moved_rows::MovedRows;
use crate::measurements::poses::MeasuredPose;

/// Median distance between places from which on something is wrong, m.
const MIN_OFF_M: f64 = 0.05;
/// The same of turned poses, whose target is fitted along, m.
const MIN_TURNED_OFF_M: f64 = 0.03;
/// Factor by which the distance falls if the mistake is taken back.
const MIN_IMPROVEMENT: f64 = 5.0;

/// A mistake in the columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnMistake {
    /// Axis with the wrong sign, counted from 0.
    Negated(usize),
    /// Axes in the place of each other, counted from 0.
    Swapped(usize, usize),
    /// Places in a left-handed frame.
    Mirrored,
    /// Quaternions in the order x, y, z, w.
    ScalarLast,
    /// Orientations of the device in the frame of the target, and not the other way round.
    Inverted,
    /// Places and orientations beside the axes of another row.
    Moved(MovedRows),
}

impl ColumnMistake {
    /// Finds the mistake without which the measured places lie as the file's do; `place_m` is the
    /// forward kinematics of the file. `None` if the places lie so already, or nothing explains
    /// them.
    pub(super) fn find<const N: usize>(
        poses: &[MeasuredPose<N>],
        place_m: impl Fn(&[f64; N]) -> Option<Vector3<f64>>,
    ) -> Option<Self> {
        let axes = (0..N).map(Self::Negated);
        let moved = MovedRows::ALL.map(Self::Moved);
        Self::best(
            axes.chain(Self::swaps(0, N))
                .chain([Self::Mirrored])
                .chain(moved),
            MIN_OFF_M,
            |mistake| {
                let pairs: Vec<_> = taken_back(mistake, poses)
                    .into_iter()
                    .filter_map(|pose| Some((place_m(&pose.q)?, pose.position_m)))
                    .collect();
                // Half of the poses at least: another machine reaches few of them.
                let motion = rigid_trimmed(&pairs).filter(|_| 2 * pairs.len() > poses.len())?;
                Some(median(
                    pairs
                        .iter()
                        .map(|(from, to)| (to - apply(&motion, from)).norm())
                        .collect(),
                ))
            },
        )
    }

    /// The same of poses that turn, by their orientations: mistakes in quaternions, and among the
    /// axes from `first_plate` on, which turn the platform more than they move it.
    pub(super) fn find_turned<const N: usize>(
        poses: &[MeasuredPose<N>],
        first_plate: usize,
        target_m: Option<Vector3<f64>>,
        pose: impl Fn(&[f64; N]) -> Option<Isometry3<f64>>,
    ) -> Option<Self> {
        let plates = (first_plate..N)
            .map(Self::Negated)
            .chain(Self::swaps(first_plate, N));
        Self::best(
            plates.chain([Self::ScalarLast, Self::Inverted]),
            MIN_TURNED_OFF_M,
            |mistake| {
                let pairs: Vec<_> = taken_back(mistake, poses)
                    .into_iter()
                    .filter_map(|measured| {
                        let seen =
                            Isometry3::from_parts(measured.position_m.into(), measured.rotation?);
                        Some((pose(&measured.q)?, seen))
                    })
                    .collect();
                // Rows that are grossly wrong would turn the frames.
                let places: Vec<_> = pairs
                    .iter()
                    .map(|(of_file, seen)| (of_file.translation.vector, seen.translation.vector))
                    .collect();
                let pairs: Vec<_> = near(&places)
                    .into_iter()
                    .map(|index| pairs[index])
                    .collect();
                let frames =
                    Frames::fitted(&pairs, target_m).filter(|_| 2 * pairs.len() > poses.len())?;
                let left_m = pairs.iter().map(|(pose, seen)| {
                    let off = (frames.device * pose * frames.target).inverse() * seen;
                    off.translation.vector.norm() + LEVER_M * off.rotation.angle()
                });
                Some(median(left_m.collect()))
            },
        )
    }

    fn swaps(first: usize, end: usize) -> impl Iterator<Item = Self> {
        (first..end).flat_map(move |one| (one + 1..end).map(move |other| Self::Swapped(one, other)))
    }

    /// The mistake without which the distance is smallest, if it is small enough.
    fn best(
        mistakes: impl Iterator<Item = Self>,
        least_off_m: f64,
        off_m: impl Fn(Option<Self>) -> Option<f64>,
    ) -> Option<Self> {
        let as_it_is = off_m(None).unwrap_or(f64::INFINITY);
        if as_it_is <= least_off_m {
            return None;
        }
        let found = mistakes.filter_map(|mistake| Some((mistake, off_m(Some(mistake))?)));
        let (mistake, left_m) = found.min_by(|(_, one), (_, other)| one.total_cmp(other))?;
        (left_m * MIN_IMPROVEMENT < as_it_is).then_some(mistake)
    }
}

/// Poses without a mistake.
fn taken_back<const N: usize>(
    mistake: Option<ColumnMistake>,
    poses: &[MeasuredPose<N>],
) -> Vec<MeasuredPose<N>> {
    if let Some(ColumnMistake::Moved(moved)) = mistake {
        return moved
            .pairs(poses)
            .map(|(set, measured)| MeasuredPose {
                q: set.q,
                ..measured.clone()
            })
            .collect();
    }
    let mut poses = poses.to_vec();
    poses.iter_mut().for_each(|pose| take_back(mistake, pose));
    poses
}

/// Corrects one pose.
fn take_back<const N: usize>(mistake: Option<ColumnMistake>, pose: &mut MeasuredPose<N>) {
    match mistake {
        None | Some(ColumnMistake::Moved(_)) => {}
        Some(ColumnMistake::Negated(axis)) => {
            pose.q.iter_mut().skip(axis).take(1).for_each(|q| *q = -*q)
        }
        Some(ColumnMistake::Swapped(one, other)) => pose.q.swap(one, other),
        // Of a frame that is anywhere each reflection is the same.
        Some(ColumnMistake::Mirrored) => pose.position_m.x = -pose.position_m.x,
        Some(ColumnMistake::ScalarLast) => {
            pose.rotation = pose.rotation.map(|rotation| {
                let Quaternion { coords } = rotation.into_inner();
                // Parts w, x, y, z hold x, y, z, w.
                UnitQuaternion::new_normalize(Quaternion::new(
                    coords.z, coords.w, coords.x, coords.y,
                ))
            });
        }
        Some(ColumnMistake::Inverted) => {
            pose.rotation = pose.rotation.map(|rotation| rotation.inverse())
        }
    }
}

impl fmt::Display for ColumnMistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Negated(axis) => write!(f, "column q_{0}: has the wrong sign; negate q_{0}", axis + 1),
            Self::Swapped(one, other) => {
                write!(f, "columns q_{0}, q_{1}: are in the place of each other; swap them", one + 1, other + 1)
            }
            Self::ScalarLast => f.write_str(
                "columns rot_w, rot_x, rot_y, rot_z: hold x, y, z, w; the scalar part w is the first here",
            ),
            Self::Inverted => f.write_str(
                "columns rot_w, rot_x, rot_y, rot_z: are the inverse rotations; negate rot_x, rot_y, rot_z",
            ),
            Self::Moved(moved) => write!(f, "columns x_m, y_m, z_m: {moved}"),
            Self::Mirrored => f.write_str(
                "columns x_m, y_m, z_m: are in a left-handed frame; one of them has the wrong sign, or two of them are in the place of each other",
            ),
        }
    }
}
