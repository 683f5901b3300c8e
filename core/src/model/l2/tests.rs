use super::*;
use crate::model::kinematics::{KinematicsError, Pose, SINGULARITY_TOLERANCE, is_pose};
use crate::model::linalg::{norm, rotation_from_vector};
use crate::model::presets;
use crate::model::robot::{ARMS, Branch, Compliances, MAX_LENGTH_M};
use crate::model::statics::Wrench;
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;
use std::vec::Vec;

/// The example machine, its travel unchecked.
pub(crate) fn geometry() -> Geometry {
    Geometry {
        travel: None,
        ..presets::l2()
    }
}

/// The same machine with guideways that are neither parallel nor of unit length, seen from turned
/// world axes.
pub(crate) fn skewed() -> (Geometry, Matrix3<f64>) {
    let turn = rotation_from_vector(&Vector3::new(0.4, -0.7, 0.3)).unwrap();
    let mut geometry = geometry();
    geometry.guideways = [
        turn * Vector3::new(0.9, 0.05, -0.03),
        turn * Vector3::new(1.4, -0.1, 0.08),
        turn * Vector3::new(-0.003, 0.0001, 0.0002),
    ];
    // The third guideway points the other way, so that its link is on its other side.
    geometry.configuration.inverse[2] = Branch::Negative;
    for joint in &mut geometry.cart_joints_m {
        *joint = turn * *joint;
    }
    (geometry, turn)
}

/// Both machines, each with the constant orientation of its platform.
pub(crate) fn machines() -> [(Geometry, Matrix3<f64>); 2] {
    [(geometry(), Matrix3::identity()), skewed()]
}

pub(crate) fn machine(geometry: Geometry, rotation: &Matrix3<f64>) -> Kinematics {
    Kinematics::new(&Robot::new(geometry).unwrap(), rotation).unwrap()
}

pub(crate) fn l2() -> Kinematics {
    machine(geometry(), &Matrix3::identity())
}

pub(crate) fn compliances() -> Compliances<AXES> {
    presets::l2_compliances()
}

