//! The composition of the proofs, checked by Coq: what the theorems rest on is what the record says.
//!
//! Without `coqc` the trial is reported as ignored; with `GANTRY_TAU_REQUIRE_COQ=1` it fails instead.
#![allow(clippy::expect_used, reason = "tests fail by panicking")]

use std::process::Command;

use libtest_mimic::{Failed, Trial};

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let is_there = Command::new("coqc").arg("--version").output().is_ok();
    let is_required = std::env::var_os("GANTRY_TAU_REQUIRE_COQ").is_some_and(|value| value == "1");
    let trial = Trial::test("composition::is_checked_by_coq", check);
    vec![if is_there || is_required {
        trial
    } else {
        trial.with_kind("coqc not found").with_ignored_flag(true)
    }]
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
