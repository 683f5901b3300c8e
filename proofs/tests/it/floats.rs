//! The properties of the floats on stable Rust: any bit patterns, and the stated grids where a
//! number is what matters.

use gantry_tau_core::model::compensation::CompensatorConfig;
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::linalg::rotation_from_vector;
use gantry_tau_core::model::load_filter::SectionState;
use gantry_tau_core::model::nalgebra::Matrix3;
use gantry_tau_core::model::robot::{Branch, Compliances};
use gantry_tau_core::model::sensor::{ForceSensor, LowPass, SensorConfig, SensorState, Tool};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::model::{f1, l2, presets};
use gantry_tau_core::units::{OffsetNm, PositionNm};
use gantry_tau_proofs::properties::compensation::{
    correction_is_bounded, cycle_is_bounded, offset_is_within, sensor_check_admits_finite,
    sensor_stays_valid, sensor_takes_good_readings,
};
use gantry_tau_proofs::properties::crossing::{
    back_is_finite, crossing_is_exact, offset_is_total, offset_survives, position_is_total,
    rounding_is_exact, rounding_keeps_order,
};
use gantry_tau_proofs::properties::kinematics::{
    check_is_right, forward_is_inside, inverse_in_assembly_is_inside, inverse_is_inside,
    lengths_are_kept, statics_are_finite, there_and_back, travel_is_finite,
};
use gantry_tau_proofs::properties::six_link;
use gantry_tau_proofs::robots;
use proptest::array::{uniform2, uniform3, uniform4, uniform6, uniform9};
use proptest::prelude::*;

/// Any bit pattern, with an inclination to those that hurt.
fn any_float() -> impl Strategy<Value = f64> {
    let special = vec![
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        5e-324,
        -5e-324,
        9_007_199.254_740_992,
        -9_007_199.254_740_99,
        2.147_483_647,
        -2.147_483_648,
        0.5e-9,
        1e154,
        1e-154,
    ];
    prop_oneof![
        any::<u64>().prop_map(f64::from_bits),
        proptest::num::f64::ANY,
        proptest::sample::select(special),
        -3.0..3.0_f64,
        (-3.0..3.0_f64, -12..12_i32).prop_map(|(x, scale)| x * 10.0_f64.powi(scale)),
        // A few ulps beside an end of travel or another round number.
        (-4..5_i32, any::<i8>()).prop_map(|(half, ulps)| {
            let end = f64::from(half) / 2.0;
            f64::from_bits(end.to_bits().wrapping_add_signed(i64::from(ulps)))
        }),
    ]
}

fn l2() -> (l2::Robot, l2::Kinematics) {
    robots::l2(robots::l2_geometry()).unwrap()
}

fn point() -> impl Strategy<Value = [f64; 3]> {
    uniform3(-1.0..1.0_f64)
}

fn branch() -> impl Strategy<Value = Branch> {
    prop_oneof![Just(Branch::Positive), Just(Branch::Negative)]
}

/// Machines of which only the lengths are sane: guideways in any direction, carts that may meet,
/// travel unchecked.
fn any_machine() -> impl Strategy<Value = (l2::Robot, l2::Kinematics)> {
    let origins = (point(), point(), point(), 0..4_u8);
    let lengths = (uniform3(0.5..1.5_f64), prop_oneof![Just(1.0), Just(1e-3)]);
    (
        origins,
        uniform3(point()),
        lengths,
        uniform3(branch()),
        branch(),
    )
        .prop_filter_map(
            "a guideway without direction",
            |((o1, o2, o3, shared), guideways, (lengths, scale), inverse, forward)| {
                let o3 = if shared > 0 { o2 } else { o3 };
                let o1 = if shared > 1 { o2 } else { o1 };
                let mut machine = l2::Geometry {
                    cart_joints_m: [o1, o2, o2, o3, o3, o3].map(Into::into),
                    guideways: guideways.map(Into::into),
                    platform_joints_m: [[0.0; 3]; 6].map(Into::into),
                    lengths_m: lengths.map(|length| length * scale),
                    travel: None,
                    ..robots::l2_geometry()
                };
                machine.configuration.inverse = inverse;
                machine.configuration.forward = forward;
                robots::l2(machine)
            },
        )
}

/// Numbers of either sign, their powers of ten in a range.
fn any_scale(powers: std::ops::Range<f64>) -> impl Strategy<Value = f64> {
    (-1.0..1.0_f64, powers).prop_map(|(x, power)| x * 10.0_f64.powf(power))
}

/// Positions from 10 nm to a kilometre: one far, two that may nearly meet, as near a singularity as
/// there is.
fn wild_positions() -> impl Strategy<Value = [f64; 3]> {
    (
        any_scale(-1.0..3.0),
        any_scale(-8.0..1.0),
        any_scale(-8.0..1.0),
    )
        .prop_map(|(a, b, c)| [a, b, c])
}

