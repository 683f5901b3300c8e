//! Shape of the region that places were measured in: a line, a plane or a small cube does not show a machine.

use std::fmt;

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::fit::statistics::float;
use crate::geometry::MeasuredPose;

/// Largest extent across a line or a plane, in longest extents.
const FLAT: f64 = 0.02;
/// Longest extent of a region that is called small, m.
const SMALL_M: f64 = 0.2;

/// Principal axes of places, and how far the places reach along them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shape {
    /// Mean of the places, m.
    pub(super) centre_m: Vector3<f64>,
    /// Direction across the plane that the places fit best.
    pub(super) normal: Vector3<f64>,
    /// Distances between the farthest places along the axes, m, the longest first.
    pub(super) extents_m: [f64; 3],
}

impl Shape {
    /// Shape of one or more places, m.
    pub(super) fn of(places: &[Vector3<f64>]) -> Self {
        let centre_m = places.iter().sum::<Vector3<f64>>() / float(places.len());
        let scatter: Matrix3<f64> =
            places.iter().map(|place| (place - centre_m) * (place - centre_m).transpose()).sum();
        let eigen = SymmetricEigen::new(scatter);
        let mut order = [0, 1, 2];
        order.sort_by(|one: &usize, other| eigen.eigenvalues[*other].total_cmp(&eigen.eigenvalues[*one]));
        let axes = order.map(|axis| eigen.eigenvectors.column(axis).into_owned());
        let extent = |axis: Vector3<f64>| {
            let along = places.iter().map(|place| (place - centre_m).dot(&axis));
            let (least, most) = along.fold((f64::MAX, f64::MIN), |(least, most), at| (least.min(at), most.max(at)));
            most - least
        };
        Self { centre_m, normal: axes[2], extents_m: axes.map(extent) }
    }

    /// Shape of the places of these poses.
    pub(super) fn of_poses<const N: usize>(poses: &[MeasuredPose<N>], used: &[usize]) -> Self {
        Self::of(&used.iter().map(|index| poses[*index].position_m).collect::<Vec<_>>())
    }

    /// True where the places hardly leave a plane, and are not on a line.
    pub(super) fn is_thin(&self) -> bool {
        let [length, width, thickness] = self.extents_m;
        thickness < 5.0 * FLAT * width && width > FLAT * length
    }

    /// True for a shape that [`fmt::Display`] has a word for.
    pub(super) fn is_poor(&self) -> bool {
        let [length, _, thickness] = self.extents_m;
        thickness <= FLAT * length || length <= SMALL_M
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [length, width, thickness] = self.extents_m;
        if width <= FLAT * length {
            write!(f, "on a line, within {:.2} mm", width * 1e3)
        } else if thickness <= FLAT * length {
            write!(f, "in a plane, within {:.2} mm", thickness * 1e3)
        } else {
            write!(f, "within {:.0} mm of each other", length * 1e3)
        }
    }
}