/// Largest difference over largest magnitude of the reference.
pub(crate) fn close(ours: &[f64], reference: &[f64], tolerance: f64, what: &str) {
    assert_eq!(ours.len(), reference.len(), "{what}");
    let magnitude = reference.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    for (a, b) in ours.iter().zip(reference) {
        assert!(
            (a - b).abs() <= tolerance * magnitude,
            "{what}: {ours:?} {reference:?}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn what_inverse_returns_forward_takes_back(
        x in -0.9..0.9_f64, y in -1.3..1.3_f64, z in -0.9..2.2_f64, skew: bool,
    ) {
        let (geometry, rotation) = machines()[usize::from(skew)];
        let nominal = machine(geometry, &rotation);
        let tcp = rotation * Vector3::new(x, y, z);
        if let Ok(q) = nominal.inverse_in_assembly(&tcp) {
            let residual = Robot::new(geometry).unwrap().residual_m(&Pose { position_m: tcp, rotation }, &q);
            prop_assert!(residual < 1e-13, "{residual}");
            match nominal.forward(&q) {
                Ok(back) => prop_assert!(norm(&(back - tcp)) < 1e-10, "{back} {tcp}"),
                // Both ways refuse at the same measure; rounding may put a pose on either side of
                // it.
                Err(error) => prop_assert!(
                    matches!(error, KinematicsError::Singular { measure } if measure > 0.999 * SINGULARITY_TOLERANCE), "{error}"
                ),
            }
        }
    }

    #[test]
    fn what_forward_returns_inverse_takes_back(
        q1 in -1.0..2.0_f64, q2 in -2.0..1.0_f64, q3 in -1.0..2.0_f64, skew: bool,
    ) {
        let (geometry, rotation) = machines()[usize::from(skew)];
        let (nominal, q) = (machine(geometry, &rotation), [q1, q2, if skew { q3 * -333.0 } else { q3 }]);
        if let Ok(tcp) = nominal.forward(&q) {
            match nominal.inverse_in_assembly(&tcp) {
                Ok(back) => for ((back, q), origin) in back.iter().zip(q).zip(&nominal.arms) {
                    prop_assert!((back - q).abs() * norm(&origin.guideway) < 1e-10, "{back} {q}");
                },
                Err(error) => prop_assert!(
                    matches!(error, KinematicsError::Singular { measure } if measure > 0.999 * SINGULARITY_TOLERANCE), "{error}"
                ),
            }
        }
    }
}

#[test]
fn the_jacobian_is_the_derivative_of_forward() {
    for (geometry, turn) in machines() {
        let nominal = machine(geometry, &turn);
        let tcp = turn * Vector3::new(0.1, 0.45, 0.6);
        let q = nominal.inverse(&tcp).unwrap();
        let jacobian = nominal.jacobian(&tcp).unwrap();
        for axis in 0..AXES {
            let step = 1e-5 / norm(&nominal.arms[axis].guideway);
            let [ahead, behind] = [step, -step].map(|by| {
                let mut moved = q;
                moved[axis] += by;
                nominal.forward(&moved).unwrap()
            });
            let difference = (ahead - behind) / (2.0 * step);
            let ours = jacobian.column(axis).into_owned();
            assert!(
                norm(&(difference - ours)) < 1e-8 * norm(&ours),
                "{difference} {ours}"
            );
        }
    }
}

fn inverse_error(nominal: &Kinematics, tcp_m: [f64; 3]) -> KinematicsError {
    nominal.inverse_in_assembly(&tcp_m.into()).unwrap_err()
}

#[test]
fn every_refusal_of_inverse_has_its_code() {
    let nominal = l2();
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(
            inverse_error(&nominal, [bad, 0.5, 0.6]),
            KinematicsError::NotFinite
        );
        assert_eq!(
            inverse_error(&nominal, [0.0, 0.5, bad]),
            KinematicsError::NotFinite
        );
    }
    assert_eq!(
        inverse_error(&nominal, [0.0, 1.2, 0.6]),
        KinematicsError::Unreachable { arm: 0 }
    );
    assert_eq!(
        inverse_error(&nominal, [0.0, 0.2, 1.12]),
        KinematicsError::Unreachable { arm: 2 }
    );
    assert_eq!(
        inverse_error(&nominal, [1e300, 0.5, 0.6]),
        KinematicsError::Unreachable { arm: 0 }
    );
    assert_eq!(
        inverse_error(&nominal, [0.0, f64::MAX, 0.6]),
        KinematicsError::Unreachable { arm: 0 }
    );
    assert!(matches!(
        inverse_error(&nominal, [5000.0, 0.5, 0.6]),
        KinematicsError::OutOfRange { axis: 0, .. }
    ));
    // On the other side of the carts' plane.
    assert_eq!(
        inverse_error(&nominal, [0.0, -0.6, 0.6]),
        KinematicsError::OtherBranch { arm: None }
    );
    // Straight across the guideway of arm 1, to the last bit and nearly.
    for y in [1.0, 1.0 - 1e-10] {
        let Err(KinematicsError::Singular { measure }) =
            nominal.inverse(&Vector3::new(0.0, y, 1.25))
        else {
            // Arm 3 is out of reach there too, and arm 1 is looked at first.
            panic!("{:?}", nominal.inverse(&Vector3::new(0.0, y, 1.25)));
        };
        assert!(measure < SINGULARITY_TOLERANCE);
    }
}

#[test]
fn travel_is_checked_and_named() {
    let mut geometry = geometry();
    let tcp = Vector3::new(0.0, 0.5, 0.65);
    let q = l2().inverse(&tcp).unwrap();
    for axis in 0..AXES {
        let mut travel = [(-2.0, 2.0); AXES];
        travel[axis] = (q[axis] + 1e-9, 2.0);
        geometry.travel = Some(travel);
        let nominal = machine(geometry, &Matrix3::identity());
        for error in [
            nominal.inverse(&tcp).unwrap_err(),
            nominal.forward(&q).unwrap_err(),
        ] {
            assert!(
                matches!(error, KinematicsError::OutOfRange { axis: named, .. } if named == axis)
            );
        }
        assert_eq!(nominal.without_travel().inverse(&tcp), Ok(q));
        assert_eq!(nominal.inverse(&tcp).unwrap_err().kind(), "out_of_range");
    }
}

