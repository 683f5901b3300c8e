//! The kinematics module in LinuxCNC: part programs, and poses that it refuses.

use std::fmt::Write as _;
use std::process::Command;

use gantry_tau_machine::robot_file::{AnyRobotFile, RobotFile};
use libtest_mimic::Failed;

use super::record::Row;
use super::run::{Ended, Machine, make};
use crate::capi::tools::{run, target};

/// Symbols that a module may need beside `hal_*` and `rtapi_*`.
const ALLOWED: [&str; 15] = [
    // Of every shared object that gcc links.
    "_ITM_deregisterTMCloneTable",
    "_ITM_registerTMCloneTable",
    "__cxa_finalize",
    "__gmon_start__",
    "__stack_chk_fail",
    // What compilers presuppose, and the maths of units.h.
    "memcpy",
    "memmove",
    "memset",
    "memcmp",
    "bcmp",
    "sin",
    "cos",
    "sincos",
    "atan2",
    "sqrt",
];

/// Servo periods between a pose and the joints that follow it: LinuxCNC's interpolator.
const DELAY: usize = 2;
/// Half a digit of the record, and half a nanometre of the joints, with a margin: mm or degrees.
const DIGITS: f64 = 1.5e-6;
/// A nanometre of a cart, mm, and of a plate's screw of 0.1 m/rad, degrees, are 1e-6 and 0.57e-6;
/// joints are rounded to whole ones.
const STEP: f64 = 0.57e-6;
/// The record's poses have six digits as well: through an inverse that turns 1e-6 mm and degrees
/// into as much again.
const POSE_DIGITS: f64 = 0.6e-6;

/// Rounding between a joint and the inverse of a recorded pose, mm or degrees.
const BOUND: f64 = DIGITS + STEP + POSE_DIGITS;

/// No panic path, no allocation and no function beyond the list is linked: LinuxCNC would find that
/// out when it loads the module.
pub(super) fn needs_nothing_else() -> Result<(), Failed> {
    for robot in ["l2", "f1"] {
        let build = target().join(format!("linuxcnc-{robot}-symbols"));
        make(robot, &build, |header| header)?;
        let listing = run(Command::new("nm")
            .args(["-D", "--undefined-only"])
            .arg(build.join("gantrytaukins.so")))?;
        let needed: Vec<_> = listing
            .lines()
            .filter_map(|line| line.split_whitespace().nth(1))
            .collect();
        assert!(needed.contains(&"hal_init"), "{listing}");
        for symbol in needed {
            let name = symbol.split('@').next().unwrap();
            let known =
                name.starts_with("hal_") || name.starts_with("rtapi_") || ALLOWED.contains(&name);
            assert!(known, "{robot}: {name}");
        }
    }
    Ok(())
}

/// Ends at the programmed pose; joints at rest are those of `solve`; in motion they are the inverse
/// of the pose two periods ago, but for the interpolator.
pub(super) fn runs_a_part_program(robot: &'static str) -> Result<(), Failed> {
    assert_limits_are_the_travel(robot);
    let machine = Machine::new(robot, "part", |header| header)?;
    let ended = machine.run()?;
    assert_eq!(ended.lines("ended"), ["done"], "{}", ended.said);
    let programmed: &[f64] = if robot == "l2" {
        &[20.0, 507.5, 652.25]
    } else {
        &[120.0, 7.5, 302.25, 1.5, -2.25, 3.5]
    };
    assert_near(
        &ended.numbers("pose"),
        programmed,
        1e-6,
        "the end of the program",
    );
    // The screen prints nine digits.
    let [at_rest] = solve(robot, &[programmed.to_vec()]).try_into().unwrap();
    assert_near(&ended.numbers("joints"), &at_rest, STEP, "joints at rest");

    let motion = ended.motion();
    let axes: Vec<_> = motion.iter().map(|row| row.axes.clone()).collect();
    let solved = solve(robot, &axes);
    let last = motion.last().unwrap();
    assert_near(&last.joints, &at_rest, BOUND, "the last row");
    assert!(motion.iter().all(|row| row.refused == 0.0));
    assert!(
        motion.iter().all(|row| row.residual_m < 1e-10),
        "links have their lengths"
    );
    assert!(motion.len() > 3000, "{} rows", motion.len());
    in_motion(motion, &solved);
    Ok(())
}