fn six_numbers() -> impl Strategy<Value = [f64; 6]> {
    uniform6(prop_oneof![
        -1e6..1e6_f64,
        -10.0..10.0_f64,
        Just(1e6),
        Just(-1e6)
    ])
}

/// A sensor in any valid state, its mounting turned.
fn any_sensor() -> impl Strategy<Value = ForceSensor> {
    (
        1..1_000_u32,
        any::<u32>(),
        six_numbers(),
        six_numbers(),
        (any::<bool>(), -3.0..5.0_f64),
        uniform4(uniform2(uniform6(-1e9..1e9_f64))),
    )
        .prop_map(
            |(tare_samples, to_go, tare, filtered, (is_first_order, cutoff), sections)| {
                let (low_pass, highest_hz) = if is_first_order {
                    (LowPass::FirstOrder, 1e5)
                } else {
                    (LowPass::SecondOrder, 450.0)
                };
                let config = SensorConfig {
                    rotation: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]].into(),
                    lever_m: [0.02, 10.0, -0.08].into(),
                    tool: Tool {
                        weight_n: [-1e5, 20.0, 1e5].into(),
                        centre_m: [10.0, -0.2, 0.0].into(),
                    },
                    low_pass,
                    cutoff_hz: 10.0_f64.powf(cutoff).min(highest_hz),
                    cycle_s: 1e-3,
                    tare_samples,
                };
                let tare_remaining = to_go % (tare_samples + 1);
                let first = tare_remaining == tare_samples;
                let state = SensorState {
                    tare_remaining,
                    tare: Wrench::from_array(if first { [0.0; 6] } else { tare }),
                    filtered: Wrench::from_array(filtered),
                    sections: sections.map(|[band, low]| SectionState {
                        band: Wrench::from_array(band),
                        low: Wrench::from_array(low),
                    }),
                };
                ForceSensor::from_parts(config, state).unwrap()
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn the_crossing_is_total(x in any_float(), y in any_float(), nm: i64) {
        position_is_total(x);
        offset_is_total(x);
        rounding_is_exact(x);
        rounding_keeps_order(x, y);
        crossing_is_exact(x);
        back_is_finite(PositionNm(nm));
    }

    #[test]
    fn the_correction_is_bounded(
        x in any_float(), limit: i32, limits: [i32; 3], scales in uniform3(any_float()),
        q in uniform3(any_float()), command in uniform3(any_float()), gain in any_float(),
    ) {
        offset_is_within(x, OffsetNm(limit));
        let config = CompensatorConfig { gain, limits: limits.map(OffsetNm), metres_per_q: scales };
        correction_is_bounded(&config, &q, &command);
    }

    #[test]
    fn a_cycle_is_bounded(
        load in uniform6(prop_oneof![any_float(), -1e4..1e4_f64]), q in uniform3(any_float()),
        standing: bool, gain in 0.0..=1.0_f64, limits in uniform3(0..=i32::MAX), nominal: [i64; 3],
    ) {
        let pose = Pose::at([0.0, 0.5, 0.65].into());
        let (_, kinematics) = l2();
        let home = kinematics.inverse(&pose.position_m).unwrap();
        let (q, load) = (if standing { home } else { q }, Wrench::from_array(load));
        let config = &CompensatorConfig { gain, limits: limits.map(OffsetNm), metres_per_q: [1.0; 3] };
        let compensator = l2::Compensator::new(&kinematics, &presets::l2_compliances(), *config).unwrap();
        cycle_is_bounded(config, compensator.correct_q(&q, &load), &load);
        cycle_is_bounded(config, compensator.correct_exact_at(&pose, &q, &load), &load);
        let nominal = nominal.map(PositionNm);
        cycle_is_bounded(config, compensator.correct(&nominal, &load), &load);
    }

    #[test]
    fn the_sensor_stays_valid(
        sensor in any_sensor(), raw in uniform6(any_float()), good in uniform6(-1e6..=1e6_f64), tare_remaining in 0..9_u32,
        turn in uniform3(-4.0..4.0_f64), columns in uniform9(any_float()),
    ) {
        let turned = rotation_from_vector(&turn.into()).unwrap();
        sensor_takes_good_readings(&sensor, &Wrench::from_array(good), &turned);
        let filtered = Wrench::from_array(raw);
        sensor_check_admits_finite(*sensor.config(), SensorState { tare_remaining, filtered, ..*sensor.state() });
        for raw in [raw, good].map(Wrench::from_array) {
            for platform in [turned, Matrix3::from_column_slice(&columns)] {
                sensor_stays_valid(&sensor, &raw, &platform);
            }
        }
    }

    #[test]
    fn any_numbers_lead_to_finite_numbers_or_errors(
        tcp in uniform3(any_float()), q in uniform3(any_float()), load in uniform6(any_float()), fits: bool,
    ) {
        let (robot, nominal) = l2();
        check_is_right(&nominal, q);
        inverse_is_inside(&nominal, tcp);
        inverse_in_assembly_is_inside(&nominal, tcp);
        forward_is_inside(&nominal, q);
        lengths_are_kept(&robot, &nominal, tcp, q);
        let q = if fits { nominal.inverse(&tcp.into()).unwrap_or(q) } else { q };
        statics_are_finite(&robot, &nominal, tcp, q, &Wrench::from_array(load));
    }

    #[test]
    fn six_axes_answer_what_is_checked(
        position in uniform3(prop_oneof![any_float(), -1.0..1.0_f64]), turn in uniform3(prop_oneof![3 => -0.4..0.4_f64, 1 => any_float()]),
        q in uniform6(any_float()), carts in uniform3(0.5..2.0_f64), plates in uniform3(-0.4..0.4_f64), seeded: bool,
        load in uniform6(prop_oneof![any_float(), -1e3..1e3_f64]), limits in uniform6(0..=i32::MAX), gain in 0.0..=1.0_f64, narrow: bool,
    ) {
        let travel = narrow.then_some([(0.5, 2.0), (0.5, 2.0), (0.5, 2.0), (-0.3, 0.3), (-0.3, 0.3), (-0.3, 0.3)]);
        let kinematics = robots::f1(f1::Geometry { travel, ..robots::f1_geometry() }).unwrap();
        let rotation = rotation_from_vector(&turn.into()).unwrap_or_else(|| [[0.0; 3]; 3].into());
        let pose = Pose { position_m: position.into(), rotation };
        let ([q1, q2, q3], [q4, q5, q6]) = (carts, plates);
        let standing = [q1, q2, q3, q4, q5, q6];
        let machine = f1::Elastic::new(&kinematics, &Compliances::new([5e-7; 6], [4e-8; 6]).unwrap());
        let config = CompensatorConfig { gain, limits: limits.map(OffsetNm), metres_per_q: [1.0; 6] };
        let compensator = f1::Compensator::new(&kinematics, machine.compliances(), config).unwrap();
        let fits = kinematics.inverse(&pose, None).map_or(standing, |found| found.value);
        let load = Wrench::from_array(load);
        for q in [q, standing, fits] {
            six_link::check_is_right(&kinematics, &q);
            six_link::answers_are_checked(&kinematics, &pose, seeded.then_some(plates), &q);
            six_link::statics_are_finite(&machine, &pose, &q, &load);
            six_link::cycles_are_bounded(&compensator, &pose, &q, &load);
        }
        six_link::tracker_is_checked(&kinematics, &Pose::at(robots::f1_home().into()), &[q, standing, fits]);
    }

    #[test]
    fn lengths_are_kept_by_any_machine(
        (robot, nominal) in any_machine(), tcp in uniform3(any_float()), q in wild_positions(),
    ) {
        travel_is_finite(&nominal);
        lengths_are_kept(&robot, &nominal, tcp, q);
        // And where a link just reaches: straight across its guideway.
        let (cart, guideway) = (robot.geometry().cart_joints_m[0], robot.geometry().guideways[0]);
        lengths_are_kept(&robot, &nominal, (cart + guideway * q[0]).into(), q);
    }
}

