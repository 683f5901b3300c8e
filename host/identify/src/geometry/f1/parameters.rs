//! The 64 parameters of an F1 as numbers: their order, their scales, steps of them, and those that
//! no pose shows.

use std::ops::Range;

use gantry_tau_core::model::f1;
use gantry_tau_core::model::robot::{ARMS, LINKS};
use nalgebra::{DVector, Matrix3, SMatrix, UnitQuaternion, Vector3};

use crate::fit::frames::across;
use crate::fit::least_squares::Direction;

/// First parameters of the groups `C` (9), `V` (9), `P` (18), `b` (18), `L` (6), `ax` (2), `ax6`
/// (2), and their number.
pub(super) const C: usize = 0;
pub(super) const V: usize = 9;
pub(super) const P: usize = 18;
pub(super) const B: usize = 36;
pub(super) const L: usize = 54;
pub(super) const AX: usize = 60;
pub(super) const AX6: usize = 62;
/// All of them.
pub const PARAMETERS: usize = 64;
/// Those that can be seen.
pub const OBSERVABLE: usize = 60;
/// Changes that would matter: of a place or a length, m, and of a direction, rad. Ten times those
/// of an L2: some combinations of joints move the tool so little that sixty poses know them to
/// centimetres only, and are estimated all the same.
const TOLERANCE_M: f64 = 1.0;
const TOLERANCE_RAD: f64 = 1.0;
/// Standard deviation of a combination that no step may be taken along, m.
const FIXED_M: f64 = 1e-9;

/// Change of each parameter that would matter.
pub(crate) fn scales(geometry: &f1::Geometry) -> DVector<f64> {
    let mut scales = DVector::repeat(PARAMETERS, TOLERANCE_M);
    for (arm, guideway) in geometry.guideways.iter().enumerate() {
        scales
            .fixed_rows_mut::<3>(V + 3 * arm)
            .fill(TOLERANCE_RAD * guideway.norm());
    }
    scales.rows_mut(AX, PARAMETERS - AX).fill(TOLERANCE_RAD);
    scales
}

/// Returns a machine changed by a step of its parameters.
pub(super) fn stepped(geometry: &f1::Geometry, step: &DVector<f64>) -> f1::Geometry {
    f1::Geometry {
        carts_m: shifted(&geometry.carts_m, step, C),
        guideways: shifted(&geometry.guideways, step, V),
        plate_joints_m: shifted(&geometry.plate_joints_m, step, P),
        platform_joints_m: shifted(&geometry.platform_joints_m, step, B),
        lengths_m: std::array::from_fn(|link| geometry.lengths_m[link] + step[L + link]),
        turn_axis: turned(&geometry.turn_axis, step, AX),
        tilt_axis: turned(&geometry.tilt_axis, step, AX6),
        ..*geometry
    }
}

/// Vectors changed by those of a step, from `first` on.
fn shifted<const N: usize>(
    vectors: &[Vector3<f64>; N],
    step: &DVector<f64>,
    first: usize,
) -> [Vector3<f64>; N] {
    std::array::from_fn(|index| {
        vectors[index] + step.fixed_rows::<3>(first + 3 * index).into_owned()
    })
}

/// An axis turned by the two components of a step at `first`.
fn turned(axis: &Vector3<f64>, step: &DVector<f64>, first: usize) -> Vector3<f64> {
    let [one, other] = across(axis);
    UnitQuaternion::from_scaled_axis(one * step[first] + other * step[first + 1]) * axis
}

/// Parameters of a machine near `origin`, whose axes' own are zero.
#[must_use]
pub fn parameters(geometry: &f1::Geometry, origin: &f1::Geometry) -> DVector<f64> {
    let mut parameters = DVector::zeros(PARAMETERS);
    let groups: [(usize, &[Vector3<f64>]); 4] = [
        (C, &geometry.carts_m),
        (V, &geometry.guideways),
        (P, &geometry.plate_joints_m),
        (B, &geometry.platform_joints_m),
    ];
    for (first, vectors) in groups {
        for (index, vector) in vectors.iter().enumerate() {
            parameters
                .fixed_rows_mut::<3>(first + 3 * index)
                .copy_from(vector);
        }
    }
    parameters
        .fixed_rows_mut::<LINKS>(L)
        .copy_from_slice(&geometry.lengths_m);
    let axes = [
        (AX, geometry.turn_axis, origin.turn_axis),
        (AX6, geometry.tilt_axis, origin.tilt_axis),
    ];
    for (first, axis, from) in axes {
        // The rotation vector from one unit vector to one near it.
        let turn = from.normalize().cross(&axis.normalize());
        for (index, direction) in across(&from).iter().enumerate() {
            parameters[first + index] = turn.dot(direction);
        }
    }
    parameters
}

const _: () = assert!(
    V == 3 * ARMS
        && P == V + 3 * ARMS
        && B == P + 3 * LINKS
        && L == B + 3 * LINKS
        && AX == L + LINKS
);

/// Parameters that the constraint of [`fixed`] keeps at the file's values: `P_11`.
pub(crate) const KEPT: Range<usize> = P..P + 3;

/// Directions that no pose shows, in changes that would matter: `C_1` against `P_11`, and `C_2`
/// against `P_21` and `P_22` along the plates' axis.
pub(crate) fn unseen(geometry: &f1::Geometry) -> Vec<Direction> {
    let along = geometry.turn_axis.normalize();
    let mut unseen = vec![DVector::zeros(PARAMETERS); 4];
    for (component, direction) in unseen.iter_mut().take(3).enumerate() {
        direction[C + component] = 1.0;
        direction[P + component] = -1.0;
    }
    if let Some(direction) = unseen.last_mut() {
        direction.fixed_rows_mut::<3>(C + 3).copy_from(&along);
        direction.fixed_rows_mut::<3>(P + 3).copy_from(&-along);
        direction.fixed_rows_mut::<3>(P + 6).copy_from(&-along);
    }
    unseen
        .into_iter()
        .map(|components| Direction {
            relative_sd: f64::INFINITY,
            components: components.normalize(),
        })
        .collect()
}

/// Rows that keep what cannot be seen: `P_11`, and the mean of `P_21`, `P_22` along the plates'
/// axis.
pub(crate) fn fixed(geometry: &f1::Geometry) -> SMatrix<f64, 4, PARAMETERS> {
    let mut rows = SMatrix::<f64, 4, PARAMETERS>::zeros();
    rows.fixed_view_mut::<3, 3>(0, P)
        .copy_from(&Matrix3::from_diagonal_element(1.0 / FIXED_M));
    let along = geometry.turn_axis.normalize() / (2.0 * FIXED_M);
    for link in [1, 2] {
        rows.fixed_view_mut::<1, 3>(3, P + 3 * link)
            .copy_from(&along.transpose());
    }
    rows
}
