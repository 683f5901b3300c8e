//! Predictions over the workspace.

use gantry_tau_core::model::kinematics::Pose as CorePose;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::elastic::backlash::Backlash;
use gantry_tau_machine::elastic::{ElasticMachine, Equilibrium, Pose};
use gantry_tau_machine::model::{CorrectedPose, L2, MachineKind};
use gantry_tau_machine::robot_file::{RobotFile, WristJoint};
use nalgebra::{Vector3, Vector6};

use super::WORKPIECE;
use super::simulated::{Draw, N, SPRINGS, identified};
use crate::verify::{PredictOptions, directions, predict};

/// The prediction over the workspace against machines drawn from the file: means of squares, place
/// by place and load by load.
#[test]
fn the_map_is_the_mean_over_machines() {
    let file = identified();
    let options = PredictOptions {
        cells: 12,
        force_n: 300.0,
        workpiece_n_per_m: WORKPIECE,
    };
    let prediction = predict(&file, &options).unwrap();
    let summary = prediction.summary();
    let compensator = file.compensator([OffsetNm(2_000_000); N]).unwrap();
    let mut draw = Draw::new(3);
    let mut simulated = 0.0;
    let mut predicted = 0.0;
    let mut count = 0.0;
    for _ in 0..40 {
        let machine =
            ElasticMachine::new(file.model.geometry(), draw.machine(&file), Backlash::NONE);
        for place in prediction.places.iter().step_by(5) {
            let tool_m = Vector3::from(place.tool_m);
            let off = file.model.axes_at(&tool_m).unwrap();
            let start = Equilibrium::unloaded(Pose {
                translation_m: tool_m,
                rotation: nalgebra::UnitQuaternion::identity(),
            });
            let began = machine
                .equilibrium(&off, &Vector6::zeros(), &start)
                .unwrap();
            for (way, load) in directions()
                .into_iter()
                .zip(&place.loads)
                .filter(|(_, load)| load.is_judged())
            {
                let force = way * options.force_n;
                let wrench = Vector6::new(force.x, force.y, force.z, 0.0, 0.0, 0.0);
                let pose = CorePose::at(tool_m);
                let held = CorrectedPose::new(
                    &*compensator,
                    &[1.0; N],
                    &pose,
                    &off,
                    &Wrench::from_array(wrench.into()),
                )
                .unwrap();
                let now = machine
                    .equilibrium(&held.corrected, &wrench, &began)
                    .unwrap();
                // Relative, so that places near a singularity do not decide alone.
                simulated += ((now.pose.translation_m - began.pose.translation_m).norm()
                    / load.before_m)
                    .powi(2);
                predicted += (load.expected_m() / load.before_m).powi(2);
                count += 1.0;
            }
        }
    }
    assert!(count > 1000.0);
    // Forty machines of nine springs: the mean square is known to a tenth.
    let ratio = f64::sqrt(simulated / predicted);
    assert!((0.9..1.1).contains(&ratio), "{ratio} {summary}");
    assert!(
        summary.across_the_jump > 0 && summary.method_rms_m < 1e-8,
        "{summary}"
    );
}

/// A wrist is compensated along; what the file does not know of it remains.
#[test]
fn a_wrist_is_part_of_the_prediction() {
    let mut file = identified();
    file.wrist = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        .map(|axis| WristJoint {
            axis,
            point_m: [0.0, 0.0, 0.15],
            c_rad_per_nm: 1e-5,
        })
        .into();
    // Known to a tenth each.
    let known = file.identified.as_mut().unwrap();
    known.sd.extend([1e-6; 2]);
    known
        .covariance
        .iter_mut()
        .for_each(|row| row.extend([0.0; 2]));
    for joint in 0..2 {
        known.covariance.push(
            (0..SPRINGS + 2)
                .map(|column| {
                    if column == SPRINGS + joint {
                        1e-12
                    } else {
                        0.0
                    }
                })
                .collect(),
        );
    }
    let options = PredictOptions {
        cells: 12,
        force_n: 300.0,
        workpiece_n_per_m: WORKPIECE,
    };
    let with = predict(&file, &options).unwrap().summary();
    let without = predict(&identified(), &options).unwrap().summary();
    // 300 N across 0.15 m turn a joint by 0.45 mrad, which moves the tool by 67 um; a tenth of it
    // is not known.
    assert!(
        with.before_rms_m > without.before_rms_m + 10e-6,
        "{with} {without}"
    );
    assert!(
        with.method_rms_m < 1.5e-6 && (4e-6..8e-6).contains(&with.springs_rms_m),
        "{with}"
    );
    assert!(with.largest_gain < without.largest_gain, "{with} {without}");
}

#[test]
fn a_file_without_a_covariance_predicts_nothing() {
    let file = RobotFile::builtin_l2().unwrap();
    let options = PredictOptions {
        cells: 12,
        force_n: 300.0,
        workpiece_n_per_m: WORKPIECE,
    };
    let error = predict(&file, &options).unwrap_err().to_string();
    assert!(
        error.contains("has no [identified]") && !error.contains('\n'),
        "{error}"
    );
}

/// Largest stable gain over the workspace.
fn largest_gain(file: &RobotFile<L2, N>, workpiece_n_per_m: f64) -> f64 {
    let options = PredictOptions {
        cells: 12,
        force_n: 300.0,
        workpiece_n_per_m,
    };
    predict(file, &options).unwrap().summary().largest_gain
}

/// Against a rigid workpiece the margin is what the springs are not known to: one sided 97.5 %. A
/// soft workpiece allows more.
#[test]
fn the_margin_is_that_of_the_springs() {
    let mut file = identified();
    let [rigid, soft] = [1e12, 1e5].map(|workpiece_n_per_m| largest_gain(&file, workpiece_n_per_m));
    assert!(
        (0.8..0.995).contains(&rigid) && soft > rigid + 0.2,
        "{rigid} {soft}"
    );
    let exact = file.identified.as_mut().unwrap();
    exact
        .covariance
        .iter_mut()
        .flatten()
        .for_each(|entry| *entry = 0.0);
    assert!((largest_gain(&file, 1e12) - 1.0).abs() < 1e-4);
}
