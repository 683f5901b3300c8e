//! The kinematics of six axes: T13. A result is finite, inside the travel, and keeps the links'
//! lengths; or is an error.

use gantry_tau_core::model::f1;
use gantry_tau_core::model::kinematics::{
    COLD_ITERATIONS, Pose, RESIDUAL_TOLERANCE, WARM_ITERATIONS,
};
use gantry_tau_core::model::linalg::rotation_deviation;
use gantry_tau_core::model::statics::Wrench;

use crate::properties::compensation::cycle_is_bounded;
use crate::properties::kinematics::finite;

/// Positions of the axes, q-units.
type Six = [f64; f1::AXES];

/// T13: the check of the axes that every answer passes admits only what is inside the travel, and
/// therefore no NaN.
pub fn check_is_right(kinematics: &f1::Kinematics, q: &Six) {
    if kinematics.travels(q) {
        is_inside(kinematics, q);
    }
}

fn is_inside(kinematics: &f1::Kinematics, q: &Six) {
    let travel = kinematics.travel();
    for axis in 0..f1::AXES {
        let (lower, upper) = travel[axis];
        assert!(
            lower <= q[axis] && q[axis] <= upper,
            "T13: inside the travel"
        );
    }
}

/// T13: every answer of inverse and forward, from any numbers, is finite, inside the travel, and
/// keeps the links' lengths. Tested.
pub fn answers_are_checked(
    kinematics: &f1::Kinematics,
    pose: &Pose,
    seed: Option<[f64; 3]>,
    q: &Six,
) {
    if let Ok(found) = kinematics.inverse(pose, seed) {
        keeps_lengths(kinematics, pose, &found.value);
    }
    let plates = seed.unwrap_or_default();
    let (place, near) = (&pose.position_m, &pose.rotation);
    if let Ok(found) = kinematics.inverse_fixed_plates(place, &plates, near, COLD_ITERATIONS) {
        let (q, pose) = &found.value;
        keeps_lengths(kinematics, pose, q);
    }
    let unseeded = kinematics.forward(q);
    let seeded = kinematics.forward_from(q, pose, WARM_ITERATIONS);
    for found in [unseeded, seeded].iter().flatten() {
        keeps_lengths(kinematics, &found.value, q);
    }
}

fn keeps_lengths(kinematics: &f1::Kinematics, pose: &Pose, q: &Six) {
    is_inside(kinematics, q);
    finite(q);
    assert!(
        rotation_deviation(&pose.rotation) <= 1e-9,
        "T13: a rotation"
    );
    let lengths_m = &kinematics.robot().geometry().lengths_m;
    let shortest_m = lengths_m.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(
        kinematics.residual_m(pose, q) <= RESIDUAL_TOLERANCE * shortest_m,
        "T13: the links keep their lengths"
    );
}

/// T12 and T13 for what is built on the kinematics: no panic on any numbers, and every returned
/// number is finite. Tested.
pub fn statics_are_finite(machine: &f1::Elastic, pose: &Pose, q: &Six, load: &Wrench) {
    if let Ok(jacobian) = machine.kinematics().jacobian(pose, q) {
        finite(jacobian.as_slice());
    }
    if let Ok(lines) = machine.kinematics().line_matrix(pose, q) {
        if let Ok(jacobian) = lines.jacobian() {
            finite(jacobian.as_slice());
        }
        if let Ok(forces) = lines.link_forces_n(load) {
            finite(&forces);
        }
        if let Ok(deflection) = lines.deflection(machine.compliances(), load) {
            finite(&deflection.carts);
            finite(&deflection.total.to_array());
        }
    }
    let first_order = machine.command(pose, q, load, 1.0);
    let exact = machine.exact_command(pose, q, load).map(|held| held.value);
    for command in [first_order, exact].iter().flatten() {
        finite(command);
    }
}

/// T13: for any positions, the tracker returns an error or a pose that satisfies the links; after
/// an error the last pose stays, and the next reachable positions (those of `near`) lead to it.
/// Tested.
pub fn tracker_is_checked(kinematics: &f1::Kinematics, near: &Pose, wild: &[Six]) {
    let Ok(there) = kinematics.inverse(near, None) else {
        return;
    };
    let mut tracker = f1::PoseTracker::default();
    let Ok(first) = tracker.track(kinematics, &there.value) else {
        return;
    };
    for q in wild {
        tracker.last = Some(first.value);
        // Warm, patient, cold.
        let found = (0..3).find_map(|_| {
            let found = tracker.track(kinematics, q).ok();
            assert!(
                found.is_some() || tracker.last == Some(first.value),
                "T13: an error leaves the last pose"
            );
            found
        });
        if let Some(found) = found {
            keeps_lengths(kinematics, &found.value, q);
            continue;
        }
        let back = tracker.track(kinematics, &there.value);
        assert!(
            back.is_ok_and(|back| (back.value.position_m - first.value.position_m).amax() < 1e-10),
            "T13: the next reachable positions work"
        );
    }
}

/// T14, for a whole cycle of six axes, by either map. Tested.
pub fn cycles_are_bounded(compensator: &f1::Compensator, pose: &Pose, q: &Six, load: &Wrench) {
    let config = compensator.config();
    let correction = compensator.correct_at(pose, q, load);
    if let Ok(lines) = compensator.machine().kinematics().line_matrix(pose, q) {
        assert!(
            compensator.correct_of(&lines, pose, q, load) == correction,
            "T14: the same correction, from its lines"
        );
    }
    cycle_is_bounded(config, correction, load);
    cycle_is_bounded(config, compensator.correct_exact_at(pose, q, load), load);
}
