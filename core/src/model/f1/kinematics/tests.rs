//! The F1 against finite differences and itself, and its errors. `tests/tests/oracle.rs` has the
//! oracle.

use super::*;
use crate::model::f1::Geometry;
use crate::model::kinematics::{COLD_ITERATIONS, WARM_ITERATIONS};
use crate::model::l2;
use crate::model::l2::tests::{about_the_border, close, directions_of_a_cube};
use crate::model::linalg::rotation_from_vector;
use crate::model::presets::{self, F1_METRES_PER_Q};
use crate::model::robot::Branch;
use crate::model::statics::Wrench;
use nalgebra::Matrix3;
use proptest::prelude::*;
use std::string::ToString;

/// The example machine, its travel unchecked.
fn geometry() -> Geometry {
    Geometry {
        travel: None,
        ..presets::f1()
    }
}

/// The same machine with guideways that are neither parallel nor of unit length, other axes, and
/// links that are not alike.
fn skewed() -> Geometry {
    let mut geometry = geometry();
    geometry.guideways = [
        Vector3::new(0.02, -0.03, 0.9),
        Vector3::new(-0.05, 0.04, 1.3),
        Vector3::new(0.0001, 0.0, -0.004),
    ];
    geometry.configuration[2] = Branch::Negative;
    geometry.turn_axis = Vector3::new(0.05, -0.02, 2.0);
    geometry.tilt_axis = Vector3::new(0.1, 1.0, 0.03);
    geometry.lengths_m = [1.7, 1.71, 1.69, 1.72, 1.68, 1.7];
    geometry
}

mod inverse_fixed_plates;
mod statics;

fn kinematics(geometry: Geometry) -> Kinematics {
    Kinematics::new(&Robot::new(geometry).unwrap())
}

fn f1() -> Kinematics {
    kinematics(geometry())
}

/// Six numbers of one pose: where the tool stands, and its rotation vector.
fn pose(x: [f64; 6]) -> Pose {
    let [x, y, z, a, b, c] = x;
    Pose {
        position_m: Vector3::new(x, y, z),
        rotation: rotation_from_vector(&Vector3::new(a, b, c)).unwrap(),
    }
}

/// Largest difference of two poses: metres, radians.
fn apart(one: &Pose, other: &Pose) -> f64 {
    let moved = norm(&(one.position_m - other.position_m));
    moved.max((one.rotation - other.rotation).amax())
}

fn rotation(vector: Vector3<f64>) -> Matrix3<f64> {
    rotation_from_vector(&vector).unwrap()
}

/// Poses of the machine's workspace: turned as the plates turn it, and a little out of step.
fn workspace() -> impl Strategy<Value = Pose> {
    let turn = -0.3..0.3_f64;
    let small = -0.03..0.03_f64;
    let position = (-0.3..0.3_f64, -0.3..0.3_f64, 0.0..1.0_f64);
    (
        position,
        turn.clone(),
        turn,
        small.clone(),
        small.clone(),
        small,
    )
        .prop_map(|((x, y, z), yaw, tilt, a, b, c)| Pose {
            position_m: Vector3::new(x, y, z),
            rotation: rotation(Vector3::z() * yaw)
                * rotation(Vector3::y() * tilt)
                * rotation(Vector3::new(a, b, c)),
        })
}

#[test]
fn the_jacobian_is_the_derivative() {
    // Central differences of the forward problem: step h leaves h^2 of truncation and 1e-14 / h of
    // rounding, 1e-8 both.
    let step = 1e-5;
    for geometry in [geometry(), skewed()] {
        let machine = kinematics(geometry);
        let at = pose([0.1, -0.1, 0.4, 0.1, -0.05, 0.15]);
        let q = machine.inverse(&at, None).unwrap().value;
        let jacobian = machine.jacobian(&at, &q).unwrap();
        for axis in 0..AXES {
            let [ahead, behind] = [step, -step].map(|by| {
                let mut q = q;
                q[axis] += by;
                machine
                    .forward_from(&q, &at, COLD_ITERATIONS)
                    .unwrap()
                    .value
            });
            let translation = (ahead.position_m - behind.position_m) / (2.0 * step);
            let turn =
                (ahead.rotation * behind.rotation.transpose() - Matrix3::identity()) / (2.0 * step);
            let rotation = Vector3::new(turn[(2, 1)], turn[(0, 2)], turn[(1, 0)]);
            let column = jacobian.column(axis);
            for (row, value) in translation.iter().chain(rotation.iter()).enumerate() {
                assert!(
                    (column[row] - value).abs() < 1e-4,
                    "{axis} {row} {value} {column}"
                );
            }
        }
    }
}

