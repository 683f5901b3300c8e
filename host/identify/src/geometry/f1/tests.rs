//! Calibration of simulated machines whose truth is known.

use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::presets;
use gantry_tau_core::model::robot::LINKS;
use gantry_tau_machine::robot_file::RobotFile;
use gantry_tau_system::output::Name;
use gantry_tau_test_support::seeds::Seeds;
use nalgebra::{Translation3, UnitQuaternion, Vector4};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::derivative::*;
use super::parameters::*;
use super::placed::framed;
use super::*;
use crate::fit::frames::Frames;
use crate::fit::least_squares::Observability;
use crate::fit::statistics::NORMAL_95;
use crate::fit::svd::Svd;
use crate::geometry::robust_fit::fit_agreeing;

/// Noise of a tracker: m, rad.
const SIGMA: [f64; 2] = [50e-6, 100e-6];

fn file() -> f1::Geometry {
    f1::Geometry {
        travel: None,
        ..presets::f1()
    }
}

struct Campaign {
    random: ChaCha8Rng,
    /// As the device sees it.
    truth: f1::Geometry,
    /// The file's machine, as the device sees it: the start.
    start: f1::Geometry,
}

impl Campaign {
    /// A machine whose places are up to 5 mm off, its directions 3 mrad, its lengths 2 mm.
    fn new(seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut step = DVector::zeros(PARAMETERS);
        for (parameter, value) in step.iter_mut().enumerate() {
            let most = match parameter {
                V..P | AX.. => 3e-3,
                L..AX => 2e-3,
                _ => 5e-3,
            };
            *value = most * random.random_range(-1.0..1.0_f64);
        }
        // What cannot be seen is not changed.
        step.fixed_rows_mut::<3>(P).fill(0.0);
        let along = file().turn_axis.normalize();
        let mean = (step.fixed_rows::<3>(P + 3) + step.fixed_rows::<3>(P + 6)).dot(&along) / 2.0;
        for link in [1, 2] {
            let mut joint = step.fixed_rows_mut::<3>(P + 3 * link);
            joint -= along * mean;
        }
        let [device, target] = [(2.0, 3.0), (1.0, 0.1)].map(|(turn, shift)| {
            let [turn, shift] =
                [turn, shift].map(|most| Vector3::from_fn(|_, _| within(&mut random, most)));
            Isometry3::from_parts(
                Translation3::from(shift),
                UnitQuaternion::from_scaled_axis(turn),
            )
        });
        let [truth, start] =
            [stepped(&file(), &step), file()].map(|machine| seen_by(&machine, &device, &target));
        Self {
            random,
            truth,
            start,
        }
    }

    /// Positions of the axes all over the workspace, plates turned out of step.
    fn positions(&mut self, count: usize) -> Vec<[f64; AXES]> {
        let kinematics = f1::Kinematics::new(&f1::Robot::new(file()).unwrap());
        let mut found = Vec::new();
        while found.len() < count {
            let [x, y, z] = [0.4, 0.3, 0.3].map(|most| within(&mut self.random, most));
            let position_m = Vector3::new(x, y, 0.4 + z);
            let [about_z, about_y] = [Vector3::z(), Vector3::y()]
                .map(|axis| UnitQuaternion::from_scaled_axis(axis * within(&mut self.random, 0.3)));
            let vector = Vector3::from_fn(|_, _| within(&mut self.random, 0.15));
            let rotation = about_z * about_y * UnitQuaternion::from_scaled_axis(vector);
            let pose = Pose {
                position_m,
                rotation: rotation.to_rotation_matrix().into_inner(),
            };
            let Ok(solution) = kinematics.inverse_in_assembly(&pose, None) else {
                continue;
            };
            // A machine that is millimetres off may be at its end where that of the file is not.
            let truth = Poses::kinematics(&self.truth).unwrap();
            if forward(&truth, &solution.value, &self.nearby(&solution.value)).is_ok() {
                found.push(solution.value);
            }
        }
        found
    }

