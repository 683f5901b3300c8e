//! Three axes whose links are not alike within their clusters: the carts for a place of the tool.

use super::*;
use crate::model::l2::exact_command;
use crate::model::l2::tests::{compliances, geometry as l2_geometry, l2, skewed as skewed_l2};

const STILL: [f64; 3] = [0.0; 3];

/// Changes of the links' lengths by up to 5 mm, and of their joints by up to 1 mm.
fn errors() -> impl Strategy<Value = ([f64; LINKS], [[f64; 3]; LINKS])> {
    let joints = prop::array::uniform3(-1e-3..1e-3_f64);
    (
        prop::array::uniform6(-5e-3..5e-3_f64),
        prop::array::uniform6(joints),
    )
}

fn uneven((lengths, joints): ([f64; LINKS], [[f64; 3]; LINKS])) -> Geometry {
    let mut geometry = Geometry::from(&l2_geometry());
    for link in 0..LINKS {
        geometry.lengths_m[link] += lengths[link];
        geometry.platform_joints_m[link] += Vector3::from(joints[link]);
    }
    geometry
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]
    #[test]
    fn uneven_links_turn_the_platform_and_keep_the_tool(
        errors in errors(), x in -0.3..0.3_f64, y in 0.3..0.55_f64, z in 0.5..0.75_f64,
    ) {
        let machine = kinematics(uneven(errors));
        let place = Vector3::new(x, y, z);
        let found = machine.inverse_fixed_plates(&place, &STILL, &Matrix3::identity(), COLD_ITERATIONS);
        // Nothing in this part of the workspace is out of reach or near a singularity.
        let found = found.map_err(|error| TestCaseError::fail(error.kind()))?;
        let (q, pose) = found.value;
        prop_assert_eq!(pose.position_m, place);
        prop_assert_eq!(&q[3..], &[0.0; 3]);
        prop_assert!(found.iterations <= 6 && found.residual_m < 1e-13, "{found:?}");
        // Every link, by its definition.
        let geometry = machine.robot().geometry();
        for link in 0..LINKS {
            let arm = [0, 1, 1, 2, 2, 2][link];
            let cart = geometry.plate_joints_m[link] + geometry.guideways[arm] * q[arm];
            let end = place + pose.rotation * geometry.platform_joints_m[link];
            prop_assert!((norm(&(cart - end)) - geometry.lengths_m[link]).abs() < 1e-12);
        }
        // And forward, which knows nothing of this solver, leads back; a cycle later two solves are
        // enough.
        let back = machine.forward_from(&q, &pose, COLD_ITERATIONS).unwrap().value;
        prop_assert!(apart(&back, &pose) < 1e-10, "{back:?}");
        let moved = place + Vector3::new(6e-4, -6e-4, 5e-4);
        let warm = machine.inverse_fixed_plates(&moved, &STILL, &pose.rotation, WARM_ITERATIONS).unwrap();
        prop_assert!(warm.residual_m < 1e-10, "{warm:?}");
    }
}

#[test]
fn the_tau_machine_is_not_turned() {
    let (skewed, turn) = skewed_l2();
    let upright = Matrix3::identity();
    for (geometry, rotation) in [(l2_geometry(), upright), (skewed, turn)] {
        let place = rotation * Vector3::new(0.05, 0.5, 0.6);
        let nominal = l2::tests::machine(geometry, &rotation);
        let machine = kinematics(Geometry::from(&geometry));
        // From a platform that is a little turned.
        let near = rotation_from_vector(&Vector3::new(0.02, -0.01, 0.03)).unwrap() * rotation;
        let found = machine.inverse_fixed_plates(&place, &STILL, &near, COLD_ITERATIONS);
        let (q, pose) = found.unwrap().value;
        assert!((pose.rotation - rotation).amax() < 1e-12);
        let [q1, q2, q3, ..] = q;
        close(&[q1, q2, q3], &nominal.inverse(&place).unwrap(), 1e-12, "q");
    }
}

