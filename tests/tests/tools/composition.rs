//! The composition of the proofs, checked by Coq: what the theorems rest on is what the record says.
//!
//! Without `coqc` the trial is reported as ignored; with `GANTRY_TAU_REQUIRE_COQ=1` it fails instead.
#![allow(clippy::expect_used, reason = "tests fail by panicking")]

use std::process::Command;

use libtest_mimic::{Failed, Trial};

use crate::needing;

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let is_there = Command::new("coqc").arg("--version").output().is_ok();
    let missing = (!is_there).then(|| "coqc not found".to_owned());
    let name = "composition::is_checked_by_coq".to_owned();
    vec![needing::trial(
        name,
        missing,
        "GANTRY_TAU_REQUIRE_COQ",
        check,
    )]
}

fn check() -> Result<(), Failed> {
    let output = Command::new(env!("CARGO"))
        .args([
            "run",
            "-q",
            "-p",
            "gantry-tau-proofs",
            "--",
            "check",
            "--coq",
        ])
        .output()
        .expect("cargo runs");
    if output.status.success() {
        return Ok(());
    }
    Err(String::from_utf8_lossy(&output.stderr).into_owned().into())
}