/// Rounding made of a far cart and two that nearly met a point three million kilometres from the
/// machine.
#[test]
fn near_a_singularity_rounding_is_no_answer() {
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;
    let mut runner = TestRunner::deterministic();
    let strategy = (any_machine(), wild_positions());
    for _ in 0..200_000 {
        let ((robot, nominal), q) = strategy.new_tree(&mut runner).unwrap().current();
        lengths_are_kept(&robot, &nominal, [f64::NAN; 3], q);
    }
}

/// Coordinates in metres, from centimetres.
fn steps(from_cm: i32, to_cm: i32, by_cm: usize) -> impl Iterator<Item = f64> {
    (from_cm..=to_cm)
        .step_by(by_cm)
        .map(|cm| f64::from(cm) / 100.0)
}

/// The grid of T13: 1 cm over the box that holds every pose within the travel, 6.1 million points,
/// of which 663 777 are reached.
#[test]
fn lengths_are_kept_over_the_workspace() {
    let (robot, nominal) = l2();
    let mut reached = 0_u32;
    for x in steps(-150, 150, 3) {
        for y in steps(-140, 110, 1) {
            for z in steps(-40, 200, 1) {
                let tcp = [x, y, z];
                if let Ok(q) = nominal.inverse(&tcp.into()) {
                    reached += 1;
                    lengths_are_kept(&robot, &nominal, tcp, q);
                    there_and_back(&nominal, tcp, 1e-9);
                }
            }
        }
    }
    assert!(reached > 100_000, "{reached}");
}

/// The grid of T15: every 101st offset, and every one within a millimetre of zero and of both ends.
#[test]
fn offsets_survive_the_round_trip() {
    let near = 1_000_000;
    for nm in (i32::MIN..=i32::MAX).step_by(101) {
        offset_survives(OffsetNm(nm));
    }
    for nm in (-near..=near)
        .chain(i32::MIN..=i32::MIN + near)
        .chain(i32::MAX - near..=i32::MAX)
    {
        offset_survives(OffsetNm(nm));
    }
}
