//! Compensators against the elastic machine of the simulation, whose springs they know.

use gantry_tau_core::model::kinematics::Pose as CorePose;
use gantry_tau_core::units::{Metres, OffsetNm};
use nalgebra::{UnitQuaternion, Vector3, Vector6};

use super::*;
use crate::elastic::backlash::Backlash;
use crate::elastic::{ElasticMachine, Equilibrium, Pose};
use crate::robot_file::edit::RobotText;
use crate::robot_file::{AnyRobotFile, RobotFile, text_of};

/// Loads of 300 N along each axis of the world, at a hook below the tool centre point.
fn loads() -> Vec<Vector6<f64>> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()]
        .into_iter()
        .flat_map(|axis| [axis, -axis]);
    axes.map(|axis| axis * 300.0)
        .map(|force: Vector3<f64>| {
            let moment = Vector3::new(0.0, 0.0, -0.08).cross(&force);
            Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
        })
        .collect()
}

fn wrench(load: &Vector6<f64>) -> Wrench {
    Wrench::from_array((*load).into())
}

/// A machine at a pose, and its compensator.
struct Bench<const N: usize> {
    elastic: ElasticMachine<N>,
    compensator: Box<dyn Compensate<N>>,
    metres_per_q: [f64; N],
    wrist: Wrist,
}

impl<const N: usize> Bench<N> {
    /// Compensates with `correction` and for `known`; the machine has the wrist of the file.
    fn new<K: MachineKind<N>>(
        file: &RobotFile<K, N>,
        correction: CorrectionKind,
        known: &[WristJoint],
    ) -> Self {
        let compliances = file.compliances.as_ref().unwrap();
        let config = CompensatorConfig {
            gain: 1.0,
            limits: [OffsetNm(4_000_000); N],
            metres_per_q: file.metres_per_q,
        };
        let setup = CompensatorSetup {
            compliances,
            config,
            correction,
            wrist: known,
            home_m: file.home_m(),
        };
        Self {
            elastic: ElasticMachine::new(file.model.geometry(), *compliances, Backlash::NONE),
            compensator: file.model.compensator(&setup).unwrap(),
            metres_per_q: file.metres_per_q,
            wrist: Wrist::new(&file.wrist),
        }
    }

    /// Displacement and turn of the tool under a load, from where it is without: uncompensated, and
    /// compensated.
    fn displaced(
        &mut self,
        place: &CorePose,
        q: [f64; N],
        load: &Vector6<f64>,
    ) -> [(Vector3<f64>, Vector3<f64>); 2] {
        let nominal = std::array::from_fn(|axis| {
            PositionNm::from_metres(Metres(q[axis] * self.metres_per_q[axis])).unwrap()
        });
        let pose = self.compensator.locate(&nominal).unwrap();
        let offsets = self
            .compensator
            .correct(&pose, &nominal, &wrench(load))
            .unwrap()
            .offsets;
        let stood: [f64; N] =
            std::array::from_fn(|axis| nominal[axis].to_metres().0 / self.metres_per_q[axis]);
        let held = std::array::from_fn(|axis| {
            stood[axis] + offsets[axis].to_metres().0 / self.metres_per_q[axis]
        });
        let rotation = UnitQuaternion::from_matrix(&place.rotation);
        let start = Equilibrium::unloaded(Pose {
            translation_m: place.position_m,
            rotation,
        });
        let began = self
            .elastic
            .equilibrium(&stood, &Vector6::zeros(), &start)
            .unwrap();
        [stood, held].map(|q| {
            let now = self.elastic.equilibrium(&q, load, &began).unwrap();
            let given = self.wrist.displacement(
                &now.pose.rotation.to_rotation_matrix().into_inner(),
                &wrench(load),
            );
            let turn = (now.pose.rotation * began.pose.rotation.inverse()).scaled_axis()
                + given.rotation_rad;
            (
                now.pose.translation_m + given.translation_m - began.pose.translation_m,
                turn,
            )
        })
    }
}

