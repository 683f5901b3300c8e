//! Values of a robot file that move along with its world axes.

use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_machine::robot_file::edit::RobotText;
use nalgebra::{Isometry3, Vector3};

use crate::fit::frames::apply;

/// Moves what a robot file says of its surroundings to where `motion` takes its world axes: home,
/// sensor, tool, wrist. The axes of the platform turn along, so that a platform that is unturned in
/// the file still is; joints are left to the caller.
pub(super) fn move_frame<K, const N: usize>(
    text: &mut RobotText,
    robot: &RobotFile<K, N>,
    motion: &Isometry3<f64>,
) {
    fn turned(motion: &Isometry3<f64>, vector: [f64; 3]) -> [f64; 3] {
        (motion.rotation * Vector3::from(vector)).into()
    }
    let home: [f64; 3] = apply(motion, &robot.home_m()).into();
    text.set_numbers_at(&["simulation", "home_m"], &home);
    let sensor = motion.rotation.to_rotation_matrix().into_inner() * robot.sensor.rotation_matrix();
    let rows: [[f64; 3]; 3] = sensor.transpose().into();
    text.set_rows_at(&["sensor", "rotation"], &rows);
    text.set_numbers_at(
        &["sensor", "lever_m"],
        &turned(motion, robot.sensor.lever_m),
    );
    text.set_numbers_at(
        &["sensor", "tool", "weight_n"],
        &turned(motion, robot.sensor.tool.weight_n),
    );
    text.set_numbers_at(
        &["sensor", "tool", "centre_m"],
        &turned(motion, robot.sensor.tool.centre_m),
    );
    for (index, joint) in robot.wrist.iter().enumerate() {
        text.set_numbers_of("wrist", index, "axis", &turned(motion, joint.axis));
        text.set_numbers_of("wrist", index, "point_m", &turned(motion, joint.point_m));
    }
}
