//! The exact correction of three axes: large deflections, links that are not parallel, a platform that turns as it will.

use nalgebra::Vector3;

use crate::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, Solved, is_pose, links};
use crate::linalg::{Lu, norm, rotation_from_vector};
use crate::robot::{ARMS, Compliances, LINKS, Robot};
use crate::rows::pairs;
use crate::statics::{LineMatrix, Wrench, finite};

/// Largest error of a loaded link that is accepted, metres. Tensions hardly depend on what is sought, and count as constant in a step:
/// each leaves a few per cent of the error.
const SETTLED_M: f64 = 1e-10;

/// Positions for which the loaded machine's tool stands at `pose`'s position: with the axes yielding by `r = c tau` and every link
/// as long as its own tension makes it, `|A(q + r) - T - R b| = L + c f`; `q` is returned. `R` is found with it: three axes cannot
/// hold it. `pose` and `q` are those of the machine without load, or nearby.
///
/// `residual_m` is the largest error of a loaded link's length.
///
/// # Errors
/// `Singular`, `NotFinite`, and `NotConverged` where no such state is nearby.
pub fn held(
    robot: &Robot,
    compliances: &Compliances,
    pose: &Pose,
    q: &[f64; ARMS],
    load: &Wrench,
) -> Result<Solved<[f64; ARMS]>, KinematicsError> {
    if !is_pose(pose) {
        return Err(KinematicsError::NotFinite);
    }
    let mut pose = *pose;
    let mut standing = *q;
    let mut residual_m = f64::INFINITY;
    for made in 0..=COLD_ITERATIONS {
        let lines = LineMatrix::new(robot, &pose, &standing)?;
        let forces = lines.link_forces_n(load)?;
        let (errors, rows) = loaded(robot, compliances, &pose, &standing, &forces);
        // `max` drops a NaN.
        residual_m = (finite(errors)?.iter()).fold(0.0, |most: f64, error| most.max(error.abs()));
        if residual_m <= SETTLED_M {
            let loads = lines.cart_loads(&forces);
            let springs = pairs(compliances.cart_m_per_n(), &loads);
            for ((compliance, tau), q) in springs.zip(&mut standing) {
                *q -= compliance * tau;
            }
            return Ok(Solved {
                answer: finite(standing)?,
                iterations: made,
                residual_m,
            });
        }
        let [q1, q2, q3, a, b, c] = Lu::factor(&rows)?.solve(&errors);
        for (q, change) in standing.iter_mut().zip([q1, q2, q3]) {
            *q -= change;
        }
        let turn =
            rotation_from_vector(&-Vector3::new(a, b, c)).ok_or(KinematicsError::NotFinite)?;
        pose.rotation = turn * pose.rotation;
    }
    Err(KinematicsError::NotConverged {
        iterations: COLD_ITERATIONS,
        residual_m,
    })
}