    /// Pose of the target with the axes there.
    fn pose(machine: &f1::Geometry, q: &[f64; AXES], seed: &Pose) -> Pose {
        let kinematics = Poses::kinematics(machine).unwrap();
        forward(&kinematics, q, seed).unwrap()
    }

    /// Pose of the start's machine: from its own synchronised form, if it has one, or from the
    /// file's.
    fn nearby(&self, q: &[f64; AXES]) -> Pose {
        // The same motion that made the start from the file.
        let kinematics = f1::Kinematics::new(&f1::Robot::new(file()).unwrap());
        let at_home = kinematics.forward(q).unwrap().value;
        let device = rigid_of(&file().carts_m, &self.start.carts_m);
        let on_platform = rigid_of(&self.start.platform_joints_m, &file().platform_joints_m);
        let rotation = UnitQuaternion::from_matrix(&at_home.rotation);
        let platform = Isometry3::from_parts(Translation3::from(at_home.position_m), rotation);
        let seen = device * platform * on_platform;
        Pose {
            position_m: seen.translation.vector,
            rotation: seen.rotation.to_rotation_matrix().into_inner(),
        }
    }

    fn measured(&mut self, positions: &[[f64; AXES]], sigma: [f64; 2]) -> Vec<MeasuredPose<AXES>> {
        let mut poses = Vec::new();
        for q in positions {
            let pose = Self::pose(&self.truth, q, &self.nearby(q));
            let [turn, shift] = [sigma[1], sigma[0]].map(|sigma| {
                Vector3::from_fn(|_, _| {
                    sigma * Distribution::<f64>::sample(&StandardNormal, &mut self.random)
                })
            });
            let turn = UnitQuaternion::from_scaled_axis(turn);
            poses.push(MeasuredPose {
                name: Name::made(poses.len()),
                q: *q,
                position_m: pose.position_m + shift,
                rotation: Some(turn * UnitQuaternion::from_matrix(&pose.rotation)),
            });
        }
        poses
    }
}

/// Number of up to `most` in size.
fn within(random: &mut ChaCha8Rng, most: f64) -> f64 {
    random.random_range(-most..most)
}

/// The motion between two sets of points that are the same but for it.
fn rigid_of(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Isometry3<f64> {
    let pairs: Vec<_> = from.iter().copied().zip(to.iter().copied()).collect();
    crate::fit::frames::rigid(&pairs).unwrap()
}

fn poses(measured: &[MeasuredPose<AXES>]) -> Poses<'_> {
    let [place, turn] = SIGMA.map(|sigma| 1.0 / sigma);
    Poses {
        poses: measured,
        whitening: Matrix6::from_diagonal(&Vector6::new(place, place, place, turn, turn, turn)),
    }
}

#[test]
fn the_derivatives_are_those_of_the_forward_kinematics() {
    let mut campaign = Campaign::new(1);
    let step = 1e-6;
    for q in campaign.positions(10) {
        let here = Campaign::pose(&campaign.truth, &q, &campaign.nearby(&q));
        let derivative = derivative(&campaign.truth, &q, &here);
        for parameter in 0..PARAMETERS {
            let [ahead, behind] = [step, -step].map(|by| {
                let mut change = DVector::zeros(PARAMETERS);
                change[parameter] = by;
                Campaign::pose(&stepped(&campaign.truth, &change), &q, &here)
            });
            let place = (ahead.position_m - behind.position_m) / (2.0 * step);
            let turn =
                rotation_vector(&(ahead.rotation * behind.rotation.transpose())) / (2.0 * step);
            let column = derivative.column(parameter);
            let off = (column.fixed_rows::<3>(0) - place)
                .amax()
                .max((column.fixed_rows::<3>(3) - turn).amax());
            assert!(off < 1e-6, "{parameter}: {off:e}");
        }
    }
}

