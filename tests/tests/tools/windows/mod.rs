//! `gantry-tau client` for Windows, cross-compiled, under Wine against the server on this computer
//! `[T 5.1.2]`.
//!
//! A trial whose tool is missing is reported as ignored, by name; with
//! `GANTRY_TAU_REQUIRE_WINDOWS=1` it fails instead.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail by panicking")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use gantry_tau_core::control::message::{Cause, Phase};
use libtest_mimic::{Failed, Trial};

use crate::capi::tools::has;
use crate::needing;
use crate::session::{Session, Tool};

const TARGET: &str = "x86_64-pc-windows-gnu";
/// Wine, in the PATH or where Debian's package wine64 puts it.
const WINES: [&str; 3] = ["wine64", "wine", "/usr/lib/wine/wine64"];

fn run() -> Result<(), Failed> {
    compensates_and_obeys();
    Ok(())
}

/// All trials, by name.
pub(crate) fn trials() -> Vec<Trial> {
    let name = "windows::client_under_wine_compensates_and_obeys_its_operator".to_owned();
    let missing = missing().map(|tool| format!("{tool} missing"));
    vec![needing::trial(
        name,
        missing,
        "GANTRY_TAU_REQUIRE_WINDOWS",
        run,
    )]
}

/// Returns a tool that is not there.
fn missing() -> Option<&'static str> {
    let libraries = Command::new("rustc")
        .args(["--print", "target-libdir", "--target", TARGET])
        .output();
    let has_library = libraries
        .is_ok_and(|said| Path::new(String::from_utf8_lossy(&said.stdout).trim()).is_dir());
    if !has("x86_64-w64-mingw32-gcc") {
        Some("x86_64-w64-mingw32-gcc")
    } else if !has_library {
        Some("Rust's library for x86_64-pc-windows-gnu")
    } else if !WINES.iter().any(|wine| has(wine)) {
        Some("wine64")
    } else {
        None
    }
}

/// Builds the program, and beside it the library that Wine 8 lacks; returns its path.
fn build() -> PathBuf {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("windows");
    let status = Command::new(env!("CARGO"))
        .args([
            "build",
            "--quiet",
            "--locked",
            "-p",
            "gantry-tau",
            "--bin",
            "gantry-tau",
            "--target",
            TARGET,
        ])
        .arg("--target-dir")
        .arg(&target)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .status();
    assert!(status.unwrap().success());
    let folder = target.join(TARGET).join("debug");
    let source =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/windows/bcryptprimitives.c");
    let mut gcc = Command::new("x86_64-w64-mingw32-gcc");
    gcc.arg("-shared")
        .arg("-o")
        .arg(folder.join("bcryptprimitives.dll"))
        .arg(source)
        .arg("-ladvapi32");
    assert!(gcc.status().unwrap().success());
    folder.join("gantry-tau.exe")
}

fn compensates_and_obeys() {
    let program = build();
    let prefix = Path::new(env!("CARGO_TARGET_TMPDIR")).join("wine");
    let mut session = Session::new(Tool::Steps(60.0, 0.3));
    let server = session.address();
    let wine = WINES.into_iter().find(|wine| has(wine)).unwrap();
    let mut client = Command::new(wine)
        .arg(program)
        .args(["client", &server])
        .env("WINEPREFIX", prefix)
        .env("WINEDEBUG", "-all")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    session.until("an offset that compensates", |row| {
        row.state.axes[1].offsets.position.0 < -40_000
    });
    let input = client.stdin.as_mut().unwrap();
    input.write_all(b"status\r\nsubmit\r\n").unwrap();
    session.until("Submit", |row| row.state.phase == Phase::Submit);
    input.write_all(b"quit\r\n").unwrap();
    let (code, said) = session.end_of(client);
    assert_eq!(code, Some(0), "{said}");
    assert!(
        said.contains("left with Goodbye after ") && said.contains(": offsets "),
        "{said}"
    );
    assert_eq!(session.ramped(), Cause::Goodbye);
    session.quit();
}
