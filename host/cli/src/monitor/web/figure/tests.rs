use gantry_tau_core::control::message::{Cause, Phase};
use serde_json::Value;

use super::*;
use crate::monitor::{AxisSnapshot, Channels, Counters};

fn snapshot(nominal_nm: &[i64], offset_nm: i32) -> Snapshot {
    let axes = nominal_nm.iter().map(|&nominal_nm| AxisSnapshot {
        nominal_nm,
        reference_nm: nominal_nm + i64::from(offset_nm),
        offset: Channels {
            position_nm: offset_nm,
            velocity_um_s: 0,
            torque_permille: 0,
        },
        shadow_nm: 0,
        actual: Channels {
            position_nm: nominal_nm,
            velocity_um_s: 0,
            torque_permille: 0,
        },
        lag_nm: None,
        flags: Vec::new(),
    });
    Snapshot {
        tick: 1,
        phase: Phase::Obtain,
        epoch: 1,
        cause: Cause::None,
        sequence: 1,
        on_time: 100,
        ramp_ticks_left: 0,
        counters: Counters::from([0; 10]),
        longest_miss_run: 0,
        machine_failed: false,
        rows_lost: false,
        axes: axes.collect(),
        drives: None,
        force: None,
        gauges_m: None,
        displacement_m: Some([1e-4, -2e-4, 3e-4]),
        turn_rad: Some([0.0, 0.0, 1e-3]),
        machine: None,
    }
}

fn vector(point: &Value) -> Vector3<f64> {
    Vector3::from_fn(|row, _| point[row].as_f64().unwrap())
}

/// Away from home the links have the lengths of the robot file, the tool is where it was asked to
/// be, and what differs is what was said.
fn check<K: MachineKind<N>, const N: usize>(robot: RobotFile<K, N>) {
    let tool_m = robot.home_m() + Vector3::new(0.05, -0.03, 0.02);
    let q = robot.model.axes_at(&tool_m).unwrap();
    let nominal_nm: Vec<i64> = q
        .iter()
        .zip(robot.metres_per_q)
        .map(|(q, metres)| (q * metres * 1e9).round() as i64)
        .collect();
    let geometry = robot.model.geometry();
    let metres_per_q = robot.metres_per_q;
    let mut drawn = Drawn::new(robot).unwrap();
    assert_eq!(drawn.axes(), N);
    let machine: Value = serde_json::from_str(&drawn.machine()).unwrap();
    assert_eq!(machine["arms"].as_array().unwrap().len(), 3);
    let figure: Value =
        serde_json::from_str(&drawn.figure(&snapshot(&nominal_nm, 200_000)).unwrap()).unwrap();
    assert!((vector(&figure["tool"]) - tool_m).norm() < 2e-5);
    for (link, length) in geometry.lengths_m.into_iter().enumerate() {
        let apart = vector(&figure["joints"][link]) - vector(&figure["platform"][link]);
        assert!((apart.norm() - length).abs() < 2e-5, "link {link}");
        // The platform turns about z: a lever (x, y, z) goes by 1e-3 (-y, x, 0) more than the tool.
        let lever = geometry.platform_joints_m[link];
        let more =
            vector(&figure["platform_displacements"][link]) - vector(&figure["tool_displacement"]);
        assert!(
            (more - 1e-3 * Vector3::new(-lever.y, lever.x, 0.0)).norm() < 5e-9,
            "link {link}"
        );
    }
    assert_eq!(
        vector(&figure["tool_displacement"]),
        Vector3::new(1e-4, -2e-4, 3e-4)
    );
    for (arm, guideway) in geometry.guideways.into_iter().enumerate() {
        let way = vector(&figure["cart_offsets"][arm]) - guideway * (2e-4 / metres_per_q[arm]);
        assert!(way.norm() < 2e-9, "arm {arm}");
    }
    let far = snapshot(&vec![900_000_000_000; N], 0);
    assert!(drawn.figure(&far).is_err());
    assert!(
        drawn.figure(&snapshot(&nominal_nm, 0)).is_ok(),
        "it goes on after positions out of reach"
    );
}

#[test]
fn the_picture_is_that_of_the_robot_file() {
    check(RobotFile::builtin_l2().unwrap());
    check(RobotFile::builtin_f1().unwrap());
}