/// Rows that keep four directions which cannot be seen: the first joint, and the mean of two others
/// along the plates' axis.
#[test]
fn what_is_fixed_is_a_joint_and_a_mean_along_the_axis() {
    let rows = fixed(&file());
    let along = file().turn_axis.normalize();
    for joint in 0..LINKS {
        let (by, expected) = match joint {
            0 => (
                Vector3::new(1.0, 2.0, 3.0),
                Vector4::new(1.0, 2.0, 3.0, 0.0),
            ),
            1 | 2 => (along, Vector4::new(0.0, 0.0, 0.0, 0.5)),
            _ => (along, Vector4::zeros()),
        };
        let mut step = DVector::zeros(PARAMETERS);
        step.fixed_rows_mut::<3>(P + 3 * joint).copy_from(&by);
        assert!((rows * step * 1e-9 - expected).amax() < 1e-12, "{joint}");
    }
}

/// A machine that is millimetres off may stand beyond an end that the file's has.
#[test]
fn a_calibration_knows_no_travel() {
    assert!(presets::f1().travel.is_some());
    assert!(
        Poses::kinematics(&presets::f1())
            .unwrap()
            .robot()
            .geometry()
            .travel
            .is_none()
    );
}

#[test]
fn poses_without_noise_give_the_machine() {
    for seed in 0..5 {
        let mut campaign = Campaign::new(seed);
        let positions = campaign.positions(40);
        let measured = campaign.measured(&positions, [0.0; 2]);
        let found = fit_agreeing(&poses(&measured), campaign.start).unwrap();
        assert_eq!(
            (found.fit.seen.kept(), found.outliers.len()),
            (PARAMETERS, 0)
        );
        assert_eq!(found.fit.degrees(), 6 * 40 - OBSERVABLE);
        // What no pose shows is the start's, which the truth shares but for the direction of the
        // plates' axis.
        let off = apart(
            &framed(&found.fit.state, &Frames::identity(), &campaign.truth),
            &campaign.truth,
        );
        assert!(off < 1e-9, "{seed}: {off:e} after {}", found.fit.rounds);
    }
}

#[test]
fn four_combinations_cannot_be_seen() {
    let mut campaign = Campaign::new(3);
    let positions = campaign.positions(60);
    let measured = campaign.measured(&positions, SIGMA);
    let all: Vec<usize> = (0..measured.len()).collect();
    let mut rows = poses(&measured).rows(&campaign.truth, &all).unwrap();
    let readings = 6 * measured.len();
    rows.derivatives = rows.derivatives.rows(0, readings).into_owned();
    rows.residuals = rows.residuals.rows(0, readings).into_owned();
    let seen = Observability::new(&rows, &scales(&campaign.truth));
    let values = seen.singular_values();
    assert!(
        values[OBSERVABLE] < 1e-10 * values[0] && values[OBSERVABLE - 1] > 1e-6 * values[0],
        "{values}"
    );
    // They lie in the span that the page of this module says: C_1 against P_11, and C_2 against
    // P_21, P_22 along the plates' axis.
    let unseen: Vec<_> = unseen(&campaign.truth)
        .into_iter()
        .map(|direction| direction.components)
        .collect();
    let span = DMatrix::from_columns(&unseen);
    let lost = seen.lost();
    assert_eq!(lost.len(), 4);
    for direction in lost {
        let outside = &direction.components - &span * (span.transpose() * &direction.components);
        assert!(outside.norm() < 1e-6, "{outside}");
    }
}

/// A departure from the model that a simulated machine has.
#[derive(Clone, Copy, Debug)]
enum Fault {
    OwnAxis(f64),
    AxisOffset(f64),
    Gain(usize, f64),
    Periodic(usize, f64),
}

/// Length of the simulated period, rad: that of a screw of 10 mm lead.
const PERIOD_RAD: f64 = 0.1;

/// Rotation about an axis, rad.
fn about(axis: &Vector3<f64>, angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(axis.normalize() * angle)
}

