use gantry_tau_core::model::kinematics::Pose as RigidPose;
use gantry_tau_core::model::load_filter::Notch;
use gantry_tau_core::model::sensor::{ForceSensor, LowPass, Reading, SensorConfig, Tool};
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use nalgebra::{DVector, Matrix3, UnitQuaternion, Vector3};

use super::design::heaviest_tool_kg;
use super::survey::Margins;
use super::*;
use crate::drive_cascade::{CYCLE_S, POSITION_GAIN};
use crate::dynamics::MassiveMachine;
use crate::elastic::Pose;
use crate::model::{MachineKind, on_path};
use crate::robot_file::RobotFile;

/// A machine of a file with a tool of this mass.
fn massive<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    tool_kg: f64,
) -> MassiveMachine<N> {
    let mut machine = MassiveMachine::of(robot).unwrap();
    machine.masses.tool.mass_kg = tool_kg;
    machine
}

/// The same about home, and its cascade.
fn at_home<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    tool_kg: f64,
) -> (LinearMachine<N>, DriveKind<N>) {
    let pose = Pose {
        translation_m: robot.home_m(),
        rotation: UnitQuaternion::identity(),
    };
    let machine = massive(robot, tool_kg);
    let linear = LinearMachine::at(&machine, &pose, &robot.home_q().unwrap()).unwrap();
    (linear, DriveKind::cascade(robot, POSITION_GAIN).unwrap())
}

/// A hundredth of a load leaves a hundredth of its second order, and a nanometre of rounding.
fn the_correction_is_that_of_the_compensator<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
) {
    let (linear, _) = at_home(robot, 1.8);
    let limits = [OffsetNm(i32::MAX); N];
    let compensator = robot.compensator(limits).unwrap();
    let q = robot.home_q().unwrap();
    let nominal = on_path(&q, &robot.metres_per_q).unwrap();
    let pose = RigidPose::at(robot.home_m());
    for component in 0..6 {
        let mut load = [0.0; 6];
        load[component] = if component < 3 { 10.0 } else { 1.0 };
        let found = compensator
            .correct(&pose, &nominal, &Wrench::from_array(load))
            .unwrap();
        let expected = &linear.correction * DVector::from_row_slice(&load);
        for axis in 0..N {
            let found_m = found.offsets[axis].to_metres().0;
            let expected_m = expected[axis] * robot.metres_per_q[axis];
            assert!(
                (found_m - expected_m).abs() < 2e-9 + 1e-3 * expected.amax(),
                "load {component}, axis {axis}: {found_m:e} and {expected_m:e}"
            );
        }
    }
}

#[test]
fn the_linear_correction_is_the_compensators() {
    the_correction_is_that_of_the_compensator(&RobotFile::builtin_l2().unwrap());
    the_correction_is_that_of_the_compensator(&RobotFile::builtin_f1().unwrap());
}

/// Drives that stand hold the machine where the references are, and a reading is zero at rest.
#[test]
fn a_machine_comes_to_rest_at_its_references() {
    let (linear, cascade) = at_home(&RobotFile::builtin_l2().unwrap(), 1.8);
    for drives in [DriveKind::Ideal, cascade] {
        let map = TickMap::of(&linear, &drives);
        let references = DVector::from_row_slice(&[10e-6, -20e-6, 30e-6]);
        let mut state = DVector::zeros(map.state.nrows());
        let mut largest = 0.0_f64;
        for _ in 0..20_000 {
            state = &map.state * state + (&map.previous + &map.current) * &references;
            largest = largest.max((&map.reading * &state).amax());
        }
        for axis in 0..3 {
            let off = (state[6 + axis] - references[axis]).abs();
            assert!(off < 1e-12, "{drives:?}, axis {axis}: {off:e}");
        }
        assert!(
            (&map.reading * &state).amax() < 1e-9 && largest > 0.01,
            "{largest}"
        );
    }
}

/// The closed loop as it runs, from a push: its amplitude grows as its eigenvalue says.
#[test]
fn a_loop_grows_as_its_eigenvalue_says() {
    let (linear, drives) = at_home(&RobotFile::builtin_l2().unwrap(), 5.0);
    for (filter, grows) in [
        (Filter::first_order(20.0), true),
        (Filter::butterworth(6.0), false),
    ] {
        let map = TickMap::of(&linear, &drives);
        let machine = map.state.nrows();
        let looped = Loop::new(&linear, map, filter, 3);
        let growth = looped.growth().unwrap();
        assert_eq!(growth.per_s > 0.0, grows, "{growth:?}");
        let mut state = looped.start();
        state[6] = 1e-6;
        // The slowest motion is left alone.
        let mut energy = [0.0; 2];
        for cycle in 0..30_000 {
            state = looped.next(&state);
            if cycle >= 28_000 {
                energy[(cycle - 28_000) / 1_000] += state.rows(0, machine / 2).norm_squared();
            }
        }
        let measured = 0.5 * (energy[1] / energy[0]).ln();
        assert!(
            (measured - growth.per_s).abs() < 0.05,
            "{measured} {growth:?}"
        );
    }
}

