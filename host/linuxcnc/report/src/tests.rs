//! The report on records that were computed, not played.

use std::fmt::Write as _;

use gantry_tau_core::control::message::{Cause, Phase};
use gantry_tau_core::model::kinematics::Pose;
use gantry_tau_core::model::statics::Wrench;
use gantry_tau_core::units::OffsetNm;
use gantry_tau_machine::model::{L2, on_path};
use gantry_tau_machine::sensor::Mounting;
use nalgebra::{UnitQuaternion, Vector6};

use super::*;

const FORCE_N: f64 = 300.0;
/// Largest change of an offset, and that on a ramp, nm per period.
const STEP: i32 = 5_000;
const RAMP: i32 = 100;

struct Row {
    phase: Phase,
    is_loaded: bool,
    offset_nm: [i32; 3],
    /// Error of the references.
    strayed_nm: i64,
    tick: usize,
}

/// A demonstration: one client held, killed, ramp; the next one held, and its load released.
struct Played {
    robot: RobotFile<L2, 3>,
    nominal_nm: [i64; 3],
    rows: Vec<Row>,
}

impl Played {
    fn new() -> Self {
        let mut robot = RobotFile::builtin_l2().unwrap();
        // The client knows the springs: what remains is what the first order leaves.
        robot.simulation.spring_deviation = 0.0;
        let home_m = robot.home_m();
        let nominal = on_path(&robot.model.axes_at(&home_m).unwrap(), &robot.metres_per_q).unwrap();
        let mut compensator = robot.compensator([OffsetNm(2_000_000); 3]).unwrap();
        let pose: Pose = compensator.locate(&nominal).unwrap();
        let load = Wrench::from_array([FORCE_N, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let held = compensator
            .correct(&pose, &nominal, &load)
            .unwrap()
            .offsets
            .map(|offset| offset.0);
        let mut played = Self {
            robot,
            nominal_nm: nominal.map(|position| position.0),
            rows: Vec::new(),
        };
        for is_killed in [true, false] {
            played.part(20, Phase::Submit, false, |_| 0);
            played.part(1_100, Phase::Obtain, true, |axis| held[axis]);
            if is_killed {
                played.part(4_000, Phase::SafeDisconnect, true, |_| 0);
                played.part(500, Phase::Listening, true, |_| 0);
            } else {
                played.part(500, Phase::Obtain, false, |_| 0);
            }
            played.part(10, Phase::Listening, false, |_| 0);
        }
        played
    }

    /// Periods in which the offsets go to a target as fast as they may.
    fn part(
        &mut self,
        periods: usize,
        phase: Phase,
        is_loaded: bool,
        target_nm: impl Fn(usize) -> i32,
    ) {
        let largest = if phase == Phase::SafeDisconnect {
            RAMP
        } else {
            STEP
        };
        for _ in 0..periods {
            let (mut offset_nm, tick) = self
                .rows
                .last()
                .map_or(([0; 3], 0), |row| (row.offset_nm, row.tick));
            // After a delay a burst of periods has no ticks.
            let has_tick = self.rows.len() % 1_000 > 7;
            if has_tick {
                for (axis, offset) in offset_nm.iter_mut().enumerate() {
                    *offset += (target_nm(axis) - *offset).clamp(-largest, largest);
                }
            }
            self.rows.push(Row {
                phase,
                is_loaded,
                offset_nm,
                strayed_nm: 0,
                tick: tick + usize::from(has_tick),
            });
        }
    }

    /// Writes the record, with a path of 20 µm per period along the guideways, and reports on it.
    fn report(&self) -> (Results, String) {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let (mut joints, mut server) = (String::new(), String::new());
        let mounting = Mounting::from(&self.robot.sensor);
        for (number, row) in self.rows.iter().enumerate() {
            let moved = 20_000 * i64::try_from(number).unwrap();
            let nominal = self.nominal_nm.map(|nm| nm + moved);
            let reference = [0, 1, 2]
                .map(|axis| nominal[axis] + i64::from(row.offset_nm[axis]) + row.strayed_nm);
            // LinuxCNC has no whole nanometres; the component has.
            let command = nominal.map(|nm| format!("{nm}.25"));
            let counts = reference
                .into_iter()
                .chain(row.offset_nm.map(i64::from))
                .map(|nm| nm.to_string());
            let line: Vec<String> = command.into_iter().chain(counts).collect();
            writeln!(joints, "{number} {}", line.join(" ")).unwrap();
            let force = if row.is_loaded { FORCE_N } else { 0.0 };
            let raw = mounting.seen(
                &Vector6::new(force, 0.0, 0.0, 0.0, 0.0, 0.0),
                &UnitQuaternion::identity(),
            );
            let raw = raw
                .iter()
                .map(|value| format!("{value:.6} "))
                .collect::<String>();
            writeln!(
                server,
                "{number} {raw}{} {} 0 {}",
                row.phase.code(),
                Cause::Closed.code(),
                row.tick
            )
            .unwrap();
        }
        std::fs::write(folder.join("joints.txt"), joints).unwrap();
        std::fs::write(folder.join("server.txt"), server).unwrap();
        std::fs::write(folder.join("said.txt"), "  1.0 s  a < b\n").unwrap();
        let results = report(&self.robot, folder).unwrap();
        let numbers = std::fs::read_to_string(folder.join("report.json")).unwrap();
        let numbers: serde_json::Value = serde_json::from_str(&numbers).unwrap();
        assert_eq!(numbers["periods"], results.periods);
        let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
        (results, page)
    }
}

/// Displacement at home by `gantry-tau solve`, µm: first order, apart from the equilibrium that the
/// report computes.
fn solved_um() -> f64 {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../robots/l2.toml");
    let request = format!(
        r#"{{"id":0,"robot":"{file}","op":"deflection","T":[0.0,0.5,0.65],"w":[{FORCE_N},0,0,0,0,0]}}"#
    );
    let mut answer = Vec::new();
    gantry_tau::solve::run(request.as_bytes(), &mut answer).unwrap();
    let answer: serde_json::Value = serde_json::from_slice(&answer).unwrap();
    let moved = answer["ok"]["dx_total"]
        .as_array()
        .unwrap_or_else(|| panic!("{answer}"));
    moved
        .iter()
        .take(3)
        .map(|value| value.as_f64().unwrap().powi(2))
        .sum::<f64>()
        .sqrt()
        * 1e6
}

#[test]
fn as_much_may_remain_as_in_the_demo() {
    assert!((results::ALLOWED_SHARE - gantry_tau::demo::ALLOWED_SHARE).abs() < f64::EPSILON);
}

#[test]
fn sessions_ramp_and_displacements_are_found() {
    let (results, page) = Played::new().report();
    assert_eq!(results.complaints, Vec::<String>::new());
    let [first, second] = results.sessions.as_slice() else {
        panic!("{results:?}")
    };
    // The equilibrium is nonlinear by some 2 %.
    let expected = solved_um();
    for session in [first, second] {
        assert!(
            (session.uncompensated_um / expected - 1.0).abs() < 0.02,
            "{session:?}, expected {expected}"
        );
        assert!(session.remaining_share < 0.03, "{session:?}");
        assert_eq!((session.moving + 1, session.missed), (session.periods, 0));
    }
    let [ramp] = results.ramps.as_slice() else {
        panic!("{results:?}")
    };
    assert_eq!((ramp.ticks, ramp.inexact), (ramp.expected_ticks, 0));
    assert_eq!(results.largest_change_nm, 5_000);
    assert!(page.contains("a &lt; b") && page.contains("All as it should be."));
    // Two paths, displacement, offsets, ramp, force, position, state.
    assert_eq!(page.matches("<svg").count(), 8);
}

#[test]
fn a_step_that_the_core_does_not_take_is_a_complaint() {
    let mut played = Played::new();
    let at = played
        .rows
        .iter()
        .position(|row| row.phase == Phase::SafeDisconnect)
        .unwrap();
    played.rows[at + 5].offset_nm[1] += 1;
    let (results, page) = played.report();
    assert!(
        results
            .complaints
            .iter()
            .any(|text| text.contains("2 of its steps are not exact")),
        "{results:?}"
    );
    assert!(page.contains("Not as it should be"));

    let mut played = Played::new();
    let at = played
        .rows
        .iter()
        .position(|row| row.phase == Phase::Obtain)
        .unwrap();
    played.rows[at].offset_nm[2] -= 5_001;
    let (results, _) = played.report();
    assert!(
        results
            .complaints
            .iter()
            .any(|text| text.starts_with(&format!("period {at}:"))),
        "{results:?}"
    );
}

#[test]
fn a_reference_that_is_not_command_plus_offset_is_a_complaint() {
    let mut played = Played::new();
    for row in &mut played.rows[700..] {
        row.strayed_nm = 1;
    }
    let (results, _) = played.report();
    let [complaint] = results.complaints.as_slice() else {
        panic!("{results:?}")
    };
    assert!(
        complaint.starts_with("period 700: joint 0 is at "),
        "{complaint}"
    );
}

#[test]
fn a_session_without_compensation_is_a_complaint() {
    let mut played = Played::new();
    for row in &mut played.rows {
        row.offset_nm = [0; 3];
    }
    let (results, _) = played.report();
    let remains = results
        .complaints
        .iter()
        .filter(|text| text.contains("100.0 % of the displacement remain"));
    assert_eq!(remains.count(), 2, "{results:?}");
}