/// Poses of a machine with a fault, as a tracker sees them; each fault is a change of parameters
/// from pose to pose.
fn faulty(
    campaign: &mut Campaign,
    positions: &[[f64; AXES]],
    fault: Fault,
) -> Vec<MeasuredPose<AXES>> {
    let truth = campaign.truth;
    let mut poses = Vec::new();
    for q in positions {
        let mut machine = truth;
        let mut turned = *q;
        let turn = about(&truth.turn_axis, truth.turn_signs[1].sign() * q[4]);
        match fault {
            Fault::OwnAxis(angle) => {
                let axis = about(&truth.tilt_axis, angle) * truth.turn_axis;
                let own = turn.inverse() * about(&axis, truth.turn_signs[1].sign() * q[4]);
                let tilt = about(&truth.tilt_axis, q[5]);
                for link in [3, 4, 5] {
                    machine.plate_joints_m[link] =
                        tilt.inverse() * (own * (tilt * truth.plate_joints_m[link]));
                }
            }
            Fault::AxisOffset(distance) => {
                machine.carts_m[2] +=
                    turn * truth.turn_axis.cross(&truth.tilt_axis).normalize() * distance;
            }
            Fault::Gain(screw, gain) => turned[3 + screw] *= 1.0 + gain,
            Fault::Periodic(screw, size) => {
                turned[3 + screw] +=
                    size * (std::f64::consts::TAU * q[3 + screw] / PERIOD_RAD + 0.7).sin();
            }
        }
        campaign.truth = machine;
        let mut measured = campaign.measured(&[turned], SIGMA).remove(0);
        measured.q = *q;
        poses.push(measured);
    }
    campaign.truth = truth;
    poses
}

#[test]
fn departures_from_the_model_are_found_and_distinguished() {
    let gains = [0, 1, 2].map(|screw| (Fault::Gain(screw, 2e-3), 2e-3));
    let periodic = [0, 1, 2].map(|screw| (Fault::Periodic(screw, 0.3e-3), 0.3e-3));
    let axes = [
        (Fault::OwnAxis(2e-3), 2e-3),
        (Fault::AxisOffset(1e-3), 1e-3),
    ];
    for (fault, size) in axes.into_iter().chain(gains).chain(periodic) {
        let mut campaign = Campaign::new(300);
        let positions = campaign.positions(60);
        let measured = faulty(&mut campaign, &positions, fault);
        let poses = poses(&measured);
        let calibrated = fit_agreeing(&poses, campaign.start).unwrap();
        let found = poses.diagnostics(&calibrated);
        let most = found
            .iter()
            .min_by(|one, other| one.p.total_cmp(&other.p))
            .unwrap();
        let is_meant = match (fault, most.departure) {
            (Fault::OwnAxis(_), Departure::OwnAxis)
            | (Fault::AxisOffset(_), Departure::AxisOffset) => true,
            (Fault::Gain(screw, _), Departure::Gain(axis)) => axis == screw + 4,
            // Between two of the periods that are tried.
            (Fault::Periodic(screw, _), Departure::Periodic { axis, period_rad }) => {
                axis == screw + 4 && (period_rad - PERIOD_RAD).abs() < 5e-3
            }
            _ => false,
        };
        assert!(
            is_meant && most.is_found(found.len()),
            "{fault:?}: {found:#?}"
        );
        assert!(
            (most.size.abs() - size).abs() < 4.0 * most.sd,
            "{fault:?}: {most:?}"
        );
    }
}