/// A gain at the margin is where some phase makes the loop unstable; below it no latency does.
#[test]
fn below_the_margin_no_latency_is_unstable() {
    let (linear, drives) = at_home(&RobotFile::builtin_l2().unwrap(), 5.0);
    let map = TickMap::of(&linear, &drives);
    let margin = |gain: f64, latency: usize| {
        let mut weaker = linear.clone();
        weaker.correction *= gain;
        Loop::new(&weaker, map.clone(), Filter::first_order(20.0), latency)
    };
    let any_phase = margin(1.0, 3).margin().unwrap().any_phase;
    assert!((0.1..0.5).contains(&any_phase), "{any_phase}");
    let growths: Vec<f64> = (1..40)
        .map(|latency| margin(0.95 * any_phase, latency).growth().unwrap().per_s)
        .collect();
    assert!(growths.iter().all(|growth| *growth < 0.0), "{growths:?}");
    let most = (1..40)
        .map(|latency| margin(1.3 * any_phase, latency).growth().unwrap().per_s)
        .fold(f64::NEG_INFINITY, f64::max);
    assert!(most > 0.0, "{most}");
}

/// A sensor without turn and tool against the filters that stand for it.
#[test]
fn the_filters_are_those_of_the_sensor() {
    is_the_sensors(LowPass::FirstOrder, 20.0, &[]);
    is_the_sensors(LowPass::SecondOrder, 6.0, &[]);
    let notches = [20.7, 47.6, 1.3].map(|hz| Notch { hz, q: 0.7 });
    is_the_sensors(LowPass::SecondOrder, 6.0, &notches);
    is_the_sensors(LowPass::SecondOrder, 150.0, &notches[..2]);
}

