//! The nominal kinematics: T13. A result is finite, inside the travel, and keeps the links'
//! lengths; or is an error.

use gantry_tau_core::model::kinematics::{Pose, RESIDUAL_TOLERANCE};
use gantry_tau_core::model::l2;
use gantry_tau_core::model::linalg::norm;
use gantry_tau_core::model::robot::ARMS;
use gantry_tau_core::model::statics::Wrench;

/// A point in world axes, or positions of the axes.
type Three = [f64; ARMS];

/// T13: the check that every position passes last admits only what is inside the travel, and
/// therefore no NaN.
pub fn check_is_right(nominal: &l2::Kinematics, q: Three) {
    if nominal.travels(&q) {
        is_inside(&q, nominal);
    }
}

/// T13: returned positions are inside the travel, and therefore no NaN; finite, as
/// [`travel_is_finite`].
pub fn inverse_is_inside(nominal: &l2::Kinematics, tcp_m: Three) {
    if let Ok(q) = nominal.inverse(&tcp_m.into()) {
        is_inside(&q, nominal);
    }
}

/// T13, for poses of unknown origin.
pub fn inverse_in_assembly_is_inside(nominal: &l2::Kinematics, tcp_m: Three) {
    if let Ok(q) = nominal.inverse_in_assembly(&tcp_m.into()) {
        is_inside(&q, nominal);
    }
}

/// T13: a tool centre point is returned for positions inside the travel only.
pub fn forward_is_inside(nominal: &l2::Kinematics, q: Three) {
    if nominal.forward(&q).is_ok() {
        is_inside(&q, nominal);
    }
}

fn is_inside(q: &Three, nominal: &l2::Kinematics) {
    let [q1, q2, q3] = *q;
    let [(lower1, upper1), (lower2, upper2), (lower3, upper3)] = nominal.travel();
    assert!(lower1 <= q1 && q1 <= upper1, "T13: inside the travel");
    assert!(lower2 <= q2 && q2 <= upper2, "T13: inside the travel");
    assert!(lower3 <= q3 && q3 <= upper3, "T13: inside the travel");
}

/// T13: every machine there is has a finite travel, so that what is inside is finite too. Tested.
pub fn travel_is_finite(nominal: &l2::Kinematics) {
    for (lower, upper) in nominal.travel() {
        assert!(lower.is_finite() && upper.is_finite(), "T13: finite travel");
    }
}

/// T13: every answer of inverse and forward keeps the lengths of all six links, to
/// [`RESIDUAL_TOLERANCE`] and the rounding of coordinates up to a kilometre. Tested.
pub fn lengths_are_kept(robot: &l2::Robot, nominal: &l2::Kinematics, tcp_m: Three, q: Three) {
    if let Ok(found) = nominal.inverse(&tcp_m.into()) {
        keeps_lengths(robot, nominal, tcp_m, &found);
    }
    if let Ok(found) = nominal.forward(&q) {
        finite(found.as_slice());
        keeps_lengths(robot, nominal, found.into(), &q);
    }
}

/// T13: no number is NaN or infinite.
pub(crate) fn finite(values: &[f64]) {
    assert!(values.iter().all(|value| value.is_finite()), "T13: finite");
}

fn keeps_lengths(robot: &l2::Robot, nominal: &l2::Kinematics, tcp_m: Three, q: &Three) {
    let shortest_m = robot
        .geometry()
        .lengths_m
        .iter()
        .copied()
        .fold(f64::INFINITY, f64::min);
    let pose = Pose {
        position_m: tcp_m.into(),
        rotation: *nominal.rotation(),
    };
    let residual = robot.residual_m(&pose, q);
    assert!(
        residual <= RESIDUAL_TOLERANCE * shortest_m + 1e-12,
        "T13: the links keep their lengths"
    );
}

/// T13: inverse, then forward, leads back: to `tolerance_m` (metres) where the pose is regular.
/// Tested.
pub fn there_and_back(nominal: &l2::Kinematics, tcp_m: Three, tolerance_m: f64) {
    let there = Pose::at(tcp_m.into()).position_m;
    if let Ok(q) = nominal.inverse_in_assembly(&there) {
        let distance_m = nominal.forward(&q).map(|back| norm(&(back - there)));
        assert!(
            distance_m.is_ok_and(|metres| metres <= tolerance_m),
            "T13: forward leads back"
        );
    }
}

/// T12 and T13, for what is built on the kinematics: no panic on any numbers, and every returned
/// number is finite. Tested.
pub fn statics_are_finite(
    robot: &l2::Robot,
    nominal: &l2::Kinematics,
    tcp_m: Three,
    q: Three,
    load: &Wrench,
) {
    let pose = Pose {
        position_m: tcp_m.into(),
        rotation: *nominal.rotation(),
    };
    if let Ok(jacobian) = nominal.jacobian(&pose.position_m) {
        finite(jacobian.as_slice());
    }
    if let Ok(frame) = nominal.link_frame(&pose.position_m, &q) {
        finite(frame.jacobian().as_slice());
    }
    if let Ok(lines) = robot.line_matrix(&pose, &q) {
        finite(lines.matrix().as_slice());
        if let Ok(forces) = lines.link_forces_n(load) {
            finite(&forces);
        }
        if let Ok(motion) = lines.displacement(&q, &load.to_array()) {
            finite(&motion);
        }
    }
}