#[test]
fn plates_in_step_need_neither_seed_nor_iteration() {
    let f1 = f1();
    let at = pose([0.05, -0.1, 0.3, 0.0, 0.0, 0.0]);
    let q = f1.inverse(&at, None).unwrap().value;
    let turned = [q[0] + 0.1, q[1] - 0.05, q[2], -0.2, 0.2, 0.15];
    let closed = f1.forward(&turned).unwrap();
    assert!(
        closed.iterations == 0 && closed.residual_m < 1e-14,
        "{closed:?}"
    );
    let general = f1.forward_from(&turned, &at, COLD_ITERATIONS).unwrap();
    assert!(apart(&closed.value, &general.value) < 1e-12, "{general:?}");
    assert_eq!(
        kinematics(skewed()).forward(&turned).unwrap_err(),
        KinematicsError::SeedRequired
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]
    #[test]
    fn there_and_back(at in workspace(), shift in prop::array::uniform6(-1e-3..1e-3_f64)) {
        // `six_axes` in tests/ asks this of the example.
        let machine = kinematics(skewed());
        let there = match machine.inverse(&at, None) {
            Ok(there) => there,
            Err(KinematicsError::Unreachable { .. }) => return Ok(()),
            Err(error) => return Err(TestCaseError::fail(std::format!("{error:?} {at:?}"))),
        };
        // What was checked are the links of the answer, to the bit: computed again from pose and
        // positions they are the same.
        let lengths = machine.robot().geometry().lengths_m;
        let links = machine.links_m(&at, &there.value);
        let expected = zip(&links, &lengths).map(|(link, length)| (surplus(link, *length) / length).abs());
        prop_assert_eq!(there.residual_m.to_bits(), expected.fold(0.0, f64::max).to_bits());
        // No further away than the cycle before at 1 m/s and 1 rad/s: half the diagonal of a cube
        // is 0.87 of its side.
        let [x, y, z, a, b, c] = shift.map(|side| side / 2.0);
        let near = Pose {
            position_m: at.position_m + Vector3::new(x, y, z),
            rotation: rotation_from_vector(&Vector3::new(a, b, c)).unwrap() * at.rotation,
        };
        for (most, tolerance) in [(WARM_ITERATIONS, 1e-10), (COLD_ITERATIONS, 1e-11)] {
            let back = machine.forward_from(&there.value, &near, most).unwrap();
            prop_assert!(apart(&back.value, &at) < tolerance && back.iterations <= most, "{back:?} {at:?}");
        }
    }
}

#[test]
fn what_has_no_answer_is_named() {
    let f1 = f1();
    let at = pose([0.05, -0.1, 0.3, 0.0, 0.1, 0.05]);
    let q = f1.inverse(&at, None).unwrap().value;
    let far = pose([5.0, 0.0, 0.3, 0.0, 0.0, 0.0]);
    assert!(matches!(
        f1.inverse(&far, None),
        Err(KinematicsError::Unreachable { .. })
    ));
    // Within reach of arm 1, and of the others' plates, but not of their links: found on a map of
    // the workspace as "singular".
    for place in [[-0.5, -0.69, 0.3], [-0.594, -0.617, -0.5]] {
        let beside = Pose::at(place.into());
        assert!(matches!(
            f1.inverse(&beside, None),
            Err(KinematicsError::Unreachable { arm: 1 | 2 })
        ));
    }
    for wild in [f64::NAN, f64::INFINITY] {
        let mut bad = at;
        bad.position_m.y = wild;
        assert_eq!(
            f1.inverse(&bad, None).unwrap_err(),
            KinematicsError::NotFinite
        );
        assert_eq!(
            f1.forward_from(&q, &bad, 10).unwrap_err(),
            KinematicsError::NotFinite
        );
        let mut bad = q;
        bad[4] = wild;
        assert_eq!(f1.forward(&bad).unwrap_err(), KinematicsError::NotFinite);
        assert_eq!(
            f1.forward_from(&bad, &at, 10).unwrap_err(),
            KinematicsError::NotFinite
        );
        assert_eq!(
            f1.inverse(&at, Some([0.0, wild, 0.0])).unwrap_err(),
            KinematicsError::NotFinite
        );
    }
    // The tool mirrored in the carts' plane: another assembly, with every arm on its other side.
    let mut mirrored = at;
    mirrored.position_m.z = 2.0 * q[0] - at.position_m.z;
    let error = f1.forward_from(&q, &mirrored, COLD_ITERATIONS).unwrap_err();
    assert!(
        matches!(error, KinematicsError::OtherBranch { .. }),
        "{error:?}"
    );
    // Far away: an answer there is the right one, or none.
    let away = pose([0.4, 0.4, -0.4, 1.2, -1.0, 2.0]);
    if let Ok(found) = f1.forward_from(&q, &away, COLD_ITERATIONS) {
        assert!(apart(&found.value, &at) < 1e-10, "{found:?}");
    }
    let mut apart_carts = q;
    apart_carts[0] += 5.0;
    assert!(matches!(
        f1.forward(&apart_carts),
        Err(KinematicsError::NoAssembly)
    ));
    // Zero iterations find no solution, and the next call works.
    assert!(matches!(
        f1.forward_from(&q, &pose([0.06, -0.1, 0.3, 0.0, 0.1, 0.05]), 0),
        Err(KinematicsError::NotConverged { iterations: 0, .. })
    ));
    assert!(f1.forward_from(&q, &at, WARM_ITERATIONS).is_ok());
}

