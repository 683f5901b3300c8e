//! Poses, loads and helpers that both machines share.

use gantry_tau_core::model::kinematics::{Pose, Solution};
use gantry_tau_core::model::linalg::norm;
use gantry_tau_core::model::robot::{ARMS, Branch, LINKS, SCALE_RANGE};
use gantry_tau_core::model::statics::{LineMatrix, Wrench};
use gantry_tau_core::units::{Metres, PositionNm};
use nalgebra::{Matrix3, Vector3};

use crate::code::gt_code;
use crate::error::{gt_error, gt_parameter};
use crate::memory::{Reply, answer, checked, read};
use crate::padding::padded;

/// Number of links, in the order 11, 21, 22, 31, 32, 33: the first digit is the arm, and its number
/// of links.
pub const GT_LINKS: usize = 6;
/// Number of arms, carts and guideways.
pub const GT_ARMS: usize = 3;
const _: () = assert!(GT_LINKS == LINKS && GT_ARMS == ARMS, "core's machines");

/// Position and orientation of the tool: x_world = T + R x_platform.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_pose {
    /// T: tool centre point, world axes, m.
    pub position_m: [f64; 3],
    /// R: world axes from platform axes, row by row.
    pub rotation: [[f64; 3]; 3],
}

/// A load on the platform, applied BY THE ENVIRONMENT TO THE PLATFORM; moment about the tool centre
/// point.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_wrench {
    /// F, N; world axes.
    pub force_n: [f64; 3],
    /// M, N m; world axes.
    pub moment_nm: [f64; 3],
}

/// Effort and accuracy of an iterative solution.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct gt_solved {
    /// Number of linear solves.
    pub iterations: i32,
    /// Largest error of a link's length, m.
    pub residual_m: f64,
}

padded! {
    gt_pose { position_m rotation }
    gt_wrench { force_n moment_nm }
    gt_solved { iterations residual_m }
}

impl From<gt_pose> for Pose {
    fn from(pose: gt_pose) -> Self {
        Self {
            position_m: pose.position_m.into(),
            rotation: matrix(&pose.rotation),
        }
    }
}

impl From<Pose> for gt_pose {
    fn from(pose: Pose) -> Self {
        Self {
            position_m: pose.position_m.into(),
            rotation: rows(&pose.rotation),
        }
    }
}

impl From<gt_wrench> for Wrench {
    fn from(wrench: gt_wrench) -> Self {
        Self {
            force_n: wrench.force_n.into(),
            moment_nm: wrench.moment_nm.into(),
        }
    }
}

impl From<Wrench> for gt_wrench {
    fn from(wrench: Wrench) -> Self {
        Self {
            force_n: wrench.force_n.into(),
            moment_nm: wrench.moment_nm.into(),
        }
    }
}

impl<T> From<&Solution<T>> for gt_solved {
    fn from(solved: &Solution<T>) -> Self {
        Self {
            iterations: solved.iterations.into(),
            residual_m: solved.residual_m,
        }
    }
}

/// A matrix from its rows.
pub(crate) fn matrix(rows: &[[f64; 3]; 3]) -> Matrix3<f64> {
    // nalgebra counts by columns.
    Matrix3::from(*rows).transpose()
}

/// The rows of a matrix.
pub(crate) fn rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}

/// Vectors from their components.
pub(crate) fn vectors<const N: usize>(components: [[f64; 3]; N]) -> [Vector3<f64>; N] {
    components.map(Vector3::from)
}

/// Branches from their signs; `index` of an error counts from `from`.
pub(crate) fn branches<const N: usize>(signs: [i32; N], from: usize) -> Reply<[Branch; N]> {
    let mut branches = [Branch::Positive; N];
    for (index, (branch, sign)) in branches.iter_mut().zip(signs).enumerate() {
        *branch = match sign {
            1 => Branch::Positive,
            -1 => Branch::Negative,
            _ => return Err(gt_error::new(gt_code::Branch).at(index.saturating_add(from))),
        };
    }
    Ok(branches)
}

/// Ranges of axes, if they are to be checked.
pub(crate) fn travel<const N: usize>(has: u8, ranges: [[f64; 2]; N]) -> Option<[(f64, f64); N]> {
    (has != 0).then(|| ranges.map(|[lower, upper]| (lower, upper)))
}