/// By how much each link is too long for its tension, and how that changes with the carts and with the platform's turn:
/// rows `[s.v_1, s.v_2, s.v_3, -(l x s)]`, zero but for the link's own arm.
fn loaded(
    robot: &Robot,
    compliances: &Compliances,
    pose: &Pose,
    q: &[f64; ARMS],
    forces_n: &[f64; LINKS],
) -> ([f64; LINKS], [[f64; 6]; LINKS]) {
    let mut errors = [0.0; LINKS];
    let mut rows = [[0.0; 6]; LINKS];
    let springs = pairs(compliances.link_m_per_n(), forces_n);
    let described = errors.iter_mut().zip(&mut rows).zip(springs);
    for (((error, row), (compliance, force)), link) in
        described.zip(links(robot.geometry(), pose, q))
    {
        let length_m = norm(&link.vector_m);
        *error = length_m - link.length_m - compliance * force;
        let s = link.vector_m / length_m;
        let moment = link.lever_m.cross(&s);
        let drive = |arm| {
            if arm == link.arm {
                s.dot(&link.guideway)
            } else {
                0.0
            }
        };
        *row = [
            drive(0),
            drive(1),
            drive(2),
            -moment.x,
            -moment.y,
            -moment.z,
        ];
    }
    (errors, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compensation::compensated;
    use crate::kinematics::tests::{compliances, geometry, machine, skewed};
    use crate::stiffness::TauModel;
    use nalgebra::{Matrix3, Matrix6, Vector6};

    /// Where the tool of the elastic machine stands under a command, by Newton with differences over the pose: every axis where its own
    /// load leaves it, every link as long as its own tension makes it. Nothing of the map that is tested.
    fn stands(robot: &Robot, command: &[f64; ARMS], load: &Wrench, near: &Pose) -> Vector3<f64> {
        let springs = compliances();
        let errors = |pose: &Pose| {
            let mut q = *command;
            for _ in 0..20 {
                let lines = LineMatrix::new(robot, pose, &q).unwrap();
                let loads = lines.cart_loads(&lines.link_forces_n(load).unwrap());
                for axis in 0..ARMS {
                    q[axis] = command[axis] + springs.cart_m_per_n()[axis] * loads[axis];
                }
            }
            let forces = LineMatrix::new(robot, pose, &q)
                .unwrap()
                .link_forces_n(load)
                .unwrap();
            let mut errors = Vector6::zeros();
            for (index, link) in links(robot.geometry(), pose, &q).enumerate() {
                errors[index] = norm(&link.vector_m)
                    - link.length_m
                    - springs.link_m_per_n()[index] * forces[index];
            }
            errors
        };
        let step = |pose: &Pose, dx: &Vector6<f64>| Pose {
            position_m: pose.position_m + dx.fixed_rows::<3>(0),
            rotation: rotation_from_vector(&dx.fixed_rows::<3>(3).into_owned()).unwrap()
                * pose.rotation,
        };
        let mut pose = *near;
        for _ in 0..8 {
            let now = errors(&pose);
            let derivative = Matrix6::from_fn(|row, column| {
                let mut dx = Vector6::zeros();
                dx[column] = 1e-7;
                (errors(&step(&pose, &dx))[row] - now[row]) / 1e-7
            });
            pose = step(&pose, &-(derivative.try_inverse().unwrap() * now));
        }
        pose.position_m
    }

    #[test]
    fn a_held_tool_stands_where_it_should() {
        let (skewed, turn) = skewed();
        for (geometry, rotation) in [(geometry(), Matrix3::identity()), (skewed, turn)] {
            let robot = Robot::new(geometry).unwrap();
            let nominal = machine(geometry, &rotation);
            let position_m = rotation * Vector3::new(0.0, 0.5, 0.65);
            let pose = Pose {
                position_m,
                rotation,
            };
            let q = nominal.inverse(&position_m).unwrap();
            let load = Wrench::from_array([3000.0, -500.0, 1000.0, 10.0, 20.0, -10.0]);
            let off =
                |command: &[f64; ARMS]| norm(&(stands(&robot, command, &load, &pose) - position_m));
            let model = TauModel::new(&nominal, &compliances());
            let first_order = off(&compensated(&model, &position_m, &q, &load, 1.0).unwrap());
            let solved = held(&robot, &compliances(), &pose, &q, &load).unwrap();
            assert!(solved.residual_m < 1e-9, "{solved:?}");
            let exact = off(&solved.answer);
            assert!(off(&q) > 1e-3, "{}", off(&q));
            assert!(
                exact < 1e-9 && exact < 1e-3 * first_order,
                "{exact} {first_order}"
            );
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
            assert!(held(&robot, &compliances(), &pose, &q, &load).is_err());
        }
        let mirrored = Pose {
            rotation: -Matrix3::identity(),
            ..pose
        };
        let error = held(&robot, &compliances(), &mirrored, &q, &Wrench::zero()).unwrap_err();
        assert_eq!(error, KinematicsError::NotFinite);
    }
}