#[test]
fn every_refusal_of_forward_has_its_code() {
    let nominal = l2();
    assert_eq!(
        nominal.forward(&[f64::NAN, 0.0, 0.0]).unwrap_err(),
        KinematicsError::NotFinite
    );
    assert_eq!(
        nominal.forward(&[0.0, 0.0, f64::INFINITY]).unwrap_err(),
        KinematicsError::NotFinite
    );
    assert_eq!(
        nominal.forward(&[0.0, 5.0, 0.0]).unwrap_err(),
        KinematicsError::NoAssembly
    );
    assert!(matches!(
        nominal.forward(&[0.0, 0.0, 2000.0]).unwrap_err(),
        KinematicsError::OutOfRange { axis: 2, .. }
    ));
    // All carts on the tool's other side: arm 2 would have to point forwards.
    assert!(matches!(
        nominal.forward(&[0.5, 0.6, 0.5]).unwrap_err(),
        KinematicsError::OtherBranch { arm: Some(_) }
    ));
    // Carts in one line: a circle of solutions.
    let mut geometry = geometry();
    geometry.cart_joints_m[1].y += 0.35;
    geometry.cart_joints_m[2].y += 0.35;
    let in_line = machine(geometry, &Matrix3::identity());
    assert_eq!(
        in_line.forward(&[0.3, 0.3, 0.3]),
        Err(KinematicsError::Singular { measure: 0.0 })
    );
}

#[test]
fn pose_and_positions_must_belong_together() {
    let nominal = l2();
    let tcp = Vector3::new(0.0, 0.5, 0.65);
    let mut q = nominal.inverse(&tcp).unwrap();
    assert!(nominal.link_frame(&tcp, &q).is_ok());
    q[1] += 1e-5;
    assert_eq!(
        nominal.link_frame(&tcp, &q),
        Err(KinematicsError::Inconsistent { arm: 1 })
    );
    q[1] = f64::NAN;
    assert_eq!(
        nominal.link_frame(&tcp, &q),
        Err(KinematicsError::NotFinite)
    );
    let q = nominal.inverse(&tcp).unwrap();
    for component in 0..3 {
        let mut bad = tcp;
        bad[component] = f64::NAN;
        assert!(!is_pose(&Pose::at(bad)));
        assert_eq!(
            nominal.link_frame(&bad, &q),
            Err(KinematicsError::NotFinite)
        );
    }
}

#[test]
fn the_tau_property_is_checked_link_by_link() {
    for link in [2, 4, 5] {
        let mut geometry = geometry();
        geometry.cart_joints_m[link].y += 1e-6;
        let error =
            Kinematics::new(&Robot::new(geometry).unwrap(), &Matrix3::identity()).unwrap_err();
        assert!(
            matches!(error, OrientationError::NotTau { link: named, mismatch_m } if named == link && (mismatch_m - 1e-6).abs() < 1e-12)
        );
    }
    let robot = Robot::new(geometry()).unwrap();
    let turned = rotation_from_vector(&Vector3::new(0.0, 0.0, 0.1)).unwrap();
    assert!(matches!(
        Kinematics::new(&robot, &turned),
        Err(OrientationError::NotTau { link: 2, .. })
    ));
    for wrong in [
        Matrix3::identity() * 1.1,
        -Matrix3::identity(),
        Matrix3::from_element(f64::NAN),
    ] {
        assert!(matches!(
            Kinematics::new(&robot, &wrong),
            Err(OrientationError::NotRotation { .. })
        ));
    }
}

#[test]
fn the_residual_is_the_error_of_the_worst_link() {
    let robot = Robot::new(geometry()).unwrap();
    let tcp = Vector3::new(0.0, 0.5, 0.65);
    let q = l2().inverse(&tcp).unwrap();
    let turned = rotation_from_vector(&Vector3::new(0.0, 0.0, 1e-3)).unwrap();
    let residual = robot.residual_m(
        &Pose {
            position_m: tcp,
            rotation: turned,
        },
        &q,
    );
    assert!(residual > 1e-5 && residual < 2e-4, "{residual}");
    // Of a link that is too short as of one that is too long.
    for shift in [1e-4, -1e-4] {
        let mut moved = q;
        moved[1] += shift;
        let residual = robot.residual_m(&Pose::at(tcp), &moved);
        assert!(residual > 1e-5 && residual < 2e-4, "{residual}");
    }
    assert!(
        robot
            .residual_m(&Pose::at(tcp), &[f64::NAN, 0.0, 0.0])
            .is_nan()
    );
}

