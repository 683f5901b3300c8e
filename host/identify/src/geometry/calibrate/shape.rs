//! Shape of the region that places were measured in: a line, a plane or a small cube does not show
//! a machine.

use std::fmt;

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::fit::statistics::float;
use crate::measurements::poses::MeasuredPose;

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
        let scatter: Matrix3<f64> = places
            .iter()
            .map(|place| (place - centre_m) * (place - centre_m).transpose())
            .sum();
        let eigen = SymmetricEigen::new(scatter);
        let mut order = [0, 1, 2];
        order.sort_by(|one: &usize, other| {
            eigen.eigenvalues[*other].total_cmp(&eigen.eigenvalues[*one])
        });
        let axes = order.map(|axis| eigen.eigenvectors.column(axis).into_owned());
        let extents_m = axes.map(|axis| {
            let along = places.iter().map(|place| (place - centre_m).dot(&axis));
            let (least, most) = along.fold((f64::MAX, f64::MIN), |(least, most), at| {
                (least.min(at), most.max(at))
            });
            most - least
        });
        Self {
            centre_m,
            normal: axes[2],
            extents_m,
        }
    }

    /// Shape of the places of these poses.
    pub(super) fn of_poses<const N: usize>(poses: &[MeasuredPose<N>], used: &[usize]) -> Self {
        Self::of(
            &used
                .iter()
                .map(|index| poses[*index].position_m)
                .collect::<Vec<_>>(),
        )
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

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    /// Shape of the corners of a box that stands at an angle.
    fn shape(extents_m: [f64; 3]) -> Shape {
        let turn = Rotation3::from_scaled_axis(Vector3::new(0.7, -1.1, 0.4));
        let corners = (0..8_u8).map(|bits| {
            let half = Vector3::from_fn(|axis, _| if bits >> axis & 1 == 1 { 0.5 } else { -0.5 });
            turn * half.component_mul(&Vector3::from(extents_m)) + Vector3::new(3.0, -1.0, 2.0)
        });
        Shape::of(&corners.collect::<Vec<_>>())
    }

    #[test]
    fn a_region_has_its_extents_and_its_word() {
        for (extents_m, is_thin, word) in [
            ([1.0, 0.8, 0.5], false, None),
            ([1.0, 0.8, 0.081], false, None),
            ([1.0, 0.8, 0.079], true, None),
            ([1.0, 0.8, 0.021], true, None),
            ([1.0, 0.8, 0.019], true, Some("in a plane, within 19.00 mm")),
            (
                [1.0, 0.021, 0.001],
                true,
                Some("in a plane, within 1.00 mm"),
            ),
            (
                [1.0, 0.019, 0.001],
                false,
                Some("on a line, within 19.00 mm"),
            ),
            ([0.201, 0.15, 0.1], false, None),
            (
                [0.199, 0.15, 0.1],
                false,
                Some("within 199 mm of each other"),
            ),
        ] {
            let shape = shape(extents_m);
            let off = shape
                .extents_m
                .iter()
                .zip(extents_m)
                .map(|(found, is)| (found - is).abs())
                .fold(0.0, f64::max);
            assert!(off < 1e-12, "{shape:?}");
            assert_eq!(
                (shape.is_thin(), shape.is_poor()),
                (is_thin, word.is_some()),
                "{extents_m:?}"
            );
            assert!(
                word.is_none_or(|word| shape.to_string() == word),
                "{extents_m:?}: {shape}"
            );
        }
    }
}
