//! Statics by blocks against nalgebra's decomposition of all six rows.

use super::*;
use nalgebra::{Matrix6, Vector6};

/// `W` by its definition.
fn line_matrix(kinematics: &Kinematics, pose: &Pose, q: &[f64; AXES]) -> Matrix6<f64> {
    let joints = &kinematics.robot().geometry().platform_joints_m;
    let links_m = kinematics.links_m(pose, q);
    Matrix6::from_fn(|row, link| {
        let s = links_m[link] / norm(&links_m[link]);
        let moment = (pose.rotation * joints[link]).cross(&s);
        if row < 3 { s[row] } else { moment[row - 3] }
    })
}

#[expect(clippy::disallowed_methods, reason = "a solver of a test may panic")]
/// Forces, displacement and Jacobian of `lines` are those of `w`, to `tolerance` relative.
fn agree(lines: &LineMatrix<AXES>, w: Matrix6<f64>, drives: &Matrix6<f64>, tolerance: f64) {
    let load = [200.0, -90.0, 150.0, 8.0, -5.0, 3.0];
    let forces = w.lu().solve(&-Vector6::from(load)).unwrap();
    let ours = lines.link_forces_n(&Wrench::from_array(load)).unwrap();
    close(&ours, forces.as_slice(), tolerance, "f");
    let elongations = [1e-4, -2e-4, 3e-4, 1e-4, 2e-4, -1e-4];
    let motion = w.transpose().lu().solve(&-Vector6::from(elongations));
    let ours = lines.displacement(&[0.0; AXES], &elongations).unwrap();
    close(&ours, motion.unwrap().as_slice(), tolerance, "dx");
    let jacobian = w.transpose().lu().solve(drives).unwrap();
    let ours = lines.jacobian().unwrap();
    close(ours.as_slice(), jacobian.as_slice(), tolerance, "J");
    close(lines.matrix().as_slice(), w.as_slice(), 1e-15, "W");
}

fn drives(kinematics: &Kinematics, pose: &Pose, q: &[f64; AXES]) -> Matrix6<f64> {
    let directions = kinematics.links_m(pose, q).map(|link| link / norm(&link));
    let rows = kinematics.plates.at(q).drives(&directions);
    Matrix6::from_fn(|row, column| rows[row][column])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5_000))]

    #[test]
    fn blocks_agree_with_the_full_system(pose in workspace(), skew: bool) {
        let kinematics = kinematics(if skew { skewed() } else { geometry() });
        let Ok(found) = kinematics.inverse(&pose, None) else { return Ok(()) };
        let q = found.value;
        let lines = kinematics.line_matrix(&pose, &q).unwrap();
        let w = line_matrix(&kinematics, &pose, &q);
        agree(&lines, w, &drives(&kinematics, &pose, &q), 1e-9);
    }
}
