//! The firmware of `tests/firmware` on an emulated Cortex-M: it is built, it plays recordings, and
//! its outcome is the host's, bit by bit; its size and the cost of a cycle are compared with
//! `tests/firmware/sizes.toml`.
//!
//! Where the emulator or a toolchain for the target is missing, every test is reported as ignored
//! with the name of what is missing; with GANTRY_TAU_REQUIRE_FIRMWARE=1 it fails instead. With
//! GANTRY_TAU_RECORD_SIZES=1 the measurements are written to `sizes.toml`.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    clippy::as_conversions,
    reason = "helpers of tests fail by panicking; a mean may be rounded"
)]

mod budget;
mod emulator;
mod frontier;
mod host;
mod image;
#[path = "../../../firmware/src/ingress_budget.rs"]
mod ingress_budget;
#[path = "../../../firmware/src/keys.rs"]
mod keys;
mod link;
#[path = "../../../firmware/src/machine/mod.rs"]
mod machine;
#[path = "../../../firmware/src/no_keys.rs"]
mod no_keys;
mod process;
#[path = "../../../firmware/src/recording.rs"]
mod recording;
mod replay;
mod traffic;

use libtest_mimic::Trial;

use emulator::Build;
use replay::is_bit_equal;

pub(crate) use link::program;

/// Tests that need the emulator and a toolchain for the target. Those that build come first, so
/// that two variants are built at a time; the others of a variant come late, for they would wait.
const ON_TARGET: &[(&str, fn())] = &[
    ("m7_is_bit_equal_in_a_calm_session", || {
        is_bit_equal(Build::M7, traffic::calm())
    }),
    ("m4f_is_bit_equal_in_a_calm_session", || {
        is_bit_equal(Build::M4f, traffic::calm())
    }),
    ("m7_small_is_bit_equal_in_a_calm_session", || {
        is_bit_equal(Build::M7Small, traffic::calm())
    }),
    ("m7_is_bit_equal_in_a_calm_session_of_the_f1", || {
        is_bit_equal(Build::M7, traffic::calm_f1())
    }),
    ("m7_is_bit_equal_in_hostile_traffic", || {
        is_bit_equal(Build::M7, traffic::hostile())
    }),
    ("m7_with_keys_is_bit_equal", || {
        for recording in traffic::keyed() {
            is_bit_equal(Build::M7Keyed, recording);
        }
    }),
    ("a_changed_bit_is_seen", replay::a_changed_bit_is_seen),
    ("the_log_tells_the_session", replay::log_tells_the_session),
    (
        "a_real_client_drives_the_target",
        link::a_real_client_drives_the_target,
    ),
    ("a_linked_panic_is_seen", image::control_is_seen),
    ("m7_small_is_bit_equal_in_a_calm_session_of_the_f1", || {
        is_bit_equal(Build::M7Small, traffic::calm_f1())
    }),
    ("m7_small_is_bit_equal_in_hostile_traffic", || {
        is_bit_equal(Build::M7Small, traffic::hostile())
    }),
    ("the_image_has_no_panic", image::no_panic),
    ("the_images_are_as_small_as_recorded", image::sizes),
];

/// Those of them that need the decoder of its log.
const WITH_LOG: [&str; 2] = [
    "the_log_tells_the_session",
    "a_real_client_drives_the_target",
];

/// Tests that need the host only.
const ON_HOST: &[(&str, fn())] = &[
    (
        "recordings_show_every_phase",
        traffic::recordings_show_every_phase,
    ),
    (
        "recordings_with_keys_show_strangers",
        traffic::recordings_with_keys_show_strangers,
    ),
    (
        "the_f1_turns_far_and_recovers",
        traffic::the_f1_turns_far_and_recovers,
    ),
    ("recordings_replay_on_the_host", host::recordings_replay),
    ("excess_is_refused", host::excess_is_refused),
    (
        "the_machines_are_those_of_the_robot_files",
        host::machines_are_those_of_the_files,
    ),
    (
        "host_and_firmware_lock_the_same_mathematics",
        host::same_mathematics,
    ),
];

/// Returns all tests, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let required =
        std::env::var_os("GANTRY_TAU_REQUIRE_FIRMWARE").is_some_and(|value| value == "1");
    let missing = emulator::missing();
    let on_target = ON_TARGET.iter().map(|(name, test)| {
        let missing = missing
            .clone()
            .or_else(|| WITH_LOG.contains(name).then(emulator::decoder_missing)?);
        match (missing, required) {
            (None, _) => trial(name, *test),
            (Some(what), true) => Trial::test(format!("firmware::{name}"), move || {
                Err(format!("missing: {what}").into())
            }),
            (Some(what), false) => trial(name, *test)
                .with_kind(format!("ignored: missing {what}"))
                .with_ignored_flag(true),
        }
    });
    let on_host = ON_HOST.iter().map(|(name, test)| trial(name, *test));
    let frontier = frontier::is_asked_for().then(|| trial("frontier", frontier::draw));
    on_target.chain(on_host).chain(frontier).collect()
}

/// Makes a test that fails by panicking.
fn trial(name: &str, test: fn()) -> Trial {
    Trial::test(format!("firmware::{name}"), move || {
        test();
        Ok(())
    })
}