fn is_the_sensors(low_pass: LowPass, cutoff_hz: f64, notches: &[Notch]) {
    let mut sensor = ForceSensor::new(SensorConfig {
        rotation: Matrix3::identity(),
        lever_m: Vector3::zeros(),
        tool: Tool::weightless(),
        low_pass,
        cutoff_hz,
        cycle_s: CYCLE_S,
        tare_samples: 1,
    })
    .unwrap();
    let kind = match low_pass {
        LowPass::FirstOrder => FilterKind::FirstOrder { cutoff_hz },
        LowPass::SecondOrder => FilterKind::SecondOrder { cutoff_hz },
    };
    let filter = kind.with(notches, 1.0);
    sensor
        .set_notches(&std::array::from_fn(|place| notches.get(place).copied()))
        .unwrap();
    let mut past = vec![[0.0; 2]; filter.order()];
    sensor
        .update(&Wrench::zero(), &Matrix3::identity())
        .unwrap();
    for sample in 0..600 {
        let force_n = f64::from(sample % 17) - 5.0;
        let raw = Wrench::from_array([force_n, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let Reading::Load(load) = sensor.update(&raw, &Matrix3::identity()).unwrap() else {
            panic!("still taring")
        };
        let off = filter.next(&mut past, force_n) - load.force_n.x;
        assert!(off.abs() < 1e-10, "{kind:?}, sample {sample}: {off:e}");
    }
}

/// Responses against what the filters are for: -3 dB at the corner, nothing at a notch.
#[test]
fn filters_have_their_frequencies() {
    let at = |filter: &Filter, hz: f64| {
        let (sin, cos) = (std::f64::consts::TAU * hz * CYCLE_S).sin_cos();
        filter.response(nalgebra::Complex::new(cos, sin)).norm_sqr()
    };
    let low_pass = Filter::butterworth(6.0);
    assert!((at(&low_pass, 6.0) - 0.5).abs() < 1e-12);
    assert!((at(&low_pass, 1e-6) - 1.0).abs() < 1e-9);
    assert!((at(&low_pass, 60.0).sqrt() - 0.01).abs() < 5e-4);
    let notched = low_pass.with_notch(20.0, 0.7);
    assert!(at(&notched, 20.0) < 1e-24 && (at(&notched, 1e-6) - 1.0).abs() < 1e-9);
    // Backward Euler is within 2 % of its corner.
    assert!((at(&Filter::first_order(10.0), 10.0) - 0.5).abs() < 0.02);
    // The samples agree with the response: a step ends at the gain at rest.
    let mut past = vec![[0.0; 2]; notched.order()];
    let last = (0..2_000)
        .map(|_| notched.next(&mut past, 1.0))
        .last()
        .unwrap();
    assert!((last - 1.0).abs() < 1e-9, "{last}");
}

/// The numbers of a survey of the L2 with 5 kg that was made apart, in another language, over 39
/// places: 10.2 with the modes as they are.
#[test]
fn the_default_of_an_l2_has_its_margin_over_the_reach() {
    let robot = RobotFile::builtin_l2().unwrap();
    let machine = massive(&robot, 5.0);
    let (_, drives) = at_home(&robot, 5.0);
    let judged = |filter: FilterKind| {
        let compensation = Compensation {
            filter,
            drives,
            latency_cycles: 3,
            gain: 1.0,
        };
        StabilitySurvey::of(&robot, &machine, &compensation, || {}).unwrap()
    };
    let auto = judged(FilterKind::Auto {
        cutoff_hz: 6.0,
        notches: 2,
        notch_q: 0.7,
    });
    assert!(
        (36..=42).contains(&auto.places.len()),
        "{}",
        auto.places.len()
    );
    let worst = auto
        .worst(|place| place.margins.exact.any_phase)
        .margins
        .exact
        .any_phase;
    assert!((worst - 10.2).abs() < 0.2, "{worst}");
    let wrong = auto.worst(|place| place.margins.wrong_modes.any_phase);
    assert!(wrong.margins.wrong_modes.any_phase > 2.0);
    assert!(
        auto.places
            .iter()
            .all(|place| place.margins.exact.phase_per_axis <= place.margins.exact.any_phase)
    );
    for place in &auto.places {
        for latency in 1..=6 {
            assert!(
                place.growth(latency).unwrap().per_s < 0.0,
                "{:?}",
                place.pose
            );
        }
    }
    let settles_s = auto.home.filter().settling_s(0.05);
    assert!((0.096..0.103).contains(&settles_s), "{settles_s}");
    // What the client does without: everywhere unstable.
    let today = judged(FilterKind::FirstOrder { cutoff_hz: 20.0 });
    for place in &today.places {
        assert!(place.growth(3).unwrap().per_s > 0.0, "{:?}", place.pose);
        assert!(place.margins.exact.any_phase < 1.0);
    }
}

/// With the drives of its file, and in some places with ideal ones. The survey made apart had two
/// notches, a gain of the position loops of 40 1/s, and 2.50 with the modes 20 % wrong.
#[test]
fn the_default_of_an_f1_has_its_margin_over_the_reach() {
    let robot = RobotFile::builtin_f1().unwrap();
    let machine = massive(&robot, 5.0);
    let compensation = Compensation {
        filter: FilterKind::of(&robot),
        drives: DriveKind::cascade(&robot, robot.position_gain_per_s()).unwrap(),
        latency_cycles: 3,
        gain: 1.0,
    };
    let survey = StabilitySurvey::of(&robot, &machine, &compensation, || {}).unwrap();
    assert!(survey.places.len() > 80, "{}", survey.places.len());
    for place in &survey.places {
        let Margins { exact, wrong_modes } = place.margins;
        assert!(exact.any_phase > 5.0, "{:?}: {exact:?}", place.pose);
        assert!(wrong_modes.any_phase > 2.5, "{:?}", place.pose);
        assert!(wrong_modes.phase_per_axis > 1.5, "{:?}", place.pose);
    }
    let ideal = Compensation {
        drives: DriveKind::Ideal,
        ..compensation
    };
    for place in survey.places.iter().step_by(9) {
        let with_ideal = Place::of(&machine, &place.pose, &place.axes, &ideal).unwrap();
        assert!(with_ideal.margins.exact.any_phase > 2.0);
        for place in [place, &with_ideal] {
            for latency in 1..=6 {
                let growth = place.growth(latency).unwrap();
                assert!(growth.per_s < 0.0, "{:?}: {growth:?}", place.pose);
            }
        }
    }
}

/// Growths at home on workpieces of 1e4 to 1e9 N/m, in four directions.
fn growths_in_contact<K: MachineKind<N>, const N: usize>(
    robot: &RobotFile<K, N>,
    kind: &FilterKind,
    tool_kg: f64,
    damping_ratio: f64,
) -> Vec<(Contact, Growth)> {
    let mut machine = massive(robot, tool_kg);
    machine.masses.damping_ratio = damping_ratio;
    let home = Pose::from(&RigidPose::at(robot.home_m()));
    let machine = LinearMachine::at(&machine, &home, &robot.home_q().unwrap()).unwrap();
    let drives = DriveKind::cascade(robot, robot.position_gain_per_s()).unwrap();
    let gain = LoopGain::of(&machine, &TickMap::of(&machine, &drives)).unwrap();
    let notches = kind.notches(&machine, gain.response()).unwrap();
    let filter = kind.with(&notches, 1.0);
    let directions = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 1.0],
    ];
    let contacts = directions.into_iter().flat_map(|direction| {
        (4..10).map(move |decade| Contact {
            stiffness_n_per_m: 10.0_f64.powi(decade),
            direction: direction.into(),
        })
    });
    contacts
        .map(|contact| {
            let machine = machine.in_contact(&contact).unwrap();
            let map = TickMap::of(&machine, &drives);
            let closed = Loop::new(&machine, map, filter.clone(), 3);
            (contact, closed.growth().unwrap())
        })
        .collect()
}