#[test]
fn the_error_reaches_the_bound_and_the_intervals_hold() {
    let mut squares = [0.0_f64; 2];
    let mut places = 0.0;
    let mut held = 0_u32;
    let mut asked = 0_u32;
    let mut judged = 0_u32;
    let mut alarms = 0_u32;
    let seeds = Seeds::new(6, 200);
    for seed in seeds.iter() {
        let mut campaign = Campaign::new(1_000 + seed);
        let positions = campaign.positions(60);
        let unseen = campaign.positions(40);
        let measured = campaign.measured(&positions, SIGMA);
        let found = fit_agreeing(&poses(&measured), campaign.start).unwrap();
        let covariance = found.fit.seen.covariance();
        let diagnostics = poses(&measured).diagnostics(&found);
        judged += u32::try_from(diagnostics.len()).unwrap();
        alarms += u32::try_from(
            diagnostics
                .iter()
                .filter(|diagnostic| diagnostic.p < 0.01)
                .count(),
        )
        .unwrap();
        for q in &unseen {
            let seed = campaign.nearby(q);
            let [model, truth] = [&found.fit.state, &campaign.truth]
                .map(|machine| Campaign::pose(machine, q, &seed));
            let turn = rotation_vector(&(model.rotation * truth.rotation.transpose()));
            let derivative = derivative(&campaign.truth, q, &truth);
            let expected = derivative * &covariance * derivative.transpose();
            // Each place by what is expected there: near a singular one that may be a hundred times
            // more, and would drown the others.
            squares[0] += (model.position_m - truth.position_m).norm_squared()
                / expected.fixed_view::<3, 3>(0, 0).trace();
            squares[1] += turn.norm_squared() / expected.fixed_view::<3, 3>(3, 3).trace();
            places += 1.0;
        }
        let off = parameters(&found.fit.state, &found.fit.state)
            - parameters(&campaign.truth, &campaign.truth);
        for parameter in B..AX {
            let interval = NORMAL_95 * covariance[(parameter, parameter)].sqrt();
            held += u32::from(off[parameter].abs() <= interval);
            asked += 1;
        }
    }
    let ratios = squares.map(|squares| (squares / places).sqrt());
    let limit = 1.0 + seeds.widened(0.1);
    assert!(ratios.iter().all(|ratio| *ratio < limit), "{ratios:?}");
    let share = f64::from(held) / f64::from(asked);
    assert!(
        (share - 0.95).abs() < seeds.widened(0.02),
        "{share} of {asked}"
    );
    // 1 % of the departures that are judged, none of which is there; 30 are 99.9 % of what 1600
    // draws do.
    let most = f64::from(judged) * (0.01 + seeds.widened(0.00875));
    assert!(
        judged == 8 * seeds.count && f64::from(alarms) <= most,
        "{alarms} of {judged}"
    );
}

/// Largest difference of the parameters of two machines.
fn apart(one: &f1::Geometry, other: &f1::Geometry) -> f64 {
    (parameters(one, other) - parameters(other, other)).amax()
}

/// Machine, device and target: sixteen combinations are the file's, and what is left is what moves
/// the tool.
#[test]
fn in_the_frame_of_the_file_the_file_comes_back() {
    for seed in 11..16 {
        let mut campaign = Campaign::new(seed);
        campaign.truth = campaign.start;
        let positions = campaign.positions(40);
        let measured = campaign.measured(&positions, [0.0; 2]);
        let poses = poses(&measured);
        let calibrated = fit_agreeing(&poses, campaign.start).unwrap();
        let home_m = RobotFile::builtin_f1().unwrap().home_m();
        let found = poses
            .in_frame_of(&calibrated, &file(), &home_m, None)
            .unwrap();
        let off = apart(&found.geometry, &file());
        assert!(off < 1e-9, "{seed}: {off:e}");
        // Ranks: 64 less 4 of the file, and less 12 or 9 of frames that were fitted.
        let known = poses.in_frame_of(
            &calibrated,
            &file(),
            &home_m,
            Some(found.frames.target.translation.vector),
        );
        let in_device_frame = found.in_device_frame(&calibrated, &file());
        let in_known_frame = found.in_known_frame(&calibrated, &file(), found.frames.device);
        for (placed, rank) in [
            (found, 48),
            (known.unwrap(), 51),
            (in_device_frame, 60),
            (in_known_frame, 60),
        ] {
            let back = seen_by(
                &placed.geometry,
                &placed.frames.device,
                &placed.frames.target,
            );
            let off = poses
                .residuals(&back, &[])
                .iter()
                .map(|[_, rest]| rest.norm())
                .fold(0.0, f64::max);
            assert!(off < 1e-12, "{seed}: {rank}: {off:e}");
            let values = Svd::new(placed.covariance).values;
            assert!(
                values[rank - 1] > 1e-13 && values[rank] < 1e-6 * values[rank - 1],
                "{rank}: {values}"
            );
        }
    }
}