fn rms(values: &[f64]) -> f64 {
    let count = u32::try_from(values.len()).unwrap();
    (values.iter().map(|value| value * value).sum::<f64>() / f64::from(count)).sqrt()
}

/// Places over the reach of the L2.
fn places() -> Vec<Vector3<f64>> {
    let file = RobotFile::builtin_l2().unwrap();
    let mut places = Vec::new();
    for x in [-0.4, 0.0, 0.4] {
        for y in [0.3, 0.45, 0.58] {
            places.extend([0.5, 0.65, 0.8].map(|z| Vector3::new(x, y, z)));
        }
    }
    places.retain(|place| file.model.axes_at(place).is_ok());
    places
}

/// Root mean squares of displacements of the L2's tool, over places and loads: before, and after a
/// correction.
fn remains(file: &RobotFile<L2, 3>, correction: CorrectionKind, known: &[WristJoint]) -> [f64; 2] {
    let mut bench = Bench::new(file, correction, known);
    let mut lengths = [Vec::new(), Vec::new()];
    for place in places() {
        let q = file.model.axes_at(&place).unwrap();
        for load in loads() {
            let displaced = bench.displaced(&CorePose::at(place), q, &load);
            for (lengths, (way, _)) in lengths.iter_mut().zip(displaced) {
                lengths.push(way.norm());
            }
        }
    }
    lengths.map(|lengths| rms(&lengths))
}

/// With the true springs: the first order leaves some micrometres, the exact correction what
/// rounding to whole nanometres leaves.
#[test]
fn an_exact_correction_leaves_nothing_of_what_the_first_order_leaves() {
    let file = RobotFile::builtin_l2().unwrap();
    let [before, first_order] = remains(&file, CorrectionKind::FirstOrder, &[]);
    let [_, exact] = remains(&file, CorrectionKind::Exact, &[]);
    assert!(
        (3e-6..15e-6).contains(&first_order) && before > 200e-6,
        "{before:e} {first_order:e}"
    );
    assert!(exact < 5e-9, "{exact:e}");
}

/// Two joints, as the wrist of the 5-DOF extension has them: 1e-5 rad/(N m), 0.15 m above the tool
/// centre point.
fn wrist() -> Vec<WristJoint> {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    axes.map(|axis| WristJoint {
        axis,
        point_m: [0.0, 0.0, 0.15],
        c_rad_per_nm: 1e-5,
    })
    .to_vec()
}

#[test]
fn a_wrist_that_the_file_knows_is_compensated() {
    let mut file = RobotFile::builtin_l2().unwrap();
    file.wrist = wrist();
    let [before, known] = remains(&file, CorrectionKind::Exact, &wrist());
    let [_, unknown] = remains(&file, CorrectionKind::Exact, &[]);
    // What remains: the load acts at the tool, which is off by what the wrist gives way, and the
    // wrist turns with the platform.
    assert!(
        known < 0.03 * before && unknown > 0.1 * before,
        "{before:e} {known:e} {unknown:e}"
    );
}

/// An F1 as a calibration leaves it: its links are not parallel.
fn calibrated_f1() -> RobotFile<F1, 6> {
    let nominal = RobotFile::builtin_f1().unwrap();
    let geometry = nominal.model.geometry();
    let mut lengths = geometry.lengths_m;
    lengths[2] += 1e-4;
    let mut joints: Vec<[f64; 3]> = geometry
        .platform_joints_m
        .iter()
        .map(|joint| (*joint).into())
        .collect();
    for (link, joint) in joints.iter_mut().enumerate() {
        joint[link % 3] += if link % 2 == 0 { 1e-4 } else { -1e-4 };
    }
    let mut text = RobotText::new(&text_of("f1").unwrap(), "CALIBRATED").unwrap();
    text.set_numbers("L", &lengths);
    text.set_rows("b", &joints);
    let AnyRobotFile::F1(file) = AnyRobotFile::parse("calibrated", &text.text()).unwrap() else {
        panic!("not an F1")
    };
    *file
}

