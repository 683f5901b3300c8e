//! LinuxCNC (`host/linuxcnc`): its modules are built, loaded and run headless, as an unprivileged
//! user, in namespaces of their own.
//!
//! A trial whose tool is missing is reported as ignored, by name; with
//! `GANTRY_TAU_REQUIRE_LINUXCNC=1` it fails instead, and the long ones run too.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

mod component;
mod header;
mod integrated;
mod kinematics;
mod record;
mod run;
mod scripts;
mod server;

use std::panic::{catch_unwind, resume_unwind};

use libtest_mimic::{Failed, Trial};

pub(crate) use server::hal::remove_folder;

use crate::capi::tools::has;

/// A check, without what it needs.
type Check = fn() -> Result<(), Failed>;

/// Trials that run a machine by the clock for 10 s and more each. `.ci/run` runs them; a bare
/// `cargo test` runs the others, with a part program, a session and an end of each kind.
const LONG: [&str; 10] = [
    "f1_runs_a_part_program",
    "l2_stops_where_a_path_leaves_its_reach",
    "demonstration",
    "eoffset_does_what_the_readme_says",
    "l2_compensates_while_a_program_runs",
    "f1_compensates_while_a_program_runs",
    "sessions_end_by_machine_off_estop_stop_and_an_unreachable_pose",
    "sessions_end_by_a_pulled_cable_a_stopped_client_and_a_silent_sensor",
    "server_refuses_bad_parameters_in_one_line",
    "bursts_hold_offsets",
];

/// Line of the component where LinuxCNC called it much too late, which is a stop.
const LATE: &str = "the thread was late by more than 250 periods";
/// Tries of a check on a machine that is so busy.
const MAX_TRIES: u32 = 5;

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let mut trials = vec![trial("header_compiles", &["gcc"], header::compiles)];
    let missing = run::missing();
    let all: &[(&str, Check)] = &[
        ("modules_need_nothing_else", kinematics::needs_nothing_else),
        ("l2_runs_a_part_program", || {
            kinematics::runs_a_part_program("l2")
        }),
        ("f1_runs_a_part_program", || {
            kinematics::runs_a_part_program("f1")
        }),
        ("l2_refuses_a_pose_and_nothing_moves", || {
            kinematics::refuses_a_pose("l2")
        }),
        ("f1_refuses_a_pose_and_nothing_moves", || {
            kinematics::refuses_a_pose("f1")
        }),
        (
            "l2_stops_where_a_path_leaves_its_reach",
            kinematics::stops_where_a_path_leaves_its_reach,
        ),
        ("demonstration", scripts::demonstration),
        (
            "eoffset_does_what_the_readme_says",
            scripts::does_what_the_readme_says,
        ),
        (
            "a_changed_header_is_not_loaded",
            kinematics::changed_header_is_not_loaded,
        ),
        ("component_with_a_clock_of_its_own", component::cases),
        (
            "make_builds_where_cargo_is_told_to",
            component::makes_elsewhere,
        ),
    ];
    trials.extend(
        all.iter()
            .chain(server::TRIALS)
            .chain(integrated::TRIALS)
            .map(|&(name, run)| trial(name, missing.as_slice(), run)),
    );
    trials
}

/// A trial with the tools that it needs: programs, or what [`run::missing`] names.
fn trial(name: &str, needed: &[&'static str], check: Check) -> Trial {
    let is_long = LONG.contains(&name);
    let name = format!("linuxcnc::{name}");
    let is_required =
        std::env::var_os("GANTRY_TAU_REQUIRE_LINUXCNC").is_some_and(|value| value == "1");
    let Some(missing) = needed.iter().find(|tool| !has(tool)) else {
        let trial = Trial::test(name, move || unless_late(check));
        return if is_long && !is_required {
            trial
                .with_kind("long: GANTRY_TAU_REQUIRE_LINUXCNC=1 runs it")
                .with_ignored_flag(true)
        } else {
            trial
        };
    };
    let kind = format!("{missing} missing");
    if is_required {
        let reason = kind.clone();
        return Trial::test(name, move || Err(Failed::from(reason))).with_kind(kind);
    }
    Trial::test(name, move || unless_late(check))
        .with_kind(kind)
        .with_ignored_flag(true)
}

/// Runs a check, and again where it failed and LinuxCNC's thread was late.
fn unless_late(check: Check) -> Result<(), Failed> {
    for _ in 1..MAX_TRIES {
        let ended = catch_unwind(check);
        let was_late = match &ended {
            Ok(Ok(())) => return Ok(()),
            Ok(Err(failed)) => failed.message().is_some_and(|said| said.contains(LATE)),
            Err(panic) => panic
                .downcast_ref::<String>()
                .is_some_and(|said| said.contains(LATE)),
        };
        if !was_late {
            return ended.unwrap_or_else(|panic| resume_unwind(panic));
        }
        println!("again: {LATE}");
    }
    check()
}