/// A machine that is so many times as large; its positions stay in q-units.
fn scaled(mut geometry: Geometry, factor: f64) -> Geometry {
    for joint in (geometry.cart_joints_m.iter_mut())
        .chain(&mut geometry.platform_joints_m)
        .chain(&mut geometry.guideways)
    {
        *joint *= factor;
    }
    geometry.lengths_m = geometry.lengths_m.map(|length| length * factor);
    geometry
}

/// Places along a way from inside, at 0, out over a border: to both sides of it, ever nearer.
pub(crate) fn about_the_border(is_inside: impl Fn(f64) -> bool) -> impl Iterator<Item = f64> {
    let (mut inside, mut outside) = (0.0, 4.0);
    for _ in 0..60 {
        let middle = 0.5 * (inside + outside);
        if is_inside(middle) {
            inside = middle;
        } else {
            outside = middle;
        }
    }
    (1..52).flat_map(move |halvings| {
        let near = 0.5_f64.powi(halvings);
        [inside * (1.0 - near), outside * (1.0 + near)]
    })
}

/// All directions along axes, edges and diagonals of a cube.
pub(crate) fn directions_of_a_cube() -> impl Iterator<Item = Vector3<f64>> {
    let along = |number: i32| f64::from(number % 3 - 1);
    (0..27)
        .map(move |number| Vector3::new(along(number), along(number / 3), along(number / 9)))
        .filter(|direction| norm(direction) > 0.0)
}

/// Every threshold is a share of the machine: a larger one of the same shape has the same answers
/// and refusals, to the bit as the factor is a power of two, also next to every border of its reach.
#[test]
fn size_does_not_matter() {
    for (geometry, turn) in machines() {
        let small = machine(geometry, &turn);
        let home = turn * Vector3::new(0.1, 0.45, 0.6);
        let home_q = small.inverse(&home).unwrap();
        for factor in [0.25, 8.0] {
            let large = machine(scaled(geometry, factor), &turn);
            let grown = |result: Result<Vector3<f64>, KinematicsError>| {
                result.map(|position| position * factor)
            };
            for direction in directions_of_a_cube() {
                let place = |way: f64| home + direction * way;
                for way in about_the_border(|way| small.inverse(&place(way)).is_ok()) {
                    let (near, far) = (place(way), place(way) * factor);
                    assert_eq!(small.inverse(&near), large.inverse(&far), "{near}");
                    assert_eq!(
                        small.inverse_in_assembly(&near),
                        large.inverse_in_assembly(&far)
                    );
                    assert_eq!(
                        small.jacobian(&near).map(|j| j * factor),
                        large.jacobian(&far)
                    );
                }
                for way in about_the_border(|way| small.jacobian(&place(way)).is_ok()) {
                    let (near, far) = (place(way), place(way) * factor);
                    assert_eq!(
                        small.jacobian(&near).map(|j| j * factor),
                        large.jacobian(&far)
                    );
                }
                let positions = |way: f64| -> [f64; AXES] {
                    core::array::from_fn(|axis| {
                        home_q[axis] + direction[axis] * way / norm(&geometry.guideways[axis])
                    })
                };
                for way in about_the_border(|way| small.forward(&positions(way)).is_ok()) {
                    let q = positions(way);
                    assert_eq!(grown(small.forward(&q)), large.forward(&q), "{q:?}");
                }
            }
        }
    }
}

/// The measure of a pose that is refused is within the tolerance.
#[test]
fn a_refused_pose_is_measured() {
    let nominal = l2();
    let mut refused = 0;
    for direction in directions_of_a_cube() {
        let place = |way: f64| Vector3::new(0.1, 0.45, 0.6) + direction * way;
        for way in about_the_border(|way| nominal.jacobian(&place(way)).is_ok()) {
            if let Err(KinematicsError::Singular { measure }) = nominal.jacobian(&place(way)) {
                assert!(
                    (0.0..=SINGULARITY_TOLERANCE).contains(&measure),
                    "{measure}"
                );
                refused += 1;
            }
        }
    }
    assert!(refused > 100, "{refused}");
}

/// Bounds belong to what they bound.
#[test]
fn parameters_at_their_bounds_are_taken() {
    let mut least = geometry();
    least.lengths_m = [1e-6; ARMS];
    assert!(Robot::new(least).is_ok());
    let mut most = geometry();
    most.lengths_m = [MAX_LENGTH_M; ARMS];
    most.cart_joints_m[3] = Vector3::new(0.0, -MAX_LENGTH_M, 0.0);
    assert!(Robot::new(most).is_ok());
    most.cart_joints_m[3].y *= 1.0 + 1e-12;
    assert!(Robot::new(most).is_err());
}