/// Remaining shares of displacement and turning of an F1 in a pose, from the first cycle on.
fn remaining_shares(file: &RobotFile<F1, 6>, pose: &CorePose, known: &[WristJoint]) -> [f64; 2] {
    let q = file.model.inverse_in_assembly(pose, None).unwrap().value;
    let mut shares: [f64; 2] = [0.0; 2];
    for load in loads() {
        let mut bench = Bench::new(file, CorrectionKind::Exact, known);
        let [(way, turn), (left, left_turn)] = bench.displaced(pose, q, &load);
        shares[0] = shares[0].max(left.norm() / way.norm());
        shares[1] = shares[1].max(left_turn.norm() / turn.norm());
    }
    shares
}

#[test]
fn a_calibrated_f1_is_compensated_from_the_first_cycle_on() {
    let file = calibrated_f1();
    let home = file.home_m();
    assert_eq!(
        file.model.forward(&file.home_q().unwrap()),
        Err(KinematicsError::SeedRequired)
    );
    let turned = CorePose {
        rotation: *nalgebra::Rotation3::from_scaled_axis(Vector3::new(0.0, 0.2, 0.2)).matrix(),
        ..CorePose::at(home)
    };
    let away = [
        Vector3::zeros(),
        Vector3::new(0.2, 0.0, 0.0),
        Vector3::new(0.0, 0.15, 0.13),
        Vector3::new(0.0, 0.0, 0.2),
    ];
    for pose in away
        .map(|away| CorePose::at(home + away))
        .into_iter()
        .chain([turned])
    {
        // Offsets are whole nanometres: 10 nrad of a plate, against turns of milliradians.
        let shares = remaining_shares(&file, &pose, &[]);
        assert!(
            shares.iter().all(|share| *share < 3e-5),
            "{pose:?}: {shares:?}"
        );
    }
}

/// In place and in turn, in a turned pose as well.
#[test]
fn a_wrist_on_six_axes_is_compensated() {
    let mut file = RobotFile::builtin_f1().unwrap();
    file.wrist = wrist();
    let home = CorePose::at(file.home_m());
    let turned = CorePose {
        rotation: *nalgebra::Rotation3::from_scaled_axis(Vector3::new(0.0, 0.2, 0.2)).matrix(),
        ..home
    };
    for pose in [home, turned] {
        let (known, unknown) = (
            remaining_shares(&file, &pose, &wrist()),
            remaining_shares(&file, &pose, &[]),
        );
        assert!(
            known.iter().all(|share| *share < 0.02) && unknown[1] > 0.1,
            "{known:?} {unknown:?}"
        );
    }
}

/// Corrections of links, axes and wrist together stay within the limits.
#[test]
fn a_wrist_does_not_pass_the_limits() {
    let mut file = RobotFile::builtin_l2().unwrap();
    file.wrist = wrist();
    let config = CompensatorConfig {
        gain: 1.0,
        limits: [OffsetNm(100_000); 3],
        metres_per_q: file.metres_per_q,
    };
    let correction = CorrectionKind::FirstOrder;
    let compliances = file.compliances.as_ref().unwrap();
    let setup = CompensatorSetup {
        compliances,
        config,
        correction,
        wrist: &file.wrist,
        home_m: file.home_m(),
    };
    let mut compensator = file.model.compensator(&setup).unwrap();
    let nominal = file
        .home_q()
        .unwrap()
        .map(|q| PositionNm::from_metres(Metres(q)).unwrap());
    let pose = compensator.locate(&nominal).unwrap();
    for load in loads() {
        let found = compensator
            .correct(&pose, &nominal, &wrench(&load))
            .unwrap();
        assert!(
            found.offsets.iter().all(|offset| offset.0.abs() <= 100_000),
            "{found:?}"
        );
        for (offset, cut) in found.offsets.iter().zip(found.saturated) {
            assert!(!cut || offset.0.abs() == 100_000, "{found:?}");
        }
    }
}