/// The interpolator is a cubic B-spline: a joint is (before + 4 now + after) / 6 of what the
/// inverse says. The error that this makes is a sixth of the second difference.
fn in_motion(motion: &[Row], solved: &[Vec<f64>]) {
    let (mut largest, mut farthest) = ([0.0_f64; 2], 0.0_f64);
    for (now, row) in motion.iter().enumerate().skip(DELAY + 1) {
        let at = now - DELAY;
        for (joint, position) in row.joints.iter().enumerate() {
            let [before, middle, after] = [at - 1, at, at + 1].map(|row| solved[row][joint]);
            let smoothed = (before + 4.0 * middle + after) / 6.0;
            let bound = (before - 2.0 * middle + after).abs() / 6.0 + BOUND;
            let error = (position - middle).abs();
            assert!(
                (position - smoothed).abs() < BOUND,
                "row {now}, joint {joint}: {position}, not {smoothed}"
            );
            assert!(
                error < bound,
                "row {now}, joint {joint}: off by {error}, expected {bound}"
            );
            let kind = usize::from(joint >= 3);
            largest[kind] = largest[kind].max(error);
            farthest = farthest.max((position - motion[0].joints[joint]).abs());
        }
    }
    assert!(farthest > 5.0, "the program moves");
    // README.md states them, 3.0e-4 mm of a cart and 2.6e-5 degrees of a plate; how corners are
    // blended may differ a little from run to run.
    let [carts_mm, plates_degrees] = largest;
    assert!(
        (1e-4..4e-4).contains(&carts_mm) && plates_degrees < 4e-5,
        "{largest:?}"
    );
}

/// The end of a line is out of reach, within the limits of axes: LinuxCNC names the line, and no
/// joint moves.
pub(super) fn refuses_a_pose(robot: &'static str) -> Result<(), Failed> {
    let machine = Machine::new(robot, "pose", |header| header)?;
    machine.program(if robot == "l2" {
        "G21 G90\nG1 X0 Y800 Z950 F3000\nM2\n"
    } else {
        "G21 G90\nG1 A15 C-15 F600\nM2\n"
    })?;
    let ended = machine.run()?;
    let errors = ended.lines("error").join("\n");
    assert!(errors.contains("fails kinematicsInverse"), "{}", ended.said);
    assert_eq!(ended.lines("ended"), ["error"]);
    assert!(ended.record.0.iter().any(|row| row.refused > 0.0));
    stands_still(&ended, 0, f64::EPSILON);
    Ok(())
}

/// A circle that begins and ends within reach. The joints stop where a pose is refused, and the
/// machine is off.
pub(super) fn stops_where_a_path_leaves_its_reach() -> Result<(), Failed> {
    let machine = Machine::new("l2", "path", |header| header)?;
    machine.program("G21 G90 G19\nG0 Y560 Z850\nG4 P0.1\nG3 Y560 Z850 J60 K-20 F600\nM2\n")?;
    let ended = machine.run()?;
    // LinuxCNC may print it after the screen has ended on a busy computer.
    assert!(
        ended.said.contains("kinematicsInverse failed"),
        "{}",
        ended.said
    );
    let rows = &ended.record.0;
    let refused = rows.iter().position(|row| row.refused > 0.0).unwrap();
    let off = refused + rows[refused..].iter().position(|row| !row.is_on).unwrap();
    assert!(
        off - refused <= 2,
        "switched off {} periods after the refusal",
        off - refused
    );
    // The commands follow the references, which go towards the drives: lag times speed, and carts
    // are fast at the edge of the reach.
    stands_still(&ended, off + DELAY, 1.5);
    Ok(())
}

/// All joints have the same command, from a row on, within a tolerance, mm.
fn stands_still(ended: &Ended, from: usize, tolerance: f64) {
    // Before the machine is on for the first time the commands are not yet those of the drives.
    let on = ended.record.0.iter().position(|row| row.is_on).unwrap();
    let rows = &ended.record.0[from.max(on)..];
    for (number, row) in rows.iter().enumerate() {
        assert_near(
            &row.joints,
            &rows[0].joints,
            tolerance,
            &format!("row {number}"),
        );
    }
}