#[test]
fn travel_and_sides_are_kept() {
    let at = pose([0.05, -0.1, 0.3, 0.0, 0.1, 0.05]);
    let q = f1().inverse(&at, None).unwrap().value;
    for axis in 0..AXES {
        let mut narrow = geometry();
        let mut travel = [(-3.0, 3.0); AXES];
        travel[axis] = (q[axis] + 1e-3, q[axis] + 1.0);
        narrow.travel = Some(travel);
        let narrow = kinematics(narrow);
        for error in [
            narrow.inverse(&at, None).unwrap_err(),
            narrow.forward_from(&q, &at, WARM_ITERATIONS).unwrap_err(),
        ] {
            assert!(
                matches!(error, KinematicsError::OutOfRange { axis: named, .. } if named == axis),
                "{error:?}"
            );
        }
    }
    let mut other = geometry();
    other.configuration[1] = Branch::Negative;
    let error = kinematics(other)
        .forward_from(&q, &at, WARM_ITERATIONS)
        .unwrap_err();
    assert_eq!(error, KinematicsError::OtherBranch { arm: Some(1) });
}

#[test]
fn singular_machines_are_refused() {
    // Every platform joint in one point: no link can turn the platform.
    let mut flat = geometry();
    flat.platform_joints_m = [Vector3::zeros(); LINKS];
    let flat = kinematics(flat);
    let at = pose([0.0, 0.0, 0.3, 0.0, 0.0, 0.0]);
    let q = [1.5, 1.5, 1.5, 0.0, 0.0, 0.0];
    assert!(matches!(
        flat.forward_from(&q, &at, COLD_ITERATIONS),
        Err(KinematicsError::Singular { .. })
    ));
    // Plate 2's joints on its axis: turning it changes nothing.
    let mut idle = geometry();
    idle.plate_joints_m[1] = Vector3::zeros();
    idle.plate_joints_m[2] = Vector3::z() * 0.1;
    assert!(matches!(
        kinematics(idle).inverse(&at, None),
        Err(KinematicsError::Singular { .. })
    ));
}

type Change = fn(&mut Geometry);

/// Checksum of a changed machine.
fn checksum(change: Change) -> u32 {
    let mut geometry = geometry();
    change(&mut geometry);
    kinematics(geometry).checksum(&F1_METRES_PER_Q)
}

