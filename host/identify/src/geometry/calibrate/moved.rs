//! A device, or a machine, that was moved between two poses: all places from there on lie
//! elsewhere, by one rigid motion. It is fitted along with the parameters before each pose, and
//! judged.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3};

use crate::fit::goodness::{MIN_P, p_value_text};
use crate::fit::least_squares::{Rows, eliminated, solve};
use crate::fit::statistics::{chi_squared_above, f_above, float};
use crate::measurements::poses::MeasuredPose;

/// Components of a motion: shift, turn.
const MOTION: usize = 6;
/// Smallest number of poses on either side.
const MIN_POSES: usize = 4;

/// A motion.
struct Moved {
    /// Place of the first pose after it, among those that were used.
    first: usize,
    /// Shift of the middle of the places, m; turn, rad.
    motion: DVector<f64>,
    /// Probability of such a motion, or of a larger one, where there is none before any pose.
    p: f64,
}

/// Says if the poses that were `used`, in their order, show a motion of the device; `rows` are
/// those of the fit, and `whitened` are the rows of a pose that is moved by the columns of a
/// matrix: place, rotation vector.
pub(super) fn doubt<const N: usize>(
    measured: &[MeasuredPose<N>],
    used: &[usize],
    rows: &Rows,
    whitened: impl Fn(&Matrix6<f64>) -> DMatrix<f64>,
) -> Option<String> {
    let middle_m = used
        .iter()
        .map(|index| measured[*index].position_m)
        .sum::<Vector3<f64>>()
        / float(used.len());
    let motions: Vec<_> = used
        .iter()
        .map(|index| whitened(&motion_about(&(measured[*index].position_m - middle_m))))
        .collect();
    let Moved { first, motion, p } = find(rows, &motions).filter(|moved| moved.p < MIN_P)?;
    Some(format!(
        "from pose {} on the places lie {:.0} um and {:.0} urad away from those before it ({}): the device or the machine was moved; measure the poses without that, or those on one side of it alone",
        measured[used[first]].name,
        motion.rows(0, 3).norm() * 1e6,
        motion.rows(3, 3).norm() * 1e6,
        p_value_text(p)
    ))
}

/// Change of place and rotation vector of a pose by a shift and a turn about a point, `lever_m`
/// before it.
fn motion_about(lever_m: &Vector3<f64>) -> Matrix6<f64> {
    let mut motion = Matrix6::identity();
    let by_turn: Matrix3<f64> = -lever_m.cross_matrix();
    motion.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_turn);
    motion
}

/// The most significant motion; `motions` has the rows of each pose, the columns of a motion.
fn find(rows: &Rows, motions: &[DMatrix<f64>]) -> Option<Moved> {
    let firsts: Vec<usize> = (MIN_POSES..(motions.len() + 1).saturating_sub(MIN_POSES)).collect();
    let width = MOTION * firsts.len();
    let mut whole = DMatrix::zeros(rows.degrees(), width + 1);
    whole.set_column(width, &rows.residuals);
    let mut row = 0;
    for (pose, motion) in motions.iter().enumerate() {
        for (place, _) in firsts
            .iter()
            .enumerate()
            .filter(|(_, first)| pose >= **first)
        {
            whole
                .view_mut((row, MOTION * place), motion.shape())
                .copy_from(motion);
        }
        row += motion.nrows();
    }
    let left = eliminated(rows.derivatives.clone(), whole);
    let residuals = left.column(width).into_owned();
    firsts
        .iter()
        .enumerate()
        .filter_map(|(place, first)| {
            let columns = left.columns(MOTION * place, MOTION).into_owned();
            let (motion, p) = tested(columns, &residuals)?;
            Some(Moved {
                first: *first,
                motion,
                // The most significant of several is not as rare as one alone.
                p: (p * float(firsts.len())).min(1.0),
            })
        })
        .min_by(|one, other| one.p.total_cmp(&other.p))
}

/// Motion that explains most of the residuals, and the probability of so much explained by chance.
fn tested(columns: DMatrix<f64>, residuals: &DVector<f64>) -> Option<(DVector<f64>, f64)> {
    let (motion, rank) = solve(columns.clone(), residuals.clone());
    let unexplained = (residuals - columns * &motion).norm_squared();
    let degrees = residuals
        .len()
        .checked_sub(rank)
        .filter(|degrees| rank > 0 && *degrees > 0)?;
    let explained = residuals.norm_squared() - unexplained;
    let ratio = (explained / float(rank)) / (unexplained.max(f64::MIN_POSITIVE) / float(degrees));
    // It must be rare by the residuals and by the stated noise.
    let p = f_above(ratio, rank, degrees).max(chi_squared_above(explained, rank));
    Some((motion, p))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector6};

    use super::*;

    #[test]
    fn a_motion_turns_about_the_middle() {
        let lever_m = Vector3::new(0.4, -0.7, 1.1);
        let turn = Vector3::new(2e-6, 1e-6, -3e-6);
        let shift_m = Vector3::new(5e-6, 0.0, -2e-6);
        let expected_m = shift_m + Rotation3::from_scaled_axis(turn) * lever_m - lever_m;
        let motion = Vector6::from_fn(|row, _| if row < 3 { shift_m[row] } else { turn[row - 3] });
        let moved = motion_about(&lever_m) * motion;
        // The square of the turn is left.
        assert!(
            (moved.fixed_rows::<3>(0) - expected_m).amax() < 1e-11
                && (moved.fixed_rows::<3>(3) - turn).amax() <= 0.0
        );
    }
}