/// With the default nothing grows, with either tool and little damping.
fn nothing_grows_in_contact<K: MachineKind<N>, const N: usize>(robot: &RobotFile<K, N>) {
    for tool_kg in [1.835, 5.0] {
        for damping_ratio in [0.01, 0.02] {
            let kind = FilterKind::of(robot);
            for (contact, growth) in growths_in_contact(robot, &kind, tool_kg, damping_ratio) {
                assert!(growth.per_s < 0.0, "{tool_kg} kg, {contact:?}: {growth:?}");
            }
        }
    }
}

#[test]
fn contact_is_stable_with_the_default() {
    nothing_grows_in_contact(&RobotFile::builtin_l2().unwrap());
    nothing_grows_in_contact(&RobotFile::builtin_f1().unwrap());
    // With the filter of first order everything does.
    let first_order = FilterKind::FirstOrder { cutoff_hz: 20.0 };
    let l2 = RobotFile::builtin_l2().unwrap();
    for (contact, growth) in growths_in_contact(&l2, &first_order, 5.0, 0.02) {
        assert!(growth.per_s > 0.0, "{contact:?}: {growth:?}");
    }
}

/// A static load on a machine in contact: the workpiece and the machine share it by their
/// stiffnesses.
#[test]
fn a_workpiece_carries_its_share() {
    let robot = RobotFile::builtin_l2().unwrap();
    let (machine, drives) = at_home(&robot, 1.8);
    let stiffness_n_per_m = 1e6;
    let contact = Contact {
        stiffness_n_per_m,
        direction: Vector3::z(),
    };
    let held = machine.in_contact(&contact).unwrap();
    let references = DVector::from_row_slice(&[30e-6, 10e-6, -20e-6]);
    let settled = |machine: &LinearMachine<3>| {
        let map = TickMap::of(machine, &drives);
        let mut state = DVector::zeros(map.state.nrows());
        for _ in 0..20_000 {
            state = &map.state * state + (&map.previous + &map.current) * &references;
        }
        (state[2], (&map.reading * &state)[2])
    };
    let (free_m, _) = settled(&machine);
    let (held_m, force_n) = settled(&held);
    assert!((force_n + stiffness_n_per_m * held_m).abs() < 1e-6 * force_n.abs());
    // By the compliance of the machine in z, to which the drives add nothing at rest.
    let m_per_n = (held_m - free_m) / force_n;
    assert!((1e-7..2e-6).contains(&m_per_n), "{m_per_n:e}");
    let in_drives = &machine.correction * DVector::from_row_slice(&[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let map = TickMap::of(&machine, &drives);
    let mut state = DVector::zeros(map.state.nrows());
    for _ in 0..20_000 {
        state = &map.state * state + (&map.previous + &map.current) * &in_drives;
    }
    assert!(
        (state[2] + m_per_n).abs() < 1e-6 * m_per_n,
        "{} {m_per_n}",
        state[2]
    );
}

/// A pole of the cascade that the drives do not damp: at 150 1/s the F1's mode at 24 Hz.
#[test]
fn a_stiff_position_loop_undamps_an_f1() {
    let robot = RobotFile::builtin_f1().unwrap();
    let (machine, _) = at_home(&robot, 1.835);
    for (gain, expected) in [(150.0, 0.24e-2), (40.0, 1.72e-2)] {
        let drives = DriveKind::cascade(&robot, gain).unwrap();
        let vibrations = TickMap::of(&machine, &drives).vibrations().unwrap();
        let least = vibrations
            .into_iter()
            .map(|(_, ratio)| ratio)
            .fold(1.0, f64::min);
        assert!((least - expected).abs() < 0.02e-2, "{gain}: {least}");
    }
}

/// Margins of `tests/data/dynamics.json` at home with ideal drives, to a thousandth where the peak is
/// at a mode.
#[test]
fn ideal_drives_have_the_margins_of_the_vectors() {
    let text = include_str!("../../../../tests/data/dynamics.json");
    let vectors: serde_json::Value = serde_json::from_str(text).unwrap();
    let robot = RobotFile::builtin_f1().unwrap();
    let mut judged = 0;
    for case in vectors["robots"]["f1"]["stability"].as_array().unwrap() {
        if case["pose"] != "home" || case["drives"] != "ideal" {
            continue;
        }
        let (machine, _) = at_home(&robot, case["tool_kg"].as_f64().unwrap());
        let modes = machine.modes.hz();
        let filter = match case["filter"].as_str().unwrap() {
            "first_order_20" => Filter::first_order(20.0),
            "butterworth2_4" => Filter::butterworth(4.0),
            _ => Filter::butterworth(6.0)
                .with_notch(modes[0], 0.7)
                .with_notch(modes[2], 0.7),
        };
        let map = TickMap::of(&machine, &DriveKind::Ideal);
        let found = Loop::new(&machine, map, filter, 3)
            .margin()
            .unwrap()
            .any_phase;
        let expected = case["any_phase_margin"].as_f64().unwrap();
        assert!((found / expected - 1.0).abs() < 2e-3, "{found} of {case}");
        judged += 1;
    }
    assert_eq!(judged, 6);
}

/// Entries that are no numbers would keep balancing from its end.
#[test]
fn a_map_without_numbers_has_no_eigenvalues() {
    let (machine, drives) = at_home(&RobotFile::builtin_l2().unwrap(), 1.8);
    for wrong in [f64::NAN, f64::INFINITY] {
        let mut map = TickMap::of(&machine, &drives);
        map.state[(3, 4)] = wrong;
        assert!(LoopGain::of(&machine, &map).is_none() && map.vibrations().is_none());
        let looped = Loop::new(&machine, map, Filter::first_order(20.0), 3);
        assert!(looped.growth().is_none() && looped.margin().is_none());
    }
}

/// Half of the correction has twice the margin.
#[test]
fn a_margin_is_by_the_share_of_the_correction() {
    let robot = RobotFile::builtin_l2().unwrap();
    let [whole, half] = [1.0, 0.5].map(|gain| Place::at_home(&robot, gain).unwrap().margins);
    let ratio = half.exact.any_phase / whole.exact.any_phase;
    assert!((ratio - 2.0).abs() < 1e-9, "{ratio}");
}

/// With ideal drives the vibrations are the modes, each with the damping of the file; the frequencies
/// of the simulation's steps are off by the square of a sixteenth of a cycle, the damping by a share
/// of the frequency.
#[test]
fn vibrations_with_ideal_drives_are_the_modes() {
    let robot = RobotFile::builtin_l2().unwrap();
    let (linear, _) = at_home(&robot, 1.8);
    let ratio = robot.masses.unwrap().damping_ratio;
    let found = TickMap::of(&linear, &DriveKind::Ideal)
        .vibrations()
        .unwrap();
    let modes = linear.modes.hz();
    assert_eq!(found.len(), modes.iter().filter(|hz| **hz < 500.0).count());
    assert!(found.iter().all(|(hz, _)| *hz > 1.0), "{found:?}");
    for ((hz, damping), mode_hz) in found.iter().zip(&modes) {
        assert!((hz / mode_hz - 1.0).abs() < 2e-3, "{hz} {mode_hz}");
        assert!((damping / ratio - 1.0).abs() < 0.05, "{damping} {ratio}");
    }
}

/// The heaviest tool suffices, and one that is 2 % heavier does not.
#[test]
fn the_heaviest_tool_is_the_last_that_suffices() {
    let robot = RobotFile::builtin_l2().unwrap();
    let finder = NotchFinder::of(&robot).unwrap();
    let compensation = Compensation {
        filter: finder.filter,
        drives: finder.drives,
        latency_cycles: 1,
        gain: 1.0,
    };
    let home = Place::at_home(&robot, 1.0).unwrap();
    let heaviest = heaviest_tool_kg(&finder.machine, &compensation, &[&home]).unwrap();
    for (mass_kg, suffices) in [(heaviest, true), (1.02 * heaviest, false)] {
        let mut machine = finder.machine;
        machine.masses.tool.mass_kg = mass_kg;
        let place = Place::of(&machine, &home.pose, &home.axes, &compensation).unwrap();
        assert_eq!(place.margins.suffice(), suffices, "{mass_kg} kg");
    }
}