#[test]
fn machines_are_validated() {
    let refused: [(Change, &str); 6] = [
        (|g| g.carts_m[1].x = f64::NAN, "C[1] is not finite"),
        (
            |g| g.plate_joints_m[3].y = f64::INFINITY,
            "P[3] is not finite",
        ),
        (
            |g| g.lengths_m[5] = 0.0,
            "L[5] must have a magnitude from 1e-6 to 1e3",
        ),
        (
            |g| g.turn_axis = Vector3::zeros(),
            "ax[0] must have a magnitude from 1e-6 to 1e3",
        ),
        (
            |g| g.tilt_axis = Vector3::zeros(),
            "ax6[0] must have a magnitude from 1e-6 to 1e3",
        ),
        (
            |g| g.travel = Some([(1.0, -1.0); AXES]),
            "travel[0] has its lower end above its upper end",
        ),
    ];
    for (change, error) in refused {
        let mut wrong = geometry();
        change(&mut wrong);
        assert_eq!(Robot::new(wrong).unwrap_err().to_string(), error);
    }
    let ours = checksum(|_| {});
    assert_eq!(ours, checksum(|g| g.travel = Some([(-1.0, 1.0); AXES])));
    assert_eq!(ours, checksum(|g| g.turn_axis *= 2.0));
    assert_ne!(ours, checksum(|g| g.turn_signs[0] = Branch::Positive));
    assert_ne!(ours, checksum(|g| g.lengths_m[2] += 1e-9));
    let kinematics = Kinematics::new(&Robot::new(geometry()).unwrap());
    for axis in 0..AXES {
        let mut screws = F1_METRES_PER_Q;
        screws[axis] *= 1.0 + 1e-15;
        assert_ne!(ours, kinematics.checksum(&screws), "axis {axis}");
    }
}

/// The L2 as six links: the nominal model where the Tau property holds, and a turned platform where
/// it does not.
#[test]
fn three_axes_are_six_links() {
    let l2 = l2::tests::geometry();
    let nominal = l2::tests::l2();
    let at = Pose::at(Vector3::new(0.05, 0.5, 0.6));
    let [q1, q2, q3] = nominal.inverse(&at.position_m).unwrap();
    let q = [q1, q2, q3, 0.0, 0.0, 0.0];
    let near = pose([0.06, 0.49, 0.61, 0.01, -0.02, 0.01]);
    let tau = kinematics(Geometry::from(&l2));
    let found = tau.forward_from(&q, &near, COLD_ITERATIONS).unwrap();
    assert!(apart(&found.value, &at) < 1e-12, "{found:?}");
    // Joints out of place: the exact map without load turns the platform and keeps the tool.
    let mut displaced = l2;
    displaced.platform_joints_m[2].y += 2e-3;
    displaced.platform_joints_m[4].z -= 3e-3;
    let robot = l2::Robot::new(displaced).unwrap();
    let held = l2::exact_command(
        &robot,
        &presets::l2_compliances(),
        &at,
        &[q1, q2, q3],
        &Wrench::zero(),
    )
    .unwrap();
    let [h1, h2, h3] = held.value;
    let displaced = kinematics(Geometry::from(&displaced));
    let found = displaced
        .forward_from(&[h1, h2, h3, 0.0, 0.0, 0.0], &at, COLD_ITERATIONS)
        .unwrap()
        .value;
    assert!(
        norm(&(found.position_m - at.position_m)) < 1e-9,
        "{found:?}"
    );
    let turned = (found.rotation - at.rotation).amax();
    assert!(turned > 1e-3, "the platform turns: {turned}");
    let mut uneven = Geometry::from(&l2);
    uneven.lengths_m[2] += 1e-3;
    uneven.lengths_m[4] -= 2e-3;
    let uneven = kinematics(uneven);
    let found = uneven.forward_from(&q, &at, COLD_ITERATIONS).unwrap();
    assert!(found.residual_m < 1e-12, "{found:?}");
    let turned = (found.value.rotation - Matrix3::identity()).amax();
    assert!(turned > 1e-3, "the platform turns: {turned}");
}

mod loaded {
    use super::*;
    use crate::model::compensation::CompensatorConfig;
    use crate::model::f1::{Compensator, Elastic};
    use crate::model::stiffness;
    use crate::units::OffsetNm;

    fn elastic(geometry: Geometry) -> Elastic {
        Elastic::new(&kinematics(geometry), &presets::f1_compliances())
    }

    /// Returns the elastic machine's pose under a command.
    fn stands(machine: &Elastic, command: &[f64; AXES], load: &Wrench, near: &Pose) -> Pose {
        let kinematics = machine.kinematics();
        stiffness::tests::stands(
            |pose, q| kinematics.line_matrix(pose, q).unwrap(),
            |pose, q| {
                let lengths = kinematics.robot().geometry().lengths_m;
                let links = kinematics.links_m(pose, q);
                std::array::from_fn(|i| norm(&links[i]) - lengths[i])
            },
            machine.compliances(),
            command,
            load,
            near,
        )
    }