/// Largest deviation of a cart's metres_per_q, the drive's count, from the length of its guideway,
/// which calibration finds; relative. The same as of a robot file.
const SCALE_TOLERANCE: f64 = 0.01;

/// Length of one unit of each q, m: converts between nanometres and q-units.
#[derive(Clone, Copy)]
pub(crate) struct Scale<const N: usize>(pub(crate) [f64; N]);

impl<const N: usize> Scale<N> {
    /// Checks the conversion; a cart's is the length of its guideway, to a percent.
    pub(crate) fn new(metres_per_q: [f64; N], guideways: &[[f64; 3]; GT_ARMS]) -> Reply<Self> {
        let mut lengths = guideways
            .iter()
            .map(|guideway| norm(&Vector3::from(*guideway)));
        for (axis, metres) in metres_per_q.iter().enumerate() {
            let (lower, upper) = lengths.next().map_or(SCALE_RANGE, |length| {
                (
                    length * (1.0 - SCALE_TOLERANCE),
                    length * (1.0 + SCALE_TOLERANCE),
                )
            });
            if !metres.is_finite() {
                return Err(refused_scale(gt_code::RobotNotFinite, axis));
            }
            if !(lower..=upper).contains(metres) {
                return Err(refused_scale(gt_code::RobotOutOfRange, axis).range(lower, upper));
            }
        }
        Ok(Self(metres_per_q))
    }

    /// Returns positions in q-units.
    pub(crate) fn q(&self, positions_nm: [i64; N]) -> [f64; N] {
        let mut q = positions_nm.map(|position| PositionNm(position).to_metres().0);
        for (q, metres) in q.iter_mut().zip(&self.0) {
            *q /= metres;
        }
        q
    }

    /// Returns positions in nm, rounded.
    pub(crate) fn positions_nm(&self, q: &[f64; N]) -> Reply<[i64; N]> {
        let mut positions_nm = [0; N];
        for ((position, q), metres) in positions_nm.iter_mut().zip(q).zip(&self.0) {
            *position = PositionNm::from_metres(Metres(q * metres))?.0;
        }
        Ok(positions_nm)
    }
}

/// Error of an axis' metres_per_q.
fn refused_scale(code: gt_code, axis: usize) -> gt_error {
    gt_error::new(code).of(gt_parameter::MetresPerQ).at(axis)
}

/// A machine: its kinematics, and the conversion of its positions.
pub(crate) struct Machine<K, const N: usize> {
    pub(crate) kinematics: K,
    pub(crate) scale: Scale<N>,
}

impl<K, const N: usize> Machine<K, N> {
    /// Copies positions of the caller, in q-units.
    ///
    /// # Safety
    /// As [`read`], for `[i64; N]`.
    pub(crate) unsafe fn q(&self, positions_nm: *const i64) -> Reply<[f64; N]> {
        // SAFETY: the caller's promise.
        Ok(self.scale.q(unsafe { read(positions_nm.cast()) }?))
    }
}

/// Statics: writes the tensions of the links and the loads on the axes.
///
/// # Safety
/// The header's rules for pointers.
#[inline(always)]
pub(crate) unsafe fn statics<const N: usize>(
    link_forces_n: *mut f64,
    axis_loads: *mut [f64; N],
    load: *const gt_wrench,
    error: *mut gt_error,
    lines: impl FnOnce() -> Reply<LineMatrix<N>>,
) -> gt_code {
    // SAFETY: the caller's promise.
    unsafe {
        answer(axis_loads, error, || {
            let forces = checked(link_forces_n.cast::<[f64; GT_LINKS]>())?;
            let (load, lines) = (read(load)?, lines()?);
            let tensions = lines.link_forces_n(&load.into())?;
            forces.write(tensions);
            Ok(lines.cart_loads(&tensions))
        })
    }
}

/// Converts a length to whole nanometres, rounded half away from zero. The only conversion from
/// floats to references.
///
/// Errors: those of CROSSING_ (NaN, infinite, or 2^53 nm and more).
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gt_position_from_metres(
    metres: f64,
    position_nm: *mut i64,
    error: *mut gt_error,
) -> gt_code {
    // SAFETY: the header's rules for pointers.
    unsafe {
        answer(position_nm, error, || {
            Ok(PositionNm::from_metres(Metres(metres))?.0)
        })
    }
}