#[test]
fn a_load_is_finite_in_every_component() {
    for component in 0..6 {
        let mut load = [1.0; 6];
        assert!(Wrench::from_array(load).is_finite());
        load[component] = f64::NAN;
        assert!(!Wrench::from_array(load).is_finite());
    }
}

/// Of carts without a stated range: so many lengths of the arm, either way.
#[test]
fn unlimited_travel_is_by_the_length() {
    let geometry = scaled(geometry(), 0.25);
    let travel = machine(geometry, &Matrix3::identity()).travel();
    for (axis, (lower, upper)) in travel.into_iter().enumerate() {
        let reach_m = upper * norm(&geometry.guideways[axis]);
        assert!(
            (reach_m / geometry.lengths_m[axis] - 1e3).abs() < 1e-9,
            "{upper}"
        );
        assert_eq!(lower.to_bits(), (-upper).to_bits());
    }
}

/// As large as its machine: the turn of the platform up to which links of a cluster run parallel.
#[test]
fn the_tau_property_is_a_share_of_the_lengths() {
    let small = Robot::new(geometry()).unwrap();
    let large = Robot::new(scaled(geometry(), 8.0)).unwrap();
    let mut taken = 0;
    for halvings in 20..50 {
        let turn = rotation_from_vector(&Vector3::new(0.0, 0.0, 0.5_f64.powi(halvings))).unwrap();
        let [small, large] = [&small, &large].map(|robot| Kinematics::new(robot, &turn).is_ok());
        assert_eq!(small, large, "{halvings}");
        taken += u32::from(small);
    }
    assert!(taken > 5 && taken < 25, "{taken}");
}

/// Under the same force, and a moment that is so many times as large, links of the same compliance
/// give way by as much.
#[test]
fn a_larger_machine_gives_way_by_as_much() {
    let factor = 8.0;
    let load = |lever: f64| Wrench {
        force_n: Vector3::new(30.0, -20.0, 50.0),
        moment_nm: Vector3::new(2.0, 3.0, -1.0) * lever,
    };
    for (geometry, turn) in machines() {
        let tcp = turn * Vector3::new(0.1, 0.45, 0.6);
        let [small, large] = [1.0, factor].map(|factor| {
            let nominal = machine(scaled(geometry, factor), &turn);
            let q = nominal.inverse(&(tcp * factor)).unwrap();
            let elastic = Elastic::new(&nominal, &compliances());
            elastic
                .deflection(&(tcp * factor), &q, &load(factor))
                .unwrap()
        });
        assert_eq!(small.translation_m, large.translation_m);
    }
}

/// CRC-32 of the numbers in the order of the wire format's page, the orientation row by row; a zero
/// has no sign.
#[test]
fn the_checksum_is_that_of_the_numbers() {
    let (geometry, turn) = skewed();
    let metres_per_q = [1.0, 0.5, 2.0];
    let mut numbers: Vec<f64> = Vec::new();
    for vectors in [
        &geometry.cart_joints_m[..],
        &geometry.guideways,
        &geometry.platform_joints_m,
    ] {
        numbers.extend(vectors.iter().flat_map(|vector| vector.iter()));
    }
    numbers.extend(geometry.lengths_m);
    numbers.extend(geometry.configuration.inverse.map(Branch::sign));
    numbers.push(geometry.configuration.forward.sign());
    for row in 0..3 {
        numbers.extend((0..3).map(|column| turn[(row, column)]));
    }
    numbers.extend(metres_per_q);
    let bytes: Vec<u8> = numbers
        .iter()
        .flat_map(|number| number.to_le_bytes())
        .collect();
    let expected = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes);
    assert_eq!(machine(geometry, &turn).checksum(&metres_per_q), expected);

    let sum_with = |zero: f64| {
        let mut geometry = geometry;
        geometry.cart_joints_m[0].x = zero;
        let robot = Robot::new(geometry).unwrap();
        crate::model::robot::checksum(robot.numbers())
    };
    assert_eq!(sum_with(0.0), sum_with(-0.0));
    assert_ne!(sum_with(0.0), sum_with(1e-9));
}
