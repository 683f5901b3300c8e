//! The client in Python (`host/python`), its examples, and controllers that fail, against the
//! server in lock-step.
//!
//! A trial without python3 is reported as ignored; with `GANTRY_TAU_REQUIRE_PYTHON=1` it fails
//! instead.
#![allow(
    clippy::arithmetic_side_effects,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests fail by panicking"
)]

mod examples;
mod failures;
#[cfg(unix)]
mod keys;
mod package;
mod peers;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use libtest_mimic::{Failed, Trial};

use crate::capi::tools::has;
use crate::needing;

/// `host/python`.
fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../host/python")
}

/// Python, with output that is read as a whole.
fn python() -> Command {
    let mut python = Command::new("env");
    // A script's background jobs ignore SIGINT, and so would their children. No bytecode beside the
    // sources.
    python
        .args(["--default-signal=INT", "python3", "-B"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    python
}

/// A check that fails by panicking.
type Check = fn();

fn passed(check: Check) -> Result<(), Failed> {
    check();
    Ok(())
}

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let all = examples::TRIALS
        .iter()
        .chain(failures::TRIALS)
        .chain(peers::TRIALS);
    #[cfg(unix)]
    let all = all.chain(keys::TRIALS);
    let all = all.map(|&(name, check)| trial(name, check));
    all.chain(package::trials()).collect()
}

fn trial(name: &str, check: Check) -> Trial {
    let missing = (!has("python3")).then(|| "python3 missing".to_owned());
    needing::trial(
        format!("python::{name}"),
        missing,
        "GANTRY_TAU_REQUIRE_PYTHON",
        move || passed(check),
    )
}
