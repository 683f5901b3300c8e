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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(5_000))]

    #[test]
    #[expect(clippy::disallowed_methods, reason = "a solver of a test may panic")]
    fn blocks_agree_with_the_full_system(pose in workspace(), skew: bool) {
        let kinematics = kinematics(if skew { skewed() } else { geometry() });
        let Ok(found) = kinematics.inverse(&pose, None) else { return Ok(()) };
        let q = found.value;
        let lines = kinematics.line_matrix(&pose, &q).unwrap();
        let w = line_matrix(&kinematics, &pose, &q);
        close(lines.matrix().as_slice(), w.as_slice(), 1e-15, "W");
        let load = [200.0, -90.0, 150.0, 8.0, -5.0, 3.0];
        let forces = w.lu().solve(&-Vector6::from(load)).unwrap();
        close(&lines.link_forces_n(&Wrench::from_array(load)).unwrap(), forces.as_slice(), 1e-9, "f");
        let transposed = w.transpose().lu();
        let elongations = [1e-4, -2e-4, 3e-4, 1e-4, 2e-4, -1e-4];
        let motion = transposed.solve(&-Vector6::from(elongations)).unwrap();
        close(&lines.displacement(&[0.0; AXES], &elongations).unwrap(), motion.as_slice(), 1e-9, "dx");
        let directions = kinematics.links_m(&pose, &q).map(|link| link / norm(&link));
        let drives = kinematics.plates.at(&q).drives(&directions).rows();
        let jacobian = transposed.solve(&Matrix6::from_fn(|row, column| drives[row][column])).unwrap();
        close(lines.jacobian().unwrap().as_slice(), jacobian.as_slice(), 1e-9, "J");
        close(kinematics.jacobian(&pose, &q).unwrap().as_slice(), jacobian.as_slice(), 1e-9, "J, without forces");
    }
}