#[test]
fn it_is_what_the_loaded_machine_does_without_load() {
    let mut geometry = l2_geometry();
    geometry.platform_joints_m[2].y += 2e-3;
    geometry.platform_joints_m[4].z -= 3e-3;
    let at = Pose::at(Vector3::new(0.05, 0.5, 0.6));
    let near = l2().inverse(&at.position_m).unwrap();
    let robot = l2::Robot::new(geometry).unwrap();
    let unloaded = exact_command(&robot, &compliances(), &at, &near, &Wrench::zero()).unwrap();
    let machine = kinematics(Geometry::from(&geometry));
    let found = machine.inverse_fixed_plates(&at.position_m, &STILL, &at.rotation, COLD_ITERATIONS);
    let (q, pose) = found.unwrap().value;
    let turned = (pose.rotation - at.rotation).amax();
    assert!(turned > 1e-3, "{turned}");
    // `exact_command` converges within 1e-10 m of each link's length.
    close(&q[..3], &unloaded.value, 1e-9, "q");
}

#[test]
fn the_plates_stay_as_they_are_told() {
    let f1 = f1();
    let at = pose([0.1, -0.1, 0.4, 0.02, -0.15, 0.2]);
    let q = f1.inverse(&at, None).unwrap().value;
    let near = pose([0.0, 0.0, 0.0, 0.0, -0.13, 0.18]).rotation;
    let found = f1.inverse_fixed_plates(&at.position_m, &[q[3], q[4], q[5]], &near, 10);
    let (found, turned) = found.unwrap().value;
    close(&found, &q, 1e-12, "q");
    assert!(apart(&turned, &at) < 1e-12);
}

/// Returns the error of a machine for a tool position (metres), with plates that stay at zero.
fn refused(
    geometry: Geometry,
    place: Vector3<f64>,
    near: Matrix3<f64>,
    iterations: u8,
) -> KinematicsError {
    kinematics(geometry)
        .inverse_fixed_plates(&place, &STILL, &near, iterations)
        .unwrap_err()
}

#[test]
fn what_is_not_to_be_had_is_refused_by_its_code() {
    let mut geometry = uneven(([3e-3, -2e-3, 4e-3, -5e-3, 1e-3, 5e-3], [[0.0; 3]; LINKS]));
    let upright = Matrix3::identity();
    let place = Vector3::new(0.05, 0.5, 0.6);
    for wild in [f64::NAN, f64::INFINITY] {
        let place = Vector3::new(wild, 0.5, 0.6);
        assert_eq!(
            refused(geometry, place, upright, 10),
            KinematicsError::NotFinite
        );
        assert_eq!(
            refused(geometry, Vector3::zeros(), upright * wild, 10),
            KinematicsError::NotFinite
        );
    }
    assert_eq!(
        refused(geometry, place, -upright, 10),
        KinematicsError::NotFinite
    );
    let far = Vector3::new(0.0, 2.0, 0.6);
    assert_eq!(
        refused(geometry, far, upright, 10),
        KinematicsError::Unreachable { arm: 0 }
    );
    let early = refused(geometry, place, upright, 1);
    assert!(
        matches!(early, KinematicsError::NotConverged { iterations: 1, residual_m } if residual_m > 1e-9),
        "{early:?}"
    );
    // Links 31, 32 and 33 side by side hold no turn about the line they lie in.
    let mut flat = geometry;
    let shift = Vector3::new(0.12, -0.05, 0.05) - flat.plate_joints_m[5];
    flat.plate_joints_m[5] += shift;
    flat.platform_joints_m[5] += shift;
    flat.lengths_m[5] = flat.lengths_m[4];
    let error = refused(flat, place, upright, 10);
    assert!(
        matches!(error, KinematicsError::Singular { .. }),
        "{error:?}"
    );
    geometry.travel = Some([
        (-2.0, 0.0),
        (-2.0, 2.0),
        (-2.0, 2.0),
        (0.0, 0.0),
        (0.0, 0.0),
        (0.0, 0.0),
    ]);
    let error = refused(geometry, place, upright, 10);
    assert!(
        matches!(error, KinematicsError::OutOfRange { axis: 0, .. }),
        "{error:?}"
    );
}
