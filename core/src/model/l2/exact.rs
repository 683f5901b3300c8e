//! Exact command of three axes: large deflections, links that are not parallel, a platform that
//! turns.

use nalgebra::Vector3;

use super::robot::links;
use super::{AXES, Robot};
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, Solution, is_pose};
use crate::model::linalg::{max_propagating_nan, norm, product, rotation_from_vector};
use crate::model::lu::Lu;
use crate::model::robot::{Compliances, LINKS};
use crate::model::statics::{Wrench, finite};
use crate::zip::zip;

/// Largest error of a loaded link that is accepted, metres. A step takes tensions as constant,
/// which they nearly are: each leaves a few per cent of the error.
const SETTLED_M: f64 = 1e-10;

/// Returns positions for which the loaded machine's tool stands at `pose`'s position: with the axes
/// yielding by `r = c tau` and every link as long as its own tension makes it,
/// `|A(q + r) - T - R b| = L + c f`; `q` is returned. `R` is found with it, as three axes cannot
/// hold it. `pose` and `q` are those of the machine without load, or nearby. The Tau property is
/// not needed.
///
/// `residual_m` is the largest error of a loaded link's length.
///
/// # Errors
/// `Singular`, `NotFinite`, and `NotConverged` where no such state is nearby.
pub fn exact_command(
    robot: &Robot,
    compliances: &Compliances<AXES>,
    pose: &Pose,
    q: &[f64; AXES],
    load: &Wrench,
) -> Result<Solution<[f64; AXES]>, KinematicsError> {
    if !is_pose(pose) {
        return Err(KinematicsError::NotFinite);
    }
    let mut pose = *pose;
    let mut standing = *q;
    let mut residual_m = f64::INFINITY;
    for made in 0..=COLD_ITERATIONS {
        let lines = robot.line_matrix(&pose, &standing)?;
        let forces = lines.link_forces_n(load)?;
        let errors = errors_m(robot, compliances, &pose, &standing, &forces);
        residual_m = errors
            .iter()
            .fold(0.0, |most, error| max_propagating_nan(most, error.abs()));
        if residual_m <= SETTLED_M {
            let value = finite(compliances.before_yielding(&standing, &lines.cart_loads(&forces)))?;
            return Ok(Solution {
                value,
                iterations: made,
                residual_m,
            });
        }
        let [q1, q2, q3, a, b, c] = Lu::factor(&lines.rows_by_carts())?.solve(&errors);
        for (q, change) in standing.iter_mut().zip([q1, q2, q3]) {
            *q -= change;
        }
        let turn =
            rotation_from_vector(&-Vector3::new(a, b, c)).ok_or(KinematicsError::NotFinite)?;
        pose.rotation = product(&turn, &pose.rotation);
    }
    Err(KinematicsError::NotConverged {
        iterations: COLD_ITERATIONS,
        residual_m,
    })
}

/// Errors of the link lengths under their tensions, metres.
fn errors_m(
    robot: &Robot,
    compliances: &Compliances<AXES>,
    pose: &Pose,
    q: &[f64; AXES],
    forces_n: &[f64; LINKS],
) -> [f64; LINKS] {
    let mut errors = [0.0; LINKS];
    let springs = zip(compliances.link_m_per_n(), forces_n);
    let links = links(robot.geometry(), pose, q);
    for ((error, (link_m, length_m)), (compliance, force)) in
        errors.iter_mut().zip(links).zip(springs)
    {
        *error = norm(&link_m) - length_m - compliance * force;
    }
    errors
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::l2::Elastic;
    use crate::model::l2::tests::{compliances, geometry, machine, machines};
    use crate::model::stiffness;
    use nalgebra::Matrix3;

    /// Returns the tool of the elastic machine under a command.
    fn stands(robot: &Robot, command: &[f64; AXES], load: &Wrench, near: &Pose) -> Vector3<f64> {
        let pose = stiffness::tests::stands(
            |pose, q| robot.line_matrix(pose, q).unwrap(),
            |pose, q| {
                let mut links = links(robot.geometry(), pose, q);
                std::array::from_fn(|_| {
                    links
                        .next()
                        .map(|(link_m, length_m)| norm(&link_m) - length_m)
                        .unwrap()
                })
            },
            &compliances(),
            command,
            load,
            near,
        );
        pose.position_m
    }

    /// Distance of the elastic machine's tool under a command from the tool of `pose`, metres.
    fn deviation_m(robot: &Robot, command: &[f64; AXES], load: &Wrench, pose: &Pose) -> f64 {
        norm(&(stands(robot, command, load, pose) - pose.position_m))
    }

    #[test]
    fn a_corrected_tool_stands_where_it_should() {
        for (geometry, rotation) in machines() {
            let robot = Robot::new(geometry).unwrap();
            let nominal = machine(geometry, &rotation);
            let position_m = rotation * Vector3::new(0.0, 0.5, 0.65);
            let pose = Pose {
                position_m,
                rotation,
            };
            let q = nominal.inverse(&position_m).unwrap();
            let model = Elastic::new(&nominal, &compliances());
            let load = [300.0, -50.0, 100.0, 1.0, 2.0, -1.0];
            // The error left to first order grows with the load.
            for (times, left) in [(1.0, 6e-3), (10.0, 6e-2)] {
                let load = Wrench::from_array(load.map(|component| component * times));
                let without = deviation_m(&robot, &q, &load, &pose);
                let [half, full] = [0.5, 1.0].map(|gain| {
                    let command = model.command(&position_m, &q, &load, gain).unwrap();
                    deviation_m(&robot, &command, &load, &pose) / without
                });
                assert!(without > 1e-4 && full < left, "{without} {full}");
                assert!((half - 0.5).abs() < left, "{half}");
                let solved = exact_command(&robot, &compliances(), &pose, &q, &load).unwrap();
                assert!(solved.residual_m < 1e-9, "{solved:?}");
                let exact = deviation_m(&robot, &solved.value, &load, &pose);
                assert!(
                    exact < 1e-9 && exact / without < 1e-3 * full,
                    "{exact} {without}"
                );
            }
        }
    }

    #[test]
    fn wild_loads_are_refused() {
        let robot = Robot::new(geometry()).unwrap();
        let pose = Pose::at(Vector3::new(0.0, 0.5, 0.65));
        let q = machine(geometry(), &pose.rotation)
            .inverse(&pose.position_m)
            .unwrap();
        for wild in [f64::NAN, f64::INFINITY, 1e12, f64::MAX] {
            let load = Wrench::from_array([wild, 0.0, 0.0, 0.0, 0.0, 0.0]);
            assert!(exact_command(&robot, &compliances(), &pose, &q, &load).is_err());
        }
        let mirrored = Pose {
            rotation: -Matrix3::identity(),
            ..pose
        };
        let error =
            exact_command(&robot, &compliances(), &mirrored, &q, &Wrench::zero()).unwrap_err();
        assert_eq!(error, KinematicsError::NotFinite);
    }
}