/// A header whose numbers were changed by hand is refused when the module is loaded, in one line.
pub(super) fn changed_header_is_not_loaded() -> Result<(), Failed> {
    let machine = Machine::new("l2", "header", |header| {
        let changed = header.replace(".lengths_m = {1.0,", ".lengths_m = {1.001,");
        assert_ne!(changed, header);
        changed
    })?;
    let ended = machine.run()?;
    let said = "gantrytaukins: machine.h was changed: its checksum is not that of its numbers";
    assert_eq!(ended.said.matches(said).count(), 1, "{}", ended.said);
    assert!(ended.record.0.is_empty(), "nothing runs");
    Ok(())
}

/// Joints by `gantry-tau solve`, mm and degrees, for poses in mm and degrees.
fn solve(robot: &str, poses: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../robots");
    let mut requests = String::new();
    for pose in poses {
        let tool_m = [0, 1, 2].map(|axis| pose[axis] / 1e3);
        let turned = pose.get(3..6).map_or(String::new(), |angles| {
            format!(",\"R\":{:?}", rotation(angles))
        });
        writeln!(
            requests,
            r#"{{"id":0,"robot":"{file}/{robot}.toml","op":"ik","T":{tool_m:?}{turned}}}"#
        )
        .unwrap();
    }
    let mut answers = Vec::new();
    gantry_tau::solve::run(requests.as_bytes(), &mut answers).unwrap();
    let answers = String::from_utf8(answers).unwrap();
    let joints = answers.lines().map(|line| {
        let answer: serde_json::Value = serde_json::from_str(line).unwrap();
        let q = answer["ok"]["q"]
            .as_array()
            .unwrap_or_else(|| panic!("{line}"));
        q.iter()
            .enumerate()
            .map(|(axis, q)| {
                let unit = if axis < 3 { 1e3 } else { 1_f64.to_degrees() };
                q.as_f64().unwrap() * unit
            })
            .collect()
    });
    joints.collect()
}

/// R = Rz(C) Ry(B) Rx(A), by rows, composed from the three turns.
fn rotation(angles: &[f64]) -> [[f64; 3]; 3] {
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let vector = nalgebra::Vector3::ith_axis(axis).into_inner() * angles[axis].to_radians();
        nalgebra::Rotation3::from_scaled_axis(vector)
    });
    let matrix = (z * y * x).into_inner();
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)]))
}

fn assert_near(found: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (number, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!(
            (found - expected).abs() <= tolerance,
            "{what}: {found} of {number}, expected {expected}"
        );
    }
}

/// The limits of joints in the INI file are the nominal travel of the robot file; those of plates
/// may be rounded inwards.
fn assert_limits_are_the_travel(robot: &str) {
    let travel: Vec<(f64, f64)> = match AnyRobotFile::named(robot).unwrap() {
        AnyRobotFile::L2(robot) => travel(&robot),
        AnyRobotFile::F1(robot) => travel(&robot),
    };
    let text =
        std::fs::read_to_string(super::run::folder().join(format!("config/{robot}/{robot}.ini")))
            .unwrap();
    for (joint, (lower, upper)) in travel.into_iter().enumerate() {
        let section = text.split(&format!("[JOINT_{joint}]\n")).nth(1).unwrap();
        let [low, high] = ["MIN_LIMIT", "MAX_LIMIT"].map(|key| -> f64 {
            let line = section
                .lines()
                .find_map(|line| line.strip_prefix(key))
                .unwrap();
            line.trim_start_matches(" = ").parse().unwrap()
        });
        assert!(
            (0.0..0.02).contains(&(low - lower)) && (0.0..0.02).contains(&(upper - high)),
            "joint {joint}: {low}, {high}"
        );
    }
}

/// Nominal travel of each axis, mm and degrees.
fn travel<K, const N: usize>(robot: &RobotFile<K, N>) -> Vec<(f64, f64)> {
    let axes = robot.limits.iter().zip(robot.metres_per_q).enumerate();
    let ends = axes.map(|(axis, (limits, metres_per_q))| {
        let travel = limits.nominal_travel;
        let [lower, upper] = [travel.lower, travel.upper].map(|end| {
            let metres = end.to_metres().0;
            if axis < 3 {
                metres * 1e3
            } else {
                (metres / metres_per_q).to_degrees()
            }
        });
        (lower, upper)
    });
    ends.collect()
}
