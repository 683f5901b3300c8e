//! The program `gantry-tau` as a process.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::PATIENCE;
use crate::firmware::process::Process;

/// Builds the program as `cargo test` does, with whose features nothing is built twice. Returns its
/// path.
pub(crate) fn build() -> PathBuf {
    let whole = ["test", "--workspace", "--no-run", "--test", "it"];
    cargo(&whole, "test").join("gantry-tau")
}

/// Runs a command of cargo where this test was built: in its folder, in a profile that gives what was
/// built for it. `debug`: that profile where it is not a release. Returns the folder.
pub(crate) fn cargo(arguments: &[&str], debug: &str) -> PathBuf {
    let test = std::env::current_exe().unwrap();
    let profile = test.ancestors().nth(2).unwrap();
    let is_debug = profile.ends_with("debug");
    let status = Command::new(env!("CARGO"))
        .args(arguments)
        .args(["--quiet", "--locked"])
        .args(["--profile", if is_debug { debug } else { "release" }])
        .arg("--target-dir")
        .arg(profile.parent().unwrap())
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .status()
        .unwrap();
    assert!(status.success());
    profile.to_owned()
}

/// The running program.
pub(super) struct Running {
    /// Its process.
    pub(super) process: Process,
    errors: PathBuf,
}

impl Running {
    /// Starts it with `arguments`; its output goes to files in `place` called `name`.
    pub(super) fn start(program: &Path, place: &Path, name: &str, arguments: &[&str]) -> Self {
        let [out, errors] = ["out", "err"].map(|end| place.join(format!("{name}.{end}")));
        let process = Process::start(
            Command::new(program)
                .args(arguments)
                .env("STATE_DIRECTORY", place)
                .env_remove("RUST_LOG")
                .stdin(Stdio::null())
                .stdout(File::create(out).unwrap())
                .stderr(File::create(&errors).unwrap()),
        );
        Self { process, errors }
    }

    /// Waits for its end. Returns exit code and stderr.
    pub(super) fn end(mut self) -> (Option<i32>, String) {
        let status = self
            .process
            .end(PATIENCE, || std::fs::read_to_string(&self.errors).unwrap());
        let errors = std::fs::read_to_string(&self.errors).unwrap();
        (status.code(), errors)
    }
}
