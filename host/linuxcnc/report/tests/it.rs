//! The program: usage and exit codes.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use std::process::{Command, Output};

fn run(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gantry-tau-linuxcnc-report"))
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn a_folder_without_a_record_is_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let ended = run(&[folder.path().to_str().unwrap(), "--robot", "f1"]);
    let said = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(1), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(said.contains("joints.txt"), "{said}");
    assert_eq!(run(&[]).status.code(), Some(2));
}