    #[test]
    fn a_corrected_machine_stands_where_it_should() {
        for geometry in [geometry(), skewed()] {
            let machine = elastic(geometry);
            let at = pose([0.1, -0.1, 0.4, 0.02, -0.15, 0.2]);
            let q = machine.kinematics().inverse(&at, None).unwrap().value;
            let load = Wrench::from_array([200.0, -90.0, 150.0, 8.0, -5.0, 3.0]);
            let without = apart(&stands(&machine, &q, &load, &at), &at);
            let first_order = machine.command(&at, &q, &load, 1.0).unwrap();
            let first_order = apart(&stands(&machine, &first_order, &load, &at), &at);
            let held = machine.exact_command(&at, &q, &load).unwrap();
            assert!(held.residual_m < 1e-9, "{held:?}");
            let exact = apart(&stands(&machine, &held.value, &load, &at), &at);
            assert!(without > 1e-4, "{without}");
            assert!(first_order < 2e-2 * without, "{first_order} {without}");
            assert!(exact < 1e-9, "{exact}");
        }
    }

    fn load(n: f64) -> Wrench {
        Wrench::from_array([n, -n, n, 0.05 * n, 0.0, 0.0])
    }

    #[test]
    fn offsets_are_within_their_limits() {
        let at = pose([0.1, -0.1, 0.4, 0.0, -0.15, 0.2]);
        let machine = elastic(geometry());
        let q = machine.kinematics().inverse(&at, None).unwrap().value;
        let config = CompensatorConfig {
            gain: 1.0,
            limits: [OffsetNm(300_000); AXES],
            metres_per_q: [1.0, 1.0, 1.0, 0.1, 0.1, 0.1],
        };
        let compensator =
            Compensator::new(machine.kinematics(), machine.compliances(), config).unwrap();
        let light = compensator.correct_at(&at, &q, &load(30.0)).unwrap();
        assert!(
            light.offsets.iter().all(|offset| offset.0 != 0),
            "{light:?}"
        );
        assert_eq!(light.saturated, [false; AXES]);
        let heavy = compensator.correct_at(&at, &q, &load(3_000.0)).unwrap();
        assert!(heavy.saturated.contains(&true), "{heavy:?}");
        assert!(heavy.offsets.iter().all(|offset| offset.0.abs() <= 300_000));
        let exact = compensator.correct_exact_at(&at, &q, &load(30.0)).unwrap();
        for (exact, first_order) in exact.offsets.iter().zip(light.offsets) {
            // To first order the same: a per cent of some tens of micrometres.
            assert!((exact.0 - first_order.0).abs() < 1_000, "{exact:?}");
        }
        let heavy = compensator.correct_exact_at(&at, &q, &load(3_000.0));
        let heavy = heavy.unwrap();
        assert!(heavy.saturated.contains(&true), "{heavy:?}");
        assert!(heavy.offsets.iter().all(|offset| offset.0.abs() <= 300_000));
        let half = CompensatorConfig {
            gain: 0.5,
            ..config
        };
        let half = Compensator::new(machine.kinematics(), machine.compliances(), half).unwrap();
        let half = half.correct_exact_at(&at, &q, &load(30.0)).unwrap();
        for (half, all) in half.offsets.iter().zip(exact.offsets) {
            assert!((2 * half.0 - all.0).abs() <= 1, "{half:?}");
        }
        for wild in [f64::NAN, f64::INFINITY, 1e300] {
            assert!(compensator.correct_at(&at, &q, &load(wild)).is_err());
            assert!(compensator.correct_exact_at(&at, &q, &load(wild)).is_err());
        }
        let refused = CompensatorConfig {
            gain: 1.1,
            ..config
        };
        assert!(Compensator::new(machine.kinematics(), machine.compliances(), refused).is_err());
    }
}

/// A machine whose answer is `q`, with the first link of an arm at this slope against across its
/// guideway.
fn nearly_across(
    at: &Pose,
    mut q: [f64; AXES],
    arm: usize,
    slope: f64,
) -> (Kinematics, [f64; AXES]) {
    let mut made = geometry();
    let first = [0, 1, 3][arm];
    let link = f1().links_m(at, &q)[first];
    q[arm] += slope * norm(&link.cross(&Vector3::z())) - link.z;
    made.lengths_m = f1().links_m(at, &q).map(|link| norm(&link));
    (kinematics(made), q)
}

