//! The exact correction of three axes: large deflections, links that are not parallel, a platform that turns as it will.

use nalgebra::Vector3;

use super::{CompensatorConfig, CompensatorError, Correction};
use crate::model::kinematics::{COLD_ITERATIONS, KinematicsError, Pose, Solved, is_pose, links};
use crate::model::linalg::{Lu, larger, norm, product, rotation_from_vector};
use crate::model::robot::{ARMS, Compliances, LINKS, Robot};
use crate::model::statics::{LineMatrix, Wrench, finite};
use crate::zip::zip;

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
        residual_m = errors
            .iter()
            .fold(0.0, |most, error| larger(most, error.abs()));
        if residual_m <= SETTLED_M {
            let loads = lines.cart_loads(&forces);
            let springs = zip(compliances.cart_m_per_n(), &loads);
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
        pose.rotation = product(&turn, &pose.rotation);
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
    let springs = zip(compliances.link_m_per_n(), forces_n);
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

/// The exact map with gain, limits and units: from a wrench to offsets for the server, for a machine of three axes.
/// It costs several solves of six equations a cycle; [`Compensator`](super::Compensator) is the map to first order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactCompensator {
    robot: Robot,
    compliances: Compliances,
    config: CompensatorConfig,
}

impl ExactCompensator {
    /// Checks the configuration.
    ///
    /// # Errors
    /// [`CompensatorError`], naming the parameter and its axis.
    pub fn new(
        robot: &Robot,
        compliances: &Compliances,
        config: CompensatorConfig,
    ) -> Result<Self, CompensatorError> {
        config.check()?;
        Ok(Self {
            robot: *robot,
            compliances: *compliances,
            config,
        })
    }

    /// The configuration.
    #[must_use]
    pub const fn config(&self) -> &CompensatorConfig {
        &self.config
    }

    /// One cycle: offsets that hold the tool at `pose`'s position, which belongs to the nominal positions `q` (q-units),
    /// under `load`; the share `gain` of them.
    ///
    /// Whatever the load, what comes out is within the limits or an error.
    ///
    /// # Errors
    /// As [`held`].
    pub fn correction(
        &self,
        pose: &Pose,
        q: &[f64; ARMS],
        load: &Wrench,
    ) -> Result<Correction, KinematicsError> {
        let held = held(&self.robot, &self.compliances, pose, q, load)?;
        self.config.bounded_share(q, &held.answer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::compensation::compensated;
    use crate::model::kinematics::tests::{compliances, geometry, l2, machine, skewed};
    use crate::model::stiffness::TauModel;
    use crate::units::OffsetNm;
    use nalgebra::{Matrix3, Matrix6, Vector6};
    use proptest::prelude::*;

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

    const LIMIT: OffsetNm = OffsetNm(2_000_000);

    fn compensator(gain: f64, limit: OffsetNm) -> ExactCompensator {
        let config = CompensatorConfig {
            gain,
            limits: [limit; ARMS],
            metres_per_q: [1.0; ARMS],
        };
        let robot = Robot::new(geometry()).unwrap();
        ExactCompensator::new(&robot, &compliances(), config).unwrap()
    }

    fn home() -> (Pose, [f64; ARMS]) {
        let pose = Pose::at(Vector3::new(0.0, 0.5, 0.65));
        let q = l2().inverse(&pose.position_m).unwrap();
        (pose, q)
    }

    #[test]
    fn offsets_are_the_share_of_the_exact_map() {
        let (pose, q) = home();
        let load = Wrench::from_array([300.0, -50.0, 100.0, 1.0, 2.0, -1.0]);
        let robot = Robot::new(geometry()).unwrap();
        let exact = held(&robot, &compliances(), &pose, &q, &load).unwrap();
        for gain in [1.0, 0.5, 0.0] {
            let ours = compensator(gain, LIMIT)
                .correction(&pose, &q, &load)
                .unwrap();
            assert_eq!(ours.saturated, [false; ARMS]);
            for ((offset, q), held) in ours.offsets.iter().zip(q).zip(exact.answer) {
                let expected_m = gain * (held - q);
                // A nanometre is the offset's unit.
                assert!((offset.to_metres().0 - expected_m).abs() < 1e-9);
            }
        }
        let cut = compensator(1.0, OffsetNm(100_000)).correction(&pose, &q, &load);
        let cut = cut.unwrap();
        assert!(cut.saturated.contains(&true), "{cut:?}");
        assert!(cut.offsets.iter().all(|offset| offset.0.abs() <= 100_000));
        let mut config = *compensator(1.0, LIMIT).config();
        config.gain = f64::NAN;
        let refused = ExactCompensator::new(&robot, &compliances(), config);
        assert_eq!(refused, Err(CompensatorError::Gain));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(5_000))]
        #[test]
        fn the_output_is_bounded_for_any_load(
            load in prop::array::uniform6(prop_oneof![any::<f64>(), -1e7..1e7_f64, Just(f64::NAN)]),
            moved in -1e-3..1e-3_f64, gain in 0.0..=1.0_f64, limit in 0..=i32::MAX,
        ) {
            let (mut pose, q) = home();
            pose.position_m.x += moved;
            let answer = compensator(gain, OffsetNm(limit)).correction(&pose, &q, &Wrench::from_array(load));
            if let Ok(correction) = answer {
                prop_assert!(correction.offsets.iter().all(|offset| offset.0.abs() <= limit));
                prop_assert!(load.iter().all(|value| value.is_finite()));
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
