//! Statics by blocks, with and without the Tau property, against nalgebra's decomposition of all six rows.

use super::*;
use crate::model::statics::TauFormError;
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
    let rows = kinematics.drives(q, &directions);
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

    #[test]
    fn the_tau_form_is_the_general_one_in_step(
        position in prop::array::uniform3(-0.3..0.3_f64), yaw in -0.3..0.3_f64, tilt in -0.3..0.3_f64, three: bool,
    ) {
        let (kinematics, pose) = if three {
            // Three axes without a turn: parallel everywhere.
            let l2 = crate::model::l2::tests::geometry();
            let position_m = Vector3::new(0.0, 0.4, 0.65) + Vector3::from(position) * 0.5;
            (kinematics(Geometry::from(&l2)), Pose::at(position_m))
        } else {
            let turned = |v| rotation_from_vector(&v).unwrap();
            let rotation = turned(Vector3::z() * yaw) * turned(Vector3::y() * tilt);
            (f1(), Pose { position_m: position.into(), rotation })
        };
        let Ok(found) = kinematics.inverse(&pose, None) else { return Ok(()) };
        let q = found.value;
        let lines = kinematics.line_matrix_in_tau_form(&pose, &q).unwrap();
        let w = line_matrix(&kinematics, &pose, &q);
        // The links are parallel to 1e-12 or so, which a lever of a tenth of a metre makes ten times as much.
        agree(&lines, w, &drives(&kinematics, &pose, &q), 1e-9);
    }
}

#[test]
fn links_that_are_not_parallel_are_named_with_their_angle() {
    let f1 = f1();
    let in_step = f1.inverse(&pose([0.1, -0.1, 0.4, 0.0, -0.15, 0.0]), None);
    let q = in_step.unwrap().value;
    // One plate out of step turns the platform, and with it every cluster's links; a tilt does not.
    for axis in [3, 4] {
        let mut q = q;
        q[axis] += 1e-3;
        let pose = f1.forward(&q).unwrap().value;
        let [_, w21, w22, ..] = f1.links_m(&pose, &q);
        let angle = w21.angle(&w22);
        assert!(angle > 1e-5, "{angle}");
        assert!(f1.line_matrix(&pose, &q).is_ok());
        let error = f1.line_matrix_in_tau_form(&pose, &q).unwrap_err();
        assert!(
            // `angle` takes an arc cosine, which keeps half the digits.
            matches!(error, TauFormError::NotParallel { link: 2, angle_rad } if (angle_rad - angle).abs() < 1e-7),
            "{error:?} {angle}"
        );
    }
    let mut tilted = q;
    tilted[5] += 1e-3;
    let pose = f1.forward(&tilted).unwrap().value;
    assert!(f1.line_matrix_in_tau_form(&pose, &tilted).is_ok());
    let nowhere = Pose::at(Vector3::new(f64::NAN, 0.0, 0.0));
    let error = f1.line_matrix_in_tau_form(&nowhere, &q).unwrap_err();
    assert_eq!(error, KinematicsError::NotFinite.into());
}