/// The plates of the seed are a little off, and the cart starts too near to the foot of the
/// perpendicular, or would start beyond it.
#[test]
fn a_link_nearly_across_its_guideway_is_solved() {
    let at = pose([0.05, -0.1, 0.3, 0.0, 0.1, 0.05]);
    for slope in [1e-3, 0.01, 0.02, 0.025, 0.03, 0.05] {
        for turn in [-0.05, 0.0, 0.1] {
            let (machine, q) = nearly_across(&at, [1.5, 1.5, 1.5, -turn, turn, -0.1], 1, slope);
            for off in [-0.002, -0.001, 0.0, 0.001, 0.002] {
                let found = machine.inverse(&at, Some([q[3] + off, q[4] + off, q[5]]));
                let known = found
                    .is_ok_and(|found| zip(&found.value, &q).all(|(x, y)| (x - y).abs() < 1e-9));
                assert!(known, "{slope} {turn} {off}: {q:?}, not {found:?}");
            }
        }
    }
}

/// The seed fits every link, but arm 3 is not on its side: an answer farther away does not replace
/// that verdict.
#[test]
fn a_verdict_from_a_fitting_seed_stands() {
    let at = pose([0.05, -0.1, 0.3, -0.05, 0.1, 0.05]);
    let (machine, q) = nearly_across(&at, [1.5, 1.5, 1.5, 0.0, 0.0, 0.0], 2, 0.01);
    let found = machine.inverse(&at, Some([q[3], q[4], q[5]]));
    assert_eq!(found, Err(KinematicsError::OtherBranch { arm: Some(2) }));
}

/// A machine that is so many times as large; its positions stay in q-units.
fn scaled(mut geometry: Geometry, factor: f64) -> Geometry {
    for joint in (geometry.carts_m.iter_mut())
        .chain(&mut geometry.plate_joints_m)
        .chain(&mut geometry.platform_joints_m)
        .chain(&mut geometry.guideways)
    {
        *joint *= factor;
    }
    geometry.lengths_m = geometry.lengths_m.map(|length| length * factor);
    geometry
}

/// As of the L2: a machine of the same shape has the same answers and refusals, to the bit.
#[test]
fn size_does_not_matter() {
    for geometry in [geometry(), skewed()] {
        let small = kinematics(geometry);
        let home = pose([0.1, -0.05, 0.4, 0.02, 0.1, -0.05]);
        let home_q = small.inverse(&home, None).unwrap().value;
        for factor in [0.25, 8.0] {
            let large = kinematics(scaled(geometry, factor));
            let grown = |pose: &Pose| Pose {
                position_m: pose.position_m * factor,
                ..*pose
            };
            let grown_error = |error| match error {
                KinematicsError::NotConverged {
                    iterations,
                    residual_m,
                } => KinematicsError::NotConverged {
                    iterations,
                    residual_m: residual_m * factor,
                },
                error => error,
            };
            for direction in directions_of_a_cube() {
                let place = |way: f64| Pose {
                    position_m: home.position_m + direction * way,
                    ..home
                };
                for way in about_the_border(|way| small.inverse(&place(way), None).is_ok()) {
                    let near = small.inverse(&place(way), None);
                    let far = large.inverse(&grown(&place(way)), None);
                    assert_eq!(
                        near.map(|found| found.value).map_err(grown_error),
                        far.map(|found| found.value),
                        "{way}"
                    );
                }
                let positions = |way: f64| -> [f64; AXES] {
                    let [x, y, z] = direction.into();
                    let moved = [x, y, z, 0.1 * y, 0.1 * z, 0.1 * x];
                    core::array::from_fn(|axis| home_q[axis] + moved[axis] * way)
                };
                let from_home = |q: &[f64; AXES]| small.forward_from(q, &home, COLD_ITERATIONS);
                for way in about_the_border(|way| from_home(&positions(way)).is_ok()) {
                    let q = positions(way);
                    let near = from_home(&q);
                    let far = large.forward_from(&q, &grown(&home), COLD_ITERATIONS);
                    assert_eq!(
                        near.map(|found| grown(&found.value)).map_err(grown_error),
                        far.map(|found| found.value),
                        "{q:?}"
                    );
                }
            }
        }
    }
}
